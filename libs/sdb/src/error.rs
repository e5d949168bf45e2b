//! The errors of spatial databases, sorted by their origin.

use granita_image::ImageError;
use std::path::PathBuf;

/// A database that cannot be read, written or added to.
#[derive(Debug, thiserror::Error)]
pub enum SdbError {
    /// The system refused an operation.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The image of a database over surfaces could not be written.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A file is not a database, or is damaged.
    #[error("{}: {what}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// A description of the error, with the numbers compared.
        what: String,
    },
    /// A file has a later version.
    #[error("{}: version {version} of the format, only 1 is known", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// Its version.
        version: u32,
    },
    /// Records do not belong together, or there is nothing to write.
    #[error("spatial database \"{name}\": {what}")]
    Misuse {
        /// The database.
        name: String,
        /// The request.
        what: String,
    },
}

/// The result of an operation on databases.
pub type Result<T> = std::result::Result<T, SdbError>;

impl From<granita_base::FileError> for SdbError {
    fn from(error: granita_base::FileError) -> Self {
        Self::Io { path: error.path, source: error.source }
    }
}
