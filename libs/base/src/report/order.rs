//! The order of the messages of work that several threads share.

use super::{Report, Reporter};
use parking_lot::Mutex;
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::ThreadId;

/// The largest number of messages that wait for their turn. Messages beyond it are not put into order, so that work
/// that prints without end does not fill the memory.
const MOST_HELD: usize = 10_000;

/// Passes on the messages of parts of a work in the order of the parts, whichever threads do them and whenever they
/// end.
///
/// A part is numbered from 0. Its messages are passed on as they come when all parts before it have ended, and wait
/// until then. When this is dropped, all that wait are passed on.
///
/// ```
/// use granita_base::{Reporter, report::MessageOrder};
/// let (reporter, kept) = Reporter::collecting();
/// let order = MessageOrder::new(&reporter);
/// std::thread::scope(|scope| {
///     for number in [1, 0] {
///         let (order, reporter) = (&order, &reporter);
///         scope.spawn(move || {
///             let _part = order.begin(number);
///             reporter.error(format!("part {number}"));
///         });
///     }
/// });
/// assert_eq!(kept.lock()[0].text, "part 0");
/// ```
#[derive(Debug)]
pub struct MessageOrder {
    reporter: Reporter,
    waiting: Arc<Mutex<Waiting>>,
}

/// A part in progress, on the thread that began it. It ends when this is dropped.
#[must_use]
#[derive(Debug)]
pub struct Part<'a> {
    order: &'a MessageOrder,
    /// The number of the part; `None` when the thread was at work on a part already.
    number: Option<usize>,
}

/// The messages of a work, and the number of one of its parts.
type Place = (Arc<Mutex<Waiting>>, usize);

/// The parts that threads are at work on.
#[derive(Default)]
pub(super) struct Threads {
    parts: Mutex<HashMap<ThreadId, Place>>,
    count: AtomicUsize,
}

/// The messages that wait.
#[derive(Debug, Default)]
pub(super) struct Waiting {
    /// The first part that has not ended, or whose messages were not all passed on.
    current: usize,
    /// True when the messages of the current part are passed on as they come.
    is_live: bool,
    /// True while a thread passes messages on.
    is_passing: bool,
    /// The parts from `current` on of which something is known.
    parts: BTreeMap<usize, Known>,
    /// The number of messages of all parts.
    held: usize,
}

#[derive(Debug, Default)]
struct Known {
    reports: Vec<Report>,
    has_ended: bool,
}

impl MessageOrder {
    /// Returns the order of the messages that go to `reporter` or its clones.
    pub fn new(reporter: &Reporter) -> Self {
        let waiting = Waiting { is_live: true, ..Waiting::default() };
        Self { reporter: reporter.clone(), waiting: Arc::new(Mutex::new(waiting)) }
    }

    /// Begins a part on this thread. A part that begins within another one belongs to that one.
    pub fn begin(&self, number: usize) -> Part<'_> {
        let threads = self.reporter.threads();
        let thread = std::thread::current().id();
        let mut parts = threads.parts.lock();
        if parts.contains_key(&thread) {
            return Part { order: self, number: None };
        }
        parts.insert(thread, (self.waiting.clone(), number));
        threads.count.fetch_add(1, Ordering::Relaxed);
        Part { order: self, number: Some(number) }
    }

    /// Ends a part.
    fn end(&self, number: usize) {
        let mut waiting = self.waiting.lock();
        waiting.parts.entry(number).or_default().has_ended = true;
        if number != waiting.current || waiting.is_passing {
            return;
        }
        waiting.is_passing = true;
        waiting.is_live = false;
        loop {
            let current = waiting.current;
            let part = waiting.parts.entry(current).or_default();
            let reports = std::mem::take(&mut part.reports);
            if !reports.is_empty() {
                waiting.held -= reports.len();
                drop(waiting);
                // The lock is not held, because a receiver of messages may report some itself.
                reports.into_iter().for_each(|report| self.reporter.pass_on(report));
                waiting = self.waiting.lock();
            } else if part.has_ended {
                waiting.parts.remove(&current);
                waiting.current += 1;
            } else {
                waiting.is_live = true;
                waiting.is_passing = false;
                return;
            }
        }
    }
}

impl Drop for MessageOrder {
    fn drop(&mut self) {
        let parts = std::mem::take(&mut self.waiting.lock().parts);
        let reports = parts.into_values().flat_map(|part| part.reports);
        reports.for_each(|report| self.reporter.pass_on(report));
    }
}

impl Drop for Part<'_> {
    fn drop(&mut self) {
        let Some(number) = self.number else { return };
        let threads = self.order.reporter.threads();
        threads.parts.lock().remove(&std::thread::current().id());
        threads.count.fetch_sub(1, Ordering::Relaxed);
        self.order.end(number);
    }
}

impl Threads {
    /// Stores a message of this thread until it is its turn. Returns it when it is now.
    pub(super) fn hold(&self, report: Report) -> Option<Report> {
        if self.count.load(Ordering::Relaxed) == 0 {
            return Some(report);
        }
        let part = self.parts.lock().get(&std::thread::current().id()).cloned();
        let Some((waiting, number)) = part else { return Some(report) };
        let mut waiting = waiting.lock();
        let is_current = waiting.is_live && number == waiting.current;
        if is_current || waiting.held >= MOST_HELD {
            return Some(report);
        }
        waiting.held += 1;
        waiting.parts.entry(number).or_default().reports.push(report);
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Location, Severity};

    fn texts(kept: &Mutex<Vec<crate::report::Message>>) -> Vec<String> {
        kept.lock().iter().map(|message| message.text.clone()).collect()
    }

    #[test]
    fn messages_have_the_order_of_the_parts_for_any_threads() {
        let expected: Vec<String> = (0..60).flat_map(|i| [format!("{i} a"), format!("{i} b")]).collect();
        for threads in [1, 2, 7] {
            let (reporter, kept) = Reporter::collecting();
            let order = MessageOrder::new(&reporter);
            crate::parallel_map(
                0..60,
                threads,
                || (),
                |(), i| {
                    let _part = order.begin(i);
                    reporter.error(format!("{i} a"));
                    // Early parts take longer than late ones.
                    std::thread::sleep(std::time::Duration::from_micros(if i % 7 == 0 { 900 } else { 30 }));
                    reporter.error(format!("{i} b"));
                    reporter.counted("one cause", Severity::Error, &Location::default(), "0 a");
                },
            );
            drop(order);
            // Of one cause the first is shown, here as a repetition of the first message.
            let shown: Vec<String> = texts(&kept).into_iter().filter(|text| text != "0 a").collect();
            assert_eq!(shown, expected[1..], "{threads} threads");
            assert!(reporter.threads().parts.lock().is_empty());
        }
    }

    #[test]
    fn parts_that_never_begin_hold_nothing_back() {
        let (reporter, kept) = Reporter::collecting();
        let order = MessageOrder::new(&reporter);
        for i in [3, 2] {
            let _part = order.begin(i);
            let _inner = order.begin(0);
            reporter.error(i.to_string());
        }
        reporter.error("of no part");
        assert_eq!(texts(&kept), ["of no part"]);
        drop(order);
        assert_eq!(texts(&kept), ["of no part", "2", "3"]);
    }

    #[test]
    fn the_number_of_messages_that_wait_has_a_limit() {
        let (reporter, kept) = Reporter::collecting();
        let order = MessageOrder::new(&reporter);
        let part = order.begin(1);
        for i in 0..MOST_HELD + 5 {
            reporter.say(Severity::Message, &Location::default(), i.to_string());
        }
        assert_eq!(kept.lock().len(), 5);
        drop(part);
        drop(order);
        assert_eq!(kept.lock().len(), MOST_HELD + 5);
    }
}
