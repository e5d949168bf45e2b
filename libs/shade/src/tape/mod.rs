//! Runs of plain operations, computed strip by strip.
//!
//! Most of a shader is arithmetic between values that nobody needs for long. Done one operation at a time over a
//! whole grid, every intermediate result is found, checked, stored and read again. A *tape* is such a run of operations
//! taken apart into components: numbered values, each computed once, from numbers, from registers or from values
//! before it. Copies, conversions and constructions vanish, and what is the same for all points is computed once.
//!
//! - [`build`](build::build) makes tapes when a group is linked. The operations stay where they are, behind an
//!   `OpCode::Straight` that stands for them; the executor can always run them instead.
//! - [`Plan`](plan::Plan) is a tape for one choice of which registers vary; made when first needed, kept with the tape.
//! - Running a plan takes strips of 64 points through all of it, so that intermediate values stay in the nearest cache.
//!
//! Values are those of the operations, to the bit: a step calls the loops that the operations call (`run::lanes`).

mod build;
mod plan;
mod run;
mod strips;

pub(crate) use build::fuse;
pub(crate) use strips::{NARROW, Room, Strips, WIDE, strips};

use crate::run::lanes::{Binary, Ternary, Unary};
use granita_gsl::ir::SymbolId;
use std::sync::OnceLock;

/// What a step computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Code {
    One(Unary),
    Two(Binary),
    Three(Ternary),
}

impl Code {
    /// Operands.
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
    /// This number, by its bits.
    Const(u32),
    /// [`Tape::inputs`].
    Input(u32),
    /// [`Tape::steps`], before the one that takes it.
    Value(u32),
}

/// One step; unused operands are `Const (0)`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Step {
    code: Code,
    args: [Ref; 3],
}

/// One component of a register that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Input {
    slot: u32,
    component: u32,
}

/// A register that is written as a whole.
#[derive(Clone, Debug)]
struct Output {
    slot: u32,
    /// Values of inactive lanes need not be kept.
    scratch: bool,
    parts: Vec<Ref>,
}

/// A run of operations, taken apart.
#[derive(Debug)]
pub(crate) struct Tape {
    /// How many operations behind the `Straight` it stands for.
    pub(crate) len: usize,
    inputs: Vec<Input>,
    steps: Vec<Step>,
    outputs: Vec<Output>,
    plans: Plans,
}

/// Plans by the inputs that vary (bit by bit), in the order in which they were needed. A list that only grows can be
/// read by all threads without a lock.
#[derive(Debug, Default)]
struct Plans(OnceLock<Box<Node>>);

#[derive(Debug)]
struct Node {
    varies: u64,
    plan: plan::Plan,
    next: Plans,
}

/// More plans than this no tape gets: the operations run one by one then.
const MAX_PLANS: usize = 32;

impl Tape {
    /// The plan for these varying inputs; `None` when there are too many already.
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

/// Names a symbol in maps.
type Symbols = std::collections::HashMap<SymbolId, Vec<Ref>>;
