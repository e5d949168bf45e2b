//! How a run ends before its time: by a signal, by `-timeout`, or because the program that it works for is gone.

use crate::{Bar, Status, before_signals, leave, when_caller_is_gone};
use granita_base::{Reporter, Supervisor};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

/// How long a run may take to end in an orderly way once its time is over.
const GRACE: Duration = Duration::from_secs(2);

/// Ends a run and the processes that it started; clones end the same run.
#[derive(Clone)]
pub struct Ending {
    supervisor: Supervisor,
    bar: Bar,
    /// Ends the frame that is rendered, once there is a session.
    stop: Arc<OnceLock<Arc<AtomicBool>>>,
    /// The time is over.
    late: Arc<AtomicBool>,
}

impl Ending {
    /// Ends a run whose progress `bar` shows.
    pub fn new(bar: Bar) -> Self {
        Self { supervisor: Supervisor::default(), bar, stop: Arc::default(), late: Arc::default() }
    }

    /// Returns what starts and knows the processes of the run.
    pub fn supervisor(&self) -> &Supervisor {
        &self.supervisor
    }

    /// Sets the flag that stops the frame that is rendered.
    pub fn stops(&self, stop: Arc<AtomicBool>) {
        let _ = self.stop.set(stop);
    }

    /// Returns true once the time of [`Ending::limit`] was over.
    pub fn is_late(&self) -> bool {
        self.late.load(Ordering::SeqCst)
    }

    /// What is done before the process ends while its threads still run. This is the place for everything that must not be left
    /// behind.
    fn tidy(&self) {
        self.bar.mute();
        self.supervisor.end();
        granita_base::files::remove_unfinished();
    }

    /// Ends the run on signals, and with `caller` when the program that this one works for is gone.
    pub fn watch(&self, caller: bool, reporter: &Reporter) {
        let warn = |error: std::io::Error| reporter.warning(format!("signals are not watched: {error}"));
        let ending = self.clone();
        before_signals(move || ending.tidy()).unwrap_or_else(warn);
        if caller {
            let ending = self.clone();
            let gone = move || {
                ending.tidy();
                leave(Status::WithErrors)
            };
            when_caller_is_gone(gone).unwrap_or_else(warn);
        }
    }

    /// Ends the run after so many seconds: reports an error that names what is running, ends the processes, stops the frame, and
    /// leaves two seconds later with [`Status::WithErrors`].
    pub fn limit(&self, seconds: f64, reporter: &Reporter) {
        let (ending, reporter) = (self.clone(), reporter.clone());
        std::thread::spawn(move || {
            // Longer than anything lasts when it cannot be expressed.
            std::thread::sleep(Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX));
            let running = ending.supervisor.running().join(", ");
            let running = if running.is_empty() { "starting or ending".to_owned() } else { running };
            ending.late.store(true, Ordering::SeqCst);
            reporter.error(format!("-timeout: {seconds} s are over while {running}"));
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
/// Anything but a finite number above 0.
pub fn seconds(word: &str) -> Result<f64, String> {
    match word.parse::<f64>() {
        Ok(seconds) if seconds > 0.0 && seconds.is_finite() => Ok(seconds),
        _ => Err("expected a number of seconds, more than 0".to_owned()),
    }
}
