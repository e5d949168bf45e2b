//! Mistakes of a file, gathered by kind: one message for each kind, with the first place and how many more there are.

use granita_base::{Location, Reporter, Severity};
use std::sync::Arc;

/// Gathers, and tells when dropped, in the order in which the kinds were first seen.
pub(crate) struct Faults<'a> {
    reporter: &'a Reporter,
    file: Arc<str>,
    kinds: Vec<Fault>,
}

struct Fault {
    kind: &'static str,
    severity: Severity,
    line: u32,
    text: String,
    more: u64,
}

impl<'a> Faults<'a> {
    pub(crate) fn new(reporter: &'a Reporter, file: Arc<str>) -> Self {
        Self { reporter, file, kinds: Vec::new() }
    }

    /// Something is left out or replaced. `line` is 0 where there are none; `text` is made for the first of its kind only.
    pub(crate) fn error(&mut self, kind: &'static str, line: u32, text: impl FnOnce() -> String) {
        self.add(Severity::Error, kind, line, text);
    }

    /// Something is perhaps not as the user thinks.
    pub(crate) fn warning(&mut self, kind: &'static str, line: u32, text: impl FnOnce() -> String) {
        self.add(Severity::Warning, kind, line, text);
    }

    fn add(&mut self, severity: Severity, kind: &'static str, line: u32, text: impl FnOnce() -> String) {
        match self.kinds.iter_mut().find(|f| f.kind == kind) {
            Some(fault) => fault.more += 1,
            None => self.kinds.push(Fault { kind, severity, line, text: text(), more: 0 }),
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
    }
}

/// ` (object "name")`, or nothing.
pub(crate) fn of_object(name: &str) -> String {
    if name.is_empty() { String::new() } else { format!(" (object \"{name}\")") }
}
