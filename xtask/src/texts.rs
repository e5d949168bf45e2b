//! Checks the house rules that can be read from the text of files.

use crate::rules::Rules;
use crate::source::{Kind, Source};
use crate::workspace::Workspace;
use std::path::Path;

/// The first lines of tables and of tests, which may have any length.
const ANY_LENGTH: [&str; 2] = ["// tidy: table", "// tidy: tests"];
/// The beginning of a first line that gives the reason for a long file.
const LONG: &str = "// tidy: long: ";
/// File names without a meaning.
const VAGUE: [&str; 8] =
    ["utils.rs", "util.rs", "common.rs", "manager.rs", "helper.rs", "helpers.rs", "misc.rs", "tools.rs"];

/// Returns all breaches, one line each.
pub(crate) fn check(workspace: &Workspace, sources: &[Source], rules: &Rules) -> Result<Vec<String>, String> {
    let mut faults = Vec::new();
    for file in workspace.files()? {
        let Some(text) = workspace.text(&file) else { continue };
        let extension = file.extension().and_then(|e| e.to_str()).unwrap_or_default();
        match extension {
            "md" => check_links(workspace, &file, &text, &mut faults),
            "toml" if file.ends_with("Cargo.toml") => check_manifest(&file, &text, &mut faults),
            _ => {}
        }
        check_words(&file, &text, &mut faults);
    }
    for source in sources {
        check_source(source, rules, &mut faults);
    }
    for member in &workspace.crates {
        for root in ["src/lib.rs", "src/main.rs"] {
            let path = member.folder.join(root);
            let Some(text) = workspace.text(&path).filter(|_| !rules.allows_unsafe(&member.folder)) else {
                continue;
            };
            let has_place = rules.unsafe_places.iter().any(|place| place.starts_with(&member.folder));
            let wanted = if has_place { "#![deny(unsafe_code)]" } else { "#![forbid(unsafe_code)]" };
            if !text.contains(wanted) && !text.contains("#![forbid(unsafe_code)]") {
                faults.push(format!("{}: no {wanted}", path.display()));
            }
        }
    }
    let median = median(sources);
    let [least, most] = rules.median;
    if !(least..=most).contains(&median) {
        faults
            .push(format!("half of the files have {median} lines or fewer, and {least} to {most} are good"));
    }
    Ok(faults)
}

/// Returns the median of the lines of all files.
pub(crate) fn median(sources: &[Source]) -> usize {
    let mut lines: Vec<usize> = sources.iter().map(|source| source.text.lines().count()).collect();
    lines.sort_unstable();
    lines.get(lines.len() / 2).copied().unwrap_or(0)
}

/// Returns the error in the length of a file, or in its first line about the length.
fn check_length(text: &str, rules: &Rules) -> Option<String> {
    let lines = text.lines().count();
    let first = text.lines().next().unwrap_or_default();
    // A mark in another form, or in another place, would have no effect.
    let is_mark = |line: &str| {
        let comment = line.trim_start().trim_start_matches(['/', '!']).trim_start();
        line.trim_start().starts_with("//")
            && ["table", "tests", "long"].iter().any(|kind| {
                comment
                    .strip_prefix("tidy: ")
                    .is_some_and(|rest| rest.split([':', ' ']).next() == Some(*kind))
            })
    };
    if let Some(at) = text.lines().skip(1).position(is_mark) {
        return Some(format!("{}: a mark of tidy that is not the first line", at + 2));
    }
    if ANY_LENGTH.contains(&first) {
        return None;
    }
    let has_reason = match first.strip_prefix(LONG) {
        Some(reason) if reason.split_whitespace().count() < 4 => {
            return Some(format!("1: `{first}` gives no reason"));
        }
        Some(_) if lines <= rules.lines_without_reason => {
            return Some(format!("1: {lines} lines need no reason"));
        }
        Some(_) => true,
        None if is_mark(first) => return Some(format!("1: `{first}` is no mark of tidy")),
        None => false,
    };
    if lines > rules.lines {
        Some(format!("{lines} lines, more than {}", rules.lines))
    } else if lines > rules.lines_without_reason && !has_reason {
        let most = rules.lines_without_reason;
        Some(format!("{lines} lines, more than {most}, and no reason (`{LONG}REASON` as the first line)"))
    } else {
        None
    }
}

fn check_source(source: &Source, rules: &Rules, faults: &mut Vec<String>) {
    let Source { file, text, .. } = source;
    faults.extend(check_length(text, rules).map(|what| format!("{}:{what}", file.display())));
    let head = text.lines().find(|l| !l.starts_with("// ") && !l.trim().is_empty());
    if !head.is_some_and(|l| l.starts_with("//!")) {
        faults.push(format!("{}: does not begin with what it is for (//!)", file.display()));
    }
    let allows = source.all.windows(3).any(|part| {
        part[1].kind == Kind::Sign('(')
            && [&part[0].kind, &part[2].kind]
                .into_iter()
                .zip(["allow", "unsafe_code"])
                .all(|(kind, word)| matches!(kind, Kind::Word(own) if own == word))
    });
    if allows && !source.is_test && !rules.allows_unsafe(file) {
        faults.push(format!("{}: allows unsafe code", file.display()));
    }
    if file.file_name().and_then(|n| n.to_str()).is_some_and(|n| VAGUE.contains(&n)) {
        faults.push(format!("{}: a name that says nothing", file.display()));
    }
}

/// Checks that versions are written in the root manifest only.
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

/// Checks that the targets of the relative links of a page exist.
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

/// Checks that a file does not contain unfinished work or paths of one machine.
fn check_words(file: &Path, text: &str, faults: &mut Vec<String>) {
    // Each word is split in two, so that this file does not contain it.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_files_without_a_reason_are_reported() {
        let rules = Rules {
            lines: 10,
            lines_without_reason: 6,
            median: [1, 9],
            comment_width: 120,
            unsafe_places: Vec::new(),
        };
        let problem = |first: &str, lines: usize| {
            let text = format!("{first}\n{}", "x\n".repeat(lines - 1));
            check_length(&text, &rules).unwrap_or_default()
        };
        assert_eq!(problem("//! X.", 6), "");
        assert!(problem("//! X.", 7).contains("no reason"));
        assert_eq!(problem("// tidy: long: a list of what there is", 7), "");
        assert!(problem("// tidy: long: big", 7).contains("gives no reason"));
        assert!(problem("// tidy: long: a list of what there is", 6).contains("need no reason"));
        assert!(problem("// tidy: long: a list of what there is", 11).contains("more than 10"));
        assert_eq!(problem("// tidy: table", 11), "");
        assert!(problem("//! tidy: table", 11).contains("no mark"));
        assert!(problem("// tidy: tests and more", 3).contains("no mark"));
        assert!(
            problem("//! X.\n// tidy: table", 3).contains("2: a mark of tidy that is not the first line")
        );
        // The reason why another check does not apply is not such a mark.
        assert_eq!(problem("//! X.\n// tidy: attribute: x", 3), "");
    }

    #[test]
    fn the_median_is_the_middle_length() {
        let file = |lines: usize| Source::new("src/a.rs".into(), "\n".repeat(lines)).unwrap();
        assert_eq!(median(&[file(500), file(100), file(200)]), 200);
        assert_eq!(median(&[]), 0);
    }
}
