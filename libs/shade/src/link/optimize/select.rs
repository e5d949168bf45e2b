//! Replaces small conditions by selection. Both sides are computed, and the condition chooses.
//!
//! Splitting the lanes of a grid and merging them again costs more than a few operations.

use super::blocks_mut;
use super::effects::{Effect, effect, is_partial, may_complain};
use crate::program::{Block, Op, Operation, Stmt};
use granita_gsl::Func;
use granita_gsl::ir::{OpCode, SourcePos, Symbol, SymbolId, SymbolKind, SymbolType, ValueType};

/// The largest number of operations on one side. With more, skipping them where they are not needed is faster.
const MOST: usize = 5;

/// Replaces conditions inside a block.
pub(super) fn select(block: &mut Block, symbols: &mut Vec<Symbol>) {
    let mut out = Vec::with_capacity(block.len());
    for mut stmt in std::mem::take(block) {
        blocks_mut(&mut stmt).into_iter().for_each(|b| select(b, symbols));
        let Stmt::If { cond, then, otherwise } = &stmt else {
            out.push(stmt);
            continue;
        };
        match sides(then, otherwise, symbols) {
            Some((dst, sides)) => {
                let args = vec![*cond, sides[0].value, sides[1].value];
                out.extend(sides.into_iter().flat_map(|side| side.before).map(Stmt::Op));
                let at = SourcePos::default();
                out.push(Stmt::Op(Op { code: Operation::Select, dst: Some(dst), args, at, call: None }));
            }
            None => out.push(stmt),
        }
    }
    *block = out;
}

/// The code of one side: operations with their own results, and the final value.
struct Side {
    before: Vec<Op>,
    value: SymbolId,
}

/// Returns the variable that both sides set, and their code; `None` when they do more than that.
fn sides(then: &Block, otherwise: &Block, symbols: &mut Vec<Symbol>) -> Option<(SymbolId, [Side; 2])> {
    let target = |block: &Block| match block.last() {
        Some(Stmt::Op(op)) => op.dst,
        _ => None,
    };
    let dst = target(then)?;
    let ty = symbols[dst.0 as usize].ty;
    let plain = ty.array.is_none() && (ty.value == ValueType::Float || ty.value.is_triple());
    let both = otherwise.is_empty() || target(otherwise) == Some(dst);
    if !plain || !both || ![then, otherwise].into_iter().all(|b| is_simple(b, dst, symbols)) {
        return None;
    }
    let a = side(then, dst, ty, symbols);
    let b = match otherwise.is_empty() {
        true => Side { before: Vec::new(), value: dst },
        false => side(otherwise, dst, ty, symbols),
    };
    Some((dst, [a, b]))
}

/// True when a side consists of cheap operations on temporaries, the last of which sets the variable.
fn is_simple(block: &Block, dst: SymbolId, symbols: &[Symbol]) -> bool {
    block.len() <= MOST
        && block.iter().enumerate().all(|(k, stmt)| {
            let Stmt::Op(op) = stmt else { return false };
            let own = op.dst.is_some_and(|d| symbols[d.0 as usize].kind == SymbolKind::Temp && d != dst);
            let last = k + 1 == block.len() && op.dst == Some(dst);
            (own || last) && is_cheap(op, symbols)
        })
}

/// Returns the operations of a side with new result symbols, so that the sides are independent.
fn side(block: &Block, dst: SymbolId, ty: SymbolType, symbols: &mut Vec<Symbol>) -> Side {
    let mut fresh: Vec<(SymbolId, SymbolId)> = Vec::new();
    let mut before = Vec::new();
    for stmt in block {
        let Stmt::Op(op) = stmt else { continue };
        let mut op = op.clone();
        for arg in &mut op.args {
            if let Some((_, to)) = fresh.iter().rev().find(|(from, _)| from == arg) {
                *arg = *to;
            }
        }
        let Some(result) = op.dst else { continue };
        let from = |s: SymbolId| symbols[s.0 as usize].ty;
        if result == dst
            && op.is(OpCode::Assign)
            && (from(op.args[0]) == ty || from(op.args[0]).value == ValueType::Float)
        {
            return Side { before, value: op.args[0] };
        }
        let symbol = Symbol { name: "".into(), ty: from(result), kind: SymbolKind::Temp };
        symbols.push(symbol);
        let to = SymbolId(symbols.len() as u32 - 1);
        fresh.push((result, to));
        op.dst = Some(to);
        before.push(op);
    }
    let value = fresh.last().map_or(dst, |(_, to)| *to);
    Side { before, value }
}

/// True for an operation that is cheap and has no side effects.
fn is_cheap(op: &Op, symbols: &[Symbol]) -> bool {
    let plain = match op.func() {
        Some(func) => {
            use Func as F;
            matches!(
                func,
                F::Abs
                    | F::Fabs
                    | F::Sqrt
                    | F::Min
                    | F::Max
                    | F::Clamp
                    | F::Mix
                    | F::Floor
                    | F::Ceil
                    | F::Sign
            )
        }
        None => true,
    };
    let single = |s: &SymbolId| {
        let ty = symbols[s.0 as usize].ty;
        ty.array.is_none() && !matches!(ty.value, ValueType::Matrix | ValueType::String)
    };
    plain
        && effect(op, symbols) == Effect::Pure
        && !is_partial(op, symbols)
        && !may_complain(op, symbols)
        && op.args.iter().chain(&op.dst).all(single)
}
