//! Rays and hits.

use granita_base::Vec3;

/// A ray: the points `origin + t * dir` with `tmin <= t <= tmax`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Ray {
    /// The origin.
    pub origin: Vec3,
    /// The smallest distance of a hit, in units of `dir`.
    pub tmin: f32,
    /// The direction, of any length but zero.
    pub dir: Vec3,
    /// The largest distance of a hit, in units of `dir`; may be infinite.
    pub tmax: f32,
    /// The time, for moving geometry.
    pub time: f32,
}

/// The hit of a ray on a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Hit {
    /// The distance in units of the ray's direction; infinite for a miss.
    pub t: f32,
    /// The index of the mesh; `u32::MAX` for a miss.
    pub mesh: u32,
    /// The index of the triangle in its mesh.
    pub triangle: u32,
    /// The weight of the triangle's second vertex.
    pub b1: f32,
    /// The weight of the triangle's third vertex. The weight of the first is `1 - b1 - b2`.
    pub b2: f32,
}

impl Hit {
    /// The value for a ray that hits nothing.
    pub const MISS: Self = Self { t: f32::INFINITY, mesh: u32::MAX, triangle: u32::MAX, b1: 0.0, b2: 0.0 };

    /// True when the ray hit a triangle.
    pub fn is_hit(&self) -> bool {
        self.mesh != u32::MAX
    }
}
