//! Functions of numbers against double precision, over their domain and its edges: all lanes at once, one by
//! one, and with unoptimised code.

use crate::fixture::*;
use granita_base::Params;
use granita_gsl::ir::ValueType;
use granita_shade::{Executor, Grid, Group, LayerSource, LinkOptions, Topology};

/// Ordinary numbers, small and large ones, and those that are none.
fn numbers() -> Vec<f32> {
    let mut list: Vec<f32> = (-60..=60).map(|k| k as f32 * 0.173).collect();
    for x in [0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 2.5, 10.0, 100.0, 1e-10, 1e-30, 1e-42, 1e4, 1e10, 1e30, f32::MAX]
    {
        list.extend([x, -x]);
    }
    list.extend([
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::NAN,
        88.7,
        -103.0,
        0.999_999_9,
        1.000_000_1,
        std::f32::consts::PI,
    ]);
    list
}

/// The group of `r = EXPRESSION` in `u` and `v`.
fn group(expression: &str, optimize: bool) -> Group {
    let source = format!("surface t (output float r = 0) {{ r = {expression}; }}");
    let params = Params::new();
    let layer = LayerSource { module: module(&source), params: &params, name: None };
    Group::link_with(&[layer], &[], LinkOptions { optimize }, &mut |_, text| panic!("{text}"))
        .expect("a group")
}

fn values(group: &Group, points: &[(f32, f32)]) -> Vec<f32> {
    let mut grid = Grid::new(Topology::Scattered { n: points.len() });
    grid.u = points.iter().map(|p| p.0).collect();
    grid.v = points.iter().map(|p| p.1).collect();
    let wanted = [("r", ValueType::Float)];
    let result = Executor::new().run(group, &mut grid, &mut Double::default(), &wanted).pop();
    result.flatten().expect("an output")
}

/// Distance of `got` from the true value in units in the last place.
fn ulps(got: f32, exact: f64) -> f64 {
    let nearest = exact as f32;
    if got == nearest || got.is_nan() && nearest.is_nan() {
        return 0.0;
    }
    if !got.is_finite() || !nearest.is_finite() {
        return f64::INFINITY;
    }
    let unit = f64::from(f32::from_bits(nearest.abs().to_bits() + 1)) - f64::from(nearest.abs());
    (f64::from(got) - exact).abs() / unit.max(f64::from(f32::from_bits(1)))
}

fn bits(list: &[f32]) -> Vec<u32> {
    list.iter().map(|x| if x.is_nan() { 1 } else { x.to_bits() }).collect()
}

/// Checks an expression in `u` and `v` at points.
fn check(expression: &str, points: &[(f32, f32)], most: f64, exact: impl Fn(f64, f64) -> f64) {
    let better = group(expression, true);
    let all = values(&better, points);
    assert_eq!(bits(&all), bits(&values(&group(expression, false), points)), "{expression}, unoptimised");
    for (point, got) in points.iter().zip(&all) {
        let alone = values(&better, &[*point]);
        assert_eq!(bits(&alone), bits(&[*got]), "{expression} of {point:?} alone");
        let wanted = exact(f64::from(point.0), f64::from(point.1));
        let error = ulps(*got, wanted);
        assert!(
            error <= most,
            "{expression} of {point:?}: {got}, not {wanted} ({error} ulp, {most} allowed)"
        );
    }
}

#[test]
fn functions_of_one_number() {
    let points: Vec<(f32, f32)> = numbers().into_iter().map(|x| (x, 0.0)).collect();
    type Exact = fn(f64) -> f64;
    let table: [(&str, f64, Exact); 28] = [
        ("radians (u)", 1.0, f64::to_radians),
        ("degrees (u)", 1.0, f64::to_degrees),
        ("tan (u)", 4.0, f64::tan),
        ("asin (u)", 3.0, |x| x.clamp(-1.0, 1.0).asin()),
        ("acos (u)", 3.0, |x| x.clamp(-1.0, 1.0).acos()),
        ("atan (u)", 3.0, f64::atan),
        ("sinh (u)", 2.0, f64::sinh),
        ("cosh (u)", 2.0, f64::cosh),
        ("tanh (u)", 2.0, f64::tanh),
        ("exp (u)", 2.0, f64::exp),
        ("log (u)", 2.0, f64::ln),
        ("log2 (u)", 1.5, f64::log2),
        ("log10 (u)", 1.5, f64::log10),
        ("sqrt (u)", 0.5, f64::sqrt),
        ("inversesqrt (u)", 1.5, |x| 1.0 / x.sqrt()),
        ("abs (u)", 0.0, f64::abs),
        ("fabs (u)", 0.0, f64::abs),
        ("sign (u)", 0.0, |x| {
            if x > 0.0 {
                1.0
            } else if x < 0.0 {
                -1.0
            } else {
                0.0
            }
        }),
        ("floor (u)", 0.0, f64::floor),
        ("ceil (u)", 0.0, f64::ceil),
        ("round (u)", 0.0, f64::round),
        ("trunc (u)", 0.0, f64::trunc),
        ("isnan (u)", 0.0, |x| f64::from(u8::from(x.is_nan()))),
        ("isinf (u)", 0.0, |x| if x.is_infinite() { x.signum() } else { 0.0 }),
        ("finite (u)", 0.0, |x| f64::from(u8::from(x.is_finite()))),
        ("-u", 0.0, |x| -x),
        ("u * u", 0.5, |x| x * x),
        ("1 / u", 0.5, |x| 1.0 / x),
    ];
    for (expression, most, exact) in table {
        check(expression, &points, most, |x, _| exact(x));
    }
    // Far from their zeros sines are as exact as their results; near them the error is absolute.
    for (expression, exact) in [("sin (u)", f64::sin as Exact), ("cos (u)", f64::cos)] {
        for (point, got) in points.iter().zip(values(&group(expression, true), &points)) {
            let wanted = exact(f64::from(point.0));
            let fits = (f64::from(got) - wanted).abs() < 1.2e-7 || got.is_nan() && wanted.is_nan();
            assert!(fits, "{expression} of {point:?}: {got}, not {wanted}");
        }
    }
}

#[test]
fn functions_of_two_numbers() {
    let some: Vec<f32> = numbers().into_iter().step_by(4).collect();
    let points: Vec<(f32, f32)> = some.iter().flat_map(|x| some.iter().map(|y| (*x, *y))).collect();
    let points: Vec<(f32, f32)> = points.into_iter().step_by(3).collect();
    type Exact = fn(f64, f64) -> f64;
    let table: [(&str, f64, Exact); 10] = [
        ("u + v", 0.5, |x, y| x + y),
        ("u - v", 0.5, |x, y| x - y),
        ("u * v", 0.5, |x, y| x * y),
        ("u / v", 0.5, |x, y| x / y),
        ("pow (u, v)", 1.0, f64::powf),
        ("atan (u, v)", 4.0, f64::atan2),
        ("hypot (u, v)", 1.0, f64::hypot),
        ("step (u, v)", 0.0, |e, x| f64::from(u8::from(x >= e))),
        ("u < v ? 1 : 0", 0.0, |x, y| f64::from(u8::from(x < y))),
        ("u != v ? 1 : 0", 0.0, |x, y| f64::from(u8::from(x != y))),
    ];
    for (expression, most, exact) in table {
        check(expression, &points, most, exact);
    }
    // By their definitions, in single precision: the formula is the reference.
    type Formula = fn(f32, f32) -> f32;
    let table: [(&str, Formula); 5] = [
        ("mod (u, v)", |a, b| a - b * (a / b).floor()),
        ("min (u, v)", |a, b| if b < a { b } else { a }),
        ("max (u, v)", |a, b| if b > a { b } else { a }),
        ("clamp (u, -1, 2)", |x, _| {
            let x = if -1.0 > x { -1.0 } else { x };
            if 2.0 < x { 2.0 } else { x }
        }),
        ("mix (u, v, 0.25)", |x, y| x * 0.75 + y * 0.25),
    ];
    for (expression, formula) in table {
        check(expression, &points, 0.0, |x, y| f64::from(formula(x as f32, y as f32)));
    }
}
