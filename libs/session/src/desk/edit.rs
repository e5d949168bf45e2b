//! The edits that viewers send, as JSON.
//!
//! An edit is an object with the word of its kind in "do", and further values by kind (see [`Edit`]). All edits may
//! have "visible", the rectangle `[x, y, width, height]` of the image that the user sees, and "number", an integer that
//! comes back in the panel when the image shows the edit.

use granita_image::PixelRect;
use serde_json::Value;

/// The largest number of bytes of a name, and of a pattern.
const NAME_BYTES: usize = 1024;

/// A message of a viewer.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Received {
    pub(crate) edit: Edit,
    /// The part of the image that the user sees, in pixels of the image.
    pub(crate) visible: Option<PixelRect>,
    /// The number that the viewer gave to the edit.
    pub(crate) number: Option<u64>,
}

/// What a user did.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Edit {
    /// Changes a light: "light" and the change.
    Light(String, Change),
    /// Adds a light: "shader" and, where the user chose one, "light".
    Add {
        /// The shader of the light.
        shader: String,
        /// The id that the user chose.
        id: Option<String>,
    },
    /// A drag begins: the edits until its end are one step for undo, and the images are coarse.
    Begin,
    /// A drag ends.
    End,
    Undo,
    Redo,
    /// Writes the patch: "file".
    Save(String),
    /// The user sees another part of the image.
    See,
    /// Ends the run.
    Quit,
}

/// A change of a light.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Change {
    /// "set": a parameter ("layer", "param", "value").
    Set(usize, String, Value),
    /// "reset": a parameter has the value of the scene again ("layer", "param").
    Reset(usize, String),
    /// "shader": another shader ("layer", "value").
    Shader(usize, String),
    /// "place": the light is at these pixels of the image, at its depth ("at").
    Place([f32; 2]),
    /// "distance": the depth of the light is multiplied by "value".
    Distance(f32),
    /// "position": in world space ("value").
    Position([f32; 3]),
    /// "direction": two angles in degrees ("value").
    Direction([f32; 2]),
    /// "aim": the light shines at what these pixels show ("at").
    Aim([f32; 2]),
    /// "on": "value".
    On(bool),
    /// "solo": "value".
    Solo(bool),
    /// "link": a rule for objects ("pattern", "value").
    Link(String, bool),
    /// "unlink": removes the rule of this index ("index").
    Unlink(usize),
    /// "delete".
    Delete,
    /// "copy": adds a light like this one.
    Copy,
    /// "restore": the light is that of the scene again.
    Restore,
}

impl Received {
    /// Parses a message.
    ///
    /// # Errors
    /// Returns a message when the text is not an edit.
    pub(crate) fn parse(text: &str) -> Result<Self, String> {
        let value: Value =
            serde_json::from_str(text).map_err(|error| format!("an edit is not JSON: {error}"))?;
        let edit = Edit::of(&value).ok_or_else(|| {
            let text: String = text.chars().take(200).collect();
            format!("not an edit: {text}")
        })?;
        Ok(Self { edit, visible: visible(&value["visible"]), number: value["number"].as_u64() })
    }
}

impl Edit {
    fn of(value: &Value) -> Option<Self> {
        let word = value["do"].as_str()?;
        Some(match word {
            "add" => {
                let id = name(&value["light"]).filter(|id| !id.is_empty());
                Self::Add { shader: name(&value["shader"])?, id }
            }
            "begin" => Self::Begin,
            "end" => Self::End,
            "undo" => Self::Undo,
            "redo" => Self::Redo,
            "save" => Self::Save(name(&value["file"]).unwrap_or_default()),
            "see" => Self::See,
            "quit" => Self::Quit,
            _ => Self::Light(name(&value["light"])?, Change::of(word, value)?),
        })
    }
}

impl Change {
    fn of(word: &str, value: &Value) -> Option<Self> {
        let index = |word: &str| value[word].as_u64().unwrap_or(0) as usize;
        let flag = || value["value"].as_bool();
        Some(match word {
            "set" => Self::Set(index("layer"), name(&value["param"])?, value["value"].clone()),
            "reset" => Self::Reset(index("layer"), name(&value["param"])?),
            "shader" => Self::Shader(index("layer"), name(&value["value"])?),
            "place" => Self::Place(numbers(&value["at"])?),
            "distance" => Self::Distance(numbers::<1>(&value["value"])?[0]).valid()?,
            "position" => Self::Position(numbers(&value["value"])?),
            "direction" => Self::Direction(numbers(&value["value"])?),
            "aim" => Self::Aim(numbers(&value["at"])?),
            "on" => Self::On(flag()?),
            "solo" => Self::Solo(flag()?),
            "link" => Self::Link(name(&value["pattern"])?, flag()?),
            "unlink" => Self::Unlink(index("index")),
            "delete" => Self::Delete,
            "copy" => Self::Copy,
            "restore" => Self::Restore,
            _ => return None,
        })
    }

    fn valid(self) -> Option<Self> {
        match self {
            Self::Distance(by) if !(1.0e-3..=1.0e3).contains(&by) => None,
            other => Some(other),
        }
    }

    /// Returns the name of the step for undo.
    pub(crate) fn label(&self) -> String {
        match self {
            Self::Set(_, param, _) | Self::Reset(_, param) => param.clone(),
            Self::Shader(..) => "shader".to_owned(),
            Self::Place(_) | Self::Position(_) | Self::Distance(_) => "position".to_owned(),
            Self::Direction(_) | Self::Aim(_) => "aim".to_owned(),
            Self::On(true) => "on".to_owned(),
            Self::On(false) => "off".to_owned(),
            Self::Solo(_) => "solo".to_owned(),
            Self::Link(..) | Self::Unlink(_) => "objects".to_owned(),
            Self::Delete => "delete".to_owned(),
            Self::Copy => "copy".to_owned(),
            Self::Restore => "as in the scene".to_owned(),
        }
    }
}

/// Reads a text of moderate length.
fn name(value: &Value) -> Option<String> {
    let text = value.as_str()?;
    (text.len() <= NAME_BYTES && !text.contains(['\0', '\n', '\r'])).then(|| text.to_owned())
}

/// Reads finite numbers: a list, or one number alone.
fn numbers<const N: usize>(value: &Value) -> Option<[f32; N]> {
    let number = |v: &Value| v.as_f64().map(|v| v as f32).filter(|v| v.is_finite());
    let list: Vec<f32> = match value {
        Value::Array(list) => list.iter().map(number).collect::<Option<_>>()?,
        one => vec![number(one)?],
    };
    list.try_into().ok()
}

/// Reads the part of the image that the user sees.
fn visible(value: &Value) -> Option<PixelRect> {
    let [x, y, width, height] = numbers::<4>(value)?;
    let side = |v: f32| v.clamp(0.0, 1.0e6) as u32;
    let rect = PixelRect::at(x.floor() as i32, y.floor() as i32, side(width.ceil()), side(height.ceil()));
    (!rect.is_empty()).then_some(rect)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edits_are_parsed_or_refused() {
        let light = |change| Edit::Light("key".to_owned(), change);
        for (text, edit) in [
            (
                r#"{"do":"set","light":"key","layer":1,"param":"intensity","value":2.5}"#,
                light(Change::Set(1, "intensity".to_owned(), Value::from(2.5))),
            ),
            (r#"{"do":"place","light":"key","at":[3,-4.5]}"#, light(Change::Place([3.0, -4.5]))),
            (
                r#"{"do":"link","light":"key","pattern":"^a","value":false}"#,
                light(Change::Link("^a".to_owned(), false)),
            ),
            (r#"{"do":"undo"}"#, Edit::Undo),
            (
                r#"{"do":"add","shader":"spotlight","light":""}"#,
                Edit::Add { shader: "spotlight".to_owned(), id: None },
            ),
        ] {
            assert_eq!(Received::parse(text), Ok(Received { edit, visible: None, number: None }), "{text}");
        }
        let seen = Received::parse(r#"{"do":"see","visible":[10.5,20,30,40],"number":7}"#).unwrap();
        let visible = Some(PixelRect::at(10, 20, 30, 40));
        assert_eq!(seen, Received { edit: Edit::See, visible, number: Some(7) });
        for bad in [
            "",
            "[]",
            "{}",
            "3",
            r#"{"do":"dance","light":"key"}"#,
            r#"{"do":"on","value":true}"#,
            r#"{"do":"on","light":"key","value":1}"#,
            r#"{"do":"place","light":"key","at":[1]}"#,
            r#"{"do":"place","light":"key","at":[1,1e300]}"#,
            r#"{"do":"distance","light":"key","value":-1}"#,
            r#"{"do":"set","light":"a\u0000b","param":"x","value":1}"#,
        ] {
            assert!(Received::parse(bad).is_err(), "{bad}");
        }
        let long = format!(r#"{{"do":"delete","light":"{}"}}"#, "x".repeat(2000));
        assert!(Received::parse(&long).is_err());
        for seen in ["[0,0,0,5]", "[0,0,1e300,5]", "\"x\"", "[1,2,3]"] {
            let text = format!(r#"{{"do":"see","visible":{seen}}}"#);
            assert_eq!(Received::parse(&text).unwrap().visible, None, "{seen}");
        }
        for number in ["-1", "1.5", "\"1\"", "null"] {
            let text = format!(r#"{{"do":"undo","number":{number}}}"#);
            assert_eq!(Received::parse(&text).unwrap().number, None, "{number}");
        }
    }
}
