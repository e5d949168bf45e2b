//! Compares `imgtool` with OpenImageIO's `oiiotool`.
//!
//! `cargo run --release -p granita-benches --bin peers -- --edits`
//!
//! The other program is found by the variable `OIIO_TOOL`, or on the search path. Both run the same command lines on an
//! image of 8192 x 8192 halves with three channels (TIFF, zip), with two threads. They alternate, and the fastest of
//! three runs counts.

use granita_benches::{Cost, find_program, measure, release_tool};
use std::path::{Path, PathBuf};
use std::process::Command;

/// The command lines, after the name of the input.
const CASES: [(&str, &str); 6] = [
    ("convert to OpenEXR, zip", "-d half --compression zip -o OUT.exr"),
    ("convert to TIFF, 8 bits, lzw", "-d uint8 --compression lzw -o OUT.tif"),
    ("crop to 4096^2, TIFF", "--crop 4096x4096+1024+1024 -d half --compression zip -o OUT.tif"),
    ("resize to 1024^2, lanczos3", "--resize:filter=lanczos3 1024x1024 -d half --compression zip -o OUT.exr"),
    (
        "crop, resize to 1024^2, convert",
        "--cut 6144x6144+1024+1024 --resize:filter=lanczos3 1024x1024 -d uint8 -o OUT.png",
    ),
    ("rotate90, half of the values", "--rotate90 --mulc 0.5 -d half --compression zip -o OUT.tif"),
];

const RUNS: usize = 3;

/// Runs all cases and prints a table.
///
/// # Errors
/// A message when a program cannot be started or fails.
pub(crate) fn run(input: &Path, place: &Path) -> Result<(), String> {
    let theirs = std::env::var_os("OIIO_TOOL").map(PathBuf::from).or_else(|| find_program("oiiotool"));
    if theirs.is_none() {
        println!("OpenImageIO's oiiotool is not here (OIIO_TOOL or the search path): ours alone");
    }
    let ours = release_tool("imgtool")?;
    println!(
        "{:<34} {:>8} {:>8} {:>6} {:>9} {:>9} {:>6}",
        "imgtool, 8192 x 8192", "ours", "theirs", "ratio", "our MiB", "their MiB", "ratio"
    );
    for (about, line) in CASES {
        let (mut mine, mut other) = (None, None);
        for _ in 0..RUNS {
            quicker(&mut mine, once(&ours, input, line, &place.join("ours"))?);
            if let Some(program) = &theirs {
                quicker(&mut other, once(program, input, line, &place.join("theirs"))?);
            }
        }
        let Some(mine) = mine else { continue };
        let mib = |cost: Cost| cost.peak_bytes.map(|b| b as f64 / f64::from(1 << 20));
        let seconds = |cost: Cost| Some(cost.wall.as_secs_f64());
        let text = |v: Option<f64>, digits: usize| v.map_or("-".to_owned(), |v| format!("{v:.digits$}"));
        let ratio = |f: &dyn Fn(Cost) -> Option<f64>| Some(f(mine)? / f(other?)?);
        println!(
            "{about:<34} {:>8} {:>8} {:>6} {:>9} {:>9} {:>6}",
            text(seconds(mine), 2),
            text(other.and_then(seconds), 2),
            text(ratio(&seconds), 2),
            text(mib(mine), 0),
            text(other.and_then(mib), 0),
            text(ratio(&mib), 2),
        );
    }
    Ok(())
}

/// Keeps the faster run.
fn quicker(best: &mut Option<Cost>, cost: Cost) {
    if best.is_none_or(|b| cost.wall < b.wall) {
        *best = Some(cost);
    }
}

/// Runs one command line.
fn once(program: &Path, input: &Path, line: &str, output: &Path) -> Result<Cost, String> {
    let output = output.to_string_lossy();
    measure(1, || {
        let mut command = Command::new(program);
        command.args(["--threads", "2"]).arg(input);
        command.args(line.split(' ').map(|word| word.replace("OUT", &output)));
        command
    })
}
