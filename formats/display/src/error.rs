//! What can go wrong, sorted by whose fault it is.

/// A packet that cannot be understood, or a conversation that cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum DisplayError {
    /// The system refused.
    #[error("{what}: {source}")]
    Io {
        /// What was attempted, with the address.
        what: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// A packet contradicts the protocol.
    #[error("malformed packet: {what} at byte {at}")]
    Malformed {
        /// What is wrong.
        what: String,
        /// Where, counted from the packet's length.
        at: usize,
    },
    /// A packet of a kind that is not known.
    #[error("unknown packet of type {kind}")]
    Unsupported {
        /// Its type.
        kind: u8,
    },
    /// More than is taken in.
    #[error("{what} {asked} exceeds the limit of {max}")]
    Limit {
        /// What is too large.
        what: &'static str,
        /// How large.
        asked: u64,
        /// How large it may be.
        max: u64,
    },
    /// What the caller asked for cannot be said in the protocol.
    #[error("{what}")]
    Misuse {
        /// What was asked.
        what: String,
    },
}

/// Result of an operation of this crate.
pub type Result<T> = std::result::Result<T, DisplayError>;
