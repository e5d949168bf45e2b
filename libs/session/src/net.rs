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
//! - `bucket I`: render this bucket of the frame.
//!
//! The worker greets with [`GREETING`] and its threads, a line; its answers are binary, little-endian: the bucket and the number
//! of its images, and for each image the number of its values and these; or the bucket, [`NO_IMAGES`], the length of a text and
//! the text. All counts have 32 bits.

use crate::SessionOptions;
use granita_base::{Reporter, Severity};
use granita_render::{BucketPixels, Buckets, Coordinator, Workers};
use std::collections::VecDeque;
use std::io::{BufRead, BufReader, BufWriter, Read, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// What a worker of this version says first.
const GREETING: &str = concat!("granita-worker ", env!("CARGO_PKG_VERSION"));

/// Stands for a number of images when there are none.
const NO_IMAGES: u32 = u32::MAX;

/// More values than any bucket has.
const MOST_VALUES: u32 = 1 << 28;

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The workers of a coordinator.
pub(crate) struct Net {
    options: Arc<SessionOptions>,
    reporter: Reporter,
    state: Mutex<Progress>,
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
    child: Child,
    to: ChildStdin,
    from: BufReader<ChildStdout>,
    /// Threads that it has; 0 until it has greeted.
    threads: usize,
}

impl Net {
    pub(crate) fn new(options: Arc<SessionOptions>, reporter: Reporter) -> Self {
        Self {
            options,
            reporter,
            state: Mutex::default(),
            alone: AtomicBool::new(false),
            workers: Mutex::default(),
        }
    }

    /// Starts workers on machines, unless they are there already; `command` is how `gelato` is called on them. False when there are none.
    pub(crate) fn start(&self, servers: &[&str], command: &str) -> bool {
        let Some(arguments) = &self.options.net_arguments else {
            refuse(&self.reporter, "the scene is no file that workers could read");
            return false;
        };
        let mut workers = lock(&self.workers);
        if workers.is_empty() {
            let progress = lock(&self.state);
            for server in servers {
                match Worker::start(server, command, arguments, &self.options) {
                    Ok(mut worker) => {
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
            let _ = lock(worker).as_mut().map(|worker| worker.say(line));
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
        let result = worker.work(buckets);
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
    ) -> std::io::Result<Self> {
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
        let mut child = start.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
        let (Some(to), Some(from)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(std::io::Error::other("it has no streams"));
        };
        Ok(Self { name: server.to_owned(), child, to, from: BufReader::new(from), threads: 0 })
    }

    fn say(&mut self, line: &str) -> std::io::Result<()> {
        self.to.write_all(line.as_bytes())?;
        self.to.flush()
    }

    /// Reads the greeting, once.
    fn greet(&mut self) -> Result<(), String> {
        if self.threads > 0 {
            return Ok(());
        }
        let mut line = String::new();
        (&mut self.from).take(200).read_line(&mut line).map_err(|e| e.to_string())?;
        let threads = line.strip_prefix(GREETING).and_then(|rest| rest.trim().parse().ok());
        match threads {
            Some(threads @ 1..=4096) => self.threads = threads,
            _ if line.is_empty() => return Err("it did not start".to_owned()),
            _ => return Err(format!("it says \"{}\", not {GREETING}", line.trim())),
        }
        Ok(())
    }

    fn work(&mut self, buckets: &dyn Buckets) -> Result<(), String> {
        self.greet()?;
        let mut waiting = 0;
        loop {
            // Two for each thread, so that none waits for the wire.
            while waiting < 2 * self.threads {
                let Some(index) = buckets.take(waiting == 0) else { break };
                self.say(&format!("bucket {index}\n")).map_err(|e| e.to_string())?;
                waiting += 1;
            }
            if waiting == 0 {
                return Ok(());
            }
            let (index, pixels) = self.answer().map_err(|e| e.to_string())?;
            buckets.put(index, pixels)?;
            waiting -= 1;
        }
    }

    fn answer(&mut self) -> std::io::Result<(usize, Result<BucketPixels, String>)> {
        let (index, images) = (number(&mut self.from)?, number(&mut self.from)?);
        let mut read = |size: u64| {
            let mut bytes = Vec::new();
            if (&mut self.from).take(size).read_to_end(&mut bytes)? as u64 != size {
                return Err(std::io::Error::from(std::io::ErrorKind::UnexpectedEof));
            }
            Ok(bytes)
        };
        let count = |bytes: &[u8]| bytes.try_into().map_or(u32::MAX, u32::from_le_bytes);
        let too_much = || std::io::Error::other("its answer makes no sense");
        if images == NO_IMAGES {
            let size = Some(count(&read(4)?)).filter(|n| *n < 1 << 16).ok_or_else(too_much)?;
            let text = String::from_utf8_lossy(&read(size.into())?).into_owned();
            return Ok((index as usize, Err(text)));
        }
        let mut pixels = Vec::new();
        for _ in 0..images {
            let size = Some(count(&read(4)?)).filter(|n| *n < MOST_VALUES).ok_or_else(too_much)?;
            let bytes = read(u64::from(size) * 4)?;
            pixels.push(bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect());
        }
        Ok((index as usize, Ok(pixels)))
    }
}

impl Drop for Worker {
    /// Without its input it ends by itself; one that hangs is ended.
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn number(from: &mut impl Read) -> std::io::Result<u32> {
    let mut bytes = [0; 4];
    from.read_exact(&mut bytes)?;
    Ok(u32::from_le_bytes(bytes))
}

/// A word for a shell.
fn quoted(word: &str) -> String {
    format!("'{}'", word.replace('\'', "'\\''"))
}

/// The coordinator as its worker knows it.
pub(crate) struct Master {
    shared: Arc<Shared>,
    output: Mutex<BufWriter<Box<dyn Write + Send>>>,
    /// Commands and frames that the worker came to.
    here: Mutex<Progress>,
}

/// What the coordinator said.
#[derive(Default)]
struct Shared {
    said: Mutex<Said>,
    changed: Condvar,
}

#[derive(Default)]
struct Said {
    progress: Progress,
    buckets: VecDeque<usize>,
    /// It says nothing more.
    over: bool,
}

impl Master {
    /// Greets.
    pub(crate) fn new(
        input: Box<dyn Read + Send>,
        output: Box<dyn Write + Send>,
        threads: usize,
        reporter: &Reporter,
    ) -> Self {
        let mut output = BufWriter::new(output);
        if let Err(error) = writeln!(output, "{GREETING} {threads}").and_then(|()| output.flush()) {
            reporter.error(format!("-worker: {error}"));
        }
        let shared = Arc::new(Shared::default());
        let theirs = shared.clone();
        std::thread::spawn(move || theirs.listen(input));
        Self { shared, output: Mutex::new(output), here: Mutex::default() }
    }

    /// Waits until the coordinator has run the command that the worker came to. False when it is gone.
    pub(crate) fn command(&self) -> bool {
        let number = {
            let mut here = lock(&self.here);
            here.commands += 1;
            here.commands
        };
        let mut said = lock(&self.shared.said);
        while said.progress.commands < number && !said.over {
            said = self.shared.changed.wait(said).unwrap_or_else(PoisonError::into_inner);
        }
        said.progress.commands >= number
    }
}

impl Shared {
    fn listen(&self, input: Box<dyn Read + Send>) {
        for line in BufReader::new(input).lines() {
            let Ok(line) = line else { break };
            let Some((word, number)) = line.split_once(' ') else { continue };
            let Ok(number) = number.trim().parse() else { continue };
            let mut said = lock(&self.said);
            match word {
                "commands" => said.progress.commands = number,
                "frame" => said.progress.frame = number,
                "bucket" => said.buckets.push_back(number),
                _ => (),
            }
            drop(said);
            self.changed.notify_all();
        }
        self.hang_up();
    }

    fn hang_up(&self) {
        lock(&self.said).over = true;
        self.changed.notify_all();
    }
}

impl Coordinator for Master {
    fn begin(&self) {
        lock(&self.here).frame += 1;
    }

    fn next(&self) -> Option<usize> {
        // Frames before this number are over when this one is.
        let frame = lock(&self.here).frame;
        let mut said = lock(&self.shared.said);
        loop {
            if said.progress.frame >= frame {
                return None;
            }
            if said.over {
                return None;
            }
            if let Some(index) = said.buckets.pop_front() {
                return Some(index);
            }
            said = self.shared.changed.wait(said).unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn done(&self, index: usize, pixels: Result<&BucketPixels, &str>) {
        let count = |n: usize| u32::try_from(n).unwrap_or(NO_IMAGES).to_le_bytes();
        let mut bytes = count(index).to_vec();
        match pixels {
            Ok(images) => {
                bytes.extend(count(images.len()));
                for values in images {
                    bytes.extend(count(values.len()));
                    bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
                }
            }
            Err(text) => {
                bytes.extend(NO_IMAGES.to_le_bytes());
                let text = &text.as_bytes()[..text.len().min(1000)];
                bytes.extend(count(text.len()));
                bytes.extend(text);
            }
        }
        let mut output = lock(&self.output);
        if output.write_all(&bytes).and_then(|()| output.flush()).is_err() {
            // Nobody listens any more.
            self.shared.hang_up();
        }
    }
}

/// Says that a frame cannot be spread.
pub(crate) fn refuse(reporter: &Reporter, why: &str) {
    let text = format!("-net: {why}: this machine renders alone");
    reporter.once("net refused", Severity::Warning, &granita_base::Location::default(), text);
}
