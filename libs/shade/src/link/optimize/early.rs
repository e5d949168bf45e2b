//! Moves operations in front of the questions to the renderer that come before them.
//!
//! What lights, rays and files have no influence on is then computed first, in one piece. Re-renders need not compute
//! it again ([`crate::link::Parts`]).

use super::effects::may_complain;
use super::{Effect, blocks, effect, is_partial, occurrences, written};
use crate::program::{Block, Stmt};
use granita_gsl::ir::{Symbol, SymbolKind};

/// Moves the operations of a body in front of its first question, as far as their operands are known there.
pub(super) fn advance(body: &mut Block, symbols: &[Symbol]) {
    let Some(first) = body.iter().position(|stmt| asks(stmt, symbols)) else { return };
    if body.iter().any(leaves) {
        return;
    }
    let later = body.split_off(first);
    let mut rest = Vec::with_capacity(later.len());
    let mut is_written = vec![false; symbols.len()];
    let mut is_used = vec![false; symbols.len()];
    for stmt in later {
        let may_advance = match &stmt {
            Stmt::Op(op) => op.dst.is_some_and(|dst| {
                let own = matches!(symbols[dst.0 as usize].kind, SymbolKind::Local | SymbolKind::Temp);
                own && !is_used[dst.0 as usize]
                    && effect(op, symbols) == Effect::Pure
                    && !is_partial(op, symbols)
                    && !may_complain(op, symbols)
                    && op.args.iter().all(|arg| !is_written[arg.0 as usize])
            }),
            _ => false,
        };
        if may_advance {
            body.push(stmt);
            continue;
        }
        written(&stmt, symbols, &mut |s| is_written[s.0 as usize] = true);
        occurrences(std::slice::from_ref(&stmt), symbols, &mut |s| is_used[s.0 as usize] = true);
        rest.push(stmt);
    }
    body.append(&mut rest);
}

/// True when a statement asks the renderer something.
fn asks(stmt: &Stmt, symbols: &[Symbol]) -> bool {
    match stmt {
        Stmt::Op(op) => effect(op, symbols) == Effect::Bound,
        Stmt::Lights { .. } | Stmt::Emit { .. } | Stmt::Trace { .. } => true,
        other => blocks(other).into_iter().flatten().any(|stmt| asks(stmt, symbols)),
    }
}

/// True when a statement may end the shader.
fn leaves(stmt: &Stmt) -> bool {
    matches!(stmt, Stmt::Exit) || blocks(stmt).into_iter().flatten().any(leaves)
}
