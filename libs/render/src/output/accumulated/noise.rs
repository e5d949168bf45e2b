//! The noise of an image of passes.

use super::{Accumulated, TILE, places};
use crate::PixelRect;
use crate::output::halves::Halves;
use crate::passes::{ErrorEstimate, Spot, confident_error};

/// The side of the blocks whose errors are reported, in pixels.
const BLOCK: i32 = 8;

/// The least [`Halves::share`] of a pixel whose halves show its noise.
const LEAST_SHARE: f64 = 1e-6;

/// What the passes of a pixel show of its noise.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct PixelNoise {
    /// The mean of its colours.
    mean: f64,
    /// The mean variance that a colour would have if all passes were independent of each other.
    independent: f64,
    /// The mean variance of a colour, from the difference of two halves, which are independent.
    squared: f64,
}

impl Accumulated {
    /// Returns the noise of a pixel; `None` when it is not finite or there are fewer than two passes.
    fn noise(&self, pixel: usize) -> Option<PixelNoise> {
        let (n, channels) = (self.counts[pixel], self.colors.len() as f64);
        let second = self.second.as_ref().filter(|_| n >= 2)?;
        let (mut noise, mut known, mut total) = (PixelNoise::default(), 0.0, 0.0);
        let mut is_halved = n > 2;
        for (k, (c, layer)) in self.colors.iter().zip(&self.layer_of).enumerate() {
            let sum = self.sums[pixel * self.channels + c];
            total = self.weights[pixel * self.layers.len() + layer];
            noise.mean += sum / total;
            known += sum * sum / total;
            let Halves { means: [a, b], share } = second.halves(pixel, [k, *layer], [sum, total]);
            is_halved &= share > LEAST_SHARE;
            noise.squared +=
                if is_rounding(a - b, a.abs() + b.abs()) { 0.0 } else { share * (a - b).powi(2) };
        }
        let differences = (self.squares[pixel] - known).max(0.0);
        // What rounding leaves of values that are all the same is no variance.
        let differences = if is_rounding(differences.sqrt(), known.sqrt()) { 0.0 } else { differences };
        noise.independent = differences / total / f64::from(n - 1);
        // Two passes are two halves. Where one half sees nothing, it shows no noise.
        if !is_halved {
            noise.squared = noise.independent;
        }
        let mean = |sum: f64| sum / channels;
        let noise = PixelNoise {
            mean: mean(noise.mean),
            independent: mean(noise.independent),
            squared: mean(noise.squared),
        };
        [noise.mean, noise.independent, noise.squared].iter().all(|v| v.is_finite()).then_some(noise)
    }

    /// Returns the standard deviations of the pixels of a rectangle over the mean value `mean`: the noise of the image.
    /// Each channel of a pixel has that of all its colours. It is 0 where it is not known.
    pub(crate) fn deviations(&self, rect: &PixelRect, mean: f64) -> Vec<f32> {
        let deviation = |[x, y]: [i32; 2]| {
            let noise = self.noise(self.pixel(x, y)).unwrap_or_default();
            (noise.squared.sqrt() / mean.abs()) as f32
        };
        places(rect).flat_map(|at| std::iter::repeat_n(deviation(at), self.channels)).collect()
    }

    /// Returns the mean of the colours of all pixels; `None` when no pixel has two passes.
    pub(crate) fn mean(&self) -> Option<f64> {
        let known = || (0..self.counts.len()).filter_map(|pixel| self.noise(pixel));
        let count = known().count();
        (count > 0).then(|| known().map(|noise| noise.mean).sum::<f64>() / count as f64)
    }

    /// Returns what is known of the pixels of a rectangle.
    pub(crate) fn spot(&self, rect: &PixelRect) -> Spot {
        let rect = rect.intersection(&self.rect);
        let (mut pixels, mut passes) = (0_usize, 0);
        let (mut squared, mut independent) = (0.0, 0.0);
        for [x, y] in places(&rect) {
            let pixel = self.pixel(x, y);
            if let Some(noise) = self.noise(pixel) {
                (pixels, squared) = (pixels + 1, squared + noise.squared);
                independent += noise.independent;
                passes = passes.max(self.counts[pixel]);
            }
        }
        let [squared, independent] = [squared, independent].map(|sum| sum / pixels.max(1) as f64);
        Spot { pixels, squared, independent, passes }
    }

    /// Returns the error over the pixels of a rectangle, relative to the mean value `mean`; `None` when it is not
    /// known.
    pub(crate) fn error(&self, rect: &PixelRect, mean: f64) -> Option<ErrorEstimate> {
        let tiles: Vec<Spot> =
            Self::cut(rect, TILE).iter().map(|tile| self.spot(tile)).filter(|spot| spot.pixels > 0).collect();
        if self.colors.is_empty() || tiles.is_empty() {
            return None;
        }
        let relative = |squared: f64| match squared {
            0.0 => 0.0,
            _ => squared.sqrt() / mean.abs(),
        };
        let [error, bound] = confident_error(&tiles).map(relative);
        // The differences of all passes show where the noise of a tile is, and the halves how much it is.
        let of_tile = |tile: PixelRect| {
            let part = self.spot(&tile).part_of_independent();
            let blocks = Self::cut(&tile, BLOCK).into_iter().map(move |block| (self.spot(&block), block));
            blocks
                .filter(|(spot, _)| spot.pixels > 0)
                .map(move |(spot, block)| (relative(part * spot.independent), block))
        };
        let mut blocks: Vec<(f64, PixelRect)> = Self::cut(rect, TILE).into_iter().flat_map(of_tile).collect();
        blocks.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (worst_block, worst) = *blocks.last()?;
        let blocks_99 = blocks[(blocks.len() * 99 / 100).min(blocks.len() - 1)].0;
        let worst_at = [worst.x0, worst.y0];
        Some(ErrorEstimate { error, bound, blocks_99, worst_block, worst_at, ..ErrorEstimate::default() })
    }
}

/// True for a difference that comes from the rounding of sums.
fn is_rounding(difference: f64, of: f64) -> bool {
    difference.abs() < 1e-6 * of
}
