//! Lowering of expressions, places and calls.

use super::{Lowerer, MANY_ARMS, MAX_DEPTH, Part, Return, Spot};
use crate::access;
use crate::builtins::Signature;
use crate::check::zero;
use crate::hir::{self, Component, ExprKind, FuncId, Operator, StmtKind, VarKind};
use crate::ir::*;
use crate::source::Pos;
use std::sync::Arc;

/// The largest number of operators beside each other whose temporaries are all kept until their statement ends.
const MANY_LINKS: usize = 64;

impl<'a> Lowerer<'a> {
    // Expressions.

    /// Lowers an expression for its side effects.
    pub(super) fn effect(&mut self, expr: &'a hir::Expr) {
        match &expr.kind {
            ExprKind::Step { place, up, .. } => {
                let spot = self.spot(place);
                self.step(spot, place, *up, expr.pos);
            }
            ExprKind::Exit => self.emit(Stmt::Exit, expr.pos),
            ExprKind::Const(_) | ExprKind::Bad => {}
            _ => {
                self.value(expr, None);
            }
        }
    }

    pub(super) fn expr(&mut self, expr: &'a hir::Expr) -> SymbolId {
        self.value(expr, None)
    }

    /// Lowers an expression and stores its value in `dst`.
    pub(super) fn expr_to(&mut self, expr: &'a hir::Expr, dst: SymbolId, pos: Pos) {
        let found = self.value(expr, Some(dst));
        if found != dst {
            self.op(OpCode::Assign, Some(dst), vec![found], pos);
        }
    }

    /// Computes an expression. The result is in `hint` when that is possible without harm.
    fn value(&mut self, expr: &'a hir::Expr, hint: Option<SymbolId>) -> SymbolId {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            self.stop(expr.pos, format!("expressions are nested more than {MAX_DEPTH} deep"));
        }
        let out = if self.stopped { self.float(0.0) } else { self.value_kind(expr, hint) };
        self.depth -= 1;
        out
    }

    /// Returns `hint` if it has exactly this type and is not one of `args`, else a temporary.
    fn target(&mut self, hint: Option<SymbolId>, ty: ValueType, args: &[SymbolId]) -> SymbolId {
        match hint {
            Some(id) if self.ty(id) == SymbolType::of(ty) && !args.contains(&id) => id,
            _ => self.temp(ty),
        }
    }

    fn value_kind(&mut self, expr: &'a hir::Expr, hint: Option<SymbolId>) -> SymbolId {
        let pos = expr.pos;
        let ty = expr.ty.value;
        match &expr.kind {
            ExprKind::Const(value) => self.constant(expr.ty, value),
            ExprKind::Bad | ExprKind::Exit => self.constant(SymbolType::of(ty), &zero(ty)),
            ExprKind::Read(place) => {
                let spot = self.spot(place);
                self.read_access(place);
                self.load(spot, ty, pos)
            }
            ExprKind::Unary(code, a) => {
                let a = self.expr(a);
                let dst = self.target(hint, ty, &[]);
                self.op(*code, Some(dst), vec![a], pos);
                dst
            }
            ExprKind::Chain(first, links) => self.chain(first, links, hint),
            ExprKind::Select(arms, otherwise) => self.select(arms, otherwise, ty, pos),
            ExprKind::Convert(a) => {
                let a = self.expr(a);
                let dst = self.target(hint, ty, &[]);
                self.op(OpCode::Assign, Some(dst), vec![a], pos);
                dst
            }
            ExprKind::Construct { space, parts } => {
                let mut args: Vec<SymbolId> = space.iter().map(|s| self.expr(s)).collect();
                args.extend(parts.iter().map(|p| self.expr(p)).collect::<Vec<_>>());
                let dst = self.target(hint, ty, &args);
                self.op(OpCode::Construct, Some(dst), args, pos);
                dst
            }
            ExprKind::Builtin { signature, args, outputs } => {
                self.builtin(signature, args, outputs, expr, hint)
            }
            ExprKind::Call { func, args } => self.call(*func, args, pos),
            ExprKind::Assign { place, op, value } => self.assign(place, *op, value, expr, pos),
            ExprKind::Step { place, up, postfix } => {
                let spot = self.spot(place);
                if !*postfix {
                    return self.step(spot, place, *up, pos);
                }
                let before = self.load(spot, ty, pos);
                let copy = self.temp(ty);
                self.op(OpCode::Assign, Some(copy), vec![before], pos);
                self.step(spot, place, *up, pos);
                copy
            }
        }
    }

    /// Lowers operators from left to right. In long chains, the result of an operator is freed as soon as the next one
    /// has used it.
    fn chain(&mut self, first: &'a hir::Expr, links: &'a [hir::Link], hint: Option<SymbolId>) -> SymbolId {
        let mark = self.live.len();
        let mut value = self.expr(first);
        let mut pos = first.pos;
        for (k, link) in links.iter().enumerate() {
            value = self.link(value, pos, link, hint.filter(|_| k + 1 == links.len()));
            pos = link.pos;
            if links.len() > MANY_LINKS {
                self.release_but(mark, value);
            }
        }
        value
    }

    fn link(&mut self, a: SymbolId, pos_a: Pos, link: &'a hir::Link, hint: Option<SymbolId>) -> SymbolId {
        let (ty, pos) = (link.ty, link.pos);
        let a = match link.left {
            None => a,
            Some((code, ty)) => {
                let dst = self.temp(ty);
                self.op(code, Some(dst), vec![a], pos_a);
                dst
            }
        };
        let code = match link.operator {
            Operator::Op(code) => code,
            and_or => {
                let cond = self.temp(ty);
                let negated = if and_or == Operator::And { OpCode::Truth } else { OpCode::Not };
                self.op(negated, Some(cond), vec![a], pos);
                let result = self.local(ty);
                let copied = if and_or == Operator::And { OpCode::Assign } else { OpCode::Not };
                self.op(copied, Some(result), vec![cond], pos);
                self.second(cond, &link.right, result, pos);
                return result;
            }
        };
        let args = vec![a, self.expr(&link.right)];
        // For operations by component, an operand may also be the result.
        let apart: &[SymbolId] = if ty == ValueType::Matrix { &args } else { &[] };
        let dst = self.target(hint, ty, apart);
        self.op(code, Some(dst), args, pos);
        dst
    }

    fn select(
        &mut self,
        arms: &'a [(hir::Expr, hir::Expr)],
        otherwise: &'a hir::Expr,
        ty: ValueType,
        pos: Pos,
    ) -> SymbolId {
        let Some(((condition, _), _)) = arms.split_first() else { return self.expr(otherwise) };
        if arms.len() <= MANY_ARMS {
            let cond = self.expr(condition);
            let result = self.local(ty);
            self.select_nested(cond, arms, otherwise, result, pos);
            return result;
        }
        let result = self.local(ty);
        self.in_scope(pos, |s, scope| {
            for (condition, value) in arms {
                let mark = s.live.len();
                let cond = s.expr(condition);
                let then = s.inner(pos, |s| {
                    s.branch(value, result, pos);
                    s.emit(Stmt::Leave(scope), pos);
                });
                s.emit(Stmt::If { cond, then, otherwise: Vec::new() }, pos);
                s.release(mark);
            }
            s.branch(otherwise, result, pos);
        });
        result
    }

    /// Lowers the first arm, whose condition is `cond`, and the others within its `else`.
    fn select_nested(
        &mut self,
        cond: SymbolId,
        arms: &'a [(hir::Expr, hir::Expr)],
        otherwise: &'a hir::Expr,
        result: SymbolId,
        pos: Pos,
    ) {
        let Some(((_, value), rest)) = arms.split_first() else { return };
        let then = self.inner(pos, |s| s.branch(value, result, pos));
        let otherwise = self.inner(pos, |s| match rest.first() {
            None => s.branch(otherwise, result, pos),
            Some((condition, _)) => {
                let mark = s.live.len();
                let cond = s.expr(condition);
                s.select_nested(cond, rest, otherwise, result, pos);
                s.release(mark);
            }
        });
        self.emit(Stmt::If { cond, then, otherwise }, pos);
    }

    /// Lowers the second operand of `&&` or `||`, which runs where `cond` holds.
    fn second(&mut self, cond: SymbolId, b: &'a hir::Expr, result: SymbolId, pos: Pos) {
        let then = self.inner(pos, |s| {
            let mark = s.live.len();
            let b = s.expr(b);
            s.op(OpCode::Truth, Some(result), vec![b], pos);
            s.release(mark);
        });
        self.emit(Stmt::If { cond, then, otherwise: Vec::new() }, pos);
    }

    fn branch(&mut self, expr: &'a hir::Expr, result: SymbolId, pos: Pos) {
        let mark = self.live.len();
        self.expr_to(expr, result, pos);
        self.release(mark);
    }

    // Places.

    fn read_access(&mut self, place: &hir::Place) {
        if let Some(SymbolKind::Global(g)) =
            self.bound[place.var.0].map(|s| self.symbols[s.0 as usize].kind.clone())
        {
            self.read_global(g, place.pos);
        }
    }

    fn read_global(&mut self, g: Global, pos: Pos) {
        self.reads.insert(g);
        if let Some(what) = access::read(self.shader.kind, g, self.in_lights > 0) {
            self.diags.error(pos, what);
        }
    }

    fn write_access(&mut self, place: &hir::Place) {
        let Some(symbol) = self.bound[place.var.0] else { return };
        // The checker reports writes to read-only parameters, because it has all places that write them.
        if let SymbolKind::Global(g) = self.symbols[symbol.0 as usize].kind {
            self.write_global(g, place.pos);
        }
    }

    fn write_global(&mut self, g: Global, pos: Pos) {
        self.writes.insert(g);
        if let Some(what) = access::write(self.shader.kind, g) {
            self.diags.error(pos, what);
        }
    }

    fn spot(&mut self, place: &'a hir::Place) -> Spot {
        let symbol = self.variable(place.var);
        let element = place.element.as_ref().map(|e| self.expr(e));
        let part = match &place.component {
            Component::All => Part::All,
            Component::One(i) => Part::One(self.expr(i)),
            Component::Cell(row, column) => {
                let row = self.expr(row);
                Part::Cell(row, self.expr(column))
            }
        };
        Spot { symbol, element, part }
    }

    /// Returns the element (or the whole) that a spot is part of.
    fn load_element(&mut self, spot: Spot, keep: bool, pos: Pos) -> SymbolId {
        let Some(index) = spot.element else { return spot.symbol };
        let ty = self.ty(spot.symbol).value;
        let dst = if keep { self.local(ty) } else { self.temp(ty) };
        self.op(OpCode::Index, Some(dst), vec![spot.symbol, index], pos);
        dst
    }

    fn load(&mut self, spot: Spot, ty: ValueType, pos: Pos) -> SymbolId {
        let from = self.load_element(spot, false, pos);
        let (code, args) = match spot.part {
            Part::All => return from,
            Part::One(i) => (OpCode::Component, vec![from, i]),
            Part::Cell(row, column) => (OpCode::MatrixComponent, vec![from, row, column]),
        };
        let dst = self.temp(ty);
        self.op(code, Some(dst), args, pos);
        dst
    }

    fn store(&mut self, spot: Spot, value: SymbolId, pos: Pos) {
        if let Part::All = spot.part {
            match spot.element {
                None if value == spot.symbol => {}
                None => self.op(OpCode::Assign, Some(spot.symbol), vec![value], pos),
                Some(i) => self.op(OpCode::IndexSet, Some(spot.symbol), vec![i, value], pos),
            }
            return;
        }
        let whole = self.load_element(spot, true, pos);
        match spot.part {
            Part::All => {}
            Part::One(i) => self.op(OpCode::ComponentSet, Some(whole), vec![i, value], pos),
            Part::Cell(r, c) => self.op(OpCode::MatrixComponentSet, Some(whole), vec![r, c, value], pos),
        }
        if let Some(i) = spot.element {
            self.op(OpCode::IndexSet, Some(spot.symbol), vec![i, whole], pos);
        }
    }

    /// Adds or subtracts 1. Returns the new value.
    fn step(&mut self, spot: Spot, place: &hir::Place, up: bool, pos: Pos) -> SymbolId {
        self.read_access(place);
        self.write_access(place);
        let one = self.float(1.0);
        let code = if up { OpCode::Add } else { OpCode::Sub };
        let old = self.load(spot, ValueType::Float, pos);
        if spot.element.is_none() && matches!(spot.part, Part::All) {
            self.op(code, Some(spot.symbol), vec![old, one], pos);
            return spot.symbol;
        }
        let new = self.temp(ValueType::Float);
        self.op(code, Some(new), vec![old, one], pos);
        self.store(spot, new, pos);
        new
    }

    fn assign(
        &mut self,
        place: &'a hir::Place,
        op: Option<OpCode>,
        value: &'a hir::Expr,
        expr: &hir::Expr,
        pos: Pos,
    ) -> SymbolId {
        let ty = expr.ty.value;
        let spot = self.spot(place);
        self.write_access(place);
        let Some(op) = op else {
            if place.is_whole() {
                self.expr_to(value, spot.symbol, pos);
                return spot.symbol;
            }
            let value = self.expr(value);
            self.store(spot, value, pos);
            return value;
        };
        self.read_access(place);
        let value = self.expr(value);
        let old = self.load(spot, ty, pos);
        if place.is_whole() && ty != ValueType::Matrix {
            self.op(op, Some(spot.symbol), vec![old, value], pos);
            return spot.symbol;
        }
        let new = self.temp(ty);
        self.op(op, Some(new), vec![old, value], pos);
        self.store(spot, new, pos);
        new
    }

    // Calls.

    /// Returns a variable for an argument that is written, and the spot when the value must be stored back.
    fn output(&mut self, expr: &'a hir::Expr) -> (SymbolId, Option<Spot>) {
        let ExprKind::Read(place) = &expr.kind else { return (self.expr(expr), None) };
        let spot = self.spot(place);
        self.write_access(place);
        if place.is_whole() {
            return (spot.symbol, None);
        }
        // The value is copied in and out, because the function may leave it unchanged. The function may also change the
        // variables of the subscripts, but the element is the one at the call.
        let spot = Spot {
            element: spot.element.map(|i| self.kept(i, expr.pos)),
            part: match spot.part {
                Part::All => Part::All,
                Part::One(i) => Part::One(self.kept(i, expr.pos)),
                Part::Cell(r, c) => Part::Cell(self.kept(r, expr.pos), self.kept(c, expr.pos)),
            },
            ..spot
        };
        let value = self.load(spot, expr.ty.value, expr.pos);
        let copy = self.local(expr.ty.value);
        self.op(OpCode::Assign, Some(copy), vec![value], expr.pos);
        (copy, Some(spot))
    }

    /// Returns the current value of a subscript.
    fn kept(&mut self, index: SymbolId, pos: Pos) -> SymbolId {
        if matches!(self.symbols[index.0 as usize].kind, SymbolKind::Const(_) | SymbolKind::Temp) {
            return index;
        }
        let copy = self.temp(ValueType::Float);
        self.op(OpCode::Assign, Some(copy), vec![index], pos);
        copy
    }

    fn builtin(
        &mut self,
        signature: &'static Signature,
        args: &'a [hir::Expr],
        outputs: &[bool],
        expr: &hir::Expr,
        hint: Option<SymbolId>,
    ) -> SymbolId {
        let (ty, pos) = (expr.ty.value, expr.pos);
        if signature.func == crate::Func::ArrayLength {
            let array = self.expr(&args[0]);
            let found = self.ty(array);
            if !found.open {
                return self.float(found.elements() as f32);
            }
            let dst = self.target(hint, ty, &[]);
            self.op(OpCode::Call(signature.func), Some(dst), vec![array], pos);
            return dst;
        }
        self.derivatives |= signature.derivatives;
        for g in signature.reads {
            self.read_global(*g, pos);
        }
        for g in signature.writes {
            self.write_global(*g, pos);
        }
        if signature.runs_lights {
            self.lighting(access::gather(self.shader.kind, signature.func.word()), pos);
        }
        let mut symbols = Vec::with_capacity(args.len());
        let mut back = Vec::new();
        for (arg, output) in args.iter().zip(outputs) {
            if *output {
                let (symbol, spot) = self.output(arg);
                back.extend(spot.map(|s| (s, symbol)));
                symbols.push(symbol);
            } else {
                symbols.push(self.expr(arg));
            }
        }
        let dst = if ty == ValueType::Void { None } else { Some(self.target(hint, ty, &symbols)) };
        self.op(OpCode::Call(signature.func), dst, symbols, pos);
        for (spot, symbol) in back {
            self.store(spot, symbol, pos);
        }
        dst.unwrap_or_else(|| self.float(0.0))
    }

    /// Lowers a call of a library's function. Its operands follow the text that names it.
    fn shadeop(&mut self, text: &Arc<str>, func: &hir::Func, args: &'a [hir::Expr], pos: Pos) -> SymbolId {
        let named = ConstValue::Strings([text.clone()].into());
        let mut symbols = vec![self.constant(SymbolType::of(ValueType::String), &named)];
        let mut back = Vec::new();
        for (arg, formal) in args.iter().zip(&func.formals) {
            if self.shader.vars[formal.0].written {
                let (symbol, spot) = self.output(arg);
                back.extend(spot.map(|s| (s, symbol)));
                symbols.push(symbol);
            } else {
                symbols.push(self.expr(arg));
            }
        }
        let dst = (func.ret != ValueType::Void).then(|| self.local(func.ret));
        self.op(OpCode::Call(crate::Func::Shadeop), dst, symbols, pos);
        for (spot, symbol) in back {
            self.store(spot, symbol, pos);
        }
        dst.unwrap_or_else(|| self.float(0.0))
    }

    fn call(&mut self, id: FuncId, args: &'a [hir::Expr], pos: Pos) -> SymbolId {
        let shader = self.shader;
        let func = &shader.funcs[id.0];
        if let Some(text) = &func.shadeop {
            return self.shadeop(text, func, args, pos);
        }
        // All arguments are computed first, because one of them may call the same function.
        let mut symbols = Vec::with_capacity(args.len());
        let mut back = Vec::new();
        for (arg, formal) in args.iter().zip(&func.formals) {
            let formal = &shader.vars[formal.0];
            let written = formal.written || formal.kind == (VarKind::Formal { output: true });
            let variable = matches!(arg.kind, ExprKind::Read(_));
            let symbol = if written && variable {
                let (symbol, spot) = self.output(arg);
                back.extend(spot.map(|s| (s, symbol)));
                symbol
            } else {
                let value = self.expr(arg);
                if written {
                    let copy = self.local(arg.ty.value);
                    self.op(OpCode::Assign, Some(copy), vec![value], arg.pos);
                    copy
                } else {
                    value
                }
            };
            symbols.push(symbol);
        }
        for (symbol, formal) in symbols.into_iter().zip(&func.formals) {
            self.bound[formal.0] = Some(symbol);
        }
        let result = (func.ret != ValueType::Void).then(|| self.local(func.ret));
        let early = returns_early(&func.body, true);
        let scope = early.then(|| self.scope_id());
        self.returns.push(Return { scope, result });
        if let (false, Some(result)) = (func.returns, result) {
            let value = self.constant(SymbolType::of(func.ret), &zero(func.ret));
            self.op(OpCode::Assign, Some(result), vec![value], pos);
        }
        let body = self.inner(pos, |s| s.statements(&func.body));
        self.returns.pop();
        match scope {
            Some(id) => self.emit(Stmt::Scope { id, body }, pos),
            None => self.out.extend(body),
        }
        for (spot, symbol) in back {
            self.store(spot, symbol, pos);
        }
        result.unwrap_or_else(|| self.float(0.0))
    }
}

/// True when some `return` is not the last statement of the function.
fn returns_early(body: &[hir::Stmt], outermost: bool) -> bool {
    body.iter().enumerate().any(|(i, s)| match &s.kind {
        StmtKind::Return(_) => !(outermost && i + 1 == body.len()),
        StmtKind::Block(list) => returns_early(list, false),
        StmtKind::If(arms, otherwise) => {
            arms.iter().any(|arm| returns_early(&arm.body, false)) || returns_early(otherwise, false)
        }
        StmtKind::Loop { body, .. }
        | StmtKind::Emit(_, body)
        | StmtKind::Lights { body, .. }
        | StmtKind::Trace { body, .. } => returns_early(body, false),
        _ => false,
    })
}
