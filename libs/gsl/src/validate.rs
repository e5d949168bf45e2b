//! Checks that every symbol exists and that every operation has permitted operands, which the executor relies on.
//!
//! Modules from the compiler satisfy this. Files are checked when they are read.

use crate::builtins::{Arg, Rest, Ret, Signature, TABLE, TRACE, TypeSet};
use crate::codec::check_value;
use crate::ir::*;

type Checked = Result<(), String>;

/// Checks a module. The message describes the first error.
pub(crate) fn validate(module: &Module) -> Checked {
    for (i, symbol) in module.symbols.iter().enumerate() {
        let bad = match &symbol.kind {
            SymbolKind::Global(g) => symbol.ty != SymbolType::of(g.value_type()),
            SymbolKind::Param(p) => {
                module.params.get(*p as usize).is_none_or(|p| p.symbol != SymbolId(i as u32))
            }
            SymbolKind::Const(value) => symbol.ty.elements() == 0 || check_value(&symbol.ty, value).is_err(),
            SymbolKind::Local | SymbolKind::Temp => symbol.ty.open,
        };
        if bad || symbol.ty.value == ValueType::Void {
            return Err(format!("symbol {i} does not match its kind"));
        }
    }
    for (i, param) in module.params.iter().enumerate() {
        let symbol = module.symbols.get(param.symbol.0 as usize);
        if symbol.is_none_or(|s| s.kind != SymbolKind::Param(i as u32)) {
            return Err(format!("parameter {i} has no symbol"));
        }
    }
    let mut checker = Checker { module, scopes: Vec::new(), loops: vec![false] };
    for param in &module.params {
        checker.block(&param.init)?;
    }
    checker.block(&module.body)
}

struct Checker<'a> {
    module: &'a Module,
    /// The scopes around the current statement.
    scopes: Vec<ScopeId>,
    /// The constructs around that repeat their body, with the innermost one last. True for a `Loop`.
    loops: Vec<bool>,
}

impl Checker<'_> {
    fn ty(&self, id: SymbolId) -> Result<SymbolType, String> {
        match self.module.symbols.get(id.0 as usize) {
            Some(symbol) => Ok(symbol.ty),
            None => Err(format!("there is no symbol {}", id.0)),
        }
    }

    /// Checks that a symbol is a single value with the components of a type.
    fn value(&self, id: SymbolId, ty: ValueType) -> Checked {
        if like(self.ty(id)?, ty) { Ok(()) } else { Err(format!("symbol {} is not a `{}`", id.0, ty.word())) }
    }

    fn block(&mut self, block: &Block) -> Checked {
        block.iter().try_for_each(|s| self.statement(s))
    }

    fn looped(&mut self, block: &Block, is_loop: bool) -> Checked {
        self.loops.push(is_loop);
        let checked = self.block(block);
        self.loops.pop();
        checked
    }

    fn statement(&mut self, statement: &Stmt) -> Checked {
        use ValueType::{Float, Point, String, Vector};
        match statement {
            Stmt::Op(op) => self.op(op),
            Stmt::If { cond, then, otherwise } => {
                self.value(*cond, Float)?;
                self.block(then)?;
                self.block(otherwise)
            }
            Stmt::Loop { test, cond, body, step, .. } => {
                self.block(test)?;
                cond.map_or(Ok(()), |c| self.value(c, Float))?;
                self.looped(body, true)?;
                self.block(step)
            }
            Stmt::Scope { id, body } => {
                self.scopes.push(*id);
                let checked = self.block(body);
                self.scopes.pop();
                checked
            }
            Stmt::Leave(id) if self.scopes.contains(id) => Ok(()),
            Stmt::Leave(id) => Err(format!("scope {} is left from outside", id.0)),
            Stmt::Break | Stmt::Continue => match self.loops.last() {
                Some(true) => Ok(()),
                _ => Err("there is no loop to leave".to_owned()),
            },
            Stmt::Exit => Ok(()),
            Stmt::Lights { category, position, cone, body, .. } => {
                category.map_or(Ok(()), |c| self.value(c, String))?;
                self.value(*position, Point)?;
                if let Some((axis, angle)) = cone {
                    self.value(*axis, Vector)?;
                    self.value(*angle, Float)?;
                }
                self.looped(body, false)
            }
            Stmt::Emit { form, body, .. } => {
                match *form {
                    EmitForm::Reflection => {}
                    EmitForm::Point(from) => self.value(from, Point)?,
                    EmitForm::Distant { axis, spread } => {
                        self.value(axis, Vector)?;
                        self.value(spread, Float)?;
                    }
                    EmitForm::Cone { from, axis, angle } => {
                        self.value(from, Point)?;
                        self.value(axis, Vector)?;
                        self.value(angle, Float)?;
                    }
                }
                self.looped(body, false)
            }
            Stmt::Trace { set, position, axis, angle, samples, options, body, .. } => {
                self.value(*set, String)?;
                self.value(*position, Point)?;
                self.value(*axis, Vector)?;
                self.value(*angle, Float)?;
                self.value(*samples, Float)?;
                for (name, value) in options {
                    self.option(*name, *value, TRACE)?;
                }
                self.looped(body, false)
            }
        }
    }

    fn op(&self, op: &Op) -> Checked {
        let args: Vec<SymbolType> = op.args.iter().map(|a| self.ty(*a)).collect::<Result<_, _>>()?;
        let dst = op.dst.map(|d| self.ty(d)).transpose()?;
        let constant =
            op.dst.is_some_and(|d| matches!(self.module.symbols[d.0 as usize].kind, SymbolKind::Const(_)));
        if constant {
            return Err("a constant is written".to_owned());
        }
        let fits = match op.code {
            OpCode::Call(crate::Func::Shadeop) => {
                let call = crate::ShadeopCall::of(self.module, op.args.first());
                let constant =
                    |s: &SymbolId| matches!(self.module.symbols[s.0 as usize].kind, SymbolKind::Const(_));
                let fits = call.is_some_and(|call| {
                    let rest = &op.args[1..];
                    rest.len() == call.outputs.len()
                        && rest.iter().zip(&call.outputs).all(|(s, output)| !output || !constant(s))
                });
                return if fits { Ok(()) } else { Err("a shadeop does not take its operands".to_owned()) };
            }
            OpCode::Call(func) => {
                return if TABLE.iter().any(|row| row.func == func && self.call(row, op, dst, &args)) {
                    Ok(())
                } else {
                    Err(format!("`{}` does not take its operands", func.word()))
                };
            }
            code => dst.is_some_and(|dst| plain(code, dst, &args)),
        };
        if fits { Ok(()) } else { Err(format!("{:?} does not take its operands", op.code)) }
    }

    /// True when a call is one of this overload.
    fn call(&self, row: &Signature, op: &Op, dst: Option<SymbolType>, args: &[SymbolType]) -> bool {
        let written =
            |i: usize| !matches!(self.module.symbols[op.args[i].0 as usize].kind, SymbolKind::Const(_));
        let single = |ty: SymbolType, set: TypeSet| ty.array.is_none() && set.contains(ty.value);
        let result = match row.ret {
            Ret::Is(ValueType::Void) => dst.is_none(),
            Ret::Is(ty) => dst.is_some_and(|d| like(d, ty)),
            Ret::Same => dst.is_some_and(|d| d.array.is_none() && d.value != ValueType::String),
            Ret::Wanted(set) => dst.is_some_and(|d| single(d, set)),
        };
        let same = dst.map_or(0, |d| d.value.components());
        let fixed = row.args.len();
        if !result || args.len() < fixed {
            return false;
        }
        let shared = |ty: SymbolType| {
            ty.array.is_none() && ty.value != ValueType::String && ty.value.components() == same
        };
        for (i, (arg, ty)) in row.args.iter().zip(args).enumerate() {
            let fits = match *arg {
                Arg::Is(want) => like(*ty, want),
                Arg::Same(_) => shared(*ty),
                Arg::Any(set) => single(*ty, set),
                Arg::Data => true,
                Arg::Array => ty.array.is_some(),
                Arg::SameArray(set) => {
                    ty.array.is_some() && set.contains(ty.value) && ty.value.components() == same
                }
                Arg::Out(want) => like(*ty, want) && written(i),
                Arg::OutAny(set) => single(*ty, set) && written(i),
                Arg::OutData => written(i),
            };
            if !fits {
                return false;
            }
        }
        let rest = &args[fixed..];
        match row.rest {
            Rest::Nothing => rest.is_empty(),
            Rest::Values => true,
            Rest::Strings => rest.iter().all(|t| like(*t, ValueType::String)),
            Rest::Same(n) => rest.len() >= n && rest.iter().all(|t| shared(*t)),
            Rest::Options(choices) => op.args[fixed..].chunks(2).all(|pair| match *pair {
                [name, value] => self.option(name, value, choices).is_ok(),
                _ => false,
            }),
        }
    }

    fn option(&self, name: SymbolId, value: SymbolId, choices: &[crate::builtins::Choice]) -> Checked {
        self.value(name, ValueType::String)?;
        let found = self.ty(value)?;
        let SymbolKind::Const(ConstValue::Strings(word)) = &self.module.symbols[name.0 as usize].kind else {
            return Ok(());
        };
        let Some(choice) = choices.iter().find(|c| *c.name == *word[0]) else { return Ok(()) };
        let ty = SymbolType { value: found.value, array: None, open: false };
        let constant = matches!(self.module.symbols[value.0 as usize].kind, SymbolKind::Const(_));
        if found.array != choice.array || !like(ty, choice.ty) || (choice.output && constant) {
            return Err(format!("option \"{}\" has no such value", choice.name));
        }
        Ok(())
    }
}

/// True for a single value with the components of `ty`. Strings match only strings.
fn like(found: SymbolType, ty: ValueType) -> bool {
    found.array.is_none()
        && (found.value == ValueType::String) == (ty == ValueType::String)
        && found.value.components() == ty.components()
}

/// True when `from` converts to `to`, because it has the same components or is one float.
fn converts(from: SymbolType, to: ValueType) -> bool {
    like(from, to) || (like(from, ValueType::Float) && to != ValueType::String)
}

/// True when the operands of an operation that is not a call are permitted.
fn plain(code: OpCode, dst: SymbolType, args: &[SymbolType]) -> bool {
    use ValueType::{Float, Matrix, String};
    let number = |t: SymbolType| t.array.is_none() && t.value != String;
    let float = |t: SymbolType| like(t, Float);
    let triple = |t: SymbolType| t.array.is_none() && t.value.is_triple();
    let matrix = |t: SymbolType| like(t, Matrix);
    let element = |array: SymbolType| SymbolType::of(array.value);
    match (code, args) {
        (OpCode::Assign, [a]) if dst.array.is_some() => {
            let lengths = dst.array == a.array || dst.open || a.open;
            a.array.is_some() && lengths && like(element(*a), dst.value)
        }
        (OpCode::Assign, [a]) => converts(*a, dst.value),
        (OpCode::Neg, [a]) => number(dst) && converts(*a, dst.value),
        (OpCode::Add | OpCode::Sub, [a, b]) => {
            number(dst) && !matrix(dst) && converts(*a, dst.value) && converts(*b, dst.value)
        }
        (OpCode::Mul | OpCode::Div, [a, b]) => {
            number(dst) && converts(*a, dst.value) && converts(*b, dst.value)
        }
        (OpCode::Eq | OpCode::Ne, [a, b]) => float(dst) && like(*a, b.value) && b.array.is_none(),
        (OpCode::Lt | OpCode::Le | OpCode::Gt | OpCode::Ge, [a, b]) => float(dst) && float(*a) && float(*b),
        (OpCode::Not | OpCode::Truth, [a]) => float(dst) && a.array.is_none(),
        (OpCode::Index, [a, i]) => a.array.is_some() && float(*i) && like(dst, a.value),
        (OpCode::IndexSet, [i, a]) => dst.array.is_some() && float(*i) && like(*a, dst.value),
        (OpCode::Component, [a, i]) => float(dst) && triple(*a) && float(*i),
        (OpCode::ComponentSet, [i, a]) => triple(dst) && float(*i) && float(*a),
        (OpCode::MatrixComponent, [m, r, c]) => float(dst) && matrix(*m) && float(*r) && float(*c),
        (OpCode::MatrixComponentSet, [r, c, a]) => matrix(dst) && [*r, *c, *a].into_iter().all(float),
        (OpCode::Construct, all) => {
            let numbers = match all {
                [first, rest @ ..] if like(*first, String) => rest,
                _ => all,
            };
            (triple(dst) || matrix(dst))
                && (numbers.len() == 1 || numbers.len() == dst.value.components())
                && numbers.iter().all(|n| float(*n))
        }
        _ => false,
    }
}
