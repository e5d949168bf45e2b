//! The viewer's model: what a picture holds, how it is shown, what its values are, how two differ.
//!
//! No window, no socket and no format is known here: files are opened through the registry that the caller
//! brings, and what a display shows are plain bytes that the caller puts on a screen, in a terminal or in a file.

#![forbid(unsafe_code)]

mod error;
mod live;
mod rect;

pub use error::{Result, ViewError};
pub use live::{CommandSender, Live, LiveInfo, LiveLimits, LiveWishes, ViewCommand};
pub use rect::Rect;
