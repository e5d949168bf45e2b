//! Writes chunks in the order of arrival, and their table at the end.

use crate::attributes::{self, channel_order};
use crate::{CompressionName, Order, zip};
use exr::block::chunk::{CompressedBlock, CompressedScanLineBlock, CompressedTileBlock, TileCoordinates};
use exr::block::{BlockIndex, UncompressedBlock};
use exr::compression::Compression;
use exr::meta::attribute::{
    self as exr_attribute, AttributeValue, ChannelDescription, IntegerBounds, LevelMode, LineOrder,
    SampleType, TileDescription,
};
use exr::meta::header::{Header, ImageAttributes};
use exr::meta::{BlockDescription, MetaData};
use exr::prelude::{SmallVec, Vec2};
use granita_image::{
    AtomicFile, Content, CreateOptions, DeflateLevel, ImageError, ImageOutput, ImageSpec, PixelType, Pixels,
    Result, TileRows,
};
use rayon::prelude::*;
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;

/// A rectangle of the current level: column and row, columns and rows, and the number of pixels in the rows of its
/// block in memory.
#[derive(Clone, Copy, Debug)]
struct Area {
    at: (usize, usize),
    size: (usize, usize),
    stride: usize,
}

/// An OpenEXR file that is being written. It has one part, scanlines or tiles, and one level or a whole MIP map.
#[derive(Debug)]
pub struct ExrOutput {
    file: AtomicFile,
    headers: [Header; 1],
    order: Order,
    /// The level of the compressions "zip" and "zips".
    deflate: DeflateLevel,
    /// The offset of the next byte.
    position: u64,
    /// The offset and the content of the table of chunks. An entry is 0 for a chunk that is not written yet.
    table_at: u64,
    table: Vec<u64>,
    /// The index of the current level, its spec, and the index of its first chunk.
    level: usize,
    spec: ImageSpec,
    first_chunk: usize,
    /// The spec and the index of the first chunk of every level, once they are planned.
    planned: Vec<(ImageSpec, usize)>,
    /// The rows that do not fill a block or a row of tiles yet.
    tiles: Option<TileRows>,
    block: Pixels,
    filled: u32,
    next_y: u32,
}

impl ExrOutput {
    /// Begins a file. It is not visible under its name before `close`.
    ///
    /// # Errors
    /// Returns an error when the folder is missing or refuses the file, and for a description that OpenEXR cannot
    /// store.
    pub fn create(path: &Path, options: &CreateOptions<'_>) -> Result<Self> {
        let spec = options.spec;
        let (header, order, deflate) = header(path, spec, options.levels)?;
        let requirements = MetaData::validate(std::slice::from_ref(&header), true)
            .map_err(|e| misuse(path, format!("OpenEXR cannot hold it: {e}")))?;
        let mut front = vec![0x76, 0x2f, 0x31, 0x01];
        let mut written = requirements.write(&mut front);
        // The attributes are sorted by name. The crate's own order is that of a hash map, and differs from run to run.
        let mut all: Vec<(Vec<u8>, AttributeValue)> =
            header.all_named_attributes().map(|(name, value)| (name.to_vec(), value)).collect();
        all.sort_by(|a, b| a.0.cmp(&b.0));
        for (name, value) in &all {
            written = written.and_then(|()| exr_attribute::write(name, value, &mut front));
        }
        written.map_err(|e| misuse(path, e.to_string()))?;
        front.push(0);
        let table_at = front.len() as u64;
        front.resize(front.len() + header.chunk_count * 8, 0);
        let mut file = options.files.create(path)?;
        file.write_all(&front).map_err(|e| file.io_error(e))?;
        let rows = header.compression.scan_lines_per_block().min(spec.height as usize);
        let block = if spec.is_tiled() { 0 } else { rows * spec.width as usize * spec.nchannels() };
        Ok(Self {
            file,
            table: vec![0; header.chunk_count],
            headers: [header],
            order,
            deflate,
            position: front.len() as u64,
            table_at,
            level: 0,
            spec: spec.clone(),
            first_chunk: 0,
            planned: Vec::new(),
            tiles: None,
            block: Pixels::zeros(spec.pixel_type, block),
            filled: 0,
            next_y: 0,
        })
    }

    fn misuse(&self, what: String) -> ImageError {
        misuse(self.file.path(), what)
    }

    fn check_type(&self, pixels: &Pixels) -> Result<()> {
        let (got, wanted) = (pixels.pixel_type(), self.spec.pixel_type);
        if got == wanted {
            return Ok(());
        }
        Err(self.misuse(format!("pixels of type {got:?} for a file of {wanted:?}")))
    }

    /// Compresses and writes blocks, each with its chunk index. They are compressed in the threads of the caller's
    /// pool, and written in order.
    fn write_blocks(&mut self, blocks: &[(usize, Area, &Pixels)]) -> Result<()> {
        let done: Vec<Result<Vec<u8>>> = match blocks {
            [(_, area, pixels)] => vec![self.pack(area, pixels)],
            many => many.par_iter().map(|(_, area, pixels)| self.pack(area, pixels)).collect(),
        };
        for ((number, _, _), bytes) in blocks.iter().zip(done) {
            if self.table[*number] != 0 {
                return Err(self.misuse(format!("tile {number} is written twice")));
            }
            let bytes = bytes?;
            self.file.write_all(&bytes).map_err(|e| self.file.io_error(e))?;
            self.table[*number] = self.position;
            self.position += bytes.len() as u64;
        }
        Ok(())
    }

    /// Returns the chunk of a block of the current level, as the file stores it.
    fn pack(&self, area: &Area, pixels: &Pixels) -> Result<Vec<u8>> {
        let (at, size) = (area.at, area.size);
        let data = self.order.gather(pixels, size.0, size.1, area.stride);
        let zip = matches!(self.headers[0].compression, Compression::ZIP1 | Compression::ZIP16);
        let block = if zip && cfg!(target_endian = "little") {
            let half = self.spec.pixel_type == PixelType::Half;
            let content = if half { Content::Halves } else { Content::Words };
            let compressed_pixels_le = zip::compress(&data, content, self.deflate).unwrap_or(data);
            if self.spec.is_tiled() {
                let tile = (self.spec.tile_width as usize, self.spec.tile_height as usize);
                CompressedBlock::Tile(CompressedTileBlock {
                    coordinates: TileCoordinates {
                        tile_index: Vec2(at.0 / tile.0, at.1 / tile.1),
                        level_index: Vec2(self.level, self.level),
                    },
                    compressed_pixels_le,
                })
            } else {
                let top = self.headers[0].own_attributes.layer_position.1;
                CompressedBlock::ScanLine(CompressedScanLineBlock {
                    y_coordinate: top.wrapping_add(at.1 as i32),
                    compressed_pixels_le,
                })
            }
        } else {
            let block = UncompressedBlock {
                index: BlockIndex {
                    layer: 0,
                    pixel_position: Vec2(at.0, at.1),
                    pixel_size: Vec2(size.0, size.1),
                    level: Vec2(self.level, self.level),
                },
                data,
            };
            let chunk = block.compress_to_chunk(&self.headers).map_err(|e| match e {
                exr::error::Error::NotSupported(what) => {
                    let what = format!("OpenEXR: {what} is not supported");
                    ImageError::Unsupported { path: self.file.path().to_owned(), what }
                }
                other => self.misuse(other.to_string()),
            })?;
            chunk.compressed_block
        };
        let mut bytes = Vec::new();
        let written = match &block {
            CompressedBlock::ScanLine(block) => block.write(&mut bytes),
            CompressedBlock::Tile(block) => block.write(&mut bytes),
            // A header without deep data has no deep blocks.
            CompressedBlock::DeepScanLine(_) | CompressedBlock::DeepTile(_) => Ok(()),
        };
        written.map_err(|e| self.misuse(e.to_string()))?;
        Ok(bytes)
    }

    /// Returns the chunk index and the area of a tile. It is an error when the tile does not exist or `pixels` does not
    /// have its size.
    fn tile_area(&self, tx: u32, ty: u32, pixels: &Pixels) -> Result<(usize, Area)> {
        self.check_type(pixels)?;
        let spec = &self.spec;
        let (across, down) = spec.tiles();
        let (tw, th) = (spec.tile_width, spec.tile_height);
        let n = tw as usize * th as usize * spec.nchannels();
        if tx >= across || ty >= down || pixels.len() != n {
            let got = pixels.len();
            return Err(self.misuse(format!(
                "tile ({tx}, {ty}) with {got} values, in an image of {across} x {down} tiles of {n}"
            )));
        }
        let at = ((tx * tw) as usize, (ty * th) as usize);
        let size =
            ((spec.width as usize - at.0).min(tw as usize), (spec.height as usize - at.1).min(th as usize));
        let number = self.first_chunk + ty as usize * across as usize + tx as usize;
        Ok((number, Area { at, size, stride: tw as usize }))
    }

    /// Returns the number of chunks of the current level.
    fn chunks(&self) -> usize {
        if self.spec.is_tiled() {
            let (across, down) = self.spec.tiles();
            across as usize * down as usize
        } else {
            self.table.len()
        }
    }

    /// Checks that the current level is complete.
    fn check_complete(&self) -> Result<()> {
        let chunks = &self.table[self.first_chunk..self.first_chunk + self.chunks()];
        let missing = chunks.iter().filter(|c| **c == 0).count();
        if missing == 0 {
            return Ok(());
        }
        let (level, total) = (self.level, chunks.len());
        Err(self
            .misuse(format!("level {level} is incomplete: {missing} of {total} blocks or tiles are missing")))
    }

    /// Makes the next level the current one.
    fn advance(&mut self, spec: &ImageSpec) -> Result<()> {
        let halved = ((self.spec.width / 2).max(1), (self.spec.height / 2).max(1));
        let first_chunk = self.first_chunk + self.chunks();
        if !self.spec.is_tiled() || first_chunk >= self.table.len() {
            let level = self.level;
            return Err(self.misuse(format!("there is no level after level {level}")));
        }
        let (old, new) = (&self.spec, spec);
        if (new.width, new.height) != halved
            || (new.tile_width, new.tile_height) != (old.tile_width, old.tile_height)
            || new.channels != old.channels
            || new.pixel_type != old.pixel_type
        {
            return Err(self.misuse(format!(
                "level {} is {} x {} in tiles of {} x {}; OpenEXR needs {} x {} in tiles of {} x {}, and the same channels",
                self.level + 1,
                new.width,
                new.height,
                new.tile_width,
                new.tile_height,
                halved.0,
                halved.1,
                old.tile_width,
                old.tile_height,
            )));
        }
        self.first_chunk = first_chunk;
        self.level += 1;
        self.spec = spec.clone();
        self.tiles = None;
        Ok(())
    }
}

fn misuse(path: &Path, what: String) -> ImageError {
    ImageError::Misuse { path: path.to_owned(), what }
}

/// Returns the header of a file for `spec`, the order of its channels, and the level of deflate.
fn header(path: &Path, spec: &ImageSpec, levels: usize) -> Result<(Header, Order, DeflateLevel)> {
    let unsupported = |what: String| ImageError::Unsupported { path: path.to_owned(), what };
    if spec.width == 0 || spec.height == 0 || spec.nchannels() == 0 {
        let (w, h, n) = (spec.width, spec.height, spec.nchannels());
        return Err(misuse(path, format!("an image of {w} x {h} pixels with {n} channels")));
    }
    let sample_type = match spec.pixel_type {
        PixelType::Half => SampleType::F16,
        PixelType::Float => SampleType::F32,
        PixelType::U32 => SampleType::U32,
        other => return Err(unsupported(format!("OpenEXR does not hold {other:?} values"))),
    };
    let mut sorted = spec.channels.clone();
    sorted.sort_by(|a, b| a.as_bytes().cmp(b.as_bytes()));
    if let Some(pair) = sorted.windows(2).find(|p| p[0] == p[1]) {
        return Err(misuse(path, format!("two channels are called \"{}\"", pair[0])));
    }
    let mut list: SmallVec<[ChannelDescription; 5]> = SmallVec::new();
    for name in &sorted {
        let text = attributes::channel_name(name)
            .ok_or_else(|| misuse(path, format!("\"{name}\" cannot name a channel")))?;
        list.push(ChannelDescription::named(text, sample_type));
    }
    let joined = spec.channels.join(",");
    let order = channel_order(&sorted, Some(&joined));
    let mut own = attributes::to_header(spec);
    if channel_order(&sorted, None) != order
        && let Some(text) = attributes::channel_name(&joined)
    {
        own.other.insert(attributes::CHANNEL_ORDER.into(), AttributeValue::Text(text));
    }
    own.layer_position = Vec2(spec.x, spec.y);

    let word = spec.string("compression").unwrap_or("zip");
    let (compression, level) = CompressionName::parse(word).map_err(unsupported)?;
    let (blocks, line_order) = if spec.is_tiled() {
        if spec.tile_height == 0 {
            return Err(misuse(path, format!("tiles of {} x 0 pixels", spec.tile_width)));
        }
        let tiles = TileDescription {
            tile_size: Vec2(spec.tile_width as usize, spec.tile_height as usize),
            level_mode: if levels > 1 { LevelMode::MipMap } else { LevelMode::Singular },
            rounding_mode: exr::math::RoundingMode::Down,
        };
        (BlockDescription::Tiles(tiles), LineOrder::Unspecified)
    } else if levels > 1 {
        return Err(misuse(path, "OpenEXR stores MIP levels in tiles only".to_owned()));
    } else {
        (BlockDescription::ScanLines, LineOrder::Increasing)
    };
    // The format cannot store the size of one cube face. The display window is that of all six faces.
    let cube = spec.string("textureformat").is_some_and(|t| t.starts_with("CubeFace"));
    let display = if cube {
        IntegerBounds::new(Vec2(spec.x, spec.y), Vec2(spec.width as usize, spec.height as usize))
    } else {
        let size = Vec2(spec.full_width.max(1) as usize, spec.full_height.max(1) as usize);
        IntegerBounds::new(Vec2(spec.full_x, spec.full_y), size)
    };
    let size = Vec2(spec.width as usize, spec.height as usize);
    let pixel_aspect = spec.attributes.float("pixelaspect").filter(|a| *a > 0.0).unwrap_or(1.0);
    let header = Header::new(Default::default(), size, list)
        .with_attributes(own)
        .with_shared_attributes(ImageAttributes { pixel_aspect, ..ImageAttributes::new(display) })
        .with_encoding(compression, blocks, line_order);
    let types = vec![sample_type; sorted.len()];
    Ok((header, Order { types, order, pixel_type: spec.pixel_type }, level))
}

impl ImageOutput for ExrOutput {
    fn write_rows(&mut self, pixels: &Pixels) -> Result<()> {
        self.check_type(pixels)?;
        let row = self.spec.width as usize * self.spec.nchannels();
        let count = pixels.len() / row;
        let next_y = self.tiles.as_ref().map_or(self.next_y, TileRows::next_y);
        let left = self.spec.height - next_y;
        if !pixels.len().is_multiple_of(row) || count > left as usize {
            let n = pixels.len();
            return Err(self.misuse(format!(
                "{n} values are no whole rows of {row}, or more than the {left} rows left"
            )));
        }
        if self.spec.is_tiled() {
            let spec = self.spec.clone();
            let mut tiles = self.tiles.take().unwrap_or_else(|| TileRows::new(&spec));
            let mut row: Vec<(u32, u32, Pixels)> = Vec::with_capacity(spec.tiles().0 as usize);
            let pushed = tiles.push(&spec, pixels, |tx, ty, tile| {
                row.push((tx, ty, tile.clone()));
                if tx + 1 < spec.tiles().0 {
                    return Ok(());
                }
                self.write_tiles(&std::mem::take(&mut row))
            });
            self.tiles = Some(tiles);
            return pushed;
        }
        let per_block = self.headers[0].compression.scan_lines_per_block() as u32;
        let mut done = 0;
        while done < count {
            let number = self.next_y / per_block;
            let top = number * per_block;
            let width = self.spec.width as usize;
            // Available whole blocks are packed several at once.
            let ready = if self.filled == 0 { (count - done) / per_block as usize } else { 0 };
            if ready > 1 {
                let ready = ready.min(8 * rayon::current_num_threads());
                let len = per_block as usize * row;
                let blocks: Vec<Pixels> = (0..ready)
                    .map(|i| {
                        let mut block = Pixels::zeros(pixels.pixel_type(), len);
                        block.copy_from(0, pixels, done * row + i * len, len);
                        block
                    })
                    .collect();
                let area = |i: usize| Area {
                    at: (0, top as usize + i * per_block as usize),
                    size: (width, per_block as usize),
                    stride: width,
                };
                let numbered: Vec<(usize, Area, &Pixels)> =
                    blocks.iter().enumerate().map(|(i, b)| (number as usize + i, area(i), b)).collect();
                self.write_blocks(&numbered)?;
                self.next_y += ready as u32 * per_block;
                done += ready * per_block as usize;
                continue;
            }
            let in_block = per_block.min(self.spec.height - top);
            let take = (in_block - self.filled).min((count - done) as u32);
            self.block.copy_from(self.filled as usize * row, pixels, done * row, take as usize * row);
            self.filled += take;
            self.next_y += take;
            done += take as usize;
            if self.filled == in_block {
                self.filled = 0;
                let block = std::mem::replace(&mut self.block, Pixels::zeros(self.spec.pixel_type, 0));
                let area = Area { at: (0, top as usize), size: (width, in_block as usize), stride: width };
                self.write_blocks(&[(number as usize, area, &block)])?;
                self.block = block;
            }
        }
        Ok(())
    }

    fn write_tile(&mut self, tx: u32, ty: u32, pixels: &Pixels) -> Result<()> {
        let (number, area) = self.tile_area(tx, ty, pixels)?;
        self.write_blocks(&[(number, area, pixels)])
    }

    fn write_tiles(&mut self, tiles: &[(u32, u32, Pixels)]) -> Result<()> {
        let placed: Vec<(usize, Area, &Pixels)> = tiles
            .iter()
            .map(|(tx, ty, pixels)| {
                let (number, area) = self.tile_area(*tx, *ty, pixels)?;
                Ok((number, area, pixels))
            })
            .collect::<Result<_>>()?;
        // Not all are packed at once, because packed tiles stay in memory.
        let at_once = 8 * rayon::current_num_threads();
        placed.chunks(at_once).try_for_each(|group| self.write_blocks(group))
    }

    fn plan_levels(&mut self, specs: &[ImageSpec]) -> Result<bool> {
        if self.level > 0 || !self.planned.is_empty() {
            return Err(self.misuse("levels are planned after the first".to_owned()));
        }
        let first = self.spec.clone();
        let mut planned = vec![(first.clone(), 0)];
        for spec in specs {
            self.advance(spec)?;
            planned.push((self.spec.clone(), self.first_chunk));
        }
        if self.first_chunk + self.chunks() < self.table.len() {
            let level = self.level + 1;
            return Err(self.misuse(format!("level {level} and those after it are not planned")));
        }
        (self.spec, self.first_chunk, self.level, self.planned) = (first, 0, 0, planned);
        Ok(true)
    }

    fn select_level(&mut self, level: usize) -> Result<()> {
        let Some((spec, first_chunk)) = self.planned.get(level).cloned() else {
            return Err(self.misuse(format!("level {level} was not planned")));
        };
        (self.spec, self.first_chunk, self.level, self.tiles) = (spec, first_chunk, level, None);
        Ok(())
    }

    fn next_level(&mut self, spec: &ImageSpec) -> Result<()> {
        if !self.planned.is_empty() {
            return Err(self.misuse("a further level after the planned ones".to_owned()));
        }
        self.check_complete()?;
        self.advance(spec)
    }

    fn close(mut self: Box<Self>) -> Result<()> {
        for level in 0..self.planned.len() {
            self.select_level(level)?;
            self.check_complete()?;
        }
        self.check_complete()?;
        if self.first_chunk + self.chunks() < self.table.len() {
            let level = self.level + 1;
            return Err(self.misuse(format!("level {level} and those after it are missing")));
        }
        let bytes: Vec<u8> = self.table.iter().flat_map(|n| n.to_le_bytes()).collect();
        let file = &mut self.file;
        let written = file.seek(SeekFrom::Start(self.table_at)).and_then(|_| file.write_all(&bytes));
        written.map_err(|e| self.file.io_error(e))?;
        Ok(self.file.commit()?)
    }
}
