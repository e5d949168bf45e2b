//! Errors of the viewer, sorted by their cause.

use granita_image::ImageError;

/// The reason why an image cannot be shown, measured or compared.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// A file that cannot be read or written.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// More than there may be.
    #[error("{what} {asked} exceeds the limit of {max}")]
    Limit {
        /// What is too large.
        what: &'static str,
        /// How large.
        asked: u64,
        /// How large it may be.
        max: u64,
    },
    /// The caller asked for something that does not exist or does not fit.
    #[error("{what}")]
    Misuse {
        /// What was asked, and of what.
        what: String,
    },
}

/// The result of the viewer's operations.
pub type Result<T> = std::result::Result<T, ViewError>;
