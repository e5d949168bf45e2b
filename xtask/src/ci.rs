//! What a change must pass, in the order that fails fastest on what people get wrong most.

use crate::workspace::{Workspace, cargo};
use std::path::Path;
use std::process::Command;
use std::time::Instant;

/// The README's test command is the first step; it is read from there so that the two cannot differ.
const TEST_MARK: &str = "cargo test";

/// Runs all steps; stops at the first that fails.
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
    step(root, "tests", &words)?;
    step(root, "format", &["fmt", "--all", "--check"])?;
    step(root, "lints", &["clippy", "--workspace", "--all-targets", "--quiet", "--", "-D", "warnings"])?;
    step(root, "docs", &["doc", "--workspace", "--no-deps", "--quiet"])?;
    crate::tidy()?;
    attack()?;
    licences(root)
}

fn step(root: &Path, name: &str, arguments: &[&str]) -> Result<(), String> {
    println!("ci: {name}: cargo {}", arguments.join(" "));
    let start = Instant::now();
    let status = Command::new(cargo())
        .current_dir(root)
        .args(arguments)
        .env("RUSTDOCFLAGS", "-D warnings")
        .status()
        .map_err(|e| format!("cargo: {e}"))?;
    println!("ci: {name}: {:.0} s", start.elapsed().as_secs_f64());
    if status.success() { Ok(()) } else { Err(format!("{name} failed")) }
}

/// The fixed part of `cargo xtask attack`, where it runs.
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

/// `cargo deny` where it is installed.
fn licences(root: &Path) -> Result<(), String> {
    let there = Command::new(cargo())
        .args(["deny", "--version"])
        .output()
        .is_ok_and(|answer| answer.status.success());
    if there {
        step(root, "licences", &["deny", "--offline", "check", "licenses", "bans", "sources"])
    } else {
        println!("ci: licences: skipped, cargo-deny is not installed");
        Ok(())
    }
}
