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

mod error;
mod format;
mod pixels;
mod spec;

pub use error::{ImageError, Result};
pub use format::{CreateOptions, Format, FormatRegistry, ImageInput, ImageOutput, Limits};
pub use pixels::Pixels;
pub use spec::{ImageSpec, PixelType};
