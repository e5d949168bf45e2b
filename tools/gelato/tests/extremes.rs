//! Tests the table "What happens at extremes" of the manual. Each row renders a scene with extreme numbers, and
//! compares it with the same scene with ordinary ones: to the bit where the difference is a power of two.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test, with a line number")]

mod folder;

use folder::Folder;
use granita_image::{FormatRegistry, Limits};
use std::fmt::Write;

/// A light whose shading scales exactly with powers of two, and surfaces.
const SHADERS: [(&str, &str); 4] = [
    (
        "lamp",
        "light lamp (float intensity = 1) { emit (point (\"shader\", 0, 0, 0)) { Cl = intensity / dot (L, L); } }",
    ),
    ("matte", "surface matte () { C = opacity * C * (0.1 + diffuse (faceforward (normalize (N), I))); }"),
    (
        "shiny",
        "surface shiny (float roughness = 0.1) {
        normal n = faceforward (normalize (N), I);
        C = opacity * C * (diffuse (n) + specular (n, -normalize (I), roughness));
    }",
    ),
    (
        "mapped",
        "surface mapped (string map = \"\") { C = (color) texture (map, u, v, \"wrap\", \"clamp\"); }",
    ),
];

/// The numbers of a scene.
#[derive(Clone)]
struct Scene {
    /// The factor of all lengths.
    scale: f64,
    /// The factor of an object whose own coordinates are as much smaller.
    object: f64,
    /// The time at which the shutter closes, and that of the second key of motion.
    close: f64,
    quality: [u32; 2],
    /// Statements before `World`.
    front: String,
    /// Statements before the last object.
    more: String,
}

impl Default for Scene {
    fn default() -> Self {
        let more = String::new();
        Self { scale: 1.0, object: 1.0, close: 0.0, quality: [3, 3], front: more.clone(), more }
    }
}

impl Scene {
    fn text(&self) -> String {
        let s = |x: f64| format!("{:e}", x * self.scale);
        let Self { object, close, quality: [qx, qy], front, more, .. } = self;
        let mut text = format!(
            "Attribute (\"int[2] resolution\", (48, 36))\nAttribute (\"int[2] spatialquality\", ({qx}, {qy}))\n\
             Attribute (\"float fov\", 60)\nAttribute (\"float near\", {})\nAttribute (\"float far\", {})\n\
             Attribute (\"float[2] shutter\", (0, {close:e}))\n{front}\
             Output (\"a.exr\", \"exr\", \"rgba\", \"main\", \"string pixeltype\", \"float\")\nCamera (\"main\")\nWorld ()\n",
            s(0.125),
            s(4096.0),
        );
        let _ = writeln!(text, "PushTransform ()\nTranslate ({}, {}, {})", s(2.0), s(3.0), s(-1.0));
        let _ = writeln!(
            text,
            "Light (\"l\", \"lamp\", \"float intensity\", {:e})",
            24.0 * self.scale * self.scale
        );
        text += "PopTransform ()\nShader (\"surface\", \"matte\")\nAttribute (\"color C\", (0.8, 0.5, 0.2))\nPushTransform ()\n";
        let _ = writeln!(text, "Translate ({}, {}, {})", s(0.25), s(0.125), s(5.0));
        if *close > 0.0 {
            let _ = writeln!(
                text,
                "Motion (0, {close:e})\nTranslate (0, 0, 0)\nTranslate ({}, {}, 0)",
                s(0.5),
                s(0.25)
            );
        }
        let _ = writeln!(text, "Scale ({object:e}, {object:e}, {object:e})");
        let radius = self.scale / object;
        let _ = writeln!(text, "Sphere ({radius:e}, {:e}, {radius:e}, 360)\nPopTransform ()", -radius);
        text += more;
        let corners = [[-4.0, -1.0, 9.0], [4.0, -1.0, 9.0], [-4.0, -1.0, 1.0], [4.0, -1.0, 1.0]];
        let corners: Vec<String> = corners.iter().flatten().map(|x| s(*x)).collect();
        let _ = writeln!(
            text,
            "Attribute (\"color C\", (0.3, 0.4, 0.6))\nPatch (\"linear\", 2, 2, \"vertex point P\", ({}))\nRender ()",
            corners.join(", ")
        );
        text
    }
}

struct Place(Folder);

impl std::ops::Deref for Place {
    type Target = Folder;

    fn deref(&self) -> &Folder {
        &self.0
    }
}

impl Place {
    fn new() -> Self {
        let place = Folder::with(&[]);
        SHADERS.iter().for_each(|(name, text)| place.write(&format!("{name}.gsl"), text));
        Self(place)
    }

    /// Renders a scene. Returns the exit status, the messages, and the pixels if there are any.
    fn render(&self, text: &str) -> (i32, String, Vec<f32>) {
        self.write("scene.pyg", text);
        let _ = std::fs::remove_file(self.path().join("a.exr"));
        let ran = self.run(&["-timeout", "300", "scene.pyg"]);
        let registry: FormatRegistry = granita_plugin::bundled_formats(Limits::default());
        let pixels = registry.open(&self.path().join("a.exr")).ok();
        let pixels = pixels.map_or_else(Vec::new, |file| file.read_level(0, 0).unwrap().to_floats());
        (ran.status, ran.said, pixels)
    }

    /// Renders a scene without any message. Returns the pixels, all of which are finite.
    fn image(&self, scene: &Scene) -> Vec<f32> {
        let (status, said, pixels) = self.render(&scene.text());
        assert!(status == 0 && said.is_empty(), "{said}");
        assert!(pixels.iter().any(|v| *v > 0.1) && pixels.iter().all(|v| v.is_finite()));
        pixels
    }
}

/// Returns the mean difference between two images.
fn difference(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f32>() / a.len() as f32
}

#[test]
fn scenes_and_objects_of_any_size_have_the_same_bits() {
    let place = Place::new();
    let ordinary = place.image(&Scene::default());
    // 2^27 is more than 1e8.
    for power in [-27, -3, 4, 27] {
        let factor = f64::from(2.0_f32.powi(power));
        let scaled = place.image(&Scene { scale: factor, ..Scene::default() });
        assert!(scaled == ordinary, "the scene scaled by 2^{power}: {}", difference(&scaled, &ordinary));
        let scaled = place.image(&Scene { object: factor, ..Scene::default() });
        assert!(scaled == ordinary, "an object scaled by 2^{power}: {}", difference(&scaled, &ordinary));
    }
}

#[test]
fn shutters_of_any_length_have_the_same_bits() {
    let place = Place::new();
    let ordinary = place.image(&Scene { close: 1.0, ..Scene::default() });
    assert!(ordinary != place.image(&Scene::default()));
    // 2^20 is more than 1e6.
    for power in [-20, 20] {
        let image = place.image(&Scene { close: f64::from(2.0_f32.powi(power)), ..Scene::default() });
        assert!(image == ordinary, "2^{power}: {}", difference(&image, &ordinary));
    }
}

#[test]
fn scenes_far_from_the_origin_look_the_same() {
    let place = Place::new();
    let ordinary = Scene::default();
    let at = |x: f64| {
        let text = ordinary.text();
        let text = text.replace("Camera (\"main\")", &format!("Translate ({x:e}, 0, 0)\nCamera (\"main\")"));
        text.replace("World ()\n", &format!("World ()\nTranslate ({x:e}, 0, 0)\n"))
    };
    let near = place.image(&ordinary);
    for x in [1e4, 1e7, -1e7] {
        let (status, said, far) = place.render(&at(x));
        assert!(status == 0 && said.is_empty(), "{x}: {said}");
        let off = difference(&near, &far);
        assert!(off < 2e-3, "{x}: {off}");
    }
}

#[test]
fn one_sample_and_65536_show_the_same_scene() {
    let place = Place::new();
    let of = |n: u32| {
        let front = "Attribute (\"float[4] crop\", (0.4, 0.65, 0.4, 0.6))\n".to_owned();
        place.image(&Scene { quality: [n, n], front, ..Scene::default() })
    };
    let [one, ordinary, many] = [1, 16, 256].map(of);
    assert!(difference(&ordinary, &many) < 2e-3, "{}", difference(&ordinary, &many));
    assert!(difference(&one, &many) < 0.05, "{}", difference(&one, &many));
}

#[test]
fn highlights_of_roughness_0_are_finite() {
    let place = Place::new();
    for roughness in ["0", "1e-6", "1e-30", "-1"] {
        let more = format!("Shader (\"surface\", \"shiny\", \"float roughness\", {roughness})\n");
        place.image(&Scene { more, ..Scene::default() });
    }
}

#[test]
fn a_light_within_a_surface_lights_the_surface_from_within() {
    let place = Place::new();
    let more = "PushTransform ()\nTranslate (0.25, 0.125, 5)\nLight (\"within\", \"lamp\", \"float intensity\", 1)\nPopTransform ()\n\
                Attribute (\"float opacity\", 1)\nPushTransform ()\nTranslate (-1.5, 0, 4)\nLight (\"on\", \"lamp\", \"float intensity\", 1)\n\
                Sphere (0, 0, 0, 360)\nSphere (0.5, -0.5, 0.5, 360)\nPopTransform ()\n";
    let (status, said, pixels) = place.render(&Scene { more: more.into(), ..Scene::default() }.text());
    assert!(status <= 1 && pixels.iter().all(|v| v.is_finite()) && pixels.iter().any(|v| *v > 0.1), "{said}");
}

#[test]
fn thousands_of_transparent_layers_are_as_opaque_as_their_product() {
    let place = Place::new();
    let layers = |n: usize, opacity: f64| {
        let mut more = format!("Attribute (\"color opacity\", ({opacity}, {opacity}, {opacity}))\n");
        for k in 0..n {
            let z = 2.0 + k as f64 / n as f64;
            let _ = writeln!(
                more,
                "Patch (\"linear\", 2, 2, \"vertex point P\", (-0.01, -0.01, {z}, 0.01, -0.01, {z}, -0.01, 0.01, {z}, 0.01, 0.01, {z}))"
            );
        }
        more += "Attribute (\"color opacity\", (1, 1, 1))\n";
        let front = "Attribute (\"float[4] crop\", (0.48, 0.52, 0.47, 0.53))\n".to_owned();
        place.image(&Scene { more, front, ..Scene::default() })
    };
    // (1 - a)^n is the same.
    let few = layers(4, 1.0 - 0.5_f64.powf(0.25));
    let many = layers(4000, 1.0 - 0.5_f64.powf(1.0 / 4000.0));
    let alpha = |image: &[f32]| image.chunks(4).map(|p| p[3]).sum::<f32>() / (image.len() / 4) as f32;
    assert!((alpha(&few) - alpha(&many)).abs() < 5e-3, "{} {}", alpha(&few), alpha(&many));
}

#[test]
fn curves_thinner_than_a_pixel_cover_what_they_should() {
    let place = Place::new();
    // A pixel is 0.083 units wide at this distance. The curves stand next to each other, with gaps as wide as they are.
    let alpha = |n: usize, gap: f64| {
        let width = 0.4 / n as f64;
        let mut points = String::new();
        for k in 0..n {
            let y = (k as f64 + 0.5) * width * (1.0 + gap) - 0.2 * (1.0 + gap);
            let _ = write!(points, "{}-1, {y}, 3, 1, {y}, 3", if k > 0 { ", " } else { "" });
        }
        let text = format!(
            "Attribute (\"int[2] resolution\", (48, 36))\nAttribute (\"int[2] spatialquality\", (12, 12))\n\
             Attribute (\"float fov\", 60)\n\
             Output (\"a.exr\", \"exr\", \"rgba\", \"main\", \"string pixeltype\", \"float\")\nCamera (\"main\")\nWorld ()\n\
             Shader (\"surface\", \"matte\")\n\
             Curves (\"linear\", {n}, 2, \"vertex point P\", ({points}), \"constant float width\", {width})\nRender ()\n"
        );
        let (status, said, pixels) = place.render(&text);
        assert!(status == 0 && said.is_empty(), "{said}");
        pixels.chunks(4).map(|p| p[3]).sum::<f32>()
    };
    for gap in [1.0, 3.0] {
        let few = alpha(8, gap);
        // 0.01 and 0.001 pixels.
        for n in [500, 5000] {
            let many = alpha(n, gap);
            assert!((many / few - 1.0).abs() < 0.03, "{n} curves with gaps of {gap}: {many}, not {few}");
        }
    }
}

#[test]
fn textures_of_one_texel_and_very_wide_ones_show_their_colour() {
    let place = Place::new();
    let color = [200_u8, 100, 50];
    for [width, height] in [[1, 1], [65536, 16], [1, 4096]] {
        let pixels: Vec<u8> = color.iter().copied().cycle().take(3 * width * height).collect();
        let head = format!("P6\n{width} {height}\n255\n");
        std::fs::write(place.path().join("map.ppm"), [head.as_bytes(), &pixels].concat()).unwrap();
        let more = "Shader (\"surface\", \"mapped\", \"string map\", \"map.ppm\")\n".to_owned();
        let (status, said, image) = place.render(&Scene { more, ..Scene::default() }.text());
        assert!(status == 0 && said.lines().all(|line| line.contains("is not tiled")), "{said}");
        // The last row shows the ground.
        let last = &image[image.len() - 4 * 24..][..3];
        for (seen, stored) in last.iter().zip(color) {
            assert!((seen - f32::from(stored) / 255.0).abs() < 1e-3, "{width} x {height}: {last:?}");
        }
    }
}

#[test]
fn numbers_that_are_not_finite_end_in_a_message_or_an_image() {
    let statements = [
        "Sphere (NUMBER, -1, 1, 360)",
        "Sphere (1, NUMBER, 1, 360)",
        "Sphere (1, -1, 1, NUMBER)",
        "Translate (NUMBER, 0, 4)\nSphere (1, -1, 1, 360)",
        "Scale (1, NUMBER, 1)\nSphere (1, -1, 1, 360)",
        "Rotate (NUMBER, 0, 0, 1)\nSphere (1, -1, 1, 360)",
        "Attribute (\"color C\", (NUMBER, 1, 1))\nSphere (1, -1, 1, 360)",
        "Attribute (\"color opacity\", (NUMBER, 1, 1))\nSphere (1, -1, 1, 360)",
        "Attribute (\"float shadingquality\", NUMBER)\nSphere (1, -1, 1, 360)",
        "Attribute (\"float displace:maxradius\", NUMBER)\nSphere (1, -1, 1, 360)",
        "Light (\"x\", \"lamp\", \"float intensity\", NUMBER)",
        "Patch (\"linear\", 2, 2, \"vertex point P\", (0, 0, NUMBER, 1, 0, 4, 0, 1, 4, 1, 1, 4))",
        "Curves (\"linear\", 1, 2, \"vertex point P\", (0, 0, 4, 1, 1, 4), \"constant float width\", NUMBER)",
        "Points (1, \"vertex point P\", (0, 0, 4), \"constant float width\", NUMBER)",
        "Motion (0, NUMBER)\nTranslate (0, 0, 4)\nTranslate (0, 1, 4)\nSphere (1, -1, 1, 360)",
        "Torus (1, NUMBER, 0, 360, 360)",
    ];
    let fronts = [
        "Attribute (\"float fov\", NUMBER)\n",
        "Attribute (\"float near\", NUMBER)\n",
        "Attribute (\"float far\", NUMBER)\n",
        "Attribute (\"float[2] shutter\", (0, NUMBER))\n",
        "Attribute (\"float fstop\", NUMBER)\n",
        "Attribute (\"float pixelaspect\", NUMBER)\n",
        "Attribute (\"float[4] screen\", (-1, NUMBER, -1, 1))\n",
        "Attribute (\"float[4] crop\", (0, NUMBER, 0, 1))\n",
        "Attribute (\"float render:error\", NUMBER)\n",
    ];
    let test = |number: &str| {
        let place = Place::new();
        let with = |text: &str| text.replace("NUMBER", number);
        // Objects that are too large for this limit take long with the usual one.
        let limit = "Attribute (\"int limits:primitivepoints\", 1000000)\n";
        let scene = |front: &str, more: String| Scene {
            front: format!("{limit}{front}"),
            more,
            quality: [1, 1],
            ..Scene::default()
        };
        let scenes = statements
            .iter()
            .map(|statement| scene("", with(&format!("{statement}\n"))))
            .chain(fronts.iter().map(|front| scene(&with(front), String::new())));
        for scene in scenes {
            let (status, said, pixels) = place.render(&scene.text());
            let changed = format!("{}{}", scene.front, scene.more);
            assert!(
                status <= 2 && !said.contains("panic") && !said.contains("-timeout"),
                "{changed}: {said}"
            );
            assert!(!pixels.is_empty() || !said.is_empty(), "{changed}: neither an image nor a message");
            assert!(!pixels.iter().any(|v| v.is_nan()), "{changed}: NaN in the image: {said}");
        }
    };
    std::thread::scope(|scope| {
        for number in ["nan", "-inf", "1e38"] {
            scope.spawn(|| test(number));
        }
    });
}
