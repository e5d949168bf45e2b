//! The settings with which a scene reaches an error soonest (`-trade`).
//!
//! Each setting renders two passes of the same crops of the image, in a process of its own. Two passes show the
//! variance of one. n passes then have the error `sqrt (variance / n)` and take n times as long, so that a time
//! follows for each error. What the settings change makes noise and no bias, so that no converged image is needed.
//!
//! The crops are blocks of the image, chosen at random with probabilities in proportion to their noise, which a small
//! image shows. The mean over the whole image is estimated from them by importance sampling. The time of the whole
//! image is that of the small one, times the number of its pixels.

use crate::Options;
use crate::again::{Again, passed_on};
use granita_base::{AtomicFile, Reporter, Supervisor, sample};
use granita_cli::{ErrorPlot, Given, Status};
use granita_image::{FormatRegistry, Limits};
use serde_json::Value;
use std::ffi::OsString;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;
use std::process::Stdio;
use tempfile::TempDir;

/// The numbers of blocks across and down the image, and of those that are rendered.
const BLOCKS: [usize; 2] = [8, 6];
const CROPS: usize = 4;

/// The side of the small image, in blocks of which each has this many pixels at least.
const LEAST_BLOCK: u32 = 12;

/// The factors between settings that are tried one after the other, of "spatialquality" in each direction and of
/// "render:samples".
const QUALITY_STEP: f32 = 2.0;
const SAMPLES_STEP: f32 = 4.0;

/// The largest number of steps in one direction.
const STEPS: u32 = 4;

/// The errors of the table, as fractions of the mean of the image.
const ERRORS: [f64; 5] = [0.08, 0.04, 0.02, 0.01, 0.005];

/// The part by which a setting must be faster than the scene's own to be preferred, because times vary.
const WORTH: f64 = 0.05;

/// The options that are not passed on, because the runs have their own.
const OWN: [&str; 25] = [
    "trade",
    "files",
    "error",
    "draft",
    "review",
    "final_",
    "seconds",
    "until",
    "passes",
    "finer",
    "larger",
    "causes",
    "denoise",
    "output",
    "data",
    "only",
    "crop",
    "statistics",
    "statistics_json",
    "silent",
    "verbosity",
    "iv",
    "display",
    "progress",
    "timeout",
];

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Wanted {
    /// The least time for an error.
    Error(f64),
    /// The least error in a time in seconds.
    Seconds(f64),
}

/// A setting, as factors of the scene's own numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Setting {
    quality: f32,
    samples: f32,
}

impl Setting {
    const OWN: Self = Self { quality: 1.0, samples: 1.0 };

    /// Returns the values of "spatialquality" and "render:samples".
    fn values(self, scene: &Scene) -> ([u32; 2], f32) {
        let times = |n: u32| ((n as f32 * self.quality).round() as u32).clamp(1, 256);
        (scene.quality.map(times), self.samples * scene.samples)
    }

    /// Returns the values of "temporalquality" and "dofquality", as far as the scene has blur. They are the least
    /// numbers of samples, so that they are scaled like "spatialquality".
    fn blurs(self, scene: &Scene) -> impl Iterator<Item = (&'static str, u32)> {
        let square = self.quality * self.quality;
        let times = move |n: u32| ((n as f32 * square).round() as u32).max(2);
        let both = ["temporalquality", "dofquality"].into_iter().zip(scene.blurs);
        both.filter_map(move |(name, n)| Some((name, times(n?))))
    }

    /// Returns the words of the command line that set it.
    fn words(self, scene: &Scene) -> Vec<String> {
        let ([x, y], samples) = self.values(scene);
        let own = [format!("spatialquality={x},{y}"), format!("render:samples={samples}")].into_iter();
        let all = own.chain(self.blurs(scene).map(|(name, n)| format!("{name}={n}")));
        all.flat_map(|set| ["-set".to_owned(), set]).collect()
    }
}

/// What the scene says of itself.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Scene {
    resolution: [u32; 2],
    quality: [u32; 2],
    /// "render:samples".
    samples: f32,
    /// "temporalquality" and "dofquality", with motion blur and depth of field.
    blurs: [Option<u32>; 2],
}

/// The cost of a setting over the whole image.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Outcome {
    setting: Setting,
    /// The seconds of one pass.
    seconds: f64,
    /// The squared error of one pass, over the squared mean of the image.
    variance: f64,
}

impl Outcome {
    /// Returns the number of passes that reach an error. `-error` takes at least two.
    fn passes(&self, error: f64) -> f64 {
        (self.variance / (error * error)).ceil().max(2.0)
    }

    /// Returns the seconds until an error is reached.
    fn time(&self, error: f64) -> f64 {
        self.passes(error) * self.seconds
    }

    /// Returns the error that is reached in a number of seconds; infinite when one pass takes longer.
    fn error(&self, seconds: f64) -> f64 {
        (self.variance / (seconds / self.seconds).floor()).sqrt()
    }

    /// Returns what is to be small.
    fn cost(&self, wanted: Wanted) -> f64 {
        match wanted {
            Wanted::Error(error) => self.time(error),
            Wanted::Seconds(seconds) => self.error(seconds),
        }
    }
}

/// Returns the outcome that is best for what is wanted; the scene's own unless another one is clearly better.
fn best(outcomes: &[Outcome], wanted: Wanted) -> Option<&Outcome> {
    // Where no pass ends in time, the quickest one is best.
    let order = |a: &&Outcome, b: &&Outcome| {
        a.cost(wanted).total_cmp(&b.cost(wanted)).then(a.seconds.total_cmp(&b.seconds))
    };
    let least = outcomes.iter().min_by(order)?;
    let own = outcomes.iter().find(|outcome| outcome.setting == Setting::OWN);
    own.filter(|own| {
        let within = |a: f64, b: f64| a <= b * (1.0 + WORTH);
        within(own.cost(wanted), least.cost(wanted))
            && (own.cost(wanted).is_finite() || within(own.seconds, least.seconds))
    })
    .or(Some(least))
}

/// A part of the image, from 0 to 1 (xmin, xmax, ymin, ymax).
type Crop = [f32; 4];

/// The result of a run.
struct Run {
    size: [u32; 2],
    /// The interleaved values of all channels.
    pixels: Vec<f32>,
    channels: usize,
    /// The seconds of the frame, without reading the scene.
    seconds: f64,
    /// The error, over the mean of the run's pixels.
    error: f64,
    scene: Scene,
}

impl Run {
    /// The mean of all values.
    fn mean(&self) -> f64 {
        self.pixels.iter().map(|v| f64::from(*v)).sum::<f64>() / self.pixels.len().max(1) as f64
    }
}

/// Renders the runs.
struct Renderer<'a> {
    options: &'a Options,
    given: &'a [Given],
    again: Again<'a>,
    folder: TempDir,
    formats: FormatRegistry,
}

impl Renderer<'_> {
    fn run(&self, words: &[String], crop: Option<Crop>, passes: u32) -> Result<Run, String> {
        let [image, record] = ["image.exr", "record.json"].map(|name| self.folder.path().join(name));
        let mut command = self.again.command();
        command.args(["-silent", "-only", "-data", "first", "-o"]).arg(&image);
        command.arg("-statistics-json").arg(&record).args(["-passes", &passes.to_string()]);
        if let Some(crop) = crop {
            command.arg("-crop").args(crop.map(|x| x.to_string()));
        }
        // Of several -set of one attribute the last one counts.
        command.args(passed_on(self.given, &OWN).flat_map(|given| &given.words)).args(words).arg("--");
        command.args(self.options.files.iter().map(OsString::from)).stdout(Stdio::null());
        let status = self.again.run(command, "rendering crops for -trade")?;
        if !status.success() {
            return Err(format!("a crop was not rendered: {status}"));
        }
        let text = std::fs::read_to_string(&record).map_err(|e| format!("{}: {e}", record.display()))?;
        let json: Value = serde_json::from_str(&text).map_err(|e| format!("{}: {e}", record.display()))?;
        let frames = json["frames"].as_array().cloned().unwrap_or_default();
        let last = frames.last().ok_or("the scene renders no frame")?;
        let seconds = last["cameras"][0]["seconds"]["frame"].as_f64().unwrap_or_default();
        let input = self.formats.open(&image).map_err(|error| error.to_string())?;
        let spec = input.spec(0, 0).ok_or("a crop has no image")?;
        let pixels = input.read_level(0, 0).map_err(|error| error.to_string())?;
        let text = |name: &str| spec.string(&format!("granita/{name}"));
        let number = |name: &str| text(name).and_then(|text| text.parse().ok());
        let count = |name: &str| text(name).and_then(|text| text.parse().ok());
        let pair = || {
            let mut words = text("samples")?.split_whitespace().map(str::parse);
            Some([words.next()?.ok()?, words.next()?.ok()?])
        };
        Ok(Run {
            size: [spec.width, spec.height],
            channels: spec.channels.len(),
            pixels: pixels.to_floats(),
            seconds: seconds / f64::from(passes),
            error: number("error").unwrap_or_default(),
            scene: Scene {
                resolution: [spec.full_width, spec.full_height],
                quality: pair().unwrap_or([1, 1]),
                samples: text("render:samples").and_then(|text| text.parse().ok()).unwrap_or(1.0), // tidy: attribute: the name of metadata
                blurs: ["temporalquality", "dofquality"].map(count),
            },
        })
    }
}

/// Returns the mean squared difference in each block of two images of the same size, row by row.
fn blocks(a: &Run, b: &Run) -> Vec<f64> {
    let [across, down] = BLOCKS;
    let [width, height] = a.size.map(|n| (n as usize).max(1));
    let mut sums = vec![(0.0, 0_usize); across * down];
    let channels = a.channels.max(1);
    for (k, (a, b)) in a.pixels.chunks_exact(channels).zip(b.pixels.chunks_exact(channels)).enumerate() {
        let (x, y) = (k % width, k / width);
        let block = (y * down / height).min(down - 1) * across + (x * across / width).min(across - 1);
        let squares = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).filter(|v| v.is_finite());
        sums[block].0 += squares.sum::<f64>();
        sums[block].1 += 1;
    }
    sums.into_iter().map(|(sum, n)| sum / n.max(1) as f64).collect()
}

/// A block that is rendered.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Chosen {
    crop: Crop,
    /// What its variance counts in the mean over the image.
    weight: f64,
}

/// Chooses blocks with probabilities in proportion to their noise. Every twentieth one is chosen without regard to it,
/// so that nothing is missed that the small image does not show.
fn choose(noise: &[f64]) -> Vec<Chosen> {
    let [across, down] = BLOCKS;
    let chosen = sample::in_proportion(noise, CROPS, 0.05);
    let block = |(k, _, factor): (usize, usize, f64)| {
        let at = |k: usize, n: usize| [k, k + 1].map(|k| k as f32 / n as f32);
        let ([x0, x1], [y0, y1]) = (at(k % across, across), at(k / across, down));
        Chosen { crop: [x0, x1, y0, y1], weight: factor / noise.len() as f64 }
    };
    chosen.into_iter().map(block).collect()
}

impl Renderer<'_> {
    /// Measures settings, from the scene's own one to better ones.
    fn outcomes(&self, wanted: Wanted, reporter: &Reporter) -> Result<(Scene, Vec<Outcome>), String> {
        let scene = self.run(&[], Some([0.49, 0.51, 0.49, 0.51]), 1)?.scene;
        let [width, height] = scene.resolution;
        let least = |n: usize| (n as u32 * LEAST_BLOCK) as f32;
        let scale = (least(BLOCKS[0]) / width as f32).max(least(BLOCKS[1]) / height as f32).clamp(0.25, 1.0);
        let [w, h] = scene.resolution.map(|n| ((n as f32 * scale).round() as u32).max(1));
        let small = ["-set".to_owned(), format!("resolution={w},{h}")];
        reporter.info(format!("a small image, {w} x {h} pixels"));
        let (one, two) = (self.run(&small, None, 1)?, self.run(&small, None, 2)?);
        let chosen = choose(&blocks(&one, &two));
        let larger = f64::from(width) * f64::from(height) / (f64::from(w) * f64::from(h));
        let (whole, mean) = (two.seconds * larger, two.mean());
        if mean == 0.0 {
            return Err("the image is black".to_owned());
        }
        let measure = |setting: Setting| -> Result<(f64, f64), String> {
            let words = if setting == Setting::OWN { Vec::new() } else { setting.words(&scene) };
            let (mut seconds, mut variance) = (0.0, 0.0);
            for Chosen { crop, weight } in &chosen {
                let run = self.run(&words, Some(*crop), 2)?;
                seconds += run.seconds;
                // Two passes have half of the variance of one.
                variance += weight * 2.0 * (run.error * run.mean()).powi(2);
            }
            Ok((seconds, variance / (mean * mean)))
        };
        let (own_seconds, own_variance) = measure(Setting::OWN)?;
        let outcome = |setting, (seconds, variance): (f64, f64)| Outcome {
            setting,
            seconds: whole * seconds / own_seconds.max(1e-9),
            variance,
        };
        let mut outcomes = vec![outcome(Setting::OWN, (own_seconds, own_variance))];
        // From the best setting so far, each number is changed in both directions, as long as it pays.
        let knobs =
            [[1.0, 1.0 / SAMPLES_STEP], [1.0, SAMPLES_STEP], [1.0 / QUALITY_STEP, 1.0], [QUALITY_STEP, 1.0]];
        for [quality, samples] in knobs {
            for _ in 0..STEPS {
                let Some(from) = best(&outcomes, wanted).copied() else { break };
                let Setting { quality: q, samples: s } = from.setting;
                let setting = Setting { quality: q * quality, samples: s * samples };
                let same = |outcome: &Outcome| outcome.setting.words(&scene) == setting.words(&scene);
                if outcomes.iter().any(same) {
                    break;
                }
                reporter.info(setting.words(&scene).join(" "));
                let next = outcome(setting, measure(setting)?);
                outcomes.push(next);
                if next.cost(wanted) >= from.cost(wanted) * (1.0 - WORTH) {
                    break;
                }
            }
        }
        Ok((scene, outcomes))
    }
}

/// Returns the table of all settings, the quickest first.
fn table(scene: &Scene, outcomes: &[Outcome]) -> String {
    // tidy: attribute: the heading of a table
    let mut text = format!("{:<28} {:>9} {:>9}", "spatialquality, render:samples", "a pass", "its error");
    for error in ERRORS {
        let _ = write!(text, " {:>9}", format!("to {} %", percent(error)));
    }
    let least = ERRORS.map(|error| best(outcomes, Wanted::Error(error)).map(|outcome| outcome.setting));
    let mut sorted: Vec<&Outcome> = outcomes.iter().collect();
    sorted.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
    for outcome in sorted {
        let ([x, y], samples) = outcome.setting.values(scene);
        let own = if outcome.setting == Setting::OWN { "  (as it is)" } else { "" };
        let error = format!("{:.2} %", 100.0 * outcome.variance.sqrt());
        let _ = write!(
            text,
            "\n{:<30} {:>7} {error:>9}",
            format!("{x} x {y}, {samples}{own}"),
            seconds(outcome.seconds)
        );
        for (error, least) in ERRORS.into_iter().zip(least) {
            let star = if least == Some(outcome.setting) { "*" } else { " " };
            let _ = write!(text, " {:>8}{star}", seconds(outcome.time(error)));
        }
    }
    text + "\n* the least time for this error\n"
}

/// Returns a fraction in percent, without the digits that rounding adds.
fn percent(fraction: f64) -> f64 {
    (fraction * 1e6).round() / 1e4
}

/// Returns a number of seconds for people.
fn seconds(seconds: f64) -> String {
    if seconds < 10.0 { format!("{seconds:.2} s") } else { format!("{seconds:.0} s") }
}

/// Returns the statements that make a scene have the best setting.
fn snippet(scene: &Scene, best: &Outcome, wanted: Wanted) -> String {
    let ([x, y], samples) = best.setting.values(scene);
    let (what, end) = match wanted {
        Wanted::Error(error) => (
            format!("an error of {} %, after about {}", percent(error), seconds(best.time(error))),
            format!("Attribute (\"float render:error\", {error})"),
        ),
        Wanted::Seconds(time) => (
            match best.error(time) {
                error if error.is_finite() => {
                    format!("{}, with an error of about {:.2} %", seconds(time), 100.0 * error)
                }
                _ => {
                    format!("{}, which is less than the {} of one pass", seconds(time), seconds(best.seconds))
                }
            },
            format!("Attribute (\"float render:seconds\", {time})"),
        ),
    };
    let blurs: String =
        best.setting.blurs(scene).map(|(name, n)| format!("Attribute (\"int {name}\", {n})\n")).collect();
    format!(
        "# For {what}.\nAttribute (\"int[2] spatialquality\", ({x}, {y}))\n{blurs}Attribute (\"float render:samples\", {samples})\n{end}\n"
    )
}

/// Returns a picture with one line for each setting. The settings that are best for an error are drawn in colour.
fn plot(scene: &Scene, outcomes: &[Outcome], name: &str) -> String {
    let times = outcomes.iter().flat_map(|outcome| ERRORS.map(|error| outcome.time(error)));
    let mut plot = ErrorPlot::new(name, times, ERRORS.into_iter());
    let is_best = |setting: Setting| {
        ERRORS
            .iter()
            .any(|error| best(outcomes, Wanted::Error(*error)).is_some_and(|best| best.setting == setting))
    };
    let mut colors = ErrorPlot::COLORS.iter().cycle();
    for outcome in outcomes {
        let points = ERRORS.map(|error| (outcome.time(error), error));
        let ([across, down], samples) = outcome.setting.values(scene);
        let name = format!("{across} x {down}, {samples}");
        if outcome.setting == Setting::OWN {
            plot.line(&points, ErrorPlot::BLACK);
            plot.name(&format!("{name} (as it is)"), ErrorPlot::BLACK);
        } else if is_best(outcome.setting) {
            let color = colors.next().unwrap_or(&ErrorPlot::BLACK);
            plot.line(&points, color);
            plot.name(&name, color);
        } else {
            plot.line(&points, ErrorPlot::FAINT);
        }
    }
    plot.finish()
}

/// Measures the settings of a scene, prints them, and writes the best ones.
pub(crate) fn run(
    options: &Options,
    given: &[Given],
    supervisor: &Supervisor,
    reporter: &Reporter,
) -> Status {
    match trade(options, given, supervisor, reporter) {
        Ok(()) => Status::Done,
        Err(what) => {
            reporter.error(format!("-trade: {what}"));
            Status::Failed
        }
    }
}

fn trade(
    options: &Options,
    given: &[Given],
    supervisor: &Supervisor,
    reporter: &Reporter,
) -> Result<(), String> {
    let file = options.files.last().ok_or("no scene file was given (try -help)")?;
    if options.files.iter().any(|file| crate::is_stream(file)) {
        return Err("the scene is rendered several times, so it must be in a file".to_owned());
    }
    let asked = options.passes();
    let wanted = match asked.seconds {
        Some(seconds) if asked.error.is_none() => Wanted::Seconds(seconds),
        // The error was read as a float of few digits.
        _ => Wanted::Error(asked.error.map_or(ERRORS[2], |error| (f64::from(error) * 1e6).round() / 1e6)),
    };
    let renderer = Renderer {
        options,
        given,
        again: Again::new(supervisor)?,
        folder: tempfile::tempdir().map_err(|e| e.to_string())?,
        formats: granita_plugin::bundled_formats(Limits::default()),
    };
    let (scene, outcomes) = renderer.outcomes(wanted, reporter)?;
    if outcomes.iter().all(|outcome| outcome.variance == 0.0) {
        return Err("the image has no noise, so one pass is all that it needs".to_owned());
    }
    let Some(best) = best(&outcomes, wanted) else { return Ok(()) };
    granita_cli::print(&table(&scene, &outcomes));
    let [pyg, svg] = ["pyg", "svg"].map(|ending| Path::new(file).with_extension(format!("trade.{ending}")));
    let write = |path: &Path, text: &str| {
        let mut file = AtomicFile::create(path)?;
        file.write_all(text.as_bytes()).map_err(|error| file.io_error(error))?;
        file.commit()
    };
    let text = snippet(&scene, best, wanted);
    write(&pyg, &text)
        .and_then(|()| write(&svg, &plot(&scene, &outcomes, file)))
        .map_err(|e| e.to_string())?;
    let end = match wanted {
        Wanted::Error(error) => format!("-error {}%", percent(error)),
        Wanted::Seconds(seconds) => format!("-seconds {seconds}"),
    };
    granita_cli::print(&format!(
        "{}\n    gelato {} {end} {}\n{} has the statements, {} the curves\n",
        text.lines().next().unwrap_or_default().trim_start_matches("# "),
        best.setting.words(&scene).join(" "),
        options.files.join(" "),
        pyg.display(),
        svg.display()
    ));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome(quality: f32, samples: f32, seconds: f64, variance: f64) -> Outcome {
        Outcome { setting: Setting { quality, samples }, seconds, variance }
    }

    #[test]
    fn the_best_setting_depends_on_what_is_wanted() {
        let coarse = outcome(0.5, 1.0, 1.0, 0.01);
        let own = outcome(1.0, 1.0, 4.0, 0.001);
        let all = [coarse, own];
        // Two passes of the coarse one have an error of 7 %, and 25 of them the 2 % that 3 of the other one have.
        assert_eq!(best(&all, Wanted::Error(0.08)), Some(&coarse));
        assert_eq!(best(&all, Wanted::Error(0.02)), Some(&own));
        assert_eq!((coarse.time(0.02), own.time(0.02)), (25.0, 12.0));
        assert_eq!(best(&all, Wanted::Seconds(2.0)), Some(&coarse));
        assert_eq!(best(&all, Wanted::Seconds(40.0)), Some(&own));
        assert_eq!(best(&all, Wanted::Seconds(0.5)), Some(&coarse));
        // A difference that times may have by chance changes nothing.
        let alike = outcome(2.0, 1.0, 3.9, 0.001);
        assert_eq!(best(&[own, alike], Wanted::Error(0.02)), Some(&own));
    }

    #[test]
    fn blocks_are_chosen_by_their_noise_and_weigh_less_then() {
        let [across, down] = BLOCKS;
        let even = choose(&vec![1.0; across * down]);
        assert!(
            even.len() == CROPS && even.iter().all(|c| (c.weight - 1.0 / CROPS as f64).abs() < 1e-9),
            "{even:?}"
        );
        let mut noise = vec![1.0; across * down];
        noise[13] = 100.0;
        let chosen = choose(&noise);
        let loud = chosen.iter().find(|c| c.crop == [0.625, 0.75, 1.0 / 6.0, 2.0 / 6.0]).unwrap();
        assert!(loud.weight < 0.1, "{chosen:?}");
        // The mean over the image is estimated without bias where noise is in proportion to what was seen.
        let of = |c: &Chosen| if c == loud { 100.0 } else { 1.0 };
        let estimate: f64 = chosen.iter().map(|c| c.weight * of(c)).sum();
        let mean = noise.iter().sum::<f64>() / noise.len() as f64;
        assert!((estimate / mean - 1.0).abs() < 0.3, "{estimate} {mean}");
        assert_eq!(choose(&vec![0.0; across * down]).len(), CROPS);
    }

    #[test]
    fn statements_name_what_they_are_for() {
        let scene = Scene { resolution: [640, 480], quality: [4, 4], samples: 0.5, blurs: [Some(16), None] };
        let best = outcome(0.5, 4.0, 1.0, 0.01);
        let text = snippet(&scene, &best, Wanted::Error(0.02));
        assert_eq!(
            text,
            "# For an error of 2 %, after about 25 s.\nAttribute (\"int[2] spatialquality\", (2, 2))\n\
             Attribute (\"int temporalquality\", 4)\nAttribute (\"float render:samples\", 2)\nAttribute (\"float render:error\", 0.02)\n"
        );
        assert!(snippet(&scene, &best, Wanted::Seconds(5.0)).contains("render:seconds\", 5)"));
        assert!(table(&scene, &[best]).contains("2 x 2, 2"));
    }
}
