//! Tests each bundled light against a closed form, on a matte square in the plane z = 0.

use crate::support::{Place, SHADERS, SQUARE, asks, assert_near, at, middle, scene};
use granita_tests::Image;

/// Renders a matte square under one light.
fn lit(light: &str) -> Image {
    Place::new().seen(
        "",
        &format!(
            "{light}\nAttribute (\"float shadingquality\", 4)\nShader (\"surface\", \"matte\")\n{SQUARE}"
        ),
    )
}

/// Compares the brightness of every fifth pixel in each direction with a function of its position.
fn assert_lit(light: &str, tolerance: f32, wanted: impl Fn(f32, f32) -> f32) {
    let image = lit(light);
    for j in (0..16).step_by(5) {
        for i in (0..16).step_by(5) {
            let (x, y) = (middle(i), middle(j));
            assert_near(at(&image, x, y), &[wanted(x, y); 3], tolerance, &format!("{light} at {x} {y}"));
        }
    }
}

/// Returns the distance from (0, 0, -2), two units in front of the square.
fn distance(x: f32, y: f32) -> f32 {
    (x * x + y * y + 4.0).sqrt()
}

#[test]
fn ambient_light_is_uniform() {
    assert_lit("Light (\"a\", \"ambientlight\", \"float intensity\", 0.25)", 1e-6, |_, _| 0.25);
    let tinted =
        lit("Light (\"a\", \"ambientlight\", \"float intensity\", 0.5, \"color lightcolor\", (1, 0.5, 0))");
    assert_near(at(&tinted, 0.3, 0.3), &[0.5, 0.25, 0.0], 1e-6, "lightcolor");
}

#[test]
fn point_lights_fall_off_by_their_exponent() {
    for falloff in [0.0, 1.0, 2.0] {
        let light = format!(
            "Light (\"p\", \"pointlight\", \"float intensity\", 3, \"point from\", (0, 0, -2), \"float falloff\", {falloff})"
        );
        assert_lit(&light, 2e-3, |x, y| {
            let r = distance(x, y);
            3.0 * 2.0 / r / r.powf(falloff)
        });
    }
}

#[test]
fn distant_lights_have_parallel_rays() {
    let cos = 1.0 / 3.0_f32.sqrt();
    let light = "Light (\"d\", \"distantlight\", \"float intensity\", 2, \"point from\", (1, 1, -1), \"point to\", (0, 0, 0))";
    assert_lit(light, 1e-5, |_, _| 2.0 * cos);
    // The default direction is +z of the space in which the light is declared.
    assert_lit("Light (\"d\", \"distantlight\")", 1e-5, |_, _| 1.0);
    assert_lit(
        "PushTransform ()\nRotate (60, 0, 1, 0)\nLight (\"d\", \"distantlight\")\nPopTransform ()",
        1e-5,
        |_, _| 0.5,
    );
}

/// A spot light at (0, 0, -2), with a half angle of 0.4 radians and an edge of 0.1 radians.
const CONE: &str = "\"point from\", (0, 0, -2), \"point to\", (0, 0, 0), \"float coneangle\", 0.4, \"float conedeltaangle\", 0.1, \
                    \"float beamdistribution\", 3, \"float falloff\", 2, \"float intensity\", 8";

fn spot(x: f32, y: f32) -> f32 {
    let r = distance(x, y);
    let c = 2.0 / r;
    let t = ((c - 0.4_f32.cos()) / (0.3_f32.cos() - 0.4_f32.cos())).clamp(0.0, 1.0);
    8.0 * c / (r * r) * c.powi(3) * t * t * (3.0 - 2.0 * t)
}

#[test]
fn spot_lights_shine_in_their_cone() {
    for name in ["spotlight", "shadowspot"] {
        assert_lit(&format!("Light (\"s\", \"{name}\", {CONE})"), 6e-3, spot);
    }
    // The light "uberlight" gives the same result.
    assert_lit(&format!("Light (\"s\", \"uberlight\", {CONE})"), 6e-3, spot);
    assert!(spot(0.1, 0.1) > 1.5 && spot(0.9, 0.9) == 0.0);
}

/// A card half way to the light, over x < 0. Its shadow ends at x = 0.
const CARD: &str = "PushAttributes ()\nAttribute (\"string geometryset\", \"blockers\")\n\
    Patch (\"linear\", 2, 2, \"vertex point P\", (-3, -3, -1, 0, -3, -1, -3, 3, -1, 0, 3, -1))\nPopAttributes ()\n";

#[test]
fn lights_cast_ray_traced_shadows() {
    for name in ["pointlight", "distantlight", "spotlight", "shadowspot", "uberlight"] {
        let to = if name == "pointlight" { "" } else { ", \"point to\", (0, 0, 0)" };
        let light = |more: &str| {
            lit(&format!("{CARD}Light (\"s\", \"{name}\", \"point from\", (0, 0, -2){to}{more})"))
        };
        let (open, shadowed) = (light(""), light(", \"string shadowname\", \"blockers\""));
        for x in [0.3, 0.5] {
            let (dark, bright) = (at(&shadowed, -x, 0.1), at(&shadowed, x, 0.1));
            assert!(dark[0] == 0.0 && bright[0] > 0.1, "{name}: {dark:?} {bright:?}");
            assert_near(bright, at(&open, x, 0.1), 1e-6, name);
        }
    }
}

#[test]
fn uberlight_has_limits_and_colours() {
    let light = |more: &str| format!("Light (\"u\", \"uberlight\", \"point from\", (0, 0, -2){more})");
    assert_lit(&light(""), 1e-3, |x, y| 2.0 / distance(x, y));
    assert_lit(&light(", \"float falloff\", 2, \"float falloffdist\", 2"), 2e-3, |x, y| {
        8.0 / distance(x, y).powi(3)
    });
    // "maxintensity" limits the intensity to 1.5 here.
    let most = ", \"float falloff\", 2, \"float falloffdist\", 4, \"float maxintensity\", 1.5";
    assert_lit(&light(most), 1e-3, |x, y| 3.0 / distance(x, y));
    let near = at(&lit(&light(", \"float cutnear\", 3")), 0.1, 0.1)[0];
    let far = at(&lit(&light(", \"float cutfar\", 1.5")), 0.1, 0.1)[0];
    assert_eq!((near, far), (0.0, 0.0));
    // Shadows may have a colour, and "__nondiffuse" excludes diffuse reflection.
    let red = ", \"string shadowname\", \"blockers\", \"color shadowcolor\", (1, 0, 0)";
    let image = lit(&format!("{CARD}{}", light(red)));
    let wanted = 2.0 / distance(0.4, 0.1);
    assert_near(at(&image, -0.4, 0.1), &[wanted, 0.0, 0.0], 0.05, "shadowcolor");
    let none = lit(&light(", \"float __nondiffuse\", 1"));
    assert_eq!(at(&none, 0.1, 0.1)[..3], [0.0; 3]);
}

#[test]
fn area_lights_emit_from_their_geometry() {
    // A small lamp at (0, 0, -2) faces the square. Its other side is dark.
    let lamp = |turned: &str, more: &str| {
        format!(
            "Light (\"a\", \"arealight\", \"string geometry\", \"lamp\", \"float intensity\", 4{more})\nPushAttributes ()\n\
             Attribute (\"string geometryset\", \"lamp\")\nTranslate (0, 0, -2)\n{turned}Scale (0.01, 0.01, 1)\n{SQUARE}PopAttributes ()"
        )
    };
    // The product of the cosines at both ends, divided by the squared distance.
    let wanted = |x: f32, y: f32| 4.0 * 4.0 / distance(x, y).powi(4);
    let toward = lit(&lamp("", ""));
    let (facing, away) = if at(&toward, 0.1, 0.1)[0] > 0.0 {
        ("", "Rotate (180, 0, 1, 0)\n")
    } else {
        ("Rotate (180, 0, 1, 0)\n", "")
    };
    assert_lit(&lamp(facing, ""), 0.01, wanted);
    assert_lit(&lamp(away, ""), 0.0, |_, _| 0.0);
    assert_lit(&lamp(away, ", \"float twosided\", 1"), 0.01, wanted);
}

#[test]
fn indirect_and_environment_lights_gather_a_hemisphere() {
    // An endless wall stands on the plane of the square at x = 0. It covers half of the hemisphere of every point.
    let wall = |set: &str| {
        format!(
            "PushAttributes ()\nAttribute (\"string geometryset\", \"{set}\")\nAttribute (\"color C\", (0.8, 0.4, 0))\n\
             Shader (\"surface\", \"constant\")\n\
             Patch (\"linear\", 2, 2, \"vertex point P\", (0, -9000, -9000, 0, 9000, -9000, 0, -9000, 0, 0, 9000, 0))\nPopAttributes ()\n"
        )
    };
    let light = |text: &str| lit(&format!("{}{text}", wall("walls")));
    let bounced = light(
        "Light (\"i\", \"indirectlight\", \"string indirectname\", \"walls\", \"float samples\", 1024)",
    );
    for x in [-0.5, 0.5] {
        assert_near(at(&bounced, x, 0.3), &[0.4, 0.2, 0.0], 0.02, "half of the wall's colour");
    }
    let half = light(
        "Light (\"e\", \"envlight\", \"string occlusionname\", \"walls\", \"float samples\", 1024, \"float intensity\", 0.6)",
    );
    // The light comes along the mean open direction, which is (4 / (3 pi), 0, 2 / 3), normalised.
    let open = 4.0 / (3.0 * std::f32::consts::PI);
    let cos = (2.0 / 3.0) / (open * open + 4.0 / 9.0).sqrt();
    assert_near(at(&half, 0.5, 0.3), &[0.3 * cos; 3], 0.01, "half of the sky");
    let open = light("Light (\"e\", \"envlight\", \"float intensity\", 0.6)");
    assert_near(at(&open, 0.5, 0.3), &[0.6, 0.6, 0.6], 1e-5, "all of the sky");
    let weak = light(
        "Light (\"e\", \"envlight\", \"string occlusionname\", \"walls\", \"float samples\", 1024, \"float Kocclusion\", 0.5)",
    );
    assert_near(at(&weak, 0.5, 0.3), &[0.75 * cos; 3], 0.02, "half of the occlusion");
}

#[test]
fn no_light_passes_where_a_wall_stands_on_the_edge() {
    // The wall ends exactly at the left edge of the square. All of the square is in its shadow, and sees it.
    let wall = "PushAttributes ()\nAttribute (\"string geometryset\", \"walls\")\nShader (\"surface\", \"constant\")\n\
                Patch (\"linear\", 2, 2, \"vertex point P\", (-1, -9, -9, -1, 9, -9, -1, -9, 0, -1, 9, 0))\nPopAttributes ()\n";
    for more in
        ["", ", \"float shadowsamples\", 9", ", \"float shadowsamples\", 16, \"float shadowblur\", 0.05"]
    {
        let light = format!(
            "{wall}Light (\"d\", \"distantlight\", \"point from\", (-1, 0.3, -1), \"point to\", (0, 0, 0), \"string shadowname\", \
             \"walls\"{more})"
        );
        let image = lit(&light);
        assert!(image.values.chunks(4).all(|p| p[..3] == [0.0; 3]), "{more}: {:?}", &image.values[..16]);
    }
    let bodies = [
        "float there = 0; environment (\"walls\", vector (-1, 0, -1), \"samples\", 4, \"alpha\", there); C = there;",
        "C = 0; trace (\"walls\", P, vector (-1, 0, -1), 0, 1) { float hit = 0; getmessage (\"trace\", \"hit\", hit); C = hit; }",
    ];
    for body in bodies {
        let place = Place::new();
        let square = asks(&place, "", body);
        let image = place.seen(SHADERS, &format!("{wall}{square}"));
        assert!(image.values.chunks(4).all(|p| p[..3] == [1.0; 3]), "{body}: {:?}", &image.values[..16]);
    }
}

#[test]
fn caustic_lights_show_the_density_of_photons() {
    // The photons have a power of 0.02 and lie on a lattice with a step of 0.05, in one grid. A unit of area has 400 of
    // them, with a power of 8.
    let place = Place::new();
    place.write(
        "lays.gsl",
        "surface lays () { spatialdbsave (\"@/photons.sdb\", P, normal (0, 0, -1), color (0.02, 0.01, 0), \"filemode\", \"wo\"); }",
    );
    let one = format!("{SHADERS}Attribute (\"int limits:gridsize\", 2000)");
    let laying =
        format!("Attribute (\"float[2] dice:fixed\", (40, 40))\nShader (\"surface\", \"lays\")\n{SQUARE}");
    place.quiet(&scene(&one, &laying));
    assert_eq!(granita_sdb::read(&place.path("photons.sdb")).unwrap().len(), 41 * 41);
    let world = format!(
        "Light (\"c\", \"causticlight\", \"string photonfile\", \"@/photons.sdb\", \"float maxpixeldist\", 3)\n\
         Shader (\"surface\", \"matte\")\n{SQUARE}"
    );
    let image = place.seen("", &world);
    assert_near(&image.mean([5, 5, 11, 11]).unwrap(), &[8.0, 4.0, 0.0], 0.4, "the density");
}
