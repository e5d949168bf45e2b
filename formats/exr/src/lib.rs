//! OpenEXR: floats with many named channels, in scanlines, tiles and MIP levels.
//!
//! **Reading.** Halves, floats and 32-bit integers are read (channels of different types become floats). They are in
//! scanlines, tiles or MIP levels. Of RIP maps, the levels that are reduced equally in both directions are read. A file
//! may have several parts, each an image. All compressions except HTJ2K are supported. Deep scanlines and tiles are
//! flattened; their attribute `deep` is "flattened", and [`ImageInput::deep_samples`] counts their samples.
//!
//! **Writing.** A file has one part, or several parts that are written in any order. A part has one type for all
//! channels, scanlines or tiles, and one level or (as the only part) a MIP map whose sizes are rounded down. The
//! attribute `name` is the name of a part, and `view` that of its eye.
//!
//! **Order of channels.** The format sorts channels by name. They are returned layer by layer, in each R, G, B, Y, A,
//! Z, and then the rest by name. A file that is written here in another order stores it in the attribute
//! `channelOrder`.
//!
//! **Attributes.** `worldtocamera`, `wrapmodes`, `software`, `owner` (also `copyright`, reference 7.4.4) and
//! `ImageDescription` (`comments`) are stored in the format's standard attributes, and an environment map in `envmap`.
//! Others are stored under their own names. `compression` is "none", "rle", "zip" (or "deflate", the default), "zips",
//! "piz", "pxr24", "b44", "b44a", "dwaa" or "dwab" (both with a quality, as "dwaa:45"). "zip" and "zips" accept a level
//! from 1 to 12, as "zip:9". Attributes are written in the
//! order of their names, so that the same image results in the same bytes.
//!
//! # Invariants
//!
//! - One tile is two positioned reads (its head, its data), from any thread.
//! - Memory is allocated by the numbers of a header only after they are checked against limits and file size.
//!
//! Subsampled channels and the writing of deep pixels are deliberately absent. In the reference a
//! *rendered* image is always stored in halves (7.4.4), which [`Format::output_type`] returns. Other writers may store
//! floats.
//!
//! ```
//! use granita_exr::ExrFormat;
//! use granita_image::{CreateOptions, Format, ImageSpec, Limits, PixelType, Pixels};
//! # fn main() -> granita_image::Result<()> {
//! # let folder = tempfile::tempdir().unwrap();
//! # let path = folder.path().join("normals.exr");
//! let mut spec = ImageSpec::new(4, 2, 3, PixelType::Half);
//! spec.channels = ["N.X", "N.Y", "N.Z"].map(String::from).to_vec();
//! let mut file = ExrFormat.create(&path, &CreateOptions::new(&spec, 1))?;
//! file.write_rows(&Pixels::from_floats(PixelType::Half, &[0.0, 0.0, 1.0].repeat(8)))?;
//! file.close()?;
//! let file = ExrFormat.open(&path, &Limits::default())?;
//! assert_eq!(file.spec(0, 0).map(|spec| spec.channels.join(" ")).as_deref(), Some("N.X N.Y N.Z"));
//! assert_eq!(file.read_rows(0, 0, 1, 2)?.to_floats(), [0.0, 0.0, 1.0].repeat(4));
//! # Ok(())
//! # }
//! ```

#![forbid(unsafe_code)]
#![warn(unnameable_types)]

mod attributes;
mod deep;
mod header;
mod input;
mod order;
mod output;
mod part;
mod zip;

pub use input::ExrInput;
pub use output::ExrOutput;

use exr::compression::Compression;
use granita_base::Files;
use granita_image::{
    CreateOptions, DeflateLevel, Format, ImageInput, ImageOutput, ImageSpec, Limits, PixelType, Result,
};
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
        matches!(
            feature,
            "write"
                | "tiles"
                | "levels"
                | "half"
                | "float"
                | "u32"
                | "channels"
                | "layers"
                | "alpha"
                | "images"
                | "parts"
        )
    }

    fn output_type(&self, _quantized: PixelType) -> PixelType {
        PixelType::Half
    }

    fn create(&self, path: &Path, options: &CreateOptions<'_>) -> Result<Box<dyn ImageOutput>> {
        Ok(Box::new(ExrOutput::create(path, options)?))
    }

    fn create_images(&self, path: &Path, specs: &[ImageSpec], files: &Files) -> Result<Box<dyn ImageOutput>> {
        Ok(Box::new(ExrOutput::create_parts(path, specs, files)?))
    }
}

/// The name of a compression, as in the attribute `compression`, and its quality.
#[derive(Clone, Copy, Debug)]
struct CompressionName(&'static str, Option<f32>);

/// The default level of deflate, which is that of OpenEXR's own library since 3.1.3.
const OPENEXR_LEVEL: u8 = 4;

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

    /// Returns the compression of a word, and the level of deflate. `Err` says why it cannot be written.
    fn parse(word: &str) -> std::result::Result<(Compression, DeflateLevel), String> {
        let lower = word.to_ascii_lowercase();
        let (name, level) = DeflateLevel::split(&lower)?;
        let unsupported = || format!("OpenEXR compression \"{word}\" is not supported");
        let (name, quality) = match name.split_once(':') {
            Some((name @ ("dwaa" | "dwab"), quality)) => {
                let quality = quality.parse().ok().filter(|q: &f32| q.is_finite() && *q >= 0.0);
                (name, Some(quality.ok_or_else(unsupported)?))
            }
            _ => (name, None),
        };
        let compression = match name {
            "dwaa" => Compression::DWAA(quality),
            "dwab" => Compression::DWAB(quality),
            "none" => Compression::Uncompressed,
            "rle" => Compression::RLE,
            "zip" | "deflate" => Compression::ZIP16,
            "zips" => Compression::ZIP1,
            "piz" => Compression::PIZ,
            "pxr24" => Compression::PXR24,
            "b44" => Compression::B44,
            "b44a" => Compression::B44A,
            _ => return Err(unsupported()),
        };
        Ok((compression, level.or(DeflateLevel::new(OPENEXR_LEVEL)).unwrap_or_default()))
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
