//! Computes runs of plain operations strip by strip.
//!
//! Most of a shader is arithmetic with intermediate results that are used only once. Executed one operation at a
//! time over a whole grid, every intermediate result is looked up, checked, stored and read again. A *tape* is such
//! a run of operations divided into components. It is a list of values, each computed once from numbers, from
//! registers or from earlier values. Copies, conversions and constructions vanish, and uniform values are computed
//! once.
//!
//! - [`build`](build::build) makes tapes when a group is linked. The operations stay in place, after an
//!   [`Operation::Fused`](crate::program::Operation::Fused) that represents them. The executor can always run them
//!   instead.
//! - [`Plan`](plan::Plan) is a tape for one choice of varying registers. It is made when first needed and kept with
//!   the tape.
//! - Running a plan processes strips of 64 points through all steps, so that intermediate values stay in the
//!   nearest cache.
//!
//! Values equal those of the operations to the bit, because a step calls the loops that the operations call
//! (`run::lanes`).

mod build;
mod plan;
mod run;
mod strips;

pub(crate) use build::fuse;
pub(crate) use plan::{Part, Plan};
#[cfg(test)]
pub(crate) use plan::{Result as PlanResult, StripStep};
pub(crate) use strips::{NARROW, Room, Strips, WIDE, strips};

use crate::run::lanes::{Binary, Ternary, Unary};
use granita_gsl::ir::SymbolId;
use std::sync::OnceLock;

/// The computation of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Code {
    One(Unary),
    Two(Binary),
    Three(Ternary),
}

impl Code {
    /// Returns the number of operands.
    fn arity(self) -> usize {
        match self {
            Self::One(_) => 1,
            Self::Two(_) => 2,
            Self::Three(_) => 3,
        }
    }
}

/// An operand.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Ref {
    /// A number, by its bits.
    Const(u32),
    /// An index into [`Tape::inputs`].
    Input(u32),
    /// An index into [`Tape::steps`], before the step that takes it.
    Value(u32),
}

/// One step. Unused operands are `Const (0)`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Step {
    code: Code,
    args: [Ref; 3],
}

/// One component of a register that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Input {
    pub(crate) slot: u32,
    pub(crate) component: u32,
}

/// A register that is written as a whole.
#[derive(Clone, Debug)]
struct Output {
    slot: u32,
    /// True when values of inactive lanes need not be kept.
    scratch: bool,
    parts: Vec<Ref>,
}

/// A run of operations, divided into steps.
#[derive(Debug)]
pub(crate) struct Tape {
    /// The number of operations after its [`Operation::Fused`](crate::program::Operation::Fused) that it
    /// represents.
    pub(crate) len: usize,
    inputs: Vec<Input>,
    steps: Vec<Step>,
    outputs: Vec<Output>,
    plans: Plans,
}

/// Plans by the varying inputs (bit by bit), in the order of first use. All threads can read a list that only grows
/// without a lock.
#[derive(Debug, Default)]
struct Plans(OnceLock<Box<Node>>);

#[derive(Debug)]
struct Node {
    varies: u64,
    plan: plan::Plan,
    next: Plans,
}

/// The largest number of plans of a tape. Beyond it the operations run one by one.
const MAX_PLANS: usize = 32;

impl Tape {
    /// Returns the plan for these varying inputs; `None` when there are too many already.
    fn plan(&self, varies: u64) -> Option<&plan::Plan> {
        let mut list = &self.plans;
        for _ in 0..MAX_PLANS {
            let make =
                || Box::new(Node { varies, plan: plan::Plan::new(self, varies), next: Plans::default() });
            let node = list.0.get_or_init(make);
            if node.varies == varies {
                return Some(&node.plan);
            }
            list = &node.next;
        }
        None
    }
}

/// The current components by symbol.
type Symbols = std::collections::HashMap<SymbolId, Vec<Ref>>;
