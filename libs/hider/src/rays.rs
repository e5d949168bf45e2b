//! Intersects the rays of samples with micropolygons.
//!
//! The edge functions are those of homogeneous rasterization (Olano and Greer, Triangle Scan Conversion using 2D
//! Homogeneous Coordinates, 1997), so that corners behind the camera need no clipping.

use super::candidates::{Candidate, Candidates};
use super::hit::{Corners, Raster, spans};
use super::lanes::{Lanes, Points, first_lanes};
use super::visible::ViewedGrid;
use granita_base::{Vec2, Vec3};
use granita_machine::simd::Simd;

/// A micropolygon that is searched for hits.
pub(super) struct Polygon {
    pub(super) corners: Corners,
    pub(super) rim: [bool; 4],
    /// The size of a pixel in camera space at z = 1.
    pub(super) pixel: Vec2,
}

/// The rays of eight samples in camera space.
struct Rays<S: Simd> {
    /// The x and y of the origins, whose z is 0.
    origin: [Lanes<S>; 2],
    /// The directions, whose z is 1.
    direction: Points<S>,
}

/// The edge functions of a micropolygon at eight rays.
///
/// The micropolygon consists of the triangles (0, 1, 2) and (0, 2, 3). The diagonal is not a boundary edge.
struct EdgeFunctions<'a, S: Simd> {
    polygon: &'a Polygon,
    perspective: bool,
    /// For each edge: true when it is a boundary edge, which is widened.
    widened: [bool; 4],
    /// The corners relative to the origins of the rays, in camera units.
    p: [Points<S>; 4],
    /// The normals of the planes through the origin of a ray and the edge from each corner to the next.
    normals: [Points<S>; 4],
    /// The functions of the edges from each corner to the next.
    e: [Lanes<S>; 4],
    /// The function of the diagonal from corner 0 to corner 2.
    diagonal: Lanes<S>,
    /// By how much the function of each edge may be on the outer side, where the edge is widened.
    pad: [Lanes<S>; 4],
    /// For each triangle: 1 when its edge functions are positive inside of it, otherwise -1.
    signs: [Lanes<S>; 2],
}

/// The hits of eight rays on a triangle of a micropolygon.
struct TriangleHits<S: Simd> {
    /// The rays that hit the triangle or the widening of its boundary edges, as bits.
    found: u32,
    /// The rays that hit the triangle itself, as bits.
    inside: u32,
    /// The depths in camera space.
    z: Lanes<S>,
    /// The coordinates in the micropolygon.
    u: Lanes<S>,
    v: Lanes<S>,
}

/// The corners of each triangle of a micropolygon.
const TRIANGLES: [[usize; 3]; 2] = [[0, 1, 2], [0, 2, 3]];

/// For each triangle: the edges of the micropolygon that are its edges; `None` for the diagonal.
const TRIANGLE_EDGES: [[Option<usize>; 3]; 2] = [[Some(0), Some(1), None], [None, Some(2), Some(3)]];

impl<'a, S: Simd> EdgeFunctions<'a, S> {
    /// Returns the edge functions at rays with these directions. `p` holds the corners relative to their origins.
    #[inline(always)]
    fn new(
        simd: S,
        polygon: &'a Polygon,
        view: &ViewedGrid,
        p: [Points<S>; 4],
        direction: &Points<S>,
    ) -> Self {
        // The normals of the planes through the origin and an edge are exactly opposite for opposite directions of
        // the edge.
        let diagonal = p[0].cross(&p[2]).dot(direction);
        let zero = Lanes::splat(simd, 0.0);
        let (mut normals, mut e) = ([p[0]; 4], [zero; 4]);
        for k in 0..4 {
            normals[k] = p[k].cross(&p[(k + 1) % 4]);
            e[k] = normals[k].dot(direction);
        }
        let mut out = Self {
            polygon,
            perspective: view.perspective,
            widened: polygon.rim.map(|rim| rim && view.rim_px > 0.0),
            p,
            normals,
            e,
            diagonal,
            pad: [zero; 4],
            signs: [(e[0] + e[1] - diagonal).sign(), (diagonal + e[2] + e[3]).sign()],
        };
        for k in 0..4 {
            if out.widened[k] {
                let [x, y] = out.slope(k);
                out.pad[k] = (x * x + y * y).root() * view.rim_px;
            }
        }
        out
    }

    /// Returns the change of an edge function over one pixel in x and y.
    #[inline(always)]
    fn slope(&self, k: usize) -> [Lanes<S>; 2] {
        let pixel = self.polygon.pixel;
        match self.perspective {
            true => [self.normals[k].x * pixel.x, self.normals[k].y * pixel.y],
            // In an orthographic view both ends are projected without their depths.
            false => {
                let (a, b) = (&self.p[k], &self.p[(k + 1) % 4]);
                [(a.y - b.y) * pixel.x, (b.x - a.x) * pixel.y]
            }
        }
    }

    /// Returns the functions of the edges of a triangle.
    #[inline(always)]
    fn of_triangle(&self, t: usize) -> [Lanes<S>; 3] {
        match t {
            0 => [self.e[0], self.e[1], -self.diagonal],
            _ => [self.diagonal, self.e[2], self.e[3]],
        }
    }

    /// Returns the least edge function of a triangle with its padding. It is not negative where a ray hits the
    /// triangle or the widening of its boundary edges.
    #[inline(always)]
    fn slack(&self, t: usize) -> Lanes<S> {
        let sign = self.signs[t];
        let slack = |k: usize| self.e[k] * sign + self.pad[k];
        match t {
            0 => slack(0).min(slack(1)).min(-self.diagonal * sign),
            _ => slack(2).min(slack(3)).min(self.diagonal * sign),
        }
    }

    /// Returns the hits on a triangle of the rays in `alive`, which are bits.
    #[inline(always)]
    fn hits(&self, simd: S, t: usize, alive: u32) -> TriangleHits<S> {
        let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
        let (e, sign) = (self.of_triangle(t), self.signs[t]);
        let sum = e[0] + e[1] + e[2];
        let size = sum * sign;
        // The size must be neither 0 nor infinite.
        let valid = size.positive() & (Lanes::splat(simd, f32::INFINITY) - size).positive();
        let found = self.slack(t).not_negative() & valid & alive;
        if found == 0 {
            return TriangleHits { found, inside: 0, z: zero, u: zero, v: zero };
        }
        let least = (e[0] * sign).min(e[1] * sign).min(e[2] * sign);
        let inside = found & least.not_negative();
        let mut w = [e[1], e[2], e[0]];
        for w in &mut w {
            *w = (*w / sum).max(zero).min(one);
        }
        let total = w[0] + w[1] + w[2];
        for w in &mut w {
            *w = *w / total;
        }
        let [a, b, c] = TRIANGLES[t];
        let z = w[0] * self.p[a].z + w[1] * self.p[b].z + w[2] * self.p[c].z;
        let along = (w[1] + w[2]).min(one);
        let (u, v) = if t == 0 { (along, w[2]) } else { (w[1], along) };
        TriangleHits { found, inside, z, u, v }
    }
}

impl Raster<'_> {
    /// Intersects rays from the lens points of samples with the two triangles of a micropolygon at the samples'
    /// times. It computes the depth along z and the coordinates in the micropolygon. For a ray that passes beside the
    /// micropolygon, on the widened boundary edge, it computes the direction to the micropolygon ([`Hit::beside`]).
    /// The samples are up to eight candidates from the index `first` on.
    ///
    /// [`Hit::beside`]: super::hit::Hit::beside
    #[inline(always)]
    pub(super) fn rays<S: Simd>(
        &self,
        simd: S,
        polygon: &Polygon,
        (list, first): (&Candidates, usize),
        hit: &mut impl FnMut(usize, f32, f32, f32, Option<Vec2>),
    ) {
        let view = self.view;
        let sample = |lane: usize| list.sample(first + lane);
        let (used, list) = (first_lanes(list.len() - first), list.eight(simd, first));
        let rays = self.rays_of(simd, &list, polygon.pixel);
        let time = list.time;
        let mut p = self.corners_at(simd, &polygon.corners, time);
        for p in &mut p {
            (p.x, p.y) = (p.x - rays.origin[0], p.y - rays.origin[1]);
        }
        let edges = EdgeFunctions::new(simd, polygon, view, p, &rays.direction);
        let far_enough = view.near.max(view.z_min);
        let mut alive = used;
        if let Some([from, to]) = view.existence {
            alive &= (time - from).not_negative() & (-(time - to)).not_negative();
        }
        let mut triangles = [edges.hits(simd, 0, alive), edges.hits(simd, 1, alive)];
        // A ray through the diagonal hits the first triangle.
        triangles[1].inside &= !triangles[0].inside;
        for TriangleHits { inside, z, u, v, .. } in &triangles {
            let clear = (*z - far_enough).not_negative() & (-(*z - view.far)).not_negative();
            let mut inside = inside & clear;
            if inside == 0 {
                continue;
            }
            let (z, u, v) = (z.numbers(), u.numbers(), v.numbers());
            while inside != 0 {
                let lane = inside.trailing_zeros() as usize;
                inside &= inside - 1;
                hit(sample(lane), z[lane], u[lane], v[lane], None);
            }
        }
        // These rays are beside both triangles, on the widened boundary edge of one.
        let mut beside =
            (triangles[0].found | triangles[1].found) & !(triangles[0].inside | triangles[1].inside);
        while beside != 0 {
            let lane = beside.trailing_zeros() as usize;
            beside &= beside - 1;
            let on_edge = triangles.iter().enumerate().find_map(|(t, triangle)| {
                let may_hit = triangle.found & 1 << lane != 0;
                let toward = if may_hit { self.beside(&edges, &rays.direction, t, lane) } else { None };
                toward.map(|toward| (triangle, toward))
            });
            if let Some((TriangleHits { z, u, v, .. }, toward)) = on_edge {
                let (z, u, v) = (z.lane(lane), u.lane(lane), v.lane(lane));
                if z >= far_enough && z <= view.far {
                    hit(sample(lane), z, u, v, Some(toward));
                }
            }
        }
    }

    /// Returns the rays from the lens points of samples through their raster positions. `pixel` is the size of a
    /// pixel in camera space at z = 1.
    #[inline(always)]
    fn rays_of<S: Simd>(&self, simd: S, list: &Candidate<Lanes<S>>, pixel: Vec2) -> Rays<S> {
        let view = self.view;
        let on_plane = [(list.x - view.center.x) * pixel.x, (list.y - view.center.y) * pixel.y];
        let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
        if !view.perspective {
            Rays { origin: on_plane, direction: Points { x: zero, y: zero, z: one } }
        } else if view.lens_radius > 0.0 {
            let lens = [list.lens_x, list.lens_y];
            let (x, y) = (on_plane[0] - lens[0] / view.focus, on_plane[1] - lens[1] / view.focus);
            Rays { origin: lens, direction: Points { x, y, z: one } }
        } else {
            Rays { origin: [zero; 2], direction: Points { x: on_plane[0], y: on_plane[1], z: one } }
        }
    }

    /// Returns the direction from the ray of a lane, which passes beside triangle `t` of a micropolygon, to the
    /// micropolygon in raster space. The length is arbitrary, and 0 where the edge is not widened. `None` when the
    /// ray does not pass along the edge.
    #[inline(always)]
    fn beside<S: Simd>(
        &self,
        edges: &EdgeFunctions<'_, S>,
        direction: &Points<S>,
        t: usize,
        lane: usize,
    ) -> Option<Vec2> {
        let e = edges.of_triangle(t);
        let (sign, e) = (edges.signs[t].lane(lane), [e[0].lane(lane), e[1].lane(lane), e[2].lane(lane)]);
        let k = (0..3).find(|k| e[*k] * sign < 0.0)?;
        let corner = |k: usize| edges.p[TRIANGLES[t][k]].lane(lane);
        let ends = [corner(k), corner((k + 1) % 3)];
        let ray = Vec2::new(direction.x.lane(lane), direction.y.lane(lane));
        if !self.is_along(ends, ray, edges.polygon.pixel) {
            return None;
        }
        let edge = TRIANGLE_EDGES[t][k].filter(|edge| edges.widened[*edge]);
        Some(edge.map_or(Vec2::ZERO, |edge| {
            let [x, y] = edges.slope(edge);
            Vec2::new(x.lane(lane), y.lane(lane)) * sign
        }))
    }

    /// Does the test of [`spans`] for a ray from the origin to `ray` at depth 1 past an edge. An edge that reaches
    /// behind the camera ends on one side only. An edge that is entirely behind the camera is beside no ray.
    fn is_along(&self, ends: [Vec3; 2], ray: Vec2, pixel: Vec2) -> bool {
        let view = self.view;
        let seen = |p: Vec3| p.truncate() / if view.perspective { p.z } else { 1.0 } / pixel;
        let at = if view.perspective { ray / pixel } else { Vec2::ZERO };
        if view.perspective && !ends.iter().all(|p| p.z > 0.0) {
            let [behind, front] = if ends[0].z > 0.0 { [ends[1], ends[0]] } else { ends };
            // The direction in which the raster position of the end in front moves on the way to the other end.
            let along = (behind.truncate() * front.z - front.truncate() * behind.z) / pixel;
            return front.z > 0.0 && (at - seen(front)).dot(along.normalize_or_zero()) >= -1.5 * view.rim_px;
        }
        let [from, to] = ends.map(seen);
        spans(to - from, at - from, view.rim_px)
    }
}
