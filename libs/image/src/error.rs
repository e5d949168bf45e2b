//! The errors of images, sorted by their origin.

use std::path::PathBuf;

/// An image that cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// The system refused an operation.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The file contradicts its own format.
    #[error("{}: malformed {format}: {what}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The assumed format.
        format: &'static str,
        /// A description of the error, and its place in the file if known.
        what: String,
    },
    /// The file is valid, but a feature is not supported.
    #[error("{}: {what}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// The unsupported feature.
        what: String,
    },
    /// The file exceeds a limit of the reader.
    #[error("{}: {what} {asked} exceeds the limit of {max}", path.display())]
    Limit {
        /// The file.
        path: PathBuf,
        /// The quantity that is too large.
        what: &'static str,
        /// Its value.
        asked: u64,
        /// The largest allowed value.
        max: u64,
    },
    /// The caller requested something that does not exist or does not fit.
    #[error("{}: {what}", path.display())]
    Misuse {
        /// The file.
        path: PathBuf,
        /// The request.
        what: String,
    },
    /// A plugin failed.
    #[error("{}: {plugin}: {what}", path.display())]
    Plugin {
        /// The image.
        path: PathBuf,
        /// The name of the plugin.
        plugin: String,
        /// The failed operation, and the plugin's description of the error.
        what: String,
    },
}

impl ImageError {
    /// Returns the same error when reading again would give it again, because errors of a file's contents are
    /// permanent. `None` for system errors, which may be temporary.
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

/// The result of an image operation.
pub type Result<T> = std::result::Result<T, ImageError>;

impl From<granita_base::FileError> for ImageError {
    fn from(error: granita_base::FileError) -> Self {
        Self::Io { path: error.path, source: error.source }
    }
}
