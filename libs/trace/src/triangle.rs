//! A ray against a triangle, watertight.
//!
//! Woop, Benthin, Wald: "Watertight Ray/Triangle Intersection", JCGT 2(1), 2013. Vertices are moved and sheared so
//! that the ray runs along z from the origin; three 2D edge functions then say whether it passes inside. A rounded
//! product never falls on the wrong side of another, so an edge function has the right sign or is 0, and 0 counts
//! as inside on both sides of the edge: nothing passes between triangles. Unlike the paper this works in double
//! precision throughout, which neither overflows nor underflows for any single precision scene.

use crate::Ray;
use granita_base::Vec3;

/// What is the same for all triangles a ray meets.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shear {
    origin: [f64; 3],
    /// The axes in an order in which the last is the ray's longest.
    axes: [usize; 3],
    /// How far x and y move with z, and the scale of z.
    shear: [f64; 3],
}

/// A hit on one triangle: distance and the weights of the second and third vertex.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TriangleHit {
    pub(crate) t: f32,
    pub(crate) b1: f32,
    pub(crate) b2: f32,
}

impl Shear {
    /// `None` for rays that hit nothing: not finite, or without direction.
    pub(crate) fn new(ray: &Ray) -> Option<Self> {
        let finite = ray.origin.is_finite() && ray.dir.is_finite() && ray.dir != Vec3::ZERO;
        // An infinite tmax is fine; NaN compares false.
        if !(finite && ray.tmin <= ray.tmax && ray.time.is_finite()) {
            return None;
        }
        let dir = ray.dir.to_array().map(f64::from);
        let z = (0..3).fold(0, |z, a| if dir[a].abs() > dir[z].abs() { a } else { z });
        let axes = [(z + 1) % 3, (z + 2) % 3, z];
        let shear = [dir[axes[0]] / dir[z], dir[axes[1]] / dir[z], 1.0 / dir[z]];
        Some(Self { origin: ray.origin.to_array().map(f64::from), axes, shear })
    }

    /// Where the ray meets a triangle between `tmin` and `tmax`, from either side.
    #[inline]
    pub(crate) fn hit(&self, vertices: &[Vec3; 3], tmin: f32, tmax: f32) -> Option<TriangleHit> {
        let [kx, ky, kz] = self.axes;
        let [sx, sy, sz] = self.shear;
        let sheared = vertices.map(|v| {
            let x = f64::from(v[kx]) - self.origin[kx];
            let y = f64::from(v[ky]) - self.origin[ky];
            let z = f64::from(v[kz]) - self.origin[kz];
            [x - sx * z, y - sy * z, sz * z]
        });
        let [a, b, c] = sheared;
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let det = u + v + w;
        if det == 0.0 {
            return None;
        }
        let t = ((u * a[2] + v * b[2] + w * c[2]) / det) as f32;
        // NaN fails, too.
        if !(t >= tmin && t <= tmax) {
            return None;
        }
        Some(TriangleHit { t, b1: (v / det) as f32, b2: (w / det) as f32 })
    }
}
