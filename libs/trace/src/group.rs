//! The values of eight rays, prepared and tested at once.
//!
//! The operations for each ray are those of [`Probe`] and [`crate::probe::Wide`], one by one.

use crate::Ray;
use crate::layout::Box3;
use crate::probe::{FAR, MODERATE, Met, Probe, ROOM, Scale};
use granita_machine::simd::{Simd, WIDE};

/// One value of eight rays.
pub(crate) type Lane = [f32; WIDE];

/// Eight rays, value by value. The values are those of [`Probe`], but axes are in the order x, y, z.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(crate) struct Group {
    pub(crate) near_origin: [Lane; 3],
    pub(crate) far_origin: [Lane; 3],
    pub(crate) inverse: [Lane; 3],
    origin: [Lane; 3],
    dir: [Lane; 3],
    pub(crate) tmin: Lane,
    /// The distance of the best hit so far; negative infinity when the search has ended.
    pub(crate) tmax: Lane,
    /// The number of the triangle of the best hit so far; `u32::MAX` for none.
    pub(crate) id: [u32; WIDE],
    /// The weights of the second and third vertex there.
    b: [Lane; 2],
    /// The numbers of [`Probe::class`].
    pub(crate) class: [u32; WIDE],
    /// This and the next two values are set by [`Group::shear`].
    shear: [Lane; 2],
    zscale: Lane,
    exact: [[f64; WIDE]; 3],
    advance: [f64; WIDE],
    unit: [f64; WIDE],
}

impl Group {
    /// A group without rays.
    pub(crate) const EMPTY: Self = Self {
        near_origin: [[0.0; WIDE]; 3],
        far_origin: [[0.0; WIDE]; 3],
        inverse: [[0.0; WIDE]; 3],
        origin: [[0.0; WIDE]; 3],
        dir: [[1.0; WIDE]; 3],
        tmin: [0.0; WIDE],
        tmax: [0.0; WIDE],
        id: [u32::MAX; WIDE],
        b: [[0.0; WIDE]; 2],
        class: [0; WIDE],
        shear: [[0.0; WIDE]; 2],
        zscale: [0.0; WIDE],
        exact: [[0.0; WIDE]; 3],
        advance: [0.0; WIDE],
        unit: [1.0; WIDE],
    };

    /// Prepares one to eight rays. Returns those that may hit something, as bits.
    #[inline(always)]
    pub(crate) fn load(&mut self, rays: &[Ray], scale: Scale, bounds: &Box3) -> u32 {
        let mut ranges = [[0.0; WIDE], [-1.0; WIDE], [0.0; WIDE]];
        for (k, ray) in rays.iter().enumerate().take(WIDE) {
            [self.origin[0][k], self.origin[1][k], self.origin[2][k]] = ray.origin.to_array();
            [self.dir[0][k], self.dir[1][k], self.dir[2][k]] = ray.dir.to_array();
            [ranges[0][k], ranges[1][k], ranges[2][k]] = [ray.tmin, ray.tmax, ray.time];
        }
        let usual = self.prepare(&ranges, scale.factor(), bounds);
        let mut there = usual;
        if usual.count_ones() as usize != rays.len() {
            for (k, ray) in rays.iter().enumerate().filter(|(k, _)| usual >> k & 1 == 0) {
                if let Some(probe) = Probe::new(ray, scale, bounds) {
                    self.set(k, &probe);
                    there |= 1 << k;
                }
            }
        }
        there
    }

    /// Prepares the values that depend on the origins and directions. Returns the rays for which they are valid, as
    /// bits. The others are unusual, or hit nothing.
    #[inline(always)]
    fn prepare(&mut self, [tmin, tmax, time]: &[Lane; 3], factor: f32, bounds: &Box3) -> u32 {
        let (mut far, mut reach, mut zero) = ([0.0; WIDE], [0.0; WIDE], [0.0; WIDE]);
        for a in 0..3 {
            for k in 0..WIDE {
                let x = self.origin[a][k] * factor;
                self.origin[a][k] = x;
                far[k] = greater(x.abs(), far[k]);
                reach[k] = greater((bounds.lo[a] - x).abs(), reach[k]);
                reach[k] = greater((bounds.hi[a] - x).abs(), reach[k]);
                // The sum stays 0 unless a value is infinite or NaN.
                zero[k] += x * 0.0 + self.dir[a][k] * 0.0;
            }
        }
        let mut room = [0.0; WIDE];
        for k in 0..WIDE {
            room[k] = reach[k] * ROOM + far[k] * f32::EPSILON;
        }
        for a in 0..3 {
            for (k, room) in room.iter().enumerate() {
                let inverse = 1.0 / self.dir[a][k];
                let moved = room.copysign(inverse);
                self.inverse[a][k] = inverse;
                self.near_origin[a][k] = self.origin[a][k] + moved;
                self.far_origin[a][k] = self.origin[a][k] - moved;
            }
        }
        let mut usual = [0; WIDE];
        for k in 0..WIDE {
            let (x, y, z) = (self.dir[0][k].abs(), self.dir[1][k].abs(), self.dir[2][k].abs());
            let most = greater(x, y);
            let is_z = u32::from(z > most);
            let axis = is_z * 2 + (1 - is_z) * u32::from(y > x);
            let sign = |a: usize| self.inverse[a][k].to_bits() >> 31;
            self.class[k] = axis << 3 | sign(2) << 2 | sign(1) << 1 | sign(0);
            let size = greater(z, most);
            let sound = (zero[k] + time[k] * 0.0 == 0.0) & (tmin[k] <= tmax[k]) & (far[k] <= FAR);
            usual[k] = u32::from(sound & MODERATE.contains(&size));
        }
        for k in 0..WIDE {
            // The factor is a power of two, so that the product is that of double precision.
            self.tmin[k] = tmin[k] * factor;
            self.tmax[k] = tmax[k] * factor;
        }
        self.id = [u32::MAX; WIDE];
        self.advance = [0.0; WIDE];
        self.unit = [f64::from(factor); WIDE];
        let mut mask = 0;
        for (k, usual) in usual.iter().enumerate() {
            mask |= usual << k;
        }
        mask
    }

    /// Sets the values of an unusual ray.
    #[cold]
    fn set(&mut self, lane: usize, probe: &Probe) {
        for (a, axis) in probe.axes.into_iter().enumerate() {
            self.near_origin[a][lane] = probe.near_origin[a];
            self.far_origin[a][lane] = probe.far_origin[a];
            self.inverse[a][lane] = probe.inverse[a];
            self.origin[axis][lane] = probe.origin[a];
            self.dir[a][lane] = probe.dir[a];
        }
        self.tmin[lane] = probe.tmin;
        self.tmax[lane] = probe.tmax;
        self.advance[lane] = probe.advance;
        self.unit[lane] = probe.unit;
        self.class[lane] = probe.class();
    }

    /// Computes the shear of all rays for a class.
    #[inline(always)]
    pub(crate) fn shear(&mut self, class: Class) {
        let [kx, ky, kz] = class.axes;
        for k in 0..WIDE {
            let depth = 1.0 / f64::from(self.dir[kz][k]);
            let (x, y) = (f64::from(self.dir[kx][k]) * depth, f64::from(self.dir[ky][k]) * depth);
            (self.exact[0][k], self.exact[1][k], self.exact[2][k]) = (x, y, depth);
            (self.shear[0][k], self.shear[1][k], self.zscale[k]) = (x as f32, y as f32, depth as f32);
        }
    }

    /// Returns the probe of a ray of a class.
    #[inline(always)]
    pub(crate) fn probe(&self, k: usize, class: Class) -> Probe {
        let k = k & (WIDE - 1);
        let three = |x: &[Lane; 3]| [x[0][k], x[1][k], x[2][k]];
        let [kx, ky, kz] = class.axes;
        Probe {
            near_origin: three(&self.near_origin),
            far_origin: three(&self.far_origin),
            inverse: three(&self.inverse),
            near_row: class.near_row,
            axes: class.axes,
            origin: [self.origin[kx][k], self.origin[ky][k], self.origin[kz][k]],
            shear: [self.shear[0][k], self.shear[1][k]],
            exact: [self.exact[0][k], self.exact[1][k], self.exact[2][k]],
            dir: three(&self.dir),
            tmin: self.tmin[k],
            tmax: self.tmax[k],
            advance: self.advance[k],
            unit: self.unit[k],
        }
    }

    /// Returns the hit of a ray so far.
    #[inline(always)]
    pub(crate) fn met(&self, k: usize) -> Met {
        let k = k & (WIDE - 1);
        Met { t: self.tmax[k], b1: self.b[0][k], b2: self.b[1][k] }
    }

    /// Replaces the hit of a ray. With `ends` the search of the ray ends.
    #[inline(always)]
    pub(crate) fn take(&mut self, k: usize, met: &Met, id: u32, ends: bool) {
        let k = k & (WIDE - 1);
        (self.b[0][k], self.b[1][k], self.id[k]) = (met.b1, met.b2, id);
        self.tmax[k] = if ends { f32::NEG_INFINITY } else { met.t };
    }

    /// Returns the rays that enter a box, as bits. `planes` are the near and the far plane of each axis.
    #[inline(always)]
    pub(crate) fn enter<S: Simd>(&self, s: S, planes: &[[S::F8; 2]; 3]) -> u32 {
        let (mut near, mut far) = (s.load8(&self.tmin), s.load8(&self.tmax));
        for (a, [first, second]) in planes.iter().enumerate() {
            let inverse = s.load8(&self.inverse[a]);
            let n = s.mul8(s.sub8(*first, s.load8(&self.near_origin[a])), inverse);
            let f = s.mul8(s.sub8(*second, s.load8(&self.far_origin[a])), inverse);
            near = s.max8(n, near);
            far = s.min8(f, far);
        }
        s.le8(near, far)
    }

    /// Returns the rays that may hit a triangle, as bits. They include all that hit it and few others.
    #[inline(always)]
    pub(crate) fn candidates<S: Simd>(&self, s: S, vertices: &[[f32; 3]; 3], class: Class) -> u32 {
        let [kx, ky, kz] = class.axes;
        let (ox, oy, oz) = (s.load8(&self.origin[kx]), s.load8(&self.origin[ky]), s.load8(&self.origin[kz]));
        let (sx, sy) = (s.load8(&self.shear[0]), s.load8(&self.shear[1]));
        let mut x = [ox; 3];
        let mut y = x;
        let mut z = x;
        for (v, vertex) in vertices.iter().enumerate() {
            z[v] = s.sub8(s.splat8(vertex[kz]), oz);
            x[v] = s.sub8(s.sub8(s.splat8(vertex[kx]), ox), s.mul8(sx, z[v]));
            y[v] = s.sub8(s.sub8(s.splat8(vertex[ky]), oy), s.mul8(sy, z[v]));
        }
        let u = s.sub8(s.mul8(x[2], y[1]), s.mul8(y[2], x[1]));
        let v = s.sub8(s.mul8(x[0], y[2]), s.mul8(y[0], x[2]));
        let w = s.sub8(s.mul8(x[1], y[0]), s.mul8(y[1], x[0]));
        let zero = s.splat8(0.0);
        let lowest = s.min8(s.min8(u, v), w);
        let highest = s.max8(s.max8(u, v), w);
        let inside = s.le8(zero, lowest) | s.le8(highest, zero);
        if inside == 0 {
            return 0;
        }
        let scale = s.load8(&self.zscale);
        let t = [s.mul8(z[0], scale), s.mul8(z[1], scale), s.mul8(z[2], scale)];
        let first = s.min8(s.min8(t[0], t[1]), t[2]);
        let last = s.max8(s.max8(t[0], t[1]), t[2]);
        let room = s.mul8(s.max8(last, s.sub8(zero, first)), s.splat8(5e-7));
        let near = s.le8(s.sub8(first, room), s.load8(&self.tmax));
        let far = s.le8(s.load8(&self.tmin), s.sub8(last, s.sub8(zero, room)));
        inside & near & far
    }
}

#[inline(always)]
fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The signs and the longest axis of a direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Class {
    /// See [`Probe`].
    pub(crate) near_row: [usize; 3],
    /// See [`Probe`].
    pub(crate) axes: [usize; 3],
}

impl Class {
    /// Returns the class of a number.
    #[inline(always)]
    pub(crate) fn new(class: u32) -> Self {
        let class = class as usize;
        let z = (class >> 3).min(2);
        Self {
            near_row: [class & 1, 2 + (class >> 1 & 1), 4 + (class >> 2 & 1)],
            axes: [[1, 2, 0], [2, 0, 1], [0, 1, 2]][z],
        }
    }
}
