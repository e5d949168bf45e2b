//! Plain images with rows and without tiles. Only DDS has levels. DDS, DPX, PSD, FITS and RLA have several images.
//!
//! | format | read | written |
//! |---|---|---|
//! | "png" | every kind | 8 and 16 bits, 1 to 4 channels |
//! | "jpeg" | grey, RGB, CMYK; rotated upright by its Exif data | 8 bits, grey and RGB; alpha is left out |
//! | "tga" | every kind | 8 bits; grey, RGB, RGBA |
//! | "bmp" | every kind | 8 bits; grey, RGB, RGBA |
//! | "pnm" | PBM, PGM, PPM, PAM | 8 and 16 bits, 1 to 4 channels; without alpha under the extensions ppm and pgm |
//! | "pfm" | grey, RGB | floats, grey and RGB |
//! | "hdr" | RGBE | RGBE (9 bits of each colour), alpha is left out |
//! | "sgi" | every kind without a colour map | 8 and 16 bits, any number of channels |
//! | "iff" (Maya) | 8 and 16 bits, floats, RGB, RGBA, depth | the same; floats with depth |
//! | "dds" | BC1 to BC7 and uncompressed, levels, cubes, arrays | uncompressed, levels |
//! | "dpx" | 8 to 16 bits, floats; elements are images | 8, 10, 12 and 16 bits; 1, 3 and 4 channels |
//! | "cineon" | 8 to 16 bits | no |
//! | "psd" | PSD and PSB, layers are images | no |
//! | "fits" | images of 8 to 64 bits | no |
//! | "rla" | integers and floats; concatenated files are images | no |
//! | "softimage" | PIC of 8 and 16 bits | no |
//! | "ico" | the largest image | no |
//! | "jpegxl" | grey and RGB with alpha, the first frame | without loss, 8 bits; 16 without alpha |
//! | "jpeg2000" | grey, RGB, CMYK, L*a*b*, palettes, with alpha | no |
//! | "qoi", "webp" | every kind | 8 bits, RGB and RGBA |
//! | "gif" | first image | no |
//! | "DevIL" | | "bmp", "png", "sgi" or "tga" of 8 bits, by the extension of the name |
//!
//! # Metadata
//!
//! JPEG, PNG, WebP, JPEG XL, JPEG 2000 and PSD have Exif, IPTC, XMP and ICC profiles, as far as their definitions say.
//! They become attributes ([`granita_image::metadata`]), and JPEG, PNG, WebP and JPEG XL are written with them.
//!
//! # Invariants
//!
//! Nothing is converted silently. A type or a number of channels that a format cannot store is an error at `create`.
//! Only alpha may be left out, and `supports("alpha")` is then false.
//!
//! # Memory of readers
//!
//! SGI, IFF, DDS, DPX, Cineon, PSD, FITS, RLA, PFM and binary PNM of 8 and 16 bits find any rows by their position in
//! the file. Layers of PSD that are compressed with deflate are kept. PNG that is not interlaced is decoded row after
//! row without keeping rows. A request for rows before the last ones begins again. The others (JPEG, TGA, BMP, HDR,
//! GIF, ICO, QOI, WebP, JPEG XL, JPEG 2000, PIC, interlaced PNG, text PNM) are decoded as a whole at the first request
//! and kept. Images are encoded as a whole at `close`, except DDS, which is written as rows arrive.
//!
//! Colour profiles, animation, writing of GIF, compression to BC1 to BC7, and volumes in DDS are deliberately absent.
//!
//! ```
//! use granita_image::{CreateOptions, FormatRegistry, ImageSpec, Limits, PixelType, Pixels};
//! # fn main() -> granita_image::Result<()> {
//! # let folder = tempfile::tempdir().unwrap();
//! # let path = folder.path().join("grey.png");
//! let mut formats = FormatRegistry::new(Limits::default());
//! granita_raster::formats().into_iter().for_each(|format| formats.register(format));
//! let spec = ImageSpec::new(3, 1, 1, PixelType::U16);
//! let mut file = formats.create(&path, "png", &CreateOptions::new(&spec, 1))?;
//! file.write_rows(&Pixels::U16(vec![0, 32768, 65535]))?;
//! file.close()?;
//! let file = formats.open(&path)?;
//! assert_eq!((file.format_name(), file.read_level(0, 0)?.len()), ("png", 3));
//! # Ok(())
//! # }
//! ```

#![forbid(unsafe_code)]
#![warn(unnameable_types)]

mod boxes;
mod cineon;
mod dds;
mod devil;
mod dpx;
mod fields;
mod film;
mod fits;
mod gif;
mod ico;
mod iff;
mod jpeg;
mod jpeg2000;
mod jpegxl;
mod pfm;
mod plain;
mod png;
mod pnm;
mod psd;
mod rla;
mod rows;
mod segments;
mod sgi;
mod softimage;
mod turn;
mod whole;

pub use self::cineon::CineonFormat;
pub use self::dds::DdsFormat;
pub use self::devil::DevilFormat;
pub use self::dpx::DpxFormat;
pub use self::fits::FitsFormat;
pub use self::iff::IffFormat;
pub use self::jpeg2000::Jpeg2000Format;
pub use self::jpegxl::JpegXlFormat;
pub use self::pfm::PfmFormat;
pub use self::plain::{FORMATS, PlainFormat};
pub use self::png::PngFormat;
pub use self::psd::PsdFormat;
pub use self::rla::RlaFormat;
pub use self::sgi::SgiFormat;
pub use self::softimage::SoftimageFormat;

use granita_image::Format;
use std::sync::Arc;

/// Returns all formats of this crate, in the order in which files should be tried. [`DevilFormat`] is a name for some
/// of them.
pub fn formats() -> Vec<Arc<dyn Format>> {
    let mut all: Vec<Arc<dyn Format>> = vec![
        Arc::new(PngFormat),
        Arc::new(PfmFormat),
        Arc::new(SgiFormat),
        Arc::new(IffFormat),
        Arc::new(DdsFormat),
        Arc::new(DpxFormat),
        Arc::new(CineonFormat),
        Arc::new(PsdFormat),
        Arc::new(FitsFormat),
        Arc::new(JpegXlFormat),
        Arc::new(Jpeg2000Format),
    ];
    all.extend(FORMATS.iter().map(|f| Arc::new(*f) as Arc<dyn Format>));
    // Radiance files have the extension of Softimage as well, and are written under it. RLA files have no mark.
    all.extend([Arc::new(SoftimageFormat) as Arc<dyn Format>, Arc::new(RlaFormat)]);
    all
}
