//! Illumination functions (reference 5.8.11).

use super::{compute, compute_as, constant};
use crate::program::Op;
use crate::run::lanes;
use crate::run::machine::Machine;
use crate::run::store::Out;
use granita_base::{Color, Vec3};
use granita_gsl::Func;
use granita_gsl::ir::Global;

/// `ambient`, `diffuse`, `specular`, `specularbrdf`.
pub(super) fn run(m: &mut Machine<'_>, func: Func, op: &Op) {
    match func {
        Func::Ambient => ambient(m, op),
        Func::Diffuse => gather(m, op, false),
        Func::Specular => gather(m, op, true),
        _ => {
            compute(m, op, 3, |m, out, work| {
                let [l, n, v] = [0, 1, 2].map(|k| m.view(op.args[k]).triple());
                let roughness = m.view(op.args[3]).lane(0);
                work.each(|i| {
                    out.set3(i, Vec3::splat(brdf(l.get(i), n.get(i), v.get(i), roughness.get(i))));
                });
            });
        }
    }
}

/// Returns max (0, N.H) ^ (8 / roughness), with H halfway between light and viewer. All vectors have unit length.
///
/// The reference names no formula. This is the lobe of Blinn, "Models of Light Reflection for Computer Synthesized
/// Images", SIGGRAPH 1977, with the exponent 8 / roughness that BMRT and Aqsis use for `specular ()`.
pub(super) fn brdf(l: Vec3, n: Vec3, v: Vec3, roughness: f32) -> f32 {
    let h = (l + v).normalize_or_zero();
    let cos = n.dot(h).max(0.0);
    if cos == 0.0 { 0.0 } else { lanes::pow(cos, 8.0 / roughness.max(1e-6)) }
}

/// Computes the sum of all ambient lights.
fn ambient(m: &mut Machine<'_>, op: &Op) {
    let Some(dst) = op.dst else { return };
    let (ps, ns) = (m.captured_global(Global::P), m.captured_global(Global::N));
    let mut sum: Option<Out> = None;
    for k in 0..m.services.light_count() {
        if !m.services.light_info(k).ambient {
            continue;
        }
        let result = {
            let batch = crate::Batch { lanes: m.n, active: &m.mask.active, layer: m.layer };
            m.services.illuminate(k, &crate::IlluminateQuery::new(batch, ps.triple(), ns.triple()))
        };
        let Some(light) = result.ambient.as_ref().filter(|l| l.len() == m.n) else { continue };
        let mut total = sum.take().unwrap_or_else(|| {
            let mut zero = m.out(true, 3);
            zero.data.fill(0.0);
            zero
        });
        for c in 0..3 {
            for (to, &from) in total.part(c).iter_mut().zip(&light.xyz[c]) {
                *to += from;
            }
        }
        sum = Some(total);
    }
    m.discard(ps);
    m.discard(ns);
    match sum {
        None => constant(m, op, 0.0),
        Some(mut total) => {
            super::widen(m, dst, &mut total, 3);
            m.commit(dst, total);
        }
    }
}

/// Runs `diffuse (N)`, the sum of Cl max (0, N.L) (1 - __nondiffuse), and `specular (N, V, roughness)`, the sum of
/// Cl specularbrdf (L, N, V, roughness) (1 - __nonspecular), over the lights in front of the surface.
fn gather(m: &mut Machine<'_>, op: &Op, specular: bool) {
    let Some(dst) = op.dst else { return };
    let ps = m.captured_global(Global::P);
    let ns = m.captured(op.args[0]);
    let lights = m.illuminated(None, &ps, &ns, true);
    if lights.is_empty() {
        m.discard(ps);
        m.discard(ns);
        return constant(m, op, 0.0);
    }
    compute_as(m, dst, true, 3, |m, out, work| {
        out.data.fill(0.0);
        let n = ns.triple();
        let v = op.args.get(1).map(|&v| m.view(v).triple());
        let roughness = op.args.get(2).map(|&r| m.view(r).lane(0));
        for light in &lights {
            let without = if specular { &light.nonspecular } else { &light.nondiffuse };
            for sample in &light.samples {
                work.each(|i| {
                    if !sample.lit.get(i).copied().unwrap_or(false) {
                        return;
                    }
                    let (l, n) = (sample.l.get(i).normalize_or_zero(), n.get(i));
                    let cos = n.dot(l);
                    if cos.is_nan() || cos <= 0.0 {
                        return;
                    }
                    let factor = match (v, roughness) {
                        (Some(v), Some(r)) if specular => brdf(l, n, v.get(i), r.get(i)),
                        _ => cos,
                    };
                    let scale = factor * (1.0 - without.get(i).copied().unwrap_or(0.0));
                    let so_far: Color = Vec3::from(out.parts3().map(|part| part[i]));
                    out.set3(i, so_far + sample.cl.get(i) * scale);
                });
            }
        }
    });
    m.discard(ps);
    m.discard(ns);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn highlights_have_the_values_of_the_formula() {
        let n = Vec3::Z;
        assert_eq!(brdf(n, n, n, 0.1), 1.0);
        // H at 45 degrees: cos^16 is 1/256 at roughness 0.5, cos^8 is 1/16 at 1.
        let (l, v) = (Vec3::X, Vec3::Z);
        assert!((brdf(l, n, v, 0.5) - 1.0 / 256.0).abs() < 1e-7);
        assert!((brdf(l, n, v, 1.0) - 1.0 / 16.0).abs() < 1e-6);
        // Light and viewer are opposite, so there is no halfway direction.
        assert_eq!(brdf(Vec3::X, n, -Vec3::X, 0.1), 0.0);
        assert!(brdf(l, n, v, 0.0).is_finite() && brdf(n, n, n, 0.0) == 1.0);
    }
}
