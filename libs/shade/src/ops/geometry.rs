//! Geometric functions (reference 5.8.3) without named spaces.

use super::{compute, compute_as, matrix};
use crate::program::Op;
use crate::run::kernel::{fold2, map2};
use crate::run::lanes::Unary;
use crate::run::machine::Machine;
use crate::run::simd;
use granita_base::Vec3;
use granita_gsl::Func;
use granita_gsl::ir::{Global, SymbolId};

/// Functions of points, vectors and normals.
pub(super) fn run(m: &mut Machine<'_>, func: Func, op: &Op) {
    match func {
        Func::Dot => dot(m, op),
        Func::Cross => cross(m, op),
        Func::Length => compute(m, op, 1, |m, out, _| {
            let a = m.view(op.args[0]);
            simd::length(out.part(0), a.triple().xyz);
        }),
        Func::Distance => distance(m, op),
        Func::Normalize => normalize(m, op),
        Func::FaceForward => faceforward(m, op),
        Func::Reflect => triples(m, op, |_, v| v[0] - 2.0 * v[1].dot(v[0]) * v[1]),
        Func::Refract => triples(m, op, |x, v| refract(v[0], v[1], x[2])),
        Func::Rotate => rotate(m, op),
        Func::Fresnel => fresnel(m, op),
        _ => {}
    }
}

fn dot(m: &mut Machine<'_>, op: &Op) {
    compute(m, op, 1, |m, out, _| {
        let (a, b) = (m.view(op.args[0]), m.view(op.args[1]));
        simd::dot(out.part(0), a.triple().xyz, b.triple().xyz);
    });
}

fn cross(m: &mut Machine<'_>, op: &Op) {
    compute(m, op, 3, |m, out, _| {
        let (a, b) = (m.view(op.args[0]), m.view(op.args[1]));
        for c in 0..3 {
            let (j, k) = ((c + 1) % 3, (c + 2) % 3);
            map2(out.part(c), a.lane(j), b.lane(k), |x, y| x * y);
            fold2(out.part(c), a.lane(k), b.lane(j), |o, x, y| o - x * y);
        }
    });
}

/// A vector of zero or infinite length has no direction. The result is zero, not NaN.
fn normalize(m: &mut Machine<'_>, op: &Op) {
    compute(m, op, 3, |m, out, _| {
        let a = m.view(op.args[0]);
        for c in 0..3 {
            simd::unary(Unary::Copy, out.part(c), a.lane(c));
        }
        simd::normalize(out.parts3());
    });
}

fn distance(m: &mut Machine<'_>, op: &Op) {
    compute(m, op, 1, |m, out, work| {
        let [a, b] = [0, 1].map(|k| m.view(op.args[k]).triple());
        match op.args.get(2) {
            None => work.each(|i| out.set(0, i, (a.get(i) - b.get(i)).length())),
            Some(&q) => {
                let q = m.view(q).triple();
                work.each(|i| out.set(0, i, segment_distance(a.get(i), b.get(i), q.get(i))));
            }
        }
    });
}

/// Returns the distance of `q` from the segment `a b`.
fn segment_distance(a: Vec3, b: Vec3, q: Vec3) -> f32 {
    let along = b - a;
    let length2 = along.length_squared();
    let t = if length2 > 0.0 { ((q - a).dot(along) / length2).clamp(0.0, 1.0) } else { 0.0 };
    (a + t * along - q).length()
}

/// Returns `-N` when the reference normal points along `I`. The default reference is the geometric normal.
fn faceforward(m: &mut Machine<'_>, op: &Op) {
    let Some(dst) = op.dst else { return };
    let varying = m.varies(&op.args) || op.args.len() < 3 && m.global(Global::Ng).varying;
    compute_as(m, dst, varying, 3, |m, out, work| {
        let (n, i) = (m.view(op.args[0]).triple(), m.view(op.args[1]).triple());
        let reference = match op.args.get(2) {
            Some(&r) => m.view(r).triple(),
            None => m.global(Global::Ng).triple(),
        };
        work.each(|k| {
            let v = n.get(k);
            out.set3(k, if i.get(k).dot(reference.get(k)) > 0.0 { -v } else { v });
        });
    });
}

/// Computes a triple per lane from up to four operands, read as floats and as triples.
fn triples(m: &mut Machine<'_>, op: &Op, f: impl Fn([f32; 4], [Vec3; 4]) -> Vec3) {
    compute(m, op, 3, |m, out, work| {
        let views: [_; 4] = std::array::from_fn(|k| m.view(op.args[k.min(op.args.len() - 1)]));
        work.each(|i| {
            out.set3(i, f(views.map(|v| v.get(i)), views.map(|v| v.triple().get(i))));
        });
    });
}

/// Refracts by Snell's law; zero at total reflection.
pub(crate) fn refract(i: Vec3, n: Vec3, eta: f32) -> Vec3 {
    let cos = i.dot(n);
    let k = 1.0 - eta * eta * (1.0 - cos * cos);
    if k < 0.0 { Vec3::ZERO } else { eta * i - (eta * cos + k.sqrt()) * n }
}

/// Returns the reflectance of unpolarised light at a dielectric (Fresnel's equations, in the form of Cook and
/// Torrance, A Reflectance Model for Computer Graphics, 1982, for the relative index `1 / eta`).
pub(crate) fn reflectance(i: Vec3, n: Vec3, eta: f32) -> f32 {
    let c = i.dot(n).abs();
    let g2 = 1.0 / (eta * eta) - 1.0 + c * c;
    if g2 <= 0.0 {
        return 1.0;
    }
    let g = g2.sqrt();
    let (a, b) = ((g - c) / (g + c), (c * (g + c) - 1.0) / (c * (g - c) + 1.0));
    (0.5 * a * a * (1.0 + b * b)).clamp(0.0, 1.0)
}

/// Runs `fresnel (I, N, eta, Kr, Kt, R, T)`. Only a damaged module lacks R and T.
fn fresnel(m: &mut Machine<'_>, op: &Op) {
    let inputs: [SymbolId; 3] = [op.args[0], op.args[1], op.args[2]];
    let varying = m.varies(&inputs);
    let (mut kr, mut kt) = (m.out(varying, 1), m.out(varying, 1));
    let (mut r, mut t) = (m.out(varying, 3), m.out(varying, 3));
    {
        let (i, n) = (m.view(inputs[0]).triple(), m.view(inputs[1]).triple());
        let eta = m.view(inputs[2]).lane(0);
        m.work(varying).each(|k| {
            let (ray, axis, eta) = (i.get(k), n.get(k), eta.get(k));
            let f = reflectance(ray, axis, eta);
            kr.set(0, k, f);
            kt.set(0, k, 1.0 - f);
            r.set3(k, ray - 2.0 * axis.dot(ray) * axis);
            t.set3(k, refract(ray, axis, eta));
        });
    }
    for (dst, out) in op.args[3..7].iter().zip([kr, kt, r, t]) {
        m.commit(*dst, out);
    }
}

/// Runs `rotate (Q, angle, P0, P1)`: about the axis from P0 to P1, counter-clockwise as `Rotate` does.
fn rotate(m: &mut Machine<'_>, op: &Op) {
    triples(m, op, |x, v| {
        let turn = matrix::rotation(x[1], v[3] - v[2]);
        v[2] + turn.vector(v[0] - v[2])
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_to_segments_are_exact() {
        let (a, b) = (Vec3::ZERO, Vec3::X * 2.0);
        assert_eq!(segment_distance(a, b, Vec3::new(1.0, 3.0, 0.0)), 3.0);
        assert_eq!(segment_distance(a, b, Vec3::new(5.0, 4.0, 0.0)), 5.0);
        assert_eq!(segment_distance(a, a, Vec3::Y), 1.0);
    }

    #[test]
    fn refraction_and_reflectance_equal_the_formulas() {
        let n = Vec3::Z;
        // At normal incidence there is no refraction, and the reflectance is ((n1 - n2) / (n1 + n2))^2.
        assert!((refract(-n, n, 1.0 / 1.5) + n).length() < 1e-6);
        assert!((reflectance(-n, n, 1.0 / 1.5) - 0.04).abs() < 1e-6);
        // Total reflection from inside glass.
        let shallow = Vec3::new(0.9, 0.0, -(1.0_f32 - 0.81).sqrt());
        assert_eq!((refract(shallow, n, 1.5), reflectance(shallow, n, 1.5)), (Vec3::ZERO, 1.0));
        // By Snell's law, sines are in the ratio of the indices.
        let i = Vec3::new(0.6, 0.0, -0.8);
        let t = refract(i, n, 1.0 / 1.5);
        assert!((t.length() - 1.0).abs() < 1e-6 && (t.x - 0.4).abs() < 1e-6 && t.z < 0.0);
        // In the same medium everything is transmitted.
        assert!(reflectance(i, n, 1.0).abs() < 1e-6);
        // At grazing incidence everything is reflected.
        assert!((reflectance(Vec3::X, n, 0.7) - 1.0).abs() < 1e-6);
    }
}
