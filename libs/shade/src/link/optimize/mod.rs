//! Makes the code of one instance better before it runs: same results, to the bit, for less work.
//!
//! What is known when a group is linked (constants, the values given with the instance, defaults) is
//! [folded](fold) through the code and settles conditions; what is computed twice is computed
//! [once](reuse); what nobody reads is [left out](dead), and what does not change inside a loop moves in
//! front of it. Everything works on the structured code of a module, whose symbols keep their numbers:
//! constants are added behind them.
//!
//! A primitive variable may replace a parameter that was folded. The code as it was compiled stays beside
//! the better one, and a grid with such a variable runs that.
//!
//! Not the same, on purpose: mistakes that code complains about as it runs are not found in code that was
//! left out.

mod dead;
mod effects;
mod fold;
mod reuse;
mod select;

use granita_gsl::ir::{Block, ConstValue, Module, OpCode, Stmt, Symbol, SymbolId, SymbolKind, SymbolType};
use std::collections::HashMap;
use std::sync::Arc;

pub(crate) use dead::occurrences;
pub(crate) use effects::{is_inert, written};

/// What is known of a parameter before the shader runs.
#[derive(Clone, Debug)]
pub(crate) enum Known {
    /// Whatever its default is.
    Default,
    /// This value.
    Given(ConstValue),
    /// Nothing.
    Unknown,
}

/// Better code for one layer.
#[derive(Clone, Debug)]
pub(crate) struct Better {
    /// The module with this body and with more symbols.
    pub(crate) module: Module,
    /// Parameters (by index) that must not be replaced by primitive variables.
    pub(crate) assumed: Vec<usize>,
}

/// Optimises a module; `known` by parameter.
pub(crate) fn optimize(module: &Module, known: &[Known]) -> Better {
    let mut pool = Constants::new(module);
    let (mut body, assumed) = fold::fold(module, known, &mut pool);
    reuse::reuse(&mut body, &pool.symbols);
    // What became a copy of a constant may settle more.
    dead::remove(&mut body, &pool.symbols);
    dead::hoist(&mut body, &pool.symbols);
    select::select(&mut body, &mut pool.symbols);
    dead::merge_copies(&mut body, &pool.symbols);
    let mut better = module.clone();
    better.symbols = pool.symbols;
    better.body = body;
    Better { module: better, assumed }
}

/// All symbols, with constants found by value.
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

    /// The constant's symbol.
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

/// The number of operations in a block and inside of it.
pub(crate) fn operations(block: &[Stmt]) -> usize {
    block
        .iter()
        .map(|stmt| match stmt {
            Stmt::Op(op) => usize::from(!matches!(op.code, OpCode::Straight(_))),
            other => blocks(other).into_iter().map(|b| operations(b)).sum(),
        })
        .sum()
}

/// The blocks inside of a statement.
fn blocks(stmt: &Stmt) -> Vec<&Block> {
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

/// The blocks inside of a statement, to be changed.
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

/// Calls `f` for each symbol that the statement itself reads, beside operations and blocks inside.
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
