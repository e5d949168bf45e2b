//! The renderer's reports to its program.

use super::GREETING;
use crate::SharedProgress;
use crate::commands::PriorityRequest;
use crate::connection::{Connection, message_bytes};
use crate::patient::PULSE;
use granita_base::Reporter;
use granita_base::report::VERBOSITY_INFO;
use granita_render::{Priority, Progress};
use parking_lot::Mutex;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Sends messages, progress and answers to the program. Clones share the connection.
#[derive(Clone)]
pub struct Told(Arc<Inner>);

struct Inner {
    to: Connection,
    /// The number of steps of the frame.
    total: AtomicU64,
    /// The last reported progress, in 256ths.
    share: AtomicU64,
    /// True when the program requested the end of its frame.
    ends: AtomicBool,
    /// The flag that ends the session's frames; `None` before [`Session::obey`](crate::Session::obey).
    stop: Mutex<Option<Arc<AtomicBool>>>,
    /// The priority of the session's buckets; `None` before [`Session::obey`](crate::Session::obey).
    priority: Mutex<Option<Arc<Priority>>>,
    /// The requested priority for the frame of the program.
    request: Mutex<Option<PriorityRequest>>,
}

impl std::fmt::Debug for Told {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Told")
    }
}

impl Told {
    /// Connects and sends the greeting.
    pub fn new(to: Box<dyn Write + Send>) -> Self {
        let told = Self(Arc::new(Inner {
            to: Connection::new(to),
            total: AtomicU64::new(0),
            share: AtomicU64::new(0),
            ends: AtomicBool::new(false),
            stop: Mutex::default(),
            priority: Mutex::default(),
            request: Mutex::default(),
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

    /// Returns the stream to the program.
    pub(super) fn connection(&self) -> &Connection {
        &self.0.to
    }

    /// Returns the reporter of the session. It sends all messages, because the program applies its own verbosity.
    pub fn reporter(&self) -> Reporter {
        let told = self.clone();
        let reporter = Reporter::new(Box::new(move |message| told.say(b'M', &[&message_bytes(message)])));
        reporter.set_verbosity(VERBOSITY_INFO);
        reporter
    }

    /// Returns the progress receiver of the session.
    pub fn progress(&self) -> SharedProgress {
        SharedProgress(Arc::new(self.clone()))
    }

    pub(super) fn say(&self, kind: u8, parts: &[&[u8]]) {
        self.0.to.say(kind, parts);
    }

    /// Sets the flag that ends the session's frames.
    pub(super) fn set_stop(&self, stop: Arc<AtomicBool>) {
        *self.0.stop.lock() = Some(stop);
    }

    /// Sets the priority of the buckets of the session's frames.
    pub(super) fn set_frame_priority(&self, priority: Arc<Priority>) {
        *self.0.priority.lock() = Some(priority);
    }

    /// Drops the requests for a frame that has ended.
    pub(super) fn forget_requests(&self) {
        self.0.ends.store(false, Ordering::Release);
        *self.0.request.lock() = None;
    }

    /// Ends the current or the next frame.
    pub(super) fn end_frame(&self) {
        self.0.ends.store(true, Ordering::Release);
        self.pass_end_on();
    }

    /// Changes the order of the buckets of the current or the next frame.
    pub(super) fn set_priority(&self, request: PriorityRequest) {
        *self.0.request.lock() = Some(request);
        self.apply_request();
    }

    fn apply_request(&self) {
        let request = *self.0.request.lock();
        if let (Some(request), Some(priority)) = (request, &*self.0.priority.lock()) {
            request.apply(priority);
        }
    }

    fn pass_end_on(&self) {
        let stop = self.0.stop.lock();
        if let Some(stop) = stop.as_ref().filter(|_| self.0.ends.load(Ordering::Acquire)) {
            stop.store(true, Ordering::Relaxed);
        }
    }
}

/// Receives whole frames, which `granita_pyg::serve` makes.
impl Write for Told {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.to.clone().write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Progress for Told {
    fn begin(&self, _: &Path, total: u64) {
        self.0.total.store(total, Ordering::Relaxed);
        self.0.share.store(0, Ordering::Relaxed);
        self.pass_end_on();
        // Requests from before the frame were dropped when it began.
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
