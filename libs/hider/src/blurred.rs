//! Samples micropolygons that move, that are out of focus, or that reach before the near plane.

use super::candidates::{Candidate, Candidates};
use super::hit::{Corners, Hit, Raster, Sink, before};
use super::lanes::{LANES, Lanes, Points, first_lanes};
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
    /// The times at every border of a stratum, and at every eighth one. The last one is repeated. They are the same for
    /// all micropolygons.
    times: [Vec<f32>; 2],
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
        let z_min = view.depths[mp];
        let nearest = before(z_min);
        if sink.hides(&whole, nearest) {
            return;
        }
        let corners = self.corners([at, at + 1, at + nu + 1, at + nu]);
        let travel_px = if z_min < self.closest() { f32::INFINITY } else { self.travel_px(at) };
        room.candidates.clear();
        if self.is_fast(travel_px) {
            let streak = Streak { corners: &corners, whole: &whole, pad, nearest, limits: sink.limits() };
            self.follow(simd, &streak, &mut room.streaks, &mut room.candidates);
        } else {
            let strata = samples.time_strata();
            let groups = samples.per_pixel.div_ceil(LANES);
            // Each sample is tested in its own part of the shutter, or all samples of a group in their parts
            // together.
            let together = travel_px <= groups as f32;
            self.find_borders(simd, &corners, together, pad, &mut room.borders);
            for group in 0..groups {
                let slice = match together {
                    _ if strata == 1 => Slice::All(0),
                    true => Slice::All(group),
                    false => Slice::Each(group * LANES),
                };
                let boxes = room.borders.during(simd, slice);
                let wanted = Wanted { group, whole: &whole, nearest, limits: sink.limits() };
                if view.lens_radius > 0.0 {
                    self.sift::<_, true>(simd, &wanted, (&boxes, slice), &mut room.candidates);
                } else {
                    self.sift::<_, false>(simd, &wanted, (&boxes, slice), &mut room.candidates);
                }
            }
        }
        let polygon = Polygon { corners, rim, pixel: Vec2::new(1.0 / view.scale.x, 1.0 / view.scale.y) };
        for first in (0..room.candidates.len()).step_by(LANES) {
            self.rays(simd, &polygon, (&room.candidates, first), &mut |sample, z, u, v, beside| {
                sink.hit(Hit { sample, z, at: at as u32, u, v, rim: any_rim, beside });
            });
        }
    }

    /// Appends the samples that may see the micropolygon at the places `boxes` to the candidates. `DEFOCUS` is true
    /// with a lens.
    #[inline(always)]
    fn sift<S: Simd, const DEFOCUS: bool>(
        &self,
        simd: S,
        wanted: &Wanted<'_>,
        (boxes, slice): (&LaneBoxes<S>, Slice),
        candidates: &mut Candidates,
    ) {
        let (samples, scale) = (self.samples, self.view.scale);
        let tables = &*samples.tables;
        let first = wanted.group * LANES;
        let lens = match tables.lens_boxes.get(wanted.group) {
            Some(lens) if DEFOCUS => *lens,
            _ => [0.0; 4],
        };
        let reach = boxes.reach(lens, scale);
        let reach = match slice {
            // All lanes are the same.
            Slice::All(_) => [reach[0].lane(0), reach[1].lane(0), reach[2].lane(0), reach[3].lane(0)],
            Slice::Each(_) => [reach[0].least(), reach[1].least(), reach[2].most(), reach[3].most()],
        };
        let rect = pixels_of(reach, wanted.whole);
        let full = first_lanes(samples.per_pixel - first);
        let nearest = Lanes::splat(simd, wanted.nearest);
        let zero = Lanes::splat(simd, 0.0);
        for y in rect.y0..rect.y1 {
            let row = samples.pixel(rect.x0, y);
            for pixel in row..row + rect.width() {
                let at = pixel * samples.per_pixel + first;
                let mut inside = full;
                if let Some(limits) = wanted.limits {
                    inside &= nearest.below(Lanes::load(simd, limits, at));
                    if inside == 0 {
                        continue;
                    }
                }
                // Samples that a pixel lacks have no position, so that they are outside.
                let (x, y) = (Lanes::load(simd, &samples.x, at), Lanes::load(simd, &samples.y, at));
                let (mut lens_x, mut lens_y) = (zero, zero);
                let room = if DEFOCUS {
                    let lens = samples.lenses[pixel] as usize + first;
                    lens_x = Lanes::load(simd, &tables.lens_x, lens);
                    lens_y = Lanes::load(simd, &tables.lens_y, lens);
                    let (sx, sy) = (lens_x * scale.x, lens_y * scale.y);
                    let (ax, bx) = (x - sx * boxes.near, x - sx * boxes.far);
                    let (ay, by) = (y - sy * boxes.near, y - sy * boxes.far);
                    let x_room = (ax.max(bx) - boxes.lo_x).min(boxes.hi_x - ax.min(bx));
                    x_room.min(ay.max(by) - boxes.lo_y).min(boxes.hi_y - ay.min(by))
                } else {
                    let x_room = (x - boxes.lo_x).min(boxes.hi_x - x);
                    x_room.min(y - boxes.lo_y).min(boxes.hi_y - y)
                };
                inside &= room.positive();
                if inside != 0 {
                    let time = match samples.times.get(pixel) {
                        Some(time) => Lanes::load(simd, &tables.time, *time as usize + first),
                        None => Lanes::splat(simd, samples.shutter[0]),
                    };
                    let eight = Candidate { x, y, time, lens_x, lens_y };
                    candidates.push_lanes::<_, DEFOCUS>(simd, inside, at, eight);
                }
            }
        }
    }

    /// Returns the corners of a micropolygon.
    #[inline(always)]
    pub(super) fn corners(&self, indices: [usize; 4]) -> Corners {
        let at = |key: Option<&Vec<Vec3>>| key.map_or([Vec3::ZERO; 4], |p| indices.map(|i| p[i]));
        Corners { indices, ends: [at(self.view.p_cam.first()), at(self.view.p_cam.last())] }
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

    /// Finds the positions of a micropolygon at every stratum boundary of the shutter, or at every eighth one for
    /// samples that are tested `together`, and at its end. The boxes are padded for rounding and by `pad` raster
    /// pixels for the boundary edge.
    #[inline(always)]
    fn find_borders<S: Simd>(
        &self,
        simd: S,
        corners: &Corners,
        together: bool,
        pad: f32,
        borders: &mut Borders,
    ) {
        let (samples, view) = (self.samples, self.view);
        let strata = samples.time_strata();
        let step = if together { LANES } else { 1 };
        let slices = strata.div_ceil(step);
        borders.reserve(slices);
        let still = view.times.len() == 1;
        let which = usize::from(together);
        if borders.times[which].is_empty() {
            let size = (slices + 1).next_multiple_of(LANES);
            borders.times[which].extend((0..size).map(|k| samples.stratum_time((k * step).min(strata))));
        }
        for first in (0..=slices).step_by(LANES) {
            let time = Lanes::load(simd, &borders.times[which], first);
            borders.set(first, &self.outlines(simd, self.corners_at(simd, corners, time), pad));
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
                let outline =
                    self.outlines(simd, self.corners_at(simd, corners, Lanes::splat(simd, time)), pad);
                let slice = (at as usize).min(slices - 1);
                for border in slice.saturating_sub(1)..=(slice + 2).min(slices) {
                    borders.include(border, &outline);
                }
            }
        }
        if !together {
            borders.pad(slices);
        }
    }

    /// Returns the outlines of the corners at eight times.
    #[inline(always)]
    fn outlines<S: Simd>(&self, simd: S, p: [Points<S>; 4], pad: f32) -> LaneBoxes<S> {
        let view = self.view;
        let (most, least) = (Lanes::splat(simd, f32::INFINITY), Lanes::splat(simd, f32::NEG_INFINITY));
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
            let (focus, one) = (Lanes::splat(simd, 1.0 / view.focus), Lanes::splat(simd, 1.0));
            (boxes.near, boxes.far) = (focus - one / boxes.near, focus - one / boxes.far);
        }
        let zero = Lanes::splat(simd, 0.0);
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
    pub(super) fn corners_at<S: Simd>(&self, simd: S, corners: &Corners, time: Lanes<S>) -> [Points<S>; 4] {
        let view = self.view;
        let [first, last] = &corners.ends;
        let mut out = [Points::splat(simd, Vec3::ZERO); 4];
        match &view.times[..] {
            [_] => {
                for k in 0..4 {
                    out[k] = Points::splat(simd, first[k]);
                }
            }
            [t0, t1] => {
                let alpha = (time - *t0) / (t1 - t0);
                let alpha = alpha.max(Lanes::splat(simd, 0.0)).min(Lanes::splat(simd, 1.0));
                let rest = Lanes::splat(simd, 1.0) - alpha;
                for k in 0..4 {
                    let (a, b) = (Points::splat(simd, first[k]), Points::splat(simd, last[k]));
                    out[k] = Points {
                        x: a.x * rest + b.x * alpha,
                        y: a.y * rest + b.y * alpha,
                        z: a.z * rest + b.z * alpha,
                    };
                }
            }
            _ => {
                let all = self.corners_between(&corners.indices, &time.numbers());
                for k in 0..4 {
                    out[k] = Points::new(simd, &all[k]);
                }
            }
        }
        out
    }

    /// Returns the coordinates of the corners with these indices at eight times, for any number of keys.
    #[inline(never)]
    fn corners_between(&self, indices: &[usize; 4], time: &[f32; LANES]) -> [[[f32; LANES]; 3]; 4] {
        let view = self.view;
        let keys = time.map(|time| granita_dicing::key_at(&view.times, time));
        indices.map(|corner| {
            let p = keys.map(|(key, next, alpha)| view.between(key, next, alpha, corner));
            [p.map(|p| p.x), p.map(|p| p.y), p.map(|p| p.z)]
        })
    }
}

/// The samples that a micropolygon is tested against.
struct Wanted<'a> {
    /// The number of a group of eight samples of each pixel.
    group: usize,
    /// The pixels.
    whole: &'a PixelRect,
    /// A depth that is not behind any hit.
    nearest: f32,
    /// See [`Sink::limits`].
    limits: Option<&'a [f32]>,
}

/// The slices of the shutter in which eight samples are tested.
#[derive(Clone, Copy)]
enum Slice {
    /// All samples are tested in this slice.
    All(usize),
    /// Each sample is tested in its own slice, beginning with this one.
    Each(usize),
}

impl Slice {
    /// Returns the numbers at the beginnings of the slices, or with an `offset` of 1 at their ends.
    #[inline(always)]
    fn at<S: Simd>(self, simd: S, list: &[f32], offset: usize) -> Lanes<S> {
        match self {
            Self::All(k) => Lanes::splat(simd, list[k + offset]),
            Self::Each(k) => Lanes::load(simd, list, k + offset),
        }
    }

    #[inline(always)]
    fn least<S: Simd>(self, simd: S, list: &[f32]) -> Lanes<S> {
        self.at(simd, list, 0).min(self.at(simd, list, 1))
    }

    #[inline(always)]
    fn most<S: Simd>(self, simd: S, list: &[f32]) -> Lanes<S> {
        self.at(simd, list, 0).max(self.at(simd, list, 1))
    }
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
    fn set<S: Simd>(&mut self, first: usize, boxes: &LaneBoxes<S>) {
        for (list, lanes) in self.lists.iter_mut().zip(boxes.lists()) {
            list[first..first + LANES].copy_from_slice(&lanes.numbers());
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
    fn include<S: Simd>(&mut self, border: usize, boxes: &LaneBoxes<S>) {
        for (k, (list, lanes)) in self.lists.iter_mut().zip(boxes.lists()).enumerate() {
            let value = &mut list[border];
            *value = if k % 2 == 0 { value.min(lanes.lane(0)) } else { value.max(lanes.lane(0)) };
        }
    }

    /// Returns the union of the outlines at the borders of the slices.
    #[inline(always)]
    fn during<S: Simd>(&self, simd: S, slice: Slice) -> LaneBoxes<S> {
        let [lo_x, hi_x, lo_y, hi_y, near, far] = &self.lists;
        LaneBoxes {
            lo_x: slice.least(simd, lo_x),
            hi_x: slice.most(simd, hi_x),
            lo_y: slice.least(simd, lo_y),
            hi_y: slice.most(simd, hi_y),
            near: slice.least(simd, near),
            far: slice.most(simd, far),
        }
    }
}

/// The outlines that eight samples are tested against; see [`Borders`].
struct LaneBoxes<S: Simd> {
    lo_x: Lanes<S>,
    hi_x: Lanes<S>,
    lo_y: Lanes<S>,
    hi_y: Lanes<S>,
    near: Lanes<S>,
    far: Lanes<S>,
}

impl<S: Simd> LaneBoxes<S> {
    #[inline(always)]
    fn lists(&self) -> [&Lanes<S>; 6] {
        [&self.lo_x, &self.hi_x, &self.lo_y, &self.hi_y, &self.near, &self.far]
    }

    /// Returns the raster boxes (x0, y0, x1, y1) of the outlines, seen through a part (x0, x1, y0, y1) of the lens.
    #[inline(always)]
    fn reach(&self, [x0, x1, y0, y1]: [f32; 4], scale: Vec2) -> [Lanes<S>; 4] {
        let x = self.side([self.lo_x, self.hi_x], x0 * scale.x, x1 * scale.x);
        let y = self.side([self.lo_y, self.hi_y], y0 * scale.y, y1 * scale.y);
        [x[0], y[0], x[1], y[1]]
    }

    /// Returns the least and largest coordinates of `lo..hi`, seen through a part of the lens from `l0` to `l1`.
    #[inline(always)]
    fn side(&self, [lo, hi]: [Lanes<S>; 2], l0: f32, l1: f32) -> [Lanes<S>; 2] {
        let [a, b] = [self.near * l0, self.far * l0];
        let [c, d] = [self.near * l1, self.far * l1];
        [lo + a.min(b).min(c.min(d)), hi + a.max(b).max(c.max(d))]
    }
}
