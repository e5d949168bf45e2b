//! Live pictures over TCP, in the protocol that the viewer `tev` established.
//!
//! - [`packet`]: what is said, and its bytes;
//! - [`IvFormat`]: the image format "iv" (reference 7.4.3), which sends a picture to a viewer while it is made;
//! - [`Listener`]: takes pictures from any renderer that speaks the protocol.
//!
//! Invariants:
//! - a viewer that dies, stalls or talks nonsense never stops or slows whoever makes the picture;
//! - a sender that dies, stalls or talks nonsense never stops whoever shows it, and takes no memory beyond
//!   [`PacketLimits`];
//! - connections that say nothing never keep others out ([`Places`]);
//! - packets that are not part of tev's protocol are sent to nobody who did not say that it speaks them
//!   ([`packet::GREETING`]).
//!
//! Deliberately absent: encryption and passwords (listen on this machine only, and forward the port by ssh), and
//! compression of pixels (ssh does that as well).

#![forbid(unsafe_code)]

mod client;
mod error;
mod link;
pub mod packet;
mod places;
mod server;

pub use client::IvFormat;
pub use error::{DisplayError, Result};
pub use link::Patience;
pub use packet::{Packet, PacketLimits};
pub use places::{Place, Places, Refusal, Sparingly};
pub use server::{Client, Ending, Listener, ServerLimits, Sink, listen_address, server_address};
