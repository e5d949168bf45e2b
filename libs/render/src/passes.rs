//! Images that are the sum of passes: what is requested, and what was reached.
//!
//! A pass is a frame with random numbers of its own (sample positions, times, lens points, and all directions that
//! shading draws). Even and odd passes are independent of each other, and each continues the sequences of those before
//! it ([`granita_base::PassNumbers`]). The image is the mean of its passes, weighted with the weights of the pixel
//! filter, before gain, gamma and quantizing. It follows from the number of passes alone.
//!
//! The error of an image is `sqrt (mean ((a - b)^2)) / mean (b)` over the values of its colour channels, where `b` is
//! the mean of infinitely many passes. It is estimated from the difference between even and odd passes.
//!
//! What all passes have in common is bias. With a requested error, the first passes are coarse: they have twice the
//! dicing step, and fewer records of indirect light and occlusion. They are rendered once more with four times the
//! step, which shows where there is bias. Some parts of the image are then rendered with half of the step and more
//! records. Where the bias is too large, the passes begin again with the accuracy that it shows to be needed. Where it
//! does not show that, they have the accuracy of the scene, for which the bias is measured in the same way, and then
//! finer surfaces ([`crate::accuracy`]). It is measured once more where these are much finer. Where many passes are
//! needed, they have more samples each ([`crate::larger`]). Filters of textures and shadow maps are not part of it.
//!
//! With a requested time, and no error or one for which it is too short, surfaces become finer and passes larger where
//! that is expected to leave the least error at its end. Such an image is that of its number of passes with surfaces as
//! fine and as many samples.

use crate::accuracy::{Accuracy, SquaredBias};
use granita_base::NoiseSource;
use std::time::{Duration, Instant};

/// The number of passes of the whole frame after which an image with a requested error decides where more are needed.
pub(crate) const PILOT: u32 = 2;

/// The width of the one-sided confidence interval of the reached error in standard deviations, for 95 %.
pub(crate) const CONFIDENCE: f64 = 1.645;

/// The factor by which the reached error may exceed the requested one. The first passes show it to a few percent.
pub(crate) const TOLERANCE: f64 = 1.05;

/// The approximate number of pixels that share one random number: neighbours share samples through the filter, and
/// points of grids.
pub(crate) const PIXELS_PER_NUMBER: f64 = 9.0;

/// The end of the passes of an image. Without any, there are [`PassPlan::MOST`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PassPlan {
    /// The largest number of passes, at least 1; `None` when only time or error end them.
    pub passes: Option<u32>,
    /// The time at which the image must be finished. The first pass is always finished. A later one begins only when
    /// it is expected to end in time.
    pub deadline: Option<Instant>,
    /// The time that the deadline may be exceeded by before a pass is given up.
    pub grace: Duration,
    /// The requested error as a fraction of the mean of the image, for example 0.02 for 2 %.
    pub error: Option<f32>,
    /// True when the part of each noise source in the error is measured, with one more pass for each.
    pub causes: bool,
    /// The level of surfaces where no error is requested, from 0 to [`PassPlan::FINEST`]: they are `2^level` times as
    /// fine as the scene says.
    pub level: u32,
    /// The samples of pixels, and of lights and rays, of a pass where no error is requested: `4^n` times those of a
    /// frame without passes, with `n` from 0 to [`PassPlan::LARGEST`].
    pub larger: [u32; 2],
}

impl PassPlan {
    /// The largest number of passes of an image for which neither a number nor a time is requested.
    pub const MOST: u32 = 4096;

    /// The finest level.
    pub const FINEST: u32 = Accuracy::MOST.unsigned_abs();

    /// The largest power of 4 by which passes have more samples.
    pub const LARGEST: u32 = 2;

    /// True when surfaces may become finer, and passes larger, where that is the best use of the time. With a requested
    /// error they do so when the time is too short for it.
    pub(crate) fn refines(&self) -> bool {
        self.deadline.is_some() && self.passes.is_none() && !self.causes
    }

    /// True when a pass that takes `time` ends in time.
    pub(crate) fn has_time_for(&self, time: Duration) -> bool {
        // Half of the grace is for a time that was predicted too short.
        self.deadline.is_none_or(|deadline| Instant::now() + time <= deadline + self.grace / 2)
    }

    /// Returns the plan of the first of `frames` frames that share the time.
    pub(crate) fn shared_by(self, frames: u32) -> Self {
        let own = |deadline: Instant| {
            let now = Instant::now();
            now + deadline.saturating_duration_since(now) / frames.max(1)
        };
        Self { deadline: self.deadline.map(own), ..self }
    }

    /// Returns the largest number of passes.
    pub(crate) fn most(&self) -> u32 {
        let unbounded = if self.deadline.is_some() { u32::MAX } else { Self::MOST };
        self.passes.unwrap_or(unbounded).max(1)
    }
}

/// The error of an image, as its passes show it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ErrorEstimate {
    /// The root of the mean of the squared errors over the mean of the image, noise and bias together.
    pub error: f64,
    /// The upper end of the one-sided confidence interval of `error`, at 95 %.
    pub bound: f64,
    /// The part of `error` that all passes have in common: how surfaces are diced, and what is interpolated between
    /// records of indirect light and occlusion. 0 where it could not be told from noise; `None` where it was not
    /// measured.
    pub bias: Option<f64>,
    /// The 99th percentile of the errors of blocks of 8 x 8 pixels, each over the mean of the whole image.
    pub blocks_99: f64,
    /// The largest of these errors.
    pub worst_block: f64,
    /// The first pixel of that block, from the left and the top of the whole image.
    pub worst_at: [i32; 2],
    /// The parts of the error that noise sources have, by their numbers: what remains of the error when all other
    /// random numbers stay the same. `None` for a source that was not measured.
    pub causes: [Option<f64>; NoiseSource::ALL.len()],
}

impl ErrorEstimate {
    /// Returns the estimate with a bias, which is independent of the noise.
    pub(crate) fn with_bias(self, bias: &SquaredBias) -> Self {
        let bias = bias.root();
        let [error, bound] = [self.error, self.bound].map(|noise| libm::hypot(noise, bias));
        Self { error, bound, bias: Some(bias), ..self }
    }

    /// True when the image has a requested error.
    pub(crate) fn is_within(&self, requested: f32) -> bool {
        self.bound <= f64::from(requested) * TOLERANCE
    }

    /// Returns the noise sources that were measured, with their parts of the error, the largest first.
    pub fn causes(&self) -> Vec<(NoiseSource, f64)> {
        let parts = NoiseSource::ALL.into_iter().zip(self.causes);
        let mut list: Vec<(NoiseSource, f64)> =
            parts.filter_map(|(source, error)| Some((source, error?))).collect();
        list.sort_by(|a, b| b.1.total_cmp(&a.1));
        list
    }

    /// Returns a text for people.
    pub fn text(&self) -> String {
        let mut text = format!(
            "error {}, at most {} at 95 % confidence; 99 % of blocks below {}, the one at {} {} has {}",
            percent(self.error),
            percent(self.bound),
            percent(self.blocks_99),
            self.worst_at[0],
            self.worst_at[1],
            percent(self.worst_block)
        );
        if let Some(bias) = self.bias.filter(|bias| *bias > 0.0) {
            text += &format!("; bias {}", percent(bias));
        }
        let causes = self.causes();
        for (k, (source, error)) in causes.iter().enumerate() {
            let before = if k == 0 { "; from" } else { "," };
            text += &format!("{before} {} {}", source.name(), percent(*error));
        }
        text
    }
}

/// The passes of an image, and its error.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageError {
    /// The name of the file.
    pub name: String,
    /// `None` after one pass, and for images without colours.
    pub error: Option<ErrorEstimate>,
}

/// The passes of the images of a camera.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PassReport {
    /// The number of passes that were completed.
    pub passes: u32,
    /// The mean number of passes of a pixel. It is less than `passes` where later ones rendered a part of the image.
    pub mean_passes: f64,
    /// The largest error of an image; `None` after one pass, and for images without colours.
    pub error: Option<ErrorEstimate>,
    /// How many times as far apart the points of surfaces are as the scene says, in a coarse image. The first pass
    /// would not have ended in time, or the image has the requested error without finer points.
    pub coarse: Option<u32>,
    /// How many times as fine surfaces are as the scene says.
    pub finer: u32,
    /// How many times the samples of pixels of a frame without passes the passes of the image have.
    pub pixel_samples: u32,
    /// How many times the samples of lights and rays of such a frame they have.
    pub samples: u32,
    /// The error that was requested.
    pub requested: Option<f32>,
    /// True when the requested error was not reached.
    pub is_short: bool,
    /// True when the time was too short for the requested error, or ended before the bias was measured, and no more is
    /// estimated than was requested.
    pub is_unsure: bool,
    /// The error of each image.
    pub images: Vec<ImageError>,
}

impl PassReport {
    /// Returns a text for people.
    pub fn text(&self) -> String {
        let mut text = match self.passes {
            1 => "1 pass".to_owned(),
            n => format!("{n} passes"),
        };
        if let Some(factor) = self.coarse {
            text += &format!(", coarse: points are {factor} times as far apart");
        }
        if self.finer > 1 {
            text += &format!(", with points {} times as close", self.finer);
        }
        text += &match (self.pixel_samples, self.samples) {
            (0 | 1, 0 | 1) => String::new(),
            (pixels, samples) if pixels == samples => format!(", with {samples} times the samples"),
            (pixels, 0 | 1) => format!(", with {pixels} times the samples of pixels"),
            (0 | 1, samples) => format!(", with {samples} times the samples of lights and rays"),
            (pixels, samples) => {
                format!(
                    ", with {pixels} times the samples of pixels and {samples} times those of lights and rays"
                )
            }
        };
        if self.mean_passes + 0.05 < f64::from(self.passes) {
            text += &format!(" ({:.1} of a pixel)", self.mean_passes);
        }
        if let Some(error) = &self.error {
            text += &format!("; {}", error.text());
        }
        text
    }
}

/// Returns a fraction in percent with three digits.
pub(crate) fn percent(fraction: f64) -> String {
    let percent = fraction * 100.0;
    let digits = if percent >= 10.0 {
        1
    } else if percent >= 1.0 {
        2
    } else {
        3
    };
    format!("{percent:.digits$} %")
}

/// The noise of a part of the image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Spot {
    /// The number of pixels.
    pub(crate) pixels: usize,
    /// The mean squared noise of its values, from the difference of two halves of the passes.
    pub(crate) squared: f64,
    /// The same, if all passes were independent of each other.
    pub(crate) independent: f64,
    /// The number of passes.
    pub(crate) passes: u32,
}

impl Spot {
    /// Returns the squared noise over the number of passes.
    fn of_a_pass(&self) -> f64 {
        self.squared / f64::from(self.passes.max(1))
    }

    /// Returns how much of the squared noise of independent passes is left.
    pub(crate) fn part_of_independent(&self) -> f64 {
        if self.independent > 0.0 { self.squared / self.independent } else { 1.0 }
    }
}

/// Returns the mean squared error of an image of parts, when each has the squared noise that `noise` returns, and its
/// standard deviation.
fn squared_error(spots: &[Spot], noise: impl Fn(&Spot) -> f64) -> [f64; 2] {
    let (mut pixels, mut sum, mut spread) = (0.0, 0.0, 0.0);
    for spot in spots {
        let all = spot.pixels as f64;
        let own = all * noise(spot);
        // Each random number shows one difference of two halves.
        let freedom = (all / PIXELS_PER_NUMBER).max(1.0);
        (pixels, sum, spread) = (pixels + all, sum + own, spread + own * own * 2.0 / freedom);
    }
    if pixels == 0.0 { [0.0; 2] } else { [sum / pixels, spread.sqrt() / pixels] }
}

/// Returns the mean squared error of an image of parts, and the upper end of its confidence interval.
pub(crate) fn confident_error(spots: &[Spot]) -> [f64; 2] {
    let [mean, deviation] = squared_error(spots, |spot| spot.squared);
    [mean, mean + CONFIDENCE * deviation]
}

/// The rule by which parts of an image get more passes.
///
/// The time of an image is least when every part has the same ratio between what a further pass gains and what it
/// costs (the method of Lagrange). A part gets passes until its squared noise over their number is at most `least`:
/// where passes are independent, as many as are in proportion to its standard deviation. `least` follows from the first
/// passes of the whole frame. After that, each part decides by itself, so that a crop of an image has its pixels. One
/// whose noise falls more slowly than expected gets passes until it has the noise that was expected of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rule {
    least: f64,
    power: f64,
}

/// The largest exponent of [`fall`] that is expected of more passes.
const STEEPEST: f64 = 1.75;

/// Returns the power of the number of passes by which the squared noise falls: 1 where passes are independent, and more
/// where they continue each other. It follows from parts that have twice as many passes after as before, less its
/// standard deviation.
pub(crate) fn fall(before: &[Spot], after: &[Spot]) -> f64 {
    let twice: Vec<(Spot, Spot)> = before
        .iter()
        .copied()
        .zip(after.iter().copied())
        .filter(|(before, after)| after.passes == 2 * before.passes)
        .collect();
    let (before, after): (Vec<Spot>, Vec<Spot>) = twice.into_iter().unzip();
    let [[from, of_from], [to, of_to]] =
        [&before, &after].map(|spots| squared_error(spots, |spot| spot.squared));
    let power = libm::log2(from / to) - libm::hypot(of_from / from, of_to / to) / std::f64::consts::LN_2;
    if power.is_nan() { 1.0 } else { power.clamp(1.0, STEEPEST) }
}

impl Rule {
    /// Returns the rule with which the mean squared error of an image is `most` at 95 % confidence, as far as the
    /// passes show it that there are. `spots` are all parts of the whole image. Squared noise falls with a power of the
    /// number of passes ([`fall`]).
    pub(crate) fn new(spots: &[Spot], most: f64, power: f64) -> Self {
        let fits = |least: f64| {
            let rule = Self { least, power };
            let noise = |spot: &Spot| spot.squared * libm::pow(rule.times(spot), -power);
            let [mean, deviation] = squared_error(spots, noise);
            mean + CONFIDENCE * deviation <= most
        };
        // With the largest one no part gets more passes than it has.
        let largest = spots.iter().map(Spot::of_a_pass).fold(f64::MIN_POSITIVE, f64::max);
        if fits(largest) {
            return Self { least: largest, power };
        }
        let (mut low, mut high) = (0.0, largest);
        for _ in 0..200 {
            let middle = 0.5 * (low + high);
            if fits(middle) { low = middle } else { high = middle }
        }
        Self { least: low, power }
    }

    /// Returns how many times the passes are expected to be that a part has.
    fn times(&self, spot: &Spot) -> f64 {
        libm::pow((spot.of_a_pass() / self.least).max(1.0), 1.0 / (self.power + 1.0))
    }

    /// True when a part needs another pass. `first` is the part as [`Rule::new`] had it.
    pub(crate) fn wants(&self, spot: &Spot, first: &Spot) -> bool {
        let expected = f64::from(first.passes) * self.times(first);
        spot.squared > self.least * f64::from(spot.passes).min(expected)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a part of an image whose values have a standard deviation in each of two passes.
    fn spot(deviation: f64) -> Spot {
        after(2, deviation, 1.0)
    }

    /// Returns the same after some passes, when its noise falls with a power.
    fn after(passes: u32, deviation: f64, power: f64) -> Spot {
        let squared = deviation * deviation / 2.0 * libm::pow(2.0 / f64::from(passes), power);
        Spot { pixels: 1024, squared, independent: squared, passes }
    }

    #[test]
    fn parts_get_passes_in_proportion_to_their_deviation() {
        let deviations: Vec<f64> = (0..100).map(|k| if k < 10 { 1.0 } else { 0.1 }).collect();
        let spots: Vec<Spot> = deviations.iter().map(|d| spot(*d)).collect();
        for power in [1.0, 1.5] {
            let rule = Rule::new(&spots, 0.001, power);
            let needed = |deviation: f64| {
                let first = spot(deviation);
                let mut spot = first;
                while rule.wants(&spot, &first) {
                    spot = after(spot.passes + 1, deviation, power);
                }
                spot.passes
            };
            let (many, few) = (needed(1.0), needed(0.1));
            let ratio = libm::pow(100.0, 1.0 / (power + 1.0));
            assert!((f64::from(many) / f64::from(few) - ratio).abs() < 0.15 * ratio, "{many} {few}");
            let spots: Vec<Spot> = deviations.iter().map(|d| after(needed(*d), *d, power)).collect();
            let [mean, bound] = confident_error(&spots);
            assert!(mean < bound && bound <= 0.001 && mean > 0.0007, "{power}: {mean} {bound}");
        }
    }

    #[test]
    fn parts_reach_the_error_where_their_noise_falls_more_slowly_than_expected() {
        let deviations: Vec<f64> = (0..100).map(|k| if k < 10 { 1.0 } else { 0.1 }).collect();
        let first: Vec<Spot> = deviations.iter().map(|d| spot(*d)).collect();
        let rule = Rule::new(&first, 0.001, STEEPEST);
        let last = |(deviation, first): (&f64, &Spot)| {
            let passes = (first.passes..).find(|n| !rule.wants(&after(*n, *deviation, 1.0), first));
            after(passes.unwrap(), *deviation, 1.0)
        };
        let spots: Vec<Spot> = deviations.iter().zip(&first).map(last).collect();
        let [mean, bound] = confident_error(&spots);
        assert!(bound <= 0.001 && mean > 0.0007, "{mean} {bound}");
    }

    #[test]
    fn the_fall_of_noise_is_measured_where_there_are_twice_the_passes() {
        let of = |passes: u32, power: f64| vec![after(passes, 1.0, power); 1000];
        let before = of(2, 1.0);
        for (power, least) in [(1.0, 1.0), (1.4, 1.38), (3.0, STEEPEST), (0.5, 1.0)] {
            let found = fall(&before, &of(4, power));
            assert!((least..=power.clamp(1.0, STEEPEST)).contains(&found), "{power}: {found}");
        }
        // What few parts show is uncertain.
        assert!(fall(&before[..1], &of(4, 1.4)[..1]) < 1.3);
        assert_eq!(fall(&before, &of(3, 1.4)), 1.0);
        assert_eq!(fall(&[], &[]), 1.0);
    }

    #[test]
    fn what_is_not_known_of_bias_counts_as_bias() {
        let unsure = SquaredBias { value: 1e-5, deviation: 2e-5, noise: 2e-5, grows: false };
        assert_eq!(unsure.root(), 0.0);
        assert!((unsure.leaves(0.01) - 7e-5).abs() < 1e-12);
        assert!((SquaredBias { deviation: 1.0, ..unsure }.leaves(0.01) - 6.5e-5).abs() < 1e-12);
        assert!(unsure.is_known_for(0.01) && !unsure.is_known_for(0.008));
        assert!(unsure.is_small_for(0.2) && !unsure.is_small_for(0.18));
        let estimate = ErrorEstimate { error: 0.003, bound: 0.004, ..ErrorEstimate::default() };
        assert_eq!(estimate.with_bias(&unsure), ErrorEstimate { bias: Some(0.0), ..estimate });
        // Few parts of the image show how large a bias is, but that there is one.
        let sure = SquaredBias { value: 1.6e-5, noise: 1e-6, ..unsure };
        assert!((estimate.with_bias(&sure).error - 0.005).abs() < 1e-9);
    }

    #[test]
    fn an_image_without_noise_needs_no_more_passes() {
        let rule = Rule::new(&[spot(0.0), spot(0.0)], 1e-6, 1.0);
        assert!(!rule.wants(&spot(0.0), &spot(0.0)));
        assert_eq!(confident_error(&[spot(0.0)]), [0.0, 0.0]);
        assert_eq!(confident_error(&[]), [0.0, 0.0]);
        // The requested error is reached already.
        let rule = Rule::new(&[spot(0.1)], 1.0, 1.0);
        assert!(!rule.wants(&spot(0.1), &spot(0.1)));
    }

    #[test]
    fn texts_of_passes_show_percent() {
        let report = PassReport { passes: 1, mean_passes: 1.0, ..PassReport::default() };
        assert_eq!(report.text(), "1 pass");
        let coarse = PassReport { coarse: Some(4), ..report };
        assert_eq!(coarse.text(), "1 pass, coarse: points are 4 times as far apart");
        let mut causes = [None; NoiseSource::ALL.len()];
        causes[NoiseSource::Edges as usize] = Some(0.004);
        causes[NoiseSource::Lights as usize] = Some(0.0115);
        let error = Some(ErrorEstimate {
            error: 0.0123,
            bound: 0.0131,
            bias: Some(0.004),
            blocks_99: 0.123,
            worst_block: 0.2,
            worst_at: [16, 8],
            causes,
        });
        let report = PassReport { passes: 9, mean_passes: 4.25, error, ..PassReport::default() };
        assert_eq!(
            report.text(),
            "9 passes (4.2 of a pixel); error 1.23 %, at most 1.31 % at 95 % confidence; 99 % of blocks below 12.3 %, \
             the one at 16 8 has 20.0 %; bias 0.400 %; from lights 1.15 %, edges 0.400 %"
        );
        assert_eq!(percent(0.004), "0.400 %");
    }
}
