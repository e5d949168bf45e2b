//! Tiles: blocks of texels in memory, in the type of their file.

use crate::gaussian::Gaussian;
use crate::simd::{LANES, Piece, Row, Rows, Run, Sums, Texel};
use granita_image::{PixelType, Pixels};
use half::f16;

/// The largest magnitude of a float texel, so that filtering can neither overflow nor compute infinity minus
/// infinity.
const LARGEST: f32 = 1e30;

/// The memory layout of the channels of a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Layout {
    /// The values are stored texel by texel, for access to single texels.
    Texels,
    /// The values are stored row by row, and in each row channel by channel, so that the values for filters are
    /// contiguous.
    Planes,
}

/// A block of texels in memory, in the type of the file.
#[derive(Debug)]
pub(crate) struct Tile {
    pixels: Pixels,
    channels: usize,
    layout: Layout,
    /// The number of values from a row to the next. It is 0 where one row represents all.
    row: usize,
    /// The number of values from a channel of a row to the next, for [`Layout::Planes`]. It is 0 where one channel
    /// represents all.
    plane: usize,
}

/// Converts a stored number to the value of lookups.
#[inline]
pub(crate) fn from_raw(pixel_type: PixelType, raw: f32) -> f32 {
    match pixel_type {
        PixelType::U8 => raw * (1.0 / 255.0),
        PixelType::U16 => raw / 65535.0,
        PixelType::U32 | PixelType::Half | PixelType::Float => raw,
    }
}

/// Reorders rows of texels channel by channel.
fn planes<T: Copy>(values: &mut Vec<T>, width: usize, channels: usize) {
    let mut out = Vec::with_capacity(values.len());
    for row in values.chunks(width * channels) {
        for c in 0..channels {
            out.extend(row.iter().skip(c).step_by(channels));
        }
    }
    *values = out;
}

impl Tile {
    /// Takes a block of rows of `width` texels, which are stored texel by texel. NaN becomes 0, and infinite values
    /// become finite.
    pub(crate) fn new(mut pixels: Pixels, width: usize, channels: usize, layout: Layout) -> Self {
        match &mut pixels {
            Pixels::Float(v) => {
                for x in v {
                    *x = if x.is_nan() { 0.0 } else { x.clamp(-LARGEST, LARGEST) };
                }
            }
            Pixels::Half(v) => {
                for x in v.iter_mut().filter(|x| !x.is_finite()) {
                    *x = match (x.is_nan(), x.is_sign_negative()) {
                        (true, _) => f16::ZERO,
                        (false, false) => f16::MAX,
                        (false, true) => f16::MIN,
                    };
                }
            }
            Pixels::U8(_) | Pixels::U16(_) | Pixels::U32(_) => {}
        }
        if layout == Layout::Planes && channels > 1 {
            match &mut pixels {
                Pixels::U8(v) => planes(v, width, channels),
                Pixels::U16(v) => planes(v, width, channels),
                Pixels::U32(v) => planes(v, width, channels),
                Pixels::Half(v) => planes(v, width, channels),
                Pixels::Float(v) => planes(v, width, channels),
            }
        }
        Self { pixels, channels, layout, row: width * channels, plane: width }
    }

    /// Returns a tile of black texels, of any size. It holds the values of one channel of one row, which represent all.
    pub(crate) fn black(pixel_type: PixelType, width: usize, channels: usize) -> Self {
        let pixels = Pixels::zeros(pixel_type, width);
        Self { pixels, channels, layout: Layout::Planes, row: 0, plane: 0 }
    }

    /// Returns the index of the value of a texel's channel, and the distance to that of the next channel.
    #[inline]
    fn place(&self, x: usize, y: usize, channel: usize) -> (usize, usize) {
        match self.layout {
            Layout::Texels => (y * self.row + x * self.channels + channel, 1),
            Layout::Planes => (y * self.row + channel * self.plane + x, self.plane),
        }
    }

    /// Returns the channels `first .. first + n` of the texel at (x, y). `n` is at most 4, and all channels are in the
    /// file.
    #[inline]
    pub(crate) fn texel(&self, x: usize, y: usize, first: usize, n: usize) -> [f32; 4] {
        let pixel_type = self.pixels.pixel_type();
        self.raw(x, y, first, n).map(|v| from_raw(pixel_type, v))
    }

    /// Does the same as [`Tile::texel`], but returns the numbers as they are stored.
    #[inline]
    pub(crate) fn raw(&self, x: usize, y: usize, first: usize, n: usize) -> [f32; 4] {
        let (at, step) = self.place(x, y, first);
        match &self.pixels {
            Pixels::U8(v) => every(v, at, step, n),
            Pixels::U16(v) => every(v, at, step, n),
            Pixels::U32(v) => every(v, at, step, n),
            Pixels::Half(v) => every(v, at, step, n),
            Pixels::Float(v) => every(v, at, step, n),
        }
    }

    /// Does the same as [`Tile::texel`], for the texel, the one to its right, and the two below them, which are all in
    /// the tile.
    #[inline]
    pub(crate) fn four(&self, x: usize, y: usize, first: usize, n: usize) -> [[f32; 4]; 4] {
        let (at, step) = self.place(x, y, first);
        let right = if self.layout == Layout::Texels { self.channels } else { 1 };
        let places = [at, at + right, at + self.row, at + self.row + right];
        match &self.pixels {
            Pixels::U8(v) => places.map(|at| every(v, at, step, n).map(|v| from_raw(PixelType::U8, v))),
            Pixels::U16(v) => places.map(|at| every(v, at, step, n).map(|v| from_raw(PixelType::U16, v))),
            Pixels::U32(v) => places.map(|at| every(v, at, step, n)),
            Pixels::Half(v) => places.map(|at| every(v, at, step, n)),
            Pixels::Float(v) => places.map(|at| every(v, at, step, n)),
        }
    }

    /// Adds `count` texels from (x, y) to the right, which are the next of a row. The channels are `first .. first +
    /// n`, with the values of [`Tile::raw`].
    #[inline]
    pub(crate) fn add_run(
        &self,
        (x, y): (usize, usize),
        (first, n): (usize, usize),
        count: usize,
        row: &mut Row,
        sums: &mut Sums,
    ) {
        sums.begin(|| self.raw(x, y, first, n));
        if self.layout == Layout::Texels && self.channels > 1 {
            for x in x..x + count {
                sums.add(row, self.raw(x, y, first, n));
            }
            return;
        }
        let (at, plane) = self.place(x, y, first);
        let run = (at, plane, count);
        match &self.pixels {
            Pixels::U8(v) => add(v, run, n, row, sums),
            Pixels::U16(v) => add(v, run, n, row, sums),
            Pixels::U32(v) => add(v, run, n, row, sums),
            Pixels::Half(v) => add(v, run, n, row, sums),
            Pixels::Float(v) => add(v, run, n, row, sums),
        }
    }

    /// Adds texels from (x, y) to the right with the weights of lanes `from .. to`, as [`Sums::weighted`] does.
    #[inline]
    pub(crate) fn add_weighted(
        &self,
        (x, y): (usize, usize),
        (first, n): (usize, usize),
        weights: &[f32; LANES],
        lanes: (usize, usize),
        sums: &mut Sums,
    ) {
        sums.begin(|| self.raw(x, y, first, n));
        if self.layout == Layout::Texels && self.channels > 1 {
            for (x, lane) in (x..).zip(lanes.0..lanes.1) {
                let value = self.raw(x, y, first, n);
                sums.weighted::<f32, 4>(weights, (lane, lane + 1), (&value, 0, 1));
            }
            return;
        }
        let (at, plane) = self.place(x, y, first);
        match &self.pixels {
            Pixels::U8(v) => weighted(v, (at, plane, n), weights, lanes, sums),
            Pixels::U16(v) => weighted(v, (at, plane, n), weights, lanes, sums),
            Pixels::U32(v) => weighted(v, (at, plane, n), weights, lanes, sums),
            Pixels::Half(v) => weighted(v, (at, plane, n), weights, lanes, sums),
            Pixels::Float(v) => weighted(v, (at, plane, n), weights, lanes, sums),
        }
    }

    /// Passes all channels of the texel at (x, y) to `f`. The tile is stored texel by texel.
    pub(crate) fn with_texel<T>(&self, x: usize, y: usize, f: impl FnOnce(&[f32]) -> T) -> T {
        let (at, step) = self.place(x, y, 0);
        match &self.pixels {
            Pixels::Float(v) if self.layout == Layout::Texels => f(&v[at..at + self.channels]),
            other => f(&(0..self.channels).map(|c| other.get(at + c * step)).collect::<Vec<f32>>()),
        }
    }

    /// Returns the bytes of memory that it takes.
    pub(crate) fn bytes(&self) -> u64 {
        (self.pixels.len() * self.pixels.pixel_type().bytes()) as u64
    }
}

/// Returns `n` values from `at` on, `step` apart.
#[inline]
fn every<T: Texel>(values: &[T], at: usize, step: usize, n: usize) -> [f32; 4] {
    let mut out = [0.0; 4];
    for (c, out) in out[..n].iter_mut().enumerate() {
        *out = values[at + c * step].raw();
    }
    out
}

/// Implements [`Tile::add_run`].
#[inline]
fn add<T: Texel>(
    values: &[T],
    (at, plane, count): (usize, usize, usize),
    n: usize,
    row: &mut Row,
    sums: &mut Sums,
) {
    let run = Run { values, at, plane, count };
    match n {
        1 => sums.run::<T, 1>(row, run),
        2 => sums.run::<T, 2>(row, run),
        3 => sums.run::<T, 3>(row, run),
        _ => sums.run::<T, 4>(row, run),
    }
}

/// Implements [`Tile::add_weighted`].
#[inline]
fn weighted<T: Texel>(
    values: &[T],
    (at, plane, n): (usize, usize, usize),
    weights: &[f32; LANES],
    lanes: (usize, usize),
    sums: &mut Sums,
) {
    match n {
        1 => sums.weighted::<T, 1>(weights, lanes, (values, at, plane)),
        2 => sums.weighted::<T, 2>(weights, lanes, (values, at, plane)),
        3 => sums.weighted::<T, 3>(weights, lanes, (values, at, plane)),
        _ => sums.weighted::<T, 4>(weights, lanes, (values, at, plane)),
    }
}

/// A tile that a footprint touches, and its position in the image. Where an image repeats, that is the position in the
/// copy that the footprint touches.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Placed<'a> {
    pub(crate) tile: &'a Tile,
    /// The position of texel (0, 0) of the tile in the image.
    pub(crate) corner: (i32, i32),
    /// The first column that belongs to the next tile.
    pub(crate) to: i32,
}

/// The largest number of tiles side by side for [`add_rows`].
pub(crate) const MOST_PLACED: usize = 8;

/// Adds the texels under a Gaussian that lie in the rows `y.0 .. y.1` of the image. `placed` are the tiles that these
/// rows touch, from left to right, at least one and at most [`MOST_PLACED`]. Returns false, and adds nothing, when they
/// are stored texel by texel.
#[inline]
pub(crate) fn add_rows(
    placed: &[Placed<'_>],
    channels: (usize, usize),
    (centre, y): ((f32, f32), (i32, i32)),
    gaussian: &Gaussian,
    sums: &mut Sums,
) -> bool {
    let place = (centre, y);
    match placed[0].tile.pixels.pixel_type() {
        PixelType::U8 => add_rows_of::<u8>(placed, channels, place, gaussian, sums),
        PixelType::U16 => add_rows_of::<u16>(placed, channels, place, gaussian, sums),
        PixelType::U32 => add_rows_of::<u32>(placed, channels, place, gaussian, sums),
        PixelType::Half => add_rows_of::<f16>(placed, channels, place, gaussian, sums),
        PixelType::Float => add_rows_of::<f32>(placed, channels, place, gaussian, sums),
    }
}

/// Implements [`add_rows`] for one type of texels.
#[inline]
fn add_rows_of<T: Texel>(
    placed: &[Placed<'_>],
    (first, n): (usize, usize),
    (centre, y): ((f32, f32), (i32, i32)),
    g: &Gaussian,
    sums: &mut Sums,
) -> bool {
    /// Returns the values of a tile, and `None` where they are stored texel by texel.
    #[inline]
    fn piece<'a, T: Texel>(placed: &Placed<'a>, first: usize) -> Option<Piece<'a, T>> {
        let Placed { tile, corner, to } = *placed;
        let values = T::of(&tile.pixels).filter(|_| tile.layout == Layout::Planes || tile.channels == 1)?;
        let (stride, plane) = (tile.row, tile.plane);
        let at = (first * plane) as isize - corner.0 as isize - corner.1 as isize * stride as isize;
        Some(Piece { values, at, stride, plane, to })
    }

    let Some(one) = piece::<T>(&placed[0], first) else { return false };
    if let [_] = placed {
        sum_rows(&[one], n, (centre, y), g, sums);
        return true;
    }
    let mut pieces = [one; MOST_PLACED];
    for (piece_of, placed) in pieces.iter_mut().zip(placed) {
        let Some(piece) = piece(placed, first) else { return false };
        *piece_of = piece;
    }
    sum_rows(&pieces[..placed.len()], n, (centre, y), g, sums);
    true
}

/// Adds the rows of [`add_rows`].
#[inline]
fn sum_rows<T: Texel>(
    pieces: &[Piece<'_, T>],
    n: usize,
    (centre, y): ((f32, f32), (i32, i32)),
    g: &Gaussian,
    sums: &mut Sums,
) {
    let rows = Rows { pieces, centre, y };
    match (n, g.is_long()) {
        (1, false) => sums.rows::<T, 1, false>(g, rows),
        (1, true) => sums.rows::<T, 1, true>(g, rows),
        (2, false) => sums.rows::<T, 2, false>(g, rows),
        (2, true) => sums.rows::<T, 2, true>(g, rows),
        (3, false) => sums.rows::<T, 3, false>(g, rows),
        (3, true) => sums.rows::<T, 3, true>(g, rows),
        (_, false) => sums.rows::<T, 4, false>(g, rows),
        (_, true) => sums.rows::<T, 4, true>(g, rows),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texels_are_made_finite() {
        let t = Tile::new(
            Pixels::Float(vec![f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1.0]),
            4,
            1,
            Layout::Planes,
        );
        let got: Vec<f32> = (0..4).map(|x| t.texel(x, 0, 0, 1)[0]).collect();
        assert_eq!(got, [0.0, 1e30, -1e30, 1.0]);
        let t = Tile::new(
            Pixels::Half(vec![f16::NAN, f16::INFINITY, f16::ONE, f16::NEG_INFINITY]),
            4,
            1,
            Layout::Texels,
        );
        let got: Vec<f32> = (0..4).map(|x| t.texel(x, 0, 0, 1)[0]).collect();
        assert_eq!(got, [0.0, 65504.0, 1.0, -65504.0]);
    }
}
