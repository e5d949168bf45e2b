//! The commands for programs that a scene runs.

use crate::RunOptions;
use granita_base::Supervisor;
use granita_base::process::Process;
use std::io::{self, Read};
use std::process::{ChildStdout, Command, Stdio};

/// Returns the command that runs a line in the default shell.
pub fn shell(line: &str, options: &RunOptions) -> Command {
    let mut command = if cfg!(windows) {
        let mut command = Command::new("cmd");
        command.arg("/C").arg(line);
        command
    } else {
        let mut command = Command::new("/bin/sh");
        command.arg("-c").arg(format!("{}{line}", shell_functions(options)));
        command
    };
    prepare(&mut command, options);
    command
}

/// Returns shell functions with the names of the suite's own tools, which also work in pipelines and lists.
fn shell_functions(options: &RunOptions) -> String {
    let Some(own) = &options.own_tools else { return String::new() };
    let program = format!("'{}'", own.program.to_string_lossy().replace('\'', "'\\''"));
    own.names.iter().map(|name| format!("{name}() {{ {program} --as {name} \"$@\"; }}\n")).collect()
}

/// Returns the command for a program by name. It is one of the suite's own tools, or a program of `PATH`.
/// [`prepare`] must follow its arguments.
pub fn program(name: &str, options: &RunOptions) -> Command {
    match &options.own_tools {
        Some(own) if own.names.iter().any(|n| n == name) => {
            let mut command = Command::new(&own.program);
            command.args(["--as", name]);
            command
        }
        _ => Command::new(name),
    }
}

/// Sets the variables, the standard input and the standard output of a program that a scene runs.
pub fn prepare(command: &mut Command, options: &RunOptions) {
    command.envs(options.program_environment.iter().map(|(k, v)| (k, v)));
    // Standard input may be the scene. A program that is not in the foreground of a terminal is stopped when it
    // reads there.
    command.stdin(Stdio::null());
    if options.programs_print_to_stderr {
        command.stdout(std::io::stderr());
    }
}

/// The output of a program, read while it runs. Dropping it ends the program.
pub(crate) struct Output {
    child: Process,
    out: ChildStdout,
    line: String,
}

impl Output {
    /// Starts a command, whose line is `line`.
    pub(crate) fn start(mut command: Command, line: String, supervisor: &Supervisor) -> io::Result<Self> {
        command.stdin(Stdio::null()).stdout(Stdio::piped());
        let mut child = supervisor.spawn(&mut command, format!("running \"{line}\""))?;
        let out = child.take_stdout().ok_or_else(|| io::Error::other("no pipe"))?;
        Ok(Self { child, out, line })
    }
}

impl Read for Output {
    fn read(&mut self, buf: &mut [u8]) -> io::Result<usize> {
        let n = self.out.read(buf)?;
        if n == 0 && !buf.is_empty() {
            let status = self.child.wait()?;
            if !status.success() {
                return Err(io::Error::other(format!("the program \"{}\" failed: {status}", self.line)));
            }
        }
        Ok(n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::OwnTools;

    #[test]
    fn the_names_of_our_own_tools_mean_our_own_program() {
        let own = OwnTools { program: "/bin/echo".into(), names: vec!["maketx".to_owned()] };
        let options = RunOptions { own_tools: Some(own), ..RunOptions::default() };
        let arguments: Vec<_> = program("maketx", &options).get_args().map(|a| a.to_owned()).collect();
        assert_eq!(arguments, ["--as", "maketx"]);
        assert_eq!(program("true", &options).get_program(), "true");
    }
}
