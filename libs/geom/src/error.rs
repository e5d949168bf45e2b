//! What can be wrong with a primitive.

/// Why a primitive cannot be built. The message names the call and the numbers compared.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GeomError {
    /// The declaration contradicts itself: wrong counts, missing positions, indices out of range, numbers that are
    /// not finite.
    #[error("{call}: {what}")]
    Malformed {
        /// The call that declared the primitive.
        call: &'static str,
        /// What is wrong with it.
        what: String,
    },
    /// More than can be handled.
    #[error("{call}: {what} is {asked}, the limit is {max}")]
    Limit {
        /// The call that declared the primitive.
        call: &'static str,
        /// What there is too much of.
        what: &'static str,
        /// How much was asked for.
        asked: u64,
        /// How much is allowed.
        max: u64,
    },
}
