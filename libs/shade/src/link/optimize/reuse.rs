//! Reuses the results of repeated operations, and reads copies from their source.

use super::effects::{Effect, effect, first_written, is_partial, written};
use super::{blocks_mut, operands_mut};
use crate::program::{Block, Op, Operation, Stmt};
use granita_gsl::ir::{OpCode, Symbol, SymbolId, SymbolType};
use std::collections::HashMap;

/// Rewrites a block.
pub(super) fn reuse(block: &mut Block, symbols: &[Symbol]) {
    let count = symbols.len();
    let table = Table { versions: vec![0; count], copies: vec![None; count], known: HashMap::new() };
    Reuse { symbols, next: 1 }.block(block, table);
}

/// A value, which is a symbol and the number of its writes. An operation has certain values as operands.
type Value = (SymbolId, u32);
type Known = HashMap<(Operation, Vec<Value>, SymbolType), Value>;

/// The known facts at a point of the code.
#[derive(Clone)]
struct Table {
    /// By symbol, the number of its last write.
    versions: Vec<u32>,
    /// By symbol, the value that it is a copy of, with its own version at that time.
    copies: Vec<Option<(Value, u32)>>,
    /// Results that are available.
    known: Known,
}

impl Table {
    fn value(&self, s: SymbolId) -> Value {
        (s, self.versions[s.0 as usize])
    }

    /// Returns the symbol that holds the original of a copied value.
    fn resolved(&self, s: SymbolId) -> SymbolId {
        match self.copies[s.0 as usize] {
            Some((source, own)) if own == self.versions[s.0 as usize] && self.value(source.0) == source => {
                source.0
            }
            _ => s,
        }
    }
}

struct Reuse<'s> {
    symbols: &'s [Symbol],
    next: u32,
}

impl Reuse<'_> {
    fn block(&mut self, block: &mut Block, mut table: Table) {
        for stmt in block {
            self.stmt(stmt, &mut table);
        }
    }

    fn stmt(&mut self, stmt: &mut Stmt, table: &mut Table) {
        operands_mut(stmt, |s| *s = table.resolved(*s));
        if let Stmt::Op(op) = stmt {
            return self.op(op, table);
        }
        let branches = matches!(stmt, Stmt::If { .. });
        if !branches {
            // A round begins with the values of the last one.
            self.forget(stmt, table);
        }
        for block in blocks_mut(stmt) {
            self.block(block, table.clone());
        }
        self.forget(stmt, table);
    }

    fn op(&mut self, op: &mut Op, table: &mut Table) {
        let outputs = first_written(op);
        for arg in op.args.iter_mut().take(outputs) {
            *arg = table.resolved(*arg);
        }
        let reusable = effect(op, self.symbols) <= Effect::Steady && !is_partial(op, self.symbols);
        let single = op.dst.is_some_and(|d| self.symbols[d.0 as usize].ty.array.is_none());
        let mut key = None;
        if let (Some(dst), true, true) = (op.dst, reusable, single) {
            let ty = self.symbols[dst.0 as usize].ty;
            let args: Vec<Value> = op.args.iter().map(|&s| table.value(s)).collect();
            if !op.is(OpCode::Assign) {
                let found = (op.code, args, ty);
                let held = table.known.get(&found).copied().filter(|v| table.value(v.0) == *v);
                if let Some((source, _)) = held {
                    *op = Op::assign(dst, source, op.at);
                } else {
                    key = Some(found);
                }
            }
        }
        self.forget(&Stmt::Op(op.clone()), table);
        let Some(dst) = op.dst.filter(|_| single) else { return };
        let now = table.value(dst);
        if let Some(key) = key {
            // An operand that is also the result has another value now. The key refers to the old one.
            table.known.insert(key, now);
        }
        if op.is(OpCode::Assign) {
            let source = op.args[0];
            let same = self.symbols[source.0 as usize].ty == self.symbols[dst.0 as usize].ty;
            if same && source != dst {
                table.copies[dst.0 as usize] = Some((table.value(source), now.1));
            }
        }
    }

    /// Assigns new versions to symbols that a statement may write.
    fn forget(&mut self, stmt: &Stmt, table: &mut Table) {
        let next = &mut self.next;
        written(stmt, self.symbols, &mut |s| {
            table.versions[s.0 as usize] = *next;
            *next += 1;
        });
    }
}
