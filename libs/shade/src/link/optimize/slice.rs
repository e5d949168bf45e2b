//! Finds the part of code that determines some of its symbols.
//!
//! It follows the code from its end to its beginning, and notes which symbols are read later ("live"). An operation is
//! part of the slice when it writes one of these, or when it has an effect.

use super::dead::head;
use super::effects::{Effect, effect, first_written, is_partial, writes_globals};
use super::{blocks_mut, operands_mut};
use crate::program::{Block, Op, Stmt};
use granita_gsl::Func;
use granita_gsl::ir::{Global, ScopeId, Symbol, SymbolId, SymbolKind};

/// Returns the part of a block that has effects or determines the symbols of `live`, which become those that it reads.
///
/// Returns `None` when it asks questions whose random numbers depend on the number of questions before them, some of
/// which may be absent.
pub(crate) fn slice(block: &Block, symbols: &[Symbol], live: &mut Vec<bool>) -> Option<Block> {
    let pinned =
        symbols.iter().map(|s| matches!(s.kind, SymbolKind::Global(g) if is_read_silently(g))).collect();
    let whole = Around { kind: Kind::Whole, after: live.clone(), again: Vec::new(), kept: false };
    let mut slicer = Slicer { symbols, pinned, around: vec![whole], draws: false };
    slicer.pinned.iter().zip(&mut *live).for_each(|(pinned, live)| *live |= pinned);
    let part = slicer.block(block, live);
    (!slicer.draws).then_some(part)
}

/// True for globals that functions read although they are not operands.
fn is_read_silently(global: Global) -> bool {
    use Global as G;
    !matches!(global, G::C | G::opacity | G::L | G::Cl | G::Ps | G::Ns | G::Pl | G::Nl)
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Whole,
    Scope(ScopeId),
    Loop,
}

/// Code that jumps may leave.
struct Around {
    kind: Kind,
    /// The symbols that are live after it.
    after: Vec<bool>,
    /// The symbols that are live where a loop continues.
    again: Vec<bool>,
    /// True when something inside is part of the slice.
    kept: bool,
}

struct Slicer<'a> {
    symbols: &'a [Symbol],
    /// The symbols that are always live.
    pinned: Vec<bool>,
    /// The code around a statement, outermost first.
    around: Vec<Around>,
    /// True when the slice asks questions that draw random numbers.
    draws: bool,
}

impl Slicer<'_> {
    /// Returns the part of a block before code that reads the symbols of `live`, which become those that are live
    /// before the block.
    fn block(&mut self, block: &Block, live: &mut Vec<bool>) -> Block {
        let mut part: Block = block.iter().rev().filter_map(|stmt| self.stmt(stmt, live)).collect();
        part.reverse();
        part
    }

    fn stmt(&mut self, stmt: &Stmt, live: &mut Vec<bool>) -> Option<Stmt> {
        match stmt {
            Stmt::Op(op) => self.op(op, live).then(|| stmt.clone()),
            Stmt::Exit => self.jump(stmt, |kind| kind == Kind::Whole, live),
            Stmt::Leave(scope) => self.jump(stmt, |kind| kind == Kind::Scope(*scope), live),
            Stmt::Break | Stmt::Continue => self.jump(stmt, |kind| kind == Kind::Loop, live),
            Stmt::If { cond, then, otherwise } => {
                let mut other = live.clone();
                let then = self.block(then, live);
                let otherwise = self.block(otherwise, &mut other);
                join(live, &other);
                (!then.is_empty() || !otherwise.is_empty()).then(|| {
                    live[cond.0 as usize] = true;
                    Stmt::If { cond: *cond, then, otherwise }
                })
            }
            Stmt::Scope { id, body } => {
                self.enter(Kind::Scope(*id), live);
                let body = self.block(body, live);
                self.around.pop();
                (!body.is_empty()).then_some(Stmt::Scope { id: *id, body })
            }
            Stmt::Loop { .. } => self.repeated(stmt, live),
            Stmt::Lights { body, .. } | Stmt::Emit { body, .. } | Stmt::Trace { body, .. } => {
                self.enter(Kind::Loop, live);
                let part = self.block(body, &mut live.clone());
                self.around.pop();
                if part.is_empty() {
                    return None;
                }
                self.draws = true;
                operands_mut(&mut head(stmt), |s| live[s.0 as usize] = true);
                Some(stmt.clone())
            }
        }
    }

    /// Returns the part of a loop. It is followed until no more symbols become live.
    fn repeated(&mut self, stmt: &Stmt, live: &mut Vec<bool>) -> Option<Stmt> {
        let Stmt::Loop { body_first, cond, .. } = stmt else { return None };
        let after = live.clone();
        self.enter(Kind::Loop, live);
        let mut begin = after.clone();
        loop {
            let mut part = stmt.clone();
            let [test, body, step] = &mut blocks_mut(&mut part)[..] else { return None };
            let kept = self.around.last().is_some_and(|a| a.kept);
            let mut now = begin.clone();
            let leave = |now: &mut Vec<bool>| {
                join(now, &after);
                cond.iter().filter(|_| kept).for_each(|cond| now[cond.0 as usize] = true);
            };
            if *body_first {
                leave(&mut now);
                **test = self.block(test, &mut now);
            }
            **step = self.block(step, &mut now);
            if let Some(around) = self.around.last_mut() {
                join(&mut around.again, &now);
            }
            **body = self.block(body, &mut now);
            if !*body_first {
                leave(&mut now);
                **test = self.block(test, &mut now);
            }
            let grew = join(&mut begin, &now);
            let is_kept = self.around.last().is_some_and(|a| a.kept);
            if !grew && kept == is_kept {
                self.around.pop();
                if is_kept {
                    *live = begin;
                }
                return is_kept.then_some(part);
            }
        }
    }

    fn enter(&mut self, kind: Kind, live: &[bool]) {
        self.around.push(Around { kind, after: live.to_vec(), again: live.to_vec(), kept: false });
    }

    /// Returns a jump out of the innermost code of a kind, or to its next round. It matters when something there is
    /// part of the slice.
    fn jump(&mut self, stmt: &Stmt, is: impl Fn(Kind) -> bool, live: &mut [bool]) -> Option<Stmt> {
        let at = self.around.iter().rposition(|around| is(around.kind))?;
        if !self.around[at].kept {
            return None;
        }
        self.around[at..].iter_mut().for_each(|around| around.kept = true);
        let target = &self.around[at];
        join(live, if matches!(stmt, Stmt::Continue) { &target.again } else { &target.after });
        Some(stmt.clone())
    }

    /// True when an operation is part of the slice.
    fn op(&mut self, op: &Op, live: &mut [bool]) -> bool {
        let asks = op.func().is_some_and(is_question);
        let of_globals = writes_globals(op);
        let holds = effect(op, self.symbols) == Effect::Bound && !asks
            || of_globals
            || written(op).any(|s| live[s.0 as usize]);
        if !holds {
            return false;
        }
        self.around.iter_mut().for_each(|around| around.kept = true);
        self.draws |= op.func().is_some_and(draws);
        if let Some(dst) = op.dst.filter(|_| !is_partial(op, self.symbols)) {
            live[dst.0 as usize] = self.pinned[dst.0 as usize];
        }
        op.args.iter().for_each(|s| live[s.0 as usize] = true);
        if of_globals {
            for (live, symbol) in live.iter_mut().zip(self.symbols) {
                *live |= matches!(symbol.kind, SymbolKind::Global(_));
            }
        }
        true
    }
}

/// Returns the symbols that an operation may write.
fn written(op: &Op) -> impl Iterator<Item = &SymbolId> {
    op.dst.iter().chain(op.args.iter().skip(first_written(op)))
}

/// Adds all symbols of `other`. Returns true when there are more than before.
fn join(live: &mut [bool], other: &[bool]) -> bool {
    let mut grew = false;
    for (live, other) in live.iter_mut().zip(other) {
        grew |= *other && !*live;
        *live |= other;
    }
    grew
}

/// True when a function asks the renderer something, without any other effect than its results.
fn is_question(func: Func) -> bool {
    use Func as F;
    matches!(
        func,
        F::Environment
            | F::Shadow
            | F::Occlusion
            | F::Indirect
            | F::Ambient
            | F::Diffuse
            | F::Specular
            | F::Texture
            | F::Texture3d
            | F::SpatialDbQuery
            | F::GetAttribute
            | F::GetMessage
            | F::GetTextureInfo
            | F::Fresnel
    )
}

/// True when the random numbers of a question may depend on the number of questions before it.
fn draws(func: Func) -> bool {
    use Func as F;
    matches!(
        func,
        F::Environment
            | F::Shadow
            | F::Occlusion
            | F::Indirect
            | F::Ambient
            | F::Diffuse
            | F::Specular
            | F::Subsurface
            | F::Shadeop
    )
}
