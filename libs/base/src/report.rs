//! Messages for the user: sorted by severity, placed, and said once per cause.
//!
//! Libraries never print. They hand messages to a [`Reporter`]; the tool decides where they go.

use std::collections::HashSet;
use std::fmt;
use std::sync::atomic::{AtomicU8, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// How bad it is (reference 2.10).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Severity {
    /// Output that was asked for, as a shader's `printf`; always shown.
    Message,
    /// What is going on.
    Info,
    /// Perhaps a mistake; the work goes on as documented.
    Warning,
    /// A mistake; the work goes on with a substitute.
    Error,
    /// Nothing useful can come out.
    Severe,
}

impl fmt::Display for Severity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Message => "message",
            Self::Info => "info",
            Self::Warning => "warning",
            Self::Error => "error",
            Self::Severe => "severe error",
        })
    }
}

/// Where in the user's input something stands.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Location {
    /// File name, or what stands for one (`<string>`); empty when there is no place.
    pub file: Arc<str>,
    /// Line, counted from 1; 0 when unknown.
    pub line: u32,
    /// Column, counted from 1; 0 when unknown.
    pub column: u32,
}

impl Location {
    /// A line of a file.
    pub fn line(file: &Arc<str>, line: u32) -> Self {
        Self { file: file.clone(), line, column: 0 }
    }

    /// Whether it names any place at all.
    pub fn is_known(&self) -> bool {
        !self.file.is_empty()
    }
}

impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.file)?;
        if self.line > 0 {
            write!(f, ":{}", self.line)?;
            if self.column > 0 {
                write!(f, ":{}", self.column)?;
            }
        }
        Ok(())
    }
}

/// One message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// How bad.
    pub severity: Severity,
    /// Where; may be unknown.
    pub at: Location,
    /// What, in lower case, without a full stop.
    pub text: String,
}

impl fmt::Display for Message {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.severity == Severity::Message {
            return f.write_str(&self.text);
        }
        if self.at.is_known() {
            write!(f, "{}: ", self.at)?;
        }
        write!(f, "{}: {}", self.severity, self.text)
    }
}

/// Receives messages; called from any thread, one at a time.
pub type Sink = Box<dyn Fn(&Message) + Send + Sync>;

/// Takes messages from every part of a renderer and passes them on. Clones share one state.
#[derive(Clone)]
pub struct Reporter(Arc<Inner>);

struct Inner {
    sink: Mutex<Sink>,
    verbosity: AtomicU8,
    said: Mutex<HashSet<String>>,
    counts: [AtomicUsize; 5],
}

impl fmt::Debug for Reporter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Reporter({} errors)", self.errors())
    }
}

impl Reporter {
    /// Sends messages to `sink`, at verbosity 1.
    pub fn new(sink: Sink) -> Self {
        Self(Arc::new(Inner {
            sink: Mutex::new(sink),
            verbosity: AtomicU8::new(1),
            said: Mutex::default(),
            counts: Default::default(),
        }))
    }

    /// Drops all messages, but counts them.
    pub fn silent() -> Self {
        Self::new(Box::new(|_| ()))
    }

    /// Keeps all messages, for tests and for callers that show them later.
    pub fn collecting() -> (Self, Arc<Mutex<Vec<Message>>>) {
        let kept = Arc::new(Mutex::new(Vec::new()));
        let copy = kept.clone();
        let reporter =
            Self::new(Box::new(move |m| copy.lock().unwrap_or_else(PoisonError::into_inner).push(m.clone())));
        (reporter, kept)
    }

    /// 0: errors only; 1: also warnings; 2: also information (reference 4.3.7).
    pub fn set_verbosity(&self, verbosity: u8) {
        self.0.verbosity.store(verbosity, Ordering::Relaxed);
    }

    /// The verbosity in force.
    pub fn verbosity(&self) -> u8 {
        self.0.verbosity.load(Ordering::Relaxed)
    }

    /// How many errors and severe errors were reported, whether shown or not.
    pub fn errors(&self) -> usize {
        self.count(Severity::Error) + self.count(Severity::Severe)
    }

    /// How many messages of this severity were reported, whether shown or not.
    pub fn count(&self, severity: Severity) -> usize {
        self.0.counts[severity as usize].load(Ordering::Relaxed)
    }

    /// Passes a message on, if the verbosity lets it through.
    pub fn say(&self, severity: Severity, at: &Location, text: impl Into<String>) {
        self.0.counts[severity as usize].fetch_add(1, Ordering::Relaxed);
        let shown = match severity {
            Severity::Message | Severity::Error | Severity::Severe => true,
            Severity::Warning => self.verbosity() >= 1,
            Severity::Info => self.verbosity() >= 2,
        };
        if shown {
            let message = Message { severity, at: at.clone(), text: text.into() };
            (self.0.sink.lock().unwrap_or_else(PoisonError::into_inner))(&message);
        }
    }

    /// As [`Reporter::say`], but only the first time for this `cause`.
    pub fn once(&self, cause: &str, severity: Severity, at: &Location, text: impl Into<String>) {
        let new = self.0.said.lock().unwrap_or_else(PoisonError::into_inner).insert(cause.to_owned());
        if new {
            self.say(severity, at, text);
        }
    }

    /// An error without a place.
    pub fn error(&self, text: impl Into<String>) {
        self.say(Severity::Error, &Location::default(), text);
    }

    /// A warning without a place.
    pub fn warning(&self, text: impl Into<String>) {
        self.say(Severity::Warning, &Location::default(), text);
    }

    /// Information without a place.
    pub fn info(&self, text: impl Into<String>) {
        self.say(Severity::Info, &Location::default(), text);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn once_per_cause_and_verbosity() {
        let (r, kept) = Reporter::collecting();
        let at = Location::line(&"a.pyg".into(), 3);
        for _ in 0..3 {
            r.once("missing foo", Severity::Warning, &at, "cannot find \"foo\"");
        }
        r.info("hidden");
        r.set_verbosity(0);
        r.warning("hidden too");
        r.error("shown");
        let kept = kept.lock().unwrap();
        let lines: Vec<String> = kept.iter().map(ToString::to_string).collect();
        assert_eq!(lines, ["a.pyg:3: warning: cannot find \"foo\"", "error: shown"]);
        assert_eq!((r.errors(), r.count(Severity::Warning)), (1, 2));
    }
}
