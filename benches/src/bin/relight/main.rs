//! Measures re-rendering: the time from an edit to the last pixel, beside that of the same frame rendered anew.
//!
//! `cargo run --release -p granita-benches --bin relight [-- --only WORD --threads N --size WxH --gelato PATH]`
//!
//! Each case is a scene, a size and a number of threads. Two processes make the same edits one after the other, each
//! from the state that the edits before it left: one keeps what it can between frames, the other renders each frame
//! anew. Images are delivered in memory. Their writing as OpenEXR is timed apart. A third process renders the first
//! frame without "rerender".
//!
//! `--only` selects scenes by their names or edits by words of theirs. `--gelato` is the program that makes textures
//! and maps; without it one is built for release.

#![forbid(unsafe_code)]
#![allow(clippy::print_stdout, reason = "a table for a terminal")]

mod child;
mod scenes;

use granita_benches::release_tool;
use scenes::{KINDS, SCENES, Scene};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

/// The allocator of `gelato`.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// The selected cases.
struct Options {
    only: Option<String>,
    threads: Vec<usize>,
    sizes: Vec<(u32, u32)>,
    gelato: Option<PathBuf>,
}

/// The times of a process in seconds, and its peak memory.
#[derive(Default)]
struct Times {
    first: f64,
    edits: Vec<f64>,
    write: f64,
    peak_bytes: u64,
}

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let done = match words.split_first() {
        Some((first, rest)) if first == "--child" => child::run(rest),
        _ => options(&words).and_then(|options| run(&options)),
    };
    granita_benches::exit("relight", done)
}

fn options(words: &[String]) -> Result<Options, String> {
    let mut options =
        Options { only: None, threads: vec![1, 2], sizes: vec![(640, 480), (1920, 1080)], gelato: None };
    for pair in words.chunks(2) {
        let [name, value] = pair else { return Err(format!("{} needs a value", pair[0])) };
        let bad = || format!("{name} {value}: not a value of this option");
        match name.as_str() {
            "--only" => options.only = Some(value.clone()),
            "--threads" => options.threads = vec![value.parse().map_err(|_| bad())?],
            "--size" => {
                let (width, height) = value.split_once('x').ok_or_else(bad)?;
                options.sizes = vec![(width.parse().map_err(|_| bad())?, height.parse().map_err(|_| bad())?)];
            }
            "--gelato" => options.gelato = Some(std::path::absolute(value).map_err(|e| e.to_string())?),
            _ => return Err(format!("no option {name}; there are --only, --threads, --size and --gelato")),
        }
    }
    Ok(options)
}

fn run(options: &Options) -> Result<(), String> {
    let only = options.only.as_deref().unwrap_or("");
    let named = SCENES.iter().any(|scene| scene.name == only);
    let scenes: Vec<&Scene> = SCENES.iter().filter(|scene| !named || scene.name == only).collect();
    let kinds: Vec<usize> =
        (0..KINDS.len()).filter(|i| named || only.is_empty() || KINDS[*i].0.contains(only)).collect();
    if kinds.is_empty() {
        return Err(format!("no scene and no edit is named {only}"));
    }
    let gelato = match &options.gelato {
        Some(path) => path.clone(),
        None => release_tool("gelato")?,
    };
    let place = tempfile::tempdir().map_err(|e| e.to_string())?;
    for scene in scenes {
        scene.prepare(&gelato, place.path())?;
        for size in &options.sizes {
            for threads in &options.threads {
                case(scene, *size, *threads, &kinds, place.path())?;
            }
        }
    }
    Ok(())
}

/// Measures a scene, and prints its table.
fn case(
    scene: &Scene,
    size: (u32, u32),
    threads: usize,
    kinds: &[usize],
    place: &Path,
) -> Result<(), String> {
    let edits: Vec<(usize, String)> =
        kinds.iter().filter_map(|kind| Some((*kind, scene.edit(*kind)?))).collect();
    let write =
        |name: &str, text: String| std::fs::write(place.join(name), text).map_err(|e| format!("{name}: {e}"));
    write("scene.pyg", scene.text(size, "Attribute (\"int rerender\", 1)\n")?)?;
    write("plain.pyg", scene.text(size, "")?)?;
    write("edits.pyg", edits.iter().map(|(_, text)| format!("{text}{}", child::EDIT)).collect())?;
    write("none.pyg", String::new())?;
    let plain = times("anew", threads, "plain.pyg", "none.pyg", place)?;
    let anew = times("anew", threads, "scene.pyg", "edits.pyg", place)?;
    let kept = times("kept", threads, "scene.pyg", "edits.pyg", place)?;
    let (width, height) = size;
    println!("{} at {width} x {height}, {threads} thread(s)", scene.name);
    println!("  {:<30} {:>9} {:>11} {:>8} {:>6}", "edit", "anew", "re-rendered", "ratio", "bar");
    for (((kind, _), anew), kept) in edits.iter().zip(&anew.edits).zip(&kept.edits) {
        let (name, bar) = KINDS[*kind];
        let (ratio, missed) = (anew / kept, if anew / kept < bar { "  missed" } else { "" });
        println!("  {name:<30} {anew:>8.3}s {kept:>10.3}s {ratio:>8.1} {:>6}{missed}", format!(">={bar}"));
    }
    let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    println!(
        "  first image: {:.3} s plain, {:.3} s with \"rerender\", ratio {:.2}",
        plain.first,
        kept.first,
        kept.first / plain.first
    );
    println!(
        "  peak memory: {:.0} MiB plain, {:.0} MiB anew, {:.0} MiB re-rendered; writing OpenEXR: {:.3} s",
        mib(plain.peak_bytes),
        mib(anew.peak_bytes),
        mib(kept.peak_bytes),
        kept.write
    );
    Ok(())
}

/// Runs a process, and reads its times.
fn times(mode: &str, threads: usize, scene: &str, edits: &str, place: &Path) -> Result<Times, String> {
    let own = std::env::current_exe().map_err(|e| e.to_string())?;
    let mut command = Command::new(own);
    command.current_dir(place).args(["--child", mode, &threads.to_string(), scene, edits]);
    let done = command.output().map_err(|e| e.to_string())?;
    if !done.status.success() {
        return Err(String::from_utf8_lossy(&done.stderr).into_owned());
    }
    let mut times = Times::default();
    for line in String::from_utf8_lossy(&done.stdout).lines() {
        let Some((what, number)) = line.split_once(' ') else { continue };
        let seconds: f64 = number.parse().map_err(|_| format!("a child printed {line}"))?;
        match what {
            "first" => times.first = seconds,
            "edit" => times.edits.push(seconds),
            "write" => times.write = seconds,
            _ => times.peak_bytes = seconds as u64,
        }
    }
    Ok(times)
}
