//! Tests of the PLY reader with small files written by hand.

use super::Ply;
use crate::trial::{flat, run};

const HEADER: &str = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
    element face 2\nproperty list uchar int vertex_indices\nend_header\n";
const P: &str = "\"vertex point P\", (0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0)";

fn ascii(rest: &str) -> String {
    format!("ply\nformat ascii 1.0\n{rest}")
}

fn square() -> String {
    ascii(&format!("{HEADER}0 0 0\n1 0 0\n1 1 0\n0 1 0\n"))
}

#[test]
fn the_same_mesh_in_three_encodings() {
    let want = format!("Mesh (\"linear\", (3, 4), (0, 1, 2, 0, 1, 2, 3), {P})\n");
    assert_eq!(flat(&run(&Ply, square() + "3 0 1 2\n4 0 1 2 3").clean()), want);
    for big in [false, true] {
        let format = if big { "binary_big_endian" } else { "binary_little_endian" };
        let mut bytes =
            format!("ply\r\nformat {format} 1.0\r\n{}", HEADER.replace('\n', "\r\n")).into_bytes();
        let mut put = |b: &[u8]| {
            let mut b = b.to_vec();
            if big {
                b.reverse();
            }
            bytes.extend(b);
        };
        for x in [0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.] {
            put(&f32::to_le_bytes(x));
        }
        for face in [&[0, 1, 2][..], &[0, 1, 2, 3]] {
            put(&[face.len() as u8]);
            face.iter().for_each(|i| put(&i32::to_le_bytes(*i)));
        }
        assert_eq!(flat(&run(&Ply, bytes).clean()), want);
    }
}

#[test]
fn every_property() {
    let text = ascii(
        "comment a\nobj_info b\nelement camera 1\nproperty float view\nproperty list int float list\n\
         element vertex 3\nproperty double x\nproperty list uchar int neighbours\nproperty double y\nproperty double z\n\
         property float nx\nproperty float ny\nproperty float nz\nproperty float u\nproperty float v\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nproperty float alpha\n\
         element face 1\nproperty uchar flags\nproperty list uchar uint vertex_index\nend_header\n\
         7 2 1 1\n0 0 0 0 0 0 1 0 0 255 0 0 1\n1 2 5 5 0 0 0 0 1 0.5 0.25 0 255 0 0.5\n0 0 1 0 0 0 1 1 1 0 0 51 1\n\
         9 3 0 1 2\n",
    );
    let want = "Mesh (\"linear\", (3,), (0, 1, 2), \"vertex point P\", (0, 0, 0, 1, 0, 0, 0, 1, 0), \
        \"vertex normal N\", (0, 0, 1, 0, 0, 1, 0, 0, 1), \"vertex float s\", (0, 0.5, 1), \"vertex float t\", (1, 0.75, 0), \
        \"vertex color C\", (1, 0, 0, 0, 1, 0, 0, 0, 0.2), \"vertex color opacity\", (1, 1, 1, 0.5, 0.5, 0.5, 1, 1, 1))\n";
    assert_eq!(flat(&run(&Ply, text).clean()), want);
}

#[test]
fn texture_coordinates_of_corners_and_colours_of_faces() {
    let text = square().replace(
        "vertex_indices\n",
        "vertex_indices\nproperty list uchar float texcoord\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n",
    ) + "3 0 1 2 6 0 0 1 0 1 1 255 0 0\n3 0 2 3 0 0 255 0\n";
    let got = flat(&run(&Ply, text).clean());
    assert!(
        got.contains("\"linear float s\", (0, 1, 1, 0, 0, 0), \"linear float t\", (1, 1, 0, 1, 1, 1)"),
        "{got}"
    );
    assert!(got.contains("\"perpiece color C\", (1, 0, 0, 0, 1, 0)"), "{got}");
}

#[test]
fn faces_before_vertices() {
    let text = ascii(
        "element face 1\nproperty list uchar int vertex_indices\nelement vertex 3\nproperty float x\nproperty float y\n\
         property float z\nend_header\n3 2 1 0\n0 0 0\n1 0 0\n0 1 0\n",
    );
    assert!(run(&Ply, text).clean().starts_with("Mesh (\"linear\", (3,), (2, 1, 0)"));
}

#[test]
fn triangle_strips() {
    let text = ascii(
        "element vertex 5\nproperty float x\nproperty float y\nproperty float z\nelement tristrips 1\n\
         property list int int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n9 0 1 2 3 3 -1 4 1 0\n",
    );
    let got = run(&Ply, text).clean();
    assert!(got.starts_with("Mesh (\"linear\", (3, 3, 3), (0, 1, 2, 2, 1, 3, 4, 1, 0)"), "{got}");
}

#[test]
fn particles() {
    let header = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
    let rest = "end_header\n0 0 0\n1 nan 0\n0 1 0\n";
    let trial = run(&Ply, ascii(&format!("{header}{rest}")));
    let want = "Points (2, \"vertex point P\", (0, 0, 0, 0, 1, 0), \"float rasterwidth\", 2)\n";
    assert_eq!(flat(&trial.pyg), want);
    let want = ["t:9: error: vertex 1 has too few numbers, or none that are finite: left out"];
    assert_eq!(trial.messages, want);
    let text = ascii(&format!(
        "{header}property float radius\nelement face 0\nend_header\n0 0 0 1\n1 0 0 2\n0 1 0 3\n"
    ));
    let got = flat(&run(&Ply, text).clean());
    assert!(got.contains("\"vertex float width\", (2, 4, 6)"), "{got}");
}

#[test]
fn mistakes_cost_only_themselves() {
    let faces = "3 0 1 2\n3 0 1 4\n3 0 1\n2 0 1\nx 0 1\n3 0 -1 2\n3 0 1.5e300 2\n";
    let text = square().replace("face 2", "face 7") + faces;
    let trial = run(&Ply, text);
    assert!(trial.pyg.starts_with("Mesh (\"linear\", (3,), (0, 1, 2)"), "{}", trial.pyg);
    let want = [
        "t:15: error: face 1 refers to vertex 4, of 4 from 0 on: left out; 2 more of this kind",
        "t:16: error: face 2 has too few numbers: left out",
        "t:17: error: face 3 has 2 of at least 3 vertices: left out",
        "t:18: error: face 4 has a list of NaN values: left out",
    ];
    assert_eq!(trial.messages, want);
    let text = square().replace("1 1 0", "1 1 x") + "3 0 1 2\n3 0 1 3\n";
    let trial = run(&Ply, text);
    assert!(trial.pyg.starts_with("Mesh (\"linear\", (3,), (0, 1, 3)"), "{}", trial.pyg);
    let want = [
        "t:12: error: vertex 2 has too few numbers, or none that are finite: left out",
        "t: error: 1 faces refer to vertices that were left out, and are left out too",
    ];
    assert_eq!(trial.messages, want);
}

#[test]
fn files_that_end_early() {
    let trial = run(&Ply, square() + "3 0 1 2\n");
    assert!(trial.pyg.starts_with("Mesh (\"linear\", (3,)"), "{}", trial.pyg);
    assert_eq!(trial.messages, ["t:15: error: the file ends after 1 of 2 elements \"face\""]);
    // The header declares more vertices than fit into memory.
    let text = square().replace("vertex 4", "vertex 1000000000000");
    let trial = run(&Ply, text);
    assert!(trial.pyg.is_empty());
    let want = "t:14: error: the file ends after 4 of 1000000000000 elements \"vertex\"";
    assert_eq!(trial.messages, [want]);
    let binary = "ply\nformat binary_little_endian 1.0\nelement vertex 1000000000\nproperty float x\nproperty float y\n\
        property float z\nelement face 4000000000\nproperty list int int vertex_indices\nend_header\n";
    let trial = run(&Ply, binary);
    assert_eq!(trial.messages, ["t: error: the file ends after 0 of 1000000000 elements \"vertex\""]);
    for (text, want) in [
        ("", "t:1: the file is empty"),
        ("ply\nformat ascii 1.0\n", "t:3: the file ends in its header"),
        ("solid\n", "t:1: no PLY file: it does not begin with \"ply\""),
    ] {
        assert_eq!(run(&Ply, text).error.unwrap().to_string(), want);
    }
}

#[test]
fn files_without_what_is_needed() {
    let no_y = ascii("element vertex 1\nproperty float x\nproperty float z\nend_header\n0 0\n");
    assert_eq!(run(&Ply, no_y).messages, ["t: error: vertices without the properties x, y and z"]);
    let none = ascii("element face 1\nproperty list int int vertex_indices\nend_header\n3 0 1 2\n");
    assert_eq!(run(&Ply, none).messages, ["t: error: no element \"vertex\": nothing to draw"]);
    let no_list = square().replace("list uchar int vertex_indices", "int material") + "0\n0\n";
    assert_eq!(run(&Ply, no_list).messages, ["t: error: element \"face\" has no list \"vertex_indices\""]);
}

#[test]
fn a_length_that_is_none_ends_a_binary_file() {
    let mut bytes =
        b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty char x\nproperty char y\n\
        property char z\nelement face 2\nproperty list char uchar vertex_indices\nend_header\n"
            .to_vec();
    bytes.extend([0, 0, 0, 1, 0, 0, 0, 1, 0, 3, 0, 1, 2, 0xff, 1, 2]);
    let trial = run(&Ply, bytes);
    assert!(trial.pyg.starts_with("Mesh (\"linear\", (3,), (0, 1, 2)"), "{}", trial.pyg);
    assert_eq!(trial.messages, ["t: error: face 1 has a list of -1 values: the rest cannot be read"]);
}
