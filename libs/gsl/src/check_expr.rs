// tidy: long: expressions are checked by one type, with a method for each kind
//! Checks expressions, with their types, conversions, overloads and constants.
//!
//! The result type of some functions depends on their context (`noise`, `texture`, `random`). A check therefore has
//! an expected type. Assignments, casts and arguments set it, and arithmetic passes it to both operands. Before an
//! overload is chosen, [`Checker::possible`] returns the types that an argument can have.

use crate::ast::{self, Binary};
use crate::builtins::{self, Arg, Choice, NUMBERS, Rest, Ret, Signature, TypeSet};
use crate::check::{Checker, opcode};
use crate::diagnostic::suggestion;
use crate::fold::{convert, fold, number};
use crate::hir::*;
use crate::ir::{ConstValue, OpCode, SymbolType, ValueType};
use crate::overload::*;
use crate::source::Pos;

/// A chosen overload and the type of its `Same` arguments.
type Chosen = (&'static Signature, Option<ValueType>);

/// The choice of the function for a call.
enum Choose {
    /// A function of the source. It is also chosen when no form fits and the source declares some.
    User,
    /// A form of the standard library.
    Builtin(Chosen),
    Nothing,
}

/// Returns the type of argument `i` of a form, where the form defines it.
fn fixed_type(row: &Signature, i: usize) -> Option<ValueType> {
    match argument(row, i)?.0 {
        Arg::Is(ty) => Some(ty),
        _ => None,
    }
}

/// True when the forms of this function return one of their arguments or a value between them. Where the result is a
/// factor, so are the arguments.
fn passes_factor(name: &str) -> bool {
    let mut forms = builtins::named(name).peekable();
    forms.peek().is_some() && forms.all(|row| row.ret == Ret::Same)
}

impl Checker<'_> {
    // Possible types.

    /// Returns the types that an expression can have, with `factor` as in [`Wish`].
    pub(crate) fn possible(&self, expr: &ast::Expr, factor: bool) -> Possible {
        use Possible::Value;
        match &expr.kind {
            ast::ExprKind::Number(_) | ast::ExprKind::Not(_) => Value(ValueType::Float),
            ast::ExprKind::Missing => Possible::Bad,
            ast::ExprKind::Text(_) => Value(ValueType::String),
            ast::ExprKind::Variable(name, subscripts) => self.possible_variable(&name.text, subscripts.len()),
            ast::ExprKind::Call(name, _) if self.lost.declares(&name.text) => Possible::Bad,
            ast::ExprKind::Call(name, args) => {
                let args = self.possible_arguments(&name.text, args, factor);
                match self.choose(&name.text, &args, None) {
                    Choose::User => self.possible_user_call(&name.text, &args),
                    Choose::Builtin((row, same)) => match row.ret {
                        Ret::Is(ty) => Value(ty),
                        Ret::Same => match Self::same_possible(row, &args) {
                            Some(set) => Possible::Wanted(set),
                            None => same.map_or(Possible::Bad, Value),
                        },
                        Ret::Wanted(set) if factor && set == NUMBERS => Value(ValueType::Float),
                        Ret::Wanted(set) => Possible::Wanted(set),
                    },
                    Choose::Nothing if &*name.text == "exit" => Value(ValueType::Void),
                    Choose::Nothing => Possible::Bad,
                }
            }
            ast::ExprKind::Construct(ty, _) | ast::ExprKind::Cast(ty, _) => Value(*ty),
            ast::ExprKind::Negate(inner) => self.possible(inner, factor),
            ast::ExprKind::Chain(first, links) => links.iter().fold(self.possible(first, factor), |a, l| {
                possible_link(l.operator, a, self.possible(&l.right, factor))
            }),
            ast::ExprKind::Select(arms, otherwise) => {
                arms.iter().rev().fold(self.possible(otherwise, factor), |rest, (_, a)| {
                    match (self.possible(a, factor), rest) {
                        (a @ Possible::Wanted(_), Value(ValueType::Float)) => a,
                        (Value(ValueType::Float) | Possible::Wanted(_), rest) => rest,
                        (a, _) => a,
                    }
                })
            }
            ast::ExprKind::Assign(_, target, _) | ast::ExprKind::Step { target, .. } => {
                self.possible(target, false)
            }
        }
    }

    /// Returns the types that the arguments of a call can have. Those of `max` and similar functions are factors where
    /// the call is one.
    fn possible_arguments(&self, name: &str, args: &[ast::Expr], factor: bool) -> Vec<Possible> {
        let factor = factor && passes_factor(name);
        args.iter().map(|a| self.possible(a, factor)).collect()
    }

    fn possible_variable(&self, name: &str, subscripts: usize) -> Possible {
        if self.lost.declares(name) {
            return Possible::Bad;
        }
        let Some(id) = self.variable(name) else {
            let constant = builtins::CONSTANTS.iter().any(|(n, _)| *n == name);
            return if constant { Possible::Value(ValueType::Float) } else { Possible::Bad };
        };
        let ty = self.vars[id.0].ty;
        match (ty.array, subscripts) {
            (Some(_), 0) => Possible::Array(ty.value),
            (None, 0) | (Some(_), 1) => Possible::Value(ty.value),
            _ => Possible::Value(ValueType::Float),
        }
    }

    /// Returns the types that the `Same` arguments can have, when the context decides.
    fn same_possible(row: &Signature, args: &[Possible]) -> Option<TypeSet> {
        let mut found = None;
        for (i, possible) in args.iter().enumerate() {
            let (Arg::Same(set), _) = argument(row, i)? else { continue };
            match possible {
                Possible::Wanted(s) => found = Some(found.unwrap_or(set).intersection(*s)),
                Possible::Value(ValueType::Float) => {}
                _ => return None,
            }
        }
        found
    }

    // Overloads.

    /// Returns the form that fits best, which is the one with the least conversions. Of equal ones, a form of the
    /// source comes before the first one in the table. A function of the source that is being declared gives way to a
    /// built-in form, so that it may wrap it.
    fn choose(&self, name: &str, args: &[Possible], wanted: Option<ValueType>) -> Choose {
        let mut best: Option<(u32, Chosen)> = None;
        for row in builtins::named(name) {
            let Some((cost, same)) = fit(row, args, wanted) else { continue };
            if best.is_none_or(|(c, _)| cost < c) {
                best = Some((cost, (row, same)));
            }
        }
        if self.user_functions(name).is_empty() {
            return best.map_or(Choose::Nothing, |(_, chosen)| Choose::Builtin(chosen));
        }
        match (self.user_cost(name, args), best) {
            // Of equal costs, the form is chosen that changes fewer arguments from floats to other types.
            (Some((cost, complete)), Some((least, chosen)))
                if !complete || cost > (least, bent(args, |i| fixed_type(chosen.0, i))) =>
            {
                Choose::Builtin(chosen)
            }
            (None, Some((_, chosen))) => Choose::Builtin(chosen),
            _ => Choose::User,
        }
    }

    // Checking.

    /// Checks an expression with an expected type. The result may have another type.
    pub(crate) fn expr(&mut self, expr: &ast::Expr, wish: impl Into<Wish>) -> Expr {
        let wish = wish.into();
        let checked = self.statement_expr_wanted(expr, wish);
        let bad = checked.ty.value == ValueType::Void && !matches!(checked.kind, ExprKind::Bad);
        if bad {
            let what = match &expr.kind {
                ast::ExprKind::Call(name, _) => format!("function `{}` returns no value", name.text),
                _ => "this has no value".to_owned(),
            };
            self.diags.error(expr.pos, what);
            return self.bad(expr.pos, wish.ty);
        }
        checked
    }

    /// Checks an expression as [`Checker::expr`] does, but it need not have a value.
    pub(crate) fn statement_expr(&mut self, expr: &ast::Expr) -> Expr {
        self.statement_expr_wanted(expr, Wish::default())
    }

    pub(crate) fn bad(&self, pos: Pos, wanted: Option<ValueType>) -> Expr {
        Expr { ty: SymbolType::of(wanted.unwrap_or(ValueType::Float)), kind: ExprKind::Bad, pos }
    }

    fn statement_expr_wanted(&mut self, expr: &ast::Expr, wish: Wish) -> Expr {
        let wanted = wish.ty;
        let pos = expr.pos;
        let float = SymbolType::of(ValueType::Float);
        match &expr.kind {
            ast::ExprKind::Missing => self.bad(pos, wanted),
            ast::ExprKind::Number(n) => number(*n, pos),
            ast::ExprKind::Text(t) => {
                let kind = ExprKind::Const(ConstValue::Strings([t.clone()].into()));
                Expr { ty: SymbolType::of(ValueType::String), kind, pos }
            }
            ast::ExprKind::Variable(name, _) => {
                let constant = builtins::CONSTANTS.iter().find(|(n, _)| **n == *name.text);
                if let (Some((_, value)), None, false) =
                    (constant, self.variable(&name.text), self.lost.declares(&name.text))
                {
                    return number(*value, pos);
                }
                let Some((place, ty)) = self.place(expr) else { return self.bad(pos, wanted) };
                self.mark_read(place.var, pos);
                Expr { ty, kind: ExprKind::Read(place), pos }
            }
            ast::ExprKind::Call(name, args) => self.call(name, args, wish),
            ast::ExprKind::Construct(ty, args) => self.construct(*ty, args, pos),
            ast::ExprKind::Cast(ty, inner) => {
                let value = self.expr(inner, Wish { ty: Some(*ty), cast: true, factor: false });
                self.cast(value, *ty, pos)
            }
            ast::ExprKind::Negate(inner) => {
                let value = self.expr(inner, wish);
                if value.ty.array.is_some() || !NUMBERS.contains(value.ty.value) {
                    return self.operands("-", &[&value], pos, wanted);
                }
                let ty = value.ty;
                fold(Expr { ty, kind: ExprKind::Unary(OpCode::Neg, Box::new(value)), pos })
            }
            ast::ExprKind::Not(inner) => {
                let value = self.expr(inner, Some(ValueType::Float));
                if value.ty.array.is_some() {
                    return self.operands("!", &[&value], pos, wanted);
                }
                Expr { ty: float, kind: ExprKind::Unary(OpCode::Not, Box::new(value)), pos }
            }
            ast::ExprKind::Chain(first, links) => self.chain(first, links, wish),
            ast::ExprKind::Select(arms, otherwise) => self.select(arms, otherwise, pos, wish),
            ast::ExprKind::Assign(op, target, value) => self.assign(*op, target, value, pos, wanted),
            ast::ExprKind::Step { target, up, postfix } => {
                let Some((place, ty)) = self.place(target) else { return self.bad(pos, wanted) };
                if ty != float {
                    let what = format!("`++` and `--` need a `float` variable, not {}", describe(ty));
                    self.diags.error(pos, what);
                    return self.bad(pos, wanted);
                }
                self.mark_read(place.var, target.pos);
                self.mark_written(place.var, target.pos);
                Expr { ty, kind: ExprKind::Step { place, up: *up, postfix: *postfix }, pos }
            }
        }
    }

    /// Reports operands that an operator does not accept.
    fn operands(&mut self, op: &str, operands: &[&Expr], pos: Pos, wanted: Option<ValueType>) -> Expr {
        if !operands.iter().any(|o| matches!(o.kind, ExprKind::Bad)) {
            let types: Vec<String> = operands.iter().map(|o| describe(o.ty)).collect();
            self.diags.error(pos, format!("`{op}` does not apply to {}", types.join(" and ")));
        }
        self.bad(pos, wanted)
    }

    /// Returns the variable, element or component that an expression names.
    fn place(&mut self, expr: &ast::Expr) -> Option<(Place, SymbolType)> {
        let ast::ExprKind::Variable(name, subscripts) = &expr.kind else { return None };
        if self.lost.declares(&name.text) {
            self.lost_place(name, subscripts);
            return None;
        }
        let Some(var) = self.variable(&name.text) else {
            if builtins::CONSTANTS.iter().any(|(n, _)| **n == *name.text) {
                self.diags.error(name.pos, format!("`{}` is a constant", name.text));
                return None;
            }
            let function =
                !self.user_functions(&name.text).is_empty() || builtins::named(&name.text).next().is_some();
            if function {
                let help = Some(format!("write `{} (...)` to call it", name.text));
                self.report_name(name, format!("`{}` is a function", name.text), help);
            } else {
                let help = self.suggest_variable(&name.text);
                self.report_name(name, format!("unknown variable `{}`", name.text), help);
            }
            return None;
        };
        let ty = self.vars[var.0].ty;
        let mut rest = subscripts.iter();
        let mut place = Place { var, element: None, component: Component::All, pos: expr.pos };
        let mut ty = ty;
        if let Some(length) = ty.array {
            let Some(index) = rest.next() else { return Some((place, ty)) };
            let length = if ty.open { None } else { Some(length) };
            place.element = Some(Box::new(self.subscript(index, length, "array")));
            ty = SymbolType::of(ty.value);
        }
        let parts: Vec<&ast::Expr> = rest.collect();
        match (parts.as_slice(), ty.value) {
            ([], _) => return Some((place, ty)),
            ([index], v) if v.is_triple() => {
                place.component = Component::One(Box::new(self.subscript(index, Some(3), v.word())));
            }
            ([row, column], ValueType::Matrix) => {
                let row = self.subscript(row, Some(4), "matrix");
                let column = self.subscript(column, Some(4), "matrix");
                place.component = Component::Cell(Box::new(row), Box::new(column));
            }
            ([_], ValueType::Matrix) => {
                self.diags.error(expr.pos, "a component of a matrix needs a row and a column");
                return None;
            }
            _ => {
                let what =
                    format!("`{}` is {} and has no such subscript", name.text, describe(self.vars[var.0].ty));
                self.diags.error(expr.pos, what);
                return None;
            }
        }
        Some((place, SymbolType::of(ValueType::Float)))
    }

    /// Checks the subscripts of a variable whose declaration may be in a part that could not be parsed.
    fn lost_place(&mut self, name: &ast::Name, subscripts: &[ast::Expr]) {
        if let Some(var) = self.variable(&name.text).map(|id| &mut self.vars[id.0]) {
            (var.read, var.written) = (true, true);
        }
        for index in subscripts {
            self.expr(index, Some(ValueType::Float));
        }
    }

    fn subscript(&mut self, index: &ast::Expr, length: Option<u32>, of: &str) -> Expr {
        let value = self.expr(index, Some(ValueType::Float));
        let value = self.coerce(value, ValueType::Float);
        if let (ExprKind::Const(ConstValue::Floats(v)), Some(length)) = (&value.kind, length) {
            let i = v[0].floor();
            if !(0.0..length as f32).contains(&i) {
                let what = format!("subscript {i} of {} is outside [0..{}]", article(of), length.max(1) - 1);
                self.diags.error(index.pos, what);
            }
        }
        value
    }

    // Conversions.

    /// Converts to `ty` as assignments and arguments do. Reports an error where that is not possible.
    pub(crate) fn coerce(&mut self, value: Expr, ty: ValueType) -> Expr {
        if matches!(value.kind, ExprKind::Bad) {
            return Expr { ty: SymbolType::of(ty), ..value };
        }
        if value.ty.array.is_none() && conversion(value.ty.value, ty).is_some() {
            self.one_channel(&value, ty);
            return convert(value, ty);
        }
        let triples = value.ty.array.is_none() && value.ty.value.is_triple() && ty.is_triple();
        let help = triples.then(|| format!("write `({})` in front to mean that", ty.word()));
        let what = format!("cannot convert {} to `{}`", describe(value.ty), ty.word());
        self.diags.error_help(value.pos, what, help);
        self.bad(value.pos, Some(ty))
    }

    /// Warns about `vector v = texture (...)`. Only the form of one channel fits, which is rarely intended.
    fn one_channel(&mut self, value: &Expr, ty: ValueType) {
        if let ExprKind::Builtin { signature, .. } = &value.kind
            && matches!(signature.ret, Ret::Wanted(set) if set != NUMBERS)
            && value.ty.value == ValueType::Float
            && ty.is_point_like()
        {
            let what = format!("`{}` gives one number here, for all components", signature.func.word());
            let help = format!("write `({})` in front to take three channels", ty.word());
            self.diags.warning_help(value.pos, what, Some(help));
        }
    }

    fn cast(&mut self, value: Expr, ty: ValueType, pos: Pos) -> Expr {
        let from = value.ty.value;
        let allowed = value.ty.array.is_none() && casts(from, ty);
        if matches!(value.kind, ExprKind::Bad) {
            return self.bad(pos, Some(ty));
        }
        if !allowed {
            self.diags.error(pos, format!("cannot cast {} to `{}`", describe(value.ty), ty.word()));
            return self.bad(pos, Some(ty));
        }
        if from == ty {
            return value;
        }
        fold(Expr { ty: SymbolType::of(ty), kind: ExprKind::Convert(Box::new(value)), pos })
    }

    /// Returns a value as a condition, which is a float that is not 0 when it is true.
    pub(crate) fn truth(&mut self, value: Expr) -> Expr {
        let float = SymbolType::of(ValueType::Float);
        if value.ty == float {
            return value;
        }
        let pos = value.pos;
        if value.ty.array.is_some() {
            self.diags.error(pos, format!("{} cannot be a condition", describe(value.ty)));
            return self.bad(pos, Some(ValueType::Float));
        }
        Expr { ty: float, kind: ExprKind::Unary(OpCode::Truth, Box::new(value)), pos }
    }

    // Operators.

    /// Checks operators beside each other, of any number. Expected types are passed from the last to the first, and
    /// types from the first to the last.
    fn chain(&mut self, first: &ast::Expr, links: &[ast::Link], wish: Wish) -> Expr {
        let mut left = self.possible(first, wish.factor);
        let mut sides = Vec::with_capacity(links.len());
        for link in links {
            let right = self.possible(&link.right, wish.factor);
            sides.push((left, right));
            left = possible_link(link.operator, left, right);
        }
        // These are the expected types of both operands and of the result of each operator.
        let mut wishes = vec![(wish, wish, wish); links.len()];
        let mut result = wish;
        for (k, (left, right)) in sides.iter().enumerate().rev() {
            let (a, b) = side_wishes(links[k].operator, *left, *right, result);
            wishes[k] = (a, b, result);
            result = a;
        }
        let mut value = self.expr(first, wishes[0].0);
        for (link, (_, wish, result)) in links.iter().zip(wishes) {
            let operand = self.expr(&link.right, wish);
            value = self.link(value, link, operand, result.ty);
        }
        value
    }

    /// Checks one operator of a chain.
    fn link(&mut self, a: Expr, link: &ast::Link, b: Expr, wanted: Option<ValueType>) -> Expr {
        let (op, pos) = (link.operator, link.pos);
        let linked = |a: Expr, left, operator, right, ty| {
            let link = Link { left, operator, right, ty, pos };
            let kind = match a.kind {
                ExprKind::Chain(first, mut links) => {
                    links.push(link);
                    ExprKind::Chain(first, links)
                }
                kind => ExprKind::Chain(Box::new(Expr { kind, ..a }), vec![link]),
            };
            Expr { ty: SymbolType::of(ty), kind, pos }
        };
        // This is the operation on the left operand. A link of its own would nest chains.
        let within = matches!(a.kind, ExprKind::Chain(..));
        match op {
            Binary::And | Binary::Or => {
                let asks = within && a.ty != SymbolType::of(ValueType::Float);
                let left = asks.then_some((OpCode::Truth, ValueType::Float));
                let a = if within { a } else { self.truth(a) };
                let b = self.truth(b);
                let operator = if op == Binary::And { Operator::And } else { Operator::Or };
                linked(a, left, operator, b, ValueType::Float)
            }
            Binary::Mul | Binary::Div | Binary::Add | Binary::Sub => {
                let ty = match (a.ty.array, b.ty.array) {
                    (None, None) => arithmetic_type(op, a.ty.value, b.ty.value),
                    _ => None,
                };
                let Some(ty) = ty else { return self.arithmetic_mistake(op, &a, &b, pos, wanted) };
                fold(linked(a, None, Operator::Op(opcode(op)), b, ty))
            }
            _ => {
                let ordered = !matches!(op, Binary::Eq | Binary::Ne);
                let common = common_type(a.ty, b.ty).filter(|t| !ordered || *t == ValueType::Float);
                let Some(common) = common else { return self.operands(op.word(), &[&a, &b], pos, wanted) };
                let converts = within && a.ty.value.components() != common.components();
                let left = converts.then_some((OpCode::Assign, common));
                let a = if within { a } else { convert(a, common) };
                linked(a, left, Operator::Op(opcode(op)), convert(b, common), ValueType::Float)
            }
        }
    }

    /// Checks `c ? a : d ? b : ...`. All values are converted to the type that the first one and the rest have in
    /// common.
    fn select(
        &mut self,
        arms: &[(ast::Expr, ast::Expr)],
        otherwise: &ast::Expr,
        pos: Pos,
        wish: Wish,
    ) -> Expr {
        let wanted = wish.ty;
        let mut checked = Vec::with_capacity(arms.len());
        for (condition, value) in arms {
            let condition = self.condition(condition);
            checked.push((condition, self.expr(value, wish)));
        }
        let otherwise = self.expr(otherwise, wish);
        let mut common = otherwise.ty;
        for (_, value) in checked.iter().rev() {
            let Some(ty) = common_type(value.ty, common) else {
                let rest = Expr { ty: common, kind: ExprKind::Const(crate::check::zero(common.value)), pos };
                let bad = matches!(otherwise.kind, ExprKind::Bad);
                let rest = if bad { self.bad(pos, wanted) } else { rest };
                return self.operands("?:", &[value, &rest], pos, wanted);
            };
            common = SymbolType::of(ty);
        }
        let mut coerced = Vec::with_capacity(arms.len());
        for (condition, value) in checked {
            coerced.push((condition, self.coerce(value, common.value)));
        }
        let otherwise = self.coerce(otherwise, common.value);
        Expr { ty: common, kind: ExprKind::Select(coerced, Box::new(otherwise)), pos }
    }

    fn arithmetic_mistake(
        &mut self,
        op: Binary,
        a: &Expr,
        b: &Expr,
        pos: Pos,
        wanted: Option<ValueType>,
    ) -> Expr {
        let is_bad = matches!(a.kind, ExprKind::Bad) || matches!(b.kind, ExprKind::Bad);
        let mixed = !is_bad && a.ty.value.is_triple() && b.ty.value.is_triple();
        if mixed && a.ty.array.is_none() && b.ty.array.is_none() {
            let what = format!("`{}` does not mix {} and {}", op.word(), describe(a.ty), describe(b.ty));
            let help = format!("cast one of them, as `({})`", a.ty.value.word());
            self.diags.error_help(pos, what, Some(help));
            return self.bad(pos, wanted);
        }
        self.operands(op.word(), &[a, b], pos, wanted)
    }

    fn assign(
        &mut self,
        op: Option<Binary>,
        target: &ast::Expr,
        value: &ast::Expr,
        pos: Pos,
        wanted: Option<ValueType>,
    ) -> Expr {
        let place = self.place(target);
        let wish = place.as_ref().map(|(_, ty)| ty.value).map_or(Wish::default(), |ty| match op {
            None => ty.into(),
            Some(op) => {
                let factor = matches!(op, Binary::Mul | Binary::Div);
                let value = self.possible(value, factor);
                operand_wishes(op, Possible::Value(ty), value, Wish { factor, ..ty.into() }).1
            }
        });
        let value = self.expr(value, wish);
        let Some((place, ty)) = place else { return self.bad(pos, wanted) };
        if op.is_some() {
            self.mark_read(place.var, target.pos);
        }
        self.mark_written(place.var, target.pos);
        let value = if ty.array.is_some() || value.ty.array.is_some() {
            let fits = op.is_none()
                && ty.value == value.ty.value
                && ty.array.is_some() == value.ty.array.is_some()
                && (ty.open || value.ty.open || ty.array == value.ty.array);
            if !fits && !matches!(value.kind, ExprKind::Bad) {
                let what = format!("cannot assign {} to {}", describe(value.ty), describe(ty));
                self.diags.error(pos, what);
                return self.bad(pos, wanted);
            }
            value
        } else if let Some(op) = op {
            let result = arithmetic_type(op, ty.value, value.ty.value);
            let fits = result.is_some_and(|r| conversion(r, ty.value).is_some_and(|c| c < 4));
            if !fits {
                let left = Expr { ty, kind: ExprKind::Const(crate::check::zero(ty.value)), pos };
                let sign = format!("{}=", op.word());
                return self.operands(&sign, &[&left, &value], pos, wanted);
            }
            value
        } else {
            self.coerce(value, ty.value)
        };
        let kind = ExprKind::Assign { place, op: op.map(opcode), value: Box::new(value) };
        Expr { ty, kind, pos }
    }

    // Constructors and calls.

    fn construct(&mut self, ty: ValueType, args: &[ast::Expr], pos: Pos) -> Expr {
        let named =
            args.first().is_some_and(|a| self.possible(a, false) == Possible::Value(ValueType::String));
        let (space, numbers) = if named { args.split_at(1) } else { args.split_at(0) };
        let full = ty.components();
        if ty == ValueType::Float && named {
            self.diags.error(pos, "a `float` has no space");
            return self.bad(pos, Some(ty));
        }
        // `vector (P)` is read as a cast.
        if let ([one], false, true) = (numbers, named, ty.is_triple()) {
            let value = self.expr(one, Some(ty));
            if value.ty.array.is_none() && value.ty.value.is_triple() {
                return self.cast(value, ty, pos);
            }
            let part = self.coerce(value, ValueType::Float);
            let kind = ExprKind::Construct { space: None, parts: vec![part] };
            return fold(Expr { ty: SymbolType::of(ty), kind, pos });
        }
        if numbers.len() != 1 && numbers.len() != full {
            let what = format!("`{}` takes 1 or {full} numbers, {} given", ty.word(), numbers.len());
            self.diags.error(pos, what);
            return self.bad(pos, Some(ty));
        }
        let space = space.first().map(|s| Box::new(self.expr(s, Some(ValueType::String))));
        let mut parts = Vec::with_capacity(numbers.len());
        for number in numbers {
            let value = self.expr(number, Some(ValueType::Float));
            parts.push(self.coerce(value, ValueType::Float));
        }
        if ty == ValueType::Float {
            return parts.pop().unwrap_or_else(|| self.bad(pos, Some(ty)));
        }
        fold(Expr { ty: SymbolType::of(ty), kind: ExprKind::Construct { space, parts }, pos })
    }

    fn call(&mut self, name: &ast::Name, args: &[ast::Expr], wish: Wish) -> Expr {
        let pos = name.pos;
        if self.lost.declares(&name.text) {
            for arg in args {
                self.expr(arg, None);
            }
            return self.bad(pos, wish.ty);
        }
        let builtin = builtins::named(&name.text).next().is_some();
        let user = !self.user_functions(&name.text).is_empty();
        if user && !builtin {
            return self.user_call(name, args, wish.ty);
        }
        if &*name.text == "exit" {
            if !args.is_empty() {
                self.diags.error(pos, "`exit` takes no arguments");
            }
            return Expr { ty: SymbolType::of(ValueType::Void), kind: ExprKind::Exit, pos };
        }
        if !builtin {
            for arg in args {
                self.expr(arg, None);
            }
            let help = self.suggest_function(&name.text);
            self.report_name(name, format!("unknown function `{}`", name.text), help);
            return self.bad(pos, wish.ty);
        }
        let possible = self.possible_arguments(&name.text, args, wish.factor);
        let (row, same) = match self.choose(&name.text, &possible, wish.ty) {
            Choose::Builtin(chosen) => chosen,
            Choose::User => return self.user_call(name, args, wish.ty),
            Choose::Nothing => return self.no_form(name, args, wish.ty),
        };
        let ret = match row.ret {
            Ret::Is(ty) => ty,
            Ret::Same => same.unwrap_or(ValueType::Float),
            Ret::Wanted(set) => from_set(set, wish),
        };
        let factor = wish.factor && passes_factor(&name.text);
        let mut checked = Vec::with_capacity(args.len());
        let mut outputs = Vec::with_capacity(args.len());
        let fixed = if let Rest::Options(_) = row.rest { row.args.len() } else { args.len() };
        for (i, arg) in args[..fixed].iter().enumerate() {
            let Some((kind, _)) = argument(row, i) else { continue };
            let (value, output) = match kind {
                Arg::Is(ty) => {
                    let value = self.expr(arg, Some(ty));
                    (self.coerce(value, ty), false)
                }
                Arg::Same(_) => {
                    let value = self.expr(arg, Wish { factor, ..same.into() });
                    (self.coerce(value, ret), false)
                }
                Arg::Any(_) | Arg::Data | Arg::Array | Arg::SameArray(_) => (self.expr(arg, None), false),
                Arg::Out(ty) => (self.output(arg, Some(ty)), true),
                Arg::OutAny(_) | Arg::OutData => (self.output(arg, None), true),
            };
            checked.push(value);
            outputs.push(output);
        }
        if let Rest::Options(choices) = row.rest {
            let (list, outs) = self.options(&args[fixed..], choices, &name.text, pos);
            checked.extend(list);
            outputs.extend(outs);
        }
        if row.rest == Rest::Values {
            self.check_template(row, &checked);
        }
        let kind = ExprKind::Builtin { signature: row, args: checked, outputs };
        Expr { ty: SymbolType::of(ret), kind, pos }
    }

    /// Reports arguments that no overload of a function accepts.
    pub(crate) fn no_form(
        &mut self,
        name: &ast::Name,
        args: &[ast::Expr],
        wanted: Option<ValueType>,
    ) -> Expr {
        let before = self.diags.has_errors();
        let checked: Vec<Expr> = args.iter().map(|a| self.expr(a, None)).collect();
        let bad = checked.iter().any(|c| matches!(c.kind, ExprKind::Bad));
        if !(bad && (before || self.diags.has_errors())) {
            let mut types: Vec<String> = checked.iter().take(24).map(|c| spell_type(c.ty)).collect();
            if types.len() < checked.len() {
                types.push("...".into());
            }
            let what = format!("no form of `{}` takes ({})", name.text, types.join(", "));
            let mut forms = self.user_forms(&name.text);
            forms.extend(builtins::named(&name.text).map(Signature::spell));
            if forms.len() > 6 {
                forms.truncate(5);
                forms.push("...".into());
            }
            let help = Some(format!("it is one of {}", forms.join("; ")));
            self.diags.error_help(name.pos, what, help);
        }
        self.bad(name.pos, wanted)
    }

    /// Checks an argument that the function writes.
    pub(crate) fn output(&mut self, arg: &ast::Expr, ty: Option<ValueType>) -> Expr {
        let Some((place, found)) = self.output_place(arg) else { return self.bad(arg.pos, ty) };
        let fits = ty.is_none_or(|ty| {
            found.array.is_none()
                && (found.value == ty || (found.value.is_point_like() && ty.is_point_like()))
        });
        if !fits {
            let word = ty.map_or("value", ValueType::word);
            let what = format!("the function writes a `{word}` here, which {} cannot hold", describe(found));
            self.diags.error(arg.pos, what);
            return self.bad(arg.pos, ty);
        }
        Expr { ty: found, kind: ExprKind::Read(place), pos: arg.pos }
    }

    pub(crate) fn output_place(&mut self, arg: &ast::Expr) -> Option<(Place, SymbolType)> {
        if !matches!(arg.kind, ast::ExprKind::Variable(..)) {
            self.diags.error(arg.pos, "the function writes this argument, so it must be a variable");
            return None;
        }
        let (place, ty) = self.place(arg)?;
        self.mark_written(place.var, arg.pos);
        self.vars[place.var.0].read = true;
        Some((place, ty))
    }

    /// Checks names and values of optional arguments, and finds those that are written.
    pub(crate) fn options(
        &mut self,
        args: &[ast::Expr],
        choices: &[Choice],
        function: &str,
        pos: Pos,
    ) -> (Vec<Expr>, Vec<bool>) {
        let (mut list, mut outputs) = (Vec::new(), Vec::new());
        for pair in args.chunks(2) {
            let [name, value] = pair else {
                self.diags.error(pos, format!("an optional argument of `{function}` has no value"));
                break;
            };
            let name_pos = name.pos;
            let name = self.expr(name, Some(ValueType::String));
            let name = self.coerce(name, ValueType::String);
            let word = match &name.kind {
                ExprKind::Const(ConstValue::Strings(s)) => Some(s[0].clone()),
                _ => None,
            };
            let choice = word.as_ref().and_then(|w| choices.iter().find(|c| *c.name == **w));
            if let (Some(word), None) = (&word, choice) {
                let help = suggestion(word, choices.iter().map(|c| c.name));
                let what = format!("`{function}` has no option \"{word}\"");
                self.diags.warning_help(name_pos, what, help);
            }
            let (value, output) = match choice {
                Some(choice) if choice.output => (self.output(value, Some(choice.ty)), true),
                Some(choice) if choice.array.is_some() => {
                    let found = self.expr(value, None);
                    let fits = found.ty.value == choice.ty && found.ty.array == choice.array;
                    if !fits && !matches!(found.kind, ExprKind::Bad) {
                        let n = choice.array.unwrap_or(1);
                        let what = format!("option \"{}\" needs a `{}[{n}]`", choice.name, choice.ty.word());
                        self.diags.error(value.pos, what);
                    }
                    (found, false)
                }
                Some(choice) => {
                    let found = self.expr(value, Some(choice.ty));
                    (self.coerce(found, choice.ty), false)
                }
                None => (self.expr(value, None), false),
            };
            list.extend([name, value]);
            outputs.extend([false, output]);
        }
        (list, outputs)
    }

    /// Compares a constant template with its values, as `printf` takes them.
    fn check_template(&mut self, row: &Signature, args: &[Expr]) {
        let at = row.args.len() - 1;
        let Some(template) = args.get(at) else { return };
        let ExprKind::Const(ConstValue::Strings(text)) = &template.kind else { return };
        let mut wanted = 0;
        let mut chars = text[0].chars().peekable();
        while let Some(c) = chars.next() {
            if c != '%' {
                continue;
            }
            if chars.peek() == Some(&'%') {
                chars.next();
                continue;
            }
            while chars.peek().is_some_and(|c| c.is_ascii_digit() || matches!(c, '.' | '-' | '+' | ' ' | '#'))
            {
                chars.next();
            }
            match chars.next() {
                Some(letter) if builtins::CONVERSIONS.contains(letter) => wanted += 1,
                other => {
                    let shown = other.map_or(String::new(), String::from);
                    let what = format!("the template has the unknown conversion `%{shown}`");
                    self.diags.warning(template.pos, what);
                    return;
                }
            }
        }
        // An array counts as its elements, whose number is open for some parameters.
        let values = &args[at + 1..];
        let given: usize = values.iter().map(|value| value.ty.elements()).sum();
        let is_known = |value: &Expr| !value.ty.open && !matches!(value.kind, ExprKind::Bad);
        if wanted != given && values.iter().all(is_known) {
            let what = format!("the template prints {wanted} values, {given} given");
            self.diags.warning(template.pos, what);
        }
    }
}

/// Returns the types that an operator's result can have.
fn possible_link(op: Binary, a: Possible, b: Possible) -> Possible {
    if is_arithmetic(op) { possible_result(op, a, b) } else { Possible::Value(ValueType::Float) }
}

fn is_arithmetic(op: Binary) -> bool {
    matches!(op, Binary::Mul | Binary::Div | Binary::Add | Binary::Sub)
}

/// Returns the expected types of the operands of an operator.
fn side_wishes(op: Binary, left: Possible, right: Possible, wish: Wish) -> (Wish, Wish) {
    let value = |p: Possible| match p {
        Possible::Value(ty) => Some(ty),
        _ => None,
    };
    match op {
        Binary::And | Binary::Or => (ValueType::Float.into(), ValueType::Float.into()),
        _ if is_arithmetic(op) => operand_wishes(op, left, right, wish),
        _ => {
            let (a, b) = (value(left), value(right));
            let either =
                |first: Option<ValueType>, second| Wish::from(first.or(second).unwrap_or(ValueType::Float));
            (either(a, b), either(b, a))
        }
    }
}
