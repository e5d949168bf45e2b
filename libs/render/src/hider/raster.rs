//! Which samples hit which micropolygons.

use super::SampleGrid;
use super::visible::{ShadedGrid, ViewedGrid, pixels_of};
use crate::PixelRect;
use granita_base::{Vec2, Vec3};

/// A grid over samples.
pub(super) struct Raster<'a> {
    pub(super) samples: &'a SampleGrid,
    pub(super) grid: &'a ShadedGrid,
    /// As the eye sees it whose samples these are.
    pub(super) view: &'a ViewedGrid,
}

/// A micropolygon at a sample.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hit {
    pub(super) sample: usize,
    /// Camera space depth.
    pub(super) z: f32,
    /// Lower left point of the micropolygon.
    pub(super) at: u32,
    /// Place in the micropolygon.
    pub(super) u: f32,
    pub(super) v: f32,
    /// The micropolygon is on the rim of its grid.
    pub(super) rim: bool,
    /// The sample lies beside the grid, no farther from its rim than [`ViewedGrid::rim_px`]: where the grid is from
    /// there, of any length.
    pub(super) beside: Option<Vec2>,
}

/// Takes hits.
type Hits<'h> = dyn FnMut(Hit) + 'h;

/// One edge of a raster triangle: `(x - ox) * a + (y - oy) * b`, positive inside.
#[derive(Clone, Copy)]
struct Edge {
    a: f32,
    b: f32,
    ox: f32,
    oy: f32,
    /// A sample is inside above this,
    least: f32,
    /// and on the widened rim above this.
    least_rim: f32,
    /// From one end to the other.
    d: Vec2,
}

impl Edge {
    /// From `p` to `q`; `sign` is that of the triangle's area. The arithmetic does not depend on the direction, so
    /// that two triangles that share an edge agree about every sample.
    fn new(p: Vec2, q: Vec2, sign: f32, widen: f32) -> Self {
        let swapped = (q.x, q.y) < (p.x, p.y);
        let (p, q, sign) = if swapped { (q, p, -sign) } else { (p, q, sign) };
        let d = q - p;
        // A sample on the edge belongs to the triangle for which the edge runs forward.
        let least = if sign > 0.0 { -f32::MIN_POSITIVE } else { 0.0 };
        let least_rim = if widen > 0.0 { -widen * d.length() } else { least };
        Self { a: -d.y * sign, b: d.x * sign, ox: p.x, oy: p.y, least, least_rim, d }
    }

    /// Whether a place is beside the edge, and not beyond its ends.
    fn spans(&self, x: f32, y: f32, pad: f32) -> bool {
        spans(self.d, Vec2::new(x - self.ox, y - self.oy), pad)
    }

    fn at(&self, x: f32, y: f32) -> f32 {
        (x - self.ox) * self.a + (y - self.oy) * self.b
    }
}

/// Whether a place `from` the begin of an edge `d` is beside it, and not beyond its ends by more than about `pad`: a
/// sharp corner that is widened on one or both sides would have a long spike otherwise.
fn spans(d: Vec2, from: Vec2, pad: f32) -> bool {
    // Two sides, each widened by `pad`, meet 1.41 of it from a right angle.
    let (along, length) = (from.dot(d), d.length());
    along >= -1.5 * pad * length && along <= (length + 1.5 * pad) * length
}

impl Raster<'_> {
    /// Finds all hits; order of micropolygons, then of samples.
    pub(super) fn each_hit(&self, hit: &mut Hits<'_>) {
        let grid = self.grid;
        let (mu, mv) = (grid.nu.saturating_sub(1), grid.nv.saturating_sub(1));
        for j in 0..mv {
            for i in 0..mu {
                if grid.kept.get(j * mu + i).is_some_and(|kept| !kept) {
                    continue;
                }
                // Sides at v = 0, u = 1, v = 1, u = 0.
                let [s0, s1, s2, s3] = grid.sides;
                let rim = [s0 && j == 0, s1 && i + 1 == mu, s2 && j + 1 == mv, s3 && i == 0];
                if self.view.raster.is_empty() {
                    self.moving(j * grid.nu + i, rim, hit);
                } else {
                    self.still(j * grid.nu + i, rim, hit);
                }
            }
        }
    }

    /// Pixels in which the grid may be seen.
    fn window(&self) -> PixelRect {
        self.samples.rect.intersection(&self.view.rect)
    }

    fn widening(&self, rim: bool) -> f32 {
        if rim { self.view.rim_px } else { 0.0 }
    }

    /// A micropolygon that does not move, without a lens, all before the camera.
    fn still(&self, at: usize, rim: [bool; 4], hit: &mut Hits<'_>) {
        let (grid, samples) = (self.grid, self.samples);
        let nu = grid.nu;
        let near = self.view.near.max(self.view.z_min);
        let corner = [at, at + 1, at + nu + 1, at + nu].map(|i| self.view.raster[i]);
        let (lo, hi) =
            corner[1..].iter().fold((corner[0], corner[0]), |(lo, hi), c| (lo.min(*c), hi.max(*c)));
        let any_rim = rim.contains(&true);
        let pad = self.widening(any_rim);
        let rect = pixels_of([lo.x - pad, lo.y - pad, hi.x + pad, hi.y + pad], &self.window());
        if rect.is_empty() {
            return;
        }
        // Triangles (0, 1, 2) and (0, 2, 3); the diagonal is no rim.
        let triangles = [([0, 1, 2], [rim[0], rim[1], false]), ([0, 2, 3], [false, rim[2], rim[3]])];
        for (second, (index, rims)) in triangles.into_iter().enumerate() {
            let p = index.map(|k| corner[k]);
            let q = p.map(Vec3::truncate);
            let area = (q[1] - q[0]).perp_dot(q[2] - q[0]);
            if area == 0.0 || !area.is_finite() {
                continue;
            }
            let sign = area.signum();
            let edges: [Edge; 3] =
                std::array::from_fn(|k| Edge::new(q[k], q[(k + 1) % 3], sign, self.widening(rims[k])));
            let inverse = 1.0 / area.abs();
            for y in rect.y0..rect.y1 {
                for x in rect.x0..rect.x1 {
                    let first = samples.pixel(x, y) * samples.per_pixel;
                    for s in first..first + samples.per_pixel {
                        let (sx, sy) = (samples.x[s], samples.y[s]);
                        let e = [edges[0].at(sx, sy), edges[1].at(sx, sy), edges[2].at(sx, sy)];
                        if !(0..3).all(|k| e[k] > edges[k].least_rim) {
                            continue;
                        }
                        let crossed = (0..3).find(|k| e[*k] <= edges[*k].least);
                        if crossed.is_some_and(|k| !edges[k].spans(sx, sy, pad)) {
                            continue;
                        }
                        let beside = crossed.map(|k| Vec2::new(edges[k].a, edges[k].b));
                        // Edge k lies opposite to corner k + 2.
                        let w = [e[1] * inverse, e[2] * inverse, e[0] * inverse].map(|w| w.clamp(0.0, 1.0));
                        let sum = w[0] + w[1] + w[2];
                        let (z, w) = self.depth(p, w, sum);
                        if !(z >= near && z <= self.view.far) {
                            continue;
                        }
                        let (u, v) = place(second == 1, w);
                        hit(Hit { sample: s, z, at: at as u32, u, v, rim: any_rim, beside });
                    }
                }
            }
        }
    }

    /// Depth from the third coordinate of the corners, and weights that are right in space, summing to one.
    fn depth(&self, p: [Vec3; 3], w: [f32; 3], sum: f32) -> (f32, [f32; 3]) {
        let third = (w[0] * p[0].z + w[1] * p[1].z + w[2] * p[2].z) / sum;
        if self.view.perspective {
            let z = 1.0 / third;
            (z, std::array::from_fn(|k| w[k] * p[k].z * z / sum))
        } else {
            (third, w.map(|w| w / sum))
        }
    }

    /// Any micropolygon: a ray through each sample's lens point at its time, against the corners where they are then.
    ///
    /// The edge functions are those of homogeneous rasterization (Olano and Greer, Triangle Scan Conversion using
    /// 2D Homogeneous Coordinates, 1997), so that corners behind the camera need no clipping.
    fn moving(&self, at: usize, rim: [bool; 4], hit: &mut Hits<'_>) {
        let (grid, samples) = (self.grid, self.samples);
        let (nu, view) = (grid.nu, self.view);
        let near = view.near.max(view.z_min);
        let corners = [at, at + 1, at + nu + 1, at + nu];
        let any_rim = rim.contains(&true);
        let pad = self.widening(any_rim);
        let (b, _) = view.bound(corners.into_iter());
        let whole = pixels_of([b[0] - pad, b[1] - pad, b[2] + pad, b[3] + pad], &self.window());
        if whole.is_empty() {
            return;
        }
        let pixel = Vec2::new(1.0 / view.scale.x, 1.0 / view.scale.y);
        // What moves far is in few places at any one time: each slice of the shutter looks only where it is then
        // (Fatahalian et al., Data-Parallel Rasterization of Micropolygons with Defocus and Motion Blur, 2009).
        let strata = samples.time_strata();
        let slices = strata.min(self.travel_px(corners, b));
        let mut begin = self.outline(corners, samples.stratum_time(0));
        for slice in 0..slices {
            let strata = slice * strata / slices..(slice + 1) * strata / slices;
            let end = self.outline(corners, samples.stratum_time(strata.end));
            let outline = self.swept(corners, begin, end, &strata, pad);
            begin = end;
            let rect = match &outline {
                Some(outline) => pixels_of(outline.reach(view.lens_radius), &whole),
                None => whole,
            };
            for y in rect.y0..rect.y1 {
                for x in rect.x0..rect.x1 {
                    for s in samples.within(samples.pixel(x, y), &strata) {
                        let place = Vec2::new(samples.x[s], samples.y[s]);
                        let lens = match samples.lens.get(s) {
                            Some(lens) if view.lens_radius > 0.0 && view.perspective => Vec2::from(*lens),
                            _ => Vec2::ZERO,
                        };
                        if outline.as_ref().is_some_and(|outline| outline.misses(place, lens)) {
                            continue;
                        }
                        let on_plane = (place - view.center) * pixel;
                        let (origin, direction) = match (view.perspective, lens == Vec2::ZERO) {
                            (false, _) => (on_plane.extend(0.0), Vec3::Z),
                            (true, true) => (Vec3::ZERO, on_plane.extend(1.0)),
                            (true, false) => (lens.extend(0.0), (on_plane - lens / view.focus).extend(1.0)),
                        };
                        let (key, next, alpha) = match samples.time.get(s) {
                            Some(time) => crate::dicing::key_at(&view.times, *time),
                            None => (0, 0, 0.0),
                        };
                        let p = corners.map(|i| view.between(key, next, alpha, i) - origin);
                        if let Some((z, u, v, beside)) = self.ray(p, direction, pixel, rim)
                            && z >= near
                            && z <= view.far
                        {
                            hit(Hit { sample: s, z, at: at as u32, u, v, rim: any_rim, beside });
                        }
                    }
                }
            }
        }
    }

    /// About how many pixels a micropolygon moves, at least 1; `whole` is the raster box of its path.
    fn travel_px(&self, corners: [usize; 4], whole: [f32; 4]) -> usize {
        let Some(start) = self.outline(corners, self.view.times[0]) else { return usize::MAX };
        let path = Vec2::new(whole[2] - whole[0], whole[3] - whole[1]);
        (path - (start.hi - start.lo)).max_element().ceil().max(1.0) as usize
    }

    /// Where a micropolygon is at one time; `None` when it is too close to the camera to tell.
    fn outline(&self, corners: [usize; 4], time: f32) -> Option<Outline> {
        let view = self.view;
        let mut outline = Outline {
            lo: Vec2::INFINITY,
            hi: Vec2::NEG_INFINITY,
            scale: view.scale,
            near: f32::INFINITY,
            far: f32::NEG_INFINITY,
        };
        let (key, next, alpha) = crate::dicing::key_at(&view.times, time);
        for i in corners {
            let p = view.between(key, next, alpha, i);
            if view.perspective && !(p.z >= view.near && p.z > 0.0) {
                return None;
            }
            let q = view.project(p);
            (outline.lo, outline.hi) = (outline.lo.min(q), outline.hi.max(q));
            (outline.near, outline.far) = (outline.near.min(p.z), outline.far.max(p.z));
        }
        Some(outline)
    }

    /// Where a micropolygon is from the `begin` to the `end` of some parts of the shutter, rims included. Between keys
    /// points move along straight lines, which the projection keeps straight.
    fn swept(
        &self,
        corners: [usize; 4],
        begin: Option<Outline>,
        end: Option<Outline>,
        strata: &std::ops::Range<usize>,
        pad: f32,
    ) -> Option<Outline> {
        let view = self.view;
        let mut outline = begin?.with(&end?);
        let [first, last] = [strata.start, strata.end].map(|k| self.samples.stratum_time(k));
        for time in view.times.iter().filter(|t| **t > first && **t < last) {
            outline = outline.with(&self.outline(corners, *time)?);
        }
        // Room for rounding.
        let room = pad + 0.01 + 1e-5 * (outline.lo.abs().max(outline.hi.abs()).max_element());
        (outline.lo, outline.hi) = (outline.lo - room, outline.hi + room);
        if view.lens_radius > 0.0 {
            let shift = |z: f32| 1.0 / view.focus - 1.0 / z;
            (outline.near, outline.far) = (shift(outline.near), shift(outline.far));
        }
        Some(outline)
    }

    /// A ray from the origin through the two triangles of a micropolygon; depth along z, place, and where they are when
    /// it passes beside them, on the widened rim ([`Hit::beside`]).
    fn ray(
        &self,
        p: [Vec3; 4],
        direction: Vec3,
        pixel: Vec2,
        rim: [bool; 4],
    ) -> Option<(f32, f32, f32, Option<Vec2>)> {
        // Normals of the planes through the origin and an edge; exactly opposite for opposite directions.
        let plane = |i: usize, j: usize| p[i].cross(p[j]);
        let diagonal = plane(0, 2);
        let sides = [plane(0, 1), plane(1, 2), plane(2, 3), plane(3, 0)];
        // How the edge functions change over one pixel, where that matters.
        let slope: [Vec2; 4] = std::array::from_fn(|k| {
            if !rim[k] || self.view.rim_px <= 0.0 {
                Vec2::ZERO
            } else if self.view.perspective {
                sides[k].truncate() * pixel
            } else {
                // Both ends are as deep as they are.
                (p[(k + 1) % 4] - p[k]).truncate().perp() * pixel
            }
        });
        let pad = slope.map(|slope| self.view.rim_px * slope.length());
        let e = sides.map(|n| n.dot(direction));
        let d = diagonal.dot(direction);
        let triangles = [
            ([p[0], p[1], p[2]], [e[0], e[1], -d], [Some(0), Some(1), None]),
            ([p[0], p[2], p[3]], [d, e[2], e[3]], [None, Some(2), Some(3)]),
        ];
        let mut on_rim = None;
        for (second, (corner, e, side)) in triangles.into_iter().enumerate() {
            let sum = e[0] + e[1] + e[2];
            let sign = if sum < 0.0 { -1.0 } else { 1.0 };
            let pad = side.map(|side| side.map_or(0.0, |k| pad[k]));
            if sum == 0.0 || !sum.is_finite() || (0..3).any(|k| e[k] * sign < -pad[k]) {
                continue;
            }
            let w = [e[1], e[2], e[0]].map(|w| (w / sum).clamp(0.0, 1.0));
            let total = w[0] + w[1] + w[2];
            let w = w.map(|w| w / total);
            let z = w[0] * corner[0].z + w[1] * corner[1].z + w[2] * corner[2].z;
            let (u, v) = place(second == 1, w);
            match (0..3).find(|k| e[*k] * sign < 0.0) {
                None => return Some((z, u, v, None)),
                Some(k) => {
                    let ends = [corner[k], corner[(k + 1) % 3]];
                    if self.is_along(ends, direction, pixel) {
                        let toward = side[k].map_or(Vec2::ZERO, |side| slope[side] * sign);
                        on_rim.get_or_insert((z, u, v, Some(toward)));
                    }
                }
            }
        }
        on_rim
    }

    /// As [`spans`], for a ray from the origin past an edge; edges that reach behind the camera have no ends.
    fn is_along(&self, ends: [Vec3; 2], direction: Vec3, pixel: Vec2) -> bool {
        let view = self.view;
        if view.perspective && !ends.iter().all(|p| p.z > 0.0) {
            return true;
        }
        let seen = |p: Vec3| p.truncate() / if view.perspective { p.z } else { 1.0 } / pixel;
        let at = if view.perspective { seen(direction) } else { Vec2::ZERO };
        let [from, to] = ends.map(seen);
        spans(to - from, at - from, view.rim_px)
    }
}

/// Where a micropolygon is seen: a point at depth `z`, seen through the lens point `l`, appears
/// `scale * l * (1 / focus - 1 / z)` away from where a pinhole shows it.
#[derive(Clone, Copy)]
struct Outline {
    /// Raster box as a pinhole shows it.
    lo: Vec2,
    hi: Vec2,
    scale: Vec2,
    /// Depths of the nearest and farthest corner; once swept, with a lens, `1 / focus - 1 / z` of them.
    near: f32,
    far: f32,
}

impl Outline {
    /// Of both.
    fn with(&self, other: &Self) -> Self {
        Self {
            lo: self.lo.min(other.lo),
            hi: self.hi.max(other.hi),
            scale: self.scale,
            near: self.near.min(other.near),
            far: self.far.max(other.far),
        }
    }

    /// Raster box as the whole lens shows it.
    fn reach(&self, lens_radius: f32) -> [f32; 4] {
        let shift = if lens_radius > 0.0 {
            (self.scale * (lens_radius * self.near.abs().max(self.far.abs()))).abs()
        } else {
            Vec2::ZERO
        };
        let (lo, hi) = (self.lo - shift, self.hi + shift);
        [lo.x, lo.y, hi.x, hi.y]
    }

    /// Whether a sample at `place` through the lens point `lens` surely misses.
    fn misses(&self, place: Vec2, lens: Vec2) -> bool {
        if lens == Vec2::ZERO {
            return place.cmplt(self.lo).any() || place.cmpgt(self.hi).any();
        }
        let shift = self.scale * lens;
        let (a, b) = (place - shift * self.near, place - shift * self.far);
        a.max(b).cmplt(self.lo).any() || a.min(b).cmpgt(self.hi).any()
    }
}

/// Place in the micropolygon from the weights in one of its triangles.
fn place(second: bool, w: [f32; 3]) -> (f32, f32) {
    if second { (w[1], (w[1] + w[2]).min(1.0)) } else { ((w[1] + w[2]).min(1.0), w[2]) }
}
