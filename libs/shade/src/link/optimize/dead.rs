//! Removes unused code, and moves loop-invariant operations in front of their loops.

use super::effects::{Effect, effect, is_partial, may_complain, written};
use super::{blocks, blocks_mut, operands_mut};
use crate::program::{Block, Op, Stmt};
use granita_gsl::ir::{OpCode, Symbol, SymbolId, SymbolKind};

/// Removes operations whose results are never read, and conditions around empty blocks.
pub(super) fn remove(block: &mut Block, symbols: &[Symbol]) {
    loop {
        let mut read = vec![0; symbols.len()];
        reads(block, &mut |s| read[s.0 as usize] += 1);
        if !sweep(block, symbols, &mut read) {
            return;
        }
    }
}

/// Calls `f` for each symbol that is read.
fn reads(block: &[Stmt], f: &mut dyn FnMut(SymbolId)) {
    for stmt in block {
        match stmt {
            Stmt::Loop { cond: Some(cond), .. } => f(*cond),
            _ => operands(stmt, f),
        }
        blocks(stmt).into_iter().for_each(|b| reads(b, f));
    }
}

/// Calls `f` for each use of a symbol that code reads or writes.
pub(crate) fn occurrences(block: &[Stmt], symbols: &[Symbol], f: &mut dyn FnMut(SymbolId)) {
    reads(block, f);
    block.iter().for_each(|stmt| written(stmt, symbols, f));
}

/// Calls `f` for each symbol that a statement itself reads, without those that blocks inside and the condition of a
/// loop read.
pub(crate) fn operands(stmt: &Stmt, f: &mut dyn FnMut(SymbolId)) {
    match stmt {
        Stmt::Op(op) => op.args.iter().for_each(|s| f(*s)),
        // Operands are found through the one list of them.
        _ if !blocks(stmt).is_empty() => operands_mut(&mut head(stmt), |s| f(*s)),
        _ => {}
    }
}

/// Returns a statement without the code inside.
pub(super) fn head(stmt: &Stmt) -> Stmt {
    match stmt {
        Stmt::If { cond, .. } => Stmt::If { cond: *cond, then: vec![], otherwise: vec![] },
        Stmt::Lights { category, position, cone, at, .. } => {
            Stmt::Lights { category: *category, position: *position, cone: *cone, body: vec![], at: *at }
        }
        Stmt::Emit { form, at, .. } => Stmt::Emit { form: *form, body: vec![], at: *at },
        Stmt::Trace { set, position, axis, angle, samples, options, at, .. } => Stmt::Trace {
            set: *set,
            position: *position,
            axis: *axis,
            angle: *angle,
            samples: *samples,
            options: options.clone(),
            body: vec![],
            at: *at,
            call: None,
        },
        _ => Stmt::Exit,
    }
}

/// Removes unused operations from the end to the beginning, and updates the number of reads of each symbol.
/// Operations that only removed ones used are removed, too. Returns true when something was removed.
fn sweep(block: &mut Block, symbols: &[Symbol], read: &mut [u32]) -> bool {
    let before = block.len();
    let mut changed = false;
    let mut kept = Vec::with_capacity(before);
    for mut stmt in std::mem::take(block).into_iter().rev() {
        for inside in blocks_mut(&mut stmt).into_iter().rev() {
            changed |= sweep(inside, symbols, read);
        }
        match &mut stmt {
            Stmt::Op(op) if is_dead(op, symbols, read) => {
                op.args.iter().for_each(|s| read[s.0 as usize] -= 1);
            }
            Stmt::If { cond, then, otherwise } if then.is_empty() && otherwise.is_empty() => {
                read[cond.0 as usize] -= 1;
            }
            _ => kept.push(stmt),
        }
    }
    kept.reverse();
    *block = kept;
    changed || block.len() != before
}

fn is_dead(op: &Op, symbols: &[Symbol], read: &[u32]) -> bool {
    let Some(dst) = op.dst else { return false };
    let own = matches!(symbols[dst.0 as usize].kind, SymbolKind::Local | SymbolKind::Temp);
    // A copy of a symbol to itself has no effect.
    let idle = op.is(OpCode::Assign) && op.args[0] == dst;
    idle || own && read[dst.0 as usize] == 0 && effect(op, symbols) < Effect::Bound
}

/// Replaces an operation and the copy right after it by one operation, where nothing else reads the first result.
pub(super) fn merge_copies(block: &mut Block, symbols: &[Symbol]) {
    let mut count = vec![0_u32; symbols.len()];
    reads(block, &mut |s| count[s.0 as usize] += 1);
    merge_in(block, symbols, &count);
}

fn merge_in(block: &mut Block, symbols: &[Symbol], count: &[u32]) {
    for stmt in &mut *block {
        blocks_mut(stmt).into_iter().for_each(|b| merge_in(b, symbols, count));
    }
    let mut k = 0;
    while k + 1 < block.len() {
        let (front, back) = block.split_at_mut(k + 1);
        if let (Stmt::Op(op), Stmt::Op(copy)) = (&mut front[k], &back[0])
            && let (Some(result), Some(target)) = (op.dst, copy.dst)
            && copy.is(OpCode::Assign)
            && copy.args[0] == result
            && count[result.0 as usize] == 1
            && symbols[result.0 as usize].kind == SymbolKind::Temp
            && symbols[result.0 as usize].ty == symbols[target.0 as usize].ty
            && symbols[target.0 as usize].ty.array.is_none()
            && !is_partial(op, symbols)
            && effect(op, symbols) <= Effect::Steady
            && !op.args.contains(&target)
        {
            op.dst = Some(target);
            block.remove(k + 1);
        }
        k += 1;
    }
}

/// Moves operations that give the same result in each round of a loop in front of it.
pub(super) fn hoist(block: &mut Block, symbols: &[Symbol]) {
    let mut writes = vec![0_u32; symbols.len()];
    for stmt in &*block {
        written(stmt, symbols, &mut |s| writes[s.0 as usize] += 1);
    }
    hoist_in(block, symbols, &writes);
}

fn hoist_in(block: &mut Block, symbols: &[Symbol], writes: &[u32]) {
    let mut out = Vec::with_capacity(block.len());
    for mut stmt in std::mem::take(block) {
        for inside in blocks_mut(&mut stmt) {
            hoist_in(inside, symbols, writes);
        }
        if matches!(stmt, Stmt::Loop { .. }) {
            let mut changing = vec![false; symbols.len()];
            written(&stmt, symbols, &mut |s| changing[s.0 as usize] = true);
            for inside in blocks_mut(&mut stmt) {
                inside.retain(|stmt| {
                    let Stmt::Op(op) = stmt else { return true };
                    let Some(dst) = op.dst else { return true };
                    let fixed = matches!(symbols[dst.0 as usize].kind, SymbolKind::Temp)
                        && writes[dst.0 as usize] == 1
                        && effect(op, symbols) <= Effect::Steady
                        && !is_partial(op, symbols)
                        && !may_complain(op, symbols)
                        && op.args.iter().all(|s| !changing[s.0 as usize]);
                    if fixed {
                        changing[dst.0 as usize] = false;
                        out.push(stmt.clone());
                    }
                    !fixed
                });
            }
        }
        out.push(stmt);
    }
    *block = out;
}
