//! How much larger passes become where an image with a requested error needs many of them.
//!
//! Samples of one pass are spread evenly, and those of several passes less so. So one pass with four times the samples
//! has less noise than four passes, and takes less time. Samples of pixels and those of lights and rays become more
//! each by itself: one more pass shows which of them the noise comes from.

use crate::passes::{PILOT, PassPlan};

/// The part of the squared noise of a pass that is left with four times the samples of pixels, and of lights and rays.
/// It would be a quarter if they were independent of each other. (On Stanford's dragon under a panorama, it was a
/// tenth.)
const LEFT: [f64; 2] = [1.0 / 8.0, 1.0 / 6.0];
/// The part of the squared noise of shading that is left with half of the dicing step, and so four times the points.
/// (In two scenes it was 0.38 and 0.45 from the coarse level, 0.2 to 0.4 from finer ones.)
const LEFT_OF_LEVEL: f64 = 0.4;
/// The largest number of samples along one side of a pixel. More would need too much memory.
const MOST_SAMPLES: u32 = 16;
/// The part of the noise that comes from the samples of pixels above which shading is taken to draw nothing.
const ALL: f64 = 0.95;

/// How many times the samples of a frame without passes the passes of an image have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Larger {
    /// They have `2^pixels` times the samples along each side of a pixel, from 0 to [`PassPlan::LARGEST`].
    pub(crate) pixels: u32,
    /// They have `4^shading` times the samples of lights and rays, from 0 to the same.
    pub(crate) shading: u32,
}

impl Larger {
    /// Returns those that are possible with a number of samples along the sides of a pixel, the smaller ones first.
    pub(crate) fn possible([x, y]: [u32; 2]) -> Vec<Self> {
        let of_pixels = |pixels| (0..=PassPlan::LARGEST).map(move |shading| Self { pixels, shading });
        let all = (0..=PassPlan::LARGEST).flat_map(of_pixels);
        all.filter(|larger| larger.pixels == 0 || x.max(y) << larger.pixels <= MOST_SAMPLES).collect()
    }

    /// Returns the part of the time of a pass that hides surfaces behind each other.
    pub(crate) fn of_hiding(is_drawn: bool) -> f64 {
        if is_drawn { 0.07 } else { 0.4 }
    }

    /// True when the passes have more samples of any kind.
    pub(crate) fn is_any(self) -> bool {
        self != Self::default()
    }

    /// Returns the approximate time of a pass over that of a pass of the scene's own accuracy and samples, where
    /// surfaces are `steps` times as fine.
    ///
    /// Of twelve scenes of 320 x 240 pixels, those whose shading draws random numbers take 0.01 to 0.1 of the time to
    /// hide surfaces behind each other, and the others 0.4. Half of the dicing step, and so four times the points, take
    /// 3 times the time.
    fn time(self, is_drawn: bool, steps: i32) -> f64 {
        let [fixed, shading] = if is_drawn { [0.13, 0.8] } else { [0.6, 0.0] };
        let hiding = Self::of_hiding(is_drawn);
        let power = |base: f64, exponent: u32| base.powi(exponent.cast_signed());
        let of_points = fixed + shading * power(4.0, self.shading);
        3.0_f64.powi(steps) * of_points + hiding * power(4.0, self.pixels)
    }

    /// Returns the factor of the samples of lights and rays.
    pub(crate) fn samples(self) -> f32 {
        4.0_f32.powi(self.shading.cast_signed())
    }

    /// Returns the part of the squared noise of a pass that is left `steps` levels above, of which the part `of_pixels`
    /// comes from the samples of pixels.
    pub(crate) fn left(self, of_pixels: f64, steps: i32) -> f64 {
        self.left_where(LEFT, (of_pixels, steps))
    }

    /// Returns the same as if all samples were independent of each other.
    pub(crate) fn left_of_independent(self, of_pixels: f64) -> f64 {
        self.left_where([0.25; 2], (of_pixels, 0))
    }

    /// Returns it for the parts that are left with four times the samples.
    fn left_where(self, [pixels, shading]: [f64; 2], (of_pixels, steps): (f64, i32)) -> f64 {
        let of_shading = shading.powi(self.shading.cast_signed()) * LEFT_OF_LEVEL.powi(steps);
        of_pixels * pixels.powi(self.pixels.cast_signed()) + (1.0 - of_pixels) * of_shading
    }
}

/// Returns the part of the noise that comes from the samples of pixels `steps` levels above, of what it is on a level.
pub(crate) fn of_pixels_above(of_pixels: f64, steps: i32) -> f64 {
    of_pixels / Larger::default().left(of_pixels, steps)
}

/// What an image needs for a requested error.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Need {
    /// The number of passes of the level on which noise was measured, with the scene's own samples.
    pub(crate) passes: f64,
    /// The part of its noise that comes from the samples of pixels.
    pub(crate) of_pixels: f64,
    /// The number of levels that the passes are above it.
    pub(crate) steps: i32,
}

/// Returns how large passes must be for all images to have the requested error in the least time. There are
/// [`PILOT`] passes which the image keeps if neither the samples nor the level change.
pub(crate) fn best(needs: &[Need], samples: [u32; 2]) -> Larger {
    let steps = needs.iter().map(|need| need.steps).max().unwrap_or(0);
    let is_drawn = needs.iter().any(|need| need.of_pixels < ALL);
    let time = |larger: &Larger| {
        let passes = needs.iter().map(|need| need.passes * larger.left(need.of_pixels, need.steps));
        let passes = passes.fold(f64::from(PILOT), f64::max);
        let kept = if larger.is_any() || steps > 0 { 0.0 } else { f64::from(PILOT) };
        (passes - kept) * larger.time(is_drawn, steps)
    };
    // The first of equal ones, which is the smallest, is chosen.
    Larger::possible(samples).into_iter().min_by(|a, b| time(a).total_cmp(&time(b))).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn larger(pixels: u32, shading: u32) -> Larger {
        Larger { pixels, shading }
    }

    #[test]
    fn samples_are_added_where_the_noise_comes_from() {
        let of = |passes: f64, of_pixels: f64| best(&[Need { passes, of_pixels, steps: 0 }], [4, 2]);
        assert_eq!([2.0, 3.0].map(|passes| of(passes, 1.0)), [larger(0, 0); 2]);
        assert_eq!([16.0, 100.0].map(|passes| of(passes, 1.0)), [larger(1, 0), larger(2, 0)]);
        assert_eq!(
            [6.0, 16.0, 100.0].map(|passes| of(passes, 0.0)),
            [larger(0, 0), larger(0, 1), larger(0, 2)]
        );
        // Samples of pixels cost little where shading is most of the time.
        assert_eq!(of(16.0, 0.5), larger(1, 1));
        assert_eq!(of(8.0, 0.8), larger(1, 0));
        // Memory limits them.
        assert_eq!(best(&[Need { passes: 100.0, of_pixels: 1.0, steps: 0 }], [4, 8]), larger(1, 0));
        // Finer surfaces have less noise of shading.
        let finer = |of_pixels| best(&[Need { passes: 8.0, of_pixels, steps: 1 }], [4; 2]);
        assert_eq!([0.0, 1.0].map(finer), [larger(0, 0), larger(1, 0)]);
        assert_eq!([0.0, 1.0].map(|of_pixels| of_pixels_above(of_pixels, 1)), [0.0, 1.0]);
        assert!((of_pixels_above(0.5, 1) - 0.5 / 0.7).abs() < 1e-12);
        // All images get what they need.
        let both = [1.0, 0.0].map(|of_pixels| Need { passes: 30.0, of_pixels, steps: 0 });
        assert_eq!(best(&both, [4; 2]), larger(1, 1));
    }
}
