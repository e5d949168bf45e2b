//! What can go wrong when shaders are put together.

use std::sync::Arc;

/// Why a group of shaders cannot be made or attached.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ShadeError {
    /// The caller asked for something that the language forbids.
    #[error("{what}")]
    Misuse {
        /// What, with the names of the shaders.
        what: String,
    },
    /// A compiled shader does not hold together: a symbol or parameter points nowhere.
    #[error("shader \"{shader}\" is malformed: {what}")]
    Malformed {
        /// Name of the shader.
        shader: Arc<str>,
        /// What is wrong.
        what: String,
    },
    /// Too big to run.
    #[error("{what}: {asked} asked, {max} allowed")]
    Limit {
        /// What there is too much of.
        what: &'static str,
        /// How much was asked.
        asked: usize,
        /// How much is allowed.
        max: usize,
    },
}
