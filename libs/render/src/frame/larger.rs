//! Measures what larger passes need to know of the noise of the first ones (see [`crate::larger`]).

use super::bias::Run;
use super::coarse::Limit;
use super::{Frame, FrameShader};
use crate::accuracy::{Accuracy, SquaredBias};
use crate::larger::{Larger, Need, best};
use granita_base::NoiseSources;

/// The least number of passes that a requested error needs for larger ones to be considered.
const WORTH: f64 = 4.0;

impl<S: FrameShader> Frame<'_, S> {
    /// Returns how much larger than others the following passes are, for images of a level with a bias.
    pub(super) fn larger_passes(
        &mut self,
        run: &Run<'_>,
        (level, bias): (i32, &[SquaredBias]),
        error: f64,
    ) -> Larger {
        let images = self.passes.as_ref().map_or(0, |passes| passes.sums.len());
        let need = |index: usize| {
            let bias = bias.get(index).copied().unwrap_or_default();
            let steps = Accuracy::steps(level, bias.root(), error);
            let passes = self.needed_passes_above(index, (bias, steps), error);
            Need { passes, of_pixels: 1.0, steps }
        };
        let needs: Vec<Need> = (0..images).map(need).collect();
        if needs.iter().all(|need| need.passes < WORTH) {
            return Larger::default();
        }
        self.measure_noise_of_pixels(run, level);
        let Some(passes) = self.passes.as_ref().filter(|passes| passes.of_pixels.len() == images) else {
            return Larger::default();
        };
        let known = needs.into_iter().zip(&passes.of_pixels);
        let needs: Vec<Need> =
            known.map(|(need, of_pixels)| Need { of_pixels: *of_pixels, ..need }).collect();
        best(&needs, self.options.camera.spatialquality)
    }

    /// Measures which part of the noise of the first passes of a level comes from the samples of pixels, if that is not
    /// known: the first one is rendered again with other samples of pixels.
    pub(super) fn measure_noise_of_pixels(&mut self, run: &Run<'_>, level: i32) {
        if self.passes.as_ref().is_none_or(|passes| !passes.of_pixels.is_empty()) {
            return;
        }
        self.set_accuracy(Accuracy::of_level(level));
        self.begin_pass(run.scene, (0, NoiseSources::OF_PIXELS), false, Some(Larger::default()));
        let all: Vec<usize> = (0..self.buckets.order.len()).collect();
        let limit = run.plan.deadline.map(|deadline| Limit::At(deadline + run.plan.grace));
        if self.render_pass(run.scene, limit, run.canvases, run.threads, &all).is_err() {
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
