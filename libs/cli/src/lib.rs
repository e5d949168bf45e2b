//! One way to declare a tool: clap options in one or two dashes, progress, messages, exit codes.
//!
//! The suite's users write `-envcube`; today's users write `--envcube`. [`parse`] takes both: a word
//! `-name` is read as `--name` when the tool declares a long option of that name, or when no short
//! option begins with its first letter (so that a misspelling gets clap's suggestion).
//!
//! A tool that starts processes or leaves unfinished files ends them through [`Ending`], or [`before_signals`] alone.
//!
//! Exit codes: 0 done, 1 ran with errors, 2 could not run ([`Status`]). A closed pipe is no failure.

#![forbid(unsafe_code)]

mod args;
mod ending;
mod fence;
mod files;
mod progress;
mod run;

pub use args::parse;
pub use ending::{before_signals, leave, wait_for_end, when_caller_is_gone};
pub use fence::{Fence, fence};
pub use files::open_files_limit;
pub use progress::{Bar, console_reporter, reporter_with, time_left};
pub use run::{Ending, seconds};

use std::process::ExitCode;

/// How a tool ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// All well.
    Done,
    /// It ran and left something useful, but there were errors.
    WithErrors,
    /// It could not do what was asked.
    Failed,
}

impl Status {
    /// The exit status of the process.
    pub fn code(self) -> u8 {
        match self {
            Self::Done => 0,
            Self::WithErrors => 1,
            Self::Failed => 2,
        }
    }
}

impl From<Status> for ExitCode {
    fn from(status: Status) -> Self {
        Self::from(status.code())
    }
}

/// Prints to standard output; a reader that went away is no failure.
#[expect(clippy::exit, reason = "a closed pipe ends the tool, quietly and successfully")]
pub fn print(text: &str) {
    use std::io::Write;
    let mut out = std::io::stdout().lock();
    if let Err(error) = out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        let code = if error.kind() == std::io::ErrorKind::BrokenPipe { 0 } else { 2 };
        std::process::exit(code);
    }
}

/// The process's environment, for the libraries that take it as a value.
pub fn environment() -> granita_base::Environment {
    std::env::vars_os().collect()
}
