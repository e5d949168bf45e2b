//! Textures and environments: what reaches the services, and what comes back.

use crate::fixture::*;
use granita_base::Params;
use granita_gsl::ir::ValueType;

#[test]
fn textures_give_floats_or_colors() {
    assert_eq!(floats("r = texture (\"st\", u, v);")[..3], [0.0, 0.5, 1.0]);
    assert_eq!(floats("color c = texture (\"st\", u, v + 3); r = c[0] + 10 * c[1] + 100 * c[2];")[4], 240.5);
    assert_eq!(floats("float a = 0; r = texture (\"st\", u, v, \"alpha\", a); r = a;"), [0.75; 6]);
}

#[test]
fn differentials_are_given_or_taken() {
    assert_eq!(floats("color c = texture (\"d\", u, v); r = c[0] + c[1] * 10 + c[2] * 100;"), [10.5; 6]);
    assert_eq!(
        floats("color c = texture (\"d\", u, v, 1, 2, 3, 4); r = c[0] + c[1] * 10 + c[2] * 100;"),
        [241.0; 6]
    );
}

#[test]
fn options_reach_the_lookup() {
    assert_eq!(floats("r = texture (\"blur\", u, v, \"blur\", u);")[..3], [0.0, 0.5, 1.0]);
    assert_eq!(floats("r = texture (\"blur\", u, v, 0, 0, 0, 0, \"sblur\", 0.25);"), [0.25; 6]);
    assert_eq!(floats("r = texture (\"blur\", u, v, \"tblur\", 0.25);"), [-1.0; 6]);
    assert_eq!(floats("r = texture (\"wrap\", u, v, \"wrap\", \"black\");"), [1.0; 6]);
    assert_eq!(floats("r = texture (\"wrap\", u, v, \"wrap\", \"default\");"), [0.0; 6]);
    assert_eq!(floats("r = texture3d (\"none\", P, \"fill\", 0.5);"), [0.5; 6]);
    let mut services = Double::default();
    floats_with("string option = u > 5 ? \"blur\" : \"bluur\"; r = 1;", &mut services);
    assert!(services.errors().is_empty());
}

#[test]
fn lookups_touch_active_lanes_only() {
    assert_eq!(floats("r = 7; if (u > 0.2) r = texture (\"st\", u, v);")[..3], [7.0, 0.5, 1.0]);
    // Texture names may differ from point to point: one call each.
    let mut services = Double::default();
    let body =
        "string name = \"st\"; if (u > 0.2) name = \"none\"; r = texture (name, u + 4, v, \"fill\", 9);";
    assert_eq!(floats_with(body, &mut services)[..3], [4.0, 9.0, 9.0]);
    assert_eq!(services.asked, 2);
}

#[test]
fn environments() {
    assert_eq!(floats("r = environment (\"map\", vector (1, 2, 3));")[..3], [1.0, 51.0, 101.0]);
    assert_eq!(floats("r = environment (\"map\", point (2), vector (1, 2, 3));"), [201.0; 6]);
    assert_eq!(
        floats("color c = environment (\"map\", vector (1, 2, 3), vector (0), vector (0)); r = c[2];"),
        [3.0; 6]
    );
    assert_eq!(
        floats(
            "color c = environment (\"map\", point (0), vector (1, 2, 3), vector (0), vector (0), \"blur\", 1); r = c[2];"
        ),
        [3.0; 6]
    );
    let all = |name: &str| {
        let source = format!(
            "surface t (output color r = 0) {{ float a = 0, d = 0; point p = 7; \
             color c = environment (\"{name}\", vector (0), \"alpha\", a, \"hitdist\", d, \"Phit\", p); \
             r = color (a, d, p[0]); }}"
        );
        let group = link(&[(&source, Params::new())], &[]);
        let r = output(&group, &mut square(2, 1), &mut Double::default(), "r", ValueType::Color);
        [r[0], r[2], r[4]]
    };
    assert_eq!(all("map"), [0.5, 1e38, 7.0]);
    assert_eq!(all("set"), [0.5, 3.0, 1.0]);
}
