//! What can go wrong with making textures, sorted by whose fault it is.

use granita_image::ImageError;
use std::path::PathBuf;

/// A texture that cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum TextureError {
    /// The system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A picture could not be read or written.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// Input that does not fit what is to be made of it.
    #[error("{}: {what}", path.display())]
    Malformed {
        /// The input.
        path: PathBuf,
        /// What does not fit, with the numbers compared.
        what: String,
    },
    /// The file format cannot do what textures need.
    #[error("{what}")]
    Unsupported {
        /// What is missing.
        what: String,
    },
    /// More than can be held.
    #[error("{}: {what} {asked} exceeds the limit of {max}", path.display())]
    Limit {
        /// The file.
        path: PathBuf,
        /// What is too large.
        what: &'static str,
        /// How large.
        asked: u64,
        /// How large it may be.
        max: u64,
    },
    /// Options that contradict each other, or the wrong number of inputs.
    #[error("{what}")]
    Misuse {
        /// What was asked.
        what: String,
    },
}

/// Result of making a texture.
pub type Result<T> = std::result::Result<T, TextureError>;
