//! Renders one bucket: collect, hide, filter.

use super::job::{Job, LeafSlot, LeafState, Sighting};
use super::kept::{Broken, GridId, KeptBucket, KeptEye, KeptFrames, Layer, MadeGrid};
use super::{Frame, FrameShader, Jobs};
use crate::PixelRect;
use crate::output::griddump::Described;
use crate::output::plan::ImageLayer;
use crate::statistics::{add, add_time};
use granita_dicing::Leaf;
use granita_hider::film;
use granita_hider::{KeptSurfaces, Resolved, SampleGrid, ShadedGrid, Surfaces, ViewedGrid, pixels_of};
use parking_lot::MutexGuard;
use std::cmp::{Ordering, Reverse};
use std::collections::{BinaryHeap, HashMap, VecDeque};
use std::sync::{Arc, atomic};
use std::time::Instant;

/// The largest number of points of a grid that may be batched.
pub(super) const SMALL_POINTS: usize = 256;
/// The approximate number of points of batched grids.
const JOINED_POINTS: usize = 1024;

/// The next item of a bucket: a primitive, or a grid of it.
#[derive(Clone, Copy, Debug)]
struct Turn {
    /// The depth of its nearest part in camera units.
    z: f32,
    job: usize,
    leaf: Option<u32>,
}

impl Ord for Turn {
    fn cmp(&self, other: &Self) -> Ordering {
        self.z.total_cmp(&other.z).then(self.job.cmp(&other.job)).then(self.leaf.cmp(&other.leaf))
    }
}

impl PartialOrd for Turn {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Turn {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Turn {}

/// What is rendered at once: a bucket, or a part of it.
pub(super) struct Area {
    /// The number of the bucket.
    pub(super) index: usize,
    /// The pixels.
    pub(super) rect: PixelRect,
}

impl<S: FrameShader> Frame<'_, S> {
    /// Returns the area of a whole bucket.
    pub(super) fn whole(&self, index: usize) -> Area {
        Area { index, rect: self.buckets.order[index] }
    }

    /// True when an area is a whole bucket. Grids are dropped when all of their buckets are done. A part of a bucket
    /// leaves the grids to it.
    fn is_whole(&self, area: &Area) -> bool {
        area.rect == self.buckets.order[area.index]
    }

    /// Renders a bucket, or a part of it. Returns the pixels of every image.
    pub(super) fn bucket(
        &self,
        jobs: &Jobs<S::Object>,
        area: &Area,
        thread: &mut S::Thread<'_>,
    ) -> Vec<Vec<f32>> {
        let Area { index, rect } = *area;
        let blurred = self.blurred(jobs, index);
        let samples = self.samples(&rect, &blurred);
        let mut pixels = Vec::new();
        let mut eyes = Vec::with_capacity(self.eyes.len());
        for eye in 0..self.eyes.len() {
            let (of_eye, kept) = self.seen_by(eye, (jobs, area), &samples, thread);
            pixels.extend(of_eye);
            eyes.extend(kept);
        }
        add(&self.counters.samples, self.eyes.len() * samples.within(&rect));
        if let (Some(kept), Some(view)) = (self.kept, &self.view)
            && eyes.len() == self.eyes.len()
            && kept.keeps(Layer::Surfaces)
            && !self.is_stopped()
        {
            let (frame, images) = (self.shader.frame(), self.image_key());
            view.keep(kept, rect, KeptBucket { blurred, eyes, pixels: pixels.clone(), images, frame });
        }
        pixels
    }

    /// Returns the samples of a bucket, and those around it that the filters need.
    fn samples(&self, rect: &PixelRect, blurred: &[PixelRect]) -> SampleGrid {
        SampleGrid::new(rect.grown(self.margin), &self.pattern, self.options.camera, blurred)
    }

    /// Renders a bucket again whose samples see what they saw. Returns the pixels of every image.
    ///
    /// # Errors
    /// Returns the reason why the whole frame must be rendered anew.
    pub(super) fn bucket_again(
        &self,
        kept: &KeptFrames<S::Object>,
        index: usize,
        thread: &mut S::Thread<'_>,
    ) -> Result<Vec<Vec<f32>>, Broken> {
        let rect = self.buckets.order[index];
        let bucket = self.view.as_ref().and_then(|view| view.bucket(&rect)).ok_or(Broken::Lost)?;
        let bucket = &mut *bucket.lock();
        let mut changed = 0;
        let mut eyes = Vec::with_capacity(bucket.eyes.len());
        for (_, ids) in &bucket.eyes {
            let mut grids = Vec::with_capacity(ids.len());
            for id in ids {
                let (grid, frame) = self.present(kept, *id, thread)?;
                changed = changed.max(frame);
                grids.push(grid);
            }
            eyes.push(grids);
        }
        let images = self.image_key();
        if changed <= bucket.frame && bucket.images == images {
            add(&kept.counts.buckets_same, 1);
            return Ok(bucket.pixels.clone());
        }
        if images.images.iter().any(|(_, width)| width.is_some()) && bucket.images != images {
            // The texels of volume shadow maps need all surfaces.
            return Err(Broken::Lost);
        }
        add(&kept.counts.buckets_composited, 1);
        let begin = Instant::now();
        let samples = self.samples(&rect, &bucket.blurred);
        let resolved: Vec<Resolved> = bucket
            .eyes
            .iter()
            .zip(&eyes)
            .map(|((surfaces, _), grids)| surfaces.resolve(&samples, grids, &self.outputs.wanted))
            .collect();
        add_time(&self.counters.hide_nanos, begin.elapsed());
        let begin = Instant::now();
        let before = &bucket.pixels;
        let volume = |k: usize| before.get(k).cloned().unwrap_or_default();
        let of_eye = |(eye, resolved): (usize, &Resolved)| {
            let first = eye * self.outputs.images.len();
            self.filtered(&rect, &|image, _, _| volume(first + image), &samples, resolved)
        };
        let pixels: Vec<Vec<f32>> = resolved.iter().enumerate().flat_map(of_eye).collect();
        add_time(&self.counters.filter_nanos, begin.elapsed());
        bucket.pixels.clone_from(&pixels);
        (bucket.images, bucket.frame) = (images, self.shader.frame());
        Ok(pixels)
    }

    /// Returns the kept grids of leaves that have them.
    fn find_kept(
        &self,
        job: &Job<S::Object>,
        leaves: &mut [(u32, &LeafSlot, MutexGuard<'_, LeafState>)],
        thread: &mut S::Thread<'_>,
    ) {
        let Some(kept) = self.kept.filter(|_| !job.traits.saves) else { return };
        for (_, slot, state) in leaves.iter_mut().filter(|(_, _, state)| state.leaf().is_some()) {
            let Some(id) = kept.of_leaf((job.number, slot.path)) else { continue };
            // A change of opacity has no effect on the samples of this frame, whose surfaces are searched anew.
            let grid = match self.present(kept, id, thread) {
                Ok((grid, _)) => grid,
                Err(Broken::Opacity) => {
                    // Those of other frames saw something else.
                    kept.drop_views_but(self.view.as_ref());
                    match self.present(kept, id, thread) {
                        Ok((grid, _)) => grid,
                        Err(_) => continue,
                    }
                }
                Err(Broken::Lost) => continue,
            };
            let fits =
                |(view, seen): (&ViewedGrid, &Sighting)| (view.rect, view.z_min) == (seen.rect, seen.z_min);
            let grid = match grid.views.iter().zip(&slot.seen).all(fits) {
                true => grid,
                false => {
                    let mut moved = ShadedGrid::clone(&grid);
                    for (view, seen) in Arc::make_mut(&mut moved.views).iter_mut().zip(&slot.seen) {
                        (view.rect, view.z_min) = (seen.rect, seen.z_min);
                    }
                    Arc::new(moved)
                }
            };
            slot.keep(state, Some(MadeGrid { grid, kept: Some(id) }));
        }
    }

    /// Returns where blurred grids may be visible in a bucket. Only primitives that may blur are split for that.
    fn blurred(&self, jobs: &Jobs<S::Object>, index: usize) -> Vec<PixelRect> {
        let place = self.place(u32::try_from(index).unwrap_or(u32::MAX));
        let mut blurred = Vec::new();
        for eye in 0..self.eyes.len() {
            for &job in &jobs.of_bucket[index] {
                let job = &jobs.list[job];
                if job.seen[eye].blurs {
                    let split = self.split(job);
                    let seen = split.leaves_of(eye, place).map(|leaf| &split.leaves[leaf as usize].seen[eye]);
                    blurred.extend(seen.filter(|seen| seen.blurs).map(|seen| seen.rect));
                }
            }
        }
        blurred
    }

    /// Renders the view of an eye in a bucket or a part of it. Returns the pixels of every image.
    fn seen_by(
        &self,
        eye: usize,
        (jobs, area): (&Jobs<S::Object>, &Area),
        samples: &SampleGrid,
        thread: &mut S::Thread<'_>,
    ) -> (Vec<Vec<f32>>, Option<KeptEye>) {
        let (index, is_whole) = (area.index, self.is_whole(area));
        let mut surfaces =
            Surfaces::new(samples, self.composite).with_layers(self.layers_at_once(jobs, index));
        // The kept grids that were added; `None` when one of them is not kept.
        let mut ids = self.kept.map(|_| Vec::new());
        let bucket = u32::try_from(index).unwrap_or(u32::MAX);
        let place = self.place(bucket);
        // The order is front to back, so that hidden parts are culled before they are split and shaded. The order
        // of any two grids is the same in every bucket. A primitive comes before its grids, whose depth is not
        // less.
        let mut order: BinaryHeap<Reverse<Turn>> = BinaryHeap::new();
        let turn = |z: f32, job: usize, leaf: Option<u32>| Reverse(Turn { z, job, leaf });
        let here = |job: &Job<S::Object>| !job.seen[eye].rect.intersection(&samples.rect).is_empty();
        let near = jobs.of_bucket[index].iter().filter(|j| here(&jobs.list[**j]));
        order.extend(near.map(|&j| turn(jobs.list[j].seen[eye].z_min, j, None)));
        // Those with parts that may be nearer than their turn says, which are few.
        let is_loose = |turn: &Turn| self.least_depth(eye, jobs, *turn) < turn.z;
        let mut loose: Vec<Turn> = order.iter().map(|Reverse(turn)| *turn).filter(is_loose).collect();
        let mut hiding = std::time::Duration::ZERO;
        // The next turns of each primitive whose grids may be batched, in order.
        let mut next_of: HashMap<usize, VecDeque<Turn>> = HashMap::new();
        while let Some(Reverse(Turn { z, job: j, leaf })) = order.pop() {
            let job = &jobs.list[j];
            // Surfaces behind the first one count for "avgz".
            let may_cull = job.culls_hidden && !self.outputs.needs_second_surface;
            let Some(slot_number) = leaf else {
                if may_cull && surfaces.hides(&job.seen[eye].rect, z) {
                    add(&self.counters.primitives_hidden, 1);
                    if is_whole {
                        self.pass(job, eye, bucket);
                    }
                } else {
                    let split = self.split(job);
                    let z_of = |leaf: u32| split.leaves[leaf as usize].seen[eye].z_min.max(z);
                    let in_view = |leaf: &u32| {
                        let slot = &split.leaves[*leaf as usize];
                        if !slot.is_elsewhere(eye, &place) {
                            return is_whole || !slot.seen[eye].rect.intersection(&samples.rect).is_empty();
                        }
                        if is_whole {
                            slot.release(eye, &place);
                        }
                        false
                    };
                    let turns = split.leaves_of(eye, place).filter(in_view).map(|leaf| Turn {
                        z: z_of(leaf),
                        job: j,
                        leaf: Some(leaf),
                    });
                    let mut turns: Vec<Turn> = turns.collect();
                    order.extend(turns.iter().copied().map(Reverse));
                    loose.extend(turns.iter().copied().filter(is_loose));
                    if job.traits.may_batch && !job.traits.saves && turns.len() > 1 {
                        turns.sort_unstable();
                        next_of.insert(j, turns.into());
                    }
                }
                continue;
            };
            let slots = &self.split(job).leaves;
            let slot = &slots[slot_number as usize];
            let mut hidden = |leaf: &LeafSlot, z: f32| may_cull && surfaces.hides(&leaf.seen[eye].rect, z);
            if hidden(slot, z) {
                add(&self.counters.grids_hidden, 1);
            } else {
                let mut state = slot.lock();
                if let Some(points) = state.leaf().map(|leaf| leaf.rates.nu * leaf.rates.nv) {
                    let mut together = vec![(slot_number, slot, state)];
                    if points <= SMALL_POINTS
                        && let Some(next) = next_of.get_mut(&j)
                    {
                        // A turn that is left out now does not come back: its grid is made, hidden or large.
                        let mut points = points;
                        while points < JOINED_POINTS
                            && let Some(turn) = next.pop_front()
                        {
                            let Some(number) = turn.leaf.filter(|number| *number != slot_number) else {
                                continue;
                            };
                            let slot = &slots[number as usize];
                            let Some(state) = slot.lock_early().filter(|_| !hidden(slot, turn.z)) else {
                                continue;
                            };
                            let more = state.leaf().map_or(0, |leaf| leaf.rates.nu * leaf.rates.nv);
                            if more <= SMALL_POINTS {
                                points += more;
                                together.push((number, slot, state));
                            }
                        }
                    }
                    state = self.make(job, j, together, thread);
                }
                let grid = state.grid().filter(|_| !slot.is_elsewhere(eye, &place));
                drop(state);
                if let Some((grid, id)) = grid {
                    ids = ids.zip(id).map(|(mut ids, id)| {
                        ids.push(id);
                        ids
                    });
                    let begin = Instant::now();
                    if surfaces.is_full() {
                        let present = Turn { z, job: j, leaf };
                        loose.retain(|turn| *turn >= present);
                        let least = loose.iter().map(|turn| self.least_depth(eye, jobs, *turn));
                        surfaces.settle(least.fold(z, f32::min), &self.outputs.wanted);
                    }
                    surfaces.add(&grid, eye);
                    hiding += begin.elapsed();
                }
            }
            if is_whole {
                slot.release(eye, &place);
            }
        }
        if is_whole && let Some(passed) = self.passed.get(eye * self.buckets.order.len() + index) {
            passed.store(true, atomic::Ordering::Release);
        }
        let begin = Instant::now();
        let resolved = surfaces.resolve_all(&self.outputs.wanted);
        add_time(&self.counters.hide_nanos, hiding + begin.elapsed());
        let begin = Instant::now();
        let volumes = |_, channels, width| surfaces.volumes(&area.rect, channels, width);
        let pixels = self.filtered(&area.rect, &volumes, samples, &resolved);
        add_time(&self.counters.filter_nanos, begin.elapsed());
        (pixels, ids.map(|ids| kept_surfaces(&surfaces, ids)))
    }

    /// Returns the mean number of transparent layers of a sample from which on they are composited before all grids of
    /// the bucket were added. It is not limited where all layers are needed afterwards: for re-renders and for volume
    /// shadow maps. Nor is it where shaders save data, because layers that hide others keep these from being shaded.
    fn layers_at_once(&self, jobs: &Jobs<S::Object>, index: usize) -> usize {
        let needs_all = self.kept.is_some()
            || self.outputs.images.iter().any(|image| image.opaque_width.is_some())
            || jobs.of_bucket[index].iter().any(|job| jobs.list[*job].traits.saves);
        if needs_all { usize::MAX } else { self.layers_at_once }
    }

    /// Returns a depth before which no part of the grids of a turn lies.
    fn least_depth(&self, eye: usize, jobs: &Jobs<S::Object>, Turn { z, job, leaf }: Turn) -> f32 {
        let job = &jobs.list[job];
        match leaf {
            // The hider leaves out what is nearer than the bound of a grid.
            Some(leaf) => z.min(self.split(job).leaves[leaf as usize].seen[eye].z_min),
            None if job.seen[eye].is_nearest => z,
            None => f32::NEG_INFINITY,
        }
    }

    /// Returns the pixels of a rectangle, image by image, from its `resolved` samples. `volumes` returns the texels
    /// of volume shadow maps, from the number of the image, its channels and its "opaquewidth".
    fn filtered(
        &self,
        rect: &PixelRect,
        volumes: &dyn Fn(usize, usize, f32) -> Vec<f32>,
        samples: &SampleGrid,
        resolved: &Resolved,
    ) -> Vec<Vec<f32>> {
        let images = &self.outputs.images;
        let mut pixels: Vec<Vec<f32>> = Vec::with_capacity(images.len());
        for (k, (image, filters)) in images.iter().zip(&self.filters).enumerate() {
            // An image that goes to a file and to a viewer is filtered once.
            let same = images[..k].iter().position(|other| other.is_filtered_like(image));
            pixels.push(match (same, image.opaque_width) {
                (Some(same), _) => pixels[same].clone(),
                (None, Some(width)) => volumes(k, image.channels(), width),
                (None, None) => {
                    let of_layer = |(layer, filter): (&ImageLayer, &film::Support)| match &layer.mattes {
                        Some(mattes) => mattes.pixels(filter, samples, &resolved.coverage, rect),
                        None => film::filter(filter, samples, &resolved.values, &layer.channels, rect),
                    };
                    image.interleaved(image.layers.iter().zip(filters).map(of_layer).collect())
                }
            });
        }
        if self.passes.is_some() {
            for (pixels, filters) in pixels.iter_mut().zip(&self.filters) {
                filters.iter().for_each(|filter| pixels.extend(film::weights(filter, samples, rect)));
            }
        }
        pixels
    }

    /// Passes a shaded grid to "griddump:filename".
    fn dump(&self, grid: &ShadedGrid, job: &Job<S::Object>, order: (usize, u32)) {
        let is_first = self.passes.as_ref().is_none_or(|passes| passes.number == 0);
        let Some(dump) = self.options.dump.filter(|_| is_first) else { return };
        let described = Described {
            order,
            name: job.primitive.attributes.name(),
            variables: &self.outputs.variables,
            eye: self.eyes[0].camera,
        };
        dump.add(grid, &described);
    }

    /// Makes the grids of some leaves of a primitive together. Returns the locked state of the first leaf.
    fn make<'s>(
        &self,
        job: &Job<S::Object>,
        number: usize,
        mut leaves: Vec<(u32, &'s LeafSlot, MutexGuard<'s, LeafState>)>,
        thread: &mut S::Thread<'_>,
    ) -> MutexGuard<'s, LeafState> {
        self.find_kept(job, &mut leaves, thread);
        let waiting: Vec<(&LeafSlot, &Leaf)> =
            leaves.iter().filter_map(|(_, slot, state)| Some((*slot, state.leaf()?))).collect();
        let grids = if waiting.is_empty() { Vec::new() } else { self.shade(job, &waiting, thread) };
        let made = leaves.iter_mut().filter(|(_, _, state)| state.leaf().is_some());
        for ((leaf, slot, state), grid) in made.zip(grids) {
            if let Some(made) = &grid {
                self.dump(&made.grid, job, (number, *leaf));
            }
            self.touch(slot, grid.as_ref().map(|made| &*made.grid));
            slot.keep(state, grid);
        }
        leaves.swap_remove(0).2
    }

    /// Finds the buckets that a grid touches, which are fewer than those of its bound. They are not needed where grids
    /// are kept for other frames.
    fn touch(&self, slot: &LeafSlot, grid: Option<&ShadedGrid>) {
        if self.again || self.kept.is_some() {
            return;
        }
        let of_eye = |eye: usize| {
            let Some(grid) = grid else { return [0..0, 0..0] };
            let view = &grid.views[eye];
            // A pixel more than the hider needs.
            let rim = view.rim_px.ceil() + 1.0;
            let [x0, y0, x1, y1] = view.extent;
            let pixels = pixels_of([x0 - rim, y0 - rim, x1 + rim, y1 + rim], &view.rect);
            if pixels.is_empty() { [0..0, 0..0] } else { self.buckets.cells(&pixels.grown(self.margin)) }
        };
        let cells: Vec<_> = (0..self.eyes.len()).map(of_eye).collect();
        let has_passed = |eye: usize, [column, row]: [usize; 2]| {
            let bucket = eye * self.buckets.order.len() + self.buckets.at(column, row);
            self.passed.get(bucket).is_some_and(|passed| passed.load(atomic::Ordering::Acquire))
        };
        slot.touch(&cells, &has_passed);
    }
}

/// Keeps what samples see, and the kept grids that they see.
fn kept_surfaces(surfaces: &Surfaces<'_>, ids: Vec<GridId>) -> KeptEye {
    let (kept, seen) = KeptSurfaces::new(surfaces);
    (kept, seen.into_iter().map(|grid| ids[grid]).collect())
}
