//! Calls of functions that the source declares (reference 5.5.6). Overloads are chosen by the arguments and by the
//! expected result. Arguments are passed by reference.

use crate::ast;
use crate::builtins::{self, TypeSet};
use crate::check::Checker;
use crate::hir::*;
use crate::ir::{SymbolType, ValueType};
use crate::overload::{Possible, bent, conversion, describe, reach, spell_type};

/// The cost of a result that does not convert to the expected type. It is more than that of any that does.
const NO_CONVERSION: u32 = 64;

impl Checker<'_> {
    /// Returns the cost of calling a function with such arguments; `None` when it does not accept them.
    fn user_fit(&self, id: FuncId, args: &[Possible]) -> Option<u32> {
        let formals = &self.funcs[id.0].formals;
        if formals.len() != args.len() {
            return None;
        }
        let mut cost = 0;
        for (formal, possible) in formals.iter().zip(args) {
            let formal = &self.vars[formal.0];
            let output = matches!(formal.kind, VarKind::Formal { output: true });
            cost += match (*possible, formal.ty.array) {
                (Possible::Bad, _) => 0,
                (Possible::Array(ty), Some(_)) if ty == formal.ty.value => 0,
                (Possible::Array(_), _) | (_, Some(_)) => return None,
                (Possible::Value(ty), None) if output => {
                    let fits = ty == formal.ty.value || ty.is_point_like() && formal.ty.value.is_point_like();
                    if fits { u32::from(ty != formal.ty.value) } else { return None }
                }
                (possible, None) => reach(possible, formal.ty.value)?,
            };
        }
        Some(cost)
    }

    /// Returns the functions of a name whose arguments fit best, in the order of the source.
    fn best_fitting(&self, name: &str, args: &[Possible]) -> Vec<FuncId> {
        let list = self.user_functions(name);
        let costs: Vec<Option<u32>> = list.iter().map(|id| self.user_fit(*id, args)).collect();
        let Some(best) = costs.iter().flatten().min() else { return Vec::new() };
        list.iter().zip(&costs).filter(|(_, c)| **c == Some(*best)).map(|(id, _)| *id).collect()
    }

    /// Returns the least cost of calling a function of the source with such arguments, and true when a function that
    /// fits best is declared completely. The cost is that of conversions, then the number of arguments that could be
    /// floats and are not. Returns `None` when no function accepts the arguments.
    pub(crate) fn user_cost(&self, name: &str, args: &[Possible]) -> Option<((u32, u32), bool)> {
        let fitting = self.best_fitting(name, args);
        let cost = fitting.first().and_then(|id| self.user_fit(*id, args))?;
        let formal = |id: &FuncId, i: usize| {
            let formal = self.funcs[id.0].formals.get(i)?;
            Some(self.vars[formal.0].ty.value)
        };
        let bent = fitting.iter().map(|id| bent(args, |i| formal(id, i))).min().unwrap_or(0);
        Some(((cost, bent), fitting.iter().any(|id| !self.is_recursive(*id))))
    }

    /// Returns the functions of the source with a name, as messages spell them.
    pub(crate) fn user_forms(&self, name: &str) -> Vec<String> {
        let spell = |id: &FuncId| {
            let f = &self.funcs[id.0];
            let formals: Vec<String> = f.formals.iter().map(|v| spell_type(self.vars[v.0].ty)).collect();
            format!("{} {} ({})", f.ret.word(), f.name, formals.join(", "))
        };
        self.user_functions(name).iter().map(spell).collect()
    }

    /// Returns the types that a call can return. Where functions differ only in the result, the context decides.
    pub(crate) fn possible_user_call(&self, name: &str, args: &[Possible]) -> Possible {
        if let ([only], None) = (self.user_functions(name), builtins::named(name).next()) {
            return Possible::Value(self.funcs[only.0].ret);
        }
        let fitting = self.best_fitting(name, args);
        let types: Vec<ValueType> = fitting.iter().map(|id| self.funcs[id.0].ret).collect();
        match types.as_slice() {
            [] => Possible::Bad,
            [ty] => Possible::Value(*ty),
            many => Possible::Wanted(TypeSet::of(many)),
        }
    }

    /// Returns the function of a call. It is the one with the least conversions of arguments. Of equal ones, complete
    /// functions come first, then the least conversion of the result, then the order of the source.
    fn choose_user(&self, name: &str, args: &[Possible], wanted: Option<ValueType>) -> Option<FuncId> {
        let cost = |id: &FuncId| {
            let result = match wanted {
                Some(ty) => conversion(self.funcs[id.0].ret, ty).unwrap_or(NO_CONVERSION),
                None => 0,
            };
            (self.is_recursive(*id), result)
        };
        self.best_fitting(name, args).into_iter().min_by_key(cost)
    }

    pub(crate) fn user_call(
        &mut self,
        name: &ast::Name,
        args: &[ast::Expr],
        wanted: Option<ValueType>,
    ) -> Expr {
        let pos = name.pos;
        let alone = builtins::named(&name.text).next().is_none();
        let id = match self.user_functions(&name.text) {
            [only] if alone => *only,
            _ => {
                let possible: Vec<Possible> = args.iter().map(|a| self.possible(a, false)).collect();
                match self.choose_user(&name.text, &possible, wanted) {
                    Some(id) => id,
                    None => return self.no_form(name, args, wanted),
                }
            }
        };
        let ret = self.funcs[id.0].ret;
        if self.is_recursive(id) {
            if !self.lost.has_lost_braces() {
                let what = format!("function `{}` calls itself; recursion is not allowed", name.text);
                self.diags.error(pos, what);
            }
            return self.bad(pos, Some(ret));
        }
        let formals = self.funcs[id.0].formals.clone();
        if formals.len() != args.len() {
            let (n, m) = (formals.len(), args.len());
            let plural = if n == 1 { "" } else { "s" };
            self.diags.error(pos, format!("function `{}` takes {n} argument{plural}, {m} given", name.text));
            return self.bad(pos, Some(ret));
        }
        let mut checked = Vec::with_capacity(args.len());
        for (arg, formal) in args.iter().zip(formals) {
            checked.push(self.user_argument(arg, formal, &name.text));
        }
        Expr { ty: SymbolType::of(ret), kind: ExprKind::Call { func: id, args: checked }, pos }
    }

    fn user_argument(&mut self, arg: &ast::Expr, formal: VarId, function: &str) -> Expr {
        let formal = &self.vars[formal.0];
        let (ty, written, formal_name) = (formal.ty, formal.written, formal.name.clone());
        let output = matches!(formal.kind, VarKind::Formal { output: true });
        if ty.array.is_some() {
            let value = if output || written {
                match self.output_place(arg) {
                    Some((place, ty)) => Expr { ty, kind: ExprKind::Read(place), pos: arg.pos },
                    None => return self.bad(arg.pos, None),
                }
            } else {
                self.expr(arg, None)
            };
            let fits = value.ty.value == ty.value
                && value.ty.array.is_some()
                && (ty.open || value.ty.array == ty.array && !value.ty.open);
            if !fits && !matches!(value.kind, ExprKind::Bad) {
                let what = format!(
                    "parameter `{formal_name}` of `{function}` is {}, {} given",
                    describe(ty),
                    describe(value.ty)
                );
                self.diags.error(arg.pos, what);
                return self.bad(arg.pos, None);
            }
            return value;
        }
        let variable = matches!(arg.kind, ast::ExprKind::Variable(..))
            && !builtins::CONSTANTS.iter().any(|(n, _)| self.is_constant(arg, n));
        if !(output || written && variable) {
            let value = self.expr(arg, Some(ty.value));
            return self.coerce(value, ty.value);
        }
        self.output(arg, Some(ty.value))
    }

    fn is_constant(&self, arg: &ast::Expr, constant: &str) -> bool {
        matches!(&arg.kind, ast::ExprKind::Variable(name, _)
            if *name.text == *constant && self.variable(constant).is_none())
    }
}
