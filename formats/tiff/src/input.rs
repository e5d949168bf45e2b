//! Reads strips and tiles by position, from any thread.

use crate::codec::Compression;
use crate::colors::Colors;
use crate::directory::{Layout, read_directories};
use crate::level::{Level, understand};
use crate::strip_file::Chunk;
use crate::{codec, fax, jpeg, logluv, logluv24, webp};
use granita_image::{
    FileSource, ImageError, ImageInput, ImageSpec, Limits, PixelType, Pixels, Result, rows_from_tiles,
};
use parking_lot::Mutex;
use rayon::prelude::*;
use std::path::Path;
use std::sync::Arc;

/// An open TIFF file.
///
/// Every directory is an image, or a MIP level of the image before it (see [`crate`]). Tables of strips and tiles are
/// read when a level is first used, so that opening a large texture needs little time.
#[derive(Debug)]
pub struct TiffInput {
    source: FileSource,
    layout: Layout,
    limits: Limits,
    images: Vec<Vec<Level>>,
    /// The strip read last, by image, level and number, because rows are often read one by one.
    last_strip: Mutex<Option<([usize; 3], Arc<Pixels>)>>,
}

impl TiffInput {
    /// Opens a file and reads its directories, not its pixels.
    ///
    /// # Errors
    /// Returns an error when a directory is damaged, or when the first image is of a kind that is not supported.
    /// Further images that are legal but not supported are left out.
    pub fn open(path: &Path, limits: &Limits) -> Result<Self> {
        let source = FileSource::open(path, "TIFF", &limits.files)?;
        let (layout, directories) = read_directories(&source, limits)?;
        let mut images: Vec<Vec<Level>> = Vec::new();
        for directory in directories {
            let level = match understand(&source, directory, limits) {
                Ok(level) => level,
                Err(ImageError::Unsupported { .. }) if !images.is_empty() => continue,
                Err(error) => return Err(error),
            };
            match images.last_mut().filter(|image| image[image.len() - 1].is_followed_by(&level, &image[0])) {
                Some(image) => image.push(level),
                None => images.push(vec![level]),
            }
        }
        Ok(Self { source, layout, limits: limits.clone(), images, last_strip: Mutex::new(None) })
    }

    fn level(&self, image: usize, level: usize) -> Result<&Level> {
        self.images.get(image).and_then(|i| i.get(level)).ok_or_else(|| {
            self.source
                .misuse(format!("there is no level {level} of image {image} (of {})", self.images.len()))
        })
    }

    /// Reads strip or tile `(cx, cy)` with all its channels.
    fn read_chunk(&self, level: &Level, cx: u32, cy: u32) -> Result<Pixels> {
        let spec = &level.spec;
        let width = level.chunk.0;
        let height =
            if spec.is_tiled() { level.chunk.1 } else { level.chunk.1.min(spec.height - cy * level.chunk.1) };
        let bytes = self.limits.check_read(self.source.path(), spec, width, height)? as u64;
        // The memory holds the data packed, unpacked and in order. Data that is converted is stored in up to twice the
        // bytes, or becomes floats meanwhile.
        let times = if level.colors.is_some() || level.by_crate.is_some() { 12 } else { 3 };
        Limits::check_memory(self.source.path(), bytes.saturating_mul(times))?;
        let (across, down) = level.chunks();
        let index = cy as usize * across as usize + cx as usize;
        let size = (width as usize, height as usize);
        let n = level.samples;
        let mut pixels = if level.separate {
            let mut all = Pixels::zeros(spec.pixel_type, size.0 * size.1 * n);
            for plane in 0..n {
                let index = plane * across as usize * down as usize + index;
                all.set_plane(plane, n, &self.decode(level, index, size, 1)?);
            }
            all
        } else {
            self.decode(level, index, size, n)?
        };
        if let (Some(palette), Pixels::U8(indices)) = (&level.palette, &pixels) {
            // The palette has an entry for every value that the stored bits can have.
            pixels = Pixels::U8(indices.iter().flat_map(|i| palette[usize::from(*i)]).collect());
        }
        if let Some(colors) = &level.colors {
            pixels = colors.to_rgb(&pixels, n);
        }
        if level.invert {
            match &mut pixels {
                Pixels::U8(v) => v.iter_mut().for_each(|v| *v = !*v),
                Pixels::U16(v) => v.iter_mut().for_each(|v| *v = !*v),
                // White has no agreed value in the other types.
                Pixels::U32(_) | Pixels::Half(_) | Pixels::Float(_) => {}
            }
        }
        Ok(pixels)
    }

    /// Decodes entry `index` of the table, which has `size` pixels of `samples` values.
    fn decode(&self, level: &Level, index: usize, size: (usize, usize), samples: usize) -> Result<Pixels> {
        let source = &self.source;
        let table = level.table(source)?;
        let (offset, count) = (table.offsets[index], table.counts[index]);
        let pixel_type = level.spec.pixel_type;
        let (row_values, bits) = (size.0 * samples, level.bits as usize);
        let mut needed = (row_values * bits).div_ceil(8) * size.1;
        let blocks = match &level.colors {
            Some(Colors::YCbCr(tags)) if tags.block != (1, 1) => Some(tags),
            _ => None,
        };
        if let Some(tags) = blocks {
            needed = tags.block_bytes(size);
        }
        if offset == 0 && count == 0 {
            // In a sparse file this part was never written. It represents zeros.
            return Ok(Pixels::zeros(pixel_type, row_values * size.1));
        }
        let what = if level.spec.is_tiled() { "tile" } else { "strip" };
        let malformed = |fault: String| source.malformed(format!("{what} {index} at byte {offset}: {fault}"));
        // No scheme packs more densely, so a short strip cannot request a huge buffer.
        let densest = match level.compression {
            Compression::None => 1,
            // A run of 128 KiB takes four bytes. A row that equals the one above takes a bit.
            // A repetition of 273 bytes takes at least a third of a bit of LZMA.
            Compression::Zstd | Compression::Lzma | Compression::Group4 | Compression::Group3 => 1 << 15,
            _ => 4096,
        };
        if count.saturating_mul(densest) < needed as u64 {
            return Err(malformed(format!("{count} bytes cannot hold the {needed} needed")));
        }
        if offset.checked_add(count).is_none_or(|end| end > source.len()) {
            return Err(malformed(format!(
                "it has {count} bytes, but the file ends at byte {}",
                source.len()
            )));
        }
        let plain = level.compression == Compression::None;
        let mut packed = source.read_vec(offset, if plain { needed as u64 } else { count }, what)?;
        if level.reversed {
            codec::reverse_bits(&mut packed);
        }
        match level.compression {
            Compression::SgiLog => {
                return logluv::decode(&packed, size, samples).map(Pixels::Float).map_err(malformed);
            }
            Compression::SgiLog24 => {
                return logluv24::decode(&packed, size).map(Pixels::Float).map_err(malformed);
            }
            _ => {}
        }
        let mut bytes = match level.by_crate {
            Some(format) => {
                match self.decode_by_crate(level, format, packed, (size, samples)).map_err(malformed)? {
                    // The bytes are packed bits.
                    Pixels::U8(bytes) if bits < 8 => bytes,
                    pixels => return Ok(pixels),
                }
            }
            None => unpack(level, packed, needed, (size, samples)).map_err(malformed)?,
        };
        if let Some(tags) = blocks {
            bytes = tags.spread(&bytes, size);
        }
        let mut big_endian = self.layout.big_endian;
        if bits < 8 {
            bytes = codec::unpack_bits(&bytes, row_values, bits, level.palette.is_none());
        } else if level.predictor == 3 {
            bytes = codec::undo_floating(bytes, row_values, samples, pixel_type.bytes());
            big_endian = true;
        }
        if matches!(bits, 9..=15) {
            return Ok(Pixels::U16(codec::unpack_wide(&bytes, row_values, bits)));
        }
        let mut pixels = Pixels::from_bytes(pixel_type, bytes, big_endian);
        if level.predictor == 2 {
            codec::undo_horizontal(&mut pixels, row_values, samples);
        }
        Ok(pixels)
    }

    /// Decodes values of kind `format` by the crate `tiff`, after the compressions that it does not support are
    /// unpacked.
    fn decode_by_crate(
        &self,
        level: &Level,
        format: u64,
        packed: Vec<u8>,
        (size, samples): ((usize, usize), usize),
    ) -> std::result::Result<Pixels, String> {
        let bits = level.bits;
        let (data, compression) = match level.compression {
            Compression::Zstd | Compression::Lzma => {
                let needed = (size.0 * samples * bits as usize).div_ceil(8) * size.1;
                (unpack(level, packed, needed, (size, samples))?, Compression::None)
            }
            other => (packed, other),
        };
        let (compression, predictor) = (u64::from(compression.code()), level.predictor);
        let big_endian = self.layout.big_endian;
        Chunk { size, samples, bits, format, compression, predictor, big_endian }.decode(&data)
    }

    /// Returns a strip, which may be the one read last.
    fn strip(&self, key: [usize; 3], level: &Level) -> Result<Arc<Pixels>> {
        // The value is replaced as a whole, so it is consistent even after a panic in another thread.
        let last = || self.last_strip.lock();
        if let Some((held, pixels)) = &*last()
            && *held == key
        {
            return Ok(pixels.clone());
        }
        let pixels = Arc::new(self.read_chunk(level, 0, key[2] as u32)?);
        *last() = Some((key, pixels.clone()));
        Ok(pixels)
    }
}

impl ImageInput for TiffInput {
    fn format_name(&self) -> &'static str {
        "tiff"
    }

    fn images(&self) -> usize {
        self.images.len()
    }

    fn levels(&self, image: usize) -> usize {
        self.images.get(image).map_or(0, Vec::len)
    }

    fn spec(&self, image: usize, level: usize) -> Option<&ImageSpec> {
        Some(&self.images.get(image)?.get(level)?.spec)
    }

    fn read_rows(&self, image: usize, level: usize, y0: u32, y1: u32) -> Result<Pixels> {
        let l = self.level(image, level)?;
        let spec = &l.spec;
        if y0 > y1 || y1 > spec.height {
            return Err(self.source.misuse(format!("rows {y0} to {y1} of an image with {}", spec.height)));
        }
        let bytes = self.limits.check_read(self.source.path(), spec, spec.width, y1 - y0)?;
        if spec.is_tiled() {
            // The result is allocated before the tiles are read. The table is read first, to check that they exist.
            l.table(&self.source)?;
            return rows_from_tiles(spec, y0, y1, |tx, ty| self.read_chunk(l, tx, ty));
        }
        let row = spec.width as usize * spec.nchannels();
        let strip_rows = l.chunk.1;
        // Whole strips are decoded at once, in the threads of the caller's pool. Rows of a part of a strip are read
        // from the strip that is held.
        let (first, last) =
            (y0.div_ceil(strip_rows), if y1 == spec.height { l.chunks().1 } else { y1 / strip_rows });
        if last > first + 1 {
            l.table(&self.source)?;
            let mut out = Pixels::zeros(spec.pixel_type, bytes / spec.pixel_type.bytes());
            // The number at once is sufficient for all threads. The memory is that of the result and a few strips.
            let at_once = 4 * rayon::current_num_threads() as u32;
            for group in (first..last).step_by(at_once as usize) {
                let strips: Vec<Pixels> = (group..last.min(group + at_once))
                    .into_par_iter()
                    .map(|number| self.read_chunk(l, 0, number))
                    .collect::<Result<_>>()?;
                for (number, strip) in (group..).zip(&strips) {
                    out.copy_from((number * strip_rows - y0) as usize * row, strip, 0, strip.len());
                }
            }
            let (from, to) = (first * strip_rows, last.saturating_mul(strip_rows).min(y1));
            for (a, b) in [(y0, from), (to, y1)] {
                if a < b {
                    let rows = self.read_rows(image, level, a, b)?;
                    out.copy_from((a - y0) as usize * row, &rows, 0, rows.len());
                }
            }
            return Ok(out);
        }
        let mut out: Option<Pixels> = None;
        let mut y = y0;
        while y < y1 {
            let number = y / strip_rows;
            let top = number * strip_rows;
            let take = ((top.saturating_add(strip_rows)).min(y1) - y) as usize;
            let strip = self.strip([image, level, number as usize], l)?;
            let out =
                out.get_or_insert_with(|| Pixels::zeros(spec.pixel_type, bytes / spec.pixel_type.bytes()));
            out.copy_from((y - y0) as usize * row, &strip, (y - top) as usize * row, take * row);
            y += take as u32;
        }
        Ok(out.unwrap_or_else(|| Pixels::zeros(spec.pixel_type, 0)))
    }

    fn read_tile(&self, image: usize, level: usize, tx: u32, ty: u32) -> Result<Pixels> {
        let l = self.level(image, level)?;
        let (across, down) = l.spec.tiles();
        if tx >= across || ty >= down {
            let what = if l.spec.is_tiled() {
                format!("there is no tile ({tx}, {ty}) among {across} x {down}")
            } else {
                "a tile of an image stored in strips".to_owned()
            };
            return Err(self.source.misuse(what));
        }
        self.read_chunk(l, tx, ty)
    }

    fn bytes_read(&self) -> u64 {
        self.source.bytes_read()
    }

    /// Returns the bytes of a strip, or of a row of tiles.
    fn working_bytes(&self, image: usize, level: usize) -> u64 {
        self.level(image, level).map_or(0, |l| l.spec.decoding_bytes(l.chunk.1))
    }
}

/// Returns the `needed` bytes of `size` pixels of `samples` values in `packed`. `Err` describes the error in the data.
fn unpack(
    level: &Level,
    packed: Vec<u8>,
    needed: usize,
    (size, samples): ((usize, usize), usize),
) -> std::result::Result<Vec<u8>, String> {
    if level.compression == Compression::None {
        return Ok(packed);
    }
    let mut bytes = vec![0; needed];
    match level.compression {
        Compression::Jpeg => {
            let tables = level.jpeg_tables.as_deref();
            jpeg::decode(tables, &packed, &mut bytes, size, samples, level.ycc)?;
        }
        Compression::WebP => webp::decode(&packed, &mut bytes, size, samples)?,
        Compression::Runs | Compression::Group3 => fax::decode(&packed, &mut bytes, size.0, level.fax)?,
        other => other.decode(&packed, &mut bytes)?,
    }
    Ok(bytes)
}

/// True when floats of this type are written with floating-point prediction.
pub(crate) fn is_float(pixel_type: PixelType) -> bool {
    matches!(pixel_type, PixelType::Half | PixelType::Float)
}
