// tidy: table
//! Functions of numbers (reference 5.8.2) and operators.

use super::*;
use Bound::{Terms, Ulp};
use Draw::{Any, Tame, Within};

const F: Option<ValueType> = Some(ValueType::Float);

fn truth(b: bool) -> f64 {
    f64::from(u8::from(b))
}

/// Returns a reference in single precision, for functions whose formula is the definition.
fn single(f: impl Fn(&[f32]) -> f32 + 'static) -> Exact {
    each(move |x| f64::from(f(&x.iter().map(|x| *x as f32).collect::<Vec<_>>())))
}

pub(super) fn rows() -> Vec<Row> {
    let one = |form: &'static str, expression: &str, bound: Bound, f: fn(f64) -> f64| {
        row(form, expression, &[(F, Any)], bound, each(move |x| f(x[0])))
    };
    let two = |form: &'static str, expression: &str, bound: Bound, f: fn(f64, f64) -> f64| {
        row(form, expression, &[(F, Any), (F, Any)], bound, each(move |x| f(x[0], x[1])))
    };
    let turns = |form: &'static str, expression: &str, f: fn(f64) -> f64| {
        // The bound is relative up to an eighth of a turn, and absolute beyond. Half a unit of 1 is 1.2e-7 / 2.
        let exact = each_scaled(move |x| {
            let v = f(x[0]);
            (v, if x[0].abs() <= std::f64::consts::FRAC_PI_4 { v.abs() } else { 0.5 })
        });
        row(form, expression, &[(F, Any)], Terms(2.0), exact)
    };
    let own: Arg = (None, Any);
    vec![
        one("radians (float)", "radians (a)", documented("`radians`"), f64::to_radians),
        one("degrees (float)", "degrees (a)", documented("`degrees`"), f64::to_degrees),
        turns("sin (float)", "sin (a)", f64::sin),
        turns("cos (float)", "cos (a)", f64::cos),
        one("tan (float)", "tan (a)", documented("`tan`"), f64::tan),
        one("asin (float)", "asin (a)", documented("`asin`"), |x| x.clamp(-1.0, 1.0).asin()),
        one("acos (float)", "acos (a)", documented("`acos`"), |x| x.clamp(-1.0, 1.0).acos()),
        one("atan (float)", "atan (a)", documented("`atan` of one"), f64::atan),
        two("atan (float, float)", "atan (a, b)", documented("`atan` of two"), f64::atan2),
        one("sinh (float)", "sinh (a)", documented("`sinh`"), f64::sinh),
        one("cosh (float)", "cosh (a)", documented("`cosh`"), f64::cosh),
        one("tanh (float)", "tanh (a)", documented("`tanh`"), f64::tanh),
        two("pow (float, float)", "pow (a, b)", documented("`pow`"), f64::powf),
        one("exp (float)", "exp (a)", documented("`exp`"), f64::exp),
        one("log (float)", "log (a)", documented("`log`"), f64::ln),
        one("log2 (float)", "log2 (a)", documented("`log2`"), f64::log2),
        one("log10 (float)", "log10 (a)", documented("`log10`"), f64::log10),
        two("log (float, float)", "log (a, b)", documented("`log` to a base"), |x, b| x.ln() / b.ln()),
        one("sqrt (float)", "sqrt (a)", Ulp(0.5), f64::sqrt),
        one("inversesqrt (float)", "inversesqrt (a)", documented("`inversesqrt`"), |x| 1.0 / x.sqrt()),
        two("hypot (float, float)", "hypot (a, b)", documented("`hypot`"), f64::hypot),
        row(
            "hypot (float, float, float)",
            "hypot (a, b, c)",
            &[(F, Any); 3],
            documented("`hypot`"),
            each(|x| x[0].hypot(x[1]).hypot(x[2])),
        ),
        one("abs (float)", "abs (a)", Ulp(0.0), f64::abs),
        one("fabs (float)", "fabs (a)", Ulp(0.0), f64::abs),
        one("sign (float)", "sign (a)", Ulp(0.0), |x| truth(x > 0.0) - truth(x < 0.0)),
        one("floor (float)", "floor (a)", Ulp(0.0), f64::floor),
        one("ceil (float)", "ceil (a)", Ulp(0.0), f64::ceil),
        one("round (float)", "round (a)", Ulp(0.0), f64::round),
        one("trunc (float)", "trunc (a)", Ulp(0.0), f64::trunc),
        row(
            "mod (float, float)",
            "mod (a, b)",
            &[(F, Any); 2],
            Ulp(0.0),
            single(|x| x[0] - x[1] * (x[0] / x[1]).floor()),
        ),
        // A NaN in the first argument is kept, and one in the second is ignored.
        row(
            "min (type, type)",
            "min (a, b)",
            &[own, own],
            Ulp(0.0),
            each(|x| if x[1] < x[0] { x[1] } else { x[0] }),
        ),
        row(
            "max (type, type)",
            "max (a, b)",
            &[own, own],
            Ulp(0.0),
            each(|x| if x[1] > x[0] { x[1] } else { x[0] }),
        ),
        row(
            "clamp (type, type, type)",
            "clamp (a, b, c)",
            &[own, own, own],
            Ulp(0.0),
            each(|x| {
                let v = if x[1] > x[0] { x[1] } else { x[0] };
                if x[2] < v { x[2] } else { v }
            }),
        ),
        row(
            "mix (type, type, float)",
            "mix (a, b, c)",
            &[(None, Tame), (None, Tame), (F, Tame)],
            Terms(2.0),
            each_scaled(|x| {
                let (p, q) = (x[0] * (1.0 - x[2]), x[1] * x[2]);
                (p + q, p.abs() + q.abs())
            }),
        ),
        one("isnan (float)", "isnan (a)", Ulp(0.0), |x| truth(x.is_nan())),
        one("isinf (float)", "isinf (a)", Ulp(0.0), |x| if x.is_infinite() { x.signum() } else { 0.0 }),
        one("finite (float)", "finite (a)", Ulp(0.0), |x| truth(x.is_finite())),
        one("erf (float)", "erf (a)", documented("`erf`"), libm::erf),
        one("erfc (float)", "erfc (a)", documented("`erfc`"), libm::erfc),
        two("step (float, float)", "step (a, b)", Ulp(0.0), |edge, x| truth(x >= edge)),
        row(
            "smoothstep (float, float, float)",
            "smoothstep (a, b, c)",
            &[(F, Tame), (F, Tame), (F, Tame)],
            documented("`smoothstep`"),
            each(|x| smoothstep(x[0], x[1], x[2])),
        ),
    ]
}

fn smoothstep(e0: f64, e1: f64, x: f64) -> f64 {
    if x <= e0 {
        return 0.0;
    }
    if x >= e1 {
        return 1.0;
    }
    let t = (x - e0) / (e1 - e0);
    t * t * (3.0 - 2.0 * t)
}

/// Returns operators and casts (reference 5.6) over all types.
pub(super) fn operators() -> Vec<Numbers> {
    let own: Arg = (None, Any);
    let two = |expression: &str, f: fn(f64, f64) -> f64| {
        numbers(expression, &[own, own], Ulp(0.5), each(move |x| f(x[0], x[1])))
    };
    let with_float = |expression: &str, f: fn(f64, f64) -> f64| {
        numbers(expression, &[own, (F, Any)], Ulp(0.5), each(move |x| f(x[0], x[1])))
    };
    let mut list = vec![
        two("a + b", |x, y| x + y),
        two("({T}) (a - b)", |x, y| x - y),
        two("a * b", |x, y| x * y),
        two("a / b", |x, y| x / y),
        with_float("a + b", |x, y| x + y),
        with_float("b - a", |x, y| y - x),
        with_float("a * b", |x, y| x * y),
        with_float("b / a", |x, y| y / x),
        numbers("-a", &[own], Ulp(0.0), each(|x| -x[0])),
        numbers("r = a; r += b;", &[own, own], Ulp(0.5), each(|x| x[0] + x[1])),
        numbers("r = a; r -= b;", &[own, own], Ulp(0.5), each(|x| x[0] - x[1])),
        numbers("r = a; r *= b;", &[own, own], Ulp(0.5), each(|x| x[0] * x[1])),
        numbers("r = a; r /= b;", &[own, own], Ulp(0.5), each(|x| x[0] / x[1])),
        numbers(
            "c > 0 ? a : b",
            &[own, own, (F, Any)],
            Ulp(0.0),
            each(|x| if x[2] > 0.0 { x[0] } else { x[1] }),
        ),
        numbers("({T}) a", &[(F, Any)], Ulp(0.0), Box::new(|_| Vec::new())),
        // Equality is that of all components, and NaN equals nothing. Small integers are often equal.
        equality("a == b", Any, true),
        equality("a == b", Draw::Whole, true),
        equality("a != b", Draw::Whole, false),
    ];
    // The cast of a float sets all components.
    list.retain(|n| n.expression != "({T}) a");
    for ty in [ValueType::Color, ValueType::Point, ValueType::Vector, ValueType::Normal] {
        for (other, word) in [
            (ValueType::Color, "color"),
            (ValueType::Point, "point"),
            (ValueType::Vector, "vector"),
            (ValueType::Normal, "normal"),
        ] {
            // The value is cast to another triple and back.
            let mut n =
                numbers(&format!("({{T}}) (({word}) a)"), &[(Some(other), Any)], Ulp(0.0), each(|x| x[0]));
            n.only = Some(ty);
            list.push(n);
        }
        let fills: Exact = Box::new(|x| vec![(x[0][0], 0.0); 3]);
        let mut n = numbers("({T}) a", &[(F, Any)], Ulp(0.0), fills);
        n.only = Some(ty);
        list.push(n);
        // Indices of components are rounded down.
        let mut n = numbers(
            "r = a; r[1.9] = b[2]; r[0] = a[1];",
            &[own, own],
            Ulp(0.0),
            Box::new(|x| [x[0][1], x[1][2], x[0][2]].map(|v| (v, 0.0)).to_vec()),
        );
        n.only = Some(ty);
        list.push(n);
    }
    type Relation = fn(f64, f64) -> bool;
    let relations: [(&str, Relation); 12] = [
        ("a < b", |x, y| x < y),
        ("a <= b", |x, y| x <= y),
        ("a > b", |x, y| x > y),
        ("a >= b", |x, y| x >= y),
        ("a && b", |x, y| x != 0.0 && y != 0.0),
        ("a || b", |x, y| x != 0.0 || y != 0.0),
        ("!a", |x, _| x == 0.0),
        ("!(a < b)", |x, y| x >= y || x.is_nan() || y.is_nan()),
        ("a < b && b < 1", |x, y| x < y && y < 1.0),
        ("a < b || b < 1", |x, y| x < y || y < 1.0),
        ("r = a++ < b;", |x, y| x < y),
        ("r = --a < b;", |x, y| f64::from(x as f32 - 1.0) < y),
    ];
    for (expression, relation) in relations {
        for from in [Any, Within(-1.0, 1.0), Draw::Whole] {
            // Parameters are read-only, so increments are applied to copies.
            let body = if expression.starts_with('r') {
                format!("float x = a; {}", expression.replace("a++", "x++").replace("--a", "--x"))
            } else {
                expression.to_owned()
            };
            let mut n =
                numbers(&body, &[(F, from), (F, from)], Ulp(0.0), each(move |x| truth(relation(x[0], x[1]))));
            n.only = F;
            list.push(n);
        }
    }
    list
}

/// Returns `==` or `!=` of the type itself, as a number in all components.
fn equality(expression: &str, from: Draw, equal: bool) -> Numbers {
    let exact: Exact = Box::new(move |x| {
        let same = x[0].iter().zip(&x[1]).all(|(a, b)| a == b);
        vec![(truth(same == equal), 0.0); x[0].len()]
    });
    numbers(&format!("({{T}}) (float) ({expression})"), &[(None, from), (None, from)], Bound::Ulp(0.0), exact)
}
