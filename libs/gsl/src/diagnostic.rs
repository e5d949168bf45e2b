//! Errors in a source text, printed as compilers do, with position, message, the line and a caret.

use crate::source::{Pos, Sources};
use granita_base::{Location, Severity};
use std::collections::BTreeSet;
use std::fmt;

/// The largest number of errors that are shown. More end the parsing, and are counted.
const MAX_ERRORS: usize = 25;
/// The largest number of errors that are kept, of which the first ones in the source are shown.
const MAX_KEPT: usize = 1000;
/// The largest number of warnings that are shown. More are counted.
const MAX_WARNINGS: usize = 200;
/// The number of characters of a source line that are shown on either side of the caret.
const AROUND: usize = 90;

/// One error or warning about a source text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// [`Severity::Error`] or [`Severity::Warning`].
    pub severity: Severity,
    /// The file, the line and the column.
    pub at: Location,
    /// The message, in lower case, without a full stop.
    pub message: String,
    /// The source line of the error. For a very long line, it is the part around the error.
    pub line: Option<String>,
    /// The column of the caret in `line`, counted from 1 in characters.
    pub caret: u32,
    /// A hint for a correction, as ``did you mean `noise`?``.
    pub help: Option<String>,
}

impl fmt::Display for Diagnostic {
    /// Writes `file:line:column: error: message`, then the source line, a caret under the position, and the hint.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.at.is_known() {
            write!(f, "{}: ", self.at)?;
        }
        write!(f, "{}: {}", self.severity, self.message)?;
        if let Some(line) = &self.line {
            write!(f, "\n    {line}\n    ")?;
            let before = (self.caret.max(1) - 1) as usize;
            for c in line.chars().take(before) {
                f.write_str(if c == '\t' { "\t" } else { " " })?;
            }
            f.write_str("^")?;
        }
        if let Some(help) = &self.help {
            write!(f, "\n    {help}")?;
        }
        Ok(())
    }
}

/// Collects the diagnostics of one compilation. The same message is kept once per place.
#[derive(Debug, Default)]
pub(crate) struct Diagnostics {
    pub(crate) sources: Sources,
    list: Vec<(Pos, Diagnostic)>,
    errors: usize,
    warnings: usize,
    /// The files and lines with text that is not a token.
    doubtful: BTreeSet<(u16, u32)>,
}

impl Diagnostics {
    pub(crate) fn error(&mut self, pos: Pos, message: impl Into<String>) {
        self.add(Severity::Error, pos, message.into(), None);
    }

    pub(crate) fn error_help(&mut self, pos: Pos, message: impl Into<String>, help: Option<String>) {
        self.add(Severity::Error, pos, message.into(), help);
    }

    pub(crate) fn warning(&mut self, pos: Pos, message: impl Into<String>) {
        self.add(Severity::Warning, pos, message.into(), None);
    }

    pub(crate) fn warning_help(&mut self, pos: Pos, message: impl Into<String>, help: Option<String>) {
        self.add(Severity::Warning, pos, message.into(), help);
    }

    /// Keeps no further messages about a line, which has text that is not a token.
    pub(crate) fn doubt(&mut self, pos: Pos) {
        self.doubtful.insert((pos.file, pos.line));
    }

    fn add(&mut self, severity: Severity, pos: Pos, message: String, help: Option<String>) {
        if self.doubtful.contains(&(pos.file, pos.line))
            || self.list.iter().any(|(p, d)| *p == pos && d.message == message)
        {
            return;
        }
        if severity == Severity::Error {
            self.errors += 1;
            if self.errors > MAX_KEPT {
                return;
            }
        } else {
            self.warnings += 1;
            if self.warnings > MAX_WARNINGS {
                return;
            }
        }
        let (line, caret) = match self.sources.line_text(pos) {
            Some(line) => {
                let (line, caret) = excerpt(line.trim_end(), pos.column);
                (Some(line), caret)
            }
            None => (None, pos.column),
        };
        let at = self.sources.location(pos);
        self.list.push((pos, Diagnostic { severity, at, message, line, caret, help }));
    }

    pub(crate) fn has_errors(&self) -> bool {
        self.errors > 0
    }

    /// True when there are so many errors that compilation stops.
    pub(crate) fn is_full(&self) -> bool {
        self.errors > MAX_ERRORS
    }

    /// Returns the diagnostics in the order of the source, up to the largest number of errors.
    pub(crate) fn finish(mut self) -> Vec<Diagnostic> {
        self.list.sort_by_key(|(p, _)| *p);
        let mut list: Vec<Diagnostic> = self.list.into_iter().map(|(_, d)| d).collect();
        let mut errors = 0;
        list.retain(|d| {
            errors += usize::from(d.severity == Severity::Error);
            d.severity != Severity::Error || errors <= MAX_ERRORS
        });
        for (severity, word, count, max) in [
            (Severity::Warning, "warnings", self.warnings, MAX_WARNINGS),
            (Severity::Error, "errors", self.errors, MAX_ERRORS),
        ] {
            if count > max {
                let message = format!("too many {word}: {} more are not shown", count - max);
                let at = Location::default();
                list.push(Diagnostic { severity, at, message, line: None, caret: 0, help: None });
            }
        }
        list
    }
}

/// Returns the part of a line around a column (counted from 1), and the column in it.
fn excerpt(line: &str, column: u32) -> (String, u32) {
    let count = line.chars().count();
    if count <= 2 * AROUND {
        return (line.to_owned(), column);
    }
    let at = (column as usize).clamp(1, count) - 1;
    let (first, end) = (at.saturating_sub(AROUND), (at + AROUND).min(count));
    let (before, after) = (if first > 0 { "..." } else { "" }, if end < count { "..." } else { "" });
    let shown: String = line.chars().skip(first).take(end - first).collect();
    (format!("{before}{shown}{after}"), (at - first + before.len() + 1) as u32)
}

/// Returns the hint for an unknown name that is probably a misspelling of one of `candidates`.
pub(crate) fn suggestion<'a>(name: &str, candidates: impl Iterator<Item = &'a str>) -> Option<String> {
    granita_base::suggestion(name, candidates).map(|best| format!("did you mean `{best}`?"))
}
