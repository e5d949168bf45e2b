//! Typed, named values, used by `Attribute`, `Parameter`, shader arguments and metadata.
//!
//! A declaration is written `[interpolation] type[\[n\]] name`, such as `"vertex point P"` or `"float[4] crop"`. A
//! name without a type has the type [`BaseType::Unknown`]. The receiver then looks the name up in its table
//! (reference 2.1.5).

use std::fmt;
use std::sync::Arc;

/// The base type of a value (reference 2.1.5).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum BaseType {
    /// A type that is not declared. It follows from the data, or from the receiver's table.
    #[default]
    Unknown,
    /// One float.
    Float,
    /// One 32-bit integer.
    Int,
    /// One string.
    String,
    /// Three floats, a colour.
    Color,
    /// Three floats, a position.
    Point,
    /// Three floats, a direction.
    Vector,
    /// Three floats, a surface normal.
    Normal,
    /// Four floats, a homogeneous position.
    HPoint,
    /// Sixteen floats, row by row.
    Matrix,
}

impl BaseType {
    /// The number of numbers (or strings) of one value; 1 for [`BaseType::Unknown`].
    pub fn components(self) -> usize {
        match self {
            Self::Unknown | Self::Float | Self::Int | Self::String => 1,
            Self::Color | Self::Point | Self::Vector | Self::Normal => 3,
            Self::HPoint => 4,
            Self::Matrix => 16,
        }
    }

    /// Returns the word that declares the type.
    pub fn word(self) -> &'static str {
        match self {
            Self::Unknown => "",
            Self::Float => "float",
            Self::Int => "int",
            Self::String => "string",
            Self::Color => "color",
            Self::Point => "point",
            Self::Vector => "vector",
            Self::Normal => "normal",
            Self::HPoint => "hpoint",
            Self::Matrix => "matrix",
        }
    }

    /// Returns the type declared by `word`.
    pub fn from_word(word: &str) -> Option<Self> {
        Some(match word {
            "float" => Self::Float,
            "int" => Self::Int,
            "string" => Self::String,
            "color" => Self::Color,
            "point" => Self::Point,
            "vector" => Self::Vector,
            "normal" => Self::Normal,
            "hpoint" => Self::HPoint,
            "matrix" => Self::Matrix,
            _ => return None,
        })
    }

    /// True when the values are three floats.
    pub fn is_triple(self) -> bool {
        self.components() == 3
    }
}

/// The interpolation of a primitive variable over a primitive (reference 2.1.6).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum Interp {
    /// One value for the whole primitive.
    #[default]
    Constant,
    /// One value per face or curve.
    PerPiece,
    /// One value per corner, interpolated (bi)linearly.
    Linear,
    /// One value per control vertex, interpolated as positions are.
    Vertex,
}

impl Interp {
    /// Returns the word that declares it; empty for [`Interp::Constant`].
    pub fn word(self) -> &'static str {
        match self {
            Self::Constant => "",
            Self::PerPiece => "perpiece",
            Self::Linear => "linear",
            Self::Vertex => "vertex",
        }
    }
}

/// A declared type.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub struct ParamType {
    /// The base type of one element.
    pub base: BaseType,
    /// The length of an array; `None` for a single value.
    pub array: Option<u32>,
    /// The interpolation over a primitive.
    pub interp: Interp,
}

impl ParamType {
    /// Returns the type of a single, constant value.
    pub const fn of(base: BaseType) -> Self {
        Self { base, array: None, interp: Interp::Constant }
    }

    /// Returns the type of a constant array.
    pub const fn array(base: BaseType, len: u32) -> Self {
        Self { base, array: Some(len), interp: Interp::Constant }
    }

    /// Returns the same type with another interpolation.
    pub const fn with_interp(self, interp: Interp) -> Self {
        Self { interp, ..self }
    }

    /// The number of numbers (or strings) per item: components times array length.
    pub fn width(&self) -> usize {
        self.base.components() * self.array.unwrap_or(1) as usize
    }

    /// Splits a declaration into type and name. A name alone has type [`BaseType::Unknown`].
    ///
    /// Blanks are allowed around brackets: `"float [4] crop"`.
    ///
    /// # Errors
    /// Returns an error when a word is not a type, or when a bracket or the name is invalid.
    pub fn parse(declaration: &str) -> Result<(Self, String), DeclarationError> {
        let fail = |what| DeclarationError { declaration: declaration.to_owned(), what };
        let (text, array) = match (declaration.find('['), declaration.find(']')) {
            (None, None) => (declaration.to_owned(), None),
            (Some(open), Some(close)) if open < close => {
                let len: u32 = declaration[open + 1..close]
                    .trim()
                    .parse()
                    .map_err(|_| fail("array length is not a number"))?;
                (format!("{} {}", &declaration[..open], &declaration[close + 1..]), Some(len))
            }
            _ => return Err(fail("unbalanced brackets")),
        };
        let mut words: Vec<&str> = text.split_whitespace().collect();
        let name = words.pop().ok_or_else(|| fail("no name"))?;
        // In "P[3]" alone the brackets belong to a name, not to a type.
        if words.is_empty() {
            if array.is_some() {
                return Err(fail("an array needs a type"));
            }
            return Ok((Self::default(), name.to_owned()));
        }
        let mut ty = Self { array, ..Self::default() };
        for word in words {
            match (word, BaseType::from_word(word)) {
                (_, Some(base)) if ty.base == BaseType::Unknown => ty.base = base,
                ("vertex", _) => ty.interp = Interp::Vertex,
                ("linear", _) => ty.interp = Interp::Linear,
                ("perpiece", _) => ty.interp = Interp::PerPiece,
                ("constant", _) => ty.interp = Interp::Constant,
                _ => return Err(fail("unknown type")),
            }
        }
        if array.is_some() && ty.base == BaseType::Unknown {
            return Err(fail("an array needs a type"));
        }
        Ok((ty, name.to_owned()))
    }
}

impl fmt::Display for ParamType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.interp != Interp::Constant {
            write!(f, "{} ", self.interp.word())?;
        }
        f.write_str(self.base.word())?;
        match self.array {
            Some(n) => write!(f, "[{n}]"),
            None => Ok(()),
        }
    }
}

/// A declaration that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cannot read declaration \"{declaration}\": {what}")]
pub struct DeclarationError {
    /// The declaration as given.
    pub declaration: String,
    /// A description of the error.
    pub what: &'static str,
}

/// The numbers or strings of a parameter in one list. It is cheap to clone.
#[derive(Clone, Debug, PartialEq)]
pub enum ParamData {
    /// Floats (also of colours, points, matrices ...), in order.
    Float(Arc<[f32]>),
    /// Integers.
    Int(Arc<[i32]>),
    /// Strings.
    String(Arc<[Arc<str>]>),
}

impl ParamData {
    /// The number of numbers or strings.
    pub fn len(&self) -> usize {
        match self {
            Self::Float(v) => v.len(),
            Self::Int(v) => v.len(),
            Self::String(v) => v.len(),
        }
    }

    /// True when there are no values.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the numbers as floats, with integers converted; `None` for strings.
    pub fn to_floats(&self) -> Option<Arc<[f32]>> {
        match self {
            Self::Float(v) => Some(v.clone()),
            Self::Int(v) => Some(v.iter().map(|&i| i as f32).collect()),
            Self::String(_) => None,
        }
    }

    /// Returns the numbers as integers, with floats truncated; `None` for strings and for floats outside of 32 bits.
    pub fn to_ints(&self) -> Option<Arc<[i32]>> {
        match self {
            Self::Int(v) => Some(v.clone()),
            Self::Float(v) => {
                v.iter().map(|&f| (f.is_finite() && f.abs() < 2_147_483_648.0).then_some(f as i32)).collect()
            }
            Self::String(_) => None,
        }
    }
}

impl From<f32> for ParamData {
    fn from(v: f32) -> Self {
        Self::Float([v].into())
    }
}
impl From<i32> for ParamData {
    fn from(v: i32) -> Self {
        Self::Int([v].into())
    }
}
impl From<&str> for ParamData {
    fn from(v: &str) -> Self {
        Self::String([Arc::from(v)].into())
    }
}
impl From<&[f32]> for ParamData {
    fn from(v: &[f32]) -> Self {
        Self::Float(v.into())
    }
}
impl From<&[i32]> for ParamData {
    fn from(v: &[i32]) -> Self {
        Self::Int(v.into())
    }
}

/// One named, typed value.
#[derive(Clone, Debug, PartialEq)]
pub struct Param {
    /// The name without its declaration.
    pub name: Arc<str>,
    /// The declared type; [`BaseType::Unknown`] when only the name was given.
    pub ty: ParamType,
    /// The values.
    pub data: ParamData,
}

impl Param {
    /// Returns a parameter of a declaration (`"vertex point P"`) and its data.
    ///
    /// # Errors
    /// Returns the errors of [`ParamType::parse`].
    pub fn declared(declaration: &str, data: impl Into<ParamData>) -> Result<Self, DeclarationError> {
        let (ty, name) = ParamType::parse(declaration)?;
        Ok(Self { name: name.into(), ty, data: data.into() })
    }

    /// Returns the declaration as written in a scene file.
    pub fn declaration(&self) -> String {
        if self.ty.base == BaseType::Unknown {
            self.name.to_string()
        } else {
            format!("{} {}", self.ty, self.name)
        }
    }
}

/// A list of parameters, in the order given. Of two with one name the later is used.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Params(pub Vec<Param>);

impl Params {
    /// Returns an empty list.
    pub const fn new() -> Self {
        Self(Vec::new())
    }

    /// Appends a parameter, or replaces an earlier one of the same name in its place.
    pub fn set(&mut self, param: Param) {
        match self.0.iter_mut().find(|p| p.name == param.name) {
            Some(old) => *old = param,
            None => self.0.push(param),
        }
    }

    /// Returns the parameter of this name.
    pub fn get(&self, name: &str) -> Option<&Param> {
        self.0.iter().rev().find(|p| &*p.name == name)
    }

    /// Returns the floats of this name (integers converted); `None` when absent or not numbers.
    pub fn floats(&self, name: &str) -> Option<Arc<[f32]>> {
        self.get(name)?.data.to_floats()
    }

    /// Returns the first float of this name.
    pub fn float(&self, name: &str) -> Option<f32> {
        self.floats(name)?.first().copied()
    }

    /// Returns the first integer of this name (floats truncated).
    pub fn int(&self, name: &str) -> Option<i32> {
        self.get(name)?.data.to_ints()?.first().copied()
    }

    /// Returns the first string of this name.
    pub fn string(&self, name: &str) -> Option<&Arc<str>> {
        match &self.get(name)?.data {
            ParamData::String(v) => v.first(),
            _ => None,
        }
    }

    /// Returns the parameters in order.
    pub fn iter(&self) -> std::slice::Iter<'_, Param> {
        self.0.iter()
    }

    /// True when there are no parameters.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl Extend<Param> for Params {
    /// Sets each of the parameters.
    fn extend<I: IntoIterator<Item = Param>>(&mut self, params: I) {
        params.into_iter().for_each(|param| self.set(param));
    }
}

impl<'a> IntoIterator for &'a Params {
    type Item = &'a Param;
    type IntoIter = std::slice::Iter<'a, Param>;
    fn into_iter(self) -> Self::IntoIter {
        self.0.iter()
    }
}

impl FromIterator<Param> for Params {
    fn from_iter<T: IntoIterator<Item = Param>>(iter: T) -> Self {
        Self(iter.into_iter().collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn declarations_are_parsed_or_refused() {
        let (ty, name) = ParamType::parse("vertex point P").unwrap();
        assert_eq!((ty.base, ty.interp, name.as_str()), (BaseType::Point, Interp::Vertex, "P"));
        let (ty, name) = ParamType::parse("float[4] crop").unwrap();
        assert_eq!((ty, name.as_str()), (ParamType::array(BaseType::Float, 4), "crop"));
        assert_eq!(ParamType::parse("float [4] crop").unwrap().0.array, Some(4));
        let (ty, name) = ParamType::parse("fov").unwrap();
        assert_eq!((ty.base, name.as_str()), (BaseType::Unknown, "fov"));
        // A name may be the word of a type: "vector vector" declares a vector with that name.
        assert_eq!(ParamType::parse("vector vector").unwrap().1, "vector");
        for bad in ["", "  ", "float[x] a", "float] a", "quux a", "[3] a", "a[3]"] {
            assert!(ParamType::parse(bad).is_err(), "{bad:?}");
        }
    }

    #[test]
    fn a_normal_named_p_is_read() {
        // Some exporters write the invalid "vertex normal P". The receiver handles it.
        let (ty, name) = ParamType::parse("vertex normal P").unwrap();
        assert_eq!((ty.base, name.as_str()), (BaseType::Normal, "P"));
    }

    #[test]
    fn values_convert_between_numeric_types_only() {
        assert_eq!(ParamData::from(3).to_floats().unwrap()[0], 3.0);
        assert_eq!(ParamData::from(3.7).to_ints().unwrap()[0], 3);
        assert!(ParamData::from(f32::NAN).to_ints().is_none());
        assert!(ParamData::from("x").to_floats().is_none());
    }

    #[test]
    fn a_parameter_prints_its_declaration() {
        let p = Param::declared("linear color[2] Cs", &[0.0_f32; 6][..]).unwrap();
        assert_eq!(p.declaration(), "linear color[2] Cs");
    }
}
