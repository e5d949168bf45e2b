//! The answers that the shaders of a grid got, kept for re-renders.
//!
//! A re-render runs the shaders of a grid again when something changed that they depend on. Most of their time goes to
//! questions whose answers stay the same: texture lookups, shadow rays, occlusion, the light of lights that did not
//! change. A [`Memo`] keeps these answers. The key of an answer is a hash of everything that the question holds, values
//! of all points included. An answer is therefore found only when it would be computed to the same bits. Each answer
//! names the lights, files and objects that it depends on ([`Dependencies`]), and is dropped when one of these changes.

mod dependencies;
mod key;

pub use dependencies::Changes;
pub(crate) use dependencies::{Dependencies, Dependency};
pub(crate) use key::{Key, KeyHasher};

use granita_rays::SetHit;
use granita_shade::{Lanes3, LightResult, LookupResult, PartValues, PrimvarData, TraceResult};
use std::collections::HashMap;
use std::sync::Arc;

/// An answer of a service.
#[derive(Clone, Debug)]
pub(crate) enum Answer {
    /// Of `illuminate`.
    Light(Arc<LightResult>),
    /// Of `shadow` and `indirect`.
    Lanes3(Lanes3),
    /// Of `occlusion`: the blocked share, and the mean open direction.
    Occlusion(Vec<f32>, Lanes3),
    /// Of `texture`, `texture3d` and `environment`.
    Lookup(Box<LookupResult>),
    /// Of `trace`.
    Trace(Box<TraceResult>),
    /// The nearest hits of rays whose hits are shaded. They stay when lights change.
    Hits(Arc<[SetHit]>),
    /// The values of a part of a shader. It is the answer to no question.
    Part(Arc<PartValues>),
}

/// An answer with its dependencies.
#[derive(Clone, Debug)]
pub(crate) struct Entry {
    pub(crate) answer: Answer,
    pub(crate) depends: Dependencies,
    /// By how much the question advanced the count of calls that draw random numbers.
    pub(crate) calls: u32,
    /// The lanes whose own counts it advanced by one.
    pub(crate) counted: Vec<u32>,
    /// The questions that were asked to answer this one.
    parts: Vec<Key>,
    /// The bytes that the answer takes.
    bytes: usize,
    /// True when the last run asked for it.
    used: bool,
}

impl Entry {
    pub(crate) fn new(answer: Answer, depends: Dependencies, calls: u32, counted: Vec<u32>) -> Self {
        let bytes = answer.bytes() + 4 * counted.len() + depends.bytes() + size_of::<(Key, Self)>();
        Self { answer, depends, calls, counted, parts: Vec::new(), bytes, used: true }
    }
}

/// The answers that the shaders of one grid got.
#[derive(Clone, Debug, Default)]
pub struct Memo {
    entries: HashMap<Key, Entry>,
    /// What the result of the whole run depends on.
    depends: Dependencies,
    /// The questions that are being answered, each with those that were asked for it.
    open: Vec<Vec<Key>>,
}

/// The bytes of a [`Memo`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MemoBytes {
    /// The results of lights.
    pub lights: usize,
    /// All other answers.
    pub queries: usize,
}

impl Memo {
    /// True when something changed that the shaders' results depend on.
    pub fn is_stale(&self, changes: &Changes) -> bool {
        changes.touch(&self.depends)
    }

    /// Drops the answers that depend on something that changed.
    pub fn forget(&mut self, changes: &Changes) {
        self.entries.retain(|_, entry| !changes.touch(&entry.depends));
    }

    /// Begins a run.
    pub(crate) fn begin(&mut self) {
        self.open.clear();
        self.entries.values_mut().for_each(|entry| entry.used = false);
    }

    /// Ends a run whose result depends on `depends`. Answers that it did not ask for are dropped.
    pub(crate) fn end(&mut self, depends: Dependencies) {
        self.entries.retain(|_, entry| entry.used);
        self.entries.shrink_to_fit();
        self.depends = depends;
    }

    /// Returns the answer to a question. It stays, and so do the answers that it was made of.
    pub(crate) fn find(&mut self, key: Key) -> Option<&Entry> {
        if !self.entries.contains_key(&key) {
            return None;
        }
        let mut uses = vec![key];
        while let Some(key) = uses.pop() {
            if let Some(entry) = self.entries.get_mut(&key).filter(|entry| !entry.used) {
                entry.used = true;
                uses.extend(&entry.parts);
            }
        }
        self.asked(key);
        self.entries.get(&key)
    }

    /// True when the answer to a question is kept.
    pub(crate) fn has(&self, key: Key) -> bool {
        self.entries.contains_key(&key)
    }

    /// Returns what an answer depends on.
    pub(crate) fn depends(&self, key: Key) -> Option<&Dependencies> {
        self.entries.get(&key).map(|entry| &entry.depends)
    }

    /// Begins to answer a question.
    pub(crate) fn open(&mut self) {
        self.open.push(Vec::new());
    }

    /// Ends the answer to the question that was opened last. `entry` is kept, if there is one.
    pub(crate) fn close(&mut self, key: Key, entry: Option<Entry>) {
        let parts = self.open.pop().unwrap_or_default();
        match entry {
            Some(entry) => {
                self.entries.insert(key, Entry { parts, ..entry });
                self.asked(key);
            }
            None => parts.into_iter().for_each(|part| self.asked(part)),
        }
    }

    /// Notes that a question was asked for the one that is being answered.
    fn asked(&mut self, key: Key) {
        if let Some(parts) = self.open.last_mut() {
            parts.push(key);
        }
    }

    /// Returns the bytes that it takes.
    pub fn bytes(&self) -> MemoBytes {
        let mut bytes = MemoBytes { lights: 0, queries: self.depends.bytes() };
        let of = |lights: bool| {
            let entries = self.entries.values().filter(|e| matches!(e.answer, Answer::Light(_)) == lights);
            entries.map(|entry| entry.bytes).sum::<usize>()
        };
        bytes.lights += of(true);
        bytes.queries += of(false);
        bytes
    }

    /// Drops the results of lights.
    pub fn drop_lights(&mut self) {
        self.entries.retain(|_, entry| !matches!(entry.answer, Answer::Light(_)));
    }

    /// Drops all answers except the results of lights.
    pub fn drop_queries(&mut self) {
        self.entries.retain(|_, entry| matches!(entry.answer, Answer::Light(_)));
    }
}

impl Answer {
    fn bytes(&self) -> usize {
        let of = |values: &Vec<f32>| 4 * values.len();
        let of3 = |lanes: &Lanes3| lanes.xyz.iter().map(of).sum::<usize>();
        match self {
            Self::Light(result) => {
                let sample = |s: &granita_shade::LightSample| {
                    of3(&s.l) + of3(&s.cl) + of3(&s.pl) + of3(&s.nl) + s.lit.len()
                };
                let message = |m: &granita_shade::Primvar| match &m.data {
                    PrimvarData::Floats { values, .. } => of(values),
                    PrimvarData::Strings(list) => 32 * list.len(),
                };
                result.samples.iter().map(sample).sum::<usize>()
                    + result.ambient.as_ref().map_or(0, of3)
                    + of(&result.nondiffuse)
                    + of(&result.nonspecular)
                    + result.messages.iter().map(message).sum::<usize>()
            }
            Self::Lanes3(lanes) => of3(lanes),
            Self::Hits(hits) => size_of_val(&**hits),
            Self::Part(values) => values.bytes(),
            Self::Occlusion(blocked, open) => of(blocked) + of3(open),
            Self::Lookup(found) => {
                found.value.iter().map(of).sum::<usize>()
                    + of(&found.alpha)
                    + of(&found.hitdist)
                    + of3(&found.p_hit)
                    + of3(&found.n_hit)
                    + of3(&found.direction)
            }
            Self::Trace(found) => {
                let TraceResult { hit, hitdist, l, ps, cl, ol, p, others } = &**found;
                let lanes: usize = [l, ps, cl, ol, p].into_iter().map(of3).sum();
                let others: usize = others.iter().map(|o| o.there.len() + of(&o.values)).sum();
                hit.len() + of(hitdist) + lanes + others
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_scene::LightId;

    #[test]
    fn answers_are_dropped_with_what_they_depend_on() {
        let mut memo = Memo::default();
        let on = |list: &[Dependency]| list.iter().copied().collect::<Dependencies>();
        let light = |id| Dependency::Light(LightId(id));
        let key = |word: u32| {
            let mut hasher = KeyHasher::default();
            hasher.word(word);
            hasher.finish()
        };
        memo.begin();
        let answer = || Answer::Lanes3(Lanes3::zeros(2));
        memo.open();
        memo.open();
        memo.close(key(2), Some(Entry::new(answer(), on(&[Dependency::File(1)]), 1, Vec::new())));
        memo.close(key(1), Some(Entry::new(answer(), on(&[light(1)]), 1, Vec::new())));
        memo.end(on(&[light(1), Dependency::File(1)]));
        // An answer stays while one that it is part of is asked for.
        memo.begin();
        assert!(memo.find(key(1)).is_some());
        memo.end(on(&[light(1), Dependency::File(1)]));
        let changes = Changes::of(&[light(1)]);
        assert!(memo.is_stale(&changes) && !memo.is_stale(&Changes::of(&[light(2), Dependency::File(2)])));
        memo.forget(&changes);
        assert!(memo.find(key(1)).is_none() && memo.find(key(2)).is_some());
        // What a run does not ask for is dropped at its end.
        memo.begin();
        memo.end(Dependencies::default());
        assert!(memo.find(key(2)).is_none() && memo.bytes() == MemoBytes::default());
    }
}
