//! The levels of a page, which are those of its source and smaller ones that are computed tile by tile.

use crate::Result;
use crate::source::{Access, Source};
use crate::store::{TileKey, TileStore};
use crate::tile::{Reduce, TILE, Tile, tile_size};
use granita_image::PixelType;
use parking_lot::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

/// Levels are computed until no side is longer than this number of pixels.
const SMALLEST: u32 = 16;

/// One level of a page.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// The width in pixels.
    pub width: u32,
    /// The height in pixels.
    pub height: u32,
    /// The pixels of level 0 per pixel, horizontally and vertically.
    pub scale: (f64, f64),
    /// True when the source has it. Otherwise it is computed from the one before.
    pub stored: bool,
}

impl Level {
    /// Returns the numbers of tile columns and rows.
    pub fn tiles(&self) -> (u32, u32) {
        (self.width.div_ceil(TILE), self.height.div_ceil(TILE))
    }
}

/// The levels of one page, and access to their tiles from any thread.
pub struct Pyramid {
    source: Arc<dyn Source>,
    store: TileStore,
    page: u64,
    /// The id in the store of all computed levels but the first, for an image that is too large to be kept.
    upper: Option<u64>,
    levels: Vec<Level>,
    reduce: Vec<Reduce>,
    /// Locked by the one thread that reads, where a read gives much more than one tile.
    reading: Mutex<()>,
    /// True when a rough image is made before any tile is read.
    sketch_first: AtomicBool,
    /// The rough image, with its level.
    sketch: OnceLock<Option<(usize, Vec<SketchTile>)>>,
}

/// The column, the row and the pixels of a tile of the rough image.
type SketchTile = ((u32, u32), Arc<Tile>);

impl Drop for Pyramid {
    fn drop(&mut self) {
        self.store.drop_page(self.page);
        if let Some(upper) = self.upper {
            self.store.drop_page(upper);
        }
    }
}

impl std::fmt::Debug for Pyramid {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Pyramid(page {}, {} levels)", self.page, self.levels.len())
    }
}

impl Pyramid {
    /// Makes a pyramid. `reduce` is the reduction to a computed level for each channel.
    pub fn new(source: Arc<dyn Source>, store: &TileStore, reduce: Vec<Reduce>) -> Self {
        let (width, height) = source.size(0);
        let mut levels = Vec::new();
        for level in 0..source.levels().max(1) {
            let (w, h) = source.size(level);
            let scale = (f64::from(width) / f64::from(w.max(1)), f64::from(height) / f64::from(h.max(1)));
            levels.push(Level { width: w, height: h, scale, stored: true });
        }
        while let Some(last) = levels.last().filter(|l| l.width.max(l.height) > SMALLEST) {
            let next = Level {
                width: last.width.div_ceil(2),
                height: last.height.div_ceil(2),
                scale: (last.scale.0 * 2.0, last.scale.1 * 2.0),
                stored: false,
            };
            levels.push(next);
        }
        let page = store.new_page(source.access() == Access::Whole);
        let upper = (source.access() == Access::Bands).then(|| store.new_page(true));
        Self {
            source,
            store: store.clone(),
            page,
            upper,
            levels,
            reduce,
            reading: Mutex::default(),
            sketch_first: AtomicBool::new(false),
            sketch: OnceLock::new(),
        }
    }

    /// Returns the source of its pixels.
    pub fn source(&self) -> &dyn Source {
        &*self.source
    }

    /// Returns all levels, the largest first.
    pub fn levels(&self) -> &[Level] {
        &self.levels
    }

    /// Returns the number of levels of the source itself.
    pub fn stored_levels(&self) -> usize {
        self.levels.iter().filter(|l| l.stored).count()
    }

    /// Returns an id that is unique among the pages of the store.
    pub fn number(&self) -> u64 {
        self.page
    }

    /// Returns its ids in the store, each with its visible bytes, when `tiles` tiles of `level` are visible.
    pub fn in_sight(&self, level: usize, tiles: u64) -> Vec<(u64, u64)> {
        // A band is read as a whole.
        let across = self.levels.first().map_or(0, |l| u64::from(l.tiles().0));
        let tiles = if self.source.access() == Access::Bands { tiles.max(4 * across) } else { tiles };
        let bytes = tiles * u64::from(TILE * TILE) * self.pixel_bytes();
        let upper = self.upper.map(|page| (page, 0));
        // While smaller levels are computed, finer tiles are made and dropped. Four of them are always needed.
        let made = self.levels.get(level).is_some_and(|l| !l.stored);
        let made = if made { 4 * u64::from(TILE * TILE) * self.pixel_bytes() } else { 0 };
        [Some((self.page, bytes + made)), upper].into_iter().flatten().collect()
    }

    /// Returns the bytes that reading `tiles` tiles takes, for an image that is not visible yet.
    pub fn cost(&self, tiles: u64) -> u64 {
        let all = self.levels.first().map_or(0, |l| u64::from(l.width) * u64::from(l.height));
        let pixels = match self.source.access() {
            Access::Tiles => tiles * u64::from(TILE * TILE),
            // Smaller levels are estimated as half of the image.
            Access::Whole => all + all / 2,
            Access::Bands => u64::MAX / 1024,
        };
        pixels.saturating_mul(self.pixel_bytes())
    }

    /// Returns the bytes of one pixel.
    pub fn pixel_bytes(&self) -> u64 {
        (self.source.channels() * self.source.pixel_type().bytes()) as u64
    }

    fn key(&self, level: usize, tx: u32, ty: u32) -> TileKey {
        let page = self.upper.filter(|_| level > self.stored_levels()).unwrap_or(self.page);
        TileKey { page, level: level as u32, tx, ty }
    }

    /// Reads an image that is stored in bands once, and makes all computed levels but the first.
    fn make_upper(&self) {
        let base = self.stored_levels() - 1;
        let mut pending: Vec<Vec<Arc<Tile>>> = vec![Vec::new(); self.levels.len()];
        let (across, down) = self.levels[base].tiles();
        for ty in 0..down {
            let size = (self.levels[base].width, self.levels[base].height);
            let (n, pixel_type) = (self.source.channels(), self.source.pixel_type());
            let row: Vec<Arc<Tile>> = match self.source.read(base, 0, ty) {
                Ok(tiles) => tiles.into_iter().map(|(_, tile)| Arc::new(tile)).collect(),
                Err(_) => {
                    // All but the last have the same size.
                    let missing = [0, across - 1].map(|tx| {
                        let (w, h) = tile_size(size, tx, ty);
                        Arc::new(Tile::missing(w, h, n, pixel_type))
                    });
                    (0..across).map(|tx| missing[usize::from(tx + 1 == across)].clone()).collect()
                }
            };
            self.push_row(base, ty, row, &mut pending);
        }
    }

    /// Adds a complete row of tiles of a level. With the row above it, it makes a row of the next level.
    fn push_row(&self, level: usize, ty: u32, row: Vec<Arc<Tile>>, pending: &mut [Vec<Arc<Tile>>]) {
        if level > self.stored_levels() {
            let keyed = row.iter().zip(0..).map(|(tile, tx)| (self.key(level, tx, ty), tile.clone()));
            self.store.insert(keyed);
        }
        let Some(next) = self.levels.get(level + 1) else { return };
        let last = ty + 1 == self.levels[level].tiles().1;
        if ty.is_multiple_of(2) && !last {
            pending[level] = row;
            return;
        }
        let (above, below) =
            if ty.is_multiple_of(2) { (row, Vec::new()) } else { (std::mem::take(&mut pending[level]), row) };
        let made = (0..next.tiles().0)
            .map(|tx| {
                let at = |row: &[Arc<Tile>], i: u32| row.get((2 * tx + i) as usize).cloned();
                let four = [at(&above, 0), at(&above, 1), at(&below, 0), at(&below, 1)];
                let (w, h) = tile_size((next.width, next.height), tx, ty / 2);
                Arc::new(Tile::reduced(four.each_ref().map(|t| t.as_deref()), w, h, &self.reduce))
            })
            .collect();
        self.push_row(level + 1, ty / 2, made, pending);
    }

    /// Returns a tile that is in memory.
    pub fn held(&self, level: usize, tx: u32, ty: u32) -> Option<Arc<Tile>> {
        self.store.get(self.key(level, tx, ty))
    }

    /// True when a tile is in memory.
    pub fn has(&self, level: usize, tx: u32, ty: u32) -> bool {
        self.store.has(self.key(level, tx, ty))
    }

    /// Returns an existing tile from memory, or reads it, or computes it from finer ones.
    ///
    /// # Errors
    /// Returns an error when none of it can be read.
    pub fn tile(&self, level: usize, tx: u32, ty: u32) -> Result<Arc<Tile>> {
        if let Some(tile) = self.held(level, tx, ty) {
            return Ok(tile);
        }
        let Some(l) = self.levels.get(level) else {
            return Err(crate::ViewError::Misuse { what: format!("there is no level {level}") });
        };
        if l.stored {
            return self.read(level, tx, ty);
        }
        if self.upper.is_some() && level > self.stored_levels() {
            let _one = self.reading.lock();
            if !self.has(level, tx, ty) {
                self.make_upper();
            }
            return self.held(level, tx, ty).ok_or_else(|| crate::ViewError::Misuse {
                what: format!("there is no tile ({tx}, {ty}) of level {level}"),
            });
        }
        let finer = |i: u32, j: u32| {
            let (x, y) = (2 * tx + i, 2 * ty + j);
            let (across, down) = self.levels[level - 1].tiles();
            if x < across && y < down { self.tile(level - 1, x, y).map(Some) } else { Ok(None) }
        };
        // When one of the four cannot be read, the other three are still shown.
        let tiles = [finer(0, 0), finer(1, 0), finer(0, 1), finer(1, 1)];
        let mut error = None;
        let mut found = false;
        let size = (self.levels[level - 1].width, self.levels[level - 1].height);
        let tiles: Vec<Option<Arc<Tile>>> = (tiles.into_iter().enumerate())
            .map(|(i, tile)| match tile {
                Ok(tile) => {
                    found |= tile.is_some();
                    tile
                }
                Err(e) => {
                    error = Some(e);
                    let (w, h) = tile_size(size, 2 * tx + i as u32 % 2, 2 * ty + i as u32 / 2);
                    let (n, pixel_type) = (self.source.channels(), self.source.pixel_type());
                    Some(Arc::new(Tile::missing(w, h, n, pixel_type)))
                }
            })
            .collect();
        if let Some(error) = error.filter(|_| !found) {
            return Err(error);
        }
        let (w, h) = tile_size((l.width, l.height), tx, ty);
        let four = [0, 1, 2, 3].map(|i| tiles[i].as_deref());
        let tile = Arc::new(Tile::reduced(four, w, h, &self.reduce));
        self.store.insert([(self.key(level, tx, ty), tile.clone())]);
        Ok(tile)
    }

    /// Requests a rough image before the first tile is read, where the source has one.
    pub fn sketch_first(&self) {
        self.sketch_first.store(true, Ordering::Release);
    }

    /// Cancels the request of a rough image.
    pub(crate) fn no_sketch(&self) {
        self.sketch_first.store(false, Ordering::Release);
    }

    /// True when a rough image is requested and not made yet.
    pub(crate) fn wants_sketch(&self) -> bool {
        self.sketch_first.load(Ordering::Acquire)
    }

    /// Makes the rough image, if it is requested and not made yet.
    pub(crate) fn make_sketch(&self) {
        let _one = self.reading.lock();
        self.make_sketch_alone();
    }

    /// Makes the rough image while nothing else is read.
    fn make_sketch_alone(&self) {
        if !self.sketch_first.swap(false, Ordering::AcqRel) {
            return;
        }
        self.sketch.get_or_init(|| {
            // The rough image consists of means, so all channels must be reduced to means.
            let sketch = self.source.sketch().filter(|_| self.reduce.iter().all(|r| *r == Reduce::Mean))?;
            let level = self.stored_levels() - 1 + sketch.halvings as usize;
            let tiles = sketch.tiles.into_iter().map(|(at, tile)| (at, Arc::new(tile)));
            (level < self.levels.len()).then(|| (level, tiles.collect()))
        });
    }

    /// Returns a tile of the rough image.
    pub(crate) fn sketched(&self, level: usize, tx: u32, ty: u32) -> Option<Arc<Tile>> {
        let (_, tiles) = self.sketch.get()?.as_ref().filter(|(l, _)| *l == level)?;
        tiles.iter().find(|(at, _)| *at == (tx, ty)).map(|(_, tile)| tile.clone())
    }

    fn read(&self, level: usize, tx: u32, ty: u32) -> Result<Arc<Tile>> {
        let one = match self.source.access() {
            Access::Tiles => None,
            Access::Whole | Access::Bands => Some(self.reading.lock()),
        };
        if one.is_some() {
            self.make_sketch_alone();
        }
        // Another thread may have read it meanwhile.
        if one.is_some()
            && let Some(tile) = self.held(level, tx, ty)
        {
            return Ok(tile);
        }
        let mut wanted = None;
        let tiles = self.source.read(level, tx, ty)?.into_iter().map(|((x, y), tile)| {
            let tile = Arc::new(tile);
            if (x, y) == (tx, ty) {
                wanted = Some(tile.clone());
            }
            (self.key(level, x, y), tile)
        });
        let tiles: Vec<_> = tiles.collect();
        self.store.insert(tiles);
        wanted.ok_or_else(|| crate::ViewError::Misuse { what: format!("no tile ({tx}, {ty}) came") })
    }

    /// Drops the tiles of a rectangle of level 0, `x0..x1` times `y0..y1`, whose pixels changed.
    pub fn forget(&self, (x0, y0, x1, y1): (u32, u32, u32, u32)) {
        let levels = self.levels.clone();
        self.store.forget(self.page, move |level, tx, ty| {
            let Some(l) = levels.get(level as usize) else { return true };
            let span = |t: u32, scale: f64| (f64::from(t * TILE) * scale, f64::from((t + 1) * TILE) * scale);
            let (left, right) = span(tx, l.scale.0);
            let (top, bottom) = span(ty, l.scale.1);
            left < f64::from(x1) && right > f64::from(x0) && top < f64::from(y1) && bottom > f64::from(y0)
        });
    }

    /// Returns all channels of pixel (x, y) of a level, in their stored type; `None` outside.
    ///
    /// # Errors
    /// Returns an error when it cannot be read.
    pub fn pixel(&self, level: usize, x: u32, y: u32) -> Result<Option<granita_image::Pixels>> {
        let Some(l) = self.levels.get(level).filter(|l| x < l.width && y < l.height) else { return Ok(None) };
        let _ = l;
        let tile = self.tile(level, x / TILE, y / TILE)?;
        let at = ((y % TILE) * tile.width + x % TILE) as usize * tile.channels;
        let mut out = granita_image::Pixels::zeros(tile.pixels.pixel_type(), tile.channels);
        out.copy_from(0, &tile.pixels, at, tile.channels);
        Ok(Some(out))
    }

    /// Returns the type of all values.
    pub fn pixel_type(&self) -> PixelType {
        self.source.pixel_type()
    }
}
