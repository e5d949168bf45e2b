//! The errors, sorted by cause.

/// A packet that cannot be decoded, or a connection that cannot continue.
#[derive(Debug, thiserror::Error)]
pub enum DisplayError {
    /// A system call failed.
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
        /// The type of the packet.
        kind: u8,
    },
    /// A quantity exceeds the limits of the receiver.
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

/// The result of an operation of this crate.
pub type Result<T> = std::result::Result<T, DisplayError>;
