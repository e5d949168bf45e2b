//! Renders a frame whose images are the sum of passes (see [`crate::passes`]).

use super::bias::Run;
use super::clean::DenoisedErrors;
use super::coarse::{Limit, Outlook, of_first};
use super::levels::{Next, Passes, Step};
use super::{Frame, FrameShader, Jobs};
use crate::PixelRect;
use crate::accuracy::{Accuracy, SquaredBias};
use crate::bucket::{BucketOrder, Buckets};
use crate::larger::Larger;
use crate::output::accumulated::{Accumulated, TILE};
use crate::output::canvas::Canvas;
use crate::output::halves::DenoisedError;
use crate::output::plan::OutputImage;
use crate::passes::{ErrorEstimate, PILOT, PassPlan, PassReport, Rule, Spot, fall};
use granita_base::{NoiseSource, NoiseSources, PassNumbers};
use granita_dicing::CameraView;
use granita_dicing::camera::is_moving;
use granita_hider::{SamplePattern, film};
use granita_scene::Scene;
use parking_lot::{Condvar, Mutex};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// The result of the passes of a frame.
pub(super) struct Passed {
    /// The number of buckets that failed.
    pub(super) failed: usize,
    /// `passes` is 0 when the first one was not completed.
    pub(super) report: PassReport,
    /// The error of each image, those of an eye one after the other.
    pub(super) errors: Vec<Option<ErrorEstimate>>,
    /// The error that each of them has without its noise, where it was measured.
    pub(super) denoised: Vec<Option<DenoisedError>>,
}

/// The number of passes of tiles that any crop renders for the whole image. They show how fast its noise falls.
const WHOLE: u32 = PILOT;

/// The least part of the time of the first pass that the second one is expected to take. The first also makes what all
/// passes share, such as geometry for rays. One that was expected too early is given up, and nothing is lost.
const LEAST_OF_SECOND: f64 = 0.6;

/// What decides where an image needs more passes.
pub(super) struct Plan {
    rule: Rule,
    /// The mean of its colours.
    pub(super) mean: f64,
    /// The parts of the image after its first passes.
    first: Vec<Spot>,
}

pub(super) type Decision = Option<Plan>;

impl<'a, S: FrameShader> Frame<'a, S> {
    /// Prepares the frame for passes of images that show the pixels of `crop`.
    pub(super) fn sum_passes(&mut self, crop: PixelRect, plan: &PassPlan) {
        let rect = self.options.camera.crop;
        let images = self.eyes.iter().flat_map(|_| &self.outputs.images);
        let sum = |image: &OutputImage| {
            let is_compared = plan.error.is_some() || plan.refines();
            let kept = if is_compared { PILOT } else { u32::from(plan.causes) };
            Mutex::new(Accumulated::new(image, rect).keeping(kept))
        };
        let sums = images.map(sum).collect();
        let step = if plan.error.is_some() { Step::default() } else { Step::requested(plan) };
        self.passes = Some(Passes {
            number: 0,
            is_apart: false,
            first: 0,
            first_of_tiles: PILOT,
            is_timed: false,
            changes: None,
            steps: vec![step],
            held: None,
            expected: Vec::new(),
            time_below: Duration::ZERO,
            of_pixels: Vec::new(),
            is_held: false,
            coarse: None,
            measured_after: PILOT,
            bias: Vec::new(),
            crop,
            sums,
        });
    }

    /// Holds the pixels of a bucket until the pass is complete, and shows them. `index` is the number of the image.
    pub(super) fn hold(
        &self,
        (passes, index): (&Passes, usize),
        canvas: &Mutex<Canvas>,
        rect: PixelRect,
        values: Vec<f32>,
    ) {
        let Some(sum) = passes.sums.get(index) else { return };
        let mut sum = sum.lock();
        let is_seen = rect.intersection(&passes.crop) == rect && passes.held.is_none();
        // The first pass may be all that a stopped frame has.
        let shown = (is_seen && !passes.is_apart && (passes.number == 0 || canvas.lock().is_shown()))
            .then(|| sum.with(&rect, &values));
        sum.hold(rect, values);
        drop(sum);
        if let Some(shown) = shown {
            self.store(canvas, &rect, &shown);
        }
    }

    /// Renders the passes. The canvases then have the mean of those that were completed.
    pub(super) fn run_passes(
        &mut self,
        (scene, plan): (&Scene, &PassPlan),
        canvases: &[Mutex<Canvas>],
        threads: usize,
    ) -> Passed {
        let mut failed = 0;
        let mut completed = 0;
        let mut decisions: Vec<Decision> = Vec::new();
        // The time of the last pass, and its number of pixels.
        let mut last: Option<(Duration, usize)> = None;
        // The time that is left for the passes that measure noise sources.
        let mut reserved = Duration::ZERO;
        let mut denoised = DenoisedErrors::default();
        self.shader.set_all_rays(true);
        self.begin_coarse(scene, plan);
        // Images without colours have no error that more passes could reach.
        let has_colors = self.passes.as_ref().is_some_and(Passes::has_colors);
        let most = if plan.error.is_some() && !has_colors { 1 } else { plan.most() };
        let may_be_timed = self.may_be_timed(plan);
        if let Some(passes) = &mut self.passes {
            passes.is_timed = plan.error.is_none() && has_colors && may_be_timed;
        }
        let run = Run { scene, plan, canvases, threads };
        loop {
            if let Some(error) = plan.error.filter(|_| !self.is_timed()) {
                if self.passes.as_ref().is_some_and(|passes| passes.measured_after == completed) {
                    let time = last.map_or(Duration::ZERO, |(time, _)| time);
                    let is_coarse = self.passes.as_ref().is_some_and(|passes| passes.steps[0].level < 0);
                    let may_go_on = is_coarse || completed < most;
                    match may_go_on.then(|| self.measure_bias(&run, f64::from(error), time)) {
                        Some(Next::End) => break,
                        Some(Next::Restart) => {
                            completed = 0;
                            continue;
                        }
                        Some(Next::Pass) | None => (),
                    }
                }
                match self.passes.as_ref().and_then(|passes| completed.checked_sub(passes.first_of_tiles)) {
                    Some(0) => decisions = self.decisions(error, &[]),
                    Some(WHOLE) => decisions = self.decisions(error, &decisions),
                    _ => (),
                }
                let may_end = completed >= PILOT && !self.is_timed();
                if may_end && self.is_reached_by_whole_passes(error.into()) {
                    break;
                }
            }
            let is_timed = self.is_timed();
            if is_timed && self.passes.as_ref().is_some_and(|passes| passes.measured_after == completed) {
                last = last.map(|(time, pixels)| (self.refine(&run, time).unwrap_or(time), pixels));
            }
            self.show_better();
            if completed >= most {
                break;
            }
            let begin = Instant::now();
            self.set_accuracy_of_pass(completed);
            self.begin_pass(scene, (completed, NoiseSources::default()), plan.error.is_some(), None);
            let list = self.buckets_of_pass(completed, &decisions, plan.error.is_some());
            let area =
                |index: &usize| self.buckets.order[*index].width() * self.buckets.order[*index].height();
            let pixels: usize = list.iter().map(area).sum();
            let part = if completed == 1 && plan.error.is_none() { LEAST_OF_SECOND } else { 1.0 };
            let predicted =
                last.map(|(time, before)| time.mul_f64(part * pixels as f64 / before.max(1) as f64));
            let is_tried = is_timed && self.is_tried(completed);
            if list.is_empty() || predicted.is_some_and(|time| !plan.has_time_for(time + reserved)) {
                if is_tried {
                    last = self.return_to_step_before().map(|time| (time, pixels));
                    continue;
                }
                break;
            }
            let is_held = self.passes.as_ref().is_some_and(|passes| passes.is_held);
            let is_first = completed == 0 && !is_held;
            let limit = match is_first {
                true => self.first_limit(plan, begin),
                false if is_tried => self.tried_limit(plan, begin),
                false => plan.deadline.map(|deadline| Limit::At(deadline + plan.grace)),
            };
            let without = match self.render_pass(scene, limit, canvases, threads, &list) {
                Ok(without) => without,
                Err(part) if is_first && !self.is_stopped() => {
                    let whole = begin.elapsed().div_f64(part.max(1e-6));
                    let plan = of_first(plan, begin);
                    if let Some(without) = self.render_coarse((scene, &plan), whole, canvases, threads, &list)
                    {
                        self.add_pass(0);
                        (failed, completed) = (without, 1);
                    }
                    break;
                }
                Err(_) if is_tried && !self.is_stopped() => {
                    last = self.return_to_step_before().map(|time| (time, pixels));
                    continue;
                }
                Err(_) => break,
            };
            self.add_pass(completed);
            failed += without;
            completed += 1;
            last = Some((begin.elapsed(), pixels));
            if self.is_clean_enough(plan, completed, &mut denoised) {
                break;
            }
            if plan.causes && completed == 1 {
                reserved = begin.elapsed() * u32::try_from(self.noise_sources().len()).unwrap_or(0);
            }
        }
        if self.passes.as_ref().is_some_and(|passes| passes.is_held) {
            completed = PILOT;
        }
        let is_timed = self.is_timed();
        let (completed, held) = if is_timed { self.end_refined(completed) } else { (completed, None) };
        let finish = || if completed > 0 { self.finish_passes(canvases, &decisions) } else { Vec::new() };
        let mut errors = held.unwrap_or_else(finish);
        if plan.causes && completed > 1 && !self.is_stopped() {
            self.measure_sources(scene, plan, &mut errors, canvases, threads);
        }
        if plan.deadline.is_none() && self.measures_denoised(plan) {
            self.measure_denoised(completed, &mut denoised);
        }
        // The next camera has the shaders as they are.
        self.set_accuracy(Accuracy::SCENE);
        self.shader.set_all_rays(false);
        let denoised = if denoised.passes == completed { denoised } else { DenoisedErrors::default() };
        let mut report = self.report(plan, completed, &errors, &denoised);
        if is_timed {
            report.mean_passes = f64::from(completed);
        }
        Passed { failed, report, errors, denoised: denoised.errors }
    }

    /// True when surfaces may become finer and passes larger where that is the best use of the time.
    pub(super) fn may_be_timed(&self, plan: &PassPlan) -> bool {
        plan.refines() && self.options.denoising.is_none()
    }

    /// True when they do.
    pub(super) fn is_timed(&self) -> bool {
        self.passes.as_ref().is_some_and(|passes| passes.is_timed)
    }

    /// Renders the buckets of a pass. Returns the number of those that failed.
    ///
    /// # Errors
    /// A pass that was given up, by its limit or because the frame was stopped, returns the part of it that there was
    /// at most.
    pub(super) fn render_pass(
        &mut self,
        scene: &Scene,
        limit: Option<Limit>,
        canvases: &[Mutex<Canvas>],
        threads: usize,
        list: &[usize],
    ) -> Result<usize, f64> {
        self.release_others(list);
        let jobs = self.jobs(scene, threads);
        // A pass that saves is finished.
        let is_mute = self.passes.as_ref().is_some_and(Passes::is_mute);
        let saves = || !is_mute && jobs.list.iter().any(|job| job.traits.saves);
        let limit = limit.filter(|limit| matches!(limit, Limit::At(_)) || !saves());
        let steps = list.iter().map(|index| jobs.cost(*index)).sum();
        self.options.progress.begin(self.first_image(), steps);
        let (failed, is_late) = self.run_until(limit, &jobs, canvases, threads, list);
        self.options.progress.end();
        if !is_late && !self.is_stopped() {
            return Ok(failed);
        }
        if is_late {
            self.options.stop.store(false, Ordering::Relaxed);
        }
        let part = self.rendered_part(&jobs, list, threads);
        self.each_sum(|sum| drop(sum.drop_pass()));
        Err(part)
    }

    /// Returns the noise sources that the frame has, as far as its passes have shown.
    fn noise_sources(&self) -> Vec<NoiseSource> {
        let of_shading = self.shader.noise_sources();
        let is_there = |source: &NoiseSource| match source {
            NoiseSource::Edges => true,
            NoiseSource::Motion => self.pattern.blur || of_shading.contains(source),
            NoiseSource::Lens => self.pattern.defocus,
            _ => of_shading.contains(source),
        };
        NoiseSource::ALL.into_iter().filter(is_there).collect()
    }

    /// Measures the part of each noise source in the error of the images. For each one, the first pass is rendered
    /// again with other random numbers for this source alone. The differences are its variance in one pass.
    fn measure_sources(
        &mut self,
        scene: &Scene,
        plan: &PassPlan,
        errors: &mut [Option<ErrorEstimate>],
        canvases: &[Mutex<Canvas>],
        threads: usize,
    ) {
        let Some(crop) = self.passes.as_ref().map(|passes| passes.crop) else { return };
        let is_seen = |rect: &PixelRect| !rect.intersection(&crop).is_empty();
        let first = self.passes.as_ref().map_or(0, |passes| passes.first);
        self.set_accuracy_of_pass(first);
        let larger = self.passes.as_ref().map_or_else(Larger::default, |passes| passes.step_of(first).larger);
        for source in self.noise_sources() {
            self.begin_pass(scene, (0, NoiseSources::of(source)), plan.error.is_some(), Some(larger));
            let seen = self.buckets.order.iter().enumerate().filter(|(_, rect)| is_seen(rect));
            let list: Vec<usize> = seen.map(|(index, _)| index).collect();
            let limit = plan.deadline.map(|deadline| Limit::At(deadline + plan.grace));
            if self.render_pass(scene, limit, canvases, threads, &list).is_err() {
                break;
            }
            let Some(passes) = &self.passes else { return };
            for (sum, error) in passes.sums.iter().zip(errors.iter_mut()) {
                let mut sum = sum.lock();
                let (squared, mean) = (sum.compare(&crop), sum.mean());
                if let Some((estimate, mean)) = error.as_mut().zip(mean.filter(|mean| *mean != 0.0)) {
                    estimate.causes[source as usize] = Some(squared.sqrt() / mean.abs());
                }
            }
        }
    }

    /// Sets the accuracy of a pass.
    fn set_accuracy_of_pass(&mut self, number: u32) {
        let step = self.passes.as_ref().map(|passes| passes.step_of(number));
        let Step { level, larger, .. } = step.unwrap_or_default();
        self.set_accuracy(Accuracy { samples: larger.samples(), ..Accuracy::of_level(level) });
    }

    /// Adds a complete pass to the images. The first ones of a step replace those before when there are enough of them
    /// to know their error.
    fn add_pass(&mut self, number: u32) {
        let Some(passes) = &mut self.passes else { return };
        let first = passes.first_of(number);
        if first > passes.first || passes.is_held {
            if number + 1 < first + PILOT {
                return self.each_sum(Accumulated::wait);
            }
            let is_held = std::mem::take(&mut passes.is_held);
            if is_held {
                passes.bias.clear();
            }
            let levels = passes.step_of(number).level - passes.step_of(passes.first).level;
            for _ in 0..levels {
                passes.bias.iter_mut().for_each(|bias| *bias = bias.remains());
            }
            passes.first = first;
            // Those that are one level coarser show where there is bias.
            if passes.measured_after == first + PILOT && (is_held || levels == 1) {
                self.each_sum(Accumulated::keep_coarser);
            }
            self.each_sum(Accumulated::restart);
        }
        self.each_sum(Accumulated::end_pass);
    }

    /// Calls `each` with the sum of every image.
    pub(super) fn each_sum(&self, mut each: impl FnMut(&mut Accumulated)) {
        let sums = self.passes.iter().flat_map(|passes| &passes.sums);
        sums.for_each(|sum| each(&mut sum.lock()));
    }

    /// Prepares the samples, filters and shading of a pass. With a requested error, passes after the first ones render
    /// tiles instead of buckets, and so do large ones of the images. Tiles do not depend on the size of buckets, and
    /// samples of large passes fit into them.
    /// `apart` has the samples of a pass that is no part of the images. `varied` are noise sources with other numbers.
    /// The first pass of each step has the numbers of the frame without passes, so that levels can be compared.
    pub(super) fn begin_pass(
        &mut self,
        scene: &Scene,
        (pass, varied): (u32, NoiseSources),
        has_tiles: bool,
        apart: Option<Larger>,
    ) {
        let camera = self.options.camera;
        let (mut first_of_tiles, mut numbers) = (PILOT, PassNumbers::alone(pass));
        let mut larger = apart.unwrap_or_default();
        if let Some(passes) = &mut self.passes {
            passes.number = pass;
            passes.is_apart = apart.is_some();
            first_of_tiles = passes.first_of_tiles;
            if apart.is_none() {
                larger = passes.step_of(pass).larger;
                numbers = PassNumbers::of(pass - passes.first_of(pass));
            }
        }
        let numbers = PassNumbers { varied, ..numbers };
        self.shader.begin_pass(numbers);
        let of_samples = with_more_samples(camera, 1 << larger.pixels);
        self.set_pattern(SamplePattern::of_pass(&of_samples, is_moving(scene, camera), numbers));
        let is_larger = larger.is_any() && (has_tiles || apart.is_none());
        if has_tiles && pass >= first_of_tiles || is_larger {
            let side = TILE.unsigned_abs();
            let order = BucketOrder::plain(&camera.bucketorder);
            self.buckets = Buckets::new(&camera.crop, [side; 2], order, self.pattern.per_pixel());
        }
    }

    /// Sets the samples of pixels, and prepares the filters for them.
    pub(super) fn set_pattern(&mut self, pattern: SamplePattern) {
        self.pattern = pattern;
        for (filters, image) in self.filters.iter_mut().zip(&self.outputs.images) {
            for (filter, layer) in filters.iter_mut().zip(&image.layers) {
                *filter = film::Support::new(&layer.filter, &self.pattern.tables);
            }
        }
    }

    /// Returns the buckets that a pass renders, in their order.
    fn buckets_of_pass(&self, pass: u32, decisions: &[Decision], has_tiles: bool) -> Vec<usize> {
        let all = 0..self.buckets.order.len();
        let has_tiles = |passes: &&Passes| has_tiles && pass >= passes.first_of_tiles;
        let Some(passes) = self.passes.as_ref().filter(has_tiles) else {
            return all.collect();
        };
        let whole = self.options.camera.crop;
        let is_wanted = |index: &usize| {
            let rect = self.buckets.order[*index];
            let corner = [rect.x0, rect.y0].map(|at| at.div_euclid(TILE) * TILE);
            let [x0, y0] = corner;
            let tile = PixelRect { x0, x1: x0 + TILE, y0, y1: y0 + TILE }.intersection(&whole);
            let first = Accumulated::place_in_cut(&whole, TILE, [x0, y0]);
            let wants = |(sum, decision): (&Mutex<Accumulated>, &Decision)| {
                let plan = decision.as_ref().and_then(|plan| Some((plan.rule, plan.first.get(first)?)));
                plan.is_some_and(|(rule, first)| rule.wants(&sum.lock().spot(&tile), first))
            };
            // The decisions follow from the whole image.
            let is_seen = pass < passes.first_of_tiles + WHOLE || !tile.intersection(&passes.crop).is_empty();
            is_seen && passes.sums.iter().zip(decisions).any(wants)
        };
        all.filter(is_wanted).collect()
    }

    /// Prepares the buckets for a pass that renders those of `list`. The others need no grids.
    fn release_others(&mut self, list: &[usize]) {
        let count = self.buckets.order.len();
        let mut is_listed = vec![false; count];
        list.iter().for_each(|index| is_listed[*index] = true);
        let eyes = 0..self.eyes.len();
        self.passed = eyes.flat_map(|_| is_listed.iter().map(|listed| AtomicBool::new(!listed))).collect();
    }

    /// Decides from the first passes of the whole image how many passes each part needs. `before` are the decisions
    /// from half as many, which show how fast the noise falls. Until then, passes are taken for independent.
    fn decisions(&self, error: f32, before: &[Decision]) -> Vec<Decision> {
        let whole = self.options.camera.crop;
        let error = f64::from(error);
        let decision = |(index, (sum, bias)): (usize, (&Mutex<Accumulated>, SquaredBias))| {
            let sum = sum.lock();
            let mean = sum.mean().filter(|_| sum.colors() > 0)?;
            let tiles: Vec<Spot> = Accumulated::cut(&whole, TILE).iter().map(|tile| sum.spot(tile)).collect();
            let before = before.get(index).and_then(Option::as_ref);
            let power = before.map_or(1.0, |before| fall(&before.first, &tiles));
            let rule = Rule::new(&tiles, bias.leaves(error) * mean * mean, power);
            Some(Plan { rule, mean, first: tiles })
        };
        let Some(passes) = &self.passes else { return Vec::new() };
        let bias = passes.bias.iter().copied().chain(std::iter::repeat(SquaredBias::default()));
        passes.sums.iter().zip(bias).enumerate().map(decision).collect()
    }

    /// Renders the buckets of `list`. Gives up at the time `limit`. Returns the number of buckets that failed, and true
    /// when it gave up.
    fn run_until(
        &self,
        limit: Option<Limit>,
        jobs: &Jobs<S::Object>,
        canvases: &[Mutex<Canvas>],
        threads: usize,
        list: &[usize],
    ) -> (usize, bool) {
        let Some(limit) = limit else { return (self.run(jobs, canvases, threads, list), false) };
        let (is_over, changed) = (Mutex::new(false), Condvar::new());
        let is_late = AtomicBool::new(false);
        let is_expected = matches!(limit, Limit::Expected { .. });
        let saves = self.shader.saves();
        let stop = self.options.stop;
        let failed = std::thread::scope(|scope| {
            scope.spawn(|| {
                let mut over = is_over.lock();
                let mut at = limit.first();
                while !*over {
                    if !changed.wait_until(&mut over, at).timed_out() || *over {
                        continue;
                    }
                    match limit.look(self.rendered_part(jobs, list, threads)) {
                        Outlook::Unknown(next) => at = next,
                        Outlook::InTime => break,
                        // What was saved cannot be taken back.
                        Outlook::Late if is_expected && self.shader.saves() != saves => break,
                        Outlook::Late => {
                            is_late.store(true, Ordering::Relaxed);
                            stop.store(true, Ordering::Relaxed);
                            break;
                        }
                    }
                }
            });
            let failed = self.run(jobs, canvases, threads, list);
            *is_over.lock() = true;
            changed.notify_all();
            failed
        });
        (failed, is_late.into_inner())
    }

    /// Returns the part of the buckets of a list that the present pass has at most, by their expected cost. Those that
    /// are being rendered may be nearly complete.
    fn rendered_part(&self, jobs: &Jobs<S::Object>, list: &[usize], threads: usize) -> f64 {
        let Some(first) = self.passes.as_ref().and_then(|passes| passes.sums.first()) else { return 0.0 };
        let held = first.lock().held();
        let (mut part, mut all) = (0.0, 0.0);
        for index in list {
            let PixelRect { x0, y0, .. } = self.buckets.order[*index];
            let cost = jobs.cost(*index) as f64;
            all += cost;
            if held.contains(&[x0, y0]) {
                part += cost;
            }
        }
        let begun = threads as f64 / list.len().max(1) as f64;
        if all > 0.0 { (part / all + begun).min(1.0) } else { 0.0 }
    }
}

/// Returns a camera with `n` times the samples along each side of a pixel, and `n * n` times the different times and
/// points of the lens.
fn with_more_samples(camera: &CameraView, n: u32) -> CameraView {
    // A quality of 1 turns the blur off.
    let of_blur = |quality: u32| if quality > 1 { quality.saturating_mul(n * n) } else { quality };
    CameraView {
        spatialquality: camera.spatialquality.map(|samples| samples.saturating_mul(n)),
        temporalquality: of_blur(camera.temporalquality),
        dofquality: of_blur(camera.dofquality),
        ..camera.clone()
    }
}
