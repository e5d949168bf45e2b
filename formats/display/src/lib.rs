//! Live images over TCP, in the protocol that the viewer `tev` established.
//!
//! - [`packet`] contains the messages and their bytes.
//! - [`IvFormat`] is the image format "iv" (reference 7.4.3), which sends an image to a viewer while it is rendered.
//! - [`Listener`] receives images from any renderer that uses the protocol.
//!
//! # Invariants
//!
//! - A viewer that dies, stalls or sends invalid data never stops or slows the renderer.
//! - A sender that dies, stalls or sends invalid data never stops the viewer, and takes no memory beyond
//!   [`PacketLimits`].
//! - Silent connections never block others ([`Places`]).
//! - Packets that are not part of tev's protocol are sent only to a peer that declared that it supports them
//!   ([`packet::GREETING`]).
//!
//! Encryption and passwords are deliberately absent (listen on this machine only, and forward the port by ssh), and so
//! is compression of pixels (ssh does that as well).
//!
//! ```
//! use granita_display::{Packet, PacketLimits};
//! # fn main() -> granita_display::Result<()> {
//! let mut bytes = Vec::new();
//! Packet::CloseImage { name: "a.exr".into() }.encode(&mut bytes)?;
//! // The length in bytes, the type, and a text that ends with a zero byte.
//! assert_eq!(bytes, b"\x0b\0\0\0\x02a.exr\0");
//! # Ok(())
//! # }
//! ```

#![forbid(unsafe_code)]
#![warn(unnameable_types)]

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
