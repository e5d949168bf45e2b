//! Access to the texels of one file during one lookup.

use crate::cube;
use crate::file::TextureFile;
use crate::footprint::mix;
use crate::gaussian::Gaussian;
use crate::level::Level;
use crate::made::TileMaker;
use crate::shared::Shared;
use crate::simd::{LANES, Row, Sums};
use crate::tile_cache::{Cell, TileKey};
use crate::tiles::{MOST_PLACED, Placed, Tile, add_rows};
use crate::wrap::{Wrap, cell};
use granita_base::Vec3;
use std::sync::Arc;

/// Reads up to four neighbouring channels of a file.
pub(crate) struct Sampler<'a> {
    shared: Tiles<'a>,
    pub(crate) file: &'a TextureFile,
    first: usize,
    channels: usize,
    held: &'a mut Held,
}

/// The sources of tiles.
type Tiles<'a> = (&'a Shared, Option<&'a dyn TileMaker>);

/// The number of places for tiles of one thread.
const PLACES: usize = 64;

/// A tile that a thread holds.
#[derive(Debug)]
struct HeldTile {
    key: TileKey,
    cell: Arc<Cell>,
    /// The bytes that it adds to [`Held::bytes`].
    bytes: u64,
}

/// The tiles that one thread used lately, so that it seldom accesses the shared cache. They belong to any files of one
/// cache, and count for its bound.
#[derive(Debug)]
pub(crate) struct Held {
    tiles: [Option<HeldTile>; PLACES],
    /// The bytes of these tiles, and the largest permitted number of them. It is a small part of the bound, so that
    /// threads hardly reduce the memory of each other.
    bytes: u64,
    most: u64,
    /// The number of requests to the shared cache.
    pub(crate) requests: u64,
}

impl Held {
    pub(crate) fn new(shared: &Shared) -> Self {
        Self { tiles: [const { None }; PLACES], bytes: 0, most: shared.bound() / 64, requests: 0 }
    }

    /// Returns the place of a tile. Neighbouring tiles of a level have different places.
    #[inline]
    fn place(key: &TileKey) -> usize {
        let mixed = key.level.wrapping_mul(29).wrapping_add(key.file.wrapping_mul(43));
        (key.tx.wrapping_add(mixed) & 7 | (key.ty.wrapping_add(mixed >> 3) & 7) << 3) as usize
    }

    /// Returns the tile of a key.
    #[inline]
    fn tile(&mut self, key: TileKey, shared: Tiles<'_>, file: &TextureFile) -> &Tile {
        let at = Self::place(&key);
        if !self.tiles[at].as_ref().is_some_and(|held| held.key == key) {
            self.fetch(at, key, shared, file);
        }
        match &self.tiles[at] {
            Some(held) => held.cell.tile(),
            None => unreachable!("the place was found or filled above"),
        }
    }

    /// Returns the tiles at these places if the thread holds all of them.
    #[inline(always)]
    fn placed(&self, places: &Few<Place>) -> Option<Few<Placed<'_>>> {
        let placed = |place: &Place| {
            let held = self.tiles[Self::place(&place.key)].as_ref().filter(|held| held.key == place.key)?;
            Some(Placed { tile: held.cell.tile(), corner: place.corner, to: place.to })
        };
        let (first, others) = places.as_slice().split_first()?;
        let mut all = Few::of(placed(first)?);
        for place in others {
            all.push(placed(place)?)?;
        }
        Some(all)
    }

    #[cold]
    fn fetch(&mut self, at: usize, key: TileKey, (shared, maker): Tiles<'_>, file: &TextureFile) {
        if let Some(gone) = self.tiles[at].take() {
            self.bytes -= gone.bytes;
        }
        // The new tile itself counts. With the smallest bounds a thread holds one tile.
        let bytes = file.counted_bytes(key.level as usize);
        if bytes > 0 && self.bytes.saturating_add(bytes) > self.most {
            self.tiles = [const { None }; PLACES];
            self.bytes = 0;
        }
        self.requests += 1;
        let cell = shared.tile(file, key, maker);
        let bytes = cell.tile().bytes().min(bytes);
        self.bytes += bytes;
        self.tiles[at] = Some(HeldTile { key, cell, bytes });
    }
}

impl<'a> Sampler<'a> {
    /// Returns a sampler of the channels `first .. first + channels`, which are at most four and all in the file.
    pub(crate) fn new(
        shared: Tiles<'a>,
        held: &'a mut Held,
        file: &'a TextureFile,
        first: usize,
        channels: usize,
    ) -> Self {
        debug_assert!(channels <= 4 && first + channels <= file.channels, "channels of the file");
        Self { shared, file, first, channels, held }
    }

    pub(crate) fn level(&self, level: usize) -> &'a Level {
        &self.file.levels[level]
    }

    /// Returns the index of the last (smallest) level.
    pub(crate) fn last(&self) -> usize {
        self.file.levels.len() - 1
    }

    /// Returns texel (x, y) of the whole image of a level, which must be inside.
    #[inline]
    pub(crate) fn texel(&mut self, level: usize, x: u32, y: u32) -> [f32; 4] {
        let (first, channels) = (self.first, self.channels);
        let (tile, x, y) = self.tile_of(level, x, y);
        tile.texel(x, y, first, channels)
    }

    /// Passes all channels of texel (x, y) of the whole image of a level to `f`. The texel must be inside.
    pub(crate) fn with_texel<T>(&mut self, level: usize, x: u32, y: u32, f: impl FnOnce(&[f32]) -> T) -> T {
        let (tile, x, y) = self.tile_of(level, x, y);
        tile.with_texel(x, y, f)
    }

    /// Returns the tile of a texel, and the texel's position in it.
    #[inline]
    fn tile_of(&mut self, level: usize, x: u32, y: u32) -> (&Tile, usize, usize) {
        let l = &self.file.levels[level];
        let (tx, ty) = (x / l.tile_width, y / l.tile_height);
        let key = TileKey { file: self.file.index, level: level as u32, tx, ty };
        let (x, y) = ((x - tx * l.tile_width) as usize, (y - ty * l.tile_height) as usize);
        (self.held.tile(key, self.shared, self.file), x, y)
    }

    /// Returns texel (x, y) of a level, the one to its right, and the two below them, which are all inside of the
    /// level. Returns `None` in the rare case that they do not lie in one tile.
    #[inline]
    pub(crate) fn four(&mut self, level: usize, x: u32, y: u32) -> Option<[[f32; 4]; 4]> {
        let l = &self.file.levels[level];
        let (width, height) = (l.tile_width as usize, l.tile_height as usize);
        let (first, n) = (self.first, self.channels);
        let (tile, x, y) = self.tile_of(level, x, y);
        (x + 1 < width && y + 1 < height).then(|| tile.four(x, y, first, n))
    }

    /// Does the same as [`Sampler::texel`], but returns the numbers as they are stored.
    #[inline]
    pub(crate) fn raw_texel(&mut self, level: usize, x: u32, y: u32) -> [f32; 4] {
        let (first, channels) = (self.first, self.channels);
        let (tile, x, y) = self.tile_of(level, x, y);
        tile.raw(x, y, first, channels)
    }

    /// Adds texels from (x, y) to the right, which are the next of a row and start inside. Adds `most`, or as many as
    /// the tile has. Returns their number.
    #[inline]
    pub(crate) fn add_run(
        &mut self,
        level: usize,
        (x, y): (u32, u32),
        most: u32,
        row: &mut Row,
        sums: &mut Sums,
    ) -> u32 {
        let channels = (self.first, self.channels);
        let tile_width = self.file.levels[level].tile_width;
        let (tile, x, y) = self.tile_of(level, x, y);
        let count = most.min(tile_width - x as u32);
        tile.add_run((x, y), channels, count as usize, row, sums);
        count
    }

    /// Adds texels from (x, y) to the right with the weights of lanes `from .. to`. All lie inside of the level.
    #[inline]
    pub(crate) fn add_weighted(
        &mut self,
        level: usize,
        (mut x, y): (u32, u32),
        weights: &[f32; LANES],
        (mut from, to): (usize, usize),
        sums: &mut Sums,
    ) {
        let channels = (self.first, self.channels);
        let tile_width = self.file.levels[level].tile_width;
        while from < to {
            let (tile, tx, ty) = self.tile_of(level, x, y);
            let count = (to - from).min(tile_width as usize - tx);
            tile.add_weighted((tx, ty), channels, weights, (from, from + count), sums);
            from += count;
            x += count as u32;
        }
    }

    /// Adds the texels under a Gaussian with this centre that lie in the rows `y.0 .. y.1`. All lie in one tile, at
    /// this column and row of tiles. Returns false, and adds nothing, when it is stored texel by texel.
    #[inline]
    pub(crate) fn add_tile(
        &mut self,
        level: usize,
        (tx, ty): (u32, u32),
        y: (i32, i32),
        (centre, gaussian): ((f32, f32), &Gaussian),
        sums: &mut Sums,
    ) -> bool {
        let l = &self.file.levels[level];
        let key = TileKey { file: self.file.index, level: level as u32, tx, ty };
        let corner = ((tx * l.tile_width) as i32, (ty * l.tile_height) as i32);
        let tile = self.held.tile(key, self.shared, self.file);
        let placed = Placed { tile, corner, to: corner.0 + l.tile_width as i32 };
        add_rows(&[placed], (self.first, self.channels), (centre, y), gaussian, sums)
    }

    /// Adds the texels under a Gaussian with this centre that lie in the rows `y.0 .. y.1`, which are inside of one row
    /// of tiles. An image of the wrap mode [`Wrap::Periodic`] repeats to all sides. Returns false, and adds nothing,
    /// when the texels are not in a few tiles that the thread can hold together.
    #[inline]
    pub(crate) fn add_band(
        &mut self,
        level: usize,
        y: (i32, i32),
        wrap: (Wrap, Wrap),
        (centre, gaussian): ((f32, f32), &Gaussian),
        sums: &mut Sums,
    ) -> bool {
        let channels = (self.first, self.channels);
        // Bounds of the columns are computed faster than the columns. The bounds may touch a tile that the footprint
        // does not touch. It does not matter where the thread holds that tile, but such a tile must not be read.
        let bounds = gaussian.bounds(centre, y);
        if let Some(places) = self.places(level, bounds, y.0, wrap)
            && let Some(placed) = self.held.placed(&places)
        {
            return add_rows(placed.as_slice(), channels, (centre, y), gaussian, sums);
        }
        let Some(columns) = gaussian.columns(centre, y) else { return true };
        let Some(places) = self.places(level, columns, y.0, wrap) else { return false };
        for place in places.as_slice() {
            self.held.tile(place.key, self.shared, self.file);
        }
        // With little memory, or where tiles are far apart, one may have replaced another.
        let Some(placed) = self.held.placed(&places) else { return false };
        add_rows(placed.as_slice(), channels, (centre, y), gaussian, sums)
    }

    /// Returns the tiles of the columns `x.0 ..= x.1` of row `y` of a level. Returns `None` when they are many, and for
    /// texels outside of an image that does not repeat.
    #[inline(always)]
    fn places(&self, level: usize, x: (i32, i32), y: i32, wrap: (Wrap, Wrap)) -> Option<Few<Place>> {
        let l = &self.file.levels[level];
        let width = l.width as i32;
        let (ty, top) = tile_at(y, l.height as i32, l.tile_height, wrap.1)?;
        let place = |from: i32| {
            let (tx, left) = tile_at(from, width, l.tile_width, wrap.0)?;
            let to = left + (l.tile_width as i32).min(width - (tx * l.tile_width) as i32);
            let key = TileKey { file: self.file.index, level: level as u32, tx, ty };
            Some(Place { key, corner: (left, top), to })
        };
        let mut places = Few::of(place(x.0)?);
        let mut from = places.last().to;
        while from <= x.1 {
            places.push(place(from)?)?;
            from = places.last().to;
        }
        Some(places)
    }

    /// Returns texel (x, y) of a face of a level, which must be inside.
    pub(crate) fn face_texel(&mut self, level: usize, face: usize, x: u32, y: u32) -> [f32; 4] {
        let (left, top) = self.file.face_origin(self.level(level), face);
        self.texel(level, left + x, top + y)
    }

    /// Applies `of` to the four texels of a cube around a direction (finite, not 0), and interpolates the results
    /// bilinearly, across edges.
    pub(crate) fn around(&mut self, level: usize, direction: Vec3, mut of: impl FnMut(&[f32]) -> f32) -> f32 {
        let layout = self.file.layout;
        let at = cube::project(layout, direction);
        let n = self.level(level).face_width;
        let ((x, fx), (y, fy)) = (cell(at.s.clamp(0.0, 1.0), n), cell(at.t.clamp(0.0, 1.0), n));
        let mut known = (0.0_f32, 0.0_f32);
        let corners = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)].map(|(x, y)| {
            cube::texel_across(layout, at.face, x, y, n as i32).map(|(face, x, y)| {
                let (left, top) = self.file.face_origin(self.level(level), face);
                let value = self.with_texel(level, left + x as u32, top + y as u32, &mut of);
                known = (known.0 + value, known.1 + 1.0);
                value
            })
        });
        // At a corner of the cube the fourth texel does not exist.
        let [a, b, c, d] = corners.map(|c| [c.unwrap_or(known.0 / known.1.max(1.0)), 0.0, 0.0, 0.0]);
        mix(mix(a, b, fx), mix(c, d, fx), fy)[0]
    }

    /// Returns the bilinear value of a level at (s, t), which are finite, as in a plain image.
    pub(crate) fn bilinear(&mut self, level: usize, s: f32, t: f32, wrap: (Wrap, Wrap)) -> [f32; 4] {
        let l = self.level(level);
        let (x, fx) = cell(wrap.0.reduce(s), l.width);
        let (y, fy) = cell(wrap.1.reduce(t), l.height);
        let xs = [x, x + 1].map(|x| wrap.0.index(x, l.width as i32));
        let ys = [y, y + 1].map(|y| wrap.1.index(y, l.height as i32));
        if let ([Some(x0), Some(x1)], [Some(y0), Some(y1)]) = (xs, ys)
            && (x1, y1) == (x0 + 1, y0 + 1)
            && let Some([a, b, c, d]) = self.four(level, x0 as u32, y0 as u32)
        {
            return mix(mix(a, b, fx), mix(c, d, fx), fy);
        }
        let mut corner = |x: Option<i32>, y: Option<i32>| match (x, y) {
            (Some(x), Some(y)) => self.texel(level, x as u32, y as u32),
            _ => [0.0; 4],
        };
        let top = mix(corner(xs[0], ys[0]), corner(xs[1], ys[0]), fx);
        let bottom = mix(corner(xs[0], ys[1]), corner(xs[1], ys[1]), fx);
        mix(top, bottom, fy)
    }

    /// Returns the bilinear value of a level of a cube at (s, t) of a face, in [0, 1], across edges where needed.
    pub(crate) fn cube_bilinear(&mut self, level: usize, face: usize, s: f32, t: f32) -> [f32; 4] {
        let n = self.level(level).face_width;
        let (x, fx) = cell(s, n);
        let (y, fy) = cell(t, n);
        let layout = self.file.layout;
        let corners = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)].map(|(x, y)| {
            cube::texel_across(layout, face, x, y, n as i32)
                .map(|(face, x, y)| self.face_texel(level, face, x as u32, y as u32))
        });
        // Where three faces are adjacent, the missing texel is the mean of the three existing ones.
        let mut sum = [0.0; 4];
        for value in corners.iter().flatten() {
            for (s, v) in sum.iter_mut().zip(value) {
                *s += v * (1.0 / 3.0);
            }
        }
        let [a, b, c, d] = corners.map(|c| c.unwrap_or(sum));
        mix(mix(a, b, fx), mix(c, d, fx), fy)
    }
}

/// The position of a tile: see [`Placed`].
#[derive(Clone, Copy, Debug)]
struct Place {
    key: TileKey,
    corner: (i32, i32),
    to: i32,
}

/// A list of one to [`MOST_PLACED`] items.
struct Few<T> {
    items: [T; MOST_PLACED],
    count: usize,
}

impl<T: Copy> Few<T> {
    #[inline(always)]
    fn of(item: T) -> Self {
        Self { items: [item; MOST_PLACED], count: 1 }
    }

    /// Adds an item. Returns `None` when the list is full.
    #[inline(always)]
    fn push(&mut self, item: T) -> Option<()> {
        *self.items.get_mut(self.count)? = item;
        self.count += 1;
        Some(())
    }

    #[inline(always)]
    fn last(&self) -> &T {
        &self.items[self.count - 1]
    }

    #[inline(always)]
    fn as_slice(&self) -> &[T] {
        &self.items[..self.count]
    }
}

/// Returns the index of the tile of row (column) `x` of an image of `n` rows, and the first row of the tile in the same
/// copy of the image. Returns `None` for a row outside of an image that does not repeat.
#[inline]
fn tile_at(x: i32, n: i32, size: u32, wrap: Wrap) -> Option<(u32, i32)> {
    let inside = if (0..n).contains(&x) {
        x
    } else if wrap == Wrap::Periodic {
        x.rem_euclid(n)
    } else {
        return None;
    };
    let tile = inside as u32 / size;
    Some((tile, x - inside + (tile * size) as i32))
}

/// Splits a level of detail into the two levels around it and the share of the coarser one.
#[inline]
pub(crate) fn levels(lod: f32, last: usize) -> (usize, f32) {
    let lod = lod.clamp(0.0, last as f32);
    let level = (lod as usize).min(last);
    let share = lod - level as f32;
    if level == last { (last, 0.0) } else { (level, share) }
}
