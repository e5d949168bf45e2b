//! Meshes that can be traced.

use granita_base::{Bound, Vec3};

/// The index of a mesh in a tracer, in the order of [`crate::TracerBuilder::add`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct MeshId(pub u32);

/// Triangles that may move.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleMesh {
    /// The times of the motion keys, increasing; one for a mesh that does not move. Between keys the vertices move
    /// linearly. Before the first and after the last key the mesh does not exist.
    pub times: Vec<f32>,
    /// The vertices for each time.
    pub positions: Vec<Vec<Vec3>>,
    /// The three vertex indices of each triangle.
    pub triangles: Vec<[u32; 3]>,
}

impl TriangleMesh {
    /// True when the numbers of times and positions agree.
    pub(crate) fn is_usable(&self) -> bool {
        let n = self.times.len();
        n > 0
            && self.positions.len() >= n
            && self.times.iter().all(|t| t.is_finite())
            && self.times.windows(2).all(|w| w[0] < w[1])
    }

    /// Returns the box around a triangle at all times; `None` if the triangle cannot be hit.
    pub(crate) fn triangle_bound(&self, triangle: usize) -> Option<Bound> {
        let mut bound = Bound::EMPTY;
        for positions in &self.positions[..self.times.len()] {
            for &v in &self.triangles[triangle] {
                let p = *positions.get(v as usize)?;
                if !p.is_finite() {
                    return None;
                }
                bound = bound.with(p);
            }
        }
        if self.times.len() > 1 {
            // The padding covers the rounding of the interpolation between keys.
            let room = bound.min.abs().max(bound.max.abs()) * 2.4e-7;
            bound = Bound { min: bound.min - room, max: bound.max + room };
        }
        bound.is_finite().then_some(bound)
    }

    /// True when the mesh exists at a time.
    pub(crate) fn exists_at(&self, time: f32) -> bool {
        match self.times[..] {
            [first, .., last] => (first..=last).contains(&time),
            _ => true,
        }
    }

    /// Returns the vertices of a triangle at a time, or at the nearest time at which it exists. The triangle and its
    /// vertices must be valid.
    pub(crate) fn triangle_at(&self, triangle: usize, time: f32) -> [Vec3; 3] {
        let next = self.times.partition_point(|t| *t <= time);
        let corners = self.triangles[triangle].map(|v| v as usize);
        if next == 0 {
            return corners.map(|v| self.positions[0][v]);
        }
        if next == self.times.len() {
            return corners.map(|v| self.positions[next - 1][v]);
        }
        let (t0, t1) = (self.times[next - 1], self.times[next]);
        let alpha = (time - t0) / (t1 - t0);
        corners.map(|v| self.positions[next - 1][v] * (1.0 - alpha) + self.positions[next][v] * alpha)
    }
}
