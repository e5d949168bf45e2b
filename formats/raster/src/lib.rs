//! Plain pictures: one image per file, no tiles, no levels.
//!
//! | format | read | written |
//! |---|---|---|
//! | "png" | every kind | 8 and 16 bits, 1 to 4 channels |
//! | "jpeg" | grey, RGB, CMYK | 8 bits, grey and RGB; alpha is left out |
//! | "tga" | every kind | 8 bits; grey, RGB, RGBA |
//! | "bmp" | every kind | 8 bits; grey, RGB, RGBA |
//! | "pnm" | PBM, PGM, PPM, PAM | 8 and 16 bits, 1 to 4 channels |
//! | "pfm" | grey, RGB | floats, grey and RGB |
//! | "hdr" | RGBE | RGBE (9 bits of each colour), alpha is left out |
//! | "qoi", "webp" | every kind | 8 bits, RGB and RGBA |
//! | "gif" | first picture | no |
//!
//! Invariants: nothing is converted silently (a type or a number of channels that a format cannot hold is
//! an error at `create`, only alpha may be left out, and then `supports("alpha")` is false); pictures are
//! decoded whole at the first touch, and encoded whole at `close`.
//!
//! Deliberately absent: colour profiles, animation, writing of GIF, and the formats SGI, Maya IFF and DDS.

#![forbid(unsafe_code)]

mod pfm;
mod plain;
mod png;
mod whole;

pub use self::pfm::PfmFormat;
pub use self::plain::{FORMATS, PlainFormat};
pub use self::png::PngFormat;

use granita_image::Format;
use std::sync::Arc;

/// All formats of this crate, in the order in which files should be tried.
pub fn formats() -> Vec<Arc<dyn Format>> {
    let mut all: Vec<Arc<dyn Format>> = vec![Arc::new(PngFormat), Arc::new(PfmFormat)];
    all.extend(FORMATS.iter().map(|f| Arc::new(*f) as Arc<dyn Format>));
    all
}
