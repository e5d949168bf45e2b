//! Runs plans.

use super::Tape;
use super::build::alone;
use super::plan::{Part, Plan};
use super::strips::{LINE, Room, Strips, WIDE};
use crate::run::machine::Machine;
use crate::run::simd;

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
    fn strips(&self, plan: &Plan, room: &mut Room) {
        let len = plan.rows() * WIDE + LINE;
        if room.rows.len() < len {
            room.rows.resize(len, 0.0);
        }
        // With few active points, narrow strips skip more of the others.
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
