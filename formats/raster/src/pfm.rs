//! PFM, which stores floats, grey or RGB, with rows from the bottom (Debevec, "PFM Portable FloatMap Image Format").

use crate::rows::{PlainRows, RowsInput, ends_early};
use crate::whole::WholeOutput;
use granita_image::{
    AtomicFile, CreateOptions, FileSource, Format, ImageError, ImageInput, ImageOutput, ImageSpec, Limits,
    PixelType, Pixels, Result,
};
use std::io::Write;
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
        let source = FileSource::open(path, "PFM", &limits.files)?;
        // The header has four words of at most 32 bytes, separated by blanks.
        let head = source.read_vec(0, source.len().min(256), "the header")?;
        let (header, at) = Header::read(&source, &head)?;
        let spec = ImageSpec::new(header.width, header.height, header.channels, PixelType::Float);
        let end = spec.bytes().and_then(|b| b.checked_add(at));
        if end.is_none_or(|end| end > source.len()) {
            limits.check(path, "PFM", &spec)?;
            ends_early(&source, &spec, at)?;
        }
        let rows = PlainRows { at, big_endian: header.big_endian, upward: true };
        Ok(Box::new(RowsInput::new("pfm", "PFM", source, limits, vec![vec![spec]], rows)?))
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
        Ok(Box::new(WholeOutput::create(path, options, encode)?))
    }
}

struct Header {
    width: u32,
    height: u32,
    channels: usize,
    big_endian: bool,
}

impl Header {
    /// Returns the header, and its end.
    fn read(source: &FileSource, head: &[u8]) -> Result<(Self, u64)> {
        let mut words: [&str; 4] = [""; 4];
        let mut at = 0;
        for (word, what) in words.iter_mut().zip(["the mark", "the width", "the height", "the scale"]) {
            at += head[at..].iter().take_while(|b| b.is_ascii_whitespace()).count();
            let len = head[at..].iter().take_while(|b| !b.is_ascii_whitespace()).count();
            let text = std::str::from_utf8(&head[at..at + len]).ok().filter(|t| (1..=32).contains(&t.len()));
            *word = text.ok_or_else(|| source.malformed(format!("{what} is not a word")))?;
            at += len;
        }
        let side = |text: &str| -> Result<u32> {
            text.parse().map_err(|_| source.malformed(format!("\"{text}\" is not a valid size")))
        };
        let scale: f32 = words[3]
            .parse()
            .ok()
            .filter(|s: &f32| s.is_finite() && *s != 0.0)
            .ok_or_else(|| source.malformed(format!("\"{}\" is not a valid scale", words[3])))?;
        let header = Self {
            width: side(words[1])?,
            height: side(words[2])?,
            channels: if words[0] == "PF" { 3 } else { 1 },
            big_endian: scale > 0.0,
        };
        // One blank follows the scale.
        Ok((header, at as u64 + 1))
    }
}

fn encode(spec: &ImageSpec, pixels: Pixels, file: &mut AtomicFile) -> Result<()> {
    let row = spec.width as usize * spec.nchannels();
    let mark = if spec.nchannels() == 3 { "PF" } else { "Pf" };
    let mut bytes = format!("{mark}\n{} {}\n-1.0\n", spec.width, spec.height).into_bytes();
    for row in pixels.to_floats().chunks_exact(row).rev() {
        bytes.extend(row.iter().flat_map(|v| v.to_le_bytes()));
    }
    file.write_all(&bytes).map_err(|e| file.io_error(e).into())
}
