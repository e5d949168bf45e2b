//! Optimises the code of one instance before it runs. The results stay the same to the bit.
//!
//! Values that are known at link time (constants, the values of the instance, defaults) are [folded](fold) through
//! the code and resolve conditions. Repeated computations are done [once](reuse). Unused code is [removed](dead),
//! and loop-invariant code moves in front of its loop. Code that no question to the renderer has an influence on moves
//! in [front](early) of the questions. All passes work on the structured code of a program, whose
//! symbols keep their indices. Constants are appended to them.
//!
//! A primitive variable may replace a parameter that was folded. The code as it was compiled is kept, and a grid
//! with such a variable runs that.
//!
//! There is one intended difference: errors that code reports as it runs are not found in code that was removed.

mod dead;
mod early;
mod effects;
mod fold;
mod reuse;
mod select;
mod slice;

use crate::program::{Block, Operation, Program, Stmt};
use granita_gsl::ir::{ConstValue, Module, Symbol, SymbolId, SymbolKind, SymbolType};
use std::collections::HashMap;
use std::sync::Arc;

pub(crate) use dead::{occurrences, operands};
pub(crate) use effects::{Effect, effect, first_written, is_inert, is_partial, written};
pub(crate) use slice::slice;

/// The value of a parameter before the shader runs.
#[derive(Clone, Debug)]
pub(crate) enum Known {
    /// The value of its default.
    Default,
    /// This value.
    Given(ConstValue),
    /// An unknown value.
    Unknown,
}

/// Optimised code for one layer.
#[derive(Clone, Debug)]
pub(crate) struct Better {
    /// The program with this body and with more symbols.
    pub(crate) program: Program,
    /// The indices of the parameters that must not be replaced by primitive variables.
    pub(crate) assumed: Vec<usize>,
}

/// Optimises the program of a module. `known` holds the values by parameter.
pub(crate) fn optimize(module: &Module, program: &Program, known: &[Known]) -> Better {
    let mut pool = Constants::new(module);
    let (mut body, assumed) = fold::fold(module, program, known, &mut pool);
    reuse::reuse(&mut body, &pool.symbols);
    // Operations that became copies of constants may resolve more conditions.
    dead::remove(&mut body, &pool.symbols);
    dead::hoist(&mut body, &pool.symbols);
    select::select(&mut body, &mut pool.symbols);
    dead::merge_copies(&mut body, &pool.symbols);
    early::advance(&mut body, &pool.symbols);
    let inits = program.inits.clone();
    Better { program: Program { symbols: pool.symbols, inits, body }, assumed }
}

/// All symbols, with an index of the constants by value.
struct Constants {
    symbols: Vec<Symbol>,
    by_value: HashMap<(SymbolType, Key), SymbolId>,
}

/// A constant to the bit.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
enum Key {
    Bits(Vec<u32>),
    Texts(Vec<Arc<str>>),
}

impl Key {
    fn of(value: &ConstValue) -> Self {
        match value {
            ConstValue::Floats(v) => Self::Bits(v.iter().map(|x| x.to_bits()).collect()),
            ConstValue::Strings(v) => Self::Texts(v.to_vec()),
        }
    }
}

impl Constants {
    fn new(module: &Module) -> Self {
        let mut by_value = HashMap::new();
        for (k, symbol) in module.symbols.iter().enumerate() {
            if let SymbolKind::Const(value) = &symbol.kind {
                by_value.entry((symbol.ty, Key::of(value))).or_insert(SymbolId(k as u32));
            }
        }
        Self { symbols: module.symbols.clone(), by_value }
    }

    /// Returns the constant's symbol, which is added on first use.
    fn add(&mut self, ty: SymbolType, value: ConstValue) -> SymbolId {
        let symbols = &mut self.symbols;
        *self.by_value.entry((ty, Key::of(&value))).or_insert_with(|| {
            symbols.push(Symbol { name: "".into(), ty, kind: SymbolKind::Const(value) });
            SymbolId(symbols.len() as u32 - 1)
        })
    }

    fn value(&self, id: SymbolId) -> Option<&ConstValue> {
        match &self.symbols[id.0 as usize].kind {
            SymbolKind::Const(value) => Some(value),
            _ => None,
        }
    }
}

/// Returns the number of operations in a block and inside of it.
pub(crate) fn operations(block: &[Stmt]) -> usize {
    block
        .iter()
        .map(|stmt| match stmt {
            Stmt::Op(op) => usize::from(!matches!(op.code, Operation::Fused(_))),
            other => blocks(other).into_iter().map(|b| operations(b)).sum(),
        })
        .sum()
}

/// Returns the blocks inside of a statement.
pub(crate) fn blocks(stmt: &Stmt) -> Vec<&Block> {
    match stmt {
        Stmt::If { then, otherwise, .. } => vec![then, otherwise],
        Stmt::Loop { test, body, step, .. } => vec![test, body, step],
        Stmt::Scope { body, .. }
        | Stmt::Lights { body, .. }
        | Stmt::Emit { body, .. }
        | Stmt::Trace { body, .. } => vec![body],
        Stmt::Op(_) | Stmt::Leave(_) | Stmt::Break | Stmt::Continue | Stmt::Exit => vec![],
    }
}

/// Returns the mutable blocks inside of a statement.
pub(crate) fn blocks_mut(stmt: &mut Stmt) -> Vec<&mut Block> {
    match stmt {
        Stmt::If { then, otherwise, .. } => vec![then, otherwise],
        Stmt::Loop { test, body, step, .. } => vec![test, body, step],
        Stmt::Scope { body, .. }
        | Stmt::Lights { body, .. }
        | Stmt::Emit { body, .. }
        | Stmt::Trace { body, .. } => vec![body],
        Stmt::Op(_) | Stmt::Leave(_) | Stmt::Break | Stmt::Continue | Stmt::Exit => vec![],
    }
}

/// Calls `f` for each symbol that the statement itself reads, without operations and blocks inside.
fn operands_mut(stmt: &mut Stmt, mut f: impl FnMut(&mut SymbolId)) {
    use granita_gsl::ir::EmitForm as E;
    match stmt {
        Stmt::If { cond, .. } => f(cond),
        Stmt::Lights { category, position, cone, .. } => {
            category.iter_mut().for_each(&mut f);
            f(position);
            if let Some((axis, angle)) = cone {
                f(axis);
                f(angle);
            }
        }
        Stmt::Emit { form, .. } => match form {
            E::Point(from) => f(from),
            E::Cone { from, axis, angle } => [from, axis, angle].into_iter().for_each(f),
            E::Distant { axis, spread } => [axis, spread].into_iter().for_each(f),
            E::Reflection => {}
        },
        Stmt::Trace { set, position, axis, angle, samples, options, .. } => {
            [set, position, axis, angle, samples].into_iter().for_each(&mut f);
            options.iter_mut().for_each(|(name, value)| {
                f(name);
                f(value);
            });
        }
        // A loop's condition is read inside of it.
        Stmt::Loop { .. } | Stmt::Op(_) | Stmt::Scope { .. } => {}
        Stmt::Leave(_) | Stmt::Break | Stmt::Continue | Stmt::Exit => {}
    }
}
