//! Measures what all passes of an image have in common (see [`crate::passes`]).

use super::coarse::Limit;
use super::levels::{Changes, Next, Passes, Step};
use super::{Frame, FrameShader};
use crate::PixelRect;
use crate::accuracy::{Accuracy, SquaredBias};
use crate::bucket::{BucketOrder, Buckets};
use crate::larger::Larger;
use crate::output::accumulated::Accumulated;
use crate::output::canvas::Canvas;
use crate::passes::{PILOT, PIXELS_PER_NUMBER, PassPlan};
use crate::refine::{Other, PassTime};
use granita_base::{NoiseSources, sample};
use granita_scene::Scene;
use parking_lot::Mutex;
use std::time::{Duration, Instant};

/// The side of the parts of an image in which bias is measured, in pixels, and their largest number.
const PROBE: i32 = 16;
const PROBES: usize = 12;

/// The weight of the contrast of a part of the image when probes are chosen, beside what changes with coarser surfaces.
/// Noise makes the latter uncertain.
const CONTRAST: f64 = 0.3;

/// The largest number of passes that bias is measured with.
const MOST_PASSES: u32 = 16;

/// The passes in which the parts of an image are rendered whose bias is measured.
#[derive(Clone, Copy)]
struct Passing {
    /// The requested error.
    error: f64,
    /// The largest number of passes.
    most: u32,
    /// How many samples they have.
    larger: Larger,
}

impl Passing {
    /// Returns those for an error, with a quarter of the samples that the error needs: `needed` passes of these are
    /// needed for it. A pass in the probes, with both accuracies, takes about half of the time of a pass, and more in
    /// small images. Of larger passes, few show the bias.
    fn new(error: f64, needed: f64, larger: Larger) -> Self {
        let least = if larger.is_any() { PILOT + 1 } else { 2 * PILOT };
        Self { error, most: ((needed / 4.0) as u32).clamp(least, MOST_PASSES), larger }
    }
}

/// The least part of the passes of the whole image that its parts need in the mean. Some need fewer than others.
const LEAST_OF_PARTS: f64 = 0.5;

/// What every pass is rendered with.
pub(super) struct Run<'p> {
    pub(super) scene: &'p Scene,
    pub(super) plan: &'p PassPlan,
    pub(super) canvases: &'p [Mutex<Canvas>],
    pub(super) threads: usize,
}

/// A part of an image in which bias is measured.
struct Probe {
    rect: PixelRect,
    /// The number of times that it was chosen.
    times: f64,
    /// The sum over all probes of the factor times a value estimates the sum of the value over all parts.
    factor: f64,
}

/// The products of the differences of passes from more accurate ones.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Covariance {
    /// Their mean, over all pairs of passes and all colours. Noise has no part in it, because passes are independent.
    product: f64,
    /// The mean variance of a difference between passes.
    variance: f64,
    /// The number of colours.
    colors: usize,
    /// The number of passes.
    passes: usize,
}

impl Covariance {
    /// Returns the standard deviation that `product` has from noise, for a number of pixels.
    fn noise(&self, pixels: f64) -> f64 {
        let pairs = (self.passes * (self.passes - 1)) as f64 / 2.0;
        self.variance / (pairs * (pixels / PIXELS_PER_NUMBER).max(1.0)).sqrt()
    }
}

/// Returns the products of two or more passes. `differences` has the same colours of each.
fn covariance(differences: &[&[f32]]) -> Covariance {
    let passes = differences.len();
    let mut found = Covariance { passes, ..Covariance::default() };
    for k in 0..differences.first().map_or(0, |colors| colors.len()) {
        let own = || differences.iter().map(|pass| f64::from(pass[k]));
        let (sum, squares) = (own().sum::<f64>(), own().map(|v| v * v).sum::<f64>());
        let product = (sum * sum - squares) / (passes * (passes - 1)) as f64;
        if product.is_finite() {
            found.product += product;
            found.variance += squares / passes as f64 - product;
            found.colors += 1;
        }
    }
    let n = found.colors.max(1) as f64;
    Covariance { product: found.product / n, variance: found.variance / n, ..found }
}

/// Returns the number of pixels of a rectangle that see different points of the surfaces below a level: a quarter of
/// all for level 0, and all for those above.
fn coarse_pixels(rect: &PixelRect, level: i32) -> f64 {
    (rect.width() * rect.height()) as f64 * 4.0_f64.powi((level - 1).min(0))
}

/// True when so many passes that take `time` leave as much time for the image.
pub(super) fn has_time_for(plan: &PassPlan, time: Duration, passes: u32) -> bool {
    plan.has_time_for(2 * time * passes)
}

/// Returns the number of levels above one that images with a bias need for an error.
fn steps(level: i32, bias: &[SquaredBias], error: f64) -> i32 {
    bias.iter().map(|bias| Accuracy::steps(level, bias.root(), error)).max().unwrap_or(0)
}

/// Returns the mean of an image whose bias can be measured.
fn mean_of(sum: &Accumulated) -> Option<f64> {
    sum.mean().filter(|mean| *mean != 0.0 && sum.colors() > 0)
}

/// Returns the squared bias of an image with a mean. `passes` has, for each pass, the differences of the colours of all
/// probes from those of a pass with the same numbers and more accuracy, and `coarser` those from passes with less.
/// `whole` is the rectangle of all parts, and `level` the level of the image.
fn squared_bias(
    (sum, mean): (&Accumulated, f64),
    (whole, level): (&PixelRect, i32),
    probes: &[Probe],
    (passes, coarser): (&[Vec<f32>], &[Vec<f32>]),
) -> SquaredBias {
    // The sum over the image of each choice alone, as if all choices were like it.
    let choices: f64 = probes.iter().map(|probe| probe.times).sum();
    let (mut sums, mut noise, mut begin) = (Vec::with_capacity(probes.len()), 0.0, 0);
    let mut of_coarser = [0.0; 2];
    for Probe { rect, times, factor } in probes {
        let end = begin + sum.values_in(rect);
        let in_probe = |passes: &[Vec<f32>]| {
            let own: Vec<&[f32]> = passes.iter().map(|pass| &pass[begin..end]).collect();
            covariance(&own)
        };
        let [found, below] = [passes, coarser].map(in_probe);
        let weight = factor * found.colors as f64;
        sums.push((*times, found.product * weight * choices / times));
        let pixels = (rect.width() * rect.height()) as f64;
        noise += (weight * found.noise(pixels)).powi(2);
        let weight = factor * below.colors as f64;
        of_coarser[0] += below.product * weight;
        of_coarser[1] += (weight * below.noise(coarse_pixels(rect, level))).powi(2);
        begin = end;
    }
    let total = sums.iter().map(|(times, sum)| times * sum).sum::<f64>() / choices;
    let below = (of_coarser[0], of_coarser[1].sqrt());
    let (shown, grows) = match level < 0 {
        true => (Accuracy::shown_of_coarse(total, below), Accuracy::grows(total, below)),
        false => (Accuracy::SHOWN.powi(2), false),
    };
    let spread = sums.iter().map(|(times, sum)| times * (sum - total).powi(2)).sum::<f64>();
    let deviation = (spread / (choices * (choices - 1.0))).sqrt();
    let all = sum.values_in(whole) as f64;
    let relative = |v: f64| v / (all * mean * mean * shown);
    match total.is_finite() && all > 0.0 {
        true => SquaredBias {
            value: relative(total),
            deviation: relative(deviation),
            noise: relative(noise.sqrt()),
            grows,
        },
        false => SquaredBias::default(),
    }
}

impl<S: FrameShader> Frame<'_, S> {
    /// Sets how accurately the following passes compute what they have in common.
    pub(super) fn set_accuracy(&mut self, accuracy: Accuracy) {
        self.dicing.finer = self.options.finer * accuracy.dicing;
        self.shader.set_tolerance(accuracy.tolerance);
        self.shader.set_samples(accuracy.samples);
    }

    /// Measures the bias of the images after the first passes of the coarse level or of the scene's own accuracy, and
    /// decides the level that the requested error needs. `time` is that of one pass.
    ///
    /// Where the time is too short for that, or for what the error needs, it ends the passes, as if no error was
    /// requested ([`super::refine`]). The bias is then the most that the change by the level below permits, until it is
    /// measured.
    pub(super) fn measure_bias(&mut self, run: &Run<'_>, error: f64, time: Duration) -> Next {
        let Some(passes) = self.passes.as_ref().filter(|passes| passes.has_colors()) else {
            return Next::Pass;
        };
        if passes.last_step().level > 0 {
            return self.measure_bias_again(run, error, time);
        }
        let (level, is_short) = (passes.last_step().level, passes.first_of_tiles == u32::MAX);
        let (is_compared, time_of_coarse) = (passes.is_compared(), passes.time_below);
        let plan = run.plan;
        if level < 0 && !plan.has_time_for(time) {
            return Next::End;
        }
        let needed = self.passes_of(Larger::default(), error);
        let rest = LEAST_OF_PARTS * (needed - f64::from(PILOT)).max(0.0);
        let may_end = plan.has_time_for(time.mul_f64(rest));
        let begin = Instant::now();
        let may_change = is_compared || may_end && has_time_for(plan, time, PILOT);
        let changes = if may_change { self.changes_of_frame(run, level) } else { None };
        let time_below = if is_compared { time_of_coarse } else { begin.elapsed() / PILOT };
        if is_short {
            return self.go_on_in_time((plan, error), changes, (time, time_below));
        }
        let larger = self.larger_passes(run, (level, &[]), error);
        let passing = Passing::new(error, self.passes_of(larger, error), larger);
        let squared = changes.as_ref().map_or_else(Vec::new, |changes| self.squared_changes(changes, level));
        let may_measure = may_end && has_time_for(plan, time, passing.most);
        let is_too_large = level < 0 && squared.iter().any(|change| change.is_too_large_for(error));
        let found = match &changes {
            _ if is_too_large => None,
            // Where even the level below changes little, bias cannot matter.
            Some(_) if squared.iter().all(|change| change.is_small_for(error)) => Some(squared.clone()),
            Some(changes) if may_measure => self.bias_of_parts(run, passing, (level, changes)),
            _ => None,
        };
        let more = found.as_ref().map(|bias| steps(level, bias, error));
        let is_certain = found.as_ref().is_some_and(|bias| bias.iter().all(SquaredBias::shows_rest));
        // As few passes as are requested are best those of the scene's own accuracy.
        let is_last = more.is_some_and(|more| more > 0 && (!is_certain || plan.most() < 2 * PILOT));
        if level < 0 && (is_too_large || is_last) {
            return self.end_coarse(time);
        }
        let Some((bias, more)) = found.zip(more) else {
            return self.go_on_in_time((plan, error), changes, (time, time_below));
        };
        let larger = self.larger_passes(run, (level, &bias), error);
        if more > 0 || larger.is_any() {
            let time_of =
                PassTime::new(time.as_secs_f64(), (time_below.as_secs_f64(), 1), self.draws_in_shading());
            let passes = self.other_passes(&bias, (more, larger), error);
            let all = Duration::try_from_secs_f64(passes * time_of.of((more, larger)));
            if !all.is_ok_and(|all| plan.has_time_for(all)) {
                return self.go_on_in_time((plan, error), changes, (time, time_below));
            }
        }
        let Some(passes) = &mut self.passes else { return Next::Pass };
        passes.bias = bias;
        if more > 0 || larger.is_any() {
            passes.go_on_with(more, larger);
        }
        Next::Pass
    }

    /// Lets time end the passes instead of an error, for which it is too short. They take `time`, and those of the
    /// level below `time_below`, which have the `changes` if these are known. Coarse passes are followed by those of
    /// the scene's own accuracy first, which may have the error with the largest bias that the changes permit.
    fn go_on_in_time(
        &mut self,
        (plan, error): (&PassPlan, f64),
        changes: Option<Changes>,
        (time, time_below): (Duration, Duration),
    ) -> Next {
        let Some(passes) = &mut self.passes else { return Next::Pass };
        passes.first_of_tiles = u32::MAX;
        let level = passes.last_step().level;
        if level < 0 {
            return self.end_coarse(time);
        }
        let squared = changes.as_ref().map_or_else(Vec::new, |changes| self.squared_changes(changes, level));
        let Some(passes) = &mut self.passes else { return Next::Pass };
        passes.bias = squared.into_iter().map(SquaredBias::largest).collect();
        let is_timed = self.may_be_timed(plan) && !self.is_reached_by_whole_passes(error);
        let Some(passes) = &mut self.passes else { return Next::Pass };
        (passes.changes, passes.time_below) = (changes.filter(|_| is_timed), time_below);
        passes.is_timed = is_timed;
        Next::Pass
    }

    /// Returns the least number of other passes that images with a bias need for an error: some levels above, where
    /// that may be larger.
    fn other_passes(&self, bias: &[SquaredBias], (more, larger): Other, error: f64) -> f64 {
        let of_pixels = |index| self.passes.as_ref().and_then(|passes| passes.of_pixels.get(index).copied());
        let of_image = |(index, bias): (usize, &SquaredBias)| {
            let needed = self.needed_passes_above(index, (*bias, more), error);
            LEAST_OF_PARTS * needed * larger.left(of_pixels(index).unwrap_or(1.0), more)
        };
        bias.iter().enumerate().map(of_image).fold(PILOT.into(), f64::max)
    }

    /// Measures the bias of the level that is [`Accuracy::MOST_AT_ONCE`] above the one where it was too large, with few
    /// passes, and decides whether the requested error needs a higher one. Where the time is too short for it, it ends
    /// the passes.
    fn measure_bias_again(&mut self, run: &Run<'_>, error: f64, time: Duration) -> Next {
        let Some(Step { level, larger, .. }) = self.passes.as_ref().map(Passes::last_step) else {
            return Next::Pass;
        };
        let passing = Passing::new(error, 0.0, larger);
        if !has_time_for(run.plan, time, passing.most) {
            let is_timed = self.may_be_timed(run.plan);
            if let Some(passes) = self.passes.as_mut().filter(|_| is_timed) {
                (passes.first_of_tiles, passes.is_timed) = (u32::MAX, true);
                return Next::Pass;
            }
            return Next::End;
        }
        let Some(changes) = self.changes_of_frame(run, level) else { return Next::End };
        let Some(bias) = self.bias_of_parts(run, passing, (level, &changes)) else { return Next::End };
        let more = steps(level, &bias, error);
        if let Some(passes) = &mut self.passes {
            passes.bias = bias;
            if more > 0 {
                passes.go_on_with(more, larger);
            }
        }
        Next::Pass
    }

    /// True when whole passes have the requested error, where there was no time to measure the bias in parts of the
    /// image.
    pub(super) fn is_reached_by_whole_passes(&self, error: f64) -> bool {
        let whole = self.options.camera.crop;
        let Some(passes) = self.passes.as_ref().filter(|passes| passes.first_of_tiles == u32::MAX) else {
            return false;
        };
        let is_reached = |(sum, bias): (&Mutex<Accumulated>, &SquaredBias)| {
            let sum = sum.lock();
            let found = mean_of(&sum).and_then(|mean| sum.error(&whole, mean));
            found.is_none_or(|found| found.with_bias(bias).is_within(error as f32))
        };
        !passes.bias.is_empty() && passes.sums.iter().zip(&passes.bias).all(is_reached)
    }

    /// Returns for each of the first passes of a level how the colours of each image differ from those of the level
    /// below, which are rendered unless they are there; `None` when a pass was given up.
    pub(super) fn changes_of_frame(&mut self, run: &Run<'_>, level: i32) -> Option<Changes> {
        let passes = self.passes.as_mut()?;
        if let Some(changes) = passes.changes.take() {
            return Some(changes);
        }
        let is_compared = passes.is_compared();
        let all: Vec<usize> = (0..self.buckets.order.len()).collect();
        let change = |pass| {
            let mut coarser = Vec::new();
            if is_compared {
                self.each_sum(|sum| coarser.push(sum.take_coarser(pass as usize)));
            } else {
                coarser =
                    self.colors_apart(run, (pass, Accuracy::of_level(level - 1), Larger::default()), &all)?;
            }
            Some(self.changes(pass as usize, coarser))
        };
        (0..PILOT).map(change).collect()
    }

    /// Returns the squared bias of each image, from parts of it in as many passes as the requested error needs; `None`
    /// when the measurement was given up.
    fn bias_of_parts(
        &mut self,
        run: &Run<'_>,
        passing: Passing,
        (level, changes): (i32, &[Vec<Vec<f32>>]),
    ) -> Option<Vec<SquaredBias>> {
        let camera = self.options.camera;
        let probes = self.probes(changes, level);
        let order = BucketOrder::plain(&camera.bucketorder);
        let of_probes =
            Buckets::new(&camera.crop, [PROBE.unsigned_abs(); 2], order, self.pattern.per_pixel());
        let buckets = std::mem::replace(&mut self.buckets, of_probes);
        let bias = self.bias_of_probes(run, passing, (level, &probes), changes);
        self.buckets = buckets;
        bias
    }

    /// Renders the buckets of `list` in a pass that is no part of the images. Returns the colours of all pixels of each
    /// image, NaN for other pixels; `None` when the pass was given up.
    fn colors_apart(
        &mut self,
        &Run { scene, plan, canvases, threads }: &Run<'_>,
        (pass, accuracy, larger): (u32, Accuracy, Larger),
        list: &[usize],
    ) -> Option<Vec<Vec<f32>>> {
        let limit = plan.deadline.map(|deadline| Limit::At(deadline + plan.grace));
        self.set_accuracy(accuracy);
        self.begin_pass(scene, (pass, NoiseSources::default()), false, Some(larger));
        self.render_pass(scene, limit, canvases, threads, list).ok()?;
        let mut colors = Vec::new();
        self.each_sum(|sum| colors.push(sum.drop_colors()));
        Some(colors)
    }

    /// Returns the squared bias of each image from that of probes. `changes` has what coarser surfaces change, for each
    /// of the first passes and each image.
    fn bias_of_probes(
        &mut self,
        run: &Run<'_>,
        Passing { error, most, larger }: Passing,
        (level, probes): (i32, &[Probe]),
        changes: &[Vec<Vec<f32>>],
    ) -> Option<Vec<SquaredBias>> {
        let cell = |rect: &PixelRect| [rect.x0, rect.y0].map(|at| at.div_euclid(PROBE));
        let cells: Vec<[i32; 2]> = probes.iter().map(|probe| cell(&probe.rect)).collect();
        let all = self.buckets.order.iter().enumerate();
        let list: Vec<usize> =
            all.filter(|(_, rect)| cells.contains(&cell(rect))).map(|(index, _)| index).collect();
        let rects: Vec<PixelRect> = probes.iter().map(|probe| probe.rect).collect();
        let whole = self.options.camera.crop;
        let accuracy = Accuracy { samples: larger.samples(), ..Accuracy::of_level(level) };
        // For each image, the differences in each pass.
        let mut differences: Vec<Vec<Vec<f32>>> = Vec::new();
        let mut bias = Vec::new();
        for pass in 0..most {
            let begin = Instant::now();
            // The first passes are those of the image itself.
            let plain = match pass < PILOT && !larger.is_any() {
                true => None,
                false => Some(self.colors_apart(run, (pass, accuracy, larger), &list)?),
            };
            let finer = self.colors_apart(run, (pass, accuracy.finer(), larger), &list)?;
            differences.resize(finer.len(), Vec::new());
            let sums = self.passes.iter().flat_map(|passes| &passes.sums);
            for (index, (sum, out)) in sums.zip(&mut differences).enumerate() {
                let sum = sum.lock();
                let plain = plain.as_ref().map_or_else(|| sum.early(pass as usize), |colors| &*colors[index]);
                let [plain, finer] = [plain, &*finer[index]].map(|all| sum.colors_in(&rects, all));
                out.push(finer.iter().zip(plain).map(|(finer, plain)| finer - plain).collect());
            }
            // Parts of the image may take longer than their share of a pass. Time may not decide how well the bias is
            // known.
            if !has_time_for(run.plan, begin.elapsed(), most - pass - 1) {
                return None;
            }
            if pass + 1 < PILOT {
                continue;
            }
            let sums = self.passes.iter().flat_map(|passes| &passes.sums);
            let of_sum = |(index, (sum, passes)): (usize, (&Mutex<Accumulated>, &Vec<Vec<f32>>))| {
                let sum = sum.lock();
                let coarser: Vec<Vec<f32>> =
                    changes.iter().map(|pass| sum.colors_in(&rects, &pass[index])).collect();
                mean_of(&sum).map_or_else(SquaredBias::default, |mean| {
                    squared_bias((&sum, mean), (&whole, level), probes, (passes, &coarser))
                })
            };
            bias = sums.zip(&differences).enumerate().map(of_sum).collect();
            if bias.iter().all(|bias| bias.is_known_for(error)) {
                break;
            }
        }
        Some(bias)
    }

    /// Returns the number of passes that a squared noise of an image needs, as far as the first passes show it.
    fn needed_passes(&self, index: usize, squared: f64) -> f64 {
        let whole = self.options.camera.crop;
        let Some(sum) = self.passes.as_ref().and_then(|passes| passes.sums.get(index)) else { return 0.0 };
        let sum = sum.lock();
        let noise = sum.mean().and_then(|mean| sum.error(&whole, mean)).map_or(0.0, |found| found.error);
        f64::from(PILOT) * noise.powi(2) / squared
    }

    /// Returns the number of passes that an error needs beside what is left of the bias of an image some levels above.
    pub(super) fn needed_passes_above(
        &self,
        index: usize,
        (bias, steps): (SquaredBias, i32),
        error: f64,
    ) -> f64 {
        let remains = (0..steps).fold(bias, |bias, _| bias.remains());
        self.needed_passes(index, remains.leaves(error))
    }

    /// Returns the number of larger passes that the noise of all images needs for an error, if they had no bias, and if
    /// samples were independent of each other.
    fn passes_of(&self, larger: Larger, error: f64) -> f64 {
        let Some(passes) = &self.passes else { return 0.0 };
        let of_image = |index| {
            let of_pixels = passes.of_pixels.get(index).copied().unwrap_or(1.0);
            self.needed_passes(index, error * error) * larger.left_of_independent(of_pixels)
        };
        (0..passes.sums.len()).map(of_image).fold(0.0, f64::max)
    }

    /// Returns by how much the colours of each image in one of the first passes differ from those of coarser surfaces.
    fn changes(&self, pass: usize, mut coarser: Vec<Vec<f32>>) -> Vec<Vec<f32>> {
        let sums = self.passes.iter().flat_map(|passes| &passes.sums);
        for (colors, sum) in coarser.iter_mut().zip(sums) {
            colors.iter_mut().zip(sum.lock().early(pass)).for_each(|(color, plain)| *color -= plain);
        }
        coarser
    }

    /// Returns the mean square of what the level below changes in each image, over the square of its mean.
    pub(super) fn squared_changes(&self, changes: &[Vec<Vec<f32>>], level: i32) -> Vec<SquaredBias> {
        let whole = self.options.camera.crop;
        let of_sum = |(index, sum): (usize, &Mutex<Accumulated>)| {
            let sum = sum.lock();
            mean_of(&sum).map_or_else(SquaredBias::default, |mean| {
                let all: Vec<&[f32]> = changes.iter().map(|pass| &*pass[index]).collect();
                let found = covariance(&all);
                let noise = found.noise(coarse_pixels(&whole, level));
                SquaredBias { value: found.product, deviation: noise, noise, grows: false }
                    .scaled(1.0 / (mean * mean))
            })
        };
        self.passes.iter().flat_map(|passes| &passes.sums).enumerate().map(of_sum).collect()
    }

    /// Chooses small parts of the image in which the bias is measured, more often where colours differ from those of
    /// coarser surfaces by their `changes`, and where there is contrast.
    fn probes(&self, changes: &[Vec<Vec<f32>>], level: i32) -> Vec<Probe> {
        let Some(passes) = &self.passes else { return Vec::new() };
        let parts = Accumulated::cut(&self.options.camera.crop, PROBE);
        let (mut changed, mut contrasts) = (vec![0.0; parts.len()], vec![0.0; parts.len()]);
        for (index, sum) in passes.sums.iter().enumerate() {
            let sum = sum.lock();
            let Some(squared) = mean_of(&sum).map(|mean| mean * mean) else { continue };
            for ((part, changed), contrast) in parts.iter().zip(&mut changed).zip(&mut contrasts) {
                let of_part: Vec<Vec<f32>> =
                    changes.iter().map(|pass| sum.colors_in(&[*part], &pass[index])).collect();
                let all: Vec<&[f32]> = of_part.iter().map(Vec::as_slice).collect();
                let found = covariance(&all);
                let noise = found.noise(coarse_pixels(part, level));
                let is_sure = found.product > 2.0 * noise;
                *changed += if is_sure { found.product * found.colors as f64 / squared } else { 0.0 };
                *contrast += sum.contrast(part) / squared;
            }
        }
        let share = |values: &[f64]| 1.0 / values.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        let (of_changes, of_contrasts) = (share(&changed), CONTRAST * share(&contrasts));
        let sizes: Vec<f64> =
            changed.iter().zip(&contrasts).map(|(a, b)| a * of_changes + b * of_contrasts).collect();
        let count = (parts.len() / 12).clamp(6, PROBES);
        let chosen = sample::in_proportion(&sizes, count, 0.2);
        let probe = |(part, times, factor): (usize, usize, f64)| {
            let rect: PixelRect = parts[part];
            Probe { rect, times: times as f64, factor }
        };
        chosen.into_iter().map(probe).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::covariance;
    use granita_base::hash;

    #[test]
    fn noise_has_no_part_in_covariance() {
        let noise = |number: u32, k: u32| hash::unit(hash::words(&[number, k])) - 0.5;
        let pass = |number: u32| (0..10_000).map(|k| 0.1 + noise(number, k)).collect::<Vec<f32>>();
        let passes: Vec<Vec<f32>> = (0..6).map(pass).collect();
        let all: Vec<&[f32]> = passes.iter().map(Vec::as_slice).collect();
        let found = covariance(&all);
        assert_eq!((found.colors, found.passes), (10_000, 6));
        assert!(
            (found.product - 0.01).abs() < 0.001 && (found.variance - 1.0 / 12.0).abs() < 0.001,
            "{found:?}"
        );
        // 15 pairs of passes, and a thousand independent pixels.
        assert!((found.noise(9000.0) - found.variance / 15_000_f64.sqrt()).abs() < 1e-12);
        let lost = covariance(&[&[f32::NAN, 2.0], &[1.0, 3.0]]);
        assert_eq!((lost.product, lost.variance, lost.colors), (6.0, 0.5, 1));
    }
}
