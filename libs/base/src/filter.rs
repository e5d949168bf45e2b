//! Reconstruction filters by name (reference 4.2), shared by film and texture making.

use std::f32::consts::PI;

/// The shape of a one-dimensional filter. Two-dimensional filters are products of two.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Filter {
    /// exp(-2 x^2) over the width; the default.
    Gaussian,
    /// A constant.
    Box,
    /// A tent.
    Triangle,
    /// Cubic interpolation. The width only windows it (best 4).
    CatmullRom,
    /// A windowed sinc. The width only windows it (best a whole number).
    Sinc,
    /// A four-term cosine window.
    BlackmanHarris,
    /// The cubic of Mitchell and Netravali, B = C = 1/3.
    Mitchell,
    /// The cubic B-spline.
    BSpline,
}

impl Filter {
    /// All filters, in the order of the reference.
    pub const ALL: [Self; 8] = [
        Self::Gaussian,
        Self::Box,
        Self::Triangle,
        Self::CatmullRom,
        Self::Sinc,
        Self::BlackmanHarris,
        Self::Mitchell,
        Self::BSpline,
    ];

    /// Returns the name used in scene files.
    pub fn word(self) -> &'static str {
        match self {
            Self::Gaussian => "gaussian",
            Self::Box => "box",
            Self::Triangle => "triangle",
            Self::CatmullRom => "catmull-rom",
            Self::Sinc => "sinc",
            Self::BlackmanHarris => "blackman-harris",
            Self::Mitchell => "mitchell",
            Self::BSpline => "b-spline",
        }
    }

    /// Returns the filter of a name.
    pub fn from_word(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|f| f.word() == word)
    }

    /// Returns the width in pixels at which the shape is complete.
    pub fn natural_width(self) -> f32 {
        match self {
            Self::Box => 1.0,
            Self::Gaussian | Self::Triangle => 2.0,
            Self::BlackmanHarris => 3.0,
            Self::CatmullRom | Self::Sinc | Self::Mitchell | Self::BSpline => 4.0,
        }
    }

    /// Returns the weight at distance `x` from the centre for a filter of full width `width` (both in pixels). It is
    /// not normalised, and 0 outside of `[-width/2, width/2]`.
    pub fn weight(self, x: f32, width: f32) -> f32 {
        let half = width * 0.5;
        let x = x.abs();
        if x.is_nan() || x > half || half <= 0.0 {
            return 0.0;
        }
        // `r` runs from 0 at the centre to 1 at the edge.
        let r = x / half;
        match self {
            Self::Gaussian => libm::expf(-2.0 * r * r),
            Self::Box => 1.0,
            Self::Triangle => 1.0 - r,
            Self::CatmullRom => cubic(x, 0.0, 0.5),
            Self::Mitchell => cubic(2.0 * r, 1.0 / 3.0, 1.0 / 3.0),
            Self::BSpline => cubic(2.0 * r, 1.0, 0.0),
            Self::Sinc => sinc(x) * sinc(r),
            Self::BlackmanHarris => {
                let t = PI * r;
                0.35875
                    + 0.48829 * libm::cosf(t)
                    + 0.14128 * libm::cosf(2.0 * t)
                    + 0.01168 * libm::cosf(3.0 * t)
            }
        }
    }
}

/// Returns sin(pi x) / (pi x).
pub fn sinc(x: f32) -> f32 {
    if x < 1e-4 { 1.0 } else { libm::sinf(PI * x) / (PI * x) }
}

/// Returns the two-parameter cubic of Mitchell and Netravali (Reconstruction Filters in Computer Graphics, SIGGRAPH
/// 1988, eq. 8), not normalised, zero beyond 2.
pub fn cubic(x: f32, b: f32, c: f32) -> f32 {
    if x < 1.0 {
        ((12.0 - 9.0 * b - 6.0 * c) * x * x * x + (-18.0 + 12.0 * b + 6.0 * c) * x * x + (6.0 - 2.0 * b))
            / 6.0
    } else if x < 2.0 {
        ((-b - 6.0 * c) * x * x * x
            + (6.0 * b + 30.0 * c) * x * x
            + (-12.0 * b - 48.0 * c) * x
            + (8.0 * b + 24.0 * c))
            / 6.0
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filters_have_unique_words_and_are_zero_outside_of_their_width() {
        for f in Filter::ALL {
            assert_eq!(Filter::from_word(f.word()), Some(f));
            let w = f.natural_width();
            assert!(f.weight(0.0, w) > 0.0);
            assert_eq!(f.weight(w * 0.5 + 1e-3, w), 0.0);
            assert_eq!(f.weight(0.3, w), f.weight(-0.3, w));
            assert_eq!(f.weight(f32::NAN, w), 0.0);
            assert_eq!(f.weight(0.0, 0.0), 0.0);
        }
    }

    #[test]
    fn interpolating_filters_vanish_at_other_pixels() {
        for f in [Filter::CatmullRom, Filter::Sinc] {
            assert!((f.weight(0.0, 4.0) - 1.0).abs() < 1e-6);
            assert!(f.weight(1.0, 4.0).abs() < 1e-6, "{f:?}");
        }
    }

    #[test]
    fn cubics_are_partitions_of_unity() {
        for f in [Filter::CatmullRom, Filter::Mitchell, Filter::BSpline, Filter::Triangle] {
            for i in 0..10 {
                let x = i as f32 / 10.0;
                let w = f.natural_width();
                let sum: f32 = (-3..=3).map(|k| f.weight(x + k as f32, w)).sum();
                assert!((sum - 1.0).abs() < 1e-5, "{f:?} {x} {sum}");
            }
        }
    }
}
