//! One frame by several processes (reference 6.6.3): how a coordinator talks with its workers.
//!
//! A worker is this program with `-worker`, started by the coordinator, here or through `ssh`, for the same scene files.
//! It reads them as the coordinator does, but runs no commands and writes no images. Both count the commands and
//! frames that they come to, and the worker is never ahead: it waits at a command until the coordinator has run it, and
//! at a frame until it is asked for buckets of it.
//!
//! What the coordinator says are lines:
//! - `commands N`: so many commands of the scene are done;
//! - `frame N`: the frames before this one are over;
//! - `bucket F I`: render bucket I of frame F. Frames are counted from 0.
//!
//! The worker greets with [`GREETING`] and its threads, a line; its answers are binary, little-endian: the bucket, the frame and the
//! number of its images, and for each image the number of its values and these; or the bucket, the frame, [`NO_IMAGES`], the length
//! of a text and the text. All counts have 32 bits.
//!
//! As long as a worker has buckets to render, it sends [`ALIVE`] from a thread of its own, twice a second. So a worker that takes long is told from one
//! that is stopped: when nothing comes for the seconds of "net:timeout", the worker is ended, and others do its part. Writing to a
//! worker is left to a thread, so that one that does not read holds nobody up. What is the answer to a frame that was stopped is
//! passed over.

mod worker;

pub(crate) use worker::Master;

use crate::SessionOptions;
use crate::patient::{Patience, Patient};
use granita_base::process::Process;
use granita_base::{Reporter, Severity};
use granita_render::{BucketPixels, Buckets, Workers};
use std::io::{self, Read, Write};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// What a worker of this version says first: the version of the suite, and that of this protocol.
const GREETING: &str = concat!("granita-worker ", env!("CARGO_PKG_VERSION"), "/2");

/// Stands for a bucket: the worker lives.
const ALIVE: u32 = u32::MAX;

/// Stands for a number of images when there are none.
const NO_IMAGES: u32 = u32::MAX;

/// More values than any bucket has.
const MOST_VALUES: u32 = 1 << 28;

/// More images than any frame has.
const MOST_IMAGES: u32 = 1 << 16;

/// How long a worker without output may take to end.
const ENDING: Duration = Duration::from_secs(1);

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The workers of a coordinator.
pub(crate) struct Net {
    options: Arc<SessionOptions>,
    reporter: Reporter,
    state: Mutex<Progress>,
    patience: Patience,
    /// Frames are rendered without workers.
    alone: AtomicBool,
    /// Started with the first frame; `None` once a worker is of no more use.
    workers: Mutex<Vec<Arc<Mutex<Option<Worker>>>>>,
}

/// How far the coordinator is.
#[derive(Default)]
struct Progress {
    commands: usize,
    frame: usize,
}

struct Worker {
    name: String,
    /// Dropped, it is ended.
    process: Process,
    /// Lines for it.
    to: Sender<String>,
    from: Patient,
    /// Threads that it has; 0 until it has greeted.
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

    /// Starts workers on machines, unless they are there already; `command` is how `gelato` is called on them, and `patience` the
    /// longest silence in seconds. False when there are none.
    pub(crate) fn start(&self, servers: &[&str], command: &str, patience: f32) -> bool {
        let Some(arguments) = &self.options.net_arguments else {
            refuse(&self.reporter, "the scene is no file that workers could read");
            return false;
        };
        self.patience.set(patience);
        let mut workers = lock(&self.workers);
        if workers.is_empty() {
            let progress = lock(&self.state);
            for server in servers {
                match Worker::start(server, command, arguments, &self.options, &self.patience) {
                    Ok(worker) => {
                        // One that is gone already is told of when it is needed.
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
        workers.iter().any(|worker| lock(worker).is_some())
    }

    /// Whether the cameras of the next frame are rendered without workers: these have no databases of earlier frames but
    /// those in files.
    pub(crate) fn set_alone(&self, alone: bool) {
        if alone {
            refuse(&self.reporter, "workers do not have the spatial databases that earlier frames saved");
        }
        self.alone.store(alone, Ordering::Relaxed);
    }

    /// The scene's next command was run.
    pub(crate) fn command_done(&self) {
        let mut state = lock(&self.state);
        state.commands += 1;
        let line = format!("commands {}\n", state.commands);
        drop(state);
        self.tell(&line);
    }

    fn tell(&self, line: &str) {
        for worker in lock(&self.workers).iter() {
            // One that is gone is told of when it is needed.
            let _ = lock(worker).as_ref().map(|worker| worker.say(line));
        }
    }
}

impl Workers for Net {
    fn begin(&self) -> usize {
        if self.alone.load(Ordering::Relaxed) { 0 } else { lock(&self.workers).len() }
    }

    fn work(&self, worker: usize, buckets: &dyn Buckets) -> Result<(), String> {
        let Some(slot) = lock(&self.workers).get(worker).cloned() else { return Ok(()) };
        let mut slot = lock(&slot);
        let Some(worker) = slot.as_mut() else { return Ok(()) };
        let frame = lock(&self.state).frame;
        let result = worker.work(frame, buckets);
        let name = worker.name.clone();
        if result.is_err() {
            *slot = None;
        }
        result.map_err(|what| format!("-net: the worker on {name} is gone: {what}; the others do its part"))
    }

    fn end(&self) {
        let mut state = lock(&self.state);
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
        let mut start = match (server, &options.own_tools) {
            ("local" | "localhost", Some(own)) if command.is_empty() => {
                let mut start = Command::new(&own.program);
                start.arg("-worker").args(arguments);
                start
            }
            _ => {
                let command = if command.is_empty() { "gelato" } else { command };
                let words = arguments.iter().map(|word| quoted(word)).collect::<Vec<_>>().join(" ");
                let folder = std::env::current_dir()?;
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
        let mut process = options.supervisor.spawn(&mut start, format!("rendering with {server}"))?;
        let (Some(mut to), Some(from)) = (process.take_stdin(), process.take_stdout()) else {
            return Err(io::Error::other("it has no streams"));
        };
        let (sender, lines) = channel::<String>();
        std::thread::Builder::new().name("net".to_owned()).spawn(move || {
            // Ends with the worker, or with its process.
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

    /// Reads the greeting, once. False when there is nothing to do for it any more.
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
            // Two for each thread, so that none waits for the wire.
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
                // It lives, or answers what was asked in a frame that was stopped.
                _ => {}
            }
        }
    }

    /// A bucket, its frame and its pixels; `None` when the worker only shows that it lives.
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

/// A bucket, its frame, and its pixels or why there are none.
type Answer = (usize, usize, Result<BucketPixels, String>);

fn number(from: &mut impl Read) -> io::Result<u32> {
    let mut bytes = [0; 4];
    from.read_exact(&mut bytes)?;
    Ok(u32::from_le_bytes(bytes))
}

/// A word for a shell.
fn quoted(word: &str) -> String {
    format!("'{}'", word.replace('\'', "'\\''"))
}

/// Says that a frame cannot be spread.
pub(crate) fn refuse(reporter: &Reporter, why: &str) {
    let text = format!("-net: {why}: this machine renders alone");
    reporter.once("net refused", Severity::Warning, &granita_base::Location::default(), text);
}
