//! Building and tracing.

use crate::bvh::{Bvh, Node, WIDTH};
use crate::triangle::Shear;
use crate::{Hit, MeshId, Ray, TriangleMesh};
use granita_base::{Bound, Vec3};

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

    /// Adds a mesh. Triangles with vertex indices out of range, or with vertices that are not finite, are never hit;
    /// nor is a mesh without times, with fewer lists of positions than times, or with times that do not increase.
    ///
    /// # Panics
    ///
    /// With more than `u32::MAX - 1` meshes.
    pub fn add(&mut self, mesh: TriangleMesh) -> MeshId {
        assert!(self.meshes.len() < u32::MAX as usize, "too many meshes");
        self.meshes.push(mesh);
        MeshId(self.meshes.len() as u32 - 1)
    }

    /// Builds the acceleration structure, on the calling thread.
    pub fn build(self) -> Tracer {
        let mut triangles = Vec::new();
        let mut boxes = Vec::new();
        for (m, mesh) in self.meshes.iter().enumerate() {
            if !mesh.is_usable() {
                continue;
            }
            for t in 0..mesh.triangles.len() {
                let Some(bound) = mesh.triangle_bound(t) else { continue };
                let vertices = mesh.triangles[t].map(|v| mesh.positions[0][v as usize]);
                triangles.push(Triangle { vertices, mesh: m as u32, triangle: t as u32 });
                boxes.push(bound);
            }
        }
        let bvh = Bvh::build(&boxes);
        let triangles = bvh.order.iter().map(|&i| triangles[i as usize].clone()).collect();
        Tracer { meshes: self.meshes, triangles, bvh }
    }
}

/// A triangle as the leaves hold it, with its vertices at the first key.
#[derive(Clone, Debug)]
struct Triangle {
    vertices: [Vec3; 3],
    mesh: u32,
    triangle: u32,
}

/// Answers rays. Shared between threads.
#[derive(Debug)]
pub struct Tracer {
    meshes: Vec<TriangleMesh>,
    triangles: Vec<Triangle>,
    bvh: Bvh,
}

/// What a ray needs to be tested against boxes.
struct BoxTest {
    origin: Vec3,
    inverse: Vec3,
    /// Axes along which the ray runs downward.
    negative: [bool; 3],
}

/// Relative room for rounding in distances to boxes: a difference, a reciprocal and a product, each rounded once
/// (after Ize, "Robust BVH Ray Traversal", JCGT 2(2), 2013), with something to spare.
const SLACK: f32 = 5e-7;

impl BoxTest {
    fn new(ray: &Ray) -> Self {
        let inverse = 1.0 / ray.dir;
        Self { origin: ray.origin, inverse, negative: [0, 1, 2].map(|a| inverse[a] < 0.0) }
    }

    /// Entry distances of the boxes, infinite where `tmin..tmax` misses them. A ray within a plane of a box gives
    /// NaN there, which the comparisons below ignore.
    #[inline]
    fn enter(&self, node: &Node, tmin: f32, tmax: f32) -> [f32; WIDTH] {
        let mut near = [tmin; WIDTH];
        let mut far = [tmax; WIDTH];
        for axis in 0..3 {
            let (lo, hi) = (&node.lo[axis], &node.hi[axis]);
            let (first, second) = if self.negative[axis] { (hi, lo) } else { (lo, hi) };
            let (origin, inverse) = (self.origin[axis], self.inverse[axis]);
            for i in 0..WIDTH {
                let n = (first[i] - origin) * inverse;
                let f = (second[i] - origin) * inverse;
                near[i] = if n > near[i] { n } else { near[i] };
                far[i] = if f < far[i] { f } else { far[i] };
            }
        }
        // Infinite distances on the wrong side become NaN here and miss.
        let near = near.map(|n| n - n.abs() * SLACK);
        let far = far.map(|f| f + f.abs() * SLACK);
        std::array::from_fn(|i| if near[i] <= far[i] { near[i] } else { f32::INFINITY })
    }
}

/// The ray with a direction of moderate length, and what its distances have to be multiplied by. Distances of any
/// scale then neither overflow nor vanish. `None` for a ray that hits nothing.
fn moderate(ray: &Ray) -> Option<(Ray, f32)> {
    let size = ray.dir.abs().max_element();
    // NaN components may hide behind others.
    if !(ray.dir.is_finite() && size > 0.0) {
        return None;
    }
    if (1e-18..1e18).contains(&size) {
        return Some((*ray, 1.0));
    }
    // A power of two: nothing is rounded.
    let unit = if size < 1.0 { 2.0_f32.powi(80) } else { 2.0_f32.powi(-80) };
    Some((Ray { dir: ray.dir * unit, tmin: ray.tmin / unit, tmax: ray.tmax / unit, ..*ray }, unit))
}

/// A child waiting to be visited.
#[derive(Clone, Copy)]
struct Waiting {
    child: u32,
    count: u32,
    near: f32,
}

impl Tracer {
    /// The meshes, in order.
    pub fn meshes(&self) -> &[TriangleMesh] {
        &self.meshes
    }

    /// Box around everything that can be hit, over all times; empty without anything.
    pub fn bound(&self) -> Bound {
        self.bvh.bound
    }

    /// The closest hit of each ray; [`Hit::MISS`] for none.
    ///
    /// # Panics
    ///
    /// When `hits` is not as long as `rays`.
    pub fn closest(&self, rays: &[Ray], hits: &mut [Hit]) {
        assert_eq!(rays.len(), hits.len(), "as many hits as rays");
        let mut stack = self.stack();
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = self.trace(ray, &mut stack, &mut |_| Verdict::Take);
        }
    }

    /// Whether each ray hits anything.
    ///
    /// # Panics
    ///
    /// When `blocked` is not as long as `rays`.
    pub fn any(&self, rays: &[Ray], blocked: &mut [bool]) {
        assert_eq!(rays.len(), blocked.len(), "as many answers as rays");
        let mut stack = self.stack();
        for (ray, blocked) in rays.iter().zip(blocked) {
            *blocked = self.trace(ray, &mut stack, &mut |_| Verdict::Stop).is_hit();
        }
    }

    /// The closest hit that `accept` lets pass.
    ///
    /// `accept` is asked about some of the hits, in no particular order, about each at most once; its answer must
    /// depend on the hit alone.
    pub fn closest_where(&self, ray: &Ray, accept: &mut dyn FnMut(&Hit) -> bool) -> Hit {
        let mut verdict = |hit: &Hit| if accept(hit) { Verdict::Take } else { Verdict::Pass };
        self.trace(ray, &mut self.stack(), &mut verdict)
    }

    fn stack(&self) -> Vec<Waiting> {
        Vec::with_capacity(self.bvh.stack)
    }

    /// Visits all triangles whose boxes the ray meets before the best hit so far.
    #[inline]
    fn trace(&self, ray: &Ray, stack: &mut Vec<Waiting>, judge: &mut impl FnMut(&Hit) -> Verdict) -> Hit {
        let mut best = Hit::MISS;
        if self.bvh.nodes.is_empty() {
            return best;
        }
        let Some((ray, unit)) = moderate(ray) else { return best };
        let Some(shear) = Shear::new(&ray) else { return best };
        let test = BoxTest::new(&ray);
        // In the moderate ray's units, as everything but the hits.
        let mut tmax = ray.tmax;
        stack.clear();
        stack.push(Waiting { child: 0, count: 0, near: ray.tmin });
        while let Some(next) = stack.pop() {
            // Not `>=`: a hit at the same distance may have the smaller number.
            if next.near > tmax {
                continue;
            }
            if next.count > 0 {
                let leaf = next.child as usize..(next.child + next.count) as usize;
                for triangle in &self.triangles[leaf] {
                    let vertices = self.vertices(triangle, ray.time);
                    let Some(hit) = shear.hit(&vertices, ray.tmin, tmax) else { continue };
                    let t = hit.t;
                    let hit = Hit {
                        t: t * unit,
                        mesh: triangle.mesh,
                        triangle: triangle.triangle,
                        b1: hit.b1,
                        b2: hit.b2,
                    };
                    let nearer =
                        !best.is_hit() || t < tmax || (hit.mesh, hit.triangle) < (best.mesh, best.triangle);
                    if nearer {
                        match judge(&hit) {
                            Verdict::Pass => {}
                            Verdict::Stop => return hit,
                            Verdict::Take => {
                                best = hit;
                                tmax = t;
                            }
                        }
                    }
                }
                continue;
            }
            let node = &self.bvh.nodes[next.child as usize];
            let near = test.enter(node, ray.tmin, tmax);
            let base = stack.len();
            for (slot, &near) in near.iter().enumerate() {
                if near < f32::INFINITY {
                    let entry = Waiting { child: node.child[slot], count: node.count[slot], near };
                    // The nearest goes last, to be taken first.
                    let mut at = stack.len();
                    stack.push(entry);
                    while at > base && stack[at - 1].near < entry.near {
                        stack[at] = stack[at - 1];
                        at -= 1;
                    }
                    stack[at] = entry;
                }
            }
        }
        best
    }

    #[inline]
    fn vertices(&self, triangle: &Triangle, time: f32) -> [Vec3; 3] {
        let mesh = &self.meshes[triangle.mesh as usize];
        if mesh.times.len() == 1 {
            return triangle.vertices;
        }
        mesh.triangle_at(triangle.triangle as usize, time)
    }
}

/// What becomes of a hit.
enum Verdict {
    /// It does not count.
    Pass,
    /// It is the best so far.
    Take,
    /// It is enough.
    Stop,
}
