//! Strips of points that a tape processes together.

use super::Code;
use super::plan::{Part, Plan};
use crate::Lane;
use crate::run::lanes;
use crate::run::store::{Mask, Out, Slot};

/// The number of points of a strip.
pub(crate) const WIDE: usize = 64;

/// The number of points of a strip near the end of the grid, or with few active points.
pub(crate) const NARROW: usize = 16;

/// The number of floats of a cache line.
pub(super) const LINE: usize = 16;

/// The memory of tapes, kept from run to run.
#[derive(Debug, Default)]
pub(crate) struct Room {
    pub(super) scalars: Vec<f32>,
    pub(super) rows: Vec<f32>,
    pub(super) outs: Vec<Out>,
}

/// The data that a plan works on.
pub(crate) struct Strips<'a> {
    pub(super) plan: &'a Plan,
    pub(super) slots: &'a [Slot],
    pub(super) mask: &'a Mask,
    /// The number of points of the grid.
    pub(super) n: usize,
    pub(super) room: &'a mut Room,
}

/// Computes all steps for the points `from..to`, `W` at a time.
#[inline(always)]
pub(crate) fn strips<const W: usize>(task: &mut Strips<'_>, from: usize, to: usize) {
    let Strips { plan, slots, mask, n, room } = task;
    let Room { scalars, rows, outs } = &mut **room;
    // Loads across cache lines cost twice as much.
    let aligned = rows.as_ptr().align_offset(LINE * size_of::<f32>());
    let (rows, _) = rows[aligned..].as_chunks_mut::<W>();
    for (row, &k) in rows[plan.loads.len()..].iter_mut().zip(&plan.splats) {
        row.fill(scalars[k as usize]);
    }
    let whole = mask.count() == *n;
    for start in (from..to).step_by(W) {
        let len = W.min(to - start);
        if !whole && !mask.on[start..start + len].contains(&true) {
            continue;
        }
        for (row, input) in rows.iter_mut().zip(&plan.loads) {
            let at = input.component as usize * *n + start;
            copy(row, &slots[input.slot as usize].data[at..at + len]);
        }
        for step in &plan.steps {
            let (before, rest) = rows.split_at_mut(step.out as usize);
            let out: &mut [f32; W] = &mut rest[0];
            let arg = |k: usize| Lane { values: &before[step.args[k] as usize][..], stride: 1 };
            match step.code {
                Code::One(f) => lanes::unary(f, out, arg(0)),
                Code::Two(f) => lanes::binary(f, out, arg(0), arg(1)),
                Code::Three(f) => lanes::ternary(f, out, arg(0), arg(1), arg(2)),
            }
        }
        for (result, out) in plan.results.iter().zip(&mut *outs) {
            for (c, part) in result.parts.iter().enumerate() {
                if let Part::Row(k) = *part {
                    let to = &mut out.part(c)[start..start + len];
                    let row = &rows[k as usize];
                    match <&mut [f32; W]>::try_from(&mut *to) {
                        Ok(to) => *to = *row,
                        Err(_) => to.copy_from_slice(&row[..len]),
                    }
                }
            }
        }
    }
}

/// Copies the first numbers of a row.
#[inline(always)]
fn copy<const W: usize>(row: &mut [f32; W], from: &[f32]) {
    match <&[f32; W]>::try_from(from) {
        Ok(all) => *row = *all,
        Err(_) => row[..from.len()].copy_from_slice(from),
    }
}
