//! Writes chunks in the order of arrival, and their tables at the end.

use crate::header::{self, Described, misuse};
use crate::{Order, zip};
use exr::block::chunk::{CompressedBlock, CompressedScanLineBlock, CompressedTileBlock, TileCoordinates};
use exr::block::{BlockIndex, UncompressedBlock};
use exr::compression::Compression;
use exr::meta::header::Header;
use exr::prelude::Vec2;
use granita_base::Files;
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

/// An OpenEXR file that is being written. It has one part or several. A part has scanlines or tiles, and one level or a
/// whole MIP map.
#[derive(Debug)]
pub struct ExrOutput {
    file: AtomicFile,
    headers: Vec<Header>,
    /// The offset of the next byte.
    position: u64,
    /// The offset of the tables of chunks, which follow one another in the order of the parts.
    tables_at: u64,
    /// The index of the current part, and the part.
    image: usize,
    part: Part,
    /// All parts. The current one is replaced by `None`.
    others: Vec<Option<Part>>,
}

/// A part that is being written.
#[derive(Debug)]
struct Part {
    order: Order,
    /// The level of the compressions "zip" and "zips".
    deflate: DeflateLevel,
    /// The table of chunks. An entry is 0 for a chunk that is not written yet.
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

impl Part {
    fn new(spec: &ImageSpec, described: Described) -> (Header, Self) {
        let Described { header, order, deflate } = described;
        let rows = header.compression.scan_lines_per_block().min(spec.height as usize);
        let block = if spec.is_tiled() { 0 } else { rows * spec.width as usize * spec.nchannels() };
        let part = Self {
            order,
            deflate,
            table: vec![0; header.chunk_count],
            level: 0,
            spec: spec.clone(),
            first_chunk: 0,
            planned: Vec::new(),
            tiles: None,
            block: Pixels::zeros(spec.pixel_type, block),
            filled: 0,
            next_y: 0,
        };
        (header, part)
    }
}

impl ExrOutput {
    /// Begins a file of one part. It is not visible under its name before `close`.
    ///
    /// # Errors
    /// Returns an error when the folder is missing or refuses the file, and for a description that OpenEXR cannot
    /// store.
    pub fn create(path: &Path, options: &CreateOptions<'_>) -> Result<Self> {
        let described = header::described(path, options.spec, options.levels)?;
        Self::begin(path, vec![Part::new(options.spec, described)], &options.files)
    }

    /// Begins a file of several parts, each with one level. The parts are named by the attribute `name`, or by their
    /// numbers where that is missing.
    ///
    /// # Errors
    /// The errors of [`ExrOutput::create`], also for two parts of one name, and for parts whose display windows or
    /// pixel aspect ratios differ.
    pub fn create_parts(path: &Path, specs: &[ImageSpec], files: &Files) -> Result<Self> {
        let parts = header::described_parts(path, specs)?;
        Self::begin(path, specs.iter().zip(parts).map(|(spec, part)| Part::new(spec, part)).collect(), files)
    }

    fn begin(path: &Path, parts: Vec<(Header, Part)>, files: &Files) -> Result<Self> {
        let (headers, parts): (Vec<Header>, Vec<Part>) = parts.into_iter().unzip();
        let mut front = header::front(path, &headers)?;
        let tables_at = front.len() as u64;
        let chunks: usize = parts.iter().map(|part| part.table.len()).sum();
        front.resize(front.len() + chunks * 8, 0);
        let mut others: Vec<Option<Part>> = parts.into_iter().map(Some).collect();
        let first = others.first_mut().and_then(Option::take);
        let part = first.ok_or_else(|| misuse(path, "a file without an image".to_owned()))?;
        let mut file = files.create(path)?;
        file.write_all(&front).map_err(|e| file.io_error(e))?;
        Ok(Self { file, headers, position: front.len() as u64, tables_at, image: 0, part, others })
    }

    /// The header of the current part.
    fn header(&self) -> &Header {
        &self.headers[self.image]
    }

    /// Makes another part the current one; `None` when there is no such part.
    fn select(&mut self, image: usize) -> Option<()> {
        if image == self.image {
            return Some(());
        }
        let next = self.others.get_mut(image)?.take()?;
        let before = std::mem::replace(&mut self.part, next);
        self.others[self.image] = Some(before);
        self.image = image;
        Some(())
    }

    /// Checks that all levels of the current part are complete.
    fn check_part(&mut self) -> Result<()> {
        for level in 0..self.part.planned.len() {
            self.select_level(level)?;
            self.check_complete()?;
        }
        self.check_complete()?;
        if self.part.first_chunk + self.chunks() < self.part.table.len() {
            let level = self.part.level + 1;
            return Err(self.misuse(format!("level {level} and those after it are missing")));
        }
        Ok(())
    }

    fn misuse(&self, what: String) -> ImageError {
        let part = self.image;
        let what = if self.headers.len() > 1 { format!("part {part}: {what}") } else { what };
        misuse(self.file.path(), what)
    }

    fn check_type(&self, pixels: &Pixels) -> Result<()> {
        let (got, wanted) = (pixels.pixel_type(), self.part.spec.pixel_type);
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
            if self.part.table[*number] != 0 {
                return Err(self.misuse(format!("tile {number} is written twice")));
            }
            let bytes = bytes?;
            self.file.write_all(&bytes).map_err(|e| self.file.io_error(e))?;
            self.part.table[*number] = self.position;
            self.position += bytes.len() as u64;
        }
        Ok(())
    }

    /// Returns the chunk of a block of the current level, as the file stores it.
    fn pack(&self, area: &Area, pixels: &Pixels) -> Result<Vec<u8>> {
        let (at, size) = (area.at, area.size);
        let data = self.part.order.gather(pixels, size.0, size.1, area.stride);
        let zip = matches!(self.header().compression, Compression::ZIP1 | Compression::ZIP16);
        let block = if zip && cfg!(target_endian = "little") {
            let half = self.part.spec.pixel_type == PixelType::Half;
            let content = if half { Content::Halves } else { Content::Words };
            let compressed_pixels_le = zip::compress(&data, content, self.part.deflate).unwrap_or(data);
            if self.part.spec.is_tiled() {
                let tile = (self.part.spec.tile_width as usize, self.part.spec.tile_height as usize);
                CompressedBlock::Tile(CompressedTileBlock {
                    coordinates: TileCoordinates {
                        tile_index: Vec2(at.0 / tile.0, at.1 / tile.1),
                        level_index: Vec2(self.part.level, self.part.level),
                    },
                    compressed_pixels_le,
                })
            } else {
                let top = self.header().own_attributes.layer_position.1;
                CompressedBlock::ScanLine(CompressedScanLineBlock {
                    y_coordinate: top.wrapping_add(at.1 as i32),
                    compressed_pixels_le,
                })
            }
        } else {
            let block = UncompressedBlock {
                index: BlockIndex {
                    layer: self.image,
                    pixel_position: Vec2(at.0, at.1),
                    pixel_size: Vec2(size.0, size.1),
                    level: Vec2(self.part.level, self.part.level),
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
        if self.headers.len() > 1 {
            bytes.extend((self.image as i32).to_le_bytes());
        }
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
        let spec = &self.part.spec;
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
        let number = self.part.first_chunk + ty as usize * across as usize + tx as usize;
        Ok((number, Area { at, size, stride: tw as usize }))
    }

    /// Returns the number of chunks of the current level.
    fn chunks(&self) -> usize {
        if self.part.spec.is_tiled() {
            let (across, down) = self.part.spec.tiles();
            across as usize * down as usize
        } else {
            self.part.table.len()
        }
    }

    /// Checks that the current level is complete.
    fn check_complete(&self) -> Result<()> {
        let chunks = &self.part.table[self.part.first_chunk..self.part.first_chunk + self.chunks()];
        let missing = chunks.iter().filter(|c| **c == 0).count();
        if missing == 0 {
            return Ok(());
        }
        let (level, total) = (self.part.level, chunks.len());
        Err(self
            .misuse(format!("level {level} is incomplete: {missing} of {total} blocks or tiles are missing")))
    }

    /// Makes the next level the current one.
    fn advance(&mut self, spec: &ImageSpec) -> Result<()> {
        let halved = ((self.part.spec.width / 2).max(1), (self.part.spec.height / 2).max(1));
        let first_chunk = self.part.first_chunk + self.chunks();
        if !self.part.spec.is_tiled() || first_chunk >= self.part.table.len() {
            let level = self.part.level;
            return Err(self.misuse(format!("there is no level after level {level}")));
        }
        let (old, new) = (&self.part.spec, spec);
        if (new.width, new.height) != halved
            || (new.tile_width, new.tile_height) != (old.tile_width, old.tile_height)
            || new.channels != old.channels
            || new.pixel_type != old.pixel_type
        {
            return Err(self.misuse(format!(
                "level {} is {} x {} in tiles of {} x {}; OpenEXR needs {} x {} in tiles of {} x {}, and the same channels",
                self.part.level + 1,
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
        self.part.first_chunk = first_chunk;
        self.part.level += 1;
        self.part.spec = spec.clone();
        self.part.tiles = None;
        Ok(())
    }
}

impl ImageOutput for ExrOutput {
    fn write_rows(&mut self, pixels: &Pixels) -> Result<()> {
        self.check_type(pixels)?;
        let row = self.part.spec.width as usize * self.part.spec.nchannels();
        let count = pixels.len() / row;
        let next_y = self.part.tiles.as_ref().map_or(self.part.next_y, TileRows::next_y);
        let left = self.part.spec.height - next_y;
        if !pixels.len().is_multiple_of(row) || count > left as usize {
            let n = pixels.len();
            return Err(self.misuse(format!(
                "{n} values are no whole rows of {row}, or more than the {left} rows left"
            )));
        }
        if self.part.spec.is_tiled() {
            let spec = self.part.spec.clone();
            let mut tiles = self.part.tiles.take().unwrap_or_else(|| TileRows::new(&spec));
            let mut row: Vec<(u32, u32, Pixels)> = Vec::with_capacity(spec.tiles().0 as usize);
            let pushed = tiles.push(&spec, pixels, |tx, ty, tile| {
                row.push((tx, ty, tile.clone()));
                if tx + 1 < spec.tiles().0 {
                    return Ok(());
                }
                self.write_tiles(&std::mem::take(&mut row))
            });
            self.part.tiles = Some(tiles);
            return pushed;
        }
        let per_block = self.header().compression.scan_lines_per_block() as u32;
        let mut done = 0;
        while done < count {
            let number = self.part.next_y / per_block;
            let top = number * per_block;
            let width = self.part.spec.width as usize;
            // Available whole blocks are packed several at once.
            let ready = if self.part.filled == 0 { (count - done) / per_block as usize } else { 0 };
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
                self.part.next_y += ready as u32 * per_block;
                done += ready * per_block as usize;
                continue;
            }
            let in_block = per_block.min(self.part.spec.height - top);
            let take = (in_block - self.part.filled).min((count - done) as u32);
            self.part.block.copy_from(
                self.part.filled as usize * row,
                pixels,
                done * row,
                take as usize * row,
            );
            self.part.filled += take;
            self.part.next_y += take;
            done += take as usize;
            if self.part.filled == in_block {
                self.part.filled = 0;
                let block =
                    std::mem::replace(&mut self.part.block, Pixels::zeros(self.part.spec.pixel_type, 0));
                let area = Area { at: (0, top as usize), size: (width, in_block as usize), stride: width };
                self.write_blocks(&[(number as usize, area, &block)])?;
                self.part.block = block;
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
        if self.part.level > 0 || !self.part.planned.is_empty() {
            return Err(self.misuse("levels are planned after the first".to_owned()));
        }
        let first = self.part.spec.clone();
        let mut planned = vec![(first.clone(), 0)];
        for spec in specs {
            self.advance(spec)?;
            planned.push((self.part.spec.clone(), self.part.first_chunk));
        }
        if self.part.first_chunk + self.chunks() < self.part.table.len() {
            let level = self.part.level + 1;
            return Err(self.misuse(format!("level {level} and those after it are not planned")));
        }
        (self.part.spec, self.part.first_chunk, self.part.level, self.part.planned) = (first, 0, 0, planned);
        Ok(true)
    }

    fn select_level(&mut self, level: usize) -> Result<()> {
        let Some((spec, first_chunk)) = self.part.planned.get(level).cloned() else {
            return Err(self.misuse(format!("level {level} was not planned")));
        };
        (self.part.spec, self.part.first_chunk, self.part.level, self.part.tiles) =
            (spec, first_chunk, level, None);
        Ok(())
    }

    fn next_level(&mut self, spec: &ImageSpec) -> Result<()> {
        if !self.part.planned.is_empty() {
            return Err(self.misuse("a further level after the planned ones".to_owned()));
        }
        self.check_complete()?;
        self.advance(spec)
    }

    fn select_image(&mut self, image: usize) -> Result<()> {
        let count = self.headers.len();
        self.select(image).ok_or_else(|| self.misuse(format!("part {image} of a file of {count}")))
    }

    fn close(mut self: Box<Self>) -> Result<()> {
        let mut bytes: Vec<u8> = Vec::new();
        for image in 0..self.headers.len() {
            self.select_image(image)?;
            self.check_part()?;
            bytes.extend(self.part.table.iter().flat_map(|at| at.to_le_bytes()));
        }
        let file = &mut self.file;
        let written = file.seek(SeekFrom::Start(self.tables_at)).and_then(|_| file.write_all(&bytes));
        written.map_err(|e| self.file.io_error(e))?;
        Ok(self.file.commit()?)
    }
}
