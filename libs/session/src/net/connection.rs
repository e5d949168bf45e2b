//! The coordinator's end of the connection to one worker.

use super::secure::{Ends, SecureWriter};
use super::{ALIVE, BEGUN, BUCKET, DROP, DROPPED, END, GREETING, NEXT, NO_PIXELS, PIXELS, message};
use crate::patient::{Patience, Patient};
use granita_base::process::Process;
use granita_pyg::frames::{Frame, framed};
use granita_render::{BucketPixels, Buckets, Task, Want};
use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The time in which a worker without output must end.
const ENDING: Duration = Duration::from_secs(1);

/// The silence after which others get the tasks of a worker as well. A worker at work sends ten signs of life in it.
const SUSPICIOUS: Duration = Duration::from_secs(5);

/// The longest message of a worker, in bytes. The pixels of the largest bucket with many images are far below.
const LONGEST: usize = 1 << 30;

/// A worker, and what it has done.
pub(super) struct Worker {
    pub(super) name: String,
    /// What holds it; it is let go when this is dropped.
    link: Link,
    /// The messages to send to it; `None` when it is being let go.
    to: Option<Sender<Vec<u8>>>,
    writer: Option<JoinHandle<()>>,
    from: Patient,
    /// The beginning of a message of which the rest has not arrived.
    begun: Vec<u8>,
    /// True when it has been silent for a while.
    is_suspect: bool,
    /// The number of its threads; 0 before its greeting.
    threads: usize,
    /// The reason why it is let go; empty at the end of the work.
    reason: String,
    pub(super) done: Done,
}

/// What a worker has done.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Done {
    /// The buckets and parts of buckets whose pixels arrived.
    pub(super) tasks: usize,
    /// The tasks that it gave back.
    pub(super) given_back: usize,
    /// The seconds from its first task of each frame to its last pixels.
    pub(super) busy: f64,
    /// The bytes of the pixels that it sent.
    pub(super) bytes: u64,
}

/// What holds a worker.
enum Link {
    /// Its process, which is ended when this is dropped.
    Child(Process),
    /// The connection that it opened.
    Joined(TcpStream),
}

/// A message of a worker.
#[derive(Debug, PartialEq)]
pub(super) enum Answer {
    /// The pixels of a task of a frame, or the reason why there are none.
    Pixels(Task, usize, Result<BucketPixels, String>),
    /// A task of a frame was begun.
    Begun(Task, usize),
    /// A task of a frame is given back.
    Dropped(Task, usize),
    /// A sign of life.
    Alive,
}

impl Worker {
    /// Takes a process that was started.
    pub(super) fn started(name: &str, mut process: Process, patience: &Patience) -> io::Result<Self> {
        let (Some(to), Some(from)) = (process.take_stdin(), process.take_stdout()) else {
            return Err(io::Error::other("it has no streams"));
        };
        let from = Patient::new(from, patience.clone())?;
        Self::new(name, Link::Child(process), from, to, |_| {})
    }

    /// Takes a connection that a worker opened. `job` is the message with its work. Returns after the greeting of the
    /// worker, which proves that it knows the secret.
    pub(super) fn joined(name: &str, ends: Ends, job: Vec<u8>, patience: &Patience) -> Result<Self, String> {
        let from = Patient::new(ends.reader, patience.clone()).map_err(|error| error.to_string())?;
        let mut worker = Self::new(name, Link::Joined(ends.stream), from, ends.writer, SecureWriter::close)
            .map_err(|error| error.to_string())?;
        worker.send(job)?;
        let begin = Instant::now();
        let late = || begin.elapsed() > 2 * SUSPICIOUS;
        match worker.greet(&late) {
            Ok(true) => Ok(worker),
            Ok(false) => Err("it does not greet".to_owned()),
            Err(what) => Err(what),
        }
    }

    fn new<W: Write + Send + 'static>(
        name: &str,
        link: Link,
        from: Patient,
        to: W,
        close: impl FnOnce(W) + Send + 'static,
    ) -> io::Result<Self> {
        let (sender, messages) = channel::<Vec<u8>>();
        let writer =
            std::thread::Builder::new().name("net".to_owned()).spawn(move || write(messages, to, close))?;
        Ok(Self {
            name: name.to_owned(),
            link,
            to: Some(sender),
            writer: Some(writer),
            from,
            begun: Vec::new(),
            is_suspect: false,
            threads: 0,
            reason: String::new(),
            done: Done::default(),
        })
    }

    pub(super) fn send(&self, message: Vec<u8>) -> Result<(), String> {
        let sent = self.to.as_ref().and_then(|to| to.send(message).ok());
        sent.ok_or_else(|| "it does not listen".to_owned())
    }

    /// Reads the greeting once. Returns false when `gives_up` returns true before.
    fn greet(&mut self, gives_up: &dyn Fn() -> bool) -> Result<bool, String> {
        if self.threads > 0 {
            return Ok(true);
        }
        if !self.from.wait(gives_up).map_err(|e| e.to_string())? {
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
        match (threads, &mut self.link) {
            (Some(threads @ 1..=4096), _) => self.threads = threads,
            (_, Link::Child(process)) if line.is_empty() => {
                let how =
                    process.wait_for_end(ENDING).map_or_else(|e| e.to_string(), |status| status.to_string());
                return Err(format!("it did not start ({how})"));
            }
            (_, Link::Joined(_)) if line.is_empty() => return Err("it did not start".to_owned()),
            _ => return Err(format!("it is \"{}\", and this is \"{GREETING}\"", line.trim())),
        }
        Ok(true)
    }

    /// Makes a worker that joined connect again when this is dropped, instead of ending.
    pub(super) fn stay(&mut self) {
        if matches!(self.link, Link::Joined(_)) && self.reason.is_empty() {
            self.reason = NEXT.to_owned();
        }
    }

    /// Gives tasks of a frame to the worker until none is left. `silent` is called when it has been silent for a
    /// while.
    ///
    /// # Errors
    /// Returns the reason why the worker is lost.
    pub(super) fn work(
        &mut self,
        frame: usize,
        buckets: &dyn Buckets,
        silent: &dyn Fn(&str),
    ) -> Result<(), String> {
        let result = self.work_on(frame, buckets, silent);
        if let Err(what) = &result {
            self.reason.clone_from(what);
        }
        result
    }

    fn work_on(&mut self, frame: usize, buckets: &dyn Buckets, silent: &dyn Fn(&str)) -> Result<(), String> {
        if self.is_suspect && !self.speaks()? {
            return Ok(());
        }
        self.is_suspect = false;
        self.from.excuse();
        // The number of tasks that it has.
        let mut waiting = 0;
        let mut begin: Option<Instant> = None;
        while !buckets.is_over() {
            if self.threads > 0 && !self.is_suspect {
                // Two tasks per thread are sent, so that no thread waits for the connection.
                while waiting < 2 * self.threads {
                    let want = match waiting {
                        0 => Want::Wait,
                        n if n < self.threads => Want::Idle,
                        _ => Want::Ahead,
                    };
                    let Some(task) = buckets.take(want) else { break };
                    self.send(of_task(BUCKET, task, frame))?;
                    begin.get_or_insert_with(Instant::now);
                    waiting += 1;
                }
                if waiting == 0 {
                    return Ok(());
                }
                for task in buckets.revoked() {
                    self.send(of_task(DROP, task, frame))?;
                }
            }
            // A worker has no tasks before its greeting.
            let speaks = if self.threads == 0 { self.greet(&|| true)? } else { self.speaks()? };
            if speaks && self.is_suspect {
                self.is_suspect = false;
                buckets.suspect(false);
            }
            if !speaks && !self.is_suspect && self.from.silence() >= SUSPICIOUS {
                self.is_suspect = true;
                buckets.suspect(true);
                silent(&self.name);
            }
            while let Some((kind, payload)) = self.message()? {
                match answer(kind, &payload).ok_or("its answer is malformed")? {
                    Answer::Pixels(task, of, pixels) if of == frame => {
                        self.done.bytes += payload.len() as u64;
                        self.done.tasks += 1;
                        buckets.put(task, pixels)?;
                        waiting -= 1;
                        let now = Instant::now();
                        self.done.busy += begin.replace(now).map_or(0.0, |begin| (now - begin).as_secs_f64());
                        begin = begin.filter(|_| waiting > 0);
                    }
                    Answer::Begun(task, of) if of == frame => buckets.begun(task),
                    Answer::Dropped(task, of) if of == frame => {
                        self.done.given_back += 1;
                        buckets.dropped(task);
                        waiting -= 1;
                    }
                    // This is a sign of life, or an answer for a stopped frame.
                    _ => {}
                }
            }
        }
        Ok(())
    }

    /// Receives what has arrived, or waits a moment for it. Returns false when there is nothing.
    fn speaks(&mut self) -> Result<bool, String> {
        if !self.from.wait(&|| true).map_err(|e| e.to_string())? {
            return Ok(false);
        }
        let piece = self.from.arrived().ok_or("its connection has ended")?;
        self.begun.extend(piece);
        Ok(true)
    }

    /// Returns the next message that has arrived whole.
    ///
    /// # Errors
    /// Returns a message when it is longer than any answer, before the rest of it is kept.
    fn message(&mut self) -> Result<Option<(u8, Vec<u8>)>, String> {
        let Some((head, rest)) = self.begun.split_first_chunk::<5>() else { return Ok(None) };
        let length = u32::from_le_bytes([head[1], head[2], head[3], head[4]]) as usize;
        if length > LONGEST {
            return Err(format!("its answer has {length} bytes; the limit is {LONGEST}"));
        }
        let Some(payload) = rest.get(..length) else { return Ok(None) };
        let message = (head[0], payload.to_vec());
        self.begun.drain(..5 + length);
        Ok(Some(message))
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        // It may have ended.
        let _ = self.send(framed(END, &[self.reason.as_bytes()]).unwrap_or_default());
        self.to = None;
        match &self.link {
            Link::Child(_) => (),
            Link::Joined(stream) => {
                let _ = self.writer.take().map(JoinHandle::join);
                // This ends the thread that reads.
                let _ = stream.shutdown(Shutdown::Both);
            }
        }
    }
}

/// Writes messages to a worker, so that one that does not read blocks no other. The thread ends with the worker, or
/// with its connection.
fn write<W: Write>(messages: Receiver<Vec<u8>>, mut to: W, close: impl FnOnce(W)) {
    while let Ok(message) = messages.recv()
        && to.write_all(&message).and_then(|()| to.flush()).is_ok()
    {}
    close(to);
}

/// Returns a message about a task of a frame.
pub(super) fn of_task(kind: u8, task: Task, frame: usize) -> Vec<u8> {
    message(kind, &[frame, task.bucket, task.part as usize])
}

/// Returns the message of a worker; `None` when it is malformed.
pub(super) fn answer(kind: u8, payload: &[u8]) -> Option<Answer> {
    if kind == ALIVE {
        return Some(Answer::Alive);
    }
    let mut from = Frame(payload);
    let frame = from.word()? as usize;
    let task = Task { bucket: from.word()? as usize, part: from.word()? };
    match kind {
        PIXELS => {
            let images = from.word()?;
            let pixels: BucketPixels = (0..images).map_while(|_| from.floats()).collect();
            let is_whole = pixels.len() == images as usize && from.0.is_empty();
            is_whole.then_some(Answer::Pixels(task, frame, Ok(pixels)))
        }
        NO_PIXELS => Some(Answer::Pixels(task, frame, Err(from.rest()))),
        BEGUN if from.0.is_empty() => Some(Answer::Begun(task, frame)),
        DROPPED if from.0.is_empty() => Some(Answer::Dropped(task, frame)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_go_around_and_malformed_ones_are_refused() {
        let head = [1, 0, 0, 0, 3, 0, 0, 0, 6, 0, 0, 0];
        let task = Task { bucket: 3, part: 6 };
        let pixels = [&head[..], &[2, 0, 0, 0], &[1, 0, 0, 0], &1.5_f32.to_le_bytes(), &[0; 4]].concat();
        assert_eq!(answer(PIXELS, &pixels), Some(Answer::Pixels(task, 1, Ok(vec![vec![1.5], vec![]]))));
        for n in 0..pixels.len() {
            assert_eq!(answer(PIXELS, &pixels[..n]), None, "{n}");
        }
        assert_eq!(answer(PIXELS, &[&pixels[..], &[0]].concat()), None);
        let reason = [&head[..], b"no"].concat();
        assert_eq!(answer(NO_PIXELS, &reason), Some(Answer::Pixels(task, 1, Err("no".to_owned()))));
        assert_eq!(answer(BEGUN, &head), Some(Answer::Begun(task, 1)));
        assert_eq!(answer(DROPPED, &head), Some(Answer::Dropped(task, 1)));
        assert_eq!(answer(BEGUN, &reason), None);
        assert_eq!(answer(ALIVE, &[]), Some(Answer::Alive));
        assert_eq!(answer(b'?', &reason), None);
    }
}
