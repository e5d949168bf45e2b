//! How fine surfaces become in the time that is left for an image (see [`crate::passes`]).

use crate::passes::PILOT;

/// The power of the number of passes by which squared noise is expected to fall. (It is 1 to 1.7.)
const POWER: f64 = 1.25;

/// The part of the time left in which [`PILOT`] or more passes of finer surfaces must fit. Their time is not known
/// before.
const USED: f64 = 0.8;

/// The part of the squared error that finer surfaces must leave at most to be worth the passes that are lost.
const WORTH: f64 = 0.8;

/// The parts of the squared error of an image, over the square of its mean.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Parts {
    pub(crate) noise: f64,
    pub(crate) bias: f64,
    /// The part of the noise of a pass that is left on the next level. Finer surfaces have more points, which draw
    /// random numbers.
    pub(crate) left: f64,
}

impl Parts {
    /// Returns the largest squared error of images.
    pub(crate) fn largest(all: &[Self]) -> f64 {
        all.iter().map(|parts| parts.noise + parts.bias).fold(0.0, f64::max)
    }
}

/// The time of a pass in seconds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PassTime {
    /// The part that does not depend on the number of points.
    fixed: f64,
    of_points: f64,
}

impl PassTime {
    /// Returns it for a pass that takes `here`, where one that is some levels `below` takes the other time.
    pub(crate) fn new(here: f64, (below, levels): (f64, i32)) -> Self {
        let of_points = (here - below) / (1.0 - 4.0_f64.powi(-levels));
        let of_points = of_points.clamp(0.05 * here, here);
        Self { fixed: here - of_points, of_points }
    }

    /// Returns the seconds of a pass some levels above.
    pub(crate) fn above(self, levels: i32) -> f64 {
        self.fixed + self.of_points * 4.0_f64.powi(levels)
    }
}

/// Returns the part of the bias that is expected some levels above. (It was 0.26 to 0.44 a level in five scenes.)
pub(crate) fn left_of_bias(levels: i32) -> f64 {
    0.4_f64.powi(levels)
}

/// Returns the number of levels by which surfaces become finer, at most `most`, for the least error after the seconds
/// that are left. `parts` are those of each image after [`PILOT`] passes.
pub(crate) fn best_levels(parts: &[Parts], time: PassTime, left: f64, most: i32) -> i32 {
    let squared = |levels: i32| {
        let fit = left / time.above(levels);
        let passes = if levels == 0 { f64::from(PILOT) + fit.floor() } else { (USED * fit).floor() };
        if levels > 0 && passes < f64::from(PILOT) {
            return f64::INFINITY;
        }
        let remains = libm::pow(passes / f64::from(PILOT), -POWER);
        let after = |parts: &Parts| Parts {
            noise: parts.noise * remains * parts.left.powi(levels),
            bias: parts.bias * left_of_bias(levels).powi(2),
            ..*parts
        };
        Parts::largest(&parts.iter().map(after).collect::<Vec<Parts>>())
    };
    let best = (0..=most).min_by(|a, b| squared(*a).total_cmp(&squared(*b))).unwrap_or(0);
    if squared(best) < WORTH * squared(0) { best } else { 0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn surfaces_are_as_fine_as_the_time_left_permits() {
        let time = PassTime::new(1.0, (0.25, 1));
        assert_eq!([0, 1, 2].map(|levels| time.above(levels)), [1.0, 4.0, 16.0]);
        assert_eq!(PassTime::new(1.0, (1.5, 1)).above(1), 0.95 + 0.2);
        let best = |noise: f64, bias: f64, left: f64| {
            best_levels(&[Parts { noise, bias, left: 1.0 }], time, left, 3)
        };
        // Where noise is most of the error, there are more passes, and where it is bias, finer ones.
        assert_eq!([10.0, 100.0, 1e4].map(|left| best(1e-2, 1e-6, left)), [0; 3]);
        assert_eq!([9.0, 14.0, 60.0, 300.0, 1e4].map(|left| best(1e-6, 1e-2, left)), [0, 1, 2, 3, 3]);
        assert_eq!([20.0, 200.0, 2000.0].map(|left| best(1e-4, 1e-4, left)), [1, 2, 2]);
        let of_shading =
            [1.0, 0.4].map(|left| best_levels(&[Parts { noise: 1e-2, bias: 1e-3, left }], time, 50.0, 3));
        assert_eq!(of_shading, [0, 1]);
        // An image without error needs nothing.
        assert_eq!(best(0.0, 0.0, 100.0), 0);
    }
}
