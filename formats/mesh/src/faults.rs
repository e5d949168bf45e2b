//! The errors of a file, collected by kind. There is one message for each kind, with the first position and the number
//! of further ones.

use granita_base::{Location, Reporter, Severity};
use std::borrow::Cow;
use std::sync::Arc;

/// The largest number of kinds that are reported separately. All others share one message.
const MOST_KINDS: usize = 40;

/// Collects errors, and reports them when dropped, in the order in which the kinds first occurred.
pub(crate) struct Faults<'a> {
    reporter: &'a Reporter,
    file: Arc<str>,
    kinds: Vec<Fault>,
    others: u64,
    /// The highest severity of these others.
    severity: Severity,
}

struct Fault {
    kind: Cow<'static, str>,
    severity: Severity,
    line: u32,
    text: String,
    more: u64,
}

impl<'a> Faults<'a> {
    pub(crate) fn new(reporter: &'a Reporter, file: Arc<str>) -> Self {
        Self { reporter, file, kinds: Vec::new(), others: 0, severity: Severity::Warning }
    }

    /// Adds an error, after which something is left out or replaced. `line` is 0 where there are no lines. `text` is
    /// called only for the first error of its kind.
    pub(crate) fn error(
        &mut self,
        kind: impl Into<Cow<'static, str>>,
        line: u32,
        text: impl FnOnce() -> String,
    ) {
        self.add(Severity::Error, kind.into(), line, text);
    }

    /// Adds a warning, when the result may differ from what the user expects.
    pub(crate) fn warning(&mut self, kind: &'static str, line: u32, text: impl FnOnce() -> String) {
        self.add(Severity::Warning, kind.into(), line, text);
    }

    fn add(&mut self, severity: Severity, kind: Cow<'static, str>, line: u32, text: impl FnOnce() -> String) {
        if let Some(fault) = self.kinds.iter_mut().find(|f| f.kind == kind) {
            fault.more += 1;
        } else if self.kinds.len() >= MOST_KINDS {
            self.others += 1;
            self.severity = self.severity.max(severity);
        } else {
            self.kinds.push(Fault { kind, severity, line, text: text(), more: 0 });
        }
    }
}

impl Drop for Faults<'_> {
    fn drop(&mut self) {
        for fault in &self.kinds {
            let more = match fault.more {
                0 => String::new(),
                n => format!("; {n} more of this kind"),
            };
            let at = Location::line(&self.file, fault.line);
            self.reporter.say(fault.severity, &at, format!("{}{more}", fault.text));
        }
        if self.others > 0 {
            let text = format!("{} more errors and warnings of other kinds", self.others);
            self.reporter.say(self.severity, &Location::line(&self.file, 0), text);
        }
    }
}

/// Returns ` (object "name")`, or an empty string.
pub(crate) fn of_object(name: &str) -> String {
    if name.is_empty() { String::new() } else { format!(" (object \"{name}\")") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn further_kinds_have_the_highest_of_their_severities() {
        for has_error in [false, true] {
            let (reporter, messages) = Reporter::collecting();
            let mut faults = Faults::new(&reporter, "a.obj".into());
            for kind in 0..MOST_KINDS {
                faults.error(kind.to_string(), 1, || "an error".to_owned());
            }
            faults.warning("a warning", 2, || unreachable!());
            if has_error {
                faults.error("one more", 3, || unreachable!());
            }
            drop(faults);
            let last = messages.lock().last().cloned().unwrap();
            let expected = if has_error { Severity::Error } else { Severity::Warning };
            assert_eq!(last.severity, expected, "{last}");
        }
    }
}
