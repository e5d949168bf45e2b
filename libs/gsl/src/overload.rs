//! Conversions between types, and how well arguments fit an overload.

use crate::ast::Binary;
use crate::builtins::{Arg, NUMBERS, Rest, Signature, TypeSet};
use crate::check_expr::Possible;
use crate::ir::{SymbolType, ValueType};

/// Cost of a conversion that needs no cast.
pub(crate) fn conversion(from: ValueType, to: ValueType) -> Option<u32> {
    match (from, to) {
        (a, b) if a == b => Some(0),
        (a, b) if a.is_point_like() && b.is_point_like() => Some(1),
        (ValueType::Float, b) if b.is_triple() => Some(4),
        (ValueType::Float, ValueType::Matrix) => Some(5),
        _ => None,
    }
}

/// Type of `a op b`, if there is one.
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

/// Type that two values are compared in, or chosen from.
pub(crate) fn common_type(a: SymbolType, b: SymbolType) -> Option<ValueType> {
    if a.array.is_some() || b.array.is_some() {
        return None;
    }
    if conversion(b.value, a.value).is_some() {
        return Some(a.value);
    }
    conversion(a.value, b.value).map(|_| b.value)
}

/// What an operand of an arithmetic operator should be.
pub(crate) fn operand_type(
    op: Binary,
    this: Possible,
    other: Possible,
    wanted: Option<ValueType>,
) -> Option<ValueType> {
    let Possible::Wanted(set) = this else {
        return match this {
            Possible::Value(ty) => Some(ty),
            _ => wanted,
        };
    };
    match (wanted, other) {
        (Some(ty), _) if set.contains(ty) => Some(ty),
        (_, Possible::Value(ty)) if set.contains(ty) && matches!(op, Binary::Add | Binary::Sub) => Some(ty),
        _ => wanted,
    }
}

/// What a function that can return `set` returns where `wanted` is wanted.
pub(crate) fn from_set(set: TypeSet, wanted: Option<ValueType>) -> ValueType {
    match wanted {
        Some(ty) if set.contains(ty) => ty,
        // `(normal) texture (...)` takes three channels.
        Some(ty) if ty.is_triple() && set.contains(ValueType::Color) => ValueType::Color,
        _ => set.iter().next().unwrap_or(ValueType::Float),
    }
}

/// What argument `i` of an overload may be, and whether it is one of the `rest`; `None` beyond the last.
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

/// How well arguments fit an overload: the cost, and the type of `Same` arguments. `None`: not at all.
pub(crate) fn fit(
    row: &Signature,
    args: &[Possible],
    wanted: Option<ValueType>,
) -> Option<(u32, Option<ValueType>)> {
    let fixed = row.args.len();
    if args.len() < fixed {
        return None;
    }
    match row.rest {
        Rest::Nothing if args.len() > fixed => return None,
        Rest::Same(n) if args.len() < fixed + n => return None,
        Rest::Options(_) => {
            let mut rest = args[fixed..].chunks(2);
            let named = |p: &[Possible]| matches!(p[0], Possible::Value(ValueType::String) | Possible::Bad);
            if !rest.all(named) {
                return None;
            }
        }
        _ => {}
    }
    let positional = if let Rest::Options(_) = row.rest { fixed } else { args.len() };
    let mut cost = 0;
    let mut same: Option<TypeSet> = None;
    let mut shared: Vec<Possible> = Vec::new();
    for (i, possible) in args[..positional].iter().enumerate() {
        let (arg, _) = argument(row, i)?;
        cost += match arg {
            Arg::Is(ty) => reach(*possible, ty)?,
            Arg::Same(set) => {
                same = Some(set);
                shared.push(*possible);
                0
            }
            Arg::Any(set) => match *possible {
                Possible::Value(ty) if set.contains(ty) => 0,
                Possible::Wanted(_) | Possible::Bad => 0,
                _ => return None,
            },
            Arg::Data | Arg::OutData => match *possible {
                Possible::Value(ValueType::Void) => return None,
                _ => 0,
            },
            Arg::Array => match *possible {
                Possible::Array(_) | Possible::Bad => 0,
                _ => return None,
            },
            Arg::SameArray(set) => match *possible {
                Possible::Array(ty) if set.contains(ty) => {
                    same = Some(TypeSet::of(&[ty]));
                    0
                }
                Possible::Bad => 0,
                _ => return None,
            },
            // What is no variable of the right type is reported when it is checked.
            Arg::Out(ty) => match *possible {
                Possible::Value(found) => {
                    if found.components() != ty.components() || (found == ValueType::String) {
                        return None;
                    }
                    u32::from(found != ty)
                }
                Possible::Bad => 0,
                _ => return None,
            },
            Arg::OutAny(set) => match *possible {
                Possible::Value(ty) if set.contains(ty) => 0,
                Possible::Bad => 0,
                _ => return None,
            },
        };
    }
    let Some(set) = same else { return Some((cost, None)) };
    // The type of the shared arguments: the one that converts least; where an argument can be what is
    // wanted, what the context wants.
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
    let (more, ty) = best?;
    Some((cost + more, Some(ty)))
}

/// Cost of making an argument a `ty`.
pub(crate) fn reach(possible: Possible, ty: ValueType) -> Option<u32> {
    match possible {
        Possible::Value(found) => conversion(found, ty),
        Possible::Wanted(set) if set.contains(ty) => Some(0),
        Possible::Wanted(_) => conversion(ValueType::Float, ty),
        Possible::Bad => Some(0),
        Possible::Array(_) => None,
    }
}

/// A type with its article, for messages: "an array `float[3]`".
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
