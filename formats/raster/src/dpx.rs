//! DPX (SMPTE 268M-2003, "File Format for Digital Moving-Picture Exchange").

mod header;
mod output;

use crate::film::FilmRows;
use crate::rows::RowsInput;
use crate::whole::WholeOutput;
use granita_image::{
    CreateOptions, FileSource, Format, ImageError, ImageInput, ImageOutput, Limits, PixelType, Result,
};
use std::path::Path;

/// The format "dpx", of which each image element is an image.
///
/// Values are those of the file. No transfer function is applied: "dpx:Transfer" and "dpx:Colorimetric" are its names.
/// 10 and 12 bits become 16 bits whose high bits are repeated as the low ones, and `int BitsPerSample` is their number.
/// Fields of the header are attributes, with the names that OpenImageIO gives them.
///
/// Written are 8 and 16 bits, and of 16 bits the upper 10 or 12 where `int BitsPerSample` says so.
#[derive(Clone, Copy, Debug, Default)]
pub struct DpxFormat;

impl Format for DpxFormat {
    fn name(&self) -> &'static str {
        "dpx"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["dpx"]
    }

    fn recognizes(&self, head: &[u8]) -> bool {
        head.starts_with(b"SDPX") || head.starts_with(b"XPDS")
    }

    fn open(&self, path: &Path, limits: &Limits) -> Result<Box<dyn ImageInput>> {
        let source = FileSource::open(path, "DPX", &limits.files)?;
        let (specs, elements) = header::read(&source, limits)?;
        let images = specs.into_iter().map(|spec| vec![spec]).collect();
        Ok(Box::new(RowsInput::new("dpx", "DPX", source, limits, images, FilmRows(elements))?))
    }

    fn supports(&self, feature: &str) -> bool {
        matches!(feature, "write" | "u16" | "alpha")
    }

    fn create(&self, path: &Path, options: &CreateOptions<'_>) -> Result<Box<dyn ImageOutput>> {
        let spec = options.spec;
        let fault = if !matches!(spec.pixel_type, PixelType::U8 | PixelType::U16) {
            format!("DPX holds 8 to 16-bit integers here, not {:?}", spec.pixel_type)
        } else if !matches!(spec.nchannels(), 1 | 3 | 4) {
            format!("DPX holds 1, 3 or 4 channels here, not {}", spec.nchannels())
        } else if spec.pixel_type == PixelType::U16 && !matches!(output::bits(spec), 10 | 12 | 16) {
            format!("DPX holds 8, 10, 12 or 16 bits per sample, not {}", output::bits(spec))
        } else {
            return Ok(Box::new(WholeOutput::create(path, options, output::encode)?));
        };
        Err(ImageError::Unsupported { path: path.to_owned(), what: fault })
    }
}
