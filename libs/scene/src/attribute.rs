//! The attribute table, with one row for each attribute of reference chapter 4. It is the only source of defaults,
//! types and scopes. Programs access attributes by the keys of [`attr`], never by their names.

mod key;
mod table;

pub use key::{AttributeValue, Key, scope};
pub use table::TABLE;

/// The keys of all attributes.
pub mod attr {
    pub use super::table::*;
}

use granita_base::{Param, ParamData, ParamType};
use rustc_hash::FxHashMap;
use std::sync::{Arc, LazyLock};

/// The kind of object that an attribute belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Scope {
    /// A camera (4.1). The attribute is a parameter of `Camera`, or set by `Attribute` before the next one.
    Camera,
    /// An image (4.2). The attribute is a parameter of `Output`.
    Output,
    /// The whole scene (4.3). The attribute is set by `Attribute` before `World`.
    Global,
    /// Each object (4.4). The attribute is set by `Attribute` at any time, and saved and restored with the state.
    Object,
    /// Writers of scene files (4.3.12). A renderer ignores the attribute. It is set by `Attribute` at any time.
    Writer,
    /// Read-only values, which can be queried but not set (4.3.10, 4.4.1).
    ReadOnly,
}

/// The default value of an attribute.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DefaultValue {
    /// There is no default. The attribute is absent until it is set.
    Unset,
    /// Floats, also of colours.
    Floats(&'static [f32]),
    /// Integers.
    Ints(&'static [i32]),
    /// A string.
    Text(&'static str),
    /// The first of these strings. No others are accepted.
    OneOf(&'static [&'static str]),
}

/// The effect of setting an attribute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// The effect that the reference describes.
    Full,
    /// There is no effect. The attribute tunes how the work is done, and this renderer needs no tuning there.
    Hint,
}

/// A mark at the end of a row of the table.
#[derive(Clone, Copy)]
enum Mark {
    /// The effect is [`Effect::Hint`].
    Hint,
    /// The attribute may change in a re-render.
    Rerender,
}

/// An attribute of the table.
#[derive(Clone, Copy, Debug)]
pub struct AttributeRow {
    /// The name, without a declaration.
    pub name: &'static str,
    /// The type. Values of any numeric type are converted to it.
    pub ty: ParamType,
    /// The value when it is not set.
    pub default: DefaultValue,
    /// The kind of object that it belongs to.
    pub scope: Scope,
    /// The section of the reference.
    pub section: &'static str,
    /// A description in one line.
    pub help: &'static str,
    /// The effect of setting it.
    pub effect: Effect,
    /// True when it may change between the frames of re-rendering mode (reference 11.1). An attribute of objects
    /// changes by `Modify`.
    pub rerender: bool,
}

impl AttributeRow {
    /// Returns the row with marks.
    const fn marked(mut self, marks: &[Mark]) -> Self {
        let mut i = 0;
        while i < marks.len() {
            match marks[i] {
                Mark::Hint => self.effect = Effect::Hint,
                Mark::Rerender => self.rerender = true,
            }
            i += 1;
        }
        self
    }

    /// Returns the default as a parameter; `None` when there is none.
    pub fn default_param(&self) -> Option<Param> {
        let data = match self.default {
            DefaultValue::Unset => return None,
            DefaultValue::Floats(v) => ParamData::from(v),
            DefaultValue::Ints(v) => ParamData::from(v),
            DefaultValue::Text(v) => ParamData::from(v),
            DefaultValue::OneOf(words) => ParamData::from(*words.first()?),
        };
        Some(Param { name: self.name.into(), ty: self.ty, data })
    }

    /// Returns the strings that it accepts; empty for any.
    pub fn words(&self) -> &'static [&'static str] {
        match self.default {
            DefaultValue::OneOf(words) => words,
            _ => &[],
        }
    }

    /// True when its value is a list of strings that grows with every call.
    pub fn is_list(&self) -> bool {
        self.name.starts_with("spatialdb:")
    }

    /// Returns the declaration, such as `"int[2] resolution"`.
    pub fn declaration(&self) -> String {
        format!("{} {}", self.ty, self.name)
    }
}

/// Alternative spellings in use, and the row of each.
const ALIASES: &[(&str, &str)] = &[
    ("ray:opaquesadows", "ray:opaqueshadows"),
    ("texture:subtexture", "texture:substtexture"),
    ("format:binary", "pyg:binary"),
    ("renderer", "renderer:name"),
    ("version", "renderer:version"),
    ("versionstring", "renderer:versionstring"),
];

/// A row with its name and default in shared form.
#[derive(Clone, Debug)]
pub(crate) struct Known {
    /// The row of the table.
    pub(crate) row: &'static AttributeRow,
    /// The name.
    pub(crate) name: Arc<str>,
    /// The default, if it has one.
    pub(crate) default: Option<Param>,
}

static INDEX: LazyLock<FxHashMap<&'static str, Known>> = LazyLock::new(|| {
    let known = |row: &'static AttributeRow| {
        let default = row.default_param();
        let name = default.as_ref().map_or_else(|| row.name.into(), |d| d.name.clone());
        (row.name, Known { row, name, default })
    };
    let mut rows: FxHashMap<_, _> = TABLE.iter().map(known).collect();
    for (other, name) in ALIASES {
        if let Some(found) = rows.get(name).cloned() {
            rows.insert(*other, found);
        }
    }
    rows
});

/// Returns the data of an attribute, also for an alternative spelling.
pub(crate) fn known(name: &str) -> Option<&'static Known> {
    INDEX.get(name)
}

/// Returns the row of an attribute, also for an alternative spelling.
pub fn attribute_row(name: &str) -> Option<&'static AttributeRow> {
    known(name).map(|known| known.row)
}

/// Returns the default of an attribute as a parameter; `None` for an unknown name or one without a default.
pub fn attribute_default(name: &str) -> Option<Param> {
    known(name)?.default.clone()
}

/// Returns the value of `name` that was set, or its default from the table.
pub(crate) fn lookup(set: Option<&Param>, name: &str) -> Option<Param> {
    set.cloned().or_else(|| attribute_default(name))
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::BaseType;

    #[test]
    fn rows_of_the_attribute_table_are_consistent() {
        let mut seen = std::collections::BTreeSet::new();
        for row in TABLE {
            assert!(seen.insert(row.name), "{} twice", row.name);
            assert!(!row.help.is_empty() && !row.help.ends_with('.'), "{}", row.name);
            if let Some(p) = row.default_param() {
                assert_eq!(p.data.len(), row.ty.width(), "{}", row.name);
                let string = matches!(p.data, ParamData::String(_));
                assert_eq!(string, row.ty.base == BaseType::String, "{}", row.name);
                let int = matches!(p.data, ParamData::Int(_));
                assert_eq!(int, row.ty.base == BaseType::Int, "{}", row.name);
            }
        }
        for (other, name) in ALIASES {
            assert_eq!(attribute_row(other).unwrap().name, *name);
        }
    }

    #[test]
    fn lookups_return_the_set_value_or_the_default() {
        let mut set = std::collections::BTreeMap::new();
        assert_eq!(lookup(set.get("shadingquality"), "shadingquality").unwrap().data, ParamData::from(1.0));
        set.insert(Arc::from("shadingquality"), Param::declared("float shadingquality", 2.0).unwrap());
        assert_eq!(lookup(set.get("shadingquality"), "shadingquality").unwrap().data, ParamData::from(2.0));
        assert!(lookup(set.get("screen"), "screen").is_none());
        assert!(lookup(set.get("no such thing"), "no such thing").is_none());
    }
}
