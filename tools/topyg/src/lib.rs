//! `topyg`: converts scenes, and whatever else `Input` takes, to Pyg (reference 3.8).

#![forbid(unsafe_code)]

mod convert;
mod output;

use clap::Parser;
use granita_base::{Environment, Reporter, Severity};
use granita_cli::Status;
use granita_pyg::WriterOptions;
use granita_session::SessionOptions;
use std::ffi::OsString;
use std::io::Write;
use std::path::PathBuf;

/// Converts scene files and generator commands to Pyg.
#[derive(Parser, Debug)]
#[command(name = "topyg", about = "Converts scene files and generator commands to Pyg")]
struct Args {
    /// Write to this file instead of the terminal
    #[arg(short = 'o', value_name = "FILE")]
    output: Option<PathBuf>,
    /// Where to look for generators: folders, separated by colons
    #[arg(short = 'p', value_name = "PATH")]
    path: Option<String>,
    /// How many levels of Input to expand
    #[arg(short = 'r', value_name = "DEPTH", default_value_t = 0)]
    depth: u32,
    /// Tell what is going on
    #[arg(short = 'v')]
    verbose: bool,
    /// Write long arrays as binary data
    #[arg(long)]
    binary: bool,
    /// Write parameters as calls of their own
    #[arg(long)]
    separateparams: bool,
    /// Scene files, or commands as Input takes them ("pyg < program")
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<String>,
}

/// Runs the tool; `words` begins with the name it was called by.
pub fn main(words: Vec<OsString>) -> Status {
    let args: Args = granita_cli::parse(words);
    let environment = granita_cli::environment();
    let reporter = stderr_reporter();
    reporter.set_verbosity(if args.verbose { 2 } else { 1 });
    let job = convert::Job {
        inputs: args.inputs,
        depth: args.depth,
        generators: generator_path(args.path.as_deref(), &environment),
        writer: WriterOptions { binary: args.binary, separate_params: args.separateparams, indent: 0 },
        session: SessionOptions { environment, ..SessionOptions::default() },
    };
    match output::Output::open(args.output.as_deref()) {
        Ok(output) => convert::run(&job, output, &reporter),
        Err(error) => {
            reporter.error(error.to_string());
            Status::Failed
        }
    }
}

/// Everything goes to standard error: standard output may be the scene.
fn stderr_reporter() -> Reporter {
    Reporter::new(Box::new(|message| {
        let mut err = std::io::stderr().lock();
        // Nobody is left to tell when standard error is closed.
        let _ = match message.severity {
            Severity::Message => write!(err, "{}", message.text),
            _ => writeln!(err, "topyg: {message}"),
        };
    }))
}

/// `-p`, then `GELATO_GENERATOR_PATH`, the current folder and `$GELATOHOME/lib`.
fn generator_path(option: Option<&str>, environment: &Environment) -> String {
    let parts = [option, environment.get("GELATO_GENERATOR_PATH"), Some("."), Some("$GELATOHOME/lib")];
    parts.into_iter().flatten().collect::<Vec<_>>().join(":")
}
