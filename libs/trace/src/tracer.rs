//! Building and tracing.

use crate::build::{self, Item, Topology};
use crate::layout::{Block, Box3, Link, Node};
use crate::moving::MovingTree;
use crate::order::{self, Sorter};
use crate::probe::{Met, Probe, Scale, Wide, still_plane};
use crate::simd::{self, NARROW, Simd, WIDE};
use crate::trace::{Batch, RayRoom, Task, Tree};
use crate::{Hit, MeshId, Ray, TriangleMesh};
use granita_base::{Bound, Vec3};

/// Triangles of all meshes of a tracer at most.
const MAX_TRIANGLES: usize = 1 << 30;

/// Triangles that stand still and lie elsewhere: nothing of them is copied before the tree is built.
pub trait Triangles: Sync {
    /// How many there are.
    fn count(&self) -> usize;

    /// The vertices of one; `None` for one that is never hit.
    fn triangle(&self, triangle: usize) -> Option<[Vec3; 3]>;
}

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

/// What rays go through.
#[derive(Debug)]
pub(crate) struct Scene {
    pub(crate) still: StillTree,
    pub(crate) moving: MovingTree,
    /// Number of the first triangle of each mesh.
    first: Vec<u32>,
    pub(crate) scale: Scale,
    /// Box around everything in the coordinates of the trees.
    pub(crate) bounds: Box3,
}

impl Scene {
    /// What the world is told of a hit.
    pub(crate) fn hit(&self, probe: &Probe, met: &Met, id: u32) -> Hit {
        let mesh = self.first.partition_point(|first| *first <= id) - 1;
        Hit {
            t: probe.distance(met.t),
            mesh: mesh as u32,
            triangle: id - self.first[mesh],
            b1: met.b1,
            b2: met.b2,
        }
    }
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
            simd::run(&batch, Task::Closest(hits), &mut RayRoom::default());
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
            simd::run(&batch, Task::Any(blocked), &mut RayRoom::default());
        }
    }

    /// The closest hit of one ray, as [`Tracer::closest`] finds it.
    pub fn closest_of_one(&self, ray: &Ray, room: &mut RayRoom) -> Hit {
        let mut hit = [Hit::MISS];
        simd::run(&self.only(ray), Task::Closest(&mut hit), room);
        hit[0]
    }

    /// Whether one ray hits anything, as [`Tracer::any`] finds it.
    pub fn any_of_one(&self, ray: &Ray, room: &mut RayRoom) -> bool {
        let mut blocked = [false];
        simd::run(&self.only(ray), Task::Any(&mut blocked), room);
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
        simd::run(&self.only(ray), Task::Where(&mut hit, accept), &mut RayRoom::default());
        hit
    }
}

/// The vertices of a triangle that lies elsewhere, if it can be hit.
fn corners_elsewhere(triangles: &dyn Triangles, t: usize) -> Option<[Vec3; 3]> {
    triangles.triangle(t).filter(|v| v.iter().all(|p| p.is_finite()))
}

/// The tree of all that stands still.
#[derive(Debug, Default)]
pub(crate) struct StillTree {
    nodes: Vec<Node>,
    blocks: Vec<Block>,
}

impl StillTree {
    fn new(
        meshes: &[TriangleMesh],
        elsewhere: &[Option<&dyn Triangles>],
        first: &[u32],
        scale: Scale,
        threads: usize,
    ) -> Self {
        let count = |mesh: usize| match elsewhere[mesh] {
            Some(triangles) => triangles.count(),
            None if meshes[mesh].times.len() == 1 => meshes[mesh].triangles.len(),
            None => 0,
        };
        let corners = |mesh: usize, t: usize| -> Option<[Vec3; 3]> {
            if let Some(triangles) = elsewhere[mesh] {
                return corners_elsewhere(triangles, t).map(|v| v.map(|p| scale.point(p)));
            }
            meshes[mesh].triangle_bound(t)?;
            let [a, b, c] = meshes[mesh].triangles[t].map(|v| meshes[mesh].positions[0].get(v as usize));
            Some([*a?, *b?, *c?].map(|p| scale.point(p)))
        };
        let mut items = Vec::with_capacity((0..meshes.len()).map(count).sum());
        for (m, first) in first.iter().enumerate() {
            for t in 0..count(m) {
                if let Some(vertices) = corners(m, t) {
                    items.push(Item::new(first + t as u32, &Box3::around(&vertices)));
                }
            }
        }
        let Topology { mut nodes, blocks: spans } = build::build(&mut items, threads);
        nodes.shrink_to_fit();
        // The boxes are not needed any more, and the blocks are about to take their room.
        let ids: Vec<u32> = items.iter().map(Item::id).collect();
        drop(items);
        let mut blocks = simd::with_large_pages(spans.len());
        blocks.resize(spans.len(), Block::EMPTY);
        let part = spans.len().div_ceil(threads.max(1)).max(1);
        std::thread::scope(|scope| {
            for (spans, blocks) in spans.chunks(part).zip(blocks.chunks_mut(part)) {
                let (ids, corners) = (&ids, &corners);
                let fill = move || {
                    for (span, block) in spans.iter().zip(blocks) {
                        let own = &ids[span.first as usize..][..span.count as usize];
                        for (lane, &id) in own.iter().enumerate() {
                            let mesh = first.partition_point(|f| *f <= id) - 1;
                            if let Some(vertices) = corners(mesh, (id - first[mesh]) as usize) {
                                block.set(lane, id, &vertices);
                            }
                        }
                    }
                };
                if threads > 1 { _ = scope.spawn(fill) } else { fill() }
            }
        });
        Self { nodes, blocks }
    }

    /// How many blocks there are.
    #[cfg(test)]
    pub(crate) fn len(&self) -> usize {
        self.blocks.len()
    }

    fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<Node>() + self.blocks.capacity() * size_of::<Block>()
    }
}

impl Tree for StillTree {
    #[inline(always)]
    fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    #[inline(always)]
    fn enter<S: Simd>(
        &self,
        s: S,
        node: usize,
        wide: &Wide<S>,
        tmax: f32,
    ) -> (u32, [f32; WIDE], &[u32; WIDE]) {
        let node = &self.nodes[node];
        let (mask, near) = wide.enter(s, still_plane(s, node), tmax);
        (mask, near, node.links())
    }

    #[inline(always)]
    fn block<'a>(&'a self, block: usize, _: &'a mut Block) -> &'a Block {
        &self.blocks[block]
    }

    #[inline(always)]
    fn bounds(&self, block: &Block, lane: usize) -> Box3 {
        Box3::around(&block.vertices(lane).map(Vec3::from_array))
    }

    #[inline(always)]
    fn prefetch<S: Simd>(&self, s: S, link: Link) {
        if link.is_leaf() {
            s.prefetch(&self.blocks[link.blocks().start]);
        } else {
            s.prefetch(&self.nodes[link.0 as usize]);
        }
    }
}

const _: () = assert!(NARROW == 4);
