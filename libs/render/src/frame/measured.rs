//! Measures displacements whose bound the scene does not declare (reference 4.4.6).
//!
//! "displace:maxradius" only extends bounds. An object without it is displaced in the same way. So before such a
//! primitive is sorted into buckets, all parts that the whole image may show are diced and displaced, and the
//! longest distance of a point is the bound. A crop measures the same grids, so that it shows the same pixels.

use super::job::Job;
use super::limits::{Budget, POINTS_OF_A_SPLIT};
use super::{Frame, FrameShader};
use crate::{CameraView, PixelRect};
use granita_base::{Vec3, parallel_map};
use granita_dicing::Plan;
use granita_geom::{Piece, Surface};
use std::sync::atomic::Ordering;

/// The number of pieces that several threads measure.
const MANY: usize = 256;

/// The margin for rounding, as a part of the measured distance.
const ROOM: f32 = 1e-4;

/// A piece of a primitive that is being measured.
enum Part<'p> {
    /// A piece of the primitive itself.
    Whole(&'p dyn Surface),
    /// A piece from a split.
    Split(Piece),
}

impl Part<'_> {
    fn surface(&self) -> &dyn Surface {
        match self {
            Self::Whole(piece) => *piece,
            Self::Split(piece) => &**piece,
        }
    }
}

impl<S: FrameShader> Frame<'_, S> {
    /// Returns the longest distance in world units that the displacement shaders of an object move a point of its
    /// `pieces` which the image may show. `thread` is made when it is needed.
    pub(super) fn measured_displacement<'t>(
        &'t self,
        job: &Job<S::Object>,
        pieces: &[Piece],
        thread: &mut Option<S::Thread<'t>>,
    ) -> f32 {
        let camera: &CameraView = self.options.camera;
        let region = CameraView::crop_pixels([0.0, 1.0, 0.0, 1.0], camera.resolution).grown(self.margin);
        let budget = Budget::new(self.dicing.most_points());
        let mut parts: Vec<(Part<'_>, u32)> = pieces.iter().map(|p| (Part::Whole(&**p), 0)).collect();
        let mut longest = 0.0_f32;
        // Splitting is breadth first, until there are enough parts for all threads.
        while !parts.is_empty() && (self.options.threads == 1 || parts.len() < MANY) {
            let mut next = Vec::with_capacity(2 * parts.len());
            let mute = thread.get_or_insert_with(|| self.mute_thread());
            for part in parts.drain(..) {
                longest = longest.max(self.measured(job, &part, (&region, &budget), mute, &mut next));
            }
            parts = next;
        }
        let of_parts = parallel_map(
            parts,
            self.options.threads,
            || self.mute_thread(),
            |thread, part| {
                let mut longest = 0.0_f32;
                let mut stack = vec![part];
                while let Some(part) = stack.pop() {
                    longest = longest.max(self.measured(job, &part, (&region, &budget), thread, &mut stack));
                }
                longest
            },
        );
        let longest = of_parts.into_iter().fold(longest, f32::max);
        longest * (1.0 + ROOM)
    }

    /// Returns a thread whose shaders print and save nothing.
    fn mute_thread(&self) -> S::Thread<'_> {
        let mut thread = self.thread();
        self.shader.mute(&mut thread, true);
        thread
    }

    /// Returns the longest distance of a point of a diced part. The parts of a split one are appended to `out`.
    fn measured<'p>(
        &self,
        job: &Job<S::Object>,
        (part, depth): &(Part<'p>, u32),
        (region, budget): (&PixelRect, &Budget),
        thread: &mut S::Thread<'_>,
        out: &mut Vec<(Part<'p>, u32)>,
    ) -> f32 {
        let piece = part.surface();
        if budget.is_spent() || self.options.stop.load(Ordering::Relaxed) {
            return 0.0;
        }
        let seen = self.sightings(job, piece, region);
        if seen.iter().all(|s| s.rect.is_empty()) {
            return 0.0;
        }
        match self.plan(job, piece, *depth) {
            Plan::Split(direction, settled) => {
                budget.spend(if piece.is_group() { 0 } else { POINTS_OF_A_SPLIT });
                let parts = piece.split_settled(direction, settled);
                out.extend(parts.into_iter().map(|p| (Part::Split(p), depth + 1)));
                0.0
            }
            Plan::Dice(rates) => {
                budget.spend((rates.nu * rates.nv) as u64);
                let Some((_, mut grid, _)) = self.grid(job, &seen, (piece, &rates), job.time) else {
                    return 0.0;
                };
                let before = grid.p.clone();
                self.shader.displace(thread, &job.object, &mut grid);
                let to_world = &job.placement.to_world;
                let back = to_world.at(grid.time).inverse();
                let length = |offset: Vec3| {
                    let own = offset.length();
                    if !to_world.is_moving() {
                        return own;
                    }
                    // A displacement moves along with the surface.
                    let own_space = back.vector(offset);
                    let times = job.placement.times().iter();
                    times.map(|t| to_world.at(*t).vector(own_space).length()).fold(own, f32::max)
                };
                let ways = (0..grid.len()).map(|i| length(grid.p.get(i) - before.get(i)));
                ways.filter(|way| way.is_finite()).fold(0.0, f32::max)
            }
        }
    }
}
