//! Images in another size, which are made while the rows of the source arrive.

use super::kernel::{Kernel, centre, clamped, resampled_radially};
use crate::image::Image;
use granita_machine::widest;
use rayon::prelude::*;
use std::f32::consts::PI;

/// The number of rows of a whole image that are processed together.
const ROWS: usize = 128;

/// The source texels and weights of each destination texel in one direction. Texels are in ascending order.
#[derive(Debug, Default)]
struct Weights {
    taps: Vec<(usize, f32)>,
    /// The end of the taps of each destination texel.
    ends: Vec<usize>,
}

impl Weights {
    fn push(&mut self, taps: impl IntoIterator<Item = (usize, f32)>) {
        self.taps.extend(taps);
        self.ends.push(self.taps.len());
    }

    fn of(&self, o: usize) -> &[(usize, f32)] {
        let start = if o == 0 { 0 } else { self.ends[o - 1] };
        &self.taps[start..self.ends[o]]
    }

    /// Returns the normalised weights of a kernel of this radius, in source texels.
    fn of_kernel(from: usize, to: usize, radius: i64, kernel: Kernel, width: f32) -> Self {
        let ratio = to as f32 / from as f32;
        let mut weights = Self::default();
        for o in 0..to {
            let (at, part) = centre(o, from, to);
            let taps: Vec<(usize, f32)> = (-radius..=radius)
                .map(|i| (clamped(at + i, from), kernel.weight(ratio * (i as f32 - (part - 0.5)), width)))
                .filter(|tap| tap.1 != 0.0)
                .collect();
            let total: f32 = taps.iter().map(|tap| tap.1).sum();
            weights.push(taps.into_iter().map(|(i, w)| (i, if total == 0.0 { 0.0 } else { w / total })));
        }
        weights
    }

    /// Applies the weights to a row of texels of `N` channels.
    fn apply<const N: usize>(&self, to: &mut [f32], from: &[f32]) {
        let from = from.as_chunks::<N>().0;
        for (o, texel) in to.as_chunks_mut::<N>().0.iter_mut().enumerate() {
            let mut sum = [0.0; N];
            for &(i, w) in self.of(o) {
                sum.iter_mut().zip(&from[i]).for_each(|(v, from)| *v += w * from);
            }
            *texel = sum;
        }
    }

    /// Does the same for `n` channels.
    fn apply_to(&self, n: usize, to: &mut [f32], from: &[f32]) {
        match n {
            1 => self.apply::<1>(to, from),
            2 => self.apply::<2>(to, from),
            3 => self.apply::<3>(to, from),
            4 => self.apply::<4>(to, from),
            6 => self.apply::<6>(to, from),
            _ => {
                for (o, texel) in to.chunks_exact_mut(n).enumerate() {
                    texel.fill(0.0);
                    for &(i, w) in self.of(o) {
                        texel.iter_mut().zip(&from[i * n..]).for_each(|(v, from)| *v += w * from);
                    }
                }
            }
        }
    }
}

/// An image that is made in another size. Results do not depend on the number of rows that arrive together.
#[derive(Debug)]
pub(crate) struct Reduction {
    across: Weights,
    down: Weights,
    /// The width of the source.
    width: usize,
    /// The next row of the source.
    next: usize,
    out: Image,
}

impl Reduction {
    /// Returns the reduction by a kernel; `None` when the kernel is not a product of functions of x and of y.
    pub(crate) fn resampling(
        from: (usize, usize),
        to: (usize, usize),
        channels: usize,
        kernel: Kernel,
    ) -> Option<Self> {
        if kernel.is_radial() {
            return None;
        }
        let (size, (rx, ry)) = kernel.extent(from, to);
        let across = Weights::of_kernel(from.0, to.0, rx, kernel, size.0);
        let down = Weights::of_kernel(from.1, to.1, ry, kernel, size.1);
        Some(Self { across, down, width: from.0, next: 0, out: Image::new(to.0, to.1, channels) })
    }

    /// Returns the reduction by bilinear interpolation at the centres of the texels. At half the size that is the mean
    /// of four texels. Rows of a panorama are also weighted by the sine of their polar angle.
    pub(crate) fn interpolation(
        from: (usize, usize),
        to: (usize, usize),
        channels: usize,
        panorama: bool,
    ) -> Self {
        let pair = |o: usize, from: usize, to: usize| {
            let at = (o as f32 + 0.5) * (1.0 / to as f32) * from as f32 - 0.5;
            let i = at.floor();
            (clamped(i as i64, from), clamped(i as i64 + 1, from), at - i)
        };
        let (mut across, mut down) = (Weights::default(), Weights::default());
        for x in 0..to.0 {
            let (a, b, part) = pair(x, from.0, to.0);
            across.push([(a, 1.0 - part), (b, part)]);
        }
        for y in 0..to.1 {
            let (a, b, part) = pair(y, from.1, to.1);
            let sine = |row: usize| libm::sinf(PI * (row as f32 + 0.5) / from.1 as f32);
            let (w0, w1) = ((1.0 - part) * sine(a), part * sine(b));
            let part = if panorama { w1 / (w0 + w1) } else { part };
            down.push([(a, 1.0 - part), (b, part)]);
        }
        Self { across, down, width: from.0, next: 0, out: Image::new(to.0, to.1, channels) }
    }

    /// Adds the next rows of the source.
    pub(crate) fn push(&mut self, rows: &[f32]) {
        let n = self.out.channels;
        let (from, to) = (self.width * n, self.out.width * n);
        let (first, end) = (self.next, self.next + rows.len() / from);
        self.next = end;
        let (across, down) = (&self.across, &self.down);
        let mut wide = vec![0.0; (end - first) * to];
        wide.par_chunks_mut(to)
            .zip(rows.par_chunks(from))
            .for_each(|(to, from)| across.apply_to(n, to, from));
        let arrived = first..end;
        self.out.data.par_chunks_mut(to).enumerate().for_each(|(y, row)| {
            for &(i, w) in down.of(y).iter().filter(|tap| arrived.contains(&tap.0)) {
                let from = &wide[(i - first) * to..][..to];
                widest!(row.iter_mut().zip(from).for_each(|(v, from)| *v += w * from));
            }
        });
    }

    /// Adds all rows of the source, and returns the image.
    pub(crate) fn of(mut self, source: &Image) -> Image {
        source.data.chunks(ROWS * source.width * source.channels).for_each(|rows| self.push(rows));
        self.finish()
    }

    /// Returns the image, when all rows have arrived.
    pub(crate) fn finish(self) -> Image {
        self.out
    }
}

/// Returns an image in another size.
pub(crate) fn resampled(source: &Image, size: (usize, usize), kernel: Kernel) -> Image {
    match Reduction::resampling((source.width, source.height), size, source.channels, kernel) {
        Some(reduction) => reduction.of(source),
        None => resampled_radially(source, size, kernel),
    }
}

/// Returns an image in another size by [`Reduction::interpolation`].
pub(crate) fn interpolated(source: &Image, size: (usize, usize), panorama: bool) -> Image {
    Reduction::interpolation((source.width, source.height), size, source.channels, panorama).of(source)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(width: usize, height: usize) -> Image {
        let mut p = Image::new(width, height, 2);
        for (i, v) in p.data.iter_mut().enumerate() {
            *v = granita_base::hash::unit(granita_base::hash::words(&[i as u32]));
        }
        p
    }

    #[test]
    fn kernels_keep_constants() {
        for (name, kernel) in Kernel::NAMES {
            let mut p = Image::new(13, 10, 1);
            p.data.fill(0.25);
            // A disk of the width of a texel misses all texels of an enlarged image.
            let sizes = [(6, 5), (13, 10), (16, 16)];
            for size in sizes.into_iter().take(if kernel == Kernel::Disk { 2 } else { 3 }) {
                for v in resampled(&p, size, kernel).data {
                    assert!((v - 0.25).abs() < 1e-5, "{name} {size:?} {v}");
                }
            }
        }
    }

    #[test]
    fn interpolation_halves_by_means() {
        let p = noise(8, 6);
        let half = interpolated(&p, (4, 3), false);
        for (y, x) in (0..3).flat_map(|y| (0..4).map(move |x| (y, x))) {
            let four = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| p.texel(2 * x + i, 2 * y + j)[0]);
            assert!((half.texel(x, y)[0] - four.iter().sum::<f32>() / 4.0).abs() < 1e-6);
        }
        assert_eq!(resampled(&p, (4, 3), Kernel::Box).data.len(), half.data.len());
        for (a, b) in resampled(&p, (4, 3), Kernel::Box).data.iter().zip(&half.data) {
            assert!((a - b).abs() < 1e-6);
        }
    }

    #[test]
    fn portions_of_rows_do_not_matter() {
        for (channels, size) in [(1, (16, 9)), (3, (7, 12)), (5, (4, 3)), (6, (1, 1))] {
            let mut source = Image::new(13, 17, channels);
            for (i, v) in source.data.iter_mut().enumerate() {
                *v = granita_base::hash::unit(granita_base::hash::words(&[i as u32]));
            }
            let made = || {
                let from = (13, 17);
                let lanczos = Reduction::resampling(from, size, channels, Kernel::Lanczos3).unwrap();
                [lanczos, Reduction::interpolation(from, size, channels, true)]
            };
            for (whole, mut parts) in made().into_iter().zip(made()) {
                for rows in source.data.chunks(13 * channels * 2) {
                    parts.push(rows);
                }
                assert_eq!(whole.of(&source), parts.finish());
            }
        }
        assert!(Reduction::resampling((2, 2), (1, 1), 1, Kernel::Disk).is_none());
    }
}
