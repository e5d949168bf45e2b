//! Connects a program with a renderer in another process (reference 2.3, "remote"). This module has both sides.
//!
//! The program's side is [`Remote`], a receiver of calls. The renderer's side is a [`Session`] in [`Session::obey`].
//! Calls are sent as flat Pyg, in pieces. The program sends these kinds of frames (see [`granita_pyg::frames`]):
//! - `T` contains calls, `A` queries an attribute (answered by `G`), `W` waits (answered by `W`).
//! - `X` ends the frame that is being rendered. `P` (a pixel or a rectangle) sets the priority of its buckets. `Z`
//!   ends the connection. A connection that ends without it means that the program has crashed, so its frame is not
//!   needed.
//!
//! The renderer sends these kinds:
//! - `H` is the first frame and contains the version.
//! - `B` is a sign of life, sent from a separate thread twice a second. A renderer that is silent for too long is
//!   ended.
//! - `M` is a message: severity, line, column, file, text.
//! - `R` is the progress of the frame, 0 to 1. `D` reports that `Render` is done.
//! - `O`, `S`, `L` open an image in the memory of the program, send its rows and close it.

mod client;
mod images;
mod serve;
mod told;

pub use client::{Remote, RemoteEnds};
pub use told::Told;

use granita_base::report::Message;
use granita_base::{Location, Severity};
use granita_pyg::frames::Frame;

/// The first text of a renderer, which contains the version of the suite and of this protocol.
const GREETING: &str = concat!("granita-remote ", env!("CARGO_PKG_VERSION"), "/3");

/// Returns the message of an `M`.
fn message(payload: &[u8]) -> Option<Message> {
    let mut frame = Frame(payload);
    let code = i32::try_from(frame.word()?).ok()?;
    let (line, column) = (frame.word()?, frame.word()?);
    let at = Location { file: frame.text()?.into(), line, column };
    Some(Message { severity: Severity::from_code(code), at, text: frame.text()? })
}
