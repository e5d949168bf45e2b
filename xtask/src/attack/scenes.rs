//! Scenes and shaders at the ends of all ranges, as text.

/// Returns a frame of `calls` in the world, with `settings` before it. It renders `out.exr`.
pub(crate) fn frame(settings: &str, calls: &str) -> String {
    format!(
        "Attribute (\"int[2] resolution\", (64, 48))\n{settings}Output (\"out.exr\", \"exr\", \"rgba\", \"camera\")\n\
         World ()\nLight (\"key\", \"distantlight\")\nShader (\"surface\", \"matte\")\n{calls}Render ()\n"
    )
}

/// Returns a scene of the ground, one unit below a horizontal camera. The ground covers half of the image.
pub(crate) fn ground(primitive: &str) -> String {
    frame(
        "Attribute (\"float fov\", 60)\nRotate (90, 1, 0, 0)\n",
        &format!("Shader (\"surface\", \"constant\")\nTranslate (0, 0, -1)\n{primitive}"),
    )
}

/// Returns a square patch of this half side.
pub(crate) fn patch(half: &str) -> String {
    format!(
        "Patch (\"linear\", 2, 2, \"vertex point P\", (-{half}, -{half}, 0, {half}, -{half}, 0, -{half}, {half}, 0, {half}, {half}, 0))\n"
    )
}

/// Returns the same square as a mesh.
pub(crate) fn mesh(half: &str) -> String {
    format!(
        "Mesh (\"linear\", (4,), (0, 1, 2, 3), \"vertex point P\", (-{half}, -{half}, 0, {half}, -{half}, 0, {half}, {half}, 0, -{half}, {half}, 0))\n"
    )
}

/// Returns a sphere whose top is the ground.
pub(crate) fn globe(radius: &str) -> String {
    format!("Translate (0, 0, -{radius})\nSphere ({radius}, -{radius}, {radius}, 360)\n")
}

/// A ball in front of the camera.
pub(crate) const BALL: &str = "Translate (0, 0, 4)\nSphere (1, -1, 1, 360)\n";

/// Returns a visible square whose last vertex lies at this position.
pub(crate) fn vertex(kind: &str, place: &str) -> String {
    let shape = match kind {
        "mesh" => format!(
            "Mesh (\"linear\", (4,), (0, 1, 2, 3), \"vertex point P\", (-1, -1, 3, 1, -1, 3, {place}, -1, 1, 3))\n"
        ),
        "bezier" => {
            let point = |k: usize| match k {
                15 => place.to_owned(),
                _ => format!("{}, {}, 3", (k % 4) as f32 - 1.5, (k / 4) as f32 - 1.5),
            };
            let points: Vec<String> = (0..16).map(point).collect();
            format!("Patch (\"bezier\", 4, 4, \"vertex point P\", ({}))\n", points.join(", "))
        }
        _ => format!(
            "Patch (\"linear\", 2, 2, \"vertex point P\", (-1, -1, 3, 1, -1, 3, -1, 1, 3, {place}))\n"
        ),
    };
    frame("", &shape)
}

/// Returns two mirrors that face each other, with a glass ball between them when `glass` is true.
pub(crate) fn mirrors(depth: u32, glass: bool) -> String {
    let between = if glass {
        "Shader (\"surface\", \"glass\", \"string envname\", \"all\")\nTranslate (0, 0, 2)\nSphere (0.5, -0.5, 0.5, 360)\n"
    } else {
        ""
    };
    frame(
        &format!("Attribute (\"int ray:maxdepth\", {depth})\nAttribute (\"int[2] resolution\", (16, 12))\n"),
        &format!(
            "Attribute (\"string geometryset\", \"+all\")\nShader (\"surface\", \"shinymetal\", \"string envname\", \"all\")\n\
             Patch (\"linear\", 2, 2, \"vertex point P\", (-9, -9, 4, 9, -9, 4, -9, 9, 4, 9, 9, 4))\n\
             Patch (\"linear\", 2, 2, \"vertex point P\", (-9, -9, -1, 9, -9, -1, -9, 9, -1, 9, 9, -1))\n{between}"
        ),
    )
}

/// Returns a star with this number of corners, as one face of an OBJ file.
pub(crate) fn star(corners: u32) -> String {
    let mut text = String::new();
    for k in 0..corners {
        let angle = f64::from(k) / f64::from(corners) * std::f64::consts::TAU;
        let radius = if k % 2 == 0 { 1.0 } else { 0.6 };
        text += &format!("v {:.7} {:.7} 0\n", radius * angle.cos(), radius * angle.sin());
    }
    text.push('f');
    (1..=corners).for_each(|k| text += &format!(" {k}"));
    text + "\n"
}

/// Returns a scene with this number of attributes of different names. After each of them there is a small ball, which
/// has all attributes so far.
pub(crate) fn user_attributes(count: u32) -> String {
    let mut calls = String::new();
    for k in 0..count {
        calls += &format!("Attribute (\"float user:number{k}\", {k})\nSphere (0.01, -0.01, 0.01, 360)\n");
    }
    calls += BALL;
    frame("", &calls)
}

/// Returns a surface shader that adds this number of terms.
pub(crate) fn sum(terms: u32) -> String {
    let terms: Vec<String> = (0..terms).map(|k| format!("u * {k}.5")).collect();
    format!("surface x ()\n{{\n    float sum = {};\n    C = color (sum);\n}}\n", terms.join(" + "))
}

/// Returns a surface shader that doubles a text this many times.
pub(crate) fn doubled(times: u32) -> String {
    let step = "    s = concat (s, s);\n".repeat(times as usize);
    format!(
        "surface x ()\n{{\n    string s = \"0123456789\";\n{step}    if (s == \"0\")\n        C = 0;\n}}\n"
    )
}

/// A surface shader whose loop never ends.
pub(crate) const ENDLESS: &str =
    "surface x ()\n{\n    float k = 0;\n    while (k < 1)\n        k = k * 0.5;\n    C = color (k);\n}\n";

/// Returns a ball with the surface shader "x".
pub(crate) fn shaded() -> String {
    frame("", &format!("Shader (\"surface\", \"x\")\n{BALL}"))
}

/// Returns squares with one texture each. The textures are called `N.tx`.
pub(crate) fn textures(count: u32) -> String {
    let mut calls = "Light (\"fill\", \"ambientlight\")\nTranslate (-7.5, -5, 12)\n".to_owned();
    for k in 0..count {
        let (x, y) = (k % 15, k / 15);
        calls += &format!(
            "Shader (\"surface\", \"texmap\", \"string texturename\", \"{k}.tx\")\n\
             Patch (\"linear\", 2, 2, \"vertex point P\", ({x}, {y}, 0, {}, {y}, 0, {x}, {}, 0, {}, {}, 0))\n",
            x + 1,
            y + 1,
            x + 1,
            y + 1
        );
    }
    frame("", &calls)
}

/// Returns a chain of nodes of a glTF file, each of which is the child of the one before.
pub(crate) fn nested_nodes(count: u32) -> String {
    let nodes: Vec<String> = (0..count)
        .map(|k| if k + 1 < count { format!("{{\"children\":[{}]}}", k + 1) } else { "{}".to_owned() })
        .collect();
    format!(
        "{{\"asset\":{{\"version\":\"2.0\"}},\"scene\":0,\"scenes\":[{{\"nodes\":[0]}}],\"nodes\":[{}]}}",
        nodes.join(",")
    )
}
