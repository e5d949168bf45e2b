//! Tests every form of every function of the standard library against closed forms in double precision.
//!
//! The compiler lists the forms ([`granita_gsl::overloads`]). A form without a reference here fails the test. Each
//! expression runs over its domain and the domain's edges, for every type that it can return. It runs in all lanes at
//! once, in a few lanes of many, lane by lane, with uniform arguments that linking folds, and unoptimised. All results
//! are the same to the bit, and as near to the reference as `docs/language.md` promises.

mod others;
mod patterns;
mod scalars;
mod spatial;

use crate::fixture::*;
use granita_base::{BaseType, Param, ParamType, Params};
use granita_gsl::ir::ValueType;
use granita_shade::*;
use std::collections::BTreeSet;

/// The range of the numbers of an argument.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Draw {
    /// All magnitudes of both signs, zeros, the smallest and largest, infinities, NaN.
    Any,
    /// Magnitudes from 1e-3 to 1e3 of both signs, and zero.
    Tame,
    /// Numbers between two numbers, both included.
    Within(f32, f32),
    /// Integers from -3 to 3.
    Whole,
    /// Vectors of length one.
    Direction,
    /// Matrices without projection, or any.
    Affine,
    Projective,
}

/// An argument: its type (`None` is that of the result) and its numbers.
pub(super) type Arg = (Option<ValueType>, Draw);

/// The largest permitted error of a result.
#[derive(Clone, Copy, Debug)]
pub(super) enum Bound {
    /// The bound is in units in the last place of the result.
    Ulp(f64),
    /// The bound is in units in the last place of the scale that the reference returns, which is its largest term.
    Terms(f64),
}

/// The function that returns the components of the reference, each with its scale.
pub(super) type Exact = Box<dyn Fn(&[Vec<f64>]) -> Vec<(f64, f64)>>;

/// One expression in `a`, `b`, `c` ... with its reference. The expression may also be a body that sets `r`. `{T}` is
/// the name of the result's type.
pub(super) struct Numbers {
    pub(super) expression: String,
    pub(super) args: Vec<Arg>,
    pub(super) bound: Bound,
    pub(super) exact: Exact,
    /// The only result type that is tested, if not all are.
    pub(super) only: Option<ValueType>,
}

/// The test of a form.
pub(super) enum How {
    Numbers(Vec<Numbers>),
    Test(fn()),
    /// The form is tested by another file of this suite. The first value is that file's text, and the second the call
    /// in it.
    Elsewhere(&'static str, &'static str),
}

pub(super) type Row = (&'static str, How);

pub(super) fn numbers(expression: &str, args: &[Arg], bound: Bound, exact: Exact) -> Numbers {
    Numbers { expression: expression.to_owned(), args: args.to_vec(), bound, exact, only: None }
}

/// Returns a form with one expression.
pub(super) fn row(form: &'static str, expression: &str, args: &[Arg], bound: Bound, exact: Exact) -> Row {
    (form, How::Numbers(vec![numbers(expression, args, bound, exact)]))
}

/// Applies the same function to the numbers of each component.
pub(super) fn each(f: impl Fn(&[f64]) -> f64 + 'static) -> Exact {
    each_scaled(move |x| {
        let v = f(x);
        (v, v.abs())
    })
}

pub(super) fn each_scaled(f: impl Fn(&[f64]) -> (f64, f64) + 'static) -> Exact {
    Box::new(move |args| {
        let n = args.iter().map(Vec::len).max().unwrap_or(1);
        (0..n)
            .map(|c| f(&args.iter().map(|a| a[if a.len() == 1 { 0 } else { c }]).collect::<Vec<_>>()))
            .collect()
    })
}

/// Returns the bound that the manual promises for a function, by its name in the manual's table.
pub(super) fn documented(name: &str) -> Bound {
    const MANUAL: &str = include_str!("../../../../../docs/language.md");
    let line = MANUAL.lines().find(|l| {
        let cell = l.split('|').nth(1).unwrap_or("");
        l.starts_with("| `") && l.matches('|').count() == 3 && cell.contains(name)
    });
    let line = line.unwrap_or_else(|| panic!("the manual says nothing about {name}"));
    let cell = line.split('|').nth(2).expect("a second column").trim();
    let number: String = cell.chars().take_while(|c| c.is_ascii_digit() || *c == '.').collect();
    Bound::Ulp(number.parse().unwrap_or_else(|_| panic!("{line}")))
}

fn hash(words: &[u32]) -> u32 {
    granita_base::hash::words(words)
}

/// Returns all kinds of numbers.
pub(super) fn any_numbers() -> Vec<f32> {
    let mut list = vec![f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, -0.0, f32::MAX, f32::MIN];
    list.extend([
        f32::MIN_POSITIVE,
        -f32::MIN_POSITIVE,
        1e-45,
        -1e-45,
        88.7,
        -103.0,
        0.999_999_9,
        1.000_000_1,
    ]);
    list.extend([
        0.25,
        0.5,
        1.0,
        1.5,
        2.0,
        2.5,
        -0.5,
        -1.0,
        -1.5,
        -2.5,
        0.499_999_97,
        8_388_607.5,
        16_777_216.0,
    ]);
    list.extend([
        std::f32::consts::PI,
        std::f32::consts::FRAC_PI_2,
        -std::f32::consts::FRAC_PI_4,
        355.0,
        8192.5,
    ]);
    list.extend((-60..=60).map(|k| k as f32 * 0.173));
    for k in 0..500 {
        let t = -45.0 + 84.0 * (k as f32 + 0.5) / 500.0;
        let x = 10.0_f64.powf(f64::from(t)) as f32;
        list.extend([x, -x]);
    }
    for k in 0..300 {
        let x = 10.0_f32.powf(-2.0 + 4.0 * k as f32 / 300.0);
        list.extend([x, -x]);
    }
    list
}

/// Returns one argument of point `k`.
fn draw(list: &[f32], from: Draw, size: usize, k: usize, arg: usize) -> Vec<f32> {
    let unit =
        |c: usize, salt: u32| f64::from(hash(&[k as u32, arg as u32, c as u32, salt])) / f64::from(u32::MAX);
    let between = |c: usize, a: f64, b: f64| (a + (b - a) * unit(c, 1)) as f32;
    let one = |c: usize| match from {
        Draw::Any => list[(unit(c, 2) * (list.len() - 1) as f64).round() as usize],
        Draw::Tame if unit(c, 3) < 0.04 => 0.0,
        Draw::Tame => {
            let size = 10.0_f64.powf(-3.0 + 6.0 * unit(c, 4)) as f32;
            if unit(c, 5) < 0.5 { -size } else { size }
        }
        // The ends of the range are included.
        Draw::Within(a, b) => match unit(c, 6) {
            t if t < 0.03 => a,
            t if t < 0.06 => b,
            _ => between(c, f64::from(a), f64::from(b)),
        },
        Draw::Whole => (unit(c, 7) * 6.0).round() as f32 - 3.0,
        Draw::Direction => between(c, -1.0, 1.0),
        Draw::Affine if c % 4 == 3 => f32::from(u8::from(c == 15)),
        Draw::Affine | Draw::Projective => between(c, -2.0, 2.0),
    };
    let mut v: Vec<f32> = (0..size).map(one).collect();
    if from == Draw::Direction {
        let length = v.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt().max(1e-9);
        v.iter_mut().for_each(|x| *x = (f64::from(*x) / length) as f32);
    }
    v
}

const NAMES: [&str; 8] = ["a", "b", "c", "d", "e", "f", "g", "h"];

fn source(body: &str, types: &[ValueType], result: ValueType) -> String {
    let params: String =
        types.iter().zip(NAMES).map(|(ty, name)| format!("{} {name} = 0, ", ty.word())).collect();
    format!("surface t ({params}output {} r = 0) {{ {body} }}", result.word())
}

fn group(source: &str, params: &Params, optimize: bool) -> Group {
    let layer = LayerSource { module: module(source), params, name: None };
    Group::link_with(&[layer], &[], LinkOptions { optimize }, &mut |_, text| panic!("{text}\n{source}"))
        .expect("a group")
}

/// Returns the results for each point.
fn values(
    group: &Group,
    points: &[Vec<Vec<f32>>],
    types: &[ValueType],
    result: ValueType,
    executor: &mut Executor,
) -> Vec<Vec<f32>> {
    let n = points.len();
    let mut grid = Grid::new(Topology::Scattered { n });
    grid.ng = Lanes3::splat(-granita_base::Vec3::Z, n);
    for (k, ty) in types.iter().enumerate() {
        let size = ty.components();
        let values = (0..size).flat_map(|c| points.iter().map(move |p| p[k][c])).collect();
        grid.primvars.push(Primvar {
            name: NAMES[k].into(),
            ty: param_type(*ty),
            data: PrimvarData::Floats { values, varying: true },
        });
    }
    outputs(group, &mut grid, result, executor)
}

/// Returns `r` of every lane.
fn outputs(group: &Group, grid: &mut Grid, result: ValueType, executor: &mut Executor) -> Vec<Vec<f32>> {
    let out = executor.run(group, grid, &mut Double::default(), &[("r", result)]).pop();
    let (out, n) = (out.flatten().expect("an output"), grid.len());
    (0..n).map(|i| (0..result.components()).map(|c| out[c * n + i]).collect()).collect()
}

fn param_type(ty: ValueType) -> ParamType {
    ParamType::of(ty.base_type().unwrap_or(BaseType::Float))
}

fn bits(v: &[f32]) -> Vec<u32> {
    v.iter().map(|x| if x.is_nan() { u32::MAX } else { x.to_bits() }).collect()
}

/// Returns the unit in the last place of a number.
fn unit(x: f64) -> f64 {
    let x = (x.abs() as f32).min(f32::MAX);
    f64::from(f32::from_bits(x.to_bits() + 1)) - f64::from(x)
}

/// Returns the error of a result in the bound's units. It is infinite where the result is of another kind.
fn error(got: f32, (wanted, scale): (f64, f64), bound: Bound) -> f64 {
    let nearest = wanted as f32;
    if got == nearest || got.is_nan() && nearest.is_nan() {
        return 0.0;
    }
    if let Bound::Terms(_) = bound {
        // The result is beyond the range of floats, or the reference does not define it.
        if scale.is_nan() || scale > 1e37 || !nearest.is_finite() && !got.is_finite() {
            return 0.0;
        }
    }
    if !got.is_finite() || !nearest.is_finite() {
        return f64::INFINITY;
    }
    let by = if let Bound::Terms(_) = bound { scale } else { wanted };
    (f64::from(got) - wanted).abs() / unit(by)
}

/// Checks an expression for one result type. Returns the largest error.
fn check(n: &Numbers, result: ValueType) -> f64 {
    let expression = n.expression.replace("{T}", result.word());
    let body = if expression.contains(';') { expression.clone() } else { format!("r = {expression};") };
    let types: Vec<ValueType> = n.args.iter().map(|(ty, _)| ty.unwrap_or(result)).collect();
    let list = any_numbers();
    // With one argument the points are the whole list in order.
    let all = types == [ValueType::Float] && n.args[0].1 == Draw::Any;
    let count = if all { list.len() } else { 400 };
    let points: Vec<Vec<Vec<f32>>> = (0..count)
        .map(|k| {
            if all {
                return vec![vec![list[k]]];
            }
            let sizes = types.iter().zip(&n.args).enumerate();
            sizes.map(|(i, (ty, (_, from)))| draw(&list, *from, ty.components(), k, i)).collect()
        })
        .collect();
    let text = source(&body, &types, result);
    let none = Params::new();
    let mut executor = Executor::new();
    let better = group(&text, &none, true);
    let got = values(&better, &points, &types, result, &mut executor);
    let same = |other: &[Vec<f32>], mine: &[Vec<f32>], how: &str| {
        for (k, (a, b)) in other.iter().zip(mine).enumerate() {
            assert_eq!(bits(a), bits(b), "{expression} {how}: {a:?}, not {b:?} at {:?}", points[k]);
        }
    };
    let plain = values(&group(&text, &none, false), &points, &types, result, &mut executor);
    same(&plain, &got, "unoptimised");
    let some = source(
        &format!("float lane = gridindex (); if (lane - 7 * floor (lane / 7) == 3) {{ {body} }}"),
        &types,
        result,
    );
    let few = values(&group(&some, &none, true), &points, &types, result, &mut executor);
    for k in (3..count).step_by(7) {
        same(&few[k..=k], &got[k..=k], "in few lanes");
    }
    for k in (0..count).step_by(count.div_ceil(100)) {
        let alone = values(&better, &points[k..=k], &types, result, &mut executor);
        assert_eq!(bits(&alone[0]), bits(&got[k]), "{expression} alone at {:?}", points[k]);
    }
    for k in (0..count).step_by(count.div_ceil(10)) {
        // Points and matrices of an instance are in "shader" space, which differs from "common" space.
        let placed = |i: usize| matches!(types[i], ValueType::Point | ValueType::Matrix);
        let given: Params = (0..types.len())
            .filter(|i| !placed(*i))
            .map(|i| Param {
                name: NAMES[i].into(),
                ty: param_type(types[i]),
                data: points[k][i].as_slice().into(),
            })
            .collect();
        for optimize in [true, false] {
            let folded = group(&text, &given, optimize);
            let mut grid = Grid::new(Topology::Scattered { n: 3 });
            grid.ng = Lanes3::splat(-granita_base::Vec3::Z, 3);
            for i in (0..types.len()).filter(|i| placed(*i)) {
                grid.primvars.push(Primvar {
                    name: NAMES[i].into(),
                    ty: param_type(types[i]),
                    data: PrimvarData::Floats { values: points[k][i].clone(), varying: false },
                });
            }
            let alone = outputs(&folded, &mut grid, result, &mut executor);
            assert_eq!(bits(&alone[1]), bits(&got[k]), "{expression} with uniform {:?}", points[k]);
        }
    }
    let mut worst = 0.0_f64;
    let (Bound::Ulp(most) | Bound::Terms(most)) = n.bound;
    for (point, got) in points.iter().zip(&got) {
        let wide: Vec<Vec<f64>> = point.iter().map(|v| v.iter().map(|x| f64::from(*x)).collect()).collect();
        let wanted = (n.exact)(&wide);
        assert_eq!(wanted.len(), got.len(), "{expression}");
        for (got, wanted) in got.iter().zip(wanted) {
            let e = error(*got, wanted, n.bound);
            assert!(
                e <= most,
                "{expression} of {point:?}: {got:e}, not {:e} (error {e:.2}, {:?} allowed)",
                wanted.0,
                n.bound
            );
            worst = worst.max(e);
        }
    }
    worst
}

/// Runs a test. Returns its panic message as the error.
fn tried(test: impl FnOnce() -> f64) -> Result<f64, String> {
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(test)).map_err(|what| {
        let text = what.downcast_ref::<String>().map(String::as_str);
        text.or_else(|| what.downcast_ref::<&str>().copied()).unwrap_or("a panic").to_owned()
    })
}

/// Runs all rows of one file, even after failures. `cargo test forms -- --nocapture` prints the largest errors.
#[allow(clippy::print_stdout, reason = "the errors that were found, for who asks")]
fn check_rows(rows: Vec<Row>) {
    let mut report = String::new();
    let mut wrong = String::new();
    for (form, how) in rows {
        let results = granita_gsl::overloads().find(|o| o.form == form).map(|o| o.results);
        let mut results = results.unwrap_or_else(|| panic!("there is no form {form}"));
        if results.is_empty() {
            results.push(ValueType::Float);
        }
        match how {
            How::Numbers(list) => {
                for n in list {
                    let of = results.iter().filter(|ty| n.only.is_none_or(|only| only == **ty));
                    let worst = tried(|| of.map(|ty| check(&n, *ty)).fold(0.0, f64::max));
                    match worst {
                        Ok(worst) => {
                            report += &format!("{:<44} {worst:>6.2} of {:?}\n", n.expression, n.bound)
                        }
                        Err(what) => wrong += &format!("{what}\n"),
                    }
                }
            }
            How::Test(test) => {
                if let Err(what) = tried(|| {
                    test();
                    0.0
                }) {
                    wrong += &format!("{form}: {what}\n");
                }
            }
            How::Elsewhere(text, call) if !text.contains(call) => {
                wrong += &format!("{form}: nothing calls {call}\n");
            }
            How::Elsewhere(..) => {}
        }
    }
    println!("{report}");
    assert!(wrong.is_empty(), "\n{wrong}");
}

#[test]
fn every_form_of_a_function_has_a_reference() {
    let here: Vec<&str> = [scalars::rows(), spatial::rows(), patterns::rows(), others::rows()]
        .iter()
        .flatten()
        .map(|r| r.0)
        .collect();
    let forms: Vec<String> = granita_gsl::overloads().map(|o| o.form).collect();
    let tested: BTreeSet<&str> = here.iter().copied().collect();
    let known: BTreeSet<&str> = forms.iter().map(String::as_str).collect();
    let missing: Vec<_> = known.difference(&tested).collect();
    let unknown: Vec<_> = tested.difference(&known).collect();
    assert!(missing.is_empty() && unknown.is_empty(), "without a test: {missing:#?}\nunknown: {unknown:#?}");
    assert_eq!(here.len(), forms.len(), "a form stands twice");
}

#[test]
fn scalar_functions_equal_their_references() {
    check_rows(scalars::rows());
}

#[test]
fn spatial_functions_equal_their_references() {
    check_rows(spatial::rows());
}

#[test]
fn pattern_functions_equal_their_references() {
    check_rows(patterns::rows());
}

#[test]
fn other_functions_equal_their_references() {
    check_rows(others::rows());
}

/// Operators, comparisons, casts and constructors are not functions.
#[test]
fn operators_and_casts_equal_their_references() {
    for n in scalars::operators() {
        let types = match n.only {
            Some(only) => vec![only],
            None => vec![
                ValueType::Float,
                ValueType::Color,
                ValueType::Point,
                ValueType::Vector,
                ValueType::Normal,
            ],
        };
        types.into_iter().for_each(|ty| _ = check(&n, ty));
    }
    for n in spatial::constructors() {
        let ty = n.only.expect("a type");
        check(&n, ty);
    }
}
