//! Pyg scene files (reference chapter 3): the reader and the writer.

mod bytes;
mod calls;
mod flat;
mod input;
mod names;
mod python;
mod read;
mod script;
mod value;
mod write;

pub use input::runs_program;
pub use read::{Chunking, PygError, PygOptions, PygSource, read};
pub use write::{Writer, WriterOptions};

/// `; did you mean ...`, or nothing.
pub(crate) fn hint(suggestion: Option<&str>) -> String {
    suggestion.map(|s| format!("; did you mean \"{s}\"?")).unwrap_or_default()
}
