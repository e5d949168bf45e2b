//! The filters of OpenImageIO's texture maker, by its definitions, and levels that are made with them.
//!
//! They differ from those of [`granita_base::Filter`] in their widths, and the results are not limited to the range of
//! the texels, so that filters with negative lobes ring. Beyond a border the texels of the border repeat.

use crate::image::Image;
use granita_base::Filter;
use granita_base::filter::{cubic, sinc};
use rayon::prelude::*;

/// The shape of a filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kernel {
    /// A constant over 1 pixel.
    Box,
    /// A tent over 2 pixels.
    Triangle,
    /// exp(-2 r^2) over 3 pixels, where r is 1 at the edge.
    Gaussian,
    /// exp(-4 r^2) over 2 pixels.
    SharpGaussian,
    /// Cubic interpolation over 4 pixels.
    CatmullRom,
    /// A four-term cosine window over 3 pixels.
    BlackmanHarris,
    /// sin(pi x) / (pi x), cut off at 4 pixels.
    Sinc,
    /// A sinc with three lobes, windowed by a sinc, over 6 pixels.
    Lanczos3,
    /// The same as a function of the distance from the centre.
    RadialLanczos3,
    /// The cubic of Mitchell and Netravali over 4 pixels.
    Mitchell,
    /// The cubic B-spline over 4 pixels.
    BSpline,
    /// A disk with a diameter of 1 pixel.
    Disk,
    /// The cubic convolution of R. Keys with a = 0, over 4 pixels.
    Cubic,
    /// The same with a = -0.5.
    Keys,
    /// The same with a = -0.75.
    Simon,
    /// The same with a = -1.
    Rifman,
}

impl Kernel {
    /// The names on the command line.
    pub const NAMES: [(&'static str, Self); 17] = [
        ("box", Self::Box),
        ("triangle", Self::Triangle),
        ("gaussian", Self::Gaussian),
        ("sharp-gaussian", Self::SharpGaussian),
        ("catmull-rom", Self::CatmullRom),
        ("blackman-harris", Self::BlackmanHarris),
        ("sinc", Self::Sinc),
        ("lanczos3", Self::Lanczos3),
        ("radial-lanczos3", Self::RadialLanczos3),
        ("nuke-lanczos6", Self::Lanczos3),
        ("mitchell", Self::Mitchell),
        ("bspline", Self::BSpline),
        ("disk", Self::Disk),
        ("cubic", Self::Cubic),
        ("keys", Self::Keys),
        ("simon", Self::Simon),
        ("rifman", Self::Rifman),
    ];

    /// Returns the kernel of a name.
    pub fn from_word(word: &str) -> Option<Self> {
        Self::NAMES.into_iter().find(|(name, _)| *name == word).map(|(_, kernel)| kernel)
    }

    /// Returns the width in pixels at which the filter is used.
    pub fn natural_width(self) -> f32 {
        match self {
            Self::Box | Self::Disk => 1.0,
            Self::Triangle | Self::SharpGaussian => 2.0,
            Self::Gaussian | Self::BlackmanHarris => 3.0,
            Self::Lanczos3 | Self::RadialLanczos3 => 6.0,
            _ => 4.0,
        }
    }

    /// True when the filter is not a product of functions of x and of y.
    pub fn is_radial(self) -> bool {
        matches!(self, Self::RadialLanczos3 | Self::Disk)
    }

    /// Returns the weight at distance `x` from the centre, for a filter stretched to `width` (both in pixels). It is
    /// not normalised.
    pub fn weight(self, x: f32, width: f32) -> f32 {
        let x = x.abs();
        // `r` is 1 at the edge, and `n` is the distance in pixels of the natural width.
        let r = 2.0 * x / width;
        let n = 0.5 * r * self.natural_width();
        match self {
            Self::Box => f32::from(u8::from(r <= 1.0)),
            Self::Disk => f32::from(u8::from(r < 1.0)),
            Self::Triangle => (1.0 - r).max(0.0),
            Self::Gaussian if r < 1.0 => libm::expf(-2.0 * r * r),
            Self::SharpGaussian if r < 1.0 => libm::expf(-4.0 * r * r),
            Self::BlackmanHarris => Filter::BlackmanHarris.weight(x, width),
            // The sinc is not stretched, only its end is.
            Self::Sinc if r <= 1.0 => sinc(x),
            Self::Lanczos3 | Self::RadialLanczos3 if n <= 3.0 => sinc(n) * sinc(n / 3.0),
            Self::Mitchell => cubic(n, 1.0 / 3.0, 1.0 / 3.0),
            Self::BSpline => cubic(n, 1.0, 0.0),
            Self::Cubic => keys(n, 0.0),
            Self::CatmullRom | Self::Keys => keys(n, -0.5),
            Self::Simon => keys(n, -0.75),
            Self::Rifman => keys(n, -1.0),
            _ => 0.0,
        }
    }

    /// Returns the size in pixels at which the filter resizes an image, and its radius in texels of the source.
    pub(super) fn extent(self, from: (usize, usize), to: (usize, usize)) -> ((f32, f32), (i64, i64)) {
        let ratio = (to.0 as f32 / from.0 as f32, to.1 as f32 / from.1 as f32);
        let natural = self.natural_width();
        let size = (natural * ratio.0.max(1.0), natural * ratio.1.max(1.0));
        let reach = |ratio: f32| (size.0 / 2.0 / ratio).ceil() as i64;
        (size, (reach(ratio.0), reach(ratio.1)))
    }

    /// Returns the weight at (x, y) for a filter of `width` x `height` pixels.
    pub fn weight_at(self, (x, y): (f32, f32), (width, height): (f32, f32)) -> f32 {
        if self.is_radial() {
            // A distance of 1 is the edge.
            let r = libm::hypotf(2.0 * x / width, 2.0 * y / height);
            self.weight(r, 2.0)
        } else {
            self.weight(x, width) * self.weight(y, height)
        }
    }
}

/// Returns the kernel of cubic convolution (R. Keys, Cubic Convolution Interpolation for Digital Image Processing,
/// IEEE ASSP-29, 1981, eq. 4 with a free parameter).
fn keys(x: f32, a: f32) -> f32 {
    cubic(x, 0.0, -a)
}

/// The filter of levels, and of sharpening them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LevelFilter {
    /// The name on the command line.
    pub name: String,
    /// The filter that makes a level.
    pub kernel: Kernel,
    /// The filter of the unsharp mask.
    pub blur: Kernel,
    /// True when a level is sharpened after it was made, and not the one from which it is made.
    pub sharpen_after: bool,
}

impl Default for LevelFilter {
    fn default() -> Self {
        Self { name: "box".to_owned(), kernel: Kernel::Box, blur: Kernel::Gaussian, sharpen_after: false }
    }
}

impl LevelFilter {
    /// Returns the filter of a name. The name is that of a kernel, or `unsharp-KERNEL`, which is `lanczos3` with this
    /// kernel for sharpening. After `post-` a level is sharpened when it is complete.
    pub fn from_word(word: &str) -> Option<Self> {
        let (after, rest) = word.strip_prefix("post-").map_or((false, word), |rest| (true, rest));
        let (kernel, blur) = match rest.strip_prefix("unsharp-") {
            Some(blur) => (Kernel::Lanczos3, Kernel::from_word(blur)?),
            None => (Kernel::from_word(rest)?, Kernel::Gaussian),
        };
        Some(Self { name: word.to_owned(), kernel, blur, sharpen_after: after })
    }
}

/// Returns the index of the texel that replaces `i`, which may lie beyond a border.
pub(super) fn clamped(i: i64, n: usize) -> usize {
    i.clamp(0, n as i64 - 1) as usize
}

/// Returns the centre of destination texel `o` as an index of a source texel and a part of it.
pub(super) fn centre(o: usize, from: usize, to: usize) -> (i64, f32) {
    let at = (o as f32 + 0.5) * (1.0 / to as f32) * from as f32;
    (at.floor() as i64, at - at.floor())
}

/// Returns an image in another size, by a kernel that is not a product of functions of x and of y.
pub(crate) fn resampled_radially(source: &Image, (width, height): (usize, usize), kernel: Kernel) -> Image {
    let from = (source.width, source.height);
    let ratio = (width as f32 / from.0 as f32, height as f32 / from.1 as f32);
    let (size, (rx, ry)) = kernel.extent(from, (width, height));
    let n = source.channels;
    let mut out = Image::new(width, height, n);
    out.data.par_chunks_mut(width * n).enumerate().for_each(|(y, row)| {
        let (at_y, part_y) = centre(y, source.height, height);
        for (x, texel) in row.chunks_exact_mut(n).enumerate() {
            let (at_x, part_x) = centre(x, source.width, width);
            let mut total = 0.0;
            for j in -ry..=ry {
                for i in -rx..=rx {
                    let place = (i as f32 - (part_x - 0.5), j as f32 - (part_y - 0.5));
                    let w = kernel.weight_at((ratio.0 * place.0, ratio.1 * place.1), size);
                    if w != 0.0 {
                        total += w;
                        let from =
                            source.texel(clamped(at_x + i, source.width), clamped(at_y + j, source.height));
                        texel.iter_mut().zip(from).for_each(|(v, from)| *v += w * from);
                    }
                }
            }
            texel.iter_mut().for_each(|v| *v = if total == 0.0 { 0.0 } else { *v / total });
        }
    });
    out
}

/// Returns an image plus `amount` times its difference from a blurred copy. The blur extends over 3 x 3 texels.
pub(crate) fn sharpened(source: &Image, blur: Kernel, amount: f32) -> Image {
    let (w, h, n) = (source.width, source.height, source.channels);
    let at: Vec<(i64, i64)> = (-1..=1).flat_map(|j| (-1..=1).map(move |i| (i, j))).collect();
    let taps: Vec<f32> = at.iter().map(|&(i, j)| blur.weight_at((i as f32, j as f32), (3.0, 3.0))).collect();
    let total: f32 = taps.iter().sum();
    let mut out = source.clone();
    out.data.par_chunks_mut(w * n).enumerate().for_each(|(y, row)| {
        for (x, texel) in row.chunks_exact_mut(n).enumerate() {
            let mut sum = vec![0.0; n];
            for (&(i, j), tap) in at.iter().zip(&taps) {
                let from = source.texel(clamped(x as i64 + i, w), clamped(y as i64 + j, h));
                sum.iter_mut().zip(from).for_each(|(s, v)| *s += tap / total * v);
            }
            texel.iter_mut().zip(sum).for_each(|(v, blurred)| *v += amount * (*v - blurred));
        }
    });
    out
}

/// The value below which highlights are not compressed, and the constants of the logarithm above it. They are those of
/// OpenImageIO, which has them from Sony Pictures Imageworks.
const HIGHLIGHT: f32 = 0.18;
const LOG: (f32, f32, f32) = (-0.545_768_86, 0.183_516_7, 284.357_8);

/// Replaces highlights by a logarithm, so that few bright texels do not dominate a filter. `skip` are channels that are
/// kept, such as alpha.
pub(crate) fn compress_highlights(image: &mut Image, skip: &[usize]) {
    let (a, b, c) = LOG;
    each(image, skip, |v| {
        if v.abs() <= HIGHLIGHT { v } else { (a + b * libm::logf(c * v.abs() + 1.0)).copysign(v) }
    });
}

/// Does the inverse of [`compress_highlights`]. Negative results become 0.
pub(crate) fn expand_highlights(image: &mut Image, skip: &[usize]) {
    let (a, b, c) = LOG;
    each(image, skip, |v| {
        if v.abs() <= HIGHLIGHT {
            return v;
        }
        let power = libm::expf((v.abs() - a) / b);
        let x = (power - 1.0) / c;
        (if x < HIGHLIGHT { (-power - 1.0) / c } else { x }).copysign(v)
    });
    image.data.iter_mut().for_each(|v| *v = v.max(0.0));
}

fn each(image: &mut Image, skip: &[usize], change: impl Fn(f32) -> f32 + Sync) {
    let n = image.channels;
    let row = n * image.width.max(1);
    image.data.par_chunks_mut(row).for_each(|row| {
        for (i, v) in row.iter_mut().enumerate() {
            if !skip.contains(&(i % n)) {
                *v = change(*v);
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernels_keep_constants_and_have_names() {
        for (name, kernel) in Kernel::NAMES {
            assert_eq!(Kernel::from_word(name), Some(kernel));
            let mut p = Image::new(13, 10, 1);
            p.data.fill(0.25);
            assert!(sharpened(&p, kernel, 2.0).data.iter().all(|v| (v - 0.25).abs() < 1e-6), "{name}");
        }
        let f = LevelFilter::from_word("post-unsharp-mitchell").unwrap();
        assert_eq!((f.kernel, f.blur, f.sharpen_after), (Kernel::Lanczos3, Kernel::Mitchell, true));
        assert_eq!(LevelFilter::from_word("unsharp-round"), None);
    }

    #[test]
    fn highlights_survive_compression_and_expansion() {
        let mut p = Image::new(5, 1, 2);
        let values = [0.0, 0.1, 0.18, 0.5, 1.0, 7.0, 100.0, 6e4, 0.05, 2.0];
        p.data.copy_from_slice(&values);
        compress_highlights(&mut p, &[1]);
        assert!(p.data[6] < 2.0 && p.data[7] == 6e4);
        expand_highlights(&mut p, &[1]);
        for (a, b) in p.data.iter().zip(values) {
            assert!((a - b).abs() <= 1e-3 * b, "{a} {b}");
        }
    }
}
