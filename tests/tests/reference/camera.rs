//! Tests attributes of cameras (reference 4.1).

use crate::support::{CAMERA, Place, Rendered, SQUARE, assert_near, levels_of_alpha, scene};
use granita_tests::Image;

/// A triangle without horizontal or vertical edges.
const SLANT: &str =
    "Mesh (\"linear\", (3,), (0, 1, 2), \"vertex point P\", (-1, -0.9, 0, 1, -0.7, 0, -0.8, 0.9, 0))\n";

#[test]
fn the_field_of_view_applies_to_the_height() {
    let place = Place::new();
    // At depth 4 half the height is 4 tan 30 = 2.3094, and half the width is twice that.
    let scene = CAMERA
        .replace("(16, 16)", "(32, 16)")
        .replace("orthographic", "perspective")
        .replace("Attribute (\"float[4] screen\", (-1, 1, -1, 1))", "Attribute (\"float fov\", 60)");
    let square = "Translate (0, 0, 4)\nWorld ()\nScale (1.1547, 1.1547, 1)\n";
    place.quiet(&format!("{scene}{square}{SQUARE}Render ()\n"));
    let image = place.image("out.tif");
    for y in 0..16 {
        for x in 0..32 {
            let inside = (4..12).contains(&y) && (12..20).contains(&x);
            assert_eq!(image.pixel(x, y).unwrap()[3], f32::from(u8::from(inside)), "{x} {y}");
        }
    }
}

/// Returns the mean distance of the alpha of two images.
fn distance(a: &Image, b: &Image) -> f32 {
    let pairs = a.values.chunks(4).zip(b.values.chunks(4));
    pairs.map(|(a, b)| (a[3] - b[3]).abs()).sum::<f32>() * 4.0 / a.values.len() as f32
}

#[test]
fn spatial_quality_smooths_edges() {
    let place = Place::new();
    let with =
        |nx: u32, ny: u32| place.seen(&format!("Attribute (\"int[2] spatialquality\", ({nx}, {ny}))"), SLANT);
    let (one, four, many, exact) = (with(1, 1), with(2, 2), with(8, 8), with(32, 32));
    assert_eq!(levels_of_alpha(&one), 2);
    assert!((3..=5).contains(&levels_of_alpha(&four)), "{}", levels_of_alpha(&four));
    assert!(levels_of_alpha(&many) > 20, "{}", levels_of_alpha(&many));
    let errors = [one, four, many].map(|image| distance(&image, &exact));
    assert!(errors[0] > 2.0 * errors[1] && errors[1] > 2.0 * errors[2], "{errors:?}");
}

#[test]
fn temporal_and_lens_quality_reduce_noise() {
    let place = Place::new();
    let moving = format!("Motion (0, 1)\nTranslate (-1, 0, 0)\nTranslate (1, 0, 0)\n{SQUARE}");
    // With a lens the projection is perspective. At depth 5 the view is five times as wide as at depth 1.
    let lens = "Attribute (\"string projection\", \"perspective\")\nAttribute (\"float fstop\", 1)\n\
                Attribute (\"float focallength\", 1)\nAttribute (\"float focaldistance\", 2.5)\n";
    let wide = format!("Scale (5, 5, 1)\n{SLANT}");
    for (name, before, world) in [
        ("temporalquality", "Attribute (\"float[2] shutter\", (0, 1))\n", moving.as_str()),
        ("dofquality", lens, wide.as_str()),
    ] {
        let with = |n: u32| {
            let quality = format!(
                "{before}Attribute (\"int {name}\", {n})\nAttribute (\"int[2] spatialquality\", (1, 1))"
            );
            place.seen(&quality, world)
        };
        let (few, many, exact) = (with(2), with(64), with(1024));
        assert!(levels_of_alpha(&exact) > 10, "{name}: it blurs");
        assert!(levels_of_alpha(&few) <= 3, "{name}: {}", levels_of_alpha(&few));
        let errors = [few, many].map(|image| distance(&image, &exact));
        assert!(errors[0] > 3.0 * errors[1], "{name}: {errors:?}");
    }
}

/// Renders a scene with these camera attributes.
fn counted(attributes: &[(&str, &str)], world: &str) -> Rendered {
    let list: String =
        attributes.iter().map(|(name, value)| format!("Attribute (\"{name}\", {value})\n")).collect();
    Place::new().quiet(&scene(&list, world))
}

#[test]
fn preview_sets_the_shading_quality() {
    let points = |list: &[(&str, &str)], world: &str| counted(list, world).counts().points_shaded;
    let full = points(&[], SQUARE);
    let half = points(&[("float preview", "0.5")], SQUARE);
    // The counts are 17 x 17 and 9 x 9 points, except for the borders of grids.
    let ratio = full as f32 / half as f32;
    assert!((3.0..4.5).contains(&ratio), "{full} {half}");
    // The object's own quality does not count in a preview.
    let asks = format!("Attribute (\"float shadingquality\", 4)\n{SQUARE}");
    assert_eq!(points(&[("float preview", "0.5")], &asks), half);
    assert!(points(&[], &asks) > 10 * full);
}

#[test]
fn preview_has_its_own_curvature_angle() {
    let ball = "Attribute (\"float dice:curvature\", 1)\nSphere (0.5, -0.5, 0.5, 360)\n";
    let points = |angle: &str| {
        let list = [("float preview", "0.5"), ("float preview:dicecurvature", angle)];
        counted(&list, ball).counts().points_shaded
    };
    let (coarse, fine) = (points("90"), points("8"));
    assert!(fine > 2 * coarse, "{fine} {coarse}");
    let default = counted(&[("float preview", "0.5")], ball).counts().points_shaded;
    assert_eq!(default, coarse);
}

#[test]
fn preview_has_its_own_samples_and_buckets() {
    let moving = format!("Motion (0, 1)\nTranslate (-1, 0, 0)\nTranslate (1, 0, 0)\n{SQUARE}");
    let open = [("float[2] shutter", "(0, 1)"), ("int limits:autopassreduction", "0")];
    let lens = [
        ("string projection", "\"perspective\""),
        ("float fstop", "1"),
        ("float focallength", "1"),
        ("float focaldistance", "2.5"),
        ("int limits:autopassreduction", "0"),
    ];
    let samples = |own: &[(&str, &str)], world: &str| {
        let list = [own, &[("float preview", "1")]].concat();
        counted(&list, world).counts().samples
    };
    let one = samples(&[], SQUARE);
    assert_eq!(samples(&[("int[2] preview:spatialquality", "(3, 2)")], SQUARE), 6 * one);
    assert_eq!(samples(&[("int[2] spatialquality", "(3, 2)")], SQUARE), one);
    for (name, blurred, world) in [
        ("int preview:temporalquality", &open[..], moving.as_str()),
        ("int preview:dofquality", &lens, SQUARE),
    ] {
        let with = |n: &str| samples(&[blurred, &[(name, n)]].concat(), world);
        let (plain, few, many) = (samples(blurred, world), with("1"), with("12"));
        assert!(plain == few && many >= 12 * few, "{name}: {plain} {few} {many}");
    }
    let buckets = |list: &[(&str, &str)]| counted(list, SQUARE).counts().buckets;
    assert_eq!(buckets(&[("float preview", "1")]), 1);
    assert_eq!(buckets(&[("float preview", "1"), ("int[2] preview:bucketsize", "(8, 4)")]), 8);
    assert_eq!(buckets(&[("float preview", "1"), ("int[2] limits:bucketsize", "(8, 4)")]), 1);
    assert_eq!(buckets(&[("int[2] limits:bucketsize", "(8, 4)")]), 8);
}

#[test]
fn an_unknown_hider_is_reported_and_ignored() {
    let place = Place::new();
    let plain = place.seen("", SLANT);
    assert!(plain == place.seen("Attribute (\"string hider\", \"default\")", SLANT));
    let other = place.render(&scene("Attribute (\"string hider\", \"depthbuffer\")", SLANT));
    assert!(other.said.len() == 1 && other.said[0].contains("depthbuffer"), "{:?}", other.said);
    assert!(plain == place.image("out.tif"));
    assert_near(&plain.mean([0, 0, 16, 16]).unwrap(), &[0.445; 4], 0.005, "the triangle's area");
}
