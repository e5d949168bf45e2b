//! Runs plans.

use super::plan::{Part, Plan};
use super::{Code, Tape};
use crate::Lane;
use crate::run::lanes;
use crate::run::machine::Machine;
use crate::run::simd;
use crate::run::store::{Mask, Out, Slot};

/// Points of a strip.
pub(crate) const WIDE: usize = 64;
/// Points of a strip where the end of the grid is near, or few points are active.
pub(crate) const NARROW: usize = 16;

/// Numbers of a cache line.
const LINE: usize = 16;

/// Memory of tapes from run to run.
#[derive(Debug, Default)]
pub(crate) struct Room {
    scalars: Vec<f32>,
    rows: Vec<f32>,
    outs: Vec<Out>,
}

/// What a plan works on.
pub(crate) struct Strips<'a> {
    plan: &'a Plan,
    slots: &'a [Slot],
    mask: &'a Mask,
    /// Points of the grid.
    n: usize,
    room: &'a mut Room,
}

/// Takes the points `from..to` through all steps, `W` at a time.
#[inline(always)]
pub(crate) fn strips<const W: usize>(task: &mut Strips<'_>, from: usize, to: usize) {
    let Strips { plan, slots, mask, n, room } = task;
    let Room { scalars, rows, outs } = &mut **room;
    // Loads that straddle cache lines cost twice.
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

/// The first numbers of a row.
#[inline(always)]
fn copy<const W: usize>(row: &mut [f32; W], from: &[f32]) {
    match <&[f32; W]>::try_from(from) {
        Ok(all) => *row = *all,
        Err(_) => row[..from.len()].copy_from_slice(from),
    }
}

impl Machine<'_> {
    /// Runs a tape in the active lanes; `false` when its operations must be run one by one.
    pub(crate) fn tape(&mut self, tape: &Tape) -> bool {
        if self.st.nan_check {
            return false;
        }
        let mut varies = 0_u64;
        for (k, input) in tape.inputs.iter().enumerate() {
            varies |= u64::from(self.st.slots[input.slot as usize].varying) << k;
        }
        let Some(plan) = tape.plan(varies) else { return false };
        let mut room = std::mem::take(&mut self.st.room);
        self.scalars(plan, &mut room.scalars);
        for result in &plan.results {
            let out = self.out(result.varying, result.parts.len());
            room.outs.push(out);
        }
        self.fill_uniform(plan, &mut room);
        if !plan.loads.is_empty() {
            self.strips(plan, &mut room);
        }
        for (output, out) in tape.outputs.iter().zip(room.outs.drain(..)) {
            self.commit_slot(output.slot as usize, out, output.scratch);
        }
        self.st.room = room;
        true
    }

    /// What is the same for all points.
    fn scalars(&self, plan: &Plan, list: &mut Vec<f32>) {
        list.clear();
        list.extend_from_slice(&plan.constants);
        list.extend(plan.uniform.iter().map(|i| self.st.slots[i.slot as usize].data[i.component as usize]));
        for step in &plan.scalars {
            let [a, b, c] = step.args.map(|k| [list[k as usize]]);
            list.push(alone(step.code, [&a, &b, &c]));
        }
    }

    /// Components of results that are the same for all points.
    fn fill_uniform(&self, plan: &Plan, room: &mut Room) {
        for (result, out) in plan.results.iter().zip(&mut room.outs) {
            for (c, part) in result.parts.iter().enumerate() {
                if let Part::Scalar(k) = *part {
                    out.part(c).fill(room.scalars[k as usize]);
                }
            }
        }
    }

    /// Takes all points through the steps.
    fn strips(&self, plan: &Plan, room: &mut Room) {
        let len = plan.rows() * WIDE + LINE;
        if room.rows.len() < len {
            room.rows.resize(len, 0.0);
        }
        // Where few points are active, narrow strips leave out more.
        let few = self.mask.count() * 4 < self.n;
        let wide_end = if few { 0 } else { self.n - self.n % WIDE };
        let n = self.n;
        let mut task = Strips { plan, slots: &self.st.slots, mask: &self.mask, n, room };
        if wide_end > 0 {
            simd::strips_wide(&mut task, 0, wide_end);
        }
        if wide_end < n {
            simd::strips_narrow(&mut task, wide_end, n);
        }
    }
}

/// One step for single numbers.
pub(super) fn alone(code: Code, args: [&[f32; 1]; 3]) -> f32 {
    let mut out = [0.0];
    let [a, b, c] = args.map(|values| Lane { values, stride: 0 });
    match code {
        Code::One(f) => simd::unary(f, &mut out, a),
        Code::Two(f) => simd::binary(f, &mut out, a, b),
        Code::Three(f) => simd::ternary(f, &mut out, a, b, c),
    }
    out[0]
}
