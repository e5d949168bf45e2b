//! A layer that is linked.

use super::wires::Wire;
use crate::program::Place;
use crate::tape::Tape;
use granita_gsl::ir::{Block, Global, Module, SymbolId};
use std::sync::Arc;

/// How a parameter gets its value, beside primitive variables.
#[derive(Debug)]
pub(crate) struct ParamPlan {
    pub(crate) symbol: SymbolId,
    pub(crate) name: Arc<str>,
    /// Value of the instance.
    pub(crate) given: Option<Arc<[f32]>>,
    pub(crate) wires: Vec<Wire>,
}

/// A linked layer.
#[derive(Debug)]
pub(crate) struct Layer {
    pub(crate) module: Arc<Module>,
    /// By symbol.
    pub(crate) places: Vec<Place>,
    pub(crate) params: Vec<ParamPlan>,
    /// Connections into globals.
    pub(crate) globals: Vec<Wire>,
    /// Globals that later layers take as this layer leaves them, and where they are kept.
    pub(crate) kept: Vec<(Global, u32)>,
    /// The code as it was compiled.
    pub(crate) plain: Code,
    /// Better code, for grids where no primitive variable replaces what it relies on.
    pub(crate) better: Option<BetterCode>,
    /// Does nothing but compute its parameters: need not run when nobody takes one.
    pub(crate) inert: bool,
    /// Layers (by number) that take something from this one.
    pub(crate) feeds: Vec<usize>,
}

/// Code that can run.
#[derive(Debug, Default)]
pub(crate) struct Code {
    pub(crate) body: Block,
    /// What its `Straight` operations stand for.
    pub(crate) tapes: Vec<Tape>,
}

/// Optimised code of a layer.
#[derive(Debug)]
pub(crate) struct BetterCode {
    pub(crate) code: Code,
    /// Parameters (by number) whose values it relies on.
    pub(crate) assumed: Vec<usize>,
}
