//! OpenEXR: floats with many named channels, in scanlines, tiles and MIP levels.
//!
//! Read are halves, floats and 32-bit integers (channels of different types become floats); scanlines, tiles, MIP
//! levels, of RIP maps those reduced equally in both directions; several parts, each an image; all compressions
//! except HTJ2K. Written are one part, one type for all channels, scanlines or tiles, one level or a MIP map that
//! halves downward.
//!
//! **Order of channels.** The format sorts channels by name. They are given out layer by layer, in each R,
//! G, B, Y, A, Z, then the rest by name. A file written here in another order keeps it in the attribute
//! `channelOrder`.
//!
//! **Attributes.** `worldtocamera`, `wrapmodes`, `software`, `owner` (also `copyright`, reference 7.4.4)
//! and `ImageDescription` (`comments`) are stored in the format's standard attributes, an environment map in
//! `envmap`; others under their own names. `compression` is "none", "rle", "zip" (or "deflate", the
//! default), "zips", "piz", "pxr24", "b44", "b44a", "dwaa" or "dwab" (both with a quality, as "dwaa:45").
//! Attributes are written in the order of their names: the same picture gives the same bytes.
//!
//! Invariants: one tile is two positioned reads (its head, its data), from any thread; nothing is allocated
//! on the word of a header before it is checked against limits and file size.
//!
//! Deliberately absent: deep pixels, subsampled channels, writing of several parts. In the reference a *rendered*
//! image is always stored in halves (7.4.4), which [`Format::output_type`] returns. Other writers may store floats.

#![forbid(unsafe_code)]

mod attributes;
mod input;
mod order;
mod output;
mod zip;

pub use input::ExrInput;
pub use output::ExrOutput;

use exr::compression::Compression;
use granita_image::{CreateOptions, Format, ImageInput, ImageOutput, Limits, PixelType, Result};
use order::Order;
use std::fmt;
use std::path::Path;

/// The format "exr", also called "OpenEXR".
#[derive(Clone, Copy, Debug, Default)]
pub struct ExrFormat;

impl Format for ExrFormat {
    fn name(&self) -> &'static str {
        "exr"
    }

    fn aliases(&self) -> &'static [&'static str] {
        &["OpenEXR"]
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["exr"]
    }

    fn recognizes(&self, head: &[u8]) -> bool {
        head.starts_with(&[0x76, 0x2f, 0x31, 0x01])
    }

    fn open(&self, path: &Path, limits: &Limits) -> Result<Box<dyn ImageInput>> {
        Ok(Box::new(ExrInput::open(path, limits)?))
    }

    fn supports(&self, feature: &str) -> bool {
        matches!(feature, "write" | "tiles" | "levels" | "half" | "float" | "u32" | "channels" | "alpha")
    }

    fn output_type(&self, _quantized: PixelType) -> PixelType {
        PixelType::Half
    }

    fn create(&self, path: &Path, options: &CreateOptions<'_>) -> Result<Box<dyn ImageOutput>> {
        Ok(Box::new(ExrOutput::create(path, options)?))
    }
}

/// Names of compressions, as the attribute `compression` has them.
#[derive(Clone, Copy, Debug)]
struct CompressionName(&'static str, Option<f32>);

impl CompressionName {
    fn of(compression: Compression) -> Self {
        match compression {
            Compression::Uncompressed => Self("none", None),
            Compression::RLE => Self("rle", None),
            Compression::ZIP1 => Self("zips", None),
            Compression::ZIP16 => Self("zip", None),
            Compression::PIZ => Self("piz", None),
            Compression::PXR24 => Self("pxr24", None),
            Compression::B44 => Self("b44", None),
            Compression::B44A => Self("b44a", None),
            Compression::DWAA(level) => Self("dwaa", level),
            Compression::DWAB(level) => Self("dwab", level),
            Compression::HTJ2K32 => Self("htj2k32", None),
            Compression::HTJ2K256 => Self("htj2k256", None),
        }
    }

    /// The compression that a word names, if it can be written.
    fn parse(word: &str) -> Option<Compression> {
        let word = word.to_ascii_lowercase();
        let (name, level) = match word.split_once(':') {
            Some((name, level)) => {
                (name, Some(level.parse().ok().filter(|l: &f32| l.is_finite() && *l >= 0.0)?))
            }
            None => (&*word, None),
        };
        Some(match (name, level) {
            ("dwaa", _) => Compression::DWAA(level),
            ("dwab", _) => Compression::DWAB(level),
            (_, Some(_)) => return None,
            ("none", _) => Compression::Uncompressed,
            ("rle", _) => Compression::RLE,
            ("zip" | "deflate", _) => Compression::ZIP16,
            ("zips", _) => Compression::ZIP1,
            ("piz", _) => Compression::PIZ,
            ("pxr24", _) => Compression::PXR24,
            ("b44", _) => Compression::B44,
            ("b44a", _) => Compression::B44A,
            _ => return None,
        })
    }
}

impl fmt::Display for CompressionName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.1 {
            Some(level) => write!(f, "{}:{level}", self.0),
            None => f.write_str(self.0),
        }
    }
}
