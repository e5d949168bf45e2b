//! House rules that can be read off the files.

use crate::workspace::Workspace;
use std::path::Path;

/// Longest file, in lines, unless its first line carries one of [`EXEMPT`].
const MAX_LINES: usize = 1000;
/// First-line markers of tables and of tests.
const EXEMPT: [&str; 2] = ["// tidy: table", "// tidy: tests"];
/// File names that say nothing.
const VAGUE: [&str; 8] =
    ["utils.rs", "util.rs", "common.rs", "manager.rs", "helper.rs", "helpers.rs", "misc.rs", "tools.rs"];
/// Crates that may contain unsafe code.
const UNSAFE_CRATES: [&str; 3] = ["libs/plugin", "libs/gpu", "bindings"];

/// Crates that may have one `simd.rs` with unsafe code, after a measurement kept in `benches/`.
const SIMD_CRATES: [&str; 3] = ["libs/shade", "libs/texture", "libs/trace"];

/// Files elsewhere that may contain unsafe code: there is no other way to map a file.
const UNSAFE_FILES: [&str; 1] = ["libs/sdb/src/map.rs"];

/// All breaches, one line each.
pub(crate) fn check(workspace: &Workspace) -> Result<Vec<String>, String> {
    let mut faults = Vec::new();
    for file in workspace.files()? {
        let Some(text) = workspace.text(&file) else { continue };
        let extension = file.extension().and_then(|e| e.to_str()).unwrap_or_default();
        match extension {
            "rs" => check_source(&file, &text, &mut faults),
            "md" => check_links(workspace, &file, &text, &mut faults),
            "toml" if file.ends_with("Cargo.toml") => check_manifest(&file, &text, &mut faults),
            _ => {}
        }
        check_words(&file, &text, &mut faults);
    }
    for member in &workspace.crates {
        for root in ["src/lib.rs", "src/main.rs"] {
            let path = member.folder.join(root);
            let exempt = UNSAFE_CRATES.iter().any(|c| member.folder.starts_with(c));
            if let Some(text) = workspace.text(&path)
                && !exempt
                && !text.contains("#![forbid(unsafe_code)]")
                && !(SIMD_CRATES
                    .iter()
                    .chain(&UNSAFE_FILES)
                    .any(|c| Path::new(c).starts_with(&member.folder))
                    && text.contains("#![deny(unsafe_code)]"))
            {
                faults.push(format!("{}: no #![forbid(unsafe_code)]", path.display()));
            }
        }
    }
    Ok(faults)
}

fn check_source(file: &Path, text: &str, faults: &mut Vec<String>) {
    let lines = text.lines().count();
    let first = text.lines().next().unwrap_or_default();
    let exempt = EXEMPT.iter().any(|mark| first.starts_with(mark));
    if lines > MAX_LINES && !exempt {
        faults.push(format!("{}: {lines} lines, more than {MAX_LINES}", file.display()));
    }
    let head = text.lines().find(|l| !l.starts_with("// ") && !l.trim().is_empty());
    if !head.is_some_and(|l| l.starts_with("//!")) {
        faults.push(format!("{}: does not begin with what it is for (//!)", file.display()));
    }
    let test = file.components().any(|c| c.as_os_str() == "tests");
    let simd = test || file.ends_with("simd.rs") && SIMD_CRATES.iter().any(|c| file.starts_with(c));
    let own = file.starts_with("xtask");
    if text.contains(concat!("allow(", "unsafe_code"))
        && !own
        && !simd
        && !UNSAFE_FILES.iter().any(|f| file.ends_with(f))
        && !UNSAFE_CRATES.iter().any(|c| file.starts_with(c))
    {
        faults.push(format!("{}: allows unsafe code", file.display()));
    }
    if file.file_name().and_then(|n| n.to_str()).is_some_and(|n| VAGUE.contains(&n)) {
        faults.push(format!("{}: a name that says nothing", file.display()));
    }
    let below_tools =
        file.starts_with("libs") && !file.starts_with("libs/cli") || file.starts_with("formats");
    // Tests sit at the end of a file; what they read is theirs.
    let code = text.split("#[cfg(test)]").next().unwrap_or(text);
    if below_tools && !test && (code.contains("env::var") || code.contains("process::exit")) {
        faults.push(format!("{}: reads the environment or exits below the tools (law 6)", file.display()));
    }
}

/// Versions stand in the root manifest only.
fn check_manifest(file: &Path, text: &str, faults: &mut Vec<String>) {
    if file.components().count() == 1 || file.starts_with("fuzz") {
        return;
    }
    let mut in_dependencies = false;
    for line in text.lines() {
        if let Some(section) = line.strip_prefix('[') {
            in_dependencies = section.contains("dependencies");
        } else if in_dependencies && line.contains('=') && !line.contains("workspace") {
            faults.push(format!("{}: `{line}` does not take its version from the workspace", file.display()));
        }
    }
    if !text.contains("[lints]") {
        faults.push(format!("{}: does not take the workspace's lints", file.display()));
    }
}

/// Relative links of a page lead somewhere.
fn check_links(workspace: &Workspace, file: &Path, text: &str, faults: &mut Vec<String>) {
    let folder = file.parent().unwrap_or(Path::new(""));
    for (number, line) in text.lines().enumerate() {
        for part in line.split("](").skip(1) {
            let target = part.split([')', '#', ' ']).next().unwrap_or_default();
            let outside = target.is_empty() || target.contains("://") || target.starts_with("mailto:");
            if !outside && !workspace.root.join(folder).join(target).exists() {
                faults.push(format!("{}:{}: no {target}", file.display(), number + 1));
            }
        }
    }
}

/// Unfinished work and somebody's machine have no place in a commit.
fn check_words(file: &Path, text: &str, faults: &mut Vec<String>) {
    // Each in two parts, so that this file is none of them.
    const WORDS: [&str; 7] = [
        concat!("TO", "DO"),
        concat!("FIX", "ME"),
        concat!("XX", "X:"),
        concat!("#[ig", "nore]"),
        concat!("/ho", "me/"),
        concat!("/ro", "ot/"),
        concat!("unimpl", "emented!("),
    ];
    for (number, line) in text.lines().enumerate() {
        for word in WORDS {
            if line.contains(word) {
                faults.push(format!("{}:{}: {word}", file.display(), number + 1));
            }
        }
    }
}
