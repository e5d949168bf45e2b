//! The progress of each image: on a terminal a bar, and then the name of the file; lines of information
//! (`-verbosity 2`) without one.

use granita_base::Reporter;
use granita_base::report::{VERBOSITY_INFO, VERBOSITY_NORMAL, printable};
use granita_cli::{Bar, time_left};
use granita_render::Progress;
use parking_lot::{Mutex, MutexGuard};
use std::path::Path;
use std::time::Instant;

/// The distance of progress lines, in percent.
const STEP_PERCENT: u64 = 10;

/// Shows a frame's progress with an estimate of the time that is left.
pub(crate) struct ShownProgress {
    reporter: Reporter,
    shown: Mutex<Shown>,
}

struct Shown {
    bar: Bar,
    begin: Instant,
    total: u64,
    done: u64,
    /// The progress of the last line, in percent, rounded down to [`STEP_PERCENT`].
    told: u64,
}

/// Returns a text that fits before a bar.
fn one_line(text: &str) -> String {
    printable(text).replace(['\n', '\t'], " ").trim_end().to_owned()
}

impl ShownProgress {
    pub(crate) fn new(bar: Bar, reporter: Reporter) -> Self {
        let shown = Shown { bar, begin: Instant::now(), total: 0, done: 0, told: 0 };
        Self { reporter, shown: Mutex::new(shown) }
    }

    fn shown(&self) -> MutexGuard<'_, Shown> {
        self.shown.lock()
    }
}

impl Progress for ShownProgress {
    fn begin(&self, image: &Path, total: u64) {
        let mut shown = self.shown();
        (shown.begin, shown.total, shown.done, shown.told) = (Instant::now(), total, 0, 0);
        let name = image.file_name().unwrap_or_default().to_string_lossy();
        shown.bar.begin(&one_line(&format!("rendering {name}")), total);
    }

    fn done(&self, steps: u64) {
        let mut shown = self.shown();
        // Threads do not arrive here in the order in which they counted their steps.
        shown.done = shown.done.max(steps);
        shown.bar.done(shown.done);
        let percent = (u128::from(shown.done) * 100 / u128::from(shown.total.max(1))) as u64;
        if shown.bar.is_shown()
            || percent < shown.told + STEP_PERCENT
            || percent == 100
            || self.reporter.verbosity() < VERBOSITY_INFO
        {
            return;
        }
        shown.told = percent / STEP_PERCENT * STEP_PERCENT;
        let left = time_left(shown.begin.elapsed(), shown.done, shown.total);
        let left = left.map(|left| format!(", about {left} left")).unwrap_or_default();
        self.reporter.info(format!("{percent} % rendered{left}"));
    }

    fn end(&self) {
        let shown = self.shown();
        shown.bar.end();
        let seconds = shown.begin.elapsed().as_secs_f64();
        self.reporter.info(format!("rendered in {seconds:.1} s"));
    }

    fn wrote(&self, path: &Path) {
        let shown = self.shown();
        if shown.bar.is_shown() && self.reporter.verbosity() >= VERBOSITY_NORMAL {
            shown.bar.line(&one_line(&format!("wrote {}", path.display())));
        }
    }
}
