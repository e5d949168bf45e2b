//! The table of the calls of the scene interface, with one row for each call: its forms, and the name, the type, the
//! range and the meaning of each argument.
//!
//! The reader of Pyg takes arguments by these rows and names them in its messages. [`Call::name`](crate::Call::name)
//! comes from them. The documentation of the Python package and the argument tables of the manual are made from them.

mod table;

pub use table::*;

/// The type of an argument, and the way in which a reader takes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A string.
    Text,
    /// A string or nothing. At the end of the arguments it may be left out.
    OptionalText,
    /// One number.
    Number,
    /// A number that is 0 for "off". A script may pass a truth value.
    Switch,
    /// An integer that is not negative.
    Count,
    /// A sequence of numbers.
    Numbers,
    /// A sequence of integers.
    Integers,
    /// This number of numbers, separate or in sequences. It is the last argument of its form.
    Row(usize),
    /// The same, or nothing.
    OptionalRow(usize),
    /// Any number of numbers, separate or in sequences. It is the last argument of its form.
    Rest,
    /// The name of a parameter or attribute with its type, as in "float Kd".
    Declaration,
    /// A value of the type that was declared.
    Value,
    /// The name of a layer. It is there when the number of the remaining arguments is odd.
    Layer,
}

/// An argument of a call.
#[derive(Clone, Copy, Debug)]
pub struct Arg {
    /// The name, in messages, signatures and tables.
    pub name: &'static str,
    /// The type.
    pub kind: Kind,
    /// The number of values of a sequence, or the names of the numbers of a row; empty for other types.
    pub shape: &'static str,
    /// The value when the argument is left out; empty when it is needed.
    pub default: &'static str,
    /// The unit, and the range where there is one.
    pub range: &'static str,
    /// The words that it accepts or that are most usual; empty for any.
    pub words: &'static [&'static str],
    /// The meaning, in sentences.
    pub help: &'static str,
}

/// A form of a call.
#[derive(Clone, Copy, Debug)]
pub struct Form {
    /// The arguments, in order.
    pub args: &'static [Arg],
    /// True when parameters may follow, as declarations and values in turn.
    pub params: bool,
}

/// The page of the manual that describes a call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Page {
    /// Cameras, images, frames, commands and inputs.
    Frames,
    /// Attributes and parameters.
    Attributes,
    /// Transformations and motion.
    Transformations,
    /// Shaders and lights.
    Shaders,
    /// Geometric primitives.
    Shapes,
}

/// A call of the table.
#[derive(Clone, Copy, Debug)]
pub struct CallRow {
    /// The name.
    pub name: &'static str,
    /// The page of the manual.
    pub page: Page,
    /// A description in one sentence.
    pub help: &'static str,
    /// The forms, of which there is at least one. Forms differ in whether their first argument is a string.
    pub forms: &'static [Form],
    /// A description of the value that it returns; empty for calls that return nothing. Such a call is a query and not
    /// a [`Call`](crate::Call).
    pub returns: &'static str,
}

impl CallRow {
    /// True when the call is a query, which changes nothing.
    pub fn is_query(&self) -> bool {
        !self.returns.is_empty()
    }

    /// Returns the form whose first argument is a string, or is none; the first form when there is no such form.
    pub fn form(&self, text: bool) -> &'static Form {
        const NONE: Form = Form { args: &[], params: false };
        let fits = |form: &&Form| form.args.first().is_some_and(|arg| arg.kind.is_text() == text);
        self.forms.iter().find(fits).or(self.forms.first()).unwrap_or(&NONE)
    }

    /// Returns the words of the argument `name`; empty when no argument of that name has any.
    pub fn words(&self, name: &str) -> &'static [&'static str] {
        let args = self.forms.iter().flat_map(|form| form.args);
        args.filter(|arg| arg.name == name)
            .map(|arg| arg.words)
            .find(|words| !words.is_empty())
            .unwrap_or(&[])
    }
}

impl Kind {
    /// True for arguments that are strings.
    pub fn is_text(self) -> bool {
        matches!(self, Self::Text | Self::OptionalText | Self::Declaration | Self::Layer)
    }
}

/// Returns the row of a call.
pub fn call_row(name: &str) -> Option<&'static CallRow> {
    TABLE.iter().copied().find(|row| row.name == name)
}

/// A parameter of primitives whose name has a type of its own, so that it needs no declaration.
#[derive(Clone, Copy, Debug)]
pub struct VariableRow {
    /// The name.
    pub name: &'static str,
    /// The type. Arrays of length 0 are as long as their data.
    pub ty: granita_base::ParamType,
    /// The primitives that it has a meaning for.
    pub of: &'static str,
    /// The value without it; empty where there is none.
    pub default: &'static str,
    /// The unit, and the range.
    pub range: &'static str,
    /// The meaning, in sentences.
    pub help: &'static str,
}

/// A command of [`COMMAND`].
#[derive(Clone, Copy, Debug)]
pub struct CommandRow {
    /// The first word of the name.
    pub name: &'static str,
    /// The parameters, each with its meaning.
    pub params: &'static [(&'static str, &'static str)],
    /// The meaning, in sentences.
    pub help: &'static str,
}
