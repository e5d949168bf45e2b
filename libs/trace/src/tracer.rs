//! Building and tracing.

use crate::layout::Box3;
use crate::moving::MovingTree;
use crate::order::{self, Sorter};
use crate::probe::Scale;
use crate::scene::Scene;
use crate::still::{StillTree, Triangles, corners_elsewhere};
use crate::trace::{Batch, RayRoom, Task};
use crate::{Hit, MeshId, Ray, TriangleMesh};
use granita_base::Bound;

/// Triangles of all meshes of a tracer at most.
const MAX_TRIANGLES: usize = 1 << 30;

/// Collects meshes.
#[derive(Default)]
pub struct TracerBuilder<'a> {
    meshes: Vec<TriangleMesh>,
    /// By mesh: where its triangles are when they are not in it.
    elsewhere: Vec<Option<&'a dyn Triangles>>,
    triangles: usize,
    within: Option<Bound>,
}

impl<'a> TracerBuilder<'a> {
    /// No meshes.
    pub fn new() -> Self {
        Self::default()
    }

    /// No meshes, of a tracer that is one of several within `bound`: what is hit, and where, does not depend on which of
    /// them a triangle is in, and no ray passes between triangles that share an edge and are in different ones.
    pub fn within(bound: Bound) -> Self {
        Self { within: Some(bound), ..Self::default() }
    }

    /// Adds triangles that stand still; as [`TracerBuilder::add`]. Vertices that are not finite are never hit.
    ///
    /// # Panics
    ///
    /// With more than 2^30 triangles in all.
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

    /// Adds a mesh. Triangles with vertex indices out of range, or with vertices that are not finite, are never hit;
    /// nor is a mesh without times, with fewer lists of positions than times, or with times that do not increase.
    ///
    /// # Panics
    ///
    /// With more than 2^30 triangles in all.
    pub fn add(&mut self, mesh: TriangleMesh) -> MeshId {
        self.count(mesh.triangles.len());
        self.meshes.push(mesh);
        self.elsewhere.push(None);
        MeshId(self.meshes.len() as u32 - 1)
    }

    /// Builds the acceleration structure, on the calling thread and up to `threads - 1` more. The structure does
    /// not depend on their number. Meshes that stand still are not kept.
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
        // Only what moves is looked up again.
        for mesh in self.meshes.iter_mut().filter(|m| m.times.len() < 2) {
            *mesh = TriangleMesh::default();
        }
        let moving = MovingTree::new(self.meshes, &first, scale, threads);
        let bounds = scale.bounds(&bounds);
        let sorter = Sorter::new(&Box3 { lo: bound.min.to_array(), hi: bound.max.to_array() });
        Tracer { bound, sorter, scene: Scene { still, moving, first, scale, bounds } }
    }
}

/// Answers rays. Shared between threads.
#[derive(Debug)]
pub struct Tracer {
    bound: Bound,
    sorter: Sorter,
    pub(crate) scene: Scene,
}

impl Tracer {
    /// Box around everything that can be hit, over all times; empty without anything.
    pub fn bound(&self) -> Bound {
        self.bound
    }

    /// Bytes of memory that the structure takes.
    pub fn bytes(&self) -> usize {
        self.scene.still.bytes() + self.scene.moving.bytes() + self.scene.first.capacity() * size_of::<u32>()
    }

    /// The closest hit of each ray; [`Hit::MISS`] for none.
    ///
    /// # Panics
    ///
    /// When `hits` is not as long as `rays`.
    pub fn closest(&self, rays: &[Ray], hits: &mut [Hit]) {
        assert_eq!(rays.len(), hits.len(), "as many hits as rays");
        for (rays, hits) in rays.chunks(order::MANY).zip(hits.chunks_mut(order::MANY)) {
            let order = self.sorter.order(rays);
            let batch = Batch { scene: &self.scene, rays, order: order.as_deref() };
            batch.trace(Task::Closest(hits), &mut RayRoom::default());
        }
    }

    /// Whether each ray hits anything.
    ///
    /// # Panics
    ///
    /// When `blocked` is not as long as `rays`.
    pub fn any(&self, rays: &[Ray], blocked: &mut [bool]) {
        assert_eq!(rays.len(), blocked.len(), "as many answers as rays");
        for (rays, blocked) in rays.chunks(order::MANY).zip(blocked.chunks_mut(order::MANY)) {
            let order = self.sorter.order(rays);
            let batch = Batch { scene: &self.scene, rays, order: order.as_deref() };
            batch.trace(Task::Any(blocked), &mut RayRoom::default());
        }
    }

    /// The closest hit of one ray, as [`Tracer::closest`] finds it.
    pub fn closest_of_one(&self, ray: &Ray, room: &mut RayRoom) -> Hit {
        let mut hit = [Hit::MISS];
        self.only(ray).trace(Task::Closest(&mut hit), room);
        hit[0]
    }

    /// Whether one ray hits anything, as [`Tracer::any`] finds it.
    pub fn any_of_one(&self, ray: &Ray, room: &mut RayRoom) -> bool {
        let mut blocked = [false];
        self.only(ray).trace(Task::Any(&mut blocked), room);
        blocked[0]
    }

    fn only<'a>(&'a self, ray: &'a Ray) -> Batch<'a> {
        Batch { scene: &self.scene, rays: std::slice::from_ref(ray), order: None }
    }

    /// The closest hit that `accept` lets pass.
    ///
    /// `accept` is asked about some of the hits, in no particular order, about each at most once; its answer must
    /// depend on the hit alone.
    pub fn closest_where(&self, ray: &Ray, accept: &mut dyn FnMut(&Hit) -> bool) -> Hit {
        let mut hit = Hit::MISS;
        self.only(ray).trace(Task::Where(&mut hit, accept), &mut RayRoom::default());
        hit
    }
}
