//! Pixels and files without knowing a format.
//!
//! A format crate implements [`Format`]; a [`FormatRegistry`] collects formats, opens files **by
//! content** (the extension only breaks ties) and creates files by name. Everything above (textures,
//! renderer, tools) speaks [`ImageInput`] and [`ImageOutput`] only.
//!
//! Invariants:
//! - readers check [`Limits`] before they allocate, and take `&self`: one open file serves many threads;
//! - a written file appears under its name complete, at [`ImageOutput::close`], or not at all;
//! - values keep their stored type ([`Pixels`]); only the caller converts.
//!
//! Deliberately absent: colour management, image processing, any particular format.

#![forbid(unsafe_code)]

mod block;
mod contain;
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
