//! Tests bundled surfaces, displacements and volumes against numbers, and against the formulas of the reference and of
//! their sources.

use crate::support::{Place, SHADERS, SQUARE, asks, assert_near, at, middle, scene};
use granita_tests::Image;

/// A light from the side and an ambient one.
const LIGHTS: &str = "Light (\"a\", \"ambientlight\", \"float intensity\", 0.25)\n\
    Light (\"d\", \"distantlight\", \"point from\", (1, 0.5, -1), \"point to\", (0, 0, 0), \"color lightcolor\", (1, 0.8, 0.6))\n\
    Attribute (\"color C\", (0.9, 0.5, 0.25))\nAttribute (\"color opacity\", (0.75, 0.75, 0.75))\n";

/// Renders a rotated square with a surface shader, under [`LIGHTS`].
fn surface(place: &Place, shader: &str) -> Image {
    place.seen(SHADERS, &format!("{LIGHTS}Rotate (20, 1, 0.3, 0)\nScale (2, 2, 1)\n{shader}\n{SQUARE}"))
}

/// Bundled surfaces equal their formulas, written as shaders.
#[test]
fn bundled_surfaces_equal_their_formulas() {
    const PLASTIC: &str =
        "C = opacity * (C * (Ka * ambient () + Kd * diffuse (Nf)) + Ks * tint * specular (Nf, V, 0.3));";
    let formula = "float Ka = 1, float Kd = 0.5, float Ks = 0.5, color tint = 1";
    let place = Place::new();
    for (shader, parameters, body) in [
        ("\"matte\"", formula, "C *= opacity * (Ka * ambient () + diffuse (Nf));"),
        (
            "\"matte\", \"float Ka\", 0.5, \"float Kd\", 0.25",
            formula,
            "C *= opacity * (0.5 * ambient () + 0.25 * diffuse (Nf));",
        ),
        ("\"plastic\", \"float roughness\", 0.3", formula, PLASTIC),
        (
            "\"plastic\", \"float roughness\", 0.3, \"color specularcolor\", (0, 1, 0), \"float Ks\", 2",
            "float Ka = 1, float Kd = 0.5, float Ks = 2, color tint = color (0, 1, 0)",
            PLASTIC,
        ),
        ("\"paintedplastic\", \"float roughness\", 0.3", formula, PLASTIC),
        ("\"plasticss\", \"float roughness\", 0.3", formula, PLASTIC),
        (
            "\"metal\", \"float roughness\", 0.3, \"float Ks\", 0.5",
            formula,
            "C *= opacity * (Ka * ambient () + Ks * specular (Nf, V, 0.3));",
        ),
        (
            "\"shiny\", \"float roughness\", 0.3, \"float Ka\", 1, \"float Kd\", 0.5, \"float Ks\", 0.5",
            formula,
            "C *= opacity * (Ka * ambient () + Kd * diffuse (Nf) + Ks * specular (Nf, V, 0.3));",
        ),
        ("\"texmap\", \"float roughness\", 0.3, \"float Kd\", 0.5, \"float Ks\", 0.5", formula, PLASTIC),
        ("\"constant\"", formula, "C *= opacity;"),
        ("\"nullsurface\"", formula, ""),
        (
            "\"defaultsurface\"",
            formula,
            "C *= opacity * (0.2 + 0.8 * abs (dot (normalize (N), normalize (I))));",
        ),
        (
            "\"showN\"",
            formula,
            "C = opacity * ((color) (0.5 * (vector) normalize (transformn (\"camera\", N)) + 0.5));",
        ),
    ] {
        let found = surface(&place, &format!("Shader (\"surface\", {shader})"));
        let needs =
            |word: &str, line: &str| if body.contains(word) { line.to_owned() } else { String::new() };
        let own = needs("Nf", "normal Nf = faceforward (normalize (N), I); ")
            + &needs("V,", "vector V = -normalize (I); ")
            + body;
        let line = asks(&place, parameters, &own);
        let wanted = surface(&place, line.lines().next().unwrap());
        assert!(wanted.mean([0, 0, 16, 16]).unwrap()[3] == 0.75, "the square fills the view");
        let (worst, place) = found.difference(&wanted).unwrap();
        assert!(worst < 1e-5, "{shader}: {worst} at {place:?}");
    }
}

#[test]
fn painted_surfaces_have_the_colour_of_their_texture() {
    let place = Place::new();
    // The image runs from black to white along s.
    place.write("ramp.gsl", "surface ramp () { C = u; }");
    let out = "Output (\"@/ramp.ppm\", \"ppm\", \"rgb\", \"camera\", \"string filter\", \"box\", \"float[2] filterwidth\", (1, 1), \"float dither\", 0)\n";
    place.quiet(&scene(&format!("{SHADERS}{out}"), &format!("Shader (\"surface\", \"ramp\")\n{SQUARE}")));
    for shader in ["texmap", "paintedplastic"] {
        let world = format!(
            "Light (\"a\", \"ambientlight\")\nShader (\"surface\", \"{shader}\", \"string texturename\", \"@/ramp.ppm\")\n{SQUARE}"
        );
        place.render(&scene("", &world));
        let image = place.image("out.tif");
        for i in 2..14 {
            let x = middle(i);
            assert_near(at(&image, x, 0.1), &[0.5 + 0.5 * x; 3], 0.02, shader);
        }
    }
}

#[test]
fn polished_surfaces_reflect_the_environment() {
    // A coloured sphere surrounds the scene.
    let sky = "PushAttributes ()\nAttribute (\"string geometryset\", \"sky\")\nAttribute (\"color C\", (0.2, 0.4, 0.8))\n\
               Shader (\"surface\", \"constant\")\nSphere (50, -50, 50, 360)\nPopAttributes ()\n";
    let seen = |shader: &str, before: &str| {
        let world = format!("{sky}{before}Shader (\"surface\", {shader})\n{SQUARE}");
        at(&Place::new().seen("", &world), 0.1, 0.1).to_vec()
    };
    let env = "\"string envname\", \"sky\"";
    assert_near(&seen(&format!("\"shinymetal\", {env}"), ""), &[0.2, 0.4, 0.8, 1.0], 1e-5, "shinymetal");
    assert_near(
        &seen(&format!("\"shiny\", {env}, \"float Kr\", 0.5"), ""),
        &[0.1, 0.2, 0.4, 1.0],
        1e-5,
        "shiny",
    );
    assert_near(
        &seen(&format!("\"envsurf\", {env}, \"float intensity\", 0.5"), ""),
        &[0.1, 0.2, 0.4, 1.0],
        1e-5,
        "envsurf",
    );
    // Reflected and refracted light together are all of the light, also behind the glass.
    let glass = seen(&format!("\"glass\", {env}"), "Attribute (\"string geometryset\", \"+sky\")\n");
    assert_near(&glass, &[0.2, 0.4, 0.8, 1.0], 1e-4, "glass");
}

#[test]
fn fog_thickens_with_distance() {
    let place = Place::new();
    let volume =
        "Shader (\"volume\", \"fog\", \"float distance\", 4, \"color background\", (0.1, 0.2, 0.9))\n";
    let white = format!("{volume}Shader (\"surface\", \"constant\")\n{SQUARE}");
    // The projection is perspective, so that the distance to the eye varies over the square. Its least value is five
    // units.
    let scene = scene("", &white)
        .replace("\"orthographic\"", "\"perspective\"")
        .replace("(-1, 1, -1, 1)", "(-0.2, 0.2, -0.2, 0.2)");
    place.quiet(&scene);
    let image = place.image("out.tif");
    for i in [0, 5, 8, 15] {
        let x = middle(i);
        let clear = (-(25.0 + x * x + 0.1 * 0.1_f32).sqrt() / 4.0).exp();
        let wanted = [0.1, 0.2, 0.9].map(|fog| fog + (1.0 - fog) * clear);
        assert_near(at(&image, x, 0.1), &wanted, 2e-3, &format!("fog at {x}"));
    }
}

/// Returns the depths of a displaced square in every pixel, minus those of the flat one.
fn relief(place: &Place, before: &str, displacement: &str) -> Vec<f32> {
    let out = "Output (\"@/z.tif\", \"tiff\", \"z\", \"camera\", \"int[4] quantize\", (0, 0, 0, 0), \"float dither\", 0)\n";
    let world = format!(
        "Attribute (\"float displace:maxradius\", 20)\nShader (\"displacement\", {displacement})\nScale (2, 2, 1)\n{SQUARE}"
    );
    place.quiet(&scene(&format!("{out}{before}"), &world));
    place.image("z.tif").values.iter().map(|z| z - 5.0).collect()
}

fn range(values: &[f32]) -> (f32, f32) {
    let ends = (f32::INFINITY, f32::NEG_INFINITY);
    values.iter().fold(ends, |(low, high), v| (low.min(*v), high.max(*v)))
}

#[test]
fn bumps_have_their_height_in_scene_units() {
    let place = Place::new();
    let bumps = |unit: &str, amp: f32| {
        let before = format!("Attribute (\"string units:length\", \"{unit}\")\n");
        range(&relief(&place, &before, &format!("\"bumpy\", \"float amp\", {amp}, \"float period\", 0.5")))
    };
    let (low, high) = bumps("mm", 0.5);
    let height = high - low;
    assert!(low >= -0.5 && high <= 0.5 && height > 0.2, "{low} {high}");
    let twice = bumps("mm", 1.0);
    assert!((twice.1 - twice.0 - 2.0 * height).abs() < 0.05 * height, "{twice:?}");
    // The height is a tenth of that when a unit is a centimetre.
    let far = bumps("cm", 1.0);
    assert!(far.1 - far.0 <= 0.1 && far.1 - far.0 > 0.02, "{far:?}");
}

#[test]
fn dents_displace_inward_only() {
    let place = Place::new();
    let dents =
        |km: f32| relief(&place, "", &format!("\"dented\", \"float Km\", {km}, \"float frequency\", 3"));
    let flat = range(&dents(0.0));
    assert!(flat.0 > -1e-5 && flat.1 < 1e-5, "{flat:?}");
    let (one, half) = (range(&dents(1.0)), range(&dents(0.5)));
    // The normal of the square is +z, so that inward is towards the eye.
    assert!(one.0 < -0.02 && one.1 <= 1e-5 && one.0 > -2.0, "{one:?}");
    assert!((half.0 - 0.5 * one.0).abs() < 0.1 * -one.0, "{half:?} {one:?}");
}

#[test]
fn ambient_occlusion_measures_the_open_part_of_the_hemisphere() {
    let place = Place::new();
    let wall = "PushAttributes ()\nAttribute (\"string geometryset\", \"walls\")\n\
        Patch (\"linear\", 2, 2, \"vertex point P\", (0, -9000, -9000, 0, 9000, -9000, 0, -9000, 0, 0, 9000, 0))\nPopAttributes ()\n";
    let shader = |more: &str| {
        format!(
            "{wall}Shader (\"surface\", \"ambocclude\", \"float samples\", 1024, \"float twosided\", 1{more})\n{SQUARE}"
        )
    };
    let half = place.seen("", &shader(", \"string occlusionname\", \"walls\""));
    assert_near(at(&half, 0.5, 0.2), &[0.5, 0.5, 0.5, 1.0], 0.02, "beside a wall");
    assert_near(at(&place.seen("", &shader("")), 0.5, 0.2), &[1.0, 1.0, 1.0, 1.0], 0.0, "in the open");
}

#[test]
fn baked_light_is_read_back_as_subsurface_light() {
    let place = Place::new();
    let light = "Light (\"d\", \"distantlight\", \"color lightcolor\", (1, 0.5, 0.25))\nAttribute (\"string orientation\", \"inside\")\n";
    // The slab has 8 by 8 units, and its middle is seen. The coefficients are 5 per unit, so that little light is lost
    // at the sides.
    let bake = format!(
        "{light}Scale (4, 4, 1)\nShader (\"surface\", \"bakediffuse\", \"string filename\", \"@/light.sdb\", \"float weightarea\", 1)\n{SQUARE}"
    );
    let wide =
        scene("Attribute (\"int cull:occlusion\", 0)\nAttribute (\"string units:length\", \"mm\")", &bake);
    place.quiet(&wide.replace("(-1, 1, -1, 1)", "(-4, 4, -4, 4)").replace("(16, 16)", "(64, 64)"));
    let baked = granita_sdb::read(&place.path("light.sdb")).unwrap();
    let sum = (0..baked.len()).fold([0.0; 3], |s, i| {
        let v = baked.value(i);
        [s[0] + v[0], s[1] + v[1], s[2] + v[2]]
    });
    // The sum is the light times the area of 64 units.
    assert_near(&sum, &[64.0, 32.0, 16.0], 0.5, "what was baked");
    let under = "\"string diffusefile\", \"@/light.sdb\", \"color scattering\", (5, 5, 5), \"color absorption\", (0.01, 0.01, 0.01)";
    let seen = |shader: &str| {
        let world = format!("{light}Scale (4, 4, 1)\n{shader}\n{SQUARE}");
        let image = place.seen("Attribute (\"string units:length\", \"mm\")", &world);
        at(&image, 0.1, 0.1)[..3].to_vec()
    };
    let plain = seen("Shader (\"surface\", \"plasticss\", \"float Kd\", 0.5, \"float Ks\", 0)");
    let scattered =
        seen(&format!("Shader (\"surface\", \"plasticss\", \"float Kd\", 0.5, \"float Ks\", 0, {under})"));
    let layer = seen(&format!(
        "ShaderGroupBegin ()\nShader (\"surface\", \"plastic\", \"a\", \"float Kd\", 0.5, \"float Ks\", 0)\n\
         Shader (\"surface\", \"subsurflayer\", \"b\", {under})\nShaderGroupEnd ()"
    ));
    assert_near(&plain, &[0.5, 0.25, 0.125], 1e-4, "without scattering");
    assert_near(&layer, &scattered, 1e-5, "as a layer");
    let out: Vec<f32> = scattered.iter().zip(&plain).map(|(a, b)| a - b).collect();
    // The scattered light has the colour of the incident light, and is less than all of it.
    assert!(out[0] > 0.2 && out[0] < 1.0, "{out:?}");
    assert_near(&out, &[out[0], 0.5 * out[0], 0.25 * out[0]], 0.01, "the colour of the light");
}
