//! Errors of linking and attaching shaders.

/// The reason why a group of shaders cannot be made or attached.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ShadeError {
    /// The caller requested something that the language forbids.
    #[error("{what}")]
    Misuse {
        /// The description, with the names of the shaders.
        what: String,
    },
    /// The shaders are too large to run.
    #[error("{what}: {asked} requested, {max} allowed")]
    Limit {
        /// The limited quantity.
        what: &'static str,
        /// The requested number.
        asked: usize,
        /// The permitted number.
        max: usize,
    },
}
