//! The errors of building a primitive.

/// The reason why a primitive cannot be built. The message contains the call and the numbers compared.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GeomError {
    /// The declaration contradicts itself: wrong counts, missing positions, indices out of range, numbers that are
    /// not finite.
    #[error("{call}: {what}")]
    Malformed {
        /// The call that declared the primitive.
        call: &'static str,
        /// The description of the error.
        what: String,
    },
    /// A limit is exceeded.
    #[error("{call}: {what} is {asked}, the limit is {max}")]
    Limit {
        /// The call that declared the primitive.
        call: &'static str,
        /// The kind of thing that exceeds the limit.
        what: &'static str,
        /// The requested number.
        asked: u64,
        /// The largest allowed number.
        max: u64,
    },
}
