//! Pyg scene files (reference chapter 3), with their reader and writer.
//!
//! Pyg is Python with a function for every call of the scene interface. In practice, nearly all of it is *flat*. It
//! consists of calls with constant arguments, one after the other, sometimes with binary arrays. [`read`] reads flat
//! statements itself, as fast as the numbers can be read and with only one statement in memory. Anything else (`def`,
//! `for`, a variable ...) is cut out statement by statement and executed by a child `python3`, which sends its calls
//! back. Flat statements between them still need no Python. A scene without other statements needs none at all.
//!
//! Beyond the flat subset of the reference, the reader accepts arithmetic between constants (`1.0/48`, `[0]*3`), nested
//! sequences, adjacent numbers where a sequence belongs, and indented statements.
//!
//! [`Writer`] is the inverse. It is a [`granita_scene::SceneSink`] that writes every call as flat, ASCII Pyg whose
//! numbers read back to the same bits.
//!
//! ```
//! use granita_base::Reporter;
//! use granita_pyg::{PygOptions, PygSource, Writer, read};
//! let mut writer = Writer::new(Vec::new());
//! let text = b"Translate ([0, 1.0/4, 2]) # up\nSphere(1,-1,1,360)".to_vec();
//! let source = PygSource::Bytes { name: "<example>".into(), bytes: text };
//! read(source, &mut writer, &PygOptions::default(), &Reporter::silent())?;
//! assert_eq!(writer.into_inner()?, b"Translate (0, 0.25, 2)\nSphere (1, -1, 1, 360)\n");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![forbid(unsafe_code)]

mod bytes;
mod calls;
mod error;
mod flat;
pub mod frames;
mod line;
mod names;
mod options;
mod python;
mod read;
mod reader;
mod run;
mod script;
mod serve;
mod text;
mod value;
mod write;

pub use error::PygError;
pub use options::{Chunking, OpenedFiles, PygOptions, Scripts};
pub use read::{PygSource, read};
pub use serve::{Requests, serve, serve_with};
pub use write::{Writer, WriterOptions};

/// Returns the names of all calls of the scene interface.
pub fn call_names() -> impl Iterator<Item = &'static str> {
    names::calls()
}

/// Returns `; did you mean ...`, or an empty string.
pub(crate) fn hint(suggestion: Option<&str>) -> String {
    suggestion.map(|s| format!("; did you mean \"{s}\"?")).unwrap_or_default()
}
