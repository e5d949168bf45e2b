//! Samples micropolygons that move, that are out of focus, or that reach before the near plane.

use super::candidates::{Candidate, Candidates};
use super::hit::{Hit, Raster, Sink, before};
use super::lanes::{LANES, Lanes, Points, Signs, first_lanes};
use super::rays::Polygon;
use super::streaks::{Streak, Streaks};
use super::visible::pixels_of;
use granita_base::{Vec2, Vec3};
use granita_dicing::PixelRect;
use granita_machine::simd::Simd;

/// Scratch for the work on a micropolygon, kept from one to the next.
#[derive(Default)]
pub(super) struct Scratch {
    borders: Borders,
    /// Scratch for micropolygons that move fast.
    pub(super) streaks: Streaks,
    /// The samples that the micropolygon may hit.
    candidates: Candidates,
}

/// The positions of a micropolygon at some consecutive times: its raster box as seen through a pinhole, and `1 /
/// focus - 1 / z` of its nearest and farthest corner for the lens. A point at depth `z`, seen through the lens point
/// `l`, appears `scale * l * (1 / focus - 1 / z)` away from where a pinhole shows it.
///
/// The box is infinite when the micropolygon is not entirely behind the near plane.
#[derive(Default)]
struct Borders {
    /// The members of [`LaneBoxes`], with padding for loads beyond the last outline.
    lists: [Vec<f32>; 6],
}

impl Raster<'_> {
    /// Samples any micropolygon. A ray through each sample's lens point at its time is tested against the corners at
    /// that time.
    ///
    /// Two tests reject samples before the rays are traced. First, a micropolygon that moves far is in few places at
    /// any one time, so that samples are tested only against its positions in their part of the shutter (Fatahalian
    /// et al., Data-Parallel Rasterization of Micropolygons with Defocus and Motion Blur, 2009). Second, only those
    /// samples remain whose lens point may see it there.
    #[inline(always)]
    pub(super) fn moving(
        &self,
        simd: impl Simd,
        (at, mp): (usize, usize),
        rim: [bool; 4],
        room: &mut Scratch,
        sink: &mut impl Sink,
    ) {
        let (samples, view, nu) = (self.samples, self.view, self.grid.nu);
        let any_rim = rim.contains(&true);
        let pad = self.widening(any_rim);
        let b = view.boxes[mp];
        let whole = pixels_of([b[0] - pad, b[1] - pad, b[2] + pad, b[3] + pad], &self.window());
        if whole.is_empty() {
            return;
        }
        let corners = [at, at + 1, at + nu + 1, at + nu];
        // Depths change linearly from key to key.
        let depths = view.p_cam.iter().flat_map(|p| corners.map(|k| p[k].z));
        let z_min = depths.fold(f32::INFINITY, f32::min);
        let nearest = before(z_min);
        if sink.hides(&whole, nearest) {
            return;
        }
        let travel_px = if z_min < self.closest() { f32::INFINITY } else { self.travel_px(corners[0]) };
        room.candidates.clear();
        if self.is_fast(travel_px) {
            let streak = Streak { corners: &corners, whole: &whole, pad, nearest, limits: sink.limits() };
            self.follow(&streak, &mut room.streaks, &mut room.candidates);
        } else {
            let strata = samples.time_strata();
            let groups = samples.per_pixel.div_ceil(LANES);
            // Each sample is tested in its own part of the shutter, or all samples of a group in their parts
            // together.
            let together = travel_px <= groups as f32;
            let step = if together { LANES } else { 1 };
            self.find_borders(&corners, step, pad, &mut room.borders);
            for group in 0..groups {
                let slice = match together {
                    _ if strata == 1 => Slice::All(0),
                    true => Slice::All(group),
                    false => Slice::Each(group * LANES),
                };
                self.sift(simd, group, slice, (&whole, nearest, sink.limits()), room);
            }
        }
        let polygon = Polygon { corners, rim, pixel: Vec2::new(1.0 / view.scale.x, 1.0 / view.scale.y) };
        for first in (0..room.candidates.len()).step_by(LANES) {
            let (eight, used) = (room.candidates.eight(first), room.candidates.len() - first);
            self.rays(simd, &polygon, &eight, first_lanes(used), &mut |sample, z, u, v, beside| {
                sink.hit(Hit { sample, z, at: at as u32, u, v, rim: any_rim, beside });
            });
        }
    }

    /// Appends the samples that may see the micropolygon to the candidates. Of each pixel in `whole` it tests the
    /// `group`-th group of eight samples, and of these the samples that need hits at the depth `nearest`.
    #[inline(always)]
    fn sift(
        &self,
        simd: impl Simd,
        group: usize,
        slice: Slice,
        (whole, nearest, limits): (&PixelRect, f32, Option<&[f32]>),
        room: &mut Scratch,
    ) {
        let (samples, view) = (self.samples, self.view);
        let Scratch { borders, candidates, .. } = room;
        let first = group * LANES;
        let boxes = borders.during(slice);
        let scale = view.scale;
        let defocused = view.lens_radius > 0.0;
        let lens = match samples.tables.lens_boxes.get(group) {
            Some(lens) if defocused => *lens,
            _ => [0.0; 4],
        };
        let reach = boxes.reach(lens, scale);
        let rect = pixels_of(reach, whole);
        let full = first_lanes(samples.per_pixel - first);
        let nearest = Lanes::splat(nearest);
        let tables = &*samples.tables;
        for y in rect.y0..rect.y1 {
            let row = samples.pixel(rect.x0, y);
            for pixel in row..row + rect.width() {
                let at = pixel * samples.per_pixel + first;
                let mut wanted = match samples.varies() {
                    true => first_lanes(samples.count(pixel).saturating_sub(first)),
                    false => full,
                };
                if let Some(limits) = limits {
                    wanted &= simd.positive(Lanes::load(limits, at) - nearest);
                    if wanted == 0 {
                        continue;
                    }
                }
                let place = samples.places(pixel) + first;
                let x = Lanes::load(&tables.fx, place) + (rect.x0 + (pixel - row) as i32) as f32;
                let y = Lanes::load(&tables.fy, place) + y as f32;
                let zero = Lanes::splat(0.0);
                let (mut lens_x, mut lens_y) = (zero, zero);
                let room = if defocused {
                    let lens = samples.lenses[pixel] as usize + first;
                    (lens_x, lens_y) = (Lanes::load(&tables.lens_x, lens), Lanes::load(&tables.lens_y, lens));
                    let (sx, sy) = (lens_x * scale.x, lens_y * scale.y);
                    let (ax, bx) = (x - sx * boxes.near, x - sx * boxes.far);
                    let (ay, by) = (y - sy * boxes.near, y - sy * boxes.far);
                    let x_room = (ax.max(bx) - boxes.lo_x).min(boxes.hi_x - ax.min(bx));
                    x_room.min(ay.max(by) - boxes.lo_y).min(boxes.hi_y - ay.min(by))
                } else {
                    let x_room = (x - boxes.lo_x).min(boxes.hi_x - x);
                    x_room.min(y - boxes.lo_y).min(boxes.hi_y - y)
                };
                let inside = simd.positive(room) & wanted;
                if inside != 0 {
                    let time = match samples.times.get(pixel) {
                        Some(time) => Lanes::load(&tables.time, *time as usize + first),
                        None => Lanes::splat(samples.shutter[0]),
                    };
                    let eight = Candidate { sample: zero, x, y, time, lens_x, lens_y };
                    candidates.push_lanes(simd, inside, at, eight);
                }
            }
        }
    }

    /// Returns the depth from which on points are projected.
    #[inline(always)]
    pub(super) fn closest(&self) -> f32 {
        if self.view.perspective { self.view.near.max(f32::MIN_POSITIVE) } else { f32::NEG_INFINITY }
    }

    /// Returns approximately how many pixels a point moves from the first to the last key.
    #[inline(always)]
    pub(super) fn travel_px(&self, point: usize) -> f32 {
        let view = self.view;
        let (Some(first), Some(last)) = (view.p_cam.first(), view.p_cam.last()) else { return 0.0 };
        let (a, b) = (first[point], last[point]);
        let path = view.project(b) - view.project(a);
        let far_enough = !view.perspective || a.z >= view.near && b.z >= view.near;
        if far_enough { path.abs().max_element() } else { f32::INFINITY }
    }

    /// Finds the positions of a micropolygon at every `step`-th stratum boundary of the shutter and at its end. The
    /// boxes are padded for rounding and by `pad` raster pixels for the boundary edge.
    #[inline(always)]
    fn find_borders(&self, corners: &[usize; 4], step: usize, pad: f32, borders: &mut Borders) {
        let (samples, view) = (self.samples, self.view);
        let strata = samples.time_strata();
        let slices = strata.div_ceil(step);
        borders.reserve(slices);
        let still = view.times.len() == 1;
        for first in (0..=slices).step_by(LANES) {
            let mut time = Lanes::splat(0.0);
            for (k, time) in time.0.iter_mut().enumerate() {
                *time = samples.stratum_time(((first + k) * step).min(strata));
            }
            borders.set(first, &self.outlines(self.corners_at(corners, time), pad));
            if still {
                // A micropolygon that does not move has one position.
                break;
            }
        }
        if still {
            borders.repeat_first(slices + 1);
        }
        // Between keys points move along straight lines, which the projection preserves. A key between two borders
        // extends both.
        let [open, close] = samples.shutter;
        for key in 1..view.times.len().saturating_sub(1) {
            let time = view.times[key];
            let at = (time - open) / (close - open) * (strata as f32 / step as f32);
            if at > 0.0 && at <= slices as f32 {
                let outline = self.outlines(self.corners_at(corners, Lanes::splat(time)), pad);
                let slice = (at as usize).min(slices - 1);
                for border in slice.saturating_sub(1)..=(slice + 2).min(slices) {
                    borders.include(border, &outline);
                }
            }
        }
        borders.pad(slices);
    }

    /// Returns the outlines of the corners at eight times.
    #[inline(always)]
    fn outlines(&self, p: [Points; 4], pad: f32) -> LaneBoxes {
        let view = self.view;
        let [most, least] = [f32::INFINITY, f32::NEG_INFINITY].map(Lanes::splat);
        let mut boxes =
            LaneBoxes { lo_x: most, hi_x: least, lo_y: most, hi_y: least, near: most, far: least };
        for p in &p {
            let (mut x, mut y) = (p.x * view.scale.x, p.y * view.scale.y);
            if view.perspective {
                (x, y) = (x / p.z, y / p.z);
            }
            (boxes.lo_x, boxes.hi_x) = (boxes.lo_x.min(x), boxes.hi_x.max(x));
            (boxes.lo_y, boxes.hi_y) = (boxes.lo_y.min(y), boxes.hi_y.max(y));
            (boxes.near, boxes.far) = (boxes.near.min(p.z), boxes.far.max(p.z));
        }
        let largest = boxes.hi_x.max(-boxes.lo_x).max(boxes.hi_y).max(-boxes.lo_y);
        let room = largest.max(-largest) * 1e-5 + (pad + 0.01 + 1e-5 * view.center.abs().max_element());
        let too_close = if view.perspective { view.near.max(f32::MIN_POSITIVE) } else { -f32::MAX };
        let clear = boxes.near - too_close;
        (boxes.lo_x, boxes.hi_x) = (boxes.lo_x + view.center.x - room, boxes.hi_x + view.center.x + room);
        (boxes.lo_y, boxes.hi_y) = (boxes.lo_y + view.center.y - room, boxes.hi_y + view.center.y + room);
        if view.lens_radius > 0.0 {
            let (focus, one) = (Lanes::splat(1.0 / view.focus), Lanes::splat(1.0));
            (boxes.near, boxes.far) = (focus - one / boxes.near, focus - one / boxes.far);
        }
        let zero = Lanes::splat(0.0);
        LaneBoxes {
            lo_x: clear.choose(boxes.lo_x, least),
            hi_x: clear.choose(boxes.hi_x, most),
            lo_y: clear.choose(boxes.lo_y, least),
            hi_y: clear.choose(boxes.hi_y, most),
            near: clear.choose(boxes.near, zero),
            far: clear.choose(boxes.far, zero),
        }
    }

    /// Returns the positions of the corners at eight times.
    #[inline(always)]
    pub(super) fn corners_at(&self, corners: &[usize; 4], time: Lanes) -> [Points; 4] {
        let view = self.view;
        let mut out = [Points::splat(Vec3::ZERO); 4];
        match (&view.times[..], &view.p_cam[..]) {
            ([_], [p]) => {
                for k in 0..4 {
                    out[k] = Points::splat(p[corners[k]]);
                }
            }
            ([t0, t1], [a, b]) => {
                let alpha = (time - *t0) / (t1 - t0);
                let alpha = alpha.max(Lanes::splat(0.0)).min(Lanes::splat(1.0));
                let rest = Lanes::splat(1.0) - alpha;
                for k in 0..4 {
                    let (a, b) = (Points::splat(a[corners[k]]), Points::splat(b[corners[k]]));
                    out[k] = Points {
                        x: a.x * rest + b.x * alpha,
                        y: a.y * rest + b.y * alpha,
                        z: a.z * rest + b.z * alpha,
                    };
                }
            }
            _ => {
                let keys = time.0.map(|time| granita_dicing::key_at(&view.times, time));
                for k in 0..4 {
                    let p = keys.map(|(key, next, alpha)| view.between(key, next, alpha, corners[k]));
                    let [x, y, z] = [p.map(|p| p.x), p.map(|p| p.y), p.map(|p| p.z)];
                    out[k] = Points { x: Lanes(x), y: Lanes(y), z: Lanes(z) };
                }
            }
        }
        out
    }
}

/// The slices of the shutter in which eight samples are tested.
#[derive(Clone, Copy)]
enum Slice {
    /// All samples are tested in this slice.
    All(usize),
    /// Each sample is tested in its own slice, beginning with this one.
    Each(usize),
}

impl Borders {
    /// Makes room for the outlines at the borders of some slices.
    #[inline(always)]
    fn reserve(&mut self, slices: usize) {
        let size = (slices + 1).next_multiple_of(LANES) + LANES + 1;
        if self.lists[0].len() < size {
            self.lists.iter_mut().for_each(|list| list.resize(size, 0.0));
        }
    }

    /// Stores the outlines at eight times.
    #[inline(always)]
    fn set(&mut self, first: usize, boxes: &LaneBoxes) {
        for (list, lanes) in self.lists.iter_mut().zip(boxes.lists()) {
            list[first..first + LANES].copy_from_slice(&lanes.0);
        }
    }

    /// Repeats the first outline `n` times.
    #[inline(always)]
    fn repeat_first(&mut self, n: usize) {
        for list in &mut self.lists {
            let first = list[0];
            list[..n].fill(first);
        }
    }

    /// Repeats the last outline behind it, for loads beyond the last slice.
    #[inline(always)]
    fn pad(&mut self, slices: usize) {
        for list in &mut self.lists {
            let last = list[slices];
            list[slices + 1..][..LANES + 1].fill(last);
        }
    }

    /// Extends an outline by the first lane of other outlines.
    fn include(&mut self, border: usize, boxes: &LaneBoxes) {
        for (k, (list, lanes)) in self.lists.iter_mut().zip(boxes.lists()).enumerate() {
            let value = &mut list[border];
            *value = if k % 2 == 0 { value.min(lanes.0[0]) } else { value.max(lanes.0[0]) };
        }
    }

    /// Returns the union of the outlines at the borders of the slices.
    #[inline(always)]
    fn during(&self, slice: Slice) -> LaneBoxes {
        let at = |list: &[f32], offset: usize| match slice {
            Slice::All(k) => Lanes::splat(list[k + offset]),
            Slice::Each(k) => Lanes::load(list, k + offset),
        };
        let least = |list: &[f32]| at(list, 0).min(at(list, 1));
        let most = |list: &[f32]| at(list, 0).max(at(list, 1));
        let [lo_x, hi_x, lo_y, hi_y, near, far] = &self.lists;
        LaneBoxes {
            lo_x: least(lo_x),
            hi_x: most(hi_x),
            lo_y: least(lo_y),
            hi_y: most(hi_y),
            near: least(near),
            far: most(far),
        }
    }
}

/// The outlines that eight samples are tested against; see [`Borders`].
struct LaneBoxes {
    lo_x: Lanes,
    hi_x: Lanes,
    lo_y: Lanes,
    hi_y: Lanes,
    near: Lanes,
    far: Lanes,
}

impl LaneBoxes {
    #[inline(always)]
    fn lists(&self) -> [&Lanes; 6] {
        [&self.lo_x, &self.hi_x, &self.lo_y, &self.hi_y, &self.near, &self.far]
    }

    /// Returns the raster box of everything in the outlines, seen through a part (x0, x1, y0, y1) of the lens.
    #[inline(always)]
    fn reach(&self, [x0, x1, y0, y1]: [f32; 4], scale: Vec2) -> [f32; 4] {
        let x = self.side([self.lo_x, self.hi_x], x0 * scale.x, x1 * scale.x);
        let y = self.side([self.lo_y, self.hi_y], y0 * scale.y, y1 * scale.y);
        [x[0].least(), y[0].least(), x[1].most(), y[1].most()]
    }

    /// Returns the least and largest coordinates of `lo..hi`, seen through a part of the lens from `l0` to `l1`.
    #[inline(always)]
    fn side(&self, [lo, hi]: [Lanes; 2], l0: f32, l1: f32) -> [Lanes; 2] {
        let [a, b] = [self.near * l0, self.far * l0];
        let [c, d] = [self.near * l1, self.far * l1];
        [lo + a.min(b).min(c.min(d)), hi + a.max(b).max(c.max(d))]
    }
}
