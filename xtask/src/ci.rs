//! The checks for a change, ordered so that the most frequent errors fail fastest.

use crate::workspace::{Workspace, cargo};
use std::collections::BTreeSet;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

/// The beginning of the test command in the README. The first step reads the command from there, so that the two cannot
/// differ.
const TEST_MARK: &str = "cargo test";

/// The beginning of the line that `tests/needs` writes for a skipped test.
const SKIPPED: &str = "skipped: ";

/// Runs all steps until one fails.
pub(crate) fn run() -> Result<(), String> {
    let workspace = Workspace::load()?;
    let root = &workspace.root;
    let readme = std::fs::read_to_string(root.join("README.md")).map_err(|e| format!("README.md: {e}"))?;
    let test = readme
        .lines()
        .find(|line| line.starts_with(TEST_MARK))
        .ok_or("README.md names no test command")?
        .trim();
    let words: Vec<&str> = test.split_whitespace().skip(1).collect();
    tests(root, &words)?;
    step(root, "format", &["fmt", "--all", "--check"])?;
    step(root, "lints", &["clippy", "--workspace", "--all-targets", "--quiet", "--", "-D", "warnings"])?;
    devices(root)?;
    step(root, "docs", &["doc", "--workspace", "--no-deps", "--quiet"])?;
    crate::tidy()?;
    pages(root)?;
    attack()?;
    farm()?;
    other_architecture(root)?;
    dependencies(root)
}

fn step(root: &Path, name: &str, arguments: &[&str]) -> Result<(), String> {
    step_with(root, name, arguments, &[("RUSTDOCFLAGS", "-D warnings")])
}

fn step_with(root: &Path, name: &str, arguments: &[&str], variables: &[(&str, &str)]) -> Result<(), String> {
    println!("ci: {name}: cargo {}", arguments.join(" "));
    let start = Instant::now();
    let status = Command::new(cargo())
        .current_dir(root)
        .args(arguments)
        .envs(variables.iter().copied())
        .status()
        .map_err(|e| format!("cargo: {e}"))?;
    println!("ci: {name}: {:.0} s", start.elapsed().as_secs_f64());
    if status.success() { Ok(()) } else { Err(format!("{name} failed")) }
}

/// Runs the tests, and prints at the end which of them were skipped. Tests report it on standard error (see
/// `tests/needs`).
fn tests(root: &Path, arguments: &[&str]) -> Result<(), String> {
    println!("ci: tests: cargo {}", arguments.join(" "));
    let start = Instant::now();
    let mut cargo = Command::new(cargo());
    cargo.current_dir(root).args(arguments).env("RUSTDOCFLAGS", "-D warnings").stderr(Stdio::piped());
    // See `granita_tests::Tools`.
    cargo.env("GRANITA_WHOLE_WORKSPACE", "1");
    let mut child = cargo.spawn().map_err(|e| format!("cargo: {e}"))?;
    let mut skipped = BTreeSet::new();
    if let Some(mut lines) = child.stderr.take().map(BufReader::new) {
        let mut line = Vec::new();
        while lines.read_until(b'\n', &mut line).map_err(|e| format!("cargo: {e}"))? > 0 {
            // When standard error cannot be written, the status still counts.
            let _ = std::io::stderr().write_all(&line);
            let text = String::from_utf8_lossy(&line);
            skipped.extend(text.strip_prefix(SKIPPED).map(|what| what.trim_end().to_owned()));
            line.clear();
        }
    }
    let status = child.wait().map_err(|e| format!("cargo: {e}"))?;
    for what in &skipped {
        println!("ci: tests: skipped: {what}");
    }
    println!("ci: tests: {} skipped, {:.0} s", skipped.len(), start.elapsed().as_secs_f64());
    if status.success() { Ok(()) } else { Err("tests failed".to_owned()) }
}

/// Checks what only builds with devices. Its tests, `cargo test -p gelato --features gpu --test gpu`, take minutes to
/// build; those of the crate `gpu` are among the tests of the workspace.
fn devices(root: &Path) -> Result<(), String> {
    let built = [
        "--package",
        "gelato",
        "--package",
        "granita-benches",
        "--features",
        "gelato/gpu,granita-benches/gpu",
    ];
    let lints = [&["clippy", "--quiet"], &built[..], &["--bins", "--tests", "--", "-D", "warnings"]].concat();
    step(root, "devices", &lints)
}

/// Checks the links of the manual and a part of each of its images. The tests of the manual have run before.
fn pages(root: &Path) -> Result<(), String> {
    let start = Instant::now();
    crate::book::check_links(None)?;
    println!("ci: book: {:.0} s", start.elapsed().as_secs_f64());
    let start = Instant::now();
    // The tests have built it.
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root.join("target"), Into::into);
    crate::gallery::check_all(target.join("debug").join(format!("gelato{}", std::env::consts::EXE_SUFFIX)))?;
    println!("ci: gallery: {:.0} s", start.elapsed().as_secs_f64());
    Ok(())
}

/// Runs the fixed part of `cargo xtask attack`, on systems that support it.
fn attack() -> Result<(), String> {
    #[cfg(target_os = "linux")]
    {
        let start = Instant::now();
        crate::attack::fixed()?;
        println!("ci: attack: {:.0} s", start.elapsed().as_secs_f64());
    }
    #[cfg(not(target_os = "linux"))]
    println!("ci: attack: skipped, it needs /proc and sh of Linux");
    Ok(())
}

/// Runs the part of `cargo xtask farm` without Slurm, on systems that support it.
fn farm() -> Result<(), String> {
    #[cfg(target_os = "linux")]
    {
        let start = Instant::now();
        crate::farm::fixed()?;
        println!("ci: farm: {:.0} s", start.elapsed().as_secs_f64());
    }
    #[cfg(not(target_os = "linux"))]
    println!("ci: farm: skipped, it needs signals and /proc of Linux");
    Ok(())
}

/// The crates that are checked for another architecture. All code that differs between architectures is in them.
const PORTABLE: [&str; 9] = [
    "granita-base",
    "granita-image",
    "granita-scene",
    "granita-gsl",
    "granita-geom",
    "granita-trace",
    "granita-sdb",
    "granita-texture",
    "granita-shade",
];

/// The crates with code for AVX2 beside the portable code.
const DISPATCHED: [&str; 3] = ["granita-trace", "granita-texture", "granita-shade"];

/// The compiler of this machine stands in for the other architecture's. A check links nothing, so what it makes of the
/// C code of dependencies is never used.
const STAND_INS: [(&str, &str); 2] =
    [("CC_aarch64_unknown_linux_gnu", "cc"), ("AR_aarch64_unknown_linux_gnu", "ar")];

/// The other architecture.
const OTHER: &str = "aarch64-unknown-linux-gnu";

/// Checks the crates for another architecture, where its standard library is installed, and runs the tests of the
/// code for it.
fn other_architecture(root: &Path) -> Result<(), String> {
    let packages =
        |names: &[&'static str]| names.iter().flat_map(|name| ["--package", name]).collect::<Vec<_>>();
    let answer = Command::new("rustc").args(["--print", "target-libdir", "--target", OTHER]).output();
    let is_there = answer.is_ok_and(|answer| {
        answer.status.success() && Path::new(String::from_utf8_lossy(&answer.stdout).trim()).is_dir()
    });
    if is_there {
        let check = [vec!["check", "--quiet", "--target", OTHER], packages(&PORTABLE)].concat();
        step_with(root, "other architecture", &check, &STAND_INS)?;
    } else {
        println!("ci: other architecture: skipped, {OTHER} is not installed (rustup target add {OTHER})");
    }
    if cfg!(target_arch = "x86_64") {
        portable(root)?;
    }
    Ok(())
}

/// Runs the tests of [`DISPATCHED`] again, without wide vectors. Their programs are those that the tests of the whole
/// workspace left. `cargo test` of these packages alone would build them again, with other features of dependencies.
fn portable(root: &Path) -> Result<(), String> {
    let start = Instant::now();
    let built = Command::new(cargo())
        .current_dir(root)
        .args(["test", "--workspace", "--no-run", "--quiet", "--message-format", "json"])
        .stderr(Stdio::inherit())
        .output()
        .map_err(|e| format!("cargo: {e}"))?;
    let mut programs = Vec::new();
    for line in String::from_utf8_lossy(&built.stdout).lines() {
        let Ok(artifact) = serde_json::from_str::<serde_json::Value>(line) else { continue };
        let text = |key: &str| artifact[key].as_str().unwrap_or_default();
        let (manifest, program) = (Path::new(text("manifest_path")), text("executable"));
        let folder = manifest.parent().unwrap_or(root);
        let package = folder.file_name().unwrap_or_default().to_string_lossy();
        if !program.is_empty() && DISPATCHED.contains(&&*format!("granita-{package}")) {
            programs.push((folder.to_owned(), program.to_owned()));
        }
    }
    if programs.len() < DISPATCHED.len() {
        return Err("portable code: its tests were not built".to_owned());
    }
    for (folder, program) in &programs {
        let mut test = Command::new(program);
        test.current_dir(folder).arg("--quiet").env("GRANITA_PORTABLE", "1");
        let status = test.status().map_err(|e| format!("{program}: {e}"))?;
        if !status.success() {
            return Err(format!("portable code: {program} failed"));
        }
    }
    println!("ci: portable code: {} programs, {:.0} s", programs.len(), start.elapsed().as_secs_f64());
    Ok(())
}

/// Runs `cargo deny` if it is installed.
fn dependencies(root: &Path) -> Result<(), String> {
    let is_fine = |arguments: &[&str]| {
        Command::new(cargo())
            .current_dir(root)
            .args(arguments)
            .output()
            .is_ok_and(|answer| answer.status.success())
    };
    if !is_fine(&["deny", "--version"]) {
        println!("ci: dependencies: skipped, cargo-deny is not installed (cargo install cargo-deny)");
        Ok(())
    } else if !is_fine(&["fetch", "--locked", "--quiet"]) {
        println!("ci: dependencies: skipped, what other systems need cannot be fetched");
        Ok(())
    } else {
        step(root, "dependencies", &["deny", "--offline", "check", "licenses", "bans", "sources"])
    }
}
