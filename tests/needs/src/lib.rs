//! What a test needs besides Rust and a C compiler, and what becomes of the test without it.
//!
//! The harness of Rust has no test that is skipped while it runs. A test that lacks a program returns, and one line on standard
//! error says so. The line is written past the harness, which keeps what a passing test prints. `cargo xtask ci` counts these
//! lines. Where the variable `GRANITA_NEEDS` names the program, or is `all`, the test fails instead. `.ci/run` sets the
//! variable to what it has installed.
//!
//! ```
//! use granita_needs::has;
//! if !has("sh") {
//!     return;
//! }
//! ```

#![forbid(unsafe_code)]

use std::io::Write;

/// What a line about a skipped test begins with.
pub const SKIPPED: &str = "skipped: ";

/// The variable that names, with blanks between, what tests must not lack; `all` is everything.
pub const NEEDS: &str = "GRANITA_NEEDS";

/// Returns true when a program of this name lies on the search path. Otherwise the test is reported as skipped, and has to return.
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

/// Reports that the test which runs is skipped, or a part of it, because `what` is missing. `what` begins with the name by which
/// `GRANITA_NEEDS` knows it; details follow after a blank.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_is_said_in_one_line() {
        assert_eq!(line("iv", "a_test", "Xvfb\n (a screen)"), "skipped: iv::a_test needs Xvfb (a screen)\n");
        assert!(has("sh") || cfg!(not(unix)));
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
