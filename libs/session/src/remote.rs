//! The renderer that is another process (reference 2.3, "remote"): both ends of the connection.
//!
//! The program's end is [`Remote`], a receiver of calls; the renderer's is a [`Session`] that [`Session::obey`]s. Calls go as
//! flat Pyg, in pieces. Kinds of frames (see [`granita_pyg::frames`]), from the program:
//! - `T` calls, `A` asks for an attribute (answered by `G`), `W` waits (answered by `W`);
//! - `X` ends the frame that is being rendered, `P` (a pixel or a rectangle) says which buckets of it come first; `Z`: there will be nothing more. An end without it means that the program is
//!   gone, and its frame is of no use to anybody.
//!
//! From the renderer:
//! - `H` greets with the version, first;
//! - `B` it lives: sent from a thread of its own, twice a second. A renderer that is silent for too long is ended;
//! - `M` a message: severity, line, column, file, text;
//! - `R` how far the frame is, 0 to 1; `D`: `Render` is done;
//! - `O`, `S`, `L` open, rows and close of an image in the memory of the program.

mod client;
mod images;
mod serve;
mod told;

pub use client::{Remote, RemoteEnds};
pub use told::Told;

use granita_base::report::Message;
use granita_base::{Location, Severity};
use granita_pyg::frames::{Frame, put_text};

/// What a renderer of this version says first.
const GREETING: &str = concat!("granita-remote ", env!("CARGO_PKG_VERSION"), "/3");

/// The payload of `M`.
fn message_bytes(message: &Message) -> Vec<u8> {
    let mut out = Vec::new();
    for number in [message.severity.code() as u32, message.at.line, message.at.column] {
        out.extend(number.to_le_bytes());
    }
    put_text(&message.at.file, &mut out);
    put_text(&message.text, &mut out);
    out
}

/// The message of an `M`.
fn message(payload: &[u8]) -> Option<Message> {
    let mut frame = Frame(payload);
    let code = i32::try_from(frame.word()?).ok()?;
    let (line, column) = (frame.word()?, frame.word()?);
    let at = Location { file: frame.text()?.into(), line, column };
    Some(Message { severity: Severity::from_code(code), at, text: frame.text()? })
}
