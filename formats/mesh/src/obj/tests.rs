//! Tests of the OBJ reader with small files written by hand.

use super::Obj;
use crate::trial::{flat, run, run_source};
use granita_scene::GeneratorSource;

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";
const P: &str = "\"vertex point P\", (0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0)";

fn pyg(text: &str) -> String {
    run(&Obj, text).clean()
}

#[test]
fn one_face_in_the_current_state() {
    let want = format!("Mesh (\"linear\", (4,), (0, 1, 2, 3), {P})\n");
    for face in ["f 1 2 3 4", "f -4 -3 -2 -1", "f 1 2 \\\n3 4", "\tf  1 2\t3 4 \r", "f 1/ 2/ 3/ 4/"] {
        assert_eq!(flat(&pyg(&format!("# a square\n{SQUARE}{face}\n"))), want, "{face}");
    }
}

#[test]
fn vertices_are_numbered_anew_for_each_mesh() {
    let text = format!("{SQUARE}g a\nf 4 3 2\ng b c\nf 1 2 4\no big\nf 1 2 3\ng part\nf 1 2 3\n");
    let want = "PushAttributes ()\nAttribute (\"string name\", \"a\")\n\
        Mesh (\"linear\", (3,), (0, 1, 2), \"vertex point P\", (0, 1, 0, 1, 1, 0, 1, 0, 0))\nPopAttributes ()\n\
        PushAttributes ()\nAttribute (\"string name\", \"b c\")\n\
        Mesh (\"linear\", (3,), (0, 1, 2), \"vertex point P\", (0, 0, 0, 1, 0, 0, 0, 1, 0))\nPopAttributes ()\n\
        PushAttributes ()\nAttribute (\"string name\", \"big\")\n\
        Mesh (\"linear\", (3,), (0, 1, 2), \"vertex point P\", (0, 0, 0, 1, 0, 0, 1, 1, 0))\nPopAttributes ()\n\
        PushAttributes ()\nAttribute (\"string name\", \"big/part\")\n\
        Mesh (\"linear\", (3,), (0, 1, 2), \"vertex point P\", (0, 0, 0, 1, 0, 0, 1, 1, 0))\nPopAttributes ()\n";
    assert_eq!(flat(&pyg(&text)), want);
}

#[test]
fn faces_before_their_vertices() {
    assert_eq!(flat(&pyg(&format!("f 1 2 3 4\n{SQUARE}"))).matches("Mesh").count(), 1);
}

#[test]
fn normals_and_texture_coordinates_per_vertex_where_that_says_all() {
    let text = format!("{SQUARE}vt 0.25 0.25\nvt 1 1\nvn 0 0 2\nf 1/1/1 2/2/1 3/1/1\nf 1/1/1 3/1/1 4/2/1\n");
    let got = flat(&pyg(&text));
    assert!(got.contains("\"vertex normal N\", (0, 0, 2, 0, 0, 2, 0, 0, 2, 0, 0, 2)"), "{got}");
    assert!(got.contains("\"vertex float s\", (0.25, 1, 0.25, 1)"), "{got}");
    assert!(got.contains("\"vertex float t\", (0.75, 0, 0.75, 0)"), "{got}");
}

#[test]
fn corners_that_disagree_make_them_linear() {
    let text = format!("{SQUARE}vt 0 0\nvt 1 1\nvn 0 0 1\nvn 1 0 0\nf 1/1/1 2/1/1 3/1/1\nf 1/2/2 3/1/1 4\n");
    let got = flat(&pyg(&text));
    let n = "\"linear normal N\", (0, 0, 1, 0, 0, 1, 0, 0, 1, 1, 0, 0, 0, 0, 1, 0, 0, 1)";
    assert!(got.contains(n), "{got}");
    assert!(got.contains("\"linear float s\", (0, 0, 0, 1, 0, 0)"), "{got}");
    assert!(got.contains("\"linear float t\", (1, 1, 1, 0, 1, 1)"), "{got}");
}

#[test]
fn smoothing_groups_share_normals() {
    // The surface has a fold along an edge. Within a smoothing group it is smooth, and between two groups it has a
    // crease.
    let fold = "v 0 0 0\nv 0 1 0\nv 1 0 1\nv -1 0 1\n";
    let got = flat(&pyg(&format!("{fold}s 1\nf 1 2 3\nf 2 1 4\n")));
    let sum = "\"linear normal N\", (0, 0, -1, 0, 0, -1, ";
    assert!(got.contains(sum), "{got}");
    let got = flat(&pyg(&format!("{fold}s 1\nf 1 2 3\ns 2\nf 2 1 4\n")));
    assert!(got.contains("\"linear normal N\", (0.70710677, 0, -0.70710677, 0.70710677, "), "{got}");
    assert!(!pyg(&format!("{fold}s off\nf 1 2 3\n")).contains('N'));
}

#[test]
fn vertex_colours() {
    let got = flat(&pyg("v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0\nf 1 2 3\n"));
    assert!(got.contains("\"vertex color C\", (1, 0, 0, 0, 1, 0, 1, 1, 1)"), "{got}");
}

#[test]
fn lines_and_points() {
    let got = flat(&pyg(&format!("{SQUARE}l 1 2 3\nl 3 4\nl 1/2 2\nl 2 3 4\np 1 2\np 3\n")));
    assert!(got.starts_with("Curves (\"linear\", 2, 2, "), "{got}");
    assert!(got.contains("Curves (\"linear\", 2, 3, "), "{got}");
    assert!(got.contains("\"float width\", 0.0028284271"), "{got}");
    let points = "Points (3, \"vertex point P\", (0, 0, 0, 1, 0, 0, 1, 1, 0), \"float rasterwidth\", 2)\n";
    assert!(got.ends_with(points), "{got}");
}

#[test]
fn mistakes_are_told_once_and_cost_only_themselves() {
    let text = format!(
        "{SQUARE}o cube\nf 1 2 3\nf 1 2 9\nf 1 2 10\nf 1 2\nf 1 x 3\nf 0 1 2\nf 1//7 2//7 3//7\nf 1/8 2 3\n\
         v 1 2\nf 1 2 5\nvt\nvn 1 2\nbogus 3\nsurf 0 1 0 1 1 2 3\nl 1\nl 1 99\np 98\ncall x.obj\n"
    );
    let trial = run(&Obj, text);
    assert_eq!(
        trial.pyg.matches("Mesh (\"linear\", (3, 3, 3), (0, 1, 2, 0, 1, 2, 0, 1, 2)").count(),
        1,
        "{}",
        trial.pyg
    );
    let want = [
        "t:9: error: face with 2 of at least 3 vertices (object \"cube\"): left out; 1 more of this kind",
        "t:10: error: face with \"x\" for a corner (object \"cube\"): left out",
        "t:11: error: face refers to number 0, with 4 vertices so far (object \"cube\"): left out",
        "t:14: error: vertex with fewer numbers than it needs, or none that are finite",
        "t:16: error: texture coordinate with fewer numbers than it needs, or none that are finite",
        "t:17: error: normal with fewer numbers than it needs, or none that are finite",
        "t:18: warning: unknown statement \"bogus\": ignored",
        "t:19: warning: free-form geometry (\"surf\") is not supported: left out",
        "t:23: warning: \"call\" is not supported: ignored",
        "t:7: error: face refers to vertex 9 of 5 (object \"cube\"): left out; 1 more of this kind",
        "t:12: error: face refers to normal 7 of 1 (object \"cube\"): taken without normals; 2 more of this kind",
        "t:13: error: face refers to texture coordinate 8 of 1 (object \"cube\"): taken without them",
        "t:15: error: face refers to vertex 5, which is not finite (object \"cube\"): left out",
        "t:6: error: a line refers to a vertex that does not exist (object \"cube\"): left out",
        "t:6: error: a point refers to a vertex that does not exist (object \"cube\"): left out",
    ];
    assert_eq!(trial.messages, want);
}

#[test]
fn a_file_that_was_cut_before_its_faces_has_a_message() {
    for text in ["", SQUARE, "v 0 0 0\nv 1 0 0\nv 1 1"] {
        let trial = run(&Obj, text);
        let last = trial.messages.last().map(String::as_str);
        assert_eq!(last, Some("t: warning: no faces, lines or points: nothing to draw"), "{text}");
        assert_eq!((trial.pyg.as_str(), trial.error.is_none()), ("", true));
    }
}

#[test]
fn bytes_that_are_no_obj() {
    let trial = run(&Obj, [0u8, 255, 10, 1, 2, 3, 10, 92, 10]);
    assert!(trial.pyg.is_empty() && trial.error.is_none());
    assert_eq!(trial.messages.len(), 2);
}

#[test]
fn materials() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("a b.mtl", "newmtl red\nKd 1 0 0\nd 0.5\nmap_Kd -s 2 2 wood.png\n");
    let text = format!(
        "mtllib a b.mtl\nmtllib gone.mtl\n{SQUARE}vt 0.25 0.25\nusemtl red\nf 1/1 2/1 3/1\nusemtl blue\nf 1/1 2/1 3/1\n"
    );
    write("m.obj", &text);
    let source = GeneratorSource::file(folder.path().join("m.obj"));
    let trial = run_source(&Obj, &source);
    let path = folder.path().display().to_string();
    let got = flat(&trial.pyg).replace(&path, "DIR");
    let want = "PushAttributes ()\nAttribute (\"color C\", (1, 0, 0))\nAttribute (\"color opacity\", (0.5, 0.5, 0.5))\n\
        Shader (\"surface\", \"mtlsurface\", \"color specularcolor\", (0, 0, 0), \"float roughness\", 0.8, \
        \"color emission\", (0, 0, 0), \"string texturename\", \"DIR/wood.png\", \"string wrap\", \"periodic\", \
        \"float texturesrgb\", 1)\nMesh (";
    assert!(got.starts_with(want), "{got}");
    assert!(got.contains(
        "\"vertex float s\", (0.5, 0.5, 0.5), \"vertex float t\", (0.5, 0.5, 0.5))\nPopAttributes"
    ));
    assert!(got.contains("PopAttributes ()\nMesh (\"linear\", (3,)"), "{got}");
    let messages: Vec<String> = trial.messages.iter().map(|m| m.replace(&path, "DIR")).collect();
    assert!(
        messages[0].starts_with("DIR/m.obj:2: error: cannot read the materials in DIR/gone.mtl: "),
        "{messages:?}"
    );
    assert_eq!(
        messages[1],
        "DIR/m.obj:10: warning: no material \"blue\" in the libraries: the current attributes are used"
    );
    assert_eq!(messages.len(), 2);
}

#[test]
fn no_such_file() {
    let trial = run_source(&Obj, &GeneratorSource::file("nowhere.obj"));
    let text = trial.error.unwrap().to_string();
    assert!(text.starts_with("nowhere.obj: "), "{text}");
    let folder = tempfile::tempdir().unwrap();
    let trial = run_source(&Obj, &GeneratorSource::file(folder.path().to_owned()));
    assert!(trial.error.unwrap().to_string().contains("a folder, not a file"));
}
