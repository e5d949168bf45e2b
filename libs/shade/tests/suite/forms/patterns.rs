// tidy: table
//! Steps, noises, random numbers and splines (reference 5.8.6), and antialiased steps (5.8.7).

use super::*;
use Bound::{Terms, Ulp};
use Draw::{Any, Tame, Within};
use granita_base::hash::mix32;

const F: Option<ValueType> = Some(ValueType::Float);
const P: Option<ValueType> = Some(ValueType::Point);

// Noise by its description, corner by corner in double precision.

fn chain(h: u32, i: i32) -> u32 {
    mix32(h ^ i as u32).wrapping_add(0x9e37_79b9)
}

fn cell(x: f64) -> (i32, f64) {
    // Numbers beyond the lattice are at its last point, and NaN is at 0.
    let i = x.floor() as i32;
    let t = x - x.floor();
    (i, if x.abs() < 2_147_483_648.0 { t } else { 0.0 })
}

fn gradient(h: u32, d: &[f64]) -> f64 {
    let turn = |bit: usize, x: f64| if h >> bit & 1 == 1 { -x } else { x };
    match d.len() {
        1 => (f64::from(h >> 8) / 8_388_608.0 - 1.0) * d[0],
        2 => match h >> 30 {
            0 => turn(0, d[0]),
            1 => turn(0, d[1]),
            _ => (turn(0, d[0]) + turn(1, d[1])) / std::f64::consts::SQRT_2,
        },
        n => {
            let left_out = (((h >> 16) * n as u32) >> 16) as usize;
            (0..n).filter(|k| *k != left_out).map(|k| turn(k, d[k])).sum()
        }
    }
}

/// Returns the signed noise at `x`. `periods` may be empty.
fn signed(x: &[f64], periods: &[f64], component: usize) -> f64 {
    let n = x.len();
    let cells: Vec<(i32, f64)> = x.iter().map(|x| cell(*x)).collect();
    let mut sum = 0.0;
    for corner in 0..1 << n {
        let mut h = chain(0x736e_6f69, component as i32 ^ ((n as i32) << 8));
        let (mut weight, mut offset) = (1.0, Vec::new());
        for (k, (i, t)) in cells.iter().enumerate() {
            let side = corner >> k & 1;
            let mut i = i.wrapping_add(side);
            if let Some(p) = periods.get(k) {
                let p = if p.floor() >= 1.0 { p.floor().min(2_147_483_647.0) as i64 } else { 1 };
                i = i64::from(i).rem_euclid(p) as i32;
            }
            h = chain(h, i);
            let fade = t.powi(3) * (t * (t * 6.0 - 15.0) + 10.0);
            weight *= if side == 1 { fade } else { 1.0 - fade };
            offset.push(t - f64::from(side));
        }
        sum += weight * gradient(mix32(h), &offset);
    }
    let scale = [2.0, std::f64::consts::SQRT_2, 1.0 / 1.036_354, 1.0 / 1.5355][n - 1];
    (sum * scale).clamp(-1.0, 1.0)
}

fn cellular(x: &[f64], component: usize) -> f64 {
    let seed = chain(0x636e_6f69, component as i32 ^ ((x.len() as i32) << 8));
    let h = x.iter().fold(seed, |h, x| chain(h, cell(*x).0));
    (f64::from(mix32(h) >> 9) + 0.5) / 8_388_608.0
}

/// Adds all forms of one noise. Each component of the result has its own lattice.
fn noises(list: &mut Vec<Row>, forms: [&'static str; 4], word: &str, unsigned: bool, cells: bool) {
    let shapes: [&[Arg]; 4] = [&[(F, Any)], &[(F, Any), (F, Any)], &[(P, Any)], &[(P, Any), (F, Any)]];
    let near: [&[Arg]; 4] = [
        &[(F, Within(-9.0, 9.0))],
        &[(F, Within(-9.0, 9.0)), (F, Within(-9.0, 9.0))],
        &[(P, Within(-9.0, 9.0))],
        &[(P, Within(-9.0, 9.0)), (F, Within(-9.0, 9.0))],
    ];
    for (k, form) in forms.into_iter().enumerate() {
        let mut rows = Vec::new();
        for args in [shapes[k], near[k]] {
            for ty in
                [ValueType::Float, ValueType::Color, ValueType::Point, ValueType::Vector, ValueType::Normal]
            {
                let exact: Exact = Box::new(move |x| {
                    let x: Vec<f64> = x.iter().flatten().copied().collect();
                    (0..ty.components())
                        .map(|c| {
                            if cells {
                                return (cellular(&x, c), 0.0);
                            }
                            let v = signed(&x, &[], c);
                            (if unsigned { 0.5 + 0.5 * v } else { v }, 1.0)
                        })
                        .collect()
                });
                let names = ["a", "a, b"][args.len() - 1];
                let bound = if cells { Ulp(0.5) } else { Terms(16.0) };
                let mut n = numbers(&format!("{word} ({names})"), args, bound, exact);
                n.only = Some(ty);
                rows.push(n);
            }
        }
        list.push((form, How::Numbers(rows)));
    }
}

fn periodic(list: &mut Vec<Row>, forms: [&'static str; 4], word: &str, unsigned: bool) {
    let x = Within(-9.0, 9.0);
    let p = Within(-1.0, 5.5);
    let shapes: [&[Arg]; 4] = [
        &[(F, x), (F, p)],
        &[(F, x), (F, x), (F, p), (F, p)],
        &[(P, x), (P, p)],
        &[(P, x), (F, x), (P, p), (F, p)],
    ];
    for (k, form) in forms.into_iter().enumerate() {
        let any: Vec<Arg> = shapes[k].iter().map(|(ty, _)| (*ty, Any)).collect();
        let mut rows = Vec::new();
        for args in [shapes[k].to_vec(), any] {
            for ty in
                [ValueType::Float, ValueType::Color, ValueType::Point, ValueType::Vector, ValueType::Normal]
            {
                let exact: Exact = Box::new(move |x| {
                    let (x, periods) = x.split_at(x.len() / 2);
                    let flat = |v: &[Vec<f64>]| v.iter().flatten().copied().collect::<Vec<_>>();
                    let (x, periods) = (flat(x), flat(periods));
                    (0..ty.components())
                        .map(|c| {
                            let v = signed(&x, &periods, c);
                            (if unsigned { 0.5 + 0.5 * v } else { v }, 1.0)
                        })
                        .collect()
                });
                let names = ["", "a, b", "", "a, b, c, d"][args.len() - 1];
                let mut n = numbers(&format!("{word} ({names})"), &args, Terms(16.0), exact);
                n.only = Some(ty);
                rows.push(n);
            }
        }
        list.push((form, How::Numbers(rows)));
    }
}

/// A shift by a whole number of periods does not change the result, to the bit, where the sum is exact.
#[test]
fn noise_repeats_exactly_after_whole_periods() {
    for (x, shift) in [(0.25, 3.0), (-2.75, -9.0), (7.5, 300.0)] {
        for word in ["pnoise", "pnnoise", "psnoise"] {
            let moved = x + shift;
            for (a, b) in [
                (format!("{word} ({x}, 3)"), format!("{word} ({moved}, 3.9)")),
                (format!("{word} (0.5, {x}, 7, 3)"), format!("{word} (-6.5, {moved}, 7, 3)")),
                (format!("{word} (point ({x}, 0.125, {x}), point (3, 2, 1))"), {
                    format!("{word} (point ({moved}, 4.125, {x} + 5), point (3, 2, 1))")
                }),
                (format!("{word} (point ({x}), 0.25, point (3), 4)"), {
                    format!("{word} (point ({moved}), 8.25, point (3), 4)")
                }),
            ] {
                let r = floats(&format!("color one = {a}, other = {b}; r = one == other;"));
                assert_eq!(r, [1.0; 6], "{a} {b}");
            }
        }
    }
}

fn random_is_a_hash() {
    // The numbers are within (0, 1), evenly distributed, different for different arguments, and the same for the same,
    // in every component.
    for (argument, other) in [("u * 1000", "u * 1000 + 0.001"), ("P * 1000", "P * 1000 + 0.001")] {
        let source = format!(
            "surface t (output color r = 0, output float same = 0) {{ r = random ({argument}); \
             color again = random ({argument}), next = random ({other}); same = r == again && r != next; }}"
        );
        let group = link(&[(&source, Params::new())], &[]);
        let mut services = Double::default();
        let r = output(&group, &mut square(100, 50), &mut services, "r", ValueType::Color);
        let same = output(&group, &mut square(100, 50), &mut services, "same", ValueType::Float);
        assert!(same.iter().all(|s| *s == 1.0));
        assert!(r.iter().all(|x| (0.0..1.0).contains(x)));
        for component in r.chunks(5000) {
            // u has only 100 values, and P has 5000.
            if argument.starts_with('P') {
                let mut bins = [0_u32; 10];
                component.iter().for_each(|x| bins[(x * 10.0) as usize] += 1);
                assert!(bins.iter().all(|b| b.abs_diff(500) < 110), "{bins:?}");
            }
        }
        assert!(r[..5000].iter().zip(&r[5000..]).all(|(a, b)| a != b), "components differ");
    }
    // A vector or normal is equivalent to a point, and minus zero to zero.
    assert_eq!(floats("r = random (P) == random ((vector) P) && random (0) == random (-0.0);"), [1.0; 6]);
}

fn random_without_arguments() {
    let draw = |body: &str| {
        let source = format!("surface t (output color r = 0) {{ {body} }}");
        let group = link(&[(&source, Params::new())], &[]);
        output(&group, &mut square(50, 40), &mut Double::default(), "r", ValueType::Color)
    };
    let r = draw("r = random ();");
    assert!(r.iter().all(|x| (0.0..1.0).contains(x)));
    let mean = r.iter().sum::<f32>() / r.len() as f32;
    assert!((mean - 0.5).abs() < 0.02, "{mean}");
    // Each point, component and call has a different random number.
    let mut seen: Vec<u32> = r.iter().map(|x| x.to_bits()).collect();
    seen.sort_unstable();
    seen.dedup();
    assert!(seen.len() > 5990, "{}", seen.len());
    assert!(draw("color first = random (); r = random (); r = first == r;").iter().all(|x| *x == 0.0));
}

fn randomgrid() {
    for ty in ["float", "color", "point", "vector", "normal"] {
        let r = floats(&format!(
            "{ty} x = randomgrid (), y = randomgrid (); \
             r = (gridmin (x) == gridmax (x)) + 10 * (x != y) + 100 * (gridmin (length ((vector) x)) > 0);"
        ));
        assert_eq!(r, [111.0; 6], "{ty}");
    }
    let r = floats("color x = randomgrid (); r = x[0] != x[1] && x[1] != x[2] && x[0] > 0 && x[0] < 1;");
    assert_eq!(r, [1.0; 6]);
}

// Splines by their definitions.

fn segment(basis: &str, k: [f64; 4], t: f64) -> f64 {
    let hermite = |p: f64, m: f64, q: f64, n: f64| {
        let (t2, t3) = (t * t, t * t * t);
        (2.0 * t3 - 3.0 * t2 + 1.0) * p + (t3 - 2.0 * t2 + t) * m + (3.0 * t2 - 2.0 * t3) * q + (t3 - t2) * n
    };
    match basis {
        // The slope at a knot is half the difference of its neighbours.
        "catmull-rom" => hermite(k[1], 0.5 * (k[2] - k[0]), k[2], 0.5 * (k[3] - k[1])),
        "hermite" => hermite(k[0], k[1], k[2], k[3]),
        "linear" => k[1] + t * (k[2] - k[1]),
        "bezier" => {
            // This is the algorithm of De Casteljau.
            let mut p = k.to_vec();
            while p.len() > 1 {
                p = p.windows(2).map(|w| w[0] + t * (w[1] - w[0])).collect();
            }
            p[0]
        }
        _ => {
            // This is De Boor's basis for uniform knots.
            let s = 1.0 - t;
            let w = [
                s.powi(3),
                3.0 * t.powi(3) - 6.0 * t * t + 4.0,
                3.0 * s.powi(3) - 6.0 * s * s + 4.0,
                t.powi(3),
            ];
            (0..4).map(|i| w[i] * k[i]).sum::<f64>() / 6.0
        }
    }
}

fn spline(basis: &str, x: f64, y: &[f64]) -> f64 {
    let step = match basis {
        "bezier" => 3,
        "hermite" => 2,
        _ => 1,
    };
    let segments = (y.len() - 4) / step + 1;
    let s = x.clamp(0.0, 1.0) * segments as f64;
    let at = (s as usize).min(segments - 1);
    segment(basis, std::array::from_fn(|k| y[at * step + k]), s - at as f64)
}

/// Returns the parameter at which a rising spline is `v`.
fn solved(basis: &str, v: f64, y: &[f64]) -> (f64, f64) {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if spline(basis, middle, y) < v { low = middle } else { high = middle }
    }
    let slope = (spline(basis, high + 1e-5, y) - spline(basis, low - 1e-5, y)).abs() / 2e-5;
    let size = y.iter().fold(0.0, |a: f64, b| a.max(b.abs()));
    (low, 1.0 + size / slope.max(1e-6))
}

/// The knots of a spline, computed from the numbers of a point.
type Knots = Box<dyn Fn(&[f64]) -> Vec<f64>>;

fn splines(list: &mut Vec<Row>) {
    const BASES: [(&str, usize); 5] =
        [("catmull-rom", 7), ("bezier", 7), ("bspline", 7), ("hermite", 6), ("linear", 7)];
    let x: Arg = (F, Within(-0.25, 1.25));
    let own: Arg = (None, Tame);
    let letters = ["b", "c", "d", "e", "f", "g", "h"];
    let mut rows: [Vec<Numbers>; 4] = std::array::from_fn(|_| Vec::new());
    for (basis, n) in BASES {
        let mut args = vec![x];
        args.resize(n + 1, own);
        let knots = letters[..n].join(", ");
        let exact = || {
            each_scaled(move |x: &[f64]| {
                (spline(basis, x[0], &x[1..]), x[1..].iter().fold(0.0, |a: f64, b| a.max(b.abs())))
            })
        };
        let bound = Terms(16.0);
        let array = format!("{{T}} k[{n}] = {{ {knots} }};");
        if basis == "catmull-rom" {
            rows[0].push(numbers(&format!("spline (a, {knots})"), &args, bound, exact()));
            rows[2].push(numbers(&format!("{array} r = spline (a, k);"), &args, bound, exact()));
        }
        rows[1].push(numbers(&format!("spline (\"{basis}\", a, {knots})"), &args, bound, exact()));
        rows[3].push(numbers(&format!("{array} r = spline (\"{basis}\", a, k);"), &args, bound, exact()));
        // The splines rise. Each value adds to the last, and a Hermite spline's slopes are those of its values.
        let (rising, values): (String, Knots) = if basis == "hermite" {
            (
                "0.1, 1, 1 + b, 1, 2 + b + c, 1".into(),
                Box::new(|x| vec![0.1, 1.0, 1.0 + x[1], 1.0, 2.0 + x[1] + x[2], 1.0]),
            )
        } else {
            (
                "0, b, b + c, b + c + d, b + c + d + b, b + c + d + b + c, b + c + d + b + c + d".into(),
                Box::new(|x| {
                    let (b, c, d) = (x[1], x[2], x[3]);
                    vec![0.0, b, b + c, b + c + d, 2.0 * b + c + d, 2.0 * (b + c) + d, 2.0 * (b + c + d)]
                }),
            )
        };
        let args =
            [(F, Within(-0.5, 6.0)), (F, Within(0.5, 1.0)), (F, Within(0.5, 1.0)), (F, Within(0.5, 1.0))];
        let exact = |values: Knots| -> Exact {
            Box::new(move |x| {
                let x: Vec<f64> = x.iter().flatten().copied().collect();
                vec![solved(basis, x[0], &values(&x))]
            })
        };
        let mut n =
            numbers(&format!("spline (\"solve{basis}\", a, {rising})"), &args, Terms(16.0), exact(values));
        n.only = Some(ValueType::Float);
        rows[1].push(n);
    }
    // Solving also accepts arrays.
    let exact: Exact = Box::new(|x| vec![(((x[0][0] - 1.0) / 3.0).clamp(0.0, 1.0), 1.0)]);
    let body = "float k[6] = { 0, 1, 2, 3, 4, 5 }; r = spline (\"solvelinear\", a, k);";
    let mut n = numbers(body, &[(F, Within(-1.0, 6.0))], Terms(8.0), exact);
    n.only = Some(ValueType::Float);
    rows[3].push(n);
    let forms = [
        "spline (float, 4 or more type)",
        "spline (string, float, 4 or more type)",
        "spline (float, type[])",
        "spline (string, float, type[])",
    ];
    list.extend(forms.into_iter().zip(rows.map(How::Numbers)));
}

// Antialiased steps as integrals of their kernels.

fn kernel(filter: &str, x: f64) -> f64 {
    match filter {
        "box" => 1.0,
        "triangle" => 1.0 - x.abs(),
        "gaussian" => (-2.0 * x * x).exp(),
        _ => {
            let t = 2.0 * x.abs();
            if t < 1.0 {
                1.0 - 2.5 * t * t + 1.5 * t.powi(3)
            } else {
                2.0 - 4.0 * t + 2.5 * t * t - 0.5 * t.powi(3)
            }
        }
    }
}

/// Integrates a kernel by Simpson's rule, normalised to 1. Kernels are smooth except at 0 and at half their width,
/// where pieces end.
fn integral(filter: &str, to: f64) -> f64 {
    let piece = |a: f64, b: f64| {
        let n = 200;
        let h = (b - a) / f64::from(n);
        let at = |k: i32| kernel(filter, a + h * f64::from(k));
        (0..n / 2).map(|k| (at(2 * k) + 4.0 * at(2 * k + 1) + at(2 * k + 2)) * h / 3.0).sum::<f64>()
    };
    let upto = |x: f64| {
        [-1.0, -0.5, 0.0, 0.5].map(|a| if x > a { piece(a, x.min(a + 0.5)) } else { 0.0 }).iter().sum::<f64>()
    };
    upto(to) / upto(1.0)
}

fn filtered(filter: &str, edge: f64, s: f64, ds: f64) -> (f64, f64) {
    let half = 0.5 * ds.abs();
    if half == 0.0 {
        return (f64::from(u8::from(s >= edge)), 1.0);
    }
    let x = (s - edge) / half;
    (integral(filter, x.clamp(-1.0, 1.0)), 2.0)
}

fn steps(list: &mut Vec<Row>) {
    let args = [(F, Within(-1.0, 1.0)), (F, Within(-1.0, 1.0)), (F, Within(-1.5, 1.5))];
    let mut rows = Vec::new();
    let mut add = |options: &str, filter: &'static str, width: f64| {
        let exact: Exact = Box::new(move |x| vec![filtered(filter, x[0][0], x[1][0], x[2][0] * width)]);
        rows.push(numbers(&format!("aastep (a, b, c{options})"), &args, Terms(8.0), exact));
    };
    add("", "catmull-rom", 1.0);
    add(", \"width\", 2", "catmull-rom", 2.0);
    for filter in ["box", "triangle", "gaussian", "catmull-rom"] {
        let name = format!(", \"filter\", \"{filter}\"");
        add(&name, filter, 1.0);
        add(&format!("{name}, \"width\", 0.5"), filter, 0.5);
    }
    list.push(("aastep (float, float, float, ...)", How::Numbers(rows)));
    list.push(("aastep (float, float, ...)", How::Test(filtered_steps)));
}

/// Tests steps without a width, whose width is that of the argument over the grid.
fn filtered_steps() {
    for filter in ["box", "triangle", "gaussian", "catmull-rom"] {
        for width in [1.0, 3.0] {
            let source = format!(
                "surface t (output float r = 0) {{ r = aastep (0.45, u + 2 * v, \"filter\", \"{filter}\", \"width\", {width}); }}"
            );
            let group = link(&[(&source, Params::new())], &[]);
            let mut grid = square(9, 5);
            let r = output(&group, &mut grid, &mut Double::default(), "r", ValueType::Float);
            // The steps are 1/8 and 2/4.
            let ds = (0.125_f64.powi(2) + 0.5_f64.powi(2)).sqrt() * width;
            for (k, got) in r.iter().enumerate() {
                let s = f64::from(grid.u[k]) + 2.0 * f64::from(grid.v[k]);
                let (wanted, _) = filtered(filter, 0.45, s, ds);
                assert!((f64::from(*got) - wanted).abs() < 2e-6, "{filter} {width} {k}: {got} {wanted}");
            }
        }
    }
}

pub(super) fn rows() -> Vec<Row> {
    let mut list = Vec::new();
    noises(
        &mut list,
        ["noise (float)", "noise (float, float)", "noise (point)", "noise (point, float)"],
        "noise",
        true,
        false,
    );
    noises(
        &mut list,
        ["snoise (float)", "snoise (float, float)", "snoise (point)", "snoise (point, float)"],
        "snoise",
        false,
        false,
    );
    noises(
        &mut list,
        ["cnoise (float)", "cnoise (float, float)", "cnoise (point)", "cnoise (point, float)"],
        "cnoise",
        true,
        true,
    );
    macro_rules! periodic {
        ($word:literal, $unsigned:expr) => {
            periodic(
                &mut list,
                [
                    concat!($word, " (float, float)"),
                    concat!($word, " (float, float, float, float)"),
                    concat!($word, " (point, point)"),
                    concat!($word, " (point, float, point, float)"),
                ],
                $word,
                $unsigned,
            )
        };
    }
    periodic!("pnoise", true);
    periodic!("pnnoise", true);
    periodic!("psnoise", false);
    splines(&mut list);
    steps(&mut list);
    list.push(("random ()", How::Test(random_without_arguments)));
    list.push(("random (float)", How::Test(random_is_a_hash)));
    list.push(("random (point)", How::Test(random_is_a_hash)));
    list.push(("randomgrid ()", How::Test(randomgrid)));
    list
}
