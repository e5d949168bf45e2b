//! What can be traced.

use granita_base::Vec3;

/// Which mesh of a tracer: its position in the order of [`crate::TracerBuilder::add`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct MeshId(pub u32);

/// Triangles, perhaps moving.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleMesh {
    /// Times of the motion keys, increasing; one for a mesh that stands still. Between keys vertices move linearly,
    /// before the first and after the last they stand still.
    pub times: Vec<f32>,
    /// Vertices for each time.
    pub positions: Vec<Vec<Vec3>>,
    /// Three vertex indices for each triangle.
    pub triangles: Vec<[u32; 3]>,
}
