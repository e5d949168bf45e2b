//! Finds, parses and runs the cases of the suite.

use crate::check::{Kept, check};
use crate::{Ran, Tools};
use std::path::{Path, PathBuf};

/// A case of the suite, which is a folder.
#[derive(Clone, Debug)]
pub struct Case {
    /// The name, `AREA/NAME`.
    pub name: String,
    /// The folder of its files.
    pub folder: PathBuf,
    /// The lines of the file `case`.
    pub lines: Vec<Line>,
}

/// A line of a `case` file.
#[derive(Clone, Debug)]
pub struct Line {
    /// The number of the line, counted from 1.
    pub number: usize,
    /// The words. A part in double quotes is one word.
    pub words: Vec<String>,
}

/// The result of a case.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The name, `AREA/NAME`.
    pub name: String,
    /// The errors, with line numbers; empty on success.
    pub faults: Vec<String>,
    /// The reference images and results for the report, each as title, reference and result.
    pub images: Vec<(String, PathBuf, PathBuf)>,
}

/// Returns all cases under `suite`, sorted by name.
///
/// # Errors
/// Returns an error when a folder cannot be read or a line cannot be parsed.
pub fn cases(suite: &Path) -> Result<Vec<Case>, String> {
    let mut found = Vec::new();
    for area in folders(suite)? {
        for folder in folders(&area)? {
            let text = std::fs::read_to_string(folder.join("case"))
                .map_err(|e| format!("{}: {e}", folder.join("case").display()))?;
            let name = folder.strip_prefix(suite).unwrap_or(&folder).to_string_lossy().replace('\\', "/");
            let mut lines = Vec::new();
            for (index, line) in text.lines().enumerate() {
                let words = words(line).map_err(|e| format!("{name}: line {}: {e}", index + 1))?;
                if !words.is_empty() {
                    lines.push(Line { number: index + 1, words });
                }
            }
            if lines.is_empty() {
                return Err(format!("{name}: the case asserts nothing"));
            }
            let mut kept: Vec<_> =
                lines.iter().filter(|l| l.words[0] == "text").map(|l| l.words.last()).collect();
            kept.sort();
            if kept.windows(2).any(|pair| pair[0] == pair[1]) {
                return Err(format!("{name}: two texts under one name; give them labels"));
            }
            found.push(Case { name, folder, lines });
        }
    }
    Ok(found)
}

fn folders(parent: &Path) -> Result<Vec<PathBuf>, String> {
    let entries = std::fs::read_dir(parent).map_err(|e| format!("{}: {e}", parent.display()))?;
    let mut found: Vec<PathBuf> =
        entries.filter_map(|e| Some(e.ok()?.path())).filter(|p| p.is_dir()).collect();
    found.sort();
    Ok(found)
}

fn words(line: &str) -> Result<Vec<String>, String> {
    let mut words = Vec::new();
    let mut rest = line.trim_start();
    while !rest.is_empty() && !rest.starts_with('#') {
        let (word, after) = match rest.strip_prefix('"') {
            Some(quoted) => quoted.split_once('"').ok_or("a quote is not closed")?,
            None => rest.split_at(rest.find(char::is_whitespace).unwrap_or(rest.len())),
        };
        words.push(word.to_owned());
        rest = after.trim_start();
    }
    Ok(words)
}

/// Runs a case in a fresh copy of its folder under `scratch`.
///
/// With `bless`, its references are replaced by the current results.
pub fn run(case: &Case, tools: &Tools, reference: &Path, scratch: &Path, bless: bool) -> Outcome {
    let mut outcome = Outcome { name: case.name.clone(), faults: Vec::new(), images: Vec::new() };
    let place = scratch.join(case.name.replace('/', "-"));
    if let Err(e) = copy_folder(&case.folder, &place) {
        outcome.faults.push(e);
        return outcome;
    }
    let kept = Kept { stem: reference.join(&case.name), bless };
    let mut last = Ran { status: 0, stdout: String::new(), stderr: String::new() };
    for line in &case.lines {
        let words: Vec<&str> = line.words.iter().map(String::as_str).collect();
        let done = match words.as_slice() {
            ["exits", status, tool, arguments @ ..] if Tools::NAMES.contains(tool) => {
                run_tool(tools, &place, tool, arguments, status, &mut last)
            }
            [tool, arguments @ ..] if Tools::NAMES.contains(tool) => {
                run_tool(tools, &place, tool, arguments, "0", &mut last)
            }
            _ => check(&words, &place, &last, &kept, &mut outcome.images),
        };
        if let Err(what) = done {
            outcome.faults.push(format!("line {}: {}: {what}", line.number, line.words.join(" ")));
            // The rest of the case needs the files that are missing now, and would only repeat the error.
            if Tools::NAMES.contains(&words[0]) || words[0] == "exits" {
                break;
            }
        }
    }
    outcome
}

fn run_tool(
    tools: &Tools,
    place: &Path,
    tool: &str,
    arguments: &[&str],
    status: &str,
    last: &mut Ran,
) -> Result<(), String> {
    *last = tools.run(place, tool, arguments)?;
    let panicked = last.stderr.contains("panicked at");
    if last.status.to_string() == status && !panicked {
        return Ok(());
    }
    Err(format!("exit status {} instead of {status}\n{}{}", last.status, last.stdout, last.stderr))
}

fn copy_folder(from: &Path, to: &Path) -> Result<(), String> {
    let told = |e: std::io::Error| format!("{}: {e}", to.display());
    std::fs::create_dir_all(to).map_err(told)?;
    for entry in std::fs::read_dir(from).map_err(told)? {
        let path = entry.map_err(told)?.path();
        let target = to.join(path.file_name().unwrap_or_default());
        if path.is_dir() {
            copy_folder(&path, &target)?;
        } else {
            std::fs::copy(&path, &target).map_err(told)?;
        }
    }
    Ok(())
}
