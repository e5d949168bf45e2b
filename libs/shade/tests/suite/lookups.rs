//! Tests of textures and environments: the data that the services receive, and their results.

use crate::fixture::*;
use granita_base::Params;
use granita_gsl::ir::ValueType;
use granita_shade::Executor;

#[test]
fn textures_give_floats_or_colors() {
    assert_eq!(floats("r = texture (\"st\", u, v);")[..3], [0.0, 0.5, 1.0]);
    assert_eq!(floats("color c = texture (\"st\", u, v + 3); r = c[0] + 10 * c[1] + 100 * c[2];")[4], 240.5);
    assert_eq!(floats("float a = 0; r = texture (\"st\", u, v, \"alpha\", a); r = a;"), [0.75; 6]);
}

#[test]
fn texture_differentials_are_given_or_computed() {
    assert_eq!(floats("color c = texture (\"d\", u, v); r = c[0] + c[1] * 10 + c[2] * 100;"), [10.5; 6]);
    assert_eq!(
        floats("color c = texture (\"d\", u, v, 1, 2, 3, 4); r = c[0] + c[1] * 10 + c[2] * 100;"),
        [241.0; 6]
    );
}

#[test]
fn texture_options_are_passed_to_the_lookup() {
    assert_eq!(floats("r = texture (\"blur\", u, v, \"blur\", u);")[..3], [0.0, 0.5, 1.0]);
    assert_eq!(floats("r = texture (\"blur\", u, v, 0, 0, 0, 0, \"sblur\", 0.25);"), [0.25; 6]);
    assert_eq!(floats("r = texture (\"blur\", u, v, \"tblur\", 0.25);"), [-1.0; 6]);
    assert_eq!(floats("r = texture (\"wrap\", u, v, \"wrap\", \"black\");"), [1.0; 6]);
    assert_eq!(floats("r = texture (\"wrap\", u, v, \"wrap\", \"default\");"), [0.0; 6]);
    assert_eq!(floats("r = texture3d (\"none\", P, \"fill\", 0.5);"), [0.5; 6]);
}

#[test]
fn option_names_may_be_computed_at_run_time() {
    let body =
        |option: &str| format!("string option = {option}; r = texture (\"blur\", u, v, option, 0.25);");
    assert_eq!(floats(&body("u > 5 ? \"fill\" : \"blur\"")), [0.25; 6]);
    let mut services = Double::default();
    assert_eq!(floats_with(&body("u > 5 ? \"blur\" : \"bluur\""), &mut services), [-1.0; 6]);
    assert_eq!(services.errors(), ["test.gsl:1: shader \"t\": texture has no option \"bluur\""]);
}

#[test]
fn unknown_options_are_reported_with_their_line() {
    let calls = [
        (
            "r = texture (\"blur\", u, v, \"bluur\", 1, \"blur\", 0.5, \"wild\", 2);",
            "texture has no option \"bluur\", \"wild\"",
        ),
        ("r = aastep (0.5, u, \"with\", 1);", "aastep has no option \"with\""),
        ("r = spatialdbquery (\"a\", P, r, \"most\", 1);", "spatialdbquery has no option \"most\""),
    ];
    for (call, said) in calls {
        let mut services = Double::default();
        floats_with(&format!("for (float k = 0; k < 2; ++k) {{ {call} }}"), &mut services);
        assert_eq!(services.errors(), [format!("test.gsl:1: shader \"t\": {said}")]);
        let mut services = Double::default();
        floats_with(&format!("if (u > 5) {{ {call} }}"), &mut services);
        assert!(services.errors().is_empty());
    }
    // Options of other lookups are ignored, because the compiler has warned about them.
    let mut services = Double::default();
    floats_with("r = texture (\"blur\", u, v, \"samples\", 4, \"up\", \"y\");", &mut services);
    assert!(services.errors().is_empty());
}

#[test]
fn maps_of_constant_names_are_found_once() {
    let kept = |body: &str| {
        let mut services = Double::default();
        let source = format!("surface t (string map = \"st\", string other = \"st\") {{ {body} }}");
        let group = link(&[(&source, Params::new())], &[]);
        for _ in 0..3 {
            Executor::new().run(&group, &mut square(2, 2), &mut services, &[]);
        }
        (services.found, services.asked)
    };
    // There is one call and three grids.
    assert_eq!(kept("C = texture (\"st\", u, v);"), (1, 3));
    assert_eq!(kept("C = texture (map, u, v, \"blur\", 0.5);"), (1, 3));
    assert_eq!(kept("C = texture (map, u, v) + texture (other, u + 1, v);"), (2, 6));
    // The name is computed while the shader runs.
    assert_eq!(kept("C = texture (u > 0.5 ? map : \"d\", u, v);"), (0, 6));
}

#[test]
fn lookups_change_active_lanes_only() {
    assert_eq!(floats("r = 7; if (u > 0.2) r = texture (\"st\", u, v);")[..3], [7.0, 0.5, 1.0]);
    // Texture names may differ from point to point. Each name is one call.
    let mut services = Double::default();
    let body =
        "string name = \"st\"; if (u > 0.2) name = \"none\"; r = texture (name, u + 4, v, \"fill\", 9);";
    assert_eq!(floats_with(body, &mut services)[..3], [4.0, 9.0, 9.0]);
    assert_eq!(services.asked, 2);
}

#[test]
fn environment_lookups_take_directions_and_positions() {
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

#[test]
fn queries_carry_messages_to_and_from_their_rays() {
    let mut services = Double::default();
    let source = "surface t (float Kd = 0.5) {
        setmessage (\"tag\", 2);
        C = shadow (\"curious\", P) + environment (\"curious\", N) + environment (\"sky.env\", N);
        C += indirect (\"curious\", P, N) + indirect (\"quiet\", P, N);
        trace (\"curious\", P, N, 0, 1) { C += 1; }
    }";
    let group = link(&[(source, Params::new())], &[]);
    let mut grid = square(2, 2);
    services.grid = Some(grid.clone());
    Executor::new().run(&group, &mut grid, &mut services, &[]);
    let all: Vec<(&str, &[String])> = services.told.iter().map(|(name, told)| (&**name, &**told)).collect();
    let told = ["tag".to_owned(), "Kd".to_owned()];
    let expected: [(&str, &[String]); 6] = [
        ("curious", &told),
        ("curious", &told),
        ("sky.env", &[]),
        ("curious", &told),
        ("quiet", &[]),
        ("curious", &told),
    ];
    assert_eq!(all, expected);
}
