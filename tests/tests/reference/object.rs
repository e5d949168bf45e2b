//! Tests attributes of objects (reference 4.4).

use crate::support::{Place, SHADERS, SQUARE, asks, scene};

#[test]
fn baking_views_along_the_normal() {
    let place = Place::new();
    let square = asks(
        &place,
        "",
        "C = color (length (I + Ng) < 1e-6, length (I - Ng) < 1e-6, length (I - vector (\"camera\", 0, 0, 1)) < 1e-6);",
    );
    for (view, wanted) in
        [("camera", [0.0, 0.0, 1.0]), ("outside", [1.0, 0.0, 0.0]), ("inside", [0.0, 1.0, 0.0])]
    {
        let world =
            format!("Attribute (\"string shading:view\", \"{view}\")\nRotate (40, 0, 1, 0)\n{square}");
        let image = place.seen(SHADERS, &world);
        assert_eq!(image.pixel(8, 8).unwrap()[..3], wanted, "{view}");
    }
}

#[test]
fn bounds_grow_by_displacements_in_their_space() {
    // The square lies beside the view, in a space with a scale of 10.
    let off_screen = |radius: &str, space: &str| {
        let world = format!(
            "Attribute (\"float displace:maxradius\", {radius})\n{space}Translate (6, 0, 0)\nScale (10, 10, 10)\n\
             Shader (\"displacement\", \"dented\", \"float Km\", 0)\nScale (0.1, 0.1, 1)\n{SQUARE}"
        );
        Place::new().quiet(&scene("", &world)).counts().primitives_off_screen
    };
    let object = "Attribute (\"string displace:maxspace\", \"object\")\n";
    assert_eq!(off_screen("0", ""), 1);
    assert_eq!(off_screen("0.5", ""), 1);
    assert_eq!(off_screen("5", ""), 0);
    assert_eq!(off_screen("0.5", object), 0);
    assert_eq!(off_screen("0.3", object), 1);
}

#[test]
fn hidden_surfaces_are_shaded_without_occlusion_culling() {
    let points = |line: &str| {
        let world = format!("{SQUARE}{line}\nTranslate (0, 0, 1)\nScale (0.9, 0.9, 1)\n{SQUARE}");
        Place::new().quiet(&scene("", &world)).counts().points_shaded
    };
    let (culled, all) = (points(""), points("Attribute (\"int cull:occlusion\", 0)"));
    assert!(all as f32 > 1.7 * culled as f32, "{all} {culled}");
    assert_eq!(culled, points("Attribute (\"int cull:occlusion\", 1)"));
}

#[test]
fn attributes_name_the_databases_of_irradiance() {
    for (kind, call) in [
        ("indirect", "C = indirect (\"walls\", P, N, \"samples\", 16);"),
        ("occlusion", "C = 1 - occlusion (\"walls\", P, N, M_PI_2, \"samples\", 16);"),
    ] {
        let place = Place::new();
        let square = asks(&place, "", call);
        let world = format!(
            "Attribute (\"string {kind}:spatialdb\", \"@/mine.sdb\")\n{square}\
             Attribute (\"string geometryset\", \"walls\")\nShader (\"surface\", \"constant\")\n\
             Translate (0, 0, -2)\nScale (3, 3, 1)\n{SQUARE}"
        );
        let write = |name: &str| format!("{SHADERS}Attribute (\"string spatialdb:writeonly\", \"@/{name}\")");
        place.quiet(&scene(&write("other.sdb"), &world));
        assert!(!place.path("mine.sdb").exists() && !place.path("other.sdb").exists(), "{kind}");
        place.quiet(&scene(&write("mine.sdb"), &world));
        let records = granita_sdb::read(&place.path("mine.sdb")).unwrap();
        assert!(records.len() >= 4, "{kind}: {}", records.len());
    }
}

#[test]
fn shaders_know_the_kind_of_ray() {
    let place = Place::new();
    place.write(
        "told.gsl",
        "surface told () { C = color (raylevel (), isshadowray (), isindirectray ()); opacity = 0.25 + 0.5 * isshadowray (); }",
    );
    // The wall is in front of the square. Only rays see it.
    let wall = "PushAttributes ()\nAttribute (\"string geometryset\", \"told\")\nShader (\"surface\", \"told\")\n\
                Translate (0, 0, -1)\nScale (9000, 9000, 1)\n";
    let seen = |body: &str| {
        let square = asks(&place, "", body);
        let world = format!("{wall}{SQUARE}PopAttributes ()\n{square}");
        place.seen(SHADERS, &world).pixel(8, 8).unwrap()[..3].to_vec()
    };
    assert_eq!(seen("C = color (raylevel (), isshadowray (), isindirectray ());"), [0.0, 0.0, 0.0]);
    let away = "vector way = vector (\"world\", 0, 0, -1);";
    assert_eq!(seen(&format!("{away} C = environment (\"told\", way);")), [1.0, 0.0, 0.0]);
    let alpha = "float a = 0; environment (\"told\", way, \"alpha\", a); C = a;";
    assert_eq!(seen(&format!("{away} {alpha}"))[0], 0.25);
    let world = format!(
        "{wall}{SQUARE}PopAttributes ()\nLight (\"d\", \"distantlight\", \"string shadowname\", \"told\")\n\
         Shader (\"surface\", \"matte\")\n{SQUARE}"
    );
    let lit = place.seen(SHADERS, &world);
    crate::support::assert_near(
        lit.pixel(8, 8).unwrap(),
        &[0.25; 3],
        1e-6,
        "three quarters of the light are kept",
    );
    let indirect =
        seen("C = indirect (\"told\", P, faceforward (normalize (N), I), \"samples\", 16, \"maxerror\", 0);");
    crate::support::assert_near(&indirect, &[1.0, 0.0, 1.0], 1e-5, "indirect");
}
