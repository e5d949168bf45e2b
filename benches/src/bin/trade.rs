//! Measures the time and the error of each parameter of a scene's indirect light and occlusion.
//!
//! `cargo xtask trade SCENE.pyg [--threads N] [--reference SAMPLES] [--resolution X,Y] [--svg FILE]`
//!
//! The scene is rendered with one parameter changed at a time, and with all pairs of "samples" and "maxerror". A table
//! and a plot show the time of each image and its distance from a reference, in which every point is sampled with
//! `--reference` samples (by default 1024). Settings that no other setting beats in both are marked.
//!
//! "samples", "adaptive", "maxerror" and "maxpixeldist" are parameters of the scene's shaders `indirectlight`,
//! `envlight` and `ambocclude`. "shadingquality" and "spatialquality" are attributes. In a scene with none of these
//! shaders only the attributes are changed. The commands of the scene, which make maps and photons, run once, before
//! anything is timed.

#![forbid(unsafe_code)]
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a table for a terminal")]

use granita_benches::release_tool;
use granita_cli::ErrorPlot;
use granita_image::Limits;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::time::Instant;

/// The shaders whose parameters are changed.
const SHADERS: [&str; 3] = ["\"indirectlight\"", "\"envlight\"", "\"ambocclude\""];
/// The parameters and their values.
const SWEEPS: [(&str, &[f64]); 6] = [
    ("samples", &[16.0, 32.0, 64.0, 128.0, 256.0, 512.0]),
    ("maxerror", &[0.0, 0.05, 0.1, 0.25, 0.5, 1.0]),
    ("maxpixeldist", &[2.0, 5.0, 10.0, 20.0, 50.0]),
    ("adaptive", &[0.0, 0.5, 1.0, 2.0, 4.0]),
    ("shadingquality", &[0.25, 0.5, 1.0, 2.0]),
    ("spatialquality", &[1.0, 2.0, 4.0, 6.0]),
];
/// The values of the other parameters while one is changed.
const BASE: [(&str, f64); 6] = [
    ("samples", 64.0),
    ("maxerror", 0.25),
    ("maxpixeldist", 20.0),
    ("adaptive", 0.0),
    ("shadingquality", 1.0),
    ("spatialquality", 4.0),
];

fn main() -> ExitCode {
    granita_benches::exit("trade", run())
}

/// The values of all parameters.
type Setting = Vec<(&'static str, f64)>;

/// The result of a setting.
struct Outcome {
    /// The parameter that was changed.
    knob: &'static str,
    setting: Setting,
    seconds: f64,
    /// The root mean square distance from the reference, divided by the mean of the reference.
    error: f64,
}

struct Options {
    scene: PathBuf,
    threads: String,
    reference: f64,
    /// The resolution that replaces the scene's.
    resolution: Option<String>,
    svg: PathBuf,
}

fn options() -> Result<Options, String> {
    let mut words = std::env::args().skip(1);
    let mut scene = None;
    let (mut threads, mut reference, mut svg) = ("1".to_owned(), 1024.0, PathBuf::from("trade.svg"));
    let mut resolution = None;
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or(format!("{word} needs a value"));
        match &*word {
            "--threads" => threads = value()?,
            "--reference" => reference = value()?.parse().map_err(|e| format!("--reference: {e}"))?,
            "--resolution" => resolution = Some(value()?),
            "--svg" => svg = PathBuf::from(value()?),
            _ if word.starts_with('-') => return Err(format!("no option {word}")),
            _ => scene = Some(PathBuf::from(word)),
        }
    }
    Ok(Options { scene: scene.ok_or("name a scene (flat Pyg)")?, threads, reference, resolution, svg })
}

fn run() -> Result<(), String> {
    let options = options()?;
    let text =
        std::fs::read_to_string(&options.scene).map_err(|e| format!("{}: {e}", options.scene.display()))?;
    let gelato = release_tool("gelato")?;
    let has_shaders = SHADERS.iter().any(|s| text.contains(s));
    if !has_shaders {
        eprintln!("{} uses none of {}: attributes only", options.scene.display(), SHADERS.join(", "));
    }
    let text = prepared(&gelato, &options, text)?;
    let place = tempfile::tempdir().map_err(|e| e.to_string())?;
    let image = place.path().join("image.exr");
    let render = |setting: &Setting| render(&gelato, &options.threads, &with(&text, setting), &image);
    let best: Setting = vec![
        ("samples", options.reference),
        ("maxerror", 0.0),
        ("maxpixeldist", 20.0),
        ("adaptive", 0.0),
        ("shadingquality", 1.0),
        ("spatialquality", 8.0),
    ];
    eprintln!("the reference: every point with {} samples", options.reference);
    let (seconds, reference) = render(&best)?;
    eprintln!("took {seconds:.1} s");
    let mut outcomes = Vec::new();
    for (knob, setting) in settings().into_iter().filter(|s| has_shaders || !of_shaders(s.0)) {
        let (seconds, pixels) = render(&setting)?;
        let error = distance(&pixels, &reference)?;
        eprintln!("{}: {seconds:.2} s, {:.2}%", words(&setting), 100.0 * error);
        outcomes.push(Outcome { knob, setting, seconds, error });
    }
    table(&outcomes);
    std::fs::write(&options.svg, plot(&outcomes, &options.scene))
        .map_err(|e| format!("{}: {e}", options.svg.display()))?;
    println!("\n{}", options.svg.display());
    Ok(())
}

/// True when this is a parameter of shaders.
fn of_shaders(knob: &str) -> bool {
    !matches!(knob, "base" | "shadingquality" | "spatialquality")
}

/// Returns the scene without its commands and at the requested resolution. The commands run here, so that the files
/// that the scene needs exist.
fn prepared(gelato: &Path, options: &Options, mut text: String) -> Result<String, String> {
    let is_command = |line: &str| line.trim_start().starts_with("Command");
    if text.lines().any(is_command) {
        let status = Command::new(gelato).arg("-silent").arg(&options.scene).stdout(Stdio::null()).status();
        let status = status.map_err(|e| format!("{}: {e}", gelato.display()))?;
        if !status.success() {
            return Err(format!("gelato {}: {status}", options.scene.display()));
        }
        let mut kept = String::new();
        text.lines().filter(|line| !is_command(line)).for_each(|line| kept += &format!("{line}\n"));
        text = kept;
    }
    if let Some(resolution) = &options.resolution {
        let declared = "\"int[2] resolution\", (";
        let Some(at) = text.find(declared).map(|at| at + declared.len()) else {
            return Err(format!("{} says no resolution that could be replaced", options.scene.display()));
        };
        let end = closing(&text, at);
        text.replace_range(at..end, resolution);
    }
    Ok(text)
}

/// Returns the settings: one parameter at a time, then pairs of the two that matter most, without duplicates.
fn settings() -> Vec<(&'static str, Setting)> {
    let mut out: Vec<(&'static str, Setting)> = vec![("base", BASE.to_vec())];
    let mut add = |knob: &'static str, setting: Setting| {
        if !out.iter().any(|(_, known)| *known == setting) {
            out.push((knob, setting));
        }
    };
    let moved = |changes: &[(&'static str, f64)]| -> Setting {
        BASE.iter().map(|(k, v)| (*k, changes.iter().find(|c| c.0 == *k).map_or(*v, |c| c.1))).collect()
    };
    for (knob, values) in SWEEPS {
        for value in values {
            add(knob, moved(&[(knob, *value)]));
        }
    }
    for samples in [16.0, 256.0, 1024.0] {
        for maxerror in [0.1, 0.25, 0.5] {
            add("samples x maxerror", moved(&[("samples", samples), ("maxerror", maxerror)]));
        }
    }
    out
}

fn words(setting: &Setting) -> String {
    setting.iter().map(|(k, v)| format!("{k} {v}")).collect::<Vec<_>>().join(", ")
}

/// Returns the scene with a setting. Numbers in the scene are replaced, and missing ones are added.
fn with(text: &str, setting: &Setting) -> String {
    let (mut out, mut before) = (text.to_owned(), String::new());
    for (knob, value) in setting {
        match *knob {
            "shadingquality" => {
                let declared = format!("\"float {knob}\", ");
                if !replace_number(&mut out, 0, usize::MAX, &declared, *value) {
                    let _ = writeln!(before, "Attribute ({declared}{value})");
                }
            }
            "spatialquality" => {
                let declared = format!("\"int[2] {knob}\", ");
                let pair = format!("({value}, {value})");
                match out
                    .find(&declared)
                    .and_then(|at| Some((at + declared.len(), out[at..].find(')')? + at)))
                {
                    Some((from, to)) => out.replace_range(from..=to, &pair),
                    None => _ = writeln!(before, "Attribute ({declared}{pair})"),
                }
            }
            _ => {
                for shader in SHADERS {
                    let mut from = 0;
                    while let Some(at) = out[from..].find(shader).map(|at| at + from + shader.len()) {
                        let declared = format!("\"float {knob}\", ");
                        let end = closing(&out, at);
                        if !replace_number(&mut out, at, end, &declared, *value) {
                            out.insert_str(at, &format!(", {declared}{value}"));
                        }
                        from = at;
                    }
                }
            }
        }
    }
    before + &out
}

/// Returns the position of the bracket that closes the one that is open at `from`.
fn closing(text: &str, from: usize) -> usize {
    let mut depth = 1;
    for (at, c) in text[from..].char_indices() {
        match c {
            '(' => depth += 1,
            ')' => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return from + at;
        }
    }
    text.len()
}

/// Replaces the number after `declared`. Returns false when there is none.
fn replace_number(text: &mut String, from: usize, to: usize, declared: &str, value: f64) -> bool {
    let part = &text[from..to.min(text.len())];
    let Some(at) = part.find(declared).map(|at| from + at + declared.len()) else { return false };
    let length = text[at..].find([',', ')']).unwrap_or(0);
    text.replace_range(at..at + length, &value.to_string());
    true
}

/// Renders the text of a scene. Returns the seconds and the pixels.
fn render(gelato: &Path, threads: &str, text: &str, image: &Path) -> Result<(f64, Vec<f32>), String> {
    let begin = Instant::now();
    let mut child = Command::new(gelato)
        .args(["-silent", "-threads", threads, "-data", "rgb", "-o"])
        .arg(image)
        .arg("-")
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .map_err(|e| format!("{}: {e}", gelato.display()))?;
    let mut input = child.stdin.take().ok_or("no way to send the scene")?;
    input.write_all(text.as_bytes()).map_err(|e| e.to_string())?;
    drop(input);
    let status = child.wait().map_err(|e| e.to_string())?;
    if !status.success() {
        return Err(format!("gelato: {status}"));
    }
    let seconds = begin.elapsed().as_secs_f64();
    let formats = granita_plugin::bundled_formats(Limits::default());
    let input = formats.open(image).map_err(|e| e.to_string())?;
    Ok((seconds, input.read_level(0, 0).map_err(|e| e.to_string())?.to_floats()))
}

/// Returns the root mean square distance, divided by the mean of the reference.
fn distance(pixels: &[f32], reference: &[f32]) -> Result<f64, String> {
    if pixels.len() != reference.len() {
        return Err("images of different sizes".to_owned());
    }
    let n = reference.len().max(1) as f64;
    let mean = reference.iter().map(|r| f64::from(*r)).sum::<f64>() / n;
    let square = pixels.iter().zip(reference).map(|(p, r)| f64::from(p - r).powi(2)).sum::<f64>() / n;
    Ok(square.sqrt() / mean.max(1e-12))
}

/// True when no other outcome is as fast and as exact, and better in one of both.
fn is_best(one: &Outcome, all: &[Outcome]) -> bool {
    !all.iter().any(|o| {
        o.seconds <= one.seconds && o.error <= one.error && (o.seconds < one.seconds || o.error < one.error)
    })
}

/// Returns the best outcomes, the quickest first.
fn pareto(outcomes: &[Outcome]) -> Vec<&Outcome> {
    let mut best: Vec<&Outcome> = outcomes.iter().filter(|o| is_best(o, outcomes)).collect();
    best.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
    best
}

fn table(outcomes: &[Outcome]) {
    println!("| knob | setting | seconds | error, % | best |\n|---|---|---|---|---|");
    for o in outcomes {
        let best = if is_best(o, outcomes) { "yes" } else { "" };
        println!(
            "| {} | {} | {:.2} | {:.2} | {best} |",
            o.knob,
            words(&o.setting),
            o.seconds,
            100.0 * o.error
        );
    }
    println!("\nPareto-best, quickest first:");
    for o in pareto(outcomes) {
        println!("- {:.2} s, {:.2}%: {}", o.seconds, 100.0 * o.error, words(&o.setting));
    }
}

/// Returns a plot of all outcomes. The best ones are connected.
fn plot(outcomes: &[Outcome], scene: &Path) -> String {
    let name = scene.file_name().unwrap_or_default().to_string_lossy();
    let at = |o: &Outcome| (o.seconds, o.error);
    let mut plot =
        ErrorPlot::new(&name, outcomes.iter().map(|o| o.seconds), outcomes.iter().map(|o| o.error));
    let best: Vec<(f64, f64)> = pareto(outcomes).into_iter().map(at).collect();
    plot.line(&best, ErrorPlot::BLACK);
    let colors = || [ErrorPlot::BLACK].into_iter().chain(ErrorPlot::COLORS);
    let mut knobs: Vec<&str> = Vec::new();
    for outcome in outcomes {
        if !knobs.contains(&outcome.knob) {
            knobs.push(outcome.knob);
        }
        let known = knobs.iter().zip(colors().cycle()).find(|(knob, _)| **knob == outcome.knob);
        plot.dot(at(outcome), &words(&outcome.setting), known.map_or(ErrorPlot::BLACK, |(_, color)| color));
    }
    knobs.iter().zip(colors().cycle()).for_each(|(knob, color)| plot.name(knob, color));
    plot.finish()
}
