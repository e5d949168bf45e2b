//! Illumination functions (reference 5.8.11).

use super::{compute, compute_as, constant};
use crate::program::Op;
use crate::run::gather::{Gather, brdf};
use crate::run::machine::Machine;
use crate::run::simd;
use crate::run::store::Out;
use granita_base::Vec3;
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
    compute_as(m, dst, true, 3, |m, out, _| {
        out.data.fill(0.0);
        let to = Gather {
            normal: ns.triple().xyz,
            highlight: specular.then(|| (m.view(op.args[1]).triple().xyz, m.view(op.args[2]).lane(0))),
            on: &m.mask.on,
        };
        let mut sums = out.parts3();
        for light in &lights {
            let without = if specular { &light.nonspecular } else { &light.nondiffuse };
            light.samples.iter().for_each(|sample| simd::gather(&to, sample, without, &mut sums));
        }
    });
    m.discard(ps);
    m.discard(ns);
}
