//! Errors of making textures, sorted by their cause.

use granita_image::ImageError;
use std::path::PathBuf;

/// The reason why a texture cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum TextureError {
    /// A system call failed.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
    /// An image could not be read or written.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// The input is not suitable for the requested texture.
    #[error("{}: {what}", path.display())]
    Malformed {
        /// The input.
        path: PathBuf,
        /// A description of the mismatch, with the numbers compared.
        what: String,
    },
    /// The file format lacks a feature that textures need.
    #[error("{what}")]
    Unsupported {
        /// The missing feature.
        what: String,
    },
    /// The value exceeds a limit.
    #[error("{}: {what} {asked} exceeds the limit of {max}", path.display())]
    Limit {
        /// The file.
        path: PathBuf,
        /// The limited quantity.
        what: &'static str,
        /// The requested value.
        asked: u64,
        /// The largest permitted value.
        max: u64,
    },
    /// The options contradict each other, or the number of inputs is not accepted.
    #[error("{what}")]
    Misuse {
        /// A description of the error.
        what: String,
    },
}

/// The result of making a texture.
pub type Result<T> = std::result::Result<T, TextureError>;
