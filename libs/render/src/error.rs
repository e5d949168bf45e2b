//! What can keep a frame from being rendered.

use std::path::PathBuf;

/// Why a frame could not be rendered, or not completely.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// The system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// An image cannot be written.
    #[error(transparent)]
    Image(#[from] granita_image::ImageError),
    /// Larger than can be rendered.
    #[error("{what} {asked} exceeds the limit of {max}")]
    Limit {
        /// What is too large.
        what: &'static str,
        /// How large.
        asked: u64,
        /// How large it may be.
        max: u64,
    },
    /// The scene lacks what rendering needs, or the caller asked for something that is not there.
    #[error("{what}")]
    Misuse {
        /// What was asked.
        what: String,
    },
    /// The caller asked to stop before the frame was done.
    #[error("rendering was stopped before the frame was done")]
    Stopped,
}

impl From<granita_base::FileError> for RenderError {
    fn from(error: granita_base::FileError) -> Self {
        Self::Io { path: error.path, source: error.source }
    }
}
