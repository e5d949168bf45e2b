//! Errors of compiled shaders.

/// The reason why a compiled shader cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GslError {
    /// The file is invalid.
    #[error("{at}: {what}")]
    Malformed {
        /// A description of the error.
        what: String,
        /// The file.
        at: String,
    },
    /// The file is of a kind that this version does not support.
    #[error("{at}: {what}")]
    Unsupported {
        /// A description of the unsupported kind.
        what: String,
        /// The file.
        at: String,
    },
}
