//! Work that takes longer than a frame: computed by the loader's threads, and shown when it is done.

use super::entries::Seen;
use granita_image::PixelRect;
use granita_view::{
    CompareOptions, Comparison, Histogram, Loader, Needs, Page, Pick, Statistics, TileStore, compare,
    flip_page, statistics, value_range,
};
use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::sync::Arc;

/// What one question is about.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Question {
    Probe { page: u64, part: PixelRect },
    Compare { first: u64, second: u64 },
    FlipMap { first: u64, second: u64 },
    Histogram { page: u64, layer: usize, level: usize, tiles: u64, low: f32, high: f32, log: bool },
}

#[derive(Clone)]
enum Answer {
    Probe(Result<Vec<Statistics>, String>),
    Compare(Box<Result<Comparison, String>>),
    FlipMap(Result<Arc<Page>, String>),
    Histogram(Box<Histogram>),
}

/// What is there of what was asked.
#[derive(Clone, Default)]
pub(crate) struct Answers {
    pub(crate) probe: Option<Result<Vec<Statistics>, String>>,
    pub(crate) comparison: Option<Result<Comparison, String>>,
    pub(crate) histogram: Option<Histogram>,
}

/// What is asked about a page.
pub(crate) struct Asked<'a> {
    /// What it is compared with.
    pub(crate) second: Option<&'a Seen>,
    /// The area that is measured.
    pub(crate) probe: Option<PixelRect>,
    /// The tiles of which there is to be a histogram.
    pub(crate) histogram: Option<&'a Needs>,
}

/// Least and largest value of a layer of a page, where there are any.
type Ranges = BTreeMap<(u64, usize), Option<(f32, f32)>>;

/// The questions that were asked; the last few answers are kept.
#[derive(Default)]
pub(crate) struct Tasks {
    asked: Vec<Question>,
    answers: Arc<Mutex<Vec<(Question, Answer)>>>,
    ranges_asked: Vec<(u64, usize)>,
    ranges: Arc<Mutex<Ranges>>,
    /// The histogram that was shown last, until there is a new one.
    last_histogram: Option<Histogram>,
}

/// Answers that are kept.
const KEPT: usize = 16;

impl Tasks {
    /// Least and largest value of a layer; `None` until it is known, or when there is none.
    pub(crate) fn range(&mut self, loader: &Loader, page: &Arc<Page>, layer: usize) -> Option<(f32, f32)> {
        let key = (page.pyramid.number(), layer);
        if let Some(range) = self.ranges.lock().get(&key) {
            return *range;
        }
        if !self.ranges_asked.contains(&key) {
            self.ranges_asked.push(key);
            let (page, ranges) = (page.clone(), self.ranges.clone());
            loader.run(move || {
                let range = value_range(&page, layer).ok().flatten();
                ranges.lock().insert(key, range);
            });
        }
        None
    }

    fn ask(
        &mut self,
        loader: &Loader,
        question: Question,
        answer: impl FnOnce() -> Answer + Send + 'static,
    ) -> Option<Answer> {
        let held = self.answers.lock();
        if let Some((_, answer)) = held.iter().find(|(q, _)| *q == question) {
            return Some(answer.clone());
        }
        drop(held);
        if !self.asked.contains(&question) {
            self.asked.push(question);
            if self.asked.len() > KEPT {
                self.asked.remove(0);
            }
            let answers = self.answers.clone();
            loader.run(move || {
                let answer = answer();
                let mut held = answers.lock();
                held.push((question, answer));
                if held.len() > KEPT {
                    held.remove(0);
                }
            });
        }
        None
    }

    /// What is known by now; asks for what is not.
    pub(crate) fn answers(&mut self, loader: &Loader, seen: &Seen, asked: &Asked<'_>) -> Answers {
        let number = seen.page.pyramid.number();
        let mut out = Answers::default();
        if let Some(part) = asked.probe {
            let page = seen.page.clone();
            let ask = Question::Probe { page: number, part };
            let answer = self.ask(loader, ask, move || {
                Answer::Probe(statistics(&page, 0, part).map_err(|e| e.to_string()))
            });
            if let Some(Answer::Probe(found)) = answer {
                out.probe = Some(found);
            }
        }
        if let Some(second) = asked.second {
            let (a, b) = (seen.page.clone(), second.page.clone());
            let ask = Question::Compare { first: number, second: b.pyramid.number() };
            let answer = self.ask(loader, ask, move || {
                let found = compare(&a, &b, &CompareOptions::default());
                Answer::Compare(Box::new(found.map_err(|e| e.to_string())))
            });
            if let Some(Answer::Compare(found)) = answer {
                out.comparison = Some(*found);
            }
        }
        if let Some(needs) = asked.histogram {
            out.histogram = self.histogram(loader, seen, needs);
        }
        out
    }

    /// How different two pictures look, as a page; `None` until it is computed.
    pub(crate) fn flip_map(
        &mut self,
        loader: &Loader,
        a: &Seen,
        b: &Seen,
        store: &TileStore,
    ) -> Option<Result<Arc<Page>, String>> {
        let (a, b, store) = (a.page.clone(), b.page.clone(), store.clone());
        let ask = Question::FlipMap { first: a.pyramid.number(), second: b.pyramid.number() };
        let answer = self.ask(loader, ask, move || {
            let page = flip_page(&a, &b, &CompareOptions::default(), &store);
            Answer::FlipMap(page.map(Arc::new).map_err(|e| e.to_string()))
        });
        match answer {
            Some(Answer::FlipMap(page)) => Some(page),
            _ => None,
        }
    }

    /// Of what is in sight.
    fn histogram(&mut self, loader: &Loader, seen: &Seen, needs: &Needs) -> Option<Histogram> {
        let page = seen.page.clone();
        let layer = page.layers.get(seen.layer)?;
        let (low, high, log) = match (seen.display.false_color, seen.display.range) {
            (Some(f), _) => (f.low, f.high, f.log),
            (None, Some((a, b))) => (a.min(b), a.max(b), false),
            (None, None) => (0.0, (-seen.display.exposure).exp2(), false),
        };
        let tiles =
            needs.tiles.iter().fold(u64::from(seen.display.pick(layer)[0] == Pick::Value(0.0)), |h, t| {
                h.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(u64::from(t.0) << 32 | u64::from(t.1))
            });
        let level = needs.level;
        let number = page.pyramid.number();
        let ask = Question::Histogram { page: number, layer: seen.layer, level, tiles, low, high, log };
        let (pick, needs) = (seen.display.pick(layer), needs.clone());
        let answer = self.ask(loader, ask, move || {
            let mut histogram = Histogram::new(low, high, log);
            for (tx, ty) in &needs.tiles {
                if let Some(tile) = page.pyramid.held(level, *tx, *ty) {
                    histogram.add(&tile, &pick, |v| v);
                }
            }
            Answer::Histogram(Box::new(histogram))
        });
        if let Some(Answer::Histogram(found)) = answer {
            self.last_histogram = Some(*found);
        }
        self.last_histogram.clone()
    }
}
