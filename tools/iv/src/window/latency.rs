//! The times from the edits of a desk for lighting until the window shows them, for the command `latency` of scripts.

use std::time::{Duration, Instant};

/// The longest wait for an image that shows all edits.
pub(super) const LONGEST: Duration = Duration::from_secs(60);

/// An image that the window showed completely.
#[derive(Clone, Copy, Debug)]
struct Shown {
    /// The number of the last edit that it shows.
    edit: u64,
    coarse: bool,
    at: Instant,
}

/// The edits since the last report, and the images that showed them.
#[derive(Debug, Default)]
pub(super) struct Latency {
    /// The number of the last edit; 0 before the first one.
    sent: u64,
    /// The numbers of the edits of lights, and the times of their inputs.
    edits: Vec<(u64, Instant)>,
    /// The time of the input of the last edit of any kind, such as the end of a drag.
    last: Option<Instant>,
    images: Vec<Shown>,
    /// The last complete image of the sender: the number of the last edit that it shows, and true for a coarse image.
    reported: Option<(u64, bool)>,
    /// True when the window draws that image in the current frame, which is not on the screen yet.
    is_drawn: bool,
}

impl Latency {
    /// Records an edit whose input came at `input`, and returns its number. `is_light` is true for edits of a light.
    pub(super) fn sent(&mut self, input: Instant, is_light: bool) -> u64 {
        self.sent += 1;
        if is_light {
            self.edits.push((self.sent, input));
        }
        self.last = Some(input);
        self.sent
    }

    /// Returns the number of the last edit; 0 before the first one.
    pub(super) fn last_edit(&self) -> u64 {
        self.sent
    }

    /// Records a frame of the window, at its end. `reported` is the last complete image of the sender, and `complete`
    /// is true when the window draws all of its pixels. Returns true when another frame is necessary.
    pub(super) fn drawn(&mut self, reported: Option<(u64, bool)>, complete: bool) -> bool {
        if self.reported != reported {
            (self.reported, self.is_drawn) = (reported, false);
        }
        let is_new = self.reported != self.images.last().map(|shown| (shown.edit, shown.coarse));
        self.is_drawn = complete && is_new && self.reported.is_some();
        self.is_drawn
    }

    /// Records the beginning of a frame, at which the previous one is on its way to the screen.
    pub(super) fn begin(&mut self, now: Instant) {
        if std::mem::take(&mut self.is_drawn)
            && let Some((edit, coarse)) = self.reported
        {
            self.images.push(Shown { edit, coarse, at: now });
        }
    }

    /// True when the window shows all edits in a final image.
    pub(super) fn is_done(&self) -> bool {
        self.images.last().is_some_and(|shown| shown.edit >= self.sent && !shown.coarse)
    }

    /// Returns the report in milliseconds, and forgets what it was about: the time from each input of an edit to the
    /// first image that showed it or a later one, and the time from the last input to the final image.
    pub(super) fn report(&mut self) -> String {
        let after = |input: Instant, shown: &Shown| (shown.at - input).as_secs_f64() * 1e3;
        let first = |(number, input): &(u64, Instant)| {
            let shown = self.images.iter().find(|shown| shown.edit >= *number);
            shown.map_or("none".to_owned(), |shown| format!("{:.0}", after(*input, shown)))
        };
        let edits: Vec<String> = self.edits.iter().map(first).collect();
        let last = self.images.iter().find(|shown| shown.edit >= self.sent && !shown.coarse).zip(self.last);
        let last = last.map_or("none".to_owned(), |(shown, input)| format!("{:.0}", after(input, shown)));
        self.edits.clear();
        self.images.drain(..self.images.len().saturating_sub(1));
        format!("latency: edits {}; final {last}", edits.join(" "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_answer_all_edits_before_them() {
        let begin = Instant::now();
        let at = |ms: u64| begin + Duration::from_millis(ms);
        let mut latency = Latency::default();
        assert!(!latency.is_done());
        // The begin of a drag is an edit, but not of a light.
        assert_eq!(latency.sent(at(0), false), 1);
        assert_eq!(latency.sent(at(0), true), 2);
        assert_eq!(latency.sent(at(30), true), 3);
        assert_eq!(latency.sent(at(60), true), 4);
        // The image of an earlier edit, and one that is not drawn completely yet.
        assert!(latency.drawn(Some((1, false)), true));
        latency.begin(at(70));
        assert!(!latency.drawn(Some((3, true)), false));
        latency.begin(at(80));
        assert!(latency.drawn(Some((3, true)), true));
        latency.begin(at(100));
        assert!(!latency.drawn(Some((3, true)), true), "it is recorded already");
        assert!(latency.drawn(Some((4, true)), true));
        latency.begin(at(200));
        assert_eq!(latency.sent(at(210), false), 5);
        assert!(!latency.is_done());
        assert!(latency.drawn(Some((5, false)), true));
        latency.begin(at(1210));
        assert!(latency.is_done());
        assert_eq!(latency.report(), "latency: edits 100 70 140; final 1000");
        assert_eq!(latency.sent(at(2000), true), 6);
        assert!(!latency.is_done());
        assert_eq!(latency.report(), "latency: edits none; final none");
    }
}
