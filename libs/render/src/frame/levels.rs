//! The steps of an image with a requested error (see [`crate::passes`]). It begins with coarse surfaces, which may be
//! all that the error needs. Where many passes are needed, it goes on with larger ones. Those of an image with a
//! requested time have finer and finer surfaces ([`super::refine`]).

use super::{Frame, FrameShader};
use crate::PixelRect;
use crate::accuracy::{Accuracy, SquaredBias};
use crate::larger::{Larger, of_pixels_above};
use crate::output::accumulated::Accumulated;
use crate::passes::{ErrorEstimate, PILOT, PassPlan};
use crate::refine::Parts;
use granita_scene::Scene;
use parking_lot::Mutex;
use std::time::Duration;

/// How the passes of a step are rendered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Step {
    /// The level of [`Accuracy`].
    pub(super) level: i32,
    /// How many samples they have.
    pub(super) larger: Larger,
    /// The first pass. All steps but the last one have [`PILOT`] passes.
    pub(super) first: u32,
}

impl Step {
    /// Returns the step of a plan without an error.
    pub(super) fn requested(plan: &PassPlan) -> Self {
        let [pixels, shading] = plan.larger.map(|n| n.min(PassPlan::LARGEST));
        let level = plan.level.min(PassPlan::FINEST).cast_signed();
        Self { level, larger: Larger { pixels, shading }, first: 0 }
    }
}

/// The image of a step, which is shown until that of the next one is better.
pub(super) struct Held {
    pub(super) errors: Vec<Option<ErrorEstimate>>,
    /// The number of its passes, and the first of them.
    pub(super) passes: u32,
    pub(super) first: u32,
    /// The parts of its squared error in each image.
    pub(super) parts: Vec<Parts>,
}

/// By how much the colours of each image differ from those of the level below, in each of the first passes.
pub(super) type Changes = Vec<Vec<Vec<f32>>>;

/// The passes that a frame has and their results so far.
pub(super) struct Passes {
    /// The pass that is rendered, from 0.
    pub(super) number: u32,
    /// True while a pass is rendered that is no part of the images.
    pub(super) is_apart: bool,
    /// The first pass that is a part of the images. Those before were not accurate enough.
    pub(super) first: u32,
    /// The first pass that renders tiles where an error is requested. The [`PILOT`] passes before it render the whole
    /// frame, and show where more are needed. It is `u32::MAX` when the time is too short for the error.
    pub(super) first_of_tiles: u32,
    /// True when surfaces become finer and passes larger where that leaves the least error at the end of the time.
    pub(super) is_timed: bool,
    /// The steps, of which there is one at least. The last one has what the requested error needs.
    pub(super) steps: Vec<Step>,
    /// The part of the noise of each image that comes from the samples of pixels. Empty when it was not measured.
    pub(super) of_pixels: Vec<f64>,
    /// True while the images are coarse, because there are not enough passes of the scene's own accuracy yet.
    pub(super) is_held: bool,
    /// How many times as far apart the points of surfaces are, in a coarse image instead of the first pass.
    pub(super) coarse: Option<u32>,
    /// The number of passes after which the bias is measured next. Where it was too much to say how many levels are
    /// needed, it is measured once more on the highest of them.
    pub(super) measured_after: u32,
    /// What the passes of an image have in common, for each sum. Empty when it was not measured.
    pub(super) bias: Vec<SquaredBias>,
    /// What the first passes of the last step change, where it was measured for an error whose time is too short.
    pub(super) changes: Option<Changes>,
    /// What the images are until finer surfaces are better, where time is requested.
    pub(super) held: Option<Held>,
    /// The parts that the squared error of each image is expected to have after the first passes of the last step.
    pub(super) expected: Vec<Parts>,
    /// The time of a pass of the step before.
    pub(super) time_below: Duration,
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

    /// Returns the number of the step of a pass.
    fn place_of(&self, number: u32) -> usize {
        self.steps.partition_point(|step| step.first <= number).saturating_sub(1)
    }

    /// Returns the step of a pass.
    pub(super) fn step_of(&self, number: u32) -> Step {
        self.steps.get(self.place_of(number)).copied().unwrap_or_default()
    }

    /// Returns the last step.
    pub(super) fn last_step(&self) -> Step {
        self.steps.last().copied().unwrap_or_default()
    }

    /// True when it is known what the first passes of the last step change, or when those that it replaced are there.
    pub(super) fn is_compared(&self) -> bool {
        self.changes.is_some() || self.sums.iter().all(|sum| sum.lock().has_coarser())
    }

    /// Returns by how many levels the last step is above the one before, or above the coarse passes before it.
    pub(super) fn levels_of_last_step(&self) -> i32 {
        let before = self.steps.iter().rev().nth(1);
        before.map_or(1, |before| self.last_step().level - before.level)
    }

    /// Returns how many times as fine surfaces are as the scene says, and 1 where they are not finer.
    pub(super) fn finer(&self) -> u32 {
        1 << self.step_of(self.first).level.max(0)
    }

    /// Returns the first pass of the step that a pass belongs to.
    pub(super) fn first_of(&self, number: u32) -> u32 {
        self.step_of(number).first
    }

    /// Sets the last step, whose passes are `more` levels above the present one, and `larger`.
    pub(super) fn go_on_with(&mut self, more: i32, larger: Larger) {
        let Step { level, first, .. } = self.last_step();
        let first = first + PILOT;
        self.steps.push(Step { level: level + more, larger, first });
        self.first_of_tiles = first + PILOT;
        self.measured_after = if more >= Accuracy::MOST_AT_ONCE { self.first_of_tiles } else { u32::MAX };
    }

    /// Returns how many times as far apart the points of surfaces of a coarse image are.
    pub(super) fn coarseness(&self) -> Option<u32> {
        let is_coarse = self.is_held || self.step_of(self.first).level < 0;
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
        let is_coarse = is_measured && !self.saves_anything(scene);
        if let Some(passes) = self.passes.as_mut().filter(|_| is_coarse) {
            passes.steps = vec![Step { level: Accuracy::COARSE, ..Step::default() }];
        }
    }

    /// True when a primitive of the frame may save anything.
    fn saves_anything(&self, scene: &Scene) -> bool {
        let saves = |primitive| self.traits_of(primitive, &self.shader.object(primitive)).saves;
        scene.primitives.iter().filter(|primitive| self.is_visible(primitive)).any(|p| saves(p))
    }

    /// Ends the coarse level, whose passes take `time` and are not accurate enough. Passes of the scene's own accuracy
    /// follow.
    pub(super) fn end_coarse(&mut self, time: Duration) -> Next {
        if let Some(passes) = &mut self.passes {
            (passes.steps, passes.is_held) = (vec![Step::default()], true);
            (passes.measured_after, passes.time_below) = (PILOT, time);
            let above = |of_pixels: &mut f64| *of_pixels = of_pixels_above(*of_pixels, -Accuracy::COARSE);
            passes.of_pixels.iter_mut().for_each(above);
        }
        Next::Restart
    }
}
