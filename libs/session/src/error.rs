//! Why a session cannot go on.

use std::path::PathBuf;

/// Why a scene could not be read, or reading it ended early.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// A file that was asked for by name cannot be read.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// There is no such scene, neither as a file nor on the input path.
    #[error("cannot find the scene \"{name}\" (looked in {places})")]
    Missing {
        /// As it was named.
        name: String,
        /// Where was looked.
        places: String,
    },
    /// The scene asked to stop: `Command ("exit")`.
    #[error("stopped by the scene's own request")]
    Exit,
    /// A scene that cannot be read on.
    #[error("{at}: {what}")]
    Scene {
        /// What is wrong.
        what: String,
        /// Where.
        at: granita_base::Location,
    },
    /// Anything else that ended reading.
    #[error("{0}")]
    Failed(String),
}
