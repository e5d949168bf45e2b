//! Tests of the glTF reader with small files that are made here.

use super::Gltf;
use crate::trial::{Trial, bytes, flat, run, run_in, run_source};
use base64::Engine;
use granita_base::Param;
use granita_scene::{Generator, GeneratorSource};
use serde_json::{Value, json};

const TRIANGLE: [f32; 9] = [0., 0., 0., 1., 0., 0., 0., 1., 0.];
const P: &str = "\"vertex point P\", (0, 0, 0, 1, 0, 0, 0, 1, 0)";
const HERE: &str = "AppendTransform ((1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1))\n";

fn le(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|x| x.to_le_bytes()).collect()
}

fn glb(json: &Value, bin: &[u8]) -> Vec<u8> {
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut all = b"glTF\x02\0\0\0".to_vec();
    all.extend((28 + text.len() as u32 + bin.len() as u32).to_le_bytes());
    all.extend((text.len() as u32).to_le_bytes());
    all.extend(b"JSON");
    all.extend(text);
    all.extend((bin.len() as u32).to_le_bytes());
    all.extend(b"BIN\0");
    all.extend(bin);
    all
}

/// Returns a document with one mesh on one node. Views are given by offset and length, and the rest of the document as
/// JSON.
fn document(views: &[(usize, usize)], accessors: Value, primitives: Value, rest: Value) -> Value {
    let views: Vec<Value> =
        views.iter().map(|(o, l)| json!({"buffer": 0, "byteOffset": o, "byteLength": l})).collect();
    let mut all = json!({
        "asset": {"version": "2.0"}, "buffers": [{"byteLength": 0}], "bufferViews": views, "accessors": accessors,
        "meshes": [{"primitives": primitives}], "nodes": [{"mesh": 0, "name": "n"}],
    });
    for (key, value) in rest.as_object().unwrap() {
        all[key] = value.clone();
    }
    all
}

fn floats3(view: usize, count: usize) -> Value {
    json!({"bufferView": view, "componentType": 5126, "count": count, "type": "VEC3"})
}

/// Returns a file with one triangle, and with further items of the document.
fn triangle(rest: Value) -> Vec<u8> {
    let primitives = json!([{"attributes": {"POSITION": 0}, "material": rest.get("materials").map(|_| 0)}]);
    glb(&document(&[(0, 36)], json!([floats3(0, 3)]), primitives, rest), &le(&TRIANGLE))
}

fn object(inner: &str) -> String {
    format!("PushAttributes ()\nAttribute (\"string name\", \"n\")\n{inner}PopAttributes ()\n")
}

#[test]
fn the_same_triangle_from_all_kinds_of_buffers() {
    let want = object(&format!("{HERE}Mesh (\"linear\", (3,), (0, 1, 2), {P})\n"));
    assert_eq!(flat(&run(&Gltf, triangle(json!({}))).clean()), want);
    let primitives = json!([{"attributes": {"POSITION": 0}}]);
    let mut doc = document(&[(0, 36)], json!([floats3(0, 3)]), primitives, json!({}));
    let text = base64::engine::general_purpose::STANDARD.encode(le(&TRIANGLE));
    doc["buffers"] = json!([{"uri": format!("data:application/gltf-buffer;base64,{text}")}]);
    assert_eq!(flat(&run(&Gltf, doc.to_string()).clean()), want);
    assert_eq!(flat(&run(&Gltf, format!("\u{feff}{doc}")).clean()), want);
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a b.bin"), le(&TRIANGLE)).unwrap();
    doc["buffers"] = json!([{"uri": "a%20b.bin"}]);
    let file = folder.path().join("t.gltf");
    std::fs::write(&file, doc.to_string()).unwrap();
    assert_eq!(flat(&run_source(&Gltf, &GeneratorSource::file(file)).clean()), want);
}

#[test]
fn indices_of_all_types_and_unused_vertices() {
    let mut bin = le(&[9.0; 3]);
    bin.extend(le(&TRIANGLE));
    for (code, size) in [(5121, 1), (5123, 2), (5125, 4)] {
        let mut bin = bin.clone();
        for i in [1u32, 2, 3, 3, 2, 1] {
            bin.extend(&i.to_le_bytes()[..size]);
        }
        let accessors =
            json!([floats3(0, 4), {"bufferView": 1, "componentType": code, "count": 6, "type": "SCALAR"}]);
        let primitives = json!([{"attributes": {"POSITION": 0}, "indices": 1}]);
        let doc = document(&[(0, 48), (48, 6 * size)], accessors, primitives, json!({}));
        let got = flat(&run(&Gltf, glb(&doc, &bin)).clean());
        assert!(got.contains(&format!("Mesh (\"linear\", (3, 3), (0, 1, 2, 2, 1, 0), {P})")), "{got}");
    }
}

#[test]
fn interleaved_normalised_and_sparse() {
    // A vertex has a position of three signed bytes and a colour of four unsigned ones, in 8 bytes.
    let mut bin = Vec::new();
    for (p, c) in
        [([0u8, 0, 0], [255, 0, 0, 255]), ([127, 0, 0], [0, 255, 0, 51]), ([0, 127, 0], [0, 0, 0, 0])]
    {
        bin.extend(p);
        bin.push(0);
        bin.extend(c);
    }
    // Vertex 2 becomes (0, -1, 0).
    bin.extend([2, 0, 0, 0, 0, 0x80, 0, 0]);
    let accessors = json!([
        {"bufferView": 0, "componentType": 5120, "normalized": true, "count": 3, "type": "VEC3",
         "sparse": {"count": 1, "indices": {"bufferView": 1, "componentType": 5121},
                    "values": {"bufferView": 1, "byteOffset": 4}}},
        {"bufferView": 0, "byteOffset": 4, "componentType": 5121, "normalized": true, "count": 3, "type": "VEC4"},
    ]);
    let primitives = json!([{"attributes": {"POSITION": 0, "COLOR_0": 1}, "material": 0}]);
    let rest = json!({"materials": [{"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [0.5, 1, 1, 0.5]}}]});
    let mut doc = document(&[(0, 24), (24, 8)], accessors, primitives, rest);
    doc["bufferViews"][0]["byteStride"] = json!(8);
    let got = flat(&run(&Gltf, glb(&doc, &bin)).clean());
    assert!(got.contains("\"vertex point P\", (0, 0, 0, 1, 0, 0, 0, -1, 0)"), "{got}");
    assert!(got.contains("\"vertex color C\", (0.5, 0, 0, 0, 1, 0, 0, 0, 0)"), "{got}");
    assert!(got.contains("\"vertex color opacity\", (0.5, 0.5, 0.5, 0.1, 0.1, 0.1, 0, 0, 0)"), "{got}");
}

#[test]
fn lines_points_and_normals() {
    let mut bin = le(&TRIANGLE);
    bin.extend(le(&[0., 0., 1., 0., 0., 1., 0., 0., 1.]));
    let attributes = json!({"POSITION": 0, "NORMAL": 1});
    for (mode, want) in [
        (
            0,
            "Points (3, \"vertex point P\", (0, 0, 0, 1, 0, 0, 0, 1, 0), \"float rasterwidth\", 2, \"vertex normal N\"",
        ),
        (1, "Curves (\"linear\", 1, 2, \"vertex point P\", (0, 0, 0, 1, 0, 0), \"float width\", 0.002)"),
        (
            2,
            "Curves (\"linear\", 1, 4, \"vertex point P\", (0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 0), \"float width\"",
        ),
        (3, "Curves (\"linear\", 1, 3, "),
        (4, "\"vertex normal N\", (0, 0, 1, 0, 0, 1, 0, 0, 1))"),
        (5, "Mesh (\"linear\", (3,), (0, 1, 2), "),
        (6, "Mesh (\"linear\", (3,), (1, 2, 0), "),
    ] {
        let primitives = json!([{"attributes": attributes, "mode": mode}]);
        let doc =
            document(&[(0, 36), (36, 36)], json!([floats3(0, 3), floats3(1, 3)]), primitives, json!({}));
        let got = flat(&run(&Gltf, glb(&doc, &bin)).clean());
        assert!(got.contains(want), "{mode}: {got}");
    }
}

#[test]
fn hierarchies_and_shared_meshes() {
    let nodes = json!([
        {"mesh": 0, "name": "n", "translation": [0, 0, 5]},
        {"children": [2, 0], "scale": [2, 2, 2]},
        {"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 7, 0, 0, 1]},
        {"mesh": 0, "name": "not in the scene"},
    ]);
    let got = flat(&run(&Gltf, triangle(json!({"nodes": nodes, "scenes": [{"nodes": [1]}]}))).clean());
    let first = got.find("AppendTransform ((2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 14, 0, 0, 1))").unwrap();
    let second = got.find("AppendTransform ((2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 10, 1))").unwrap();
    assert!(first < second && got.matches("Mesh").count() == 2, "{got}");
    assert!(got.contains("\"mesh0\"") && !got.contains("not in the scene"));
}

#[test]
fn materials() {
    let materials = json!([{
        "pbrMetallicRoughness": {
            "baseColorFactor": [1, 0.5, 0, 0.25], "metallicFactor": 0.5, "roughnessFactor": 0.25,
            "baseColorTexture": {"index": 0, "texCoord": 1, "extensions": {"KHR_texture_transform": {"offset": [0.5, 0], "scale": [2, 1]}}},
        },
        "alphaMode": "MASK", "alphaCutoff": 0.75, "doubleSided": true, "emissiveFactor": [0, 1, 0],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 3}, "KHR_materials_unlit": {}},
    }]);
    let rest = json!({
        "materials": materials, "textures": [{"source": 0, "sampler": 0}], "images": [{"uri": "pic%20ture.PNG"}],
        "samplers": [{"wrapS": 33071, "wrapT": 33648}], "extensionsRequired": ["KHR_texture_transform"],
    });
    let mut bin = le(&TRIANGLE);
    bin.extend(le(&[0., 0., 1., 0., 0., 1.]));
    let accessors =
        json!([floats3(0, 3), {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"}]);
    let primitives = json!([{"attributes": {"POSITION": 0, "TEXCOORD_1": 1}, "material": 0}]);
    let doc = document(&[(0, 36), (36, 24)], accessors, primitives, rest);
    let folder = tempfile::tempdir().unwrap();
    let source = GeneratorSource::file(folder.path().join("t.glb"));
    std::fs::write(folder.path().join("t.glb"), glb(&doc, &bin)).unwrap();
    let got = flat(&run_source(&Gltf, &source).clean()).replace(folder.path().to_str().unwrap(), "DIR");
    let want = "Attribute (\"color C\", (1, 0.5, 0))\nAttribute (\"color opacity\", (0.25, 0.25, 0.25))\n\
        Attribute (\"int twosided\", 1)\nShader (\"surface\", \"gltfsurface\", \"float metallic\", 0.5, \
        \"float roughness\", 0.25, \"color emission\", (0, 3, 0), \"string alphamode\", \"mask\", \
        \"float alphacutoff\", 0.75, \"float unlit\", 1, \"float texturesrgb\", 1, \
        \"string texturename\", \"DIR/pic ture.PNG\", \"string swrap\", \"clamp\", \"string twrap\", \"mirror\")\n";
    assert!(got.contains(want), "{got}");
    assert!(got.contains("\"vertex float s\", (0.5, 2.5, 0.5), \"vertex float t\", (0, 0, 1)"), "{got}");
    // The scene disables the materials of the file.
    let no = Param::declared("int user:materials", 0).unwrap();
    let got = run_in(&Gltf, &source, true, Some(no)).clean();
    assert!(!got.contains("Shader") && !got.contains("twosided"), "{got}");
}

/// Reads a file with a camera and lights before or after `World`.
fn scenery(in_world: bool, attribute: Option<Param>) -> Trial {
    let nodes = json!([
        {"mesh": 0, "name": "n"},
        {"camera": 0, "name": "eye", "translation": [0, 0, 5], "scale": [2, 2, 2]},
        {"camera": 1},
        {"name": "sun", "extensions": {"KHR_lights_punctual": {"light": 0}}},
        {"extensions": {"KHR_lights_punctual": {"light": 1}}},
        {"extensions": {"KHR_lights_punctual": {"light": 2}}},
    ]);
    let rest = json!({
        "nodes": nodes,
        "cameras": [
            {"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.5, "zfar": 100}},
            {"type": "orthographic", "orthographic": {"xmag": 2, "ymag": 1, "znear": 1, "zfar": 10}},
        ],
        "extensions": {"KHR_lights_punctual": {"lights": [
            {"type": "directional", "intensity": std::f32::consts::PI},
            {"type": "point", "color": [1, 0, 0]},
            {"type": "spot", "spot": {"innerConeAngle": 0.25, "outerConeAngle": 0.5}, "name": "lamp"},
        ]}},
    });
    run_in(&Gltf, &bytes(triangle(rest)), in_world, attribute)
}

#[test]
fn cameras_before_world() {
    let trial = scenery(false, None);
    let want = "PushTransform ()\nAppendTransform ((1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0, 0, 0, 5, 1))\n\
        Camera (\"eye\", \"float near\", 0.5, \"float far\", 100, \"float fov\", 57.29578)\nPopTransform ()\n\
        PushTransform ()\nAppendTransform ((1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1))\n\
        Camera (\"camera\", \"float near\", 1, \"float far\", 10, \"string projection\", \"orthographic\", \
        \"float[4] screen\", (-2, 2, -1, 1))\nPopTransform ()\n";
    assert_eq!(flat(&trial.pyg), want);
    assert_eq!(
        trial.messages,
        ["t: info: cameras are taken before World, and all else by an Input after it"]
    );
}

#[test]
fn lights_after_world() {
    let got = flat(&scenery(true, None).clean());
    assert!(!got.contains("Camera") && got.contains("Mesh"), "{got}");
    let want = "Light (\"t/sun\", \"distantlight\", \"float intensity\", 1, \"color lightcolor\", (1, 1, 1), \
         \"string shadowname\", \"shadow\")\n";
    assert!(got.contains(want), "{got}");
    let want = "Light (\"t/light\", \"pointlight\", \"float intensity\", 0.31830987, \"color lightcolor\", (1, 0, 0), \
        \"float falloff\", 2, \"string shadowname\", \"shadow\")\n";
    assert!(got.contains(want), "{got}");
    let want = "\"float falloff\", 2, \"float coneangle\", 0.5, \"float conedeltaangle\", 0.25, \
        \"float beamdistribution\", 0, \"string shadowname\", \"shadow\")\n";
    assert!(got.contains(want), "{got}");
    assert!(got.rfind("Light (").unwrap() < got.find("Mesh").unwrap());
    // What casts shadows are the objects of the file, in a set that the scene may name.
    assert!(got.contains("Attribute (\"string geometryset\", \"+shadow\")"), "{got}");
    let named = Param::declared("string user:shadows", "all").unwrap();
    let got = flat(&scenery(true, Some(named)).clean());
    assert!(got.matches("\"string shadowname\", \"all\"").count() == 3 && got.contains("\"+all\""), "{got}");
    let none = Param::declared("string user:shadows", "").unwrap();
    let got = flat(&scenery(true, Some(none)).clean());
    assert!(!got.contains("shadowname") && !got.contains("geometryset"), "{got}");
    let no = Param::declared("int user:lights", 0).unwrap();
    assert!(!scenery(true, Some(no)).clean().contains("Light"));
}

#[test]
fn bounds_where_the_file_says_them() {
    let mut accessor = floats3(0, 3);
    accessor["min"] = json!([0, 0, 0]);
    accessor["max"] = json!([1, 1, 0]);
    let file = |rest: Value| {
        let primitives = json!([{"attributes": {"POSITION": 0}}]);
        bytes(glb(&document(&[(0, 36)], json!([accessor]), primitives, rest), &le(&TRIANGLE)))
    };
    let moved = json!({"nodes": [{"mesh": 0, "translation": [10, 0, 0], "scale": [-2, 1, 1]}]});
    let b = Gltf.bound(&file(moved)).unwrap();
    let want = [8.0, 10.0, 0.0, 1.0, 0.0, 0.0];
    assert!(b.iter().zip(want).all(|(b, w)| (b - w).abs() < 1e-4), "{b:?}");
    assert_eq!(Gltf.bound(&bytes(triangle(json!({})))), None);
    // A light must be made before the geometry that it lights.
    let lit = json!({"nodes": [{"mesh": 0}, {"extensions": {"KHR_lights_punctual": {"light": 0}}}]});
    assert_eq!(Gltf.bound(&file(lit)), None);
    assert_eq!(Gltf.bound(&bytes("{}")), None);
}

#[test]
fn files_that_are_none() {
    let fails = |file: &[u8]| run(&Gltf, file).error.unwrap().to_string();
    assert!(fails(b"").starts_with("t: EOF while parsing"), "{}", fails(b""));
    assert_eq!(fails(b"[]"), "t: the JSON is no object");
    assert_eq!(fails(b"{}"), "t: no glTF file: it has no asset version");
    assert_eq!(fails(br#"{"asset": {"version": "1.0"}}"#), "t: glTF of version \"1.0\", not 2");
    let mut old = triangle(json!({}));
    old[4] = 1;
    assert_eq!(fails(&old), "t: glTF of version 1, not 2");
    let cut = &triangle(json!({}))[..100];
    assert!(fails(cut).starts_with("t: the file ends in its JSON, after 80 of "), "{}", fails(cut));
    let mut no_json = triangle(json!({}));
    no_json[16] = b'X';
    assert_eq!(fails(&no_json), "t: the first chunk is no JSON");
    assert!(fails(&[b'['; 100_000]).contains("recursion limit"), "{}", fails(&[b'['; 100_000]));
}

#[test]
fn mistakes_cost_only_themselves() {
    let good = json!({"attributes": {"POSITION": 0}});
    let primitives = json!([
        {"attributes": {}}, {"attributes": {"POSITION": 9}}, {"attributes": {"POSITION": 1}},
        {"attributes": {"POSITION": 2}}, {"attributes": {"POSITION": 3}}, {"attributes": {"POSITION": 4}},
        {"attributes": {"POSITION": 0}, "indices": 0}, {"attributes": {"POSITION": 0}, "mode": 9},
        {"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 5, "material": 7}, good,
    ]);
    let accessors = json!([
        floats3(0, 3), floats3(0, 1_000_000_000), floats3(7, 3),
        {"componentType": 5126, "count": 1_000_000_000_000u64, "type": "VEC3"},
        {"bufferView": "x"},
        {"bufferView": 1, "componentType": 5121, "count": 6, "type": "SCALAR"},
    ]);
    let mut bin = le(&TRIANGLE);
    bin.extend([0, 1, 2, 0, 1, 200]);
    let nodes = json!([{"mesh": 0, "children": [1]}, {"children": [1, 77], "mesh": 3}]);
    let doc = document(
        &[(0, 36), (36, 6)],
        accessors,
        primitives,
        json!({"nodes": nodes, "extensionsRequired": ["XYZ"]}),
    );
    let trial = run(&Gltf, glb(&doc, &bin));
    assert_eq!(trial.pyg.matches("Mesh (\"linear\", (3,), (0, 1, 2)").count(), 2, "{}", trial.pyg);
    let want = [
        "t: error: accessors[4]: invalid type: string \"x\", expected usize: left out",
        "t: error: node 1 hangs on more than one node: taken once",
        "t: error: there is no node 77: left out",
        "t: error: the file requires the extension XYZ, which is not supported: what it says is left out",
        "t: error: mesh 0 (\"mesh0\"), primitive 0: it has no POSITION: left out",
        "t: error: mesh 0 (\"mesh0\"), primitive 1: there is no accessor 9: left out",
        "t: error: mesh 0 (\"mesh0\"), primitive 2: accessor 1: buffer view 0 has 36 bytes of the 12000000000 that are needed: left out",
        "t: error: mesh 0 (\"mesh0\"), primitive 3: accessor 2: there is no buffer view 7: left out",
        "t: error: mesh 0 (\"mesh0\"), primitive 4: 1000000000000 vertices are more than indices can name: left out",
        "t: error: mesh 0 (\"mesh0\"), primitive 5: there is no accessor 4: left out",
        "t: error: mesh 0 (\"mesh0\"), primitive 6: accessor 0 holds no indices: left out",
        "t: error: mesh 0 (\"mesh0\"), primitive 7: unknown mode 9: left out",
        "t: error: mesh 0 (\"mesh0\"), primitive 8: elements that refer to vertices that do not exist (of 3), \
         or are not finite: left out",
        "t: error: mesh 0 (\"mesh0\"), primitive 8: NORMAL: accessor 1: buffer view 0 has 36 bytes of the \
         12000000000 that are needed: left out",
        "t: error: there is no material 7: the current attributes are used",
        "t: error: there is no mesh 3: left out",
    ];
    assert_eq!(trial.messages, want);
}

#[test]
fn each_mistake_of_a_primitive_in_words() {
    let why = |accessor: Value, view: Value| {
        let mut doc = document(&[], json!([accessor]), json!([{"attributes": {"POSITION": 0}}]), json!({}));
        doc["bufferViews"] = json!([view]);
        let trial = run(&Gltf, glb(&doc, &le(&TRIANGLE)));
        let text = trial.messages.join("|");
        let text = text.strip_prefix("t: error: mesh 0 (\"n\"), primitive 0: ").unwrap_or(&text).to_owned();
        text.strip_suffix(": left out").unwrap_or(&text).to_owned()
    };
    let view = || json!({"buffer": 0, "byteLength": 36});
    assert_eq!(why(floats3(0, 3), view()), "");
    let mut a = floats3(0, 3);
    a["type"] = json!("MAT3");
    assert_eq!(why(a.clone(), view()), "accessor 0: type \"MAT3\" where numbers or vectors belong");
    a["type"] = json!("VEC2");
    assert_eq!(why(a.clone(), view()), "accessor 0 is of type \"VEC2\", which does not fit its use");
    a["type"] = json!("VEC3");
    a["componentType"] = json!(1);
    assert_eq!(why(a, view()), "accessor 0: unknown component type 1");
    let short = json!({"buffer": 0, "byteOffset": 8, "byteLength": 36});
    assert_eq!(why(floats3(0, 3), short), "accessor 0: buffer 0 has 36 bytes of the 44 that are needed");
    let far = json!({"buffer": 0, "byteOffset": u64::MAX, "byteLength": 36});
    assert_eq!(why(floats3(0, 3), far), "accessor 0: sizes beyond all memory");
    let stride = json!({"buffer": 0, "byteLength": 36, "byteStride": 4});
    assert_eq!(why(floats3(0, 3), stride), "accessor 0: elements of 12 bytes in steps of 4");
    let none = json!({"buffer": 3, "byteLength": 36});
    assert_eq!(why(floats3(0, 3), none), "accessor 0: there is no buffer 3");
    let meshopt = json!({"buffer": 0, "byteLength": 36, "extensions": {"EXT_meshopt_compression": {}}});
    let want = match cfg!(feature = "meshopt") {
        true => "accessor 0: buffer view 0: EXT_meshopt_compression without buffer",
        false => {
            "accessor 0: buffer view 0: compressed with EXT_meshopt_compression, and this build has no decoder; "
        }
    };
    let got = why(floats3(0, 3), meshopt);
    assert!(got.starts_with(want), "{got}");
}

/// Returns the message about a primitive with a triangle that an extension compresses.
fn compressed(extension: &str, content: Value) -> String {
    let primitives = json!([{"attributes": {"POSITION": 0}, "extensions": {extension: content}}]);
    let accessors = json!([{"componentType": 5126, "count": 3, "type": "VEC3"}]);
    let rest = json!({"extensionsRequired": ["KHR_draco_mesh_compression"]});
    let trial = run(&Gltf, glb(&document(&[(0, 36)], accessors, primitives, rest), &le(&TRIANGLE)));
    let [message] = &trial.messages[..] else { panic!("{:?}", trial.messages) };
    assert!(trial.pyg.is_empty(), "{}", trial.pyg);
    message.strip_prefix("t: error: mesh 0 (\"n\"), primitive 0: ").unwrap().to_owned()
}

#[test]
fn compressed_geometry_that_cannot_be_read_is_named() {
    const DRACO: &str = "KHR_draco_mesh_compression";
    let want = "its geometry is compressed with EXT_other_compression, which is not supported; save the file without \
        compression: left out";
    assert_eq!(compressed("EXT_other_compression", json!({})), want);
    assert_eq!(compressed(DRACO, json!({})), "KHR_draco_mesh_compression without a buffer view: left out");
    let none = compressed(DRACO, json!({"bufferView": 0}));
    assert_eq!(none, "KHR_draco_mesh_compression without attributes: left out");
    let damaged = compressed(DRACO, json!({"bufferView": 0, "attributes": {"POSITION": 0}}));
    assert!(
        damaged.starts_with("KHR_draco_mesh_compression: ") && damaged.ends_with(": left out"),
        "{damaged}"
    );
}

#[cfg(feature = "draco")]
#[test]
fn draco_meshes_are_decoded() {
    let file = include_bytes!("../../../../fuzz/corpus/gltf/bunny-draco.glb");
    let pyg = flat(&run(&Gltf, file).clean());
    let mesh = &pyg[pyg.find("Mesh (").unwrap()..];
    assert!(mesh.starts_with("Mesh (\"linear\", (3, 3, "), "{}", &mesh[..80]);
    let values = |name: &str| -> Vec<f32> {
        let list = mesh.split_once(&format!("\"vertex {name}\", (")).unwrap().1.split_once(')').unwrap().0;
        list.split(", ").map(|x| x.parse().unwrap()).collect()
    };
    let (p, n) = (values("point P"), values("normal N"));
    // The numbers of the accessors that the file describes.
    assert_eq!((p.len(), n.len()), (2826 * 3, 2826 * 3));
    assert_eq!(mesh.split_once("), (").unwrap().0.matches('3').count(), 16944 / 3);
    let most = |k: usize| p.iter().skip(k).step_by(3).copied().fold(f32::MIN, f32::max);
    assert!(
        (most(0) - 0.917_214).abs() < 1e-3 && (most(1) - 0.939_883).abs() < 1e-3,
        "{} {}",
        most(0),
        most(1)
    );
    assert!(n.as_chunks::<3>().0.iter().all(|n| (n.iter().map(|x| x * x).sum::<f32>() - 1.0).abs() < 0.02));
    // The end of the data is missing.
    let trial = run(&Gltf, &file[..file.len() - 4000]);
    assert!(trial.pyg.is_empty() && trial.messages[0].contains("buffer 0 has "), "{:?}", trial.messages);
}

#[cfg(feature = "meshopt")]
#[test]
fn meshopt_views_are_decoded() {
    use meshoptimizer_rs::Workspace;
    use meshoptimizer_rs::codec::{IndexEncoding, VertexEncoding, encode_index_buffer, encode_vertex_buffer};
    let mut workspace = Workspace::default();
    // Positions of 16 bits, normalised (KHR_mesh_quantization), in steps of 8 bytes.
    let corners: [[i16; 4]; 4] =
        [[0, 0, 0, 0], [32767, 0, 0, 0], [32767, 32767, 0, 0], [0, 32767, -32767, 0]];
    let stored: Vec<u8> = corners.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
    for (name, version) in [("EXT_meshopt_compression", 0), ("KHR_meshopt_compression", 1)] {
        let encoding = VertexEncoding::new(version, 2).unwrap();
        let vertices = encode_vertex_buffer(&stored, 4, 8, encoding, &mut workspace).unwrap();
        let indices =
            encode_index_buffer(&[0, 1, 2, 0, 2, 3], IndexEncoding::DEFAULT, &mut workspace).unwrap();
        let view = |offset: usize, data: &[u8], count: usize, stride: usize, mode: &str| {
            json!({"buffer": 1, "byteLength": count * stride, "byteStride": stride, "extensions": {name: {"buffer": 0,
                "byteOffset": offset, "byteLength": data.len(), "byteStride": stride, "count": count, "mode": mode}}})
        };
        let data = [&vertices[..], &indices].concat();
        let accessors = json!([
            {"bufferView": 0, "componentType": 5122, "normalized": true, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ]);
        let primitives = json!([{"attributes": {"POSITION": 0}, "indices": 1}]);
        let rest = json!({
            "bufferViews": [view(0, &vertices, 4, 8, "ATTRIBUTES"), view(vertices.len(), &indices, 6, 2, "TRIANGLES")],
            "buffers": [{"byteLength": data.len()}, {"byteLength": 44}],
            "extensionsRequired": [name, "KHR_mesh_quantization"],
        });
        let file = glb(&document(&[], accessors, primitives, rest), &data);
        let want = "Mesh (\"linear\", (3, 3), (0, 1, 2, 0, 2, 3), \
            \"vertex point P\", (0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, -1))";
        let got = flat(&run(&Gltf, &file).clean());
        assert!(got.contains(want), "{got}");
    }
}

#[test]
fn images_inside_of_the_file_have_its_name() {
    let material = json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}});
    let rest = json!({"materials": [material], "textures": [{"source": 0}], "images": [{"bufferView": 0}]});
    let trial = run(&Gltf, triangle(rest));
    // A stream has no file name.
    assert_eq!(trial.messages.len(), 1);
    assert!(trial.messages[0].contains("which is no file on the disk"), "{:?}", trial.messages);
    assert!(trial.pyg.contains("gltfsurface") && !trial.pyg.contains("texturename"));
    let emissive = json!({"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 1}});
    let rest = json!({
        "materials": [emissive], "textures": [{"source": 0}, {"source": 1}],
        "images": [{"bufferView": 0}, {"uri": "data:image/png;base64,AAAA"}],
    });
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a b.glb");
    std::fs::write(&path, triangle(rest)).unwrap();
    let got = flat(&run_source(&Gltf, &GeneratorSource::file(path.clone())).clean());
    let want = format!("\"string emissionname\", \"{}#1\"", path.display());
    assert!(got.contains(&want), "{got}");
}

#[test]
fn morph_targets_stand_at_rest() {
    let mut bin = le(&TRIANGLE);
    bin.extend(le(&[0., 0., 2., 0., 0., 4., 0., 8., 0.]));
    bin.extend(le(&[0., 0., 1., 0., 0., 1., 0., 0., 1.]));
    bin.extend(le(&[3., 0., 0., 0., 0., 0., 0., 3., 3.]));
    let views = [(0, 36), (36, 36), (72, 36), (108, 36)];
    let accessors = json!([floats3(0, 3), floats3(1, 3), floats3(2, 3), floats3(3, 3)]);
    let primitives = json!([{
        "attributes": {"POSITION": 0, "NORMAL": 2},
        "targets": [{"POSITION": 1}, {"POSITION": 1, "NORMAL": 3}],
    }]);
    let file = |weights: Value, nodes: Value| {
        let mut all = document(&views, accessors.clone(), primitives.clone(), json!({ "nodes": nodes }));
        all["meshes"][0]["weights"] = weights;
        flat(&run(&Gltf, glb(&all, &bin)).clean())
    };
    let plain = json!([{"mesh": 0, "name": "n"}]);
    assert!(file(json!([]), plain.clone()).contains(P));
    assert!(file(json!([0, 0]), plain.clone()).contains(P));
    let half = "\"vertex point P\", (0, 0, 1, 1, 0, 2, 0, 5, 0)";
    assert!(file(json!([0.5]), plain.clone()).contains(half));
    let both = file(json!([0.25, 0.25]), plain);
    assert!(
        both.contains(half) && both.contains("\"vertex normal N\", (0.6, 0, 0.8, 0, 0, 1, 0, 0."),
        "{both}"
    );
    // The weights of a node take precedence over those of the mesh. Other nodes of the mesh keep those of the mesh.
    let nodes = json!([{"mesh": 0, "name": "n"}, {"mesh": 0, "name": "n", "weights": [0, 0]}, {"mesh": 0, "name": "n"}]);
    let three = file(json!([0.5]), nodes);
    assert_eq!((three.matches(half).count(), three.matches(P).count()), (2, 1), "{three}");
}

#[test]
fn skins_at_rest() {
    // Vertex 0 has joint 0, vertex 1 has joint 1, and vertex 2 has both. The transformation of the node has no effect.
    let mut bin = le(&TRIANGLE);
    bin.extend(le(&[0., 0., 1., 0., 0., 1., 0., 0., 1.]));
    bin.extend([0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0]);
    bin.extend([255, 0, 0, 0, 255, 0, 0, 0, 51, 51, 0, 0]);
    let moved = |x: f32| [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., x, 0., 0., 1.];
    bin.extend(le(&[moved(0.0), moved(-1.0)].concat()));
    let bytes4 = |view: usize, normalized: bool| json!({"bufferView": view, "componentType": 5121, "normalized": normalized, "count": 3, "type": "VEC4"});
    let accessors = json!([
        floats3(0, 3), floats3(1, 3), bytes4(2, false), bytes4(3, true),
        {"bufferView": 4, "componentType": 5126, "count": 2, "type": "MAT4"},
    ]);
    let primitives = json!([{"attributes": {"POSITION": 0, "NORMAL": 1, "JOINTS_0": 2, "WEIGHTS_0": 3}}]);
    let rest = json!({
        "nodes": [{"mesh": 0, "name": "n", "skin": 0, "translation": [9, 9, 9]}, {"translation": [0, 0, 2], "children": [2]},
                  {"translation": [0, 4, 0]}],
        "skins": [{"joints": [1, 2], "inverseBindMatrices": 4}],
    });
    let views = [(0, 36), (36, 36), (72, 12), (84, 12), (96, 128)];
    let got = flat(&run(&Gltf, glb(&document(&views, accessors, primitives, rest.clone()), &bin)).clean());
    let want = format!(
        "{HERE}Mesh (\"linear\", (3,), (0, 1, 2), \"vertex point P\", (0, 0, 2, 0, 4, 2, -0.5, 3, 2), \
         \"vertex normal N\", (0, 0, 1, 0, 0, 1, 0, 0, 1))\n"
    );
    assert!(got.contains(&want), "{got}");
    // A joint that does not exist is reported. The mesh keeps its modelled shape.
    let mut rest = rest;
    rest["skins"] = json!([{"joints": [1, 7]}]);
    let accessors = json!([floats3(0, 3), floats3(1, 3), bytes4(2, false), bytes4(3, true)]);
    let primitives = json!([{"attributes": {"POSITION": 0, "JOINTS_0": 2, "WEIGHTS_0": 3}}]);
    let trial = run(&Gltf, glb(&document(&views, accessors, primitives, rest), &bin));
    assert_eq!(
        trial.messages,
        ["t: error: skin 0: joint 7 is no node of the scene: \"n\" stands as it was modelled"]
    );
    assert!(flat(&trial.pyg).contains(P), "{}", trial.pyg);
}
