//! Reads chunks by position, from any thread.

use crate::attributes::{self, channel_order};
use crate::{CompressionName, Order, zip};
use exr::block::UncompressedBlock;
use exr::block::chunk::{
    Chunk, CompressedBlock, CompressedScanLineBlock, CompressedTileBlock, TileCoordinates,
};
use exr::compression::Compression;
use exr::meta::attribute::{EnvironmentMap, LevelMode, SampleType};
use exr::meta::header::Header;
use exr::meta::{BlockDescription, MetaData, compute_level_count, compute_level_size};
use exr::prelude::Vec2;
use granita_base::{BaseType, Param, ParamType};
use granita_image::{
    FileSource, ImageInput, ImageSpec, Limits, PixelType, Pixels, Result, contained, rows_from_tiles,
};
use parking_lot::Mutex;
use rayon::prelude::*;
use std::io::Read;
use std::path::Path;
use std::sync::{Arc, OnceLock};

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

/// A part of the file that can be read.
#[derive(Debug)]
struct Part {
    /// The index of the header.
    header: usize,
    levels: Vec<Level>,
    order: Order,
    /// The number of rows of one block of scanlines.
    block_rows: u32,
    table_at: u64,
    chunks: u64,
    table: OnceLock<Vec<u64>>,
}

#[derive(Debug)]
struct Level {
    spec: ImageSpec,
    /// The index of this level in both directions.
    index: usize,
    /// The index of its first chunk in the table of the part.
    first_chunk: usize,
}

/// Reads a file from its beginning and counts the bytes read.
struct Front<'a> {
    source: &'a FileSource,
    position: u64,
    buffer: Vec<u8>,
    /// The number of bytes of `buffer` that were consumed.
    used: usize,
    /// The error that ended reading, which the crate does not pass on.
    fault: Option<granita_image::ImageError>,
}

impl Read for Front<'_> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        if self.used == self.buffer.len() {
            let n = 4096.min(self.source.len() - self.position);
            self.buffer.resize(n as usize, 0);
            self.used = 0;
            if let Err(fault) = self.source.read_at(self.position, &mut self.buffer, "the header") {
                self.buffer.clear();
                self.fault = Some(fault);
            }
            self.position += self.buffer.len() as u64;
        }
        let n = out.len().min(self.buffer.len() - self.used);
        out[..n].copy_from_slice(&self.buffer[self.used..self.used + n]);
        self.used += n;
        Ok(n)
    }
}

impl Front<'_> {
    /// Returns the number of bytes that were consumed so far.
    fn consumed(&self) -> u64 {
        self.position - (self.buffer.len() - self.used) as u64
    }
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
        let mut wanted: Vec<i32> = Vec::new();
        if self.meta.requirements.has_multiple_layers {
            wanted.push(part.header as i32);
        }
        let y = header.own_attributes.layer_position.y().wrapping_add((cy * part.block_rows) as i32);
        if tiled {
            wanted.extend([cx as i32, cy as i32, level.index as i32, level.index as i32]);
        } else {
            wanted.push(y);
        }
        let head = self.source.read_vec(at, 4 * wanted.len() as u64 + 4, "a chunk").map_err(Fault::Image)?;
        let words: Vec<i32> = head.as_chunks::<4>().0.iter().map(|b| i32::from_le_bytes(*b)).collect();
        if words[..wanted.len()] != wanted[..] {
            return Err(Fault::Data(format!(
                "at byte {at} is {:?} instead of {wanted:?}",
                &words[..wanted.len()]
            )));
        }
        let size = i64::from(words[wanted.len()]);
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
                    y_coordinate: y,
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

/// An error of a chunk.
enum Fault {
    Image(granita_image::ImageError),
    Data(String),
}

/// Returns the headers, and the offset of the tables of chunks.
fn read_headers(source: &FileSource) -> Result<(MetaData, u64)> {
    let mut front = Front { source, position: 0, buffer: Vec::new(), used: 0, fault: None };
    let read = contained(|| MetaData::read_from_buffered(&mut front, false))
        .map_err(|fault| source.malformed(format!("the header: {fault}")))?;
    if let Some(fault) = front.fault.take() {
        return Err(fault);
    }
    let meta = read.map_err(|e| exr_fault(source, e, "the header"))?;
    let end = front.consumed();
    contained(|| MetaData::validate(&meta.headers, false))
        .map_err(|fault| source.malformed(format!("the header: {fault}")))?
        .map_err(|e| exr_fault(source, e, "the header"))?;
    Ok((meta, end))
}

/// Converts an error of the crate `exr`.
fn exr_fault(source: &FileSource, error: exr::error::Error, at: &str) -> granita_image::ImageError {
    match error {
        exr::error::Error::NotSupported(what) => {
            source.unsupported(format!("OpenEXR: {what} is not supported"))
        }
        exr::error::Error::Invalid(what) => source.malformed(format!("{at}: {what}")),
        exr::error::Error::Aborted => source.malformed(format!("{at}: cancelled")),
        exr::error::Error::Io(e) => {
            granita_image::ImageError::Io { path: source.path().to_owned(), source: e }
        }
    }
}

impl Part {
    fn understand(
        source: &FileSource,
        index: usize,
        header: &Header,
        limits: &Limits,
        table_at: u64,
    ) -> Result<Self> {
        if header.deep {
            return Err(source.unsupported("OpenEXR with deep pixels is not supported"));
        }
        if matches!(header.compression, Compression::HTJ2K32 | Compression::HTJ2K256) {
            let name = CompressionName::of(header.compression);
            return Err(source.unsupported(format!("OpenEXR compression {name} is not supported")));
        }
        let list = &header.channels.list;
        // The number is checked before any work for each pair of channels.
        limits.within(source.path(), "number of channels", list.len() as u64, u64::from(limits.channels))?;
        if let Some(c) = list.iter().find(|c| c.sampling != Vec2(1, 1)) {
            let name = attributes::string(&c.name);
            return Err(
                source.unsupported(format!("OpenEXR with subsampled channel \"{name}\" is not supported"))
            );
        }
        let names: Vec<String> = list.iter().map(|c| attributes::string(&c.name)).collect();
        let types: Vec<SampleType> = list.iter().map(|c| c.sample_type).collect();
        let pixel_type = match header.channels.uniform_sample_type {
            Some(SampleType::U32) => PixelType::U32,
            Some(SampleType::F16) => PixelType::Half,
            // For different types, floats hold the most values.
            Some(SampleType::F32) | None => PixelType::Float,
        };
        let own = &header.own_attributes;
        let wanted = own.other.get(attributes::CHANNEL_ORDER.as_bytes()).and_then(|v| match v {
            exr::meta::attribute::AttributeValue::Text(t) => Some(attributes::string(t)),
            _ => None,
        });
        let order = channel_order(&names, wanted.as_deref());

        let side = |n: usize| u32::try_from(n).map_err(|_| source.malformed(format!("a side of {n} pixels")));
        let mut spec = ImageSpec::new(side(header.layer_size.0)?, side(header.layer_size.1)?, 1, pixel_type);
        spec.channels = order.iter().map(|i| names[*i].clone()).collect();
        (spec.x, spec.y) = (own.layer_position.0, own.layer_position.1);
        let display = header.shared_attributes.display_window;
        (spec.full_x, spec.full_y) = (display.position.0, display.position.1);
        (spec.full_width, spec.full_height) = (side(display.size.0)?, side(display.size.1)?);
        spec.attributes = attributes::from_header(own);
        let compression = CompressionName::of(header.compression).to_string();
        let ty = ParamType::of(BaseType::String);
        spec.attributes.set(Param { name: "compression".into(), ty, data: compression.as_str().into() });
        if let Some(name) = &own.layer_name {
            let data = attributes::string(name);
            spec.attributes.set(Param { name: "name".into(), ty, data: data.as_str().into() });
        }
        let block_rows = header.compression.scan_lines_per_block() as u32;
        let levels = match header.blocks {
            BlockDescription::ScanLines => {
                limits.check_read(source.path(), &spec, spec.width, block_rows.min(spec.height.max(1)))?;
                vec![Level { spec, index: 0, first_chunk: 0 }]
            }
            BlockDescription::Tiles(tiles) => {
                (spec.tile_width, spec.tile_height) = (side(tiles.tile_size.0)?, side(tiles.tile_size.1)?);
                tile_levels(source, &spec, tiles.level_mode, tiles.rounding_mode)?
            }
        };
        let levels = levels
            .into_iter()
            .map(|mut level| {
                if own.environment_map == Some(EnvironmentMap::Cube) {
                    // There are six faces, one above the other (reference 9.2.8).
                    level.spec.full_width = level.spec.width;
                    level.spec.full_height = level.spec.height.div_ceil(6);
                }
                limits.check(source.path(), "OpenEXR", &level.spec)?;
                Ok(level)
            })
            .collect::<Result<_>>()?;
        let chunks = header.chunk_count as u64;
        let order = Order { types, order, pixel_type };
        Ok(Self { header: index, levels, order, block_rows, table_at, chunks, table: OnceLock::new() })
    }

    /// Returns the offsets of the chunks, which are read from the file at the first use.
    fn table(&self, source: &FileSource) -> Result<&[u64]> {
        if let Some(table) = self.table.get() {
            return Ok(table);
        }
        let bytes = source.read_vec(self.table_at, self.chunks * 8, "the table of chunks")?;
        let table = bytes.as_chunks::<8>().0.iter().map(|b| u64::from_le_bytes(*b)).collect();
        Ok(self.table.get_or_init(|| table))
    }
}

/// Returns the levels of a tiled part. These are all levels of a MIP map. For a map that is reduced in each direction
/// separately (a "RIP map"), they are the levels reduced equally in both.
fn tile_levels(
    source: &FileSource,
    first: &ImageSpec,
    mode: LevelMode,
    round: exr::math::RoundingMode,
) -> Result<Vec<Level>> {
    if first.width == 0 || first.height == 0 || first.tile_width == 0 || first.tile_height == 0 {
        return Err(source.malformed("an empty window or tile"));
    }
    let (w, h) = (first.width as usize, first.height as usize);
    let size = |n: usize, level: usize| compute_level_size(round, n, level) as u32;
    let tiles = |x: usize, y: usize| {
        size(w, x).div_ceil(first.tile_width) as usize * size(h, y).div_ceil(first.tile_height) as usize
    };
    let (count_x, count_y) = (compute_level_count(round, w), compute_level_count(round, h));
    let count = match mode {
        LevelMode::Singular => 1,
        LevelMode::MipMap => count_x.max(count_y),
        LevelMode::RipMap => count_x.min(count_y),
    };
    let mut levels = Vec::with_capacity(count);
    let mut first_chunk = 0;
    for index in 0..count {
        let mut spec = first.clone();
        (spec.width, spec.height) = (size(w, index), size(h, index));
        let whole = first.full_width == first.width && first.full_height == first.height;
        (spec.full_width, spec.full_height) = if whole {
            (spec.width, spec.height)
        } else {
            (size(first.full_width as usize, index), size(first.full_height as usize, index))
        };
        let number = match mode {
            // Levels of a RIP map are in rows of equal height.
            LevelMode::RipMap => {
                let above: usize = (0..index).map(|y| (0..count_x).map(|x| tiles(x, y)).sum::<usize>()).sum();
                above + (0..index).map(|x| tiles(x, index)).sum::<usize>()
            }
            _ => first_chunk,
        };
        first_chunk += tiles(index, index);
        levels.push(Level { spec, index, first_chunk: number });
    }
    Ok(levels)
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

    fn bytes_read(&self) -> u64 {
        self.source.bytes_read()
    }

    /// Returns the bytes of a row of tiles. Blocks of scanlines have few rows.
    fn working_bytes(&self, image: usize, level: usize) -> u64 {
        self.spec(image, level).map_or(0, |spec| spec.decoding_bytes(spec.tile_height))
    }
}
