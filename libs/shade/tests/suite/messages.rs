//! Messages, attributes, printing.

use crate::fixture::*;
use granita_base::{BaseType, ParamType, Params};
use granita_gsl::ir::{ShaderKind, ValueType};
use granita_shade::{Executor, Primvar, PrimvarData};

#[test]
fn attributes() {
    assert_eq!(floats("float x = 0; r = getattribute (\"limits:eye\", x) * 100 + x;"), [107.0; 6]);
    assert_eq!(floats("float x = 3; r = getattribute (\"nothing\", x) * 100 + x;"), [3.0; 6]);
    assert_eq!(
        floats("string s = \"\"; r = getattribute (\"user:name\", s) * 10 + (s == \"fred\");"),
        [11.0; 6]
    );
    assert_eq!(floats("float x = 3; r = getattribute (\"user:tint\", x) * 100 + x;"), [3.0; 6]);
    assert_eq!(floats("color x = 3; r = getattribute (\"user:tint\", x) * 100 + x[2];"), [103.0; 6]);
    assert_eq!(
        floats("float x[2] = {0, 0}; r = gettextureinfo (\"wood.tx\", \"resolution\", x) + x[0] + x[1];"),
        [1121.0; 6]
    );
    // Only active lanes are written.
    assert_eq!(
        floats("r = 1; if (u > 0.2) { float f = getattribute (\"limits:eye\", r); }")[..3],
        [1.0, 7.0, 7.0]
    );
}

#[test]
fn printing() {
    let mut services = Double::default();
    floats_with(
        "printf (\"%s %d\\n\", \"once\", 3); if (u > 0.7) { printf (\"%.1f\", v); error (\"bad %g\", u); } \
         fprintf (\"log.txt\", \"%c\", color (1));",
        &mut services,
    );
    assert_eq!(services.printed(), ["once 3\n", "0.0", "1.0"]);
    // The same in all points where it runs: once.
    assert_eq!(services.errors(), ["shader \"t\": bad 1"]);
    assert_eq!(services.files, [("log.txt".to_owned(), "1.000000 1.000000 1.000000".to_owned())]);
}

#[test]
fn messages_between_layers() {
    let layers = [
        (
            "surface a (float depth = 4) { setmessage (\"m\", u); if (u > 0.7) setmessage (\"m\", 9); setmessage (\"s\", \"hi\"); }",
            Params::new(),
        ),
        (
            "surface b (output float r = 0) { float x = -1, d = 0; string s = \"\"; color c = 5; \
             r = getmessage (\"surface\", \"m\", x) * 100 + x; r += getmessage (\"surface\", \"m\", c) + c[0]; \
             r += getmessage (\"surface\", \"depth\", d) * 1000 + d; r += getmessage (\"surface\", \"s\", s) * (s == \"hi\") * 10000; }",
            Params::new(),
        ),
    ];
    let group = link(&layers, &[]);
    let r = output(&group, &mut square(3, 1), &mut Double::default(), "r", ValueType::Float);
    assert_eq!(r, [11109.0, 11109.5, 11118.0]);
}

#[test]
fn messages_between_usages_travel_with_the_grid() {
    let mut displacement = link(
        &[(
            "displacement d (output float bumps = 0) { bumps = u; setmessage (\"tag\", color (1, 2, 3)); }",
            Params::new(),
        )],
        &[],
    );
    let surface = link(
        &[(
            "surface s (output float r = 0) { color c = 0; float x = 0; \
             r = getmessage (\"displacement\", \"tag\", c) * 10 + c[1]; r += getmessage (\"displacement\", \"bumps\", x) * 100 + x; }",
            Params::new(),
        )],
        &[],
    );
    assert!(surface.listens_to(ShaderKind::Displacement) && !surface.listens_to(ShaderKind::Volume));
    for (keeps, expected) in [(false, [12.0, 12.0]), (true, [112.0, 113.0])] {
        if keeps {
            displacement.keep_parameters();
        }
        let mut grid = square(2, 1);
        Executor::new().run(&displacement, &mut grid, &mut Double::default(), &[]);
        let r = output(&surface, &mut grid, &mut Double::default(), "r", ValueType::Float);
        assert_eq!(r, expected);
    }
}

#[test]
fn messages_of_lights_and_primitives() {
    let light =
        "light l (float intensity = 2, string kind = \"sun\") { emit (vector (0, 0, 1), 0) { Cl = 1; } }";
    let body = "r = 0; float x = 5; lights (P) { string k = \"\"; r = getmessage (\"light\", \"intensity\", x) * 10 + x; \
                r += getmessage (\"light\", \"kind\", k) * 100 * (k == \"sun\"); } \
                r += getmessage (\"light\", \"intensity\", x) * 1000;";
    assert_eq!(floats_with(body, &mut Double::with_lights(&[light])), [112.0; 6]);
    let source = "surface t (float id = 1, output float r = 0) { float x = 0; r = getmessage (\"primitive\", \"other\", x) * 10 + x; }";
    let group = link(&[(source, Params::new())], &[]);
    let mut grid = square(2, 1);
    grid.primvars.push(Primvar {
        name: "other".into(),
        ty: ParamType::of(BaseType::Float),
        data: PrimvarData::Floats { values: vec![3.0, 4.0], varying: true },
    });
    assert_eq!(output(&group, &mut grid, &mut Double::default(), "r", ValueType::Float), [13.0, 14.0]);
    let asks = "surface t (output float r = 0) { float x = 0; color c = 0; \
                r = getmessage (\"parent\", \"x\", x) * 100 + x; r += getmessage (\"parent\", \"x\", c) * 1000 + c[1]; \
                r += getmessage (\"parent\", \"y\", x) * 10000; }";
    let group = link(&[(asks, Params::new())], &[]);
    assert!(group.asks_parent());
    let mut grid = square(2, 1);
    let floats_named = |name: &str, ty, values: &[f32]| Primvar {
        name: name.into(),
        ty: ParamType::of(ty),
        data: PrimvarData::Floats { values: values.into(), varying: values.len().is_multiple_of(2) },
    };
    // The first of the right type counts.
    grid.parent = vec![
        floats_named("x", BaseType::Color, &[0.0, 0.0, 7.0, 8.0, 0.0, 0.0]),
        floats_named("x", BaseType::Float, &[3.0, 4.0]),
        floats_named("x", BaseType::Float, &[9.0]),
    ];
    let r = output(&group, &mut grid, &mut Double::default(), "r", ValueType::Float);
    assert_eq!(r, [1110.0, 1112.0]);
    assert_eq!(
        floats("float x = 0; r = getmessage (\"parent\", \"x\", x) + getmessage (\"volume\", \"x\", x);"),
        [0.0; 6]
    );
}

#[test]
fn what_is_stored_is_compared() {
    assert_eq!(
        floats(
            "string s = \"\"; float g = getattribute (\"user:name\", s); r = 5; if (s != \"fred\") r = g;"
        ),
        [5.0; 6]
    );
    assert_eq!(
        floats(
            "string s = \"\"; r = getattribute (\"user:name\", s) + 10 * getattribute (\"none\", s); if (s != \"fred\") r = 0;"
        ),
        [1.0; 6]
    );
    let source = "surface t (output color r = 0) { string s = \"\"; setmessage (\"who\", \"fred\"); \
        float g = getmessage (\"surface\", \"who\", s); r = color (g, 2, 3); if (s != \"fred\") r = 0; }";
    let group = link(&[(source, Params::new())], &[]);
    let out = output(&group, &mut square(2, 1), &mut Double::default(), "r", ValueType::Color);
    assert_eq!(out, [1.0, 1.0, 2.0, 2.0, 3.0, 3.0]);
    let source = "surface t (output color r = 0) { string s = \"\"; \
        float g = getmessage (\"parent\", \"who\", s); r = color (g, 2, 3); if (s != \"fred\") r = 0; }";
    let group = link(&[(source, Params::new())], &[]);
    let mut grid = square(2, 1);
    grid.parent = vec![Primvar {
        name: "who".into(),
        ty: ParamType::of(BaseType::String),
        data: PrimvarData::Strings(vec!["fred".into()]),
    }];
    let out = output(&group, &mut grid, &mut Double::default(), "r", ValueType::Color);
    assert_eq!(out, [1.0, 1.0, 2.0, 2.0, 3.0, 3.0]);
}
