//! The errors of this crate.

use granita_image::ImageError;
use granita_texture::TextureError;
use std::path::PathBuf;

/// The result of an operation.
pub type Result<T> = std::result::Result<T, EditError>;

/// The error of an operation.
#[derive(Debug, thiserror::Error)]
pub enum EditError {
    /// A file that cannot be read or written.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A map of directions that cannot be converted.
    #[error(transparent)]
    Texture(#[from] TextureError),
    /// A file without the requested part, or whose format cannot store the image.
    #[error("{}: {what}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// What is missing.
        what: String,
    },
    /// An operation that does not apply to its images or its values.
    #[error("{what}")]
    Misuse {
        /// What does not fit.
        what: String,
    },
    /// A limit that is exceeded.
    #[error("{what}: {asked}, at most {max} are permitted")]
    Limit {
        /// The limited quantity, with its unit.
        what: &'static str,
        /// The requested number.
        asked: u64,
        /// The largest number.
        max: u64,
    },
}

impl EditError {
    /// Returns an error about the use of an operation.
    pub(crate) fn misuse(what: impl Into<String>) -> Self {
        Self::Misuse { what: what.into() }
    }
}
