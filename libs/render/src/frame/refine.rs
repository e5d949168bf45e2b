//! Finer surfaces and larger passes for images with a requested time (see [`crate::passes`]).

use super::bias::Run;
use super::levels::{Held, Passes, Step};
use super::{Frame, FrameShader};
use crate::accuracy::{Accuracy, SquaredBias};
use crate::larger::Larger;
use crate::output::accumulated::Accumulated;
use crate::output::canvas::Canvas;
use crate::passes::{ErrorEstimate, PILOT};
use crate::refine::{Parts, PassTime, around, best};
use granita_base::NoiseSources;
use parking_lot::Mutex;
use std::time::{Duration, Instant};

/// The least time that is left, in passes, for the bias to be measured with coarser ones.
const LEAST_LEFT: u32 = 4;

/// The same for a pass that shows how much of the noise comes from the samples of pixels.
const LEAST_LEFT_FOR_SOURCES: u32 = 16;

/// The least part of the noise that is taken to be left on the next level.
const LEAST_LEFT_OF_NOISE: f64 = 0.35;

/// What the first passes of a step show.
struct Shown {
    /// The parts of the squared error of each image.
    parts: Vec<Parts>,
    time: PassTime,
}

impl<S: FrameShader> Frame<'_, S> {
    /// Decides after the first passes of a step whether the following ones have finer surfaces or more samples, so that
    /// the error is least at the end of the time. `time` is that of the last pass. Returns the expected time of the
    /// next one if that changes.
    ///
    /// The image follows from the last step and the number of its passes alone. So time may decide both.
    pub(super) fn refine(&mut self, run: &Run<'_>, time: Duration) -> Option<Duration> {
        let passes = self.passes.as_ref()?;
        let step = passes.last_step();
        let is_compared = passes.is_compared();
        if !is_compared && !run.plan.has_time_for(time * LEAST_LEFT) {
            return None;
        }
        let shown = self.shown(run, is_compared, time)?;
        // Where samples differ as well, the changes say nothing of noise and time.
        if step.larger.is_any() { None } else { self.decide(run, step, shown) }
    }

    /// Returns what the first passes of the last step show beside those of the step before (`is_compared`), or beside
    /// passes with points twice as far apart. `time` is that of the last pass.
    fn shown(&mut self, run: &Run<'_>, is_compared: bool, time: Duration) -> Option<Shown> {
        let begin = Instant::now();
        let passes = self.passes.as_ref()?;
        let (level, time_below) = (passes.last_step().level, passes.time_below);
        let levels = if is_compared { passes.levels_of_last_step() } else { 1 };
        let changes = self.changes_of_frame(run, level)?;
        let time_below = if is_compared { time_below } else { begin.elapsed() / PILOT };
        let left_of_noise = self.left_of_noise(&changes, levels);
        let changes = self.squared_changes(&changes, level + 1 - levels);
        let bias = changes.iter().map(|change| around(*change, levels));
        let (before, after): (Vec<SquaredBias>, Vec<SquaredBias>) = bias.map(|[a, b]| (a, b)).unzip();
        let mut parts = self.parts(&after);
        parts.iter_mut().zip(left_of_noise).for_each(|(parts, left)| parts.left = left);
        let is_drawn = self.draws_in_shading();
        let passes = self.passes.as_mut()?;
        passes.bias = after;
        for (parts, before) in passes.held.iter_mut().flat_map(|held| &mut held.parts).zip(before) {
            parts.bias = before.value.max(0.0);
        }
        let time = PassTime::new(time.as_secs_f64(), (time_below.as_secs_f64(), levels), is_drawn);
        Some(Shown { parts, time })
    }

    /// Decides what follows the first passes of a step.
    fn decide(&mut self, run: &Run<'_>, step: Step, Shown { mut parts, time }: Shown) -> Option<Duration> {
        let is_drawn = self.draws_in_shading();
        if is_drawn && run.plan.has_time_for(time.here() * LEAST_LEFT_FOR_SOURCES) {
            self.measure_noise_of_pixels(run, step.level);
        }
        let passes = self.passes.as_mut()?;
        let is_known = !is_drawn || !passes.of_pixels.is_empty();
        for (parts, of_pixels) in parts.iter_mut().zip(&passes.of_pixels) {
            parts.of_pixels = *of_pixels;
        }
        let left = run.plan.deadline?.saturating_duration_since(Instant::now()).as_secs_f64();
        let mut possible = Larger::possible(self.options.camera.spatialquality);
        possible.truncate(if is_known { possible.len() } else { 1 });
        let (more, larger) = best(&parts, time, left, (Accuracy::most_above(step.level), &possible));
        if more == 0 && !larger.is_any() {
            return None;
        }
        if is_known {
            passes.of_pixels = parts.iter().map(|parts| parts.of_pixels_above(more)).collect();
        }
        let expected = parts.iter().map(|parts| parts.with((more, larger))).collect();
        self.hold_image(run.canvases, parts);
        let passes = self.passes.as_mut()?;
        passes.expected = expected;
        let first = step.first + PILOT;
        passes.steps.push(Step { level: step.level + more, larger, first });
        passes.time_below = time.here();
        // Other samples alone change no bias.
        passes.measured_after = u32::MAX;
        if more > 0 {
            passes.measured_after = first + PILOT;
            self.each_sum(Accumulated::keep_coarser);
        }
        Duration::try_from_secs_f64(time.of((more, larger))).ok()
    }

    /// True when the next pass is the first of other surfaces or samples.
    pub(super) fn is_tried(&self, completed: u32) -> bool {
        let passes = self.passes.as_ref();
        passes.is_some_and(|passes| passes.steps.len() > 1 && passes.last_step().first == completed)
    }

    /// Gives up the last step, of which no pass is complete, and goes on with the one before. Returns the time of a
    /// pass of that one.
    pub(super) fn return_to_step_before(&mut self) -> Option<Duration> {
        let passes = self.passes.as_mut()?;
        passes.steps.pop();
        passes.measured_after = u32::MAX;
        // It has that image, to which passes are added again.
        passes.held.take_if(|held| held.first == passes.first);
        Some(passes.time_below)
    }

    /// True when shading draws random numbers.
    pub(super) fn draws_in_shading(&self) -> bool {
        self.shader.noise_sources().into_iter().any(|source| !NoiseSources::OF_PIXELS.contains(source))
    }

    /// Lets the images have what they have now until finer surfaces are better. Those that are held already stay if
    /// they are better.
    fn hold_image(&mut self, canvases: &[Mutex<Canvas>], parts: Vec<Parts>) {
        let is_better = |held: &Held| Parts::largest(&held.parts) <= Parts::largest(&parts);
        let Some(passes) = &self.passes else { return };
        if passes.held.as_ref().is_some_and(is_better) {
            return;
        }
        let first = passes.last_step().first;
        let errors = self.finish_passes(canvases, &[]);
        if let Some(passes) = &mut self.passes {
            passes.held = Some(Held { errors, passes: PILOT, first, parts });
        }
    }

    /// Shows the images of the last step from the time on when they are better than those that are held.
    pub(super) fn show_better(&mut self) {
        let Some(Passes { held: Some(held), bias, first, .. }) = &self.passes else { return };
        let is_better =
            *first > held.first && Parts::largest(&self.parts(bias)) < Parts::largest(&held.parts);
        if let Some(passes) = self.passes.as_mut().filter(|_| is_better) {
            passes.held = None;
        }
    }

    /// Shows the only pass of the last step where it is expected to be better than the images that are held.
    fn show_single_pass(&mut self, completed: u32) {
        let Some(passes) = &mut self.passes else { return };
        let first = passes.last_step().first;
        let is_better = |held: &mut Held| {
            first > held.first && Parts::largest_after(&passes.expected, 1.0) < Parts::largest(&held.parts)
        };
        if completed == first + 1 && passes.held.take_if(is_better).is_some() {
            passes.first = first;
            self.each_sum(Accumulated::restart);
        }
    }

    /// Ends the passes after those that were completed. Returns the number of those that the images have, and their
    /// errors if they are held.
    pub(super) fn end_refined(&mut self, completed: u32) -> (u32, Option<Vec<Option<ErrorEstimate>>>) {
        self.show_better();
        self.show_single_pass(completed);
        let Some(passes) = &mut self.passes else { return (completed, None) };
        match passes.held.take() {
            Some(held) => {
                passes.first = held.first;
                (held.passes, Some(held.errors))
            }
            // Those of steps before are no part of the images.
            None => (completed - passes.first, None),
        }
    }

    /// Returns the parts of the squared error of each image, which has a bias.
    fn parts(&self, bias: &[SquaredBias]) -> Vec<Parts> {
        let whole = self.options.camera.crop;
        let sums = self.passes.iter().flat_map(|passes| &passes.sums);
        let of_sum = |(sum, bias): (&Mutex<Accumulated>, &SquaredBias)| {
            let sum = sum.lock();
            let noise = sum.mean().and_then(|mean| sum.error(&whole, mean)).map_or(0.0, |found| found.error);
            // What noise hides may be there. Its expectation is right.
            Parts { noise: noise.powi(2), bias: bias.value.max(0.0), left: 1.0, of_pixels: 1.0 }
        };
        sums.zip(bias).map(of_sum).collect()
    }

    /// Returns the part of the noise of a pass of each image that is left on the next level: what it was in the mean
    /// from some levels below, from which the first passes have `changes`.
    fn left_of_noise(&self, changes: &[Vec<Vec<f32>>], levels: i32) -> Vec<f64> {
        let [first, second] = changes else { return Vec::new() };
        let variance = |differences: &mut dyn Iterator<Item = f32>| {
            differences.filter(|v| v.is_finite()).map(|v| f64::from(v).powi(2)).sum::<f64>()
        };
        let of_sum = |(index, sum): (usize, &Mutex<Accumulated>)| {
            let sum = sum.lock();
            let early = sum.early(0).iter().zip(sum.early(1));
            let changed = first[index].iter().zip(&second[index]);
            let here = variance(&mut early.clone().map(|(a, b)| a - b));
            let below = variance(&mut early.zip(changed).map(|((a, b), (c, d))| (a + c) - (b + d)));
            if below > 0.0 {
                libm::pow((here / below).clamp(0.0, 1.0), 1.0 / f64::from(levels)).max(LEAST_LEFT_OF_NOISE)
            } else {
                1.0
            }
        };
        self.passes.iter().flat_map(|passes| &passes.sums).enumerate().map(of_sum).collect()
    }
}
