//! Measures the cost of a second eye, more samples, a second thread and preview mode, as ratios of alternating runs.

#![forbid(unsafe_code)]
#![allow(clippy::print_stdout, reason = "a table for a terminal")]

use granita_benches::{Cost, Fur, measure, release_tool, repository};
use std::path::Path;
use std::process::{Command, ExitCode};
use std::time::Duration;

/// The number of runs of each side of a ratio.
const TURNS: usize = 3;

/// A ratio that is measured.
struct Ratio {
    what: &'static str,
    /// The scenes and options of the two sides.
    sides: [(&'static str, &'static [&'static str]); 2],
    /// True when the ratio is of wall clock time, false for processor time.
    wall: bool,
    /// The largest allowed ratio; the least one when `above` is true.
    bar: f64,
    above: bool,
}

/// All ratios. Each is the second side over the first.
const RATIOS: [Ratio; 8] = [
    ratio("fur: 8 x 8 samples over 4 x 4", [("fur.pyg", &[]), ("fur8.pyg", &[])], 1.3),
    ratio("first: 8 x 8 samples over 4 x 4", [("first.pyg", &[]), ("first8.pyg", &[])], 1.3),
    ratio("fur: stereo over mono", [("fur.pyg", &[]), ("stereo.pyg", &[])], 1.35),
    ratio("first: stereo over mono", [("first.pyg", &[]), ("first-stereo.pyg", &[])], 1.35),
    speed_up("fur: -preview 0.1", [("fur.pyg", &["-preview", "0.1"]), ("fur.pyg", &[])], false, 10.0),
    speed_up("first: -preview 0.1", [("first.pyg", &["-preview", "0.1"]), ("first.pyg", &[])], false, 10.0),
    speed_up("fur: two threads", [("fur.pyg", &["-threads", "2"]), ("fur.pyg", &[])], true, 1.85),
    speed_up("first: two threads", [("first.pyg", &["-threads", "2"]), ("first.pyg", &[])], true, 1.85),
];

type Sides = [(&'static str, &'static [&'static str]); 2];

const fn ratio(what: &'static str, sides: Sides, bar: f64) -> Ratio {
    Ratio { what, sides, wall: false, bar, above: false }
}

const fn speed_up(what: &'static str, sides: Sides, wall: bool, bar: f64) -> Ratio {
    Ratio { what, sides, wall, bar, above: true }
}

fn main() -> ExitCode {
    granita_benches::exit("views", run())
}

fn run() -> Result<(), String> {
    let gelato = release_tool("gelato")?;
    let place = tempfile::tempdir().map_err(|e| e.to_string())?;
    prepare(&gelato, place.path())?;
    println!("{:<32} {:>9} {:>9} {:>7}  bar", "ratio", "one, s", "other, s", "ratio");
    for ratio in &RATIOS {
        let mut best = [Duration::MAX; 2];
        for _ in 0..TURNS {
            for (best, (scene, options)) in best.iter_mut().zip(&ratio.sides) {
                let cost = measure(1, || {
                    let mut command = Command::new(&gelato);
                    command.current_dir(place.path()).arg("-silent").args(*options).arg(scene);
                    if !options.contains(&"-threads") {
                        command.args(["-threads", "1"]);
                    }
                    command
                })?;
                *best = (*best).min(if ratio.wall { cost.wall } else { processor(&cost) });
            }
        }
        let [one, other] = best.map(|time| time.as_secs_f64());
        let met = if ratio.above { other / one >= ratio.bar } else { other / one <= ratio.bar };
        println!(
            "{:<32} {one:>9.2} {other:>9.2} {:>6.2}x  {} {}{}",
            ratio.what,
            other / one,
            if ratio.above { "at least" } else { "at most" },
            ratio.bar,
            if met { "" } else { ", missed" }
        );
    }
    println!(
        "(processor time; of two threads wall clock, which tells only when the machine does nothing else)"
    );
    Ok(())
}

/// Returns the processor time, or the wall clock time where the system does not provide it.
fn processor(cost: &Cost) -> Duration {
    cost.processor.unwrap_or(cost.wall)
}

/// Writes the scenes. The frame of `examples/first` is written at half of its size, and without the commands that make
/// its textures, maps and shaders. These run once here.
fn prepare(gelato: &Path, place: &Path) -> Result<(), String> {
    let write =
        |name: &str, text: String| std::fs::write(place.join(name), text).map_err(|e| format!("{name}: {e}"));
    let fur = Fur::default();
    write("fur.pyg", fur.scene())?;
    write("fur8.pyg", Fur { spatialquality: 8, ..fur }.scene())?;
    write("stereo.pyg", Fur { stereo: true, ..fur }.scene())?;
    let (from, to) = (repository().join("examples/first"), place.join("examples/first"));
    std::fs::create_dir_all(&to).map_err(|e| e.to_string())?;
    for entry in std::fs::read_dir(&from).map_err(|e| e.to_string())? {
        let entry = entry.map_err(|e| e.to_string())?;
        if entry.path().is_file() {
            std::fs::copy(entry.path(), to.join(entry.file_name())).map_err(|e| e.to_string())?;
        }
    }
    let data = place.join("examples/data");
    std::fs::create_dir_all(&data).map_err(|e| e.to_string())?;
    std::fs::copy(repository().join("examples/data/rabbit.pyg"), data.join("rabbit.pyg"))
        .map_err(|e| format!("rabbit.pyg: {e}"))?;
    let text = std::fs::read_to_string(from.join("first.pyg")).map_err(|e| e.to_string())?;
    let (size, quality) = ("resolution\", (1280, 800)", "spatialquality\", (4, 4)");
    if !(text.contains(size) && text.contains(quality)) {
        return Err(format!("first.pyg no longer says {size} and {quality}"));
    }
    let text = text.replace(size, "resolution\", (640, 400)");
    std::fs::write(to.join("first.pyg"), &text).map_err(|e| e.to_string())?;
    let made = Command::new(gelato)
        .current_dir(place)
        .args(["-silent", "examples/first/first.pyg"])
        .status()
        .map_err(|e| e.to_string())?;
    if !made.success() {
        return Err(format!("examples/first/first.pyg: {made}"));
    }
    let frame: String =
        text.lines().filter(|l| !l.starts_with("Command (")).flat_map(|l| [l, "\n"]).collect();
    let eyes =
        "Attribute (\"float stereo:separation\", 0.35)\nAttribute (\"float stereo:convergence\", 15)\n";
    write("first-stereo.pyg", format!("{eyes}{frame}"))?;
    write("first8.pyg", frame.replace(quality, "spatialquality\", (8, 8)"))?;
    write("first.pyg", frame)
}
