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
//!
//! | type | is |
//! |---|---|
//! | [`ImageSpec`], [`PixelType`] | the size, the channels and the metadata of an image |
//! | [`Pixels`] | values in the type that they are stored in |
//! | [`FormatRegistry`], [`Format`], [`Limits`] | the formats of a program, and the bounds of their readers |
//! | [`ImageInput`], [`ImageOutput`], [`CreateOptions`] | a file that is read, a file that is written |
//! | [`Quantize`] | the conversion of computed values to stored ones |
//! | [`Denoiser`] | the interface to a library that removes the noise of rendered images |
//!
//! ```
//! use granita_image::{FormatRegistry, ImageSpec, Limits, PixelType, Pixels};
//! // Halves keep their type until a caller converts them.
//! let spec = ImageSpec::new(2, 1, 3, PixelType::Half);
//! let pixels = Pixels::from_floats(spec.pixel_type, &[0.0, 0.5, 1.0, 0.25, 2.0, 65504.0]);
//! assert_eq!(pixels.get(5), 65504.0);
//! assert_eq!(pixels.plane(1, spec.nchannels()).to_floats(), [0.5, 2.0]);
//! // A registry without formats opens nothing. `granita_plugin::bundled_formats` returns one with all of the suite.
//! let error = FormatRegistry::new(Limits::default()).open("Cargo.toml".as_ref()).err();
//! assert!(error.is_some_and(|error| error.to_string().contains("not an image of a known format")));
//! ```

#![forbid(unsafe_code)]
#![warn(unnameable_types)]

mod block;
pub mod color;
mod contain;
mod deflate;
mod denoise;
mod error;
mod format;
mod live;
pub mod metadata;
mod one;
mod pixels;
mod quantize;
mod registry;
mod source;
mod spec;

pub use block::{BlockCopy, TileRows, rows_from_tiles};
pub use contain::contained;
pub use deflate::{Content, DeflateLevel, zlib_compress};
pub use denoise::{Denoiser, NoisyImage};
pub use error::{ImageError, Result};
pub use format::{CreateOptions, DeepSamples, Format, ImageInput, ImageOutput, Limits};
pub use granita_base::AtomicFile;
pub use live::{Draw, PixelRect, Request, Wishes};
pub use one::split_image_name;
pub use pixels::Pixels;
pub use quantize::{Placement, Quantize};
pub use registry::{FormatFinder, FormatRegistry};
pub use source::FileSource;
pub use spec::{ImageSpec, PixelType, is_about_colors};
