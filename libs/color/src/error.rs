//! The errors of this crate.

use std::path::PathBuf;

/// An error of a configuration, of a file that it names, or of a request.
#[derive(Debug, thiserror::Error)]
pub enum ColorError {
    /// A file cannot be read.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A file is damaged, or is not of its kind.
    #[error("{place}: {what}")]
    Malformed {
        /// The file, and the line where it is known.
        place: String,
        /// The reason.
        what: String,
    },
    /// A file asks for something that this crate does not do.
    #[error("{place}: {what} is not supported")]
    Unsupported {
        /// The file, and the line where it is known.
        place: String,
        /// The name of the transform or of the option.
        what: String,
    },
    /// A file asks for something that neither this crate nor another library does.
    #[error("{place}: {what} is not supported; {why}")]
    Elsewhere {
        /// The file, and the line where it is known.
        place: String,
        /// The name of the transform or of the option.
        what: String,
        /// The message of the other library, or of its absence.
        why: String,
    },
    /// A file asks for more than a limit allows.
    #[error("{place}: {what}: {asked}, and the limit is {max}")]
    Limit {
        /// The file, and the line where it is known.
        place: String,
        /// The name of the quantity.
        what: &'static str,
        /// The number that the file asks for.
        asked: u64,
        /// The largest number that is allowed.
        max: u64,
    },
    /// A request names something that does not exist.
    #[error("{what}")]
    Misuse {
        /// The reason, with the names that exist.
        what: String,
    },
}
