//! Errors of compiled shaders.

/// The reason why a compiled shader cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GslError {
    /// The file is not what it should be.
    #[error("{at}: {what}")]
    Malformed {
        /// What is wrong.
        what: String,
        /// The file.
        at: String,
    },
    /// The file is of a kind that this version does not know.
    #[error("{at}: {what}")]
    Unsupported {
        /// What is not known.
        what: String,
        /// The file.
        at: String,
    },
}
