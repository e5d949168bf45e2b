//! Errors that end a session.

use std::path::PathBuf;

/// The reason why a scene could not be read completely.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// A file that was requested by name cannot be read.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
    /// The scene exists neither as a file nor on the input path.
    #[error("cannot find the scene \"{name}\" (looked in {places})")]
    Missing {
        /// The name that was given.
        name: String,
        /// The places that were searched.
        places: String,
    },
    /// The scene stopped the session with `Command ("exit")`.
    #[error("stopped by the scene's own request")]
    Exit,
    /// The scene cannot be read further.
    #[error("{at}: {what}")]
    Scene {
        /// A description of the error.
        what: String,
        /// The position of the error.
        at: granita_base::Location,
    },
    /// Another error that ended reading.
    #[error("{0}")]
    Failed(String),
}
