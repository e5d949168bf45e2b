//! The scenes, as texts.

use granita_benches::{Fur, repository};
use std::fmt::Write as _;

/// The number of the quality of a scene: as it is, and as the converged image has it.
#[derive(Clone, Copy)]
pub(crate) struct Quality {
    pub(crate) shading: f32,
    pub(crate) maxerror: f32,
}

pub(crate) const ORDINARY: Quality = Quality { shading: 1.0, maxerror: 0.25 };
pub(crate) const CONVERGED: Quality = Quality { shading: 4.0, maxerror: 0.0 };

/// Makes the text of a scene.
pub(crate) type Make = fn(Quality) -> String;

/// The scenes by their names.
pub(crate) const SCENES: [(&str, Make); 12] = [
    ("box", cornell),
    ("room", room),
    ("rabbit", rabbit),
    ("still life", still_life),
    ("fur", fur),
    ("lens", lens),
    ("motion", motion),
    ("glossy", glossy),
    ("penumbra", penumbra),
    ("veils", veils),
    ("displaced", displaced),
    ("hair", hair),
];

/// The statements of all scenes. `before` precedes `World`.
fn scene(quality: Quality, before: &str, after: &str) -> String {
    format!(
        "Attribute (\"string path:input\", \"examples/indirect:examples/data:examples/first:&\")\n\
         Attribute (\"string path:texture\", \"examples/first/out:&\")\n\
         Attribute (\"string path:shader\", \"examples/first/out:&\")\n\
         Attribute (\"int[2] resolution\", (96, 72))\nAttribute (\"string projection\", \"perspective\")\n\
         Attribute (\"float shadingquality\", {})\n{before}\
         World ()\nAttribute (\"string geometryset\", \"+all\")\n{after}Render ()\n",
        quality.shading
    )
}

/// The parameters of indirect light.
fn bounce(quality: Quality, set: &str) -> String {
    format!(
        "Light (\"bounce\", \"indirectlight\", \"string indirectname\", \"{set}\", \"float maxerror\", {})\n",
        quality.maxerror
    )
}

/// The light of the panorama of the first example.
fn panorama(quality: Quality) -> String {
    format!(
        "Light (\"sky\", \"envlight\", \"string envname\", \"room.env\", \"string occlusionname\", \"all\", \
         \"float blur\", 0.5, \"float samples\", 64, \"float maxerror\", {})\n",
        quality.maxerror
    )
}

const SUN: &str = "Light (\"sun\", \"distantlight\", \"float intensity\", 1, \"point from\", (-1, 2, -1.5), \
                   \"point to\", (0, 0, 0), \"string shadowname\", \"all\")\n";
const AMBIENT: &str = "Light (\"fill\", \"ambientlight\", \"float intensity\", 0.1)\n";
const FLOOR: &str =
    "Patch (\"linear\", 2, 2, \"vertex point P\", (-8, -1, 12, 8, -1, 12, -8, -1, -2, 8, -1, -2))\n";

/// A sphere at a place.
fn sphere([x, y, z]: [f64; 3], radius: f64) -> String {
    format!(
        "PushTransform ()\nTranslate ({x:.3}, {y:.3}, {z:.3})\nSphere ({radius}, {}, {radius}, 360)\nPopTransform ()\n",
        -radius
    )
}

fn cornell(q: Quality) -> String {
    let lights = "Light (\"lamp\", \"pointlight\", \"float intensity\", 40000, \"float falloff\", 2, \
                  \"point from\", (278, 450, 279.5), \"string shadowname\", \"all\")\n";
    let before = "Attribute (\"float fov\", 39.3)\nScale (-1, 1, 1)\nTranslate (-278, -273, 800)\n";
    scene(q, before, &format!("{lights}{}Input (\"box.pyg\")\n", bounce(q, "all")))
}

fn room(q: Quality) -> String {
    let path = repository().join("benches/frames/room.pyg");
    let text = std::fs::read_to_string(path).unwrap_or_default();
    let declared = "\"string indirectname\", \"room\"";
    format!("Attribute (\"float shadingquality\", {})\n", q.shading)
        + &text.replace(declared, &format!("{declared}, \"float maxerror\", {}", q.maxerror))
}

fn rabbit(q: Quality) -> String {
    let before = "Attribute (\"float fov\", 30)\nTranslate (0, -4.5, 24)\nRotate (-10, 1, 0, 0)\n";
    let after = "Shader (\"surface\", \"matte\")\nAttribute (\"color C\", (0.8, 0.7, 0.6))\nInput (\"rabbit.pyg\")\n\
                 Patch (\"linear\", 2, 2, \"vertex point P\", (-40, 0, 40, 40, 0, 40, -40, 0, -20, 40, 0, -20))\n";
    scene(q, before, &(panorama(q) + after))
}

/// The world of the first example, in focus and at rest.
fn still_life(q: Quality) -> String {
    let before = "Attribute (\"string units:length\", \"mm\")\nAttribute (\"int ray:maxdepth\", 2)\n\
                  Attribute (\"float fov\", 23.5)\nTranslate (0, 0, 16)\nRotate (-9, 1, 0, 0)\n\
                  Translate (0, -1.75, 0)\n";
    let first = include_str!("../../../../examples/first/first.pyg");
    let world = first.split_once("\nWorld ()\n").map_or("", |(_, world)| world);
    scene(q, before, &world.replace("\nRender ()\n", "\n"))
}

fn fur(q: Quality) -> String {
    of_fur(q, Fur { curves: 3000, moves: false, defocus: false, ..Fur::default() })
}

fn of_fur(q: Quality, fur: Fur) -> String {
    let text = fur.scene().replace("(640, 480)", "(96, 72)");
    let text = text.replace("Output (\"out.tif\", \"tiff\", \"rgba\", \"camera\")\n", "");
    format!("Attribute (\"float shadingquality\", {})\n{text}", q.shading)
}

fn lens(q: Quality) -> String {
    let before = "Attribute (\"float fov\", 40)\nAttribute (\"float fstop\", 1.4)\nAttribute (\"float focallength\", 0.4)\n\
                  Attribute (\"float focaldistance\", 6)\n";
    let mut after = format!(
        "{SUN}{AMBIENT}Shader (\"surface\", \"plastic\", \"float roughness\", 0.03, \"float Ks\", 8)\n"
    );
    for k in 0..30 {
        let (i, j) = (f64::from(k % 5), f64::from(k / 5));
        let _ = writeln!(after, "Attribute (\"color C\", (0.{}, 0.3, 0.{}))", 2 + k % 7, 1 + k % 8);
        after += &sphere([i * 1.2 - 2.4, -0.6 + 0.2 * j, 3.0 + 1.8 * j], 0.4);
    }
    scene(q, before, &(after + FLOOR))
}

fn motion(q: Quality) -> String {
    let before = "Attribute (\"float fov\", 45)\nAttribute (\"float[2] shutter\", (0, 1))\n";
    let mut after = format!("{SUN}{AMBIENT}Shader (\"surface\", \"plastic\")\n");
    for k in 0..24 {
        let (x, y) = (f64::from(k % 6) - 2.5, f64::from(k / 6) * 0.8 - 0.8);
        let _ = writeln!(
            after,
            "Attribute (\"color C\", (0.8, 0.{}, 0.3))\nPushTransform ()\nMotion (0, 1)\n\
             Translate ({x}, {y}, 5)\nTranslate ({:.2}, {:.2}, 5)\nSphere (0.35, -0.35, 0.35, 360)\nPopTransform ()",
            1 + k % 8,
            x + 0.1 * f64::from(k % 9),
            y + 0.05 * f64::from(k % 5)
        );
    }
    scene(q, before, &(after + FLOOR))
}

fn glossy(q: Quality) -> String {
    let before = "Attribute (\"float fov\", 45)\nTranslate (0, 0.3, 0)\nRotate (-8, 1, 0, 0)\n";
    let mut after = format!("{SUN}{AMBIENT}Shader (\"surface\", \"plastic\")\n");
    for k in 0..5 {
        let _ = writeln!(after, "Attribute (\"color C\", (0.{}, 0.4, 0.{}))", 9 - k, 1 + k);
        after += &sphere([f64::from(k) * 1.3 - 2.6, -0.5, 6.0 + 0.5 * f64::from(k % 2)], 0.5);
    }
    after += "Attribute (\"color C\", (0.7, 0.7, 0.75))\n\
              Shader (\"surface\", \"shinymetal\", \"string envname\", \"all\", \"float samples\", 8, \"float blur\", 0.15)\n";
    scene(q, before, &(after + FLOOR))
}

fn penumbra(q: Quality) -> String {
    let before = "Attribute (\"float fov\", 45)\nTranslate (0, 0.3, 0)\nRotate (-12, 1, 0, 0)\n";
    let lamp = |set: &str, at: [f64; 3], half: f64| {
        let [x, y, z] = at;
        let (x0, x1, z0, z1) = (x - half, x + half, z - half, z + half);
        format!(
            "PushAttributes ()\nAttribute (\"string geometryset\", \"{set}\")\nShader (\"surface\", \"constant\")\n\
             Patch (\"linear\", 2, 2, \"vertex point P\", ({x0}, {y}, {z0}, {x1}, {y}, {z0}, {x0}, {y}, {z1}, {x1}, {y}, {z1}))\n\
             PopAttributes ()\n"
        )
    };
    let light = |set: &str, intensity: f64| {
        format!(
            "Attribute (\"int light:nsamples\", 8)\n\
             Light (\"of {set}\", \"arealight\", \"string geometry\", \"{set}\", \"float twosided\", 1, \
             \"float intensity\", {intensity}, \"string shadowname\", \"all\")\n"
        )
    };
    let mut after = lamp("large", [-2.0, 3.0, 5.0], 1.0) + &lamp("small", [2.5, 3.0, 5.0], 0.1);
    after += &(light("large", 8.0) + &light("small", 6.0));
    after += "Shader (\"surface\", \"matte\")\n";
    for k in 0..4 {
        after += &sphere([f64::from(k) * 1.4 - 2.1, -0.4, 5.0 + 0.6 * f64::from(k % 2)], 0.6);
    }
    scene(q, before, &(after + FLOOR))
}

fn veils(q: Quality) -> String {
    let before = "Attribute (\"float fov\", 45)\n";
    let mut after = format!("{AMBIENT}{}Shader (\"surface\", \"matte\")\n", SUN.replace("all", ""));
    for k in 0..40 {
        let (turn, z) = (f64::from(k) * 2.4, 9.0 - 0.15 * f64::from(k));
        let (x, y) = (turn.cos() * 1.6, turn.sin() * 1.1);
        let _ = writeln!(
            after,
            "Attribute (\"color C\", (0.{}, 0.{}, 0.5))\nAttribute (\"color opacity\", (0.3, 0.3, 0.3))\n\
             Patch (\"linear\", 2, 2, \"vertex point P\", ({:.3}, {:.3}, {z:.3}, {:.3}, {:.3}, {z:.3}, {:.3}, {:.3}, {z:.3}, {:.3}, {:.3}, {z:.3}))",
            1 + k % 9,
            9 - k % 9,
            x - 1.0,
            y - 0.7,
            x + 0.8,
            y - 0.9,
            x - 0.9,
            y + 0.8,
            x + 1.0,
            y + 0.6
        );
    }
    scene(q, before, &after)
}

fn displaced(q: Quality) -> String {
    let before =
        "Attribute (\"float fov\", 30)\nAttribute (\"string units:length\", \"cm\")\nTranslate (0, 0, 4)\n";
    let after = "Light (\"key\", \"distantlight\", \"float intensity\", 1, \"point from\", (-1, 1, -1), \"point to\", (0, 0, 0))\n\
                 Shader (\"surface\", \"plastic\")\nShader (\"displacement\", \"bumpy\")\n\
                 Attribute (\"float displace:maxradius\", 0.2)\nSphere (1, -1, 1, 360)\n";
    scene(q, before, after)
}

fn hair(q: Quality) -> String {
    let text = of_fur(q, Fur { curves: 3000, moves: false, defocus: false, ..Fur::default() });
    let key = text.find("Light (\"key\"").unwrap_or_default();
    let end = text.find("Shader (\"surface\"").unwrap_or(key);
    format!(
        "Attribute (\"string path:texture\", \"examples/first/out:&\")\n{}{}Attribute (\"string geometryset\", \"+all\")\n{}",
        &text[..key],
        panorama(q),
        &text[end..]
    )
}
