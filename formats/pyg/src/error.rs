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
        /// The message of the system.
        source: io::Error,
    },
    /// A text that is neither flat nor Python.
    #[error("{at}: {what}")]
    Malformed {
        /// The error.
        what: String,
        /// The position.
        at: Location,
    },
    /// A script where none is allowed, or without an interpreter.
    #[error("{0}")]
    Unsupported(String),
    /// The sink stopped the reading.
    #[error(transparent)]
    Stopped(#[from] Stop),
}
