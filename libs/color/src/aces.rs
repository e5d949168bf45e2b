//! The output transforms of ACES 1 for screens of standard range (Academy S-2014-004 and TB-2014-004 to -014; the
//! reference implementation 1.0.3, `RRT.ctl` and `ODT.Academy.*`).
//!
//! The rendering transform moves reds and adds a glow in ACES2065-1, takes colour away in AP1, and ends with a curve of
//! each channel. The curve of the screen follows. Both curves are quadratic splines of logarithms.

use granita_base::math::{exp2, log2, pow};

/// A spline of the logarithms of light, to the base 10. Its knots are evenly spaced below and above the middle.
struct Spline<const N: usize> {
    /// The lowest, the middle and the highest point.
    points: [(f64, f64); 3],
    /// The coefficients below and above the middle.
    low: [f64; N],
    high: [f64; N],
    /// The slope above the highest point. Below the lowest one it is 0.
    end: f64,
}

/// The logarithm of 0.18.
const GREY: f64 = -0.744_727_494_896_693_9;
/// The logarithm of 2.
const STOP: f64 = std::f64::consts::LOG10_2;
/// The logarithm of 4.8, the light of grey on the screens for which the curves are defined, in cd/m2.
const MIDDLE: f64 = 0.681_241_237_375_587_2;

/// The curve of the rendering transform.
const RENDERING: Spline<6> = Spline {
    points: [(GREY - 15.0 * STOP, -4.0), (GREY, MIDDLE), (GREY + 18.0 * STOP, 4.0)],
    low: [-4.0, -4.0, -3.157_376_577_3, -0.485_249_995_8, 1.847_732_470_6, 1.847_732_470_6],
    high: [-0.718_548_242_5, 2.081_030_717_2, 3.668_124_123_7, 4.0, 4.0, 4.0],
    end: 0.0,
};

/// The curve of a screen of 48 cd/m2. Its lowest and highest points are 6.5 stops below and above grey.
const SCREEN: Spline<10> = Spline {
    points: [
        (-2.540_623_618_854, -1.698_970_004_336_018_8),
        (MIDDLE, MIDDLE),
        (3.002_476_810_122_9, 1.681_241_237_375_587_2),
    ],
    low: [
        -1.698_970_004_3,
        -1.698_970_004_3,
        -1.4779,
        -1.2291,
        -0.8648,
        -0.448,
        0.005_18,
        0.451_108_033_4,
        0.911_374_441_4,
        0.911_374_441_4,
    ],
    high: [
        0.515_438_696_5,
        0.847_043_777_8,
        1.1358,
        1.3802,
        1.5197,
        1.5985,
        1.6467,
        1.674_609_135_7,
        1.687_873_339,
        1.687_873_339,
    ],
    end: 0.04,
};

/// The light of white and of black of such a screen, in cd/m2.
const WHITE: f64 = 48.0;
const BLACK: f64 = 0.02;

impl<const N: usize> Spline<N> {
    /// Returns the quadratic polynomial of a part: `a t^2 + b t + c`.
    fn part(of: &[f64; N], j: usize) -> [f64; 3] {
        let [p, q, r] = [of[j], of[j + 1], of[j + 2]];
        [0.5 * p - q + 0.5 * r, q - p, 0.5 * (p + q)]
    }

    fn value(&self, x: f64) -> f64 {
        let [low, middle, high] = self.points;
        let (of, start, end) = match x {
            x if x <= low.0 => return low.1,
            x if x >= high.0 && self.end > 0.0 => return high.1 + self.end * (x - high.0),
            x if x >= high.0 => return high.1,
            x if x < middle.0 => (&self.low, low.0, middle.0),
            _ => (&self.high, middle.0, high.0),
        };
        let parts = N - 3;
        let place = (x - start) / (end - start) * parts as f64;
        // NaN becomes the first part, and stays NaN.
        let j = (place as usize).min(parts - 1);
        let t = place - j as f64;
        let [a, b, c] = Self::part(of, j);
        (a * t + b) * t + c
    }

    fn inverse(&self, y: f64) -> f64 {
        let [low, middle, high] = self.points;
        let (of, start, end) = match y {
            y if y <= low.1 => return low.0,
            y if y >= high.1 && self.end > 0.0 => return high.0 + (y - high.1) / self.end,
            y if y >= high.1 => return high.0,
            y if y < middle.1 => (&self.low, low.0, middle.0),
            _ => (&self.high, middle.0, high.0),
        };
        let parts = N - 3;
        let mut j = 0;
        while j + 1 < parts && y >= 0.5 * (of[j + 1] + of[j + 2]) {
            j += 1;
        }
        let [a, b, c] = Self::part(of, j);
        let c = c - y;
        let root = (b * b - 4.0 * a * c).max(0.0).sqrt();
        let t = -2.0 * c / (b + root);
        start + (j as f64 + t) * (end - start) / parts as f64
    }
}

/// Returns the light of a screen, in fractions of its white, of linear light in AP1 after the rendering transform's
/// changes of colour.
pub(crate) fn tone(v: f32) -> f32 {
    // Light that is not positive is that of the smallest half.
    let v = if v > 0.0 { v } else { v.max(5.960_464_5e-8) };
    let seen = SCREEN.value(RENDERING.value(log2(v) * STOP));
    ((exp2(seen / STOP) - BLACK) / (WHITE - BLACK)) as f32
}

/// Returns the inverse of [`tone`].
pub(crate) fn tone_inverse(v: f32) -> f32 {
    let light = (f64::from(v) * (WHITE - BLACK) + BLACK).max(1e-10);
    exp2(RENDERING.inverse(SCREEN.inverse(log2(light as f32) * STOP)) / STOP) as f32
}

fn largest([r, g, b]: [f64; 3]) -> f64 {
    r.max(g).max(b)
}

/// Returns the saturation of a colour in ACES2065-1: 0 for greys.
fn saturation(rgb: [f64; 3]) -> f64 {
    let least = rgb[0].min(rgb[1]).min(rgb[2]);
    (largest(rgb).max(1e-10) - least.max(1e-10)) / largest(rgb).max(1e-2)
}

/// Adds light to dark colours by their saturation. `gain` is the largest share, and `middle` the luminance of colours
/// that get half of it.
pub(crate) fn glow(gain: f64, middle: f64, inverse: bool, rgb: [f32; 3]) -> [f32; 3] {
    let [r, g, b] = rgb.map(f64::from);
    let chroma = (b * (b - g) + g * (g - r) + r * (r - b)).max(0.0).sqrt();
    let luminance = (b + g + r + 1.75 * chroma) / 3.0;
    let x = (saturation([r, g, b]) - 0.4) / 0.2;
    let t = (1.0 - (0.5 * x).abs()).max(0.0);
    let share = 0.5 * (1.0 + 1.0_f64.copysign(x) * (1.0 - t * t));
    let gain = gain * share;
    let scale = match inverse {
        false if luminance <= middle * 2.0 / 3.0 => gain,
        false if luminance < 2.0 * middle => gain * (middle / luminance - 0.5),
        true if luminance <= (1.0 + gain) * middle * 2.0 / 3.0 => -gain / (1.0 + gain),
        true if luminance < 2.0 * middle => gain * (middle / luminance - 0.5) / (0.5 * gain - 1.0),
        _ => 0.0,
    };
    rgb.map(|v| (f64::from(v) * (1.0 + scale)) as f32)
}

/// Returns how red a hue is: 1 for red, 0 from 67.5 degrees away.
fn redness([r, g, b]: [f64; 3]) -> f64 {
    const WIDTH: f64 = 135.0;
    let hue = libm::atan2(3.0_f64.sqrt() * (g - b), 2.0 * r - g - b).to_degrees();
    let place = (hue + 0.5 * WIDTH) * 4.0 / WIDTH;
    // A cubic B-spline of four parts.
    let t = place.fract();
    let found = match place {
        place if place <= 0.0 || place >= 4.0 => 0.0,
        place if place < 1.0 => t * t * t,
        place if place < 2.0 => ((-3.0 * t + 3.0) * t + 3.0) * t + 1.0,
        place if place < 3.0 => (3.0 * t - 6.0) * t * t + 4.0,
        _ => ((3.0 - t) * t - 3.0) * t + 1.0,
    };
    found / 4.0
}

/// Moves saturated reds towards a pivot.
pub(crate) fn red_modifier(inverse: bool, rgb: [f32; 3]) -> [f32; 3] {
    const PIVOT: f64 = 0.03;
    const SCALE: f64 = 0.82;
    let wide = rgb.map(f64::from);
    let weight = redness(wide) * (1.0 - SCALE);
    if weight <= 0.0 || !weight.is_finite() {
        return rgb;
    }
    let [red, green, blue] = wide;
    let moved = if inverse {
        // Red is the largest channel here, so that its saturation is known from the smallest one.
        let least = green.min(blue);
        let (a, b, c) = (weight - 1.0, red - weight * (PIVOT + least), weight * PIVOT * least);
        (-b - (b * b - 4.0 * a * c).max(0.0).sqrt()) / (2.0 * a)
    } else {
        red + weight * saturation(wide) * (PIVOT - red)
    };
    [moved as f32, rgb[1], rgb[2]]
}

/// Changes colours in AP1 that were made for dark surroundings to ones for dim surroundings: the luminance to a power,
/// with the ratios of colours kept.
pub(crate) fn dark_to_dim(inverse: bool, rgb: [f32; 3]) -> [f32; 3] {
    const POWER: f64 = 0.9811;
    let [r, g, b] = rgb.map(f64::from);
    let luminance = 0.272_228_716_780_914_5 * r + 0.674_081_765_811_148_3 * g + 0.053_689_517_407_937_06 * b;
    let luminance = luminance.max(1e-10) as f32;
    let power = if inverse { 1.0 / POWER } else { POWER };
    let scale = f64::from(pow(luminance, power)) / f64::from(luminance);
    rgb.map(|v| (f64::from(v) * scale) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn splines_pass_through_their_points() {
        for (x, y) in RENDERING.points {
            assert!((RENDERING.value(x) - y).abs() < 1e-6, "{x} {y} {}", RENDERING.value(x));
        }
        for (x, y) in SCREEN.points {
            assert!((SCREEN.value(x) - y).abs() < 1e-6, "{x} {y} {}", SCREEN.value(x));
        }
        // The ends of the second curve are 6.5 stops from grey, after the first one.
        for (stops, (x, _)) in [(-6.5, SCREEN.points[0]), (6.5, SCREEN.points[2])] {
            assert!((RENDERING.value(GREY + stops * STOP) - x).abs() < 1e-9, "{stops}");
        }
    }

    #[test]
    fn greys_have_the_light_of_the_reference_implementation() {
        // Grey has 4.8 of 48 cd/m2, and black that of the screen.
        assert!((tone(0.18) - (4.8 - 0.02) / 47.98).abs() < 1e-6);
        assert!(tone(0.0).abs() < 1e-6 && tone(-1.0).abs() < 1e-6 && tone(f32::NAN).abs() < 1e-6);
        assert!((tone(16.3) - 0.999_44).abs() < 1e-3, "{}", tone(16.3));
        assert!(tone(1e4) > 1.0 && tone(f32::INFINITY).is_finite());
        assert_eq!(redness([1.0, 0.0, 0.0]), 1.0);
        assert_eq!(redness([0.0, 1.0, 0.0]), 0.0);
    }

    proptest! {
        #[test]
        fn the_way_back_is_the_inverse(r in 0.001_f32..4.0, g in 0.001_f32..4.0, b in 0.001_f32..4.0) {
            let near = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 2e-5 * b.abs().max(0.01));
            let rgb = [r, g, b];
            prop_assert!(near(dark_to_dim(true, dark_to_dim(false, rgb)), rgb));
            let tones = rgb.map(tone).map(tone_inverse);
            prop_assert!(tones.iter().zip(rgb).all(|(a, b)| (a - b).abs() <= 2e-3 * b), "{:?}", tones);
            let glowing = glow(0.05, 0.08, true, glow(0.05, 0.08, false, rgb));
            prop_assert!(near(glowing, rgb), "{:?}", glowing);
            // The hue is that of the result, so that only pure reds have an exact inverse.
            let red = [r + g + 0.01, g, g];
            prop_assert!(near(red_modifier(true, red_modifier(false, red)), red), "{:?}", red);
        }
    }
}
