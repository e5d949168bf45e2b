//! Work that takes longer than a frame. The loader's threads compute it, and it is shown when it is done.

use super::entries::Seen;
use granita_image::PixelRect;
use granita_view::{
    CompareOptions, Comparison, Histogram, Loader, Needs, Page, Pick, Statistics, TileStore, compare,
    flip_page, statistics, value_range,
};
use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The key of a result.
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

/// The results that are available.
#[derive(Clone, Default)]
pub(crate) struct Answers {
    pub(crate) probe: Option<Result<Vec<Statistics>, String>>,
    pub(crate) comparison: Option<Result<Comparison, String>>,
    pub(crate) histogram: Option<Histogram>,
}

/// The requested results.
pub(crate) struct Asked<'a> {
    /// The image for the comparison.
    pub(crate) second: Option<&'a Seen>,
    /// The area that is measured.
    pub(crate) probe: Option<PixelRect>,
    /// The tiles of the histogram.
    pub(crate) histogram: Option<&'a Needs>,
}

/// The least and the largest value of a layer of a page; `None` when it has no values.
type Ranges = BTreeMap<(u64, usize), Option<(f32, f32)>>;

/// The recent requests and their results.
#[derive(Default)]
pub(crate) struct Tasks {
    asked: Vec<Question>,
    answers: Arc<Mutex<Vec<(Question, Answer)>>>,
    ranges_asked: Vec<(u64, usize)>,
    ranges: Arc<Mutex<Ranges>>,
    /// The last computed histogram. It is shown until there is a new one.
    last_histogram: Option<Histogram>,
}

/// The number of requests and of results that are kept.
const KEPT: usize = 16;

impl Tasks {
    /// Returns the least and the largest value of a layer; `None` until they are computed, or when there are none.
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

    /// Returns the available results, and requests the others.
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

    /// Returns the perceived difference of two images, as a page; `None` until it is computed.
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

    /// Returns the histogram of the visible tiles; the last computed one until the new one is there.
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
