//! The storage and types of values that C and C++ pass.

use granita_base::{BaseType, ParamData, ParamType};
use std::ffi::{CStr, c_char, c_int, c_void};
use std::sync::Arc;

/// A parameter that waits for the call that uses it.
pub(super) struct Pending {
    pub(super) name: Arc<str>,
    pub(super) ty: ParamType,
    pub(super) source: Source,
}

/// The storage of the values of a parameter.
pub(super) enum Source {
    /// A copied integer.
    Int(c_int),
    /// A copied float.
    Float(f32),
    /// A copied string.
    Text(ParamData),
    /// The address of values of the parameter's type.
    Any(*const c_void),
    Ints(*const c_int),
    Floats(*const f32),
    Strings(*const *const c_char),
}

impl Source {
    /// Reads a `gelato_value_kind` and its data. Single values are copied.
    ///
    /// # Safety
    /// `data` is NULL or points to values of that kind.
    pub(super) unsafe fn new(kind: c_int, data: *const c_void) -> Self {
        if data.is_null() {
            return Self::Any(data);
        }
        match kind {
            // SAFETY: it is one int, by the contract.
            1 => Self::Int(unsafe { *data.cast::<c_int>() }),
            // SAFETY: it is one float.
            2 => Self::Float(unsafe { *data.cast::<f32>() }),
            // SAFETY: it is one double.
            3 => Self::Float(unsafe { *data.cast::<f64>() } as f32),
            // SAFETY: it is a string.
            4 => Self::Text((&*unsafe { CStr::from_ptr(data.cast()) }.to_string_lossy()).into()),
            5 => Self::Ints(data.cast()),
            6 => Self::Floats(data.cast()),
            7 => Self::Strings(data.cast()),
            _ => Self::Any(data),
        }
    }

    /// Returns `items` values of type `ty`.
    ///
    /// # Errors
    /// Returns a description of the mismatch, to append to the name of the parameter.
    pub(super) fn read(&self, ty: ParamType, items: usize) -> Result<ParamData, String> {
        match self {
            Self::Int(value) => return Ok((*value).into()),
            Self::Float(value) => return Ok((*value).into()),
            Self::Text(data) => return Ok(data.clone()),
            _ => {}
        }
        if ty.base == BaseType::Unknown {
            return Err("needs a type, as in \"float x\"".to_owned());
        }
        let n = items
            .checked_mul(ty.width())
            .filter(|n| *n <= isize::MAX as usize / 16)
            .ok_or_else(|| format!("has {items} items, which is too many"))?;
        if n == 0 {
            return match items {
                0 => Err(format!("is \"{}\", which the primitive does not take", ty.interp.word())),
                _ => Err("is an array without a length".to_owned()),
            };
        }
        let is_text = ty.base == BaseType::String;
        let is_int = ty.base == BaseType::Int;
        let (ints, floats, texts): (*const c_int, *const f32, *const *const c_char) = match *self {
            Self::Any(data) if data.is_null() => return Err("has no data (NULL)".to_owned()),
            Self::Any(data) if is_text => (std::ptr::null(), std::ptr::null(), data.cast()),
            Self::Any(data) if is_int => (data.cast(), std::ptr::null(), std::ptr::null()),
            Self::Any(data) => (std::ptr::null(), data.cast(), std::ptr::null()),
            Self::Ints(data) if !is_text => (data, std::ptr::null(), std::ptr::null()),
            Self::Floats(data) if !is_text => (std::ptr::null(), data, std::ptr::null()),
            Self::Strings(data) if is_text => (std::ptr::null(), std::ptr::null(), data),
            _ => return Err(format!("is a {}, and the data is not", ty.base.word())),
        };
        // SAFETY: by the interface, the data of a parameter has as many values as its type and its call require, and
        // does not change until that call.
        unsafe {
            if !ints.is_null() {
                return Ok(std::slice::from_raw_parts(ints, n).into());
            }
            if !floats.is_null() {
                return Ok(std::slice::from_raw_parts(floats, n).into());
            }
            let list: Option<Arc<[Arc<str>]>> = std::slice::from_raw_parts(texts, n)
                .iter()
                .map(|text| crate::ffi::text(*text).map(|text| Arc::from(&*text)))
                .collect();
            list.map(ParamData::String).ok_or_else(|| "has a string that is NULL".to_owned())
        }
    }
}

/// Returns the type of an attribute or of a parameter of cameras and outputs, by name.
pub(super) fn known_type(name: &str) -> Option<ParamType> {
    granita_scene::attribute_row(name).map(|row| row.ty)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_wrong_types_are_refused_with_a_reason() {
        let float = ParamType::of(BaseType::Float);
        let floats = [1.0f32, 2.0];
        let source = Source::Floats(floats.as_ptr());
        assert_eq!(source.read(float, 2).unwrap(), ParamData::from(&floats[..]));
        assert!(source.read(ParamType::of(BaseType::String), 1).unwrap_err().contains("string"));
        assert!(source.read(float, 0).unwrap_err().contains("does not take"));
        assert!(source.read(float, usize::MAX).unwrap_err().contains("too many"));
        assert!(source.read(ParamType::default(), 1).unwrap_err().contains("needs a type"));
        // SAFETY: the contract permits NULL.
        let null = unsafe { Source::new(6, std::ptr::null()) };
        assert!(null.read(float, 1).unwrap_err().contains("NULL"));
    }
}
