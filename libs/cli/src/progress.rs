//! A progress bar, and messages that do not tear it apart.

use granita_base::Reporter;
use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::time::Duration;

/// The bars of one tool. Draws nothing when standard error is not a terminal.
#[derive(Clone, Debug)]
pub struct Bar {
    all: MultiProgress,
    bar: ProgressBar,
}

impl Default for Bar {
    fn default() -> Self {
        Self::new(true)
    }
}

impl Bar {
    /// A bar that is not yet shown; never shown when `visible` is false.
    pub fn new(visible: bool) -> Self {
        let target =
            if visible { ProgressDrawTarget::stderr_with_hz(10) } else { ProgressDrawTarget::hidden() };
        Self { all: MultiProgress::with_draw_target(target), bar: ProgressBar::hidden() }
    }

    /// Starts to show `total` steps of `what`.
    pub fn begin(&mut self, what: &str, total: u64) {
        let style =
            ProgressStyle::with_template("{msg} [{bar:40}] {percent:>3}% {elapsed} (about {eta} left)")
                .unwrap_or_else(|_| ProgressStyle::default_bar());
        self.bar = self.all.add(
            ProgressBar::new(total).with_style(style.progress_chars("=> ")).with_message(what.to_owned()),
        );
        self.bar.enable_steady_tick(Duration::from_millis(250));
    }

    /// So many steps are done.
    pub fn done(&self, steps: u64) {
        self.bar.set_position(steps);
    }

    /// Takes the bar away.
    pub fn end(&self) {
        self.bar.finish_and_clear();
    }

    /// Prints a line to standard error above the bar.
    fn line(&self, text: &str) {
        if self.all.is_hidden() {
            use std::io::Write;
            // Nobody is left to tell when standard error is closed.
            let _ = writeln!(std::io::stderr().lock(), "{text}");
        } else {
            let _ = self.all.println(text);
        }
    }
}

/// A reporter that prints to the terminal, above `bar`: messages to standard output, the rest to standard
/// error behind the tool's name.
pub fn console_reporter(tool: &'static str, bar: &Bar) -> Reporter {
    reporter_with(tool, bar, crate::print)
}

/// As [`console_reporter`], with messages to `say` instead of standard output.
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
