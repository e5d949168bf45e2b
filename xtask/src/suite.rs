//! Calls the runner of the suite in `tests/`.

use crate::workspace::{Workspace, cargo};
use std::process::Command;

/// Runs the suite so that it replaces references. The name `manual` stands for the pages that are made from tables.
pub(crate) fn bless(name: Option<&str>) -> Result<(), String> {
    let variables = [("GRANITA_BLESS", name.unwrap_or("all"))];
    if name.is_none_or(|name| name == "manual") {
        tests("manual", &variables)?;
    }
    if name == Some("manual") { Ok(()) } else { tests("suite", &variables) }
}

/// Runs the suite so that it writes a page of images.
pub(crate) fn report() -> Result<(), String> {
    let root = Workspace::load()?.root;
    let folder = root.join("target").join("suite-report");
    std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let outcome = tests("suite", &[("GRANITA_REPORT", &folder.to_string_lossy())]);
    println!("{}", folder.join("index.html").display());
    outcome
}

/// Plays sequences of edits, in tests that are built for release.
pub(crate) fn rerender(sequences: u32, seed: u32) -> Result<(), String> {
    let status = Command::new(cargo())
        .args(["test", "--release", "--package", "granita-tests", "--test", "rerender"])
        .args(["many_random_sequences", "--", "--ignored", "--nocapture"])
        .env("GRANITA_RERENDER_SEQUENCES", sequences.to_string())
        .env("GRANITA_RERENDER_SEED", seed.to_string())
        .status()
        .map_err(|e| format!("cargo: {e}"))?;
    if status.success() {
        Ok(())
    } else {
        Err("a re-rendered frame differs, or a session reported errors".to_owned())
    }
}

/// Runs the bench `trade`, built for release.
pub(crate) fn trade(words: &[String]) -> Result<(), String> {
    let status = Command::new(cargo())
        .args(["run", "--quiet", "--release", "--package", "granita-benches", "--bin", "trade", "--"])
        .args(words)
        .status()
        .map_err(|e| format!("cargo: {e}"))?;
    if status.success() { Ok(()) } else { Err("the bench failed".to_owned()) }
}

fn tests(target: &str, variables: &[(&str, &str)]) -> Result<(), String> {
    let status = Command::new(cargo())
        .args(["test", "--package", "granita-tests", "--test", target, "--", "--nocapture"])
        .envs(variables.iter().copied())
        .status()
        .map_err(|e| format!("cargo: {e}"))?;
    if status.success() { Ok(()) } else { Err(format!("the tests of {target} failed")) }
}
