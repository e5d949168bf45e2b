//! The common parts of all tools: clap options with one or two dashes, progress, messages, exit codes.
//!
//! Users of the suite write `-envcube`, and common practice today is `--envcube`. [`parse`] accepts both. A word
//! `-name` is read as `--name` when the tool declares a long option of that name, or when no short option begins with
//! its first letter (so that a misspelling gets clap's suggestion).
//!
//! A tool that starts processes or leaves unfinished files ends them through [`Ending`], or with [`before_signals`]
//! alone.
//!
//! The exit codes are 0 (done), 1 (ran with errors) and 2 (could not run); see [`Status`]. A closed pipe is not a
//! failure.

#![forbid(unsafe_code)]

mod args;
mod ending;
mod fence;
mod files;
mod help;
mod plot;
mod progress;
mod run;

pub use args::{
    BUILD_DATE, Given, Refusal, SUITE_VERSION, command, parse, parse_or, parse_with_given, try_parse,
};
pub use ending::{before_signals, leave, wait_for_end, when_caller_is_gone};
pub use fence::{Fence, fence};
pub use files::open_files_limit;
pub use help::help;
pub use plot::ErrorPlot;
pub use progress::{Bar, console_reporter, reporter_with, time_left};
pub use run::{Ending, seconds};

use std::process::ExitCode;

/// The result of a tool.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// The tool ran without errors.
    Done,
    /// The tool ran and left a useful result, but there were errors.
    WithErrors,
    /// The tool could not do what was requested.
    Failed,
    /// A status of another program whose place the tool takes.
    Other(u8),
}

impl Status {
    /// Returns the exit status of the process.
    pub fn code(self) -> u8 {
        match self {
            Self::Done => 0,
            Self::WithErrors => 1,
            Self::Failed => 2,
            Self::Other(code) => code,
        }
    }
}

impl From<Status> for ExitCode {
    fn from(status: Status) -> Self {
        Self::from(status.code())
    }
}

/// Prints the result of a tool to standard output. The tool ends when nothing reads it, successfully after a closed
/// pipe.
#[expect(clippy::exit, reason = "a closed pipe ends the tool, quietly and successfully")]
pub fn print(text: &str) {
    if let Err(error) = written(text) {
        std::process::exit(if error.kind() == std::io::ErrorKind::BrokenPipe { 0 } else { 2 });
    }
}

/// Prints a message of a tool whose result is a file to standard output. Text for a closed pipe is dropped, and the
/// work goes on. Another error ends the tool.
#[expect(clippy::exit, reason = "output that a disk does not take is lost, which must not pass for success")]
pub(crate) fn print_or_drop(text: &str) {
    if written(text).is_err_and(|error| error.kind() != std::io::ErrorKind::BrokenPipe) {
        std::process::exit(2);
    }
}

fn written(text: &str) -> std::io::Result<()> {
    use std::io::Write;
    let mut out = std::io::stdout().lock();
    out.write_all(text.as_bytes()).and_then(|()| out.flush())
}

/// Returns the process's environment, for the libraries that take it as a value.
pub fn environment() -> granita_base::Environment {
    std::env::vars_os().collect()
}
