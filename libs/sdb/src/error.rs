//! What can go wrong with spatial databases, sorted by whose fault it is.

use granita_image::ImageError;
use std::path::PathBuf;

/// A database that cannot be read, written or added to.
#[derive(Debug, thiserror::Error)]
pub enum SdbError {
    /// The system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The picture that a database over surfaces was to become could not be written.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A file that is no database, or a broken one.
    #[error("{}: {what}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong, with the numbers compared.
        what: String,
    },
    /// A file of a later version.
    #[error("{}: version {version} of the format, only 1 is known", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// Its version.
        version: u32,
    },
    /// Records that do not belong together, or nothing to write.
    #[error("spatial database \"{name}\": {what}")]
    Misuse {
        /// The database.
        name: String,
        /// What was asked.
        what: String,
    },
}

/// Result of an operation on databases.
pub type Result<T> = std::result::Result<T, SdbError>;

impl From<granita_base::FileError> for SdbError {
    fn from(error: granita_base::FileError) -> Self {
        Self::Io { path: error.path, source: error.source }
    }
}
