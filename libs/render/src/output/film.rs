//! From samples to pixels.
//!
//! A pixel is the weighted mean of the samples in the support of its filter, also those of neighbouring
//! pixels (reference 7.5). Which samples these are, their weights and the order of the sums depend on the
//! absolute pixel alone, so that buckets and crops cannot change them.

use crate::PixelRect;
use crate::hider::{SampleGrid, Tables};
use granita_base::Filter;

/// How samples become a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum PixelFilter {
    /// A weighted mean.
    Weighted(Filter),
    /// The least value: depths.
    Min,
    /// The greatest value of samples that see something: depths.
    Max,
    /// The mean of the samples that see something: depths.
    Average,
}

/// Depth where nothing is seen (reference 10.1).
pub(crate) const NO_DEPTH: f32 = 1.0e30;

/// A filter with its support in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FilterSpec {
    /// The shape.
    pub(crate) filter: PixelFilter,
    /// Full widths in x and y, in pixels.
    pub(crate) width: [f32; 2],
}

impl FilterSpec {
    /// Pixels beyond its own whose samples a pixel needs, in x and y.
    pub(crate) fn margin(&self) -> [i32; 2] {
        self.width.map(|w| ((w * 0.5 - 0.5).ceil() as i32).max(0))
    }
}

/// Sums are kept in this many lanes, so that they can run side by side in a fixed order.
const LANES: usize = 8;

/// Channels that are summed in one pass over the samples.
const TOGETHER: usize = 4;

/// Filters some channels of samples into the pixels of `pixels`.
///
/// `values` holds channel `c` of sample `s` at `c * samples.len() + s`; `samples` must reach
/// [`FilterSpec::margin`] beyond `pixels`. The result has the channels of a pixel side by side, row by row.
pub(crate) fn filter(
    support: &Support,
    samples: &SampleGrid,
    values: &[f32],
    channels: &[usize],
    pixels: &PixelRect,
) -> Vec<f32> {
    // With the widest vector instructions that the machine has: they change no result.
    let source = Source { samples, values, channels };
    pulp::Arch::new().dispatch(FilterAll { support, source, pixels })
}

/// The work of [`filter`].
struct FilterAll<'a> {
    support: &'a Support,
    source: Source<'a>,
    pixels: &'a PixelRect,
}

impl pulp::WithSimd for FilterAll<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn with_simd<M: pulp::Simd>(self, _: M) -> Vec<f32> {
        let Self { support, source, pixels } = self;
        let channels = source.channels.len();
        let mut out = vec![0.0; pixels.width() * pixels.height() * channels];
        let mut at = 0;
        for y in pixels.y0..pixels.y1 {
            for x in pixels.x0..pixels.x1 {
                let pixel = &mut out[at..at + channels];
                match support.spec.filter {
                    PixelFilter::Weighted(_) => support.weighted(&source, [x, y], pixel),
                    _ => support.picked(&source, [x, y], pixel),
                }
                at += channels;
            }
        }
        out
    }
}

/// The first eight numbers; zeros where there are not as many.
#[inline(always)]
fn eight(numbers: &[f32]) -> [f32; LANES] {
    numbers.first_chunk().copied().unwrap_or_else(|| {
        let mut out = [0.0; LANES];
        out[..numbers.len()].copy_from_slice(numbers);
        out
    })
}

/// What is filtered.
struct Source<'a> {
    samples: &'a SampleGrid,
    /// Channel `c` of sample `s` at `c * samples.len() + s`.
    values: &'a [f32],
    /// The channels wanted.
    channels: &'a [usize],
}

/// Weights of every place in the patterns of samples for the pixels around its own.
pub(crate) struct Support {
    spec: FilterSpec,
    margin: [i32; 2],
    /// `x[k][i]`: weight of place `i` for the pixel `k - margin` columns to the right of its own.
    x: Vec<Vec<f32>>,
    y: Vec<Vec<f32>>,
}

impl Support {
    /// Of a filter.
    pub(crate) fn new(spec: &FilterSpec, tables: &Tables) -> Self {
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

    /// The pixels in the support of one: the index of the first sample of each, what a sample of it counts beside others,
    /// and the weights of its samples in x and y.
    #[inline(always)]
    fn around<'s>(
        &'s self,
        samples: &'s SampleGrid,
        [x, y]: [i32; 2],
    ) -> impl Iterator<Item = (usize, f32, &'s [f32], &'s [f32])> {
        let [mx, my] = self.margin;
        (-my..=my).flat_map(move |dy| (-mx..=mx).map(move |dx| (dx, dy))).map(move |(dx, dy)| {
            let pixel = samples.pixel(x + dx, y + dy);
            let (n, places) = (samples.count(pixel), samples.places(pixel));
            // Seen from there, this pixel lies the other way.
            let wx = &self.x[(mx - dx) as usize][places..places + n];
            let wy = &self.y[(my - dy) as usize][places..places + n];
            // All pixels count the same, however many samples they have.
            let counts = samples.per_pixel as f32 / n as f32;
            (pixel * samples.per_pixel, counts, wx, wy)
        })
    }

    /// A weighted mean per channel. Sums are kept in [`LANES`] lanes: sample `s` of a pixel goes to lane `s % LANES`.
    #[inline(always)]
    fn weighted(&self, source: &Source<'_>, pixel: [i32; 2], out: &mut [f32]) {
        let Source { samples, values, channels } = *source;
        let total = samples.len();
        let own = samples.pixel(pixel[0], pixel[1]) * samples.per_pixel;
        for (out, channels) in out.chunks_mut(TOGETHER).zip(channels.chunks(TOGETHER)) {
            // Deviations from one value instead of the values: what is constant stays exactly so.
            let mut base = [0.0_f32; TOGETHER];
            for (base, channel) in base.iter_mut().zip(channels) {
                let v = values[channel * total + own];
                *base = if v.is_finite() { v } else { 0.0 };
            }
            let mut weight = [0.0_f32; LANES];
            let mut sum = [[0.0_f32; LANES]; TOGETHER];
            for (first, counts, wx, wy) in self.around(samples, pixel) {
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
            }
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
            for (first, _, wx, wy) in self.around(samples, pixel) {
                for (s, (a, b)) in wx.iter().zip(wy).enumerate() {
                    let v = plane[first + s];
                    if a * b > 0.0 && v.is_finite() {
                        least = least.min(v);
                        greatest = greatest.max(v);
                        sum += f64::from(v);
                        count += 1;
                    }
                }
            }
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
    use crate::hider::SamplePattern;
    use granita_base::{Params, Reporter};

    fn samples(rect: PixelRect) -> SampleGrid {
        let camera = granita_scene::Camera {
            name: "main".into(),
            world_to_camera: Default::default(),
            params: Params::new(),
        };
        let camera = crate::CameraView::new(&camera, &Reporter::silent());
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
    fn a_constant_stays_exactly_constant() {
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
    fn a_ramp_stays_a_ramp_within_noise() {
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
    fn depth_filters() {
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
    fn margins() {
        let margin = |w: f32| FilterSpec { filter: PixelFilter::Min, width: [w, 1.0] }.margin();
        assert_eq!([1.0, 1.5, 2.0, 3.0, 3.1, 4.0].map(|w| margin(w)[0]), [0, 1, 1, 1, 2, 2]);
    }
}
