//! `topyg` converts scenes, and everything else that `Input` accepts, to Pyg (reference 3.8).

#![forbid(unsafe_code)]

mod convert;
mod output;

use clap::Parser;
use granita_base::files::is_same_file;
use granita_base::{Environment, Files, Reporter, Severity, Supervisor};
use granita_cli::{Bar, Ending, Status};
use granita_inputs::RunOptions;
use granita_pyg::WriterOptions;
use std::ffi::OsString;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Converts scene files and generator commands to Pyg.
#[derive(Parser, Debug)]
#[command(name = "topyg", about = "Converts scene files and generator commands to Pyg", after_help = AFTER_HELP)]
struct Args {
    /// Write to this file instead of the terminal
    #[arg(short = 'o', value_name = "FILE")]
    output: Option<PathBuf>,
    /// Search path of generators: folders, separated by colons
    #[arg(short = 'p', value_name = "PATH")]
    path: Option<String>,
    /// The number of levels of Input to expand
    #[arg(short = 'r', value_name = "DEPTH", default_value_t = 0)]
    depth: u32,
    /// Print progress
    #[arg(short = 'v')]
    verbose: bool,
    /// Write long arrays as binary data
    #[arg(long)]
    binary: bool,
    /// Write parameters as separate calls
    #[arg(long)]
    separateparams: bool,
    /// End the run after this number of seconds, with all programs that it started, and exit with status 1
    #[arg(long, value_name = "SECONDS", value_parser = granita_cli::seconds)]
    timeout: Option<f64>,
    /// A folder of plugins, or a library, which is used before bundled ones; may be repeated
    #[arg(long, value_name = "PATH")]
    plugins: Vec<PathBuf>,
    /// For untrusted scenes: run no scripts, programs and plugins, read below the scene's folder only
    #[arg(long)]
    safe: bool,
    /// Do not have the kernel enforce -safe as well
    #[arg(long, hide = true, requires = "safe")]
    nofence: bool,
    /// Scene files, or commands as Input takes them ("pyg < program"); "-" reads Pyg from standard input
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<String>,
}

const AFTER_HELP: &str = "\
Without -safe, scenes run: scripts in Python, the programs of Input (\"pyg < program\"), and plugins along -p.";

/// Returns the table of the options.
pub fn command() -> clap::Command {
    granita_cli::command::<Args>()
}

/// Runs the tool. `words` begins with the name by which it was called.
pub fn main(words: Vec<OsString>) -> Status {
    let args: Args = granita_cli::parse(words);
    let mut environment = granita_cli::environment();
    let files = match args.safe {
        true => Files::reading(args.inputs.iter().map(Path::new)),
        false => Files::default(),
    };
    environment.set_files(files.clone());
    let ending = Ending::new(Bar::new(false));
    let reporter = stderr_reporter(ending.supervisor().clone());
    reporter.set_verbosity(if args.verbose { 2 } else { 1 });
    if let Some(files) = temporary_files(&environment, &reporter) {
        environment.set_files(files);
    }
    ending.watch(false, &reporter);
    if let Some(seconds) = args.timeout {
        ending.limit(seconds, &reporter);
    }
    let job = convert::Job {
        inputs: args.inputs,
        depth: args.depth,
        generators: generator_path(args.path.as_deref(), &environment),
        writer: WriterOptions { binary: args.binary, separate_params: args.separateparams, indent: 0 },
        run: RunOptions {
            environment,
            supervisor: ending.supervisor().clone(),
            safe: args.safe,
            plugins: args.plugins,
            ..RunOptions::default()
        },
    };
    if args.safe && !args.nofence {
        // The user named the output file.
        let fenced = files.clone();
        args.output.iter().for_each(|output| fenced.grant_output(output));
        if let Err(what) = granita_cli::fence(&fenced) {
            reporter.error(format!("-safe: {what}"));
            return Status::Failed;
        }
    }
    let source = job
        .inputs
        .iter()
        .find(|input| args.output.as_deref().is_some_and(|output| is_same_file(Path::new(input), output)));
    if let Some(source) = source {
        reporter.error(format!("{source} is read, and is not overwritten"));
        return Status::Failed;
    }
    let status = match output::Output::open(args.output.as_deref(), job.run.environment.files()) {
        Ok(output) => convert::run(&job, output, &reporter),
        Err(error) => {
            reporter.error(error.to_string());
            Status::Failed
        }
    };
    if ending.is_late() {
        return Status::WithErrors;
    }
    if ending.supervisor().has_ended() {
        granita_cli::wait_for_end();
    }
    ending.supervisor().release();
    status
}

/// Returns a reporter that prints everything on standard error, because standard output may be the scene. After the
/// processes of the run were ended, the resulting messages are not shown.
fn stderr_reporter(supervisor: Supervisor) -> Reporter {
    Reporter::new(Box::new(move |message| {
        if supervisor.has_ended() {
            return;
        }
        let mut err = std::io::stderr().lock();
        // When standard error is closed, the failure cannot be reported.
        let _ = match message.severity {
            Severity::Message => write!(err, "{}", message.text),
            _ => writeln!(err, "topyg: {message}"),
        };
    }))
}

/// Returns the files of a run with temporary ones in `$GELATOTEMP`; `None` without such a folder.
fn temporary_files(environment: &Environment, reporter: &Reporter) -> Option<Files> {
    let folder = environment.get("GELATOTEMP").filter(|folder| !folder.is_empty())?;
    if !Path::new(folder).is_dir() {
        reporter.warning(format!(
            "GELATOTEMP: \"{folder}\" is no folder; temporary files lie in the folder of the system"
        ));
        return None;
    }
    Some(environment.files().clone().with_temporary(Path::new(folder)))
}

/// Returns the search path of generators. It consists of `-p`, `GELATO_GENERATOR_PATH`, the current folder and
/// `$GELATOHOME/lib`.
fn generator_path(option: Option<&str>, environment: &Environment) -> String {
    let parts = [option, environment.get("GELATO_GENERATOR_PATH"), Some("."), Some("$GELATOHOME/lib")];
    parts.into_iter().flatten().collect::<Vec<_>>().join(":")
}
