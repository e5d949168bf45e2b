//! Tests of the sources of parameters' values, and of the connections between layers (reference 2.6, 5.3.2).

use crate::fixture::*;
use granita_base::{BaseType, Param, ParamData, ParamType, Params, Vec3};
use granita_gsl::ir::{Global, ShaderKind, ValueType};
use granita_shade::{Executor, Group, LayerSource, Primvar, PrimvarData, ShadeError};

fn params(list: &[(&str, ParamData)]) -> Params {
    list.iter().map(|(d, data)| Param::declared(d, data.clone()).expect("a declaration")).collect()
}

fn floats_of(list: &[f32]) -> ParamData {
    ParamData::from(list)
}

fn run1(group: &Group, name: &str, ty: ValueType) -> Vec<f32> {
    let all = output(group, &mut square(2, 2), &mut Double::default(), name, ty);
    (0..ty.components()).map(|c| all[c * 4]).collect()
}

#[test]
fn defaults_read_globals_and_earlier_parameters() {
    let group = link(
        &[(
            "surface t (float a = 3, float b = a / 4, float s = u, output float r = b + s + N[2]) { }",
            Params::new(),
        )],
        &[],
    );
    let r = output(&group, &mut square(3, 1), &mut Double::default(), "r", ValueType::Float);
    assert_eq!(r, [-0.25, 0.25, 0.75]);
}

#[test]
fn instance_values_convert_in_type_and_space() {
    let source = "surface t (float f = 0, color c = 0, point p = 0, vector v = 0, string s = \"\", \
                  float list[] = {1, 2}, matrix m = 1, output point r = 0) \
                  { r = p + v + f + (point) c + arraylength (list) * 1000 + list[2] + m[3][0] * 100; if (s != \"x\") r = 0; }";
    let given = params(&[
        ("int f", 3.into()),
        ("float c", floats_of(&[5.0])),
        ("p", floats_of(&[1.0, 2.0, 3.0])),
        ("vector v", floats_of(&[0.5, 0.5, 0.5])),
        ("string s", "x".into()),
        ("float[3] list", floats_of(&[1.0, 2.0, 7.0])),
        (
            "matrix m",
            floats_of(&[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
        ),
    ]);
    let group = link(&[(source, given)], &[]);
    // The point was moved by 10, and the vector was not. The matrix also ends in "common" space.
    assert_eq!(run1(&group, "r", ValueType::Point), [4026.5, 4017.5, 4018.5]);
}

#[test]
fn unusable_instance_values_are_reported_and_replaced_by_defaults() {
    let source =
        "surface t (float f = 7, color c = 1, string s = \"d\", output float r = 0) { r = f + c[2]; }";
    let given = params(&[
        ("float[2] f", floats_of(&[1.0, 2.0])),
        ("string c", "red".into()),
        ("nothing", floats_of(&[1.0])),
        ("float s", floats_of(&[1.0])),
    ]);
    let (group, said) = link_saying(&[(source, given)], &[]);
    assert_eq!(run1(&group, "r", ValueType::Float), [8.0]);
    assert_eq!(
        said,
        [
            "shader \"t\" has no parameter \"nothing\"",
            "shader \"t\": parameter \"f\" is a float, not float[2] with 2 values",
            "shader \"t\": parameter \"c\" is a color, not string with 1 values",
            "shader \"t\": parameter \"s\" is a string, not float with 1 values",
        ]
    );
}

#[test]
fn primitive_variables_override_instance_values() {
    let source = "surface t (color Cs = 0, float f = 0, string tex = \"\", output color r = 0) \
                  { r = Cs + f; if (tex == \"a.tx\") r += 100; }";
    let group = link(
        &[(source, params(&[("color Cs", floats_of(&[9.0, 9.0, 9.0])), ("float f", floats_of(&[1.0]))]))],
        &[],
    );
    let mut grid = square(2, 1);
    let primvar = |name: &str, ty, data| Primvar { name: name.into(), ty: ParamType::of(ty), data };
    grid.primvars = vec![
        primvar(
            "Cs",
            BaseType::Color,
            PrimvarData::Floats { values: vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0], varying: true },
        ),
        // A variable of another type is ignored.
        primvar("f", BaseType::Color, PrimvarData::Floats { values: vec![50.0; 3], varying: false }),
        primvar("tex", BaseType::String, PrimvarData::Strings(vec!["a.tx".into()])),
    ];
    let r = output(&group, &mut grid, &mut Double::default(), "r", ValueType::Color);
    assert_eq!(r, [102.0, 103.0, 104.0, 105.0, 106.0, 107.0]);
}

#[test]
fn arrays_of_primitives_set_the_length_of_parameters() {
    let source = "surface t (float list[] = {1, 2}, color tints[] = {0}, string names[] = {\"a\"}, output color r = 0) { \
                  float sum = 0; for (float k = 0; k < arraylength (list); ++k) sum += list[k]; \
                  r = color (arraylength (list), sum, arraylength (tints) + 10 * arraylength (names)); \
                  if (names[arraylength (names) - 1] == \"z\") r[2] += 100; }";
    let array = |name: &str, base, n: u32, data| Primvar {
        name: name.into(),
        ty: ParamType { array: Some(n), ..ParamType::of(base) },
        data,
    };
    let list = |n: u32, varying: bool| {
        let lanes = if varying { 2 } else { 1 };
        let values = (0..n * lanes).map(|i| (1 + i / lanes) as f32).collect();
        array("list", BaseType::Float, n, PrimvarData::Floats { values, varying })
    };
    let tints =
        array("tints", BaseType::Color, 3, PrimvarData::Floats { values: vec![0.0; 9], varying: false });
    let names = array("names", BaseType::String, 2, PrimvarData::Strings(vec!["y".into(), "z".into()]));
    let mut services = Double::default();
    for optimize in [true, false] {
        let none = Params::new();
        let layer = LayerSource { module: module(source), params: &none, name: None };
        let group =
            Group::link_with(&[layer], &[], granita_shade::LinkOptions { optimize }, &mut |_, text| {
                panic!("{text}")
            })
            .expect("a group");
        for (primvars, expected) in [
            (vec![], [2.0, 3.0, 11.0]),
            (vec![list(5, false)], [5.0, 15.0, 11.0]),
            (vec![list(1, true)], [1.0, 1.0, 11.0]),
            (vec![list(2, true)], [2.0, 3.0, 11.0]),
            (vec![list(4, true), tints.clone()], [4.0, 10.0, 13.0]),
            (vec![names.clone(), tints.clone()], [2.0, 3.0, 123.0]),
            // A variable of another type is ignored.
            (
                vec![array(
                    "list",
                    BaseType::Color,
                    2,
                    PrimvarData::Floats { values: vec![9.0; 6], varying: false },
                )],
                [2.0, 3.0, 11.0],
            ),
            (vec![list(5, false)], [5.0, 15.0, 11.0]),
        ] {
            let mut grid = square(2, 1);
            grid.primvars = primvars;
            let r = output(&group, &mut grid, &mut services, "r", ValueType::Color);
            assert_eq!([r[0], r[2], r[4]], expected);
            assert_eq!([r[1], r[3], r[5]], expected);
        }
    }
    // Such a parameter has the length of its source in the next layer, and takes precedence over a connection.
    let taker = "surface b (float x[] = {0}, output float r = 0) { r = arraylength (x) * 10 + x[arraylength (x) - 1]; }";
    let giver = "surface a (output float list[] = {7, 8, 9}) { }";
    let group = link(&[(giver, Params::new()), (taker, Params::new())], &[["a", "list", "b", "x"]]);
    let mut grid = square(2, 1);
    assert_eq!(output(&group, &mut grid, &mut services, "r", ValueType::Float), [39.0; 2]);
    grid.primvars = vec![list(5, false)];
    assert_eq!(output(&group, &mut grid, &mut services, "r", ValueType::Float), [55.0; 2]);
    grid.primvars = vec![Primvar { name: "x".into(), ..list(4, true) }];
    assert_eq!(output(&group, &mut grid, &mut services, "r", ValueType::Float), [44.0; 2]);
}

const GIVER: &str = "surface g (output float f = 2, output color c = 0, output float list[3] = {1, 2, 3}, \
                     output string s = \"yes\") { c = color (u, 5, 6); C = 0.5; }";

#[test]
fn connections_convert_between_types_and_components() {
    let taker = |decl: &str, body: &str| format!("surface t ({decl}, output float r = -1) {{ r = {body}; }}");
    for (decl, body, from, to, expected) in [
        ("float x = 0", "x", "f", "x", 2.0),
        ("color x = 0", "x[0] + x[2]", "f", "x", 4.0),
        ("float x = 0", "x", "c", "x", 0.0),
        ("vector x = 0", "x[1] + x[2]", "c", "x", 11.0),
        ("float x = 0", "x", "c[1]", "x", 5.0),
        ("color x = 1", "x[0] + 10 * x[1] + x[2]", "f", "x[1]", 22.0),
        ("color x = 1", "x[0] + 10 * x[1] + x[2]", "c[2]", "x[1]", 62.0),
        ("float x[3] = {0, 0, 0}", "x[0] + x[1] + x[2]", "list", "x", 6.0),
        ("float x[] = {0}", "x[2] + 10 * arraylength (x)", "list", "x", 33.0),
        ("float x[] = {7}", "x[0] + 10 * x[4] + 100 * arraylength (x)", "list[1]", "x[4]", 527.0),
        ("float x = 0", "x", "list[2]", "x", 3.0),
        ("color x[2] = {0, 0}", "x[1][0] + x[1][2] + x[0][0]", "f", "x[1]", 4.0),
        ("color x[2] = {0, 0}", "x[1][0] + x[1][2] + x[0][0]", "f", "x[1][2]", 2.0),
        ("string x = \"no\"", "x == \"yes\"", "s", "x", 1.0),
        ("color x = 0", "x[0]", "C", "x", 0.5),
        ("float unused = 0", "C[0] + C[1] + u * 0", "c[1]", "C[0]", 5.5),
    ] {
        let source = taker(decl, body);
        let group = link(&[(GIVER, Params::new()), (&source, Params::new())], &[["a", from, "b", to]]);
        assert_eq!(run1(&group, "r", ValueType::Float), [expected], "{from} -> {to}: {decl}");
    }
}

#[test]
fn connected_globals_are_those_of_the_source_layer() {
    let middle = "surface m () { C = 9; }";
    let taker = "surface t (color x = 0, output float r = -1) { r = x[0] + 100 * C[0]; }";
    let layers = [(GIVER, Params::new()), (middle, Params::new()), (taker, Params::new())];
    let group = link(&layers, &[["a", "C", "c", "x"]]);
    assert_eq!(run1(&group, "r", ValueType::Float), [900.5]);
}

#[test]
fn impossible_connections_are_reported() {
    let taker =
        "surface t (float x = 4, string s = \"\", float list[2] = {0, 0}, output float r = -1) { r = x; }";
    for (connection, why) in [
        (["a", "nothing", "b", "x"], "shader \"g\" has no parameter \"nothing\""),
        (["z", "f", "b", "x"], "there is no layer \"z\""),
        (["b", "r", "a", "f"], "the source must be an earlier layer"),
        (["a", "s", "b", "x"], "a string does not connect to a float"),
        (["a", "list", "b", "list"], "the array lengths differ"),
        (["a", "list", "b", "x"], "the array lengths differ"),
        (["a", "list[3]", "b", "x"], "\"list[3]\" is outside of the array's 3 elements"),
        (["a", "c[3]", "b", "x"], "\"c[3]\" is outside of the three components"),
        (["a", "f[0]", "b", "x"], "\"f[0]\" has an index, but is neither an array nor a triple"),
        (["a", "c[x]", "b", "x"], "cannot read the index in \"c[x]\""),
    ] {
        let (group, said) = link_saying(&[(GIVER, Params::new()), (taker, Params::new())], &[connection]);
        assert!(said.len() == 1 && said[0].ends_with(why), "{connection:?}: {said:?}");
        assert_eq!(run1(&group, "r", ValueType::Float), [4.0]);
    }
}

#[test]
fn layers_share_globals_and_run_even_if_unconnected() {
    let layers = [
        ("surface a () { C = 0.25; opacity = 0.5; exit (); C = 7; }", Params::new()),
        ("surface b () { C *= 2; }", Params::new()),
    ];
    let group = link(&layers, &[]);
    let mut grid = square(2, 2);
    Executor::new().run(&group, &mut grid, &mut Double::default(), &[]);
    assert_eq!((grid.c.get(3), grid.opacity.get(0)), (Vec3::splat(0.5), Vec3::splat(0.5)));
    assert!(group.sets_opacity() && group.writes(Global::C) && !group.writes(Global::P));
}

#[test]
fn requested_results_come_from_the_last_layer_that_has_them() {
    let layers = [
        ("surface a (output float f = 1, float g = 5) { C = P[0] * 0; }", Params::new()),
        (
            "surface b (output float f = 2, output color k = 3, output normal N2 = 0) { N2 = N * 2; N = N2; }",
            Params::new(),
        ),
    ];
    let group = link(&layers, &[]);
    assert_eq!(group.output_names().iter().map(|n| &**n).collect::<Vec<_>>(), ["f", "k", "N2"]);
    let wanted = [
        ("f", ValueType::Float),
        ("k", ValueType::Float),
        ("g", ValueType::Float),
        ("N", ValueType::Normal),
        ("u", ValueType::Float),
        ("none", ValueType::Color),
    ];
    let results = Executor::new().run(&group, &mut square(2, 1), &mut Double::default(), &wanted);
    assert_eq!(results[0], Some(vec![2.0, 2.0]));
    assert_eq!((&results[1], &results[2], &results[5]), (&None, &None, &None));
    assert_eq!(results[3], Some(vec![0.0, 0.0, 0.0, 0.0, -2.0, -2.0]));
    assert_eq!(results[4], Some(vec![0.0, 1.0]));
}

#[test]
fn generic_shaders_keep_the_rules_of_their_usage() {
    for (body, allowed) in [
        ("C = 1;", [true, false, true, false]),
        ("P += N;", [false, true, false, false]),
        ("N = -N;", [true, true, false, false]),
        ("displace (1);", [false, true, false, false]),
        ("C = diffuse (N);", [true, false, true, false]),
        ("float x = u;", [true, true, true, true]),
    ] {
        let kinds = [ShaderKind::Surface, ShaderKind::Displacement, ShaderKind::Volume, ShaderKind::Light];
        for (kind, ok) in kinds.into_iter().zip(allowed) {
            let mut group = link(&[(&format!("shader t () {{ {body} }}"), Params::new())], &[]);
            assert_eq!(group.attach(kind).is_ok(), ok, "{body} as {kind:?}");
        }
    }
    let mut group = link(&[("surface t () { C = 1; }", Params::new())], &[]);
    let error = group.attach(ShaderKind::Volume).expect_err("another type");
    assert_eq!(error.to_string(), "a surface shader cannot be used as volume");
}

#[test]
fn invalid_groups_are_refused() {
    assert!(matches!(Group::link(&[], &[], &mut |_, _| ()), Err(ShadeError::Misuse { .. })));
    let none = Params::new();
    let layer = |source| LayerSource { module: module(source), params: &none, name: None };
    let mixed = [layer("surface a () { }"), layer("light b () { }")];
    assert!(matches!(Group::link(&mixed, &[], &mut |_, _| ()), Err(ShadeError::Misuse { .. })));
}

#[test]
fn constant_string_parameters_are_known_without_running() {
    let source = "light l (string __category = \"key,soft\", string map = \"\", string x = concat (\"a\", \"b\")) { emit () { } }";
    let group = link(&[(source, params(&[("string map", "m.sm".into())]))], &[]);
    let told = |name: &str| group.param_string(name).map(|s| s.to_string());
    assert_eq!(told("__category").as_deref(), Some("key,soft"));
    assert_eq!(told("map").as_deref(), Some("m.sm"));
    assert_eq!((told("x"), told("nothing")), (None, None));
}

#[test]
fn linking_layers_with_many_paths_is_quick() {
    // Whether a layer can be omitted depends on those that it feeds. There are 2 to the power of 60 ways to the last.
    let source = "surface t (float a = 1, float b = 2, output float c = 0, output float d = 0) { c = a + b; d = a - b; }";
    let names: Vec<String> = (0..60).map(|k| format!("l{k}")).collect();
    let none = Params::new();
    let layers: Vec<LayerSource<'_>> = names
        .iter()
        .map(|name| LayerSource { module: module(source), params: &none, name: Some(name) })
        .collect();
    let wire = |k: usize, source: &'static str, target: &'static str| granita_shade::ConnectionSource {
        source_layer: &names[k],
        source,
        target_layer: &names[k + 1],
        target,
    };
    let wires: Vec<granita_shade::ConnectionSource<'_>> =
        (0..59).flat_map(|k| [wire(k, "c", "a"), wire(k, "d", "b")]).collect();
    let group = Group::link(&layers, &wires, &mut |_, text| panic!("{text}")).expect("a group");
    assert_eq!(group.idle_layers(&[]), (0..60).collect::<Vec<usize>>());
    assert!(group.idle_layers(&[("c", ValueType::Float)]).is_empty());
    assert_eq!(run1(&group, "c", ValueType::Float), [2.0_f32.powi(30)]);
}

#[test]
fn parameters_without_elements_take_those_of_the_instance() {
    let source = "surface t (float list[] = {}, output float r = -1) {
        r = arraylength (list);
        for (float k = 0; k < arraylength (list); ++k) r += 10 * list[k];
    }";
    let run = |given: Params| {
        let group = link(&[(source, given)], &[]);
        output(&group, &mut square(2, 1), &mut Double::default(), "r", ValueType::Float)
    };
    assert_eq!(run(params(&[("float[3] list", floats_of(&[1.0, 2.0, 3.0]))])), [63.0, 63.0]);
    // An array has at least one element.
    assert_eq!(run(Params::new()), [1.0, 1.0]);
}
