//! The progress of each image: on a terminal a bar, and then the name of the file; lines of information
//! (`-verbosity 2`) without one.

use granita_base::Reporter;
use granita_base::report::{VERBOSITY_INFO, VERBOSITY_NORMAL, printable};
use granita_cli::{Bar, time_left};
use granita_render::Progress;
use parking_lot::{Mutex, MutexGuard};
use std::io::Write;
use std::path::Path;
use std::time::Instant;

/// The distance of progress lines, in percent.
const STEP_PERCENT: u64 = 10;

/// The distance of lines for an engine, in percent.
const LINE_PERCENT: u64 = 2;

/// Lines of progress for an engine, on standard output.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Lines {
    /// What stands before and after the number of percent; `None` for no lines.
    around: Option<[&'static str; 2]>,
    /// The percent that were done before, and the part of this process.
    share: [f64; 2],
}

impl Lines {
    /// Returns the lines of a style: "percent" or "openjd". `share` is the percent that were done before and the part
    /// of this process; empty for the whole.
    pub(crate) fn new(style: Option<&str>, share: &[f64]) -> Self {
        let around = style.map(|style| match style {
            "openjd" => ["openjd_progress: ", ""],
            _ => ["progress: ", " %"],
        });
        let share = <[f64; 2]>::try_from(share).unwrap_or([0.0, 100.0]);
        Self { around, share }
    }

    /// Returns the line for a part of the work of this process, from 0 to 1.
    fn line(&self, part: f64) -> Option<String> {
        let [before, after] = self.around?;
        Some(format!("{before}{:.0}{after}\n", self.share[0] + self.share[1] * part))
    }

    /// Prints the line for a part of the work of this process, from 0 to 1.
    pub(crate) fn print(&self, part: f64) {
        if let Some(line) = self.line(part) {
            // An engine that does not read loses the progress, and nothing else.
            let _ = std::io::stdout().write_all(line.as_bytes()).and_then(|()| std::io::stdout().flush());
        }
    }
}

/// Shows a frame's progress with an estimate of the time that is left.
pub(crate) struct ShownProgress {
    reporter: Reporter,
    lines: Lines,
    shown: Mutex<Shown>,
}

struct Shown {
    bar: Bar,
    begin: Instant,
    total: u64,
    done: u64,
    /// The progress of the last line, in percent, rounded down to [`STEP_PERCENT`].
    told: u64,
    /// The progress of the last line for an engine, in percent.
    lined: u64,
}

/// Returns a text that fits before a bar.
fn one_line(text: &str) -> String {
    printable(text).replace(['\n', '\t'], " ").trim_end().to_owned()
}

impl ShownProgress {
    pub(crate) fn new(bar: Bar, reporter: Reporter, lines: Lines) -> Self {
        let shown = Shown { bar, begin: Instant::now(), total: 0, done: 0, told: 0, lined: 0 };
        Self { reporter, lines, shown: Mutex::new(shown) }
    }

    fn shown(&self) -> MutexGuard<'_, Shown> {
        self.shown.lock()
    }
}

impl Progress for ShownProgress {
    fn begin(&self, image: &Path, total: u64) {
        let mut shown = self.shown();
        (shown.begin, shown.total, shown.done) = (Instant::now(), total, 0);
        (shown.told, shown.lined) = (0, 0);
        let name = image.file_name().unwrap_or_default().to_string_lossy();
        shown.bar.begin(&one_line(&format!("rendering {name}")), total);
    }

    fn done(&self, steps: u64) {
        let mut shown = self.shown();
        // Threads do not arrive here in the order in which they counted their steps.
        shown.done = shown.done.max(steps);
        shown.bar.done(shown.done);
        let percent = (u128::from(shown.done) * 100 / u128::from(shown.total.max(1))) as u64;
        if percent >= shown.lined + LINE_PERCENT || percent == 100 && shown.lined < 100 {
            shown.lined = percent;
            self.lines.print(percent as f64 / 100.0);
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_have_the_style_of_their_engine_and_the_share_of_the_process() {
        let line = |style: Option<&str>, share: &[f64], part| Lines::new(style, share).line(part);
        assert_eq!(line(None, &[], 0.5), None);
        assert_eq!(line(Some("percent"), &[], 0.5).as_deref(), Some("progress: 50 %\n"));
        assert_eq!(line(Some("openjd"), &[50.0, 25.0], 1.0).as_deref(), Some("openjd_progress: 75\n"));
    }
}
