//! Operations on images of any size: the work of `imgtool`.
//!
//! An [`Image`] is a description and a [`Source`] of rows. An operation returns an image whose source reads the rows of
//! its inputs when its own rows are requested, so that a chain of operations holds some bands of rows in memory and not
//! whole images. [`write()`] requests the rows of a file from the top downward.
//!
//! | module | operations |
//! |---|---|
//! | `file` | files, their images and MIP levels |
//! | `window` | crop, cut, paste, contact sheets |
//! | `channels` | selection, order, names, sums |
//! | `color` | colour spaces |
//! | `arithmetic`, `repair` | images with images and with constants, alpha, values that are not finite |
//! | `resize`, `taps` | other sizes, blur, by the filters of `maketx -filter` |
//! | `orient` | flips, rotations by quarters |
//! | `pattern` | images from nothing, noise |
//! | `environment` | maps of all directions |
//! | `metadata`, `measure`, `sequence` | metadata; statistics and comparison; names of frames |
//!
//! # Invariants
//!
//! - The values of an image are the same, to the bit, for any number of threads and any order of requests.
//! - Operations that copy pixels (crop, channels, flips) keep their type and their bits. Others compute with floats.
//! - Colours that a file stores apart from alpha (PNG) are multiplied by it before anything is computed from them.
//! - Memory is proportional to the width of the images. The exceptions are rotations by a quarter, flips of files that
//!   are decoded from their beginning (both limited by an argument), and maps of directions, which are held.
//!
//! Formats are those of the caller's registry, and colours are converted by the processors of `granita_color`. Windows
//! and displays are deliberately absent.
//!
//! ```
//! use granita_edit::{File, Geometry, Resampling, WriteOptions, write};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let folder = tempfile::tempdir()?;
//! # let (large, small) = (folder.path().join("large.exr"), folder.path().join("small.png"));
//! # let formats = granita_plugin::bundled_formats(granita_image::Limits::default());
//! # let window = granita_edit::Window { x: 0, y: 0, width: 64, height: 32 };
//! # let pattern = granita_edit::Pattern::Constant(vec![0.25]);
//! # write(&granita_edit::pattern(pattern, &window, 3)?, &large, &formats, &WriteOptions::default())?;
//! let image = File::open(&large, &formats)?.image(0, 0)?;
//! let half = Geometry::parse("50%")?.window(&image.full())?;
//! let image = image.resized(&half, Resampling::Filter(None))?;
//! write(&image, &small, &formats, &WriteOptions::default())?;
//! # assert_eq!(File::open(&small, &formats)?.image(0, 0)?.spec().width, 32);
//! # Ok(())
//! # }
//! ```

#![forbid(unsafe_code)]

mod arithmetic;
mod channels;
mod color;
mod environment;
mod error;
mod file;
mod geometry;
mod hold;
mod image;
mod measure;
mod metadata;
mod orient;
mod pattern;
mod pointwise;
mod repair;
mod resize;
mod sequence;
mod taps;
mod window;
mod write;

pub use arithmetic::{Binary, binary, multiply_add, over};
pub use channels::{Note, append_channels};
pub use error::{EditError, Result};
pub use file::File;
pub use geometry::{Geometry, Side, numbers};
pub use image::{Image, Shape, Source, Window, float_rows};
pub use measure::{DiffLimits, Difference, Verdict, difference, statistics};
pub use metadata::attribute;
pub use orient::Turn;
pub use pattern::{Noise, Pattern, pattern};
pub use resize::{FillMode, Resampling};
pub use sequence::{FrameName, frames};
pub use window::{mosaic, paste};
pub use write::{Tiling, WriteOptions, write};
