//! TIFF: the suite's own format for textures, shadow maps and rendered images.
//!
//! **Reading.** These are read:
//! - 1, 2, 4, 8 to 16 and 32-bit unsigned integers (values of fewer than 8 bits, and palettes, become 8-bit values, and
//!   those of 9 to 15 bits 16-bit values), and 16 and 32-bit floats, with any number of channels
//! - signed integers and 64-bit values, which become floats of the same number
//! - strips and tiles, in one plane or one per channel
//! - uncompressed data, and LZW, deflate, PackBits, Zstandard, LZMA, JPEG, WebP and CCITT, with all three predictors
//! - both byte orders, both orders of bits, and 32-bit and 64-bit offsets ("BigTIFF")
//! - CMYK, YCbCr and CIE L*a*b*, which become RGB (module `colors`), and LogLuv, which becomes floats of RGB
//!
//! The crate `tiff` decodes signed integers, 64-bit values and group 4. One strip or tile at a time is passed to it as
//! a file of its own (module `strip_file`).
//!
//! **Writing.** Unsigned integers of 8, 16 and 32 bits and floats are written in little-endian, in strips or tiles, in
//! one plane or one per channel, uncompressed or with LZW, deflate or PackBits. Offsets have 64 bits only where needed.
//!
//! **Levels.** A file is a chain of directories. A directory that holds the same kind of pixels at half the size is a
//! MIP level of the image before it, and so is any not larger one in a file with a texture format tag (reference
//! 9.2.1). Others are further images.
//!
//! **Tags of textures** (reference 9.2) appear as the attributes `textureformat`, `wrapmodes`, `fovcot`,
//! `worldtoscreen` and `worldtocamera` of [`ImageSpec`]. The size of the display window, or of a cube face, is in its
//! `full_width` and `full_height`.
//!
//! **Attributes when writing** (reference 7.4.1): `compression` ("none", "lzw", "zip" or "deflate", and "packbits"; the
//! default is "zip"; deflate accepts a level from 1 to 12, as "zip:9"), `rowsperstrip` (default 32), `planarconfig`,
//! `ImageDescription`, `DocumentName`, `Artist`, `copyright` (or `owner`), `software`, `DateTime`, `Make`, `Model`,
//! `HostComputer`, `XMP`, the attributes of Exif and IPTC ([`granita_image::metadata`]), `XResolution`, `YResolution`,
//! `ResolutionUnit` ("in", "cm" or "none"), `orientation`, and `bigtiff` (int; 1 requests 64-bit offsets). A date is
//! written only when it is given, so that the same image results in the same bytes.
//!
//! # Invariants
//!
//! - One tile is read by one positioned read, from any thread, without reading the rest.
//! - Memory is allocated by the numbers of a header only after they are checked against limits and file size.
//!
//! Deliberately absent are LERC, JPEG 2000, the JPEG of 1992, ITU L*a*b*, values of other sizes (24 bits),
//! complex values, and names of channels. TIFF cannot store names of channels, so they are read as "R", "G", "B", "A",
//! "channel4" ...
//!
//! ```
//! use granita_image::{CreateOptions, Format, ImageSpec, Limits, PixelType, Pixels};
//! use granita_tiff::TiffFormat;
//! # fn main() -> granita_image::Result<()> {
//! # let folder = tempfile::tempdir().unwrap();
//! # let path = folder.path().join("grey.tif");
//! let spec = ImageSpec::new(20, 10, 1, PixelType::Float).tiled(16, 16);
//! let mut file = TiffFormat.create(&path, &CreateOptions::new(&spec, 1))?;
//! file.write_rows(&Pixels::Float(vec![0.5; 200]))?;
//! file.close()?;
//! let file = TiffFormat.open(&path, &Limits::default())?;
//! assert_eq!(file.read_tile(0, 0, 1, 0)?.get(3), 0.5);
//! # Ok(())
//! # }
//! ```

#![forbid(unsafe_code)]
#![warn(unnameable_types)]

mod codec;
mod colors;
mod directory;
mod fax;
mod field;
mod input;
mod jpeg;
mod level;
mod logluv;
mod logluv24;
mod output;
mod settings;
mod strip_file;
mod tags;
mod webp;

pub use input::TiffInput;
pub use output::TiffOutput;

use granita_base::{BaseType, Files, Param, ParamType};
use granita_image::{CreateOptions, Format, ImageInput, ImageOutput, ImageSpec, Limits, PixelType, Result};
use std::path::Path;

/// The format "tiff".
#[derive(Clone, Copy, Debug, Default)]
pub struct TiffFormat;

impl Format for TiffFormat {
    fn name(&self) -> &'static str {
        "tiff"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["tif", "tiff", "tx", "tex", "env"]
    }

    fn recognizes(&self, head: &[u8]) -> bool {
        directory::Layout::of(head).is_some()
    }

    fn open(&self, path: &Path, limits: &Limits) -> Result<Box<dyn ImageInput>> {
        Ok(Box::new(TiffInput::open(path, limits)?))
    }

    fn supports(&self, feature: &str) -> bool {
        matches!(
            feature,
            "write" | "tiles" | "levels" | "half" | "float" | "u16" | "u32" | "channels" | "alpha" | "images"
        )
    }

    fn create(&self, path: &Path, options: &CreateOptions<'_>) -> Result<Box<dyn ImageOutput>> {
        Ok(Box::new(TiffOutput::create(path, options)?))
    }

    fn create_images(&self, path: &Path, specs: &[ImageSpec], files: &Files) -> Result<Box<dyn ImageOutput>> {
        Ok(Box::new(TiffOutput::create_pages(path, specs, files)?))
    }
}

/// The format "shadow" (reference 7.4.2), which is a TIFF of floats in tiles, marked as a shadow map. The matrices are
/// the attributes `worldtocamera` and `worldtoscreen` of the spec.
///
/// Specs are completed. Tiles are 64 x 64 where the spec has none. The texture format is "Shadow" ("Volume Shadow" from
/// 4 channels on) where the spec names none. Rows are accepted as well as tiles.
#[derive(Clone, Copy, Debug, Default)]
pub struct ShadowFormat;

impl ShadowFormat {
    fn adapted(spec: &ImageSpec) -> ImageSpec {
        let mut spec = spec.clone();
        if !spec.is_tiled() {
            spec = spec.tiled(64, 64);
        }
        if spec.string("textureformat").is_none() {
            let kind = if spec.nchannels() >= 4 { "Volume Shadow" } else { "Shadow" };
            let ty = ParamType::of(BaseType::String);
            spec.attributes.set(Param { name: "textureformat".into(), ty, data: kind.into() });
        }
        spec
    }
}

impl Format for ShadowFormat {
    fn name(&self) -> &'static str {
        "shadow"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["sm", "shd", "shad"]
    }

    /// Always returns false, because the files are TIFF files.
    fn recognizes(&self, _head: &[u8]) -> bool {
        false
    }

    fn open(&self, path: &Path, limits: &Limits) -> Result<Box<dyn ImageInput>> {
        TiffFormat.open(path, limits)
    }

    fn supports(&self, feature: &str) -> bool {
        matches!(feature, "write" | "tiles" | "levels" | "float" | "channels")
    }

    fn output_type(&self, _quantized: PixelType) -> PixelType {
        PixelType::Float
    }

    fn create(&self, path: &Path, options: &CreateOptions<'_>) -> Result<Box<dyn ImageOutput>> {
        if options.spec.pixel_type != PixelType::Float {
            let what = format!("a shadow map holds floats, not {:?}", options.spec.pixel_type);
            return Err(granita_image::ImageError::Misuse { path: path.to_owned(), what });
        }
        let spec = Self::adapted(options.spec);
        TiffFormat.create(path, &CreateOptions::new(&spec, options.levels))
    }
}
