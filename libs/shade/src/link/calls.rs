//! Finds the calls with options, as the last step of linking a layer.

use super::optimize::blocks_mut;
use crate::call::Call;
use crate::program::{Block, CallId, Stmt};
use granita_gsl::ir::Symbol;

/// Resolves the options of all calls in a block, and appends the results to `calls`.
pub(super) fn resolve(block: &mut Block, symbols: &[Symbol], calls: &mut Vec<Call>) {
    for stmt in block {
        let found = match stmt {
            Stmt::Op(op) => op.func().and_then(|func| Call::of(func, &op.args, symbols)),
            Stmt::Trace { options, .. } => Some(Call::of_trace(options, symbols)),
            _ => None,
        };
        if let (Some(found), Stmt::Op(crate::program::Op { call, .. }) | Stmt::Trace { call, .. }) =
            (found, &mut *stmt)
        {
            *call = Some(CallId(calls.len() as u32));
            calls.push(found);
        }
        blocks_mut(stmt).into_iter().for_each(|block| resolve(block, symbols, calls));
    }
}
