//! Filters samples into pixels.
//!
//! A pixel is the weighted mean of the samples in the support of its filter, which includes samples of neighbouring
//! pixels (reference 7.5). The set of these samples, their weights and the order of the sums depend on the absolute
//! pixel alone. Buckets and crops therefore do not change a pixel.

use crate::{SampleGrid, Tables};
use granita_base::Filter;
use granita_dicing::PixelRect;
use granita_machine::simd::{Kernel, Simd, dispatch};

/// The way in which the values of samples are combined into a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PixelFilter {
    /// A weighted mean.
    Weighted(Filter),
    /// The least value, for depths.
    Min,
    /// The greatest value of the samples that see a surface, for depths.
    Max,
    /// The mean value of the samples that see a surface, for depths.
    Average,
    /// The value of the sample that is nearest to the centre of the pixel, for values that have no mean, such as
    /// positions and numbers of objects.
    Closest,
}

/// The depth of a sample that sees no surface (reference 10.1).
pub const NO_DEPTH: f32 = 1.0e30;

/// A filter with the size of its support in raster pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilterSpec {
    /// The shape.
    pub filter: PixelFilter,
    /// The full widths in x and y, in raster pixels.
    pub width: [f32; 2],
}

impl FilterSpec {
    /// The number of pixels beyond its own, in x and y, whose samples a pixel needs.
    pub fn margin(&self) -> [i32; 2] {
        self.width.map(|w| ((w * 0.5 - 0.5).ceil() as i32).max(0))
    }
}

/// The number of lanes of each sum. The lanes are added in parallel and in a fixed order.
const LANES: usize = 8;

/// The number of channels that are summed in one pass over the samples.
const TOGETHER: usize = 4;

/// Filters some channels of samples into the pixels of `pixels`.
///
/// `values` holds channel `c` of sample `s` at `c * samples.len() + s`. `samples` must reach [`FilterSpec::margin`]
/// pixels beyond `pixels`. The result holds the channels of each pixel together, row by row.
pub fn filter(
    support: &Support,
    samples: &SampleGrid,
    values: &[f32],
    channels: &[usize],
    pixels: &PixelRect,
) -> Vec<f32> {
    let source = Source { samples, values, channels };
    dispatch(Filtering { support, source, pixels })
}

/// Returns for each pixel, row by row, the sum of the weights with which [`filter`] sums the samples that a pixel
/// needs: the weight of the pixel among those of other passes over the same pixels. It is 1 for filters without
/// weights.
pub fn weights(support: &Support, samples: &SampleGrid, pixels: &PixelRect) -> Vec<f32> {
    let places = (pixels.y0..pixels.y1).flat_map(|y| (pixels.x0..pixels.x1).map(move |x| [x, y]));
    let PixelFilter::Weighted(_) = support.spec.filter else { return places.map(|_| 1.0).collect() };
    let of_pixel = |pixel| {
        let mut sum = [0.0_f32; LANES];
        support.around(samples, pixel, |_, counts, wx, wy| {
            for (wx, wy) in wx.chunks(LANES).zip(wy.chunks(LANES)) {
                for ((sum, wx), wy) in sum.iter_mut().zip(wx).zip(wy) {
                    *sum += wx * wy * counts;
                }
            }
        });
        sum.iter().sum()
    };
    places.map(of_pixel).collect()
}

/// The work of [`filter`].
struct Filtering<'a> {
    support: &'a Support,
    source: Source<'a>,
    pixels: &'a PixelRect,
}

impl Kernel for Filtering<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Vec<f32> {
        filter_all(simd, self.support, &self.source, self.pixels)
    }
}

/// Does the work of [`filter`]. Vector instructions do not change the result.
#[inline(always)]
fn filter_all(simd: impl Simd, support: &Support, source: &Source<'_>, pixels: &PixelRect) -> Vec<f32> {
    let channels = source.channels.len();
    let mut out = vec![0.0; pixels.width() * pixels.height() * channels];
    let PixelFilter::Weighted(_) = support.spec.filter else {
        let places = (pixels.y0..pixels.y1).flat_map(|y| (pixels.x0..pixels.x1).map(move |x| [x, y]));
        for (pixel, out) in places.zip(out.chunks_exact_mut(channels.max(1))) {
            support.picked(source, pixel, out);
        }
        return out;
    };
    for first in (0..channels).step_by(TOGETHER) {
        let last = channels.min(first + TOGETHER);
        let some = Source { channels: &source.channels[first..last], ..*source };
        let flat = flat_pixels(&some);
        let mut at = 0;
        for y in pixels.y0..pixels.y1 {
            for x in pixels.x0..pixels.x1 {
                support.weighted(simd, &some, &flat, [x, y], &mut out[at + first..at + last]);
                at += channels;
            }
        }
    }
    out
}

/// Returns the value of each pixel whose samples all have the same finite value in a channel, and NaN for other pixels.
/// Channel `c` of pixel `p` is at `c * pixels + p`.
#[inline(always)]
fn flat_pixels(source: &Source<'_>) -> Vec<f32> {
    let Source { samples, values, channels } = *source;
    let (total, most) = (samples.len(), samples.per_pixel);
    let mut flat = Vec::with_capacity(channels.len() * (total / most));
    for channel in channels {
        let plane = &values[channel * total..][..total];
        for (pixel, values) in plane.chunks_exact(most).enumerate() {
            let first = values[0];
            let differs = values[..samples.count(pixel)]
                .iter()
                .fold(0, |differs, value| differs | (value.to_bits() ^ first.to_bits()));
            flat.push(if differs == 0 && first.is_finite() { first } else { f32::NAN });
        }
    }
    flat
}

/// Returns the first eight numbers, with another one for those that are missing.
#[inline(always)]
fn eight(numbers: &[f32], missing: f32) -> [f32; LANES] {
    numbers.first_chunk().copied().unwrap_or_else(|| {
        let mut out = [missing; LANES];
        out[..numbers.len()].copy_from_slice(numbers);
        out
    })
}

/// The samples and channels that are filtered.
#[derive(Clone, Copy)]
struct Source<'a> {
    samples: &'a SampleGrid,
    /// Channel `c` of sample `s` at `c * samples.len() + s`.
    values: &'a [f32],
    /// The indices of the requested channels.
    channels: &'a [usize],
}

/// The weights of every sample position in the patterns, for the pixels around its own.
pub struct Support {
    spec: FilterSpec,
    margin: [i32; 2],
    /// `x[k][i]` is the weight of position `i` for the pixel `k - margin` columns to the right of its own.
    x: Vec<Vec<f32>>,
    y: Vec<Vec<f32>>,
}

impl Support {
    /// Computes the weights of a filter.
    pub fn new(spec: &FilterSpec, tables: &Tables) -> Self {
        let margin = spec.margin();
        let shape = match spec.filter {
            PixelFilter::Weighted(f) => f,
            // The nearest sample has the greatest weight.
            PixelFilter::Closest => Filter::Gaussian,
            _ => Filter::Box,
        };
        let weights = |places: &[f32], margin: i32, width: f32| {
            (-margin..=margin)
                .map(|k| places.iter().map(|f| shape.weight(f - 0.5 - k as f32, width)).collect())
                .collect()
        };
        Self {
            spec: *spec,
            margin,
            x: weights(&tables.fx, margin[0], spec.width[0]),
            y: weights(&tables.fy, margin[1], spec.width[1]),
        }
    }

    /// The way in which samples are combined.
    pub fn filter(&self) -> PixelFilter {
        self.spec.filter
    }

    /// Calls `each` for the pixels in the support of a pixel, with the index of its first sample, the weight of its
    /// samples relative to those of other pixels, and the weights of its sample positions in x and y.
    #[inline(always)]
    pub(crate) fn around(
        &self,
        samples: &SampleGrid,
        [x, y]: [i32; 2],
        mut each: impl FnMut(usize, f32, &[f32], &[f32]),
    ) {
        let [mx, my] = self.margin;
        for dy in -my..=my {
            // Relative to the other pixel, this pixel lies in the opposite direction.
            let wy = &self.y[(my - dy) as usize];
            let row = samples.pixel(x - mx, y + dy);
            for (pixel, wx) in (row..).zip(self.x.iter().rev()) {
                let (n, places) = (samples.count(pixel), samples.places(pixel));
                // All pixels have the same total weight, however many samples they have.
                let counts = samples.per_pixel as f32 / n as f32;
                each(pixel * samples.per_pixel, counts, &wx[places..][..n], &wy[places..][..n]);
            }
        }
    }

    /// Computes a weighted mean for each channel. Where all samples that a pixel needs have one value, it is that
    /// value.
    #[inline(always)]
    fn weighted(&self, simd: impl Simd, source: &Source<'_>, flat: &[f32], pixel: [i32; 2], out: &mut [f32]) {
        let mut left: [usize; TOGETHER] = [0; TOGETHER];
        let mut count = 0;
        for (k, out) in out.iter_mut().enumerate() {
            match self.flat_value(source, flat, k, pixel) {
                // The sum of deviations from the value is zero.
                Some(value) => *out = value + 0.0,
                None => (left[count], count) = (k, count + 1),
            }
        }
        match count {
            0 => {}
            1 => self.means(simd, source, [left[0]], pixel, out),
            2 => self.means(simd, source, [left[0], left[1]], pixel, out),
            3 => self.means(simd, source, [left[0], left[1], left[2]], pixel, out),
            _ => self.means(simd, source, left, pixel, out),
        }
    }

    /// Returns the one value that all samples in the support of a pixel have in a channel; `None` when they differ.
    #[inline(always)]
    fn flat_value(&self, source: &Source<'_>, flat: &[f32], channel: usize, [x, y]: [i32; 2]) -> Option<f32> {
        let pixels = source.samples.len() / source.samples.per_pixel;
        let flat = &flat[channel * pixels..][..pixels];
        let value = flat[source.samples.pixel(x, y)];
        let [mx, my] = self.margin;
        let is_same = |dy: i32| {
            let row = &flat[source.samples.pixel(x - mx, y + dy)..][..self.x.len()];
            row.iter().all(|other| other.to_bits() == value.to_bits())
        };
        // An inclusive range takes several times as long.
        (!value.is_nan() && (-my..my + 1).all(is_same)).then_some(value)
    }

    /// Computes the weighted means of some of the channels. Each sum has [`LANES`] lanes. Sample `s` of a pixel is
    /// added to lane `s % LANES`.
    #[inline(always)]
    fn means<S: Simd, const N: usize>(
        &self,
        simd: S,
        source: &Source<'_>,
        channels: [usize; N],
        pixel: [i32; 2],
        out: &mut [f32],
    ) {
        let Source { samples, values, channels: of_image } = *source;
        let total = samples.len();
        let own = samples.pixel(pixel[0], pixel[1]) * samples.per_pixel;
        let planes = channels.map(|k| &values[of_image[k] * total..][..total]);
        // Deviations from one value are summed instead of the values, so that a constant channel stays exactly
        // constant.
        let base = planes.map(|plane| if plane[own].is_finite() { plane[own] } else { 0.0 });
        let deviation_from = base.map(|base| simd.splat8(base));
        let zero = simd.splat8(0.0);
        let (mut weight, mut sum) = (zero, [zero; N]);
        self.around(
            samples,
            pixel,
            #[inline(always)]
            |first, counts, wx, wy| {
                let n = wx.len();
                let counts = simd.splat8(counts);
                for k in (0..n).step_by(LANES) {
                    let (wx, wy) = (eight(&wx[k..], 0.0), eight(&wy[k..], 0.0));
                    let w = simd.mul8(simd.mul8(simd.load8(&wx), simd.load8(&wy)), counts);
                    if simd.lt8(w, zero) | simd.lt8(zero, w) == 0 {
                        continue;
                    }
                    weight = simd.add8(weight, w);
                    let last = n.min(k + LANES);
                    for c in 0..N {
                        let seen = simd.load8(&eight(&planes[c][first + k..first + last], base[c]));
                        let deviation = simd.sub8(seen, deviation_from[c]);
                        sum[c] = simd.add8(sum[c], simd.mul8(w, deviation));
                    }
                }
            },
        );
        let total_of = |lanes: S::F8| simd.store8(lanes).iter().sum::<f32>();
        let weight = total_of(weight);
        for c in 0..N {
            let mean = base[c] + total_of(sum[c]) / weight;
            out[channels[c]] = if weight == 0.0 { base[c] } else { mean };
        }
    }

    /// Returns the index of the sample that is nearest to the centre of a pixel, the first of several.
    pub(crate) fn closest(&self, samples: &SampleGrid, pixel: [i32; 2]) -> usize {
        let (mut nearest, mut greatest) = (0, f32::NEG_INFINITY);
        self.around(samples, pixel, |first, _, wx, wy| {
            for (s, (a, b)) in wx.iter().zip(wy).enumerate() {
                if a * b > greatest {
                    (nearest, greatest) = (first + s, a * b);
                }
            }
        });
        nearest
    }

    fn picked(&self, source: &Source<'_>, pixel: [i32; 2], out: &mut [f32]) {
        let Source { samples, values, channels } = *source;
        let total = samples.len();
        if self.spec.filter == PixelFilter::Closest {
            let sample = self.closest(samples, pixel);
            for (out, channel) in out.iter_mut().zip(channels) {
                let value = values[channel * total + sample];
                *out = if value.is_finite() { value } else { NO_DEPTH };
            }
            return;
        }
        for (out, channel) in out.iter_mut().zip(channels) {
            let plane = &values[channel * total..(channel + 1) * total];
            let (mut least, mut greatest, mut sum, mut count) =
                (f32::INFINITY, f32::NEG_INFINITY, 0.0_f64, 0);
            self.around(samples, pixel, |first, _, wx, wy| {
                for (s, (a, b)) in wx.iter().zip(wy).enumerate() {
                    let v = plane[first + s];
                    if a * b > 0.0 && v.is_finite() {
                        least = least.min(v);
                        greatest = greatest.max(v);
                        sum += f64::from(v);
                        count += 1;
                    }
                }
            });
            *out = match self.spec.filter {
                _ if count == 0 => NO_DEPTH,
                PixelFilter::Min => least,
                PixelFilter::Max => greatest,
                _ => (sum / f64::from(count)) as f32,
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SamplePattern;
    use granita_base::{Params, Reporter};
    use granita_machine::simd::Portable;

    fn samples(rect: PixelRect) -> SampleGrid {
        let camera = granita_scene::Camera {
            name: "main".into(),
            world_to_camera: Default::default(),
            params: Params::new(),
        };
        let camera = granita_dicing::CameraView::new(&camera, &Reporter::silent());
        SampleGrid::new(rect, &SamplePattern::new(&camera, false), &camera, &[])
    }

    fn filter(
        spec: &FilterSpec,
        samples: &SampleGrid,
        values: &[f32],
        channels: &[usize],
        pixels: &PixelRect,
    ) -> Vec<f32> {
        super::filter(&Support::new(spec, &samples.tables), samples, values, channels, pixels)
    }

    const PIXELS: PixelRect = PixelRect { x0: 10, y0: 20, x1: 14, y1: 23 };

    #[test]
    fn a_filtered_constant_is_exactly_constant() {
        for shape in Filter::ALL {
            for width in [1.0, 1.5, 2.0, 3.0, 4.0] {
                let spec = FilterSpec { filter: PixelFilter::Weighted(shape), width: [width, width] };
                let samples = samples(PIXELS.grown(2));
                let values = vec![0.3_f32; samples.len()];
                let out = filter(&spec, &samples, &values, &[0], &PIXELS);
                assert!(out.iter().all(|v| *v == 0.3), "{shape:?} {width}");
            }
        }
    }

    #[test]
    fn pixels_of_one_value_have_the_mean_of_their_samples() {
        let spec = FilterSpec { filter: PixelFilter::Weighted(Filter::Mitchell), width: [2.0, 3.0] };
        let samples = samples(PIXELS.grown(1));
        let support = Support::new(&spec, &samples.tables);
        let n = samples.len();
        // Both channels vary to the right of a column, the second one less often.
        let value = |k: usize, c: usize| match samples.x[k] {
            x if x > 12.0 && k.is_multiple_of(1 + 400 * c) => (k as f32).sin(),
            _ => [-0.0, 0.7][c],
        };
        let values: Vec<f32> = (0..2 * n).map(|k| value(k % n, k / n)).collect();
        let source = Source { samples: &samples, values: &values, channels: &[0, 1] };
        let found = super::filter(&support, &samples, &values, &[0, 1], &PIXELS);
        let mut ways = [0; 2];
        let flat = flat_pixels(&source);
        for (k, pixel) in found.chunks(2).enumerate() {
            let place = [PIXELS.x0 + k as i32 % 4, PIXELS.y0 + k as i32 / 4];
            let mut means = [0.0; 2];
            support.means(Portable, &source, [0, 1], place, &mut means);
            assert_eq!(means.map(f32::to_bits), [pixel[0], pixel[1]].map(f32::to_bits), "{place:?}");
            (0..2)
                .for_each(|c| ways[c] += usize::from(support.flat_value(&source, &flat, c, place).is_some()));
        }
        assert!(ways[0] > 0 && ways[0] < ways[1], "{ways:?}");
    }

    #[test]
    fn the_closest_sample_is_the_pixel() {
        let samples = samples(PIXELS.grown(0));
        let n = samples.len();
        let values: Vec<f32> = (0..n).map(|s| if s == 0 { f32::INFINITY } else { s as f32 }).collect();
        let spec = FilterSpec { filter: PixelFilter::Closest, width: [1.0; 2] };
        let found = filter(&spec, &samples, &values, &[0], &PIXELS);
        for (k, value) in found.iter().enumerate() {
            let centre = [PIXELS.x0 + k as i32 % 4, PIXELS.y0 + k as i32 / 4].map(|v| v as f32 + 0.5);
            let distance = |s: usize| (samples.x[s] - centre[0]).powi(2) + (samples.y[s] - centre[1]).powi(2);
            let nearest = (0..n).map(distance).fold(f32::INFINITY, f32::min);
            let sample = if *value == NO_DEPTH { 0 } else { *value as usize };
            assert!(distance(sample) < nearest + 1.0e-4, "pixel {k}: sample {sample}");
        }
    }

    #[test]
    fn constant_regions_are_filtered_as_others() {
        let (rect, samples) = (PIXELS.grown(2), samples(PIXELS.grown(2)));
        let last = samples.len();
        // The values of the left part of the image and of a pixel and a single sample in the right part.
        for [left, pixel, sample] in [
            [0.0, 0.0, 0.0],
            [0.3, 0.3, 0.3],
            [-0.0, 0.0, 1.0],
            [1.0, f32::INFINITY, 0.5],
            [f32::NAN, 0.2, 0.1],
        ] {
            let mut values = vec![left; 2 * last];
            let (width, n) = (rect.width(), samples.per_pixel);
            for (s, value) in values.iter_mut().enumerate() {
                if (s % last) / n % width > width / 2 {
                    *value = 0.25;
                }
            }
            let one = samples.pixel(PIXELS.x1 - 1, PIXELS.y0) * n;
            values[one..one + n].fill(pixel);
            values[last + samples.pixel(PIXELS.x1 - 1, PIXELS.y1 - 1) * n + n - 1] = sample;
            for shape in Filter::ALL {
                let spec = FilterSpec { filter: PixelFilter::Weighted(shape), width: [3.0, 2.0] };
                let support = Support::new(&spec, &samples.tables);
                let source = Source { samples: &samples, values: &values, channels: &[1, 0] };
                let out = filter(&spec, &samples, &values, source.channels, &PIXELS);
                let pixels = (PIXELS.y0..PIXELS.y1).flat_map(|y| (PIXELS.x0..PIXELS.x1).map(move |x| [x, y]));
                for (place, out) in pixels.zip(out.chunks_exact(2)) {
                    let mut expected = [0.0; 2];
                    support.means(Portable, &source, [0, 1], place, &mut expected);
                    // A NaN may have any sign.
                    let bits = |x: f32| if x.is_nan() { f32::NAN.to_bits() } else { x.to_bits() };
                    assert_eq!([out[0], out[1]].map(bits), expected.map(bits), "{shape:?} {place:?}");
                }
            }
        }
    }

    #[test]
    fn a_filtered_ramp_is_a_ramp_within_noise() {
        let samples = samples(PIXELS.grown(1));
        let spec = FilterSpec { filter: PixelFilter::Weighted(Filter::Gaussian), width: [2.0, 2.0] };
        let values = samples.x.clone();
        let out = filter(&spec, &samples, &values, &[0], &PIXELS);
        for (i, v) in out.iter().enumerate() {
            let x = PIXELS.x0 as f32 + (i % 4) as f32 + 0.5;
            assert!((v - x).abs() < 0.05, "{v} at {x}");
        }
    }

    #[test]
    fn depth_filters_take_the_minimum_maximum_or_average() {
        let samples = samples(PIXELS);
        let mut values = vec![f32::INFINITY; samples.len()];
        let n = samples.per_pixel;
        (values[0], values[1]) = (2.0, 4.0);
        for (kind, expected) in
            [(PixelFilter::Min, 2.0), (PixelFilter::Max, 4.0), (PixelFilter::Average, 3.0)]
        {
            let spec = FilterSpec { filter: kind, width: [1.0, 1.0] };
            let out = filter(&spec, &samples, &values, &[0], &PIXELS);
            assert_eq!((out[0], out[1]), (expected, NO_DEPTH), "{kind:?} of {n} samples");
        }
    }

    #[test]
    fn filter_margins_are_whole_pixels() {
        let margin = |w: f32| FilterSpec { filter: PixelFilter::Min, width: [w, 1.0] }.margin();
        assert_eq!([1.0, 1.5, 2.0, 3.0, 3.1, 4.0].map(|w| margin(w)[0]), [0, 1, 1, 1, 2, 2]);
    }
}
