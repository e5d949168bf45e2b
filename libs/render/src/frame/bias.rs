//! Measures what all passes of an image have in common (see [`crate::passes`]).

use super::coarse::Limit;
use super::{Frame, FrameShader};
use crate::PixelRect;
use crate::bucket::{BucketOrder, Buckets};
use crate::output::accumulated::Accumulated;
use crate::output::canvas::Canvas;
use crate::passes::{Accuracy, PILOT, PassPlan, SquaredBias};
use granita_base::{PassNumbers, sample};
use granita_scene::Scene;
use parking_lot::Mutex;
use std::time::Duration;

/// The side of the parts of an image in which bias is measured, in pixels, and their largest number.
const PROBE: i32 = 16;
const PROBES: usize = 12;

/// The largest number of passes that bias is measured with.
const MOST_PASSES: u32 = 16;

/// A part of an image in which bias is measured.
struct Probe {
    rect: PixelRect,
    /// The number of times that it was chosen.
    times: f64,
    /// The sum over all probes of the factor times a value estimates the sum of the value over all parts.
    factor: f64,
}

/// Returns the mean of the products of differences of two passes, over all pairs of passes and all colours, and the
/// number of colours. `differences` has the same colours of each pass. Their noise has no part in the product, because
/// passes are independent.
fn covariance(differences: &[&[f32]]) -> (f64, usize) {
    let pairs = (differences.len() * (differences.len() - 1)) as f64;
    let (mut sum, mut colors) = (0.0, 0_usize);
    for k in 0..differences.first().map_or(0, |colors| colors.len()) {
        let own = || differences.iter().map(|pass| f64::from(pass[k]));
        let product = (own().sum::<f64>().powi(2) - own().map(|v| v * v).sum::<f64>()) / pairs;
        if product.is_finite() {
            (sum, colors) = (sum + product, colors + 1);
        }
    }
    (sum / colors.max(1) as f64, colors)
}

/// Returns the squared bias of an image with a mean. `passes` has, for each pass, the differences of the colours of all
/// probes from those of a pass with the same numbers and more accuracy.
fn squared_bias(sum: &Accumulated, mean: f64, probes: &[Probe], passes: &[Vec<f32>]) -> SquaredBias {
    // The sum over the image of each choice alone, as if all choices were like it.
    let choices: f64 = probes.iter().map(|probe| probe.times).sum();
    let (mut sums, mut all, mut begin) = (Vec::with_capacity(probes.len()), 0.0, 0);
    for Probe { rect, times, factor } in probes {
        let end = begin + sum.values_in(rect);
        let own: Vec<&[f32]> = passes.iter().map(|pass| &pass[begin..end]).collect();
        let (product, colors) = covariance(&own);
        let weight = factor * colors as f64;
        sums.push((*times, product * weight * choices / times));
        (all, begin) = (all + weight, end);
    }
    let total = sums.iter().map(|(times, sum)| times * sum).sum::<f64>() / choices;
    let spread = sums.iter().map(|(times, sum)| times * (sum - total).powi(2)).sum::<f64>();
    let deviation = (spread / (choices * (choices - 1.0))).sqrt();
    let relative = |v: f64| v / (all * mean * mean);
    match total.is_finite() && all > 0.0 {
        true => SquaredBias { value: relative(total), deviation: relative(deviation) },
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

    /// Measures the bias of the images after the first passes, and sets the accuracy that the requested error needs.
    /// Where that is finer than what the scene says, the images begin again with the next pass. `time` is that of one
    /// pass. Without the time for the measurement, the following passes render the whole frame: then the images are
    /// those of as many passes without a requested error, and time has decided only their number.
    pub(super) fn measure_bias(
        &mut self,
        (scene, plan): (&Scene, &PassPlan),
        error: f32,
        time: Duration,
        canvases: &[Mutex<Canvas>],
        threads: usize,
    ) {
        if !self.passes.as_ref().is_some_and(super::passes::Passes::has_colors) {
            return;
        }
        let most = self.most_passes_of_bias(error.into());
        let bias = plan.has_time_for(time * most).then(|| {
            let camera = self.options.camera;
            let probes = self.probes();
            let order = BucketOrder::plain(&camera.bucketorder);
            let side = PROBE.unsigned_abs();
            let of_probes = Buckets::new(&camera.crop, [side; 2], order, self.pattern.per_pixel());
            let buckets = std::mem::replace(&mut self.buckets, of_probes);
            let bias = self.bias_of_probes((scene, plan), (error.into(), most), &probes, canvases, threads);
            self.buckets = buckets;
            self.set_accuracy(Accuracy::SCENE);
            bias
        });
        let Some(passes) = &mut self.passes else { return };
        let Some(bias) = bias.flatten() else {
            passes.first_of_tiles = u32::MAX;
            return;
        };
        let level = bias.iter().map(|bias| Accuracy::level(bias.root(), error.into())).max().unwrap_or(0);
        passes.bias = bias;
        if level > 0 {
            (passes.level, passes.first_of_tiles) = (level, 2 * PILOT);
            self.set_accuracy(Accuracy::of_level(level));
        }
    }

    /// Returns the squared bias of each image, from as many passes as the requested error needs, at most `most`; `None`
    /// when the measurement was given up.
    fn bias_of_probes(
        &mut self,
        (scene, plan): (&Scene, &PassPlan),
        (error, most): (f64, u32),
        probes: &[Probe],
        canvases: &[Mutex<Canvas>],
        threads: usize,
    ) -> Option<Vec<SquaredBias>> {
        let cell = |rect: &PixelRect| [rect.x0, rect.y0].map(|at| at.div_euclid(PROBE));
        let cells: Vec<[i32; 2]> = probes.iter().map(|probe| cell(&probe.rect)).collect();
        let all = self.buckets.order.iter().enumerate();
        let list: Vec<usize> =
            all.filter(|(_, rect)| cells.contains(&cell(rect))).map(|(index, _)| index).collect();
        let rects: Vec<PixelRect> = probes.iter().map(|probe| probe.rect).collect();
        let limit = plan.deadline.map(|deadline| Limit::At(deadline + plan.grace));
        // For each image, the differences in each pass.
        let mut differences: Vec<Vec<Vec<f32>>> = Vec::new();
        let mut bias = Vec::new();
        for pass in 0..most {
            let render = |frame: &mut Self, accuracy| {
                frame.set_accuracy(accuracy);
                frame.begin_pass(scene, PassNumbers::of(pass), false, true);
                frame.render_pass(scene, limit, canvases, threads, &list).ok()?;
                let mut colors = Vec::new();
                frame.each_sum(|sum| {
                    let of_pass = sum.drop_colors();
                    colors.push(sum.colors_in(&rects, &of_pass));
                });
                Some(colors)
            };
            let plain = if pass < PILOT {
                let mut colors = Vec::new();
                self.each_sum(|sum| colors.push(sum.colors_in(&rects, sum.early(pass as usize))));
                colors
            } else {
                render(self, Accuracy::SCENE)?
            };
            let finer = render(self, Accuracy::FINER)?;
            differences.resize(finer.len(), Vec::new());
            for ((plain, finer), out) in plain.iter().zip(&finer).zip(&mut differences) {
                out.push(finer.iter().zip(plain).map(|(finer, plain)| finer - plain).collect());
            }
            if pass + 1 < PILOT {
                continue;
            }
            let sums = self.passes.iter().flat_map(|passes| &passes.sums);
            let of_sum = |(sum, passes): (&Mutex<Accumulated>, &Vec<Vec<f32>>)| {
                let sum = sum.lock();
                let mean = sum.mean().filter(|mean| *mean != 0.0 && sum.colors() > 0);
                mean.map_or_else(SquaredBias::default, |mean| squared_bias(&sum, mean, probes, passes))
            };
            bias = sums.zip(&differences).map(of_sum).collect();
            if bias.iter().all(|bias| bias.is_known_for(error)) {
                break;
            }
        }
        Some(bias)
    }

    /// Returns the largest number of passes that the bias is measured with: a quarter of those that the requested
    /// error needs, as far as the first passes show it.
    fn most_passes_of_bias(&self, error: f64) -> u32 {
        let whole = self.options.camera.crop;
        let needed = |sum: &Mutex<Accumulated>| {
            let sum = sum.lock();
            let noise = sum.mean().and_then(|mean| sum.error(&whole, mean)).map_or(0.0, |found| found.error);
            f64::from(PILOT) * (noise / error).powi(2)
        };
        let needed = self.passes.iter().flat_map(|passes| &passes.sums).map(needed).fold(0.0, f64::max);
        // A pass in the probes, with both accuracies, takes about half of the time of a pass, and more in small images.
        ((needed / 4.0) as u32).clamp(2 * PILOT, MOST_PASSES)
    }

    /// Chooses small parts of the image in which the bias is measured, more often where there is contrast.
    fn probes(&self) -> Vec<Probe> {
        let Some(passes) = &self.passes else { return Vec::new() };
        let parts = Accumulated::cut(&self.options.camera.crop, PROBE);
        let contrast = |part: &PixelRect| -> f64 {
            let of = |sum: &Mutex<Accumulated>| {
                let sum = sum.lock();
                let squared = sum.mean().map_or(0.0, |mean| mean * mean);
                if squared > 0.0 { sum.contrast(part) / squared } else { 0.0 }
            };
            passes.sums.iter().map(of).sum()
        };
        let contrasts: Vec<f64> = parts.iter().map(contrast).collect();
        let count = (parts.len() / 12).clamp(4, PROBES);
        let chosen = sample::in_proportion(&contrasts, count, 0.2);
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
        let (product, colors) = covariance(&all);
        assert_eq!(colors, 10_000);
        assert!((product - 0.01).abs() < 0.001, "{product}");
        let (lost, colors) = covariance(&[&[f32::NAN, 2.0], &[1.0, 3.0]]);
        assert_eq!((lost, colors), (6.0, 1));
    }
}
