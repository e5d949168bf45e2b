//! Tests of messages, attributes and printing.

use crate::fixture::*;
use granita_base::{BaseType, ParamType, Params};
use granita_gsl::ir::{ShaderKind, ValueType};
use granita_shade::{Executor, Primvar, PrimvarData};

#[test]
fn getattribute_returns_values_and_whether_they_exist() {
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
fn printf_error_and_fprintf_print_per_point() {
    let mut services = Double::default();
    floats_with(
        "printf (\"%s %d\\n\", \"once\", 3); if (u > 0.7) { printf (\"%.1f\", v); error (\"bad %g\", u); } \
         fprintf (\"log.txt\", \"%c\", color (1));",
        &mut services,
    );
    assert_eq!(services.printed(), ["once 3\n", "0.0", "1.0"]);
    // The error is the same in all points where it runs, so it is reported once.
    assert_eq!(services.errors(), ["test.gsl:1: shader \"t\": bad 1"]);
    assert_eq!(services.files, [("log.txt".to_owned(), "1.000000 1.000000 1.000000".to_owned())]);
}

#[test]
fn messages_pass_between_layers() {
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
fn messages_pass_between_displacement_and_surface() {
    let displacement = link(
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
fn messages_of_lights_and_primitives_are_read() {
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
    assert!(group.queries_parent());
    let mut grid = square(2, 1);
    let floats_named = |name: &str, ty, values: &[f32]| Primvar {
        name: name.into(),
        ty: ParamType::of(ty),
        data: PrimvarData::Floats { values: values.into(), varying: values.len().is_multiple_of(2) },
    };
    // The first variable of the right type is used.
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
fn messages_and_parameters_of_lights_may_vary() {
    let light = "light l (output float far = 0, output color tint = 0, float list[2] = { 1, 2 }) {
        setmessage (\"place\", 2 * Ps);
        emit (point (0, 0, -1)) { far = Ps[0]; tint = color (Ps[1], 0, 0); Cl = 1; } }";
    let body = "lights (P) {
            float far = 5, list[2] = { 0, 0 }; point place = 0; color tint = 0;
            r = getmessage (\"light\", \"far\", far) + getmessage (\"light\", \"list\", list)
                + getmessage (\"light\", \"place\", place) + getmessage (\"light\", \"tint\", tint);
            r = r * 1000 + list[1] * 100 + far * 10 + place[0] + tint[0];
            float none = 0;
            r += 10000 * (getmessage (\"light\", \"place\", none) + getmessage (\"light\", \"nothing\", none));
        }";
    let r = floats_with(body, &mut Double::with_lights(&[light]));
    assert_eq!(r, [4200.0, 4206.0, 4212.0, 4201.0, 4207.0, 4213.0]);
}

#[test]
fn lights_read_messages_of_the_surface_and_the_primitive() {
    let light = "light l () { float k = 0, id = 0, d = 0; color tag = 0;
        float found = getmessage (\"surface\", \"Kd\", k) + getmessage (\"surface\", \"tag\", tag)
            + getmessage (\"primitive\", \"id\", id) + getmessage (\"displacement\", \"depth\", d)
            + getmessage (\"volume\", \"Kd\", d);
        emit (vector (0, 0, 1), 0) { Cl = color (found, k + tag[0], id + d); } }";
    let source = "surface t (float Kd = 0.5, output color r = 0) {
        setmessage (\"tag\", color (u)); lights (P) r = Cl;
        setmessage (\"tag\", color (2)); lights (P) r += 10 * Cl; }";
    let surface = link(&[(source, Params::new())], &[]);
    let displacement = "displacement d (output float depth = 0) { depth = 3 * u; }";
    let displacement = link(&[(displacement, Params::new())], &[]);
    displacement.keep_parameters();
    let mut grid = square(2, 1);
    grid.primvars.push(Primvar {
        name: "id".into(),
        ty: ParamType::of(BaseType::Float),
        data: PrimvarData::Floats { values: vec![7.0, 8.0], varying: true },
    });
    Executor::new().run(&displacement, &mut grid, &mut Double::default(), &[]);
    let mut services = Double::with_lights(&[light]);
    let r = output(&surface, &mut grid, &mut services, "r", ValueType::Color);
    assert_eq!(r, [44.0, 44.0, 25.5, 26.5, 77.0, 121.0]);
}

#[test]
fn a_layer_whose_parameter_is_read_by_name_runs() {
    // No layer is connected to the first one, which only computes a parameter.
    let layers = [
        ("surface a (output float o = 0) { o = 2 * u; }", Params::new()),
        (
            "surface b (output float r = 0) { float x = 0; r = getmessage (\"surface\", \"o\", x) * 10 + x; }",
            Params::new(),
        ),
    ];
    let group = link(&layers, &[]);
    let r = output(&group, &mut square(3, 1), &mut Double::default(), "r", ValueType::Float);
    assert_eq!(r, [10.0, 11.0, 12.0]);
    // A source that is not constant may be any source.
    let source = "surface t (string from = \"\", output float r = 0) { float x = 0; getmessage (from, \"a\", x); r = x; }";
    let group = link(&[(source, Params::new())], &[]);
    assert!(group.asks_light() && group.asks_primitive() && group.queries_parent());
    assert!(group.listens_to(ShaderKind::Displacement) && group.listens_to(ShaderKind::Volume));
}

#[test]
fn elements_of_output_arrays_are_results() {
    let source = "surface t (output float list[3] = { 1, 2, 3 }, output color pair[2] = { 0, 0 }, float own[2] = { 1, 2 }) {
        list[1] = u; pair[1] = color (u, 5, 7); C = own[0]; }";
    let group = link(&[(source, Params::new())], &[]);
    let run = |name: &str, ty| {
        let mut services = Double::default();
        Executor::new().run(&group, &mut square(2, 1), &mut services, &[(name, ty)]).remove(0)
    };
    assert_eq!(run("list[1]", ValueType::Float), Some(vec![0.0, 1.0]));
    assert_eq!(run("list[2]", ValueType::Float), Some(vec![3.0, 3.0]));
    assert_eq!(run("pair[1]", ValueType::Color), Some(vec![0.0, 1.0, 5.0, 5.0, 7.0, 7.0]));
    for none in ["list[3]", "list", "own[0]", "pair[x]", "list[-1]"] {
        assert_eq!(run(none, ValueType::Float), None, "{none}");
    }
}

#[test]
fn a_seed_changes_only_random_functions() {
    let source = "surface t (output float r = 0, output float g = 0, output float h = 0) \
                  { r = random (); g = randomgrid (); h = random (P); }";
    let group = link(&[(source, Params::new())], &[]);
    let run = |seed: u32, named: bool| {
        let mut executor = Executor::new();
        executor.seed_random(seed);
        let mut grid = square(3, 2);
        if named {
            grid.names = (10..16).collect();
        }
        let wanted = ["r", "g", "h"].map(|name| (name, ValueType::Float));
        executor.run(&group, &mut grid, &mut Double::default(), &wanted)
    };
    for named in [false, true] {
        let (zero, one, again) = (run(0, named), run(1, named), run(1, named));
        assert_eq!(one, again);
        assert_ne!(zero[0], one[0]);
        assert_ne!(zero[1], one[1]);
        assert_eq!(zero[2], one[2]);
    }
}

#[test]
fn strings_from_attributes_and_messages_compare_equal() {
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
