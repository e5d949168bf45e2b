//! A square block of an image, which is the unit of reading, caching and drawing.

use granita_image::{BlockCopy, PixelType, Pixels};

/// The width and height of a tile in pixels. Tiles at the right and lower edges are cut.
pub const TILE: u32 = 128;

/// The pixels of a block in their stored type, row by row with interleaved channels.
#[derive(Clone, Debug, PartialEq)]
pub struct Tile {
    /// The number of pixels per row.
    pub width: u32,
    /// The number of rows.
    pub height: u32,
    /// The number of values per pixel.
    pub channels: usize,
    /// `width * height * channels` values.
    pub pixels: Pixels,
    /// True when nothing of it could be read. All values are 0 then, as those are that could not be read otherwise.
    pub missing: bool,
}

/// The reduction of the texels of a finer level to one texel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reduce {
    /// The mean. NaN stays visible.
    Mean,
    /// The least value, for depths, which are huge where nothing is.
    Least,
    /// The first value, for numbers of objects, which have no mean.
    First,
}

/// The source of the values of a shown channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pick {
    /// This channel of the image.
    Channel(usize),
    /// This value everywhere.
    Value(f32),
}

impl Tile {
    /// Returns a black tile.
    pub fn zeros(width: u32, height: u32, channels: usize, pixel_type: PixelType) -> Self {
        let n = width as usize * height as usize * channels;
        Self { width, height, channels, pixels: Pixels::zeros(pixel_type, n), missing: false }
    }

    /// Returns a tile of which nothing could be read.
    pub(crate) fn missing(width: u32, height: u32, channels: usize, pixel_type: PixelType) -> Self {
        Self { missing: true, ..Self::zeros(width, height, channels, pixel_type) }
    }

    /// Returns the bytes of its memory.
    pub fn bytes(&self) -> u64 {
        (self.pixels.len() * self.pixels.pixel_type().bytes()) as u64
    }

    /// Appends the pixels `x0..x1` of row `y`, with four picked values each. `scratch` is working memory.
    pub(crate) fn append_row(
        &self,
        (x0, x1, y): (u32, u32, u32),
        pick: &[Pick; 4],
        scratch: &mut Vec<f32>,
        out: &mut Vec<[f32; 4]>,
    ) {
        let n = self.channels;
        let from = (y as usize * self.width as usize + x0 as usize) * n;
        let to = from + (x1 - x0) as usize * n;
        let values = self.pixels.floats_of(from..to, scratch);
        if let [Pick::Channel(r), Pick::Channel(g), Pick::Channel(b), a] = *pick {
            match a {
                Pick::Channel(a) => out.extend(values.chunks_exact(n).map(|p| [p[r], p[g], p[b], p[a]])),
                Pick::Value(a) => out.extend(values.chunks_exact(n).map(|p| [p[r], p[g], p[b], a])),
            }
            return;
        }
        out.extend(values.chunks_exact(n).map(|p| {
            pick.map(|pick| match pick {
                Pick::Channel(c) => p[c],
                Pick::Value(v) => v,
            })
        }));
    }

    /// Returns all channels of pixel (x, y), as floats.
    pub fn pixel(&self, x: u32, y: u32) -> Vec<f32> {
        let at = (y as usize * self.width as usize + x as usize) * self.channels;
        (at..at + self.channels).map(|i| self.pixels.get(i)).collect()
    }

    /// Returns one tile of half the size from up to four. `finer` holds those at (0, 0), (1, 0), (0, 1), (1, 1), of
    /// which the first always exists. `width` and `height` are those of the result.
    pub(crate) fn reduced(finer: [Option<&Self>; 4], width: u32, height: u32, reduce: &[Reduce]) -> Self {
        let first = finer[0].expect("invariant: a texel covers at least one finer one");
        let (n, pixel_type) = (first.channels, first.pixels.pixel_type());
        if finer.into_iter().flatten().all(|tile| tile.missing) {
            return Self::missing(width, height, n, pixel_type);
        }
        let line = width as usize * n;
        let mut values = vec![0.0_f32; height as usize * line];
        let means = (0..n).all(|c| reduce.get(c).copied().unwrap_or(Reduce::Mean) == Reduce::Mean);
        let (mut upper, mut lower) = (Vec::new(), Vec::new());
        for (y, out) in (0..height).zip(values.chunks_exact_mut(line.max(1))) {
            let row = 2 * y % TILE;
            for (side, out) in out.chunks_mut((TILE / 2) as usize * n.max(1)).enumerate() {
                let tile = finer[(2 * y / TILE * 2) as usize + side];
                let Some(tile) = tile.filter(|t| row < t.height && t.channels == n) else { continue };
                let upper = tile.row(row, &mut upper);
                // At the lower edge there may be only one row.
                let lower = if row + 1 < tile.height { Some(tile.row(row + 1, &mut lower)) } else { None };
                let whole = (tile.width / 2) as usize;
                let (pairs, rest) = out.split_at_mut((whole * n).min(out.len()));
                match lower {
                    Some(lower) if means && n == 4 => means_of::<4>(upper, lower, n, pairs),
                    Some(lower) if means && n == 3 => means_of::<3>(upper, lower, n, pairs),
                    Some(lower) if means => means_of::<0>(upper, lower, n, pairs),
                    _ => some_of((upper, lower), (0, tile.width), n, reduce, pairs),
                }
                some_of((upper, lower), (2 * whole as u32, tile.width), n, reduce, rest);
            }
        }
        let pixels = Pixels::from_floats(pixel_type, &values);
        Self { width, height, channels: n, pixels, missing: false }
    }

    /// Returns all values of a row as floats, as [`Pixels::to_floats`] does. `room` is the memory for converted values.
    fn row<'a>(&'a self, y: u32, room: &'a mut Vec<f32>) -> &'a [f32] {
        let line = self.width as usize * self.channels;
        self.pixels.floats_of(y as usize * line..(y as usize + 1) * line, room)
    }
}

/// Computes the means of two by two pixels of `n` channels. An `N` other than 0 is the same number, known to the
/// compiler.
fn means_of<const N: usize>(upper: &[f32], lower: &[f32], n: usize, out: &mut [f32]) {
    let n = if N == 0 { n } else { N };
    let pairs = upper.chunks_exact(2 * n).zip(lower.chunks_exact(2 * n));
    for ((upper, lower), out) in pairs.zip(out.chunks_exact_mut(n)) {
        for (c, out) in out.iter_mut().enumerate() {
            *out = (0.0 + upper[c] + upper[n + c] + lower[c] + lower[n + c]) / 4.0;
        }
    }
}

/// Computes one value for each two by two pixels, as far as these exist, of columns `from..width` of one or two rows.
fn some_of(
    (upper, lower): (&[f32], Option<&[f32]>),
    (from, width): (u32, u32),
    n: usize,
    reduce: &[Reduce],
    out: &mut [f32],
) {
    for (x, out) in (from..width).step_by(2).zip(out.chunks_exact_mut(n)) {
        for (c, out) in out.iter_mut().enumerate() {
            let columns = x as usize..(x as usize + 2).min(width as usize);
            let rows = [Some(upper), lower].into_iter().flatten();
            let mut found = rows.flat_map(|row| columns.clone().map(move |x| row[x * n + c]));
            *out = match reduce.get(c).copied().unwrap_or(Reduce::Mean) {
                Reduce::First => found.next().unwrap_or(0.0),
                Reduce::Least => found.fold(f32::INFINITY, f32::min),
                Reduce::Mean => {
                    let (sum, count) = found.fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
                    sum / count
                }
            };
        }
    }
}

/// Cuts rows of a level of this size into tiles of `n` channels. The rows begin at `y0`, a multiple of the size of a
/// tile.
pub(crate) fn cut(size: (u32, u32), n: usize, y0: u32, pixels: &Pixels) -> Vec<((u32, u32), Tile)> {
    let rows = (pixels.len() / (size.0 as usize * n)) as u32;
    let mut tiles = Vec::new();
    for ty in y0 / TILE..(y0 + rows).div_ceil(TILE) {
        for tx in 0..size.0.div_ceil(TILE) {
            let (width, height) = tile_size(size, tx, ty);
            let mut tile = Tile::zeros(width, height, n, pixels.pixel_type());
            let copy = BlockCopy {
                from_width: size.0 as usize,
                from: ((tx * TILE) as usize, (ty * TILE - y0) as usize),
                to_width: width as usize,
                to: (0, 0),
                size: (width as usize, height as usize),
                nchannels: n,
            };
            copy.run(pixels, &mut tile.pixels);
            tiles.push(((tx, ty), tile));
        }
    }
    tiles
}

/// Returns the width and height of tile (tx, ty) of a level of this size.
pub(crate) fn tile_size(size: (u32, u32), tx: u32, ty: u32) -> (u32, u32) {
    (size.0.saturating_sub(tx * TILE).min(TILE), size.1.saturating_sub(ty * TILE).min(TILE))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tile(width: u32, height: u32, values: Vec<f32>) -> Tile {
        let channels = values.len() / (width * height) as usize;
        Tile { width, height, channels, pixels: Pixels::Float(values), missing: false }
    }

    #[test]
    fn tiles_are_reduced_by_mean_least_or_largest() {
        let a = tile(3, 2, vec![1.0, 2.0, 9.0, 3.0, 4.0, f32::NAN]);
        let one = |r| match Tile::reduced([Some(&a), None, None, None], 2, 1, &[r]).pixels {
            Pixels::Float(v) => v,
            _ => panic!(),
        };
        assert_eq!(one(Reduce::Mean)[0], 2.5);
        assert!(one(Reduce::Mean)[1].is_nan(), "what is no number stays visible");
        assert_eq!(one(Reduce::Least), [1.0, 9.0]);
        assert_eq!(one(Reduce::First), [1.0, 9.0]);
    }

    #[test]
    fn four_tiles_are_reduced_to_one() {
        let t = |v: f32| tile(TILE, TILE, vec![v; (TILE * TILE) as usize]);
        let (a, b, c, d) = (t(1.0), t(2.0), t(3.0), t(4.0));
        let r = Tile::reduced([Some(&a), Some(&b), Some(&c), Some(&d)], TILE, TILE, &[Reduce::Mean]);
        assert_eq!([r.pixel(0, 0)[0], r.pixel(TILE - 1, 0)[0]], [1.0, 2.0]);
        assert_eq!([r.pixel(0, TILE - 1)[0], r.pixel(TILE / 2, TILE / 2)[0]], [3.0, 4.0]);
    }

    #[test]
    fn tiles_that_could_not_be_read_stay_so_until_one_was_read() {
        let read = tile(TILE, TILE, vec![1.0; (TILE * TILE) as usize]);
        let missing = Tile::missing(TILE, TILE, 1, read.pixels.pixel_type());
        let all =
            Tile::reduced([Some(&missing), Some(&missing), None, None], TILE, TILE / 2, &[Reduce::Least]);
        assert!(all.missing);
        assert_eq!(all, Tile::missing(TILE, TILE / 2, 1, read.pixels.pixel_type()));
        let some = Tile::reduced([Some(&missing), Some(&read), None, None], TILE, TILE / 2, &[Reduce::Mean]);
        assert!(!some.missing);
        assert_eq!([some.pixel(0, 0)[0], some.pixel(TILE - 1, 0)[0]], [0.0, 1.0]);
    }

    #[test]
    fn picks_choose_channels_and_constants() {
        let mut out = Vec::new();
        let t = tile(2, 1, vec![0.1, 0.2, 0.3, 0.4]);
        let pick = [Pick::Channel(1), Pick::Channel(1), Pick::Value(0.5), Pick::Value(1.0)];
        t.append_row((0, 2, 0), &pick, &mut Vec::new(), &mut out);
        assert_eq!(out, [[0.2, 0.2, 0.5, 1.0], [0.4, 0.4, 0.5, 1.0]]);
    }
}
