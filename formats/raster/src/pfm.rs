//! PFM: floats, grey or RGB, rows from the bottom (Debevec, "PFM Portable FloatMap Image Format").

use crate::whole::{Place, WholeInput, WholeOutput};
use granita_image::{
    AtomicFile, CreateOptions, Format, ImageError, ImageInput, ImageOutput, ImageSpec, Limits, PixelType,
    Pixels, Result,
};
use std::io::{Read, Write};
use std::path::Path;

/// The format "pfm".
#[derive(Clone, Copy, Debug, Default)]
pub struct PfmFormat;

impl Format for PfmFormat {
    fn name(&self) -> &'static str {
        "pfm"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["pfm"]
    }

    fn recognizes(&self, head: &[u8]) -> bool {
        matches!(head, [b'P', b'F' | b'f', space, ..] if space.is_ascii_whitespace())
    }

    fn open(&self, path: &Path, limits: &Limits) -> Result<Box<dyn ImageInput>> {
        let place = Place::new(path, "PFM", limits);
        let header = Header::read(&place, &mut place.source()?)?;
        let spec = ImageSpec::new(header.width, header.height, header.channels, PixelType::Float);
        Ok(Box::new(WholeInput::new("pfm", place, spec, decode)?))
    }

    fn supports(&self, feature: &str) -> bool {
        matches!(feature, "write" | "float")
    }

    fn output_type(&self, _quantized: PixelType) -> PixelType {
        PixelType::Float
    }

    fn create(&self, path: &Path, options: &CreateOptions<'_>) -> Result<Box<dyn ImageOutput>> {
        let (n, pixel_type) = (options.spec.nchannels(), options.spec.pixel_type);
        if pixel_type != PixelType::Float || !matches!(n, 1 | 3) {
            let what = format!("PFM holds 1 or 3 channels of floats, not {n} of {pixel_type:?}");
            return Err(ImageError::Unsupported { path: path.to_owned(), what });
        }
        Ok(Box::new(WholeOutput::create(path, options.spec, encode)?))
    }
}

struct Header {
    width: u32,
    height: u32,
    channels: usize,
    big_endian: bool,
}

impl Header {
    /// Reads the header and leaves the source at the first row.
    fn read(place: &Place, source: &mut impl Read) -> Result<Self> {
        let mut words = Vec::with_capacity(4);
        for what in ["the mark", "the width", "the height", "the scale"] {
            words.push(
                word(source)
                    .map_err(|e| place.io(e))?
                    .ok_or_else(|| place.malformed(format!("{what} is longer than any number")))?,
            );
        }
        let side = |text: &str| -> Result<u32> {
            text.parse().map_err(|_| place.malformed(format!("\"{text}\" is no size")))
        };
        let scale: f32 = words[3]
            .parse()
            .ok()
            .filter(|s: &f32| s.is_finite() && *s != 0.0)
            .ok_or_else(|| place.malformed(format!("\"{}\" is no scale", words[3])))?;
        Ok(Self {
            width: side(&words[1])?,
            height: side(&words[2])?,
            channels: if words[0] == "PF" { 3 } else { 1 },
            big_endian: scale > 0.0,
        })
    }
}

/// The next word, and the one blank behind it; `None` when it is longer than 32 bytes.
fn word(source: &mut impl Read) -> std::io::Result<Option<String>> {
    let mut word = String::new();
    loop {
        let mut byte = [0];
        source.read_exact(&mut byte)?;
        match byte[0] {
            b if b.is_ascii_whitespace() => {
                if !word.is_empty() {
                    return Ok(Some(word));
                }
            }
            _ if word.len() >= 32 => return Ok(None),
            b => word.push(char::from(b)),
        }
    }
}

fn decode(place: &Place, spec: &ImageSpec) -> Result<Pixels> {
    let mut source = place.source()?;
    let header = Header::read(place, &mut source)?;
    let row = spec.width as usize * spec.nchannels();
    let n = row * spec.height as usize;
    let mut bytes = Vec::new();
    source.take(n as u64 * 4).read_to_end(&mut bytes).map_err(|e| place.io(e))?;
    if bytes.len() < n * 4 {
        return Err(place.malformed(format!("{} of {} bytes of pixels", bytes.len(), n * 4)));
    }
    let upward = Pixels::from_bytes(PixelType::Float, bytes, header.big_endian);
    let mut pixels = Pixels::zeros(PixelType::Float, n);
    for y in 0..spec.height as usize {
        pixels.copy_from(y * row, &upward, (spec.height as usize - 1 - y) * row, row);
    }
    Ok(pixels)
}

fn encode(spec: &ImageSpec, pixels: Pixels, file: &mut AtomicFile) -> Result<()> {
    let row = spec.width as usize * spec.nchannels();
    let mark = if spec.nchannels() == 3 { "PF" } else { "Pf" };
    let mut bytes = format!("{mark}\n{} {}\n-1.0\n", spec.width, spec.height).into_bytes();
    for row in pixels.to_floats().chunks_exact(row).rev() {
        bytes.extend(row.iter().flat_map(|v| v.to_le_bytes()));
    }
    file.write_all(&bytes).map_err(|e| file.io_error(e))
}
