// tidy: long: statements are checked by one type, with a method for each kind
//! The checker, which converts the syntax tree to the typed tree. This file has declarations and statements.
//! Expressions are in `check_expr`.

use crate::ast;
use crate::builtins;
use crate::diagnostic::{Diagnostics, suggestion};
use crate::hir::*;
use crate::ir::{ConstValue, Global, Metadatum, OpCode, ShaderKind, SymbolType, ValueType};
use crate::lost::Lost;
use crate::parse::File;
use crate::shadeop::{self, ShadeopForm};
use crate::source::Pos;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// The largest length of an array.
pub(crate) const MAX_ARRAY: u32 = 65_536;

/// The names of one scope. Variables and functions do not hide each other.
#[derive(Default)]
struct Scope {
    vars: BTreeMap<Arc<str>, VarId>,
    /// Functions of one name differ in their parameters or their result.
    funcs: BTreeMap<Arc<str>, Vec<FuncId>>,
}

/// A construct that `break` and `continue` would leave.
#[derive(Clone, Copy, PartialEq)]
enum Around {
    Loop,
    Lighting,
}

pub(crate) struct Checker<'a> {
    pub(crate) diags: &'a mut Diagnostics,
    pub(crate) vars: Vec<Var>,
    pub(crate) funcs: Vec<Func>,
    scopes: Vec<Scope>,
    around: Vec<Around>,
    /// The functions whose bodies are being checked, innermost last.
    inside: Vec<FuncId>,
    /// The names in parts of the source that could not be parsed.
    pub(crate) lost: Lost,
    /// The unknown names that were reported, with the outermost function that they are in.
    unknown: BTreeSet<(Option<FuncId>, Arc<str>)>,
}

/// Checks a shader. Errors go to `diags`, and invalid expressions become [`ExprKind::Bad`]. In a file without a shader
/// the functions are checked.
pub(crate) fn check(
    file: File,
    shadeops: &[(Arc<str>, Pos, Vec<ShadeopForm>)],
    diags: &mut Diagnostics,
) -> Shader {
    let mut checker = Checker {
        diags,
        vars: Vec::new(),
        funcs: Vec::new(),
        scopes: vec![Scope::default()],
        around: Vec::new(),
        inside: Vec::new(),
        lost: file.lost,
        unknown: BTreeSet::new(),
    };
    for g in Global::ALL {
        let id = VarId(checker.vars.len());
        let ty = SymbolType::of(g.value_type());
        checker.vars.push(Var {
            name: g.word().into(),
            ty,
            kind: VarKind::Global(g),
            pos: Pos::default(),
            read: true,
            written: true,
            warned: true,
            level: (0, 0),
        });
        checker.scopes[0].vars.insert(g.word().into(), id);
    }
    for (name, pos, forms) in shadeops {
        forms.iter().for_each(|form| checker.shadeop(name, form, *pos));
    }
    checker.scopes.push(Scope::default());
    for function in file.functions {
        checker.function(function);
    }
    checker.scopes.push(Scope::default());
    let shader = file.shader.unwrap_or_else(|| ast::Shader {
        kind: ShaderKind::Generic,
        name: ast::Name { text: "".into(), pos: Pos::default() },
        metadata: Vec::new(),
        params: Vec::new(),
        body: Vec::new(),
    });
    let metadata = checker.metadata(shader.metadata);
    let mut params = Vec::new();
    for param in shader.params {
        params.extend(checker.param(param));
    }
    let body = checker.statements(shader.body);
    checker.unused();
    Shader {
        kind: shader.kind,
        name: shader.name.text,
        metadata,
        params,
        body,
        vars: checker.vars,
        funcs: checker.funcs,
    }
}

impl Checker<'_> {
    fn unused(&mut self) {
        if self.lost.has_lost_text() {
            return;
        }
        for var in &self.vars {
            if var.kind != VarKind::Local || var.warned || self.lost.mentions(&var.name) {
                continue;
            }
            if !var.read {
                let what = if var.written { "set but never used" } else { "never used" };
                self.diags.warning(var.pos, format!("variable `{}` is {what}", var.name));
            } else if !var.written {
                self.diags.warning(var.pos, format!("variable `{}` is never given a value", var.name));
            }
        }
    }

    fn level(&self) -> (usize, usize) {
        (self.inside.len(), self.around.len())
    }

    /// Declares a variable in the innermost scope.
    fn declare(&mut self, name: &ast::Name, ty: SymbolType, kind: VarKind) -> VarId {
        let id = VarId(self.vars.len());
        let level = self.level();
        self.vars.push(Var {
            name: name.text.clone(),
            ty,
            kind,
            pos: name.pos,
            read: false,
            written: false,
            warned: false,
            level,
        });
        let old = self.scopes.last_mut().and_then(|s| s.vars.insert(name.text.clone(), id));
        if let Some(old) = old.filter(|_| !self.lost.has_lost_braces()) {
            let before = self.diags.sources.location(self.vars[old.0].pos);
            self.diags.error_help(
                name.pos,
                format!("`{}` is declared twice in the same scope", name.text),
                Some(format!("it is declared at {before} already")),
            );
        }
        id
    }

    /// Returns the variable of a name in the current scope.
    pub(crate) fn variable(&self, name: &str) -> Option<VarId> {
        self.scopes.iter().rev().find_map(|s| s.vars.get(name)).copied()
    }

    /// Declares a function of a library in the outermost scope.
    fn shadeop(&mut self, name: &Arc<str>, form: &ShadeopForm, pos: Pos) {
        let Some(declared) = shadeop::declared(name, form, pos, self.diags) else { return };
        let formals = declared.formals.iter().enumerate().map(|(i, (ty, output))| {
            self.vars.push(Var {
                name: format!("argument {}", i + 1).into(),
                ty: *ty,
                kind: VarKind::Formal { output: *output },
                pos,
                read: true,
                written: *output,
                warned: true,
                level: (0, 0),
            });
            VarId(self.vars.len() - 1)
        });
        let formals = formals.collect();
        self.funcs.push(Func {
            name: name.clone(),
            ret: declared.ret,
            formals,
            body: Vec::new(),
            complete: true,
            returns: true,
            shadeop: Some(declared.text),
        });
        let id = FuncId(self.funcs.len() - 1);
        self.scopes[0].funcs.entry(name.clone()).or_default().push(id);
    }

    /// Returns the functions of the source with a name. They are those of the innermost scope that has any.
    pub(crate) fn user_functions(&self, name: &str) -> &[FuncId] {
        self.scopes.iter().rev().find_map(|s| s.funcs.get(name)).map_or(&[], Vec::as_slice)
    }

    /// Reports a name that cannot be used, once in each function and in the shader. Names that parts of the source may
    /// declare that could not be parsed are not reported.
    pub(crate) fn report_name(&mut self, name: &ast::Name, what: String, help: Option<String>) {
        let is_declared = || self.vars.iter().any(|var| var.name == name.text);
        let is_doubtful = match self.lost.has_lost_braces() {
            true => self.lost.declares(&name.text) || is_declared(),
            false => self.lost.mentions(&name.text),
        };
        if !is_doubtful && self.unknown.insert((self.inside.first().copied(), name.text.clone())) {
            self.diags.error_help(name.pos, what, help);
        }
    }

    pub(crate) fn suggest_variable(&self, name: &str) -> Option<String> {
        let names = self.scopes.iter().flat_map(|s| s.vars.keys()).map(|k| &**k);
        suggestion(name, names.chain(builtins::CONSTANTS.iter().map(|(n, _)| *n)))
    }

    pub(crate) fn suggest_function(&self, name: &str) -> Option<String> {
        let names = self.scopes.iter().flat_map(|s| s.funcs.keys()).map(|k| &**k);
        suggestion(name, names.chain(crate::Func::ALL.iter().map(|f| f.word())).chain(["exit"]))
    }

    // Parameters and metadata.

    fn metadata(&mut self, list: Vec<ast::Datum>) -> Vec<Metadatum> {
        let mut out: Vec<Metadatum> = Vec::new();
        for datum in list {
            if out.iter().any(|m| *m.name == *datum.name.text) {
                self.diags.error(datum.name.pos, format!("metadatum `{}` is given twice", datum.name.text));
            }
            let pos = datum.value.pos;
            let value = self.expr(&datum.value, Some(datum.ty));
            let value = self.coerce(value, datum.ty);
            match value.kind {
                ExprKind::Const(value) => out.push(Metadatum { ty: datum.ty, name: datum.name.text, value }),
                ExprKind::Bad => {}
                _ => self.diags.error(pos, "the value of a metadatum must be a constant"),
            }
        }
        out
    }

    fn param(&mut self, param: ast::Param) -> Option<Param> {
        let (array, open) = self.length(param.array.as_ref(), true);
        let mut ty = SymbolType { value: param.ty, array, open };
        let init = match param.init {
            None => {
                let what = format!("parameter `{}` needs a default value", param.name.text);
                self.diags.error(param.name.pos, what);
                Init::None
            }
            Some(init) => self.initializer(init, &mut ty, &param.name),
        };
        let metadata = self.metadata(param.metadata);
        let index = self.vars.iter().filter(|v| matches!(v.kind, VarKind::Param { .. })).count();
        let kind = VarKind::Param { index, output: param.output };
        let var = self.declare(&param.name, ty, kind);
        Some(Param { var, output: param.output, init, metadata })
    }

    /// Returns the length of an array, and true for `[]`.
    fn length(&mut self, length: Option<&ast::Length>, may_be_open: bool) -> (Option<u32>, bool) {
        match length {
            None => (None, false),
            Some(ast::Length::Open(_)) if may_be_open => (Some(0), true),
            Some(ast::Length::Open(pos)) => {
                self.diags.error_help(
                    *pos,
                    "an array variable needs a length",
                    Some("only parameters may be declared with `[]`".into()),
                );
                (Some(1), false)
            }
            Some(ast::Length::Fixed(expr)) => {
                let value = self.expr(expr, Some(ValueType::Float));
                let n = match &value.kind {
                    ExprKind::Const(ConstValue::Floats(v)) if v.len() == 1 => v[0],
                    ExprKind::Bad => 1.0,
                    _ => {
                        self.diags.error(expr.pos, "the length of an array must be a constant");
                        1.0
                    }
                };
                if n < 1.0 || n.fract() != 0.0 || !n.is_finite() {
                    self.diags.error(expr.pos, format!("an array cannot have {n} elements"));
                    return (Some(1), false);
                }
                if n > MAX_ARRAY as f32 {
                    let what = format!("an array of {n} elements is too long: {MAX_ARRAY} at most");
                    self.diags.error(expr.pos, what);
                    return (Some(1), false);
                }
                (Some(n as u32), false)
            }
        }
    }

    /// Checks an initialiser, and sets the length of open arrays.
    fn initializer(&mut self, init: ast::Init, ty: &mut SymbolType, name: &ast::Name) -> Init {
        match (init, ty.array) {
            (ast::Init::One(expr), None) => {
                let value = self.expr(&expr, Some(ty.value));
                Init::One(self.coerce(value, ty.value))
            }
            (ast::Init::One(expr), Some(_)) => {
                self.diags.error_help(
                    expr.pos,
                    format!("array `{}` needs a list of values", name.text),
                    Some("write `= { value, value, ... }`".into()),
                );
                Init::None
            }
            (ast::Init::List(_, pos), None) => {
                self.diags.error(pos, format!("`{}` is not an array; it takes one value", name.text));
                Init::None
            }
            (ast::Init::List(list, pos), Some(n)) => {
                let count = list.len() as u32;
                if ty.open {
                    ty.array = Some(count);
                    if count > MAX_ARRAY {
                        self.diags.error(pos, format!("{count} values are too many: {MAX_ARRAY} at most"));
                        return Init::None;
                    }
                } else if count > n {
                    let what = format!("{count} values for array `{}` of {n} elements", name.text);
                    self.diags.error(pos, what);
                    return Init::None;
                }
                let mut values = Vec::new();
                for expr in &list {
                    let value = self.expr(expr, Some(ty.value));
                    values.push(self.coerce(value, ty.value));
                }
                // The remaining elements are zero, as in C.
                while !ty.open && values.len() < n as usize {
                    let kind = ExprKind::Const(zero(ty.value));
                    values.push(Expr { ty: SymbolType::of(ty.value), kind, pos });
                }
                Init::List(values)
            }
        }
    }

    // Functions.

    fn function(&mut self, function: ast::Function) {
        let id = FuncId(self.funcs.len());
        let name = function.name;
        self.funcs.push(Func {
            name: name.text.clone(),
            ret: function.ty,
            formals: Vec::new(),
            body: Vec::new(),
            complete: false,
            returns: false,
            shadeop: None,
        });
        if let Some(scope) = self.scopes.last_mut() {
            scope.funcs.entry(name.text.clone()).or_default().push(id);
        }
        self.scopes.push(Scope::default());
        self.inside.push(id);
        let around = std::mem::take(&mut self.around);
        let mut formals = Vec::new();
        for formal in function.params {
            let (array, open) = self.length(formal.array.as_ref(), true);
            let ty = SymbolType { value: formal.ty, array, open };
            formals.push(self.declare(&formal.name, ty, VarKind::Formal { output: formal.output }));
        }
        self.funcs[id.0].formals = formals;
        if self.is_declared_again(id) && !self.lost.has_lost_braces() {
            let what = format!("function `{}` is declared twice in the same scope", name.text);
            let help = Some("functions of one name differ in their parameters or their result".to_owned());
            self.diags.error_help(name.pos, what, help);
        }
        let body = self.statements(function.body);
        self.around = around;
        self.inside.pop();
        self.scopes.pop();
        let func = &mut self.funcs[id.0];
        func.body = body;
        func.complete = true;
        if func.ret != ValueType::Void && !func.returns && !self.lost.has_lost_braces() {
            let what = format!("function `{}` never returns a value", func.name);
            self.diags.warning(name.pos, what);
        }
    }

    /// True when another function of its scope has the same name, parameters and result.
    fn is_declared_again(&self, id: FuncId) -> bool {
        let types = |id: FuncId| {
            let f = &self.funcs[id.0];
            (f.ret, f.formals.iter().map(|v| self.vars[v.0].ty).collect::<Vec<_>>())
        };
        // The innermost scope is that of its own parameters.
        let scope = self.scopes.len().checked_sub(2).map(|k| &self.scopes[k]);
        let others = scope.and_then(|s| s.funcs.get(&self.funcs[id.0].name));
        others.is_some_and(|list| list.iter().any(|other| *other != id && types(*other) == types(id)))
    }

    // Statements.

    fn statements(&mut self, list: Vec<ast::Stmt>) -> Vec<Stmt> {
        let mut out = Vec::new();
        for statement in list {
            self.statement(statement, &mut out);
        }
        out
    }

    /// Checks a statement in a scope of its own.
    fn scoped(&mut self, statement: ast::Stmt) -> Vec<Stmt> {
        self.scopes.push(Scope::default());
        let mut out = Vec::new();
        self.statement(statement, &mut out);
        self.scopes.pop();
        out
    }

    fn body(&mut self, statement: ast::Stmt, around: Around) -> Vec<Stmt> {
        self.around.push(around);
        let out = self.scoped(statement);
        self.around.pop();
        out
    }

    /// Checks a statement, and appends it unless it does nothing or has an error that leaves nothing of it.
    fn statement(&mut self, statement: ast::Stmt, out: &mut Vec<Stmt>) {
        let pos = statement.pos;
        if let Some(kind) = self.statement_kind(statement, out) {
            out.push(Stmt { kind, pos });
        }
    }

    /// Checks a statement. Returns `None` when nothing is left of it, and for variables, whose declarations it
    /// appends.
    fn statement_kind(&mut self, statement: ast::Stmt, out: &mut Vec<Stmt>) -> Option<StmtKind> {
        let pos = statement.pos;
        Some(match statement.kind {
            ast::StmtKind::Empty => return None,
            ast::StmtKind::Missing => {
                // It may be a `return`.
                if let Some(id) = self.inside.last() {
                    self.funcs[id.0].returns = true;
                }
                return None;
            }
            ast::StmtKind::Expr(expr) => StmtKind::Expr(self.effect(&expr)),
            ast::StmtKind::Block(list) => {
                self.scopes.push(Scope::default());
                let list = self.statements(list);
                self.scopes.pop();
                StmtKind::Block(list)
            }
            ast::StmtKind::Variables(ty, list) => {
                self.variables(ty, list, out);
                return None;
            }
            ast::StmtKind::Function(function) => {
                self.function(function);
                return None;
            }
            ast::StmtKind::If(arms, otherwise) => {
                let mut checked = Vec::with_capacity(arms.len());
                for (condition, body) in arms {
                    let condition = self.condition(&condition);
                    checked.push(Arm { condition, body: self.scoped(body) });
                }
                let otherwise = otherwise.map_or_else(Vec::new, |s| self.scoped(*s));
                StmtKind::If(checked, otherwise)
            }
            ast::StmtKind::While(test, body) => {
                self.around.push(Around::Loop);
                let test = Some(self.condition(&test));
                let body = self.scoped(*body);
                self.around.pop();
                StmtKind::Loop { body_first: false, test, body, step: None }
            }
            ast::StmtKind::DoWhile(body, test) => {
                self.around.push(Around::Loop);
                let body = self.scoped(*body);
                let test = Some(self.condition(&test));
                self.around.pop();
                StmtKind::Loop { body_first: true, test, body, step: None }
            }
            ast::StmtKind::For(init, test, step, body) => {
                self.scopes.push(Scope::default());
                let mut list = Vec::new();
                self.statement(*init, &mut list);
                self.around.push(Around::Loop);
                let test = test.map(|t| self.condition(&t));
                let body = self.scoped(*body);
                let step = step.map(|s| self.effect(&s));
                self.around.pop();
                self.scopes.pop();
                let kind = StmtKind::Loop { body_first: false, test, body, step };
                list.push(Stmt { kind, pos });
                StmtKind::Block(list)
            }
            ast::StmtKind::Break => self.in_loop("break", StmtKind::Break, pos)?,
            ast::StmtKind::Continue => self.in_loop("continue", StmtKind::Continue, pos)?,
            ast::StmtKind::Lighting(kind, args, body) => self.lighting(kind, &args, *body, pos)?,
            ast::StmtKind::Return(value) => self.return_statement(value, pos),
        })
    }

    /// Checks the definitions of variables of one type, and appends their declarations.
    fn variables(&mut self, ty: ValueType, list: Vec<ast::Definition>, out: &mut Vec<Stmt>) {
        for definition in list {
            let (array, _) = self.length(definition.array.as_ref(), false);
            let mut ty = SymbolType { value: ty, array, open: false };
            let pos = definition.name.pos;
            let init = match definition.init {
                None => Init::None,
                Some(init) => self.initializer(init, &mut ty, &definition.name),
            };
            let var = self.declare(&definition.name, ty, VarKind::Local);
            self.vars[var.0].written = !matches!(init, Init::None);
            out.push(Stmt { kind: StmtKind::Declare(var, init), pos });
        }
    }

    /// Returns the statement `break` or `continue` (`word`); `None` (reported) when it is not directly in a loop.
    fn in_loop(&mut self, word: &str, kind: StmtKind, pos: Pos) -> Option<StmtKind> {
        if self.around.last() != Some(&Around::Loop) {
            if self.lost.has_lost_braces() {
                return None;
            }
            let help = (!self.around.is_empty())
                .then(|| "`lights`, `emit` and `trace` cannot be left early".to_owned());
            self.diags.error_help(pos, format!("`{word}` is not in a loop"), help);
            return None;
        }
        Some(kind)
    }

    /// Checks an expression whose value is not used.
    fn effect(&mut self, expr: &ast::Expr) -> Expr {
        let checked = self.statement_expr(expr);
        let useless = match &checked.kind {
            ExprKind::Chain(_, links) => {
                links.last().is_none_or(|link| matches!(link.operator, Operator::Op(_)))
            }
            kind => !matches!(
                kind,
                ExprKind::Builtin { .. }
                    | ExprKind::Call { .. }
                    | ExprKind::Assign { .. }
                    | ExprKind::Step { .. }
                    | ExprKind::Exit
                    | ExprKind::Select(..)
                    | ExprKind::Bad
            ),
        };
        if useless {
            self.diags.warning(expr.pos, "this statement does nothing");
        }
        checked
    }

    fn return_statement(&mut self, value: Option<ast::Expr>, pos: Pos) -> StmtKind {
        let Some(id) = self.inside.last().copied() else {
            if let Some(value) = value.filter(|_| !self.lost.has_lost_braces()) {
                self.diags.error(value.pos, "a shader returns no value");
            }
            return StmtKind::Return(None);
        };
        self.funcs[id.0].returns = true;
        let (ret, name) = (self.funcs[id.0].ret, self.funcs[id.0].name.clone());
        match value {
            Some(value) if ret == ValueType::Void => {
                self.diags.error(value.pos, format!("function `{name}` is `void` and returns no value"));
                StmtKind::Return(None)
            }
            Some(value) => {
                let checked = self.expr(&value, Some(ret));
                StmtKind::Return(Some(self.coerce(checked, ret)))
            }
            None => {
                if ret != ValueType::Void {
                    let what = format!("function `{name}` must return a value of type `{}`", ret.word());
                    self.diags.error(pos, what);
                }
                StmtKind::Return(None)
            }
        }
    }

    /// Checks a condition and returns it as a float.
    pub(crate) fn condition(&mut self, expr: &ast::Expr) -> Expr {
        let value = self.expr(expr, Some(ValueType::Float));
        self.truth(value)
    }

    /// Checks arguments and converts them to these types.
    fn typed(&mut self, args: &[ast::Expr], types: &[ValueType]) -> Vec<Expr> {
        let mut out = Vec::new();
        for (arg, ty) in args.iter().zip(types) {
            let value = self.expr(arg, Some(*ty));
            out.push(self.coerce(value, *ty));
        }
        out
    }

    fn lighting(
        &mut self,
        kind: ast::Lighting,
        args: &[ast::Expr],
        body: ast::Stmt,
        pos: Pos,
    ) -> Option<StmtKind> {
        let forms = match kind {
            ast::Lighting::Emit => builtins::EMIT,
            ast::Lighting::Lights => builtins::LIGHTS,
            ast::Lighting::Trace => builtins::TRACES,
        };
        if args.iter().any(|arg| matches!(arg.kind, ast::ExprKind::Missing)) {
            self.body(body, Around::Lighting);
            return None;
        }
        let count = if kind == ast::Lighting::Trace { args.len().min(5) } else { args.len() };
        let Some(form) = forms.iter().find(|f| f.len() == count) else {
            let list: Vec<String> = forms
                .iter()
                .map(|f| {
                    let words: Vec<_> = f.iter().map(|t| t.word()).collect();
                    format!("{} ({})", kind.word(), words.join(", "))
                })
                .collect();
            let help = Some(format!("it is one of {}", list.join(", ")));
            let n = args.len();
            self.diags.error_help(pos, format!("`{}` has no form with {n} arguments", kind.word()), help);
            self.body(body, Around::Lighting);
            return None;
        };
        let mut checked = self.typed(&args[..count], form);
        let mut options = Vec::new();
        if kind == ast::Lighting::Trace {
            let (list, _) = self.options(&args[count..], builtins::TRACE, "trace", pos);
            let mut list = list.into_iter();
            while let (Some(name), Some(value)) = (list.next(), list.next()) {
                options.push((name, value));
            }
        }
        let body = self.body(body, Around::Lighting);
        Some(match kind {
            ast::Lighting::Emit => StmtKind::Emit(checked, body),
            ast::Lighting::Lights => {
                let cone = (count > 2).then(|| {
                    let angle = checked.pop();
                    let axis = checked.pop();
                    axis.zip(angle)
                });
                let position = checked.pop()?;
                StmtKind::Lights { category: checked.pop(), position, cone: cone.flatten(), body }
            }
            ast::Lighting::Trace => StmtKind::Trace { args: checked, options, body },
        })
    }

    // Marks for warnings.

    /// Records that a variable is read.
    pub(crate) fn mark_read(&mut self, id: VarId, pos: Pos) {
        let level = self.level();
        let var = &mut self.vars[id.0];
        var.read = true;
        // Within a loop or function that begins after the declaration, the order of the text is not the order of
        // execution.
        let is_clear = var.kind == VarKind::Local && !var.written && !var.warned && var.level == level;
        if is_clear && !self.lost.mentions(&var.name) {
            var.warned = true;
            let what = format!("variable `{}` is used before it is given a value", var.name);
            self.diags.warning(pos, what);
        }
    }

    /// Records that a variable is written. Reports an error when that is not permitted.
    pub(crate) fn mark_written(&mut self, id: VarId, pos: Pos) {
        let var = &mut self.vars[id.0];
        var.written = true;
        if let VarKind::Param { output: false, .. } = var.kind {
            let what = format!("parameter `{}` is read-only", var.name);
            let help = Some(format!("declare it `output {} {}` to change it", var.ty.value.word(), var.name));
            self.diags.error_help(pos, what, help);
        }
    }

    pub(crate) fn is_recursive(&self, id: FuncId) -> bool {
        !self.funcs[id.0].complete
    }
}

/// Returns zero, or the empty string.
pub(crate) fn zero(ty: ValueType) -> ConstValue {
    match ty {
        ValueType::String => ConstValue::Strings([Arc::from("")].into()),
        other => ConstValue::Floats(vec![0.0; other.components()].into()),
    }
}

/// Returns the opcode of an arithmetic operator or a comparison.
pub(crate) fn opcode(op: ast::Binary) -> OpCode {
    match op {
        ast::Binary::Mul => OpCode::Mul,
        ast::Binary::Div => OpCode::Div,
        ast::Binary::Add => OpCode::Add,
        ast::Binary::Sub => OpCode::Sub,
        ast::Binary::Eq => OpCode::Eq,
        ast::Binary::Ne => OpCode::Ne,
        ast::Binary::Lt => OpCode::Lt,
        ast::Binary::Le => OpCode::Le,
        ast::Binary::Gt => OpCode::Gt,
        ast::Binary::Ge => OpCode::Ge,
        // These two are lowered to conditions. The opcode is that of their truth.
        ast::Binary::And | ast::Binary::Or => OpCode::Truth,
    }
}
