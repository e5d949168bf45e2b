//! The protocol between a coordinator and its workers, which render one frame with several processes (reference 6.6.3).
//!
//! A worker is this program with `-worker`, for the same scene files. The coordinator starts it, on this machine or
//! through `ssh`, or it connects to the coordinator by itself ([`listener`]). It reads the files as the coordinator
//! does, but runs no commands and writes no images. Both count
//! the commands and frames that they reach, and the worker is never ahead. It waits at a command until the
//! coordinator has run it, and at a frame until buckets of it are requested.
//!
//! The worker first sends a line with [`GREETING`] and its number of threads. Everything else is messages of
//! [`granita_pyg::frames`]. All numbers have 32 bits. A task is a frame F, counted from 0, a bucket I of it, and a part
//! P of the bucket ([`granita_render::Task`]).
//!
//! The coordinator sends:
//! - [`JOB`], first and only over connections that a worker opened: the folder, and the words of the command line.
//! - [`COMMANDS`] N: this number of commands of the scene is done.
//! - [`FRAME`] N: the frames before this one are over.
//! - [`BUCKET`] F I P: render this task.
//! - [`DROP`] F I P: give this task back unless it was begun.
//! - [`END`]: there is no more work, or the text says why the worker is dismissed. The text [`NEXT`] says that another
//!   coordinator is going to listen at the same address.
//!
//! The worker sends:
//! - [`BEGUN`] F I P: it begins this task.
//! - [`PIXELS`] F I P: the number of images, and for each image the number of its values and the values.
//! - [`NO_PIXELS`] F I P: the reason as text.
//! - [`DROPPED`] F I P: it gives this task back.
//! - [`ALIVE`]: a sign of life.
//!
//! As long as a worker has tasks, a separate thread sends [`ALIVE`] twice a second. This distinguishes
//! a slow worker from a stopped one. After five seconds of silence others get its tasks as well, and the answers that
//! come first count. When nothing arrives for the seconds of "net:timeout", the worker is ended. A thread writes to
//! each worker, so that one that does not read blocks no other. Answers for a stopped frame are ignored.

mod connection;
mod join;
mod listener;
mod secure;
mod servers;
mod worker;

pub use join::{Joined, join};
pub(crate) use worker::WorkerCoordinator;

use crate::SessionOptions;
use crate::patient::Patience;
use crate::secret::NetSecret;
use connection::Worker;
use granita_base::{Reporter, Severity};
use granita_pyg::frames::send;
use granita_render::{Buckets, Workers};
use listener::Listener;
use parking_lot::Mutex;
use servers::{Launch, Server};
use std::io;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The first line of a worker, which contains the version of the suite and of this protocol.
const GREETING: &str = concat!("granita-worker ", env!("CARGO_PKG_VERSION"), "/5");

/// The last words of a coordinator after which a worker connects again, to the coordinator of the next frame.
pub const NEXT: &str = "next";

/// The kinds of messages to a worker.
const JOB: u8 = b'J';
const COMMANDS: u8 = b'C';
const FRAME: u8 = b'F';
const BUCKET: u8 = b'B';
const DROP: u8 = b'D';
const END: u8 = b'Z';

/// The kinds of messages of a worker.
const BEGUN: u8 = b'G';
const PIXELS: u8 = b'P';
const NO_PIXELS: u8 = b'E';
const DROPPED: u8 = b'R';
const ALIVE: u8 = b'A';

/// The port that "listen" waits at.
pub const PORT: u16 = 14159;

/// The interval at which the ends of processes are noticed.
const GLANCE: Duration = Duration::from_millis(100);

/// The time in which a command that started workers must end after them. One that waits for a lost machine does not.
const LINGER: Duration = Duration::from_secs(1);

/// The workers of a coordinator.
pub(crate) struct Net {
    options: Arc<SessionOptions>,
    patience: Patience,
    /// True when frames are rendered without workers.
    alone: AtomicBool,
    /// True when [`Net::start`] was called with servers.
    started: AtomicBool,
    shared: Arc<Shared>,
    listener: Mutex<Option<Listener>>,
    /// The threads that wait for the commands which start workers.
    launched: Mutex<Vec<JoinHandle<()>>>,
}

/// What the threads that accept workers share with the coordinator.
struct Shared {
    reporter: Reporter,
    /// The workers, in the order of their arrival; `None` for a lost one.
    workers: Mutex<Vec<Slot>>,
    state: Mutex<Progress>,
    /// True when workers may connect.
    listens: AtomicBool,
    /// The number of commands that start workers and have not ended.
    launching: AtomicUsize,
    /// True when the coordinator ends.
    ends: AtomicBool,
}

type Slot = Arc<Mutex<Option<Worker>>>;

/// The progress of the coordinator.
#[derive(Default)]
struct Progress {
    commands: usize,
    frame: usize,
}

impl Shared {
    /// Adds a worker, which gets the progress so far.
    fn add(&self, worker: Worker) {
        let mut workers = self.workers.lock();
        let progress = self.state.lock();
        // A worker that has ended is reported when it is needed.
        let _ = worker
            .send(message(COMMANDS, &[progress.commands]))
            .and_then(|()| worker.send(message(FRAME, &[progress.frame])));
        workers.push(Arc::new(Mutex::new(Some(worker))));
    }
}

impl Net {
    pub(crate) fn new(options: Arc<SessionOptions>, reporter: Reporter) -> Self {
        let shared = Shared {
            reporter,
            workers: Mutex::default(),
            state: Mutex::default(),
            listens: AtomicBool::new(false),
            launching: AtomicUsize::new(0),
            ends: AtomicBool::new(false),
        };
        Self {
            options,
            patience: Patience::new(0.0),
            alone: AtomicBool::new(false),
            started: AtomicBool::new(false),
            shared: Arc::new(shared),
            listener: Mutex::default(),
            launched: Mutex::default(),
        }
    }

    /// Starts workers, unless they were started already. `lists` are those of "-net" or "net:workers", `command` is the
    /// command line of `gelato` on other machines, and `patience` the longest silence in seconds. Returns false when
    /// there are no workers and none can come.
    pub(crate) fn start<'a>(
        &self,
        lists: impl IntoIterator<Item = &'a str>,
        command: &str,
        patience: f32,
    ) -> bool {
        let reporter = &self.shared.reporter;
        let Some(arguments) = &self.options.net_arguments else {
            refuse(reporter, "the scene is no file that workers could read");
            return false;
        };
        self.patience.set(patience);
        if !self.started.swap(true, Ordering::Relaxed) {
            let files = self.options.run.environment.files();
            match servers::parse(lists, &|file: &Path| files.read_to_string(file)) {
                Ok(servers) => self.start_all(&servers, command, arguments),
                Err(what) => reporter.error(format!("-net: {what}")),
            }
        }
        let is_there = |slot: &Slot| slot.try_lock().is_none_or(|worker| worker.is_some());
        self.patience().is_some() || self.shared.workers.lock().iter().any(is_there)
    }

    fn start_all(&self, servers: &[Server], command: &str, arguments: &[String]) {
        let reporter = &self.shared.reporter;
        for server in servers {
            let Server::Start(name) = server else { continue };
            match self.start_one(name, command, arguments) {
                Ok(worker) => self.shared.add(worker),
                Err(error) => {
                    reporter.warning(format!("-net: no worker on {name}: {error}; the others do its part"));
                }
            }
        }
        let launches = servers.iter().filter_map(|server| match server {
            Server::Launch(launch) => Some(launch),
            _ => None,
        });
        let launches: Vec<&Launch> = launches.collect();
        let place = servers.iter().find_map(|server| match server {
            Server::Listen { host, port } => Some((host.as_str(), *port)),
            _ => None,
        });
        if launches.is_empty() && place.is_none() {
            return;
        }
        if let Err(what) = self.listen(place, &launches, command, arguments) {
            reporter.error(format!("-net: {what}"));
        }
    }

    fn start_one(&self, server: &str, command: &str, arguments: &[String]) -> io::Result<Worker> {
        let mut start = start_command(server, command, arguments, &self.options)?;
        let process = self.options.run.supervisor.spawn(&mut start, format!("rendering with {server}"))?;
        Worker::started(server, process, &self.patience)
    }

    /// Waits for workers that connect, and runs the commands that start them. `place` is where the options say that
    /// this program listens.
    fn listen(
        &self,
        place: Option<(&str, u16)>,
        launches: &[&Launch],
        command: &str,
        arguments: &[String],
    ) -> Result<(), String> {
        let secret = match (&self.options.net_secret, place) {
            (Some(secret), _) => secret.clone(),
            (None, None) => NetSecret::random().map_err(|error| format!("no secret for workers: {error}"))?,
            (None, Some(_)) => {
                let variable = NetSecret::VARIABLE;
                return Err(format!(
                    "workers that connect must know a secret: name a file with it (-secret FILE), or set {variable}"
                ));
            }
        };
        let (host, port) = place.unwrap_or(("", 0));
        let folder = self.options.current_folder.to_string_lossy();
        let words: Vec<&str> =
            std::iter::once(&*folder).chain(arguments.iter().map(|word| &**word)).collect();
        let job = join::job(&words).map_err(|error| error.to_string())?;
        let listener = Listener::start(host, port, secret.key, job, &self.patience, &self.shared)
            .map_err(|error| format!("cannot listen at {host}:{port}: {error}"))?;
        self.shared.listens.store(place.is_some(), Ordering::Relaxed);
        let address = listener.address(host);
        self.shared.reporter.info(format!("-net: workers join with: gelato -worker -join {address}"));
        *self.listener.lock() = Some(listener);
        let worker: Vec<String> = match (command, &self.options.run.own_tools) {
            ("", Some(own)) => vec![own.program.to_string_lossy().into_owned()],
            ("", None) => vec!["gelato".to_owned()],
            (command, _) => command.split_whitespace().map(str::to_owned).collect(),
        };
        for launch in launches {
            self.launch(launch, &launch.words(&address, &worker), &secret.text);
        }
        Ok(())
    }

    /// Runs a command that starts workers. It ends with the coordinator at the latest.
    fn launch(&self, launch: &Launch, words: &[String], secret: &str) {
        let mut command = Command::new(&words[0]);
        command.args(&words[1..]).stdin(Stdio::null());
        command.envs(self.options.run.program_environment.iter().map(|(k, v)| (k, v)));
        command.envs(launch.variables.iter().copied()).env(NetSecret::VARIABLE, secret);
        // Standard output belongs to the images of a caller, or to nobody.
        command.stdout(Stdio::null());
        let (name, program, shared) = (launch.name.clone(), words[0].clone(), self.shared.clone());
        match self.options.run.supervisor.spawn(&mut command, format!("starting workers ({name})")) {
            Ok(mut process) => {
                shared.launching.fetch_add(1, Ordering::Relaxed);
                let launched = std::thread::spawn(move || {
                    let mut end: Option<Instant> = None;
                    let status = process.wait_while(|| {
                        std::thread::sleep(GLANCE);
                        let ends = shared.ends.load(Ordering::Relaxed);
                        !ends || end.get_or_insert_with(Instant::now).elapsed() < LINGER
                    });
                    shared.launching.fetch_sub(1, Ordering::Relaxed);
                    let ended = shared.ends.load(Ordering::Relaxed);
                    match status {
                        Ok(status) if !status.success() && !ended => {
                            shared.reporter.warning(format!("-net: {name}: {program} ended ({status})"));
                        }
                        _ => (),
                    }
                });
                self.launched.lock().push(launched);
            }
            Err(error) => {
                shared
                    .reporter
                    .warning(format!("-net: {name}: {}: {error}; the others do its part", words[0]));
            }
        }
    }

    /// Sets whether the cameras of the next frame are rendered without workers. Workers have no databases of
    /// earlier frames except those in files.
    pub(crate) fn set_alone(&self, alone: bool) {
        if alone {
            refuse(
                &self.shared.reporter,
                "workers do not have the spatial databases that earlier frames saved",
            );
        }
        self.alone.store(alone, Ordering::Relaxed);
    }

    /// Counts a command of the scene that was run.
    pub(crate) fn command_done(&self) {
        let mut state = self.shared.state.lock();
        state.commands += 1;
        let commands = message(COMMANDS, &[state.commands]);
        drop(state);
        self.send(&commands);
    }

    /// Sends a message to all workers.
    fn send(&self, message: &[u8]) {
        for worker in self.shared.workers.lock().iter() {
            // A worker that has ended is reported when it is needed.
            let _ = worker.lock().as_ref().map(|worker| worker.send(message.to_vec()));
        }
    }

    /// Returns what the workers have done so far, as lines of statistics; nothing without workers.
    pub(crate) fn report(&self) -> String {
        let mut text = String::new();
        for slot in self.shared.workers.lock().iter() {
            if let Some(worker) = &*slot.lock() {
                let done = &worker.done;
                text += &format!(
                    "  {:<34} {} buckets and parts, {:.2} s busy, {:.1} MB sent, {} given back\n",
                    format!("worker {}", worker.name),
                    done.tasks,
                    done.busy,
                    done.bytes as f64 / 1e6,
                    done.given_back
                );
            }
        }
        text
    }
}

impl Drop for Net {
    fn drop(&mut self) {
        self.shared.ends.store(true, Ordering::Relaxed);
        *self.listener.lock() = None;
        if self.options.net_stays {
            for worker in self.shared.workers.lock().iter() {
                let _ = worker.lock().as_mut().map(Worker::stay);
            }
        }
        // The threads of workers that are being accepted may hold the list for a moment longer.
        self.shared.workers.lock().clear();
        for launched in self.launched.lock().drain(..) {
            // A panic of the thread was printed.
            let _ = launched.join();
        }
    }
}

impl Workers for Net {
    fn begin(&self) {}

    fn count(&self) -> usize {
        if self.alone.load(Ordering::Relaxed) { 0 } else { self.shared.workers.lock().len() }
    }

    fn patience(&self) -> Option<Duration> {
        let may_come = self.shared.listens.load(Ordering::Relaxed)
            || self.shared.launching.load(Ordering::Relaxed) > 0 && self.listener.lock().is_some();
        (may_come && !self.alone.load(Ordering::Relaxed)).then(|| self.patience.duration())
    }

    fn work(&self, worker: usize, buckets: &dyn Buckets) -> Result<(), String> {
        let Some(slot) = self.shared.workers.lock().get(worker).cloned() else { return Ok(()) };
        let mut slot = slot.lock();
        let Some(worker) = slot.as_mut() else { return Ok(()) };
        let frame = self.shared.state.lock().frame;
        let silent = |name: &str| {
            let text =
                format!("-net: the worker on {name} is silent; others do its part until it speaks again");
            self.shared.reporter.warning(text);
        };
        let result = worker.work(frame, buckets, &silent);
        let name = worker.name.clone();
        if result.is_err() {
            *slot = None;
        }
        result.map_err(|what| format!("-net: the worker on {name} is gone: {what}; the others do its part"))
    }

    fn end(&self) {
        let mut state = self.shared.state.lock();
        state.frame += 1;
        let frame = message(FRAME, &[state.frame]);
        drop(state);
        self.send(&frame);
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
