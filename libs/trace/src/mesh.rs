//! What can be traced.

use granita_base::{Bound, Vec3};

/// Which mesh of a tracer: its position in the order of [`crate::TracerBuilder::add`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct MeshId(pub u32);

/// Triangles, perhaps moving.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleMesh {
    /// Times of the motion keys, increasing; one for a mesh that stands still. Between keys vertices move linearly;
    /// before the first and after the last the mesh does not exist.
    pub times: Vec<f32>,
    /// Vertices for each time.
    pub positions: Vec<Vec<Vec3>>,
    /// Three vertex indices for each triangle.
    pub triangles: Vec<[u32; 3]>,
}

impl TriangleMesh {
    /// Whether times and positions fit together.
    pub(crate) fn is_usable(&self) -> bool {
        let n = self.times.len();
        n > 0
            && self.positions.len() >= n
            && self.times.iter().all(|t| t.is_finite())
            && self.times.windows(2).all(|w| w[0] < w[1])
    }

    /// Box around a triangle at all times; `None` if it cannot be hit.
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
            // Blending between keys rounds.
            let room = bound.min.abs().max(bound.max.abs()) * 2.4e-7;
            bound = Bound { min: bound.min - room, max: bound.max + room };
        }
        bound.is_finite().then_some(bound)
    }

    /// Whether there is anything at a time.
    pub(crate) fn exists_at(&self, time: f32) -> bool {
        match self.times[..] {
            [first, .., last] => (first..=last).contains(&time),
            _ => true,
        }
    }

    /// The vertices of a triangle at a time, or at the nearest one at which it exists. The triangle exists and its vertices do.
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
