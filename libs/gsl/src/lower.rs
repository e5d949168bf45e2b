//! Lowering: typed tree to IR. Functions are put in place of their calls, `&&`, `||` and `?:` become
//! conditions, and the rules of reference table 5.4 are checked, since only here it is known in what kind of
//! shader and around what statements a function runs.
//!
//! Temporaries are reused as soon as the statement that made them ends. What is written more than once, or in
//! one branch only, is a nameless local, never a [`SymbolKind::Temp`].

use crate::access;
use crate::builtins::Signature;
use crate::check::zero;
use crate::diagnostic::Diagnostics;
use crate::hir::{self, Component, ExprKind, FuncId, Init, StmtKind, VarId, VarKind};
use crate::ir::*;
use crate::source::Pos;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Statements of one module; functions that call functions twice each would grow without bound.
const MAX_SIZE: usize = 400_000;
/// Blocks within blocks, functions in place.
const MAX_BLOCKS: usize = 256;
/// Recursion of this module's walk.
const MAX_DEPTH: usize = 800;

/// Lowers a checked shader. Mistakes go to `diags`; then the module is of no use.
pub(crate) fn lower(shader: &hir::Shader, diags: &mut Diagnostics) -> Module {
    let mut lowerer = Lowerer {
        diags,
        shader,
        symbols: Vec::new(),
        constants: BTreeMap::new(),
        bound: vec![None; shader.vars.len()],
        free: BTreeMap::new(),
        live: Vec::new(),
        out: Vec::new(),
        returns: Vec::new(),
        next_scope: 0,
        in_lights: 0,
        in_emit: 0,
        size: 0,
        blocks: 0,
        depth: 0,
        stopped: false,
        reads: BTreeSet::new(),
        writes: BTreeSet::new(),
        derivatives: false,
    };
    lowerer.module()
}

#[derive(Clone, PartialEq, Eq, PartialOrd, Ord)]
enum ConstKey {
    Floats(u8, Option<u32>, Vec<u32>),
    Strings(Option<u32>, Vec<Arc<str>>),
}

/// Where `return` goes.
#[derive(Clone, Copy)]
struct Return {
    /// `None` when the only return is the last statement.
    scope: Option<ScopeId>,
    result: Option<SymbolId>,
}

/// A place with its subscripts evaluated.
#[derive(Clone, Copy)]
struct Spot {
    symbol: SymbolId,
    element: Option<SymbolId>,
    part: Part,
}

#[derive(Clone, Copy)]
enum Part {
    All,
    One(SymbolId),
    Cell(SymbolId, SymbolId),
}

struct Lowerer<'a> {
    diags: &'a mut Diagnostics,
    shader: &'a hir::Shader,
    symbols: Vec<Symbol>,
    constants: BTreeMap<ConstKey, SymbolId>,
    /// Symbol of each variable, as far as it has one.
    bound: Vec<Option<SymbolId>>,
    /// Temporaries (true) and nameless locals that are free again, by type.
    free: BTreeMap<(u8, bool), Vec<SymbolId>>,
    /// Those in use, in the order they were taken.
    live: Vec<SymbolId>,
    out: Block,
    returns: Vec<Return>,
    next_scope: u32,
    in_lights: usize,
    in_emit: usize,
    size: usize,
    blocks: usize,
    depth: usize,
    /// A limit was passed; nothing more is made.
    stopped: bool,
    reads: BTreeSet<Global>,
    writes: BTreeSet<Global>,
    derivatives: bool,
}

impl<'a> Lowerer<'a> {
    fn module(&mut self) -> Module {
        let shader = self.shader;
        let mut params = Vec::new();
        for (index, param) in shader.params.iter().enumerate() {
            let var = &shader.vars[param.var.0];
            let symbol = self.symbol(&var.name, var.ty, SymbolKind::Param(index as u32));
            self.bound[param.var.0] = Some(symbol);
        }
        for param in &shader.params {
            let Some(symbol) = self.bound[param.var.0] else { continue };
            let pos = shader.vars[param.var.0].pos;
            let init = self.block(|s| s.initialize(symbol, &param.init, pos, false));
            params.push(ParamDecl {
                symbol,
                output: param.output,
                default: default_value(&param.init, shader.vars[param.var.0].ty),
                init,
                metadata: param.metadata.clone(),
            });
        }
        let body = self.block(|s| s.statements(&shader.body));
        Module {
            kind: shader.kind,
            name: shader.name.clone(),
            metadata: shader.metadata.clone(),
            params,
            symbols: std::mem::take(&mut self.symbols),
            body,
            files: self.diags.sources.names().to_vec(),
            reads: self.reads.iter().copied().collect(),
            writes: self.writes.iter().copied().collect(),
            needs_derivatives: self.derivatives,
        }
    }

    // Symbols.

    fn symbol(&mut self, name: &Arc<str>, ty: SymbolType, kind: SymbolKind) -> SymbolId {
        let id = SymbolId(self.symbols.len() as u32);
        self.symbols.push(Symbol { name: name.clone(), ty, kind });
        id
    }

    fn take(&mut self, ty: ValueType, temp: bool) -> SymbolId {
        let found = self.free.get_mut(&(ty as u8, temp)).and_then(Vec::pop);
        let id = found.unwrap_or_else(|| {
            let kind = if temp { SymbolKind::Temp } else { SymbolKind::Local };
            self.symbol(&Arc::from(""), SymbolType::of(ty), kind)
        });
        self.live.push(id);
        id
    }

    /// A temporary: written once, in code that all its readers run.
    fn temp(&mut self, ty: ValueType) -> SymbolId {
        self.take(ty, true)
    }

    /// A nameless local: may be written in branches.
    fn local(&mut self, ty: ValueType) -> SymbolId {
        self.take(ty, false)
    }

    /// Frees what was taken since `live` had this length.
    fn release(&mut self, mark: usize) {
        for id in self.live.split_off(mark).into_iter().rev() {
            let symbol = &self.symbols[id.0 as usize];
            let key = (symbol.ty.value as u8, symbol.kind == SymbolKind::Temp);
            self.free.entry(key).or_default().push(id);
        }
    }

    fn constant(&mut self, ty: SymbolType, value: &ConstValue) -> SymbolId {
        let key = match value {
            ConstValue::Floats(v) => {
                ConstKey::Floats(ty.value as u8, ty.array, v.iter().map(|x| x.to_bits()).collect())
            }
            ConstValue::Strings(v) => ConstKey::Strings(ty.array, v.to_vec()),
        };
        if let Some(id) = self.constants.get(&key) {
            return *id;
        }
        let id =
            self.symbol(&Arc::from(""), SymbolType { open: false, ..ty }, SymbolKind::Const(value.clone()));
        self.constants.insert(key, id);
        id
    }

    fn float(&mut self, value: f32) -> SymbolId {
        self.constant(SymbolType::of(ValueType::Float), &ConstValue::Floats([value].into()))
    }

    fn variable(&mut self, id: VarId) -> SymbolId {
        if let Some(symbol) = self.bound[id.0] {
            return symbol;
        }
        let var = &self.shader.vars[id.0];
        let kind = match var.kind {
            VarKind::Global(g) => SymbolKind::Global(g),
            _ => SymbolKind::Local,
        };
        let symbol = self.symbol(&var.name, var.ty, kind);
        self.bound[id.0] = Some(symbol);
        symbol
    }

    fn ty(&self, id: SymbolId) -> SymbolType {
        self.symbols[id.0 as usize].ty
    }

    // Code.

    fn emit(&mut self, statement: Stmt, pos: Pos) {
        if self.stopped {
            return;
        }
        self.size += 1;
        if self.size > MAX_SIZE {
            let what =
                format!("the shader has more than {MAX_SIZE} operations when functions are put in place");
            self.stop(pos, what);
            return;
        }
        self.out.push(statement);
    }

    fn op(&mut self, code: OpCode, dst: Option<SymbolId>, args: Vec<SymbolId>, pos: Pos) {
        let at = self.diags.sources.presumed(pos);
        self.emit(Stmt::Op(Op { code, dst, args, at }), pos);
    }

    fn stop(&mut self, pos: Pos, what: String) {
        if !self.stopped {
            self.stopped = true;
            self.diags.error(pos, what);
        }
    }

    fn block(&mut self, fill: impl FnOnce(&mut Self)) -> Block {
        let before = std::mem::take(&mut self.out);
        fill(self);
        std::mem::replace(&mut self.out, before)
    }

    /// As [`Lowerer::block`], within another; counts the nesting.
    fn inner(&mut self, pos: Pos, fill: impl FnOnce(&mut Self)) -> Block {
        self.blocks += 1;
        if self.blocks > MAX_BLOCKS {
            self.stop(
                pos,
                format!("blocks are nested more than {MAX_BLOCKS} deep when functions are put in place"),
            );
        }
        let block = self.block(fill);
        self.blocks -= 1;
        block
    }

    // Statements.

    fn statements(&mut self, list: &'a [hir::Stmt]) {
        for statement in list {
            if self.stopped {
                return;
            }
            let mark = self.live.len();
            self.statement(statement);
            self.release(mark);
        }
    }

    fn statement(&mut self, statement: &'a hir::Stmt) {
        let pos = statement.pos;
        match &statement.kind {
            StmtKind::Expr(expr) => self.effect(expr),
            StmtKind::Declare(var, init) => {
                let symbol = self.variable(*var);
                self.initialize(symbol, init, pos, true);
            }
            StmtKind::Block(list) => self.statements(list),
            StmtKind::If(condition, then, otherwise) => {
                let cond = self.expr(condition);
                let then = self.inner(pos, |s| s.statements(then));
                let otherwise = self.inner(pos, |s| s.statements(otherwise));
                self.emit(Stmt::If { cond, then, otherwise }, pos);
            }
            StmtKind::Loop { body_first, test, body, step } => {
                let forever = test.as_ref().is_none_or(|t| {
                    matches!(&t.kind, ExprKind::Const(ConstValue::Floats(v)) if v.first().is_some_and(|v| *v != 0.0))
                });
                let mut cond = None;
                let test = match test {
                    Some(test) if !forever => self.inner(pos, |s| cond = Some(s.expr(test))),
                    _ => Vec::new(),
                };
                let body = self.inner(pos, |s| s.statements(body));
                let step = self.inner(pos, |s| {
                    if let Some(step) = step {
                        s.effect(step);
                    }
                });
                self.emit(Stmt::Loop { body_first: *body_first, test, cond, body, step }, pos);
            }
            StmtKind::Break => self.emit(Stmt::Break, pos),
            StmtKind::Continue => self.emit(Stmt::Continue, pos),
            StmtKind::Return(value) => self.return_statement(value.as_ref(), pos),
            StmtKind::Emit(args, body) => self.emit_statement(args, body, pos),
            StmtKind::Lights { category, position, cone, body } => {
                self.lighting(access::lights(self.shader.kind), pos);
                let category = category.as_ref().map(|c| self.expr(c));
                let position = self.expr(position);
                let cone = cone.as_ref().map(|(axis, angle)| (self.expr(axis), self.expr(angle)));
                self.in_lights += 1;
                let body = self.inner(pos, |s| s.statements(body));
                self.in_lights -= 1;
                let at = self.diags.sources.presumed(pos);
                self.emit(Stmt::Lights { category, position, cone, body, at }, pos);
            }
            StmtKind::Trace { args, options, body } => {
                let args: Vec<SymbolId> = args.iter().map(|a| self.expr(a)).collect();
                let options = options.iter().map(|(n, v)| (self.expr(n), self.expr(v))).collect();
                let body = self.inner(pos, |s| s.statements(body));
                let at = self.diags.sources.presumed(pos);
                if let [set, position, axis, angle, samples] = args[..] {
                    self.emit(Stmt::Trace { set, position, axis, angle, samples, options, body, at }, pos);
                }
            }
        }
    }

    fn lighting(&mut self, problem: Option<String>, pos: Pos) {
        if let Some(what) = problem {
            self.diags.error(pos, what);
        }
    }

    fn emit_statement(&mut self, args: &'a [hir::Expr], body: &'a [hir::Stmt], pos: Pos) {
        self.lighting(access::emit(self.shader.kind), pos);
        if self.in_emit > 0 {
            self.diags.error(pos, "`emit` stands within `emit`");
        }
        let symbols: Vec<SymbolId> = args.iter().map(|a| self.expr(a)).collect();
        let form = match symbols[..] {
            [from] => EmitForm::Point(from),
            [axis, spread] => EmitForm::Distant { axis, spread },
            [from, axis, angle] => EmitForm::Cone { from, axis, angle },
            _ => EmitForm::Reflection,
        };
        self.in_emit += 1;
        let body = self.inner(pos, |s| s.statements(body));
        self.in_emit -= 1;
        let at = self.diags.sources.presumed(pos);
        self.emit(Stmt::Emit { form, body, at }, pos);
    }

    fn return_statement(&mut self, value: Option<&'a hir::Expr>, pos: Pos) {
        let Some(to) = self.returns.last().copied() else {
            self.emit(Stmt::Exit, pos);
            return;
        };
        if let (Some(value), Some(result)) = (value, to.result) {
            self.expr_to(value, result, pos);
        }
        if let Some(scope) = to.scope {
            self.emit(Stmt::Leave(scope), pos);
        }
    }

    /// Sets a variable to its initial value; without one to zero, so that pictures depend on nothing else.
    fn initialize(&mut self, symbol: SymbolId, init: &'a Init, pos: Pos, clear: bool) {
        let ty = self.ty(symbol);
        match init {
            Init::None if clear => {
                let value = repeat(&zero(ty.value), ty.elements());
                let value = self.constant(ty, &value);
                self.op(OpCode::Assign, Some(symbol), vec![value], pos);
            }
            Init::None => {}
            Init::One(expr) => self.expr_to(expr, symbol, pos),
            Init::List(list) => {
                if let Some(value) = constant_list(list) {
                    let value = self.constant(ty, &value);
                    self.op(OpCode::Assign, Some(symbol), vec![value], pos);
                    return;
                }
                for (i, expr) in list.iter().enumerate() {
                    let mark = self.live.len();
                    let value = self.expr(expr);
                    let index = self.float(i as f32);
                    self.op(OpCode::IndexSet, Some(symbol), vec![index, value], expr.pos);
                    self.release(mark);
                }
            }
        }
    }

    // Expressions.

    /// An expression for what it does.
    fn effect(&mut self, expr: &'a hir::Expr) {
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

    fn expr(&mut self, expr: &'a hir::Expr) -> SymbolId {
        self.value(expr, None)
    }

    /// Puts the value into `dst`.
    fn expr_to(&mut self, expr: &'a hir::Expr, dst: SymbolId, pos: Pos) {
        let found = self.value(expr, Some(dst));
        if found != dst {
            self.op(OpCode::Assign, Some(dst), vec![found], pos);
        }
    }

    /// Computes an expression; into `hint`, when that can be done without harm.
    fn value(&mut self, expr: &'a hir::Expr, hint: Option<SymbolId>) -> SymbolId {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            self.stop(expr.pos, format!("expressions are nested more than {MAX_DEPTH} deep"));
        }
        let out = if self.stopped { self.float(0.0) } else { self.value_kind(expr, hint) };
        self.depth -= 1;
        out
    }

    /// `hint` if it has just this type and `args` do not name it; else a temporary.
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
            ExprKind::Binary(code, a, b) => {
                let args = vec![self.expr(a), self.expr(b)];
                // Component by component it does not matter whether an operand is the result.
                let apart: &[SymbolId] = if ty == ValueType::Matrix { &args } else { &[] };
                let apart = apart.to_vec();
                let dst = self.target(hint, ty, &apart);
                self.op(*code, Some(dst), args, pos);
                dst
            }
            ExprKind::And(a, b) => {
                let a = self.expr(a);
                let cond = self.temp(ty);
                self.op(OpCode::Truth, Some(cond), vec![a], pos);
                let result = self.local(ty);
                self.op(OpCode::Assign, Some(result), vec![cond], pos);
                self.second(cond, b, result, pos);
                result
            }
            ExprKind::Or(a, b) => {
                let a = self.expr(a);
                let cond = self.temp(ty);
                self.op(OpCode::Not, Some(cond), vec![a], pos);
                let result = self.local(ty);
                self.op(OpCode::Not, Some(result), vec![cond], pos);
                self.second(cond, b, result, pos);
                result
            }
            ExprKind::Ternary(condition, a, b) => {
                let cond = self.expr(condition);
                let result = self.local(ty);
                let then = self.inner(pos, |s| s.branch(a, result, pos));
                let otherwise = self.inner(pos, |s| s.branch(b, result, pos));
                self.emit(Stmt::If { cond, then, otherwise }, pos);
                result
            }
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
                self.builtin(signature, args, outputs, ty, hint, pos)
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

    /// The second operand of `&&` or `||`, where `cond` holds.
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
        // Read-only parameters are the checker's; it knows all places that write them.
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

    /// The element (or the whole) that a spot is part of.
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

    /// Adds or subtracts 1; gives the new value.
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

    /// A variable for an argument that is written; the spot, if the value must be stored back.
    fn output(&mut self, expr: &'a hir::Expr) -> (SymbolId, Option<Spot>) {
        let ExprKind::Read(place) = &expr.kind else { return (self.expr(expr), None) };
        let spot = self.spot(place);
        self.write_access(place);
        if place.is_whole() {
            return (spot.symbol, None);
        }
        // Copied in and out: the function may leave it as it is.
        let value = self.load(spot, expr.ty.value, expr.pos);
        let copy = self.local(expr.ty.value);
        self.op(OpCode::Assign, Some(copy), vec![value], expr.pos);
        (copy, Some(spot))
    }

    fn builtin(
        &mut self,
        signature: &'static Signature,
        args: &'a [hir::Expr],
        outputs: &[bool],
        ty: ValueType,
        hint: Option<SymbolId>,
        pos: Pos,
    ) -> SymbolId {
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

    fn call(&mut self, id: FuncId, args: &'a [hir::Expr], pos: Pos) -> SymbolId {
        let shader = self.shader;
        let func = &shader.funcs[id.0];
        // All arguments first: one of them may call the same function.
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
        let scope = early.then(|| {
            self.next_scope += 1;
            ScopeId(self.next_scope - 1)
        });
        self.returns.push(Return { scope, result });
        if !func.returns {
            if let Some(result) = result {
                let value = self.constant(SymbolType::of(func.ret), &zero(func.ret));
                self.op(OpCode::Assign, Some(result), vec![value], pos);
            }
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

/// Whether some `return` is not the last statement of the function.
fn returns_early(body: &[hir::Stmt], outermost: bool) -> bool {
    body.iter().enumerate().any(|(i, s)| match &s.kind {
        StmtKind::Return(_) => !(outermost && i + 1 == body.len()),
        StmtKind::Block(list) => returns_early(list, false),
        StmtKind::If(_, a, b) => returns_early(a, false) || returns_early(b, false),
        StmtKind::Loop { body, .. }
        | StmtKind::Emit(_, body)
        | StmtKind::Lights { body, .. }
        | StmtKind::Trace { body, .. } => returns_early(body, false),
        _ => false,
    })
}

/// A value for each of `n` elements.
fn repeat(value: &ConstValue, n: usize) -> ConstValue {
    match value {
        ConstValue::Floats(v) => ConstValue::Floats(v.repeat(n).into()),
        ConstValue::Strings(v) => {
            ConstValue::Strings(std::iter::repeat_n(v.iter().cloned(), n).flatten().collect())
        }
    }
}

/// Constants, one after the other; `None` when one is none.
fn constant_list(list: &[hir::Expr]) -> Option<ConstValue> {
    let strings = list.first().is_some_and(|e| e.ty.value == ValueType::String);
    let (mut floats, mut texts) = (Vec::new(), Vec::new());
    for expr in list {
        match &expr.kind {
            ExprKind::Const(ConstValue::Floats(v)) => floats.extend_from_slice(v),
            ExprKind::Const(ConstValue::Strings(v)) => texts.extend_from_slice(v),
            _ => return None,
        }
    }
    Some(if strings { ConstValue::Strings(texts.into()) } else { ConstValue::Floats(floats.into()) })
}

/// A constant in a named space: the space, and the numbers as they were written.
fn spaced(expr: &hir::Expr) -> Option<(Option<Arc<str>>, Vec<f32>)> {
    match &expr.kind {
        ExprKind::Const(ConstValue::Floats(v)) => Some((None, v.to_vec())),
        ExprKind::Construct { space: Some(space), parts } => {
            let ExprKind::Const(ConstValue::Strings(space)) = &space.kind else { return None };
            let mut numbers = Vec::new();
            for part in parts {
                let ExprKind::Const(ConstValue::Floats(v)) = &part.kind else { return None };
                numbers.push(v[0]);
            }
            if numbers.len() == 1 {
                let n = numbers[0];
                numbers = match expr.ty.value {
                    ValueType::Matrix => (0..16).map(|i| if i % 5 == 0 { n } else { 0.0 }).collect(),
                    other => vec![n; other.components()],
                };
            }
            Some((Some(space[0].clone()), numbers))
        }
        _ => None,
    }
}

/// A default that needs no computation. Elements of an array in different spaces count as computed.
fn default_value(init: &Init, ty: SymbolType) -> DefaultValue {
    let list = match init {
        Init::None => return DefaultValue::Unknown,
        Init::One(expr) => std::slice::from_ref(expr),
        Init::List(list) => list,
    };
    if ty.value == ValueType::String {
        return match constant_list(list) {
            Some(value @ ConstValue::Strings(_)) => DefaultValue::Known { space: None, value },
            _ if list.is_empty() => {
                DefaultValue::Known { space: None, value: ConstValue::Strings(Arc::from([])) }
            }
            _ => DefaultValue::Unknown,
        };
    }
    let mut all = Vec::new();
    let mut common: Option<Option<Arc<str>>> = None;
    for expr in list {
        let Some((space, numbers)) = spaced(expr) else { return DefaultValue::Unknown };
        if common.as_ref().is_some_and(|c| *c != space) {
            return DefaultValue::Unknown;
        }
        common = Some(space);
        all.extend(numbers);
    }
    DefaultValue::Known { space: common.flatten(), value: ConstValue::Floats(all.into()) }
}
