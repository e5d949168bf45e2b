//! How fine surfaces, and how large passes become in the time that is left for an image (see [`crate::passes`]).

use crate::accuracy::SquaredBias;
use crate::larger::Larger;
use crate::passes::PILOT;
use std::time::Duration;

/// The power of the number of passes by which squared noise is expected to fall. (It is 1 to 1.7.)
const POWER: f64 = 1.25;

/// The part of the time left in which other passes must fit. Their time is not known before.
const USED: f64 = 0.9;

/// The part of the squared error that other passes must leave at most to be worth those that are lost.
const WORTH: f64 = 0.8;

/// The parts of the squared error of an image, over the square of its mean.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Parts {
    pub(crate) noise: f64,
    pub(crate) bias: f64,
    /// The part of the noise of a pass that is left on the next level. Finer surfaces have more points, which draw
    /// random numbers.
    pub(crate) left: f64,
    /// The part of the noise that comes from the samples of pixels.
    pub(crate) of_pixels: f64,
}

impl Parts {
    /// Returns the part of the noise that comes from the samples of pixels some levels above. It stays while that of
    /// shading falls.
    pub(crate) fn of_pixels_above(&self, levels: i32) -> f64 {
        (self.of_pixels / self.left.powi(levels)).min(1.0)
    }

    /// Returns those of an image of as many other passes.
    pub(crate) fn with(&self, (levels, larger): Other) -> Self {
        let of_larger = larger.left(self.of_pixels_above(levels), 0);
        let bias = self.bias * left_of_bias(levels).powi(2);
        Self { noise: self.noise * self.left.powi(levels) * of_larger, bias, ..*self }
    }

    /// Returns the largest squared error of images.
    pub(crate) fn largest(all: &[Self]) -> f64 {
        Self::largest_after(all, PILOT.into())
    }

    /// Returns the same after a number of passes, for parts that are those after [`PILOT`].
    pub(crate) fn largest_after(all: &[Self], passes: f64) -> f64 {
        let remains = libm::pow(passes / f64::from(PILOT), -POWER);
        all.iter().map(|parts| parts.noise * remains + parts.bias).fold(0.0, f64::max)
    }
}

/// What the passes that follow are rendered with: by how many levels surfaces become finer, and how many samples the
/// passes have.
pub(crate) type Other = (i32, Larger);

/// The time of a pass in seconds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PassTime {
    /// The part that does not depend on the number of points.
    fixed: f64,
    of_points: f64,
    /// The part of `fixed` that is in proportion to the number of samples of pixels.
    hiding: f64,
    /// True when shading draws random numbers, so that most of `of_points` is in proportion to how many.
    is_drawn: bool,
}

impl PassTime {
    /// Returns it for a pass that takes `here`, where one that is some levels `below` takes the other time.
    pub(crate) fn new(here: f64, (below, levels): (f64, i32), is_drawn: bool) -> Self {
        let of_points = (here - below) / (1.0 - 4.0_f64.powi(-levels));
        let of_points = of_points.clamp(0.05 * here, here);
        let fixed = here - of_points;
        Self { fixed, of_points, hiding: fixed.min(Larger::of_hiding(is_drawn) * here), is_drawn }
    }

    /// Returns the time of a pass as it is.
    pub(crate) fn here(self) -> Duration {
        Duration::from_secs_f64(self.fixed + self.of_points)
    }

    /// Returns the seconds of a pass some levels above that may be larger.
    pub(crate) fn of(self, (levels, Larger { pixels, shading }): Other) -> f64 {
        let power = |exponent: u32| 4.0_f64.powi(exponent.cast_signed());
        let drawn = if self.is_drawn { power(shading) } else { 1.0 };
        let hiding = self.hiding * (power(pixels) - 1.0);
        self.fixed + hiding + self.of_points * 4.0_f64.powi(levels) * drawn
    }
}

/// The part of the bias that is expected on the next level. (It was 0.26 to 0.44 in five scenes, of which this is the
/// middle.)
const FALL: f64 = 0.34;

/// Returns the part of the bias that is expected some levels above.
fn left_of_bias(levels: i32) -> f64 {
    FALL.powi(levels)
}

/// Returns the bias before a change by some levels, and the one after it.
pub(crate) fn around(change: SquaredBias, levels: i32) -> [SquaredBias; 2] {
    let left = left_of_bias(levels);
    [1.0, left].map(|part| change.scaled((part / (1.0 - left)).powi(2)))
}

/// Returns the passes that have the least error after the seconds that are left, of at most `most` levels above and the
/// possible samples. `parts` are those of each image after [`PILOT`] passes.
pub(crate) fn best(parts: &[Parts], time: PassTime, left: f64, (most, possible): (i32, &[Larger])) -> Other {
    let stay = (0, Larger::default());
    let squared = |other: &Other| {
        let fit = left / time.of(*other);
        let passes = if *other == stay { f64::from(PILOT) + fit.floor() } else { (USED * fit).floor() };
        if passes < 1.0 {
            return f64::INFINITY;
        }
        let with: Vec<Parts> = parts.iter().map(|parts| parts.with(*other)).collect();
        Parts::largest_after(&with, passes)
    };
    let of_level = |levels| possible.iter().map(move |larger| (levels, *larger));
    // The first of equal ones, which is the smallest, is chosen.
    let best = (0..=most).flat_map(of_level).min_by(|a, b| squared(a).total_cmp(&squared(b)));
    best.filter(|best| squared(best) < WORTH * squared(&stay)).unwrap_or(stay)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the number of levels and the powers of samples that are best for an image.
    fn chosen(parts: Parts, time: PassTime, left: f64, possible: &[Larger]) -> (i32, [u32; 2]) {
        let (levels, Larger { pixels, shading }) = best(&[parts], time, left, (3, possible));
        (levels, [pixels, shading])
    }

    #[test]
    fn surfaces_are_as_fine_as_the_time_left_permits() {
        let time = PassTime::new(1.0, (0.25, 1), false);
        let alone = [Larger::default()];
        assert_eq!([0, 1, 2].map(|levels| time.of((levels, alone[0]))), [1.0, 4.0, 16.0]);
        assert_eq!(PassTime::new(1.0, (1.5, 1), false).of((1, alone[0])), 0.95 + 0.2);
        let levels = |noise: f64, bias: f64, left: f64| {
            chosen(Parts { noise, bias, left: 1.0, of_pixels: 1.0 }, time, left, &alone).0
        };
        // Where noise is most of the error, there are more passes, and where it is bias, finer ones.
        assert_eq!([10.0, 100.0, 1e4].map(|left| levels(1e-2, 1e-6, left)), [0; 3]);
        assert_eq!([4.0, 14.0, 60.0, 300.0, 1e4].map(|left| levels(1e-6, 1e-2, left)), [0, 1, 2, 3, 3]);
        assert_eq!([20.0, 200.0, 2000.0].map(|left| levels(1e-4, 1e-4, left)), [1, 2, 2]);
        let of_shading = [1.0, 0.4].map(|left| {
            let parts = Parts { noise: 1e-2, bias: 1e-3, left, ..Parts::default() };
            chosen(parts, time, 50.0, &alone).0
        });
        assert_eq!(of_shading, [0, 1]);
        // An image without error needs nothing.
        assert_eq!(levels(0.0, 0.0, 100.0), 0);
    }

    #[test]
    fn a_change_shows_the_bias_on_both_sides_of_it() {
        let change = SquaredBias { value: 0.25, ..SquaredBias::default() };
        for levels in [1, 2] {
            let [before, after] = around(change, levels).map(|bias| bias.root());
            assert!((before - after - 0.5).abs() < 1e-9 && (after / before - FALL.powi(levels)).abs() < 1e-9);
        }
    }

    #[test]
    fn passes_are_as_large_as_the_time_left_permits() {
        let all = Larger::possible([4; 2]);
        // A pass takes 1 s, of which 0.4 s hide surfaces.
        let time = PassTime::new(1.0, (0.7, 1), false);
        let larger = |pixels| (0, Larger { pixels, shading: 0 });
        let taken = [0, 1, 2].map(|pixels| time.of(larger(pixels)));
        assert!(taken.iter().zip([1.0, 2.2, 7.0]).all(|(a, b)| (a - b).abs() < 1e-12), "{taken:?}");
        let of_pixels = |left: f64, bias: f64| {
            chosen(Parts { noise: 1e-2, bias, left: 1.0, of_pixels: 1.0 }, time, left, &all)
        };
        let without_bias = [2.0, 7.7, 40.0].map(|left| of_pixels(left, 0.0));
        assert_eq!(without_bias, [(0, [0, 0]), (0, [1, 0]), (0, [2, 0])]);
        // Both errors fall.
        assert_eq!([8.0, 40.0].map(|left| of_pixels(left, 1e-2)), [(1, [1, 0]), (2, [2, 0])]);
        // Noise of lights and rays needs their samples, which take most of the time.
        let drawn = PassTime::new(1.0, (0.7, 1), true);
        let of_shading = |of_pixels: f64, left: f64| {
            chosen(Parts { noise: 1e-2, bias: 0.0, left: 1.0, of_pixels }, drawn, left, &all).1
        };
        assert_eq!([2.0, 7.7, 200.0].map(|left| of_shading(0.0, left)), [[0, 0], [0, 1], [0, 2]]);
        assert_eq!(of_shading(0.9, 200.0), [2, 1]);
        // Memory limits the samples of pixels.
        assert_eq!(Larger::possible([8, 2]).iter().map(|larger| larger.pixels).max(), Some(1));
    }
}
