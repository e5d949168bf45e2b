//! Conversions between types, and the cost of arguments for an overload.

use crate::ast::Binary;
use crate::builtins::{Arg, NUMBERS, Rest, Signature, TypeSet};
use crate::ir::{SymbolType, ValueType};

/// The types that an expression can have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Possible {
    Value(ValueType),
    Array(ValueType),
    /// One of these types, as the context expects.
    Wanted(TypeSet),
    /// The expression is invalid, which is reported elsewhere.
    Bad,
}

/// Returns the cost of a conversion that needs no cast.
pub(crate) fn conversion(from: ValueType, to: ValueType) -> Option<u32> {
    match (from, to) {
        (a, b) if a == b => Some(0),
        (a, b) if a.is_point_like() && b.is_point_like() => Some(1),
        (ValueType::Float, b) if b.is_triple() => Some(4),
        (ValueType::Float, ValueType::Matrix) => Some(5),
        _ => None,
    }
}

/// True when a value can be cast to another type.
pub(crate) fn casts(from: ValueType, to: ValueType) -> bool {
    from == to || (from.is_triple() && to.is_triple()) || conversion(from, to).is_some()
}

/// Returns the type of `a op b`, if there is one.
pub(crate) fn arithmetic_type(op: Binary, a: ValueType, b: ValueType) -> Option<ValueType> {
    use ValueType::{Float, Matrix, Normal, Point, String, Vector, Void};
    match (a, b) {
        (String | Void, _) | (_, String | Void) => None,
        (Matrix, Matrix | Float) | (Float, Matrix) => {
            matches!(op, Binary::Mul | Binary::Div).then_some(Matrix)
        }
        (Matrix, _) | (_, Matrix) => None,
        (Point, Point) if op == Binary::Sub => Some(Vector),
        (a, b) if a == b => Some(a),
        (Float, b) => Some(b),
        (a, Float) => Some(a),
        (Point, b) | (b, Point) if b.is_point_like() => Some(Point),
        (Normal, Vector) | (Vector, Normal) => Some(Vector),
        _ => None,
    }
}

/// Returns the type in which two values are compared or selected.
pub(crate) fn common_type(a: SymbolType, b: SymbolType) -> Option<ValueType> {
    if a.array.is_some() || b.array.is_some() {
        return None;
    }
    if conversion(b.value, a.value).is_some() {
        return Some(a.value);
    }
    conversion(a.value, b.value).map(|_| b.value)
}

/// The type that the context of an expression expects.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Wish {
    /// The type of the assigned variable, cast, argument or result; `None` where any type is accepted.
    pub(crate) ty: Option<ValueType>,
    /// True when the expression is cast, so that all triples are equivalent.
    pub(crate) cast: bool,
    /// True when the expression is right of `*=` or `/=`, where noise and random functions are floats.
    pub(crate) factor: bool,
}

impl From<Option<ValueType>> for Wish {
    fn from(ty: Option<ValueType>) -> Self {
        Self { ty, ..Self::default() }
    }
}

impl From<ValueType> for Wish {
    fn from(ty: ValueType) -> Self {
        Some(ty).into()
    }
}

impl Wish {
    /// Returns the same wish for another type.
    fn of(self, ty: ValueType) -> Self {
        Self { ty: Some(ty), cast: false, ..self }
    }

    /// Returns the cost of a value of type `found`; `None` when it does not fit.
    fn cost(self, found: ValueType) -> Option<u32> {
        let Some(ty) = self.ty else { return Some(0) };
        conversion(found, ty).or((self.cast && found.is_triple() && ty.is_triple()).then_some(2))
    }
}

/// Returns the types that an expression can have; `None` for arrays, errors and expressions without a value.
fn types(possible: Possible) -> Option<TypeSet> {
    match possible {
        Possible::Value(ValueType::Void) | Possible::Array(_) | Possible::Bad => None,
        Possible::Value(ty) => Some(TypeSet::of(&[ty])),
        Possible::Wanted(set) => Some(set),
    }
}

/// Returns the expected types of the operands of an arithmetic operator. Of all pairs of types that the operator
/// accepts, it is the one whose result is nearest to the expected type.
pub(crate) fn operand_wishes(op: Binary, left: Possible, right: Possible, wish: Wish) -> (Wish, Wish) {
    let (Some(lefts), Some(rights)) = (types(left), types(right)) else { return (wish, wish) };
    // The distance of the type of an operand that has a choice from its best type.
    let rank = |ty: ValueType, own: Possible, other: Possible| match own {
        Possible::Wanted(_) if wish.ty == Some(ty) => 0,
        Possible::Wanted(_)
            if matches!(op, Binary::Add | Binary::Sub)
                && ty != ValueType::Float
                && other == Possible::Value(ty) =>
        {
            1
        }
        Possible::Wanted(_) if ty == ValueType::Color && wish.ty.is_some_and(ValueType::is_triple) => 2,
        Possible::Wanted(_) if ty == ValueType::Float => 3,
        Possible::Wanted(_) => 4,
        _ => 0,
    };
    let mut best: Option<((bool, u32, u32), ValueType, ValueType)> = None;
    for a in lefts.iter() {
        for b in rights.iter() {
            let Some(result) = arithmetic_type(op, a, b) else { continue };
            let cost = wish.cost(result);
            let key = (cost.is_none(), rank(a, left, right) + rank(b, right, left), cost.unwrap_or(0));
            if best.is_none_or(|(least, ..)| key < least) {
                best = Some((key, a, b));
            }
        }
    }
    best.map_or((wish, wish), |(_, a, b)| (wish.of(a), wish.of(b)))
}

/// Returns the types that an operator's result can have.
pub(crate) fn possible_result(op: Binary, left: Possible, right: Possible) -> Possible {
    let (Some(lefts), Some(rights)) = (types(left), types(right)) else { return Possible::Bad };
    let pairs = lefts.iter().flat_map(|a| rights.iter().map(move |b| (a, b)));
    let results: Vec<ValueType> = pairs.filter_map(|(a, b)| arithmetic_type(op, a, b)).collect();
    // An operand with one type keeps it beside an operand that has a choice.
    if let (Possible::Value(ty), Possible::Wanted(_)) | (Possible::Wanted(_), Possible::Value(ty)) =
        (left, right)
        && ty != ValueType::Float
        && results.contains(&ty)
    {
        return Possible::Value(ty);
    }
    match results.as_slice() {
        [] => Possible::Bad,
        [first, rest @ ..] if rest.iter().all(|ty| ty == first) => Possible::Value(*first),
        all => Possible::Wanted(TypeSet::of(all)),
    }
}

/// Returns the result type of a function that can return `set`, for an expected type.
pub(crate) fn from_set(set: TypeSet, wish: Wish) -> ValueType {
    match wish.ty {
        _ if wish.factor && set == NUMBERS => ValueType::Float,
        Some(ty) if set.contains(ty) => ty,
        // `(normal) texture (...)` takes three channels.
        Some(ty) if wish.cast && ty.is_triple() && set.contains(ValueType::Color) => ValueType::Color,
        _ => set.iter().next().unwrap_or(ValueType::Float),
    }
}

/// Returns the accepted types of argument `i` of an overload, and true when it is one of the `rest`; `None` beyond
/// the last.
pub(crate) fn argument(row: &Signature, i: usize) -> Option<(Arg, bool)> {
    if let Some(arg) = row.args.get(i) {
        return Some((*arg, false));
    }
    let arg = match row.rest {
        Rest::Nothing | Rest::Options(_) => return None,
        Rest::Values => Arg::Data,
        Rest::Strings => Arg::Is(ValueType::String),
        Rest::Same(_) => Arg::Same(NUMBERS),
    };
    Some((arg, true))
}

/// Returns the cost of arguments for an overload, and the type of `Same` arguments; `None` when they are not
/// accepted.
pub(crate) fn fit(
    row: &Signature,
    args: &[Possible],
    wanted: Option<ValueType>,
) -> Option<(u32, Option<ValueType>)> {
    if !fits_length(row, args) {
        return None;
    }
    let positional = if let Rest::Options(_) = row.rest { row.args.len() } else { args.len() };
    let mut cost = 0;
    let mut same: Option<TypeSet> = None;
    let mut shared: Vec<Possible> = Vec::new();
    for (i, possible) in args[..positional].iter().enumerate() {
        let (arg, _) = argument(row, i)?;
        cost += own_cost(arg, *possible)?;
        match (arg, *possible) {
            (Arg::Same(set), possible) => {
                same = Some(set);
                shared.push(possible);
            }
            (Arg::SameArray(_), Possible::Array(ty)) => same = Some(TypeSet::of(&[ty])),
            _ => {}
        }
    }
    let Some(set) = same else { return Some((cost, None)) };
    let (more, ty) = shared_type(set, &shared, wanted)?;
    Some((cost + more, Some(ty)))
}

/// True when an overload takes this number of arguments, and when the options after the fixed ones have names.
fn fits_length(row: &Signature, args: &[Possible]) -> bool {
    let fixed = row.args.len();
    if args.len() < fixed {
        return false;
    }
    match row.rest {
        Rest::Nothing => args.len() == fixed,
        Rest::Same(n) => args.len() >= fixed + n,
        Rest::Options(_) => {
            let mut rest = args[fixed..].chunks(2);
            rest.all(|p| matches!(p[0], Possible::Value(ValueType::String) | Possible::Bad))
        }
        _ => true,
    }
}

/// Returns the cost of one argument; `None` when it is not accepted. `Same` arguments cost nothing here, because their
/// cost depends on the type that they share.
fn own_cost(arg: Arg, possible: Possible) -> Option<u32> {
    let accepted = match arg {
        Arg::Is(ty) => return reach(possible, ty),
        Arg::Same(_) => true,
        Arg::Any(set) => match possible {
            Possible::Value(ty) => set.contains(ty),
            Possible::Wanted(_) | Possible::Bad => true,
            Possible::Array(_) => false,
        },
        Arg::Data | Arg::OutData => possible != Possible::Value(ValueType::Void),
        Arg::Array => matches!(possible, Possible::Array(_) | Possible::Bad),
        Arg::SameArray(set) => match possible {
            Possible::Array(ty) => set.contains(ty),
            other => other == Possible::Bad,
        },
        // An argument that is not a variable of the right type is reported when it is checked.
        Arg::Out(ty) => match possible {
            Possible::Value(found) => {
                if found.components() != ty.components() || (found == ValueType::String) {
                    return None;
                }
                return Some(u32::from(found != ty));
            }
            other => other == Possible::Bad,
        },
        Arg::OutAny(set) => match possible {
            Possible::Value(ty) => set.contains(ty),
            other => other == Possible::Bad,
        },
    };
    accepted.then_some(0)
}

/// Returns the type of the `Same` arguments among those of a set, and their cost: the type that converts least. Where
/// an argument can be what is wanted, it is what the context wants.
fn shared_type(set: TypeSet, shared: &[Possible], wanted: Option<ValueType>) -> Option<(u32, ValueType)> {
    let open = shared.iter().any(|p| matches!(p, Possible::Wanted(_)));
    let mut best: Option<(u32, ValueType)> = None;
    for ty in set.iter() {
        let Some(mut total) = shared.iter().map(|p| reach(*p, ty)).sum::<Option<u32>>() else { continue };
        if open && wanted.is_some_and(|w| w != ty && set.contains(w)) {
            total += 100;
        }
        if best.is_none_or(|(c, _)| total < c) {
            best = Some((total, ty));
        }
    }
    best
}

/// Returns the number of arguments that could be floats and become another type in an overload with these argument
/// types.
pub(crate) fn bent(args: &[Possible], ty: impl Fn(usize) -> Option<ValueType>) -> u32 {
    let is_bent = |(i, possible): (usize, &Possible)| {
        matches!(possible, Possible::Wanted(set) if set.contains(ValueType::Float))
            && ty(i).is_some_and(|ty| ty != ValueType::Float)
    };
    args.iter().enumerate().map(|arg| u32::from(is_bent(arg))).sum()
}

/// Returns the cost of converting an argument to `ty`.
pub(crate) fn reach(possible: Possible, ty: ValueType) -> Option<u32> {
    match possible {
        Possible::Value(found) => conversion(found, ty),
        Possible::Wanted(set) => set.iter().filter_map(|found| conversion(found, ty)).min(),
        Possible::Bad => Some(0),
        Possible::Array(_) => None,
    }
}

/// Returns a type with its article for messages, such as "an array `float[3]`".
pub(crate) fn describe(ty: SymbolType) -> String {
    match ty.array {
        Some(_) => format!("an array `{}`", spell_type(ty)),
        None => format!("a `{}`", ty.value.word()),
    }
}

pub(crate) fn article(word: &str) -> String {
    let vowel = word.starts_with(['a', 'e', 'i', 'o', 'u']);
    format!("{} {word}", if vowel { "an" } else { "a" })
}

pub(crate) fn spell_type(ty: SymbolType) -> String {
    match ty.array {
        Some(_) if ty.open => format!("{}[]", ty.value.word()),
        Some(n) => format!("{}[{n}]", ty.value.word()),
        None => ty.value.word().to_owned(),
    }
}
