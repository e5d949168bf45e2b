//! `imgtool` converts, resizes, combines and compares images.
//!
//! The words of the command line become steps (`parse`), which work on a stack of images from left to right
//! (`stack`, `machine`). The images are those of [`granita_edit`]: rows are computed when a file is written, so that
//! images larger than the memory pass.

#![forbid(unsafe_code)]

mod colors;
mod files;
mod frames;
mod machine;
mod parse;
mod pixels;
mod print;
mod shapes;
mod stack;
mod table;

use granita_base::{Files, Reporter};
use granita_cli::{Bar, Status, before_signals, console_reporter, environment, fence};
use granita_edit::Verdict;
use granita_image::Limits;
use granita_plugin::PluginRules;
use parse::{Given, Refusal, Step, Table};
use stack::{Done, Fault, Machine, Settings};
use std::ffi::OsString;
use std::io::Write;
use std::path::{Path, PathBuf};
use table::Action;

/// The status of a comparison whose images differ in size, as of `idiff`.
const DIFFERENT_SIZE: Status = Status::Other(3);
/// The status of a comparison that was not possible, as of `idiff`.
const NOT_COMPARED: Status = Status::Other(4);

/// Returns the table of the options.
pub fn command() -> clap::Command {
    granita_cli::command::<Table>()
}

/// The options that apply to the whole command line.
#[derive(Debug, Default)]
struct Run {
    settings: Settings,
    threads: Option<usize>,
    frames: Option<String>,
    skip_bad_frames: bool,
    plugins: Vec<PathBuf>,
    safe: bool,
    nofence: bool,
    quiet: bool,
    /// True when the exit codes are those of `idiff`.
    compares: bool,
}

/// Returns the memory of the machine, in bytes; `None` where the system does not report it.
fn installed_bytes() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

impl Run {
    /// Reads the options of a command line that apply to all of it.
    fn of(steps: &[Step]) -> Done<Self> {
        let mut run = Self::default();
        run.settings.memory_bytes = installed_bytes().map_or(4 << 30, |bytes| bytes / 4);
        for step in steps {
            if let Step::Option(given) = step {
                run.set(given).map_err(|what| format!("{}: {what}", given.typed))?;
            }
        }
        Ok(run)
    }

    fn set(&mut self, given: &Given) -> Result<(), String> {
        let at_least_1 = |n: u64, what: &str| if n == 0 { Err(format!("0 {what}")) } else { Ok(n) };
        match given.row.action {
            Action::Frames => self.frames = Some(given.values[0].clone()),
            Action::SkipBadFrames => self.skip_bad_frames = true,
            Action::DryRun => self.settings.dry_run = true,
            Action::Update => self.settings.update = true,
            Action::NoClobber => self.settings.no_clobber = true,
            Action::CreateFolder => self.settings.create_folder = true,
            Action::Memory => {
                self.settings.memory_bytes = at_least_1(given.value(0)?, "MiB")?.saturating_mul(1 << 20);
            }
            Action::Threads => match given.value(0)? {
                n @ 1..=1024 => self.threads = Some(n),
                _ => return Err("1 to 1024 threads are possible".to_owned()),
            },
            Action::ColorConfig => self.settings.colorconfig = Some(given.values[0].clone()),
            Action::Plugins => self.plugins.push(PathBuf::from(&given.values[0])),
            Action::Safe => self.safe = true,
            Action::NoFence => self.nofence = true,
            Action::Verbose => self.settings.verbose = true,
            Action::Quiet => self.quiet = true,
            Action::Difference => self.compares = true,
            _ => {}
        }
        Ok(())
    }

    /// Returns the status after an error.
    fn failed(&self, fault: &Fault, outputs: usize) -> Status {
        match (self.compares, fault.is_size, outputs) {
            (true, true, _) => DIFFERENT_SIZE,
            (true, false, _) => NOT_COMPARED,
            (false, _, 0) => Status::Failed,
            (false, ..) => Status::WithErrors,
        }
    }
}

/// Returns the names of the files that a command line reads and writes.
fn named(steps: &[Step]) -> (Vec<PathBuf>, Vec<PathBuf>) {
    let (mut inputs, mut outputs) = (Vec::new(), Vec::new());
    for step in steps {
        match step {
            Step::Image(name) => {
                inputs.push(PathBuf::from(
                    granita_image::split_image_name(name).map_or(&**name, |(file, _)| file),
                ));
            }
            Step::Option(given) if given.row.action == Action::Input => {
                inputs.push(PathBuf::from(&given.values[0]))
            }
            Step::Option(given)
                if matches!(given.row.action, Action::ColorConfig | Action::FileTransform)
                    && !given.values[0].starts_with("ocio://") =>
            {
                inputs.push(PathBuf::from(&given.values[0]));
            }
            Step::Option(given) if given.row.action == Action::Output => {
                outputs.push(PathBuf::from(&given.values[0]))
            }
            Step::Option(_) => {}
        }
    }
    (inputs, outputs)
}

/// Carries out a command line.
fn run(steps: &[Step], run: &Run, reporter: &Reporter) -> Status {
    let failed = |fault: Fault, outputs: usize| {
        let status = run.failed(&fault, outputs);
        reporter.error(fault.what);
        status
    };
    let runs = match frames::runs(steps, run.frames.as_deref()) {
        Ok(runs) => runs,
        Err(fault) => return failed(fault, 0),
    };
    let all: Vec<Vec<Step>> = (0..runs.count).map(|i| runs.steps(i, steps)).collect();
    let files = match run.safe {
        true => {
            let inputs: Vec<PathBuf> = all.iter().flat_map(|steps| named(steps).0).collect();
            Files::reading(inputs.iter().map(PathBuf::as_path))
        }
        false => Files::default(),
    };
    let rules = PluginRules { none: run.safe, named: run.plugins.clone(), ..PluginRules::default() };
    let formats = granita_plugin::formats_with_plugins(
        Limits { files: files.clone(), ..Limits::default() },
        &environment(),
        reporter,
        rules.clone(),
        false,
    );
    if run.safe {
        all.iter().flat_map(|steps| named(steps).1).for_each(|path| files.grant_output(&path));
        if !run.nofence
            && let Err(what) = fence(&files)
        {
            return failed(format!("-safe: {what}").into(), 0);
        }
    }
    let mut settings = run.settings.clone();
    settings.environment = environment();
    settings.environment.set_files(files.clone());
    settings.rules = rules;
    let carry_out = || {
        let (mut status, mut outputs, mut verdict, mut printed) = (Status::Done, 0, None, false);
        for steps in &all {
            let mut machine = Machine::new(&formats, reporter, &settings);
            let done = machine::run(&mut machine, steps);
            outputs += machine.outputs;
            printed |= machine.printed;
            verdict = verdict.max(machine.verdict);
            if let Err(fault) = done {
                status = failed(fault, outputs);
                if !run.skip_bad_frames {
                    return status;
                }
            }
        }
        if outputs == 0 && !printed && status == Status::Done {
            reporter
                .warning("nothing is written or printed: -o FILE writes an image, -info and -stats print");
        }
        match verdict {
            Some(Verdict::Failure) if status == Status::Done => Status::Other(2),
            Some(Verdict::Warning) if status == Status::Done => Status::Other(1),
            _ => status,
        }
    };
    match run.threads {
        Some(threads) => match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
            Ok(pool) => pool.install(carry_out),
            Err(error) => failed(format!("cannot start {threads} threads: {error}").into(), 0),
        },
        None => carry_out(),
    }
}

/// Prints an error of the command line.
fn refused(what: &str) -> Status {
    // Without a standard error the status still counts.
    let _ = writeln!(std::io::stderr().lock(), "imgtool: error: {what}");
    Status::Failed
}

/// Runs the tool. `words` begins with the name by which it was called.
pub fn main(words: Vec<OsString>) -> Status {
    if words.len() < 2 {
        granita_cli::print(&format!("{}\n\nAll options: imgtool -help\n", command().render_usage()));
        return Status::Done;
    }
    let steps = match parse::steps(&words) {
        Ok(steps) => steps,
        Err(Refusal::Wrong(what)) => return refused(&what),
        Err(Refusal::Word(word)) => {
            // The parser of all tools prints the help, or a suggestion.
            let name = words.first().map(Path::new).and_then(Path::file_name).unwrap_or_default().to_owned();
            let Table = granita_cli::parse::<Table>(vec![name, word.clone()]);
            return refused(&format!("there is no option {}", word.display()));
        }
    };
    let options = match Run::of(&steps) {
        Ok(options) => options,
        Err(fault) => return refused(&fault.what),
    };
    let bar = Bar::new(false);
    let reporter = console_reporter("imgtool", &bar);
    reporter.set_verbosity(if options.quiet {
        0
    } else if options.settings.verbose {
        2
    } else {
        1
    });
    if let Err(error) = before_signals(|| ()) {
        reporter.warning(format!("signals cannot be handled: {error}"));
    }
    run(&steps, &options, &reporter)
}

#[cfg(test)]
mod tests;
