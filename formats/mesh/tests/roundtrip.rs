//! Tests that random meshes, written in each format here and read back, have the same faces to the bit.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use granita_base::{Interp, Location, Param, Reporter, ShapeDesc};
use granita_mesh::{Gltf, Obj, Ply};
use granita_scene::{Call, Generator, GeneratorSource, SceneSink, Stop};
use proptest::prelude::*;
use std::fmt::Write;
use std::ops::Range;

/// Faces with the properties of their corners.
#[derive(Clone, Debug, PartialEq)]
struct Mesh {
    positions: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    texcoords: Vec<[f32; 2]>,
    /// The indices of position, normal and texture coordinates of each corner.
    faces: Vec<Vec<[usize; 3]>>,
}

/// The result of a reader, with position, normal, s and t for each corner.
type Corners = Vec<Vec<[f32; 8]>>;

fn meshes(corners: Range<usize>, joint: bool) -> impl Strategy<Value = Mesh> {
    let number = || prop_oneof![-1.0e3f32..1.0e3, Just(0.0), -1.0e-30f32..1.0e-30, -1.0e30f32..1.0e30];
    let unit = || (-1.0f32..1.0, -1.0f32..1.0, 0.1f32..1.0).prop_map(|(x, y, z)| [x, y, z]);
    let position = (number(), number(), number()).prop_map(|(x, y, z)| [x, y, z]);
    let tables = (
        prop::collection::vec(position, 3..20),
        prop::collection::vec(unit(), 20),
        prop::collection::vec((0.0f32..1.0, 0.0f32..1.0).prop_map(|(u, v)| [u, v]), 20),
    );
    tables.prop_flat_map(move |(positions, normals, texcoords)| {
        let n = positions.len();
        let corner =
            (0..n, 0..20usize, 0..20usize).prop_map(move |(p, n, t)| if joint { [p; 3] } else { [p, n, t] });
        let faces = prop::collection::vec(prop::collection::vec(corner, corners.clone()), 1..12);
        (Just(positions), Just(normals), Just(texcoords), faces)
            .prop_map(|(positions, normals, texcoords, faces)| Mesh { positions, normals, texcoords, faces })
    })
}

/// Returns the expected corners. `flip` is true where t of the file points up.
fn corners(mesh: &Mesh, flip: bool) -> Corners {
    let corner = |[p, n, t]: &[usize; 3]| {
        let (p, n, t) = (mesh.positions[*p], mesh.normals[*n], mesh.texcoords[*t]);
        [p[0], p[1], p[2], n[0], n[1], n[2], t[0], if flip { 1.0 - t[1] } else { t[1] }]
    };
    mesh.faces.iter().map(|face| face.iter().map(corner).collect()).collect()
}

#[derive(Default)]
struct Recorder(Corners);

impl SceneSink for Recorder {
    fn call(&mut self, call: Call, _: &Location) -> Result<(), Stop> {
        let Call::Shape { shape, params } = call else { return Ok(()) };
        let ShapeDesc::Mesh { nverts, verts, .. } = *shape else { panic!("no mesh") };
        let mut corner = 0;
        for n in nverts.iter() {
            let face = (corner..corner + *n as usize).map(|c| {
                let mut all = Vec::with_capacity(8);
                for name in ["P", "N", "s", "t"] {
                    let param: &Param = params.get(name).unwrap();
                    let width = param.ty.width();
                    let at = if param.ty.interp == Interp::Linear { c } else { verts[c] as usize };
                    all.extend_from_slice(&param.data.to_floats().unwrap()[at * width..(at + 1) * width]);
                }
                all.try_into().unwrap()
            });
            self.0.push(face.collect());
            corner += *n as usize;
        }
        Ok(())
    }
}

fn read(generator: &dyn Generator, bytes: &[u8]) -> Corners {
    let source = GeneratorSource::bytes("t", bytes);
    let (reporter, kept) = Reporter::collecting();
    let mut recorder = Recorder::default();
    generator.run(&source, &mut recorder, &reporter).unwrap();
    assert!(kept.lock().is_empty(), "{:?}", kept.lock());
    recorder.0
}

/// Writes OBJ. `relative` writes indices that count backwards. Each group has `blocks` faces.
fn obj(mesh: &Mesh, relative: bool, blocks: usize) -> String {
    let mut text = String::new();
    for [x, y, z] in &mesh.positions {
        let _ = writeln!(text, "v {x:?} {y:?} {z}");
    }
    for [x, y, z] in &mesh.normals {
        let _ = writeln!(text, "vn {x} {y:e} {z}");
    }
    for [u, v] in &mesh.texcoords {
        let _ = writeln!(text, "vt {u} {v}");
    }
    let number = |i: usize, of: usize| if relative { i as i64 - of as i64 } else { i as i64 + 1 };
    for (i, face) in mesh.faces.iter().enumerate() {
        if i % blocks == 0 {
            let _ = writeln!(text, "g part{i}");
        }
        text.push('f');
        for [p, n, t] in face {
            let (p, n) = (number(*p, mesh.positions.len()), number(*n, mesh.normals.len()));
            let _ = write!(text, " {p}/{}/{n}", number(*t, mesh.texcoords.len()));
        }
        text.push('\n');
    }
    text
}

/// Writes PLY, in which all properties of a vertex belong to its position.
fn ply(mesh: &Mesh, format: &str) -> Vec<u8> {
    let mut bytes =
        format!("ply\nformat {format} 1.0\nelement vertex {}\n", mesh.positions.len()).into_bytes();
    for name in ["x", "y", "z", "nx", "ny", "nz", "s", "t"] {
        bytes.extend(format!("property float {name}\n").bytes());
    }
    let faces = mesh.faces.len();
    bytes.extend(
        format!("element face {faces}\nproperty list ushort int vertex_indices\nend_header\n").bytes(),
    );
    let mut put = |value: &str, little: &[u8], end: bool| match format {
        "ascii" => bytes.extend(format!("{value}{}", if end { '\n' } else { ' ' }).bytes()),
        "binary_little_endian" => bytes.extend(little),
        _ => bytes.extend(little.iter().rev()),
    };
    for ((p, n), t) in mesh.positions.iter().zip(&mesh.normals).zip(&mesh.texcoords) {
        for (i, x) in p.iter().chain(n).chain(t).enumerate() {
            put(&x.to_string(), &x.to_le_bytes(), i == 7);
        }
    }
    for face in &mesh.faces {
        let n = face.len();
        put(&n.to_string(), &(n as u16).to_le_bytes(), false);
        for (i, [p, ..]) in face.iter().enumerate() {
            put(&p.to_string(), &(*p as i32).to_le_bytes(), i + 1 == n);
        }
    }
    bytes
}

/// Writes a binary glTF file, whose faces are triangles.
fn glb(mesh: &Mesh) -> Vec<u8> {
    let n = mesh.positions.len();
    let mut bin = Vec::new();
    // The values are interleaved, with 32 bytes per vertex.
    for ((p, m), t) in mesh.positions.iter().zip(&mesh.normals).zip(&mesh.texcoords) {
        p.iter().chain(m).chain(t).for_each(|x| bin.extend(x.to_le_bytes()));
    }
    let indices: Vec<u8> = mesh.faces.iter().flatten().map(|[p, ..]| *p as u8).collect();
    let count = indices.len();
    bin.extend(&indices);
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"nodes":[{{"mesh":0}}],"buffers":[{{"byteLength":{}}}],"bufferViews":[
        {{"buffer":0,"byteLength":{},"byteStride":32}},{{"buffer":0,"byteOffset":{},"byteLength":{count}}}],"accessors":[
        {{"bufferView":0,"componentType":5126,"count":{n},"type":"VEC3"}},
        {{"bufferView":0,"byteOffset":12,"componentType":5126,"count":{n},"type":"VEC3"}},
        {{"bufferView":0,"byteOffset":24,"componentType":5126,"count":{n},"type":"VEC2"}},
        {{"bufferView":1,"componentType":5121,"count":{count},"type":"SCALAR"}}],"meshes":[{{"primitives":[
        {{"attributes":{{"POSITION":0,"NORMAL":1,"TEXCOORD_0":2}},"indices":3}}]}}]}}"#,
        bin.len(),
        n * 32,
        n * 32,
    );
    let mut json = json.into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    bin.resize(bin.len().next_multiple_of(4), 0);
    let mut all = b"glTF\x02\0\0\0".to_vec();
    all.extend((28 + json.len() as u32 + bin.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", json), (b"BIN\0", bin)] {
        all.extend((chunk.len() as u32).to_le_bytes());
        all.extend(kind);
        all.extend(chunk);
    }
    all
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn as_obj(mesh in meshes(3..7, false), relative: bool, blocks in 1usize..5) {
        prop_assert_eq!(read(&Obj, obj(&mesh, relative, blocks).as_bytes()), corners(&mesh, true));
    }

    #[test]
    fn as_ply(mesh in meshes(3..7, true), format in 0usize..3) {
        let format = ["ascii", "binary_little_endian", "binary_big_endian"][format];
        prop_assert_eq!(read(&Ply, &ply(&mesh, format)), corners(&mesh, true));
    }

    #[test]
    fn as_gltf(mesh in meshes(3..4, true)) {
        prop_assert_eq!(read(&Gltf, &glb(&mesh)), corners(&mesh, false));
    }
}
