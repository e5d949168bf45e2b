//! Metadata.

use crate::image::Image;
use crate::{EditError, Result};
use granita_base::{BaseType, Param, ParamData, ParamType};
use regex::RegexBuilder;
use std::sync::Arc;

/// The name of the caption.
const CAPTION: &str = "ImageDescription";
/// The name of the keywords, which are separated by semicolons.
const KEYWORDS: &str = "Keywords";

/// Returns metadata of a text. Without a type a whole number is an int, another number a float, and anything else a
/// string. Types are those of the suite (`int`, `float`, `string`, `color`, `point`, `vector`, `normal`, `matrix`),
/// also as arrays (`float[4]`), with values that are separated by commas.
///
/// # Errors
/// [`EditError::Misuse`] for an unknown type, and for a text with other values or another number of them.
pub fn attribute(name: &str, text: &str, kind: Option<&str>) -> Result<Param> {
    let Some(kind) = kind else {
        let number = text.trim();
        let (base, data): (BaseType, ParamData) = if let Ok(int) = number.parse::<i32>() {
            (BaseType::Int, int.into())
        } else if let Some(float) = number.parse::<f32>().ok().filter(|v| v.is_finite()) {
            (BaseType::Float, float.into())
        } else {
            (BaseType::String, text.into())
        };
        return Ok(Param { name: name.into(), ty: ParamType::of(base), data });
    };
    let wrong = |what: String| EditError::misuse(format!("the attribute {name}: {what}"));
    // Any name makes a declaration of the type.
    let (ty, _) = ParamType::parse(&format!("{kind} x")).map_err(|e| wrong(e.to_string()))?;
    let data: ParamData = match ty.base {
        BaseType::Unknown => return Err(wrong("a type is needed".to_owned())),
        BaseType::String if ty.array.is_none() => text.into(),
        BaseType::String => ParamData::String(text.split(',').map(Arc::from).collect()),
        BaseType::Int => {
            let list: std::result::Result<Vec<i32>, _> = text.split(',').map(|w| w.trim().parse()).collect();
            list.map_err(|_| wrong(format!("\"{text}\" does not hold whole numbers")))?.as_slice().into()
        }
        _ => crate::geometry::numbers(text).map_err(|e| wrong(e.to_string()))?.as_slice().into(),
    };
    if data.len() != ty.width() {
        return Err(wrong(format!("{} values, {} are needed", data.len(), ty.width())));
    }
    Ok(Param { name: name.into(), ty, data })
}

impl Image {
    /// Returns the image with metadata, which replaces that of the same name.
    #[must_use]
    pub fn with_attribute(&self, param: Param) -> Self {
        let mut image = self.clone();
        image.spec.attributes.set(param);
        image
    }

    /// Returns the image with metadata that is a text.
    pub(crate) fn with_text(&self, name: &str, text: &str) -> Self {
        let ty = ParamType::of(BaseType::String);
        self.with_attribute(Param { name: name.into(), ty, data: text.into() })
    }

    /// Returns the image without the metadata whose whole names match a regular expression, in any case of letters.
    ///
    /// # Errors
    /// [`EditError::Misuse`] for an invalid expression.
    pub fn without_attributes(&self, expression: &str) -> Result<Self> {
        let regex = RegexBuilder::new(&format!("^(?:{expression})$")).case_insensitive(true).build();
        let regex = regex
            .map_err(|e| EditError::misuse(format!("\"{expression}\" is not a regular expression: {e}")))?;
        let mut image = self.clone();
        image.spec.attributes.0.retain(|param: &Param| !regex.is_match(&param.name));
        Ok(image)
    }

    /// Returns the image with a caption, the metadata `ImageDescription`.
    #[must_use]
    pub fn with_caption(&self, text: &str) -> Self {
        self.with_text(CAPTION, text)
    }

    /// Returns the image with one more keyword in the metadata `Keywords`.
    #[must_use]
    pub fn with_keyword(&self, word: &str) -> Self {
        let old = self.spec.attributes.string(KEYWORDS).map(|s| s.to_string()).unwrap_or_default();
        let mut words: Vec<&str> = old.split(';').map(str::trim).filter(|w| !w.is_empty()).collect();
        if !words.contains(&word) {
            words.push(word);
        }
        self.with_text(KEYWORDS, &words.join("; "))
    }

    /// Returns the image without keywords.
    #[must_use]
    pub fn without_keywords(&self) -> Self {
        let mut image = self.clone();
        image.spec.attributes.0.retain(|param: &Param| &*param.name != KEYWORDS);
        image
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Pattern, Window, pattern};

    fn image() -> Image {
        pattern(Pattern::Constant(vec![0.5]), &Window { x: 0, y: 0, width: 2, height: 2 }, 1).unwrap()
    }

    #[test]
    fn types_follow_from_the_text_or_are_given() {
        let data = |text: &str, kind: Option<&str>| attribute("a", text, kind).map(|p| p.data);
        assert_eq!(data("12", None).unwrap(), 12.into());
        assert_eq!(data("1.5", None).unwrap(), 1.5.into());
        assert_eq!(data("a b", None).unwrap(), "a b".into());
        assert_eq!(data("12", Some("string")).unwrap(), "12".into());
        assert_eq!(data("1, 2,3", Some("color")).unwrap(), [1.0, 2.0, 3.0].as_slice().into());
        assert_eq!(data("1,2", Some("int[2]")).unwrap(), [1, 2].as_slice().into());
        for (text, kind) in [("1,2", "color"), ("x", "int"), ("1", "colour"), ("1,2", "int[3]"), ("a", "")] {
            assert!(data(text, Some(kind)).is_err(), "{text} {kind}");
        }
    }

    #[test]
    fn metadata_is_set_and_erased() {
        let image = image().with_caption("c").with_keyword("one").with_keyword("two").with_keyword("one");
        assert_eq!(image.spec.string("Keywords"), Some("one; two"));
        let image = image.with_attribute(attribute("camera:lens", "50", None).unwrap());
        let image = image.without_attributes("CAMERA:.*").unwrap();
        assert!(image.spec.attributes.get("camera:lens").is_none());
        assert_eq!(image.spec.string("ImageDescription"), Some("c"));
        assert!(image.without_keywords().spec.attributes.get("Keywords").is_none());
        assert_eq!(image.without_attributes("image").unwrap().spec.attributes, image.spec.attributes);
        assert!(image.without_attributes("(").unwrap_err().to_string().contains("regular expression"));
    }
}
