//! Our tools beside the public ones of the field, in one run, as ratios.
//!
//! `maketx` against OpenImageIO's `maketx` (called `oiiotool`'s sibling on most systems) on one picture.

#![forbid(unsafe_code)]
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a table for a terminal")]

use granita_benches::{Cost, find_program, measure, release_tool, repository};
use std::path::Path;
use std::process::{Command, ExitCode};

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(what) => {
            eprintln!("peers: {what}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), String> {
    let ours = release_tool("maketx")?;
    let picture = repository().join("examples").join("first").join("brick.png");
    let output = std::env::temp_dir().join(format!("granita-peers-{}.tx", std::process::id()));
    let mine = texture(&ours, &picture, &output)?;
    println!("maketx brick.png: {:.3} s, {} MiB", mine.wall.as_secs_f64(), mebibytes(&mine));
    match find_program("maketx") {
        Some(theirs) => {
            let other = texture(&theirs, &picture, &output)?;
            println!(
                "  OpenImageIO's: {:.3} s, {} MiB; ours takes {:.2} of its time",
                other.wall.as_secs_f64(),
                mebibytes(&other),
                mine.wall.as_secs_f64() / other.wall.as_secs_f64()
            );
        }
        None => println!("  OpenImageIO's maketx is not installed: no comparison"),
    }
    std::fs::remove_file(&output).map_err(|e| format!("{}: {e}", output.display()))
}

fn texture(program: &Path, picture: &Path, output: &Path) -> Result<Cost, String> {
    measure(3, || {
        let mut command = Command::new(program);
        command.arg(picture).arg("-o").arg(output);
        command
    })
}

fn mebibytes(cost: &Cost) -> String {
    cost.peak_bytes.map_or("?".to_owned(), |b| format!("{:.0}", b as f64 / (1 << 20) as f64))
}
