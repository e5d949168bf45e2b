//! The protocol between a coordinator and its workers, which render one frame with several processes (reference 6.6.3).
//!
//! A worker is this program with `-worker`, started by the coordinator, on this machine or through `ssh`, for the
//! same scene files. It reads them as the coordinator does, but runs no commands and writes no images. Both count
//! the commands and frames that they reach, and the worker is never ahead. It waits at a command until the
//! coordinator has run it, and at a frame until buckets of it are requested.
//!
//! The worker first sends a line with [`GREETING`] and its number of threads. Everything else is messages of
//! [`granita_pyg::frames`]. All numbers have 32 bits.
//!
//! The coordinator sends:
//! - [`COMMANDS`] N: this number of commands of the scene is done.
//! - [`FRAME`] N: the frames before this one are over.
//! - [`BUCKET`] F I: render bucket I of frame F. Frames are counted from 0.
//!
//! The worker sends:
//! - [`PIXELS`]: the bucket, the frame, the number of its images, and for each image the number of its values and the
//!   values.
//! - [`NO_PIXELS`]: the bucket, the frame, and the reason as text.
//! - [`ALIVE`]: a sign of life.
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
use granita_pyg::frames::{Frame, receive, send};
use granita_render::{BucketPixels, Buckets, Workers};
use parking_lot::Mutex;
use std::io::{self, Read, Write};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::time::Duration;

/// The first line of a worker, which contains the version of the suite and of this protocol.
const GREETING: &str = concat!("granita-worker ", env!("CARGO_PKG_VERSION"), "/3");

/// The kinds of messages to a worker.
const COMMANDS: u8 = b'C';
const FRAME: u8 = b'F';
const BUCKET: u8 = b'B';

/// The kinds of messages of a worker.
const PIXELS: u8 = b'P';
const NO_PIXELS: u8 = b'E';
const ALIVE: u8 = b'A';

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
    /// The messages to send to it.
    to: Sender<Vec<u8>>,
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
                            .send(&message(COMMANDS, &[progress.commands]))
                            .and_then(|()| worker.send(&message(FRAME, &[progress.frame])));
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
        let commands = message(COMMANDS, &[state.commands]);
        drop(state);
        self.send(&commands);
    }

    /// Sends a message to all workers.
    fn send(&self, message: &[u8]) {
        for worker in self.workers.lock().iter() {
            // A worker that has ended is reported when it is needed.
            let _ = worker.lock().as_ref().map(|worker| worker.send(message));
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
        let frame = message(FRAME, &[state.frame]);
        drop(state);
        self.send(&frame);
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
        let mut process = options.run.supervisor.spawn(&mut start, format!("rendering with {server}"))?;
        let (Some(mut to), Some(from)) = (process.take_stdin(), process.take_stdout()) else {
            return Err(io::Error::other("it has no streams"));
        };
        let (sender, messages) = channel::<Vec<u8>>();
        std::thread::Builder::new().name("net".to_owned()).spawn(move || {
            // The thread ends with the worker, or with its process.
            while let Ok(message) = messages.recv()
                && to.write_all(&message).and_then(|()| to.flush()).is_ok()
            {}
        })?;
        let from = Patient::new(from, patience.clone())?;
        Ok(Self { name: server.to_owned(), process, to: sender, from, threads: 0 })
    }

    fn send(&self, message: &[u8]) -> Result<(), String> {
        self.to.send(message.to_vec()).map_err(|_| "it does not listen".to_owned())
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
                self.send(&message(BUCKET, &[frame, index]))?;
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
        let (kind, payload) = receive(&mut self.from)?;
        if kind == ALIVE {
            return Ok(None);
        }
        answer(kind, &payload).map(Some).ok_or_else(|| io::Error::other("its answer is malformed"))
    }
}

/// Returns the command that starts the worker on a machine.
fn start_command(
    server: &str,
    command: &str,
    arguments: &[String],
    options: &SessionOptions,
) -> io::Result<Command> {
    let mut start = match (server, &options.run.own_tools) {
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
    start.envs(options.run.program_environment.iter().map(|(k, v)| (k, v)));
    start.stdin(Stdio::piped()).stdout(Stdio::piped());
    Ok(start)
}

/// A bucket, its frame, and its pixels or the reason why there are none.
type Answer = (usize, usize, Result<BucketPixels, String>);

/// Returns the answer of a worker; `None` when it is malformed.
fn answer(kind: u8, payload: &[u8]) -> Option<Answer> {
    let mut from = Frame(payload);
    let (index, frame) = (from.word()? as usize, from.word()? as usize);
    let pixels = match kind {
        PIXELS => {
            let images = from.word()?;
            let pixels: BucketPixels = (0..images).map_while(|_| from.floats()).collect();
            Ok((pixels.len() == images as usize && from.0.is_empty()).then_some(pixels)?)
        }
        NO_PIXELS => Err(from.rest()),
        _ => return None,
    };
    Some((index, frame, pixels))
}

/// Returns a message of some numbers.
fn message(kind: u8, numbers: &[usize]) -> Vec<u8> {
    let payload: Vec<u8> = numbers.iter().flat_map(|n| word(*n)).collect();
    let mut message = Vec::new();
    send(&mut message, kind, &[&payload]).expect("invariant: a short message can be written to memory");
    message
}

/// Returns the bytes of a number. Numbers are far below the limit.
fn word(n: usize) -> [u8; 4] {
    u32::try_from(n).unwrap_or(u32::MAX).to_le_bytes()
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
    fn answers_go_around_and_malformed_ones_are_refused() {
        let pixels =
            [&[3, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0][..], &[1, 0, 0, 0], &1.5_f32.to_le_bytes(), &[0; 4]];
        let pixels = pixels.concat();
        assert_eq!(answer(PIXELS, &pixels), Some((3, 1, Ok(vec![vec![1.5], vec![]]))));
        for n in 0..pixels.len() {
            assert_eq!(answer(PIXELS, &pixels[..n]), None, "{n}");
        }
        assert_eq!(answer(PIXELS, &[&pixels[..], &[0]].concat()), None);
        let reason = [&[3, 0, 0, 0, 1, 0, 0, 0][..], b"no"].concat();
        assert_eq!(answer(NO_PIXELS, &reason), Some((3, 1, Err("no".to_owned()))));
        assert_eq!(answer(b'?', &reason), None);
    }

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
