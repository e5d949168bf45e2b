//! The sources of tiles, which are files and other sources of pixels.

use crate::sketch::{self, Sketch};
use crate::tile::{TILE, Tile, cut, tile_size};
use crate::{Result, ViewError};
use granita_image::{BlockCopy, ImageError, ImageInput, ImageSpec, PixelType, Pixels};
use parking_lot::Mutex;
use std::sync::Arc;

/// The largest size in bytes of a level that is stored in rows and read as a whole. A larger one is read in bands.
const WHOLE_BYTES: u64 = 512 << 20;

/// The number of rows that are read at once from a file whose blocks are packed separately.
const GROUP: u32 = 4 * TILE;

/// The access to parts of a source.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Any tile is read by itself.
    Tiles,
    /// Much or all of a level is read at once, and is kept as a whole.
    Whole,
    /// Bands of rows are read.
    Bands,
}

/// Pixels in levels, read tile by tile from any thread.
pub trait Source: Send + Sync {
    /// Returns the number of levels, at least 1.
    fn levels(&self) -> usize;

    /// Returns the width and height in pixels of a level that exists.
    fn size(&self, level: usize) -> (u32, u32);

    /// Returns the number of values per pixel.
    fn channels(&self) -> usize;

    /// Returns the type of all values.
    fn pixel_type(&self) -> PixelType;

    /// Returns the access to its parts.
    fn access(&self) -> Access;

    /// Returns tile `(tx, ty)` of a level, and any other tiles that were read with it.
    ///
    /// # Errors
    /// Returns an error when no part of it can be read. A tile that can be read in part is returned with this part.
    fn read(&self, level: usize, tx: u32, ty: u32) -> Result<Vec<((u32, u32), Tile)>>;

    /// Returns a reading error so far, if there was any.
    fn fault(&self) -> Option<String> {
        None
    }

    /// Returns a rough image that costs a small part of reading all, if there is one.
    fn sketch(&self) -> Option<Sketch> {
        None
    }
}

/// One image of a file.
pub(crate) struct FilePage {
    input: Arc<dyn ImageInput>,
    image: usize,
    levels: Vec<ImageSpec>,
    access: Access,
    rows: Rows,
    fault: Mutex<Option<String>>,
}

/// The properties of the rows of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Rows {
    /// True when any row can be found by its position, without those above.
    by_position: bool,
    /// The number of rows that are read at once where all are kept. While the next ones are read, smaller levels are
    /// made of these.
    at_once: u32,
    /// The number of rows that are packed together.
    together: Option<u32>,
}

impl Rows {
    fn of(input: &dyn ImageInput, image: usize) -> Self {
        let together = input.rows_together(image, 0);
        let places = [
            "tiff", "shadow", "exr", "sgi", "iff", "dds", "dpx", "cineon", "psd", "fits", "rla", "pfm", "pnm",
        ];
        Self {
            by_position: together.is_some() || places.contains(&input.format_name()),
            at_once: if together.is_some_and(|rows| rows <= GROUP) { GROUP } else { u32::MAX },
            together,
        }
    }
}

impl FilePage {
    /// Returns an image of a file; `None` when the file has no such image.
    pub(crate) fn new(input: Arc<dyn ImageInput>, image: usize) -> Option<Self> {
        let first = input.spec(image, 0)?.clone();
        let mut levels = vec![first];
        for level in 1..input.levels(image) {
            let spec = input.spec(image, level)?;
            let (first, last) = (&levels[0], &levels[levels.len() - 1]);
            // A level that is not a smaller one of the same image ends the pyramid.
            let follows = spec.width <= last.width && spec.height <= last.height;
            if !follows || spec.nchannels() != first.nchannels() || spec.pixel_type != first.pixel_type {
                break;
            }
            levels.push(spec.clone());
        }
        let access = match levels[0].bytes() {
            _ if levels[0].is_tiled() => Access::Tiles,
            Some(bytes) if bytes <= WHOLE_BYTES => Access::Whole,
            _ => Access::Bands,
        };
        let mut rows = Rows::of(&*input, image);
        if access == Access::Bands {
            rows.at_once = TILE;
        }
        Some(Self { input, image, levels, access, rows, fault: Mutex::default() })
    }

    pub(crate) fn spec(&self, level: usize) -> Option<&ImageSpec> {
        self.levels.get(level)
    }

    fn note(&self, error: &ImageError) {
        let mut fault = self.fault.lock();
        fault.get_or_insert_with(|| error.to_string());
    }

    /// Returns rows `y0..y1`. Rows that cannot be read are 0.
    fn read_rows(&self, level: usize, y0: u32, y1: u32) -> Result<Pixels> {
        let first = match self.input.read_rows(self.image, level, y0, y1) {
            Ok(pixels) => return Ok(pixels),
            Err(error) => error,
        };
        self.note(&first);
        let spec = &self.levels[level];
        let row = spec.width as usize * spec.nchannels();
        let limit = (y1 - y0) as usize * row * spec.pixel_type.bytes();
        if limit as u64 > WHOLE_BYTES {
            return Err(first.into());
        }
        let mut out = Pixels::zeros(spec.pixel_type, (y1 - y0) as usize * row);
        let mut found = false;
        let mut take = |a: u32, b: u32| match self.input.read_rows(self.image, level, a, b) {
            Ok(rows) => {
                out.copy_from((a - y0) as usize * row, &rows, 0, rows.len());
                true
            }
            Err(_) => false,
        };
        if self.rows.by_position {
            // Any row may be missing, because files are written from several threads or were damaged.
            for a in (y0..y1).step_by(16) {
                let b = (a + 16).min(y1);
                if take(a, b) {
                    found = true;
                } else {
                    (a..b).for_each(|y| found |= take(y, y + 1));
                }
            }
        } else {
            // The file ends early. All rows up to some row are there.
            let (mut good, mut bad) = (y0, y1);
            while good + 1 < bad {
                let middle = good + (bad - good) / 2;
                if take(y0, middle) {
                    (good, found) = (middle, true);
                } else {
                    bad = middle;
                }
            }
        }
        if found { Ok(out) } else { Err(first.into()) }
    }

    /// Returns tile (tx, ty) and all others that the file's own tiles under it cover completely.
    fn read_tiles(&self, level: usize, tx: u32, ty: u32) -> Result<Vec<((u32, u32), Tile)>> {
        let spec = &self.levels[level];
        let (n, tw, th) = (spec.nchannels(), spec.tile_width, spec.tile_height);
        let (width, height) = tile_size((spec.width, spec.height), tx, ty);
        // The tiles of the file, from the first to after the last.
        let (cx0, cx1) = (tx * TILE / tw, (tx * TILE + width).div_ceil(tw));
        let (cy0, cy1) = (ty * TILE / th, (ty * TILE + height).div_ceil(th));
        // The tiles of this crate that are inside of those of the file, and the requested one.
        let inside = |first: u32, last: u32, file: u32, side: u32, asked: u32| {
            let first = (first * file).div_ceil(TILE).min(asked);
            let end = last.saturating_mul(file);
            let last = if end >= side { side.div_ceil(TILE) } else { end / TILE };
            first..last.max(asked + 1)
        };
        let (across, down) = (inside(cx0, cx1, tw, spec.width, tx), inside(cy0, cy1, th, spec.height, ty));
        let mut tiles = Vec::new();
        for y in down {
            for x in across.clone() {
                let (w, h) = tile_size((spec.width, spec.height), x, y);
                tiles.push(((x, y), Tile::zeros(w, h, n, spec.pixel_type)));
            }
        }
        let (mut first_error, mut found) = (None, false);
        for (cx, cy) in (cy0..cy1).flat_map(|cy| (cx0..cx1).map(move |cx| (cx, cy))) {
            let stored = self.input.read_tile(self.image, level, cx, cy);
            if let Err(error) = &stored {
                self.note(error);
            }
            for ((x, y), tile) in &mut tiles {
                let (left, top) = ((*x * TILE).max(cx * tw), (*y * TILE).max(cy * th));
                let right = (*x * TILE + tile.width).min((cx + 1).saturating_mul(tw));
                let bottom = (*y * TILE + tile.height).min((cy + 1).saturating_mul(th));
                if left >= right || top >= bottom {
                    continue;
                }
                let Ok(stored) = &stored else { continue };
                let copy = BlockCopy {
                    from_width: tw as usize,
                    from: ((left - cx * tw) as usize, (top - cy * th) as usize),
                    to_width: tile.width as usize,
                    to: ((left - *x * TILE) as usize, (top - *y * TILE) as usize),
                    size: ((right - left) as usize, (bottom - top) as usize),
                    nchannels: n,
                };
                copy.run(stored, &mut tile.pixels);
            }
            match stored {
                Ok(_) => found = true,
                Err(error) => first_error = first_error.or(Some(error)),
            }
        }
        match first_error {
            Some(error) if !found => Err(error.into()),
            _ => Ok(tiles),
        }
    }
}

impl Source for FilePage {
    fn levels(&self) -> usize {
        self.levels.len()
    }

    fn size(&self, level: usize) -> (u32, u32) {
        self.levels.get(level).map_or((0, 0), |s| (s.width, s.height))
    }

    fn channels(&self) -> usize {
        self.levels[0].nchannels()
    }

    fn pixel_type(&self) -> PixelType {
        self.levels[0].pixel_type
    }

    fn access(&self) -> Access {
        self.access
    }

    fn read(&self, level: usize, tx: u32, ty: u32) -> Result<Vec<((u32, u32), Tile)>> {
        let Some(spec) =
            self.levels.get(level).filter(|s| tx < s.width.div_ceil(TILE) && ty < s.height.div_ceil(TILE))
        else {
            return Err(ViewError::Misuse {
                what: format!("there is no tile ({tx}, {ty}) of level {level}"),
            });
        };
        if spec.is_tiled() {
            return self.read_tiles(level, tx, ty);
        }
        let y0 = ty * TILE / self.rows.at_once * self.rows.at_once;
        let y1 = y0.saturating_add(self.rows.at_once).min(spec.height);
        let pixels = self.read_rows(level, y0, y1)?;
        Ok(cut((spec.width, spec.height), spec.nchannels(), y0, &pixels))
    }

    fn fault(&self) -> Option<String> {
        self.fault.lock().clone()
    }

    fn sketch(&self) -> Option<Sketch> {
        // The smaller levels of a file are read fast enough.
        let together = self.rows.together.filter(|_| self.levels.len() == 1)?;
        sketch::of_rows(&*self.input, self.image, &self.levels[0], together)
    }
}
