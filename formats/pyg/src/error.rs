//! Why reading ends early.

use granita_base::Location;
use granita_scene::Stop;
use std::io;

/// Why reading ended early. Mistakes inside of the scene are reported, not returned.
#[derive(Debug, thiserror::Error)]
pub enum PygError {
    /// The source cannot be read.
    #[error("cannot read {path}: {source}")]
    Io {
        /// Name of the source.
        path: String,
        /// What the system said.
        source: io::Error,
    },
    /// A text that is neither flat nor Python.
    #[error("{at}: {what}")]
    Malformed {
        /// What is wrong.
        what: String,
        /// Where.
        at: Location,
    },
    /// A script where none is allowed, or without an interpreter.
    #[error("{0}")]
    Unsupported(String),
    /// The sink wants no more.
    #[error(transparent)]
    Stopped(#[from] Stop),
}
