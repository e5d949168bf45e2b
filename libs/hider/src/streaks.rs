//! Samples micropolygons that move far while the shutter is open, or that move through the near plane.
//!
//! A box around the path of such a micropolygon holds many times more samples than the streak that it draws. The
//! shutter is divided into parts, and these are divided again as long as the boxes of the parts become smaller. A
//! sample is tested only against the part that contains its time.

use super::candidates::{Candidate, Candidates};
use super::hit::{Corners, Raster};
use super::lanes::{LANES, Lanes, Points};
use super::visible::pixels_of;
use granita_base::{Bound, DVec3, Vec2, Vec3};
use granita_dicing::PixelRect;
use granita_machine::simd::Simd;

/// The distance in raster pixels that a point moves within one stratum of the shutter, from which on its micropolygon
/// is fast.
const FAST_PX: f32 = 8.0;

/// Parts whose boxes have no more pixels than this are not divided again.
const SMALL: usize = 48;

/// A part is divided when its pieces together have no more than this many times its pixels. Testing a ray takes
/// several times as long as comparing a time.
const WORTH: usize = 3;

/// The largest number of divisions into eight of one stratum of the shutter.
const MAX_DEPTH: u32 = 4;

/// Scratch for the search, kept from one micropolygon to the next.
#[derive(Default)]
pub(super) struct Streaks {
    /// For each stratum of the shutter: whether the grid may be visible in it here. Empty when that is not computed.
    live: Vec<bool>,
    parts: Vec<Part>,
}

/// A micropolygon that moves fast.
pub(super) struct Streak<'a> {
    pub(super) corners: &'a Corners,
    /// The pixels in which it may be visible.
    pub(super) whole: &'a PixelRect,
    /// The width in raster pixels by which its boundary edge is widened.
    pub(super) pad: f32,
    /// A depth that is not behind any of its hits.
    pub(super) nearest: f32,
    /// The limits of [`super::raster::Sink::limits`].
    pub(super) limits: Option<&'a [f32]>,
}

/// The shape whose path is bounded.
enum Hull<'a> {
    /// The corners of a micropolygon.
    Corners(&'a Corners),
    /// The camera space boxes of a grid at all keys.
    Boxes(&'a [Bound]),
}

/// The padding of a path.
#[derive(Clone, Copy)]
struct Padding {
    /// The padding in raster pixels.
    px: f32,
    /// The padding along each axis, in camera space units.
    cam: Vec3,
}

/// A part of a stratum of the shutter.
#[derive(Clone, Copy)]
struct Part {
    stratum: usize,
    depth: u32,
    /// The times between which its box is valid.
    times: [f32; 2],
    /// The part contains the samples from the first to before the second time. These are `times`, but infinite at the
    /// ends of a stratum.
    own: [f32; 2],
    place: Place,
    rect: PixelRect,
    /// Two lines in the raster between which the micropolygon stays; see [`Raster::sides`].
    sides: Option<[[f64; 3]; 2]>,
    /// The number of pixels in the rectangle between the lines.
    pixels: usize,
}

impl Part {
    fn new(stratum: usize, times: [f32; 2], own: [f32; 2], place: Place) -> Self {
        let rect = PixelRect { x0: 0, y0: 0, x1: 0, y1: 0 };
        Self { stratum, depth: 0, times, own, place, rect, sides: None, pixels: 0 }
    }

    /// Returns the columns of its pixels in a row.
    fn columns(&self, y: i32) -> std::ops::Range<i32> {
        let (mut from, mut to) = (f64::from(self.rect.x0), f64::from(self.rect.x1));
        for [a, b, c] in self.sides.iter().flatten() {
            // The largest value of the line's function in the row.
            let rest = (b * f64::from(y)).max(b * f64::from(y + 1)) + c;
            if *a > 0.0 {
                from = from.max((-rest / a).floor());
            } else if *a < 0.0 {
                to = to.min((-rest / a).floor() + 1.0);
            } else if rest < 0.0 {
                return 0..0;
            }
        }
        from as i32..to as i32
    }
}

/// A raster box as seen through a pinhole, and `1 / focus - 1 / z` at the nearest and the farthest depth for the
/// lens.
#[derive(Clone, Copy)]
struct Place {
    lo: Vec2,
    hi: Vec2,
    lens: [f32; 2],
}

impl Place {
    /// Returns the raster box as seen through a part (x0, x1, y0, y1) of the lens.
    fn reach(&self, [x0, x1, y0, y1]: [f32; 4], scale: Vec2) -> [f32; 4] {
        let blur = |l0: f32, l1: f32, scale: f32| {
            let all = [l0, l1].map(|l| self.lens.map(|lens| lens * l * scale));
            let all = all.as_flattened();
            let least = all.iter().copied().fold(f32::INFINITY, f32::min);
            (least, all.iter().copied().fold(f32::NEG_INFINITY, f32::max))
        };
        let (x, y) = (blur(x0, x1, scale.x), blur(y0, y1, scale.y));
        [self.lo.x + x.0, self.lo.y + y.0, self.hi.x + x.1, self.hi.y + y.1]
    }

    /// True when a sample may see this place through a point of the lens. `shift` is that point in raster pixels.
    fn holds(&self, sample: Vec2, shift: Vec2) -> bool {
        let (a, b) = (sample - shift * self.lens[0], sample - shift * self.lens[1]);
        let (lo, hi) = (a.min(b), a.max(b));
        hi.x > self.lo.x && lo.x < self.hi.x && hi.y > self.lo.y && lo.y < self.hi.y
    }
}

impl Raster<'_> {
    /// True when a micropolygon that travels this many raster pixels is followed through the parts of the shutter.
    #[inline(always)]
    pub(super) fn is_fast(&self, travel_px: f32) -> bool {
        let blurred = !self.samples.times.is_empty() && self.view.times.len() > 1;
        blurred && travel_px > FAST_PX * self.samples.time_strata() as f32
    }

    /// Finds the strata of the shutter in which the grid may be visible here. Returns whether there are any.
    #[inline(always)]
    pub(super) fn find_live(&self, simd: impl Simd, streaks: &mut Streaks) -> bool {
        let (view, window) = (self.view, self.window());
        streaks.live.clear();
        if window.is_empty() {
            return false;
        }
        if self.samples.times.is_empty() || view.times.len() < 2 || view.p_cam[0].is_empty() {
            return true;
        }
        if view.z_min >= self.closest() && !self.is_fast(self.travel_px(0)) {
            return true;
        }
        if !view.p_cam.iter().flatten().all(|p| p.is_finite()) {
            return true;
        }
        let hulls: Vec<Bound> = view.p_cam.iter().map(|p| Bound::around(p.iter().copied())).collect();
        let largest = hulls.iter().map(|hull| hull.min.abs().max(hull.max.abs()));
        let padding = self.padding(view.rim_px, largest.fold(Vec3::ZERO, Vec3::max));
        let hull = Hull::Boxes(&hulls);
        let strata = self.samples.time_strata();
        for first in (0..strata).step_by(LANES) {
            let places = self.places(simd, &hull, self.strata_times(first), padding);
            for (k, place) in places.iter().enumerate().take(strata - first) {
                let reach = place.reach(self.lens_box(first + k), view.scale);
                streaks.live.push(!pixels_of(reach, &window).is_empty());
            }
        }
        streaks.live.contains(&true)
    }

    /// Appends the samples that may see a micropolygon to the candidates.
    #[inline(always)]
    pub(super) fn follow<S: Simd>(
        &self,
        simd: S,
        streak: &Streak<'_>,
        streaks: &mut Streaks,
        candidates: &mut Candidates,
    ) {
        let (corners, padding) = (streak.corners, self.padding_of(streak));
        let hull = Hull::Corners(corners);
        let strata = self.samples.time_strata();
        let Streaks { live, parts } = streaks;
        parts.clear();
        for first in (0..strata).step_by(LANES) {
            let times = self.strata_times(first);
            let places = self.places(simd, &hull, times, padding);
            for (stratum, k) in (first..strata).zip(0..LANES) {
                if live.get(stratum) != Some(&false) {
                    let own = [f32::NEG_INFINITY, f32::INFINITY];
                    let part = Part::new(stratum, [times[k], times[k + 1]], own, places[k]);
                    parts.extend(self.seen_part(part, streak, streak.whole));
                }
            }
            while let Some(part) = parts.pop() {
                if part.pixels <= SMALL || part.depth == MAX_DEPTH {
                    self.take(&part, streak, candidates);
                    continue;
                }
                let times = eighths(part.times);
                let (new, last) = (parts.len(), LANES - 1);
                for (k, place) in self.places(simd, &hull, times, padding).into_iter().enumerate() {
                    let from = if k == 0 { part.own[0] } else { times[k] };
                    let own = [from, if k == last { part.own[1] } else { times[k + 1] }];
                    let piece = Part::new(part.stratum, [times[k], times[k + 1]], own, place);
                    parts.extend(self.seen_part(Part { depth: part.depth + 1, ..piece }, streak, &part.rect));
                }
                let pixels: usize = parts[new..].iter().map(|part| part.pixels).sum();
                if pixels > WORTH * part.pixels {
                    parts.truncate(new);
                    self.take(&part, streak, candidates);
                }
            }
        }
    }

    /// Finds the pixels of a part inside of `within`. Returns `None` when it has none.
    #[inline(always)]
    fn seen_part(&self, part: Part, streak: &Streak<'_>, within: &PixelRect) -> Option<Part> {
        let reach = part.place.reach(self.lens_box(part.stratum), self.view.scale);
        let rect = pixels_of(reach, within);
        if rect.is_empty() {
            return None;
        }
        let mut part = Part { rect, pixels: rect.width() * rect.height(), ..part };
        if part.pixels > SMALL {
            part.sides = self.sides(&part, streak);
            if part.sides.is_some() {
                let row = |y| part.columns(y).len();
                part.pixels = (rect.y0..rect.y1).map(row).sum();
            }
        }
        (part.pixels > 0).then_some(part)
    }

    /// Appends the samples of a part that may see the micropolygon to the candidates.
    #[inline(always)]
    fn take(&self, part: &Part, streak: &Streak<'_>, candidates: &mut Candidates) {
        let (samples, tables, rect) = (self.samples, &*self.samples.tables, &part.rect);
        let k = part.stratum;
        for y in rect.y0..rect.y1 {
            let columns = part.columns(y);
            if columns.is_empty() {
                continue;
            }
            let row = samples.pixel(columns.start, y);
            for pixel in row..row + columns.len() {
                let time = tables.time[samples.times[pixel] as usize + k];
                if !(time >= part.own[0] && time < part.own[1]) {
                    continue;
                }
                let sample = pixel * samples.per_pixel + k;
                let hidden = streak.limits.is_some_and(|limits| limits[sample] <= streak.nearest);
                if hidden || samples.varies() && k >= samples.count(pixel) {
                    continue;
                }
                let mut lens = Vec2::ZERO;
                if self.view.lens_radius > 0.0 {
                    let at = samples.lenses[pixel] as usize + k;
                    lens = Vec2::new(tables.lens_x[at], tables.lens_y[at]);
                }
                let (x, y) = (samples.x[sample], samples.y[sample]);
                if part.place.holds(Vec2::new(x, y), lens * self.view.scale) {
                    let one = Candidate { x, y, time, lens_x: lens.x, lens_y: lens.y };
                    candidates.push(sample, one);
                }
            }
        }
    }

    /// Returns two lines in the raster between which a micropolygon stays during a part. The value `a x + b y + c` is
    /// not negative there. The lines are those of planes through the eye that contain the direction in which the
    /// micropolygon is longest or moves, so that they are also valid where it passes the eye. Returns `None` when it
    /// lies around that direction, and for a lens.
    fn sides(&self, part: &Part, streak: &Streak<'_>) -> Option<[[f64; 3]; 2]> {
        let view = self.view;
        if !view.perspective || view.lens_radius > 0.0 {
            return None;
        }
        let keys = view.times.iter().filter(|t| part.times[0] < **t && **t < part.times[1]);
        let mut points: Vec<DVec3> = Vec::with_capacity(8);
        for &time in part.times.iter().chain(keys) {
            let (key, next, alpha) = granita_dicing::key_at(&view.times, time);
            points.extend(streak.corners.indices.map(|k| {
                let (a, b) = (view.p_cam[key][k].as_dvec3(), view.p_cam[next][k].as_dvec3());
                a.lerp(b, f64::from(alpha))
            }));
        }
        let middle = |p: &[DVec3]| p.iter().sum::<DVec3>() * 0.25;
        let ways =
            [points[2] - points[0], points[3] - points[1], middle(&points[4..8]) - middle(&points[..4])];
        let way = ways.into_iter().max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()))?;
        let way = way.try_normalize()?;
        let (s, t) = way.any_orthonormal_pair();
        let across = |p: &DVec3| DVec3::new(p.dot(s), p.dot(t), 0.0).truncate();
        let center =
            points.iter().map(|p| across(p).normalize_or_zero()).reduce(|a, b| a + b)?.try_normalize()?;
        let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
        for q in points.iter().map(across) {
            let (along, aside) = (center.dot(q), center.perp_dot(q));
            if along <= 1e-6 * q.length() || along.is_nan() {
                return None;
            }
            (least, most) = (least.min(aside / along), most.max(aside / along));
        }
        let (along, aside) = (s * center.x + t * center.y, t * center.x - s * center.y);
        let padding = self.padding_of(streak);
        let cam = padding.cam.as_dvec3();
        let nearest = points.iter().map(|p| p.z - cam.z).fold(f64::INFINITY, f64::min);
        let nearest = nearest.max(f64::from(self.closest()));
        let (scale, middle) = (view.scale.as_dvec2(), view.center.as_dvec2());
        let rect = &part.rect;
        let largest = [rect.x0, rect.x1, rect.y0, rect.y1].map(i32::unsigned_abs).into_iter().max()?;
        let room_px = f64::from(padding.px) + 1e-5 * (f64::from(largest) + middle.abs().max_element());
        Some([aside - along * least, along * most - aside].map(|normal| {
            let (a, b) = (normal.x / scale.x, normal.y / scale.y);
            let room = (a.abs() + b.abs()) * room_px + normal.abs().dot(cam) / nearest;
            [a, b, normal.z - a * middle.x - b * middle.y + room]
        }))
    }

    /// Returns the least and largest camera space coordinates of a hull at eight times.
    #[inline(always)]
    fn hull_at<S: Simd>(&self, simd: S, hull: &Hull<'_>, time: Lanes<S>) -> [Points<S>; 2] {
        match hull {
            Hull::Corners(corners) => {
                let [a, b, c, d] = self.corners_at(simd, corners, time);
                [a.min(&b).min(&c.min(&d)), a.max(&b).max(&c.max(&d))]
            }
            Hull::Boxes(boxes) => {
                let [lo, hi] = self.boxes_at(boxes, &time.numbers());
                [Points::new(simd, &lo), Points::new(simd, &hi)]
            }
        }
    }

    /// Returns the least and largest coordinates of boxes of the keys at eight times.
    #[inline(never)]
    fn boxes_at(&self, hulls: &[Bound], time: &[f32; LANES]) -> [[[f32; LANES]; 3]; 2] {
        let boxes = time.map(|time| {
            let (key, next, alpha) = granita_dicing::key_at(&self.view.times, time);
            let (a, b) = (hulls[key], hulls[next]);
            [a.min * (1.0 - alpha) + b.min * alpha, a.max * (1.0 - alpha) + b.max * alpha]
        });
        [0, 1].map(|k| [boxes.map(|h| h[k].x), boxes.map(|h| h[k].y), boxes.map(|h| h[k].z)])
    }

    /// Returns the places between each of some times and the next. Points move along straight lines from key to key,
    /// so that the boxes at both times and at the keys between them contain the path.
    #[inline(always)]
    fn places<S: Simd>(
        &self,
        simd: S,
        hull: &Hull<'_>,
        times: [f32; LANES + 1],
        padding: Padding,
    ) -> [Place; LANES] {
        let view = self.view;
        let [a_lo, a_hi] = self.hull_at(simd, hull, Lanes::load(simd, &times, 0));
        let [b_lo, b_hi] = self.hull_at(simd, hull, Lanes::load(simd, &times, 1));
        let (mut lo, mut hi) = (a_lo.min(&b_lo), a_hi.max(&b_hi));
        for &key in view.times.iter().skip(1).take(view.times.len().saturating_sub(2)) {
            let [key_lo, key_hi] = self.hull_at(simd, hull, Lanes::splat(simd, key));
            // 1 for the parts that contain the key, else -1.
            let mut within = [-1.0; LANES];
            for (k, within) in within.iter_mut().enumerate() {
                if times[k] <= key && key <= times[k + 1] {
                    *within = 1.0;
                }
            }
            let within = Lanes::new(simd, &within);
            lo = lo.min(&key_lo).or(within, &lo);
            hi = hi.max(&key_hi).or(within, &hi);
        }
        let (r, closest) = (padding.cam, Lanes::splat(simd, self.closest()));
        let last_z = hi.z + r.z;
        let (z0, z1) = ((lo.z - r.z).max(closest), last_z.max(closest));
        let depths = [z0, z1];
        let x = self.side([lo.x - r.x, hi.x + r.x], view.scale.x, &depths);
        let y = self.side([lo.y - r.y, hi.y + r.y], view.scale.y, &depths);
        let (x, y) = (padded(x, view.center.x, padding.px), padded(y, view.center.y, padding.px));
        let (focus, one) = (Lanes::splat(simd, 1.0 / view.focus), Lanes::splat(simd, 1.0));
        let (near, far) = (focus - one / z0, focus - one / z1);
        // Rounding moves a hit by less than this margin.
        let least_z = self.closest() * (1.0 - 1e-5);
        let [lo_x, hi_x, lo_y, hi_y] = [x[0].numbers(), x[1].numbers(), y[0].numbers(), y[1].numbers()];
        let [near, far, last_z] = [near.numbers(), far.numbers(), last_z.numbers()];
        std::array::from_fn(|k| {
            let (lo, hi) = (Vec2::new(lo_x[k], lo_y[k]), Vec2::new(hi_x[k], hi_y[k]));
            let lens = if view.lens_radius > 0.0 { [near[k], far[k]] } else { [0.0; 2] };
            if last_z[k] < least_z {
                Place { lo: Vec2::INFINITY, hi: Vec2::NEG_INFINITY, lens: [0.0; 2] }
            } else if lo.is_finite() && hi.is_finite() {
                Place { lo, hi, lens }
            } else {
                Place { lo: Vec2::NEG_INFINITY, hi: Vec2::INFINITY, lens }
            }
        })
    }

    /// Returns the least and largest raster coordinates of `lo..hi` in camera space, relative to the centre.
    #[inline(always)]
    fn side<S: Simd>(&self, [lo, hi]: [Lanes<S>; 2], scale: f32, [z0, z1]: &[Lanes<S>; 2]) -> [Lanes<S>; 2] {
        let (a, b) = (lo * scale, hi * scale);
        let (lo, hi) = (a.min(b), a.max(b));
        match self.view.perspective {
            true => [(lo / *z0).min(lo / *z1), (hi / *z0).max(hi / *z1)],
            false => [lo, hi],
        }
    }

    #[inline(always)]
    fn padding_of(&self, streak: &Streak<'_>) -> Padding {
        let places = self.view.p_cam.iter().flat_map(|p| streak.corners.indices.map(|k| p[k].abs()));
        self.padding(streak.pad, places.fold(Vec3::ZERO, Vec3::max))
    }

    /// Returns the padding for a path of points whose largest camera space coordinates are `largest`, on a boundary
    /// edge that is widened by `rim_px` raster pixels.
    #[inline(always)]
    fn padding(&self, rim_px: f32, largest: Vec3) -> Padding {
        // A point beside a boundary edge is up to 1.8 times the width away from the end of the edge. Between keys the
        // points are rounded relative to their positions at the keys, however close to the camera they come.
        Padding { px: 2.0 * rim_px + 0.01, cam: largest * (8.0 * f32::EPSILON) }
    }

    /// Returns the beginnings of eight strata of the shutter and the end of the last one.
    #[inline(always)]
    fn strata_times(&self, first: usize) -> [f32; LANES + 1] {
        let strata = self.samples.time_strata();
        std::array::from_fn(|k| self.samples.stratum_time((first + k).min(strata)))
    }

    /// Returns the box of the lens points of a stratum's samples.
    #[inline(always)]
    fn lens_box(&self, stratum: usize) -> [f32; 4] {
        match self.samples.tables.lens_boxes.get(stratum / LANES) {
            Some(lens) if self.view.lens_radius > 0.0 => *lens,
            _ => [0.0; 4],
        }
    }
}

/// Returns absolute raster coordinates from those relative to the centre, padded for rounding and by `px`.
#[inline(always)]
fn padded<S: Simd>([lo, hi]: [Lanes<S>; 2], center: f32, px: f32) -> [Lanes<S>; 2] {
    let room = hi.max(-lo) * 1e-5 + (px + 1e-5 * center.abs());
    [lo + center - room, hi + center + room]
}

/// Returns nine times that divide the time between two into eight equal parts.
fn eighths([from, to]: [f32; 2]) -> [f32; LANES + 1] {
    std::array::from_fn(|k| if k == LANES { to } else { from + (to - from) * (k as f32 / LANES as f32) })
}
