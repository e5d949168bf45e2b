//! Runs of this program that it starts itself, with options that are passed on.

use granita_base::Supervisor;
use granita_cli::Given;
use std::path::PathBuf;
use std::process::{Command, ExitStatus, Stdio};

/// Returns the options that were given, without those of `own`.
pub(crate) fn passed_on<'a>(given: &'a [Given], own: &'a [&str]) -> impl Iterator<Item = &'a Given> {
    given.iter().filter(|given| !own.contains(&&*given.id))
}

/// This program.
pub(crate) struct Again<'a> {
    program: PathBuf,
    supervisor: &'a Supervisor,
}

impl<'a> Again<'a> {
    /// # Errors
    /// Returns a message when the program cannot be found.
    pub(crate) fn new(supervisor: &'a Supervisor) -> Result<Self, String> {
        let program = std::env::current_exe().map_err(|e| format!("this program cannot be found: {e}"))?;
        Ok(Self { program, supervisor })
    }

    /// Returns a command without options, which reads no input.
    pub(crate) fn command(&self) -> Command {
        let mut command = Command::new(&self.program);
        // Whatever program this is, as for "granita gelato".
        command.args(["-as", "gelato"]).stdin(Stdio::null());
        command
    }

    /// Runs a command until it ends. `what` says for messages what it does.
    ///
    /// # Errors
    /// Returns the reason why it did not run.
    pub(crate) fn run(&self, mut command: Command, what: &str) -> Result<ExitStatus, String> {
        let ended = self.supervisor.spawn(&mut command, what).and_then(|mut process| process.wait());
        ended.map_err(|error| error.to_string())
    }
}
