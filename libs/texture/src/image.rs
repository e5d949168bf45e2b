//! Images in floats, with resizing, halving and MIP pyramids. Texture making and automipmap use them.

use crate::Wrap;
use granita_base::Filter;
use granita_image::{ImageInput, Pixels, Result};
use rayon::prelude::*;

/// An image of floats, with rows from the top and channels interleaved.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Image {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) channels: usize,
    pub(crate) data: Vec<f32>,
}

/// Returns the number of MIP levels down to 1 x 1.
pub(crate) fn level_count(width: usize, height: usize) -> usize {
    (width.max(height).max(1)).ilog2() as usize + 1
}

/// Returns the size of the next level in one direction, which is half, rounded down, and at least 1 (reference 9.2.1).
pub(crate) fn half(n: usize) -> usize {
    (n / 2).max(1)
}

/// The source texels and weights of one destination texel.
pub(crate) struct Taps {
    /// The indices and normalised weights, the heaviest first.
    taps: Vec<(usize, f32)>,
}

/// Returns the source texels and weights among `from` texels for each of `to` texels.
pub(crate) fn taps(from: usize, to: usize, filter: Filter, wrap: Wrap) -> Vec<Taps> {
    let scale = from as f64 / to as f64;
    (0..to)
        .map(|o| {
            let mut list: Vec<(i64, f64)> = Vec::new();
            if filter == Filter::Box {
                // The box is integrated exactly over the texels that it covers, so that sizes that do not divide
                // keep the mean.
                let (begin, end) = (o as f64 * scale, (o + 1) as f64 * scale);
                for i in begin.floor() as i64..end.ceil() as i64 {
                    let covered = end.min((i + 1) as f64) - begin.max(i as f64);
                    if covered > 1e-9 {
                        list.push((i, covered));
                    }
                }
            } else {
                let stretch = scale.max(1.0);
                let width = filter.natural_width();
                let centre = (o as f64 + 0.5) * scale;
                let reach = f64::from(width) * 0.5 * stretch;
                for i in (centre - reach - 0.5).floor() as i64..=(centre + reach - 0.5).ceil() as i64 {
                    let x = (i as f64 + 0.5 - centre) / stretch;
                    let w = f64::from(filter.weight(x as f32, width));
                    if w != 0.0 {
                        list.push((i, w));
                    }
                }
            }
            let n = from as i32;
            let inside: Vec<(usize, f64)> =
                list.iter().filter_map(|&(i, w)| wrap.index(i as i32, n).map(|i| (i as usize, w))).collect();
            let total: f64 = inside.iter().map(|t| t.1).sum();
            let mut taps: Vec<(usize, f32)> = inside.iter().map(|&(i, w)| (i, (w / total) as f32)).collect();
            if taps.is_empty() || !total.is_normal() {
                taps = vec![(((centre_of(o, scale)) as usize).min(from - 1), 1.0)];
            }
            Taps::sorted(taps)
        })
        .collect()
}

/// Returns the same for the rows of a latitude-longitude map of all directions, with a box in which rows are weighted
/// by their part of the sphere. Row `i` of `n` lies between the polar angles `pi i / n` and `pi (i + 1) / n`, so that
/// part is proportional to the difference of their cosines. The mean over the sphere is kept exactly, for any two
/// sizes.
pub(crate) fn solid_taps(from: usize, to: usize) -> Vec<Taps> {
    let scale = from as f64 / to as f64;
    // This is 1 - cos t without cancellation near the pole.
    let cap = |row: f64| 2.0 * libm::sin(row / from as f64 * std::f64::consts::FRAC_PI_2).powi(2);
    (0..to)
        .map(|o| {
            let (begin, end) = (o as f64 * scale, (o + 1) as f64 * scale);
            let part = |i: usize| cap(end.min((i + 1) as f64)) - cap(begin.max(i as f64));
            let rows = begin.floor() as usize..(end.ceil() as usize).min(from);
            let list: Vec<(usize, f64)> = rows.map(|i| (i, part(i))).filter(|t| t.1 > 1e-15).collect();
            let total: f64 = list.iter().map(|t| t.1).sum();
            Taps::sorted(list.into_iter().map(|(i, w)| (i, (w / total) as f32)).collect())
        })
        .collect()
}

fn centre_of(o: usize, scale: f64) -> f64 {
    (o as f64 + 0.5) * scale
}

impl Taps {
    /// Moves the heaviest tap to the front. It is the base to which the others are added.
    fn sorted(mut taps: Vec<(usize, f32)>) -> Self {
        let heaviest = (0..taps.len()).rev().max_by(|&a, &b| taps[a].1.total_cmp(&taps[b].1));
        taps.swap(0, heaviest.unwrap_or(0));
        Self { taps }
    }

    /// Returns the taps that copy one texel.
    pub(crate) fn one(i: usize) -> Self {
        Self { taps: vec![(i, 1.0)] }
    }

    /// Returns the indices and weights, the heaviest first.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (usize, f32)> {
        self.taps.iter().copied()
    }

    /// Returns the lowest index.
    pub(crate) fn first(&self) -> usize {
        self.taps.iter().map(|t| t.0).min().unwrap_or(0)
    }

    /// Returns the highest index.
    pub(crate) fn last(&self) -> usize {
        self.taps.iter().map(|t| t.0).max().unwrap_or(0)
    }

    /// Does the same as [`Taps::apply`] for the first `count` taps. `value` receives the position among the taps.
    #[inline]
    pub(crate) fn apply_to(&self, count: usize, value: impl Fn(usize) -> f32) -> f32 {
        let base = value(0);
        let (mut sum, mut low, mut high) = (base, base, base);
        for (i, t) in self.taps[..count].iter().enumerate().skip(1) {
            let v = value(i);
            sum += t.1 * (v - base);
            low = low.min(v);
            high = high.max(v);
        }
        sum.clamp(low, high)
    }

    /// Computes the weighted sum, exact for constants and clamped to the range of its values, so that filters with
    /// negative lobes do not ring.
    #[inline]
    pub(crate) fn apply(&self, value: impl Fn(usize) -> f32) -> f32 {
        self.apply_to(self.taps.len(), |i| value(self.taps[i].0))
    }
}

/// Replaces NaN by 0 and infinity by large values. Returns the number of NaNs.
pub(crate) fn make_finite(values: &mut [f32]) -> u64 {
    let mut nans = 0;
    for v in values {
        if v.is_nan() {
            nans += 1;
            *v = 0.0;
        } else {
            *v = v.clamp(-1e30, 1e30);
        }
    }
    nans
}

impl Image {
    /// Returns a black image.
    pub(crate) fn new(width: usize, height: usize, channels: usize) -> Self {
        Self { width, height, channels, data: vec![0.0; width * height * channels] }
    }

    /// Reads the data window of a level of a file. NaN becomes 0, and infinite values become large. Also returns the
    /// number of NaNs.
    pub(crate) fn read(input: &dyn ImageInput, level: usize) -> Result<(Self, u64)> {
        let pixels = input.read_level(0, level)?;
        let (width, height, channels) =
            input.spec(0, level).map_or((0, 0, 1), |s| (s.width as usize, s.height as usize, s.nchannels()));
        let mut data = match pixels {
            Pixels::Float(v) => v,
            other => other.to_floats(),
        };
        let nans = make_finite(&mut data);
        Ok((Self { width, height, channels, data }, nans))
    }

    /// Returns all channels of texel (x, y).
    pub(crate) fn texel(&self, x: usize, y: usize) -> &[f32] {
        &self.data[(y * self.width + x) * self.channels..][..self.channels]
    }

    /// Returns all channels of texel (x, y) for writing.
    pub(crate) fn texel_mut(&mut self, x: usize, y: usize) -> &mut [f32] {
        &mut self.data[(y * self.width + x) * self.channels..][..self.channels]
    }

    /// Returns the rectangle of `width` x `height` texels at (x, y), which lies inside.
    pub(crate) fn cropped(&self, x: usize, y: usize, width: usize, height: usize) -> Self {
        let n = self.channels;
        let mut data = Vec::with_capacity(width * height * n);
        for row in y..y + height {
            data.extend_from_slice(&self.data[(row * self.width + x) * n..][..width * n]);
        }
        Self { width, height, channels: n, data }
    }

    /// Copies `other`, which has the same number of channels, to (x, y). It must fit.
    pub(crate) fn paste(&mut self, other: &Self, x: usize, y: usize) {
        let n = self.channels;
        for row in 0..other.height {
            let from = &other.data[row * other.width * n..][..other.width * n];
            self.data[((y + row) * self.width + x) * n..][..from.len()].copy_from_slice(from);
        }
    }

    /// Returns the image rotated by 180 degrees.
    pub(crate) fn turned(&self) -> Self {
        let mut out = Self::new(self.width, self.height, self.channels);
        for y in 0..self.height {
            for x in 0..self.width {
                out.texel_mut(x, y).copy_from_slice(self.texel(self.width - 1 - x, self.height - 1 - y));
            }
        }
        out
    }

    /// Returns the image in another size.
    pub(crate) fn resized(&self, width: usize, height: usize, filter: Filter, wrap: (Wrap, Wrap)) -> Self {
        let n = self.channels;
        let mut wide = Self::new(width, self.height, n);
        if width == self.width {
            wide.data.copy_from_slice(&self.data);
        } else {
            let across = taps(self.width, width, filter, wrap.0);
            wide.data.par_chunks_mut(width * n).zip(self.data.par_chunks(self.width * n)).for_each(
                |(to, from)| {
                    for (x, t) in across.iter().enumerate() {
                        for c in 0..n {
                            to[x * n + c] = t.apply(|i| from[i * n + c]);
                        }
                    }
                },
            );
        }
        if height == self.height {
            return wide;
        }
        let down = taps(self.height, height, filter, wrap.1);
        let mut out = Self::new(width, height, n);
        out.data.par_chunks_mut(width * n).zip(&down).for_each(|(to, t)| {
            for (x, to) in to.iter_mut().enumerate() {
                *to = t.apply(|i| wide.data[i * width * n + x]);
            }
        });
        out
    }

    /// Returns the image with fewer rows. The rows of a latitude-longitude map are weighted by their part of the
    /// sphere.
    pub(crate) fn rows_by_solid_angle(&self, height: usize) -> Self {
        if height == self.height {
            return self.clone();
        }
        let row = self.width * self.channels;
        let mut out = Self::new(self.width, height, self.channels);
        let down = solid_taps(self.height, height);
        out.data.par_chunks_mut(row).zip(&down).for_each(|(to, t)| {
            for (x, to) in to.iter_mut().enumerate() {
                *to = t.apply(|i| self.data[i * row + x]);
            }
        });
        out
    }

    /// Returns the next MIP level.
    pub(crate) fn halved(&self, filter: Filter, wrap: (Wrap, Wrap)) -> Self {
        self.resized(half(self.width), half(self.height), filter, wrap)
    }

    /// Returns the image and all smaller levels.
    pub(crate) fn pyramid(self, filter: Filter, wrap: (Wrap, Wrap)) -> Vec<Self> {
        let mut levels = vec![self];
        while let Some(last) = levels.last().filter(|p| p.width > 1 || p.height > 1) {
            let next = last.halved(filter, wrap);
            levels.push(next);
        }
        levels
    }

    /// Computes the value at a point by bilinear interpolation, clamped at the border. `x` and `y` are in texels, with
    /// texel centres at half numbers.
    pub(crate) fn bilinear(&self, x: f32, y: f32, out: &mut [f32]) {
        let place = |v: f32, n: usize| {
            let v = (v - 0.5).clamp(0.0, (n - 1) as f32);
            let i = v as usize;
            (i, (i + 1).min(n - 1), v - i as f32)
        };
        let ((x0, x1, fx), (y0, y1, fy)) = (place(x, self.width), place(y, self.height));
        let corners = [(x0, y0), (x1, y0), (x0, y1), (x1, y1)].map(|(x, y)| self.texel(x, y));
        for (c, out) in out.iter_mut().enumerate() {
            let top = corners[0][c] + (corners[1][c] - corners[0][c]) * fx;
            let bottom = corners[2][c] + (corners[3][c] - corners[2][c]) * fx;
            *out = top + (bottom - top) * fy;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(width: usize, height: usize) -> Image {
        let mut p = Image::new(width, height, 1);
        for (i, v) in p.data.iter_mut().enumerate() {
            *v = granita_base::hash::unit(granita_base::hash::words(&[i as u32]));
        }
        p
    }

    fn mean(p: &Image) -> f64 {
        p.data.iter().map(|v| f64::from(*v)).sum::<f64>() / p.data.len() as f64
    }

    #[test]
    fn mip_levels_have_halved_sizes() {
        assert_eq!(level_count(1, 1), 1);
        assert_eq!(level_count(300, 7), 9);
        let levels = Image::new(300, 7, 2).pyramid(Filter::Box, (Wrap::Black, Wrap::Black));
        let sizes: Vec<_> = levels.iter().map(|p| (p.width, p.height)).collect();
        assert_eq!(sizes, [(300, 7), (150, 3), (75, 1), (37, 1), (18, 1), (9, 1), (4, 1), (2, 1), (1, 1)]);
    }

    #[test]
    fn box_levels_keep_the_mean() {
        for (w, h) in [(64, 32), (37, 53), (1, 17), (5, 1), (1, 1)] {
            let p = noise(w, h);
            let m = mean(&p);
            for level in p.pyramid(Filter::Box, (Wrap::Black, Wrap::Clamp)) {
                assert!((mean(&level) - m).abs() < 1e-6, "{w}x{h} at {}x{}", level.width, level.height);
            }
        }
    }

    #[test]
    fn constants_stay_exact_under_every_filter_and_wrap() {
        for filter in Filter::ALL {
            for wrap in Wrap::ALL {
                let mut p = Image::new(13, 10, 3);
                p.data.fill(0.3);
                for q in [p.resized(16, 16, filter, (wrap, wrap)), p.halved(filter, (wrap, wrap))] {
                    assert!(q.data.iter().all(|v| *v == 0.3), "{filter:?} {wrap:?}");
                }
            }
        }
    }

    #[test]
    fn an_enlarged_ramp_is_a_ramp() {
        let mut p = Image::new(100, 1, 1);
        for (x, v) in p.data.iter_mut().enumerate() {
            *v = (x as f32 + 0.5) / 100.0;
        }
        let q = p.resized(128, 1, Filter::CatmullRom, (Wrap::Clamp, Wrap::Clamp));
        for x in 4..124 {
            assert!((q.data[x] - (x as f32 + 0.5) / 128.0).abs() < 1e-4, "{x}: {}", q.data[x]);
        }
    }

    #[test]
    fn filters_stay_within_the_range_of_the_image() {
        let mut p = Image::new(32, 1, 1);
        p.data[16..].fill(1.0);
        for filter in Filter::ALL {
            let q = p.resized(40, 1, filter, (Wrap::Clamp, Wrap::Clamp));
            assert!(q.data.iter().all(|v| (0.0..=1.0).contains(v)), "{filter:?}");
        }
    }

    #[test]
    fn rectangles_are_cropped_pasted_and_rotated() {
        let p = noise(8, 6);
        let mut q = Image::new(8, 6, 1);
        for (x, y) in [(0, 0), (4, 0), (0, 3), (4, 3)] {
            q.paste(&p.cropped(x, y, 4, 3), x, y);
        }
        assert_eq!(p, q);
        assert_eq!(p.turned().turned(), p);
        assert_eq!(p.turned().texel(0, 0), p.texel(7, 5));
        let mut v = [0.0];
        p.bilinear(2.5, 3.5, &mut v);
        assert_eq!(v[0], p.texel(2, 3)[0]);
    }
}
