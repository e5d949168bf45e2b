//! The steps of an image with a requested error (see [`crate::passes`]). It begins with coarse surfaces, which may be
//! all that the error needs. Where many passes are needed, it goes on with larger ones.

use super::{Frame, FrameShader};
use crate::PixelRect;
use crate::accuracy::{Accuracy, SquaredBias};
use crate::output::accumulated::Accumulated;
use crate::passes::{PILOT, PassPlan};
use granita_scene::Scene;
use parking_lot::Mutex;

/// The part of the noise of a pass that is left with four times the samples, squared. It would be a quarter if they
/// were independent of each other. (On Stanford's dragon under a panorama, it was a tenth.)
const NOISE_OF_LARGE: f64 = 1.0 / 8.0;
/// The largest of [`Passes::large`].
const MOST_LARGE: u32 = 2;
/// The largest number of samples along one side of a pixel. More would need too much memory.
const MOST_SAMPLES: u32 = 16;

/// The passes that a frame has and their results so far.
pub(super) struct Passes {
    /// The pass that is rendered, from 0.
    pub(super) number: u32,
    /// True while a pass is rendered that is no part of the images.
    pub(super) is_apart: bool,
    /// The first pass that is a part of the images. Those before were not accurate enough.
    pub(super) first: u32,
    /// The first pass that renders tiles where an error is requested. The [`PILOT`] passes before it render the whole
    /// frame, and show where more are needed. Before them there are as many of each lower level. It is `u32::MAX` when
    /// the time was too short to know the level.
    pub(super) first_of_tiles: u32,
    /// The level of [`Accuracy`] that the requested error needs. Passes go up to it level by level, so that an image
    /// whose time ends has the highest level that its time permits.
    pub(super) level: i32,
    /// The level of the first passes.
    pub(super) lowest: i32,
    /// How much larger the passes of the last step are: they have `2^large` times the samples along each side of a
    /// pixel, and `4^large` times those of everything else.
    pub(super) large: u32,
    /// True while the images are coarse, because there are not enough passes of the scene's own accuracy yet.
    pub(super) is_held: bool,
    /// How many times as far apart the points of surfaces are, in a coarse image instead of the first pass.
    pub(super) coarse: Option<u32>,
    /// The number of passes after which the bias is measured next. Where it was too much to say how many levels are
    /// needed, it is measured once more on the highest of them.
    pub(super) measured_after: u32,
    /// What the passes of an image have in common, for each sum. Empty when it was not measured.
    pub(super) bias: Vec<SquaredBias>,
    /// The pixels that the images show. The frame renders those of the whole image where an error is requested.
    pub(super) crop: PixelRect,
    /// The sums of the images of each eye, one eye after the other.
    pub(super) sums: Vec<Mutex<Accumulated>>,
}

impl Passes {
    /// True when the shaders of the present pass print and save nothing.
    pub(super) fn is_mute(&self) -> bool {
        self.number > 0 || self.is_apart || self.is_held || self.coarse.is_some()
    }

    /// Returns the last step. Each step has its own level, except that large passes may have the level of the step
    /// before. All steps but the last one have [`PILOT`] passes.
    fn last_step(&self) -> u32 {
        u32::try_from(self.level - self.lowest).unwrap_or(0).max(self.large.min(1))
    }

    fn step_of(&self, number: u32) -> u32 {
        self.last_step().min(number / PILOT)
    }

    /// Returns the level of a pass.
    pub(super) fn level_of(&self, number: u32) -> i32 {
        self.level.min(self.lowest + self.step_of(number).cast_signed())
    }

    /// Returns how much larger than others a pass is.
    pub(super) fn large_of(&self, number: u32) -> u32 {
        if self.step_of(number) == self.last_step() { self.large } else { 0 }
    }

    /// Returns the first pass of the step that a pass belongs to.
    pub(super) fn first_of(&self, number: u32) -> u32 {
        self.step_of(number) * PILOT
    }

    /// Sets the last step, whose passes are `more` levels above the present one, and have `4^large` times the samples.
    pub(super) fn go_on_with(&mut self, more: i32, large: u32) {
        (self.level, self.large) = (self.level + more, large);
        self.first_of_tiles = (self.last_step() + 1) * PILOT;
        if more >= Accuracy::MOST_AT_ONCE {
            self.measured_after = self.first_of_tiles;
        }
    }

    /// Returns how many times as far apart the points of surfaces of a coarse image are.
    pub(super) fn coarseness(&self) -> Option<u32> {
        let is_coarse = self.is_held || self.lowest < 0;
        self.coarse.or_else(|| is_coarse.then(|| 1 << Accuracy::COARSE.unsigned_abs()))
    }

    /// True when the error of an image is estimated.
    pub(super) fn has_colors(&self) -> bool {
        self.sums.iter().any(|sum| sum.lock().colors() > 0)
    }
}

/// What follows when the bias of the first passes of a level was measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Next {
    /// The next pass.
    Pass,
    /// Passes of the scene's own accuracy, the first of which is the first of the image. It has the coarse passes until
    /// enough of them are complete.
    Restart,
    /// The end of the image, because there is no time for more.
    End,
}

impl<S: FrameShader> Frame<'_, S> {
    /// Lets the passes of images with a requested error begin with the coarse level. What is saved must have the
    /// accuracy of the scene, so that frames which save begin with that.
    pub(super) fn begin_coarse(&mut self, scene: &Scene, plan: &PassPlan) {
        let Some(passes) = &self.passes else { return };
        let is_measured = plan.error.is_some() && plan.most() >= PILOT && passes.has_colors();
        if is_measured && !self.saves_anything(scene) {
            self.each_sum(Accumulated::keep_coarser);
            if let Some(passes) = &mut self.passes {
                (passes.lowest, passes.level) = (Accuracy::COARSE, Accuracy::COARSE);
            }
        }
    }

    /// True when a primitive of the frame may save anything.
    fn saves_anything(&self, scene: &Scene) -> bool {
        let saves = |primitive| self.traits_of(primitive, &self.shader.object(primitive)).saves;
        scene.primitives.iter().filter(|primitive| self.is_visible(primitive)).any(|p| saves(p))
    }

    /// Ends the coarse level, whose passes are not accurate enough. Where `is_short`, the time was too short to know
    /// that, and the image becomes that of passes without a requested error.
    pub(super) fn end_coarse(&mut self, is_short: bool) -> Next {
        if let Some(passes) = &mut self.passes {
            (passes.lowest, passes.level, passes.is_held) = (0, 0, true);
            passes.measured_after = PILOT;
            if is_short {
                passes.first_of_tiles = u32::MAX;
            }
        }
        Next::Restart
    }

    /// Returns how much larger the following passes are (see [`Passes::large`]), so that a few of them have the
    /// requested error. Samples of one pass are spread evenly, and those of several passes are independent of each
    /// other. So one pass with four times the samples has less noise than four passes, and takes less time. Where time
    /// or a number ends the passes, all are alike.
    pub(super) fn larger_passes(&self, plan: &PassPlan, bias: &[SquaredBias], error: f64) -> u32 {
        if plan.passes.is_some() || plan.deadline.is_some() {
            return 0;
        }
        let needed = self.needed_passes(|index| {
            let bias = bias.get(index).copied().unwrap_or_default();
            let steps = Accuracy::steps(0, bias.root(), error);
            (0..steps).fold(bias, |bias, _| bias.remains()).leaves(error)
        });
        let most = self.options.camera.spatialquality.into_iter().max().unwrap_or(1);
        (1..=MOST_LARGE)
            .rev()
            .find(|large| {
                needed * NOISE_OF_LARGE.powi(large.cast_signed()) >= f64::from(PILOT)
                    && most << large <= MOST_SAMPLES
            })
            .unwrap_or(0)
    }
}
