//! The errors, sorted by cause.

/// A packet that cannot be understood, or a conversation that cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum DisplayError {
    /// The system refused.
    #[error("{what}: {source}")]
    Io {
        /// The action that was attempted, with the address.
        what: String,
        /// The message of the system.
        source: std::io::Error,
    },
    /// A packet contradicts the protocol.
    #[error("malformed packet: {what} at byte {at}")]
    Malformed {
        /// The error in the packet.
        what: String,
        /// The offset in bytes, counted from the packet's length.
        at: usize,
    },
    /// A packet of an unknown kind.
    #[error("unknown packet of type {kind}")]
    Unsupported {
        /// Its type.
        kind: u8,
    },
    /// More than is taken in.
    #[error("{what} {asked} exceeds the limit of {max}")]
    Limit {
        /// The quantity that is too large.
        what: &'static str,
        /// The requested value.
        asked: u64,
        /// The largest value allowed.
        max: u64,
    },
    /// The request of the caller cannot be expressed in the protocol.
    #[error("{what}")]
    Misuse {
        /// The request.
        what: String,
    },
}

/// Result of an operation of this crate.
pub type Result<T> = std::result::Result<T, DisplayError>;
