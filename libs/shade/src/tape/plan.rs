//! Plans, which are tapes for one choice of varying registers.

use super::{Code, Input, Ref, Tape};
use crate::native::Native;
use crate::run::lanes::{Binary as B, Ternary as T};
use std::sync::Arc;

/// One step over strips. Operands and result are rows of the strip's scratch memory. The result is after its
/// operands.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StripStep {
    pub(crate) code: Code,
    pub(crate) out: u32,
    pub(crate) args: [u32; 3],
}

/// One step for all points. Operands are indices into the list of scalars, and the result is appended to it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ScalarStep {
    pub(crate) code: Code,
    pub(crate) args: [u32; 3],
}

/// The place of a component of a result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Part {
    /// A row of the scratch memory.
    Row(u32),
    /// A scalar.
    Scalar(u32),
}

/// A result.
#[derive(Clone, Debug)]
pub(crate) struct Result {
    pub(crate) varying: bool,
    pub(crate) parts: Vec<Part>,
}

/// The work of a tape, in this order.
#[derive(Debug, Default)]
pub(crate) struct Plan {
    /// The scalars begin with these constants,
    pub(crate) constants: Vec<f32>,
    /// continue with uniform registers,
    pub(crate) uniform: Vec<Input>,
    /// and end with values computed from them.
    pub(crate) scalars: Vec<ScalarStep>,
    /// The rows begin with varying registers,
    pub(crate) loads: Vec<Input>,
    /// continue with scalars that steps need,
    pub(crate) splats: Vec<u32>,
    /// and end with computed values.
    pub(crate) steps: Vec<StripStep>,
    /// The results by output of the tape.
    pub(crate) results: Vec<Result>,
    /// The same as native code, once it is there.
    pub(crate) native: Arc<Native>,
}

impl Plan {
    /// Returns the number of rows of a strip.
    pub(crate) fn rows(&self) -> usize {
        self.loads.len() + self.splats.len() + self.steps.len()
    }

    /// Makes a plan for a tape whose inputs vary where `varies` has a bit.
    pub(super) fn new(tape: &Tape, varies: u64) -> Self {
        let input_varies = |k: u32| varies >> k & 1 == 1;
        let mut step_varies = Vec::with_capacity(tape.steps.len());
        for step in &tape.steps {
            let varying = step.args.iter().any(|r| match *r {
                Ref::Const(_) => false,
                Ref::Input(k) => input_varies(k),
                Ref::Value(k) => step_varies[k as usize],
            });
            step_varies.push(varying);
        }
        let mut maker = Maker {
            tape,
            plan: Self::default(),
            scalar: Scalars::default(),
            varying_inputs: (0..tape.inputs.len() as u32).map(input_varies).collect(),
            step_varies,
        };
        maker.number_scalars();
        maker.steps();
        maker.plan
    }
}

/// The indices of scalars.
#[derive(Default)]
struct Scalars {
    constants: Vec<u32>,
    inputs: Vec<u32>,
    steps: Vec<u32>,
}

struct Maker<'a> {
    tape: &'a Tape,
    plan: Plan,
    scalar: Scalars,
    varying_inputs: Vec<bool>,
    step_varies: Vec<bool>,
}

impl Maker<'_> {
    fn varies(&self, r: Ref) -> bool {
        match r {
            Ref::Const(_) => false,
            Ref::Input(k) => self.varying_inputs[k as usize],
            Ref::Value(k) => self.step_varies[k as usize],
        }
    }

    /// Returns the index of a uniform operand among the scalars.
    fn scalar(&self, r: Ref) -> u32 {
        match r {
            Ref::Const(bits) => {
                let k = self.scalar.constants.iter().position(|b| *b == bits);
                k.expect("invariant: constants were collected") as u32
            }
            Ref::Input(k) => self.scalar.inputs[k as usize],
            Ref::Value(k) => self.scalar.steps[k as usize],
        }
    }

    /// Assigns indices to constants, uniform inputs and uniform steps, in this order.
    fn number_scalars(&mut self) {
        let all = self.tape.steps.iter().flat_map(|s| &s.args[..s.code.arity()]);
        for r in all.chain(self.tape.outputs.iter().flat_map(|o| &o.parts)) {
            if let Ref::Const(bits) = r
                && !self.scalar.constants.contains(bits)
            {
                self.scalar.constants.push(*bits);
            }
        }
        self.plan.constants = self.scalar.constants.iter().map(|b| f32::from_bits(*b)).collect();
        let mut next = self.plan.constants.len() as u32;
        for (input, &varying) in self.tape.inputs.iter().zip(&self.varying_inputs) {
            self.scalar.inputs.push(next);
            if !varying {
                self.plan.uniform.push(*input);
                next += 1;
            }
        }
        for (step, &varying) in self.tape.steps.iter().zip(&self.step_varies) {
            self.scalar.steps.push(next);
            if !varying {
                let mut args = [0; 3];
                for (to, &from) in args.iter_mut().zip(&step.args[..step.code.arity()]) {
                    *to = self.scalar(from);
                }
                self.plan.scalars.push(ScalarStep { code: step.code, args });
                next += 1;
            }
        }
    }

    /// Adds varying inputs, scalars that varying steps need, and varying steps, in this order.
    fn steps(&mut self) {
        let list = self.fused();
        let mut input_rows = Vec::new();
        for (input, &varying) in self.tape.inputs.iter().zip(&self.varying_inputs) {
            input_rows.push(self.plan.loads.len() as u32);
            if varying {
                self.plan.loads.push(*input);
            }
        }
        let mut splats: Vec<u32> = Vec::new();
        for (_, code, args) in &list {
            for &r in args[..code.arity()].iter().filter(|r| !self.varies(**r)) {
                let k = self.scalar(r);
                if !splats.contains(&k) {
                    splats.push(k);
                }
            }
        }
        self.plan.splats = splats;
        let mut rows = vec![u32::MAX; self.tape.steps.len()];
        let first = (self.plan.loads.len() + self.plan.splats.len()) as u32;
        for (k, &(value, ..)) in list.iter().enumerate() {
            rows[value] = first + k as u32;
        }
        let row = |m: &Self, r: Ref| match r {
            Ref::Input(k) if m.varies(r) => input_rows[k as usize],
            Ref::Value(k) if m.varies(r) => rows[k as usize],
            uniform => {
                let k = m.scalar(uniform);
                let place = m.plan.splats.iter().position(|s| *s == k);
                (m.plan.loads.len() + place.expect("invariant: splats were collected")) as u32
            }
        };
        for (value, code, args) in &list {
            let mut of = [0; 3];
            for (to, &from) in of.iter_mut().zip(&args[..code.arity()]) {
                *to = row(self, from);
            }
            self.plan.steps.push(StripStep { code: *code, out: rows[*value], args: of });
        }
        for output in &self.tape.outputs {
            let varying = output.parts.iter().any(|r| self.varies(*r));
            let part = |&r: &Ref| {
                if self.varies(r) { Part::Row(row(self, r)) } else { Part::Scalar(self.scalar(r)) }
            };
            let parts = output.parts.iter().map(part).collect();
            self.plan.results.push(Result { varying, parts });
        }
    }

    /// Returns the varying steps. A product that is used by one sum only is computed together with it, as one step
    /// with the same two roundings.
    fn fused(&self) -> Vec<(usize, Code, [Ref; 3])> {
        let steps = &self.tape.steps;
        let mut uses = vec![0_u32; steps.len()];
        let mut count = |r: &Ref| {
            if let Ref::Value(k) = r {
                uses[*k as usize] += 1;
            }
        };
        steps.iter().for_each(|s| s.args[..s.code.arity()].iter().for_each(&mut count));
        // Results must be separate values.
        self.tape.outputs.iter().for_each(|o| {
            o.parts.iter().for_each(|r| {
                count(r);
                count(r);
            });
        });
        let product = |r: Ref| match r {
            Ref::Value(k) if self.step_varies[k as usize] && uses[k as usize] == 1 => {
                let s = &steps[k as usize];
                (s.code == Code::Two(B::Mul)).then_some((k as usize, s.args[0], s.args[1]))
            }
            _ => None,
        };
        let mut gone = vec![false; steps.len()];
        let mut list: Vec<(usize, Code, [Ref; 3])> = Vec::new();
        for (k, step) in steps.iter().enumerate().filter(|(k, _)| self.step_varies[*k]) {
            let [x, y, _] = step.args;
            let batched = match step.code {
                Code::Two(B::Add) => {
                    let right = product(y).map(|(p, a, b)| (p, T::MulAdd, [a, b, x]));
                    right.or_else(|| product(x).map(|(p, a, b)| (p, T::MulAdd, [a, b, y])))
                }
                Code::Two(B::Sub) => {
                    let right = product(y).map(|(p, a, b)| (p, T::SubMul, [a, b, x]));
                    right.or_else(|| product(x).map(|(p, a, b)| (p, T::MulSub, [a, b, y])))
                }
                Code::Two(B::Mul) => product(x).map(|(p, a, b)| (p, T::MulMul, [a, b, y])),
                _ => None,
            };
            match batched {
                // A product that was fused already is not a plain product any more.
                Some((p, code, args))
                    if !gone[p] && list.iter().any(|l| l.0 == p && l.1 == Code::Two(B::Mul)) =>
                {
                    gone[p] = true;
                    list.push((k, Code::Three(code), args));
                }
                _ => list.push((k, step.code, step.args)),
            }
        }
        list.retain(|(k, ..)| !gone[*k]);
        list
    }
}
