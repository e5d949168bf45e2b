//! Lowers the typed tree to IR. Functions are inlined, and `&&`, `||` and `?:` become conditions. The rules of
//! reference table 5.4 are checked here, because they depend on the kind of shader and the statements around a
//! function call.
//!
//! Temporaries are reused after the statement that made them. A value that is written more than once, or in one
//! branch only, is an unnamed local, never a [`SymbolKind::Temp`].

mod defaults;
mod expr;

use crate::access;
use crate::check::zero;
use crate::diagnostic::Diagnostics;
use crate::hir::{self, ExprKind, Init, StmtKind, VarId, VarKind};
use crate::ir::*;
use crate::source::Pos;
use defaults::default_value;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// The largest number of statements of one module. Functions that call functions twice each would grow without bound.
const MAX_SIZE: usize = 400_000;
/// The largest depth of nested blocks, with functions inlined.
const MAX_BLOCKS: usize = 256;
/// The largest number of conditions of one `if`, with its `else if`, that are nested in each other's `else`.
const MANY_ARMS: usize = 16;
/// The largest depth of recursion in this module.
const MAX_DEPTH: usize = 800;

/// Lowers a checked shader. Errors go to `diags`. The module is then not valid.
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

/// The target of `return`.
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
    /// The symbol of each variable that has one.
    bound: Vec<Option<SymbolId>>,
    /// The temporaries (true) and unnamed locals that are free again, by type.
    free: BTreeMap<(u8, bool), Vec<SymbolId>>,
    /// The symbols in use, in the order in which they were taken.
    live: Vec<SymbolId>,
    out: Block,
    returns: Vec<Return>,
    next_scope: u32,
    in_lights: usize,
    in_emit: usize,
    size: usize,
    blocks: usize,
    depth: usize,
    /// True after a limit was exceeded. No more code is made then.
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

    /// Returns a temporary, which is written once, in code that all its readers run.
    fn temp(&mut self, ty: ValueType) -> SymbolId {
        self.take(ty, true)
    }

    /// Returns an unnamed local, which may be written in branches.
    fn local(&mut self, ty: ValueType) -> SymbolId {
        self.take(ty, false)
    }

    /// Frees the symbols that were taken since `live` had this length.
    fn release(&mut self, mark: usize) {
        for id in self.live.split_off(mark).into_iter().rev() {
            let symbol = &self.symbols[id.0 as usize];
            let key = (symbol.ty.value as u8, symbol.kind == SymbolKind::Temp);
            self.free.entry(key).or_default().push(id);
        }
    }

    /// Frees the symbols that were taken since `live` had this length, except `kept`.
    fn release_but(&mut self, mark: usize, kept: SymbolId) {
        let is_live = self.live[mark..].contains(&kept);
        self.live[mark..].sort_by_key(|id| *id != kept);
        self.release(mark + usize::from(is_live));
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

    /// Makes a block as [`Lowerer::block`] does, within another one. Counts the nesting.
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
            StmtKind::If(arms, otherwise) => self.arms(arms, otherwise, pos),
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

    /// Lowers `if` with all of its `else if`. A few are nested in each other's `else`. Many are tested in turn, in a
    /// scope that is left by the first one whose condition holds, so that they nest no deeper than one.
    fn arms(&mut self, arms: &'a [hir::Arm], otherwise: &'a [hir::Stmt], pos: Pos) {
        let Some((arm, rest)) = arms.split_first() else { return self.statements(otherwise) };
        if arms.len() <= MANY_ARMS {
            let cond = self.expr(&arm.condition);
            let then = self.inner(pos, |s| s.statements(&arm.body));
            let otherwise = self.inner(pos, |s| {
                let mark = s.live.len();
                s.arms(rest, otherwise, pos);
                s.release(mark);
            });
            self.emit(Stmt::If { cond, then, otherwise }, pos);
            return;
        }
        self.in_scope(pos, |s, scope| {
            for arm in arms {
                let mark = s.live.len();
                let cond = s.expr(&arm.condition);
                let then = s.inner(pos, |s| {
                    s.statements(&arm.body);
                    s.emit(Stmt::Leave(scope), pos);
                });
                s.emit(Stmt::If { cond, then, otherwise: Vec::new() }, pos);
                s.release(mark);
            }
            s.statements(otherwise);
        });
    }

    /// Emits a new scope.
    fn in_scope(&mut self, pos: Pos, fill: impl FnOnce(&mut Self, ScopeId)) {
        let id = self.scope_id();
        let body = self.inner(pos, |s| fill(s, id));
        self.emit(Stmt::Scope { id, body }, pos);
    }

    fn scope_id(&mut self) -> ScopeId {
        self.next_scope += 1;
        ScopeId(self.next_scope - 1)
    }

    fn lighting(&mut self, problem: Option<String>, pos: Pos) {
        if let Some(what) = problem {
            self.diags.error(pos, what);
        }
    }

    fn emit_statement(&mut self, args: &'a [hir::Expr], body: &'a [hir::Stmt], pos: Pos) {
        self.lighting(access::emit(self.shader.kind), pos);
        if self.in_emit > 0 {
            self.diags.error(pos, "`emit` is inside of `emit`");
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

    /// Sets a variable to its initial value, or else to zero, so that images depend on nothing else.
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
            // The instance determines the elements and their number.
            Init::List(list) if list.is_empty() => {}
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
}

/// Returns a value for each of `n` elements.
fn repeat(value: &ConstValue, n: usize) -> ConstValue {
    match value {
        ConstValue::Floats(v) => ConstValue::Floats(v.repeat(n).into()),
        ConstValue::Strings(v) => {
            ConstValue::Strings(std::iter::repeat_n(v.iter().cloned(), n).flatten().collect())
        }
    }
}

/// Returns constants, one after the other; `None` when one is not a constant.
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
