//! How a run ends before its time: by a signal, by `-timeout`, or because the program that it works for is gone.

use granita_base::{Reporter, Supervisor};
use granita_cli::{Bar, Status};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

/// How long a run may take to end in an orderly way once its time is over.
const GRACE: Duration = Duration::from_secs(2);

/// Ends runs; clones end the same one.
#[derive(Clone)]
pub(crate) struct Ending {
    supervisor: Supervisor,
    bar: Bar,
    /// Ends the frame that is rendered, once there is a session.
    stop: Arc<OnceLock<Arc<AtomicBool>>>,
    /// The time is over.
    late: Arc<AtomicBool>,
}

impl Ending {
    pub(crate) fn new(bar: Bar) -> Self {
        Self { supervisor: Supervisor::default(), bar, stop: Arc::default(), late: Arc::default() }
    }

    /// Knows the processes that the run started.
    pub(crate) fn supervisor(&self) -> &Supervisor {
        &self.supervisor
    }

    /// What stops the frame that is rendered.
    pub(crate) fn stops(&self, stop: Arc<AtomicBool>) {
        let _ = self.stop.set(stop);
    }

    /// Whether the time was over.
    pub(crate) fn is_late(&self) -> bool {
        self.late.load(Ordering::SeqCst)
    }

    /// What is done before the process ends while its threads still run. This is the place for everything that must not be left
    /// behind.
    fn tidy(&self) {
        self.bar.mute();
        self.supervisor.end();
        granita_base::files::remove_unfinished();
    }

    /// Watches signals, and with `caller` the program that this one works for.
    pub(crate) fn watch(&self, caller: bool, reporter: &Reporter) {
        let warn = |error: std::io::Error| reporter.warning(format!("signals are not watched: {error}"));
        let ending = self.clone();
        granita_cli::before_signals(move || ending.tidy()).unwrap_or_else(warn);
        if caller {
            let ending = self.clone();
            let gone = move || {
                ending.tidy();
                granita_cli::leave(Status::WithErrors)
            };
            granita_cli::when_caller_is_gone(gone).unwrap_or_else(warn);
        }
    }

    /// Ends the run after so many seconds.
    pub(crate) fn limit(&self, seconds: f64, reporter: &Reporter) {
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
            granita_cli::leave(Status::WithErrors)
        });
    }
}
