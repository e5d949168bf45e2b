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
//! | "qoi", "webp" | every kind | 8 bits, RGB and RGBA |
//! | "gif" | first image | no |
//! | "DevIL" | | "bmp", "png", "sgi" or "tga" of 8 bits, by the extension of the name |
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
//! GIF, ICO, QOI, WebP, JPEG XL, PIC, interlaced PNG, text PNM) are decoded as a whole at the first request and kept.
//! Images are encoded as a whole at `close`, except DDS, which is written as rows arrive.
//!
//! Colour profiles, animation, writing of GIF, compression to BC1 to BC7, and volumes in DDS are deliberately absent.

#![forbid(unsafe_code)]

mod cineon;
mod dds;
mod devil;
mod dpx;
mod fields;
mod film;
mod fits;
mod gif;
mod iff;
mod jpeg;
mod jpegxl;
mod pfm;
mod plain;
mod png;
mod pnm;
mod psd;
mod rla;
mod rows;
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
    ];
    all.extend(FORMATS.iter().map(|f| Arc::new(*f) as Arc<dyn Format>));
    // Radiance files have the extension of Softimage as well, and are written under it. RLA files have no mark.
    all.extend([Arc::new(SoftimageFormat) as Arc<dyn Format>, Arc::new(RlaFormat)]);
    all
}
