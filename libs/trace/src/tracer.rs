//! The tracer and its builder.

use crate::layout::Box3;
use crate::moving::MovingTree;
use crate::order::{self, Sorter};
use crate::probe::Scale;
use crate::scene::Scene;
use crate::single::RayScratch;
use crate::still::{StillTree, Triangles, corners_elsewhere};
use crate::trace::{Batch, Task};
use crate::{Hit, MeshId, Ray, TriangleMesh};
use granita_base::Bound;

/// The largest number of triangles of all meshes of a tracer.
const MAX_TRIANGLES: usize = 1 << 30;

/// Collects meshes for a tracer.
#[derive(Default)]
pub struct TracerBuilder<'a> {
    meshes: Vec<TriangleMesh>,
    /// For each mesh: the source of its triangles when they are not stored in it.
    elsewhere: Vec<Option<&'a dyn Triangles>>,
    triangles: usize,
    within: Option<Bound>,
}

impl<'a> TracerBuilder<'a> {
    /// Returns a builder without meshes.
    pub fn new() -> Self {
        Self::default()
    }

    /// Returns a builder without meshes for one of several tracers within `bound`. The hits do not depend on which of
    /// the tracers contains a triangle, and no ray passes between triangles that share an edge and are in different
    /// tracers.
    pub fn within(bound: Bound) -> Self {
        Self { within: Some(bound), ..Self::default() }
    }

    /// Adds triangles that do not move; see [`TracerBuilder::add`]. Triangles with vertices that are not finite are
    /// never hit.
    ///
    /// # Panics
    ///
    /// Panics with more than 2^30 triangles in all.
    pub fn add_triangles(&mut self, triangles: &'a dyn Triangles) -> MeshId {
        let id = self.add(TriangleMesh::default());
        self.count(triangles.count());
        self.elsewhere[id.0 as usize] = Some(triangles);
        id
    }

    fn count(&mut self, more: usize) {
        self.triangles += more;
        assert!(self.triangles <= MAX_TRIANGLES && self.meshes.len() < MAX_TRIANGLES, "too many triangles");
    }

    /// Adds a mesh. Triangles with vertex indices out of range, or with vertices that are not finite, are never hit.
    /// A mesh without times, with fewer lists of positions than times, or with times that do not increase is never
    /// hit either.
    ///
    /// # Panics
    ///
    /// Panics with more than 2^30 triangles in all.
    pub fn add(&mut self, mesh: TriangleMesh) -> MeshId {
        self.count(mesh.triangles.len());
        self.meshes.push(mesh);
        self.elsewhere.push(None);
        MeshId(self.meshes.len() as u32 - 1)
    }

    /// Builds the acceleration structure, on the calling thread and up to `threads - 1` more. The structure does not
    /// depend on the number of threads. Meshes that do not move are dropped.
    pub fn build(mut self, threads: usize) -> Tracer {
        let mut bound = Bound::EMPTY;
        let mut first = Vec::with_capacity(self.meshes.len());
        let mut count = 0;
        for (mesh, elsewhere) in self.meshes.iter_mut().zip(&self.elsewhere) {
            first.push(count);
            if let Some(triangles) = elsewhere {
                count += triangles.count() as u32;
                let all = (0..triangles.count()).filter_map(|t| corners_elsewhere(*triangles, t));
                bound = all.flatten().fold(bound, |b, p| b.with(p));
                continue;
            }
            count += mesh.triangles.len() as u32;
            if !mesh.is_usable() {
                *mesh = TriangleMesh::default();
            }
            for t in 0..mesh.triangles.len() {
                if let Some(b) = mesh.triangle_bound(t) {
                    bound = bound.union(b);
                }
            }
        }
        let all = self.within.map_or(bound, |b| b.union(bound));
        let (scale, bounds) = (Scale::of(&all), all);
        let still = StillTree::new(&self.meshes, &self.elsewhere, &first, scale, threads);
        // Only moving meshes are read again.
        for mesh in self.meshes.iter_mut().filter(|m| m.times.len() < 2) {
            *mesh = TriangleMesh::default();
        }
        let moving = MovingTree::new(self.meshes, &first, scale, threads);
        let bounds = scale.bounds(&bounds);
        let sorter = Sorter::new(&Box3 { lo: bound.min.to_array(), hi: bound.max.to_array() });
        Tracer { bound, sorter, scene: Scene { still, moving, first, scale, bounds } }
    }
}

/// Finds the hits of rays. A tracer is shared between threads.
#[derive(Debug)]
pub struct Tracer {
    bound: Bound,
    sorter: Sorter,
    pub(crate) scene: Scene,
}

impl Tracer {
    /// Returns the box around everything that can be hit, over all times; empty when there is nothing.
    pub fn bound(&self) -> Bound {
        self.bound
    }

    /// The number of bytes of memory that the structure occupies.
    pub fn bytes(&self) -> usize {
        self.scene.still.bytes() + self.scene.moving.bytes() + self.scene.first.capacity() * size_of::<u32>()
    }

    /// Finds the closest hit of each ray; [`Hit::MISS`] for none.
    ///
    /// # Panics
    ///
    /// Panics when `hits` is not as long as `rays`.
    pub fn closest(&self, rays: &[Ray], hits: &mut [Hit]) {
        assert_eq!(rays.len(), hits.len(), "as many hits as rays");
        for (rays, hits) in rays.chunks(order::MANY).zip(hits.chunks_mut(order::MANY)) {
            let order = self.sorter.order(rays);
            let batch = Batch { scene: &self.scene, rays, order: order.as_deref() };
            batch.trace(Task::Closest(hits), &mut RayScratch::default());
        }
    }

    /// Determines whether each ray hits anything.
    ///
    /// # Panics
    ///
    /// Panics when `blocked` is not as long as `rays`.
    pub fn any(&self, rays: &[Ray], blocked: &mut [bool]) {
        assert_eq!(rays.len(), blocked.len(), "as many answers as rays");
        for (rays, blocked) in rays.chunks(order::MANY).zip(blocked.chunks_mut(order::MANY)) {
            let order = self.sorter.order(rays);
            let batch = Batch { scene: &self.scene, rays, order: order.as_deref() };
            batch.trace(Task::Any(blocked), &mut RayScratch::default());
        }
    }

    /// Returns the closest hit of one ray, the same as [`Tracer::closest`] finds.
    pub fn closest_of_one(&self, ray: &Ray, room: &mut RayScratch) -> Hit {
        let mut hit = [Hit::MISS];
        self.only(ray).trace(Task::Closest(&mut hit), room);
        hit[0]
    }

    /// Returns whether one ray hits anything, the same as [`Tracer::any`] finds.
    pub fn any_of_one(&self, ray: &Ray, room: &mut RayScratch) -> bool {
        let mut blocked = [false];
        self.only(ray).trace(Task::Any(&mut blocked), room);
        blocked[0]
    }

    fn only<'a>(&'a self, ray: &'a Ray) -> Batch<'a> {
        Batch { scene: &self.scene, rays: std::slice::from_ref(ray), order: None }
    }

    /// Returns the closest hit that `accept` accepts.
    ///
    /// `accept` is called for some of the hits, in no particular order, and at most once for each. Its result must
    /// depend on the hit alone.
    pub fn closest_where(&self, ray: &Ray, accept: &mut dyn FnMut(&Hit) -> bool) -> Hit {
        let mut hit = Hit::MISS;
        self.only(ray).trace(Task::Where(&mut hit, accept), &mut RayScratch::default());
        hit
    }
}
