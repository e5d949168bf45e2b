//! How accurately passes compute what all of them have in common, and the bias that is left (see [`crate::passes`]).

/// How accurately a frame computes what all its passes have in common, beside what the scene says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Accuracy {
    /// The factor of "shadingquality".
    pub(crate) dicing: f32,
    /// The factor of "maxerror" of records of indirect light and occlusion.
    pub(crate) tolerance: f32,
    /// The factor of the numbers of samples of lights and rays.
    pub(crate) samples: f32,
}

impl Accuracy {
    /// The part of the bias of [`Accuracy::SCENE`] by which [`Accuracy::finer`] differs from it (measured on five
    /// scenes, with a converged image and two passes of the whole image: 0.73 to 0.98). It is the most of the coarse
    /// level.
    pub(crate) const SHOWN: f64 = 0.8;
    /// The least part of the bias of the coarse level that [`Accuracy::finer`] is taken to show. (It was 0.5 to 0.9 in
    /// six scenes.)
    const LEAST_SHOWN: f64 = 0.44;
    /// How much more the accuracy above changes, squared, than the one below where surfaces are too coarse for what
    /// they show, and the part of the bias that it is then taken to show. (A tenth was seen of small highlights.)
    const GROWING: f64 = 1.25;
    const SHOWN_OF_GROWING: f64 = 0.1;

    /// Returns the squared part of the bias of a coarse image that [`Accuracy::finer`] shows. `change` is what the
    /// latter changes, squared, and `coarser` what the accuracy below changes, with the noise of that.
    ///
    /// What the accuracies change is taken to be independent of each other, and to fall by the same factor from each to
    /// the next. Where it grows, nothing is known of the rest, as of highlights that are smaller than the distance of
    /// points.
    pub(crate) fn shown_of_coarse(change: f64, (coarser, noise): (f64, f64)) -> f64 {
        let most = Self::SHOWN.powi(2);
        if Self::grows(change, (coarser, noise)) {
            Self::SHOWN_OF_GROWING.powi(2)
        } else if coarser <= 2.0 * noise {
            most
        } else {
            (1.0 - change / coarser).clamp(Self::LEAST_SHOWN.powi(2), most)
        }
    }

    /// True when the accuracy above a coarse image changes more than the one below.
    pub(crate) fn grows(change: f64, (coarser, noise): (f64, f64)) -> bool {
        coarser > 2.0 * noise && change / coarser > Self::GROWING
    }

    /// What the scene says.
    pub(crate) const SCENE: Self = Self { dicing: 1.0, tolerance: 1.0, samples: 1.0 };
    /// The part of the bias that remains on the next level, with half of the dicing step. Hard edges have a half, and
    /// what is smooth has a quarter (measured on a box with the shadow of a point light: 0.38).
    const FALL: f64 = 0.45;
    /// The part of the requested error that bias may have. With half of the dicing step a pass takes four times as
    /// long. That pays where the noise that is left beside the bias needs more than about four times the passes.
    const SHARE: f64 = 0.75;
    /// The level with which an image with a requested error begins. A pass takes about a quarter of the time.
    pub(crate) const COARSE: i32 = -1;
    /// The least change of an image by the level below, over its bias. In five scenes it was 0.7 to 2 times the bias.
    /// The edge of a straight shadow has 0.71.
    pub(crate) const LEAST_CHANGE: f64 = 0.7;
    /// Where the level below changes an image by less than this part of the permitted bias, it is not measured with
    /// [`Accuracy::finer`].
    const SMALL: f64 = 0.05;
    /// The level below changes an image by less than this times its bias. In six scenes it was 2.4 times at most.
    const MOST_CHANGE: f64 = 4.0;
    /// The finest level, and the largest number of levels between measurements of the bias.
    pub(crate) const MOST: i32 = 5;
    pub(crate) const MOST_AT_ONCE: i32 = 3;

    /// Returns the number of times that the dicing step of a level must be halved for a bias to be small enough for an
    /// error, as far as the bias of the level shows it.
    pub(crate) fn steps(level: i32, bias: f64, error: f64) -> i32 {
        let steps = libm::log(bias / (Self::SHARE * error)) / -libm::log(Self::FALL);
        // The bias is known to a tenth.
        if steps.is_nan() { 0 } else { ((steps - 0.1).ceil() as i32).clamp(0, Self::most_above(level)) }
    }

    /// Returns the largest number of levels above one that passes go at once.
    pub(crate) fn most_above(level: i32) -> i32 {
        Self::MOST_AT_ONCE.min(Self::MOST - level).max(0)
    }

    /// Returns the accuracy with which the bias of this one is measured. The deviation of interpolated light is at most
    /// the square of "maxerror", so that a quarter of it remains.
    pub(crate) fn finer(self) -> Self {
        Self { dicing: 2.0 * self.dicing, tolerance: 0.5 * self.tolerance, ..self }
    }

    /// Returns the accuracy of a level: 0 is what the scene says, and each level has half of the dicing step of the one
    /// below.
    pub(crate) fn of_level(level: i32) -> Self {
        let tolerance = if level < 0 { 0.5 } else { (Self::FALL as f32).sqrt() }.powi(level);
        Self { dicing: 2.0_f32.powi(level), tolerance, ..Self::SCENE }
    }
}

/// The mean squared bias of an image over the square of its mean, as it was measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct SquaredBias {
    pub(crate) value: f64,
    /// The standard deviation of `value`.
    pub(crate) deviation: f64,
    /// The part of it that comes from noise, and not from the choice of a few parts of the image.
    pub(crate) noise: f64,
    /// True when finer surfaces change a coarse image more than coarser ones do, so that little is known of the rest.
    pub(crate) grows: bool,
}

impl SquaredBias {
    /// Returns the bias, and 0 where it cannot be told from noise.
    pub(crate) fn root(&self) -> f64 {
        if self.value > self.noise { self.value.sqrt() } else { 0.0 }
    }

    /// True when noise hides less than half of it, or of what a requested error permits.
    pub(crate) fn is_known_for(&self, error: f64) -> bool {
        self.noise <= 0.5 * self.value.max((Accuracy::SHARE * error).powi(2))
    }

    /// True when it is known well enough to say how little of it is left on higher levels.
    pub(crate) fn shows_rest(&self) -> bool {
        !self.grows && self.noise <= 0.5 * self.value
    }

    /// True for what coarser surfaces change when it is too small for a requested error to depend on bias.
    pub(crate) fn is_small_for(&self, error: f64) -> bool {
        self.value + 2.0 * self.noise <= (Accuracy::SMALL * Accuracy::SHARE * error).powi(2)
    }

    /// True for what the level below changes when the bias is certainly more than a requested error permits.
    pub(crate) fn is_too_large_for(&self, error: f64) -> bool {
        self.value - 2.0 * self.noise > (Accuracy::MOST_CHANGE * Accuracy::SHARE * error).powi(2)
    }

    /// Returns the largest bias that an image may have, for what the level below changes.
    pub(crate) fn largest(self) -> Self {
        self.scaled(Accuracy::LEAST_CHANGE.powi(-2))
    }

    /// Returns what remains of it on the next level.
    pub(crate) fn remains(self) -> Self {
        self.scaled(Accuracy::FALL.powi(2))
    }

    /// Returns it times a factor.
    pub(crate) fn scaled(self, by: f64) -> Self {
        Self { value: by * self.value, deviation: by * self.deviation, noise: by * self.noise, ..self }
    }

    /// Returns the squared noise that an image may have for an error. What is not known of the bias counts as bias, up
    /// to a quarter of the squared error, because less noise removes no bias.
    pub(crate) fn leaves(&self, error: f64) -> f64 {
        let squared = error * error;
        let unknown = self.deviation.min(0.25 * squared);
        (squared - self.value.max(0.0) - unknown).max(0.4 * squared)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn surfaces_are_as_fine_as_the_error_requires() {
        assert_eq!(Accuracy::of_level(Accuracy::steps(0, 0.0, 0.01)), Accuracy::SCENE);
        assert_eq!([0.006, 0.012, 0.025, 1.0].map(|bias| Accuracy::steps(0, bias, 0.01)), [0, 1, 2, 3]);
        assert_eq!([3, 5, 6].map(|level| Accuracy::steps(level, 1.0, 0.01)), [2, 0, 0]);
        assert_eq!(Accuracy::steps(0, f64::NAN, 0.01), 0);
        let bias = |root: f64| SquaredBias { value: root * root, ..SquaredBias::default() };
        let remains = bias(0.025).remains().remains();
        assert!(remains.root() < 0.6 * 0.01 && Accuracy::of_level(2).dicing == 4.0);
        let noise = remains.leaves(0.01);
        assert!((noise.sqrt().hypot(remains.root()) - 0.01).abs() < 1e-9);
        // What cannot be reached is no reason for passes without end.
        assert!((bias(0.5).leaves(0.01) - 0.00004).abs() < 1e-12);
    }
}
