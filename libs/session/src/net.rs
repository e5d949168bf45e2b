//! The protocol between a coordinator and its workers, which render one frame with several processes (reference 6.6.3).
//!
//! A worker is this program with `-worker`, started by the coordinator, on this machine or through `ssh`, for the
//! same scene files. It reads them as the coordinator does, but runs no commands and writes no images. Both count
//! the commands and frames that they reach, and the worker is never ahead. It waits at a command until the
//! coordinator has run it, and at a frame until buckets of it are requested.
//!
//! The coordinator sends lines:
//! - `commands N`: this number of commands of the scene is done.
//! - `frame N`: the frames before this one are over.
//! - `bucket F I`: render bucket I of frame F. Frames are counted from 0.
//!
//! The worker first sends a line with [`GREETING`] and its number of threads. Its answers are binary and little-endian.
//! An answer with pixels consists of the bucket, the frame, the number of its images, and for each image the number of
//! its values and the values. An answer without pixels consists of the bucket, the frame, [`NO_IMAGES`], the length of
//! a text and the text. All counts have 32 bits.
//!
//! As long as a worker has buckets to render, a separate thread sends [`ALIVE`] twice a second. This distinguishes
//! a slow worker from a stopped one. When nothing arrives for the seconds of "net:timeout", the worker is ended,
//! and others render its buckets. A thread writes to each worker, so that one that does not read blocks no other.
//! Answers for a stopped frame are ignored.

mod worker;

pub(crate) use worker::WorkerCoordinator;

use crate::SessionOptions;
use crate::patient::{Patience, Patient};
use granita_base::process::Process;
use granita_base::{Reporter, Severity};
use granita_render::{BucketPixels, Buckets, Workers};
use parking_lot::Mutex;
use std::io::{self, Read, Write};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::time::Duration;

/// The first line of a worker, which contains the version of the suite and of this protocol.
const GREETING: &str = concat!("granita-worker ", env!("CARGO_PKG_VERSION"), "/2");

/// Sent in place of a bucket to show that the worker is running.
const ALIVE: u32 = u32::MAX;

/// Sent in place of a number of images when there are none.
const NO_IMAGES: u32 = u32::MAX;

/// The largest number of values of a bucket.
const MOST_VALUES: u32 = 1 << 28;

/// The largest number of images of a frame.
const MOST_IMAGES: u32 = 1 << 16;

/// The time in which a worker without output must end.
const ENDING: Duration = Duration::from_secs(1);

/// The workers of a coordinator.
pub(crate) struct Net {
    options: Arc<SessionOptions>,
    reporter: Reporter,
    state: Mutex<Progress>,
    patience: Patience,
    /// True when frames are rendered without workers.
    alone: AtomicBool,
    /// The workers, started with the first frame; `None` for a lost worker.
    workers: Mutex<Vec<Arc<Mutex<Option<Worker>>>>>,
}

/// The progress of the coordinator.
#[derive(Default)]
struct Progress {
    commands: usize,
    frame: usize,
}

struct Worker {
    name: String,
    /// Its process, which is ended when this is dropped.
    process: Process,
    /// The lines to send to it.
    to: Sender<String>,
    from: Patient,
    /// The number of its threads; 0 before its greeting.
    threads: usize,
}

impl Net {
    pub(crate) fn new(options: Arc<SessionOptions>, reporter: Reporter) -> Self {
        Self {
            options,
            reporter,
            state: Mutex::default(),
            patience: Patience::new(0.0),
            alone: AtomicBool::new(false),
            workers: Mutex::default(),
        }
    }

    /// Starts workers on machines, unless they are running already. `command` is the command line of `gelato` on
    /// them, and `patience` the longest silence in seconds. Returns false when there are none.
    pub(crate) fn start(&self, servers: &[&str], command: &str, patience: f32) -> bool {
        let Some(arguments) = &self.options.net_arguments else {
            refuse(&self.reporter, "the scene is no file that workers could read");
            return false;
        };
        self.patience.set(patience);
        let mut workers = self.workers.lock();
        if workers.is_empty() {
            let progress = self.state.lock();
            for server in servers {
                match Worker::start(server, command, arguments, &self.options, &self.patience) {
                    Ok(worker) => {
                        // A worker that has ended is reported when it is needed.
                        let _ = worker
                            .say(&format!("commands {}\nframe {}\n", progress.commands, progress.frame));
                        workers.push(Arc::new(Mutex::new(Some(worker))));
                    }
                    Err(error) => self
                        .reporter
                        .warning(format!("-net: no worker on {server}: {error}; the others do its part")),
                }
            }
        }
        workers.iter().any(|worker| worker.lock().is_some())
    }

    /// Sets whether the cameras of the next frame are rendered without workers. Workers have no databases of
    /// earlier frames except those in files.
    pub(crate) fn set_alone(&self, alone: bool) {
        if alone {
            refuse(&self.reporter, "workers do not have the spatial databases that earlier frames saved");
        }
        self.alone.store(alone, Ordering::Relaxed);
    }

    /// Counts a command of the scene that was run.
    pub(crate) fn command_done(&self) {
        let mut state = self.state.lock();
        state.commands += 1;
        let line = format!("commands {}\n", state.commands);
        drop(state);
        self.tell(&line);
    }

    fn tell(&self, line: &str) {
        for worker in self.workers.lock().iter() {
            // A worker that has ended is reported when it is needed.
            let _ = worker.lock().as_ref().map(|worker| worker.say(line));
        }
    }
}

impl Workers for Net {
    fn begin(&self) -> usize {
        if self.alone.load(Ordering::Relaxed) { 0 } else { self.workers.lock().len() }
    }

    fn work(&self, worker: usize, buckets: &dyn Buckets) -> Result<(), String> {
        let Some(slot) = self.workers.lock().get(worker).cloned() else { return Ok(()) };
        let mut slot = slot.lock();
        let Some(worker) = slot.as_mut() else { return Ok(()) };
        let frame = self.state.lock().frame;
        let result = worker.work(frame, buckets);
        let name = worker.name.clone();
        if result.is_err() {
            *slot = None;
        }
        result.map_err(|what| format!("-net: the worker on {name} is gone: {what}; the others do its part"))
    }

    fn end(&self) {
        let mut state = self.state.lock();
        state.frame += 1;
        let line = format!("frame {}\n", state.frame);
        drop(state);
        self.tell(&line);
    }
}

impl Worker {
    fn start(
        server: &str,
        command: &str,
        arguments: &[String],
        options: &SessionOptions,
        patience: &Patience,
    ) -> io::Result<Self> {
        let mut start = start_command(server, command, arguments, options)?;
        let mut process = options.supervisor.spawn(&mut start, format!("rendering with {server}"))?;
        let (Some(mut to), Some(from)) = (process.take_stdin(), process.take_stdout()) else {
            return Err(io::Error::other("it has no streams"));
        };
        let (sender, lines) = channel::<String>();
        std::thread::Builder::new().name("net".to_owned()).spawn(move || {
            // The thread ends with the worker, or with its process.
            while let Ok(line) = lines.recv()
                && to.write_all(line.as_bytes()).and_then(|()| to.flush()).is_ok()
            {}
        })?;
        let from = Patient::new(from, patience.clone())?;
        Ok(Self { name: server.to_owned(), process, to: sender, from, threads: 0 })
    }

    fn say(&self, line: &str) -> Result<(), String> {
        self.to.send(line.to_owned()).map_err(|_| "it does not listen".to_owned())
    }

    /// Reads the greeting once. Returns false when there is no more work for it.
    fn greet(&mut self, buckets: &dyn Buckets) -> Result<bool, String> {
        if self.threads > 0 {
            return Ok(true);
        }
        if !self.from.wait(&|| buckets.is_over()).map_err(|e| e.to_string())? {
            return Ok(false);
        }
        let mut line = Vec::new();
        let mut byte = [0];
        while line.len() < 200
            && line.last() != Some(&b'\n')
            && self.from.read(&mut byte).map_err(|e| e.to_string())? > 0
        {
            line.extend(byte);
        }
        let line = String::from_utf8_lossy(&line);
        let threads = line.strip_prefix(GREETING).and_then(|rest| rest.trim().parse().ok());
        match threads {
            Some(threads @ 1..=4096) => self.threads = threads,
            _ if line.is_empty() => {
                let how = self
                    .process
                    .wait_for_end(ENDING)
                    .map_or_else(|e| e.to_string(), |status| status.to_string());
                return Err(format!("it did not start ({how})"));
            }
            _ => return Err(format!("it is \"{}\", and this is \"{GREETING}\"", line.trim())),
        }
        Ok(true)
    }

    fn work(&mut self, frame: usize, buckets: &dyn Buckets) -> Result<(), String> {
        if !self.greet(buckets)? {
            return Ok(());
        }
        let mut waiting = 0;
        loop {
            // Two buckets per thread are sent, so that no thread waits for the connection.
            while waiting < 2 * self.threads {
                let Some(index) = buckets.take(waiting == 0) else { break };
                self.say(&format!("bucket {frame} {index}\n"))?;
                waiting += 1;
            }
            if waiting == 0 || !self.from.wait(&|| buckets.is_over()).map_err(|e| e.to_string())? {
                return Ok(());
            }
            match self.answer().map_err(|e| e.to_string())? {
                Some((index, of, pixels)) if of == frame => {
                    buckets.put(index, pixels)?;
                    waiting -= 1;
                }
                // This is a sign of life, or an answer for a stopped frame.
                _ => {}
            }
        }
    }

    /// Returns a bucket, its frame and its pixels; `None` for a sign of life.
    fn answer(&mut self) -> io::Result<Option<Answer>> {
        let index = number(&mut self.from)?;
        if index == ALIVE {
            return Ok(None);
        }
        let (frame, images) = (number(&mut self.from)? as usize, number(&mut self.from)?);
        let mut read = |size: u64| {
            let mut bytes = Vec::new();
            if (&mut self.from).take(size).read_to_end(&mut bytes)? as u64 != size {
                return Err(io::Error::from(io::ErrorKind::UnexpectedEof));
            }
            Ok(bytes)
        };
        let count = |bytes: &[u8]| bytes.try_into().map_or(u32::MAX, u32::from_le_bytes);
        let too_much = |n: u32, what: &str, most: u32| match n < most {
            true => Ok(n),
            false => {
                Err(io::Error::other(format!("its answer has {n} {what}, and there are less than {most}")))
            }
        };
        if images == NO_IMAGES {
            let size = too_much(count(&read(4)?), "bytes of text", 1 << 16)?;
            let text = String::from_utf8_lossy(&read(size.into())?).into_owned();
            return Ok(Some((index as usize, frame, Err(text))));
        }
        let mut pixels = Vec::new();
        for _ in 0..too_much(images, "images", MOST_IMAGES)? {
            let size = too_much(count(&read(4)?), "values", MOST_VALUES)?;
            let bytes = read(u64::from(size) * 4)?;
            pixels.push(bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect());
        }
        Ok(Some((index as usize, frame, Ok(pixels))))
    }
}

/// Returns the command that starts the worker on a machine.
fn start_command(
    server: &str,
    command: &str,
    arguments: &[String],
    options: &SessionOptions,
) -> io::Result<Command> {
    let mut start = match (server, &options.own_tools) {
        ("local" | "localhost", Some(own)) if command.is_empty() => {
            let mut start = Command::new(&own.program);
            start.arg("-worker").args(arguments);
            start
        }
        _ => {
            let command = if command.is_empty() { "gelato" } else { command };
            let words = arguments.iter().map(|word| quoted(word)).collect::<Vec<_>>().join(" ");
            let folder = &options.current_folder;
            if folder.as_os_str().is_empty() {
                return Err(io::Error::other("the folder of this run is not known"));
            }
            let line = format!("cd {} && {command} -worker {words}", quoted(&folder.to_string_lossy()));
            let mut start = if matches!(server, "local" | "localhost") {
                let mut start = Command::new("/bin/sh");
                start.arg("-c");
                start
            } else {
                let mut start = Command::new("ssh");
                start.args(["-o", "BatchMode=yes", "-o", "ServerAliveInterval=15", "--", server]);
                start
            };
            start.arg(line);
            start
        }
    };
    start.envs(options.program_environment.iter().map(|(k, v)| (k, v)));
    start.stdin(Stdio::piped()).stdout(Stdio::piped());
    Ok(start)
}

/// A bucket, its frame, and its pixels or the reason why there are none.
type Answer = (usize, usize, Result<BucketPixels, String>);

fn number(from: &mut impl Read) -> io::Result<u32> {
    let mut bytes = [0; 4];
    from.read_exact(&mut bytes)?;
    Ok(u32::from_le_bytes(bytes))
}

/// Returns a word for a shell.
fn quoted(word: &str) -> String {
    format!("'{}'", word.replace('\'', "'\\''"))
}

/// Reports that a frame cannot be rendered by workers.
pub(crate) fn refuse(reporter: &Reporter, why: &str) {
    let text = format!("-net: {why}: this machine renders alone");
    reporter.once("net refused", Severity::Warning, &granita_base::Location::default(), text);
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    #[test]
    fn workers_elsewhere_start_in_the_folder_that_the_options_name() {
        let words = |server: &str, folder: &str| {
            let options =
                SessionOptions { current_folder: PathBuf::from(folder), ..SessionOptions::default() };
            let start = start_command(server, "", &["a b.pyg".to_owned()], &options)?;
            Ok(start.get_args().last().unwrap_or_default().to_string_lossy().into_owned())
        };
        let line = |server, folder| words(server, folder).map_err(|e: io::Error| e.to_string());
        for server in ["alpha", "local"] {
            let expected = "cd '/scenes/it'\\''s' && gelato -worker 'a b.pyg'";
            assert_eq!(line(server, "/scenes/it's").as_deref(), Ok(expected));
            assert_eq!(line(server, "").unwrap_err(), "the folder of this run is not known");
        }
    }
}
