//! Differences between neighbouring points (reference 5.8.7).
//!
//! On a rectangular grid they are central inside and one-sided of second order at the borders, so that a quadratic
//! is continuous between grids. Only active neighbours count. Where one is missing, the difference uses the others.
//! At ray hits the neighbours are lanes of their own. Unrelated points have no differences.

use super::{compute_as, result_type};
use crate::differences::{backward, both_differences, forward, minus};
use crate::program::Op;
use crate::run::machine::Machine;
use crate::run::store::Out;
use crate::{Lane, Rect, Topology};
use granita_base::Vec3;
use granita_gsl::Func;
use granita_gsl::ir::{Global, SymbolId};

/// One of the two directions on a grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Direction {
    U,
    V,
}

/// Computes smoothed differences of `x` to the next point.
pub(crate) fn difference(m: &Machine<'_>, x: Lane<'_>, direction: Direction, out: &mut [f32]) {
    if x.stride == 0 {
        out.fill(0.0);
        return;
    }
    let v = x.values;
    match &m.grid.topology {
        Topology::Scattered { .. } => out.fill(0.0),
        Topology::Triplets { n } => {
            let n = *n;
            let from = if direction == Direction::U { n } else { 2 * n };
            for i in 0..n {
                let known = m.mask.on[i] && m.mask.on[from + i];
                let d = if known { minus(v[from + i], v[i]) } else { 0.0 };
                out[i] = d;
                out[n + i] = d;
                out[2 * n + i] = d;
            }
        }
        topology => {
            let all = m.mask.count() == m.n;
            let mut uneven = m.grid.uneven.iter().peekable();
            for rect in topology.rects() {
                let (count, stride, lines, line) = match direction {
                    Direction::U => (rect.nu, 1, rect.nv, rect.nu),
                    Direction::V => (rect.nv, rect.nu, rect.nu, 1),
                };
                // Each rectangle is processed separately.
                let all = all || m.mask.on[rect.lanes()].iter().all(|on| *on);
                for k in 0..lines {
                    let start = rect.first + k * line;
                    if all {
                        line_difference(v, start, stride, count, out);
                    } else {
                        partial_difference(v, &m.mask.on, start, stride, count, out);
                    }
                }
                while let Some(uneven) = uneven.next_if(|u| (u.lane as usize) < rect.lanes().end) {
                    if all {
                        let [along_u, along_v] = both_differences(v, rect, uneven.lane as usize);
                        let of = uneven.of[usize::from(direction == Direction::V)];
                        out[uneven.lane as usize] = of[0] * along_u + of[1] * along_v;
                    }
                }
            }
        }
    }
}

/// Computes the differences of one row or column with all points active.
fn line_difference(v: &[f32], start: usize, stride: usize, count: usize, out: &mut [f32]) {
    let at = |i: usize| start + i * stride;
    match count {
        0 => {}
        1 => out[at(0)] = 0.0,
        2 => {
            let d = minus(v[at(1)], v[at(0)]);
            out[at(0)] = d;
            out[at(1)] = d;
        }
        _ => {
            out[at(0)] = forward(v[at(0)], v[at(1)], v[at(2)]);
            for i in 1..count - 1 {
                out[at(i)] = 0.5 * minus(v[at(i + 1)], v[at(i - 1)]);
            }
            let last = count - 1;
            out[at(last)] = backward(v[at(last)], v[at(last - 1)], v[at(last - 2)]);
        }
    }
}

/// Computes the differences of one row or column with inactive points.
fn partial_difference(v: &[f32], on: &[bool], start: usize, stride: usize, count: usize, out: &mut [f32]) {
    let at = |i: usize| start + i * stride;
    let known = |i: isize| i >= 0 && (i as usize) < count && on[at(i as usize)];
    for i in 0..count {
        if !on[at(i)] {
            continue;
        }
        let k = i as isize;
        let value = |j: isize| v[at(j as usize)];
        out[at(i)] = match (known(k - 1), known(k + 1)) {
            (true, true) => 0.5 * minus(value(k + 1), value(k - 1)),
            (false, true) if known(k + 2) => forward(value(k), value(k + 1), value(k + 2)),
            (false, true) => minus(value(k + 1), value(k)),
            (true, false) if known(k - 2) => backward(value(k), value(k - 1), value(k - 2)),
            (true, false) => minus(value(k), value(k - 1)),
            (false, false) => 0.0,
        };
    }
}

/// Computes unsmoothed differences to the next point, backwards at the last one. They are the true sizes of the
/// surroundings of a point.
fn true_difference(m: &Machine<'_>, x: Lane<'_>, direction: Direction, out: &mut [f32]) {
    if m.grid.topology.rects().next().is_none() {
        return difference(m, x, direction, out);
    }
    if x.stride == 0 {
        out.fill(0.0);
        return;
    }
    let v = x.values;
    let on = |i: usize| m.mask.on[i];
    for Rect { first, nu, nv } in m.grid.topology.rects() {
        for j in 0..nv {
            for i in 0..nu {
                let here = first + j * nu + i;
                let (k, count, stride) = match direction {
                    Direction::U => (i, nu, 1),
                    Direction::V => (j, nv, nu),
                };
                out[here] = if k + 1 < count && on(here + stride) {
                    minus(v[here + stride], v[here])
                } else if k > 0 && on(here - stride) {
                    minus(v[here], v[here - stride])
                } else {
                    0.0
                };
            }
        }
    }
}

/// Returns both differences of a value, with `components` numbers each.
pub(crate) fn differences(m: &mut Machine<'_>, sym: SymbolId, components: usize) -> [Out; 2] {
    let varying = m.view(sym).varying;
    let mut result = [m.out(varying, components), m.out(varying, components)];
    let view = m.view(sym);
    for (out, direction) in result.iter_mut().zip([Direction::U, Direction::V]) {
        for c in 0..components {
            difference(m, view.lane(c), direction, out.part(c));
        }
    }
    result
}

/// Returns the length of the differences over both directions, which is the change of a value between samples.
pub(crate) fn filterwidth(m: &mut Machine<'_>, sym: SymbolId) -> Out {
    let components = m.view(sym).components;
    let [du, dv] = differences(m, sym, components);
    let mut out = m.out(du.varying, 1);
    let part = out.part(0);
    part.fill(0.0);
    for d in [&du, &dv] {
        for c in 0..components {
            crate::run::kernel::fold1(part, d.lane(c), |o, x| o + x * x);
        }
    }
    part.iter_mut().for_each(|x| *x = x.sqrt());
    m.discard(du);
    m.discard(dv);
    out
}

/// Runs the derivative functions.
pub(super) fn run(m: &mut Machine<'_>, func: Func, op: &Op) {
    let Some(dst) = op.dst else { return };
    let x = op.args[0];
    let varying = m.view(x).varying;
    match func {
        Func::DeltaU | Func::DeltaV => {
            let Some(ty) = result_type(m, op) else { return };
            let direction = if func == Func::DeltaU { Direction::U } else { Direction::V };
            compute_as(m, dst, varying, ty.components(), |m, out, _| {
                for c in 0..ty.components() {
                    difference(m, m.view(x).lane(c), direction, out.part(c));
                }
            });
        }
        Func::FilterWidth => {
            let mut out = filterwidth(m, x);
            super::widen(m, dst, &mut out, 1);
            m.commit(dst, out);
        }
        Func::SampleArea => {
            let mut tangents = [m.out(varying, 3), m.out(varying, 3)];
            let view = m.view(x);
            for (out, direction) in tangents.iter_mut().zip([Direction::U, Direction::V]) {
                for c in 0..3 {
                    true_difference(m, view.lane(c), direction, out.part(c));
                }
            }
            compute_as(m, dst, varying, 1, |_, out, work| {
                let (du, dv) = (tangents[0].triple(), tangents[1].triple());
                work.each(|i| out.set(0, i, du.get(i).cross(dv.get(i)).length()));
            });
            tangents.into_iter().for_each(|out| m.discard(out));
        }
        _ => {
            let out = surface_normal(m, x);
            m.commit(dst, out);
        }
    }
}

/// Returns `cross (deltau (p), deltav (p))` with the orientation of the surface, where both have a direction. Where
/// a tangent vanishes (at a pole), the tangent of the next row of points is used. Where it vanishes too, the
/// geometric normal is used.
pub(crate) fn surface_normal(m: &mut Machine<'_>, p: SymbolId) -> Out {
    let p = m.captured(p);
    let out = normals_of(m, &p);
    m.discard(p);
    out
}

/// Does the same as [`surface_normal`] for positions that are not of a symbol.
pub(crate) fn normals_of(m: &mut Machine<'_>, p: &Out) -> Out {
    let mut tangents = [m.out(true, 3), m.out(true, 3)];
    for (out, direction) in tangents.iter_mut().zip([Direction::U, Direction::V]) {
        for c in 0..3 {
            difference(m, p.lane(c), direction, out.part(c));
        }
    }
    let mut out = m.out(true, 3);
    let sign = if m.grid.flip_normals { -1.0 } else { 1.0 };
    {
        let (du, dv) = (tangents[0].triple(), tangents[1].triple());
        let ng = m.global(Global::Ng).triple();
        m.work(true).each(|i| {
            let (a, b) = (du.get(i), dv.get(i));
            let mut normal = a.cross(b);
            // The squared sine is below 1e-10: the vectors are parallel, or one has no length.
            let degenerate = |n: Vec3, a: Vec3, b: Vec3| {
                let size = a.length_squared() * b.length_squared();
                // NaN is degenerate too.
                !(n.length_squared() > 1e-10 * size && size > 0.0)
            };
            if degenerate(normal, a, b) {
                normal = ng.get(i) * sign;
                if let Some(Rect { first, nu, nv }) = m.grid.topology.rect_of(i) {
                    let (u, v) = ((i - first) % nu, (i - first) / nu);
                    let inward =
                        |k: usize, count: usize| if 2 * k < count { k + 1 } else { k.wrapping_sub(1) };
                    let row = (inward(v, nv) < nv).then(|| first + inward(v, nv) * nu + u);
                    let column = (inward(u, nu) < nu).then(|| first + v * nu + inward(u, nu));
                    // At a pole one tangent vanishes. It is taken from the next row or column.
                    let candidates = [
                        row.filter(|&k| m.mask.on[k]).map(|k| (du.get(k), b)),
                        column.filter(|&k| m.mask.on[k]).map(|k| (a, dv.get(k))),
                    ];
                    for (a, b) in candidates.into_iter().flatten() {
                        if !degenerate(a.cross(b), a, b) {
                            normal = a.cross(b);
                            break;
                        }
                    }
                }
            }
            out.set3(i, sign * normal);
        });
    }
    let [du, dv] = tangents;
    m.discard(du);
    m.discard(dv);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parabolas_have_exact_slopes_up_to_the_borders() {
        let f = |i: usize| {
            let x = i as f32;
            0.5 * x * x - 3.0 * x + 1.0
        };
        let v: Vec<f32> = (0..7).map(f).collect();
        let mut out = vec![0.0; 7];
        line_difference(&v, 0, 1, 7, &mut out);
        for (i, d) in out.iter().enumerate() {
            assert_eq!(*d, i as f32 - 3.0);
        }
    }

    #[test]
    fn inactive_neighbours_are_skipped_in_differences() {
        let v = [0.0, 1.0, f32::NAN, 9.0, 16.0, 25.0];
        let on = [true, true, false, true, true, true];
        let mut out = [0.0; 6];
        partial_difference(&v, &on, 0, 1, 6, &mut out);
        assert_eq!(out, [1.0, 1.0, 0.0, 6.0, 8.0, 10.0]);
        let mut all = [0.0; 4];
        let mut some = [0.0; 4];
        let v = [1.0, 4.0, 2.0, 8.0];
        line_difference(&v, 0, 1, 4, &mut all);
        partial_difference(&v, &[true; 4], 0, 1, 4, &mut some);
        assert_eq!(all, some);
    }

    #[test]
    fn differences_of_short_lines_are_constant() {
        let mut out = [7.0; 2];
        line_difference(&[1.0], 0, 1, 1, &mut out[..1]);
        assert_eq!(out[0], 0.0);
        line_difference(&[1.0, 4.0], 0, 1, 2, &mut out);
        assert_eq!(out, [3.0, 3.0]);
    }
}
