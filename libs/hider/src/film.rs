//! Filters samples into pixels.
//!
//! A pixel is the weighted mean of the samples in the support of its filter, which includes samples of neighbouring
//! pixels (reference 7.5). The set of these samples, their weights and the order of the sums depend on the absolute
//! pixel alone. Buckets and crops therefore do not change a pixel.

use crate::{SampleGrid, Tables};
use granita_base::Filter;
use granita_dicing::PixelRect;
use granita_machine::widest;

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
    widest!(filter_all(support, &source, pixels))
}

/// Does the work of [`filter`]. Vector instructions do not change the result.
#[inline(always)]
fn filter_all(support: &Support, source: &Source<'_>, pixels: &PixelRect) -> Vec<f32> {
    let channels = source.channels.len();
    let weighted = matches!(support.spec.filter, PixelFilter::Weighted(_));
    let uniform = if weighted { source.uniform_pixels() } else { Vec::new() };
    let mut out = vec![0.0; pixels.width() * pixels.height() * channels];
    let mut at = 0;
    for y in pixels.y0..pixels.y1 {
        for x in pixels.x0..pixels.x1 {
            let pixel = &mut out[at..at + channels];
            if !weighted {
                support.picked(source, [x, y], pixel);
            } else if !support.constant(source, &uniform, [x, y], pixel) {
                support.weighted(source, [x, y], pixel);
            }
            at += channels;
        }
    }
    out
}

/// Returns the first eight numbers, with zeros for those that are missing.
#[inline(always)]
fn eight(numbers: &[f32]) -> [f32; LANES] {
    numbers.first_chunk().copied().unwrap_or_else(|| {
        let mut out = [0.0; LANES];
        out[..numbers.len()].copy_from_slice(numbers);
        out
    })
}

/// The samples and channels that are filtered.
struct Source<'a> {
    samples: &'a SampleGrid,
    /// Channel `c` of sample `s` at `c * samples.len() + s`.
    values: &'a [f32],
    /// The indices of the requested channels.
    channels: &'a [usize],
}

impl Source<'_> {
    /// Returns, for each pixel of the samples, true when all of its samples have the same values.
    #[inline(always)]
    fn uniform_pixels(&self) -> Vec<bool> {
        let Self { samples, values, channels } = *self;
        let total = samples.len();
        let uniform = |pixel: usize| {
            let (first, n) = (pixel * samples.per_pixel, samples.count(pixel));
            channels.iter().all(|channel| {
                let own = &values[channel * total + first..][..n];
                // This loop has no branches. It is false for NaN.
                own.iter().fold(true, |same, v| same & (*v == own[0]))
            })
        };
        (0..samples.pixels()).map(uniform).collect()
    }
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

    /// Calls `each` for the pixels in the support of a pixel, with the index of its first sample, the weight of its
    /// samples relative to those of other pixels, and the weights of its sample positions in x and y.
    #[inline(always)]
    fn around(
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

    /// Stores the values of a pixel whose support has the same values everywhere, as [`Support::weighted`] would
    /// compute them. Returns false when it is not such a pixel.
    #[inline(always)]
    fn constant(&self, source: &Source<'_>, uniform: &[bool], [x, y]: [i32; 2], out: &mut [f32]) -> bool {
        let Source { samples, values, channels } = *source;
        let [mx, my] = self.margin;
        let rows = 0..2 * my + 1;
        let row = |k: i32| {
            let first = samples.pixel(x - mx, y - my + k);
            first..first + self.x.len()
        };
        for k in rows.clone() {
            if uniform[row(k)].contains(&false) {
                return false;
            }
        }
        for (out, channel) in out.iter_mut().zip(channels) {
            let first = |pixel: usize| values[channel * samples.len() + pixel * samples.per_pixel];
            let own = first(samples.pixel(x, y));
            // Sums with a negative zero may be a positive one.
            let usable = own.is_finite() && own.to_bits() != (-0.0_f32).to_bits();
            for k in rows.clone() {
                for pixel in row(k) {
                    if !usable || first(pixel) != own {
                        return false;
                    }
                }
            }
            *out = own;
        }
        true
    }

    /// Computes a weighted mean for each channel. Each sum has [`LANES`] lanes. Sample `s` of a pixel is added to
    /// lane `s % LANES`.
    #[inline(always)]
    fn weighted(&self, source: &Source<'_>, pixel: [i32; 2], out: &mut [f32]) {
        let Source { samples, values, channels } = *source;
        let total = samples.len();
        let own = samples.pixel(pixel[0], pixel[1]) * samples.per_pixel;
        for (out, channels) in out.chunks_mut(TOGETHER).zip(channels.chunks(TOGETHER)) {
            // Deviations from one value are summed instead of the values, so that a constant channel stays exactly
            // constant.
            let mut base = [0.0_f32; TOGETHER];
            for (base, channel) in base.iter_mut().zip(channels) {
                let v = values[channel * total + own];
                *base = if v.is_finite() { v } else { 0.0 };
            }
            let mut weight = [0.0_f32; LANES];
            let mut sum = [[0.0_f32; LANES]; TOGETHER];
            self.around(
                samples,
                pixel,
                #[inline(always)]
                |first, counts, wx, wy| {
                    let n = wx.len();
                    for k in (0..n).step_by(LANES) {
                        let (wx, wy) = (eight(&wx[k..]), eight(&wy[k..]));
                        let mut w = [0.0_f32; LANES];
                        for i in 0..LANES {
                            w[i] = wx[i] * wy[i] * counts;
                        }
                        if w == [0.0; LANES] {
                            continue;
                        }
                        for i in 0..LANES {
                            weight[i] += w[i];
                        }
                        let used = LANES.min(n - k);
                        for ((sum, base), channel) in sum.iter_mut().zip(&base).zip(channels) {
                            let seen = &values[channel * total + first + k..][..used];
                            if let Some(seen) = seen.as_array::<LANES>() {
                                for i in 0..LANES {
                                    sum[i] += w[i] * (seen[i] - base);
                                }
                            } else {
                                for ((sum, w), v) in sum.iter_mut().zip(&w).zip(seen) {
                                    *sum += w * (v - base);
                                }
                            }
                        }
                    }
                },
            );
            let weight: f32 = weight.iter().sum();
            for ((out, sum), base) in out.iter_mut().zip(&sum).zip(&base) {
                let sum: f32 = sum.iter().sum();
                *out = if weight == 0.0 { *base } else { base + sum / weight };
            }
        }
    }

    fn picked(&self, source: &Source<'_>, pixel: [i32; 2], out: &mut [f32]) {
        let Source { samples, values, channels } = *source;
        let total = samples.len();
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
                    support.weighted(&source, place, &mut expected);
                    assert_eq!(
                        [out[0], out[1]].map(f32::to_bits),
                        expected.map(f32::to_bits),
                        "{shape:?} {place:?}"
                    );
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
