//! The images of passes, and what is said of them (see [`crate::passes`]).

use super::clean::DenoisedErrors;
use super::levels::Passes;
use super::passes::Decision;
use super::{Frame, FrameShader};
use crate::output::canvas::Canvas;
use crate::output::plan::OutputImage;
use crate::passes::{ErrorEstimate, ImageError, PassPlan, PassReport};
use parking_lot::Mutex;

impl<S: FrameShader> Frame<'_, S> {
    /// Stores the means on the canvases. Returns the error of each image.
    pub(super) fn finish_passes(
        &self,
        canvases: &[Mutex<Canvas>],
        decisions: &[Decision],
    ) -> Vec<Option<ErrorEstimate>> {
        let Some(passes) = &self.passes else { return Vec::new() };
        let mut errors = Vec::with_capacity(passes.sums.len());
        for (index, (sum, canvas)) in passes.sums.iter().zip(canvases).enumerate() {
            let sum = sum.lock();
            let of_frame = decisions.get(index).and_then(|decision| decision.as_ref().map(|plan| plan.mean));
            let mean = of_frame.or_else(|| sum.mean());
            let is_error = self.outputs.images[index % self.outputs.images.len()].is_error;
            canvas.lock().restart();
            for bucket in &self.buckets.order {
                let seen = bucket.intersection(&passes.crop);
                if !seen.is_empty() {
                    canvas.lock().begin(&seen);
                    let values = match mean.filter(|mean| is_error && *mean != 0.0) {
                        Some(mean) => sum.deviations(&seen, mean),
                        None if is_error => vec![0.0; seen.width() * seen.height() * 3],
                        None => sum.pixels(&seen),
                    };
                    self.store(canvas, &seen, &values);
                }
            }
            let error = mean.and_then(|mean| sum.error(&passes.crop, mean));
            errors
                .push(error.map(|error| passes.bias.get(index).map_or(error, |bias| error.with_bias(bias))));
        }
        errors
    }

    /// Returns the names of the images with their errors.
    fn image_errors(&self, errors: &[Option<ErrorEstimate>]) -> Vec<ImageError> {
        let images = self.eyes.iter().flat_map(|_| &self.outputs.images);
        let name = |image: &OutputImage| image.path.to_string_lossy().into_owned();
        images.zip(errors).map(|(image, error)| ImageError { name: name(image), error: *error }).collect()
    }

    /// Returns the report of the passes.
    pub(super) fn report(
        &self,
        plan: &PassPlan,
        passes: u32,
        errors: &[Option<ErrorEstimate>],
        denoised: &DenoisedErrors,
    ) -> PassReport {
        let error = errors.iter().flatten().copied().max_by(|a, b| a.error.total_cmp(&b.error));
        let of_pixels = self.passes.as_ref().and_then(|all| {
            let pixels = all.crop.width() * all.crop.height();
            Some(all.sums.first()?.lock().passes(&all.crop) as f64 / pixels.max(1) as f64)
        });
        let has_colors = self.passes.as_ref().is_some_and(Passes::has_colors);
        let is_above = |most: f32| error.map_or_else(|| has_colors, |error| !error.is_within(most));
        // Where time ends the passes, bias is known to a factor of two, and one pass says nothing of its error.
        let is_timed = plan.error.is_some() && self.is_timed();
        let is_short = plan.error.is_some_and(is_above) && !(is_timed && error.is_none());
        let is_unmeasured = plan.error.is_some() && error.is_some_and(|error| error.bias.is_none());
        let is_unsure = is_timed || is_unmeasured;
        let of_denoised = self.options.denoising.and_then(|denoising| denoising.error);
        let step = self.passes.as_ref().map(|passes| passes.step_of(passes.first));
        let larger = step.unwrap_or_default().larger;
        PassReport {
            passes,
            mean_passes: of_pixels.unwrap_or_default(),
            error,
            coarse: self.passes.as_ref().and_then(Passes::coarseness),
            finer: self.passes.as_ref().map_or(1, Passes::finer),
            pixel_samples: 1 << (2 * larger.pixels),
            samples: 1 << (2 * larger.shading),
            requested: plan.error.or(of_denoised),
            is_unsure: is_unsure && !is_short,
            is_short: is_short || of_denoised.is_some_and(|most| has_colors && !denoised.are_below(most)),
            images: self.image_errors(errors),
        }
    }
}
