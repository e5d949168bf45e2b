//! Begins images with a requested error with coarse surfaces, which may be all that the error needs (see
//! [`crate::passes`]).

use super::{Frame, FrameShader};
use crate::output::accumulated::Accumulated;
use crate::passes::{Accuracy, PILOT, PassPlan};
use granita_scene::Scene;

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
            if is_short {
                passes.first_of_tiles = u32::MAX;
            }
        }
        Next::Restart
    }
}
