//! A program has the same results with uniform inputs as with the same inputs in every lane, and in every executor.

use crate::fixture::*;
use granita_base::{BaseType, ParamType, Params};
use granita_gsl::ir::ValueType;
use granita_shade::{Executor, Primvar, PrimvarData};
use proptest::prelude::*;

/// Generates float expressions over a, b, c (inputs), x, y (variables) and u.
fn expression() -> impl Strategy<Value = String> {
    let leaf = prop_oneof![
        Just("a".to_owned()),
        Just("b".to_owned()),
        Just("c".to_owned()),
        Just("x".to_owned()),
        Just("y".to_owned()),
        Just("u".to_owned()),
        (-3i32..4).prop_map(|k| format!("({k})")),
    ];
    leaf.prop_recursive(3, 12, 3, |inner| {
        let e = inner.clone();
        prop_oneof![
            (e.clone(), e.clone(), prop_oneof!["\\+", "-", "\\*", "/"])
                .prop_map(|(a, b, o)| format!("({a} {o} {b})")),
            (e.clone(), e.clone()).prop_map(|(a, b)| format!("min ({a}, {b})")),
            (e.clone(), e.clone()).prop_map(|(a, b)| format!("noise ({a}, {b})")),
            (e.clone(), e.clone(), e.clone()).prop_map(|(a, b, c)| format!("({a} < {b} ? {c} : {a})")),
            (e.clone(), e.clone(), e.clone()).prop_map(|(a, b, c)| format!(
                "length (cross (vector ({a}, {b}, {c}), vector ({b}, 1, {a})))"
            )),
            (e.clone(), e.clone(), e.clone())
                .prop_map(|(a, b, c)| format!("luminance (mix (color ({a}, {b}, 0), color ({c}), 0.25))")),
            e.clone().prop_map(|a| format!("sin ({a})")),
            e.clone().prop_map(|a| format!("deltau ({a})")),
            e.clone().prop_map(|a| format!("smoothstep (-1, 1, {a})")),
            (e.clone(), e.clone()).prop_map(|(a, b)| format!("pow (abs ({a}), {b})")),
            (e.clone(), e.clone()).prop_map(|(a, b)| format!("atan ({a}, {b})")),
            (e.clone(), e.clone()).prop_map(|(a, b)| format!("mod ({a}, {b})")),
            e.clone().prop_map(|a| format!("exp (cos ({a}))")),
            e.clone().prop_map(|a| format!("log (abs ({a}))")),
            e.clone().prop_map(|a| format!("determinant (matrix ({a}) * matrix (2))")),
            e.clone().prop_map(|a| format!("floor ({a} * 2.5)")),
            e.clone().prop_map(|a| format!("aastep ({a}, u)")),
            e.clone().prop_map(|a| format!("snoise (point ({a}, v, {a}))")),
            (e.clone(), e).prop_map(|(a, b)| format!("spline ({a}, 0, {b}, 2, 1, 0)")),
        ]
    })
}

/// Generates statements that change x and y.
pub(crate) fn statement() -> impl Strategy<Value = String> {
    let simple = prop_oneof![
        expression().prop_map(|e| format!("x = {e};")),
        expression().prop_map(|e| format!("y += {e};")),
        (expression(), expression()).prop_map(|(i, e)| format!("t[abs ({i})] = {e}; y = t[x];")),
        expression().prop_map(|e| format!("q[1] = {e}; x -= q[0];")),
        expression().prop_map(|e| format!("s = concat (substr (s, -9), format (\"%g\", floor ({e})));")),
        (expression(), 0..4).prop_map(|(e, k)| format!("s = substr (s, {e}); y += match (\"[{k}-9]$\", s);")),
        expression().prop_map(|e| format!("if (s != \"\") s = {e} > 0 ? \"1\" : \"a\"; x += s == \"a\";")),
        expression().prop_map(|e| format!("x = twist ({e}, y);")),
        expression().prop_map(|e| format!("y = twist (t[1], q[{e} > 0]);")),
        expression().prop_map(|e| format!("if ({e} > 3) exit ();")),
        expression()
            .prop_map(|e| format!("q += deltav (P * {e}); y += filterwidth (q) + samplearea (P * {e});")),
        expression().prop_map(|e| format!("x += gridmax ({e}) - gridmin (y);")),
        expression()
            .prop_map(|e| format!("setmessage (\"m\", {e}); y += getmessage (\"surface\", \"m\", x);")),
    ];
    simple.prop_recursive(3, 12, 3, |inner| {
        let many = prop::collection::vec(inner.clone(), 1..3).prop_map(|list| list.join(" "));
        prop_oneof![
            (expression(), many.clone(), many.clone())
                .prop_map(|(c, a, b)| format!("if ({c} > 0) {{ {a} }} else {{ {b} }}")),
            (expression(), many.clone(), many.clone()).prop_map(|(c, a, b)| {
                format!("for (float k = 0; k < 4; ++k) {{ {a} if (k > {c}) break; {b} }}")
            }),
            (expression(), many.clone(), many.clone()).prop_map(|(c, a, b)| {
                format!("for (float k = 0; k < 3; ++k) {{ {a} if (k == floor ({c})) continue; {b} }}")
            }),
            (expression(), many.clone()).prop_map(|(c, a)| {
                format!("{{ float n = 0; do {{ {a} n += 1; }} while (n < 3 && {c} > y); }}")
            }),
            (expression(), many.clone()).prop_map(|(c, a)| {
                format!("{{ float n = 0; while (n < 3 && ({c} || x)) {{ n++; {a} }} }}")
            }),
            (expression(), many.clone())
                .prop_map(|(c, a)| { format!("lights (P) {{ x += Cl[0] * {c} + L[2]; {a} }}") }),
            (expression(), many).prop_map(|(c, a)| {
                format!("lights (\"key | !key\", P, N, 1 + {c}) {{ {a} y += Cl[1]; }}")
            }),
        ]
    })
}

/// A function with parameters by reference, and the lights over which loops run.
pub(crate) const FUNCTION: &str = "float twist (float p, float q) { if (p > q) return p; q += 1; for (float k = 0; k < 2; ++k) if (k > p) return k; return q * 0.5; }";
pub(crate) const LIGHTS: [&str; 2] = [
    "light k (string __category = \"key\") { emit (point (0.3, 0.5, -2)) { Cl = color (Ps[0], 0.5, 1) / dot (L, L); } }",
    "light s () { emit (vector (0, 0.25, 1), 0) { Cl = Ns[2]; } }",
];

/// Returns the results x and y over a 4 x 3 square. `varying` selects the inputs that are primitive variables.
fn run(body: &str, inputs: [f32; 3], varying: [bool; 3], executor: &mut Executor) -> Vec<u32> {
    let source = format!(
        "{FUNCTION} surface t (float a = 0, float b = 0, float c = 0, output float x = 1, output float y = 2) \
         {{ float t[3] = {{1, 2, 3}}; point q = 1; string s = \"ab1\"; {body} }}"
    );
    let names = ["a", "b", "c"];
    let given: Params = (0..3).filter(|&k| !varying[k]).map(|k| param(names[k], inputs[k])).collect();
    let group = link(&[(&source, given)], &[]);
    let mut grid = square(4, 3);
    for k in (0..3).filter(|&k| varying[k]) {
        grid.primvars.push(Primvar {
            name: names[k].into(),
            ty: ParamType::of(BaseType::Float),
            data: PrimvarData::Floats { values: vec![inputs[k]; 12], varying: true },
        });
    }
    let wanted = [("x", ValueType::Float), ("y", ValueType::Float)];
    let mut services = Double { grid: Some(grid.clone()), ..Double::with_lights(&LIGHTS) };
    let results = executor.run(&group, &mut grid, &mut services, &wanted);
    // The payload of a NaN does not matter.
    let bits = |x: f32| if x.is_nan() { u32::MAX } else { x.to_bits() };
    results.into_iter().flat_map(|r| r.expect("an output")).map(bits).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn uniform_and_varying_values_give_the_same_results(
        body in prop::collection::vec(statement(), 1..5),
        inputs in [-2.0..2.0_f32, -2.0..2.0_f32, -2.0..2.0_f32],
        mixture in 1..8_u32,
    ) {
        let body = body.join("\n");
        let uniform = run(&body, inputs, [false; 3], &mut Executor::new());
        // A run with varying inputs in an executor with other memory.
        let mut used = Executor::new();
        run("for (float k = 0; k < 3; ++k) { x = u * k; if (u > 0.5) y = 1 / k; }", [0.5; 3], [true; 3], &mut used);
        let some = [0, 1, 2].map(|k| mixture >> k & 1 == 1);
        prop_assert_eq!(&uniform, &run(&body, inputs, [true; 3], &mut used), "{}", &body);
        prop_assert_eq!(&uniform, &run(&body, inputs, some, &mut used), "{}", &body);
    }
}
