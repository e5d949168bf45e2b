//! `cargo xtask attack`: tests that tools do not run for ever, hang, fill the machine or crash.
//!
//! The parts, in the order in which they run:
//! - `bombs`: small files that cause much work, and scenes at the ends of all ranges, each with its expected result;
//! - `peers`: processes and connections that are silent, stop, or send invalid data, at each place where the tools
//!   listen;
//! - `kills`: tools that are ended at random moments and must not leave a process, an incomplete file or a temporary
//!   file;
//! - `files`: changed files of every kind, read by the tools, in the time that is left.
//!
//! The tools run as separate programs, with a limit of memory (4 GB of address space) and of time. Failing cases are
//! kept in `target/attack/PART/NAME` with a script `command` that reproduces the failure. The same seed makes the same
//! cases.

mod bombs;
mod files;
mod images;
mod kills;
mod kinds;
mod mutate;
mod peers;
mod run;
mod scenes;

use crate::workspace::{Workspace, cargo};
use run::{Bounds, Outcome, Place};
use std::fs;
use std::io;
use std::path::PathBuf;
use std::process::Command;
use std::time::{Duration, Instant};

/// The parts in their order.
const PARTS: [&str; 4] = ["bombs", "peers", "kills", "files"];

/// The tools that are attacked. These are also the names of their packages.
const TOOLS: [&str; 6] = ["gelato", "maketx", "gslc", "gsoinfo", "topyg", "iv"];

/// The options of `cargo xtask attack`.
#[derive(clap::Args, Debug)]
pub(crate) struct Options {
    /// Time for all parts, in minutes.
    #[arg(long, default_value_t = 20.0, value_name = "N")]
    minutes: f64,
    /// The seed of random changes and moments.
    #[arg(long, default_value_t = 1, value_name = "S")]
    seed: u64,
    /// Run only this part (bombs, peers, kills, files), or its cases whose names begin so: bombs/ground.
    #[arg(long, value_name = "PART[/NAME]")]
    only: Vec<String>,
    /// Use the tools of the dev profile instead of release.
    #[arg(long)]
    debug: bool,
    /// Run only the fixed part that `cargo xtask ci` runs.
    #[arg(long, conflicts_with_all = ["minutes", "seed", "only", "debug"])]
    fixed: bool,
}

/// Runs all parts until the time is over.
pub(crate) fn run(options: &Options) -> Result<(), String> {
    if options.fixed {
        return fixed();
    }
    if let Some(wrong) =
        options.only.iter().find(|only| !PARTS.contains(&only.split('/').next().unwrap_or_default()))
    {
        return Err(format!("--only {wrong}: the parts are {}", PARTS.join(", ")));
    }
    if !options.minutes.is_finite() || options.minutes <= 0.0 {
        return Err(format!("--minutes {}: expected a number above 0", options.minutes));
    }
    let attack = Attack::new(options)?;
    attack.all(&Budget { files: None, kills: None, bombs: bombs::Choice::All })
}

/// Runs a fixed number of cases of each part, for `cargo xtask ci`.
pub(crate) fn fixed() -> Result<(), String> {
    let options = Options { minutes: 10.0, seed: 1, only: Vec::new(), debug: true, fixed: true };
    let attack = Attack::new(&options)?;
    attack.all(&Budget { files: Some(6), kills: Some(1), bombs: bombs::Choice::Quick })
}

/// The numbers of cases of the parts; `None` for as many as the time allows.
struct Budget {
    files: Option<u64>,
    kills: Option<u64>,
    bombs: bombs::Choice,
}

/// The common state of all parts.
pub(crate) struct Attack {
    /// The root of the checkout.
    root: PathBuf,
    /// The folder of the tools.
    bins: PathBuf,
    /// The folder of findings.
    finds: PathBuf,
    /// The folder in which cases run.
    scratch: PathBuf,
    seed: u64,
    only: Vec<String>,
    end: Instant,
    /// The number of cases that run at once.
    workers: usize,
    /// The factor by which times of a release build are multiplied.
    patience: f64,
    /// True when `gelato` has the option `-timeout`.
    has_timeout: bool,
}

impl Attack {
    fn new(options: &Options) -> Result<Self, String> {
        let root = Workspace::load()?.root;
        let mut command = Command::new(cargo());
        command.current_dir(&root).args(["build", "--quiet", "--bins"]);
        if options.fixed {
            // The tests of the whole workspace were built before, with these features of dependencies.
            command.args(["--workspace", "--lib", "--tests"]);
        } else {
            TOOLS.iter().for_each(|tool| {
                command.args(["--package", tool]);
            });
        }
        if !options.debug {
            command.arg("--release");
        }
        println!("attack: building the tools");
        let status = command.status().map_err(|e| format!("cargo: {e}"))?;
        if !status.success() {
            return Err("the tools cannot be built".to_owned());
        }
        let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root.join("target"), PathBuf::from);
        let bins = target.join(if options.debug { "debug" } else { "release" });
        let finds = target.join("attack");
        let told = |e: io::Error| format!("{}: {e}", finds.display());
        fs::create_dir_all(&finds).map_err(told)?;
        let scratch = std::env::temp_dir().join(format!("granita-attack-{}", std::process::id()));
        let help =
            Command::new(bins.join("gelato")).arg("-help").output().map_err(|e| format!("gelato: {e}"))?;
        Ok(Self {
            root,
            bins,
            finds,
            scratch,
            seed: options.seed,
            only: options.only.clone(),
            end: Instant::now() + Duration::from_secs_f64(options.minutes * 60.0),
            workers: std::thread::available_parallelism().map_or(1, |n| n.get().min(8)),
            patience: if options.debug { 2.0 } else { 1.0 },
            has_timeout: String::from_utf8_lossy(&help.stdout).contains("-timeout"),
        })
    }

    fn all(&self, budget: &Budget) -> Result<(), String> {
        let mut tallies = Vec::new();
        for part in PARTS.iter().filter(|part| self.has_part(part)) {
            let begin = Instant::now();
            // Findings of an earlier run would look like those of this one.
            let finds = self.finds.join(part);
            if finds.exists() {
                fs::remove_dir_all(&finds).map_err(|e| format!("{}: {e}", finds.display()))?;
            }
            let tally = match *part {
                "bombs" => bombs::run(self, budget.bombs),
                "peers" => peers::run(self),
                "kills" => kills::run(self, budget.kills),
                _ => files::run(self, budget.files),
            }?;
            println!("attack: {}: {:.0} s", tally.line(), begin.elapsed().as_secs_f64());
            tallies.push(tally);
        }
        let _ = fs::remove_dir_all(&self.scratch);
        let failed: usize = tallies.iter().map(|tally| tally.failures.len()).sum();
        println!("attack: seed {}", self.seed);
        tallies.iter().for_each(|tally| println!("attack: {}", tally.line()));
        if failed == 0 { Ok(()) } else { Err(format!("{failed} failed, see {}", self.finds.display())) }
    }

    fn has_part(&self, part: &str) -> bool {
        self.only.is_empty() || self.only.iter().any(|only| only.split('/').next() == Some(part))
    }

    /// True when a case is selected.
    fn is_wanted(&self, part: &str, name: &str) -> bool {
        let wants = |only: &String| match only.split_once('/') {
            Some((wanted, beginning)) => wanted == part && name.starts_with(beginning),
            None => only == part,
        };
        self.only.is_empty() || self.only.iter().any(wants)
    }

    /// True when the time is over.
    fn is_over(&self) -> bool {
        Instant::now() >= self.end
    }

    /// Converts a time for a release build to one for the present build.
    fn seconds(&self, release: f64) -> f64 {
        release * self.patience
    }

    /// Returns the program called `tool`.
    fn program(&self, tool: &str) -> PathBuf {
        self.bins.join(tool)
    }

    /// Calls `work` of a part on as many threads as there are processors, with the number of the thread.
    fn on_all_processors(
        &self,
        part: &str,
        work: impl Fn(usize) -> io::Result<()> + Sync,
    ) -> Result<(), String> {
        std::thread::scope(|scope| {
            let work = &work;
            let workers: Vec<_> = (0..self.workers).map(|n| scope.spawn(move || work(n))).collect();
            workers.into_iter().try_for_each(|worker| match worker.join() {
                Ok(result) => result.map_err(|e| format!("{part}: {e}")),
                Err(_) => Err(format!("{part}: a worker panicked")),
            })
        })
    }

    /// Runs a command line: a tool and its arguments, separated by spaces. "< FILE" at the end gives the standard
    /// input.
    fn run(&self, place: &Place, line: &str, bounds: &Bounds) -> io::Result<Outcome> {
        let (line, input) = match line.split_once(" < ") {
            Some((line, file)) => (line, Some(place.work().join(file))),
            None => (line, None),
        };
        let mut words = line.split_whitespace().map(str::to_owned);
        let tool = words.next().unwrap_or_default();
        let arguments: Vec<String> = words.collect();
        place.run(&self.program(&tool), &arguments, bounds, input.as_deref())
    }

    /// Copies the files of a case with a script that reproduces the failure. Returns the folder.
    fn keep(&self, part: &str, name: &str, place: &Place, lines: &[String]) -> io::Result<PathBuf> {
        let folder = self.finds.join(part).join(name.replace(['/', ' '], "_"));
        fs::create_dir_all(&folder)?;
        for entry in fs::read_dir(place.work())? {
            let entry = entry?;
            // Large files are left out, because `--only` makes them again.
            if entry.metadata().is_ok_and(|m| m.is_file() && m.len() <= 4 << 20) {
                fs::copy(entry.path(), folder.join(entry.file_name()))?;
            }
        }
        let mut script = "#!/bin/sh\nulimit -v 4000000\n".to_owned();
        for line in lines {
            script += &format!("{}/{line}\n", self.bins.display());
        }
        fs::write(folder.join("command"), script)?;
        Ok(folder)
    }
}

/// A failed case.
#[derive(Clone, Debug)]
pub(crate) struct Failure {
    name: String,
    what: String,
    kept: Option<PathBuf>,
}

/// The number of cases of a part, and its failures.
#[derive(Debug)]
pub(crate) struct Tally {
    part: &'static str,
    tried: u64,
    failures: Vec<Failure>,
}

impl Tally {
    fn new(part: &'static str) -> Self {
        Self { part, tried: 0, failures: Vec::new() }
    }

    /// Counts a case, and reports its failure.
    fn add(&mut self, failure: Option<Failure>) {
        self.tried += 1;
        let Some(failure) = failure else { return };
        if let Some(kept) = &failure.kept {
            println!("attack: {}/{}: {} ({})", self.part, failure.name, failure.what, kept.display());
        }
        self.failures.push(failure);
    }

    /// True when the same failure was found before with the same kind of file.
    fn has_kind(&self, kind: &str, what: &str) -> bool {
        let kind = format!("{kind}-");
        self.failures.iter().any(|f| f.name.starts_with(&kind) && alike(&f.what, what))
    }

    fn line(&self) -> String {
        format!("{}: {} tried, {} failed", self.part, self.tried, self.failures.len())
    }
}

/// True when two failures differ only in numbers.
pub(crate) fn alike(a: &str, b: &str) -> bool {
    let letters = |text: &str| text.chars().filter(|c| !c.is_ascii_digit()).collect::<String>();
    letters(a) == letters(b)
}

/// Returns the first line of messages, for a report.
pub(crate) fn first_line(text: &str) -> String {
    text.lines().next().unwrap_or_default().chars().take(200).collect()
}
