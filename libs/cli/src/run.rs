//! Early ends of a run: by a signal, by `-timeout`, or because the program that it works for is gone.

use crate::ending::next_signal;
use crate::ending::when_parent_is_gone;
use crate::{Bar, Status, before_signals, leave, when_caller_is_gone};
use granita_base::{Reporter, Supervisor};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// The time that a run has for an orderly end after its time limit.
const GRACE: Duration = Duration::from_secs(2);

/// The longest time that a frame has for writing its partial images.
const KEEPING: Duration = Duration::from_secs(60);

/// Ends a run and the processes that it started. Clones end the same run.
#[derive(Clone)]
pub struct Ending {
    supervisor: Supervisor,
    bar: Bar,
    /// The flag that ends the current frame, once there is a session.
    stop: Arc<OnceLock<Arc<AtomicBool>>>,
    /// The flag that is true during a frame whose images are kept when it is ended early.
    busy: Arc<OnceLock<Arc<AtomicBool>>>,
    /// True when the time limit was exceeded.
    late: Arc<AtomicBool>,
}

impl Ending {
    /// Returns the ending of a run whose progress `bar` shows.
    pub fn new(bar: Bar) -> Self {
        Self {
            supervisor: Supervisor::default(),
            bar,
            stop: Arc::default(),
            busy: Arc::default(),
            late: Arc::default(),
        }
    }

    /// Returns the supervisor, which starts and stores the processes of the run.
    pub fn supervisor(&self) -> &Supervisor {
        &self.supervisor
    }

    /// Sets the flag that stops the current frame.
    pub fn stops(&self, stop: Arc<AtomicBool>) {
        let _ = self.stop.set(stop);
    }

    /// Makes the end of the run wait while `busy` is true, which it is during a frame that keeps its images when it is
    /// stopped. A minute is the limit, and a second signal ends the run at once.
    pub fn keeps(&self, busy: Arc<AtomicBool>) {
        let _ = self.busy.set(busy);
    }

    /// Stops the frame that keeps its images, if there is one, and waits for it.
    fn keep(&self) {
        let Some(busy) = self.busy.get() else { return };
        // No other frame begins after this. The flag comes first, because a frame that begins resets `stop`.
        self.supervisor.close();
        if let Some(stop) = self.stop.get() {
            stop.store(true, Ordering::SeqCst);
        }
        let (again, begin) = (next_signal(), Instant::now());
        while busy.load(Ordering::SeqCst) && !again.load(Ordering::SeqCst) && begin.elapsed() < KEEPING {
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Returns true after the time of [`Ending::limit`] was exceeded.
    pub fn is_late(&self) -> bool {
        self.late.load(Ordering::SeqCst)
    }

    /// Cleans up before the process ends, while its threads still run. Everything that must not be left behind is
    /// removed here.
    fn tidy(&self) {
        self.keep();
        self.bar.mute();
        self.supervisor.end();
        granita_base::files::remove_unfinished();
    }

    /// True when a frame is rendered whose images are kept.
    fn is_keeping(&self) -> bool {
        self.busy.get().is_some_and(|busy| busy.load(Ordering::SeqCst))
    }

    /// Ends the run with the process that started this one.
    pub fn watch_parent(&self, reporter: &Reporter) {
        let ending = self.clone();
        let gone = move || {
            ending.tidy();
            leave(Status::WithErrors)
        };
        let warn = |error: std::io::Error| reporter.warning(format!("the parent cannot be watched: {error}"));
        when_parent_is_gone(gone).unwrap_or_else(warn);
    }

    /// Ends the run on signals and, when `caller` is true, when the program that it works for is gone.
    pub fn watch(&self, caller: bool, reporter: &Reporter) {
        let warn = |error: std::io::Error| reporter.warning(format!("signals cannot be handled: {error}"));
        let (ending, messages) = (self.clone(), reporter.clone());
        let end = move || {
            // On a terminal the prompt follows, on a line of its own.
            if ending.bar.is_shown() {
                ending.bar.close();
                messages.error(match ending.is_keeping() {
                    true => "ended by a signal; the frame is kept as partial images (a second signal ends at once)",
                    false => "ended by a signal; unfinished files are removed",
                });
            }
            ending.tidy();
        };
        before_signals(end).unwrap_or_else(warn);
        if caller {
            let ending = self.clone();
            let gone = move || {
                ending.tidy();
                leave(Status::WithErrors)
            };
            when_caller_is_gone(gone).unwrap_or_else(warn);
        }
    }

    /// Ends the run after so many seconds. It reports an error that names the current activities, ends the processes,
    /// stops the frame, and leaves two seconds later with [`Status::WithErrors`]. With [`Ending::keeps`] the frame is
    /// stopped first.
    pub fn limit(&self, seconds: f64, reporter: &Reporter) {
        let (ending, reporter) = (self.clone(), reporter.clone());
        std::thread::spawn(move || {
            // A time that cannot be expressed is replaced by the largest one.
            std::thread::sleep(Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX));
            let running = ending.supervisor.running().join(", ");
            let running = if running.is_empty() { "starting or ending".to_owned() } else { running };
            ending.late.store(true, Ordering::SeqCst);
            reporter.error(format!("-timeout: the limit of {seconds} s was exceeded while {running}"));
            ending.tidy();
            if let Some(stop) = ending.stop.get() {
                stop.store(true, Ordering::SeqCst);
            }
            std::thread::sleep(GRACE);
            leave(Status::WithErrors)
        });
    }
}

/// Reads the value of a `-timeout` option.
///
/// # Errors
/// An error for anything but a finite number above 0.
pub fn seconds(word: &str) -> Result<f64, String> {
    match word.parse::<f64>() {
        Ok(seconds) if seconds > 0.0 && seconds.is_finite() => Ok(seconds),
        _ => Err("expected a number of seconds, more than 0".to_owned()),
    }
}
