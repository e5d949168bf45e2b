//! Runs plans.

use super::build::alone;
use super::plan::{Part, Plan};
use super::strips::{LINE, NARROW, Room, Strips, WIDE};
use super::{Input, Tape};
use crate::native::{NativeCode, NativeStrip, print};
use crate::run::machine::Machine;
use crate::run::simd;
use std::ops::Range;

/// The number of points that native code computes together.
const NATIVE: usize = 256;

impl Machine<'_> {
    /// Runs a tape in the active lanes. Returns `false` when its operations must be run one by one.
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

    /// Computes the values that are the same for all points.
    fn scalars(&self, plan: &Plan, list: &mut Vec<f32>) {
        list.clear();
        list.extend_from_slice(&plan.constants);
        list.extend(plan.uniform.iter().map(|i| self.st.slots[i.slot as usize].data[i.component as usize]));
        for step in &plan.scalars {
            let [a, b, c] = step.args.map(|k| [list[k as usize]]);
            list.push(alone(step.code, [&a, &b, &c]));
        }
    }

    /// Stores the components of results that are the same for all points.
    fn fill_uniform(&self, plan: &Plan, room: &mut Room) {
        for (result, out) in plan.results.iter().zip(&mut room.outs) {
            for (c, part) in result.parts.iter().enumerate() {
                if let Part::Scalar(k) = *part {
                    out.part(c).fill(room.scalars[k as usize]);
                }
            }
        }
    }

    /// Computes the steps for all points.
    fn strips(&mut self, plan: &Plan, room: &mut Room) {
        if plan.native.code().is_none()
            && let Some(compiler) = self.services.native()
        {
            plan.native.count(self.n, compiler, || print(plan));
        }
        match plan.native.code() {
            None => self.tape_strips(plan, room, 0..self.n),
            Some(code) => {
                for lanes in self.native_strips(code, plan, room) {
                    self.tape_strips(plan, room, lanes);
                }
            }
        }
    }

    /// True when so few points are active that narrow strips skip more of the others.
    fn are_few_active(&self) -> bool {
        self.mask.count() * 4 < self.n
    }

    /// Computes the steps for some points, operation by operation.
    fn tape_strips(&self, plan: &Plan, room: &mut Room, lanes: Range<usize>) {
        let len = plan.rows() * WIDE + LINE;
        if room.rows.len() < len {
            room.rows.resize(len, 0.0);
        }
        let rest = if self.are_few_active() { lanes.len() } else { lanes.len() % WIDE };
        let wide_end = lanes.end - rest;
        let mut task = Strips { plan, slots: &self.st.slots, mask: &self.mask, n: self.n, room };
        if lanes.start < wide_end {
            simd::strips_wide(&mut task, lanes.start, wide_end);
        }
        if wide_end < lanes.end {
            simd::strips_narrow(&mut task, wide_end, lanes.end);
        }
    }

    /// Computes the steps for all points by native code. Returns the points for which it is not right.
    fn native_strips(&self, code: &dyn NativeCode, plan: &Plan, room: &mut Room) -> Vec<Range<usize>> {
        let n = self.n;
        let Room { scalars, outs, .. } = room;
        let input =
            |input: &Input| &self.st.slots[input.slot as usize].data[input.component as usize * n..][..n];
        let inputs: Vec<&[f32]> = plan.loads.iter().map(input).collect();
        let mut outputs: Vec<&mut [f32]> = Vec::new();
        for (result, out) in plan.results.iter().zip(outs) {
            let parts = result.parts.iter().zip(out.data.chunks_exact_mut(out.width.max(1)));
            outputs.extend(parts.filter(|(part, _)| matches!(part, Part::Row(_))).map(|(_, values)| values));
        }
        let whole = self.mask.count() == n;
        let width = match whole {
            true => NATIVE,
            false if self.are_few_active() => NARROW,
            false => WIDE,
        };
        let mut left = Vec::new();
        for start in (0..n).step_by(width) {
            let lanes = start..n.min(start + width);
            if !whole && !self.mask.on[lanes.clone()].contains(&true) {
                continue;
            }
            let mut strip =
                NativeStrip { inputs: &inputs, scalars, outputs: &mut outputs, lanes: lanes.clone() };
            if !code.run(&mut strip) {
                left.push(lanes);
            }
        }
        left
    }
}
