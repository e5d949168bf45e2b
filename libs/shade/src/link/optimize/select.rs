//! Small conditions without branches: both sides are computed, and the condition chooses.
//!
//! Splitting the lanes of a grid and joining them again costs more than a few operations.

use super::blocks_mut;
use super::effects::{Effect, effect, is_partial, may_complain, written};
use granita_gsl::Func;
use granita_gsl::ir::{Block, Op, OpCode, SourcePos, Stmt, Symbol, SymbolId, SymbolKind, ValueType};

/// More operations on one side than these are better left out where nobody needs them.
const MOST: usize = 4;

/// Turns conditions inside a block.
pub(super) fn select(block: &mut Block, symbols: &[Symbol]) {
    let mut writes = vec![0_u32; symbols.len()];
    for stmt in &*block {
        written(stmt, symbols, &mut |s| writes[s.0 as usize] += 1);
    }
    select_in(block, symbols, &writes);
}

fn select_in(block: &mut Block, symbols: &[Symbol], writes: &[u32]) {
    let mut out = Vec::with_capacity(block.len());
    for mut stmt in std::mem::take(block) {
        blocks_mut(&mut stmt).into_iter().for_each(|b| select_in(b, symbols, writes));
        match stmt {
            Stmt::If { cond, then, otherwise } => match sides(&then, &otherwise, symbols, writes) {
                Some((dst, a, b)) => {
                    let rest = otherwise.len().saturating_sub(1);
                    out.extend(then[..then.len() - 1].iter().cloned());
                    out.extend(otherwise[..rest].iter().cloned());
                    let op = Op {
                        code: OpCode::Select,
                        dst: Some(dst),
                        args: vec![cond, a, b],
                        at: SourcePos::default(),
                    };
                    out.push(Stmt::Op(op));
                }
                None => out.push(Stmt::If { cond, then, otherwise }),
            },
            other => out.push(other),
        }
    }
    *block = out;
}

/// The variable that both sides set, and what to; `None` when they do more than that.
fn sides(
    then: &Block,
    otherwise: &Block,
    symbols: &[Symbol],
    writes: &[u32],
) -> Option<(SymbolId, SymbolId, SymbolId)> {
    let (dst, a) = side(then, symbols, writes)?;
    let b = match side(otherwise, symbols, writes) {
        Some((other, b)) if other == dst => b,
        None if otherwise.is_empty() => dst,
        _ => return None,
    };
    let ty = symbols[dst.0 as usize].ty;
    let fits = |s: SymbolId| {
        let from = symbols[s.0 as usize].ty;
        from.array.is_none() && (from == ty || from.value == ValueType::Float && ty.value.is_triple())
    };
    let plain = ty.array.is_none() && (ty.value == ValueType::Float || ty.value.is_triple());
    (plain && fits(a) && fits(b)).then_some((dst, a, b))
}

/// What the last statement copies where, when the others only prepare it.
fn side(block: &Block, symbols: &[Symbol], writes: &[u32]) -> Option<(SymbolId, SymbolId)> {
    let (last, before) = block.split_last()?;
    if before.len() > MOST || !before.iter().all(|stmt| is_cheap(stmt, symbols, writes)) {
        return None;
    }
    match last {
        Stmt::Op(Op { code: OpCode::Assign, dst: Some(dst), args, .. }) => Some((*dst, args[0])),
        _ => None,
    }
}

/// An operation that nobody minds when it is done for nothing.
fn is_cheap(stmt: &Stmt, symbols: &[Symbol], writes: &[u32]) -> bool {
    let Stmt::Op(op) = stmt else { return false };
    let Some(dst) = op.dst else { return false };
    let own = symbols[dst.0 as usize].kind == SymbolKind::Temp && writes[dst.0 as usize] == 1;
    let plain = match op.code {
        OpCode::Call(func) => {
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
        _ => true,
    };
    own && plain
        && effect(op, symbols) == Effect::Pure
        && !is_partial(op, symbols)
        && !may_complain(op, symbols)
        && symbols[dst.0 as usize].ty.array.is_none()
}
