//! Conversion of computed floats to stored values: gain, gamma, quantization and dither (reference 7.3.4, 7.4).

use crate::{Format, PixelType, Pixels};
use granita_base::{Params, hash, math};
use half::f16;

/// The conversion of the values of an output to the values of its file.
///
/// A value `v` of a colour channel is first multiplied by `gain` and, where positive, raised to the power of
/// `1 / gamma`. Alpha is not changed (reference 13.3.2). Then integers are
/// `floor(zero + v * (one - zero) + dither * r + 1/2)` clamped to `min..=max`, with `r` in [-1, 1) hashed from pixel
/// and channel. With a dither of at most 1/2 a value that is exactly representable keeps its integer. NaN becomes the
/// zero level, and infinities are clamped.
///
/// Floats are stored after gain and gamma, without dither.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantize {
    /// The integer that represents 0.
    pub zero: i32,
    /// The integer that represents 1.
    pub one: i32,
    /// The smallest stored integer.
    pub min: i32,
    /// The largest stored integer.
    pub max: i32,
    /// The amplitude of the dither, in integer steps.
    pub dither: f32,
    /// The factor of colour channels.
    pub gain: f32,
    /// Colour channels are raised to the power of the inverse of this.
    pub gamma: f32,
}

impl Default for Quantize {
    /// Returns eight bits with a dither of 0.5, and gain and gamma of 1.
    fn default() -> Self {
        Self { zero: 0, one: 255, min: 0, max: 255, dither: 0.5, gain: 1.0, gamma: 1.0 }
    }
}

/// The position of a run of values in its image, for [`Quantize::apply`].
#[derive(Clone, Copy, Debug)]
pub struct Placement {
    /// The column of the first pixel, in display window coordinates, so that the dither does not depend on crops.
    pub x: i32,
    /// The row of the first pixel.
    pub y: i32,
    /// The number of pixels per row of the run.
    pub width: usize,
    /// The number of channels per pixel.
    pub nchannels: usize,
    /// The index of the alpha channel, which gain and gamma do not change.
    pub alpha: Option<usize>,
}

impl Quantize {
    /// The conversion to floats without changes.
    pub const FLOAT: Self = Self { zero: 0, one: 0, min: 0, max: 0, dither: 0.0, gain: 1.0, gamma: 1.0 };

    /// Returns the conversion of the parameters `quantize`, `dither`, `gain` and `gamma` of an output. Parameters
    /// that are absent or invalid (a gain or gamma that is not finite, a gamma of 0 or less, a negative dither) are
    /// those of [`Quantize::default`].
    pub fn from_params(params: &Params) -> Self {
        let mut q = Self::default();
        if let Some(v) = params.get("quantize").and_then(|p| p.data.to_ints())
            && let [zero, one, min, max] = v[..]
        {
            (q.zero, q.one, q.min, q.max) = (zero, one, min, max);
        }
        let number = |name: &str| params.float(name).filter(|v| v.is_finite());
        q.dither = number("dither").filter(|d| *d >= 0.0).unwrap_or(q.dither);
        q.gain = number("gain").unwrap_or(q.gain);
        q.gamma = number("gamma").filter(|g| *g > 0.0).unwrap_or(q.gamma);
        q
    }

    /// Returns the result of [`Quantize::from_params`] adapted to `format`, and the type for the spec. A format
    /// without 16 bits gets 8. One that stores only floats ("OpenEXR", "shadow") ignores `quantize` and `dither`.
    /// Where it would store half floats, the parameter `pixeltype` may request "float".
    pub fn for_output(format: &dyn Format, params: &Params) -> (Self, PixelType) {
        let mut q = Self::from_params(params);
        let wanted = q.pixel_type();
        let asked = params.string("pixeltype").is_some_and(|t| &**t == "float");
        let stored = match format.output_type(wanted) {
            PixelType::Half if asked && format.supports("float") => PixelType::Float,
            stored => stored,
        };
        let fixed = format.has_fixed_levels() && matches!(stored, PixelType::U8 | PixelType::U16);
        if fixed {
            q.dither = Self::default().dither;
        }
        if fixed || stored != wanted {
            (q.zero, q.one, q.min, q.max) = match stored {
                PixelType::U8 => (0, 255, 0, 255),
                PixelType::U16 => (0, 65535, 0, 65535),
                PixelType::U32 | PixelType::Half | PixelType::Float => (0, 0, 0, 0),
            };
        }
        (q, stored)
    }

    /// Returns the type that `max` selects: 8 bits up to 255, 16 bits up to 65535, and floats above that and when all
    /// four levels are 0.
    pub fn pixel_type(&self) -> PixelType {
        match self.max {
            _ if self.zero == 0 && self.one == 0 && self.min == 0 && self.max == 0 => PixelType::Float,
            ..=255 => PixelType::U8,
            256..=65535 => PixelType::U16,
            _ => PixelType::Float,
        }
    }

    /// Applies gain and gamma to one colour value. Values of 0 and below are only multiplied.
    pub fn expose(&self, v: f32) -> f32 {
        let v = v * self.gain;
        if self.gamma != 1.0 && v > 0.0 { math::pow(v, f64::from(1.0 / self.gamma)) } else { v }
    }

    /// Converts rows of interleaved pixels to any type `stored`. Integer types use the levels, and float types only
    /// gain and gamma. `U32` (identifiers) is rounded, without levels or dither.
    ///
    /// `values` holds whole pixels, in rows of `at.width`. A pixel has the same result in every division of the
    /// image.
    pub fn apply(&self, values: &[f32], at: &Placement, stored: PixelType) -> Pixels {
        let mut pixels = Pixels::zeros(stored, values.len());
        match &mut pixels {
            Pixels::U8(out) => self.each(values, at, true, |i, v| out[i] = v as u8),
            Pixels::U16(out) => self.each(values, at, true, |i, v| out[i] = v as u16),
            Pixels::U32(out) => self.each(values, at, false, |i, v| out[i] = v.round() as u32),
            Pixels::Half(out) => self.each(values, at, false, |i, v| out[i] = f16::from_f32(v)),
            Pixels::Float(out) => self.each(values, at, false, |i, v| out[i] = v),
        }
        pixels
    }

    /// Calls `store(index, value)` for every value after gain and gamma and, if `levels` is true, quantization to an
    /// integer.
    fn each(&self, values: &[f32], at: &Placement, levels: bool, mut store: impl FnMut(usize, f32)) {
        let n = at.nchannels.max(1);
        let width = at.width.max(1);
        let (zero, one) = (self.zero as f32, self.one as f32);
        let (min, max) = (self.min as f32, (self.max as f32).max(self.min as f32));
        for (pixel, group) in values.chunks(n).enumerate() {
            let x = at.x.wrapping_add((pixel % width) as i32) as u32;
            let y = at.y.wrapping_add((pixel / width) as i32) as u32;
            for (c, &v) in group.iter().enumerate() {
                let mut v = if at.alpha == Some(c) { v } else { self.expose(v) };
                if levels {
                    let noise = if self.dither > 0.0 {
                        self.dither * (2.0 * hash::unit(hash::words(&[x, y, c as u32])) - 1.0)
                    } else {
                        0.0
                    };
                    let q = zero + v * (one - zero) + noise;
                    v = if q.is_nan() { zero } else { (q + 0.5).floor() }.clamp(min, max);
                }
                store(pixel * n + c, v);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::Param;

    fn at(width: usize, nchannels: usize, alpha: Option<usize>) -> Placement {
        Placement { x: 0, y: 0, width, nchannels, alpha }
    }

    #[test]
    fn the_pixel_type_follows_the_largest_value() {
        let q = |zero, one, min, max| Quantize { zero, one, min, max, ..Quantize::default() }.pixel_type();
        assert_eq!(q(0, 255, 0, 255), PixelType::U8);
        assert_eq!(q(0, 127, 0, 127), PixelType::U8);
        assert_eq!(q(0, 4095, 0, 4095), PixelType::U16);
        assert_eq!(q(0, 65535, 0, 65535), PixelType::U16);
        assert_eq!(q(0, 65536, 0, 65536), PixelType::Float);
        assert_eq!(q(0, 0, 0, 0), PixelType::Float);
    }

    #[test]
    fn exact_values_survive_the_default_dither() {
        let values: Vec<f32> = (0..=255).map(|i| i as f32 / 255.0).collect();
        for y in 0..8 {
            let place = Placement { y, ..at(256, 1, None) };
            let Pixels::U8(got) = Quantize::default().apply(&values, &place, PixelType::U8) else { panic!() };
            assert_eq!(got, (0..=255).collect::<Vec<u8>>());
        }
    }

    #[test]
    fn dither_keeps_the_mean_and_does_not_depend_on_batches() {
        let values = vec![0.3f32; 64 * 64];
        let q = Quantize::default();
        let Pixels::U8(all) = q.apply(&values, &at(64, 1, None), PixelType::U8) else { panic!() };
        let mean = all.iter().map(|v| f64::from(*v)).sum::<f64>() / 4096.0;
        assert!((mean - 0.3 * 255.0).abs() < 0.05, "{mean}");
        assert!(all.contains(&76) && all.contains(&77));
        let part = Placement { x: 10, y: 20, ..at(5, 1, None) };
        let Pixels::U8(cut) = q.apply(&values[..15], &part, PixelType::U8) else { panic!() };
        for (i, v) in cut.iter().enumerate() {
            assert_eq!(*v, all[(20 + i / 5) * 64 + 10 + i % 5]);
        }
    }

    #[test]
    fn values_that_are_not_finite_are_quantized_within_limits() {
        let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -3.0, 1e30];
        let q = Quantize { zero: 16, one: 235, min: 1, max: 254, dither: 0.0, ..Quantize::default() };
        let Pixels::U8(got) = q.apply(&odd, &at(5, 1, None), PixelType::U8) else { panic!() };
        assert_eq!(got, [16, 254, 1, 1, 254]);
        // The cases are a maximum below the minimum, and a width of zero.
        let q = Quantize { min: 10, max: 0, ..q };
        let Pixels::U8(got) = q.apply(&odd, &at(0, 0, None), PixelType::U8) else { panic!() };
        assert_eq!(got, [10; 5]);
    }

    #[test]
    fn exposure_does_not_change_alpha() {
        let q = Quantize { gain: 0.5, gamma: 2.0, ..Quantize::FLOAT };
        let got = q.apply(&[0.5, 0.5, -1.0, 0.5], &at(2, 2, Some(1)), PixelType::Float);
        assert_eq!(got, Pixels::Float(vec![0.5, 0.5, -0.5, 0.5]));
    }

    #[test]
    fn quantization_is_read_from_parameters() {
        let mut p = Params::new();
        p.set(Param::declared("int[4] quantize", &[0, 65535, 0, 65535][..]).unwrap());
        p.set(Param::declared("float dither", 0.0).unwrap());
        p.set(Param::declared("float gamma", -1.0).unwrap());
        let q = Quantize::from_params(&p);
        assert_eq!(q, Quantize { one: 65535, max: 65535, dither: 0.0, ..Quantize::default() });
        // Floats are converted to the declared integers.
        p.set(Param::declared("float[4] quantize", &[0.0, 0.0, 0.0, 0.0][..]).unwrap());
        assert_eq!(Quantize::from_params(&p).pixel_type(), PixelType::Float);
    }
}
