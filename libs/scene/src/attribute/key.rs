//! Keys: attributes as constants with a type and a scope.
//!
//! ```
//! # fn f(object: &granita_scene::AttributeSet) -> f32 {
//! object.get(granita_scene::attr::SHADINGQUALITY)
//! # }
//! ```
//!
//! A wrong name, a wrong type and an attribute of another scope do not compile:
//!
//! ```compile_fail
//! # fn f(object: &granita_scene::AttributeSet) -> f32 {
//! object.get(granita_scene::attr::FOV) // belongs to cameras
//! # }
//! ```
//!
//! ```compile_fail
//! # fn f(object: &granita_scene::AttributeSet) -> i32 {
//! object.get(granita_scene::attr::SHADINGQUALITY) // an f32
//! # }
//! ```

use super::{AttributeRow, DefaultValue, known};
use crate::SceneSink;
use granita_base::{BaseType, Color, Param, ParamData, ParamType};
use std::marker::PhantomData;
use std::sync::Arc;

/// The scopes of attributes as types; see [`Scope`](super::Scope).
pub mod scope {
    /// A camera.
    #[derive(Clone, Copy, Debug)]
    pub struct Camera;
    /// An image.
    #[derive(Clone, Copy, Debug)]
    pub struct Output;
    /// The whole scene.
    #[derive(Clone, Copy, Debug)]
    pub struct Global;
    /// Each object.
    #[derive(Clone, Copy, Debug)]
    pub struct Object;
    /// Writers of scene files.
    #[derive(Clone, Copy, Debug)]
    pub struct Writer;
    /// Read-only values.
    #[derive(Clone, Copy, Debug)]
    pub struct ReadOnly;
}

/// A type of attribute values in programs.
pub trait AttributeValue: Sized + Default {
    /// The type in the scene interface.
    const TYPE: ParamType;
    /// True when the type can represent that the attribute, which has no default, is not set.
    const IS_OPTIONAL: bool = false;

    /// Returns the value of this type; `None` for data of another type or length.
    fn read(data: &ParamData) -> Option<Self>;

    /// Returns the value as data.
    fn write(self) -> ParamData;
}

impl AttributeValue for f32 {
    const TYPE: ParamType = ParamType::of(BaseType::Float);

    fn read(data: &ParamData) -> Option<Self> {
        data.to_floats()?.first().copied()
    }

    fn write(self) -> ParamData {
        ParamData::from(self)
    }
}

impl AttributeValue for i32 {
    const TYPE: ParamType = ParamType::of(BaseType::Int);

    fn read(data: &ParamData) -> Option<Self> {
        data.to_ints()?.first().copied()
    }

    fn write(self) -> ParamData {
        ParamData::from(self)
    }
}

/// An integer, where 0 is false and every other value is true.
impl AttributeValue for bool {
    const TYPE: ParamType = ParamType::of(BaseType::Int);

    fn read(data: &ParamData) -> Option<Self> {
        i32::read(data).map(|v| v != 0)
    }

    fn write(self) -> ParamData {
        i32::from(self).write()
    }
}

impl AttributeValue for Arc<str> {
    const TYPE: ParamType = ParamType::of(BaseType::String);

    fn read(data: &ParamData) -> Option<Self> {
        match data {
            ParamData::String(words) => words.first().cloned(),
            _ => None,
        }
    }

    fn write(self) -> ParamData {
        ParamData::from(&*self)
    }
}

/// A list that grows with every call.
impl AttributeValue for Arc<[Arc<str>]> {
    const TYPE: ParamType = ParamType::of(BaseType::String);

    fn read(data: &ParamData) -> Option<Self> {
        match data {
            ParamData::String(words) => Some(words.clone()),
            _ => None,
        }
    }

    fn write(self) -> ParamData {
        ParamData::String(self)
    }
}

impl<T: AttributeValue> AttributeValue for Option<T> {
    const TYPE: ParamType = T::TYPE;
    const IS_OPTIONAL: bool = true;

    fn read(data: &ParamData) -> Option<Self> {
        T::read(data).map(Some)
    }

    fn write(self) -> ParamData {
        self.unwrap_or_default().write()
    }
}

impl AttributeValue for Color {
    const TYPE: ParamType = ParamType::of(BaseType::Color);

    fn read(data: &ParamData) -> Option<Self> {
        let values = data.to_floats()?;
        values.first_chunk().map(|rgb| Self::from_array(*rgb))
    }

    fn write(self) -> ParamData {
        ParamData::from(&self.to_array()[..])
    }
}

/// Arrays of numbers.
macro_rules! arrays {
    ($($value:ty: $ty:expr, $to:ident;)*) => {$(
        impl AttributeValue for $value {
            const TYPE: ParamType = $ty;

            fn read(data: &ParamData) -> Option<Self> {
                data.$to()?.get(..Self::default().len())?.try_into().ok()
            }

            fn write(self) -> ParamData {
                ParamData::from(&self[..])
            }
        }
    )*};
}

arrays! {
    [f32; 2]: ParamType::array(BaseType::Float, 2), to_floats;
    [f32; 4]: ParamType::array(BaseType::Float, 4), to_floats;
    [f32; 16]: ParamType::of(BaseType::Matrix), to_floats;
    [i32; 2]: ParamType::array(BaseType::Int, 2), to_ints;
    [i32; 4]: ParamType::array(BaseType::Int, 4), to_ints;
}

/// An attribute of a [`scope`] with values of one type. All keys are in [`attr`](super::attr).
#[derive(Debug)]
pub struct Key<S, T> {
    row: &'static AttributeRow,
    marker: PhantomData<fn() -> (S, T)>,
}

impl<S, T> Clone for Key<S, T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<S, T> Copy for Key<S, T> {}

impl<S, T> Key<S, T> {
    /// Returns the row of the table.
    pub const fn row(self) -> &'static AttributeRow {
        self.row
    }

    /// True when a name is that of the attribute, or an alternative spelling of it.
    pub fn is_named(self, name: &str) -> bool {
        known(name).is_some_and(|known| known.row.name == self.row.name)
    }

    /// Returns the name of the attribute.
    pub const fn name(self) -> &'static str {
        self.row.name
    }
}

impl<S, T: AttributeValue> Key<S, T> {
    /// Returns the key of a row.
    pub(super) const fn new(row: &'static AttributeRow) -> Self {
        assert!(
            T::IS_OPTIONAL == matches!(row.default, DefaultValue::Unset),
            "what has no default is an Option, and nothing else is one"
        );
        Self { row, marker: PhantomData }
    }

    /// Returns the value when the attribute is not set; `None` where the table has no default.
    pub fn default(self) -> T {
        let default = || T::read(&known(self.row.name)?.default.as_ref()?.data);
        default().unwrap_or_default()
    }

    /// Returns the value that was set, or the default.
    pub(crate) fn of(self, set: Option<&Param>) -> T {
        set.and_then(|param| T::read(&param.data)).unwrap_or_else(|| self.default())
    }

    /// Returns the value that a parameter gives to this attribute; `None` for parameters of another name or type.
    pub fn given(self, param: &Param) -> Option<T> {
        self.is_named(&param.name).then(|| T::read(&param.data)).flatten()
    }

    /// Returns the value in the current state of a scene under construction, or the default.
    pub fn ask(self, sink: &dyn SceneSink) -> T {
        self.of(sink.attribute(&self.row.declaration()).as_ref())
    }

    /// Returns a parameter that sets the attribute.
    pub fn param(self, value: T) -> Param {
        let name = known(self.row.name).map_or_else(|| self.row.name.into(), |known| known.name.clone());
        Param { name, ty: self.row.ty, data: value.write() }
    }
}

#[cfg(test)]
mod tests {
    use super::super::attr;
    use super::*;

    #[test]
    fn typed_keys_return_the_set_value_or_the_default() {
        let key = attr::SHADINGQUALITY;
        assert_eq!((key.of(None), key.default()), (1.0, 1.0));
        assert_eq!(key.of(Some(&key.param(2.0))), 2.0);
        assert_eq!(attr::SCREEN.of(None), None);
        assert_eq!(attr::SCREEN.of(Some(&attr::SCREEN.param(Some([1.0; 4])))), Some([1.0; 4]));
        assert_eq!(attr::RESOLUTION.of(None), [640, 480]);
        assert!(attr::TWOSIDED.of(None) && !attr::TWOSIDED.of(Some(&attr::TWOSIDED.param(false))));
        assert_eq!(&*attr::PROJECTION.of(None), "perspective");
        let list: Arc<[Arc<str>]> = ["a.sdb".into(), "b.sdb".into()].into();
        let set = attr::SPATIALDB_READ.param(Some(list.clone()));
        assert_eq!(attr::SPATIALDB_READ.of(Some(&set)), Some(list));
        // Data of another type or length are ignored.
        let short = Param { data: ParamData::from(&[1.0, 2.0][..]), ..attr::CROP.param([0.0; 4]) };
        assert_eq!(attr::CROP.of(Some(&short)), attr::CROP.default());
    }
}
