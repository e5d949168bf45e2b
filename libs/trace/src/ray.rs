//! Rays and hits.

use granita_base::Vec3;

/// A ray: the points `origin + t * dir` with `tmin <= t <= tmax`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Ray {
    /// Where it starts.
    pub origin: Vec3,
    /// Smallest distance that counts, in units of `dir`.
    pub tmin: f32,
    /// Direction, of any length but zero.
    pub dir: Vec3,
    /// Largest distance that counts; may be infinite.
    pub tmax: f32,
    /// Time, for moving geometry.
    pub time: f32,
}

/// Where a ray met a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Hit {
    /// Distance in units of the ray's direction; infinite for a miss.
    pub t: f32,
    /// Index of the mesh; `u32::MAX` for a miss.
    pub mesh: u32,
    /// Index of the triangle in its mesh.
    pub triangle: u32,
    /// Weight of the triangle's second vertex.
    pub b1: f32,
    /// Weight of the triangle's third vertex; that of the first is `1 - b1 - b2`.
    pub b2: f32,
}

impl Hit {
    /// No hit.
    pub const MISS: Self = Self { t: f32::INFINITY, mesh: u32::MAX, triangle: u32::MAX, b1: 0.0, b2: 0.0 };

    /// Whether something was hit.
    pub fn is_hit(&self) -> bool {
        self.mesh != u32::MAX
    }
}
