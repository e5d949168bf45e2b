//! The statistics of the values of an image or a part of it.

use crate::Result;
use crate::image::Page;
use crate::tile::{TILE, Tile};
use granita_base::parallel_map;
use granita_image::PixelRect;
use std::sync::atomic::{AtomicBool, Ordering};

/// The statistics of one channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Statistics {
    /// The number of finite values.
    pub count: u64,
    /// The number of NaNs.
    pub nan: u64,
    /// The number of infinite values, of either sign.
    pub infinite: u64,
    /// The number of finite values below 0.
    pub negative: u64,
    /// The least finite value; infinite when there is none.
    pub min: f32,
    /// The largest finite value; minus infinite when there is none.
    pub max: f32,
    /// The mean of the finite values.
    pub mean: f64,
    /// The sum of the squared differences from the mean.
    squares: f64,
}

impl Default for Statistics {
    fn default() -> Self {
        Self {
            count: 0,
            nan: 0,
            infinite: 0,
            negative: 0,
            min: f32::INFINITY,
            max: f32::NEG_INFINITY,
            mean: 0.0,
            squares: 0.0,
        }
    }
}

impl Statistics {
    /// Returns the statistics of some values.
    pub fn of(values: impl Iterator<Item = f32> + Clone) -> Self {
        let mut s = Self::default();
        let mut sum = 0.0;
        for v in values.clone() {
            if v.is_nan() {
                s.nan += 1;
            } else if v.is_infinite() {
                s.infinite += 1;
            } else {
                s.count += 1;
                s.negative += u64::from(v < 0.0);
                s.min = s.min.min(v);
                s.max = s.max.max(v);
                sum += f64::from(v);
            }
        }
        if s.count > 0 {
            s.mean = sum / s.count as f64;
            s.squares = values.filter(|v| v.is_finite()).map(|v| (f64::from(v) - s.mean).powi(2)).sum();
        }
        s
    }

    /// Returns the statistics of both together (T. Chan, G. Golub, R. LeVeque, Updating formulae and a pairwise
    /// algorithm for computing sample variances, 1979).
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        let (n, m) = (self.count as f64, other.count as f64);
        let apart = other.mean - self.mean;
        let all = (n + m).max(1.0);
        Self {
            count: self.count + other.count,
            nan: self.nan + other.nan,
            infinite: self.infinite + other.infinite,
            negative: self.negative + other.negative,
            min: self.min.min(other.min),
            max: self.max.max(other.max),
            mean: (self.mean * n + other.mean * m) / all,
            squares: self.squares + other.squares + apart * apart * n * m / all,
        }
    }

    /// Returns the standard deviation of the finite values.
    pub fn deviation(&self) -> f64 {
        if self.count == 0 { 0.0 } else { (self.squares / self.count as f64).sqrt() }
    }
}

/// Returns the statistics of each channel in a part of a tile.
fn of_tile(tile: &Tile, part: PixelRect) -> Vec<Statistics> {
    let n = tile.channels;
    let (x0, x1) = (part.x0 as usize, part.x1 as usize);
    let rows: Vec<Vec<f32>> = (part.y0 as usize..part.y1 as usize)
        .map(|y| {
            let row = y * tile.width as usize;
            ((row + x0) * n..(row + x1) * n).map(|i| tile.pixels.get(i)).collect()
        })
        .collect();
    (0..n)
        .map(|c| Statistics::of(rows.iter().flat_map(|row| row.iter().skip(c).step_by(n)).copied()))
        .collect()
}

/// Returns the statistics of every channel of a part of a level. The part may extend beyond the image.
///
/// The result is the same for any number of threads, because parts of tiles are combined in order.
///
/// # Errors
/// Returns an error when a part cannot be read.
pub fn statistics(page: &Page, level: usize, part: PixelRect) -> Result<Vec<Statistics>> {
    let pyramid = &page.pyramid;
    let Some(l) = pyramid.levels().get(level) else {
        return Err(crate::ViewError::Misuse { what: format!("there is no level {level}") });
    };
    let part = part.intersection(&PixelRect::at(0, 0, l.width, l.height));
    let none = vec![Statistics::default(); page.spec().nchannels()];
    if part.is_empty() {
        return Ok(none);
    }
    let tile = TILE as i32;
    let columns = part.x0 / tile..(part.x1 - 1) / tile + 1;
    let places: Vec<(i32, i32)> = (part.y0 / tile..(part.y1 - 1) / tile + 1)
        .flat_map(|ty| columns.clone().map(move |tx| (tx, ty)))
        .collect();
    let failed = AtomicBool::new(false);
    let work = |(): &mut (), (tx, ty): (i32, i32)| {
        if failed.load(Ordering::Relaxed) {
            return Ok(None);
        }
        let t = pyramid
            .tile(level, tx as u32, ty as u32)
            .inspect_err(|_| failed.store(true, Ordering::Relaxed))?;
        let (left, top) = (tx * tile, ty * tile);
        let inside = part.intersection(&PixelRect::at(left, top, t.width, t.height));
        let inside = PixelRect {
            x0: inside.x0 - left,
            x1: inside.x1 - left,
            y0: inside.y0 - top,
            y1: inside.y1 - top,
        };
        Ok(Some(of_tile(&t, inside)))
    };
    let results = parallel_map(places, rayon::current_num_threads(), || (), work);
    let results = results.into_iter().collect::<Result<Vec<_>>>()?;
    Ok(results
        .into_iter()
        .flatten()
        .fold(none, |sums, tile| sums.into_iter().zip(tile).map(|(a, b)| a.and(b)).collect()))
}

/// Returns the range of the finite depths of a channel, the nearest first; `None` when there are none. Reads a
/// level of no more than 1024 pixels a side.
///
/// # Errors
/// Returns an error when it cannot be read.
pub fn depth_range(page: &Page, channel: usize) -> Result<Option<(f32, f32)>> {
    let levels = page.pyramid.levels();
    let level = levels.iter().position(|l| l.width.max(l.height) <= 1024).unwrap_or(levels.len() - 1);
    let (across, down) = levels[level].tiles();
    let (mut near, mut far) = (f32::INFINITY, f32::NEG_INFINITY);
    for (tx, ty) in (0..down).flat_map(|ty| (0..across).map(move |tx| (tx, ty))) {
        let tile = page.pyramid.tile(level, tx, ty)?;
        for i in (channel..tile.pixels.len()).step_by(tile.channels) {
            let z = tile.pixels.get(i);
            if z.abs() < 1e29 {
                near = near.min(z);
                far = far.max(z);
            }
        }
    }
    Ok((near <= far).then_some((near, far)))
}

/// Returns the range of the finite values of a layer, without its alpha, as [`depth_range`] does.
///
/// # Errors
/// Returns an error when it cannot be read.
pub fn value_range(page: &Page, layer: usize) -> Result<Option<(f32, f32)>> {
    let Some(layer) = page.layers.get(layer) else { return Ok(None) };
    let mut range: Option<(f32, f32)> = None;
    for channel in layer.channels.iter().filter(|c| Some(**c) != layer.alpha) {
        if let Some((low, high)) = depth_range(page, *channel)? {
            let (a, b) = range.unwrap_or((low, high));
            range = Some((a.min(low), b.max(high)));
        }
    }
    Ok(range)
}

/// A histogram of values.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram {
    /// The lower end of the first bin.
    pub low: f32,
    /// The upper end of the last bin.
    pub high: f32,
    /// True for bins of equal ratios.
    pub log: bool,
    /// For red, green and blue, the number of values in each bin. Values beyond an end are in the bin at that end.
    pub bins: [Vec<u32>; 3],
}

impl Histogram {
    /// The number of bins.
    pub const BINS: usize = 256;

    /// Returns an empty histogram.
    pub fn new(low: f32, high: f32, log: bool) -> Self {
        let log = log && low > 0.0 && high > low;
        Self { low, high, log, bins: std::array::from_fn(|_| vec![0; Self::BINS]) }
    }

    /// Adds the pixels of a tile. Values that are not finite are skipped. Channels are those of
    /// [`crate::Display::pick`].
    pub fn add(&mut self, tile: &Tile, pick: &[crate::Pick; 4], convert: impl Fn(f32) -> f32) {
        let (low, high) = if self.log { (self.low.log2(), self.high.log2()) } else { (self.low, self.high) };
        let scale = Self::BINS as f32 / (high - low).max(f32::MIN_POSITIVE);
        let (mut scratch, mut row) = (Vec::new(), Vec::new());
        for y in 0..tile.height {
            row.clear();
            tile.append_row((0, tile.width, y), pick, &mut scratch, &mut row);
            for pixel in &row {
                for (bins, v) in self.bins.iter_mut().zip(pixel) {
                    let v = convert(*v);
                    if v.is_finite() {
                        let v = if self.log { v.max(f32::MIN_POSITIVE).log2() } else { v };
                        let bin = ((v - low) * scale).clamp(0.0, (Self::BINS - 1) as f32) as usize;
                        bins[bin] = bins[bin].saturating_add(1);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nan_infinite_and_negative_values_are_counted() {
        let v = [1.0, f32::NAN, -3.0, f32::INFINITY, 5.0, f32::NEG_INFINITY];
        let s = Statistics::of(v.into_iter());
        assert_eq!((s.count, s.nan, s.infinite, s.negative), (3, 1, 2, 1));
        assert_eq!((s.min, s.max, s.mean), (-3.0, 5.0, 1.0));
        assert!((s.deviation() - (32.0_f64 / 3.0).sqrt()).abs() < 1e-12);
    }

    #[test]
    fn statistics_of_parts_combine_to_the_whole() {
        let v: Vec<f32> = (0..1000).map(|i| (i as f32 * 0.37).sin() * 100.0 + 1e6).collect();
        let whole = Statistics::of(v.iter().copied());
        let parts = v.chunks(77).map(|c| Statistics::of(c.iter().copied()));
        let parts = parts.fold(Statistics::default(), Statistics::and);
        assert_eq!((whole.count, whole.min, whole.max), (parts.count, parts.min, parts.max));
        assert!((whole.mean - parts.mean).abs() < 1e-6);
        assert!((whole.deviation() / parts.deviation() - 1.0).abs() < 1e-9);
    }

    #[test]
    fn statistics_of_no_values_are_zero() {
        let s = Statistics::of(std::iter::empty()).and(Statistics::default());
        assert_eq!((s.count, s.mean, s.deviation()), (0, 0.0, 0.0));
        assert!(s.min > s.max);
    }
}
