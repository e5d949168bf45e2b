//! Files that are read and written as a whole. They are decoded at the first request, and encoded at `close`.

use granita_image::{
    AtomicFile, CreateOptions, ImageError, ImageInput, ImageOutput, ImageSpec, Limits, Pixels, Result,
};
use parking_lot::Mutex;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

/// A file whose bytes are counted as they are read.
pub(crate) type Source = BufReader<Counted>;

/// Counts the bytes that are read.
pub(crate) struct Counted {
    from: From,
    count: Arc<AtomicU64>,
}

enum From {
    File(File),
    Bytes(io::Cursor<Arc<[u8]>>),
}

impl Read for Counted {
    fn read(&mut self, buf: &mut [u8]) -> io::Result<usize> {
        let n = match &mut self.from {
            From::File(file) => file.read(buf)?,
            From::Bytes(bytes) => bytes.read(buf)?,
        };
        self.count.fetch_add(n as u64, Ordering::Relaxed);
        Ok(n)
    }
}

impl Seek for Counted {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match &mut self.from {
            From::File(file) => file.seek(to),
            From::Bytes(bytes) => bytes.seek(to),
        }
    }
}

/// A file to decode, with its path, its limits, and the reports of its errors.
pub(crate) struct Place {
    pub(crate) path: PathBuf,
    /// The name of the format in errors, for example "PNG".
    pub(crate) format: &'static str,
    pub(crate) limits: Limits,
    /// The content, when it is not that of the file at `path`.
    bytes: Option<Arc<[u8]>>,
    count: Arc<AtomicU64>,
}

impl Place {
    pub(crate) fn new(path: &Path, format: &'static str, limits: &Limits) -> Self {
        Self { path: path.to_owned(), format, limits: limits.clone(), bytes: None, count: Arc::default() }
    }

    /// Returns the place of a source in memory. `path` still names it in errors.
    pub(crate) fn with_bytes(self, bytes: Arc<[u8]>) -> Self {
        Self { bytes: Some(bytes), ..self }
    }

    /// Returns the same place with other content.
    pub(crate) fn holding(&self, bytes: Vec<u8>) -> Self {
        Self::new(&self.path, self.format, &self.limits).with_bytes(bytes.into())
    }

    /// Reads all bytes of the file.
    pub(crate) fn read_all(&self) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        self.source()?.read_to_end(&mut bytes).map_err(|e| self.io(e))?;
        Ok(bytes)
    }

    /// Returns the length of the file in bytes.
    pub(crate) fn len(&self) -> Result<u64> {
        match &self.bytes {
            Some(bytes) => Ok(bytes.len() as u64),
            None => std::fs::metadata(&self.path).map(|m| m.len()).map_err(|e| self.io(e)),
        }
    }

    /// Opens the file from its beginning.
    pub(crate) fn source(&self) -> Result<Source> {
        let counted = |from| BufReader::new(Counted { from, count: self.count.clone() });
        if let Some(bytes) = &self.bytes {
            return Ok(counted(From::Bytes(io::Cursor::new(bytes.clone()))));
        }
        let file = self.limits.files.open(&self.path).map_err(|e| self.io(e))?;
        if file.metadata().map_err(|e| self.io(e))?.is_dir() {
            return Err(self.io(io::Error::new(io::ErrorKind::IsADirectory, "is a directory")));
        }
        Ok(counted(From::File(file)))
    }

    /// Converts an error of the system. A file that ends early is malformed.
    pub(crate) fn io(&self, source: io::Error) -> ImageError {
        if matches!(source.kind(), io::ErrorKind::UnexpectedEof | io::ErrorKind::InvalidData) {
            return self.malformed(match source.kind() {
                io::ErrorKind::UnexpectedEof => "the file ends early".to_owned(),
                _ => source.to_string(),
            });
        }
        ImageError::Io { path: self.path.clone(), source }
    }

    pub(crate) fn malformed(&self, what: impl Into<String>) -> ImageError {
        ImageError::Malformed { path: self.path.clone(), format: self.format, what: what.into() }
    }

    pub(crate) fn unsupported(&self, what: impl Into<String>) -> ImageError {
        ImageError::Unsupported { path: self.path.clone(), what: what.into() }
    }

    /// Returns the number of bytes that were read so far.
    pub(crate) fn bytes_read(&self) -> u64 {
        self.count.load(Ordering::Relaxed)
    }

    pub(crate) fn misuse(&self, what: String) -> ImageError {
        ImageError::Misuse { path: self.path.clone(), what }
    }
}

/// The pixels of a file.
pub(crate) struct Decoded {
    pub(crate) pixels: Pixels,
    /// The number of available rows and the error, when not all rows are available.
    pub(crate) missing: Option<(u32, String)>,
}

impl Decoded {
    /// Returns a result in which all pixels are available.
    pub(crate) fn whole(pixels: Pixels) -> Self {
        Self { pixels, missing: None }
    }
}

/// Decodes all pixels of a file.
pub(crate) type Decode = fn(&Place, &ImageSpec) -> Result<Decoded>;

/// An open image. Its pixels are decoded all at once at the first read, and kept. Reading all of them moves them out
/// instead. Of a file that ends early the available rows can be read.
pub(crate) struct WholeInput {
    name: &'static str,
    place: Place,
    spec: ImageSpec,
    decode: Decode,
    decoded: OnceLock<Decoded>,
    /// The reason why it cannot be decoded, so that it is not tried again.
    broken: OnceLock<ImageError>,
    /// The lock that is held while decoding, so that two threads do not both do it.
    decoding: Mutex<()>,
}

impl WholeInput {
    /// Checks the size against the limits, and against the length of the file. Its codec packs at most `ratio` bytes of
    /// pixels into one byte.
    pub(crate) fn new(
        name: &'static str,
        place: Place,
        spec: ImageSpec,
        decode: Decode,
        ratio: u64,
    ) -> Result<Self> {
        place.limits.check(&place.path, place.format, &spec)?;
        let bytes = (spec.bytes().unwrap_or(u64::MAX), place.len()?);
        place.limits.check_ratio(&place.path, place.format, bytes, ratio)?;
        Ok(Self {
            name,
            place,
            spec,
            decode,
            decoded: OnceLock::new(),
            broken: OnceLock::new(),
            decoding: Mutex::new(()),
        })
    }

    /// Returns the pixels that are kept.
    fn kept(&self) -> Result<&Decoded> {
        if let Some(decoded) = self.decoded.get() {
            return Ok(decoded);
        }
        let _one_at_a_time = self.decoding.lock();
        if let Some(decoded) = self.decoded.get() {
            return Ok(decoded);
        }
        let decoded = self.decode()?;
        Ok(self.decoded.get_or_init(|| decoded))
    }

    /// Decodes the file, unless that has failed before.
    fn decode(&self) -> Result<Decoded> {
        if let Some(error) = self.broken.get().and_then(ImageError::lasting) {
            return Err(error);
        }
        self.decode_now().inspect_err(|error| {
            if let Some(error) = error.lasting() {
                let _ = self.broken.set(error);
            }
        })
    }

    fn decode_now(&self) -> Result<Decoded> {
        let spec = &self.spec;
        let bytes = self.place.limits.check_read(&self.place.path, spec, spec.width, spec.height)?;
        // The decoders keep one or two more copies of the pixels while they work.
        Limits::check_memory(&self.place.path, 3 * bytes as u64)?;
        let decoded = (self.decode)(&self.place, spec)?;
        let pixels = &decoded.pixels;
        if pixels.pixel_type() != spec.pixel_type || pixels.len() != bytes / spec.pixel_type.bytes() {
            let what = format!("its pixels are {} values, not {bytes} bytes", pixels.len());
            return Err(self.place.malformed(what));
        }
        Ok(decoded)
    }
}

impl ImageInput for WholeInput {
    fn format_name(&self) -> &'static str {
        self.name
    }

    fn levels(&self, image: usize) -> usize {
        usize::from(image == 0)
    }

    fn spec(&self, image: usize, level: usize) -> Option<&ImageSpec> {
        (image == 0 && level == 0).then_some(&self.spec)
    }

    fn read_rows(&self, image: usize, level: usize, y0: u32, y1: u32) -> Result<Pixels> {
        if image != 0 || level != 0 {
            return Err(self.place.misuse(format!("there is no level {level} of image {image}")));
        }
        if y0 > y1 || y1 > self.spec.height {
            let what = format!("rows {y0} to {y1} of an image with {}", self.spec.height);
            return Err(self.place.misuse(what));
        }
        let row = self.spec.width as usize * self.spec.nchannels();
        let n = (y1 - y0) as usize * row;
        if n == 0 {
            return Ok(Pixels::zeros(self.spec.pixel_type, 0));
        }
        if y1 - y0 == self.spec.height && self.decoded.get().is_none() {
            let decoded = self.decode()?;
            if decoded.missing.is_none() {
                return Ok(decoded.pixels);
            }
            // The pixels are read again, in parts.
            let _ = self.decoded.set(decoded);
        }
        // The pixels are decoded, and thereby checked, before the result is allocated.
        let Decoded { pixels, missing } = self.kept()?;
        if let Some((_, what)) = missing.as_ref().filter(|(rows, _)| y1 > *rows) {
            return Err(self.place.malformed(what.clone()));
        }
        let mut out = Pixels::zeros(self.spec.pixel_type, n);
        out.copy_from(0, pixels, y0 as usize * row, n);
        Ok(out)
    }

    fn read_tile(&self, _image: usize, _level: usize, _tx: u32, _ty: u32) -> Result<Pixels> {
        Err(self.place.misuse("a tile of an image stored in rows".to_owned()))
    }

    fn bytes_read(&self) -> u64 {
        self.place.bytes_read()
    }

    /// Returns the bytes of the pixels that are kept, and of those of the decoder.
    fn working_bytes(&self, _image: usize, _level: usize) -> u64 {
        self.spec.bytes().unwrap_or(u64::MAX).saturating_mul(2)
    }
}

/// Encodes a complete image. `Err` describes the limit of the format, or the error of the system.
pub(crate) type Encode = fn(&ImageSpec, Pixels, &mut AtomicFile) -> Result<()>;

/// An image while its rows are collected.
pub(crate) struct WholeOutput {
    file: AtomicFile,
    spec: ImageSpec,
    pixels: Pixels,
    filled: usize,
    encode: Encode,
}

impl WholeOutput {
    /// Begins a file. The format has checked that it can store the image.
    pub(crate) fn create(path: &Path, options: &CreateOptions<'_>, encode: Encode) -> Result<Self> {
        let spec = options.spec;
        let misuse = |what: String| ImageError::Misuse { path: path.to_owned(), what };
        if spec.is_tiled() {
            return Err(misuse("this format does not store tiles".to_owned()));
        }
        let n = spec
            .bytes()
            .and_then(|b| usize::try_from(b).ok())
            .filter(|b| *b > 0 && *b <= isize::MAX as usize);
        let n = n.ok_or_else(|| misuse(format!("an image of {} x {} pixels", spec.width, spec.height)))?;
        let file = options.files.create(path)?;
        let pixels = Pixels::zeros(spec.pixel_type, n / spec.pixel_type.bytes());
        Ok(Self { file, spec: spec.clone(), pixels, filled: 0, encode })
    }

    fn misuse(&self, what: String) -> ImageError {
        ImageError::Misuse { path: self.file.path().to_owned(), what }
    }
}

impl ImageOutput for WholeOutput {
    fn write_rows(&mut self, pixels: &Pixels) -> Result<()> {
        let row = self.spec.width as usize * self.spec.nchannels();
        if pixels.pixel_type() != self.spec.pixel_type {
            let (got, wanted) = (pixels.pixel_type(), self.spec.pixel_type);
            return Err(self.misuse(format!("pixels of type {got:?} for a file of {wanted:?}")));
        }
        if !pixels.len().is_multiple_of(row) || pixels.len() > self.pixels.len() - self.filled {
            let left = (self.pixels.len() - self.filled) / row;
            let what = format!(
                "{} values are no whole rows of {row}, or more than the {left} rows left",
                pixels.len()
            );
            return Err(self.misuse(what));
        }
        self.pixels.copy_from(self.filled, pixels, 0, pixels.len());
        self.filled += pixels.len();
        Ok(())
    }

    fn write_tile(&mut self, _tx: u32, _ty: u32, _pixels: &Pixels) -> Result<()> {
        Err(self.misuse("this format does not store tiles".to_owned()))
    }

    fn next_level(&mut self, _spec: &ImageSpec) -> Result<()> {
        Err(self.misuse("this format does not store several images or levels".to_owned()))
    }

    fn close(self: Box<Self>) -> Result<()> {
        if self.filled < self.pixels.len() {
            let row = self.spec.width as usize * self.spec.nchannels();
            let missing = (self.pixels.len() - self.filled) / row;
            return Err(
                self.misuse(format!("incomplete: {missing} of {} rows are missing", self.spec.height))
            );
        }
        let Self { mut file, spec, pixels, encode, .. } = *self;
        encode(&spec, pixels, &mut file)?;
        Ok(file.commit()?)
    }
}

/// Divides colours by alpha, which is the last of `n` channels.
pub(crate) fn divide_by_alpha(pixels: &mut Pixels, n: usize) {
    macro_rules! divide {
        ($v:expr, $t:ty) => {
            for pixel in $v.chunks_exact_mut(n) {
                let (alpha, colors) = pixel.split_last_mut().expect("invariant: pixels have channels");
                let (a, max) = (u64::from(*alpha), u64::from(<$t>::MAX));
                if a > 0 {
                    for c in colors {
                        *c = ((u64::from(*c) * max + a / 2) / a).min(max) as $t;
                    }
                }
            }
        };
    }
    match pixels {
        Pixels::U8(v) => divide!(v, u8),
        Pixels::U16(v) => divide!(v, u16),
        Pixels::U32(_) | Pixels::Half(_) | Pixels::Float(_) => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn division_by_alpha_is_rounded_and_clamped() {
        let mut p = Pixels::U8(vec![10, 20, 0, 20, 7, 0, 100, 255]);
        divide_by_alpha(&mut p, 2);
        assert_eq!(p, Pixels::U8(vec![128, 20, 0, 20, 7, 0, 100, 255]));
        let mut p = Pixels::U8(vec![30, 20]);
        divide_by_alpha(&mut p, 2);
        assert_eq!(p, Pixels::U8(vec![255, 20]));
    }
}
