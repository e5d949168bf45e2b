//! What a test needs besides Rust and a C compiler, and what becomes of the test without it.
//!
//! The harness of Rust has no test that is skipped while it runs. A test that lacks a program returns, and one line on
//! standard error says so. The line is written past the harness, which keeps what a passing test prints. `cargo xtask
//! ci` counts these lines. Where the variable `GRANITA_NEEDS` names the program, or is `all`, the test fails instead.
//! `.ci/run` sets the variable to what it has installed.
//!
//! ```
//! use granita_needs::has;
//! if !has("sh") {
//!     return;
//! }
//! ```

#![forbid(unsafe_code)]

use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

/// What a line about a skipped test begins with.
pub const SKIPPED: &str = "skipped: ";

/// The variable that names, with blanks between, what tests must not lack; `all` is everything.
pub const NEEDS: &str = "GRANITA_NEEDS";

/// Returns true when a program of this name lies on the search path. Otherwise the test is reported as skipped, and has
/// to return.
///
/// # Panics
/// When the program is missing and `GRANITA_NEEDS` names it.
pub fn has(program: &str) -> bool {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let name = format!("{program}{}", std::env::consts::EXE_SUFFIX);
    let found = std::env::split_paths(&path).any(|folder| folder.join(&name).is_file());
    if !found {
        skip(program);
    }
    found
}

/// Reports that the test which runs is skipped, or a part of it, because `what` is missing. `what` begins with the name
/// by which `GRANITA_NEEDS` knows it; details follow after a blank.
///
/// # Panics
/// When `GRANITA_NEEDS` names `what`.
pub fn skip(what: &str) {
    let package = std::env::var("CARGO_PKG_NAME").unwrap_or_default();
    let thread = std::thread::current();
    let line = line(&package, thread.name().unwrap_or("a test"), what);
    let needed = std::env::var(NEEDS).unwrap_or_default();
    assert!(!is_needed(&needed, what), "{NEEDS} is \"{needed}\": {line}");
    // Without a standard error there is nowhere to report to.
    let _ = std::io::stderr().lock().write_all(line.as_bytes());
}

fn line(package: &str, test: &str, what: &str) -> String {
    format!("{SKIPPED}{package}::{test} needs {}\n", what.split_whitespace().collect::<Vec<_>>().join(" "))
}

fn is_needed(needed: &str, what: &str) -> bool {
    let name = what.split_whitespace().next();
    needed.split_whitespace().any(|word| word == "all" || Some(word) == name)
}

/// Writes a shell script that can be started at once. `text` follows the line that names the shell.
///
/// Another process writes the file. A file that this process writes must not be started: a child that another thread
/// starts at that time holds the open file for a moment, and a file that is open for writing is not started ("Text file
/// busy").
///
/// # Panics
/// When there is no shell or the file cannot be written.
pub fn write_script(path: &Path, text: &str) {
    let written = || {
        let mut shell = Command::new("sh")
            .args(["-c", "cat > \"$0\" && chmod 755 \"$0\""])
            .arg(path)
            .stdin(Stdio::piped())
            .spawn()?;
        if let Some(mut input) = shell.stdin.take() {
            write!(input, "#!/bin/sh\n{text}\n")?;
        }
        shell.wait()
    };
    let written = written();
    assert!(matches!(&written, Ok(status) if status.success()), "{}: {written:?}", path.display());
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_is_said_in_one_line() {
        assert_eq!(line("iv", "a_test", "Xvfb\n (a screen)"), "skipped: iv::a_test needs Xvfb (a screen)\n");
        assert!(has("sh") || cfg!(not(unix)));
    }

    /// Many threads write scripts and start them.
    #[cfg(unix)]
    #[test]
    fn scripts_start_whatever_other_threads_start() {
        let folder = std::env::temp_dir().join(format!("granita needs {}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let folder = &folder;
        std::thread::scope(|scope| {
            for thread in 0..8 {
                scope.spawn(move || {
                    for run in 0..20 {
                        let script = folder.join(format!("script {thread}"));
                        write_script(&script, &format!("exit {run}"));
                        let ended = Command::new(&script).status().unwrap();
                        assert_eq!(ended.code(), Some(run));
                    }
                });
            }
        });
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn what_is_needed_is_not_skipped() {
        for (needed, what, expected) in [
            ("", "python3", false),
            ("all", "python3", true),
            ("Xvfb python3", "python3", true),
            ("Xvfb python3", "python", false),
            ("Xvfb", "Xvfb (no driver can draw)", true),
        ] {
            assert_eq!(is_needed(needed, what), expected, "{needed} {what}");
        }
    }
}
