//! The contract between files and everybody else: input, output, format.

use crate::{ImageError, ImageSpec, PixelRect, PixelType, Pixels, Request, Result};
use granita_base::Files;
use std::path::Path;
use std::sync::Arc;

/// What a reader may take in, and how it opens files. Checked before anything is allocated.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Largest width or height.
    pub dimension: u32,
    /// Largest number of pixels of one image.
    pub pixels: u64,
    /// Largest allocation for one read call, in bytes.
    pub bytes: u64,
    /// Largest number of channels.
    pub channels: u32,
    /// Largest number of images or MIP levels in one file.
    pub images: u32,
    /// Opens the files.
    pub files: Files,
}

impl Default for Limits {
    /// Generous: 1 Mi pixels a side, 64 Gi pixels, 8 GiB at once, 1024 channels, 4096 images.
    fn default() -> Self {
        Self {
            dimension: 1 << 20,
            pixels: 1 << 36,
            bytes: 8 << 30,
            channels: 1024,
            images: 4096,
            files: Files::default(),
        }
    }
}

impl Limits {
    /// Checks the size of one level: neither side 0, sides, pixels and channels within the limits, and
    /// one tile (or one row) small enough for one read.
    pub fn check(&self, path: &Path, format: &'static str, spec: &ImageSpec) -> Result<()> {
        let n = spec.nchannels() as u64;
        if spec.width == 0 || spec.height == 0 || n == 0 {
            return Err(ImageError::Malformed {
                path: path.to_owned(),
                format,
                what: format!("image of {} x {} pixels with {n} channels", spec.width, spec.height),
            });
        }
        let sides = [spec.width, spec.height, spec.tile_width, spec.tile_height];
        let side = sides.into_iter().max().unwrap_or(0);
        self.within(path, "image or tile side", u64::from(side), u64::from(self.dimension))?;
        self.within(path, "number of channels", n, u64::from(self.channels))?;
        let pixels = u64::from(spec.width) * u64::from(spec.height);
        self.within(path, "number of pixels", pixels, self.pixels)?;
        let (w, h) = if spec.is_tiled() { (spec.tile_width, spec.tile_height) } else { (spec.width, 1) };
        self.check_read(path, spec, w, h)?;
        Ok(())
    }

    /// Bytes that `width x height` pixels of `spec` take, if one read may be that large.
    pub fn check_read(&self, path: &Path, spec: &ImageSpec, width: u32, height: u32) -> Result<usize> {
        let bytes = u64::from(width)
            .checked_mul(u64::from(height))
            .and_then(|b| b.checked_mul(spec.nchannels() as u64))
            .and_then(|b| b.checked_mul(spec.pixel_type.bytes() as u64))
            .unwrap_or(u64::MAX);
        self.within(path, "bytes of one read", bytes, self.bytes.min(isize::MAX as u64))?;
        Self::check_memory(path, bytes)?;
        Ok(bytes as usize)
    }

    /// `Ok` when the system grants so many bytes of memory now. To be called before large allocations: one that fails
    /// ends the process.
    pub fn check_memory(path: &Path, bytes: u64) -> Result<()> {
        /// Fewer bytes than these are not worth the question.
        const LARGE: u64 = 64 << 20;
        if bytes >= LARGE {
            let mut room: Vec<u8> = Vec::new();
            let granted = usize::try_from(bytes).is_ok_and(|bytes| room.try_reserve_exact(bytes).is_ok());
            // Without this the compiler may leave out an allocation that is not used.
            std::hint::black_box(&mut room);
            if !granted {
                let text = format!("it needs {bytes} bytes of memory, which the system does not grant");
                let source = std::io::Error::new(std::io::ErrorKind::OutOfMemory, text);
                return Err(ImageError::Io { path: path.to_owned(), source });
            }
        }
        Ok(())
    }

    /// `Ok` when `file_bytes` of a file can hold `pixel_bytes` of pixels, of which its codec packs at most `ratio` into
    /// one byte. Small images pass in any case, so that what is there of a file that ends early can be read.
    pub fn check_ratio(
        &self,
        path: &Path,
        format: &'static str,
        (pixel_bytes, file_bytes): (u64, u64),
        ratio: u64,
    ) -> Result<()> {
        /// Bytes of pixels that any file may promise.
        const SMALL: u64 = 64 << 20;
        let most = file_bytes.saturating_mul(ratio).max(SMALL);
        if pixel_bytes <= most {
            return Ok(());
        }
        let what = format!(
            "the header promises {pixel_bytes} bytes of pixels, and {file_bytes} bytes of data hold at most {most}"
        );
        Err(ImageError::Malformed { path: path.to_owned(), format, what })
    }

    /// `Ok` when `asked` is at most `max`.
    pub fn within(&self, path: &Path, what: &'static str, asked: u64, max: u64) -> Result<()> {
        if asked <= max { Ok(()) } else { Err(ImageError::Limit { path: path.to_owned(), what, asked, max }) }
    }
}

/// An open image file. Any number of threads may read at once.
///
/// A file holds images, each with one or more MIP levels; level 0 is the largest. Texture files that
/// store levels as further images (TIFF, reference 9.2.1) present them as levels of image 0.
pub trait ImageInput: Send + Sync {
    /// Name of the format, as "tiff".
    fn format_name(&self) -> &'static str;

    /// Number of images, at least 1.
    fn images(&self) -> usize {
        1
    }

    /// Number of MIP levels of an image, at least 1; 0 when there is no such image.
    fn levels(&self, image: usize) -> usize;

    /// Description of one level; `None` when there is no such level.
    fn spec(&self, image: usize, level: usize) -> Option<&ImageSpec>;

    /// Rows `y0..y1` of the data window (0 is its top row) of a level, tiled or not.
    fn read_rows(&self, image: usize, level: usize, y0: u32, y1: u32) -> Result<Pixels>;

    /// Tile `(tx, ty)` of a tiled level, always of full tile size; what lies outside the data window
    /// is whatever the file holds. Reads nothing but this tile. An error for a scanline image.
    fn read_tile(&self, image: usize, level: usize, tx: u32, ty: u32) -> Result<Pixels>;

    /// How many rows of a level are packed together, where such blocks are read by themselves: reading one of the rows
    /// costs what reading all of the block does, and nothing for the rows above. `None` where that is not so.
    fn rows_together(&self, image: usize, level: usize) -> Option<u32> {
        let _ = (image, level);
        None
    }

    /// The whole data window of a level.
    fn read_level(&self, image: usize, level: usize) -> Result<Pixels> {
        let height = self.spec(image, level).map_or(0, |s| s.height);
        self.read_rows(image, level, 0, height)
    }

    /// Bytes read from the file so far, headers included; for statistics and tests.
    fn bytes_read(&self) -> u64;

    /// Bytes of memory that reading rows of a level takes beside the rows themselves: all pixels of formats that are
    /// decoded as a whole, a strip or a row of tiles of others where these are high. Known without reading. 0 where it does not depend on the image.
    fn working_bytes(&self, image: usize, level: usize) -> u64 {
        let _ = (image, level);
        0
    }
}

/// A file being written: levels in order, each in rows or in tiles, then [`ImageOutput::close`].
///
/// Dropped before `close`, nothing is left under the final name.
pub trait ImageOutput: Send {
    /// The next rows of a scanline level: as many as `pixels` holds, from the top downward.
    /// `pixels` has the spec's type.
    fn write_rows(&mut self, pixels: &Pixels) -> Result<()>;

    /// Tile `(tx, ty)` of a tiled level, of full tile size; any order, each once.
    fn write_tile(&mut self, tx: u32, ty: u32, pixels: &Pixels) -> Result<()>;

    /// Several tiles of the level, each with its `(tx, ty)`, as by [`ImageOutput::write_tile`] one after the
    /// other, and with the same bytes in the file. Formats that compress do so in the threads of the
    /// caller's pool: give out tens of tiles at once rather than one.
    fn write_tiles(&mut self, tiles: &[(u32, u32, Pixels)]) -> Result<()> {
        tiles.iter().try_for_each(|(tx, ty, pixels)| self.write_tile(*tx, *ty, pixels))
    }

    /// Begins the next MIP level (or further image, where the format has no levels of its own).
    /// The level before must be complete.
    fn next_level(&mut self, spec: &ImageSpec) -> Result<()>;

    /// Announces all levels after the first at once, so that tiles of any level may be written in any
    /// order, each after [`ImageOutput::select_level`]; `next_level` is then not called. `Ok (false)`, and
    /// nothing else happens, when the format takes its levels one after the other only.
    fn plan_levels(&mut self, specs: &[ImageSpec]) -> Result<bool> {
        let _ = specs;
        Ok(false)
    }

    /// Makes a planned level (0 is the first) the one that tiles are written to.
    ///
    /// # Errors
    /// When levels were not planned, or there is none of this number.
    fn select_level(&mut self, level: usize) -> Result<()> {
        let what = format!("level {level} was not planned");
        Err(ImageError::Misuse { path: std::path::PathBuf::new(), what })
    }

    /// Pixels of `rect`, whose values do not change any more, counted from the upper left one of the data window: in formats that support "rectangles", in any order and
    /// instead of rows or tiles. Never waits for whoever takes them.
    ///
    /// # Errors
    /// When nobody takes them any more, and in other formats.
    fn write_rectangle(&mut self, rect: &PixelRect, pixels: &Pixels) -> Result<()> {
        let _ = (rect, pixels);
        let what = "the format takes no rectangles".to_owned();
        Err(ImageError::Misuse { path: std::path::PathBuf::new(), what })
    }

    /// Somebody begins to work on these pixels.
    fn begin_rectangle(&mut self, rect: &PixelRect) {
        let _ = rect;
    }

    /// What whoever looks at the picture asked for since the last call.
    fn requests(&mut self) -> Vec<Request> {
        Vec::new()
    }

    /// Completes the file and puts it under its final name.
    fn close(self: Box<Self>) -> Result<()>;
}

/// How to create a file.
#[derive(Clone, Debug)]
pub struct CreateOptions<'a> {
    /// First (largest) level. Its `attributes` carry the format's own options, as `compression`.
    pub spec: &'a ImageSpec,
    /// How many levels will follow in all, at least 1; formats that need to know it up front rely on it.
    pub levels: usize,
    /// Creates the file.
    pub files: Files,
}

impl<'a> CreateOptions<'a> {
    /// For a file wherever the process may write.
    pub fn new(spec: &'a ImageSpec, levels: usize) -> Self {
        Self { spec, levels, files: Files::default() }
    }

    /// The same for a file that `files` creates.
    pub fn with_files(self, files: &Files) -> Self {
        Self { files: files.clone(), ..self }
    }
}

/// One file format.
pub trait Format: Send + Sync {
    /// Name in `Output` and `-format`, as "tiff".
    fn name(&self) -> &'static str;

    /// Further names it answers to, as "OpenEXR" for "exr".
    fn aliases(&self) -> &'static [&'static str] {
        &[]
    }

    /// File extensions without the dot, lower case, the usual one first.
    fn extensions(&self) -> &'static [&'static str];

    /// Whether a file that begins with `head` (up to 64 bytes) is of this format.
    fn recognizes(&self, head: &[u8]) -> bool;

    /// Opens a file for reading.
    fn open(&self, path: &Path, limits: &Limits) -> Result<Box<dyn ImageInput>>;

    /// Opens a picture that lies in memory, as those inside of other files do; `path` stands for it in errors.
    ///
    /// # Errors
    /// [`ImageError::Unsupported`] for formats that are only read from files of their own, as by default.
    fn open_bytes(&self, path: &Path, bytes: Arc<[u8]>, limits: &Limits) -> Result<Box<dyn ImageInput>> {
        let _ = (bytes, limits);
        let what = format!("{} pictures are not read from inside of other files", self.name());
        Err(ImageError::Unsupported { path: path.to_owned(), what })
    }

    /// Whether it can write: "tiles", "levels", "half", "float", "u16", "channels" (more than 4), "alpha"
    /// (without it, a fourth channel is left out), "rectangles" (it shows pixels as they come), "write".
    fn supports(&self, feature: &str) -> bool;

    /// The type in which it stores a rendered output whose quantization asks for `quantized` (8 or 16
    /// bits, or floats); by default that, or the nearest it supports.
    fn output_type(&self, quantized: PixelType) -> PixelType {
        match quantized {
            PixelType::Float if self.supports("float") => PixelType::Float,
            PixelType::Half | PixelType::Float if self.supports("half") => PixelType::Half,
            PixelType::U16 | PixelType::Float | PixelType::U32 if self.supports("u16") => PixelType::U16,
            _ => PixelType::U8,
        }
    }

    /// Whether its integers are always from 0 to the largest of their type, with a dither of 0.5: "quantize" then only says
    /// how many bits there are, and "dither" nothing (reference 7.4.6).
    fn has_fixed_levels(&self) -> bool {
        false
    }

    /// What a file of this name does not keep of an image with so many channels, in words, where that would surprise.
    fn leaves_out(&self, path: &Path, channels: usize) -> Option<String> {
        let _ = (path, channels);
        None
    }

    /// Whether it wants a rendered output's values as computed, with "gain", "gamma", "quantize" and "dither" among the
    /// attributes, and applies these itself (reference 13.3.2).
    fn quantizes(&self) -> bool {
        false
    }

    /// Creates a file.
    fn create(&self, path: &Path, options: &CreateOptions<'_>) -> Result<Box<dyn ImageOutput>>;
}
