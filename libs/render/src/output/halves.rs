//! The two halves of the passes of an image, from which the error of the image without its noise follows.
//!
//! Let a and b be the means of the halves, and f (a) what a library makes of a. The noise of b is independent of f (a).
//! So the mean of `(f (a) - b)^2` is the squared error of f (a), noise and bias together, plus the variance of b. That
//! variance follows from the mean of `(a - b)^2`. No converged image is needed. Two such halves are the dual buffers of
//! Rousselle, Knaus and Zwicker, Adaptive Rendering with Non-Local Means Filtering, 2012.
//!
//! The mean of all passes has less noise than f (a): how much follows from the mean of `(f (a) - f (b))^2`. Its bias is
//! taken for that of a half, although there is less noise to remove.

use crate::passes::{CONFIDENCE, ErrorEstimate, TOLERANCE, percent};

/// The side of the blocks of pixels that the confidence interval is computed from. Neighbours share noise, and blocks
/// hardly any.
const BLOCK: usize = 8;

/// The weighted sum of the second, the fourth and so on of the passes of each pixel, whose random numbers are
/// independent of those of the others.
#[derive(Clone, Debug)]
pub(crate) struct SecondPasses {
    colors: usize,
    layers: usize,
    /// For each pixel: the sums of its colours.
    sums: Vec<f64>,
    /// For each pixel: the sums of the weights of its layers.
    weights: Vec<f64>,
}

/// A colour of a pixel in two halves of its passes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Halves {
    /// The mean of each half. A half without weight has NaN.
    pub(crate) means: [f64; 2],
    /// The part of the squared difference of the means that is the variance of the mean of all passes.
    pub(crate) share: f64,
}

impl SecondPasses {
    pub(crate) fn new(pixels: usize, colors: usize, layers: usize) -> Self {
        Self { colors, layers, sums: vec![0.0; pixels * colors], weights: vec![0.0; pixels * layers] }
    }

    pub(crate) fn clear(&mut self) {
        self.sums.fill(0.0);
        self.weights.fill(0.0);
    }

    /// Adds the colours of a pixel, each with its layer, and the weight of each layer.
    pub(crate) fn add(
        &mut self,
        pixel: usize,
        colors: impl Iterator<Item = (usize, f64)>,
        weight: impl Fn(usize) -> f64,
    ) {
        let sums = &mut self.sums[pixel * self.colors..][..self.colors];
        sums.iter_mut().zip(colors).for_each(|(sum, (layer, value))| *sum += weight(layer) * value);
        let weights = &mut self.weights[pixel * self.layers..][..self.layers];
        weights.iter_mut().enumerate().for_each(|(layer, sum)| *sum += weight(layer));
    }

    /// Returns the halves of a colour of a pixel, whose sum and weight over all passes are given.
    pub(crate) fn halves(&self, pixel: usize, [color, layer]: [usize; 2], [sum, weight]: [f64; 2]) -> Halves {
        let (own, of_own) =
            (self.sums[pixel * self.colors + color], self.weights[pixel * self.layers + layer]);
        let others = weight - of_own;
        Halves { means: [(sum - own) / others, own / of_own], share: of_own * others / (weight * weight) }
    }
}

/// The means of two halves of the passes of an image.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct HalfMeans {
    /// The channels of the image that are here.
    pub(crate) channels: Vec<usize>,
    /// For each half: these channels of all pixels.
    pub(crate) means: [Vec<f32>; 2],
    /// The number of pixels of a row.
    pub(crate) width: usize,
    /// For each pixel: the part of the mean squared difference of both halves that is the variance of the second.
    pub(crate) shares: Vec<f32>,
}

impl HalfMeans {
    /// Returns the values of three channels of all pixels of each half; `None` where an image has no such colour.
    pub(crate) fn colors(&self, first: usize) -> Option<[Vec<f32>; 2]> {
        let at = self.channels.iter().position(|c| *c == first)?;
        let colors = |means: &Vec<f32>| {
            let pixels = means.chunks_exact(self.channels.len());
            pixels.flat_map(|pixel| &pixel[at..at + 3]).copied().collect()
        };
        Some(self.means.each_ref().map(colors))
    }
}

/// The error of an image whose noise was removed, over the mean of the image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DenoisedError {
    /// The root of the mean of the squared errors: the noise that is left, and the bias of removing it.
    pub error: f64,
    /// The upper end of the one-sided confidence interval of `error`, at 95 %.
    pub bound: f64,
}

impl DenoisedError {
    /// True when an image keeps its noise: with it, the image has a requested error, and without it, it does not.
    pub(crate) fn is_worse_than(&self, noisy: Option<ErrorEstimate>, requested: f32) -> bool {
        let most = f64::from(requested) * TOLERANCE;
        self.bound > most && noisy.is_some_and(|noisy| noisy.is_within(requested))
    }

    /// Returns a text for people.
    pub fn text(&self) -> String {
        format!("{}, at most {} at 95 % confidence", percent(self.error), percent(self.bound))
    }
}

/// What the error of a denoised image follows from.
#[derive(Clone, Debug, Default)]
pub(crate) struct DenoisedSum {
    pixels: f64,
    mean: f64,
    /// For each block, row by row: the number of its pixels, and the sum of their squared errors.
    blocks: Vec<[f64; 2]>,
}

impl DenoisedSum {
    /// Adds a colour of all pixels. `noisy` are its values in both halves, `clean` the same without noise.
    pub(crate) fn add(&mut self, halves: &HalfMeans, noisy: &[Vec<f32>; 2], clean: &[Vec<f32>; 2]) {
        let each = |values: &[f32], k: usize| -> [f64; 3] { [0, 1, 2].map(|c| f64::from(values[3 * k + c])) };
        let width = halves.width.max(1);
        let across = width.div_ceil(BLOCK);
        self.blocks.resize(across * (halves.shares.len() / width).div_ceil(BLOCK), [0.0; 2]);
        for (k, share) in halves.shares.iter().enumerate() {
            let [a, b] = noisy.each_ref().map(|values| each(values, k));
            let [of_a, of_b] = clean.each_ref().map(|values| each(values, k));
            let (mut squared, mut mean) = (0.0, 0.0);
            for c in 0..3 {
                let variance = f64::from(*share) * (a[c] - b[c]).powi(2);
                let gained = (1.0 - f64::from(*share)).powi(2) * (of_a[c] - of_b[c]).powi(2);
                squared += (of_a[c] - b[c]).powi(2) - variance - gained;
                mean += 0.5 * (a[c] + b[c]);
            }
            if squared.is_finite() && mean.is_finite() {
                self.pixels += 1.0;
                self.mean += mean / 3.0;
                let [pixels, sum] = &mut self.blocks[k / width / BLOCK * across + k % width / BLOCK];
                (*pixels, *sum) = (*pixels + 1.0, *sum + squared / 3.0);
            }
        }
    }

    /// Returns the error; `None` where nothing is known.
    pub(crate) fn error(&self) -> Option<DenoisedError> {
        let Self { pixels, mean, blocks } = self;
        if *pixels == 0.0 || *mean == 0.0 {
            return None;
        }
        let value = blocks.iter().map(|[_, sum]| sum).sum::<f64>() / pixels;
        let of_blocks: Vec<f64> =
            blocks.iter().filter(|[n, _]| *n > 0.0).map(|[n, sum]| sum - value * n).collect();
        let count = of_blocks.len() as f64;
        // One block does not show its noise.
        let deviation = match count > 1.0 {
            true => {
                let squares: f64 = of_blocks.iter().map(|of_block| of_block * of_block).sum();
                (squares * count / (count - 1.0)).sqrt() / pixels
            }
            false => value.abs(),
        };
        let relative = |squared: f64| squared.max(0.0).sqrt() / (mean / pixels).abs();
        Some(DenoisedError { error: relative(value), bound: relative(value + CONFIDENCE * deviation) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::hash;

    #[test]
    fn the_error_needs_no_converged_image() {
        const PIXELS: usize = 40_000;
        let mut count = 0;
        // Noise from -0.3 to 0.3, whose variance is 0.03.
        let mut noise = || {
            count += 1;
            0.6 * hash::words(&[7, count]) as f32 / u32::MAX as f32 - 0.3
        };
        for (passes, left, bias) in [([1, 1], 0.5_f32, 0.0_f32), ([1, 1], 0.0, 0.05), ([3, 2], 0.5, 0.1)] {
            let mut half = |n: u8| -> Vec<f32> {
                let mut mean = || (0..n).map(|_| noise()).sum::<f32>() / f32::from(n);
                (0..3 * PIXELS).map(|_| 1.0 + mean()).collect()
            };
            let noisy = [half(passes[0]), half(passes[1])];
            // The library leaves a part of the noise, and adds bias.
            let clean = noisy.each_ref().map(|values: &Vec<f32>| {
                values.iter().map(|v| 1.0 + bias + left * (v - 1.0)).collect::<Vec<f32>>()
            });
            let [n0, n1] = passes.map(f32::from);
            let halves = HalfMeans {
                channels: vec![0, 1, 2],
                means: noisy.clone(),
                width: 200,
                shares: vec![n0 / (n0 + n1); PIXELS],
            };
            let mut sum = DenoisedSum::default();
            sum.add(&halves, &halves.colors(0).unwrap(), &clean);
            let found = sum.error().unwrap();
            let noise_left = 0.03 * f64::from(left * left / (n0 + n1));
            let expected = (f64::from(bias).powi(2) + noise_left).sqrt();
            assert!((found.error - expected).abs() < 0.1 * expected, "{found:?} {expected}");
            let width = found.bound - found.error;
            assert!(width > 0.0 && width < 0.1 * expected, "{found:?} {expected}");
            assert!(expected < found.error + 2.0 * width, "{found:?} {expected}");
        }
    }

    #[test]
    fn pixels_without_passes_do_not_count() {
        let halves = HalfMeans {
            channels: vec![4, 5, 6],
            means: [vec![f32::NAN, 1.0, 1.0, 2.0, 2.0, 2.0], vec![2.0; 6]],
            width: 2,
            shares: vec![0.5; 2],
        };
        assert!(halves.colors(0).is_none());
        let colors = halves.colors(4).unwrap();
        let mut sum = DenoisedSum::default();
        assert_eq!(sum.error(), None);
        sum.add(&halves, &colors, &colors);
        assert_eq!(sum.error(), Some(DenoisedError::default()));
        assert_eq!(
            DenoisedError { error: 0.012, bound: 0.5 }.text(),
            "1.20 %, at most 50.0 % at 95 % confidence"
        );
    }
}
