//! Writes DDS files, with rows in the order of arrival.

use crate::whole::divide_by_alpha;
use granita_image::{
    AtomicFile, CreateOptions, ImageError, ImageOutput, ImageSpec, PixelType, Pixels, Result,
};
use std::io::Write;
use std::path::Path;

/// A DDS file that is being written. It is uncompressed, and has one image with its levels.
pub(super) struct DdsOutput {
    file: AtomicFile,
    spec: ImageSpec,
    levels: usize,
    level: usize,
    next_y: u32,
}

/// Returns the number of the enumeration `DXGI_FORMAT` for pixels that the older header cannot describe.
fn dxgi(pixel_type: PixelType, n: usize) -> Option<u32> {
    Some(match (pixel_type, n) {
        (PixelType::U16, 1) => 56,
        (PixelType::U16, 2) => 35,
        (PixelType::U16, 4) => 11,
        (PixelType::Half, 1) => 54,
        (PixelType::Half, 2) => 34,
        (PixelType::Half, 4) => 10,
        (PixelType::Float, 1) => 41,
        (PixelType::Float, 2) => 16,
        (PixelType::Float, 3) => 6,
        (PixelType::Float, 4) => 2,
        _ => return None,
    })
}

impl DdsOutput {
    pub(super) fn create(path: &Path, options: &CreateOptions<'_>) -> Result<Self> {
        let spec = options.spec;
        let n = spec.nchannels();
        let number = dxgi(spec.pixel_type, n);
        let refuse = |what: String| Err(ImageError::Unsupported { path: path.to_owned(), what });
        if number.is_none() && !(spec.pixel_type == PixelType::U8 && (1..=4).contains(&n)) {
            return refuse(format!("DDS does not hold {n} channels of {:?} values", spec.pixel_type));
        }
        if !matches!(spec.string("compression"), None | Some("none")) {
            let word = spec.string("compression").unwrap_or_default();
            return refuse(format!("DDS compression \"{word}\" is only read, not written"));
        }
        if spec.is_tiled() || spec.width == 0 || spec.height == 0 {
            let what = format!("an image of {} x {} pixels, or in tiles", spec.width, spec.height);
            return Err(ImageError::Misuse { path: path.to_owned(), what });
        }
        let most = 32 - spec.width.max(spec.height).leading_zeros() as usize;
        if options.levels > most {
            let what = format!("{} levels of an image that has at most {most}", options.levels);
            return Err(ImageError::Misuse { path: path.to_owned(), what });
        }
        let mut file = options.files.create(path)?;
        file.write_all(&header(spec, options.levels, number)).map_err(|e| file.io_error(e))?;
        Ok(Self { file, spec: spec.clone(), levels: options.levels.max(1), level: 0, next_y: 0 })
    }

    fn misuse(&self, what: String) -> ImageError {
        ImageError::Misuse { path: self.file.path().to_owned(), what }
    }

    fn check_complete(&self) -> Result<()> {
        let missing = self.spec.height - self.next_y;
        if missing == 0 {
            return Ok(());
        }
        let (level, height) = (self.level, self.spec.height);
        Err(self.misuse(format!("level {level} is incomplete: {missing} of {height} rows are missing")))
    }
}

/// Returns the header, and the second one where the format needs it.
fn header(spec: &ImageSpec, levels: usize, number: Option<u32>) -> Vec<u8> {
    let n = spec.nchannels() as u32;
    let pitch = spec.width.saturating_mul(n).saturating_mul(spec.pixel_type.bytes() as u32);
    let mipmapped = levels > 1;
    let mut words = [0u32; 31];
    words[0] = 124;
    // The flags declare the sizes, the pixel format, the bytes of a row, and levels when they exist.
    words[1] = 0x100f | if mipmapped { 0x2_0000 } else { 0 };
    (words[2], words[3], words[4]) = (spec.height, spec.width, pitch);
    words[6] = if mipmapped { levels as u32 } else { 0 };
    words[18] = 32;
    match (number, n) {
        (Some(_), _) => {
            words[19] = 4;
            words[20] = u32::from_le_bytes(*b"DX10");
        }
        (None, 1 | 2) => {
            words[19] = 0x2_0000 | (n - 1);
            (words[21], words[22], words[25]) = (8 * n, 0xff, if n == 2 { 0xff00 } else { 0 });
        }
        (None, _) => {
            words[19] = 0x40 | (n - 3);
            words[21] = 8 * n;
            (words[22], words[23], words[24]) = (0xff, 0xff00, 0xff_0000);
            words[25] = if n == 4 { 0xff00_0000 } else { 0 };
        }
    }
    words[26] = 0x1000 | if mipmapped { 0x40_0008 } else { 0 };
    let mut bytes = b"DDS ".to_vec();
    bytes.extend(words.iter().flat_map(|w| w.to_le_bytes()));
    if let Some(number) = number {
        // The mode of alpha is 1 for colours that are not multiplied by it, and 2 for those that are.
        let straight = spec.attributes.int("unassociatedalpha").unwrap_or(0) != 0;
        let alpha = if spec.alpha_channel().is_none() { 0 } else { 2 - u32::from(straight) };
        bytes.extend([number, 3, 0, 1, alpha].iter().flat_map(|w| w.to_le_bytes()));
    }
    bytes
}

impl ImageOutput for DdsOutput {
    fn write_rows(&mut self, pixels: &Pixels) -> Result<()> {
        let spec = &self.spec;
        if pixels.pixel_type() != spec.pixel_type {
            let (got, wanted) = (pixels.pixel_type(), spec.pixel_type);
            return Err(self.misuse(format!("pixels of type {got:?} for a file of {wanted:?}")));
        }
        let row = spec.width as usize * spec.nchannels();
        let left = spec.height - self.next_y;
        if !pixels.len().is_multiple_of(row) || pixels.len() / row > left as usize {
            let n = pixels.len();
            return Err(self.misuse(format!(
                "{n} values are no whole rows of {row}, or more than the {left} rows left"
            )));
        }
        let n = spec.nchannels();
        let straight = spec.attributes.int("unassociatedalpha").unwrap_or(0) != 0;
        let mut bytes = Vec::with_capacity(pixels.len() * spec.pixel_type.bytes());
        if spec.pixel_type == PixelType::U8 && matches!(n, 2 | 4) && !straight {
            let mut divided = pixels.clone();
            divide_by_alpha(&mut divided, n);
            divided.append_le_bytes(&mut bytes);
        } else {
            pixels.append_le_bytes(&mut bytes);
        }
        self.next_y += (pixels.len() / row) as u32;
        self.file.write_all(&bytes).map_err(|e| self.file.io_error(e).into())
    }

    fn write_tile(&mut self, _tx: u32, _ty: u32, _pixels: &Pixels) -> Result<()> {
        Err(self.misuse("this format does not store tiles".to_owned()))
    }

    fn next_level(&mut self, spec: &ImageSpec) -> Result<()> {
        self.check_complete()?;
        let size = ((self.spec.width / 2).max(1), (self.spec.height / 2).max(1));
        if self.level + 1 >= self.levels {
            return Err(self.misuse(format!("there is no level after level {}", self.level)));
        }
        if (spec.width, spec.height) != size
            || spec.nchannels() != self.spec.nchannels()
            || spec.pixel_type != self.spec.pixel_type
            || spec.is_tiled()
        {
            return Err(self.misuse(format!(
                "level {} is {} x {}; DDS needs rows of {} x {} and the same channels",
                self.level + 1,
                spec.width,
                spec.height,
                size.0,
                size.1
            )));
        }
        (self.spec, self.next_y) = (spec.clone(), 0);
        self.level += 1;
        Ok(())
    }

    fn close(self: Box<Self>) -> Result<()> {
        self.check_complete()?;
        if self.level + 1 < self.levels {
            let level = self.level + 1;
            return Err(self.misuse(format!("level {level} and those after it are missing")));
        }
        Ok(self.file.commit()?)
    }
}
