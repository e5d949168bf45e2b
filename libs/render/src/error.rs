//! Errors of rendering a frame.

use std::path::PathBuf;

/// The reason why a frame could not be rendered completely.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// A system call failed.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
    /// An image cannot be written.
    #[error(transparent)]
    Image(#[from] granita_image::ImageError),
    /// The value is larger than the limit.
    #[error("{what} {asked} exceeds the limit of {max}")]
    Limit {
        /// The limited quantity.
        what: &'static str,
        /// The requested value.
        asked: u64,
        /// The largest permitted value.
        max: u64,
    },
    /// The scene lacks data that rendering needs, or the caller requested something that does not exist.
    #[error("{what}")]
    Misuse {
        /// A description of the error.
        what: String,
    },
    /// The caller stopped rendering before the frame was complete.
    #[error("rendering was stopped before the frame was done")]
    Stopped,
}

impl From<granita_base::FileError> for RenderError {
    fn from(error: granita_base::FileError) -> Self {
        Self::Io { path: error.path, source: error.source }
    }
}
