//! Tests readers with arbitrary bytes.
//!
//! Each target takes bytes and must return, without a panic, an endless loop, or an allocation beyond its limits.
//! `fuzz/` wraps the targets for libFuzzer. The ordinary tests run them with the corpus in `fuzz/corpus/TARGET` and
//! with mutations of it, which are the same on every machine.

use granita_base::{Interp, Location, Reporter, ShapeDesc, hash};
use granita_image::Limits;
use granita_pyg::{PygOptions, PygSource};
use granita_scene::{Call, GeneratorSource, SceneSink, Stop};

/// A function that must survive any bytes.
pub type Target = fn(&[u8]);

/// All targets by name.
pub const TARGETS: [(&str, Target); 42] = [
    ("pyg", pyg),
    ("calls", calls),
    ("rib", rib),
    ("gsl", gsl),
    ("gso", gso),
    ("tiff", tiff),
    ("exr", exr),
    ("png", png),
    ("hdr", hdr),
    ("jpeg", jpeg),
    ("tga", tga),
    ("bmp", bmp),
    ("pnm", pnm),
    ("pfm", pfm),
    ("gif", gif),
    ("qoi", qoi),
    ("webp", webp),
    ("sgi", sgi),
    ("iff", iff),
    ("dds", dds),
    ("dpx", dpx),
    ("cineon", cineon),
    ("psd", psd),
    ("fits", fits),
    ("rla", rla),
    ("softimage", softimage),
    ("ico", ico),
    ("jpegxl", jpegxl),
    ("jpeg2000", jpeg2000),
    ("exif", exif),
    ("iptc", iptc),
    ("obj", obj),
    ("ply", ply),
    ("stl", stl),
    ("gltf", gltf),
    ("draco", draco),
    ("meshopt", meshopt),
    ("sdb", sdb),
    ("display", display),
    ("ocio", ocio),
    ("lut", lut),
    ("icc", icc),
];

/// Returns limits that keep a hostile file from causing much work.
fn limits() -> Limits {
    Limits {
        dimension: 1 << 12,
        pixels: 1 << 20,
        bytes: 16 << 20,
        channels: 64,
        images: 64,
        ..Limits::default()
    }
}

/// Reads a configuration of colours, and makes some conversions of it.
pub fn ocio(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let path = std::path::Path::new("fuzz.ocio");
    let Ok(config) = granita_color::Config::from_text(&text, path, &nothing()) else { return };
    let names: Vec<&str> = config.color_spaces().take(8).map(|space| &*space.name).collect();
    for from in &names {
        for to in &names {
            if let Ok(processor) = config.processor(from, to) {
                let _ = processor.map([0.2, -1.0, f32::NAN]);
            }
        }
    }
    for display in config.displays().into_iter().take(4) {
        for view in config.views(display).into_iter().take(4) {
            let _ = config.display_processor(names.first().unwrap_or(&""), display, view);
        }
    }
    let _ = config.space_of_file("a/b.exr");
}

/// Reads files of tables of all formats.
pub fn lut(bytes: &[u8]) {
    let config = granita_color::Config::built_in();
    for extension in ["cube", "spi1d", "spi3d", "spimtx", "csp", "3dl", "cc", "clf"] {
        let path = format!("fuzz.{extension}");
        if let Ok(processor) = config.bytes_processor(bytes, std::path::Path::new(&path)) {
            let _ = processor.map([0.2, -1.0, f32::NAN]);
        }
    }
}

/// Reads an ICC profile.
pub fn icc(bytes: &[u8]) {
    if let Ok(encoding) = granita_color::Encoding::icc(bytes, "fuzz") {
        let _ = encoding.to_linear(&granita_color::Primaries::AP0).map([0.2, -1.0, f32::NAN]);
    }
}

/// Returns an environment whose opener of files finds none.
fn nothing() -> granita_base::Environment {
    let mut environment = granita_base::Environment::default();
    environment.set_files(granita_base::Files::confined(granita_base::Confinement::default()));
    environment
}

struct Nowhere;

impl SceneSink for Nowhere {
    fn call(&mut self, _: Call, _: &Location) -> Result<(), Stop> {
        Ok(())
    }
}

/// Reads a flat scene. Scripts are refused.
pub fn pyg(bytes: &[u8]) {
    let options =
        PygOptions { always_pyglet: true, safe: true, statement_limit: 1 << 20, ..PygOptions::default() };
    let source = PygSource::Bytes { name: "fuzz".into(), bytes: bytes.to_vec() };
    let _ = granita_pyg::read(source, &mut Nowhere, &options, &Reporter::silent());
}

/// Reads calls from a program that started the renderer.
pub fn calls(mut bytes: &[u8]) {
    let _ = granita_pyg::serve(&mut bytes, &mut std::io::sink(), &mut Nowhere, &Reporter::silent());
}

/// Reads RIB in any form, as a whole scene and as a part of one.
pub fn rib(bytes: &[u8]) {
    struct Part;
    impl SceneSink for Part {
        fn call(&mut self, _: Call, _: &Location) -> Result<(), Stop> {
            Ok(())
        }
        fn in_world(&self) -> bool {
            false
        }
        fn new_frame(&mut self) -> bool {
            true
        }
    }
    let registry = granita_plugin::bundled_generators();
    let Some(generator) = registry.by_name("rib") else { return };
    let source = granita_scene::GeneratorSource::bytes("fuzz", bytes);
    let _ = generator.run(&source, &mut Part, &Reporter::silent());
    let _ = generator.run(&source, &mut Nowhere, &Reporter::silent());
}

/// Compiles a shader. A compiled shader must survive writing and reading.
pub fn gsl(bytes: &[u8]) {
    let source = String::from_utf8_lossy(bytes);
    if let Ok(compiled) = granita_gsl::compile(&source, "fuzz", &granita_gsl::CompileOptions::default()) {
        let written = granita_gsl::gso::write(&compiled.module, false);
        let read = granita_gsl::gso::read(&written, "fuzz").expect("what was written can be read");
        assert_eq!(read, compiled.module);
    }
}

/// Reads a compiled shader.
pub fn gso(bytes: &[u8]) {
    let _ = granita_gsl::gso::read(bytes, "fuzz");
    let _ = granita_gsl::GsoArgs::from_bytes(bytes, "fuzz");
}

/// Reads TIFF.
pub fn tiff(bytes: &[u8]) {
    image(bytes, "tif");
}

/// Reads OpenEXR.
pub fn exr(bytes: &[u8]) {
    image(bytes, "exr");
}

/// Reads PNG.
pub fn png(bytes: &[u8]) {
    image(bytes, "png");
}

/// Reads Radiance HDR.
pub fn hdr(bytes: &[u8]) {
    image(bytes, "hdr");
}

/// Reads JPEG.
pub fn jpeg(bytes: &[u8]) {
    image(bytes, "jpg");
}

/// Reads Targa.
pub fn tga(bytes: &[u8]) {
    image(bytes, "tga");
}

/// Reads BMP.
pub fn bmp(bytes: &[u8]) {
    image(bytes, "bmp");
}

/// Reads PBM, PGM, PPM and PAM.
pub fn pnm(bytes: &[u8]) {
    image(bytes, "ppm");
}

/// Reads PFM.
pub fn pfm(bytes: &[u8]) {
    image(bytes, "pfm");
}

/// Reads GIF.
pub fn gif(bytes: &[u8]) {
    image(bytes, "gif");
}

/// Reads QOI.
pub fn qoi(bytes: &[u8]) {
    image(bytes, "qoi");
}

/// Reads WebP.
pub fn webp(bytes: &[u8]) {
    image(bytes, "webp");
}

/// Reads SGI.
pub fn sgi(bytes: &[u8]) {
    image(bytes, "sgi");
}

/// Reads Maya IFF.
pub fn iff(bytes: &[u8]) {
    image(bytes, "iff");
}

/// Reads DDS.
pub fn dds(bytes: &[u8]) {
    image(bytes, "dds");
}

/// Reads DPX.
pub fn dpx(bytes: &[u8]) {
    image(bytes, "dpx");
}

/// Reads Cineon.
pub fn cineon(bytes: &[u8]) {
    image(bytes, "cin");
}

/// Reads PSD.
pub fn psd(bytes: &[u8]) {
    image(bytes, "psd");
}

/// Reads FITS.
pub fn fits(bytes: &[u8]) {
    image(bytes, "fits");
}

/// Reads RLA.
pub fn rla(bytes: &[u8]) {
    image(bytes, "rla");
}

/// Reads Softimage PIC.
pub fn softimage(bytes: &[u8]) {
    image(bytes, "pic");
}

/// Reads ICO.
pub fn ico(bytes: &[u8]) {
    image(bytes, "ico");
}

/// Reads JPEG XL.
pub fn jpegxl(bytes: &[u8]) {
    image(bytes, "jxl");
}

/// Reads JPEG 2000.
pub fn jpeg2000(bytes: &[u8]) {
    image(bytes, "jp2");
}

/// Reads Exif data, whose attributes must survive writing and reading.
pub fn exif(bytes: &[u8]) {
    metadata(bytes, granita_image::metadata::exif::read, |attributes| {
        granita_image::metadata::exif::write(attributes, &[])
    });
}

/// Reads IPTC data, alone and in resources of Photoshop.
pub fn iptc(bytes: &[u8]) {
    use granita_image::metadata::iptc;
    let data = iptc::of_resources(bytes).unwrap_or(bytes);
    metadata(data, iptc::read, iptc::write);
}

/// Reads metadata. What was written is read as the same attributes, and written as the same bytes.
fn metadata(
    bytes: &[u8],
    read: fn(&[u8], &mut granita_base::Params),
    write: fn(&granita_base::Params) -> Option<Vec<u8>>,
) {
    let mut attributes = granita_base::Params::new();
    read(bytes, &mut attributes);
    let Some(written) = write(&attributes) else { return };
    let mut again = granita_base::Params::new();
    read(&written, &mut again);
    assert_eq!(write(&again), Some(written));
}

/// Reads Wavefront OBJ.
pub fn obj(bytes: &[u8]) {
    generated("obj", bytes);
}

/// Reads Stanford PLY.
pub fn ply(bytes: &[u8]) {
    generated("ply", bytes);
}

/// Reads STL, both as text and binary.
pub fn stl(bytes: &[u8]) {
    generated("stl", bytes);
}

/// Reads a Draco mesh in a glTF file.
pub fn draco(bytes: &[u8]) {
    let accessor = |kind: &str| format!(r#"{{"componentType":5126,"count":3,"type":"{kind}"}}"#);
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"byteLength":{length}}}],
        "bufferViews":[{{"buffer":0,"byteLength":{length}}}],"accessors":[{},{},{}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"NORMAL":1,"TEXCOORD_0":2}},"extensions":
        {{"KHR_draco_mesh_compression":{{"bufferView":0,"attributes":{{"POSITION":0,"NORMAL":1,"TEXCOORD_0":2}}}}}}}}]}}],
        "nodes":[{{"mesh":0}}]}}"#,
        accessor("VEC3"),
        accessor("VEC3"),
        accessor("VEC2"),
        length = bytes.len(),
    );
    generated("glb", &binary_gltf(&json, bytes));
}

/// Reads compressed buffer views of a glTF file: vertices, then triangles. The first four bytes are the length of the
/// first one, the stride of vertices divided by 4, a number that selects the filter, and the number of vertices.
pub fn meshopt(bytes: &[u8]) {
    let Some(([first, stride, filter, count], data)) = bytes.split_first_chunk::<4>() else { return };
    let (first, stride, count) = (usize::from(*first).min(data.len()), u32::from(*stride % 64) * 4, *count);
    let filters = ["NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL", "COLOR", "other"];
    let filter = filters[usize::from(*filter) % filters.len()];
    let view = |offset: usize, length: usize, count: u32, stride: u32, mode: &str, filter: &str| {
        format!(
            r#"{{"buffer":0,"byteLength":{},"byteStride":{stride},"extensions":{{"EXT_meshopt_compression":{{"buffer":0,
            "byteOffset":{offset},"byteLength":{length},"byteStride":{stride},"count":{count},"mode":"{mode}",
            "filter":"{filter}"}}}}}}"#,
            count * stride
        )
    };
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"byteLength":{}}}],"bufferViews":[{},{}],
        "accessors":[{{"bufferView":0,"componentType":5122,"count":{count},"type":"VEC3"}},
        {{"bufferView":1,"componentType":5125,"count":{},"type":"SCALAR"}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}],"nodes":[{{"mesh":0}}]}}"#,
        data.len(),
        view(0, first, u32::from(count), stride, "ATTRIBUTES", filter),
        view(first, data.len() - first, u32::from(count) * 3, 4, "TRIANGLES", "NONE"),
        u32::from(count) * 3,
    );
    generated("glb", &binary_gltf(&json, data));
}

/// Returns a binary glTF file of these two chunks.
fn binary_gltf(json: &str, data: &[u8]) -> Vec<u8> {
    let mut file = b"glTF\x02\0\0\0".to_vec();
    let (json_length, data_length) = (json.len() as u32, data.len() as u32);
    file.extend((28 + json_length + data_length).to_le_bytes());
    file.extend(json_length.to_le_bytes());
    file.extend(b"JSON");
    file.extend(json.as_bytes());
    file.extend(data_length.to_le_bytes());
    file.extend(b"BIN\0");
    file.extend(data);
    file
}

/// Reads glTF 2, both as JSON and binary.
pub fn gltf(bytes: &[u8]) {
    generated("gltf", bytes);
}

/// Runs the bundled generator of this name, after a request for the bound. The data of shapes must agree with their
/// declarations.
fn generated(name: &str, bytes: &[u8]) {
    let generators = granita_plugin::bundled_generators();
    let generator = generators.by_name(name).expect("a bundled generator");
    let source = GeneratorSource::bytes("fuzz", bytes);
    let bound = generator.bound(&source);
    assert!(bound.is_none_or(|b| b.iter().all(|x| x.is_finite())), "a bound that is not finite");
    let _ = generator.run(&source, &mut Shapes, &Reporter::silent());
}

/// A sink that checks the shapes that it receives.
struct Shapes;

impl SceneSink for Shapes {
    fn call(&mut self, call: Call, _: &Location) -> Result<(), Stop> {
        let Call::Shape { shape, params } = call else { return Ok(()) };
        let p = params.floats("P").expect("positions");
        assert!(p.iter().all(|x| x.is_finite()), "positions that are not finite");
        let vertices = p.len() / 3;
        let (linear, pieces) = match &*shape {
            ShapeDesc::Mesh { nverts, verts, .. } => {
                assert!(nverts.iter().all(|n| *n >= 3), "faces of fewer than three corners");
                assert_eq!(nverts.iter().map(|n| *n as usize).sum::<usize>(), verts.len());
                assert!(verts.iter().all(|v| *v >= 0 && (*v as usize) < vertices), "vertices that are none");
                (verts.len(), nverts.len())
            }
            ShapeDesc::Curves { ncurves, nverts, .. } => {
                assert_eq!(ncurves * nverts, vertices);
                (2 * ncurves, *ncurves)
            }
            ShapeDesc::Points { n } => {
                assert_eq!(*n, vertices);
                (vertices, vertices)
            }
            _ => return Ok(()),
        };
        for param in &params {
            let items = match param.ty.interp {
                Interp::Constant => 1,
                Interp::PerPiece => pieces,
                Interp::Linear => linear,
                Interp::Vertex => vertices,
            };
            assert_eq!(param.data.len(), items * param.ty.width(), "{}", param.declaration());
        }
        Ok(())
    }
}

/// Reads a part of each image and level of a file, as rows and tiles.
fn image(bytes: &[u8], extension: &str) {
    let Ok(file) = tempfile::Builder::new().suffix(&format!(".{extension}")).tempfile() else { return };
    if std::fs::write(file.path(), bytes).is_err() {
        return;
    }
    let Ok(input) = granita_plugin::bundled_formats(limits()).open(file.path()) else { return };
    for image in 0..input.images().min(4) {
        for level in 0..input.levels(image).min(16) {
            let Some(spec) = input.spec(image, level) else { continue };
            if spec.is_tiled() {
                let (nx, ny) = spec.tiles();
                let _ = input.read_tile(image, level, nx.saturating_sub(1), ny.saturating_sub(1));
            }
            let _ = input.read_rows(image, level, 0, spec.height.min(64));
        }
    }
}

/// Returns mutation `number` of `seed`. A few bytes are changed, removed, doubled or cut off, in the same way on every
/// machine.
pub fn mutated(seed: &[u8], number: u32) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    let changes = 1 + hash::words(&[number, 0]) % 4;
    for change in 0..changes {
        let random = |d: u32| hash::words(&[number, change + 1, d]) as usize;
        if bytes.is_empty() {
            break;
        }
        let at = random(0) % bytes.len();
        match random(1) % 6 {
            0 => bytes[at] ^= 1 << (random(2) % 8),
            1 => bytes[at] = [0, 1, 0x7f, 0x80, 0xff, b'(', b'"', b'-'][random(2) % 8],
            2 => {
                let end = (at + 1 + random(2) % 16).min(bytes.len());
                bytes.drain(at..end);
            }
            3 => {
                let end = (at + 1 + random(2) % 32).min(bytes.len());
                let piece = bytes[at..end].to_vec();
                bytes.splice(at..at, piece);
            }
            4 => bytes.truncate(at),
            _ => {
                let end = (at + 4).min(bytes.len());
                bytes[at..end].fill([0, 0xff][random(2) % 2]);
            }
        }
    }
    bytes
}

/// Reads packets of live images, one after another, as a connection sends them. A packet that was read is written and
/// read again.
pub fn display(bytes: &[u8]) {
    use granita_display::{Packet, PacketLimits, packet::rest_of};
    let limits = PacketLimits { packet_bytes: 1 << 20, ..PacketLimits::default() };
    let mut rest = bytes;
    while let Some((length, _)) = rest.split_first_chunk::<4>() {
        let Ok(more) = rest_of(*length, &limits) else { return };
        let Some((packet, after)) = rest.split_at_checked(4 + more) else { return };
        if let Ok(packet) = Packet::decode(packet, &limits) {
            let mut written = Vec::new();
            packet.encode(&mut written).expect("what was read can be written");
            // Bytes that are not UTF-8 become longer.
            let wide = PacketLimits { text_bytes: 1 << 20, packet_bytes: u32::MAX, ..limits };
            let again = Packet::decode(&written, &wide).map(|p| format!("{p:?}"));
            // The texts are compared, because NaN is not equal to itself.
            assert!(again.is_ok_and(|again| again == format!("{packet:?}")), "{packet:?} is read otherwise");
        }
        rest = after;
    }
}

/// Reads a spatial database, and queries it. The bytes are also read with corrected checksums, so that the rest of the
/// reader is reached.
pub fn sdb(bytes: &[u8]) {
    use granita_sdb::{Between, Cluster, Clusters, Density, Lanes, Probe};
    /// Takes all records one by one, and counts them.
    struct AllRecords(usize);

    impl Lanes for AllRecords {
        fn open(&self, _: &Cluster) -> u32 {
            !0
        }

        fn take(&mut self, _: [f32; 3], _: [f32; 3], _: u32) {
            self.0 += 1;
        }
    }
    let ask = |bytes: &[u8]| {
        let Ok(file) = tempfile::NamedTempFile::new() else { return };
        if std::fs::write(file.path(), bytes).is_err() {
            return;
        }
        let Ok(records) = granita_sdb::read(file.path()) else { return };
        for p in [[0.0; 3], [0.3, -0.2, 1e30], [f32::NAN; 3]] {
            let probe = Probe { p, n: Some([0.0, 0.0, 1.0]) };
            for always in [false, true] {
                let how = Between { minsamples: 3, maxdist: 0.5, maxerror: 0.25, always };
                let _ = records.between(&probe, &how);
                let _ = records.all_between(&probe, &how);
            }
            let _ = records.density(&probe, &Density { minsamples: 3, maxdist: 0.5, maxerror: 0.25 });
            let _ = records.exactly(&probe);
        }
        let mut all = AllRecords(0);
        Clusters::new(&records).gather(&records, 1, &mut all);
        assert_eq!(all.0, records.len());
    };
    ask(bytes);
    if let Some(repaired) = granita_sdb::with_checksums(bytes) {
        ask(&repaired);
    }
}
