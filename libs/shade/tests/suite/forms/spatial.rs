// tidy: table
//! Geometry, spaces, units, colours and matrices (reference 5.8.3 to 5.8.5).

use super::*;
use Bound::{Terms, Ulp};
use Draw::{Affine, Direction, Projective, Tame, Within};

const F: Option<ValueType> = Some(ValueType::Float);
const C: Option<ValueType> = Some(ValueType::Color);
const P: Option<ValueType> = Some(ValueType::Point);
const V: Option<ValueType> = Some(ValueType::Vector);
const N: Option<ValueType> = Some(ValueType::Normal);
const M: Option<ValueType> = Some(ValueType::Matrix);

type V3 = [f64; 3];
type M4 = [[f64; 4]; 4];

fn v3(x: &[f64]) -> V3 {
    [x[0], x[1], x[2]]
}

fn dot(a: V3, b: V3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn abs(a: V3) -> V3 {
    a.map(f64::abs)
}

fn length(a: V3) -> f64 {
    dot(a, a).sqrt()
}

fn minus(a: V3, b: V3) -> V3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: V3, b: V3) -> V3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Returns a result whose terms are as large as itself.
fn plain(v: V3) -> Vec<(f64, f64)> {
    v.iter().map(|x| (*x, x.abs())).collect()
}

fn with_scale(v: V3, scale: V3) -> Vec<(f64, f64)> {
    v.into_iter().zip(scale).collect()
}

// Vectors are rows, and matrices are stored by rows.

fn m4(x: &[f64]) -> M4 {
    std::array::from_fn(|i| std::array::from_fn(|j| x[4 * i + j]))
}

fn times(a: M4, b: M4) -> M4 {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..4).map(|k| a[i][k] * b[k][j]).sum()))
}

fn minor(m: &M4, row: usize, column: usize) -> f64 {
    let rows: Vec<usize> = (0..4).filter(|i| *i != row).collect();
    let columns: Vec<usize> = (0..4).filter(|i| *i != column).collect();
    let at = |i: usize, j: usize| m[rows[i]][columns[j]];
    at(0, 0) * (at(1, 1) * at(2, 2) - at(1, 2) * at(2, 1))
        - at(0, 1) * (at(1, 0) * at(2, 2) - at(1, 2) * at(2, 0))
        + at(0, 2) * (at(1, 0) * at(2, 1) - at(1, 1) * at(2, 0))
}

fn sign(i: usize, j: usize) -> f64 {
    if (i + j).is_multiple_of(2) { 1.0 } else { -1.0 }
}

fn determinant(m: &M4) -> f64 {
    (0..4).map(|j| sign(0, j) * m[0][j] * minor(m, 0, j)).sum()
}

fn inverse(m: M4) -> M4 {
    let d = determinant(&m);
    std::array::from_fn(|i| std::array::from_fn(|j| sign(i, j) * minor(&m, j, i) / d))
}

fn largest(m: &M4) -> f64 {
    m.iter().flatten().fold(0.0, |a, b| a.max(b.abs()))
}

const IDENTITY: M4 = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];

fn scaling(s: V3) -> M4 {
    let mut m = IDENTITY;
    (0..3).for_each(|k| m[k][k] = s[k]);
    m
}

fn translation(t: V3) -> M4 {
    let mut m = IDENTITY;
    m[3][..3].copy_from_slice(&t);
    m
}

/// Returns the rotation, which is counter-clockwise when seen against the axis (Rodrigues).
fn rotation(angle: f64, axis: V3) -> M4 {
    let l = length(axis);
    let [x, y, z] = axis.map(|v| v / l);
    let (s, c) = angle.sin_cos();
    let d = 1.0 - c;
    [
        [c + x * x * d, x * y * d + z * s, x * z * d - y * s, 0.0],
        [x * y * d - z * s, c + y * y * d, y * z * d + x * s, 0.0],
        [x * z * d + y * s, y * z * d - x * s, c + z * z * d, 0.0],
        [0.0, 0.0, 0.0, 1.0],
    ]
}

/// Returns the matrix from a space of the fixture to "common" space.
fn space(name: &str) -> M4 {
    match name {
        "shader" => translation([10.0, 0.0, 0.0]),
        "double" => scaling([2.0; 3]),
        "turned" => rotation(f64::from(std::f32::consts::FRAC_PI_2), [0.0, 0.0, 1.0]),
        "stretched" => scaling([1.0, 4.0, 2.0]),
        _ => IDENTITY,
    }
}

#[derive(Clone, Copy)]
enum Kind {
    Point,
    Vector,
    Normal,
}

/// Transforms a triple by a matrix. Returns the components with the sizes of their terms.
fn apply(kind: Kind, m: M4, v: V3) -> Vec<(f64, f64)> {
    let sum = |m: &M4, w: f64, j: usize| (0..3).map(|i| v[i] * m[i][j]).sum::<f64>() + w * m[3][j];
    let sizes =
        |m: &M4, w: f64, j: usize| (0..3).map(|i| (v[i] * m[i][j]).abs()).sum::<f64>() + (w * m[3][j]).abs();
    (0..3)
        .map(|j| match kind {
            Kind::Point => {
                let w = sum(&m, 1.0, 3);
                let x = sum(&m, 1.0, j) / w;
                (x, (sizes(&m, 1.0, j) + x.abs() * sizes(&m, 1.0, 3)) / w.abs())
            }
            Kind::Vector => (sum(&m, 0.0, j), sizes(&m, 0.0, j)),
            Kind::Normal => {
                let mut linear = m;
                linear.iter_mut().for_each(|row| row[3] = 0.0);
                linear[3] = [0.0, 0.0, 0.0, 1.0];
                let back = inverse(linear);
                let by: M4 = std::array::from_fn(|i| std::array::from_fn(|j| back[j][i]));
                (sum(&by, 0.0, j), sizes(&by, 0.0, j))
            }
        })
        .collect()
}

/// Scales the errors by the condition number of a matrix.
fn conditioned(list: Vec<(f64, f64)>, m: &M4) -> Vec<(f64, f64)> {
    let condition = largest(m) * largest(&inverse(*m));
    let size = list.iter().fold(0.0, |a: f64, b| a.max(b.1));
    list.into_iter().map(|(v, _)| (v, size * (1.0 + condition))).collect()
}

fn transforms(list: &mut Vec<Row>) {
    const FORMS: [[&str; 3]; 6] = [
        ["transform (matrix, point)", "transformv (matrix, vector)", "transformn (matrix, normal)"],
        [
            "transform (string, string, point)",
            "transformv (string, string, vector)",
            "transformn (string, string, normal)",
        ],
        ["transform (string, point)", "transformv (string, vector)", "transformn (string, normal)"],
        [
            "transform (string, matrix, point)",
            "transformv (string, matrix, vector)",
            "transformn (string, matrix, normal)",
        ],
        [
            "transform (matrix, string, point)",
            "transformv (matrix, string, vector)",
            "transformn (matrix, string, normal)",
        ],
        [
            "transform (matrix, matrix, point)",
            "transformv (matrix, matrix, vector)",
            "transformn (matrix, matrix, normal)",
        ],
    ];
    const SPACES: [&str; 5] = ["common", "shader", "double", "turned", "stretched"];
    for (k, (word, ty, kind)) in
        [("transform", P, Kind::Point), ("transformv", V, Kind::Vector), ("transformn", N, Kind::Normal)]
            .into_iter()
            .enumerate()
    {
        let value: Arg = (ty, Tame);
        let mut rows: [Vec<Numbers>; 6] = std::array::from_fn(|_| Vec::new());
        for from in [Affine, Projective] {
            rows[0].push(numbers(
                &format!("{word} (b, a)"),
                &[value, (M, from)],
                Terms(4.0),
                Box::new(move |x| {
                    let m = m4(&x[1]);
                    let out = apply(kind, m, v3(&x[0]));
                    if let Kind::Normal = kind { conditioned(out, &m) } else { out }
                }),
            ));
        }
        for from in SPACES {
            rows[2].push(numbers(
                &format!("{word} (\"{from}\", a)"),
                &[value],
                Terms(4.0),
                Box::new(move |x| apply(kind, inverse(space(from)), v3(&x[0]))),
            ));
            for to in SPACES {
                rows[1].push(numbers(
                    &format!("{word} (\"{from}\", \"{to}\", a)"),
                    &[value],
                    Terms(8.0),
                    Box::new(move |x| {
                        let m = times(space(from), inverse(space(to)));
                        let scaled = |list: Vec<(f64, f64)>| {
                            // A value that is moved away and back has the error of the distance.
                            list.into_iter().map(|(v, s)| (v, s + 20.0)).collect::<Vec<_>>()
                        };
                        let out = apply(kind, m, v3(&x[0]));
                        if let Kind::Point = kind { scaled(out) } else { out }
                    }),
                ));
            }
            rows[3].push(numbers(
                &format!("{word} (\"{from}\", b, a)"),
                &[value, (M, Affine)],
                Terms(8.0),
                Box::new(move |x| {
                    let m = m4(&x[1]);
                    conditioned(apply(kind, times(space(from), inverse(m)), v3(&x[0])), &m)
                }),
            ));
            rows[4].push(numbers(
                &format!("{word} (b, \"{from}\", a)"),
                &[value, (M, Affine)],
                Terms(16.0),
                Box::new(move |x| {
                    let m = m4(&x[1]);
                    conditioned(apply(kind, times(m, inverse(space(from))), v3(&x[0])), &m)
                }),
            ));
        }
        rows[5].push(numbers(
            &format!("{word} (b, c, a)"),
            &[value, (M, Affine), (M, Affine)],
            Terms(16.0),
            Box::new(move |x| {
                let (from, to) = (m4(&x[1]), m4(&x[2]));
                let out = conditioned(apply(kind, times(from, inverse(to)), v3(&x[0])), &to);
                if let Kind::Normal = kind { conditioned(out, &from) } else { out }
            }),
        ));
        for (forms, rows) in FORMS.iter().zip(rows) {
            list.push((forms[k], How::Numbers(rows)));
        }
    }
}

/// Returns the reflected part of unpolarised light, from the two polarisations of Fresnel's equations. n1 / n2 = eta.
fn reflectance(cos_in: f64, eta: f64) -> f64 {
    let sin2 = eta * eta * (1.0 - cos_in * cos_in);
    if sin2 >= 1.0 {
        return 1.0;
    }
    let cos_out = (1.0 - sin2).sqrt();
    let s = (eta * cos_in - cos_out) / (eta * cos_in + cos_out);
    let p = (eta * cos_out - cos_in) / (eta * cos_out + cos_in);
    0.5 * (s * s + p * p)
}

/// Returns the ray behind the surface by Snell's law. Its component along the surface is scaled by eta.
fn refracted(i: V3, n: V3, eta: f64) -> Vec<(f64, f64)> {
    let cos = dot(i, n);
    let k = 1.0 - eta * eta * (1.0 - cos * cos);
    if k.abs() < 1e-5 * (1.0 + eta * eta) {
        // At the onset of total reflection the result depends on one bit.
        return vec![(0.0, f64::INFINITY); 3];
    }
    if k < 0.0 {
        return vec![(0.0, 0.0); 3];
    }
    let along = [0, 1, 2].map(|c| eta * (i[c] - cos * n[c]));
    let root = k.sqrt();
    (0..3).map(|c| (along[c] - root * n[c], 1.0 + eta + (1.0 + eta * eta) / root)).collect()
}

pub(super) fn rows() -> Vec<Row> {
    let tame = |ty| (ty, Tame);
    let mut list = vec![
        row(
            "dot (vector, vector)",
            "dot (a, b)",
            &[tame(V), tame(N)],
            Terms(2.0),
            Box::new(|x| vec![(dot(v3(&x[0]), v3(&x[1])), dot(abs(v3(&x[0])), abs(v3(&x[1]))))]),
        ),
        row(
            "cross (vector, vector)",
            "cross (a, b)",
            &[tame(V), tame(V)],
            Terms(2.0),
            Box::new(|x| {
                let (a, b) = (v3(&x[0]), v3(&x[1]));
                let size = |j: usize, k: usize| (a[j] * b[k]).abs() + (a[k] * b[j]).abs();
                with_scale(cross(a, b), [size(1, 2), size(2, 0), size(0, 1)])
            }),
        ),
        row(
            "length (vector)",
            "length (a)",
            &[tame(V)],
            documented("`length`"),
            Box::new(|x| vec![(length(v3(&x[0])), 0.0)]),
        ),
        row(
            "distance (point, point)",
            "distance (a, b)",
            &[tame(P), tame(P)],
            documented("`distance` of points"),
            Box::new(|x| vec![(length(minus(v3(&x[0]), v3(&x[1]))), 0.0)]),
        ),
        row(
            "distance (point, point, point)",
            "distance (a, b, c)",
            &[tame(P), tame(P), tame(P)],
            Terms(4.0),
            Box::new(|x| {
                let (a, b, q) = (v3(&x[0]), v3(&x[1]), v3(&x[2]));
                let along = minus(b, a);
                let l2 = dot(along, along);
                let t = if l2 > 0.0 { (dot(minus(q, a), along) / l2).clamp(0.0, 1.0) } else { 0.0 };
                let nearest = [0, 1, 2].map(|c| a[c] + t * along[c]);
                vec![(length(minus(nearest, q)), length(a) + length(b) + length(q))]
            }),
        ),
        (
            "normalize (vector)",
            How::Numbers(
                [(V, Tame), (N, Tame), (V, Draw::Whole)]
                    .map(|arg| {
                        let exact: Exact = Box::new(|x| {
                            let v = v3(&x[0]);
                            let l = length(v);
                            plain(if l > 0.0 { v.map(|c| c / l) } else { [0.0; 3] })
                        });
                        numbers("normalize (a)", &[arg], documented("`normalize`"), exact)
                    })
                    .into(),
            ),
        ),
        row(
            "faceforward (vector, vector, vector)",
            "faceforward (a, b, c)",
            // Integers have exact products, so that perpendicular vectors are exactly perpendicular.
            &[tame(V), (V, Draw::Whole), (V, Draw::Whole)],
            Ulp(0.0),
            Box::new(|x| {
                let v = v3(&x[0]);
                plain(if dot(v3(&x[1]), v3(&x[2])) > 0.0 { v.map(|c| -c) } else { v })
            }),
        ),
        row(
            "faceforward (vector, vector)",
            "faceforward (a, b)",
            &[tame(V), (V, Draw::Whole)],
            Ulp(0.0),
            Box::new(|x| {
                // Ng is -z.
                let v = v3(&x[0]);
                plain(if -x[1][2] > 0.0 { v.map(|c| -c) } else { v })
            }),
        ),
        row(
            "reflect (vector, vector)",
            "reflect (a, b)",
            &[tame(V), (V, Direction)],
            Terms(4.0),
            Box::new(|x| {
                let (i, n) = (v3(&x[0]), v3(&x[1]));
                let (d, size) = (dot(i, n), dot(abs(i), abs(n)));
                (0..3).map(|c| (i[c] - 2.0 * d * n[c], i[c].abs() + 2.0 * size * n[c].abs())).collect()
            }),
        ),
        row(
            "refract (vector, vector, float)",
            "refract (a, b, c)",
            &[(V, Direction), (V, Direction), (F, Within(0.3, 3.0))],
            Terms(4.0),
            Box::new(|x| {
                let (i, n, eta) = (v3(&x[0]), v3(&x[1]), x[2][0]);
                // Where I is against the normal, the formula is Snell's law. Where it is along the normal, the formula
                // is extended.
                let cos = dot(i, n);
                let k = 1.0 - eta * eta * (1.0 - cos * cos);
                if cos <= 0.0 || k < 1e-5 * (1.0 + eta * eta) {
                    return refracted(i, n, eta);
                }
                let root = k.sqrt();
                (0..3)
                    .map(|c| (eta * i[c] - (eta * cos + root) * n[c], 1.0 + eta + (1.0 + eta * eta) / root))
                    .collect()
            }),
        ),
        (
            "fresnel (vector, normal, float, output float, output float, output vector, output vector)",
            How::Numbers(fresnel()),
        ),
    ];
    transforms(&mut list);
    list.extend([
        row(
            "transformu (string, float)",
            "transformu (\"m\", a)",
            &[(F, Draw::Any)],
            Ulp(2.0),
            each(|x| x[0] * 0.005),
        ),
        (
            "transformu (string, string, float)",
            How::Numbers(
                [
                    ("transformu (\"cm\", \"mm\", a)", 10.0),
                    ("transformu (\"common\", \"common\", a)", 1.0),
                    ("transformu (\"double\", \"m\", a)", 0.01),
                    ("transformu (\"m\", \"double\", a)", 100.0),
                    // The unit is the edge of a cube of the same volume.
                    ("transformu (\"stretched\", \"double\", a)", 1.0),
                ]
                .map(|(e, factor)| numbers(e, &[(F, Draw::Any)], Ulp(4.0), each(move |x| x[0] * factor)))
                .into(),
            ),
        ),
        row(
            "rotate (point, float, point, point)",
            "rotate (a, b, c, d)",
            &[tame(P), (F, Within(-10.0, 10.0)), tame(P), tame(P)],
            Terms(8.0),
            Box::new(|x| {
                let (q, a, b) = (v3(&x[0]), v3(&x[2]), v3(&x[3]));
                let axis = minus(b, a);
                let size = length(q) + 2.0 * length(a);
                if length(axis) == 0.0 {
                    return with_scale(q, [size; 3]);
                }
                let turned = apply(Kind::Vector, rotation(x[1][0], axis), minus(q, a));
                (0..3).map(|c| (a[c] + turned[c].0, size)).collect()
            }),
        ),
        row(
            "luminance (color)",
            "luminance (a)",
            &[tame(C)],
            Terms(2.0),
            Box::new(|x| {
                // This is the row of Y of the matrix that follows from the primaries and the white of Rec. 709.
                let y = rgb_to_xyz()[1];
                vec![(dot(y, v3(&x[0])), dot(y, abs(v3(&x[0]))))]
            }),
        ),
        ("transformc (string, color)", How::Numbers(from_rgb())),
        ("transformc (string, string, color)", How::Numbers(between_colors())),
        row(
            "determinant (matrix)",
            "determinant (a)",
            &[(M, Projective)],
            Ulp(1.0),
            Box::new(|x| vec![(determinant(&m4(&x[0])), 0.0)]),
        ),
        row(
            "transpose (matrix)",
            "transpose (a)",
            &[(M, Projective)],
            Ulp(0.0),
            Box::new(|x| (0..16).map(|k| (x[0][k % 4 * 4 + k / 4], 0.0)).collect()),
        ),
        row(
            "translate (matrix, point)",
            "translate (a, b)",
            &[(M, Projective), tame(P)],
            Terms(4.0),
            Box::new(|x| before(translation(v3(&x[1])), m4(&x[0]))),
        ),
        row(
            "rotate (matrix, float, vector)",
            "rotate (a, b, c)",
            &[(M, Projective), (F, Within(-10.0, 10.0)), (V, Direction)],
            Terms(8.0),
            Box::new(|x| {
                before(rotation(x[1][0], v3(&x[2])), m4(&x[0]))
                    .into_iter()
                    .map(|(v, s)| (v, s + 1.0))
                    .collect()
            }),
        ),
        row(
            "scale (matrix, point)",
            "scale (a, b)",
            &[(M, Projective), tame(P)],
            Terms(4.0),
            Box::new(|x| before(scaling(v3(&x[1])), m4(&x[0]))),
        ),
    ]);
    list
}

/// Returns a product, with the sizes of its terms.
fn before(first: M4, m: M4) -> Vec<(f64, f64)> {
    let product = times(first, m);
    let positive = |m: M4| m.map(|r| r.map(f64::abs));
    let sizes = times(positive(first), positive(m));
    product.iter().flatten().copied().zip(sizes.iter().flatten().copied()).collect()
}

fn fresnel() -> Vec<Numbers> {
    let body = |what: &str| {
        format!(
            "vector n = b; if (dot (a, n) > 0) n = -n; float kr = 0, kt = 0; vector R = 0, T = 0; \
             fresnel (a, n, c, kr, kt, R, T); r = {what};"
        )
    };
    let against = |x: &[Vec<f64>]| {
        let (i, n) = (v3(&x[0]), v3(&x[1]));
        if dot(i, n) > 0.0 { (i, n.map(|v| -v)) } else { (i, n) }
    };
    // The error is large at the onset of total reflection.
    let steep = |cos: f64, eta: f64| {
        let k = 1.0 - eta * eta * (1.0 - cos * cos);
        if k.abs() < 1e-5 * (1.0 + eta * eta) { f64::INFINITY } else { (1.0 + eta * eta) / k.abs().sqrt() }
    };
    let args = [(V, Direction), (V, Direction), (F, Within(0.3, 3.0))];
    let mut list = Vec::new();
    for (what, passed) in [("kr", false), ("kt", true)] {
        let exact: Exact = Box::new(move |x| {
            let (i, n) = against(x);
            let (cos, eta) = (-dot(i, n), x[2][0]);
            let kr = reflectance(cos, eta);
            vec![(if passed { 1.0 - kr } else { kr }, 1.0 + steep(cos, eta))]
        });
        list.push(numbers(&body(what), &args, Terms(8.0), exact));
    }
    for component in 0..3 {
        let reflected: Exact = Box::new(move |x| {
            let (i, n) = against(x);
            vec![(i[component] - 2.0 * dot(i, n) * n[component], 3.0)]
        });
        list.push(numbers(&body(&format!("R[{component}]")), &args, Terms(4.0), reflected));
        let passed: Exact = Box::new(move |x| {
            let (i, n) = against(x);
            vec![refracted(i, n, x[2][0])[component]]
        });
        list.push(numbers(&body(&format!("T[{component}]")), &args, Terms(4.0), passed));
    }
    list
}

// Colours.

/// Returns the matrix that follows from the chromaticities of Rec. 709 and D65.
fn rgb_to_xyz() -> [V3; 3] {
    let xyz = |x: f64, y: f64| [x / y, 1.0, (1.0 - x - y) / y];
    let primaries = [xyz(0.64, 0.33), xyz(0.30, 0.60), xyz(0.15, 0.06)];
    let white = xyz(0.3127, 0.3290);
    // The weights make the sum of the three primaries equal to white.
    let [r, g, b] = primaries;
    let d = dot(r, cross(g, b));
    let weights = [dot(white, cross(g, b)) / d, dot(white, cross(b, r)) / d, dot(white, cross(r, g)) / d];
    std::array::from_fn(|row| std::array::from_fn(|k| primaries[k][row] * weights[k]))
}

/// The matrix of FCC 1953, to seven digits as it is published.
const YIQ: [V3; 3] =
    [[0.299, 0.587, 0.114], [0.595_716, -0.274_453, -0.321_263], [0.211_456, -0.522_591, 0.311_135]];

fn by(m: [V3; 3], c: V3) -> Vec<(f64, f64)> {
    m.iter().map(|row| (dot(*row, c), dot(abs(*row), abs(c)))).collect()
}

fn inverse3(m: [V3; 3]) -> [V3; 3] {
    let [a, b, c] = m;
    let d = dot(a, cross(b, c));
    let columns = [cross(b, c), cross(c, a), cross(a, b)];
    std::array::from_fn(|i| std::array::from_fn(|j| columns[j][i] / d))
}

/// Returns the hue of the hexagon, from 0 to 1. Its scale grows as the colour becomes grey.
fn hue([r, g, b]: V3) -> (f64, f64) {
    let (max, min) = (r.max(g).max(b), r.min(g).min(b));
    let d = max - min;
    if d == 0.0 {
        return (0.0, 1.0);
    }
    let sixths = if max == r {
        (g - b) / d
    } else if max == g {
        (b - r) / d + 2.0
    } else {
        (r - g) / d + 4.0
    };
    (if sixths < 0.0 { sixths + 6.0 } else { sixths } / 6.0, 1.0 + max / d)
}

fn to_space(space: &str, c: V3) -> Vec<(f64, f64)> {
    let (max, min) = (c[0].max(c[1]).max(c[2]), c[0].min(c[1]).min(c[2]));
    match space {
        "hsv" => vec![hue(c), (if max == 0.0 { 0.0 } else { (max - min) / max }, 1.0), (max, 1.0)],
        "hsl" => {
            let l = 0.5 * (max + min);
            let span = 1.0 - (2.0 * l - 1.0).abs();
            let s = if max == min { 0.0 } else { (max - min) / span };
            vec![hue(c), (s, 1.0 + 1.0 / span.max(1e-30)), (l, 1.0)]
        }
        "YIQ" => by(YIQ, c),
        "xyz" => by(rgb_to_xyz(), c),
        _ => plain(c),
    }
}

/// Converts a colour by chroma and the hexagon's sides.
fn to_rgb(space: &str, c: V3) -> Vec<(f64, f64)> {
    let from_chroma = |h: f64, chroma: f64, m: f64| {
        let h6 = (h - h.floor()) * 6.0;
        let x = chroma * (1.0 - (h6 % 2.0 - 1.0).abs());
        let rgb = match h6 as usize {
            0 => [chroma, x, 0.0],
            1 => [x, chroma, 0.0],
            2 => [0.0, chroma, x],
            3 => [0.0, x, chroma],
            4 => [x, 0.0, chroma],
            _ => [chroma, 0.0, x],
        };
        rgb.map(|v| (v + m, 4.0 + h.abs())).to_vec()
    };
    match space {
        "hsv" => from_chroma(c[0], c[1] * c[2], c[2] - c[1] * c[2]),
        "hsl" => {
            let chroma = (1.0 - (2.0 * c[2] - 1.0).abs()) * c[1];
            from_chroma(c[0], chroma, c[2] - 0.5 * chroma)
        }
        "YIQ" => by(inverse3(YIQ), c),
        "xyz" => by(inverse3(rgb_to_xyz()), c),
        _ => plain(c),
    }
}

const COLOR_SPACES: [&str; 5] = ["rgb", "hsv", "hsl", "YIQ", "xyz"];

fn from_rgb() -> Vec<Numbers> {
    let mut list = Vec::new();
    for space in COLOR_SPACES {
        for from in [Within(0.0, 1.0), Within(0.25, 0.25)] {
            let exact: Exact = Box::new(move |x| to_space(space, v3(&x[0])));
            list.push(numbers(&format!("transformc (\"{space}\", a)"), &[(C, from)], Terms(4.0), exact));
        }
    }
    list
}

fn between_colors() -> Vec<Numbers> {
    let mut list = Vec::new();
    for from in COLOR_SPACES {
        for to in COLOR_SPACES {
            let exact: Exact = Box::new(move |x| {
                let c = v3(&x[0]);
                if from == to {
                    return plain(c);
                }
                let rgb = to_rgb(from, c);
                let values = [rgb[0].0, rgb[1].0, rgb[2].0];
                let size = rgb.iter().fold(1.0, |a: f64, b| a.max(b.1));
                let (max, min) = values.iter().fold((f64::MIN, f64::MAX), |(a, b), v| (a.max(*v), b.min(*v)));
                // Hue and saturation of nearly grey or black colours, and of those beyond the cube, depend on one bit.
                if to.starts_with("hs") && (max - min < 0.02 || !(0.02..=0.98).contains(&max) || min < 0.0) {
                    return vec![(0.0, f64::INFINITY); 3];
                }
                let grown = if to.starts_with("hs") { 50.0 } else { 4.0 };
                to_space(to, values).into_iter().map(|(v, s)| (v, (s + 1.0) * size * grown)).collect()
            });
            list.push(numbers(
                &format!("transformc (\"{from}\", \"{to}\", a)"),
                &[(C, Within(0.0, 1.0))],
                Terms(4.0),
                exact,
            ));
        }
    }
    list
}

/// Returns the constructors with and without spaces (reference 5.2, 5.8.3 to 5.8.5).
pub(super) fn constructors() -> Vec<Numbers> {
    let mut list = Vec::new();
    let mut add = |expression: String, args: &[Arg], bound: Bound, only: Option<ValueType>, exact: Exact| {
        let mut n = numbers(&expression, args, bound, exact);
        n.only = only;
        list.push(n);
    };
    let three = [(F, Tame); 3];
    let triple = |x: &[Vec<f64>]| [x[0][0], x[1][0], x[2][0]];
    for (word, ty, kind) in
        [("point", P, Kind::Point), ("vector", V, Kind::Vector), ("normal", N, Kind::Normal)]
    {
        add(format!("{word} (a, b, c)"), &three, Ulp(0.0), ty, Box::new(move |x| plain(triple(x))));
        add(format!("{word} (a)"), &[(F, Draw::Any)], Ulp(0.0), ty, Box::new(|x| plain([x[0][0]; 3])));
        for name in ["common", "shader", "double", "turned", "stretched"] {
            let of = move |v: V3| apply(kind, space(name), v);
            add(
                format!("{word} (\"{name}\", a, b, c)"),
                &three,
                Terms(4.0),
                ty,
                Box::new(move |x| of(triple(x))),
            );
            add(
                format!("{word} (\"{name}\", a)"),
                &[(F, Tame)],
                Terms(4.0),
                ty,
                Box::new(move |x| of([x[0][0]; 3])),
            );
        }
    }
    add("color (a, b, c)".into(), &three, Ulp(0.0), C, Box::new(move |x| plain(triple(x))));
    add("color (a)".into(), &[(F, Draw::Any)], Ulp(0.0), C, Box::new(|x| plain([x[0][0]; 3])));
    let unit = [(F, Within(0.0, 1.0)); 3];
    for name in COLOR_SPACES {
        let of = move |c: V3| to_rgb(name, c);
        add(format!("color (\"{name}\", a, b, c)"), &unit, Terms(4.0), C, Box::new(move |x| of(triple(x))));
        add(format!("color (\"{name}\", a)"), &unit[..1], Terms(4.0), C, Box::new(move |x| of([x[0][0]; 3])));
    }
    let diagonal = |m: M4, s: f64| {
        let mut d = IDENTITY;
        (0..4).for_each(|k| d[k][k] = s);
        before(d, m)
    };
    add("matrix (a)".into(), &[(F, Tame)], Ulp(0.0), M, Box::new(move |x| diagonal(IDENTITY, x[0][0])));
    add("r = a;".into(), &[(F, Tame)], Ulp(0.0), M, Box::new(move |x| diagonal(IDENTITY, x[0][0])));
    for name in ["common", "shader", "double", "turned"] {
        add(
            format!("matrix (\"{name}\", a)"),
            &[(F, Tame)],
            Terms(4.0),
            M,
            Box::new(move |x| diagonal(space(name), x[0][0])),
        );
        add(
            format!("matrix (\"{name}\", a, b, c, 0, d, e, f, 0, g, h, 1, 0, 5, 6, 7, 1)"),
            &[(F, Tame); 8],
            Terms(4.0),
            M,
            Box::new(move |x| {
                let v: Vec<f64> = x.iter().map(|v| v[0]).collect();
                let own = [
                    [v[0], v[1], v[2], 0.0],
                    [v[3], v[4], v[5], 0.0],
                    [v[6], v[7], 1.0, 0.0],
                    [5.0, 6.0, 7.0, 1.0],
                ];
                before(own, space(name))
            }),
        );
    }
    let two = [(M, Projective), (M, Projective)];
    add("a * b".into(), &two, Terms(4.0), M, Box::new(|x| before(m4(&x[0]), m4(&x[1]))));
    add(
        "a / b".into(),
        &[(M, Projective), (M, Affine)],
        Terms(8.0),
        M,
        Box::new(|x| {
            let m = m4(&x[1]);
            conditioned(before(m4(&x[0]), inverse(m)), &m)
        }),
    );
    add(
        "1 / a".into(),
        &[(M, Affine)],
        Terms(4.0),
        M,
        Box::new(|x| {
            let m = m4(&x[0]);
            conditioned(before(IDENTITY, inverse(m)), &m)
        }),
    );
    add("a[b][c]".into(), &[(M, Projective), (F, Within(0.0, 3.9)), (F, Within(0.0, 3.9))], Ulp(0.0), F, {
        Box::new(|x| vec![(x[0][4 * x[1][0] as usize + x[2][0] as usize], 0.0)])
    });
    add("r = a; r[2.5][1] = b;".into(), &[(M, Projective), (F, Tame)], Ulp(0.0), M, {
        Box::new(|x| (0..16).map(|k| (if k == 9 { x[1][0] } else { x[0][k] }, 0.0)).collect())
    });
    list
}
