//! Functions of the whole grid (reference 5.8.8), of the ray, and of arrays' lengths.

use super::{constant, result_type};
use crate::Topology;
use crate::program::Op;
use crate::run::machine::Machine;
use granita_gsl::Func;

/// Runs the functions. Reductions read active lanes only, and their result is uniform.
pub(super) fn run(m: &mut Machine<'_>, func: Func, op: &Op) {
    let flag = |b: bool| f32::from(b);
    match func {
        Func::GridN => constant(m, op, m.n as f32),
        Func::GridNU | Func::GridNV => {
            let (nu, nv) = match &m.grid.topology {
                Topology::Rect { nu, nv } => (*nu, *nv),
                other => (other.points(), 1),
            };
            constant(m, op, if func == Func::GridNU { nu } else { nv } as f32);
        }
        Func::GridIndex => {
            let Some(dst) = op.dst else { return };
            super::compute_as(m, dst, true, 1, |_, out, _| {
                out.part(0).iter_mut().enumerate().for_each(|(i, x)| *x = i as f32);
            });
        }
        Func::GridAny => {
            let view = m.view(op.args[0]);
            let any = (0..view.components).any(|c| {
                let lane = view.lane(c);
                m.mask.active.iter().any(|&i| lane.get(i as usize) != 0.0)
            });
            constant(m, op, flag(any));
        }
        Func::GridMin => reduce(m, op, |a, b| if b < a { b } else { a }),
        Func::GridMax => reduce(m, op, |a, b| if b > a { b } else { a }),
        Func::RayLevel => constant(m, op, m.grid.ray.level as f32),
        Func::IsShadowRay => constant(m, op, flag(m.grid.ray.shadow)),
        Func::IsIndirectRay => constant(m, op, flag(m.grid.ray.indirect)),
        Func::ArrayLength => constant(m, op, m.place(op.args[0]).elements as f32),
        _ => {}
    }
}

/// Reduces all active lanes to one value, component by component. NaNs are skipped.
fn reduce(m: &mut Machine<'_>, op: &Op, f: impl Fn(f32, f32) -> f32) {
    let (Some(dst), Some(ty)) = (op.dst, result_type(m, op)) else { return };
    let mut out = m.out(false, ty.components());
    let view = m.view(op.args[0]);
    for c in 0..ty.components() {
        let lane = view.lane(c);
        let mut values = m.mask.active.iter().map(|&i| lane.get(i as usize)).filter(|x| !x.is_nan());
        let first = values.next().unwrap_or(f32::NAN);
        out.set(c, 0, values.fold(first, &f));
    }
    m.commit(dst, out);
}
