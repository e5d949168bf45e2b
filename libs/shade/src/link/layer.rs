//! Linked layers.

use super::connections::Connection;
use super::parts::Parts;
use crate::call::Call;
use crate::program::{Block, Place};
use crate::tape::Tape;
use granita_gsl::ValidModule;
use granita_gsl::ir::{Global, SymbolId};
use std::sync::Arc;

/// The sources of the value of a parameter besides primitive variables.
#[derive(Debug)]
pub(crate) struct ParamPlan {
    pub(crate) symbol: SymbolId,
    pub(crate) name: Arc<str>,
    /// The value of the instance.
    pub(crate) given: Option<Arc<[f32]>>,
    pub(crate) connections: Vec<Connection>,
}

/// A linked layer.
#[derive(Debug)]
pub(crate) struct Layer {
    pub(crate) module: ValidModule,
    /// The places of symbols, by symbol.
    pub(crate) places: Vec<Place>,
    pub(crate) params: Vec<ParamPlan>,
    /// By parameter, the code that computes its default.
    pub(crate) inits: Vec<Block>,
    /// The calls with options of all code.
    pub(crate) calls: Vec<Call>,
    /// Connections into globals.
    pub(crate) globals: Vec<Connection>,
    /// The globals that later layers take with the values after this layer, and the registers that keep them.
    pub(crate) kept: Vec<(Global, u32)>,
    /// The code as it was compiled.
    pub(crate) plain: Code,
    /// Optimised code, for grids where no primitive variable replaces the parameters that it relies on.
    pub(crate) better: Option<OptimisedCode>,
    /// The part of the optimised code that determines opacity, where some of it does not.
    pub(crate) opacity: Option<Code>,
    /// True when the layer only computes its parameters. It need not run when they are not used.
    pub(crate) inert: bool,
    /// The indices of the layers that take values from this one.
    pub(crate) feeds: Vec<usize>,
}

/// Code that can run.
#[derive(Debug, Default)]
pub(crate) struct Code {
    pub(crate) body: Block,
    /// The tapes of its [`Operation::Fused`](crate::program::Operation::Fused).
    pub(crate) tapes: Vec<Tape>,
    /// The parts of the body that re-renders run apart.
    pub(crate) parts: Parts,
}

/// Optimised code of a layer.
#[derive(Debug)]
pub(crate) struct OptimisedCode {
    pub(crate) code: Code,
    /// The indices of the parameters whose values it relies on.
    pub(crate) assumed: Vec<usize>,
}
