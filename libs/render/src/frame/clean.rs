//! Measures the error that images of passes have without their noise (see [`crate::output::halves`]).

use super::{Denoising, Frame, FrameShader};
use crate::output::accumulated::Accumulated;
use crate::output::halves::DenoisedError;
use crate::output::plan::OutputImage;
use crate::passes::{PILOT, PassPlan, TOLERANCE};
use parking_lot::Mutex;
use std::time::{Duration, Instant};

/// The errors that images have without their noise.
#[derive(Debug, Default)]
pub(super) struct DenoisedErrors {
    /// The number of passes that they were measured with.
    pub(super) passes: u32,
    /// The number of passes to measure them with again.
    next: u32,
    pub(super) errors: Vec<Option<DenoisedError>>,
    /// The upper ends of the confidence intervals of the errors that the images have with their noise.
    noisy: Vec<f64>,
    /// The time of measuring.
    time: Duration,
}

impl DenoisedErrors {
    /// Returns the largest bound, of the better one of each image with its noise and without it; `None` when no error
    /// is known.
    fn bound(&self) -> Option<f64> {
        let known = self.errors.iter().zip(&self.noisy);
        known.filter_map(|(error, noisy)| Some(error.as_ref()?.bound.min(*noisy))).reduce(f64::max)
    }

    /// True when all are at most a requested error, with or without noise.
    pub(super) fn are_below(&self, most: f32) -> bool {
        self.bound().is_some_and(|bound| bound <= f64::from(most) * TOLERANCE)
    }
}

impl<S: FrameShader> Frame<'_, S> {
    /// True when the errors of images without their noise are measured. The library then takes three times as long as
    /// for the images alone. Where a time is requested, that goes into passes, unless an error is requested as well.
    pub(super) fn measures_denoised(&self, plan: &PassPlan) -> bool {
        let has_time = |denoising: Denoising<'_>| plan.deadline.is_none() || denoising.error.is_some();
        plan.most() > 1 && self.options.denoising.is_some_and(has_time)
    }

    /// Measures the error of each image without its noise, unless that was done with the same passes.
    pub(super) fn measure_denoised(&self, completed: u32, denoised: &mut DenoisedErrors) {
        let Some((passes, denoising)) = self.passes.as_ref().zip(self.options.denoising) else { return };
        if denoised.passes == completed || self.is_stopped() {
            return;
        }
        let begin = Instant::now();
        let images = self
            .eyes
            .iter()
            .enumerate()
            .flat_map(|(eye, _)| self.outputs.images.iter().map(move |image| (eye, image)));
        let error = |((eye, image), sum): ((usize, &OutputImage), &Mutex<Accumulated>)| {
            let halves = if image.is_denoised { sum.lock().halves(&passes.crop) } else { None }?;
            (denoising.measure)(eye, image, &halves)
        };
        denoised.errors = images.zip(&passes.sums).map(error).collect();
        let noisy = |sum: &Mutex<Accumulated>| {
            let sum = sum.lock();
            let found = sum.mean().and_then(|mean| sum.error(&passes.crop, mean));
            found.map_or(f64::INFINITY, |found| found.bound)
        };
        denoised.noisy = passes.sums.iter().map(noisy).collect();
        (denoised.passes, denoised.time) = (completed, begin.elapsed());
    }

    /// True when images without their noise have the requested error, or have it with their noise, or when the error
    /// cannot be known. It is measured after the second pass, and then each time that it may be reached if all of it
    /// were noise.
    pub(super) fn is_clean_enough(
        &self,
        plan: &PassPlan,
        completed: u32,
        denoised: &mut DenoisedErrors,
    ) -> bool {
        let Some(most) = self.options.denoising.and_then(|denoising| denoising.error) else { return false };
        if completed < denoised.next.max(PILOT) || !plan.has_time_for(denoised.time) {
            return false;
        }
        self.measure_denoised(completed, denoised);
        let Some(bound) = denoised.bound() else { return true };
        let needed = f64::from(completed) * (bound / (f64::from(most) * TOLERANCE)).powi(2);
        denoised.next = (needed.ceil() as u32).clamp(completed + 1, 2 * completed);
        denoised.are_below(most)
    }
}
