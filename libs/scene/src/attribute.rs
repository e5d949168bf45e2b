//! The attribute table: one row per attribute of reference chapter 4. Defaults, types and scopes come from here and from
//! nowhere else; programs ask for attributes by the keys of [`attr`], never by their names.

mod key;
mod table;

pub use key::{AttributeValue, Key, scope};
pub use table::TABLE;

/// The key of every attribute.
pub mod attr {
    pub use super::table::*;
}

use granita_base::{Param, ParamData, ParamType};
use rustc_hash::FxHashMap;
use std::sync::{Arc, LazyLock};

/// What an attribute belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Scope {
    /// A camera (4.1): parameter of `Camera`, or `Attribute` before the next one.
    Camera,
    /// An image (4.2): parameter of `Output`.
    Output,
    /// The whole scene (4.3): `Attribute` before `World`.
    Global,
    /// Each object (4.4): `Attribute` at any time, saved and restored with the state.
    Object,
    /// Controls writers of scene files (4.3.12), ignored by a renderer; `Attribute` at any time.
    Writer,
    /// Can be asked for, not set (4.3.10, 4.4.1).
    ReadOnly,
}

/// Default value of an attribute.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DefaultValue {
    /// None: the attribute is absent until set.
    Unset,
    /// Floats, also of colours.
    Floats(&'static [f32]),
    /// Integers.
    Ints(&'static [i32]),
    /// A string.
    Text(&'static str),
    /// The first of these strings; no other is taken.
    OneOf(&'static [&'static str]),
}

/// What comes of setting an attribute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// What the reference says.
    Full,
    /// Nothing, and nothing is missing: it tunes how the work is done, and this renderer needs no tuning there.
    Hint,
}

/// One attribute.
#[derive(Clone, Copy, Debug)]
pub struct AttributeRow {
    /// Its name, without a declaration.
    pub name: &'static str,
    /// Its type; values of any numeric type are converted to it.
    pub ty: ParamType,
    /// Its value when nobody sets it.
    pub default: DefaultValue,
    /// What it belongs to.
    pub scope: Scope,
    /// Section of the reference.
    pub section: &'static str,
    /// What it does, in one line.
    pub help: &'static str,
    /// What comes of setting it.
    pub effect: Effect,
}

impl AttributeRow {
    /// The default as a parameter; `None` when there is none.
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

    /// The strings that it may take; empty for any.
    pub fn words(&self) -> &'static [&'static str] {
        match self.default {
            DefaultValue::OneOf(words) => words,
            _ => &[],
        }
    }

    /// Whether it takes a list of strings that grows with every call.
    pub fn is_list(&self) -> bool {
        self.name.starts_with("spatialdb:")
    }

    /// The declaration, as `"int[2] resolution"`.
    pub fn declaration(&self) -> String {
        format!("{} {}", self.ty, self.name)
    }
}

/// Other spellings in use, and the row that each means.
const ALIASES: &[(&str, &str)] = &[
    ("ray:opaquesadows", "ray:opaqueshadows"),
    ("texture:subtexture", "texture:substtexture"),
    ("format:binary", "pyg:binary"),
    ("renderer", "renderer:name"),
    ("version", "renderer:version"),
    ("versionstring", "renderer:versionstring"),
];

/// What is known of a row beside the table: its name and default, to be shared.
#[derive(Clone, Debug)]
pub(crate) struct Known {
    /// The row.
    pub(crate) row: &'static AttributeRow,
    /// Its name.
    pub(crate) name: Arc<str>,
    /// Its default, if it has one.
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

/// What is known of an attribute, also by another spelling that is in use.
pub(crate) fn known(name: &str) -> Option<&'static Known> {
    INDEX.get(name)
}

/// The row of an attribute, also by another spelling that is in use.
pub fn attribute_row(name: &str) -> Option<&'static AttributeRow> {
    known(name).map(|known| known.row)
}

/// The default of an attribute as a parameter; `None` for an unknown name or one without a default.
pub fn attribute_default(name: &str) -> Option<Param> {
    known(name)?.default.clone()
}

/// The value of `name` that was set, or its default from the table.
pub(crate) fn lookup(set: Option<&Param>, name: &str) -> Option<Param> {
    set.cloned().or_else(|| attribute_default(name))
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::BaseType;

    #[test]
    fn rows_are_consistent() {
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
    fn lookups_give_set_values_then_defaults() {
        let mut set = std::collections::BTreeMap::new();
        assert_eq!(lookup(set.get("shadingquality"), "shadingquality").unwrap().data, ParamData::from(1.0));
        set.insert(Arc::from("shadingquality"), Param::declared("float shadingquality", 2.0).unwrap());
        assert_eq!(lookup(set.get("shadingquality"), "shadingquality").unwrap().data, ParamData::from(2.0));
        assert!(lookup(set.get("screen"), "screen").is_none());
        assert!(lookup(set.get("no such thing"), "no such thing").is_none());
    }
}
