//! Declarations of parameters, by `Declare`, by types inside of names, and by standard names.

use crate::request::Arg;
use granita_base::{BaseType, Interp, Param, ParamData, ParamType};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The classes of the RenderMan interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Class {
    Constant,
    Uniform,
    Varying,
    Vertex,
    FaceVarying,
}

impl Class {
    fn from_word(word: &str) -> Option<Self> {
        Some(match word {
            "constant" => Self::Constant,
            "uniform" => Self::Uniform,
            "varying" => Self::Varying,
            "vertex" => Self::Vertex,
            "facevarying" | "facevertex" => Self::FaceVarying,
            _ => return None,
        })
    }

    fn word(self) -> &'static str {
        match self {
            Self::Constant => "constant",
            Self::Uniform => "uniform",
            Self::Varying => "varying",
            Self::Vertex => "vertex",
            Self::FaceVarying => "facevarying",
        }
    }
}

/// The declaration of a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Declared {
    pub(crate) class: Class,
    pub(crate) base: BaseType,
    pub(crate) array: Option<u32>,
}

impl Declared {
    /// Returns the number of values of one item.
    pub(crate) fn width(self) -> usize {
        self.base.components().saturating_mul(self.array.unwrap_or(1) as usize)
    }

    /// Parses `class type[n]`. Without a class it is uniform.
    pub(crate) fn parse(text: &str) -> Option<Self> {
        let text = text.replace('[', " [").replace(']', "] ");
        let mut declared = Self { class: Class::Uniform, base: BaseType::Unknown, array: None };
        for word in text.split_whitespace() {
            if let Some(class) = Class::from_word(word) {
                declared.class = class;
            } else if let Some(length) = word.strip_prefix('[') {
                declared.array = Some(length.strip_suffix(']')?.trim().parse().ok().filter(|n| *n > 0)?);
            } else {
                declared.base = match word {
                    "integer" => BaseType::Int,
                    word => BaseType::from_word(word)?,
                };
            }
        }
        (declared.base != BaseType::Unknown).then_some(declared)
    }

    /// Returns the type of values without a declaration; `None` for an empty array.
    pub(crate) fn of_values(value: &Arg) -> Option<Self> {
        let (base, n) = match value {
            Arg::String(_) | Arg::Strings(_) => (BaseType::String, value.strings()?.len()),
            _ => (BaseType::Float, value.floats()?.len()),
        };
        let array = (n > 1).then(|| u32::try_from(n)).transpose().ok()?;
        (n > 0).then_some(Self { class: Class::Constant, base, array })
    }

    fn text(self) -> String {
        let array = self.array.map_or(String::new(), |n| format!("[{n}]"));
        format!("{} {}{array}", self.class.word(), self.base.word())
    }
}

/// A parameter of a request, with its name, type and values.
#[derive(Clone, Debug)]
pub(crate) struct Given {
    pub(crate) name: Arc<str>,
    pub(crate) declared: Declared,
    pub(crate) data: ParamData,
}

impl Given {
    /// Returns the parameter as a constant of the scene interface, for shaders and attributes.
    pub(crate) fn constant(&self) -> Param {
        let ty = ParamType { base: self.declared.base, array: self.declared.array, interp: Interp::Constant };
        Param { name: self.name.clone(), ty, data: self.data.clone() }
    }

    /// Returns the numbers.
    pub(crate) fn floats(&self) -> Arc<[f32]> {
        self.data.to_floats().unwrap_or_default()
    }

    /// Returns the first number.
    pub(crate) fn float(&self) -> Option<f32> {
        self.floats().first().copied()
    }

    /// Returns the first string.
    pub(crate) fn string(&self) -> Option<&Arc<str>> {
        match &self.data {
            ParamData::String(v) => v.first(),
            _ => None,
        }
    }
}

/// The reason why a parameter is left out.
#[derive(Debug)]
pub(crate) enum Flaw {
    /// Neither its name nor a declaration gives its type.
    Undeclared(String),
    /// The values do not fit, or there are none.
    Mistake(String),
}

/// The current declarations.
#[derive(Clone, Debug, Default)]
pub(crate) struct Declarations(BTreeMap<String, Declared>);

/// Returns the declaration of a standard name.
fn standard(name: &str) -> Option<Declared> {
    use BaseType::{Color, Float, HPoint, Normal, Point, String};
    use Class::{Constant, Uniform, Varying, Vertex};
    let (class, base, array) = match name {
        "P" => (Vertex, Point, None),
        "Pz" => (Vertex, Float, None),
        "Pw" => (Vertex, HPoint, None),
        "N" => (Varying, Normal, None),
        "Np" => (Uniform, Normal, None),
        "Cs" | "Os" => (Varying, Color, None),
        "s" | "t" | "width" => (Varying, Float, None),
        "st" => (Varying, Float, Some(2)),
        "constantwidth" => (Constant, Float, None),
        "Ka" | "Kd" | "Ks" | "Kr" | "Km" | "roughness" | "intensity" | "coneangle" | "conedeltaangle"
        | "beamdistribution" | "mindistance" | "maxdistance" | "distance" | "amplitude" | "fov"
        | "falloff" | "shadowsamples" | "shadowblur" | "shadowbias" => (Uniform, Float, None),
        "specularcolor" | "lightcolor" | "background" => (Uniform, Color, None),
        "from" | "to" => (Uniform, Point, None),
        "texturename" | "shadowname" | "name" => (Uniform, String, None),
        // These are names of Option and Attribute.
        "sphere" | "endofframe" | "maxdepth" | "gridsize" | "texturememory" | "binary" | "hidden"
        | "bias" => (Uniform, Float, None),
        "bucketsize" => (Uniform, BaseType::Int, Some(2)),
        "coordinatesystem" | "shader" | "texture" | "archive" | "procedural" | "display" | "sense" => {
            (Uniform, String, None)
        }
        _ => return None,
    };
    Some(Declared { class, base, array })
}

impl Declarations {
    /// Adds a declaration, for `Declare`. Returns false when the type is invalid.
    pub(crate) fn declare(&mut self, name: &str, declaration: &str) -> bool {
        match Declared::parse(declaration) {
            Some(declared) => {
                self.0.insert(name.to_owned(), declared);
                true
            }
            None => false,
        }
    }

    /// Returns the declarations as requests, for a source that is read later.
    pub(crate) fn requests(&self) -> String {
        let quoted = |name: &str| name.replace('\\', "\\\\").replace('"', "\\\"");
        self.0.iter().map(|(name, d)| format!("Declare \"{}\" \"{}\" ", quoted(name), d.text())).collect()
    }

    /// Returns the type and the name of a token, which is declared in itself, declared before, or standard.
    pub(crate) fn find<'a>(&self, token: &'a str) -> Option<(Declared, &'a str)> {
        let token = token.trim();
        match token.rsplit_once(char::is_whitespace) {
            Some((declaration, name)) => Some((Declared::parse(declaration)?, name)),
            None => {
                let known = self.0.get(token).copied().or_else(|| standard(token));
                known.map(|declared| (declared, token))
            }
        }
    }

    /// Returns the parameter list of a request. Errors go to `flaw`, and their parameters are left out. `undeclared`
    /// returns the type of a parameter without a declaration from its name and its values.
    pub(crate) fn list(
        &self,
        args: &[Arg],
        flaw: &mut dyn FnMut(Flaw),
        undeclared: &dyn Fn(&str, &Arg) -> Option<Declared>,
    ) -> Vec<Given> {
        let mut list = Vec::new();
        let mut rest = args.iter();
        while let Some(token) = rest.next() {
            let Some(token) = token.strings().and_then(|s| s.first().cloned()) else {
                flaw(Flaw::Mistake(format!("{} where the name of a parameter belongs", token.kind())));
                continue;
            };
            let Some(value) = rest.next() else {
                flaw(Flaw::Mistake(format!("parameter \"{token}\" has no value")));
                break;
            };
            let found = self.find(&token);
            let Some((declared, name)) = found.or_else(|| Some((undeclared(&token, value)?, &*token))) else {
                flaw(Flaw::Undeclared(format!("parameter \"{token}\" is not declared: it is left out")));
                continue;
            };
            let data = match declared.base {
                BaseType::String => value.strings().map(ParamData::String),
                BaseType::Int => value.ints().map(ParamData::Int),
                _ => value.floats().map(ParamData::Float),
            };
            match data {
                Some(data) if !data.is_empty() && data.len().is_multiple_of(declared.width()) => {
                    list.push(Given { name: name.into(), declared, data });
                }
                Some(data) => flaw(Flaw::Mistake(format!(
                    "parameter \"{token}\" has {} values, not a multiple of {}",
                    data.len(),
                    declared.width()
                ))),
                None => flaw(Flaw::Mistake(format!(
                    "parameter \"{token}\" needs {}s, not {}",
                    declared.base.word(),
                    value.kind()
                ))),
            }
        }
        list
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn declarations_have_class_type_and_array_length() {
        let all = Declarations::default();
        let (d, name) = all.find("uniform float[3] weights").unwrap();
        assert_eq!((d.class, d.width(), name), (Class::Uniform, 3, "weights"));
        assert_eq!(all.find("facevarying float [2] uv").unwrap().0.array, Some(2));
        assert_eq!(all.find("color tint").unwrap().0.class, Class::Uniform);
        assert_eq!(all.find("integer n").unwrap().0.base, BaseType::Int);
        assert!(all.find("nobody").is_none() && all.find("strange thing").is_none());
        assert!(Declared::parse("float[0]").is_none() && Declared::parse("float[").is_none());
        let mut all = all;
        assert!(all.declare("tint", "varying color") && !all.declare("x", "nothing"));
        assert_eq!(all.find("tint").unwrap().0.class, Class::Varying);
        assert_eq!(all.requests(), "Declare \"tint\" \"varying color\" ");
    }

    #[test]
    fn parameter_lists_are_read_and_flaws_reported() {
        let all = Declarations::default();
        let s = |t: &str| Arg::String(t.into());
        let mut told = Vec::new();
        let args = [
            s("Kd"),
            Arg::Float(0.5),
            s("unknown"),
            Arg::Int(1),
            s("from"),
            Arg::Ints([1, 2].into()),
            s("texturename"),
            Arg::Int(3),
            Arg::Int(4),
            s("Ks"),
        ];
        let list = all.list(&args, &mut |flaw| told.push(flaw), &|_, _| None);
        assert_eq!(list.len(), 1);
        assert_eq!(list[0].constant().declaration(), "float Kd");
        assert_eq!(told.len(), 5, "{told:?}");
        assert_eq!(told.iter().filter(|f| matches!(f, Flaw::Undeclared(_))).count(), 1);
        let list =
            all.list(&args[2..4], &mut |flaw| panic!("{flaw:?}"), &|_, value| Declared::of_values(value));
        assert_eq!(list[0].constant().declaration(), "float unknown");
    }
}
