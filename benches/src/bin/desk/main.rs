//! Measures how quickly the desk for lighting (`gelato -relight`) answers, on `examples/relight` at 960 x 540 pixels.
//!
//! One part drives the page of the desk in a headless browser, the other the window of `iv` under Xvfb. In both, a
//! light is dragged, and each event of the drag is timed until an image with its change is painted, and the release
//! until the final image is painted. A part whose programs are missing is skipped with a line.
//!
//! `desk page` and `desk window` run one of the parts. `--tools FOLDER` measures the tools in a folder, such as those
//! of another checkout, instead of those of this one.

#![forbid(unsafe_code)]
#![allow(clippy::print_stdout, reason = "a table for a terminal")]

mod page;
mod times;
mod window;

use granita_benches::{copy_files, release_tool, repository};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, ExitCode, Stdio};

/// The number of drags of each kind.
const TURNS: usize = 3;

/// The scene, below the folder of the bench.
const SCENE: &str = "examples/relight/relight.pyg";

fn main() -> ExitCode {
    granita_benches::exit("desk", run())
}

fn run() -> Result<(), String> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let (only, folder) = match words.iter().map(|word| &**word).collect::<Vec<_>>()[..] {
        [] => ("", None),
        [part] => (part, None),
        ["--tools", folder] => ("", Some(folder)),
        [part, "--tools", folder] => (part, Some(folder)),
        _ => ("?", None),
    };
    if !["", "page", "window"].contains(&only) {
        return Err("usage: desk [page | window] [--tools FOLDER]".to_owned());
    }
    let tool = |name: &str| match folder {
        None => release_tool(name),
        Some(folder) => std::path::absolute(Path::new(folder).join(name)).map_err(|e| e.to_string()),
    };
    // The scene runs the last two, which lie beside gelato.
    let [gelato, iv, gslc, maketx] = ["gelato", "iv", "gslc", "maketx"].map(tool);
    let tools = Tools { gelato: gelato?, iv: iv? };
    gslc.and(maketx)?;
    let place = tempfile::tempdir().map_err(|e| e.to_string())?;
    for folder in ["examples/first", "examples/relight", "examples/data"] {
        copy_files(&repository().join(folder), &place.path().join(folder))?;
    }
    times::head();
    if only != "window" {
        page::measure(&tools, place.path())?;
    }
    if only != "page" {
        window::measure(&tools, place.path())?;
    }
    Ok(())
}

/// The programs under measurement.
struct Tools {
    gelato: PathBuf,
    iv: PathBuf,
}

/// A process, and the lines of its standard output.
struct Process {
    child: Child,
    lines: std::io::Lines<BufReader<ChildStdout>>,
}

impl Drop for Process {
    fn drop(&mut self) {
        // Both calls fail when the process has already ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Process {
    fn start(command: &mut Command) -> Result<Self, String> {
        let name = command.get_program().to_string_lossy().into_owned();
        command.stdin(Stdio::null()).stdout(Stdio::piped());
        let mut child = command.spawn().map_err(|e| format!("{name}: {e}"))?;
        let output = child.stdout.take().ok_or("a process without output")?;
        Ok(Self { child, lines: BufReader::new(output).lines() })
    }

    /// Returns the rest of the first line that begins with a text; `None` when the output ends before.
    fn line(&mut self, begin: &str) -> Option<String> {
        self.lines.by_ref().map_while(Result::ok).find_map(|line| line.strip_prefix(begin).map(str::to_owned))
    }
}

/// Starts the desk with the scene.
fn desk(tools: &Tools, place: &Path, words: &[&str]) -> Result<Process, String> {
    let mut command = Command::new(&tools.gelato);
    command.current_dir(place).arg("-relight").args(words).arg(SCENE);
    // Without a screen the desk opens no browser of its own.
    command.env("HOME", place).env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY");
    Process::start(&mut command)
}
