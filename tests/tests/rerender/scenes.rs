//! The eight scenes. Each has lights and surfaces of other kinds than the others, and a frame takes a fraction of a
//! second.

use crate::model::{Camera, File, Light, Output, Stage, Value, Values};
use std::fmt::Write;

/// The number of scenes.
pub(crate) const COUNT: usize = 8;

/// Returns a scene by its index, below [`COUNT`].
pub(crate) fn scene(index: usize) -> Stage {
    [spots, rays, hair, motion, bounce, sky, layers, views][index % COUNT]()
}

const PERSPECTIVE: &str =
    "\"string projection\", \"perspective\", \"float fov\", 36, \"int[2] resolution\", (64, 48)";

fn camera(name: &'static str, place: &'static str, fixed: &'static str) -> Camera {
    let mut params = Values::default();
    params.set("int[2] spatialquality", [2.0, 2.0].into());
    Camera { name, place, fixed, params }
}

fn main_camera() -> Camera {
    camera("main", "Translate (0, 1.6, -6)\nRotate (14, 1, 0, 0)\n", PERSPECTIVE)
}

/// Returns a floor of the side 8 at the height 0, whose state is set by `state`.
fn floor(state: &str) -> String {
    format!(
        "PushAttributes ()\nAttribute (\"string name\", \"room/floor\")\n{state}Patch (\"linear\", 2, 2, \"vertex point P\", \
         (-4, 0, 4, 4, 0, 4, -4, 0, -4, 4, 0, -4))\nPopAttributes ()\n"
    )
}

/// Returns a sphere at a position, whose state is set by `state`.
fn ball(name: &str, [x, y, z]: [f32; 3], radius: f32, state: &str) -> String {
    format!(
        "PushAttributes ()\nAttribute (\"string name\", \"{name}\")\n{state}Translate ({x}, {y}, {z})\n\
         Sphere ({radius}, -{radius}, {radius}, 360)\nPopAttributes ()\n"
    )
}

fn numbers<const N: usize>(values: [f32; N]) -> Vec<Value> {
    values.iter().map(|value| [*value].into()).collect()
}

fn texts<const N: usize>(values: [&'static str; N]) -> Vec<Value> {
    values.iter().map(|value| (*value).into()).collect()
}

fn file(name: &'static str) -> File {
    File { name, version: 0 }
}

fn stage(name: &'static str) -> Stage {
    Stage {
        name,
        globals: "",
        cameras: vec![main_camera()],
        outputs: vec![Output::new("main.exr", "rgba", "main")],
        lights: Vec::new(),
        objects: String::new(),
        patterns: Vec::new(),
        files: Vec::new(),
        texts: Vec::new(),
        pattern: ".*",
    }
}

/// A spot light with a shadow map, lights without shadows, a texture, patterns, and outputs of many kinds.
fn spots() -> Stage {
    let objects =
        floor("Shader (\"surface\", \"texmap\", \"string texturename\", \"brick.tx\", \"float Ks\", 0.2)\n")
            + &ball(
                "set/red",
                [-1.0, 0.7, 0.0],
                0.7,
                "Attribute (\"color C\", (0.8, 0.2, 0.1))\nShader (\"surface\", \"plastic\")\n",
            )
            + &ball("set/marble", [0.9, 0.8, 0.6], 0.8, "Shader (\"surface\", \"greenmarble\")\n")
            + &ball("set/oak", [0.2, 0.3, -1.0], 0.3, "Shader (\"surface\", \"oak\")\n");
    let lights = vec![
        Light::new("key", "spotlight", [3.0, 5.0, -3.0], [-45.0, 49.7], 45.0)
            .with("string shadowname", "key.sm")
            .with("float shadowblur", [0.01])
            .choice("float shadowblur", numbers([0.0, 0.01, 0.05]))
            .choice("float shadowbias", numbers([0.02, 0.1]))
            .choice("string shadowname", texts(["key.sm", ""])),
        Light::new("fill", "pointlight", [-3.0, 2.0, -3.0], [0.0, 0.0], 6.0),
        Light::new("sun", "distantlight", [0.0, 4.0, 0.0], [20.0, 60.0], 0.2),
        Light::new("base", "ambientlight", [0.0, 0.0, 0.0], [0.0, 0.0], 0.1),
        Light::new("slide", "uberlight", [0.0, 4.0, 0.0], [0.0, 90.0], 0.6)
            .with("string slidename", "brick.tx")
            .with("float coneangle", [0.6])
            .spare(),
        Light::new("rim", "pointlight", [0.0, 2.0, 3.0], [0.0, 0.0], 5.0).spare(),
    ];
    let outputs = vec![
        Output::new("main.exr", "rgba", "main"),
        Output::new("look.tif", "rgb", "main").with("float gain", [0.8]).with("float gamma", [2.2]),
        Output::new("depth.exr", "z", "main"),
        Output::new("normal.exr", "normal N", "main").spare(),
        Output::new("view.tif", "vector I", "main").spare(),
        Output::new("color.tif", "color C", "main")
            .with("int[4] quantize", [0.0, 65535.0, 0.0, 65535.0])
            .spare(),
    ];
    let patterns = vec!["^set/", "red", "floor"];
    let files = vec![file("key.sm"), file("brick.tx")];
    Stage { objects, lights, outputs, patterns, files, ..stage("spots") }
}

/// An area light and lights whose shadows are traced, also through a coloured ball, and surfaces that trace rays.
fn rays() -> Stage {
    let sets = "Attribute (\"string geometryset\", \"+solid,+seen\")\n";
    let objects = format!(
        "PushAttributes ()\nAttribute (\"string name\", \"panel\")\nAttribute (\"string geometryset\", \"panel,seen\")\n\
         Shader (\"surface\", \"constant\")\nPatch (\"linear\", 2, 2, \"vertex point P\", (-3, 2.5, 1, -3, 2.5, -1, -2, 4, 1, -2, 4, -1))\n\
         PopAttributes ()\n{sets}"
    ) + &floor(
        "Shader (\"surface\", \"plastic\")\nAttribute (\"float shadingquality\", 0.5)\n",
    ) + &ball(
        "set/mirror",
        [-0.9, 0.8, 0.4],
        0.8,
        "Shader (\"surface\", \"shinymetal\", \"string envname\", \"seen\")\n",
    ) + &ball(
        "set/glass",
        [0.9, 0.6, -0.4],
        0.6,
        "Shader (\"surface\", \"glass\", \"string envname\", \"seen\")\n",
    ) + &ball(
        "set/blue",
        [0.4, 0.3, -1.3],
        0.3,
        "Attribute (\"color opacity\", (0.8, 0.6, 0.2))\nAttribute (\"color C\", (0.2, 0.4, 0.9))\nShader (\"surface\", \"plastic\")\n",
    );
    let lights = vec![
        Light::new("panel", "arealight", [0.0, 0.0, 0.0], [0.0, 0.0], 12.0)
            .with("string geometry", "panel")
            .with("string shadowname", "solid")
            .with("float twosided", [1.0])
            .attribute("int light:nsamples", [2.0])
            .choice("string shadowname", texts(["solid", ""]))
            .choice("float falloff", numbers([1.0, 2.0])),
        Light::new("key", "spotlight", [3.0, 4.0, -3.0], [-45.0, 43.0], 25.0)
            .with("string shadowname", "solid")
            .choice("float shadowblur", numbers([0.0, 0.05]))
            .choice("float shadowsamples", numbers([1.0, 3.0]))
            .choice("float shadowbias", numbers([-1.0, 0.05])),
        Light::new("back", "pointlight", [0.5, 3.0, 3.0], [0.0, 0.0], 8.0).with("string shadowname", "solid"),
        Light::new("fill", "pointlight", [2.0, 1.0, -4.0], [0.0, 0.0], 5.0).spare(),
        Light::new("sun", "distantlight", [0.0, 4.0, 0.0], [-30.0, 50.0], 0.4)
            .with("string shadowname", "solid")
            .spare(),
    ];
    let outputs = vec![
        Output::new("main.exr", "rgba", "main"),
        Output::new("depth.tif", "z", "main").with("int[4] quantize", [0.0; 4]),
        Output::new("opacity.exr", "color opacity", "main").spare(),
    ];
    let small = "\"string projection\", \"perspective\", \"float fov\", 36, \"int[2] resolution\", (48, 36)";
    let main = camera("main", "Translate (0, 1.6, -6)\nRotate (14, 1, 0, 0)\n", small);
    let patterns = vec!["^set/", "mirror", "glass|floor"];
    Stage { cameras: vec![main], objects, lights, outputs, patterns, ..stage("rays") }
}

/// Returns hairs that stand on a circle in the plane of the floor, each a cubic curve with a thin tip.
fn hairs(count: usize) -> String {
    let (mut points, mut widths) = (Vec::new(), Vec::new());
    for i in 0..count {
        let angle = i as f32 * 2.399_963;
        let radius = 0.8 * ((i as f32 + 0.5) / count as f32).sqrt();
        let (x, z) = (radius * angle.cos(), radius * angle.sin());
        for (step, width) in [0.05_f32, 0.045, 0.03, 0.01].into_iter().enumerate() {
            let height = step as f32 * 0.4;
            let bend = 1.0 + 0.25 * height * height;
            points.push(format!("{:.3}, {:.3}, {:.3}", x * bend, height, z * bend));
            widths.push(format!("{width}"));
        }
    }
    format!(
        "Curves (\"bezier\", {count}, 4, \"vertex point P\", ({}), \"vertex float width\", ({}))\n",
        points.join(", "),
        widths.join(", ")
    )
}

/// Hair with a volume shadow map, points, a screen with holes, and a map that is rendered on demand; two cameras.
fn hair() -> Stage {
    let mut objects = floor(
        "Attribute (\"string geometryset\", \"+lamp\")\nShader (\"surface\", \"clay\", \"float roughness\", 0.4)\n",
    );
    _ = write!(
        objects,
        "PushAttributes ()\nAttribute (\"string name\", \"set/hair\")\nAttribute (\"string geometryset\", \"+lamp\")\n\
         Attribute (\"color C\", (0.7, 0.4, 0.15))\nShader (\"surface\", \"plastic\")\nTranslate (-0.8, 0, 0)\n{}PopAttributes ()\n\
         PushAttributes ()\nAttribute (\"string name\", \"set/points\")\nShader (\"surface\", \"plastic\")\n\
         Points (5, \"vertex point P\", (0.4, 0.2, -1, 0.7, 0.3, -0.8, 1, 0.2, -1, 1.3, 0.4, -0.7, 0.9, 0.7, -0.9), \
         \"constant float width\", 0.3)\nPopAttributes ()\n\
         PushAttributes ()\nAttribute (\"string name\", \"set/screen\")\nAttribute (\"string geometryset\", \"+lamp\")\n\
         ShaderGroupBegin ()\nShader (\"surface\", \"pretexture\", \"string opacityname\", \"holes.tx\")\n\
         Shader (\"surface\", \"plastic\")\nShaderGroupEnd ()\n\
         Patch (\"linear\", 2, 2, \"vertex point P\", (0.2, 2, 0.4, 2, 2, 0.8, 0.2, 0, 0.4, 2, 0, 0.8))\nPopAttributes ()\n",
        hairs(60)
    );
    let lights = vec![
        Light::new("lamp", "spotlight", [2.0, 4.0, -3.0], [-33.7, 48.0], 25.0)
            .with("string shadowname", "lamp.sm")
            .with("float shadowbias", [0.05])
            .choice("float shadowblur", numbers([0.0, 0.03]))
            .choice("float shadowbias", numbers([0.05, 0.2])),
        Light::new("key", "spotlight", [-3.0, 4.0, -2.0], [56.3, 48.0], 25.0)
            .with("string shadowname", "key.vsm")
            .choice("float shadowblur", numbers([0.0, 0.02]))
            .choice("string shadowname", texts(["key.vsm", "", "lamp.sm"])),
        Light::new("base", "ambientlight", [0.0, 0.0, 0.0], [0.0, 0.0], 0.15),
        Light::new("rim", "pointlight", [0.0, 2.0, 3.0], [0.0, 0.0], 6.0).spare(),
    ];
    let lens = "\"string projection\", \"perspective\", \"float fov\", 36, \"int[2] resolution\", (64, 48), \"float fstop\", 2, \
                \"float focallength\", 0.3, \"float focaldistance\", 5.5";
    let mut main = camera("main", "Translate (0, 1.6, -6)\nRotate (14, 1, 0, 0)\n", lens);
    main.params.set("int dofquality", [4.0].into());
    let side = "Translate (5, 2, -1)\nRotate (-80, 0, 1, 0)\nRotate (18, 1, 0, 0)\n";
    let small = "\"string projection\", \"perspective\", \"float fov\", 40, \"int[2] resolution\", (40, 30)";
    let lamp = "\"string projection\", \"perspective\", \"float fov\", 60, \"int[2] resolution\", (96, 96)";
    let at_lamp = "Translate (2, 4, -3)\nRotate (-33.7, 0, 1, 0)\nRotate (48, 1, 0, 0)\n";
    Stage {
        cameras: vec![main, camera("side", side, small), camera("lamp", at_lamp, lamp)],
        outputs: vec![
            Output::new("main.exr", "rgba", "main"),
            Output::new("side.exr", "rgba", "side"),
            Output::new("lamp.sm", "z", "lamp"),
            Output::new("depth.exr", "z", "side").spare(),
            Output::new("look.tif", "rgb", "main").with("float gain", [1.5]).spare(),
        ],
        objects,
        lights,
        patterns: vec!["hair", "points|screen", "^room"],
        files: vec![file("key.vsm"), file("holes.tx")],
        ..stage("hair")
    }
}

/// Objects that move and turn while the shutter is open, a lens, and traced shadows of what moves.
fn motion() -> Stage {
    let objects = "Attribute (\"string geometryset\", \"+solid\")\n".to_owned()
        + &floor("Shader (\"surface\", \"oak\")\n")
        + "PushAttributes ()\nAttribute (\"string name\", \"set/rolling\")\nAttribute (\"int ray:motion\", 1)\n\
           Shader (\"surface\", \"plastic\")\nAttribute (\"color C\", (0.7, 0.2, 0.2))\nMotion (0, 1)\nTranslate (-1.2, 0.5, 0)\n\
           Translate (-0.6, 0.5, -0.3)\nSphere (0.5, -0.5, 0.5, 360)\nPopAttributes ()\n\
           PushAttributes ()\nAttribute (\"string name\", \"set/turning\")\nShader (\"surface\", \"screen\", \"float sfreq\", 4, \"float tfreq\", 4)\n\
           Translate (1, 1, 0.5)\nMotion (0, 1)\nRotate (0, 0, 0, 1)\nRotate (30, 0, 0, 1)\n\
           Patch (\"linear\", 2, 2, \"vertex point P\", (-0.7, -0.7, 0, 0.7, -0.7, 0, -0.7, 0.7, 0, 0.7, 0.7, 0))\nPopAttributes ()\n\
           PushAttributes ()\nAttribute (\"string name\", \"set/bending\")\nShader (\"surface\", \"plastic\")\nMotion (0, 0.5, 1)\n\
           Patch (\"bezier\", 4, 4, \"vertex point P\", (";
    let cloth = |height: f32| {
        let row = |z: f32, up: f32| format!("0.2, {up}, {z}, 0.5, {up}, {z}, 0.8, {up}, {z}, 1.1, {up}, {z}");
        [row(-1.4, 0.1), row(-1.2, 0.1 + height), row(-1.0, 0.1), row(-0.8, 0.3)].join(", ")
    };
    let objects = objects
        + &cloth(0.1)
        + "))\nPatch (\"bezier\", 4, 4, \"vertex point P\", ("
        + &cloth(0.4)
        + "))\nPatch (\"bezier\", 4, 4, \"vertex point P\", ("
        + &cloth(0.6)
        + "))\nPopAttributes ()\n";
    let lights = vec![
        Light::new("key", "spotlight", [3.0, 4.0, -3.0], [-45.0, 43.0], 30.0)
            .with("string shadowname", "solid")
            .choice("float shadowblur", numbers([0.0, 0.04]))
            .choice("string shadowname", texts(["solid", ""])),
        Light::new("fill", "pointlight", [-3.0, 3.0, -2.0], [0.0, 0.0], 8.0),
        Light::new("soft", "softlight", [0.0, 0.0, 0.0], [30.0, 70.0], 0.3)
            .with("string shadowname", "solid")
            .with("float shadowsamples", [2.0])
            .choice("float angle", numbers([0.05, 0.3]))
            .spare(),
        Light::new("rim", "shadowspot", [0.0, 3.0, 3.0], [180.0, 45.0], 15.0).spare(),
    ];
    let lens = "\"string projection\", \"perspective\", \"float fov\", 36, \"int[2] resolution\", (64, 48), \"float[2] shutter\", (0, 1), \
                \"float fstop\", 2, \"float focallength\", 0.3, \"float focaldistance\", 5.5";
    let mut main = camera("main", "Translate (0, 1.6, -6)\nRotate (14, 1, 0, 0)\n", lens);
    main.params.set("int temporalquality", [4.0].into());
    main.params.set("int dofquality", [4.0].into());
    let outputs = vec![
        Output::new("main.exr", "rgba", "main"),
        Output::new("depth.exr", "avgz", "main").spare(),
        Output::new("speed.exr", "vector dPdtime", "main").spare(),
    ];
    Stage {
        cameras: vec![main],
        outputs,
        objects,
        lights,
        patterns: vec!["rolling", "^set/"],
        ..stage("motion")
    }
}

/// A room that light is reflected in, and occlusion.
fn bounce() -> Stage {
    let wall = |name: &str, color: &str, points: &str| {
        format!(
            "PushAttributes ()\nAttribute (\"string name\", \"room/{name}\")\nAttribute (\"color C\", ({color}))\n\
             Patch (\"linear\", 2, 2, \"vertex point P\", ({points}))\nPopAttributes ()\n"
        )
    };
    let objects = "Attribute (\"string geometryset\", \"+indirect,+solid\")\nShader (\"surface\", \"matte\")\n\
                   Attribute (\"float indirect:maxpixeldist\", 8)\nAttribute (\"float occlusion:maxpixeldist\", 8)\n"
        .to_owned()
        + &wall("left", "0.8, 0.2, 0.2", "-2, 0, 2, -2, 0, -2, -2, 3, 2, -2, 3, -2")
        + &wall("right", "0.2, 0.7, 0.2", "2, 0, -2, 2, 0, 2, 2, 3, -2, 2, 3, 2")
        + &wall("back", "0.8, 0.8, 0.8", "2, 0, 2, -2, 0, 2, 2, 3, 2, -2, 3, 2")
        + &floor("Attribute (\"color C\", (0.8, 0.8, 0.8))\n")
        + &ball("set/white", [-0.6, 0.7, 0.4], 0.7, "")
        + &ball("set/gloss", [0.9, 0.4, -0.6], 0.4, "Shader (\"surface\", \"plastic\")\n");
    let lights = vec![
        Light::new("lamp", "pointlight", [0.3, 2.5, -0.5], [0.0, 0.0], 5.0)
            .with("string shadowname", "solid")
            .choice("string shadowname", texts(["solid", ""])),
        Light::new("bounce", "indirectlight", [0.0, 0.0, 0.0], [0.0, 0.0], 1.0)
            .with("float samples", [8.0])
            .choice("float samples", numbers([6.0, 10.0]))
            .choice("float maxerror", numbers([0.25, 0.5])),
        Light::new("open", "envlight", [0.0, 0.0, 0.0], [0.0, 0.0], 0.2)
            .with("string occlusionname", "solid")
            .with("float samples", [8.0])
            .choice("float maxhitdist", numbers([1.0, 100.0]))
            .choice("float Kocclusion", numbers([0.5, 1.0])),
        Light::new("spot", "spotlight", [0.0, 2.8, -1.0], [0.0, 70.0], 12.0).spare(),
        Light::new("sky", "skylight", [0.0, 0.0, 0.0], [0.0, 0.0], 0.2)
            .with("string occlusionname", "solid")
            .with("float samples", [8.0])
            .spare(),
    ];
    let outputs = vec![
        Output::new("main.exr", "rgba", "main"),
        Output::new("depth.exr", "z", "main").spare(),
        Output::new("look.tif", "rgb", "main").with("float gamma", [2.2]),
    ];
    Stage { outputs, objects, lights, patterns: vec!["^room/", "^set/", "left|right"], ..stage("bounce") }
}

/// A displaced ground of large grids, small grids, and light from an environment map.
fn sky() -> Stage {
    let objects = "Attribute (\"string geometryset\", \"+solid\")\n".to_owned()
        + &floor(
            "Attribute (\"float displace:maxradius\", 0.5)\nShader (\"displacement\", \"dented\", \"float Km\", 0.25, \"float octaves\", 3)\n\
             Shader (\"surface\", \"matte\")\nAttribute (\"color C\", (0.6, 0.5, 0.4))\n",
        )
        + &ball(
            "set/bumpy",
            [-0.9, 0.8, 0.0],
            0.7,
            "Attribute (\"float displace:maxradius\", 0.2)\nShader (\"displacement\", \"dispmap\", \"string texturename\", \"holes.tx\", \"float amplitude\", 0.1)\n\
             Shader (\"surface\", \"plastic\")\nAttribute (\"float shadingquality\", 0.25)\n",
        )
        + &ball(
            "set/chrome",
            [0.9, 0.7, 0.3],
            0.6,
            "Shader (\"surface\", \"shinymetal\", \"string envname\", \"sky.env\")\n",
        );
    let lights = vec![
        Light::new("sky", "envlight", [0.0, 0.0, 0.0], [0.0, 0.0], 0.8)
            .with("string envname", "sky.env")
            .with("string occlusionname", "solid")
            .with("float samples", [8.0])
            .choice("float blur", numbers([0.2, 0.5]))
            .choice("string occlusionname", texts(["solid", ""]))
            .choice("float envsamples", numbers([0.0, 4.0])),
        Light::new("sun", "distantlight", [0.0, 4.0, 0.0], [-40.0, 35.0], 0.7)
            .with("string shadowname", "solid")
            .choice("string shadowname", texts(["solid", ""]))
            .choice("float shadowblur", numbers([0.0, 0.02])),
        Light::new("base", "ambientlight", [0.0, 0.0, 0.0], [0.0, 0.0], 0.1),
        Light::new("lamp", "pointlight", [1.0, 2.0, -3.0], [0.0, 0.0], 6.0).spare(),
    ];
    let outputs = vec![
        Output::new("main.exr", "rgba", "main"),
        Output::new("place.exr", "point P", "main"),
        Output::new("look.tif", "rgba", "main").spare(),
    ];
    let files = vec![file("sky.env"), file("holes.tx")];
    let patterns = vec!["^set/", "floor"];
    Stage {
        globals: "Attribute (\"int limits:gridsize\", 1024)\n",
        outputs,
        objects,
        lights,
        files,
        patterns,
        ..stage("sky")
    }
}

/// The surface of the scene "layers" that selects lights by category, sends them messages and receives theirs.
const LISTENER: &str = "surface listener (float Kd = 0.8, string wanted = \"key & !rim\", output color kept = 0) {\n\
    normal Nf = faceforward (normalize (N), I);\n\
    setmessage (\"tint\", color (0.5 + 0.5 * u, 0.8, 1));\n\
    color sum = 0;\n\
    lights (wanted, P, Nf, PI / 2) {\n\
        float level = 0;\n\
        getmessage (\"light\", \"level\", level);\n\
        sum += (0.5 + level) * Cl * dot (Nf, normalize (L));\n\
    }\n\
    kept = sum;\n\
    C *= opacity * (Kd * sum + ambient ());\n}\n";

/// The light of the scene "layers" that asks the surface for its tint, and sends messages.
const TALKER: &str = "light talker (float intensity = 1, color lightcolor = 1, float strength = 0.5, string __category = \"key\",\n\
    output float level = 0) {\n\
    color tint = 1;\n\
    getmessage (\"surface\", \"tint\", tint);\n\
    level = strength;\n\
    emit (point (\"shader\", 0, 0, 0)) { Cl = intensity * lightcolor * tint / dot (L, L); }\n}\n";

/// The surface of the scene "layers" whose colour is random.
const SPECKLED: &str = "surface speckled (float Kd = 0.8, float grain = 0.3) {\n\
    normal Nf = faceforward (normalize (N), I);\n\
    float many = 1 - grain * (float) random ();\n\
    color one = 0.5 + 0.5 * (color) randomgrid ();\n\
    C *= opacity * Kd * many * one * noise (4 * P) * diffuse (Nf);\n}\n";

/// A layer of a light that makes its colour.
const GEL: &str = "light gel (output color tone = 1) {\n\
    tone = color (1, 0.6 + 0.4 * (float) noise (2 * Ps), 0.5);\n}\n";

/// The deferred input of the scene "layers".
const BALLS: &str = "Attribute (\"string name\", \"set/late\")\nTranslate (1.2, 0.4, -0.8)\nSphere (0.4, -0.4, 0.4, 360)\n\
    Translate (0, 0.8, 0)\nSphere (0.3, -0.3, 0.3, 360)\n";

/// Groups of layers of surfaces and lights, categories and messages, random numbers, fog, and an input with a bound.
fn layers() -> Stage {
    let objects =
        "Shader (\"volume\", \"fog\", \"float distance\", 12, \"color background\", (0.2, 0.25, 0.3))\n"
            .to_owned()
            + &floor("Shader (\"surface\", \"listener\", \"string wanted\", \"\")\n")
            + &ball("set/speckled", [-1.1, 0.6, 0.2], 0.6, "Shader (\"surface\", \"speckled\")\n")
            + &ball("set/listener", [0.1, 0.5, 0.9], 0.5, "Shader (\"surface\", \"listener\")\n")
            + &ball(
                "set/painted",
                [0.2, 0.35, -1.0],
                0.35,
                "ShaderGroupBegin ()\nShader (\"surface\", \"texmap\", \"paint\", \"string texturename\", \"brick.tx\")\n\
             Shader (\"surface\", \"plastic\", \"coat\")\nConnectShaders (\"paint\", \"out\", \"coat\", \"specularcolor\")\nShaderGroupEnd ()\n",
            )
            + "PushAttributes ()\nShader (\"surface\", \"plastic\")\nInput (\"balls.pyg\", (0, 3, -1, 3, -2, 1))\nPopAttributes ()\n";
    let mut gel = Light::new("gel", "spotlight", [-2.0, 3.0, -3.0], [33.7, 40.0], 12.0);
    gel.layer = Some(("gel", ["tone", "lightcolor"]));
    let lights = vec![
        Light::new("key", "talker", [2.0, 3.0, -3.0], [0.0, 0.0], 8.0)
            .choice("float strength", numbers([0.0, 0.5, 1.0]))
            .choice("string __category", texts(["key", "key,rim", "rim", ""])),
        gel,
        Light::new("rim", "uberlight", [0.0, 2.0, 3.0], [180.0, 30.0], 1.0)
            .with("string __category", "rim")
            .choice("string __category", texts(["key", "rim"]))
            .choice("string slidename", texts(["", "brick.tx"])),
        Light::new("base", "ambientlight", [0.0, 0.0, 0.0], [0.0, 0.0], 0.1),
        Light::new("more", "talker", [-3.0, 1.0, -2.0], [0.0, 0.0], 3.0).spare(),
    ];
    let outputs = vec![
        Output::new("main.exr", "rgba", "main"),
        Output::new("kept.exr", "color kept", "main").spare(),
        Output::new("look.tif", "rgb", "main").with("float gain", [1.2]),
    ];
    Stage {
        outputs,
        objects,
        lights,
        patterns: vec!["late", "^set/", "listener", "floor"],
        files: vec![file("brick.tx")],
        texts: vec![
            ("listener.gsl", LISTENER),
            ("talker.gsl", TALKER),
            ("speckled.gsl", SPECKLED),
            ("gel.gsl", GEL),
            ("balls.pyg", BALLS),
        ],
        ..stage("layers")
    }
}

/// A stereo camera, with images of both views.
fn views() -> Stage {
    let mut objects = "Attribute (\"string geometryset\", \"+solid\")\n".to_owned()
        + &floor("Shader (\"surface\", \"plastic\")\n")
        + &ball(
            "set/shiny",
            [-0.8, 0.7, 0.2],
            0.7,
            "Shader (\"surface\", \"shinyplastic\", \"string envname\", \"solid\")\n",
        )
        + &ball(
            "set/near",
            [0.7, 0.4, -1.2],
            0.4,
            "Attribute (\"color C\", (0.3, 0.5, 0.8))\nShader (\"surface\", \"clay\")\n",
        );
    _ = write!(
        objects,
        "PushAttributes ()\nAttribute (\"string name\", \"set/grass\")\nAttribute (\"color C\", (0.3, 0.6, 0.2))\n\
         Shader (\"surface\", \"plastic\")\nTranslate (1.2, 0, 0.8)\n{}PopAttributes ()\n",
        hairs(24)
    );
    let lights = vec![
        Light::new("key", "spotlight", [3.0, 4.0, -3.0], [-45.0, 43.0], 30.0)
            .with("string shadowname", "solid")
            .choice("float shadowblur", numbers([0.0, 0.04])),
        Light::new("fill", "pointlight", [-3.0, 2.0, -3.0], [0.0, 0.0], 6.0),
        Light::new("base", "ambientlight", [0.0, 0.0, 0.0], [0.0, 0.0], 0.1),
        Light::new("rim", "pointlight", [0.0, 2.0, 3.0], [0.0, 0.0], 6.0).spare(),
    ];
    let stereo = "\"string projection\", \"perspective\", \"float fov\", 36, \"int[2] resolution\", (48, 36), \"float stereo:separation\", 0.4, \
                  \"float stereo:convergence\", 6";
    let outputs = vec![
        Output::new("main.exr", "rgba", "main"),
        Output::new("depth.exr", "z", "main").spare(),
        Output::new("look.tif", "rgb", "main").with("float gamma", [2.2]).spare(),
    ];
    let main = camera("main", "Translate (0, 1.6, -6)\nRotate (14, 1, 0, 0)\n", stereo);
    Stage {
        cameras: vec![main],
        outputs,
        objects,
        lights,
        patterns: vec!["grass", "^set/"],
        ..stage("views")
    }
}
