//! Messages for the user: sorted by severity, placed, and said once per cause.
//!
//! Libraries never print. They hand messages to a [`Reporter`]; the tool decides where they go. What is said again is
//! counted and not shown; [`Reporter::summary`] tells how often. The reporter also hears of every file that was read
//! ([`Reporter::file_read`]), so that a frame can say what it depends on.

use std::borrow::Cow;
use std::collections::{BTreeSet, HashMap};
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU8, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Errors and messages are shown.
pub const VERBOSITY_QUIET: u8 = 0;
/// Warnings as well.
pub const VERBOSITY_NORMAL: u8 = 1;
/// Information as well.
pub const VERBOSITY_INFO: u8 = 2;

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

impl Severity {
    /// The number that stands for it in interfaces of the C++ kind (reference A.3).
    pub fn code(self) -> i32 {
        match self {
            Self::Info => 512,
            Self::Warning => 1024,
            Self::Error => 2048,
            Self::Severe => 4096,
            Self::Message => 8192,
        }
    }

    /// The severity of a code; [`Severity::Message`] for unknown ones.
    pub fn from_code(code: i32) -> Self {
        [Self::Info, Self::Warning, Self::Error, Self::Severe]
            .into_iter()
            .find(|severity| severity.code() == code)
            .unwrap_or(Self::Message)
    }
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

impl Message {
    /// Without what terminals and logs would take for something else: names and texts come from files.
    fn new(severity: Severity, at: &Location, text: String) -> Self {
        let clean = match severity {
            Severity::Message => printable(&text),
            _ => one_line(&text),
        };
        let clean = match clean {
            Cow::Borrowed(_) => None,
            Cow::Owned(clean) => Some(clean),
        };
        let mut at = at.clone();
        if let Cow::Owned(file) = shown(&at.file, |_| false) {
            at.file = file.into();
        }
        Self { severity, at, text: clean.unwrap_or(text) }
    }
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

/// The text as it may go to a terminal or a log: control characters, and those that change the direction of writing, become
/// escapes as `\\u{1b}`; tabs and ends of lines stay.
pub fn printable(text: &str) -> Cow<'_, str> {
    shown(text, |_| true)
}

/// The text of a message of one line. Further lines stay when they are indented by four blanks, as those that quote a source
/// are, so that no text of a scene looks like a message of its own.
fn one_line(text: &str) -> Cow<'_, str> {
    shown(text, |rest| rest.starts_with("    "))
}

/// Escapes what is not printed; `may_end` says whether a line may end before the rest of the text.
fn shown(text: &str, may_end: impl Fn(&str) -> bool) -> Cow<'_, str> {
    // Bidirectional embeddings, overrides and isolates make text look like another one.
    let is_shown = |at: usize, c: char| match c {
        '\t' => true,
        '\n' => may_end(&text[at + 1..]),
        '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' => false,
        other => !other.is_control(),
    };
    if text.char_indices().all(|(at, c)| is_shown(at, c)) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 16);
    for (at, c) in text.char_indices() {
        if is_shown(at, c) {
            out.push(c);
        } else {
            out.extend(c.escape_default());
        }
    }
    Cow::Owned(out)
}

/// Receives messages; called from any thread, one at a time.
pub type Sink = Box<dyn Fn(&Message) + Send + Sync>;

/// Takes messages from every part of a renderer and passes them on. Clones share one state.
#[derive(Clone)]
pub struct Reporter(Arc<Inner>);

struct Inner {
    sink: Mutex<Sink>,
    /// Takes all but [`Severity::Message`] in the place of `sink`.
    log: Mutex<Option<Sink>>,
    verbosity: AtomicU8,
    said: Mutex<Said>,
    counts: [AtomicUsize; 5],
    /// Messages that were shown, but [`Severity::Message`].
    shown: AtomicUsize,
    files: Mutex<BTreeSet<PathBuf>>,
}

/// Causes that were said, and how often each came again.
#[derive(Default)]
struct Said {
    /// What was said once, by cause, among the first [`MANY`].
    index: HashMap<String, usize>,
    again: Vec<Again>,
    /// Messages that look the same, among the first [`MANY`].
    looks: HashMap<String, usize>,
}

struct Again {
    severity: Severity,
    shown: String,
    times: usize,
}

/// So many different messages, and as many causes, are remembered for comparing; who says more than that says them all.
const MANY: usize = 10_000;
/// So many messages are shown; what a broken file causes beyond them fills no disk.
const MOST_SHOWN: usize = 2000;
/// So many repeated messages are listed in a summary.
const LISTED: usize = 20;

impl Said {
    fn new_entry(&mut self, message: &Message) -> usize {
        self.again.push(Again { severity: message.severity, shown: message.to_string(), times: 0 });
        self.again.len() - 1
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
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
            log: Mutex::default(),
            verbosity: AtomicU8::new(VERBOSITY_NORMAL),
            said: Mutex::default(),
            counts: Default::default(),
            shown: AtomicUsize::new(0),
            files: Mutex::default(),
        }))
    }

    /// Sends messages to `sink` from now on; returns what they went to before.
    pub fn set_sink(&self, sink: Sink) -> Sink {
        std::mem::replace(&mut *lock(&self.0.sink), sink)
    }

    /// Sends everything but [`Severity::Message`] to `log` instead ("error:filename" of reference 4.3.7); `None` ends
    /// that.
    pub fn set_log(&self, log: Option<Sink>) {
        *lock(&self.0.log) = log;
    }

    /// Drops all messages, but counts them.
    pub fn silent() -> Self {
        Self::new(Box::new(|_| ()))
    }

    /// Keeps all messages, for tests and for callers that show them later.
    pub fn collecting() -> (Self, Arc<Mutex<Vec<Message>>>) {
        let kept = Arc::new(Mutex::new(Vec::new()));
        let copy = kept.clone();
        let reporter = Self::new(Box::new(move |m| lock(&copy).push(m.clone())));
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

    /// Passes a message on, if the verbosity lets it through. A warning or an error that was said before in the same
    /// words about the same place is only counted.
    pub fn say(&self, severity: Severity, at: &Location, text: impl Into<String>) {
        let message = Message::new(severity, at, text.into());
        if severity >= Severity::Warning {
            let look = message.to_string();
            let mut said = lock(&self.0.said);
            if let Some(&entry) = said.looks.get(&look) {
                said.again[entry].times += 1;
                return;
            }
            if said.looks.len() < MANY {
                let entry = said.new_entry(&message);
                said.looks.insert(look, entry);
            }
        }
        self.pass(&message);
    }

    /// As [`Reporter::say`], but only the first time for this `cause`, however the words differ. How often it comes again
    /// does not count: for what is noticed wherever it happens to be noticed.
    pub fn once(&self, cause: &str, severity: Severity, at: &Location, text: impl Into<String>) {
        self.first(cause, severity, at, text, 0);
    }

    /// As [`Reporter::once`], but the summary tells how often it came again: for mistakes of a scene.
    pub fn counted(&self, cause: &str, severity: Severity, at: &Location, text: impl Into<String>) {
        self.first(cause, severity, at, text, 1);
    }

    fn first(&self, cause: &str, severity: Severity, at: &Location, text: impl Into<String>, counts: usize) {
        let message = Message::new(severity, at, text.into());
        {
            let mut said = lock(&self.0.said);
            if let Some(&entry) = said.index.get(cause) {
                said.again[entry].times += counts;
                return;
            }
            if said.index.len() < MANY {
                let entry = said.new_entry(&message);
                said.index.insert(cause.to_owned(), entry);
            }
        }
        self.pass(&message);
    }

    fn pass(&self, message: &Message) {
        self.0.counts[message.severity as usize].fetch_add(1, Ordering::Relaxed);
        let least = match message.severity {
            Severity::Message | Severity::Error | Severity::Severe => VERBOSITY_QUIET,
            Severity::Warning => VERBOSITY_NORMAL,
            Severity::Info => VERBOSITY_INFO,
        };
        if self.verbosity() < least {
            return;
        }
        if message.severity == Severity::Message {
            return self.show(message);
        }
        match self.0.shown.fetch_add(1, Ordering::Relaxed) {
            0..MOST_SHOWN => self.show(message),
            MOST_SHOWN => self.show(&Message {
                severity: Severity::Warning,
                at: Location::default(),
                text: format!("more than {MOST_SHOWN} messages: further ones are counted only"),
            }),
            _ => (),
        }
    }

    fn show(&self, message: &Message) {
        if message.severity != Severity::Message
            && let Some(log) = &*lock(&self.0.log)
        {
            return log(message);
        }
        (lock(&self.0.sink))(message);
    }

    /// Warnings and errors in numbers, and which of them came again how often; `None` when there was at most one.
    pub fn summary(&self) -> Option<String> {
        let (errors, warnings) = (self.errors(), self.count(Severity::Warning));
        let said = lock(&self.0.said);
        let repeated: Vec<&Again> =
            said.again.iter().filter(|a| a.times > 0 && a.severity >= Severity::Warning).collect();
        if errors + warnings < 2 && repeated.is_empty() {
            return None;
        }
        let number = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
        let mut text = format!("{}, {}", number(errors, "error"), number(warnings, "warning"));
        for again in repeated.iter().take(LISTED) {
            text += &format!("\n  {} more: {}", number(again.times, "time"), again.shown);
        }
        if repeated.len() > LISTED {
            text += &format!("\n  and {} that came again", number(repeated.len() - LISTED, "other message"));
        }
        Some(text)
    }

    /// Shows the summary, as information that verbosity 1 lets through.
    pub fn tell_summary(&self) {
        if self.verbosity() >= VERBOSITY_NORMAL
            && let Some(text) = self.summary()
        {
            self.show(&Message { severity: Severity::Info, at: Location::default(), text });
        }
    }

    /// Notes that a file was read; `./a` is the same as `a`.
    pub fn file_read(&self, path: &Path) {
        let path = path.strip_prefix(".").unwrap_or(path);
        let mut files = lock(&self.0.files);
        if !files.contains(path) {
            files.insert(path.to_owned());
        }
    }

    /// All files that were read, sorted.
    pub fn files_read(&self) -> Vec<PathBuf> {
        lock(&self.0.files).iter().cloned().collect()
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
            r.counted("missing foo", Severity::Warning, &at, "cannot find \"foo\"");
            r.once("hidden", Severity::Info, &at, "hidden");
        }
        r.info("hidden");
        r.set_verbosity(0);
        r.warning("hidden too");
        r.error("shown");
        let kept = kept.lock().unwrap();
        let lines: Vec<String> = kept.iter().map(ToString::to_string).collect();
        assert_eq!(lines, ["a.pyg:3: warning: cannot find \"foo\"", "error: shown"]);
        assert_eq!((r.errors(), r.count(Severity::Warning)), (1, 2));
        let summary = r.summary().unwrap();
        assert_eq!(summary, "1 error, 2 warnings\n  2 times more: a.pyg:3: warning: cannot find \"foo\"");
    }

    #[test]
    fn what_is_said_again_is_counted() {
        let (r, kept) = Reporter::collecting();
        assert_eq!(r.summary(), None);
        r.error("one");
        assert_eq!(r.summary(), None);
        for line in [3, 3, 4] {
            r.say(Severity::Error, &Location::line(&"a.pyg".into(), line), "two");
            r.say(Severity::Message, &Location::default(), "printed");
        }
        let lines: Vec<String> = kept.lock().unwrap().iter().map(ToString::to_string).collect();
        let printed = || "printed".to_owned();
        assert_eq!(
            lines,
            [
                "error: one".to_owned(),
                "a.pyg:3: error: two".into(),
                printed(),
                printed(),
                "a.pyg:4: error: two".into(),
                printed()
            ]
        );
        assert_eq!(r.summary().unwrap(), "3 errors, 0 warnings\n  1 time more: a.pyg:3: error: two");
        r.tell_summary();
        assert!(kept.lock().unwrap().last().unwrap().text.starts_with("3 errors"));
    }

    #[test]
    fn handlers_are_exchanged_and_logs_take_all_but_messages() {
        let (r, kept) = Reporter::collecting();
        let codes = Arc::new(Mutex::new(Vec::new()));
        let mine = codes.clone();
        let first = r.set_sink(Box::new(move |m| mine.lock().unwrap().push(m.severity.code())));
        r.set_verbosity(VERBOSITY_INFO);
        r.info("a");
        r.warning("b");
        r.error("c");
        r.say(Severity::Severe, &Location::default(), "d");
        r.say(Severity::Message, &Location::default(), "e");
        assert_eq!(*codes.lock().unwrap(), [512, 1024, 2048, 4096, 8192]);
        drop(r.set_sink(first));
        let log = codes.clone();
        r.set_log(Some(Box::new(move |m| log.lock().unwrap().push(-m.severity.code()))));
        r.error("f");
        r.say(Severity::Message, &Location::default(), "g");
        r.set_log(None);
        r.error("h");
        assert_eq!(codes.lock().unwrap().last(), Some(&-2048));
        let texts: Vec<String> = kept.lock().unwrap().iter().map(|m| m.text.clone()).collect();
        assert_eq!(texts, ["g", "h"]);
    }

    #[test]
    fn a_flood_of_messages_is_counted() {
        let (r, kept) = Reporter::collecting();
        (0..MOST_SHOWN + 100).for_each(|i| r.error(format!("mistake {i}")));
        r.say(Severity::Message, &Location::default(), "printed");
        let kept = kept.lock().unwrap();
        assert_eq!(kept.len(), MOST_SHOWN + 2);
        assert_eq!(kept[MOST_SHOWN].text, "more than 2000 messages: further ones are counted only");
        assert_eq!((r.errors(), kept[MOST_SHOWN + 1].text.as_str()), (MOST_SHOWN + 100, "printed"));
    }

    #[test]
    fn control_characters_are_escaped() {
        let (r, kept) = Reporter::collecting();
        let at = Location::line(&"a\nb\u{1b}[2J.pyg".into(), 3);
        r.say(Severity::Error, &at, "no \"\u{1b}]0;x\u{7}\"\nerror: forged\r\u{202e}");
        r.error("bad\n    float x;\n    ^");
        r.once("c", Severity::Warning, &Location::default(), "a\u{9b}b\n");
        r.say(Severity::Message, &Location::default(), "1\t2\u{8}\n3\n");
        let lines: Vec<String> = kept.lock().unwrap().iter().map(ToString::to_string).collect();
        assert_eq!(
            lines,
            [
                "a\\nb\\u{1b}[2J.pyg:3: error: no \"\\u{1b}]0;x\\u{7}\"\\nerror: forged\\r\\u{202e}",
                "error: bad\n    float x;\n    ^",
                "warning: a\\u{9b}b\\n",
                "1\t2\\u{8}\n3\n",
            ]
        );
    }

    #[test]
    fn causes_without_end_take_no_memory_without_end() {
        let reporter = Reporter::silent();
        for k in 0..2 * MANY {
            reporter.once(&format!("cause {k}"), Severity::Warning, &Location::default(), "a warning");
        }
        // The first ones are remembered, and nothing is lost.
        reporter.once("cause 0", Severity::Warning, &Location::default(), "a warning");
        assert_eq!(reporter.count(Severity::Warning), 2 * MANY);
        let said = lock(&reporter.0.said);
        assert_eq!((said.index.len(), said.again.len()), (MANY, MANY));
    }

    #[test]
    fn files_are_listed_once_in_order() {
        let r = Reporter::silent();
        ["b.tx", "a.pyg", "b.tx", "./a.pyg"].iter().for_each(|f| r.file_read(Path::new(f)));
        assert_eq!(r.files_read(), [PathBuf::from("a.pyg"), PathBuf::from("b.tx")]);
    }
}
