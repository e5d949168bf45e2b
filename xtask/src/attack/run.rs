//! Runs a tool within limits of time, memory and open files, and reports how it ended.

use std::fs::{self, File};
use std::io::{self, Read};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// The limits of a run.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds {
    /// The seconds of processor time on each of [`THREADS`] threads. By the clock a run may take [`WAITING`] times as
    /// long.
    pub(crate) seconds: f64,
    /// The address space, in KiB.
    pub(crate) memory_kib: u64,
    /// The number of open files; `None` leaves the system's limit.
    pub(crate) files: Option<u32>,
}

impl Bounds {
    /// Returns the limit of the processor time of all threads together, in seconds.
    pub(crate) fn processor_seconds(&self) -> f64 {
        self.seconds * THREADS
    }
}

/// The address space of most runs, in KiB (4 GB).
pub(crate) const MEMORY_KIB: u64 = 4_000_000;

/// The number of threads of the tools.
const THREADS: f64 = 2.0;

/// The factor from processor time to clock time. The clock detects endless waits. The factor prevents failures that
/// other work on the machine would cause.
pub(crate) const WAITING: f64 = 4.0;

/// The signal that ends a process after its processor time.
const SIGXCPU: i32 = 24;

/// The largest allowed size of all messages of a run, in bytes.
const FLOOD_BYTES: u64 = 4 << 20;

/// The way in which a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ending {
    /// The process ended by itself, with this status.
    Code(i32),
    /// The process was ended by this signal.
    Signal(i32),
    /// The process was killed after its limit of clock time.
    TimeOut,
    /// The system ended the process after its limit of processor time.
    Busy,
}

/// The result of a run.
#[derive(Debug)]
pub(crate) struct Outcome {
    pub(crate) ending: Ending,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
    /// The number of bytes of standard error. `stderr` may hold only the beginning.
    pub(crate) stderr_bytes: u64,
    /// The largest resident memory that was seen, in KiB, without child processes.
    pub(crate) peak_kib: u64,
    pub(crate) wall: Duration,
}

impl Outcome {
    /// Returns the error when it does not depend on the command.
    pub(crate) fn fault(&self) -> Option<String> {
        let first = |mark: &str| {
            let line = self.stderr.lines().find(|line| line.contains(mark))?;
            Some(line.chars().take(160).collect::<String>())
        };
        let marks = ["panicked at", "has overflowed its stack", "memory allocation of", "internal error"];
        let said = marks.iter().find_map(|mark| first(mark)).unwrap_or_default();
        match self.ending {
            Ending::TimeOut => Some(format!("ran past {:.0} s", self.wall.as_secs_f64())),
            Ending::Busy => Some("used up its processor time".to_owned()),
            Ending::Signal(signal) => Some(format!("killed by signal {signal}: {said}")),
            Ending::Code(code) if !(0..=2).contains(&code) => Some(format!("exit status {code}: {said}")),
            Ending::Code(_) if !said.is_empty() => Some(said),
            Ending::Code(_) if self.stderr_bytes > FLOOD_BYTES => {
                Some(format!("{} MiB of messages", self.stderr_bytes >> 20))
            }
            Ending::Code(_) => None,
        }
    }

    /// Returns the exit status, if there is one.
    pub(crate) fn code(&self) -> Option<i32> {
        match self.ending {
            Ending::Code(code) => Some(code),
            _ => None,
        }
    }
}

/// A folder for runs. `work` is their current folder, and `tmp` their folder for temporary files.
#[derive(Debug)]
pub(crate) struct Place {
    root: PathBuf,
}

impl Place {
    /// Returns an empty folder.
    pub(crate) fn new(root: PathBuf) -> io::Result<Self> {
        let place = Self { root };
        place.clear()?;
        Ok(place)
    }

    /// Removes all files.
    pub(crate) fn clear(&self) -> io::Result<()> {
        if self.root.exists() {
            fs::remove_dir_all(&self.root)?;
        }
        ["work", "tmp", "home"].iter().try_for_each(|name| fs::create_dir_all(self.root.join(name)))
    }

    /// Returns the current folder of runs.
    pub(crate) fn work(&self) -> PathBuf {
        self.root.join("work")
    }

    /// Returns the names of temporary files that were left: hidden ones and unfinished ones in the current folder, and
    /// all files in the folder for temporary files.
    pub(crate) fn leftovers(&self) -> Vec<String> {
        let names = |folder: &str| {
            let entries = fs::read_dir(self.root.join(folder)).into_iter().flatten().flatten();
            entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect::<Vec<_>>()
        };
        let unfinished = |name: &String| name.starts_with('.') || name.ends_with(".part");
        let mut left: Vec<String> = names("work").into_iter().filter(unfinished).collect();
        left.extend(names("tmp").into_iter().map(|name| format!("$TMPDIR/{name}")));
        left.sort();
        left
    }

    /// Starts a program here. `input` is its standard input, and `marker` identifies its processes in the system.
    pub(crate) fn start(
        &self,
        program: &Path,
        words: &[String],
        bounds: &Bounds,
        input: Stdio,
        marker: Option<&str>,
    ) -> io::Result<Started> {
        // The limits hold for the program and its child processes. `exec` keeps the process number.
        let files = bounds.files.map_or(String::new(), |n| format!("ulimit -n {n}; "));
        let (memory, seconds) = (bounds.memory_kib, bounds.processor_seconds().ceil());
        // Only the soft limit is set, so that the signal gives the reason.
        let script = format!("ulimit -c 0; ulimit -v {memory}; ulimit -S -t {seconds}; {files}exec \"$@\"");
        let (out, err) = (self.root.join("out"), self.root.join("err"));
        let mut command = Command::new("sh");
        command
            .args(["-c", &script, "sh"])
            .arg(program)
            .args(words)
            .current_dir(self.work())
            .env_remove("GELATOHOME")
            .env("HOME", self.root.join("home"))
            .env("TMPDIR", self.root.join("tmp"))
            .env("RUST_BACKTRACE", "0")
            .stdin(input)
            .stdout(File::create(&out)?)
            .stderr(File::create(&err)?)
            .process_group(0);
        if let Some(marker) = marker {
            command.env(MARKER, marker);
        }
        let begin = Instant::now();
        Ok(Started { child: command.spawn()?, begin, out, err, peak_kib: 0 })
    }

    /// Starts a program, waits for its end, and kills it after its time. `input` is the file of its standard input.
    pub(crate) fn run(
        &self,
        program: &Path,
        words: &[String],
        bounds: &Bounds,
        input: Option<&Path>,
    ) -> io::Result<Outcome> {
        let input = match input {
            Some(file) => File::open(file)?.into(),
            None => Stdio::null(),
        };
        self.start(program, words, bounds, input, None)?
            .wait(Duration::from_secs_f64(bounds.seconds * WAITING))
    }
}

/// The environment variable that marks the processes of a run.
pub(crate) const MARKER: &str = "GRANITA_ATTACK";

/// A running program in its own process group.
pub(crate) struct Started {
    pub(crate) child: Child,
    begin: Instant,
    out: PathBuf,
    err: PathBuf,
    peak_kib: u64,
}

impl Started {
    /// Sends a signal ("TERM", "INT", ...) to the process alone.
    pub(crate) fn signal(&self, name: &str) {
        kill(name, &self.child.id().to_string());
    }

    /// True when the process has ended.
    pub(crate) fn is_over(&mut self) -> bool {
        !matches!(self.child.try_wait(), Ok(None))
    }

    /// Returns the standard output so far.
    pub(crate) fn printed(&self) -> String {
        beginning(&self.out)
    }

    /// Waits for the end. After `longest` the process group is killed.
    pub(crate) fn wait(mut self, longest: Duration) -> io::Result<Outcome> {
        let mut pause = Duration::from_micros(500);
        let ending = loop {
            if let Some(status) = self.child.try_wait()? {
                break match (status.code(), status.signal()) {
                    (Some(code), _) => Ending::Code(code),
                    (None, Some(SIGXCPU)) => Ending::Busy,
                    (None, signal) => Ending::Signal(signal.unwrap_or(0)),
                };
            }
            self.peak_kib = self.peak_kib.max(peak_kib(self.child.id()));
            if self.begin.elapsed() > longest {
                kill("KILL", &format!("-{}", self.child.id()));
                self.child.wait()?;
                break Ending::TimeOut;
            }
            std::thread::sleep(pause);
            pause = (pause * 2).min(Duration::from_millis(8));
        };
        Ok(Outcome {
            ending,
            stdout: beginning(&self.out),
            stderr: beginning(&self.err),
            stderr_bytes: fs::metadata(&self.err).map_or(0, |m| m.len()),
            peak_kib: self.peak_kib,
            wall: self.begin.elapsed(),
        })
    }
}

/// Sends a signal to a process, or to its group when `whom` begins with a minus sign.
fn kill(signal: &str, whom: &str) {
    // The process may have ended.
    let _ = Command::new("kill").args([&format!("-{signal}"), "--", whom]).stderr(Stdio::null()).status();
}

/// Returns the first quarter MiB of a file.
fn beginning(path: &Path) -> String {
    let mut bytes = Vec::new();
    let read = File::open(path).and_then(|file| file.take(1 << 18).read_to_end(&mut bytes));
    if read.is_ok() { String::from_utf8_lossy(&bytes).into_owned() } else { String::new() }
}

/// Returns the largest resident memory of a process so far, in KiB; 0 when it has ended.
fn peak_kib(process: u32) -> u64 {
    let status = fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.and_then(|line| line.trim().trim_end_matches(" kB").parse().ok()).unwrap_or(0)
}

/// Returns the running processes with this marker, and their names. Processes that have ended but were not waited for
/// are left out.
pub(crate) fn marked(marker: &str) -> Vec<(u32, String)> {
    let wanted = format!("{MARKER}={marker}");
    let mut found = Vec::new();
    for entry in fs::read_dir("/proc").into_iter().flatten().flatten() {
        let Some(process) = entry.file_name().to_str().and_then(|name| name.parse().ok()) else { continue };
        let variables = fs::read(entry.path().join("environ")).unwrap_or_default();
        if !variables.split(|b| *b == 0).any(|variable| variable == wanted.as_bytes()) {
            continue;
        }
        let stat = fs::read_to_string(entry.path().join("stat")).unwrap_or_default();
        let (name, rest) = stat.rsplit_once(')').unwrap_or_default();
        let name = name.split_once('(').map_or("", |(_, name)| name);
        if !matches!(rest.trim_start().chars().next(), None | Some('Z' | 'X')) {
            found.push((process, name.to_owned()));
        }
    }
    found.sort_unstable();
    found
}

/// Ends processes that this one has started.
pub(crate) fn end(processes: &[(u32, String)]) {
    for (process, _) in processes {
        kill("KILL", &process.to_string());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_limited_by_processor_time_and_by_the_clock() {
        let root = std::env::temp_dir().join(format!("granita-attack-run-{}", std::process::id()));
        let place = Place::new(root.clone()).unwrap();
        let run = |script: &str, seconds: f64| {
            let bounds = Bounds { seconds, memory_kib: MEMORY_KIB, files: None };
            place.run(Path::new("sh"), &["-c".to_owned(), script.to_owned()], &bounds, None).unwrap().ending
        };
        assert_eq!(run("while :; do :; done", 0.5), Ending::Busy);
        assert_eq!(run("exec sleep 60", 0.02), Ending::TimeOut);
        assert_eq!(run("exit 2", 1.0), Ending::Code(2));
        fs::remove_dir_all(root).unwrap();
    }
}
