//! The interface of file formats: input, output and format.

use crate::{ImageError, ImageSpec, PixelRect, PixelType, Pixels, Request, Result};
use granita_base::Files;
use std::path::Path;
use std::sync::Arc;

/// The limits of a reader, and the opener of its files. They are checked before memory is allocated.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Limits {
    /// The largest width or height, in pixels.
    pub dimension: u32,
    /// The largest number of pixels of one image.
    pub pixels: u64,
    /// The largest allocation for one read call, in bytes.
    pub bytes: u64,
    /// The largest number of channels.
    pub channels: u32,
    /// The largest number of images or MIP levels in one file.
    pub images: u32,
    /// Opens the files.
    pub files: Files,
}

impl Default for Limits {
    /// Returns large limits: 1 Mi pixels per side, 64 Gi pixels, 8 GiB per read, 1024 channels, 4096 images.
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
    /// Checks the size of one level: neither side is 0, sides, pixels and channels are within the limits, and one
    /// tile (or one row) is small enough for one read.
    ///
    /// # Errors
    /// [`ImageError::Limit`] when a limit is exceeded, [`ImageError::Malformed`] for a side of 0.
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

    /// Returns the number of bytes of `width x height` pixels of `spec`, if one read may be that large.
    ///
    /// # Errors
    /// [`ImageError::Limit`] when one read may not be that large.
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

    /// Checks that the system grants so many bytes of memory now. It is called before large allocations, because a
    /// failed allocation ends the process.
    ///
    /// # Errors
    /// [`ImageError::Io`] when the system does not grant them.
    pub fn check_memory(path: &Path, bytes: u64) -> Result<()> {
        /// Smaller allocations are not checked.
        const LARGE: u64 = 64 << 20;
        if bytes >= LARGE {
            let mut room: Vec<u8> = Vec::new();
            let granted = usize::try_from(bytes).is_ok_and(|bytes| room.try_reserve_exact(bytes).is_ok());
            // Without this the compiler may remove an allocation that is not used.
            std::hint::black_box(&mut room);
            if !granted {
                let text = format!("it needs {bytes} bytes of memory, which the system does not provide");
                let source = std::io::Error::new(std::io::ErrorKind::OutOfMemory, text);
                return Err(ImageError::Io { path: path.to_owned(), source });
            }
        }
        Ok(())
    }

    /// Checks that `file_bytes` of a file can hold `pixel_bytes` of pixels. The codec packs at most `ratio` bytes
    /// into one byte. Small images always pass, so that the existing part of a truncated file can be read.
    ///
    /// # Errors
    /// [`ImageError::Malformed`] when the file is too small for its pixels.
    pub fn check_ratio(
        &self,
        path: &Path,
        format: &'static str,
        (pixel_bytes, file_bytes): (u64, u64),
        ratio: u64,
    ) -> Result<()> {
        /// The number of bytes of pixels that any file may declare.
        const SMALL: u64 = 64 << 20;
        let most = file_bytes.saturating_mul(ratio).max(SMALL);
        if pixel_bytes <= most {
            return Ok(());
        }
        let what = format!(
            "the header claims {pixel_bytes} bytes of pixels, and {file_bytes} bytes of data hold at most {most}"
        );
        Err(ImageError::Malformed { path: path.to_owned(), format, what })
    }

    /// Checks that `asked` is at most `max`.
    ///
    /// # Errors
    /// [`ImageError::Limit`] when it is more.
    pub fn within(&self, path: &Path, what: &'static str, asked: u64, max: u64) -> Result<()> {
        if asked <= max { Ok(()) } else { Err(ImageError::Limit { path: path.to_owned(), what, asked, max }) }
    }
}

/// The samples of an image of deep pixels, which have any number of samples at different depths.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DeepSamples {
    /// The number of samples of all pixels.
    pub total: u64,
    /// The largest number of samples of a pixel.
    pub most_per_pixel: u32,
}

/// An open image file. Any number of threads may read at once.
///
/// A file holds images, each with one or more MIP levels. Level 0 is the largest. Texture files that store levels as
/// further images (TIFF, reference 9.2.1) present them as levels of image 0.
pub trait ImageInput: Send + Sync {
    /// Returns the name of the format, such as "tiff".
    fn format_name(&self) -> &'static str;

    /// The number of images, at least 1.
    fn images(&self) -> usize {
        1
    }

    /// The number of MIP levels of an image, at least 1; 0 when there is no such image.
    fn levels(&self, image: usize) -> usize;

    /// Returns the description of one level; `None` when there is no such level.
    fn spec(&self, image: usize, level: usize) -> Option<&ImageSpec>;

    /// Returns rows `y0..y1` of the data window (0 is its top row) of a level, tiled or not.
    ///
    /// # Errors
    /// An error when there is no such level or no such rows, and when the file cannot be read or is damaged there.
    fn read_rows(&self, image: usize, level: usize, y0: u32, y1: u32) -> Result<Pixels>;

    /// Returns tile `(tx, ty)` of a tiled level, always of full tile size. Pixels outside of the data window are
    /// those of the file. Only this tile is read. An image stored in scanlines gives an error.
    ///
    /// # Errors
    /// An error when there is no such tile, and when the file cannot be read or is damaged there.
    fn read_tile(&self, image: usize, level: usize, tx: u32, ty: u32) -> Result<Pixels>;

    /// Returns the number of rows of a level that are packed together, when such blocks can be read separately.
    /// Reading one row then costs as much as reading its block, and does not read the rows above. `None` for other
    /// formats.
    fn rows_together(&self, image: usize, level: usize) -> Option<u32> {
        let _ = (image, level);
        None
    }

    /// Returns the whole data window of a level.
    ///
    /// # Errors
    /// The errors of [`ImageInput::read_rows`].
    fn read_level(&self, image: usize, level: usize) -> Result<Pixels> {
        let height = self.spec(image, level).map_or(0, |s| s.height);
        self.read_rows(image, level, 0, height)
    }

    /// Counts the samples of a level of deep pixels, which other functions return flattened. All of the level is read.
    /// `None` for other images.
    ///
    /// # Errors
    /// An error when there is no such level, and when the file cannot be read or is damaged.
    fn deep_samples(&self, image: usize, level: usize) -> Result<Option<DeepSamples>> {
        let _ = (image, level);
        Ok(None)
    }

    /// The number of bytes read from the file so far, including headers; for statistics and tests.
    fn bytes_read(&self) -> u64;

    /// The number of bytes of memory that reading rows of a level needs in addition to the rows themselves. These are
    /// all pixels for formats that are decoded as a whole, and a strip or a row of tiles for others when these are
    /// high. The number is computed without reading. 0 where it does not depend on the image.
    fn working_bytes(&self, image: usize, level: usize) -> u64 {
        let _ = (image, level);
        0
    }
}

/// A file that is being written: levels in order, each in rows or in tiles, then [`ImageOutput::close`].
///
/// When it is dropped before `close`, no new file has the final name.
pub trait ImageOutput: Send {
    /// Writes the next rows of a scanline level, from the top downward. `pixels` holds a whole number of rows and has
    /// the spec's type.
    ///
    /// # Errors
    /// An error when the rows do not fit the level, and when the file cannot be written.
    fn write_rows(&mut self, pixels: &Pixels) -> Result<()>;

    /// Writes tile `(tx, ty)` of a tiled level, of full tile size. Tiles may be in any order, each once.
    ///
    /// # Errors
    /// An error when the tile does not fit the level, and when the file cannot be written.
    fn write_tile(&mut self, tx: u32, ty: u32, pixels: &Pixels) -> Result<()>;

    /// Writes several tiles of the level, each with its `(tx, ty)`. The file has the same bytes as after
    /// [`ImageOutput::write_tile`] for each. Formats that compress do so in the threads of the caller's pool, so that
    /// callers should pass tens of tiles at once.
    ///
    /// # Errors
    /// The errors of [`ImageOutput::write_tile`].
    fn write_tiles(&mut self, tiles: &[(u32, u32, Pixels)]) -> Result<()> {
        tiles.iter().try_for_each(|(tx, ty, pixels)| self.write_tile(*tx, *ty, pixels))
    }

    /// Begins the next MIP level (or further image, where the format has no levels). The level before must be
    /// complete.
    ///
    /// # Errors
    /// An error when the level before is not complete, when the format stores no further level, and when the file
    /// cannot be written.
    fn next_level(&mut self, spec: &ImageSpec) -> Result<()>;

    /// Announces all levels after the first at once, so that tiles of any level may be written in any order, each
    /// after [`ImageOutput::select_level`]. `next_level` is then not called. Returns `Ok (false)`, without any
    /// effect, when the format accepts its levels only in order.
    ///
    /// # Errors
    /// An error when the format cannot store these levels.
    fn plan_levels(&mut self, specs: &[ImageSpec]) -> Result<bool> {
        let _ = specs;
        Ok(false)
    }

    /// Selects the planned level (0 is the first) to which tiles are written.
    ///
    /// # Errors
    /// An error when levels were not planned, or when there is none of this number.
    fn select_level(&mut self, level: usize) -> Result<()> {
        let what = format!("level {level} was not planned");
        Err(ImageError::Misuse { path: std::path::PathBuf::new(), what })
    }

    /// Writes the pixels of `rect`, whose values are final, counted from the upper left one of the data window. In
    /// formats that support "rectangles" this may be done in any order and replaces rows or tiles. It never waits for
    /// the receiver.
    ///
    /// # Errors
    /// An error when there is no receiver any more, and in other formats.
    fn write_rectangle(&mut self, rect: &PixelRect, pixels: &Pixels) -> Result<()> {
        let _ = (rect, pixels);
        let what = "the format does not accept rectangles".to_owned();
        Err(ImageError::Misuse { path: std::path::PathBuf::new(), what })
    }

    /// Announces that work on these pixels begins.
    fn begin_rectangle(&mut self, rect: &PixelRect) {
        let _ = rect;
    }

    /// Returns the requests of viewers since the last call.
    fn requests(&mut self) -> Vec<Request> {
        Vec::new()
    }

    /// Shows a part of the panel beside the image, in formats whose receiver is a viewer. `text` is JSON; an empty text
    /// removes the part. Formats without panels ignore it.
    ///
    /// # Errors
    /// An error when there is no receiver any more.
    fn show_panel(&mut self, part: &str, text: &str) -> Result<()> {
        let _ = (part, text);
        Ok(())
    }

    /// Returns the edits that users made in the panel since the last call, each as JSON.
    fn edits(&mut self) -> Vec<String> {
        Vec::new()
    }

    /// Selects the image of a file of several, as in [`Format::create_images`], to which rows, tiles and levels are
    /// written from now on. In formats that support "parts" the images may be selected in any order, again and again.
    /// In other formats they are written one after the other, each complete before the next.
    ///
    /// # Errors
    /// An error when the file has no image of this number, or when the format takes it at another time.
    fn select_image(&mut self, image: usize) -> Result<()> {
        if image == 0 {
            return Ok(());
        }
        let what = format!("image {image} was not announced when the file was created");
        Err(ImageError::Misuse { path: std::path::PathBuf::new(), what })
    }

    /// Completes the file and gives it its final name.
    ///
    /// # Errors
    /// An error when levels are not complete, and when the file cannot be written. The final name then has no file,
    /// or the previous one.
    fn close(self: Box<Self>) -> Result<()>;
}

/// The options for creating a file.
#[derive(Clone, Debug)]
pub struct CreateOptions<'a> {
    /// The first (largest) level. Its `attributes` contain the format's own options, such as `compression`.
    pub spec: &'a ImageSpec,
    /// The number of levels in all, at least 1. Some formats need it in advance.
    pub levels: usize,
    /// The opener that creates the file.
    pub files: Files,
}

impl<'a> CreateOptions<'a> {
    /// Returns options for a file in any place where the process may write.
    pub fn new(spec: &'a ImageSpec, levels: usize) -> Self {
        Self { spec, levels, files: Files::default() }
    }

    /// Returns the same options for a file that `files` creates.
    pub fn with_files(self, files: &Files) -> Self {
        Self { files: files.clone(), ..self }
    }
}

/// A file format.
pub trait Format: Send + Sync {
    /// Returns the name in `Output` and `-format`, such as "tiff".
    fn name(&self) -> &'static str;

    /// Returns further names, such as "OpenEXR" for "exr".
    fn aliases(&self) -> &'static [&'static str] {
        &[]
    }

    /// Returns the file extensions without the dot, in lower case, the usual one first.
    fn extensions(&self) -> &'static [&'static str];

    /// True when a file that begins with `head` (up to 64 bytes) has this format.
    fn recognizes(&self, head: &[u8]) -> bool;

    /// Opens a file for reading.
    ///
    /// # Errors
    /// An error when the file cannot be read, has another format, is damaged, or exceeds the limits.
    fn open(&self, path: &Path, limits: &Limits) -> Result<Box<dyn ImageInput>>;

    /// Opens an image in memory, such as one inside of another file. `path` is its name in errors.
    ///
    /// # Errors
    /// [`ImageError::Unsupported`] for formats that are only read from separate files, which is the default.
    fn open_bytes(&self, path: &Path, bytes: Arc<[u8]>, limits: &Limits) -> Result<Box<dyn ImageInput>> {
        let _ = (bytes, limits);
        let what = format!("{} images are not read from inside of other files", self.name());
        Err(ImageError::Unsupported { path: path.to_owned(), what })
    }

    /// True when the format supports a feature of writing: "tiles", "levels", "half", "float", "u16", "channels"
    /// (more than 4), "layers" (it keeps the names of channels), "alpha" (without it, a fourth channel is left out),
    /// "rectangles" (it shows pixels at once), "images" (several in one file, see [`Format::create_images`]), "parts"
    /// (images of one file have names and are written in any order), "write". A format that is only read supports none.
    fn supports(&self, feature: &str) -> bool {
        let _ = feature;
        false
    }

    /// Returns the type in which the format stores a rendered output whose quantization requests `quantized` (8 or 16
    /// bits, or floats). The default is that type, or the nearest that it supports.
    fn output_type(&self, quantized: PixelType) -> PixelType {
        match quantized {
            PixelType::Float if self.supports("float") => PixelType::Float,
            PixelType::Half | PixelType::Float if self.supports("half") => PixelType::Half,
            PixelType::U16 | PixelType::Float | PixelType::U32 if self.supports("u16") => PixelType::U16,
            _ => PixelType::U8,
        }
    }

    /// True when its integers are always from 0 to the largest of their type, with a dither of 0.5. "quantize" then
    /// selects only the number of bits, and "dither" has no effect (reference 7.4.6).
    fn has_fixed_levels(&self) -> bool {
        false
    }

    /// Describes the data of an image with so many channels that a file of this name does not store, when this may be
    /// unexpected.
    fn leaves_out(&self, path: &Path, channels: usize) -> Option<String> {
        let _ = (path, channels);
        None
    }

    /// True when the format receives a rendered output's values as computed, with "gain", "gamma", "quantize" and
    /// "dither" among the attributes, and applies these itself (reference 13.3.2).
    fn quantizes(&self) -> bool {
        false
    }

    /// Creates a file. The default is that of a format that is only read.
    ///
    /// # Errors
    /// An error when the file cannot be created, and for a description that the format cannot store.
    fn create(&self, path: &Path, options: &CreateOptions<'_>) -> Result<Box<dyn ImageOutput>> {
        let _ = options;
        let what = format!("files of the format \"{}\" are read, not written", self.name());
        Err(ImageError::Unsupported { path: path.to_owned(), what })
    }

    /// Creates a file of several images, each with one level, in the order of `specs`. [`ImageOutput::select_image`]
    /// selects the one that is written; the first one is selected at the beginning. Images of formats that support
    /// "parts" take their names from the attribute `name`. One image is the same as [`Format::create`].
    ///
    /// # Errors
    /// An error when the format stores one image in a file, when `specs` is empty, and those of [`Format::create`].
    fn create_images(&self, path: &Path, specs: &[ImageSpec], files: &Files) -> Result<Box<dyn ImageOutput>> {
        match specs {
            [one] => self.create(path, &CreateOptions::new(one, 1).with_files(files)),
            [] => {
                Err(ImageError::Misuse { path: path.to_owned(), what: "a file without an image".to_owned() })
            }
            many => {
                let what = format!("the format \"{}\" stores one image, not {}", self.name(), many.len());
                Err(ImageError::Unsupported { path: path.to_owned(), what })
            }
        }
    }
}
