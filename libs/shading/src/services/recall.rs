//! Answers of services that are kept for re-renders ([`crate::Memo`]), and the notes of what results depend on.

use super::Run;
use crate::memo::{Answer, Dependencies, Dependency, Entry, Key, KeyHasher};
use crate::object::RayScene;
use granita_rays::RayRequest;
use granita_scene::ShaderUsage;
use granita_shade::{
    Batch, EnvironmentQuery, GatherQuery, Grid, Lane3, Lanes3, Message, PartValues, Recall, ShadowQuery,
    Texture3dQuery, TextureQuery, TraceQuery,
};
use std::sync::Arc;

/// The kinds of questions whose answers are kept.
#[derive(Clone, Copy, Debug)]
#[repr(u32)]
pub(super) enum Question {
    Texture,
    Texture3d,
    Environment,
    Shadow,
    Occlusion,
    Indirect,
    Trace,
    Light,
    Hits,
    Part,
}

/// What is known about a question.
pub(super) enum Asked {
    /// Its answer.
    Known(Answer),
    /// It must be answered. The answer is kept with [`Run::keep`].
    New(Ticket),
    /// Answers are not kept.
    Unkept,
}

/// A question that is being answered.
pub(super) struct Ticket {
    key: Key,
    /// The notes of the run before the question.
    outer: Option<Dependencies>,
    calls: u32,
    lane_calls: Vec<u32>,
}

impl Run<'_, '_> {
    /// Notes that the result depends on something.
    pub(super) fn note(&mut self, one: Dependency) {
        self.thread.note(one);
    }

    /// Notes that the result depends on a file.
    pub(super) fn note_file(&mut self, name: &str) {
        if !self.frame.keeps || name.is_empty() {
            return;
        }
        let shapes = self.shaders.usage == ShaderUsage::Displacement;
        if shapes || self.thread.notes.is_some() {
            let file = self.frame.files_used.number(name);
            self.note(Dependency::File(file));
            if shapes {
                self.frame.files_used.shapes(file);
            }
        }
    }

    /// Returns the notes since `outer` was taken, and adds them to it. They are shared by what was computed together.
    pub(super) fn noted_since(&mut self, outer: Option<Dependencies>) -> Arc<Dependencies> {
        let Some(mut outer) = outer else { return Arc::default() };
        let mut new = self.thread.notes.take().unwrap_or_default();
        outer.add_all(&new);
        self.thread.notes = Some(outer);
        new.shrink();
        Arc::new(new)
    }

    /// True when answers are kept: for grids that a camera sees, for what their rays hit, and for their lights. Records
    /// of indirect light are kept instead of what their many rays hit.
    pub(super) fn keeps_answers(&self) -> bool {
        self.thread.memo.is_some() && !self.ray.shadow && !self.ray.indirect && !self.thread.builds_rays
    }

    /// Looks for the answer to a question. `hash` adds the question to its key.
    pub(super) fn ask(&mut self, question: Question, hash: impl FnOnce(&Self, &mut KeyHasher)) -> Asked {
        if !self.keeps_answers() || self.is_anew {
            return Asked::Unkept;
        }
        let mut hasher = KeyHasher::default();
        hasher.word(question as u32);
        self.hash_run(&mut hasher);
        hash(self, &mut hasher);
        let key = hasher.finish();
        let Some(memo) = &mut self.thread.memo else { return Asked::Unkept };
        if let Some(entry) = memo.find(key) {
            self.calls += entry.calls;
            for lane in &entry.counted {
                if let Some(count) = self.lane_calls.get_mut(*lane as usize) {
                    *count += 1;
                }
            }
            if let Some(notes) = &mut self.thread.notes {
                notes.add_all(&entry.depends);
            }
            return Asked::Known(entry.answer.clone());
        }
        memo.open();
        let outer = self.thread.notes.replace(Dependencies::default());
        Asked::New(Ticket { key, outer, calls: self.calls, lane_calls: self.lane_calls.clone() })
    }

    /// Keeps the answer to a question that was asked, if answers are kept.
    pub(super) fn keep(&mut self, asked: Asked, answer: impl FnOnce() -> Answer) {
        let Asked::New(Ticket { key, outer, calls, lane_calls }) = asked else { return };
        let mut depends = std::mem::replace(&mut self.thread.notes, outer).unwrap_or_default();
        if let Some(notes) = &mut self.thread.notes {
            notes.add_all(&depends);
        }
        depends.shrink();
        let (mut counted, mut keeps) = (Vec::new(), true);
        for (lane, (now, before)) in self.lane_calls.iter().zip(&lane_calls).enumerate() {
            match now - before {
                0 => {}
                1 => counted.push(lane as u32),
                // No question counts more than one call. One that does is answered again.
                _ => keeps = false,
            }
        }
        let entry = keeps.then(|| Entry::new(answer(), depends, self.calls - calls, counted));
        if let Some(memo) = &mut self.thread.memo {
            memo.close(key, entry);
        }
    }

    /// Adds everything about the run that answers may depend on, besides the grid.
    fn hash_run(&self, hasher: &mut KeyHasher) {
        hasher.word(self.shaders.usage as u32);
        if let Some(hit) = self.hits {
            hasher.bytes(bytemuck::cast_slice(&hit));
        }
        if self.shaders.usage == ShaderUsage::Light {
            hasher.text(&self.owner);
        }
        hasher.word(self.shadow_bias.to_bits());
        hasher.word(u32::from(self.gathers_in_front));
        match self.seeds.list() {
            None => hasher.words(&[self.calls, self.seed]),
            Some(seeds) => {
                hasher.words(seeds);
                hasher.words(&self.lane_calls);
            }
        }
        hasher.word(self.ray.bounces);
        self.paths.iter().for_each(|path| hasher.words(&path.words()));
    }
}

impl Run<'_, '_> {
    /// Returns the key of a part of the shaders that run.
    fn key_of_part(&self, part: u32) -> Key {
        let mut hasher = KeyHasher::default();
        hasher.words(&[Question::Part as u32, self.shaders.usage as u32, part]);
        hasher.finish()
    }
}

impl Recall for Run<'_, '_> {
    fn keeps_parts(&mut self) -> bool {
        // Of what rays hit, whole results are kept.
        let is_seen = self.ray.level == 0 && self.hits.is_none();
        is_seen && self.shaders.usage != ShaderUsage::Light && self.keeps_answers()
    }

    fn is_part_kept(&mut self, part: u32) -> bool {
        let key = self.key_of_part(part);
        self.thread.memo.as_ref().is_some_and(|memo| memo.has(key))
    }

    fn recall_part(&mut self, part: u32) -> Option<Arc<PartValues>> {
        let key = self.key_of_part(part);
        let entry = self.thread.memo.as_mut()?.find(key)?;
        let Answer::Part(values) = &entry.answer else { return None };
        if let Some(notes) = &mut self.thread.notes {
            notes.add_all(&entry.depends);
        }
        Some(values.clone())
    }

    fn begin_part(&mut self, sees_lights: bool) {
        if let Some(memo) = &mut self.thread.memo {
            memo.open();
        }
        self.part = self.thread.notes.replace(Dependencies::default());
        if sees_lights {
            self.note(Dependency::Object(self.object.number));
        }
    }

    fn end_part(&mut self, part: u32, reads: &[u32], values: &Arc<PartValues>) {
        let key = self.key_of_part(part);
        let outer = self.part.take();
        let mut depends = std::mem::replace(&mut self.thread.notes, outer).unwrap_or_default();
        let sources: Vec<Key> = reads.iter().map(|part| self.key_of_part(*part)).collect();
        let Some(memo) = &mut self.thread.memo else { return };
        for source in sources {
            if let Some(more) = memo.depends(source) {
                depends.add_all(more);
            }
        }
        if let Some(notes) = &mut self.thread.notes {
            notes.add_all(&depends);
        }
        depends.shrink();
        memo.close(key, Some(Entry::new(Answer::Part(values.clone()), depends, 0, Vec::new())));
    }
}

/// Returns the key of a grid of ray hits. Other grids have none, because a memo belongs to one of them.
pub(super) fn key_of_hits(grid: &Grid, object: u32) -> Option<Key> {
    if grid.ray.level == 0 {
        return None;
    }
    let mut hasher = KeyHasher::default();
    hasher.words(&[object, grid.ray.level, grid.time.to_bits(), grid.dtime.to_bits(), grid.seed]);
    for lanes in [&grid.p, &grid.n, &grid.ng, &grid.i] {
        hasher.lanes3(lanes);
    }
    hasher.numbers(&grid.u);
    hasher.numbers(&grid.v);
    grid.parent.iter().for_each(|value| hasher.primvar(value));
    Some(hasher.finish())
}

/// Returns the key of the nearest hits of rays in a geometry set.
pub(crate) fn nearest(scene: &RayScene, rays: &[RayRequest]) -> Key {
    let mut hasher = KeyHasher::default();
    hasher.words(&[Question::Hits as u32, scene.number(), rays.len() as u32]);
    for request in rays {
        let RayRequest { ray, leaving, departure, width, spread, .. } = request;
        let ([x, y, z], [dx, dy, dz]) = (ray.origin.to_array(), ray.dir.to_array());
        let numbers = [x, y, z, dx, dy, dz, ray.tmin, ray.tmax, ray.time, *width, *spread];
        hasher.bytes(bytemuck::cast_slice(&numbers));
        hasher.bytes(bytemuck::cast_slice(&leaving.words()));
        if let Some(departure) = departure {
            hasher.words(&departure.words());
        }
    }
    hasher.finish()
}

pub(super) fn texture(hasher: &mut KeyHasher, query: &TextureQuery<'_>) {
    let batch = query.batch;
    named(hasher, batch, query.name, &[]);
    hasher.word(query.channels as u32);
    for lane in [query.s, query.t, query.dsdx, query.dtdx, query.dsdy, query.dtdy] {
        hasher.lane(lane, batch);
    }
    options(hasher, batch, |number, text| query.options.visit(number, text));
}

pub(super) fn texture3d(hasher: &mut KeyHasher, query: &Texture3dQuery<'_>) {
    named(hasher, query.batch, query.name, &[query.p, query.dpdx, query.dpdy]);
    hasher.word(query.channels as u32);
    options(hasher, query.batch, |number, text| query.options.visit(number, text));
}

pub(super) fn environment(hasher: &mut KeyHasher, query: &EnvironmentQuery<'_>) {
    let lanes = [query.p, query.r, query.drdx, query.drdy, query.dpdx, query.dpdy];
    named(hasher, query.batch, query.name, &lanes);
    hasher.word(query.channels as u32);
    options(hasher, query.batch, |number, text| query.options.visit(number, text));
    query.messages.iter().for_each(|message| hasher.primvar(message));
}

pub(super) fn shadow(hasher: &mut KeyHasher, query: &ShadowQuery<'_>) {
    named(hasher, query.batch, query.name, &[query.p, query.dpdx, query.dpdy, query.to_light]);
    hasher.word(u32::from(query.light_infinite));
    options(hasher, query.batch, |number, text| query.options.visit(number, text));
    query.messages.iter().for_each(|message| hasher.primvar(message));
}

pub(super) fn gather(hasher: &mut KeyHasher, query: &GatherQuery<'_>) {
    aimed(hasher, query.batch, query.set, [query.p, query.axis], [query.angle, query.samples]);
    options(hasher, query.batch, |number, text| query.options.visit(number, text));
    query.messages.iter().for_each(|message| hasher.primvar(message));
}

pub(super) fn trace(hasher: &mut KeyHasher, query: &TraceQuery<'_>) {
    aimed(hasher, query.batch, query.set, [query.p, query.axis], [query.angle, query.samples]);
    hasher.word(query.sample);
    options(hasher, query.batch, |number, text| query.options.visit(number, text));
    for (name, ty) in query.wanted {
        hasher.text(name);
        hasher.word(*ty as u32);
    }
    query.messages.iter().for_each(|message| hasher.primvar(message));
}

/// Adds a question about a light. `shared` is the key of what all lights are asked ([`LightMemory::key`]), and `colors`
/// are those of the grid where they may differ from run to run.
///
/// [`LightMemory::key`]: crate::lighting::lights::LightMemory::key
pub(super) fn light(hasher: &mut KeyHasher, shared: Key, messages: &[Message], colors: Option<[&Lanes3; 2]>) {
    hasher.bytes(bytemuck::cast_slice(&shared));
    for Message { from, value } in messages {
        hasher.word(*from as u32);
        hasher.primvar(value);
    }
    colors.into_iter().flatten().for_each(|lanes| hasher.lanes3(lanes));
}

/// Adds the active lanes, the name of what is asked, and triples.
fn named(hasher: &mut KeyHasher, batch: Batch<'_>, name: &str, triples: &[Lane3<'_>]) {
    hasher.batch(batch);
    hasher.text(name);
    triples.iter().for_each(|lanes| hasher.lane3(*lanes, batch));
}

/// Adds a question that sends rays into cones: the geometry set, positions and axes, angles and numbers of samples.
fn aimed(
    hasher: &mut KeyHasher,
    batch: Batch<'_>,
    set: &str,
    cones: [Lane3<'_>; 2],
    sizes: [granita_shade::Lane<'_>; 2],
) {
    named(hasher, batch, set, &cones);
    sizes.into_iter().for_each(|lanes| hasher.lane(lanes, batch));
}

/// Adds the options that `visit` visits.
fn options<'q>(
    hasher: &mut KeyHasher,
    batch: Batch<'_>,
    visit: impl FnOnce(&mut dyn FnMut(Option<granita_shade::Lane<'q>>), &mut dyn FnMut(Option<&'q str>)),
) {
    let hasher = std::cell::RefCell::new(hasher);
    visit(&mut |number| hasher.borrow_mut().option(number, batch), &mut |text| {
        hasher.borrow_mut().optional_text(text)
    });
}

/// Copies the active lanes of an answer.
pub(super) fn copy3(from: &Lanes3, to: &mut Lanes3, batch: Batch<'_>) {
    super::maps::fit(to, batch.lanes);
    if batch.active.len() == batch.lanes {
        to.clone_from(from);
        return;
    }
    batch.active.iter().for_each(|i| to.set(*i as usize, from.get(*i as usize)));
}
