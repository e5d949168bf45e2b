//! A progress bar, and messages that do not break it.

use granita_base::Reporter;
use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Returns the estimated remaining time at the current speed, such as "1 min 20 s". `None` at the beginning, when
/// there is too little data, and at the end.
pub fn time_left(elapsed: Duration, done: u64, total: u64) -> Option<String> {
    if done == 0 || done >= total || elapsed < Duration::from_millis(500) {
        return None;
    }
    let seconds = elapsed.as_secs_f64() * (total - done) as f64 / done as f64;
    Some(match seconds {
        s if s < 99.5 => format!("{:.0} s", s.max(1.0)),
        s if s < 3600.0 => {
            // The estimate is not accurate to the second.
            let s = (s / 10.0).round() as u64 * 10;
            format!("{} min {} s", s / 60, s % 60)
        }
        s => {
            let minutes = (s / 60.0).round() as u64;
            format!("{} h {} min", minutes / 60, minutes % 60)
        }
    })
}

/// The bars of one tool. They are not drawn when standard error is not a terminal.
#[derive(Clone, Debug)]
pub struct Bar {
    all: MultiProgress,
    bar: ProgressBar,
    muted: Arc<AtomicBool>,
}

impl Default for Bar {
    fn default() -> Self {
        Self::new(true)
    }
}

impl Bar {
    /// Returns a bar that is not shown yet. It is never shown when `visible` is false.
    pub fn new(visible: bool) -> Self {
        let target =
            if visible { ProgressDrawTarget::stderr_with_hz(10) } else { ProgressDrawTarget::hidden() };
        Self {
            all: MultiProgress::with_draw_target(target),
            bar: ProgressBar::hidden(),
            muted: Arc::default(),
        }
    }

    /// Begins to show `total` steps of `what`.
    pub fn begin(&mut self, what: &str, total: u64) {
        let style = ProgressStyle::with_template("{msg} [{bar:40}] {percent:>3} % {elapsed}{left}")
            .unwrap_or_else(|_| ProgressStyle::default_bar())
            .with_key("left", |state: &ProgressState, out: &mut dyn fmt::Write| {
                if let Some(left) = time_left(state.elapsed(), state.pos(), state.len().unwrap_or(0)) {
                    // An error of writing to the terminal is ignored.
                    let _ = write!(out, ", about {left} left");
                }
            });
        self.bar = self.all.add(
            ProgressBar::new(total).with_style(style.progress_chars("=> ")).with_message(what.to_owned()),
        );
        self.bar.enable_steady_tick(Duration::from_millis(250));
    }

    /// True when the bar can be visible, which requires that standard error is a terminal.
    pub fn is_shown(&self) -> bool {
        !self.all.is_hidden()
    }

    /// Sets the number of steps that are done.
    pub fn done(&self, steps: u64) {
        self.bar.set_position(steps);
    }

    /// Removes the bar.
    pub fn end(&self) {
        self.bar.finish_and_clear();
    }

    /// Removes all bars and their line from the terminal, for good. Threads that still make progress draw nothing.
    pub fn close(&self) {
        // An error of writing to the terminal is ignored.
        let _ = self.all.clear();
        self.all.set_draw_target(ProgressDrawTarget::hidden());
    }

    /// Suppresses further warnings and errors, because failures caused by ending the tool are not of interest.
    pub fn mute(&self) {
        self.muted.store(true, Ordering::SeqCst);
    }

    /// Prints a line to standard error above the bar.
    pub fn line(&self, text: &str) {
        if self.muted.load(Ordering::SeqCst) {
            return;
        }
        if self.all.is_hidden() {
            use std::io::Write;
            // An error is ignored, because there is no output when standard error is closed.
            let _ = writeln!(std::io::stderr().lock(), "{text}");
        } else {
            let _ = self.all.println(text);
        }
    }
}

/// Returns a reporter that prints to the terminal, above `bar`. Messages go to standard output, and the rest to
/// standard error after the tool's name. Messages for a closed pipe are dropped.
pub fn console_reporter(tool: &'static str, bar: &Bar) -> Reporter {
    reporter_with(tool, bar, crate::print_or_drop)
}

/// Does the same as [`console_reporter`], with messages passed to `say` instead of standard output.
pub fn reporter_with(tool: &'static str, bar: &Bar, say: impl Fn(&str) + Send + Sync + 'static) -> Reporter {
    let bar = bar.clone();
    Reporter::new(Box::new(move |message| {
        if message.severity == granita_base::Severity::Message {
            bar.all.suspend(|| say(&message.text));
        } else {
            bar.line(&format!("{tool}: {message}"));
        }
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_remaining_time_is_estimated() {
        let left = |ms: u64, done, total| time_left(Duration::from_millis(ms), done, total);
        assert_eq!(left(1000, 0, 10), None);
        assert_eq!(left(100, 1, 10), None);
        assert_eq!(left(1000, 10, 10), None);
        assert_eq!(left(1000, 1, 0), None);
        assert_eq!(left(1000, 1, 11).as_deref(), Some("10 s"));
        assert_eq!(left(1000, 1000, 1001).as_deref(), Some("1 s"));
        assert_eq!(left(10_000, 1, 13).as_deref(), Some("2 min 0 s"));
        assert_eq!(left(60_000, 1, 126).as_deref(), Some("2 h 5 min"));
        assert!(left(u64::MAX, 1, u64::MAX).is_some());
    }
}
