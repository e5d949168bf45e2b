//! Messages for the user, sorted by severity, with their location, and reported once per cause.
//!
//! Libraries never print. They pass messages to a [`Reporter`], and the tool decides where these go. Repeated
//! messages are counted and not shown. [`Reporter::summary`] returns the counts. The reporter also records every file
//! that was read ([`Reporter::file_read`]), so that a frame can list the files that it depends on.

mod message;
mod order;

pub use message::{Location, Message, Severity, printable};
pub use order::{MessageOrder, Part};

use parking_lot::Mutex;
use std::collections::{BTreeSet, HashMap};
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicUsize, Ordering};
use std::thread::ThreadId;

/// The verbosity at which only errors and messages are shown.
pub const VERBOSITY_QUIET: u8 = 0;
/// The verbosity at which warnings are shown too.
pub const VERBOSITY_NORMAL: u8 = 1;
/// The verbosity at which information is shown too.
pub const VERBOSITY_INFO: u8 = 2;

/// A receiver of messages. It is called from any thread, one call at a time. It may report messages itself. Each of
/// these is passed to a sink after the current call. Messages that a sink reports about those are only counted.
pub type Sink = Box<dyn Fn(&Message) + Send + Sync>;

/// Receives messages from every part of a renderer and passes them on. Clones share one state.
#[derive(Clone)]
pub struct Reporter(Arc<Inner>);

struct Inner {
    sink: Mutex<Arc<Sink>>,
    /// The sink that receives all messages except [`Severity::Message`] instead of `sink`.
    log: Mutex<Option<Arc<Sink>>>,
    /// The lock that is held by the thread whose message is being passed to a sink.
    turn: Mutex<()>,
    delivery: Mutex<Delivery>,
    verbosity: AtomicU8,
    said: Mutex<Said>,
    counts: [AtomicUsize; 5],
    /// The number of messages that were shown, without [`Severity::Message`].
    shown: AtomicUsize,
    files: Mutex<BTreeSet<PathBuf>>,
    threads: order::Threads,
}

/// A message, and how it is compared with those before it.
#[derive(Debug)]
struct Report {
    /// The cause; `None` when the message itself is compared.
    cause: Option<String>,
    /// True when repetitions of the cause are counted.
    is_counted: bool,
    message: Message,
}

/// The state of the thread that holds [`Inner::turn`].
#[derive(Default)]
struct Delivery {
    thread: Option<ThreadId>,
    /// The messages that the sink itself reported. They are passed on later.
    waiting: Vec<Message>,
    /// True while these messages are passed on.
    is_late: bool,
}

/// Ends a delivery, also when the sink panics.
struct EndOfDelivery<'a>(&'a Mutex<Delivery>);

impl Drop for EndOfDelivery<'_> {
    fn drop(&mut self) {
        *self.0.lock() = Delivery::default();
    }
}

/// The causes that were reported, and how often each was repeated.
#[derive(Default)]
struct Said {
    /// The index of the entry of each cause, for the first [`MANY`] causes.
    index: HashMap<String, usize>,
    again: Vec<Again>,
    /// The index of the entry of each message text, for the first [`MANY`] texts.
    looks: HashMap<String, usize>,
}

struct Again {
    severity: Severity,
    shown: String,
    times: usize,
}

/// The number of different messages, and of causes, that are stored for comparison. Messages beyond it are all
/// reported.
const MANY: usize = 10_000;
/// The largest number of messages that are shown. It limits the output for a broken file.
const MOST_SHOWN: usize = 2000;
/// The largest number of repeated messages that a summary lists.
const LISTED: usize = 20;

impl fmt::Debug for Reporter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Reporter({} errors)", self.errors())
    }
}

impl Reporter {
    /// Returns a reporter that sends messages to `sink`, at verbosity 1.
    pub fn new(sink: Sink) -> Self {
        Self(Arc::new(Inner {
            sink: Mutex::new(Arc::new(sink)),
            log: Mutex::default(),
            turn: Mutex::default(),
            delivery: Mutex::default(),
            verbosity: AtomicU8::new(VERBOSITY_NORMAL),
            said: Mutex::default(),
            counts: Default::default(),
            shown: AtomicUsize::new(0),
            files: Mutex::default(),
            threads: order::Threads::default(),
        }))
    }

    /// Sends messages to `sink` from now on. Returns the previous sink.
    pub fn set_sink(&self, sink: Sink) -> Sink {
        let old = std::mem::replace(&mut *self.0.sink.lock(), Arc::new(sink));
        // A thread may be calling the old sink now.
        Arc::try_unwrap(old).unwrap_or_else(|shared| Box::new(move |message| shared(message)))
    }

    /// Sends all messages except [`Severity::Message`] to `log` instead ("error:filename" of reference 4.3.7). `None`
    /// sends them to the sink again.
    pub fn set_log(&self, log: Option<Sink>) {
        let old = std::mem::replace(&mut *self.0.log.lock(), log.map(Arc::new));
        // The old log is dropped without the lock, because it may report messages.
        drop(old);
    }

    /// Returns a reporter that drops all messages, but counts them.
    pub fn silent() -> Self {
        Self::new(Box::new(|_| ()))
    }

    /// Returns a reporter that stores all messages, for tests and for callers that show them later.
    pub fn collecting() -> (Self, Arc<Mutex<Vec<Message>>>) {
        let kept = Arc::new(Mutex::new(Vec::new()));
        let copy = kept.clone();
        let reporter = Self::new(Box::new(move |m| copy.lock().push(m.clone())));
        (reporter, kept)
    }

    /// Sets the verbosity. 0 shows errors only, 1 also warnings, 2 also information (reference 4.3.7).
    pub fn set_verbosity(&self, verbosity: u8) {
        self.0.verbosity.store(verbosity, Ordering::Relaxed);
    }

    /// Returns the current verbosity.
    pub fn verbosity(&self) -> u8 {
        self.0.verbosity.load(Ordering::Relaxed)
    }

    /// The number of errors and severe errors that were reported, whether shown or not.
    pub fn errors(&self) -> usize {
        self.count(Severity::Error) + self.count(Severity::Severe)
    }

    /// The number of messages of this severity that were reported, whether shown or not.
    pub fn count(&self, severity: Severity) -> usize {
        self.0.counts[severity as usize].load(Ordering::Relaxed)
    }

    /// Reports a message, which is shown if the verbosity permits it. A warning or an error that was already reported
    /// with the same text and location is only counted.
    pub fn say(&self, severity: Severity, at: &Location, text: impl Into<String>) {
        self.report(Report {
            cause: None,
            is_counted: true,
            message: Message::new(severity, at, text.into()),
        });
    }

    /// Reports a message only the first time for this `cause`, even when the texts differ. Repetitions are not
    /// counted, because their number has no meaning for some causes.
    pub fn once(&self, cause: &str, severity: Severity, at: &Location, text: impl Into<String>) {
        let message = Message::new(severity, at, text.into());
        self.report(Report { cause: Some(cause.to_owned()), is_counted: false, message });
    }

    /// Does the same as [`Reporter::once`], and the summary contains the number of repetitions. It is for errors of a
    /// scene.
    pub fn counted(&self, cause: &str, severity: Severity, at: &Location, text: impl Into<String>) {
        let message = Message::new(severity, at, text.into());
        self.report(Report { cause: Some(cause.to_owned()), is_counted: true, message });
    }

    fn report(&self, report: Report) {
        if let Some(report) = self.0.threads.hold(report) {
            self.pass_on(report);
        }
    }

    /// Returns the parts of ordered work that threads are at work on.
    fn threads(&self) -> &order::Threads {
        &self.0.threads
    }

    /// Shows or counts a message.
    fn pass_on(&self, report: Report) {
        let Report { cause, is_counted, message } = report;
        let is_compared = cause.is_some() || message.severity >= Severity::Warning;
        if is_compared {
            let mut guard = self.0.said.lock();
            let said = &mut *guard;
            let index = if cause.is_some() { &mut said.index } else { &mut said.looks };
            let key = cause.unwrap_or_else(|| message.to_string());
            if let Some(&entry) = index.get(&key) {
                said.again[entry].times += usize::from(is_counted);
                return;
            }
            if index.len() < MANY {
                index.insert(key, said.again.len());
                said.again.push(Again { severity: message.severity, shown: message.to_string(), times: 0 });
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
        let thread = std::thread::current().id();
        {
            let mut delivery = self.0.delivery.lock();
            if delivery.thread == Some(thread) {
                if !delivery.is_late {
                    delivery.waiting.push(message.clone());
                }
                return;
            }
        }
        let _turn = self.0.turn.lock();
        self.0.delivery.lock().thread = Some(thread);
        let end = EndOfDelivery(&self.0.delivery);
        self.deliver(message);
        let waiting = {
            let mut delivery = self.0.delivery.lock();
            delivery.is_late = true;
            std::mem::take(&mut delivery.waiting)
        };
        waiting.iter().for_each(|message| self.deliver(message));
        drop(end);
    }

    /// Calls the sink of a message, without holding a lock that the sink may need.
    fn deliver(&self, message: &Message) {
        let log = self.0.log.lock().clone().filter(|_| message.severity != Severity::Message);
        let sink = log.unwrap_or_else(|| self.0.sink.lock().clone());
        sink(message);
    }

    /// Returns the numbers of errors and warnings, and the repeated messages with their counts; `None` when there was
    /// at most one.
    pub fn summary(&self) -> Option<String> {
        let (errors, warnings) = (self.errors(), self.count(Severity::Warning));
        let said = self.0.said.lock();
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
            text +=
                &format!("\n  and {} that were repeated", number(repeated.len() - LISTED, "other message"));
        }
        Some(text)
    }

    /// Shows the summary, as information that verbosity 1 already shows.
    pub fn tell_summary(&self) {
        if self.verbosity() >= VERBOSITY_NORMAL
            && let Some(text) = self.summary()
        {
            self.show(&Message { severity: Severity::Info, at: Location::default(), text });
        }
    }

    /// Records that a file was read. `./a` is the same as `a`.
    pub fn file_read(&self, path: &Path) {
        let path = path.strip_prefix(".").unwrap_or(path);
        let mut files = self.0.files.lock();
        if !files.contains(path) {
            files.insert(path.to_owned());
        }
    }

    /// Returns all files that were read, sorted.
    pub fn files_read(&self) -> Vec<PathBuf> {
        self.0.files.lock().iter().cloned().collect()
    }

    /// Reports an error without a location.
    pub fn error(&self, text: impl Into<String>) {
        self.say(Severity::Error, &Location::default(), text);
    }

    /// Reports a warning without a location.
    pub fn warning(&self, text: impl Into<String>) {
        self.say(Severity::Warning, &Location::default(), text);
    }

    /// Reports information without a location.
    pub fn info(&self, text: impl Into<String>) {
        self.say(Severity::Info, &Location::default(), text);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_appear_once_per_cause_and_by_verbosity() {
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
        let kept = kept.lock();
        let lines: Vec<String> = kept.iter().map(ToString::to_string).collect();
        assert_eq!(lines, ["a.pyg:3: warning: cannot find \"foo\"", "error: shown"]);
        assert_eq!((r.errors(), r.count(Severity::Warning)), (1, 2));
        let summary = r.summary().unwrap();
        assert_eq!(summary, "1 error, 2 warnings\n  2 times more: a.pyg:3: warning: cannot find \"foo\"");
    }

    #[test]
    fn repeated_messages_are_counted() {
        let (r, kept) = Reporter::collecting();
        assert_eq!(r.summary(), None);
        r.error("one");
        assert_eq!(r.summary(), None);
        for line in [3, 3, 4] {
            r.say(Severity::Error, &Location::line(&"a.pyg".into(), line), "two");
            r.say(Severity::Message, &Location::default(), "printed");
        }
        let lines: Vec<String> = kept.lock().iter().map(ToString::to_string).collect();
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
        assert!(kept.lock().last().unwrap().text.starts_with("3 errors"));
    }

    #[test]
    fn sinks_are_replaced_and_logs_take_all_but_printed_messages() {
        let (r, kept) = Reporter::collecting();
        let codes = Arc::new(Mutex::new(Vec::new()));
        let mine = codes.clone();
        let first = r.set_sink(Box::new(move |m| mine.lock().push(m.severity.code())));
        r.set_verbosity(VERBOSITY_INFO);
        r.info("a");
        r.warning("b");
        r.error("c");
        r.say(Severity::Severe, &Location::default(), "d");
        r.say(Severity::Message, &Location::default(), "e");
        assert_eq!(*codes.lock(), [512, 1024, 2048, 4096, 8192]);
        drop(r.set_sink(first));
        let log = codes.clone();
        r.set_log(Some(Box::new(move |m| log.lock().push(-m.severity.code()))));
        r.error("f");
        r.say(Severity::Message, &Location::default(), "g");
        r.set_log(None);
        r.error("h");
        assert_eq!(codes.lock().last(), Some(&-2048));
        let texts: Vec<String> = kept.lock().iter().map(|m| m.text.clone()).collect();
        assert_eq!(texts, ["g", "h"]);
    }

    #[test]
    fn sinks_may_report_and_replace_themselves() {
        let (done, over) = std::sync::mpsc::channel();
        std::thread::spawn(move || {
            let (reporter, kept) = Reporter::collecting();
            let own = reporter.clone();
            let show = Arc::new(reporter.set_sink(Box::new(|_| ())));
            let shown = show.clone();
            drop(reporter.set_sink(Box::new(move |message| {
                shown(message);
                own.error(format!("{} again", message.text));
                own.say(Severity::Message, &Location::default(), "printed");
                let last = shown.clone();
                drop(own.set_sink(Box::new(move |message| last(message))));
            })));
            reporter.error("first");
            reporter.error("second");
            let texts: Vec<String> = kept.lock().iter().map(|m| m.text.clone()).collect();
            done.send((texts, reporter.errors())).unwrap();
        });
        let waited = over.recv_timeout(std::time::Duration::from_secs(20));
        let (texts, errors) = waited.expect("a sink that reports must not wait for itself");
        assert_eq!(texts, ["first", "first again", "printed", "second"]);
        assert_eq!(errors, 3);
    }

    #[test]
    fn a_sink_that_reports_each_message_does_not_recurse_endlessly() {
        let (reporter, kept) = Reporter::collecting();
        let own = reporter.clone();
        let show = reporter.set_sink(Box::new(|_| ()));
        drop(reporter.set_sink(Box::new(move |message| {
            show(message);
            own.error(format!("about {}", message.text));
        })));
        reporter.error("a");
        let texts: Vec<String> = kept.lock().iter().map(|m| m.text.clone()).collect();
        assert_eq!(texts, ["a", "about a"]);
        assert_eq!(reporter.errors(), 3, "the last one is counted only");
    }

    #[test]
    fn messages_of_threads_reach_the_sink_one_at_a_time() {
        let busy = Arc::new(AtomicUsize::new(0));
        let (inside, most) = (busy.clone(), Arc::new(AtomicUsize::new(0)));
        let seen = most.clone();
        let reporter = Reporter::new(Box::new(move |_| {
            seen.fetch_max(inside.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
            std::thread::yield_now();
            inside.fetch_sub(1, Ordering::SeqCst);
        }));
        std::thread::scope(|scope| {
            for thread in 0..8 {
                let reporter = &reporter;
                scope.spawn(move || (0..50).for_each(|i| reporter.error(format!("{thread} {i}"))));
            }
        });
        assert_eq!((most.load(Ordering::SeqCst), reporter.errors()), (1, 400));
    }

    #[test]
    fn messages_beyond_the_limit_are_only_counted() {
        let (r, kept) = Reporter::collecting();
        (0..MOST_SHOWN + 100).for_each(|i| r.error(format!("mistake {i}")));
        r.say(Severity::Message, &Location::default(), "printed");
        let kept = kept.lock();
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
        let lines: Vec<String> = kept.lock().iter().map(ToString::to_string).collect();
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
    fn the_memory_for_causes_is_limited() {
        let reporter = Reporter::silent();
        for k in 0..2 * MANY {
            reporter.once(&format!("cause {k}"), Severity::Warning, &Location::default(), "a warning");
        }
        // The first causes are stored, and no message is lost.
        reporter.once("cause 0", Severity::Warning, &Location::default(), "a warning");
        assert_eq!(reporter.count(Severity::Warning), 2 * MANY);
        let said = reporter.0.said.lock();
        assert_eq!((said.index.len(), said.again.len()), (MANY, MANY));
    }

    #[test]
    fn files_that_were_read_are_listed_once_and_sorted() {
        let r = Reporter::silent();
        ["b.tx", "a.pyg", "b.tx", "./a.pyg"].iter().for_each(|f| r.file_read(Path::new(f)));
        assert_eq!(r.files_read(), [PathBuf::from("a.pyg"), PathBuf::from("b.tx")]);
    }
}
