//! Colour management by configurations of OpenColorIO, without that library.
//!
//! A [`Config`] names colour spaces, displays and views. It is built in ([`Config::built_in`], with the spaces of the
//! published configurations "cg-config" and "studio-config" for ACES), or is read from a file of OpenColorIO's versions
//! 1 and 2 ([`Config::open`]). A [`Processor`] converts pixels from one space to another, or to a view of a display.
//!
//! ```
//! use granita_color::Config;
//! let config = Config::built_in();
//! let processor = config.processor("srgb_texture", "ACEScg")?;
//! let mut pixels = [1.0, 0.5, 0.0, 1.0];
//! processor.apply(&mut pixels, 4);
//! assert!((pixels[0] - 0.6858).abs() < 1e-3);
//! let screen = config.display_processor("ACEScg", config.default_display(), "Un-tone-mapped")?;
//! screen.apply(&mut pixels, 4);
//! assert!((pixels[0] - 1.0).abs() < 1e-3 && (pixels[1] - 0.5).abs() < 1e-3);
//! # Ok::<(), granita_color::ColorError>(())
//! ```
//!
//! # Invariants
//!
//! - The bits of results are the same on every machine, for any number of threads, and for any division of an image
//!   into slices. Powers and logarithms are those of this crate.
//! - A transform of a file that is not supported is an error when a conversion needs it, and not before. One message
//!   names all such transforms of a conversion with their places.
//! - Alpha is never converted. A transform that mixes it with colours is refused.
//! - This crate reads no variable of the environment. Variables that file names contain are those of the
//!   [`granita_base::Environment`] that is passed.
//!
//! An [`Encoding`] is what the file of an image says of its colours (numbers of ITU-T H.273, ICC profiles,
//! chromaticities).
//!
//! # What is absent
//!
//! The output transforms of ACES for high dynamic range and of version 2, the transforms for grading (GradingPrimary,
//! GradingRGBCurve, GradingTone), and the inverse of tables of three dimensions. An [`Engine`], another library, makes
//! conversions that need them, with the bits that it has on a machine. Tables of GPUs and dynamic properties are not a
//! matter of this crate.

#![forbid(unsafe_code)]

mod aces;
mod config;
mod curve;
pub mod encoding;
mod engine;
mod error;
mod fixed;
mod icc;
mod lut;
mod model;
pub mod primaries;
mod processor;
mod read;
mod styles;
mod table;
mod transform;
mod yaml;

pub use config::{BUILT_IN, Config};
pub use curve::{srgb_decode, srgb_encode};
pub use encoding::{Encoding, Transfer};
pub use engine::{Conversion, Converter, Engine};
pub use error::ColorError;
pub use model::{ColorSpace, Reference};
pub use primaries::Primaries;
pub use processor::Processor;
pub use table::{Interpolation, Lut1d};
