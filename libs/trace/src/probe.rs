//! Tests of a ray against boxes and triangles.
//!
//! Triangles are tested as in Woop, Benthin, Wald: "Watertight Ray/Triangle Intersection", JCGT 2(1), 2013. The
//! vertices are translated and sheared so that the ray runs along z from the origin. Three 2D edge functions then
//! determine whether the ray passes inside. Rounding of products is monotonic, so that an edge function has the right
//! sign or is 0. Lanes with a 0, and all candidates for a hit, are tested again in double precision, where products
//! of single precision numbers are exact. An edge through which the ray passes counts as inside for both of its
//! triangles, so that no ray passes between them. The place on the triangle and the distance are computed in double
//! precision from the vertices themselves.
//!
//! Boxes are enlarged by the largest error of the sheared coordinates, so that the ray hits the box of each triangle
//! that it hits. A hit is valid only when the ray also hits the triangle's own box by the same arithmetic, and when
//! the hit does not lie before that box. Rounding is monotonic, so that the ray enters all enclosing boxes no later.
//! A tree therefore finds the same hits as a test of all triangles.

use crate::Ray;
use crate::layout::{Block, Box3, Node};
use granita_base::{Bound, Vec3};
use granita_machine::simd::{NARROW, Simd, WIDE};

/// Origins farther away than this, in sizes of the scene, are moved towards the scene.
pub(crate) const FAR: f32 = 4.0;
/// The largest error of coordinates and distances to planes, relative to the largest distance of a vertex along an
/// axis. There are at most six roundings of sheared coordinates and three for each of two distances to planes, 2^-24
/// each.
pub(crate) const ROOM: f32 = 1.0 / (1 << 20) as f32;

/// The coordinates of a tree. They are those of the scene times a power of two that makes the largest less than 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Scale {
    factor: f32,
}

impl Scale {
    /// Returns the scale for coordinates up to `size`.
    pub(crate) fn new(size: f32) -> Self {
        Self { factor: if size > 0.0 { power_of_two(-exponent(size) - 1) } else { 1.0 } }
    }

    /// Returns the scale for everything within `bound`, which may be empty.
    pub(crate) fn of(bound: &Bound) -> Self {
        let size = bound.min.abs().max(bound.max.abs()).max_element();
        Self::new(if bound.is_empty() { 0.0 } else { size })
    }

    /// The power of two.
    #[inline(always)]
    pub(crate) fn factor(self) -> f32 {
        self.factor
    }

    /// Converts a box of the scene.
    pub(crate) fn bounds(&self, bound: &Bound) -> Box3 {
        Box3 { lo: self.point(bound.min).to_array(), hi: self.point(bound.max).to_array() }
    }

    /// Converts a point of the scene.
    #[inline]
    pub(crate) fn point(&self, p: Vec3) -> Vec3 {
        p * self.factor
    }
}

/// Returns `e` for `1 <= x / 2^e < 2`, within the range of [`power_of_two`].
fn exponent(x: f32) -> i32 {
    (((x.to_bits() >> 23) & 255) as i32 - 127).clamp(-125, 126)
}

/// Returns `2^e` for `e` from -127 to 127.
fn power_of_two(e: i32) -> f32 {
    if e < -126 { f32::MIN_POSITIVE * 0.5 } else { f32::from_bits(((e + 127) as u32) << 23) }
}

/// The values of a ray that are the same for all boxes and triangles.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Probe {
    /// The origin for near planes, shifted so that the planes come nearer.
    pub(crate) near_origin: [f32; 3],
    /// The origin for far planes, shifted so that the planes are farther away.
    pub(crate) far_origin: [f32; 3],
    pub(crate) inverse: [f32; 3],
    /// The rows of a node with the near planes. The rows with the far planes differ in bit 0.
    pub(crate) near_row: [usize; 3],
    /// The axes, ordered so that the last is the ray's longest.
    pub(crate) axes: [usize; 3],
    pub(crate) origin: [f32; 3],
    /// The shear of x and y along z.
    pub(crate) shear: [f32; 2],
    /// The shear of x and y and the scale of z, in double precision.
    pub(crate) exact: [f64; 3],
    /// The direction.
    pub(crate) dir: [f32; 3],
    /// The smallest distance, in the units of the tree.
    pub(crate) tmin: f32,
    /// The largest distance, in the units of the tree.
    pub(crate) tmax: f32,
    /// The distance by which the origin was moved.
    pub(crate) advance: f64,
    /// The ray's unit of distance, in the units of the tree.
    pub(crate) unit: f64,
}

/// The intersection of a ray with a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Met {
    /// The distance in the units of the tree.
    pub(crate) t: f32,
    /// The weight of the second vertex.
    pub(crate) b1: f32,
    /// The weight of the third vertex.
    pub(crate) b2: f32,
}

impl Probe {
    /// Returns a number for the signs of the direction and its longest axis.
    #[inline(always)]
    pub(crate) fn class(&self) -> u32 {
        let [x, y, z] = self.near_row;
        (self.axes[2] << 3 | (z & 1) << 2 | (y & 1) << 1 | x & 1) as u32
    }

    /// Returns the probe of a ray. `bounds` is the box of everything in the coordinates of the tree. `None` for rays
    /// that hit nothing, because they are not finite, have no direction, or pass far from everything.
    #[inline(always)]
    pub(crate) fn new(ray: &Ray, scale: Scale, bounds: &Box3) -> Option<Self> {
        let size = largest(ray.dir);
        // NaN compares false, but the NaN of one component may be hidden by other components.
        let finite = ray.origin.is_finite() & ray.dir.is_finite() & ray.time.is_finite() & (size > 0.0);
        if !(finite & (ray.tmin <= ray.tmax)) {
            return None;
        }
        let mut origin = ray.origin * scale.factor;
        let (mut dir, mut unit, mut advance) = (ray.dir, f64::from(scale.factor), 0.0);
        if !(MODERATE.contains(&size) && largest(origin) <= FAR) {
            (origin, dir, unit, advance) = moderate(ray, scale, bounds)?;
        }
        let (lo, hi) = (Vec3::from_array(bounds.lo), Vec3::from_array(bounds.hi));
        let reach = largest((lo - origin).abs().max((hi - origin).abs()));
        // The padding includes the rounding when it is added to the origin.
        let room = reach * ROOM + largest(origin) * f32::EPSILON;
        let inverse = 1.0 / dir;
        let moved = Vec3::splat(room).copysign(inverse);
        let d = dir.abs();
        let z = if d.z > d.x.max(d.y) { 2 } else { usize::from(d.y > d.x) };
        let axes = [NEXT[z], NEXT[z + 1], z];
        let dir = dir.to_array();
        let depth = 1.0 / f64::from(dir[z]);
        let exact = [f64::from(dir[axes[0]]) * depth, f64::from(dir[axes[1]]) * depth, depth];
        let inverse = inverse.to_array();
        let origin_of = origin.to_array();
        let row = |a: usize| 2 * a + (inverse[a].to_bits() >> 31) as usize;
        Some(Self {
            near_origin: (origin + moved).to_array(),
            far_origin: (origin - moved).to_array(),
            inverse,
            near_row: [row(0), row(1), row(2)],
            axes,
            origin: [origin_of[axes[0]], origin_of[axes[1]], origin_of[z]],
            shear: [exact[0] as f32, exact[1] as f32],
            exact,
            dir,
            tmin: (f64::from(ray.tmin) * unit - advance) as f32,
            tmax: (f64::from(ray.tmax) * unit - advance) as f32,
            advance,
            unit,
        })
    }

    /// Converts a distance to the units of the ray.
    #[inline]
    pub(crate) fn distance(&self, t: f32) -> f32 {
        if self.unit == 1.0 && self.advance == 0.0 {
            return t;
        }
        ((f64::from(t) + self.advance) / self.unit) as f32
    }

    /// Converts a distance to the units of the tree.
    pub(crate) fn within(&self, t: f32) -> f32 {
        (f64::from(t) * self.unit - self.advance) as f32
    }

    /// Returns the distances at which the line of the ray enters and leaves a box. The operations are those for
    /// nodes, one by one.
    pub(crate) fn through(&self, bounds: &Box3) -> (f32, f32) {
        let (mut near, mut far) = (f32::NEG_INFINITY, f32::INFINITY);
        for a in 0..3 {
            let (first, second) = if self.near_row[a] & 1 == 0 {
                (bounds.lo[a], bounds.hi[a])
            } else {
                (bounds.hi[a], bounds.lo[a])
            };
            let n = (first - self.near_origin[a]) * self.inverse[a];
            let f = (second - self.far_origin[a]) * self.inverse[a];
            near = if n > near { n } else { near };
            far = if f < far { f } else { far };
        }
        (near, far)
    }

    /// Tests a triangle again that [`Wide::candidates`] returned. `bounds` is its own box.
    #[inline(always)]
    pub(crate) fn meet(
        &self,
        vertices: &[[f32; 3]; 3],
        bounds: impl FnOnce() -> Box3,
        tmax: f32,
    ) -> Option<Met> {
        let [kx, ky, kz] = self.axes;
        let [ox, oy, oz] = self.origin;
        let mut flat = [[0.0; 2]; 3];
        let mut solid = [[0.0; 2]; 3];
        let mut depth = [0.0; 3];
        for k in 0..3 {
            let (vx, vy, vz) = (vertices[k][kx], vertices[k][ky], vertices[k][kz]);
            // The operations are those of `Wide`, one by one.
            let z = vz - oz;
            flat[k][0] = f64::from((vx - ox) - self.shear[0] * z);
            flat[k][1] = f64::from((vy - oy) - self.shear[1] * z);
            let z = f64::from(vz) - f64::from(oz);
            solid[k][0] = (f64::from(vx) - f64::from(ox)) - self.exact[0] * z;
            solid[k][1] = (f64::from(vy) - f64::from(oy)) - self.exact[1] * z;
            depth[k] = z * self.exact[2];
        }
        let weights = edges(&flat)?;
        // Near edges the double precision test may find the point outside. It is then on the edge.
        let weights = edges(&solid).unwrap_or(weights);
        let scale = 1.0 / (weights[0] + weights[1] + weights[2]);
        let t = ((weights[0] * depth[0] + weights[1] * depth[1] + weights[2] * depth[2]) * scale) as f32;
        let (near, far) = self.through(&bounds());
        let t = if near > t { near } else { t };
        // The comparison fails for NaN too.
        let hit = (near <= far) & (self.tmin <= far) & (t >= self.tmin) & (t <= tmax);
        hit.then(|| Met { t, b1: (weights[1] * scale) as f32, b2: (weights[2] * scale) as f32 })
    }
}

/// The axes that follow each axis, listed twice.
const NEXT: [usize; 4] = [1, 2, 0, 1];

/// The range of direction lengths that are not rescaled. Within it distances neither overflow nor vanish.
pub(crate) const MODERATE: std::ops::Range<f32> = 1e-6..1e6;

/// Returns the largest absolute coordinate.
#[inline(always)]
fn largest(v: Vec3) -> f32 {
    v.abs().max_element()
}

/// Returns the origin and direction in the coordinates of the tree, the ray's unit of distance there, and the
/// distance by which the origin was moved. `None` for a ray that passes by.
#[cold]
fn moderate(ray: &Ray, scale: Scale, bounds: &Box3) -> Option<(Vec3, Vec3, f64, f64)> {
    // Scaling by powers of two does not round.
    let mut dir = ray.dir;
    let mut unit = f64::from(scale.factor);
    if largest(dir) < f32::MIN_POSITIVE {
        dir *= power_of_two(30);
        unit *= f64::from(power_of_two(-30));
    }
    let e = exponent(largest(dir));
    dir *= power_of_two(-e);
    unit *= f64::from(power_of_two(e));
    let origin = ray.origin * scale.factor;
    if largest(origin) <= FAR {
        return Some((origin, dir, unit, 0.0));
    }
    let advance = approach(ray.origin, scale, dir, bounds)?;
    let at =
        |a: usize| (f64::from(ray.origin[a]) * f64::from(scale.factor) + advance * f64::from(dir[a])) as f32;
    Some((Vec3::new(at(0), at(1), at(2)), dir, unit, advance))
}

/// Returns the edge functions of a triangle around the origin. `None` when the origin is outside or the triangle has
/// no area.
#[inline(always)]
fn edges([a, b, c]: &[[f64; 2]; 3]) -> Option<[f64; 3]> {
    let u = c[0] * b[1] - c[1] * b[0];
    let v = a[0] * c[1] - a[1] * c[0];
    let w = b[0] * a[1] - b[1] * a[0];
    let low = (u < 0.0) | (v < 0.0) | (w < 0.0);
    let high = (u > 0.0) | (v > 0.0) | (w > 0.0);
    (low != high).then_some([u, v, w])
}

/// Returns the distance that a ray from far away can be advanced without passing anything; `None` when it passes by.
fn approach(origin: Vec3, scale: Scale, dir: Vec3, bounds: &Box3) -> Option<f64> {
    let (mut near, mut far) = (f64::NEG_INFINITY, f64::INFINITY);
    for a in 0..3 {
        let o = f64::from(origin[a]) * f64::from(scale.factor);
        let d = f64::from(dir[a]);
        // The size of the scene is at most 1. Twice that size covers all rounding.
        let (lo, hi) = (f64::from(bounds.lo[a]) - 1.0 - o, f64::from(bounds.hi[a]) + 1.0 - o);
        if d == 0.0 {
            if lo > 0.0 || hi < 0.0 {
                return None;
            }
            continue;
        }
        let (first, second) = (lo / d, hi / d);
        near = near.max(first.min(second));
        far = far.min(first.max(second));
    }
    (near <= far).then_some(near)
}

/// A probe with each value in all lanes of a vector.
#[derive(Clone, Copy)]
pub(crate) struct Wide<S: Simd> {
    near_origin: [S::F8; 3],
    far_origin: [S::F8; 3],
    inverse: [S::F8; 3],
    tmin: S::F8,
    near_row: [usize; 3],
    axes: [usize; 3],
    origin: [S::F4; 3],
    shear: [S::F4; 2],
    zscale: S::F4,
    tmin4: S::F4,
}

impl<S: Simd> Wide<S> {
    #[inline(always)]
    pub(crate) fn new(s: S, probe: &Probe) -> Self {
        Self {
            near_origin: probe.near_origin.map(|x| s.splat8(x)),
            far_origin: probe.far_origin.map(|x| s.splat8(x)),
            inverse: probe.inverse.map(|x| s.splat8(x)),
            tmin: s.splat8(probe.tmin),
            near_row: probe.near_row,
            axes: probe.axes,
            origin: probe.origin.map(|x| s.splat4(x)),
            shear: probe.shear.map(|x| s.splat4(x)),
            zscale: s.splat4(probe.exact[2] as f32),
            tmin4: s.splat4(probe.tmin),
        }
    }

    /// Returns the children of a node that the ray hits up to `tmax`, as bits, and the distances at which it enters
    /// them.
    #[inline(always)]
    pub(crate) fn enter(&self, s: S, plane: &impl Fn(usize) -> S::F8, tmax: f32) -> (u32, [f32; WIDE]) {
        let (mut near, mut far) = (self.tmin, s.splat8(tmax));
        for a in 0..3 {
            let row = self.near_row[a];
            let n = s.mul8(s.sub8(plane(row), self.near_origin[a]), self.inverse[a]);
            let f = s.mul8(s.sub8(plane(row ^ 1), self.far_origin[a]), self.inverse[a]);
            near = s.max8(n, near);
            far = s.min8(f, far);
        }
        (s.le8(near, far), s.store8(near))
    }

    /// Returns the triangles of a block that may be hit up to `tmax`, as bits. They include all that are hit and few
    /// others.
    #[inline(always)]
    pub(crate) fn candidates(&self, s: S, block: &Block, tmax: f32) -> u32 {
        let [kx, ky, kz] = self.axes;
        let mut x = [self.origin[0]; 3];
        let mut y = x;
        let mut z = x;
        for v in 0..3 {
            let vertex = &block.v[v];
            z[v] = s.sub4(s.load4(&vertex[kz]), self.origin[2]);
            x[v] = s.sub4(s.sub4(s.load4(&vertex[kx]), self.origin[0]), s.mul4(self.shear[0], z[v]));
            y[v] = s.sub4(s.sub4(s.load4(&vertex[ky]), self.origin[1]), s.mul4(self.shear[1], z[v]));
        }
        let u = s.sub4(s.mul4(x[2], y[1]), s.mul4(y[2], x[1]));
        let v = s.sub4(s.mul4(x[0], y[2]), s.mul4(y[0], x[2]));
        let w = s.sub4(s.mul4(x[1], y[0]), s.mul4(y[1], x[0]));
        let zero = s.splat4(0.0);
        let lowest = s.min4(s.min4(u, v), w);
        let highest = s.max4(s.max4(u, v), w);
        let inside = s.le4(zero, lowest) | s.le4(highest, zero);
        if inside == 0 {
            return 0;
        }
        // The hit lies between the nearest and the farthest vertex.
        let t = z.map(|z| s.mul4(z, self.zscale));
        let first = s.min4(s.min4(t[0], t[1]), t[2]);
        let last = s.max4(s.max4(t[0], t[1]), t[2]);
        let room = s.mul4(s.max4(last, s.sub4(zero, first)), s.splat4(5e-7));
        let near = s.le4(s.sub4(first, room), s.splat4(tmax));
        let far = s.le4(self.tmin4, s.sub4(last, s.sub4(zero, room)));
        inside & near & far
    }
}

/// Returns the planes of a node that does not move.
#[inline(always)]
pub(crate) fn still_plane<'a, S: Simd + 'a>(s: S, node: &'a Node) -> impl Fn(usize) -> S::F8 + 'a {
    move |row| s.bits8(node.row(row))
}

const _: () = assert!(NARROW == 4);
