//! Optimised code has the same results as unoptimised code, to the bit.

use crate::equivalence::{FUNCTION, LIGHTS, statement};
use crate::fixture::*;
use granita_base::{BaseType, Param, ParamType, Params};
use granita_gsl::ir::ValueType;
use granita_shade::{Executor, Grid, Group, LayerSource, LinkOptions, Primvar, PrimvarData};
use proptest::prelude::*;

/// Returns a group as it is compiled, and optimised.
fn both(layers: &[(&str, Params)], connections: &[[&str; 4]]) -> [Group; 2] {
    const NAMES: [&str; 3] = ["a", "b", "c"];
    [false, true].map(|optimize| {
        let sources: Vec<LayerSource<'_>> = layers
            .iter()
            .zip(NAMES)
            .map(|((source, params), name)| LayerSource { module: module(source), params, name: Some(name) })
            .collect();
        let connections: Vec<_> = connections
            .iter()
            .map(|c| granita_shade::ConnectionSource {
                source_layer: c[0],
                source: c[1],
                target_layer: c[2],
                target: c[3],
            })
            .collect();
        Group::link_with(&sources, &connections, LinkOptions { optimize }, &mut |_, text| panic!("{text}"))
            .expect("a group")
    })
}

/// Returns results and colours over a grid, with the printed text.
fn results(group: &Group, mut grid: Grid, wanted: &[(&str, ValueType)]) -> (Vec<Option<Vec<u32>>>, String) {
    let mut services = Double { grid: Some(grid.clone()), ..Double::with_lights(&LIGHTS) };
    let results = Executor::new().run(group, &mut grid, &mut services, wanted);
    // The payload of a NaN does not matter.
    let bits = |x: &f32| if x.is_nan() { u32::MAX } else { x.to_bits() };
    let mut list: Vec<_> = results.iter().map(|r| r.as_ref().map(|r| r.iter().map(bits).collect())).collect();
    list.push(Some(grid.c.xyz.iter().flatten().map(bits).collect()));
    (list, services.printed().concat())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn optimised_groups_give_the_same_results(
        body in prop::collection::vec(statement(), 1..6),
        default in prop_oneof!["1", "b", "u \\+ a", "noise \\(b\\)", "sin \\(a\\) \\* b", "a < b \\? 2 : v"],
        inputs in [-2.0..2.0_f32, -2.0..2.0_f32, -2.0..2.0_f32],
        given in 0..8_u32,
        replaced in 0..8_u32,
    ) {
        let body = body.join("\n");
        let source = format!(
            "{FUNCTION} surface t (float a = 0.5, float b = a * 2, float c = {}, string way = \"on\", \
             output float x = 1, output float y = a) \
             {{ float t[3] = {{1, 2, 3}}; point q = 1; string s = way; float z = 3 * b; if (way == \"on\") {{ {body} }} \
             float unread = noise (P * z); if (way != \"on\") x = unread; {body} C = color (x, y, z); \
             printf (\"%g %s\", b * 2, s); }}",
            default,
        );
        let names = ["a", "b", "c"];
        let params: Params = (0..3).filter(|k| given >> k & 1 == 1).map(|k| param(names[k], inputs[k])).collect();
        let groups = both(&[(&source, params)], &[]);
        let mut grid = square(4, 3);
        for k in (0..3).filter(|k| replaced >> k & 1 == 1 && given >> k & 1 == 0) {
            grid.primvars.push(Primvar {
                name: names[k].into(),
                ty: ParamType::of(BaseType::Float),
                data: PrimvarData::Floats { values: (0..12).map(|i| i as f32 * inputs[k]).collect(), varying: true },
            });
        }
        let wanted = [("x", ValueType::Float), ("y", ValueType::Float)];
        let [plain, better] = groups.map(|g| results(&g, grid.clone(), &wanted));
        prop_assert_eq!(plain, better, "{}", source);
    }
}

/// Returns the opacity of a run for all results, and that of a run for opacity alone, each with the printed text and
/// the number of answered lookups.
fn opacities(group: &Group, grid: &Grid) -> [(Vec<u32>, String, usize); 2] {
    [false, true].map(|alone| {
        let mut grid = grid.clone();
        let mut services = Double { grid: Some(grid.clone()), ..Double::with_lights(&LIGHTS) };
        let mut executor = Executor::new();
        match alone {
            true => executor.run_opacity(group, &mut grid, &mut services, &[]),
            false => executor.run(group, &mut grid, &mut services, &[]),
        };
        let bits = |x: &f32| if x.is_nan() { u32::MAX } else { x.to_bits() };
        let opacity = grid.opacity.xyz.iter().flatten().map(bits).collect();
        (opacity, services.printed().concat(), services.asked + services.told.len() + services.in_front.len())
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn code_for_opacity_alone_makes_the_same_opacity(
        first in prop::collection::vec(statement(), 1..4),
        second in prop::collection::vec(statement(), 1..4),
        form in 0..4_u32,
        layered in any::<bool>(),
    ) {
        let (first, second) = (first.join("\n"), second.join("\n"));
        let result = ["opacity = x;", "opacity = color (1, y, 0);", "if (x > y) opacity = x;", "opacity *= y * C[0];"];
        let head = "float t[3] = {1, 2, 3}; point q = 1; string s = \"\"; float y = 0.5;";
        let source = format!(
            "{FUNCTION} surface t (float a = 0.5, float b = 1, float c = 0.3, output float x = 0.5) {{ {head} {first} {} \
             {second} C *= color (x, y, q[0]); if (C[0] > 0.5) printf (\"%g\", u); }}",
            result[form as usize],
        );
        let before = format!("{FUNCTION} surface b (float a = 1, float b = 0.5, float c = 2, output float x = 0.25) {{ {head} {second} C = x; }}");
        let group = match layered {
            true => {
                let layers = [(&*before, Params::new()), (&*source, Params::new())];
                both(&layers, &[["a", "x", "b", "x"]])
            }
            false => both(&[(&source, Params::new())], &[]),
        };
        let [all, alone] = opacities(&group[1], &square(4, 3));
        prop_assert_eq!((all.0, all.1), (alone.0, alone.1), "{}\n{}", before, source);
    }
}

#[test]
fn code_for_opacity_alone_asks_nothing_that_only_colours_need() {
    let opaque = "surface t (float Kd = 1) {
        color sum = ambient () + Kd * diffuse (N);
        for (float k = 0; k < 4; ++k) { if (sum[0] > 9) break; sum += texture (\"a.tx\", u * k, v); }
        trace (\"all\", P, N, 0.1, 3) sum += 1;
        C *= sum * environment (\"b.tx\", N) * indirect (\"all\", P, N);
    }";
    let leaf = "surface t () {
        float a = texture (\"mask.tx\", u, v);
        color c = texture (\"colour.tx\", u, v);
        opacity = a;
        C = opacity * c * diffuse (N);
    }";
    for (source, expected) in [(opaque, 0), (leaf, 1)] {
        let [_, group] = both(&[(source, Params::new())], &[]);
        let [all, alone] = opacities(&group, &square(4, 3));
        assert_eq!((&all.0, &all.1), (&alone.0, &alone.1), "{source}");
        assert!(all.2 > expected, "{source}");
        assert_eq!(alone.2, expected, "{source}");
    }
}

#[test]
fn constants_are_folded_and_dead_code_is_removed() {
    let source = "surface t (float a = 2, string mode = \"x\", output float r = 0) {
        float b = a * 3;
        float once = noise (P * b), twice = noise (P * b);
        float unused = noise (P + 1);
        if (mode == \"y\") once = noise (P + 2);
        for (float k = 0; k < 3; ++k) r += once + twice * sin (u);
    }";
    let groups = both(&[(source, Params::new())], &[]);
    let [plain, better] = groups.each_ref().map(Group::operations);
    assert!(better + 5 <= plain, "{plain} operations became {better}");
    // Code that depends on a known condition is removed.
    let given: Params =
        [Param { name: "mode".into(), ty: ParamType::of(BaseType::String), data: "y".into() }]
            .into_iter()
            .collect();
    let other = both(&[(source, given)], &[]);
    assert!(other[1].operations() > better);
    let wanted = [("r", ValueType::Float)];
    for groups in [groups, other] {
        let [plain, better] = groups.map(|g| results(&g, square(4, 3), &wanted));
        assert_eq!(plain, better);
    }
}

#[test]
fn unused_layers_without_side_effects_do_not_run() {
    let source = "surface a (output float o = 0) { o = noise (P * 3); }";
    let speaks = "surface b (output float o = 0) { o = 1; printf (\"b\"); }";
    let last = "surface c (float x = 0.25) { C = x; }";
    let layers = [(source, Params::new()), (speaks, Params::new()), (last, Params::new())];
    let [plain, better] = both(&layers, &[]);
    let nothing: [(&str, ValueType); 0] = [];
    assert_eq!(results(&plain, square(3, 3), &nothing), results(&better, square(3, 3), &nothing));
    assert_eq!(better.idle_layers(&nothing), [0]);
    // The layer runs when its output is requested, or connected.
    let wanted = [("o", ValueType::Float)];
    assert_eq!(better.idle_layers(&wanted), Vec::<usize>::new());
    assert_eq!(results(&plain, square(3, 3), &wanted), results(&better, square(3, 3), &wanted));
    let [plain, better] = both(&layers, &[["a", "o", "c", "x"]]);
    assert_eq!(better.idle_layers(&nothing), Vec::<usize>::new());
    assert_eq!(results(&plain, square(3, 3), &nothing), results(&better, square(3, 3), &nothing));
}

#[test]
fn random_calls_keep_their_order() {
    let source = "surface t (float on = 0, output float r = 0) {
        float unused = random ();
        if (on > 0) r += random ();
        r += random () + (float) randomgrid ();
        bump (0.1 * r); r += N[0]; normal kept = N; N = 0; r += kept[1];
    }";
    let [plain, better] = both(&[(source, Params::new())], &[]);
    let wanted = [("r", ValueType::Float), ("N", ValueType::Normal)];
    assert_eq!(results(&plain, square(5, 5), &wanted), results(&better, square(5, 5), &wanted));
}

#[test]
fn optimised_bundled_shaders_give_the_same_results() {
    let lights =
        ["light p () { emit (point (0, 0, -2)) { Cl = 4 / dot (L, L); } }", "light a () { Cl = 0.125; }"];
    for (name, source) in crate::bundled::shaders() {
        let [plain, better] = both(&[(&source, Params::new())], &[]);
        if plain.usage() == granita_gsl::ir::ShaderKind::Light {
            continue;
        }
        let [a, b] = [plain, better].map(|mut group| {
            if group.usage() == granita_gsl::ir::ShaderKind::Generic {
                group.attach(granita_gsl::ir::ShaderKind::Surface).expect("a generic shader");
            }
            let mut grid = square(6, 5);
            let mut services = Double::with_lights(&lights);
            services.grid = Some(grid.clone());
            Executor::new().run(&group, &mut grid, &mut services, &[]);
            (grid.c, grid.opacity, grid.p, grid.n)
        });
        assert_eq!(a, b, "{name}");
    }
}
