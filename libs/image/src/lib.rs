//! Pixels and image files, independent of the format.
//!
//! A format crate implements [`Format`]. A [`FormatRegistry`] collects formats, opens files **by content** (the
//! extension only breaks ties) and creates files by name. All other code (textures, renderer, tools) uses
//! [`ImageInput`] and [`ImageOutput`] only.
//!
//! Invariants:
//! - readers check [`Limits`] before they allocate memory, and take `&self`: many threads may read one open file;
//! - a written file appears under its name complete, at [`ImageOutput::close`], or not at all;
//! - values keep their stored type ([`Pixels`]), and only the caller converts them.
//!
//! Colour management (beyond the formulas of [`color`]), image processing and particular formats are deliberately
//! absent.

#![forbid(unsafe_code)]

mod block;
pub mod color;
mod contain;
mod deflate;
mod error;
mod format;
mod live;
mod one;
mod pixels;
mod quantize;
mod registry;
mod source;
mod spec;

pub use block::{BlockCopy, TileRows, rows_from_tiles};
pub use contain::contained;
pub use deflate::{Content, DeflateLevel, zlib_compress};
pub use error::{ImageError, Result};
pub use format::{CreateOptions, Format, ImageInput, ImageOutput, Limits};
pub use granita_base::AtomicFile;
pub use live::{Draw, PixelRect, Request, Wishes};
pub use one::split_image_name;
pub use pixels::Pixels;
pub use quantize::{Placement, Quantize};
pub use registry::{FormatFinder, FormatRegistry};
pub use source::FileSource;
pub use spec::{ImageSpec, PixelType};
