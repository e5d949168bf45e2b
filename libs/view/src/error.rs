//! Errors of the viewer, sorted by their cause.

use granita_image::ImageError;

/// The reason why an image cannot be shown, measured or compared.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// A file cannot be read or written.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A value exceeds its limit.
    #[error("{what} {asked} exceeds the limit of {max}")]
    Limit {
        /// The limited quantity.
        what: &'static str,
        /// The requested value.
        asked: u64,
        /// The largest permitted value.
        max: u64,
    },
    /// The caller requested something that does not exist or does not fit.
    #[error("{what}")]
    Misuse {
        /// A description of the error.
        what: String,
    },
}

/// The result of the viewer's operations.
pub type Result<T> = std::result::Result<T, ViewError>;
