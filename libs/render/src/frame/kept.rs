//! What is kept of the frames of a camera for re-renders (reference 11).
//!
//! Grids are shaded in batches. A [`Batch`] keeps the points of its grids before the surface shaders ran, and the
//! answers that these got ([`Memo`]). When something changes that a batch depends on, its shaders run again, and most
//! of their questions find their answers.
//!
//! What the samples of a bucket see is kept as well ([`KeptBucket`]). A bucket is then composited and filtered again
//! only if a colour in it changed. Nothing is corrected by differences: every sum is formed again in its order, so that
//! a re-render has the pixels of a new render, to the bit.
//!
//! What is kept may be given up at any time, in the order of [`Layer`]. It is then computed again.

use super::{Frame, FrameShader};
use crate::output::plan::ImageLayer;
use crate::{PixelRect, Reuse};
use granita_gsl::ir::ValueType;
use granita_hider::{CompositeSettings, KeptSurfaces, ShadedGrid, Wanted};
use granita_scene::Primitive;
use granita_shade::Grid;
use granita_shading::Memo;
use parking_lot::{Mutex, RwLock};
use std::collections::{HashMap, HashSet};
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicU64, AtomicUsize, Ordering};

/// The layers of what is kept, in the order in which they are given up when "rerender:memory" is not enough.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub(crate) enum Layer {
    /// The results of each light on each grid.
    Lights,
    /// The answers to other questions of shaders.
    Queries,
    /// Grids, before and after they were shaded.
    Grids,
    /// What the samples see.
    Surfaces,
}

/// The number of layers.
const LAYERS: usize = 4;

/// A grid that is kept: the number of its batch, and its number in the batch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct GridId {
    batch: u32,
    member: u32,
}

/// A grid that was made, and its place among the kept ones.
pub(super) struct MadeGrid {
    pub(super) grid: Arc<ShadedGrid>,
    pub(super) kept: Option<GridId>,
}

/// The identity of a leaf: the number of its primitive in the scene, and a hash of the splits that led to it.
pub(super) type LeafId = (u32, u64);

/// What is kept of the frames of one camera. `O` is the state of objects.
pub(crate) struct KeptFrames<O> {
    /// The largest number of bytes; `None` without a limit.
    limit_bytes: Option<usize>,
    /// The bytes by layer.
    bytes: [AtomicUsize; LAYERS],
    /// The number of layers that were given up, from the first one.
    given_up: AtomicU8,
    batches: RwLock<Vec<Option<Arc<Batch<O>>>>>,
    grids: Mutex<HashMap<LeafId, GridId>>,
    /// The last frames, by what their samples see.
    views: Mutex<Vec<Arc<KeptView>>>,
    /// The properties of the frames that grids depend on.
    basis: Option<Basis>,
    pub(crate) counts: KeptCounts,
}

/// Numbers of what a frame took from earlier ones, and what it computed again.
#[derive(Debug, Default)]
pub(crate) struct KeptCounts {
    /// Buckets whose pixels stayed.
    pub(crate) buckets_same: AtomicU64,
    /// Buckets that were composited and filtered again.
    pub(crate) buckets_composited: AtomicU64,
    /// Batches whose colours stayed.
    pub(crate) batches_same: AtomicU64,
    /// Batches whose shaders ran again.
    pub(crate) batches_shaded: AtomicU64,
}

/// The properties of a frame that its grids depend on.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Basis {
    pub(crate) variables: Vec<(Arc<str>, ValueType)>,
    pub(crate) needs_shading: bool,
    /// True with motion blur, and with depth of field.
    pub(crate) blurs: [bool; 2],
}

/// The properties of a frame that decide what its samples see.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ViewKey {
    pub(super) crop: PixelRect,
    pub(super) strata: [[u32; 2]; 2],
    pub(super) margin: i32,
    pub(super) composite: CompositeSettings,
    pub(super) needs_second_surface: bool,
}

/// The channels and filters of the images of a frame.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ImageKey {
    pub(super) wanted: Wanted,
    pub(super) images: Vec<(Vec<ImageLayer>, Option<f32>)>,
}

/// The buckets of a frame.
pub(super) struct KeptView {
    pub(super) key: ViewKey,
    /// By the corner of the bucket.
    buckets: Mutex<HashMap<PixelRect, Arc<Mutex<KeptBucket>>>>,
}

/// What the samples of an eye see in a bucket, and the grids that they see.
pub(super) type KeptEye = (KeptSurfaces, Vec<GridId>);

/// A bucket of a frame.
pub(super) struct KeptBucket {
    /// Where blurred grids may be visible.
    pub(super) blurred: Vec<PixelRect>,
    /// For each eye: what its samples see, and the grids that they see.
    pub(super) eyes: Vec<KeptEye>,
    /// The pixels of every image.
    pub(super) pixels: Vec<Vec<f32>>,
    pub(super) images: ImageKey,
    /// The frame that the pixels are of.
    pub(super) frame: u64,
}

/// Grids that are shaded together.
pub(super) struct Batch<O> {
    /// The number of the primitive in the scene.
    pub(super) number: u32,
    pub(super) primitive: Arc<Primitive>,
    pub(super) object: Arc<O>,
    pub(super) state: Mutex<BatchState>,
}

/// The grids of a batch.
pub(super) struct BatchState {
    /// The frame that the colours are of.
    pub(super) frame: u64,
    /// The points before the surface shaders ran; `None` when no shader runs, or after they were given up.
    pub(super) inputs: Option<Grid>,
    /// True when the batch cannot be shaded again.
    lost: bool,
    /// True when the shaders must run again, because the last time they ended early.
    forgotten: bool,
    pub(super) memo: Memo,
    /// The points at later times, with their own answers.
    pub(super) later: Vec<(f32, Grid, Memo)>,
    pub(super) members: Vec<Member>,
    bytes: [usize; LAYERS],
}

/// A grid of a batch.
pub(super) struct Member {
    pub(super) leaf: LeafId,
    pub(super) grid: Arc<ShadedGrid>,
    /// The lanes of its points.
    pub(super) lanes: Range<usize>,
    /// The number of cells along each side of a micropolygon.
    pub(super) per_side: usize,
    /// The frame in which its colours changed last.
    pub(super) changed: u64,
}

/// The reason why a frame cannot be made from what is kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Broken {
    /// Something was given up.
    Lost,
    /// An opacity changed, so that samples may see other surfaces.
    Opacity,
}

impl<O> Default for KeptFrames<O> {
    fn default() -> Self {
        Self::new(None)
    }
}

impl<O> KeptFrames<O> {
    /// Returns an empty store with a limit in bytes.
    pub(crate) fn new(limit_bytes: Option<usize>) -> Self {
        Self {
            limit_bytes,
            bytes: Default::default(),
            given_up: AtomicU8::new(0),
            batches: RwLock::default(),
            grids: Mutex::default(),
            views: Mutex::default(),
            basis: None,
            counts: KeptCounts::default(),
        }
    }

    /// Prepares the store for a frame. Grids of frames with another basis are dropped. A new limit is applied.
    pub(crate) fn begin(&mut self, basis: Basis, limit_bytes: Option<usize>) {
        if self.basis.as_ref() != Some(&basis) {
            *self = Self::new(limit_bytes);
            self.basis = Some(basis);
        }
        if self.limit_bytes != limit_bytes {
            self.limit_bytes = limit_bytes;
            // With more memory, layers are kept again.
            self.given_up = AtomicU8::new(0);
        }
        self.counts = KeptCounts::default();
        self.fit();
    }

    /// True when a layer is kept.
    pub(super) fn keeps(&self, layer: Layer) -> bool {
        layer as u8 >= self.given_up.load(Ordering::Relaxed)
    }

    /// Returns the bytes by layer: the results of lights, other answers, grids, and what samples see.
    pub(crate) fn bytes(&self) -> [usize; LAYERS] {
        self.bytes.each_ref().map(|bytes| bytes.load(Ordering::Relaxed))
    }

    /// Returns what the present frame took from earlier ones. `changes` holds the numbers of lights, files and objects
    /// that changed.
    pub(super) fn reuse(&self, changes: Option<[usize; 3]>) -> Reuse {
        let [lights, files, objects] = changes.unwrap_or_default().map(|n| n as u64);
        let count = |n: &AtomicU64| n.load(Ordering::Relaxed);
        let [light_bytes, query_bytes, grid_bytes, sample_bytes] = self.bytes().map(|n| n as u64);
        Reuse {
            is_anew: changes.is_none(),
            lights_changed: lights,
            files_changed: files,
            objects_changed: objects,
            buckets_kept: count(&self.counts.buckets_same),
            buckets_composited: count(&self.counts.buckets_composited),
            batches_kept: count(&self.counts.batches_same),
            batches_shaded: count(&self.counts.batches_shaded),
            light_bytes,
            query_bytes,
            grid_bytes,
            sample_bytes,
        }
    }

    /// Keeps a batch. Returns the number of its first grid; `None` when grids are not kept.
    pub(super) fn add(&self, batch: Batch<O>) -> Option<u32> {
        if !self.keeps(Layer::Grids) {
            return None;
        }
        let batch = Arc::new(batch);
        let leaves: Vec<LeafId> = batch.state.lock().members.iter().map(|member| member.leaf).collect();
        let number = {
            let mut batches = self.batches.write();
            let number = u32::try_from(batches.len()).ok()?;
            batches.push(Some(batch.clone()));
            number
        };
        let mut grids = self.grids.lock();
        for (member, leaf) in (0..).zip(leaves) {
            grids.insert(leaf, GridId { batch: number, member });
        }
        drop(grids);
        self.weigh(&mut batch.state.lock());
        self.fit();
        Some(number)
    }

    /// Counts the bytes of a batch, and drops its parts of layers that were given up.
    pub(super) fn weigh(&self, state: &mut BatchState) {
        let before = state.bytes;
        state.drop_layers(self.given_up.load(Ordering::Relaxed));
        state.bytes = state.count();
        for (layer, (before, now)) in before.iter().zip(&state.bytes).enumerate() {
            // Both orders of these wrap back to the right sum.
            self.bytes[layer].fetch_add(now.wrapping_sub(*before), Ordering::Relaxed);
        }
    }

    /// Gives up layers until the limit holds.
    pub(super) fn fit(&self) {
        let Some(limit) = self.limit_bytes else { return };
        while self.bytes().iter().sum::<usize>() > limit {
            let level = self.given_up.load(Ordering::Relaxed);
            if usize::from(level) >= LAYERS {
                return;
            }
            self.given_up.fetch_max(level + 1, Ordering::Relaxed);
            if level >= Layer::Surfaces as u8 {
                self.drop_views_but(None);
            }
            let batches: Vec<_> = self.batches.read().iter().flatten().cloned().collect();
            for batch in batches {
                // One that is being shaded is weighed afterwards.
                if let Some(mut state) = batch.state.try_lock() {
                    self.weigh(&mut state);
                }
            }
        }
    }

    /// Returns the kept grid of a leaf.
    pub(super) fn of_leaf(&self, leaf: LeafId) -> Option<GridId> {
        self.grids.lock().get(&leaf).copied()
    }

    /// Returns the batch of a grid.
    pub(super) fn batch(&self, id: GridId) -> Option<Arc<Batch<O>>> {
        self.batches.read().get(id.batch as usize)?.clone()
    }

    /// Returns the frame whose samples see the same.
    pub(super) fn view(&self, key: &ViewKey) -> Option<Arc<KeptView>> {
        self.views.lock().iter().find(|view| view.key == *key).cloned()
    }

    /// Begins to keep what the samples of a frame see. At most two frames are kept, as those of a coarse and of a final
    /// quality.
    pub(super) fn new_view(&self, key: ViewKey) -> Arc<KeptView> {
        let view = Arc::new(KeptView { key, buckets: Mutex::default() });
        let mut views = self.views.lock();
        let old = views.iter().position(|other| other.key == view.key);
        let goes = old.or_else(|| (views.len() >= 2).then_some(0));
        if let Some(goes) = goes {
            self.remove_bytes(&views.remove(goes));
        }
        views.push(view.clone());
        view
    }

    /// Forgets what the samples of all frames see, except those of one that is being made.
    pub(super) fn drop_views_but(&self, view: Option<&Arc<KeptView>>) {
        let mut views = self.views.lock();
        let (stay, go): (Vec<_>, Vec<_>) =
            views.drain(..).partition(|other| view.is_some_and(|view| Arc::ptr_eq(view, other)));
        *views = stay;
        go.iter().for_each(|view| self.remove_bytes(view));
    }

    /// Subtracts the bytes of what the samples of a frame see.
    fn remove_bytes(&self, view: &KeptView) {
        let bytes: usize = view.buckets.lock().values().map(|bucket| bucket.lock().bytes()).sum();
        self.bytes[Layer::Surfaces as usize].fetch_sub(bytes, Ordering::Relaxed);
    }

    /// Drops all grids that no bucket sees.
    pub(crate) fn sweep(&self) {
        let mut used: HashSet<u32> = HashSet::new();
        for view in &*self.views.lock() {
            view.buckets.lock().values().for_each(|bucket| used.extend(bucket.lock().batches()));
        }
        let mut batches = self.batches.write();
        for (number, place) in (0..).zip(batches.iter_mut()) {
            if used.contains(&number) {
                continue;
            }
            let Some(batch) = place.take() else { continue };
            let state = batch.state.lock();
            for (layer, bytes) in state.bytes.iter().enumerate() {
                self.bytes[layer].fetch_sub(*bytes, Ordering::Relaxed);
            }
        }
        self.grids.lock().retain(|_, id| used.contains(&id.batch));
    }
}

impl KeptView {
    pub(super) fn bucket(&self, rect: &PixelRect) -> Option<Arc<Mutex<KeptBucket>>> {
        self.buckets.lock().get(rect).cloned()
    }

    /// True when all of these buckets are kept.
    pub(super) fn has_all(&self, rects: &[PixelRect]) -> bool {
        let buckets = self.buckets.lock();
        rects.iter().all(|rect| buckets.contains_key(rect))
    }

    /// Keeps a bucket.
    pub(super) fn keep<O>(&self, frames: &KeptFrames<O>, rect: PixelRect, bucket: KeptBucket) {
        let bytes = bucket.bytes();
        {
            // A frame that was dropped meanwhile keeps nothing. The lock orders both.
            let views = frames.views.lock();
            if !views.iter().any(|view| std::ptr::eq(&**view, self)) {
                return;
            }
            frames.bytes[Layer::Surfaces as usize].fetch_add(bytes, Ordering::Relaxed);
            self.buckets.lock().insert(rect, Arc::new(Mutex::new(bucket)));
        }
        frames.fit();
    }
}

impl KeptBucket {
    /// Returns the numbers of the batches that its samples see.
    fn batches(&self) -> impl Iterator<Item = u32> {
        self.eyes.iter().flat_map(|(_, grids)| grids).map(|id| id.batch)
    }

    /// The bytes of what its samples see.
    fn bytes(&self) -> usize {
        self.eyes.iter().map(|(kept, grids)| kept.bytes() + size_of_val(&grids[..])).sum()
    }
}

impl BatchState {
    /// Returns the state of a batch of frame `frame` whose grids were shaded from `inputs`.
    pub(super) fn new(frame: u64, inputs: Option<Grid>, memo: Memo, members: Vec<Member>) -> Self {
        Self {
            frame,
            inputs,
            lost: false,
            forgotten: false,
            memo,
            later: Vec::new(),
            members,
            bytes: [0; LAYERS],
        }
    }

    /// Drops the parts of the first `level` layers.
    fn drop_layers(&mut self, level: u8) {
        if level > Layer::Lights as u8 {
            self.memo.drop_lights();
            self.later.iter_mut().for_each(|(_, _, memo)| memo.drop_lights());
        }
        if level > Layer::Queries as u8 {
            self.memo.drop_queries();
            self.later.iter_mut().for_each(|(_, _, memo)| memo.drop_queries());
        }
        if level > Layer::Grids as u8 {
            self.lose();
        }
    }

    /// Drops all answers, which may be wrong. The shaders must run again.
    fn forget(&mut self) {
        self.forgotten = true;
        self.memo = Memo::default();
        self.later.iter_mut().for_each(|(_, _, memo)| *memo = Memo::default());
    }

    /// Drops everything.
    fn lose(&mut self) {
        self.lost = true;
        (self.inputs, self.members, self.memo) = (None, Vec::new(), Memo::default());
        self.later.clear();
    }

    fn count(&self) -> [usize; LAYERS] {
        let memos = || std::iter::once(&self.memo).chain(self.later.iter().map(|(_, _, memo)| memo));
        let lights = memos().map(|memo| memo.bytes().lights).sum();
        let queries = memos().map(|memo| memo.bytes().queries).sum();
        let inputs = self.inputs.iter().chain(self.later.iter().map(|(_, grid, _)| grid));
        let members = self.members.iter().map(|member| member.grid.bytes());
        [lights, queries, inputs.map(Grid::bytes).sum::<usize>() + members.sum::<usize>(), 0]
    }
}

impl<S: FrameShader> Frame<'_, S> {
    /// Brings the colours of a batch up to date. Its grids whose colours changed are replaced.
    pub(super) fn refresh(
        &self,
        kept: &KeptFrames<S::Object>,
        batch: &Batch<S::Object>,
        thread: &mut S::Thread<'_>,
    ) -> Result<(), Broken> {
        let now = self.shader.frame();
        let state = &mut *batch.state.lock();
        if state.lost {
            return Err(Broken::Lost);
        }
        if state.frame == now {
            return Ok(());
        }
        let since = state.frame;
        let locked = self.shader.is_locked(batch.number);
        let stale = |memo: &Memo| self.shader.is_stale(memo, since);
        let is_stale = || stale(&state.memo) || state.later.iter().any(|(_, _, memo)| stale(memo));
        if !state.forgotten && (locked || !is_stale()) {
            if !locked {
                state.frame = now;
            }
            kept.counts.batches_same.fetch_add(1, Ordering::Relaxed);
            return Ok(());
        }
        kept.counts.batches_shaded.fetch_add(1, Ordering::Relaxed);
        let result = self.recolor(batch, state, since, thread);
        if self.is_stopped() {
            state.forget();
        } else {
            (state.frame, state.forgotten) = (now, false);
        }
        kept.weigh(state);
        result
    }

    /// Runs the surface shaders of a batch again.
    fn recolor(
        &self,
        batch: &Batch<S::Object>,
        state: &mut BatchState,
        since: u64,
        thread: &mut S::Thread<'_>,
    ) -> Result<(), Broken> {
        let Some(inputs) = &state.inputs else { return Ok(()) };
        let mut grid = inputs.clone();
        self.shader.forget(&mut state.memo, since);
        let variables = Some(self.run_surface(&batch.object, &mut grid, thread, Some(&mut state.memo)));
        let mut later = Vec::with_capacity(state.later.len());
        self.shader.mute(thread, true);
        for (time, inputs, memo) in &mut state.later {
            let mut grid = inputs.clone();
            self.shader.forget(memo, since);
            let variables = Some(self.run_surface(&batch.object, &mut grid, thread, Some(memo)));
            later.push((*time, grid, variables));
        }
        self.shader.mute(thread, false);
        if self.is_stopped() {
            // Shaders ended early, so these colours are not valid.
            return Err(Broken::Lost);
        }
        let mut result = Ok(());
        for member in &mut state.members {
            let Member { grid: old, lanes, per_side, .. } = &*member;
            let of_later = later.iter().map(|(time, grid, variables)| {
                let mut shade =
                    self.shade_of(&batch.primitive, (grid, variables.as_deref()), &(0..grid.len()));
                shade.time = *time;
                shade
            });
            let shape = [old.nu, old.nv].map(|n| (n - 1) / per_side + 1);
            let (shades, opaque) = self.shades(
                &batch.primitive,
                (&grid, variables.as_deref()),
                (lanes, shape[0], *per_side),
                of_later.collect(),
            );
            let same = |a: &granita_hider::Shade, b: &granita_hider::Shade| {
                same_bits(&a.color, &b.color)
                    && a.variables.iter().map(|v| v.to_bits()).eq(b.variables.iter().map(|v| v.to_bits()))
            };
            let opacities = || shades.iter().zip(&old.shades);
            if opaque != old.opaque || !opacities().all(|(a, b)| same_bits(&a.opacity, &b.opacity)) {
                result = Err(Broken::Opacity);
            } else if opacities().all(|(a, b)| same(a, b)) {
                continue;
            }
            let (views, existing) = (old.views.clone(), old.kept.clone());
            let new = ShadedGrid { shades, opaque, views, kept: existing, ..**old };
            (member.grid, member.changed) = (Arc::new(new), self.shader.frame());
        }
        result
    }

    /// Returns a kept grid with its present colours, and the frame in which they changed last.
    pub(super) fn present(
        &self,
        kept: &KeptFrames<S::Object>,
        id: GridId,
        thread: &mut S::Thread<'_>,
    ) -> Result<(Arc<ShadedGrid>, u64), Broken> {
        let batch = kept.batch(id).ok_or(Broken::Lost)?;
        self.refresh(kept, &batch, thread)?;
        let state = batch.state.lock();
        let member = state.members.get(id.member as usize).ok_or(Broken::Lost)?;
        Ok((member.grid.clone(), member.changed))
    }
}

impl GridId {
    /// Returns the grid of this number in a batch.
    pub(super) fn new(batch: u32, member: u32) -> Self {
        Self { batch, member }
    }
}

fn same_bits(a: &[granita_base::Color], b: &[granita_base::Color]) -> bool {
    let bits = |c: &granita_base::Color| c.to_array().map(f32::to_bits);
    a.len() == b.len() && a.iter().map(bits).eq(b.iter().map(bits))
}
