//! Values that a scene sets for a shader instance.

use crate::run::strings::Strings;
use granita_base::{BaseType, Param, ParamData, ParamType, Severity};
use granita_gsl::ir::{Symbol, ValueType};
use std::sync::Arc;

/// Returns the instance's value for a parameter in the form of registers. Returns `None` when the types are not
/// compatible, which is reported.
///
/// Any numeric type converts when the number of values fits, and one number fills a single triple. A
/// variable-length array takes any whole number of elements.
pub(crate) fn given(
    symbol: &Symbol,
    param: &Param,
    strings: &mut Strings,
    report: &mut dyn FnMut(Severity, String),
) -> Option<Arc<[f32]>> {
    let (value, elements) = (symbol.ty.value, symbol.ty.elements());
    let values: Arc<[f32]> = match (&param.data, value) {
        (ParamData::String(list), ValueType::String) => {
            list.iter().map(|s| strings.intern(s).to_register()).collect()
        }
        (ParamData::String(_), _) | (_, ValueType::String) => {
            return refuse(symbol, param, report);
        }
        (data, _) => data.to_floats()?,
    };
    let size = value.components();
    if symbol.ty.array.is_some() && symbol.ty.open {
        return if !values.is_empty() && values.len().is_multiple_of(size) {
            Some(values)
        } else {
            refuse(symbol, param, report)
        };
    }
    if values.len() == size * elements {
        // A matrix of 16 floats and a point of 3 are accepted. A colour from an hpoint is not.
        return Some(values);
    }
    if values.len() == 1 && symbol.ty.array.is_none() && value.is_triple() {
        return Some([values[0]; 3].into());
    }
    refuse(symbol, param, report)
}

/// Reports a value that does not fit.
fn refuse(symbol: &Symbol, param: &Param, report: &mut dyn FnMut(Severity, String)) -> Option<Arc<[f32]>> {
    let array = symbol.ty.array.map_or(String::new(), |n| format!("[{n}]"));
    let what = if param.ty.base == BaseType::Unknown {
        format!("{} values", param.data.len())
    } else {
        format!("{} with {} values", param.ty, param.data.len())
    };
    report(
        Severity::Warning,
        format!("parameter \"{}\" is a {}{array}, not {what}", symbol.name, symbol.ty.value.word()),
    );
    None
}

/// True when data of a declared type is a value of the language's type. Integers are floats.
pub(crate) fn same_type(ty: ParamType, value: ValueType, array: Option<u32>) -> bool {
    let base = if ty.base == BaseType::Int { BaseType::Float } else { ty.base };
    Some(base) == value.base_type() && ty.array == array
}
