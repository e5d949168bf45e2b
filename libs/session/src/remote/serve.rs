//! The renderer's end.

use super::images::Forwarded;
use super::{GREETING, message_bytes};
use crate::commands::PriorityRequest;
use crate::patient::PULSE;
use crate::{Outcome, Session, SharedProgress};
use granita_base::report::VERBOSITY_INFO;
use granita_base::{Location, Param, Reporter};
use granita_pyg::frames::{receive, send};
use granita_render::{Priority, Progress};
use granita_scene::{Call, SceneSink, State, Stop};
use std::io::{Read, Write};
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};

/// So many frames of calls wait at most.
const QUEUE: usize = 16;

/// What the program is told: messages, progress, answers. Clones share the connection.
#[derive(Clone)]
pub struct Told(Arc<Inner>);

struct Inner {
    to: Mutex<Box<dyn Write + Send>>,
    /// Steps of the frame.
    total: AtomicU64,
    /// The share that was told last, in 256ths.
    share: AtomicU64,
    /// The program wants the frame that it asked for to end.
    ends: AtomicBool,
    /// Set by [`Session::obey`].
    stop: Mutex<Option<Arc<AtomicBool>>>,
    /// Set by [`Session::obey`] as well.
    priority: Mutex<Option<Arc<Priority>>>,
    /// What the program would have first of the frame that it asked for.
    request: Mutex<Option<PriorityRequest>>,
    /// Images that were sent: they are told apart by their numbers.
    images: AtomicU32,
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl std::fmt::Debug for Told {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Told")
    }
}

impl Told {
    /// Greets the program.
    pub fn new(to: Box<dyn Write + Send>) -> Self {
        let told = Self(Arc::new(Inner {
            to: Mutex::new(to),
            total: AtomicU64::new(0),
            share: AtomicU64::new(0),
            ends: AtomicBool::new(false),
            stop: Mutex::default(),
            priority: Mutex::default(),
            request: Mutex::default(),
            images: AtomicU32::new(0),
        }));
        told.say(b'H', &[GREETING.as_bytes()]);
        let inner = Arc::downgrade(&told.0);
        std::thread::spawn(move || {
            while let Some(inner) = inner.upgrade() {
                Self(inner).say(b'B', &[]);
                std::thread::sleep(PULSE);
            }
        });
        told
    }

    /// The number of the next image that is sent.
    pub(super) fn image_number(&self) -> u32 {
        self.0.images.fetch_add(1, Ordering::Relaxed)
    }

    /// For the session's messages. All of them go: the program's own verbosity counts.
    pub fn reporter(&self) -> Reporter {
        let told = self.clone();
        let reporter = Reporter::new(Box::new(move |message| told.say(b'M', &[&message_bytes(message)])));
        reporter.set_verbosity(VERBOSITY_INFO);
        reporter
    }

    /// For the session's progress.
    pub fn progress(&self) -> SharedProgress {
        SharedProgress(Arc::new(self.clone()))
    }

    pub(super) fn say(&self, kind: u8, parts: &[&[u8]]) {
        let mut to = self.0.to.lock().unwrap_or_else(PoisonError::into_inner);
        // Nobody is left to tell when the program is gone.
        let _ = send(&mut **to, kind, parts);
    }

    /// Ends the frame that is rendered, or that is about to be.
    fn end_frame(&self) {
        self.0.ends.store(true, Ordering::Release);
        self.pass_end_on();
    }

    /// Changes the order of the buckets of the frame that is rendered, or that is about to be.
    fn set_priority(&self, request: PriorityRequest) {
        *lock(&self.0.request) = Some(request);
        self.apply_request();
    }

    fn apply_request(&self) {
        let request = *lock(&self.0.request);
        if let (Some(request), Some(priority)) = (request, &*lock(&self.0.priority)) {
            request.apply(priority);
        }
    }

    fn pass_end_on(&self) {
        let stop = self.0.stop.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(stop) = stop.as_ref().filter(|_| self.0.ends.load(Ordering::Acquire)) {
            stop.store(true, Ordering::Relaxed);
        }
    }
}

/// Whole frames, which `granita_pyg::serve` makes.
impl Write for Told {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let mut to = self.0.to.lock().unwrap_or_else(PoisonError::into_inner);
        to.write_all(bytes)?;
        to.flush()?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Progress for Told {
    fn begin(&self, total: u64) {
        self.0.total.store(total, Ordering::Relaxed);
        self.0.share.store(0, Ordering::Relaxed);
        self.pass_end_on();
        // What was requested before the frame began was forgotten then.
        self.apply_request();
    }

    fn done(&self, steps: u64) {
        let total = self.0.total.load(Ordering::Relaxed).max(1);
        let share = (steps as f64 / total as f64 * 256.0) as u64;
        if self.0.share.fetch_max(share, Ordering::Relaxed) < share {
            self.say(b'R', &[&(share as f32 / 256.0).to_le_bytes()]);
        }
    }

    fn end(&self) {}
}

/// The frames of calls, in the order in which they came.
struct Queue {
    frames: Receiver<Vec<u8>>,
    frame: Vec<u8>,
    read: usize,
    gone: Arc<AtomicBool>,
}

impl Read for Queue {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        while self.read == self.frame.len() {
            match self.frames.recv() {
                Ok(frame) if !self.gone.load(Ordering::Acquire) => (self.frame, self.read) = (frame, 0),
                _ => return Ok(0),
            }
        }
        let n = into.len().min(self.frame.len() - self.read);
        into[..n].copy_from_slice(&self.frame[self.read..self.read + n]);
        self.read += n;
        Ok(n)
    }
}

/// Sorts what comes: what cannot wait, and the rest.
fn sort(mut input: Box<dyn Read + Send>, frames: &SyncSender<Vec<u8>>, told: &Told, gone: &AtomicBool) {
    loop {
        match receive(&mut *input) {
            Ok((b'X', _)) => told.end_frame(),
            Ok((b'P', payload)) => {
                if let Some(request) = PriorityRequest::from_bytes(&payload) {
                    told.set_priority(request);
                }
            }
            Ok((b'Z', _)) => return,
            Ok((kind, payload)) => {
                let mut frame = Vec::with_capacity(payload.len() + 5);
                // A vector takes everything.
                let _ = send(&mut frame, kind, &[&payload]);
                if frames.send(frame).is_err() {
                    return;
                }
            }
            Err(_) => {
                gone.store(true, Ordering::Release);
                return told.end_frame();
            }
        }
    }
}

/// The session's state, whose frames are told of.
struct Watched<'a> {
    state: &'a mut State,
    told: &'a Told,
}

impl SceneSink for Watched<'_> {
    fn call(&mut self, call: Call, at: &Location) -> Result<(), Stop> {
        let renders = matches!(call, Call::Render { .. });
        let done = self.state.call(call, at);
        if renders {
            self.told.0.ends.store(false, Ordering::Release);
            *lock(&self.told.0.request) = None;
            self.told.say(b'D', &[]);
        }
        done
    }

    fn new_frame(&mut self) -> bool {
        self.state.new_frame()
    }

    fn in_world(&self) -> bool {
        self.state.in_world()
    }

    fn attribute(&self, declaration: &str) -> Option<Param> {
        self.state.attribute(declaration)
    }
}

impl Session {
    /// Takes calls from the program at the other end of a connection until it wants no more, then ends. The session's
    /// reporter and progress are those of `told`.
    pub fn obey(mut self, input: Box<dyn Read + Send>, told: &Told) -> Outcome {
        *told.0.stop.lock().unwrap_or_else(PoisonError::into_inner) = Some(self.stop());
        *lock(&told.0.priority) = Some(self.priority());
        let images = told.clone();
        self.plugins()
            .set_program_images(Arc::new(move |address| Arc::new(Forwarded::new(&images, address))));
        let (sender, frames) = sync_channel(QUEUE);
        let gone = Arc::new(AtomicBool::new(false));
        let (sorter, flag) = (told.clone(), gone.clone());
        let started = std::thread::Builder::new()
            .name("remote".to_owned())
            .spawn(move || sort(input, &sender, &sorter, &flag));
        let reporter = self.reporter();
        if let Err(error) = started {
            reporter.error(format!("no thread can be started: {error}"));
            return self.finish();
        }
        let mut queue = Queue { frames, frame: Vec::new(), read: 0, gone };
        let mut watched = Watched { state: self.state(), told };
        match granita_pyg::serve(&mut queue, &mut told.clone(), &mut watched, &reporter) {
            Ok(()) | Err(granita_pyg::PygError::Stopped(Stop::Exit)) => {}
            Err(error) => reporter.error(error.to_string()),
        }
        self.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_counts_for_the_frame_that_was_asked_for() {
        let told = Told::new(Box::new(std::io::sink()));
        let priority = Arc::new(Priority::default());
        *lock(&told.0.priority) = Some(priority.clone());
        let (sender, frames) = sync_channel(QUEUE);
        let mut input = Vec::new();
        for request in [PriorityRequest::Center([7, 9]), PriorityRequest::Rectangle([1, 2, 3, 4])] {
            send(&mut input, b'P', &[&request.to_bytes()]).unwrap();
        }
        send(&mut input, b'P', &[b"123"]).unwrap();
        send(&mut input, b'W', &[]).unwrap();
        send(&mut input, b'Z', &[]).unwrap();
        sort(Box::new(std::io::Cursor::new(input)), &sender, &told, &AtomicBool::new(false));
        // It does not stand in line behind calls.
        assert_eq!(frames.try_iter().count(), 1);
        let rectangle = granita_render::PixelRect { x0: 1, y0: 2, x1: 4, y1: 5 };
        assert_eq!(priority.current(), (Some([7, 9]), Some(rectangle)));
        // A frame that begins forgets what was requested before, but not what was requested for it.
        let forgotten = Arc::new(Priority::default());
        *lock(&told.0.priority) = Some(forgotten.clone());
        told.begin(10);
        assert_eq!(forgotten.current(), (None, Some(rectangle)));
    }
}
