// tidy: table
//! Tests every function against a table, with uniform and with varying arguments.

use crate::fixture::*;
use granita_base::{BaseType, ParamType, Params};
use granita_gsl::ir::ValueType;
use granita_shade::{Group, LayerSource, LinkOptions, Primvar, PrimvarData};

/// Returns the value of an expression in x, y and z. They are given with the instance, and per lane as primitive
/// variables. Both results must be the same to the bit.
fn evaluate(expression: &str, ty: ValueType, args: [f32; 3]) -> Vec<f32> {
    let word = ty.word();
    let source = format!(
        "surface t (float x = 0, float y = 0, float z = 0, output {word} r = 0) {{ r = {expression}; }}"
    );
    let names = ["x", "y", "z"];
    let given: Params = names.iter().zip(args).map(|(n, v)| param(n, v)).collect();
    let mut services = Double::default();
    let uniform = link(&[(&source, given)], &[]);
    let a = output(&uniform, &mut square(2, 2), &mut services, "r", ty);
    let varying = link(&[(&source, Params::new())], &[]);
    let mut grid = square(2, 2);
    for (name, v) in names.iter().zip(args) {
        grid.primvars.push(Primvar {
            name: (*name).into(),
            ty: ParamType::of(BaseType::Float),
            data: PrimvarData::Floats { values: vec![v; 4], varying: true },
        });
    }
    let b = output(&varying, &mut grid, &mut services, "r", ty);
    let bits =
        |list: &[f32]| list.iter().map(|x| if x.is_nan() { 1 } else { x.to_bits() }).collect::<Vec<_>>();
    assert_eq!(bits(&a), bits(&b), "{expression} {args:?}: {a:?} {b:?}");
    // The unoptimised code has the same result as the folded code.
    let layer = LayerSource { module: module(&source), params: &Params::new(), name: None };
    let plain =
        Group::link_with(&[layer], &[], LinkOptions { optimize: false }, &mut |_, _| {}).expect("a group");
    let c = output(&plain, &mut grid, &mut services, "r", ty);
    assert_eq!(bits(&a), bits(&c), "{expression} {args:?}, unoptimised");
    assert_eq!(services.errors(), Vec::<&str>::new(), "{expression}");
    (0..ty.components()).map(|c| a[c * 4]).collect()
}

fn near(a: f32, b: f32) -> bool {
    a == b || a.is_nan() && b.is_nan() || (a - b).abs() <= 2e-6 * b.abs().max(1.0)
}

fn check(ty: ValueType, table: &[(&str, [f32; 3], &[f32])]) {
    for (expression, args, expected) in table {
        let got = evaluate(expression, ty, *args);
        assert!(
            got.len() == expected.len() && got.iter().zip(*expected).all(|(a, b)| near(*a, *b)),
            "{expression} {args:?}: {got:?}, not {expected:?}"
        );
    }
}

const NAN: f32 = f32::NAN;
const INF: f32 = f32::INFINITY;
const PI: f32 = std::f32::consts::PI;

#[test]
fn mathematical_functions_have_known_values() {
    check(
        ValueType::Float,
        &[
            ("radians (x)", [180.0, 0.0, 0.0], &[PI]),
            ("degrees (x)", [PI, 0.0, 0.0], &[180.0]),
            ("sin (x)", [PI / 6.0, 0.0, 0.0], &[0.5]),
            ("cos (x)", [PI / 3.0, 0.0, 0.0], &[0.5]),
            ("tan (x)", [PI / 4.0, 0.0, 0.0], &[1.0]),
            ("sin (x)", [INF, 0.0, 0.0], &[NAN]),
            ("asin (x)", [2.0, 0.0, 0.0], &[PI / 2.0]),
            ("asin (x)", [-INF, 0.0, 0.0], &[-PI / 2.0]),
            ("acos (x)", [1.0001, 0.0, 0.0], &[0.0]),
            ("acos (x)", [-3.0, 0.0, 0.0], &[PI]),
            ("acos (x)", [NAN, 0.0, 0.0], &[NAN]),
            ("atan (x)", [1.0, 0.0, 0.0], &[PI / 4.0]),
            ("atan (x, y)", [1.0, -1.0, 0.0], &[0.75 * PI]),
            ("atan (x, y)", [0.0, 0.0, 0.0], &[0.0]),
            ("sinh (x)", [1.0, 0.0, 0.0], &[1.175_201_2]),
            ("cosh (x)", [1.0, 0.0, 0.0], &[1.543_080_6]),
            ("tanh (x)", [INF, 0.0, 0.0], &[1.0]),
            ("pow (x, y)", [2.0, 10.0, 0.0], &[1024.0]),
            ("pow (x, y)", [0.0, 0.0, 0.0], &[1.0]),
            ("pow (x, y)", [-8.0, 1.0 / 3.0, 0.0], &[NAN]),
            ("exp (x)", [1.0, 0.0, 0.0], &[std::f32::consts::E]),
            ("log (x)", [M_E, 0.0, 0.0], &[1.0]),
            ("log (x)", [0.0, 0.0, 0.0], &[-INF]),
            ("log2 (x)", [8.0, 0.0, 0.0], &[3.0]),
            ("log10 (x)", [1000.0, 0.0, 0.0], &[3.0]),
            ("log (x, y)", [81.0, 3.0, 0.0], &[4.0]),
            ("sqrt (x)", [2.0, 0.0, 0.0], &[std::f32::consts::SQRT_2]),
            ("sqrt (x)", [-1.0, 0.0, 0.0], &[NAN]),
            ("inversesqrt (x)", [4.0, 0.0, 0.0], &[0.5]),
            ("inversesqrt (x)", [0.0, 0.0, 0.0], &[INF]),
            ("hypot (x, y)", [3.0, 4.0, 0.0], &[5.0]),
            ("hypot (x, y, z)", [2.0, 3.0, 6.0], &[7.0]),
            ("abs (x) + fabs (y)", [-3.0, -4.0, 0.0], &[7.0]),
            ("sign (x) * 10 + sign (y) * 100 + sign (z)", [-3.0, 4.0, 0.0], &[90.0]),
            ("sign (x)", [NAN, 0.0, 0.0], &[0.0]),
            ("floor (x)", [-1.5, 0.0, 0.0], &[-2.0]),
            ("ceil (x)", [-1.5, 0.0, 0.0], &[-1.0]),
            ("round (x)", [2.5, 0.0, 0.0], &[3.0]),
            ("round (x)", [-2.5, 0.0, 0.0], &[-3.0]),
            ("trunc (x)", [-1.5, 0.0, 0.0], &[-1.0]),
            ("mod (x, y)", [7.5, 2.0, 0.0], &[1.5]),
            ("mod (x, y)", [-1.0, 3.0, 0.0], &[2.0]),
            ("mod (x, y)", [1.0, -3.0, 0.0], &[-2.0]),
            ("mod (x, y)", [1.0, 0.0, 0.0], &[NAN]),
            ("min (x, y) + 10 * max (x, y)", [3.0, 4.0, 0.0], &[43.0]),
            ("clamp (x, y, z)", [5.0, 0.0, 1.0], &[1.0]),
            ("clamp (x, y, z)", [-5.0, 0.0, 1.0], &[0.0]),
            ("mix (x, y, z)", [10.0, 20.0, 0.25], &[12.5]),
            ("mix (x, y, z)", [10.0, 20.0, 2.0], &[30.0]),
            ("isnan (x) + 10 * isinf (y) + 100 * finite (z)", [NAN, -INF, 0.0], &[91.0]),
            ("isnan (x) + 10 * isinf (y) + 100 * finite (x)", [0.0, INF, 0.0], &[110.0]),
            ("finite (x) + finite (y)", [NAN, INF, 0.0], &[0.0]),
            ("erf (x)", [0.5, 0.0, 0.0], &[0.520_499_9]),
            ("erf (x)", [-INF, 0.0, 0.0], &[-1.0]),
            ("erfc (x)", [0.5, 0.0, 0.0], &[0.479_500_1]),
            ("erfc (x)", [INF, 0.0, 0.0], &[0.0]),
            (
                "M_PI_2 + M_LN2 - M_SQRT1_2 + 0 * x",
                [0.0; 3],
                &[PI / 2.0 + std::f32::consts::LN_2 - std::f32::consts::FRAC_1_SQRT_2],
            ),
            ("step (x, y) * 10 + step (x, x)", [1.0, 0.5, 0.0], &[1.0]),
            ("smoothstep (x, y, z)", [1.0, 3.0, 2.0], &[0.5]),
            ("smoothstep (x, y, z)", [1.0, 3.0, 1.5], &[0.15625]),
            ("smoothstep (x, y, z)", [1.0, 1.0, 1.0], &[0.0]),
            ("smoothstep (x, y, z)", [1.0, 1.0, 1.5], &[1.0]),
            ("smoothstep (x, y, z)", [1.0, 3.0, 9.0], &[1.0]),
        ],
    );
}

const M_E: f32 = std::f32::consts::E;

/// The constants are correct to the bit, and functions accept them.
#[test]
fn named_constants_have_their_values() {
    use std::f32::consts;
    for (name, value) in [
        ("M_PI", consts::PI),
        ("PI", consts::PI),
        ("M_PI_2", consts::FRAC_PI_2),
        ("M_E", consts::E),
        ("M_LN2", consts::LN_2),
        ("M_LN10", consts::LN_10),
        ("M_SQRT2", consts::SQRT_2),
        ("M_SQRT1_2", consts::FRAC_1_SQRT_2),
    ] {
        assert_eq!(floats(&format!("r = {name};")), [value; 6], "{name}");
    }
    let one = floats("r = log (M_E) + cos (PI) + exp (M_LN2) - 2 * M_SQRT2 * M_SQRT1_2 + sin (M_PI_2);")[0];
    assert!((one - 1.0).abs() < 1e-6, "{one}");
}

#[test]
fn operators_have_known_values() {
    check(
        ValueType::Float,
        &[
            ("x + y * z - x / y", [6.0, 2.0, 5.0], &[13.0]),
            ("-x", [3.0, 0.0, 0.0], &[-3.0]),
            ("x / y", [1.0, 0.0, 0.0], &[INF]),
            ("(x < y) + 10 * (x <= y) + 100 * (x > y) + 1000 * (x >= y)", [1.0, 2.0, 0.0], &[11.0]),
            ("(x == y) + 10 * (x != y)", [2.0, 2.0, 0.0], &[1.0]),
            ("(x == x) + 10 * (x != x)", [NAN, 0.0, 0.0], &[10.0]),
            ("x < y && y < z", [1.0, 2.0, 3.0], &[1.0]),
            ("x > y || y < z", [1.0, 2.0, 3.0], &[1.0]),
            ("!x + 10 * !y", [0.0, 2.0, 0.0], &[1.0]),
            ("x > 1 ? y : z", [2.0, 5.0, 6.0], &[5.0]),
            ("x > 1 ? y : z", [0.0, 5.0, 6.0], &[6.0]),
            ("color (x, y, z) == color (1, 2, 3)", [1.0, 2.0, 3.0], &[1.0]),
            ("color (x, y, z) != color (1, 2, 4)", [1.0, 2.0, 3.0], &[1.0]),
            ("vector (x, y, z) == 2", [2.0, 2.0, 2.0], &[1.0]),
        ],
    );
    check(
        ValueType::Color,
        &[
            ("color (x, y, z) * 2 + 1", [1.0, 2.0, 3.0], &[3.0, 5.0, 7.0]),
            ("x / color (x, y, z)", [1.0, 2.0, 4.0], &[1.0, 0.5, 0.25]),
            ("(color) x", [0.5, 0.0, 0.0], &[0.5, 0.5, 0.5]),
            ("mix (color (x, y, z), color (3), 0.5)", [1.0, 3.0, 5.0], &[2.0, 3.0, 4.0]),
            ("min (color (x, y, z), color (2))", [1.0, 2.0, 3.0], &[1.0, 2.0, 2.0]),
            ("clamp (color (x, y, z), color (1.5), color (2))", [1.0, 2.0, 3.0], &[1.5, 2.0, 2.0]),
        ],
    );
}

#[test]
fn geometric_functions_have_known_values() {
    check(
        ValueType::Float,
        &[
            ("dot (vector (x, y, z), vector (1, 2, 3))", [1.0, 2.0, 3.0], &[14.0]),
            ("length (vector (x, y, z))", [2.0, 3.0, 6.0], &[7.0]),
            ("distance (point (x, y, z), point (x, 0, z))", [2.0, 3.0, 6.0], &[3.0]),
            ("distance (point (0), point (x, 0, 0), point (y, z, 0))", [2.0, 1.0, 3.0], &[3.0]),
            ("length (normalize (vector (x, y, z)))", [2.0, 3.0, 6.0], &[1.0]),
            ("length (normalize (vector (x, y, z)))", [0.0, 0.0, 0.0], &[0.0]),
            ("luminance (color (x, y, z))", [1.0, 1.0, 1.0], &[1.0]),
        ],
    );
    check(
        ValueType::Vector,
        &[
            ("cross (vector (x, y, z), vector (0, 1, 0))", [1.0, 0.0, 0.0], &[0.0, 0.0, 1.0]),
            ("cross (vector (x, y, z), vector (x, y, z))", [1.1, 2.7, 3.3], &[0.0, 0.0, 0.0]),
            ("faceforward (vector (x, y, z), vector (0, 0, 1))", [0.0, 0.0, -1.0], &[0.0, 0.0, -1.0]),
            ("faceforward (vector (x, y, z), vector (0, 0, -1))", [0.0, 0.0, -1.0], &[0.0, 0.0, 1.0]),
            (
                "faceforward (vector (x, y, z), vector (0, 1, 0), vector (0, 2, 0))",
                [1.0, 0.0, 0.0],
                &[-1.0, 0.0, 0.0],
            ),
            ("reflect (vector (x, y, z), vector (0, 1, 0))", [1.0, -1.0, 0.0], &[1.0, 1.0, 0.0]),
            (
                "refract (vector (x, y, z), vector (0, 0, 1), 1 / 1.5)",
                [0.6, 0.0, -0.8],
                &[0.4, 0.0, -0.916_515_1],
            ),
            ("refract (vector (x, y, z), vector (0, 0, 1), 1.5)", [0.9, 0.0, -0.435_889_9], &[0.0, 0.0, 0.0]),
            ("transformv (\"turned\", \"common\", vector (x, y, z))", [1.0, 0.0, 0.0], &[0.0, 1.0, 0.0]),
            ("transformv (\"shader\", vector (x, y, z))", [1.0, 2.0, 3.0], &[1.0, 2.0, 3.0]),
            ("vector (\"double\", x, y, z)", [1.0, 2.0, 3.0], &[2.0, 4.0, 6.0]),
        ],
    );
    check(
        ValueType::Point,
        &[
            ("transform (\"shader\", \"common\", point (x, y, z))", [1.0, 2.0, 3.0], &[11.0, 2.0, 3.0]),
            ("transform (\"shader\", point (x, y, z))", [11.0, 2.0, 3.0], &[1.0, 2.0, 3.0]),
            ("transform (\"shader\", \"double\", point (x, y, z))", [2.0, 2.0, 4.0], &[6.0, 1.0, 2.0]),
            ("transform (matrix (2), point (x, y, z))", [1.0, 2.0, 3.0], &[1.0, 2.0, 3.0]),
            (
                "transform (matrix (x, 0, 0, 0, 0, x, 0, 0, 0, 0, x, 0, 1, 2, 3, 1), point (x, y, z))",
                [2.0, 3.0, 4.0],
                &[5.0, 8.0, 11.0],
            ),
            (
                "transform (\"double\", matrix (\"shader\", 1), point (x, y, z))",
                [6.0, 1.0, 2.0],
                &[2.0, 2.0, 4.0],
            ),
            (
                "transform (matrix (\"double\", 1), \"shader\", point (x, y, z))",
                [6.0, 1.0, 2.0],
                &[2.0, 2.0, 4.0],
            ),
            (
                "transform (matrix (\"double\", 1), matrix (\"shader\", 1), point (x, y, z))",
                [6.0, 1.0, 2.0],
                &[2.0, 2.0, 4.0],
            ),
            ("point (\"shader\", x, y, z)", [0.0, 0.0, 0.0], &[10.0, 0.0, 0.0]),
            ("point (\"common\", x, y, z)", [1.0, 2.0, 3.0], &[1.0, 2.0, 3.0]),
            ("point (x)", [4.0, 0.0, 0.0], &[4.0, 4.0, 4.0]),
            (
                "rotate (point (x, y, z), M_PI_2, point (1, 0, 0), point (1, 0, 5))",
                [2.0, 0.0, 3.0],
                &[1.0, 1.0, 3.0],
            ),
        ],
    );
    check(
        ValueType::Normal,
        &[
            ("transformn (\"stretched\", \"common\", normal (x, y, z))", [1.0, 1.0, 1.0], &[1.0, 0.25, 0.5]),
            ("normal (\"stretched\", x, y, z)", [0.0, 4.0, 0.0], &[0.0, 1.0, 0.0]),
            // The matrix is the identity, which does not change normals.
            ("transformn (matrix (1), normal (x, y, z))", [1.0, 2.0, 3.0], &[1.0, 2.0, 3.0]),
        ],
    );
}

#[test]
fn color_functions_have_known_values() {
    check(
        ValueType::Color,
        &[
            ("color (\"hsv\", x, y, z)", [1.0 / 3.0, 1.0, 0.5], &[0.0, 0.5, 0.0]),
            ("color (\"hsv\", x, y, z)", [-2.0 / 3.0, 1.0, 0.5], &[0.0, 0.5, 0.0]),
            ("color (\"hsl\", x, y, z)", [2.0 / 3.0, 1.0, 0.5], &[0.0, 0.0, 1.0]),
            ("color (\"rgb\", x)", [0.25, 0.0, 0.0], &[0.25, 0.25, 0.25]),
            ("transformc (\"hsv\", color (x, y, z))", [0.0, 0.5, 0.0], &[1.0 / 3.0, 1.0, 0.5]),
            ("transformc (\"YIQ\", color (x, y, z))", [1.0, 1.0, 1.0], &[1.0, 0.0, 0.0]),
            ("transformc (\"xyz\", \"xyz\", color (x, y, z))", [1.0, 2.0, 3.0], &[1.0, 2.0, 3.0]),
        ],
    );
    let xyz = evaluate("transformc (\"hsv\", \"xyz\", color (x, y, z))", ValueType::Color, [0.7, 0.0, 1.0]);
    assert!((xyz[1] - 1.0).abs() < 1e-5, "{xyz:?}");
}

#[test]
fn matrix_functions_have_known_values() {
    check(
        ValueType::Float,
        &[
            ("determinant (matrix (x))", [2.0, 0.0, 0.0], &[16.0]),
            (
                "determinant (matrix (x, 0, 0, 0, 0, y, 0, 0, 0, 0, z, 0, 5, 6, 7, 1))",
                [2.0, 3.0, 4.0],
                &[24.0],
            ),
            ("(matrix (x) == x) + 10 * (matrix (x) != y)", [2.0, 3.0, 0.0], &[11.0]),
        ],
    );
    let row = |expression: &str, args, expected: [f32; 16]| {
        check(ValueType::Matrix, &[(expression, args, &expected)])
    };
    let mut identity = [0.0; 16];
    (0..4).for_each(|k| identity[5 * k] = 1.0);
    row("matrix (x)", [1.0, 0.0, 0.0], identity);
    row("1 / matrix (x)", [0.5, 0.0, 0.0], identity.map(|v| 2.0 * v));
    row("matrix (x) * matrix (y) / matrix (z)", [2.0, 6.0, 3.0], identity.map(|v| 4.0 * v));
    row("mix (matrix (x), matrix (y), z)", [2.0, 4.0, 0.5], identity.map(|v| 3.0 * v));
    let mut moved = identity;
    moved[12..15].copy_from_slice(&[10.0, 0.0, 0.0]);
    row("matrix (\"shader\", x)", [1.0, 0.0, 0.0], moved);
    let mut t = identity;
    t[3] = 10.0;
    row("transpose (matrix (\"shader\", x))", [1.0, 0.0, 0.0], t);
    // The new transformation is applied before the old one.
    let mut both = identity.map(|v| 2.0 * v);
    both[12..16].copy_from_slice(&[2.0, 4.0, 6.0, 1.0]);
    both[15] = 2.0;
    row("translate (matrix (2), point (x, y, z))", [1.0, 2.0, 3.0], both);
    let mut scaled = moved;
    scaled[0] = 2.0;
    scaled[5] = 3.0;
    scaled[10] = 4.0;
    row("scale (matrix (\"shader\", 1), point (x, y, z))", [2.0, 3.0, 4.0], scaled);
    let mut quarter = identity;
    (quarter[0], quarter[1], quarter[4], quarter[5]) = (0.0, 1.0, -1.0, 0.0);
    row("rotate (matrix (1), x, vector (y, 0, z))", [PI / 2.0, 0.0, 7.0], quarter);
}

#[test]
fn pattern_functions_have_known_values() {
    check(
        ValueType::Float,
        &[
            ("snoise (floor (x))", [7.3, 0.0, 0.0], &[0.0]),
            ("noise (floor (x), floor (y))", [7.3, -2.2, 0.0], &[0.5]),
            ("noise (point (floor (x), floor (y), floor (z)))", [7.3, -2.2, 1.0], &[0.5]),
            ("pnoise (x, y) - pnoise (x + y, y)", [0.25, 4.0, 0.0], &[0.0]),
            ("psnoise (x, y, 3, 5) - psnoise (x + 3, y - 10, 3, 5)", [0.25, 0.5, 0.0], &[0.0]),
            (
                "pnnoise (point (x, y, z), point (2, 3, 4)) - pnnoise (point (x + 2, y + 3, z - 4), point (2, 3, 4))",
                [0.25, 0.5, 0.75],
                &[0.0],
            ),
            (
                "psnoise (point (x, y, z), z, point (2), 8) - psnoise (point (x, y, z), z + 8, point (2), 8)",
                [0.25, 0.5, 0.75],
                &[0.0],
            ),
            ("noise (x, y) - (0.5 + 0.5 * snoise (x, y))", [0.3, 0.7, 0.0], &[0.0]),
            ("cnoise (x) - cnoise (floor (x))", [7.3, 0.0, 0.0], &[0.0]),
            (
                "cnoise (point (x, y, z), 4.5) - cnoise (point (floor (x), floor (y), floor (z)), 4)",
                [7.3, 1.1, -0.1],
                &[0.0],
            ),
            ("random (x) - random (x)", [7.3, 0.0, 0.0], &[0.0]),
            ("spline (x, 0, 1, 4, 2, 7)", [0.5, 0.0, 0.0], &[4.0]),
            ("spline (\"linear\", x, 0, 1, 4, 2, 7)", [0.25, 0.0, 0.0], &[2.5]),
            ("spline (\"bezier\", x, 0, 1, 2, 3)", [0.25, 0.0, 0.0], &[0.75]),
            ("spline (\"solvelinear\", x, 0, 0, 1, 3, 4, 4)", [2.0, 0.0, 0.0], &[0.5]),
            ("spline (x, y, y, z, z)", [9.0, 1.0, 3.0], &[3.0]),
            ("aastep (x, y, z)", [0.5, 0.5, 0.1], &[0.5]),
            ("aastep (x, y, z, \"filter\", \"box\")", [0.5, 0.525, 0.1], &[0.75]),
            ("aastep (x, y, z, \"filter\", \"box\", \"width\", 2)", [0.5, 0.55, 0.1], &[0.75]),
            ("aastep (x, y, z, \"filter\", \"triangle\")", [0.5, 0.525, 0.1], &[0.875]),
            ("aastep (x, y, z)", [0.5, 0.6, 0.1], &[1.0]),
            ("aastep (x, y)", [0.5, 0.4, 0.0], &[0.0]),
        ],
    );
    check(
        ValueType::Color,
        &[(
            "spline (x, color (0), color (1, y, z), color (2), color (3))",
            [0.0, 5.0, 6.0],
            &[1.0, 5.0, 6.0],
        )],
    );
    let c = evaluate("cnoise (x)", ValueType::Color, [3.5, 0.0, 0.0]);
    assert!(c[0] != c[1] && c[1] != c[2] && c.iter().all(|v| (0.0..1.0).contains(v)), "{c:?}");
}

#[test]
fn string_functions_have_known_values() {
    check(
        ValueType::Float,
        &[
            ("match (\"^a.c$\", format (\"a%dc\", x))", [7.0, 0.0, 0.0], &[1.0]),
            ("match (\"b\", \"abc\") + 10 * match (\"^b\", \"abc\")", [0.0; 3], &[1.0]),
            (
                "format (\"%g-%c\", x, color (y)) == \"0.5-1.000000 1.000000 1.000000\"",
                [0.5, 1.0, 0.0],
                &[1.0],
            ),
            ("concat (\"a\", substr (\"hello\", x, y), \"z\") == \"aellz\"", [1.0, 3.0, 0.0], &[1.0]),
            ("substr (\"hello\", x) == \"o\"", [-1.0, 0.0, 0.0], &[1.0]),
            (
                "(\"\" ? 1 : 0) + (\"a\" ? 10 : 0) + (\"a\" == \"a\" ? 100 : 0) + (\"a\" != \"b\" ? 1000 : 0)",
                [0.0; 3],
                &[1110.0],
            ),
        ],
    );
}

#[test]
fn units_convert_as_declared() {
    check(
        ValueType::Float,
        &[
            ("transformu (\"cm\", \"mm\", x)", [2.0, 0.0, 0.0], &[20.0]),
            ("transformu (\"mm\", x)", [2.0, 0.0, 0.0], &[10.0]),
            ("transformu (\"common\", \"m\", x)", [200.0, 0.0, 0.0], &[1.0]),
            // One "double" unit is two "common" ones, which are a centimetre.
            ("transformu (\"double\", \"cm\", x)", [3.0, 0.0, 0.0], &[3.0]),
            ("transformu (\"cm\", \"double\", x)", [3.0, 0.0, 0.0], &[3.0]),
            ("transformu (\"double\", \"shader\", x)", [3.0, 0.0, 0.0], &[6.0]),
        ],
    );
}

#[test]
fn grid_and_ray_functions_have_known_values() {
    let n = floats("r = gridn () * 100 + gridnu () * 10 + gridnv ();");
    assert_eq!(n[0], 632.0);
    assert_eq!(floats("r = gridindex ();"), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
    assert_eq!(
        floats("r = gridmin (u) + 10 * gridmax (u) + 100 * gridany (u > 2) + 1000 * gridany (u > 0.9);"),
        [1010.0; 6]
    );
    assert_eq!(floats("color c = gridmax (color (u, v, 3)); r = c[0] + c[1] + c[2];"), [5.0; 6]);
    assert_eq!(floats("if (u < 0.4) r = gridmax (u); else r = gridmin (u);"), [0.0, 0.5, 0.5, 0.0, 0.5, 0.5]);
    assert_eq!(floats("r = raylevel () + isshadowray () + isindirectray ();"), [0.0; 6]);
    assert_eq!(floats("float a[7]; r = arraylength (a);"), [7.0; 6]);
}

#[test]
fn random_numbers_are_repeatable_and_differ_by_point() {
    let a = floats("r = random ();");
    assert_eq!(a, floats("r = random ();"), "an image can be computed again");
    assert!(a.iter().all(|x| (0.0..1.0).contains(x)) && a[0] != a[1]);
    let two = floats("r = random (); float other = random (); r = r == other;");
    assert_eq!(two, [0.0; 6]);
    let g = floats("r = randomgrid ();");
    assert!(g.iter().all(|x| *x == g[0]));
    assert_eq!(floats("r = random (P) == random (P + 1);"), [0.0; 6]);
}

#[test]
fn fresnel_equals_the_formula() {
    let source = |what: &str| {
        format!(
            "float kr = 0, kt = 0; vector R = 0, T = 0; \
             fresnel (vector (0.6, 0, 0.8), normal (0, 0, -1), 1 / 1.5, kr, kt, R, T); r = {what};"
        )
    };
    assert!(near(floats(&source("kr + kt"))[0], 1.0));
    // Schlick's approximation is within a percent here.
    assert!((floats(&source("kr"))[0] - 0.043).abs() < 0.005);
    assert!(near(floats(&source("R[2]"))[0], -0.8));
    assert!(near(floats(&source("T[0]"))[5], 0.4));
}

#[test]
fn errors_are_reported_once_and_have_substitutes() {
    for (body, text, value) in [
        ("float a[2] = {5, 6}; r = a[u * 10];", "index 5 is outside of 0 to 1", 6.0),
        ("float a[2] = {5, 6}; a[-3 - v] = 7; r = a[0];", "index -3 is outside of 0 to 1", 7.0),
        (
            "point p = point (\"nowhere\", 1, 2, 3); r = p[0];",
            "there is no coordinate system \"nowhere\"",
            1.0,
        ),
        ("color c = color (\"cmyk\", 1, 2, 3); r = c[0];", "there is no color space \"cmyk\"", 1.0),
        ("matrix m = 1 / matrix (\"flat\", 1); r = m[0][0];", "a singular matrix has no inverse", 1.0),
        ("r = transformu (\"mm\", \"seconds\", 4);", "cannot convert \"mm\" to \"seconds\"", 4.0),
        ("r = transformu (\"m\", \"s\", 4);", "cannot convert \"m\" to \"s\"", 4.0),
        ("r = transformu (\"s\", \"double\", 4);", "cannot convert \"s\" to \"double\"", 4.0),
        ("r = match (\"(\", \"x\");", "\"(\" is not a regular expression", 0.0),
        ("r = spline (\"cubist\", 0, 1, 2, 3, 4);", "there is no spline basis \"cubist\"", 2.0),
        ("while (1 < 2) r = 3;", "a loop does not end", 3.0),
    ] {
        let mut services = Double::default();
        let got = floats_with(&format!("for (float k = 0; k < 3; ++k) {{ {body} }}"), &mut services);
        assert_eq!(got[5], value, "{body}");
        let errors = services.errors();
        assert!(errors.len() == 1 && errors[0].contains(text), "{body}: {errors:?}");
    }
}

#[test]
fn unsupported_functions_are_reported_once() {
    let mut services = Double::default();
    floats_with(
        "float x = 0; r = spatialdbquery (\"missing\", P, x); r = spatialdbquery (\"missing\", P, x); \
         spatialdbsave (\"missing\", P, x); color c = subsurface (\"missing\", P, N);",
        &mut services,
    );
    let said = ["spatialdbquery", "spatialdbsave", "subsurface"].map(|f| format!("{f} is not supported yet"));
    let mut errors = services.errors();
    errors.dedup();
    assert_eq!(errors, said);
}

/// Names of spaces, units, bases, messages and attributes may be computed, and then differ between points.
#[test]
fn names_may_differ_from_point_to_point() {
    let of = |a: &str, b: &str, expression: &str| {
        let body = format!("string s = u < 0.3 ? \"{a}\" : \"{b}\"; float x = 0; r = {expression};");
        let found = floats(&body);
        assert_eq!(found[..3], found[3..], "{body}");
        [found[0], found[1], found[2]]
    };
    assert_eq!(of("cm", "mm", "transformu (s, \"mm\", 1)"), [10.0, 1.0, 1.0]);
    assert_eq!(of("double", "world", "length (transform (s, \"common\", point (1, 0, 0)))"), [2.0, 1.0, 1.0]);
    assert_eq!(of("double", "world", "length (transformv (s, vector (2, 0, 0)))"), [1.0, 2.0, 2.0]);
    assert_eq!(of("double", "world", "length (vector (s, 1, 0, 0))"), [2.0, 1.0, 1.0]);
    assert_eq!(of("double", "world", "determinant (matrix (s, 1))"), [8.0, 1.0, 1.0]);
    assert_eq!(of("hsv", "rgb", "luminance (color (s, 0, 0, 1))"), [1.0, 0.072_192_32, 0.072_192_32]);
    assert_eq!(of("hsv", "rgb", "luminance (transformc (s, \"rgb\", color (0, 0, 1)))")[0], 1.0);
    assert_eq!(of("linear", "bezier", "spline (s, 0, 7, 1, 2, 3)"), [1.0, 7.0, 7.0]);
    assert_eq!(of("limits:eye", "none", "getattribute (s, x) * x"), [7.0, 0.0, 0.0]);
    assert_eq!(of("surface", "none", "getmessage (s, \"r\", x)"), [1.0, 0.0, 0.0]);
    // Two names that differ.
    let two = "string a = u < 0.3 ? \"cm\" : \"m\"; string b = u > 0.7 ? \"mm\" : \"cm\"; r = transformu (a, b, 1);";
    assert_eq!(floats(two)[..3], [1.0, 100.0, 1000.0]);
}

#[test]
fn arrays_are_printed_element_by_element() {
    let body = "float a[3] = { 1, 2, 3 }; color c[2] = { color (1), color (2) }; \
        string text = format (\"%g %g %g; %d; %.0c\", a, c); r = text == \"1 2 3; 1 1 1; 2 2 2\";";
    assert_eq!(floats(body), [1.0; 6]);
}
