//! Reads chunks by position, from any thread.

use crate::deep::{DeepChannels, DeepChunk, DeepSizes};
use crate::part::{Level, Part, exr_fault, read_headers};
use crate::zip;
use exr::block::UncompressedBlock;
use exr::block::chunk::{
    Chunk, CompressedBlock, CompressedScanLineBlock, CompressedTileBlock, TileCoordinates,
};
use exr::compression::Compression;
use exr::meta::MetaData;
use exr::meta::header::Header;
use exr::prelude::Vec2;
use granita_image::{
    DeepSamples, FileSource, ImageInput, ImageSpec, Limits, Pixels, Result, contained, rows_from_tiles,
};
use parking_lot::Mutex;
use rayon::prelude::*;
use std::path::Path;
use std::sync::Arc;

/// An open OpenEXR file.
///
/// Every part is an image. Only headers are read at first. A part's table of chunks is read when the part is first
/// used. One tile is two positioned reads, of its head and its data.
#[derive(Debug)]
pub struct ExrInput {
    source: FileSource,
    meta: MetaData,
    limits: Limits,
    parts: Vec<Part>,
    /// The block of scanlines read last, by indices of image and block, because rows are often read one by one.
    last_block: Mutex<Option<([usize; 2], Arc<Pixels>)>>,
}

impl ExrInput {
    /// Opens a file and reads its headers.
    ///
    /// # Errors
    /// Returns an error when the headers are damaged, or when no part is of a supported kind.
    pub fn open(path: &Path, limits: &Limits) -> Result<Self> {
        let source = FileSource::open(path, "OpenEXR", &limits.files)?;
        let (meta, mut table_at) = read_headers(&source)?;
        limits.within(path, "number of images", meta.headers.len() as u64, u64::from(limits.images))?;
        let mut parts = Vec::new();
        let mut first_fault = None;
        for (index, header) in meta.headers.iter().enumerate() {
            let chunks = header.chunk_count as u64;
            if chunks > (source.len() - table_at.min(source.len())) / 8 {
                let what = format!("a table of {chunks} chunks at byte {table_at} of {}", source.len());
                return Err(source.malformed(what));
            }
            match Part::understand(&source, index, header, limits, table_at) {
                Ok(part) => parts.push(part),
                Err(error @ granita_image::ImageError::Unsupported { .. }) => {
                    first_fault.get_or_insert(error);
                }
                Err(error) => return Err(error),
            }
            table_at += chunks * 8;
        }
        if parts.is_empty() {
            return Err(first_fault.unwrap_or_else(|| source.malformed("there is no image in it")));
        }
        Ok(Self { source, meta, limits: limits.clone(), parts, last_block: Mutex::new(None) })
    }

    fn level(&self, image: usize, level: usize) -> Result<(&Part, &Level)> {
        self.parts.get(image).and_then(|p| Some((p, p.levels.get(level)?))).ok_or_else(|| {
            self.source
                .misuse(format!("there is no level {level} of image {image} (of {})", self.parts.len()))
        })
    }

    /// Reads tile or block of scanlines `(cx, cy)`. Tiles have full size, and the rest of an edge tile is 0.
    fn read_chunk(&self, part: &Part, level: &Level, cx: u32, cy: u32) -> Result<Pixels> {
        let (spec, source) = (&level.spec, &self.source);
        let (across, width, height) = if spec.is_tiled() {
            (spec.tiles().0, spec.tile_width, spec.tile_height)
        } else {
            (1, spec.width, part.block_rows.min(spec.height - cy * part.block_rows))
        };
        let bytes = self.limits.check_read(source.path(), spec, width, height)? as u64;
        // The memory holds the data packed, unpacked and in order.
        Limits::check_memory(source.path(), bytes.saturating_mul(4))?;
        let number = level.first_chunk + cy as usize * across as usize + cx as usize;
        let what = if spec.is_tiled() { "tile" } else { "block of scanlines" };
        let malformed = |fault: String| source.malformed(format!("{what} {number}: {fault}"));
        let at = part.table(source)?.get(number).copied().unwrap_or(0);
        if at == 0 {
            return Err(malformed("it was never written".to_owned()));
        }
        let header = &self.meta.headers[part.header];
        if let Some(channels) = &part.deep {
            let chunk = self.read_deep(part, level, channels, (cx, cy)).map_err(|e| match e {
                Fault::Image(error) => error,
                Fault::Data(fault) => malformed(fault),
            })?;
            let n = width as usize * height as usize * spec.nchannels();
            let mut pixels = Pixels::zeros(spec.pixel_type, n);
            chunk.flatten(&part.order.order, width as usize, &mut pixels);
            return Ok(pixels);
        }
        let (block, size) = self.read_block(part, level, (cx, cy), at).map_err(|e| match e {
            Fault::Image(error) => error,
            Fault::Data(fault) => malformed(fault),
        })?;
        // The size of the chunk in pixels. Tiles at the edges are stored cropped.
        let (w, h) = if spec.is_tiled() {
            let left =
                |side: u32, tile: u32, i: u32| side.saturating_sub(i.saturating_mul(tile)).min(tile) as usize;
            (left(spec.width, width, cx), left(spec.height, height, cy))
        } else {
            (width as usize, height as usize)
        };
        let mut pixels = Pixels::zeros(spec.pixel_type, width as usize * height as usize * spec.nchannels());
        if let Some(data) = unzipped(header, &block, header.channels.bytes_per_pixel * w * h) {
            part.order.scatter(&data, w, h, width as usize, &mut pixels);
            return Ok(pixels);
        }
        let chunk = Chunk { layer_index: part.header, compressed_block: block };
        let block = contained(|| UncompressedBlock::decompress_chunk(chunk, &self.meta, false))
            .map_err(malformed)?
            .map_err(|e| exr_fault(source, e, &format!("{what} {number}")))?;
        let (w, h) = (block.index.pixel_size.0, block.index.pixel_size.1);
        let bytes = header.channels.bytes_per_pixel * w * h;
        if w > width as usize || h > height as usize || block.data.len() != bytes {
            return Err(malformed(format!(
                "{size} bytes hold {w} x {h} pixels in {} bytes",
                block.data.len()
            )));
        }
        part.order.scatter(&block.data, w, h, width as usize, &mut pixels);
        Ok(pixels)
    }

    /// Reads a chunk of a deep part.
    fn read_deep<'c>(
        &self,
        part: &Part,
        level: &Level,
        channels: &'c DeepChannels,
        (cx, cy): (u32, u32),
    ) -> std::result::Result<DeepChunk<'c>, Fault> {
        let (spec, header) = (&level.spec, &self.meta.headers[part.header]);
        let (across, tile_width, tile_height) = match spec.is_tiled() {
            true => (spec.tiles().0, spec.tile_width, spec.tile_height),
            false => (1, spec.width, part.block_rows),
        };
        let left =
            |side: u32, tile: u32, i: u32| side.saturating_sub(i.saturating_mul(tile)).min(tile) as usize;
        let size = (left(spec.width, tile_width, cx), left(spec.height, tile_height, cy));
        let number = level.first_chunk + cy as usize * across as usize + cx as usize;
        let at = part.table(&self.source).map_err(Fault::Image)?.get(number).copied().unwrap_or(0);
        let wanted = self.wanted(part, level, (cx, cy));
        let head_bytes = 4 * wanted.len() as u64 + 24;
        let head = self.source.read_vec(at, head_bytes, "a chunk").map_err(Fault::Image)?;
        check_place(&head, &wanted, at)?;
        let sizes = match head.last_chunk::<24>() {
            Some(bytes) => DeepSizes::new(bytes),
            None => return Err(Fault::Data("it has no head".to_owned())),
        };
        let pixels = (tile_width as usize).checked_mul(tile_height as usize).filter(|n| *n <= usize::MAX / 4);
        let pixels = pixels.ok_or_else(|| Fault::Data(format!("{tile_width} x {tile_height} pixels")))?;
        sizes.check(pixels).map_err(Fault::Data)?;
        let path = self.source.path();
        let most = self.limits.bytes;
        self.limits.within(path, "bytes of deep samples", sizes.unpacked, most).map_err(Fault::Image)?;
        Limits::check_memory(path, sizes.unpacked.saturating_mul(3)).map_err(Fault::Image)?;
        let at = at + head_bytes;
        let table = self.source.read_vec(at, sizes.table, "a chunk").map_err(Fault::Image)?;
        let data = self.source.read_vec(at + sizes.table, sizes.data, "a chunk").map_err(Fault::Image)?;
        let parts = (&*table, &*data, sizes.unpacked);
        DeepChunk::new(channels, header.compression, size, parts).map_err(Fault::Data)
    }

    /// Returns the numbers with which a chunk begins: the part in a file of several, and the place.
    fn wanted(&self, part: &Part, level: &Level, (cx, cy): (u32, u32)) -> Vec<i32> {
        let header = &self.meta.headers[part.header];
        let mut wanted: Vec<i32> = Vec::new();
        if self.meta.requirements.has_multiple_layers {
            wanted.push(part.header as i32);
        }
        if level.spec.is_tiled() {
            wanted.extend([cx as i32, cy as i32, level.index as i32, level.index as i32]);
        } else {
            wanted.push(header.own_attributes.layer_position.y().wrapping_add((cy * part.block_rows) as i32));
        }
        wanted
    }

    /// Reads the chunk at byte `at`, whose header must match the requested chunk. Also returns its packed size.
    fn read_block(
        &self,
        part: &Part,
        level: &Level,
        (cx, cy): (u32, u32),
        at: u64,
    ) -> std::result::Result<(CompressedBlock, u64), Fault> {
        let header = &self.meta.headers[part.header];
        let tiled = level.spec.is_tiled();
        let wanted = self.wanted(part, level, (cx, cy));
        let head = self.source.read_vec(at, 4 * wanted.len() as u64 + 4, "a chunk").map_err(Fault::Image)?;
        check_place(&head, &wanted, at)?;
        let size = i64::from(head.last_chunk().map_or(0, |bytes| i32::from_le_bytes(*bytes)));
        if size <= 0 || size > header.max_block_byte_size() as i64 {
            return Err(Fault::Data(format!(
                "it is {size} bytes of at most {}",
                header.max_block_byte_size()
            )));
        }
        let size = size as u64;
        let packed = self.source.read_vec(at + head.len() as u64, size, "a chunk").map_err(Fault::Image)?;
        Ok((
            if tiled {
                CompressedBlock::Tile(CompressedTileBlock {
                    coordinates: TileCoordinates {
                        tile_index: Vec2(cx as usize, cy as usize),
                        level_index: Vec2(level.index, level.index),
                    },
                    compressed_pixels_le: packed,
                })
            } else {
                CompressedBlock::ScanLine(CompressedScanLineBlock {
                    y_coordinate: wanted.last().copied().unwrap_or(0),
                    compressed_pixels_le: packed,
                })
            },
            size,
        ))
    }

    /// Returns a block of scanlines, which may be the one read last.
    fn block(&self, key: [usize; 2], part: &Part) -> Result<Arc<Pixels>> {
        // The value is replaced as a whole, so it is consistent even after a panic in another thread.
        let last = || self.last_block.lock();
        if let Some((held, pixels)) = &*last()
            && *held == key
        {
            return Ok(pixels.clone());
        }
        let pixels = Arc::new(self.read_chunk(part, &part.levels[0], 0, key[1] as u32)?);
        *last() = Some((key, pixels.clone()));
        Ok(pixels)
    }
}

/// Returns the `len` bytes of a zipped block by the faster library; `None` when the block is not zipped or has an
/// error. This is the common case.
fn unzipped(header: &Header, block: &CompressedBlock, len: usize) -> Option<Vec<u8>> {
    if !matches!(header.compression, Compression::ZIP1 | Compression::ZIP16) || cfg!(target_endian = "big") {
        return None;
    }
    let packed = match block {
        CompressedBlock::Tile(b) => &b.compressed_pixels_le,
        CompressedBlock::ScanLine(b) => &b.compressed_pixels_le,
        CompressedBlock::DeepTile(_) | CompressedBlock::DeepScanLine(_) => return None,
    };
    // Data that would not shrink is stored uncompressed.
    if packed.len() >= len { None } else { zip::decompress(packed, len) }
}

/// Checks that a chunk at byte `at` begins with the numbers `wanted`.
fn check_place(head: &[u8], wanted: &[i32], at: u64) -> std::result::Result<(), Fault> {
    let words = head.as_chunks::<4>().0.iter().map(|bytes| i32::from_le_bytes(*bytes));
    let found: Vec<i32> = words.take(wanted.len()).collect();
    if found == wanted {
        Ok(())
    } else {
        Err(Fault::Data(format!("at byte {at} is {found:?} instead of {wanted:?}")))
    }
}

/// An error of a chunk.
enum Fault {
    Image(granita_image::ImageError),
    Data(String),
}

impl ImageInput for ExrInput {
    fn format_name(&self) -> &'static str {
        "exr"
    }

    fn images(&self) -> usize {
        self.parts.len()
    }

    fn levels(&self, image: usize) -> usize {
        self.parts.get(image).map_or(0, |p| p.levels.len())
    }

    fn spec(&self, image: usize, level: usize) -> Option<&ImageSpec> {
        Some(&self.parts.get(image)?.levels.get(level)?.spec)
    }

    fn rows_together(&self, image: usize, level: usize) -> Option<u32> {
        let (part, l) = self.level(image, level).ok()?;
        (!l.spec.is_tiled()).then_some(part.block_rows)
    }

    fn read_rows(&self, image: usize, level: usize, y0: u32, y1: u32) -> Result<Pixels> {
        let (part, l) = self.level(image, level)?;
        let spec = &l.spec;
        if y0 > y1 || y1 > spec.height {
            return Err(self.source.misuse(format!("rows {y0} to {y1} of an image with {}", spec.height)));
        }
        let bytes = self.limits.check_read(self.source.path(), spec, spec.width, y1 - y0)?;
        if spec.is_tiled() {
            part.table(&self.source)?;
            return rows_from_tiles(spec, y0, y1, |tx, ty| self.read_chunk(part, l, tx, ty));
        }
        let row = spec.width as usize * spec.nchannels();
        // Whole blocks are decoded at once, in the threads of the caller's pool. Rows of a part of a block are read
        // from the block that is held.
        let rows = part.block_rows;
        let (first, last) =
            (y0.div_ceil(rows), if y1 == spec.height { y1.div_ceil(rows) } else { y1 / rows });
        if last > first + 1 {
            part.table(&self.source)?;
            let mut out = Pixels::zeros(spec.pixel_type, bytes / spec.pixel_type.bytes());
            // The number at once is sufficient for all threads. The memory is that of the result and a few blocks.
            let at_once = 4 * rayon::current_num_threads() as u32;
            for group in (first..last).step_by(at_once as usize) {
                let blocks: Vec<Pixels> = (group..last.min(group + at_once))
                    .into_par_iter()
                    .map(|number| self.read_chunk(part, l, 0, number))
                    .collect::<Result<_>>()?;
                for (number, block) in (group..).zip(&blocks) {
                    out.copy_from((number * rows - y0) as usize * row, block, 0, block.len());
                }
            }
            for (a, b) in [(y0, first * rows), (last.saturating_mul(rows).min(y1), y1)] {
                if a < b {
                    let part = self.read_rows(image, level, a, b)?;
                    out.copy_from((a - y0) as usize * row, &part, 0, part.len());
                }
            }
            return Ok(out);
        }
        let mut out: Option<Pixels> = None;
        let mut y = y0;
        while y < y1 {
            let number = y / part.block_rows;
            let top = number * part.block_rows;
            let take = (top.saturating_add(part.block_rows).min(y1) - y) as usize;
            let block = self.block([image, number as usize], part)?;
            let out =
                out.get_or_insert_with(|| Pixels::zeros(spec.pixel_type, bytes / spec.pixel_type.bytes()));
            out.copy_from((y - y0) as usize * row, &block, (y - top) as usize * row, take * row);
            y += take as u32;
        }
        Ok(out.unwrap_or_else(|| Pixels::zeros(spec.pixel_type, 0)))
    }

    fn read_tile(&self, image: usize, level: usize, tx: u32, ty: u32) -> Result<Pixels> {
        let (part, l) = self.level(image, level)?;
        let (across, down) = l.spec.tiles();
        if tx >= across || ty >= down {
            let what = if l.spec.is_tiled() {
                format!("there is no tile ({tx}, {ty}) among {across} x {down}")
            } else {
                "a tile of an image stored in scanlines".to_owned()
            };
            return Err(self.source.misuse(what));
        }
        self.read_chunk(part, l, tx, ty)
    }

    fn deep_samples(&self, image: usize, level: usize) -> Result<Option<DeepSamples>> {
        let (part, l) = self.level(image, level)?;
        let Some(channels) = &part.deep else { return Ok(None) };
        let (across, down) = match l.spec.is_tiled() {
            true => l.spec.tiles(),
            false => (1, l.spec.height.div_ceil(part.block_rows)),
        };
        let mut all = DeepSamples::default();
        for (cx, cy) in (0..down).flat_map(|cy| (0..across).map(move |cx| (cx, cy))) {
            let chunk = self.read_deep(part, l, channels, (cx, cy)).map_err(|e| match e {
                Fault::Image(error) => error,
                Fault::Data(fault) => self.source.malformed(format!("chunk ({cx}, {cy}): {fault}")),
            })?;
            let (total, most) = chunk.counts();
            all.total = all.total.saturating_add(total);
            all.most_per_pixel = all.most_per_pixel.max(most);
        }
        Ok(Some(all))
    }

    fn bytes_read(&self) -> u64 {
        self.source.bytes_read()
    }

    /// Returns the bytes of a row of tiles. Blocks of scanlines have few rows.
    fn working_bytes(&self, image: usize, level: usize) -> u64 {
        self.spec(image, level).map_or(0, |spec| spec.decoding_bytes(spec.tile_height))
    }
}
