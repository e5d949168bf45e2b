//! One bucket: collect, hide, filter.

use super::job::{Job, LeafSlot, LeafState};
use super::{Frame, FrameShader, Jobs};
use crate::PixelRect;
use crate::dicing::Leaf;
use crate::hider::{SampleGrid, ShadedGrid, Surfaces};
use crate::output::film;
use crate::output::griddump::Described;
use crate::statistics::{add, add_time};
use std::cmp::{Ordering, Reverse};
use std::collections::{BinaryHeap, VecDeque};
use std::sync::MutexGuard;
use std::time::Instant;

/// A grid of more points than this is shaded alone.
pub(super) const SMALL_POINTS: usize = 64;
/// Points of grids that are shaded together, about.
const JOINED_POINTS: usize = 512;
/// Turns ahead that are looked at for grids to be shaded together.
const LOOK_AHEAD: usize = 128;

/// What a bucket looks at next: a primitive, or a grid of it.
#[derive(Clone, Copy, Debug)]
struct Turn {
    /// Nothing of it is nearer.
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

impl<S: FrameShader> Frame<'_, S> {
    /// Renders a bucket; returns the pixels of every image.
    pub(super) fn bucket(
        &self,
        jobs: &Jobs<S::Object>,
        index: usize,
        thread: &mut S::Thread<'_>,
    ) -> Vec<Vec<f32>> {
        let rect = self.buckets.order[index];
        let blurred = self.blurred(jobs, index);
        let samples = SampleGrid::new(rect.grown(self.margin), &self.pattern, self.options.camera, &blurred);
        let see = |eye| self.seen_by(eye, (jobs, index), &samples, thread);
        let pixels = (0..self.eyes.len()).flat_map(see).collect();
        add(&self.counters.samples, self.eyes.len() * samples.within(&rect));
        pixels
    }

    /// Where in a bucket blurred grids may be seen. What may blur is split for that; nothing else is.
    fn blurred(&self, jobs: &Jobs<S::Object>, index: usize) -> Vec<PixelRect> {
        let bucket = u32::try_from(index).unwrap_or(u32::MAX);
        let mut blurred = Vec::new();
        for eye in 0..self.eyes.len() {
            for &job in &jobs.of_bucket[index] {
                let job = &jobs.list[job];
                if job.seen[eye].blurs {
                    let split = self.split(job);
                    let seen =
                        split.leaves_of(eye, bucket).map(|leaf| &split.leaves[leaf as usize].seen[eye]);
                    blurred.extend(seen.filter(|seen| seen.blurs).map(|seen| seen.rect));
                }
            }
        }
        blurred
    }

    /// What an eye sees in a bucket; the pixels of every image.
    fn seen_by(
        &self,
        eye: usize,
        (jobs, index): (&Jobs<S::Object>, usize),
        samples: &SampleGrid,
        thread: &mut S::Thread<'_>,
    ) -> Vec<Vec<f32>> {
        let mut surfaces = Surfaces::new(samples, self.composite);
        let bucket = u32::try_from(index).unwrap_or(u32::MAX);
        // Front to back, so that what is hidden is found hidden before it is split and shaded. The order among any two
        // grids is the same in every bucket: a primitive comes before its grids, which have its depth at least.
        let mut order: BinaryHeap<Reverse<Turn>> = BinaryHeap::new();
        let turn = |z: f32, job: usize, leaf: Option<u32>| Reverse(Turn { z, job, leaf });
        let here = |job: &Job<S::Object>| !job.seen[eye].rect.intersection(&samples.rect).is_empty();
        let near = jobs.of_bucket[index].iter().filter(|j| here(&jobs.list[**j]));
        order.extend(near.map(|&j| turn(jobs.list[j].seen[eye].z_min, j, None)));
        let mut hiding = std::time::Duration::ZERO;
        // The first of them, taken out early.
        let mut ahead: VecDeque<Turn> = VecDeque::new();
        while let Some(Turn { z, job: j, leaf }) =
            ahead.pop_front().or_else(|| order.pop().map(|Reverse(turn)| turn))
        {
            let job = &jobs.list[j];
            // What lies behind the first surface counts for "avgz".
            let may_cull = job.culls_hidden && !self.outputs.needs_second_surface;
            let Some(slot_number) = leaf else {
                if may_cull && surfaces.hides(&job.seen[eye].rect, z) {
                    add(&self.counters.primitives_hidden, 1);
                    self.pass(job, eye, bucket);
                } else {
                    let split = self.split(job);
                    let z_of = |leaf: u32| split.leaves[leaf as usize].seen[eye].z_min.max(z);
                    order.extend(split.leaves_of(eye, bucket).map(|leaf| turn(z_of(leaf), j, Some(leaf))));
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
                    if job.traits.joins && !job.traits.saves && points <= SMALL_POINTS {
                        while ahead.len() < LOOK_AHEAD
                            && let Some(Reverse(turn)) =
                                order.peek().filter(|Reverse(turn)| turn.leaf.is_some())
                        {
                            ahead.push_back(*turn);
                            order.pop();
                        }
                        let mut points = points;
                        for turn in ahead.iter().filter(|turn| turn.job == j) {
                            let Some(number) = turn.leaf else { continue };
                            let slot = &slots[number as usize];
                            let Some(state) = slot.lock_early().filter(|_| !hidden(slot, turn.z)) else {
                                continue;
                            };
                            let more = state.leaf().map_or(0, |leaf| leaf.rates.nu * leaf.rates.nv);
                            if more > SMALL_POINTS {
                                continue;
                            }
                            points += more;
                            together.push((number, slot, state));
                            if points >= JOINED_POINTS {
                                break;
                            }
                        }
                    }
                    state = self.make(job, j, together, thread);
                }
                let grid = state.grid();
                drop(state);
                if let Some(grid) = grid {
                    let begin = Instant::now();
                    surfaces.add(&grid, eye);
                    hiding += begin.elapsed();
                }
            }
            slot.release();
        }
        let begin = Instant::now();
        let values = surfaces.resolve(&self.outputs.wanted);
        add_time(&self.counters.hide_nanos, hiding + begin.elapsed());
        let begin = Instant::now();
        let (images, rect) = (&self.outputs.images, &self.buckets.order[index]);
        let mut pixels: Vec<Vec<f32>> = Vec::with_capacity(images.len());
        for (k, (image, filter)) in images.iter().zip(&self.filters).enumerate() {
            // What goes to a file and to a viewer is filtered once.
            let same = images[..k].iter().position(|other| other.is_filtered_like(image));
            pixels.push(match (same, image.opaque_width) {
                (Some(same), _) => pixels[same].clone(),
                (None, Some(width)) => surfaces.volumes(rect, image.channels.len(), width),
                (None, None) => film::filter(filter, samples, &values, &image.channels, rect),
            });
        }
        add_time(&self.counters.filter_nanos, begin.elapsed());
        pixels
    }

    /// Hands a grid that was shaded to "griddump:filename".
    fn dump(&self, grid: &ShadedGrid, job: &Job<S::Object>, order: (usize, u32)) {
        let Some(dump) = self.options.dump else { return };
        let described = Described {
            order,
            name: job.primitive.attributes.name(),
            variables: &self.outputs.variables,
            eye: self.eyes[0].camera,
        };
        dump.add(grid, &described);
    }

    /// Makes the grids of some leaves of a primitive together; gives back what was locked of the first.
    fn make<'s>(
        &self,
        job: &Job<S::Object>,
        number: usize,
        mut leaves: Vec<(u32, &'s LeafSlot, MutexGuard<'s, LeafState>)>,
        thread: &mut S::Thread<'_>,
    ) -> MutexGuard<'s, LeafState> {
        let waiting: Vec<(&LeafSlot, &Leaf)> =
            leaves.iter().filter_map(|(_, slot, state)| Some((*slot, state.leaf()?))).collect();
        let grids = self.shade(job, &waiting, thread);
        for ((leaf, slot, state), grid) in leaves.iter_mut().zip(grids) {
            if let Some(grid) = &grid {
                self.dump(grid, job, (number, *leaf));
            }
            slot.keep(state, grid);
        }
        leaves.swap_remove(0).2
    }
}
