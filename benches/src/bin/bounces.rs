//! Measures what further bounces cost: reflections of reflections, and indirect light.
//!
//! `cargo run --release -p granita-benches --bin bounces`
//!
//! Each scene is rendered with one thread and one to four bounces. The table has the processor time, also relative to
//! one bounce, and the rays.

#![forbid(unsafe_code)]
#![allow(clippy::print_stdout, reason = "a table for a terminal")]

use granita_benches::{measure, measure_into, release_tool, repository};
use std::path::Path;
use std::process::{Command, ExitCode};
use std::time::Duration;

/// A scene under `benches/frames`, the attribute that is the number of bounces, and its description.
const SCENES: [(&str, &str, &str); 4] = [
    ("mirrors.pyg", "ray:maxdepth", "a mirror ball on a mirror floor"),
    ("hall.pyg", "ray:maxdepth", "a hall of blurred mirrors"),
    ("room.pyg", "indirect:maxdepth", "a room with the sun in its window"),
    ("box.pyg", "indirect:maxdepth", "the Cornell box"),
];
/// The largest number of bounces.
const BOUNCES: u32 = 4;

fn main() -> ExitCode {
    granita_benches::exit("bounces", run())
}

fn run() -> Result<(), String> {
    let gelato = release_tool("gelato")?;
    let place = tempfile::tempdir().map_err(|e| e.to_string())?;
    let frames = repository().join("benches").join("frames");
    println!(
        "{:<12} {:>7} {:>8} {:>9} {:>10} {:>10}  about",
        "scene", "bounces", "time", "relative", "rays", "records"
    );
    for (file, attribute, about) in SCENES {
        let mut one = None;
        for bounces in 1..=BOUNCES {
            let scene = place.path().join("scene.pyg");
            // The pixels, and not the time to write them, are measured: the image is written once.
            let text = format!(
                "Attribute (\"int {attribute}\", {bounces})\nOutput (\"out.tif\", \"tiff\", \"rgb\", \"camera\")\n\
                 Attribute (\"string path:input\", \"{}:&\")\nInput (\"{}\")\n",
                repository().join("examples").join("indirect").display(),
                frames.join(file).display()
            );
            std::fs::write(&scene, text).map_err(|e| e.to_string())?;
            let command = |what: &str| {
                let mut command = Command::new(&gelato);
                command.current_dir(place.path()).args([what, "-threads", "1", "scene.pyg"]);
                command
            };
            let cost = measure(2, || command("-silent"))?;
            let time = cost.processor.unwrap_or(cost.wall);
            let first = *one.get_or_insert(time);
            let report = place.path().join("statistics.txt");
            measure_into(&report, command("-statistics"))?;
            let [rays, records] = counts(&report)?;
            println!(
                "{file:<12} {bounces:>7} {:>7.2}s {:>9.2} {rays:>10} {records:>10}  {about}",
                time.as_secs_f64(),
                time.as_secs_f64() / first.max(Duration::from_millis(1)).as_secs_f64()
            );
        }
    }
    Ok(())
}

/// Returns the numbers of rays and of records of indirect light of a report of `-statistics`.
fn counts(report: &Path) -> Result<[u64; 2], String> {
    let text = std::fs::read_to_string(report).map_err(|e| format!("{}: {e}", report.display()))?;
    let number = |what: &str| {
        let line = text.lines().find_map(|line| line.trim_start().strip_prefix(what));
        let word = line.and_then(|rest| rest.split_whitespace().next());
        word.and_then(|word| word.parse().ok()).ok_or_else(|| format!("no \"{what}\" in the statistics"))
    };
    Ok([number("rays")?, number("indirect light, occlusion")?])
}
