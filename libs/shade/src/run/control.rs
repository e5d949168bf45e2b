//! Runs statements: blocks, conditions, loops and scopes.

use crate::program::{Op, Operation, Stmt};
use crate::run::machine::{LoopFrame, Machine};
use granita_gsl::ir::{OpCode, ScopeId, SourcePos, SymbolId, ValueType};

/// The largest number of iterations. A loop with more counts as endless, and the shader ends for the points that
/// are still in it.
pub(crate) const MAX_ITERATIONS: u32 = 1 << 22;

/// The number of iterations between checks whether the frame must end.
const ITERATIONS_BETWEEN_LOOKS: u32 = 256;

impl Machine<'_> {
    /// Runs statements in order until no lane is active.
    pub(crate) fn block(&mut self, block: &[Stmt]) {
        let mut rest = block;
        while let [stmt, others @ ..] = rest {
            if self.mask.is_empty() {
                return;
            }
            rest = others;
            if let Stmt::Op(Op { code: Operation::Fused(k), .. }) = stmt {
                let tape = &self.tapes[*k as usize];
                if self.tape(tape) {
                    rest = &others[tape.len..];
                }
            } else {
                self.stmt(stmt);
            }
        }
    }

    fn stmt(&mut self, stmt: &Stmt) {
        match stmt {
            Stmt::Op(op) => self.op(op),
            Stmt::If { cond, then, otherwise } => self.condition(*cond, then, otherwise),
            Stmt::Loop { body_first, test, cond, body, step } => {
                self.repeat(*body_first, test, *cond, body, step);
            }
            Stmt::Scope { id, body } => self.scope(*id, body),
            Stmt::Leave(id) => self.leave(*id),
            Stmt::Break => {
                if let Some(frame) = self.loops.last_mut() {
                    frame.broken.add(&self.mask);
                }
                self.mask.clear();
            }
            Stmt::Continue => {
                if let Some(frame) = self.loops.last_mut() {
                    frame.continued.add(&self.mask);
                }
                self.mask.clear();
            }
            Stmt::Exit => self.mask.clear(),
            Stmt::Lights { category, position, cone, body, at: _ } => {
                self.lights(*category, *position, *cone, body);
            }
            Stmt::Emit { form, body, at: _ } => self.emit(form, body),
            Stmt::Trace { set, position, axis, angle, samples, options: _, body, at, call } => {
                let rays = [*set, *position, *axis, *angle, *samples];
                let call = call.and_then(|id| self.code().calls.get(id.0 as usize));
                self.trace(rays, call, body, *at);
            }
        }
    }

    /// Runs `if`. Uniform conditions take one branch, others split the lanes.
    fn condition(&mut self, cond: SymbolId, then: &[Stmt], otherwise: &[Stmt]) {
        let view = self.view(cond);
        if !view.varying {
            let truth = view.get(0) != 0.0;
            self.block(if truth { then } else { otherwise });
            return;
        }
        let mut others = self.borrow_mask();
        others.copy_from(&self.mask);
        let mut mask = std::mem::take(&mut self.mask);
        {
            let truth = self.view(cond).lane(0);
            mask.retain(|i| truth.get(i) != 0.0);
            others.retain(|i| truth.get(i) == 0.0);
        }
        self.mask = mask;
        self.block(then);
        if !others.is_empty() && !otherwise.is_empty() {
            std::mem::swap(&mut self.mask, &mut others);
            self.block(otherwise);
        }
        self.mask.add(&others);
        self.return_mask(others);
    }

    /// Runs any loop.
    fn repeat(
        &mut self,
        body_first: bool,
        test: &[Stmt],
        cond: Option<SymbolId>,
        body: &[Stmt],
        step: &[Stmt],
    ) {
        let frame = LoopFrame { broken: self.borrow_mask(), continued: self.borrow_mask() };
        self.loops.push(frame);
        // The lanes whose test failed.
        let mut done = self.borrow_mask();
        let mut tested = !body_first;
        for iteration in 0.. {
            if tested {
                self.block(test);
                if let Some(cond) = cond {
                    self.split_off(cond, &mut done);
                }
            }
            tested = true;
            if self.mask.is_empty() {
                break;
            }
            self.block(body);
            if let Some(frame) = self.loops.last_mut() {
                self.mask.add(&frame.continued);
                frame.continued.clear();
            }
            self.block(step);
            if self.mask.is_empty() {
                break;
            }
            if iteration % ITERATIONS_BETWEEN_LOOKS == ITERATIONS_BETWEEN_LOOKS - 1
                && self.services.is_stopped()
            {
                break;
            }
            if iteration == MAX_ITERATIONS {
                let what =
                    format!("a loop does not end after {MAX_ITERATIONS} iterations; the shader ends there");
                let at = [test, body, step].into_iter().find_map(first_place);
                self.complain(at.unwrap_or_default(), &what);
                // The whole shader ends, because an endless loop around this one would start it again and again.
                self.mask.clear();
                break;
            }
        }
        self.mask.add(&done);
        self.return_mask(done);
        if let Some(frame) = self.loops.pop() {
            self.mask.add(&frame.broken);
            self.return_mask(frame.broken);
            self.return_mask(frame.continued);
        }
    }

    /// Moves lanes where the condition is false to `done`.
    fn split_off(&mut self, cond: SymbolId, done: &mut crate::run::store::Mask) {
        let view = self.view(cond);
        if !view.varying {
            if view.get(0) == 0.0 {
                done.add(&self.mask);
                self.mask.clear();
            }
            return;
        }
        let mut mask = std::mem::take(&mut self.mask);
        let mut failed = self.borrow_mask();
        failed.copy_from(&mask);
        {
            let truth = self.view(cond).lane(0);
            mask.retain(|i| truth.get(i) != 0.0);
            failed.retain(|i| truth.get(i) == 0.0);
        }
        done.add(&failed);
        self.return_mask(failed);
        self.mask = mask;
    }

    /// Runs an inlined function. Lanes that leave are active again after it.
    fn scope(&mut self, id: ScopeId, body: &[Stmt]) {
        let left = self.borrow_mask();
        self.scopes.push((id, left));
        self.block(body);
        if let Some((_, left)) = self.scopes.pop() {
            self.mask.add(&left);
            self.return_mask(left);
        }
    }

    fn leave(&mut self, id: ScopeId) {
        if let Some((_, left)) = self.scopes.iter_mut().rev().find(|(scope, _)| *scope == id) {
            left.add(&self.mask);
        }
        self.mask.clear();
    }

    /// Runs one operation.
    fn op(&mut self, op: &Op) {
        if !self.st.nan_check {
            return crate::ops::run(self, op);
        }
        // The operands may be the result, so they are checked first.
        let clean = op.args.iter().all(|&s| self.nan_lane(s).is_none());
        crate::ops::run(self, op);
        if clean
            && let Some(dst) = op.dst
            && let Some(lane) = self.nan_lane(dst)
        {
            self.report_nan(op, dst, lane);
        }
    }

    /// Returns the first active lane in which a symbol holds a NaN.
    fn nan_lane(&self, symbol: SymbolId) -> Option<usize> {
        if self.type_of(symbol) == ValueType::String {
            return None;
        }
        let view = self.view(symbol);
        let width = if view.varying { self.n } else { 1 };
        let bad = |i: usize| view.data.iter().skip(i).step_by(width).any(|x| x.is_nan());
        match view.varying {
            true => self.mask.active.iter().map(|&i| i as usize).find(|&i| bad(i)),
            false => bad(0).then_some(0),
        }
    }

    /// Reports the origin of a NaN.
    fn report_nan(&mut self, op: &Op, dst: SymbolId, lane: usize) {
        let module = &self.code().module;
        let place = module.location(op.at);
        if !self.group.first_time(format!("nan|{}|{place}|{:?}", self.layer, op.code)) {
            return;
        }
        let numbers = |symbol: SymbolId| {
            let view = self.view(symbol);
            let list: Vec<String> =
                (0..view.components).map(|c| view.lane(c).get(lane).to_string()).collect();
            if list.len() == 1 { list.concat() } else { format!("({})", list.join(" ")) }
        };
        let word = match op.code {
            Operation::Stored(OpCode::Call(func)) => func.word().to_owned(),
            Operation::Stored(code) => format!("{code:?}").to_lowercase(),
            code => format!("{code:?}").to_lowercase(),
        };
        let texts = |s: &SymbolId| self.type_of(*s) == ValueType::String;
        let operands: Vec<String> = op.args.iter().filter(|s| !texts(s)).map(|&s| numbers(s)).collect();
        let name = module.symbols.get(dst.0 as usize).map_or("", |s| &*s.name);
        let what = if name.is_empty() { String::new() } else { format!(" (in `{name}`)") };
        let text = format!("{word} of {} gives {}{what}, point {lane}", operands.join(", "), numbers(dst));
        self.services.say_of(granita_base::Severity::Warning, &module.name, &place, &text);
    }
}

/// Returns the place of the first operation of a block.
fn first_place(block: &[Stmt]) -> Option<SourcePos> {
    block.iter().find_map(|stmt| match stmt {
        Stmt::Op(op) => Some(op.at).filter(|at| *at != SourcePos::default()),
        Stmt::If { then, otherwise, .. } => first_place(then).or_else(|| first_place(otherwise)),
        Stmt::Loop { test, body, .. } => first_place(test).or_else(|| first_place(body)),
        Stmt::Lights { at, .. } | Stmt::Emit { at, .. } | Stmt::Trace { at, .. } => Some(*at),
        Stmt::Scope { body, .. } => first_place(body),
        Stmt::Leave(_) | Stmt::Break | Stmt::Continue | Stmt::Exit => None,
    })
}
