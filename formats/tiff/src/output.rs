//! Writes strips or tiles in the order of arrival, and all directories at the end.

use crate::codec::{Compression, apply_floating, apply_horizontal};
use crate::field::{Field, metadata_directories, resolution};
use crate::input::is_float;
use crate::settings::Settings;
use crate::tags;
use granita_base::Files;
use granita_image::metadata::{exif, iptc, settings};
use granita_image::{
    AtomicFile, Content, CreateOptions, ImageError, ImageOutput, ImageSpec, PixelType, Pixels, Result,
    TileRows,
};
use rayon::prelude::*;
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;

/// A TIFF file that is being written. It is little-endian, and has 64-bit offsets if it may exceed 4 GiB.
#[derive(Debug)]
pub struct TiffOutput {
    file: AtomicFile,
    /// The offset of the next byte.
    position: u64,
    big_tiff: bool,
    /// The options of the first level, for later levels without their own.
    first: Settings,
    finished: Vec<Vec<Field>>,
    current: Writing,
    /// All planned levels. The current one is replaced by `None`.
    planned: Vec<Option<Writing>>,
    /// The pages of a file of several images; empty for a file of one.
    pages: Vec<ImageSpec>,
    /// The index of the current page.
    page: usize,
}

/// The level that is being written.
#[derive(Debug)]
struct Writing {
    spec: ImageSpec,
    settings: Settings,
    /// The offset and length in bytes of every strip or tile, plane after plane.
    chunks: Vec<Option<(u64, u64)>>,
    rows: Rows,
}

/// Rows that do not fill a strip or a row of tiles yet.
#[derive(Debug)]
enum Rows {
    Strip { pixels: Pixels, filled: usize, next_y: u32 },
    Tiles(Option<TileRows>),
}

impl Writing {
    fn new(path: &Path, spec: &ImageSpec, inherited: Option<Settings>) -> Result<Self> {
        let misuse = |what: String| ImageError::Misuse { path: path.to_owned(), what };
        if spec.width == 0 || spec.height == 0 || spec.nchannels() == 0 {
            let (w, h, n) = (spec.width, spec.height, spec.nchannels());
            return Err(misuse(format!("an image of {w} x {h} pixels with {n} channels")));
        }
        if spec.nchannels() > usize::from(u16::MAX) {
            return Err(misuse(format!("{} channels, {} at most", spec.nchannels(), u16::MAX)));
        }
        if spec.is_tiled() && spec.tile_height == 0 {
            return Err(misuse(format!("tiles of {} x 0 pixels", spec.tile_width)));
        }
        let mut settings = Settings::of(path, spec, inherited)?;
        settings.rows_per_strip = settings.rows_per_strip.min(spec.height);
        let planes = if settings.separate { spec.nchannels() as u64 } else { 1 };
        let per_plane = if spec.is_tiled() {
            let (across, down) = spec.tiles();
            u64::from(across) * u64::from(down)
        } else {
            u64::from(spec.height.div_ceil(settings.rows_per_strip))
        };
        let rows = if spec.is_tiled() {
            Rows::Tiles(None)
        } else {
            let n = spec.width as usize * settings.rows_per_strip as usize * spec.nchannels();
            Rows::Strip { pixels: Pixels::zeros(spec.pixel_type, n), filled: 0, next_y: 0 }
        };
        let chunks = vec![None; (per_plane * planes) as usize];
        Ok(Self { spec: spec.clone(), settings, chunks, rows })
    }

    fn misuse(&self, file: &AtomicFile, what: String) -> ImageError {
        ImageError::Misuse { path: file.path().to_owned(), what }
    }
}

/// Returns the number of bytes of an image as the file stores it without compression.
fn stored_bytes(spec: &ImageSpec) -> u64 {
    let tiles = spec.tiles();
    let padded = (u64::from(tiles.0) * u64::from(spec.tile_width))
        .saturating_mul(u64::from(tiles.1) * u64::from(spec.tile_height))
        .saturating_mul((spec.nchannels() * spec.pixel_type.bytes()) as u64);
    spec.bytes().unwrap_or(u64::MAX).max(padded)
}

impl TiffOutput {
    /// Begins a file. It is not visible under its name before `close`.
    ///
    /// # Errors
    /// Returns an error when the folder is missing or refuses the file, and for a description that TIFF cannot store.
    pub fn create(path: &Path, options: &CreateOptions<'_>) -> Result<Self> {
        // All levels together are less than twice the first one.
        let first = stored_bytes(options.spec);
        let bytes = if options.levels > 1 { first.saturating_mul(2) } else { first };
        Self::begin(path, options.spec, bytes, &options.files)
    }

    /// Begins a file of several pages, which are written one after the other.
    ///
    /// # Errors
    /// The errors of [`TiffOutput::create`].
    pub fn create_pages(path: &Path, pages: &[ImageSpec], files: &Files) -> Result<Self> {
        let Some(first) = pages.first() else {
            let what = "a file without an image".to_owned();
            return Err(ImageError::Misuse { path: path.to_owned(), what });
        };
        for page in pages {
            Writing::new(path, page, None)?;
        }
        let bytes = pages.iter().map(stored_bytes).fold(0, u64::saturating_add);
        Ok(Self { pages: pages.to_vec(), ..Self::begin(path, first, bytes, files)? })
    }

    /// Begins a file of about so many bytes.
    fn begin(path: &Path, spec: &ImageSpec, bytes: u64, files: &Files) -> Result<Self> {
        let current = Writing::new(path, spec, None)?;
        let forced = spec.attributes.int("bigtiff").unwrap_or(0) != 0;
        // Compression may lengthen the pixels slightly.
        let big_tiff = forced || bytes.saturating_add(bytes / 16) > u64::from(u32::MAX) - (1 << 20);
        let mut file = files.create(path)?;
        let header: &[u8] =
            if big_tiff { b"II\x2b\0\x08\0\0\0\0\0\0\0\0\0\0\0" } else { b"II\x2a\0\0\0\0\0" };
        file.write_all(header).map_err(|e| file.io_error(e))?;
        let position = header.len() as u64;
        let first = current.settings;
        Ok(Self {
            file,
            position,
            big_tiff,
            first,
            finished: Vec::new(),
            current,
            planned: Vec::new(),
            pages: Vec::new(),
            page: 0,
        })
    }

    /// Returns the kind of the current directory: an image of its own, a level of the first one, or a page.
    fn kind(&self) -> u32 {
        const REDUCED: u32 = 1;
        const PAGE: u32 = 2;
        match (self.pages.len() > 1, self.finished.is_empty()) {
            (true, _) => PAGE,
            (false, true) => 0,
            (false, false) => REDUCED,
        }
    }

    /// Appends bytes at an even offset, as the format requires. Returns their offset.
    fn append(&mut self, bytes: &[u8]) -> Result<u64> {
        if self.position % 2 == 1 {
            self.file.write_all(&[0]).map_err(|e| self.file.io_error(e))?;
            self.position += 1;
        }
        let at = self.position;
        let end = at + bytes.len() as u64;
        if !self.big_tiff && end > u64::from(u32::MAX) {
            return Err(ImageError::Limit {
                path: self.file.path().to_owned(),
                what: "size of a TIFF file with 32-bit offsets",
                asked: end,
                max: u64::from(u32::MAX),
            });
        }
        self.file.write_all(bytes).map_err(|e| self.file.io_error(e))?;
        self.position = end;
        Ok(at)
    }

    /// Compresses and writes strips or tiles with all their channels. Each is given by its index within a plane and its
    /// pixels in rows of `width`. They are compressed in the threads of the caller's pool and written in order.
    fn write_chunks(&mut self, width: usize, chunks: &[(usize, &Pixels)]) -> Result<()> {
        let n = self.current.spec.nchannels();
        let settings = self.current.settings;
        let planes = if settings.separate { n } else { 1 };
        let per_plane = self.current.chunks.len() / planes;
        let packed = |pixels: &Pixels| -> std::io::Result<Vec<Vec<u8>>> {
            if planes == 1 {
                return Ok(vec![pack(pixels, width * n, n, &settings)?]);
            }
            (0..planes).map(|plane| pack(&pixels.plane(plane, n), width, 1, &settings)).collect()
        };
        let done: Vec<std::io::Result<Vec<Vec<u8>>>> = match chunks {
            [(_, only)] => vec![packed(only)],
            many => many.par_iter().map(|(_, pixels)| packed(pixels)).collect(),
        };
        for ((index, _), planes) in chunks.iter().zip(done) {
            for (plane, bytes) in planes.map_err(|e| self.file.io_error(e))?.into_iter().enumerate() {
                let slot = plane * per_plane + index;
                if self.current.chunks[slot].is_some() {
                    return Err(self.current.misuse(&self.file, format!("tile {index} is written twice")));
                }
                let at = self.append(&bytes)?;
                self.current.chunks[slot] = Some((at, bytes.len() as u64));
            }
        }
        Ok(())
    }

    /// Returns the index of a tile. It is an error when the tile does not exist or `pixels` does not have its size.
    fn tile_number(&self, tx: u32, ty: u32, pixels: &Pixels) -> Result<usize> {
        self.check_type(pixels)?;
        let spec = &self.current.spec;
        let (across, down) = spec.tiles();
        let n = spec.tile_width as usize * spec.tile_height as usize * spec.nchannels();
        if tx >= across || ty >= down || pixels.len() != n {
            let what = format!(
                "tile ({tx}, {ty}) with {} values, in an image of {across} x {down} tiles of {n}",
                pixels.len()
            );
            return Err(self.current.misuse(&self.file, what));
        }
        Ok(ty as usize * across as usize + tx as usize)
    }

    fn check_type(&self, pixels: &Pixels) -> Result<()> {
        let (got, wanted) = (pixels.pixel_type(), self.current.spec.pixel_type);
        if got == wanted {
            return Ok(());
        }
        Err(self.current.misuse(&self.file, format!("pixels of type {got:?} for a file of {wanted:?}")))
    }

    /// Closes the current level, which must be complete.
    fn finish_level(&mut self) -> Result<()> {
        let missing = self.current.chunks.iter().filter(|c| c.is_none()).count();
        if missing > 0 {
            let level = self.finished.len();
            let total = self.current.chunks.len();
            let what =
                format!("level {level} is incomplete: {missing} of {total} strips or tiles are missing");
            return Err(self.current.misuse(&self.file, what));
        }
        self.finished.push(self.fields());
        Ok(())
    }

    /// Returns the directory of the current level, sorted by tag.
    fn fields(&self) -> Vec<Field> {
        let Writing { spec, settings, chunks, .. } = &self.current;
        let n = spec.nchannels();
        let colors = if n >= 3 { 3 } else { 1 };
        let predictor = match settings.compression {
            Compression::None | Compression::PackBits => 1,
            _ if is_float(spec.pixel_type) => 3,
            _ => 2,
        };
        let mut fields = vec![
            Field::long(tags::NEW_SUBFILE_TYPE, self.kind()),
            Field::long(tags::IMAGE_WIDTH, spec.width),
            Field::long(tags::IMAGE_LENGTH, spec.height),
            Field::shorts(tags::BITS_PER_SAMPLE, &vec![8 * spec.pixel_type.bytes() as u16; n]),
            Field::shorts(tags::COMPRESSION, &[settings.compression.code()]),
            Field::shorts(tags::PHOTOMETRIC, &[if n >= 3 { 2 } else { 1 }]),
            Field::shorts(tags::SAMPLES_PER_PIXEL, &[n as u16]),
            Field::shorts(tags::PLANAR_CONFIG, &[if settings.separate { 2 } else { 1 }]),
            Field::shorts(tags::SAMPLE_FORMAT, &vec![if is_float(spec.pixel_type) { 3 } else { 1 }; n]),
        ];
        if predictor != 1 {
            fields.push(Field::shorts(tags::PREDICTOR, &[predictor]));
        }
        if n > colors {
            // Pixels of a renderer are multiplied by alpha, which is kind 1.
            let straight = spec.attributes.int("unassociatedalpha").unwrap_or(0) != 0;
            let alpha = if straight { 2 } else { 1 };
            let kind = |i| if spec.alpha_channel() == Some(i) { alpha } else { 0 };
            fields.push(Field::shorts(tags::EXTRA_SAMPLES, &(colors..n).map(kind).collect::<Vec<_>>()));
        }
        let written = || chunks.iter().map(|c| c.unwrap_or_default());
        let list = |part: fn((u64, u64)) -> u64| written().map(part).collect::<Vec<_>>().into_iter();
        let places = |tag, part| Field::places(tag, list(part), self.big_tiff);
        if spec.is_tiled() {
            fields.push(Field::long(tags::TILE_WIDTH, spec.tile_width));
            fields.push(Field::long(tags::TILE_LENGTH, spec.tile_height));
            fields.push(places(tags::TILE_OFFSETS, |c| c.0));
            fields.push(places(tags::TILE_BYTE_COUNTS, |c| c.1));
        } else {
            fields.push(Field::long(tags::ROWS_PER_STRIP, settings.rows_per_strip));
            fields.push(places(tags::STRIP_OFFSETS, |c| c.0));
            fields.push(places(tags::STRIP_BYTE_COUNTS, |c| c.1));
        }
        // The windows are relative to the upper left corner of the display window, because TIFF has no other origin.
        let (x, y) = (i64::from(spec.x) - i64::from(spec.full_x), i64::from(spec.y) - i64::from(spec.full_y));
        let within = |v: i64| v.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32;
        let (x, y) = (within(x), within(y));
        let cube = spec.string("textureformat").is_some_and(|t| t.starts_with("CubeFace"));
        let shown = exif::entries(&spec.attributes, exif::Part::Image, &[]);
        let shown = shown.into_iter().map(Field::of_exif);
        let has_windows =
            cube || (spec.full_width, spec.full_height) != (spec.width, spec.height) || (x, y) != (0, 0);
        fields.extend(resolution(shown, has_windows));
        if has_windows {
            fields.push(Field::long(tags::FULL_WIDTH, spec.full_width));
            fields.push(Field::long(tags::FULL_LENGTH, spec.full_height));
            fields.push(Field::rational(tags::X_POSITION, x));
            fields.push(Field::rational(tags::Y_POSITION, y));
        }
        for (tag, name) in tags::STRINGS.into_iter().filter(|(tag, _)| *tag != tags::XMP) {
            let named = |name: &str| spec.attributes.iter().rev().find(|p| p.name.eq_ignore_ascii_case(name));
            let mut given = named(name);
            if tag == tags::COPYRIGHT {
                given = given.or_else(|| named("owner"));
            }
            if let Some(text) = given.and_then(|p| spec.string(&p.name)) {
                fields.push(Field::text(tag, text));
            } else if tag == tags::SOFTWARE {
                fields.push(Field::text(tag, &format!("Granita {}", granita_base::VERSION)));
            }
        }
        // XMP is not a text of TIFF, which ends with a NUL.
        fields.extend(
            settings::packet(&spec.attributes).map(|text| Field::bytes(tags::XMP, 1, text.as_bytes())),
        );
        for (tag, name) in tags::MATRICES {
            if let Some(matrix) = spec.matrix(name) {
                fields.push(Field::floats(tag, &matrix));
            }
        }
        if let Some(cot) = spec.attributes.float("fovcot") {
            fields.push(Field::floats(tags::FOV_COT, &[cot]));
        }
        // What concerns an image is not repeated for its levels.
        if self.finished.is_empty() || self.pages.len() > 1 {
            fields.extend(metadata_directories(spec));
            if let Some(profile) = &spec.icc_profile {
                fields.push(Field::bytes(tags::ICC_PROFILE, 7, profile));
            }
            if let Some(mut data) = iptc::write(&spec.attributes) {
                // Readers expect the bytes as numbers of 32 bits.
                data.resize(data.len().next_multiple_of(4), 0);
                fields.push(Field { count: data.len() as u64 / 4, ..Field::bytes(tags::IPTC, 4, &data) });
            }
        }
        fields.sort_by_key(|f| f.tag);
        fields
    }

    /// Writes a directory and the values that do not fit in it. Returns its offset, and the offset of its link to the
    /// next one.
    fn write_directory(&mut self, fields: &[Field]) -> Result<(u64, u64)> {
        let inline = if self.big_tiff { 8 } else { 4 };
        let mut bytes = Vec::new();
        /// Appends a number of `width` bytes.
        fn number(bytes: &mut Vec<u8>, n: u64, width: usize) {
            bytes.extend_from_slice(&n.to_le_bytes()[..width]);
        }
        number(&mut bytes, fields.len() as u64, if self.big_tiff { 8 } else { 2 });
        for field in fields {
            let linked = match &field.directory[..] {
                [] => None,
                directory => {
                    let (at, _) = self.write_directory(directory)?;
                    Some(Field::places(field.tag, std::iter::once(at), self.big_tiff))
                }
            };
            let field = linked.as_ref().unwrap_or(field);
            bytes.extend(field.tag.to_le_bytes());
            bytes.extend(field.kind.to_le_bytes());
            number(&mut bytes, field.count, inline);
            if field.bytes.len() <= inline {
                bytes.extend_from_slice(&field.bytes);
                bytes.resize(bytes.len() + inline - field.bytes.len(), 0);
            } else {
                let at = self.append(&field.bytes)?;
                number(&mut bytes, at, inline);
            }
        }
        number(&mut bytes, 0, inline);
        let at = self.append(&bytes)?;
        Ok((at, at + (bytes.len() - inline) as u64))
    }
}

/// Returns the bytes of a strip or tile: predicted, little-endian, compressed.
fn pack(pixels: &Pixels, width: usize, step: usize, settings: &Settings) -> std::io::Result<Vec<u8>> {
    let compression = settings.compression;
    let size = pixels.pixel_type().bytes();
    let predict = matches!(compression, Compression::Lzw | Compression::Deflate);
    let mut bytes = Vec::with_capacity(pixels.len() * size);
    match pixels.pixel_type() {
        PixelType::U8 | PixelType::U16 | PixelType::U32 if predict => {
            let mut differences = pixels.clone();
            apply_horizontal(&mut differences, width, step);
            differences.append_le_bytes(&mut bytes);
        }
        PixelType::Half | PixelType::Float if predict => {
            pixels.append_le_bytes(&mut bytes);
            apply_floating(&mut bytes, width, step, size);
        }
        _ => pixels.append_le_bytes(&mut bytes),
    }
    if compression == Compression::None {
        Ok(bytes)
    } else {
        let content = if size == 1 { Content::Bytes } else { Content::Words };
        compression.encode(&bytes, width * size, content, settings.level)
    }
}

impl ImageOutput for TiffOutput {
    fn write_rows(&mut self, pixels: &Pixels) -> Result<()> {
        self.check_type(pixels)?;
        let spec = &self.current.spec;
        let row = spec.width as usize * spec.nchannels();
        let count = pixels.len() / row;
        let next_y = match &self.current.rows {
            Rows::Strip { next_y, .. } => *next_y,
            Rows::Tiles(rows) => rows.as_ref().map_or(0, TileRows::next_y),
        };
        if !pixels.len().is_multiple_of(row) || count > (spec.height - next_y) as usize {
            let what = format!(
                "{} values are no whole rows of {row}, or more than the {} rows left",
                pixels.len(),
                spec.height - next_y
            );
            return Err(self.current.misuse(&self.file, what));
        }
        if let Rows::Tiles(rows) = &mut self.current.rows {
            let mut tiles = rows.take().unwrap_or_else(|| TileRows::new(&self.current.spec));
            let spec = self.current.spec.clone();
            let mut row: Vec<(u32, u32, Pixels)> = Vec::with_capacity(spec.tiles().0 as usize);
            tiles.push(&spec, pixels, |tx, ty, tile| {
                row.push((tx, ty, tile.clone()));
                if tx + 1 < spec.tiles().0 {
                    return Ok(());
                }
                self.write_tiles(&std::mem::take(&mut row))
            })?;
            self.current.rows = Rows::Tiles(Some(tiles));
            return Ok(());
        }
        let (width, height) = (spec.width as usize, spec.height);
        let per_strip = self.current.settings.rows_per_strip;
        let mut done = 0;
        while done < count {
            let Rows::Strip { pixels: strip, filled, next_y } = &mut self.current.rows else { break };
            let number = *next_y / per_strip;
            // Available whole strips are packed several at once.
            let ready = if *filled == 0 { (count - done) / per_strip as usize } else { 0 };
            if ready > 1 {
                let ready = ready.min(4 * rayon::current_num_threads());
                let len = per_strip as usize * row;
                *next_y += ready as u32 * per_strip;
                let strips: Vec<Pixels> = (0..ready)
                    .map(|i| {
                        let mut strip = Pixels::zeros(pixels.pixel_type(), len);
                        strip.copy_from(0, pixels, done * row + i * len, len);
                        strip
                    })
                    .collect();
                let numbered: Vec<(usize, &Pixels)> = (number as usize..).zip(&strips).collect();
                self.write_chunks(width, &numbered)?;
                done += ready * per_strip as usize;
                continue;
            }
            let in_strip = per_strip.min(height - number * per_strip) as usize;
            let take = (in_strip - *filled).min(count - done);
            strip.copy_from(*filled * row, pixels, done * row, take * row);
            *filled += take;
            *next_y += take as u32;
            done += take;
            if *filled == in_strip {
                *filled = 0;
                let mut full = std::mem::replace(strip, Pixels::zeros(strip.pixel_type(), 0));
                let len = full.len();
                if in_strip * row < len {
                    full.truncate(in_strip * row);
                }
                self.write_chunks(width, &[(number as usize, &full)])?;
                if let Rows::Strip { pixels: strip, .. } = &mut self.current.rows {
                    *strip = if full.len() == len { full } else { Pixels::zeros(full.pixel_type(), len) };
                }
            }
        }
        Ok(())
    }

    fn write_tile(&mut self, tx: u32, ty: u32, pixels: &Pixels) -> Result<()> {
        let number = self.tile_number(tx, ty, pixels)?;
        self.write_chunks(self.current.spec.tile_width as usize, &[(number, pixels)])
    }

    fn write_tiles(&mut self, tiles: &[(u32, u32, Pixels)]) -> Result<()> {
        let numbered: Vec<(usize, &Pixels)> = tiles
            .iter()
            .map(|(tx, ty, pixels)| Ok((self.tile_number(*tx, *ty, pixels)?, pixels)))
            .collect::<Result<_>>()?;
        let width = self.current.spec.tile_width as usize;
        // Not all are packed at once, because packed tiles stay in memory.
        let at_once = 8 * rayon::current_num_threads();
        numbered.chunks(at_once).try_for_each(|group| self.write_chunks(width, group))
    }

    fn plan_levels(&mut self, specs: &[ImageSpec]) -> Result<bool> {
        if !self.finished.is_empty() || !self.planned.is_empty() {
            return Err(self.current.misuse(&self.file, "levels are planned after the first".to_owned()));
        }
        let path = self.file.path();
        let next = specs.iter().map(|spec| Writing::new(path, spec, Some(self.first)).map(Some));
        self.planned = std::iter::once(Ok(None)).chain(next).collect::<Result<_>>()?;
        Ok(true)
    }

    fn select_level(&mut self, level: usize) -> Result<()> {
        let Some(slot) = self.planned.get_mut(level) else {
            return Err(self.current.misuse(&self.file, format!("level {level} was not planned")));
        };
        // The only entry without a level is that of the current one.
        if let Some(next) = slot.take() {
            let old = std::mem::replace(&mut self.current, next);
            let empty = (0..self.planned.len()).find(|i| *i != level && self.planned[*i].is_none());
            if let Some(empty) = empty {
                self.planned[empty] = Some(old);
            }
        }
        Ok(())
    }

    fn next_level(&mut self, spec: &ImageSpec) -> Result<()> {
        if !self.planned.is_empty() {
            return Err(self.current.misuse(&self.file, "a further level after the planned ones".to_owned()));
        }
        let next = Writing::new(self.file.path(), spec, Some(self.first))?;
        self.finish_level()?;
        self.current = next;
        Ok(())
    }

    fn select_image(&mut self, image: usize) -> Result<()> {
        if image == self.page {
            return Ok(());
        }
        let Some(next) = self.pages.get(image).filter(|_| image == self.page + 1).cloned() else {
            let (page, count) = (self.page, self.pages.len().max(1));
            let what = format!("page {image} after page {page} of {count}");
            return Err(self.current.misuse(&self.file, what));
        };
        let next = Writing::new(self.file.path(), &next, None)?;
        self.finish_level()?;
        (self.current, self.page) = (next, image);
        Ok(())
    }

    fn close(mut self: Box<Self>) -> Result<()> {
        if self.page + 1 < self.pages.len() {
            let (next, count) = (self.page + 1, self.pages.len());
            return Err(self.current.misuse(&self.file, format!("page {next} of {count} is missing")));
        }
        if self.planned.is_empty() {
            self.finish_level()?;
        }
        for level in 0..self.planned.len() {
            self.select_level(level)?;
            self.finish_level()?;
        }
        // All directories are together at the end, so that readers get them in one read.
        let mut link = if self.big_tiff { 8 } else { 4 };
        let width = if self.big_tiff { 8 } else { 4 };
        let mut links = Vec::new();
        for fields in std::mem::take(&mut self.finished) {
            let (at, next) = self.write_directory(&fields)?;
            links.push((link, at));
            link = next;
        }
        for (link, at) in links {
            let bytes = &at.to_le_bytes()[..width];
            let io = |f: &mut AtomicFile| f.seek(SeekFrom::Start(link)).and_then(|_| f.write_all(bytes));
            io(&mut self.file).map_err(|e| self.file.io_error(e))?;
        }
        Ok(self.file.commit()?)
    }
}
