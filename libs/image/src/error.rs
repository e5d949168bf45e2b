//! What can go wrong with an image, sorted by whose fault it is.

use std::path::PathBuf;

/// An image that cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// The system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file contradicts its own format.
    #[error("{}: malformed {format}: {what}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The format it was taken for.
        format: &'static str,
        /// What is wrong, and where in the file if known.
        what: String,
    },
    /// Legal, but not handled.
    #[error("{}: {what}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// What is not handled.
        what: String,
    },
    /// Larger than the reader may take in.
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
    /// The caller asked for something that does not exist or does not fit.
    #[error("{}: {what}", path.display())]
    Misuse {
        /// The file.
        path: PathBuf,
        /// What was asked.
        what: String,
    },
    /// A plugin failed.
    #[error("{}: {plugin}: {what}", path.display())]
    Plugin {
        /// The image.
        path: PathBuf,
        /// Which plugin.
        plugin: String,
        /// What it did, and what it says about it.
        what: String,
    },
}

impl ImageError {
    /// The same error, when reading again would only find it again: what is wrong with a file stays wrong. `None` for what the
    /// system said, which may have been for the moment.
    pub fn lasting(&self) -> Option<Self> {
        Some(match self {
            Self::Malformed { path, format, what } => {
                Self::Malformed { path: path.clone(), format, what: what.clone() }
            }
            Self::Unsupported { path, what } => Self::Unsupported { path: path.clone(), what: what.clone() },
            Self::Limit { path, what, asked, max } => {
                Self::Limit { path: path.clone(), what, asked: *asked, max: *max }
            }
            Self::Io { .. } | Self::Misuse { .. } | Self::Plugin { .. } => return None,
        })
    }
}

/// Result of an image operation.
pub type Result<T> = std::result::Result<T, ImageError>;

impl From<granita_base::FileError> for ImageError {
    fn from(error: granita_base::FileError) -> Self {
        Self::Io { path: error.path, source: error.source }
    }
}
