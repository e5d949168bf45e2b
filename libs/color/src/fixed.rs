//! Functions of three values with definitions of their own.

use crate::aces;
use crate::transform::Fixed;
use granita_base::math::pow;

/// Applies a function, or its inverse.
pub(crate) fn apply(fixed: Fixed, inverse: bool, rgb: [f32; 3]) -> [f32; 3] {
    match fixed {
        Fixed::GamutCompression(params) => compress(&params, inverse, rgb),
        Fixed::Glow(gain, middle) => aces::glow(gain, middle, inverse, rgb),
        Fixed::RedModifier => aces::red_modifier(inverse, rgb),
        Fixed::DarkToDim => aces::dark_to_dim(inverse, rgb),
        Fixed::Surround(gamma) => {
            let gamma = if inverse { 1.0 / gamma } else { gamma };
            let y = 0.2627 * rgb[0] + 0.6780 * rgb[1] + 0.0593 * rgb[2];
            let y = f64::from(y.abs().max(1e-4));
            // The power is computed of a value that is not negative: y ^ (gamma - 1) = y ^ gamma / y.
            let scale = (f64::from(pow(y as f32, gamma)) / y) as f32;
            rgb.map(|v| v * scale)
        }
        Fixed::XyzToXyy if inverse => {
            let [x, y, luminance] = rgb;
            let d = if y == 0.0 { 0.0 } else { luminance / y };
            [x * d, luminance, (1.0 - x - y) * d]
        }
        Fixed::XyzToXyy => {
            let [x, y, z] = rgb;
            let sum = x + y + z;
            let d = if sum == 0.0 { 0.0 } else { 1.0 / sum };
            [x * d, y * d, y]
        }
        Fixed::XyzToUvy if inverse => {
            let [u, v, luminance] = rgb;
            let d = if v == 0.0 { 0.0 } else { 1.0 / v };
            [2.25 * luminance * u * d, luminance, luminance * (3.0 - 0.75 * u - 5.0 * v) * d]
        }
        Fixed::XyzToUvy => {
            let [x, y, z] = rgb;
            let sum = x + 15.0 * y + 3.0 * z;
            let d = if sum == 0.0 { 0.0 } else { 1.0 / sum };
            [4.0 * x * d, 9.0 * y * d, y]
        }
    }
}

/// Moves colours towards the achromatic axis where their distance from it exceeds thresholds (AMPAS S-2020-001).
fn compress(params: &[f64; 7], inverse: bool, rgb: [f32; 3]) -> [f32; 3] {
    let achromatic = rgb[0].max(rgb[1]).max(rgb[2]);
    if achromatic == 0.0 {
        return [0.0; 3];
    }
    if !achromatic.is_finite() {
        return rgb;
    }
    let scale = f64::from(achromatic.abs());
    let power = params[6];
    [0, 1, 2].map(|c| {
        let (limit, threshold) = (params[c], params[3 + c]);
        let distance = (f64::from(achromatic) - f64::from(rgb[c])) / scale;
        // Without a limit beyond 1 or below the threshold nothing changes.
        if distance.is_nan() || distance < threshold || limit < 1.0001 {
            return rgb[c];
        }
        let raise = |x: f64, y: f64| f64::from(pow(x as f32, y));
        let inner = 1.0 / raise((1.0 - threshold) / (limit - threshold), power) - 1.0;
        let range = (limit - threshold) / raise(inner, 1.0 / power);
        let normal = (distance - threshold) / range;
        let raised = raise(normal, power);
        let moved = if !inverse {
            threshold + range * normal / raise(1.0 + raised, 1.0 / power)
        } else if distance > threshold + range {
            return rgb[c];
        } else {
            threshold + range * raise(raised / (1.0 - raised), 1.0 / power)
        };
        (f64::from(achromatic) - moved * scale) as f32
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const ACES: Fixed = Fixed::GamutCompression([1.147, 1.264, 1.312, 0.815, 0.803, 0.88, 1.2]);

    #[test]
    fn gamut_compression_has_its_limits() {
        // A colour at the distance limit of cyan reaches the border of the gamut, and colours inside stay.
        let got = apply(ACES, false, [-0.147, 1.0, 0.9]);
        assert!(got[0].abs() < 1e-5 && got[1] == 1.0 && got[2] == 0.9, "{got:?}");
        for rgb in [[0.5, 0.4, 0.3], [0.0, 0.0, 0.0], [f32::INFINITY, 0.0, 0.0]] {
            assert_eq!(apply(ACES, false, rgb), rgb);
        }
        assert!(apply(ACES, false, [f32::NAN, 0.5, 0.5])[0].is_nan());
    }

    #[test]
    fn chromaticities_of_black_are_zero() {
        for fixed in [Fixed::XyzToXyy, Fixed::XyzToUvy] {
            for inverse in [false, true] {
                assert_eq!(apply(fixed, inverse, [0.0; 3]), [0.0; 3]);
            }
        }
        let white = apply(Fixed::XyzToXyy, false, [0.950_455_9, 1.0, 1.089_057_8]);
        assert!((white[0] - 0.3127).abs() < 1e-5 && (white[1] - 0.329).abs() < 1e-5 && white[2] == 1.0);
    }

    #[test]
    fn surrounds_keep_ratios() {
        let got = apply(Fixed::Surround(1.0 / 1.2), false, [1.0, 0.5, 0.2]);
        assert!((got[0] - 1.084_818_7).abs() < 1e-5 && (got[1] / got[0] - 0.5).abs() < 1e-6, "{got:?}");
    }
}
