//! Reports the programs that tests need besides Rust and a C compiler, and skips tests without them.
//!
//! The harness of Rust cannot skip a test while it runs. A test that lacks a program returns, and writes one line to
//! standard error. The line bypasses the harness, which keeps the output of passing tests. `cargo xtask ci` counts
//! these lines. When the variable `GRANITA_NEEDS` names the program, or is `all`, the test fails instead. `.ci/run`
//! sets the variable to the programs that it has installed.

#![forbid(unsafe_code)]

use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

/// The beginning of a line about a skipped test.
pub const SKIPPED: &str = "skipped: ";

/// The variable that names the programs without which tests fail, separated by blanks. `all` stands for every program.
pub const NEEDS: &str = "GRANITA_NEEDS";

/// True when a program of this name is on the search path. Otherwise the test is reported as skipped, and must return.
///
/// # Panics
/// Panics when the program is missing and `GRANITA_NEEDS` names it.
pub fn has(program: &str) -> bool {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let name = format!("{program}{}", std::env::consts::EXE_SUFFIX);
    let found = std::env::split_paths(&path).any(|folder| folder.join(&name).is_file());
    if !found {
        skip(program);
    }
    found
}

/// Reports that the running test, or a part of it, is skipped because `what` is missing. `what` begins with the name in
/// `GRANITA_NEEDS`. Details follow after a blank.
///
/// # Panics
/// Panics when `GRANITA_NEEDS` names `what`.
pub fn skip(what: &str) {
    let package = std::env::var("CARGO_PKG_NAME").unwrap_or_default();
    let thread = std::thread::current();
    let line = line(&package, thread.name().unwrap_or("a test"), what);
    let needed = std::env::var(NEEDS).unwrap_or_default();
    assert!(!is_needed(&needed, what), "{NEEDS} is \"{needed}\": {line}");
    // When standard error cannot be written, the line is lost.
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
/// Another process writes the file, because a file that this process has written cannot always be started. A child that
/// another thread starts at the same time inherits the open file for a moment, and a file that is open for writing
/// cannot be started ("Text file busy").
///
/// # Panics
/// Panics when there is no shell or the file cannot be written.
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

/// Copies a program that a test starts. Another process writes the copy, for the reason of [`write_script`].
///
/// # Panics
/// Panics when the program cannot be copied.
pub fn copy_program(from: &Path, to: &Path) {
    let copied = Command::new("cp").arg(from).arg(to).status();
    assert!(matches!(&copied, Ok(status) if status.success()), "{}: {copied:?}", to.display());
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
mod tests {
    use super::*;

    #[test]
    fn a_skipped_test_prints_one_line() {
        assert_eq!(line("iv", "a_test", "Xvfb\n (a screen)"), "skipped: iv::a_test needs Xvfb (a screen)\n");
        assert!(has("sh") || cfg!(not(unix)));
    }

    /// Many threads write scripts and start them at the same time.
    #[cfg(unix)]
    #[test]
    fn scripts_start_while_other_threads_start_programs() {
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
    fn tests_whose_needs_are_required_are_not_skipped() {
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
