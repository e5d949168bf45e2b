//! Measures what larger passes need to know of the noise of the first ones (see [`crate::larger`]).

use super::bias::Run;
use super::{Frame, FrameShader};
use crate::accuracy::{Accuracy, SquaredBias};
use crate::larger::{Larger, Need, best};
use crate::passes::PassPlan;
use granita_base::NoiseSources;

/// The least number of passes that a requested error needs for larger ones to be considered.
const WORTH: f64 = 4.0;
impl<S: FrameShader> Frame<'_, S> {
    /// Returns how much larger than others the following passes are. Where time or a number ends the passes, all are
    /// alike.
    pub(super) fn larger_passes(&self, plan: &PassPlan, bias: &[SquaredBias], error: f64) -> Larger {
        let Some(passes) = self.passes.as_ref().filter(|_| plan.may_be_larger()) else {
            return Larger::default();
        };
        let need = |index: usize| {
            let bias = bias.get(index).copied().unwrap_or_default();
            let steps = Accuracy::steps(0, bias.root(), error);
            let remains = (0..steps).fold(bias, |bias, _| bias.remains());
            let passes_needed = self.needed_passes(index, remains.leaves(error));
            Need {
                passes: passes_needed,
                of_pixels: passes.of_pixels.get(index).copied().unwrap_or(1.0),
                steps,
            }
        };
        let needs: Vec<Need> = (0..passes.sums.len()).map(need).collect();
        let is_worth = needs.iter().any(|need| need.passes >= WORTH);
        let most = self.options.camera.spatialquality.into_iter().max().unwrap_or(1);
        if is_worth { best(&needs, most) } else { Larger::default() }
    }

    /// Measures which part of the noise of the first passes comes from the samples of pixels, where the passes may
    /// become larger: the first one is rendered again with other samples of pixels.
    pub(super) fn measure_noise_of_pixels(&mut self, run: &Run<'_>, level: i32, needed: f64) {
        let is_known = self.passes.as_ref().is_none_or(|passes| !passes.of_pixels.is_empty());
        if is_known || needed < WORTH || !run.plan.may_be_larger() {
            return;
        }
        self.set_accuracy(Accuracy::of_level(level));
        self.begin_pass(run.scene, (0, NoiseSources::OF_PIXELS), false, Some(Larger::default()));
        let all: Vec<usize> = (0..self.buckets.order.len()).collect();
        if self.render_pass(run.scene, None, run.canvases, run.threads, &all).is_err() {
            return;
        }
        let whole = self.options.camera.crop;
        let mut parts = Vec::new();
        self.each_sum(|sum| {
            let squared = sum.compare(&whole);
            let mean = sum.mean().unwrap_or_default();
            let noise = sum.error(&whole, mean).map_or(0.0, |found| found.error * mean);
            parts.push(if noise == 0.0 { 1.0 } else { (squared / (noise * noise)).min(1.0) });
        });
        if let Some(passes) = &mut self.passes {
            passes.of_pixels = parts;
        }
    }
}
