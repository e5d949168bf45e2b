//! The errors that end the reading.

use granita_base::Location;
use granita_scene::Stop;
use std::io;

/// An error that ends the reading. Errors inside of the scene are reported, not returned.
#[derive(Debug, thiserror::Error)]
pub enum PygError {
    /// The source cannot be read.
    #[error("cannot read {path}: {source}")]
    Io {
        /// The name of the source.
        path: String,
        /// The message of the system.
        source: io::Error,
    },
    /// The text is neither flat nor Python.
    #[error("{at}: {what}")]
    Malformed {
        /// The error.
        what: String,
        /// The position.
        at: Location,
    },
    /// The scene is a script, but scripts are not allowed or there is no interpreter.
    #[error("{0}")]
    Unsupported(String),
    /// The sink stopped the reading.
    #[error(transparent)]
    Stopped(#[from] Stop),
}
