//! Tests the table "Only what a scene requires" of the manual: what a row names is counted as 0 in a scene without it,
//! and as more in one that requires it.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test, with a line number")]

mod folder;

use folder::Folder;
use serde_json::Value;

/// The parts of a scene, and the options with which it is rendered.
#[derive(Clone, Copy)]
struct Scene {
    /// Statements before the camera.
    front: &'static str,
    /// The output and the camera.
    images: &'static str,
    /// Statements behind `World`.
    lights: &'static str,
    /// Statements before the sphere.
    more: &'static str,
    options: &'static [&'static str],
}

/// A sphere in the light of the sun.
const PLAIN: Scene = Scene {
    front: "",
    images: "Output (\"a.exr\", \"exr\", \"rgba\", \"main\")\n",
    lights: "",
    more: "",
    options: &[],
};

/// The same, where rays could find the sphere.
const IN_SET: Scene = Scene { more: "Attribute (\"string geometryset\", \"+all\")\n", ..PLAIN };

/// A light whose shadows are traced.
const KEY: &str =
    "Light (\"key\", \"pointlight\", \"string shadowname\", \"all\", \"point from\", (3, 3, 0))\n";

/// A map on demand.
const MAP: &str = "Output (\"a.exr\", \"exr\", \"rgba\", \"main\")\n\
    Output (\"lamp.sm\", \"shadow\", \"z\", \"lamp\", \"int dynamic\", 1)\n\
    PushTransform ()\nTranslate (0, 0, -8)\nCamera (\"lamp\")\nPopTransform ()\n";

const SHADERS: [(&str, &str); 3] = [
    (
        "mirror.gsl",
        "surface mirror () {
            color seen = 0;
            trace (\"all\", P, reflect (normalize (I), normalize (N)), 0, 1) {
                color one = 0;
                if (getmessage (\"trace\", \"Cl\", one) != 0) seen += one;
            }
            C = seen;
        }",
    ),
    ("mapped.gsl", "surface mapped () { C = (color) texture (\"earlier.exr\", u, v); }"),
    ("wavy.gsl", "displacement wavy () { P += 0.1 * sin (40 * u) * normalize (N); }"),
];

fn text(scene: &Scene) -> String {
    let Scene { front, images, lights, more, .. } = scene;
    format!(
        "Attribute (\"int[2] resolution\", (32, 24))\nAttribute (\"int[2] spatialquality\", (2, 2))\n\
         {front}{images}Camera (\"main\")\nWorld ()\nLight (\"sun\", \"distantlight\")\n{lights}\
         Shader (\"surface\", \"plastic\")\n{more}Translate (0, 0, 4)\nSphere (1, -1, 1, 360)\nRender ()\n"
    )
}

/// Renders a scene. Returns what its statistics say as JSON.
fn record(folder: &Folder, scene: &Scene) -> Value {
    folder.write("scene.pyg", &text(scene));
    let ran = folder.run(&[&["-statistics-json", "s.json"], scene.options, &["scene.pyg"]].concat());
    assert!(ran.status == 0 && !ran.said.contains("error:"), "{}", ran.said);
    folder.json("s.json")["frames"][0].clone()
}

/// Returns a count; 0 for a part of the record that is not there.
fn count(record: &Value, field: &str) -> u64 {
    let value = record.pointer(field).unwrap_or(&Value::Null);
    value.as_u64().unwrap_or(u64::from(value.is_object()))
}

#[test]
fn what_a_scene_does_not_require_is_counted_as_0() {
    let folder = Folder::with(&SHADERS);
    folder.write("far.pyg", "Sphere (1, -1, 1, 360)\n");
    let plain = record(&folder, &PLAIN);
    std::fs::rename(folder.path().join("a.exr"), folder.path().join("earlier.exr")).unwrap();
    let in_set = record(&folder, &IN_SET);
    let aside = "PushTransform ()\nTranslate (0, 0, -9)\nSphere (1, -1, 1, 360)\nPopTransform ()\n";
    let behind = "PushTransform ()\nTranslate (0, 0, 900)\nSphere (1, -1, 1, 360)\nPopTransform ()\n";
    let depth = "Output (\"z.exr\", \"exr\", \"z\", \"main\")\n";
    // A scene without, one that requires it, and the counts.
    let rows: [(&Value, Scene, &[&str]); 14] = [
        (&plain, IN_SET, &["/shading/ray_structures"]),
        (
            &in_set,
            Scene { lights: KEY, ..IN_SET },
            &[
                "/shading/rays",
                "/shading/shadow_rays",
                "/shading/ray_structures_built",
                "/shading/ray_triangles",
            ],
        ),
        (
            &in_set,
            Scene {
                lights: KEY,
                more: "Attribute (\"string geometryset\", \"+all\")\nAttribute (\"float displace:maxradius\", 0.1)\n\
                       Shader (\"displacement\", \"wavy\")\n",
                ..PLAIN
            },
            &["/shading/ray_tessellations", "/shading/ray_tessellation_bytes_peak"],
        ),
        (
            &in_set,
            Scene {
                more: "Attribute (\"string geometryset\", \"+all\")\nShader (\"surface\", \"mirror\")\n",
                ..PLAIN
            },
            &["/shading/rays", "/shading/ray_hits_shaded"],
        ),
        (
            &in_set,
            Scene {
                lights: "Light (\"bounce\", \"indirectlight\", \"string indirectname\", \"all\")\n",
                ..IN_SET
            },
            &["/shading/light_records", "/shading/light_rays", "/shading/light_points"],
        ),
        (
            &plain,
            Scene { more: "Shader (\"surface\", \"mapped\")\n", ..PLAIN },
            &["/shading/texture_files", "/shading/texture_automipmaps", "/shading/texture_lookups"],
        ),
        (
            &record(&folder, &Scene { images: MAP, ..PLAIN }),
            Scene {
                images: MAP,
                lights: "Light (\"lamp\", \"pointlight\", \"string shadowname\", \"lamp.sm\", \"point from\", (0, 0, -8))\n",
                ..PLAIN
            },
            &["/shading/texture_lookups", "/shading/texture_tiles_read"],
        ),
        (
            &record(&folder, &Scene { images: depth, ..PLAIN }),
            PLAIN,
            &["/cameras/0/grids_shaded", "/cameras/0/points_shaded"],
        ),
        (&plain, Scene { images: depth, ..PLAIN }, &["/cameras/0/grids_unshaded"]),
        (&plain, Scene { more: aside, ..PLAIN }, &["/cameras/0/primitives_off_screen"]),
        (&plain, Scene { more: behind, ..PLAIN }, &["/cameras/0/primitives_hidden"]),
        (
            &record(&folder, &Scene { more: "Input (\"far.pyg\", (-1, 1, -1, 1, -20, -18))\n", ..PLAIN }),
            Scene { more: "Input (\"far.pyg\", (-1, 1, -1, 1, 18, 20))\n", ..PLAIN },
            &["/inputs/read"],
        ),
        (&plain, Scene { options: &["-passes", "2"], ..PLAIN }, &["/cameras/0/passes"]),
        (&plain, Scene { front: "Attribute (\"int rerender\", 1)\n", ..PLAIN }, &["/cameras/0/reuse"]),
    ];
    for (without, scene, fields) in &rows {
        let with = record(&folder, scene);
        for field in *fields {
            assert_eq!(count(without, field), 0, "{field} {}", text(scene));
            assert!(count(&with, field) > 0, "{field} {}", text(scene));
        }
    }
    // A map that no shader looks up, and an input that nothing sees, are no cameras and primitives of the frame.
    let unread = record(&folder, &Scene { more: "Input (\"far.pyg\", (-1, 1, -1, 1, -20, -18))\n", ..PLAIN });
    assert_eq!((count(&unread, "/inputs/unread"), count(&unread, "/cameras/0/primitives")), (1, 1));
    // Only the scene was read.
    record(&folder, &PLAIN);
    assert_eq!(folder.json("s.json")["files_read"], serde_json::json!(["scene.pyg"]));
}
