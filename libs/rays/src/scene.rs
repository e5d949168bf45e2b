// tidy: long: one type holds what rays hit, and answers each kind of ray from it
//! Geometry sets prepared for rays.
//!
//! Static meshes, which neither move nor are displaced, are put into one tree. The tessellations of small primitives
//! are put there too, as long as they are few. For all other primitives, a tree of boxes finds the parts that a ray
//! passes. A part is tessellated when the first ray needs it, as finely as the ray is wide there, and kept in a
//! [`TessellationCache`](crate::cache::TessellationCache).
//!
//! # Why rays do not leak
//!
//! The level is chosen from the ray and the primitive. For one ray all parts of a primitive are at one level, and the
//! sides of their grids agree (after Christensen, Laur, Fong, Wooten, Batali: "Ray Differentials and Multiresolution
//! Geometry Caching for Distribution Ray Tracing in Complex Scenes", Eurographics 2003, where the levels of
//! neighbouring patches may differ and rays may pass between them). Distances equal those of a single tree to the bit
//! ([`TracerBuilder::within`]). A ray that starts in the box of a primitive sees it at the finest level. The margin
//! around the surface that the ray leaves is made for this level.

use crate::areas::{AreaTable, area};
use crate::cache::{Key, Tessellation};
use crate::mesh::{self, Level, Member, MeshHit, OnDemandMesh, RayMesh, StaticMesh};
use crate::request::{Leaving, RayRequest};
use crate::{GridShader, GridShaders, RayDisplacement, RayObject};
use granita_base::report::MessageOrder;
use granita_base::{Bound, Vec3, parallel_map};
use granita_trace::{
    Accelerator, BoxScratch, BoxTree, Hit, Ray, RayScratch, Tracer, TracerBuilder, TracerCopy,
};
use rustc_hash::{FxHashMap, FxHashSet};
use std::sync::{Arc, OnceLock};

/// The approximate number of bytes of a tessellation for each triangle.
const TRIANGLE_BYTES: f32 = 128.0;
/// The fraction of the cache's limit that the tessellations of small primitives may occupy to be resident.
const RESIDENT_SHARE: f32 = 1.0 / 8.0;

/// How geometry sets are prepared.
#[derive(Clone, Debug)]
pub struct RayBuild {
    /// The largest number of threads.
    pub threads: usize,
    /// True when the rays of some object see motion.
    pub motion: bool,
    /// The processor that traces large batches of rays; `None` for the CPU alone.
    pub accelerator: Option<Arc<dyn Accelerator>>,
}

/// A geometry set, prepared for rays.
pub struct RayScene<O> {
    /// The index of the set in the frame.
    set: u32,
    /// The static meshes. They are the first parts of the set.
    static_meshes: Vec<StaticMesh<O>>,
    /// The tree of the static meshes and the resident tessellations.
    tracer: Arc<Tracer>,
    /// The copy of the tree on another processor.
    copy: Option<Box<dyn TracerCopy>>,
    /// The meshes that are tessellated on demand, small ones first.
    on_demand_meshes: Vec<OnDemandMesh<O>>,
    /// The tessellations of the first on-demand meshes. They are the parts of the set after the static meshes.
    residents: Vec<RayMesh>,
    /// The parts that follow, which are tessellated on demand: the index of the on-demand mesh and the part of it.
    parts: Vec<(u32, u32)>,
    /// The boxes of these parts.
    boxes: BoxTree,
    /// True when no object of the set lets light through.
    pub opaque_to_shadows: bool,
    /// The addresses of the objects that are tessellated. Rays that leave such an object start slightly off its
    /// tessellation.
    rough: FxHashSet<usize>,
    /// True when some shader of the set queries the shader whose ray hits it.
    pub queries_parents: bool,
    /// The table of areas, built when the set first emits light.
    areas: OnceLock<Areas>,
}

/// The hit of a ray on a set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SetHit {
    /// The distance in world units; infinite for a miss.
    pub t: f32,
    /// The barycentric coordinates of the second and third vertex.
    b1: f32,
    b2: f32,
    /// The part of the set; `u32::MAX` for a miss.
    part: u32,
    triangle: u32,
    level: Level,
}

impl SetHit {
    /// The value for a ray that hits nothing.
    pub const MISS: Self =
        Self { t: f32::INFINITY, b1: 0.0, b2: 0.0, part: u32::MAX, triangle: u32::MAX, level: Level::FINEST };

    /// True when the ray hit a surface.
    pub fn is_hit(&self) -> bool {
        self.part != u32::MAX
    }

    fn static_mesh(hit: &Hit) -> Self {
        Self {
            t: hit.t,
            b1: hit.b1,
            b2: hit.b2,
            part: hit.mesh,
            triangle: hit.triangle,
            level: Level::FINEST,
        }
    }

    /// Converts a hit, or a miss, of the tree of static meshes and resident tessellations.
    fn of(hit: &Hit) -> Self {
        if hit.is_hit() { Self::static_mesh(hit) } else { Self::MISS }
    }

    /// Returns the key that orders hits at one distance.
    pub fn order(&self) -> (u32, u32) {
        (self.part, self.triangle)
    }
}

/// The tessellations that a thread holds while it traces a batch.
#[derive(Default)]
struct ThreadTessellations {
    made: FxHashMap<(u32, Level), Arc<Tessellation>>,
    bytes: u64,
}

/// The surfaces of a set that emit light.
struct Areas {
    table: AreaTable,
    /// The static meshes as meshes for shading, when they are few.
    static_meshes: Vec<RayMesh>,
}

impl Areas {
    /// Returns the part and the triangle that a place in the unit square is mapped to, and the weights of its second
    /// and third corner there.
    fn place(&self, &[x, y]: &[f32; 2]) -> Option<(u32, u32, [f32; 2])> {
        let (part, triangle, x) = self.table.at(x)?;
        // The square is folded into the triangle, uniform in area.
        let root = x.sqrt();
        Some((part, triangle, [root * (1.0 - y), root * y]))
    }
}

/// The largest number of facets of static meshes that counts as few.
const FEW_FACETS: usize = 1 << 12;

/// The meshes of some hits, and the places of the hits in them.
pub struct Located<'a> {
    residents: &'a [RayMesh],
    meshes: Vec<Arc<Tessellation>>,
    temporary: Vec<RayMesh>,
    places: Vec<Place>,
}

/// The facets of a static mesh that were hit.
#[derive(Default)]
struct HitFacets {
    /// The index of the mesh that is made of them.
    mesh: u32,
    /// The facets in the order of their first hits.
    facets: Vec<u32>,
    /// The index of each facet in `facets`.
    known: FxHashMap<u32, u32>,
}

/// The mesh and triangle of one hit.
#[derive(Clone, Copy)]
enum Place {
    Kept(u32, u32),
    Resident(u32, u32),
    Temporary(u32, u32),
}

impl Place {
    /// Returns the place of a hit that follows a hit at this place, when it can be derived from it.
    fn next_to(self, before: &SetHit, hit: &SetHit) -> Option<Self> {
        let same = (before.part, before.level) == (hit.part, hit.level);
        match self {
            _ if !same => None,
            Self::Kept(mesh, _) => Some(Self::Kept(mesh, hit.triangle)),
            Self::Resident(mesh, _) => Some(Self::Resident(mesh, hit.triangle)),
            Self::Temporary(mesh, triangle) => {
                let facet = before.triangle / 2 == hit.triangle / 2;
                facet.then_some(Self::Temporary(mesh, triangle & !1 | hit.triangle & 1))
            }
        }
    }
}

impl Located<'_> {
    /// Returns the mesh of hit `k` and the triangle in it.
    pub fn get(&self, k: usize) -> Option<(&RayMesh, u32)> {
        match self.places[k] {
            Place::Kept(mesh, triangle) => Some((self.meshes[mesh as usize].mesh.as_ref()?, triangle)),
            Place::Resident(mesh, triangle) => Some((&self.residents[mesh as usize], triangle)),
            Place::Temporary(mesh, triangle) => Some((&self.temporary[mesh as usize], triangle)),
        }
    }
}

impl<O: RayObject> RayScene<O> {
    /// Prepares the members. Only displaced primitives without a displacement bound are
    /// tessellated here.
    pub fn build(set: u32, members: &[u32], shaders: &dyn GridShaders<O>, how: &RayBuild) -> Self {
        let (threads, motion) = (how.threads, how.motion);
        let seen = shaders.ray_frame();
        let order = MessageOrder::new(seen.reporter);
        let made = parallel_map(
            members.iter().enumerate(),
            threads,
            || shaders.thread(),
            |thread, (number, member)| {
                let _part = order.begin(number);
                let primitive = &seen.scene.primitives[*member as usize];
                let object = shaders.object(primitive);
                mesh::prepare(primitive, &object, motion, &mut **thread)
            },
        );
        let (mut static_meshes, mut on_demand_meshes) = (Vec::new(), Vec::new());
        for member in made.into_iter().flatten() {
            match member {
                Member::StaticMesh(static_mesh) => static_meshes.push(static_mesh),
                Member::OnDemandMesh(on_demand) => on_demand_meshes.push(on_demand),
            }
        }
        // Small meshes come first, so that hits at one distance have the same order whether they are resident or not.
        on_demand_meshes.sort_by_key(|on_demand: &OnDemandMesh<O>| !on_demand.is_small());
        let mut residents = Vec::new();
        let mut builder = TracerBuilder::new();
        static_meshes.iter().for_each(|static_mesh| _ = builder.add_triangles(static_mesh));
        let small = || on_demand_meshes.iter().filter(|on_demand| on_demand.is_small());
        let bytes = small().map(|on_demand| on_demand.triangles() * TRIANGLE_BYTES).sum::<f32>();
        if bytes <= seen.cache.limit() as f32 * RESIDENT_SHARE {
            let mut thread = shaders.thread();
            for on_demand in small() {
                let (mesh, triangles) =
                    on_demand.tessellate(0, Level::FINEST, &mut *thread).unwrap_or_default();
                builder.add(triangles);
                residents.push(mesh);
            }
        }
        let tracer = Arc::new(builder.build(threads));
        let copy = how.accelerator.as_ref().and_then(|accelerator| accelerator.copy(&tracer));
        let each = on_demand_meshes.iter().enumerate().skip(residents.len());
        let parts: Vec<(u32, u32)> = each
            .clone()
            .flat_map(|(s, on_demand)| (0..on_demand.parts.len()).map(move |p| (s as u32, p as u32)))
            .collect();
        let bounds: Vec<Bound> = each.clone().flat_map(|(_, s)| s.parts.iter().map(|p| p.bound)).collect();
        let objects =
            || static_meshes.iter().map(|f| &f.object).chain(on_demand_meshes.iter().map(|s| &s.object));
        Self {
            set,
            opaque_to_shadows: objects().all(|object| object.is_opaque_to_shadows()),
            queries_parents: objects().any(|object| object.queries_parent()),
            rough: on_demand_meshes
                .iter()
                .map(|on_demand| std::ptr::from_ref::<O>(&on_demand.object).addr())
                .collect(),
            boxes: BoxTree::new(&bounds),
            tracer,
            copy,
            static_meshes,
            on_demand_meshes,
            residents,
            parts,
            areas: OnceLock::new(),
        }
    }

    /// Returns the number of triangles of static meshes and resident tessellations, and the bytes of all structures
    /// except the cached tessellations.
    pub fn size(&self) -> (u64, u64) {
        let triangles: usize = self.static_meshes.iter().map(StaticMesh::triangles).sum();
        let on_demand_meshes: usize = self.on_demand_meshes.iter().map(OnDemandMesh::bytes).sum();
        let parts = self.parts.capacity() * size_of::<(u32, u32)>();
        let residents: usize = self.residents.iter().map(RayMesh::bytes).sum();
        let triangles = triangles + self.residents.iter().map(|m| m.triangles() as usize).sum::<usize>();
        (
            triangles as u64,
            (self.tracer.bytes() + self.boxes.bytes() + parts + on_demand_meshes + residents) as u64,
        )
    }

    /// Returns the index of the set in the frame.
    pub fn number(&self) -> u32 {
        self.set
    }

    /// True when rays hit an object only approximately where it is. The object is then tessellated from a curved
    /// surface, or it is displaced for the camera but not for rays.
    pub fn is_rough(&self, object: &O) -> bool {
        self.rough.contains(&std::ptr::from_ref(object).addr())
            || object.displacement() == RayDisplacement::Bumps && !self.on_demand_meshes.is_empty()
    }

    /// True when no part is tessellated on demand. The widths of rays then have no effect.
    pub fn is_settled(&self) -> bool {
        self.parts.is_empty()
    }

    /// Returns the object that was hit.
    pub fn object(&self, hit: &SetHit) -> &Arc<O> {
        match self.solid_of(hit.part) {
            Some(on_demand) => &self.on_demand_meshes[on_demand].object,
            None => &self.static_meshes[hit.part as usize].object,
        }
    }

    /// Returns the primitive that was hit, as a number for sorting and as its id.
    pub fn primitive(&self, hit: &SetHit) -> (u32, u32) {
        match self.solid_of(hit.part) {
            Some(on_demand) => {
                ((self.static_meshes.len() + on_demand) as u32, self.on_demand_meshes[on_demand].primitive.id)
            }
            None => (hit.part, self.static_meshes[hit.part as usize].primitive.id),
        }
    }

    /// The number of parts that are not tessellated on demand.
    fn settled(&self) -> usize {
        self.static_meshes.len() + self.residents.len()
    }

    /// Returns the on-demand mesh of a part, resident or not.
    fn solid_of(&self, part: u32) -> Option<usize> {
        match self.on_demand(part) {
            Some((on_demand, _)) => Some(on_demand),
            None => (part as usize).checked_sub(self.static_meshes.len()),
        }
    }

    /// Returns the on-demand mesh, and the part of it, of a part that is tessellated on demand.
    fn on_demand(&self, part: u32) -> Option<(usize, u32)> {
        let (on_demand, own) = *self.parts.get((part as usize).checked_sub(self.settled())?)?;
        Some((on_demand as usize, own))
    }

    /// Returns the tessellation of an on-demand part at a level.
    fn part(&self, thread: &mut dyn GridShader<'_, O>, part: u32, level: Level) -> Arc<Tessellation> {
        let cache = thread.ray_frame().cache;
        cache.get(Key { set: self.set, part, level }, || {
            let on_demand = self.on_demand(part);
            let made = on_demand
                .and_then(|(on_demand, own)| self.on_demand_meshes[on_demand].tessellate(own, level, thread));
            let mut builder = TracerBuilder::within(self.boxes.bound());
            let mesh = made.map(|(mesh, triangles)| {
                builder.add(triangles);
                mesh
            });
            Tessellation { mesh, tracer: builder.build(1) }
        })
    }

    fn part_at_hand<'h>(
        &self,
        thread: &mut dyn GridShader<'_, O>,
        hand: &'h mut ThreadTessellations,
        part: u32,
        level: Level,
    ) -> &'h Tessellation {
        // What one thread holds must stay a small fraction of the cache's limit.
        if hand.bytes > thread.ray_frame().cache.limit() / 16 {
            *hand = ThreadTessellations::default();
        }
        hand.made.entry((part, level)).or_insert_with(|| {
            let made = self.part(thread, part, level);
            hand.bytes += made.bytes();
            made
        })
    }

    /// Calls `passed` with each part on a ray, roughly the nearest first. `passed` returns how far the ray still goes.
    /// A negative distance ends the search. Parts of the object that is left are not called where all hits on them are
    /// hidden.
    fn along(
        &self,
        thread: &mut dyn GridShader<'_, O>,
        (hand, room): (&mut ThreadTessellations, &mut BoxScratch),
        (ray, leaving, [width, spread]): (&Ray, Leaving, [f32; 2]),
        reach: f32,
        passed: &mut dyn FnMut(&Tracer, u32, Level) -> f32,
    ) {
        let ray = Ray { tmax: reach.min(ray.tmax), ..*ray };
        let mut known: Option<(u32, Level)> = None;
        let mut reach = ray.tmax;
        self.boxes.visit(&ray, room, &mut |passage| {
            let (on_demand, _) = self.parts[passage.index as usize];
            if leaving.hides_up_to(&*self.on_demand_meshes[on_demand as usize].object, reach) {
                return reach;
            }
            let level = match known {
                Some((of, level)) if of == on_demand => level,
                _ => {
                    let own = &self.on_demand_meshes[on_demand as usize];
                    own.level(ray.origin, ray.dir, width, spread)
                }
            };
            known = Some((on_demand, level));
            let part = self.settled() as u32 + passage.index;
            let made = self.part_at_hand(thread, hand, part, level);
            reach = reach.min(passed(&made.tracer, part, level));
            reach
        });
    }

    /// Returns the closest hit of each ray.
    pub fn closest(&self, thread: &mut dyn GridShader<'_, O>, requests: &[RayRequest]) -> Vec<SetHit> {
        let rays: Vec<Ray> = requests.iter().map(|r| beyond(&r.ray, r.leaving)).collect();
        let mut hits: Vec<SetHit> = self.closest_of_settled(&rays).iter().map(SetHit::of).collect();
        let widths = |k: usize| requests[k].widths();
        self.closest_of_parts(thread, &rays, &widths, &mut hits);
        for (request, hit) in requests.iter().zip(&mut hits) {
            let near = self.near(thread, &request.ray, request.leaving, request.widths());
            if near.is_hit() {
                *hit = near;
            }
            if self.is_left(request, hit) {
                *hit = self.closest_where(thread, request, &mut |hit| self.counts(request, hit));
            }
        }
        hits
    }

    /// True when a hit of a ray counts. Hits of the surface that the ray leaves do not count within its margin, and not
    /// at all where the ray leaves a convex surface.
    pub fn counts(&self, request: &RayRequest, hit: &SetHit) -> bool {
        !request.leaving.hides(&**self.object(hit), hit.t) && !self.is_left(request, hit)
    }

    /// True when a hit is of a convex surface that the ray has left.
    fn is_left(&self, request: &RayRequest, hit: &SetHit) -> bool {
        let Some(departure) = request.departure.filter(|_| hit.is_hit()) else { return false };
        let Some(mesh) = self.solid_of(hit.part).map(|mesh| &self.on_demand_meshes[mesh]) else {
            return false;
        };
        mesh.primitive.id == departure.primitive
            && mesh.convex.as_ref().is_some_and(|convex| convex.is_left(&departure))
    }

    /// Returns the closest hit of another object within the margin of the surface that the ray leaves.
    fn near(
        &self,
        thread: &mut dyn GridShader<'_, O>,
        ray: &Ray,
        leaving: Leaving,
        [width, spread]: [f32; 2],
    ) -> SetHit {
        let margin = leaving.margin();
        if margin <= ray.tmin {
            return SetHit::MISS;
        }
        let ray = Ray { tmax: margin.min(ray.tmax), ..*ray };
        let request = RayRequest { leaving, width, spread, ..RayRequest::new(ray) };
        self.closest_where(thread, &request, &mut |hit| !leaving.hides(&**self.object(hit), hit.t))
    }

    fn closest_of_settled(&self, rays: &[Ray]) -> Vec<Hit> {
        let mut hits = vec![Hit::MISS; rays.len()];
        if !self.copy.as_ref().is_some_and(|copy| copy.closest(rays, &mut hits)) {
            self.tracer.closest(rays, &mut hits);
        }
        hits
    }

    /// Replaces hits by nearer hits of on-demand parts.
    fn closest_of_parts(
        &self,
        thread: &mut dyn GridShader<'_, O>,
        rays: &[Ray],
        widths: &dyn Fn(usize) -> [f32; 2],
        hits: &mut [SetHit],
    ) {
        if self.parts.is_empty() {
            return;
        }
        let (mut hand, mut boxes, mut room) =
            (ThreadTessellations::default(), BoxScratch::default(), RayScratch::default());
        for (k, (whole, best)) in rays.iter().zip(hits).enumerate() {
            let along = (whole, Leaving::default(), widths(k));
            self.along(thread, (&mut hand, &mut boxes), along, best.t, &mut |tracer, part, level| {
                let ray = Ray { tmax: best.t.min(whole.tmax), ..*whole };
                let hit = tracer.closest_of_one(&ray, &mut room);
                if hit.is_hit() {
                    let hit = SetHit { part, level, ..SetHit::static_mesh(&hit) };
                    if hit.t < best.t || hit.t == best.t && hit.order() < best.order() {
                        *best = hit;
                    }
                }
                best.t
            });
        }
    }

    /// Returns the distance of the closest hit of each ray; infinite for a miss. `widths` returns the
    /// [`RayRequest::widths`] of a ray, and `leaving` the surface that it leaves, by the index of the ray.
    pub fn distances(
        &self,
        thread: &mut dyn GridShader<'_, O>,
        rays: &[Ray],
        widths: &dyn Fn(usize) -> [f32; 2],
        leaving: &dyn Fn(usize) -> Leaving,
    ) -> Vec<f32> {
        let far: Vec<Ray> = rays.iter().enumerate().map(|(k, ray)| beyond(ray, leaving(k))).collect();
        let mut hits: Vec<SetHit> = self.closest_of_settled(&far).iter().map(SetHit::of).collect();
        self.closest_of_parts(thread, &far, widths, &mut hits);
        let each = rays.iter().zip(&hits).enumerate();
        each.map(|(k, (ray, hit))| self.near(thread, ray, leaving(k), widths(k)).t.min(hit.t)).collect()
    }

    /// Returns for each ray whether it hits any surface. The parameters are those of [`RayScene::distances`].
    pub fn any(
        &self,
        thread: &mut dyn GridShader<'_, O>,
        rays: &[Ray],
        widths: &dyn Fn(usize) -> [f32; 2],
        leaving: &dyn Fn(usize) -> Leaving,
    ) -> Vec<bool> {
        let far: Vec<Ray> = rays.iter().enumerate().map(|(k, ray)| beyond(ray, leaving(k))).collect();
        let mut blocked = vec![false; rays.len()];
        if !self.copy.as_ref().is_some_and(|copy| copy.any(&far, &mut blocked)) {
            self.tracer.any(&far, &mut blocked);
        }
        if !self.parts.is_empty() {
            let (mut hand, mut boxes, mut room) =
                (ThreadTessellations::default(), BoxScratch::default(), RayScratch::default());
            for (k, (ray, blocked)) in far.iter().zip(&mut blocked).enumerate().filter(|(_, (_, b))| !**b) {
                let along = (ray, Leaving::default(), widths(k));
                self.along(thread, (&mut hand, &mut boxes), along, f32::INFINITY, &mut |tracer, _, _| {
                    *blocked = tracer.any_of_one(ray, &mut room);
                    if *blocked { -1.0 } else { f32::INFINITY }
                });
            }
        }
        for (k, (ray, blocked)) in rays.iter().zip(&mut blocked).enumerate().filter(|(_, (_, b))| !**b) {
            *blocked = self.near(thread, ray, leaving(k), widths(k)).is_hit();
        }
        blocked
    }

    /// Returns the closest hit that `accept` accepts. `accept` is called for some of the hits, in no particular
    /// order, and at most once for each. Its result must depend on the hit alone, and it accepts no hit that the
    /// surface that the ray leaves [hides](Leaving::hides).
    pub fn closest_where(
        &self,
        thread: &mut dyn GridShader<'_, O>,
        request: &RayRequest,
        accept: &mut dyn FnMut(&SetHit) -> bool,
    ) -> SetHit {
        let hit = self.tracer.closest_where(&request.ray, &mut |h| accept(&SetHit::static_mesh(h)));
        let mut best = SetHit::of(&hit);
        if self.parts.is_empty() {
            return best;
        }
        let (mut hand, mut boxes) = (ThreadTessellations::default(), BoxScratch::default());
        let along = (&request.ray, request.leaving, request.widths());
        self.along(thread, (&mut hand, &mut boxes), along, best.t, &mut |tracer, part, level| {
            let ray = Ray { tmax: best.t.min(request.ray.tmax), ..request.ray };
            let of_part = |h: &Hit| SetHit { part, level, ..SetHit::static_mesh(h) };
            let hit = tracer.closest_where(&ray, &mut |h| accept(&of_part(h)));
            if hit.is_hit() {
                let hit = of_part(&hit);
                if hit.t < best.t || hit.t == best.t && hit.order() < best.order() {
                    best = hit;
                }
            }
            best.t
        });
        best
    }

    /// Returns the meshes of some hits.
    pub fn locate(&self, thread: &mut dyn GridShader<'_, O>, hits: &[SetHit]) -> Located<'_> {
        let residents = &self.residents[..];
        let mut located = Located {
            residents,
            meshes: Vec::new(),
            temporary: Vec::new(),
            places: Vec::with_capacity(hits.len()),
        };
        let mut kept: FxHashMap<(u32, Level), u32> = FxHashMap::default();
        let mut static_meshes: FxHashMap<u32, HitFacets> = FxHashMap::default();
        for (k, hit) in hits.iter().enumerate() {
            // Hits are ordered, so that most are on the same mesh as the hit before.
            let before = k.checked_sub(1).map(|k| (&hits[k], located.places[k]));
            if let Some(place) = before.and_then(|(before, place)| place.next_to(before, hit)) {
                located.places.push(place);
            } else if self.on_demand(hit.part).is_some() {
                let mesh = *kept.entry((hit.part, hit.level)).or_insert_with(|| {
                    located.meshes.push(self.part(thread, hit.part, hit.level));
                    located.meshes.len() as u32 - 1
                });
                located.places.push(Place::Kept(mesh, hit.triangle));
            } else if let Some(k) = (hit.part as usize).checked_sub(self.static_meshes.len()) {
                located.places.push(Place::Resident(k as u32, hit.triangle));
            } else {
                let mesh = static_meshes.len() as u32;
                let static_mesh =
                    static_meshes.entry(hit.part).or_insert(HitFacets { mesh, ..HitFacets::default() });
                let facet = *static_mesh.known.entry(hit.triangle / 2).or_insert_with(|| {
                    static_mesh.facets.push(hit.triangle / 2);
                    static_mesh.facets.len() as u32 - 1
                });
                located.places.push(Place::Temporary(static_mesh.mesh, 2 * facet + hit.triangle % 2));
            }
        }
        let mut static_meshes: Vec<(u32, HitFacets)> = static_meshes.into_iter().collect();
        static_meshes.sort_unstable_by_key(|(_, static_mesh)| static_mesh.mesh);
        let mesh_of = |(part, static_mesh): &(u32, HitFacets)| {
            self.static_meshes[*part as usize].mesh_of(&static_mesh.facets, thread)
        };
        located.temporary = static_meshes.iter().filter_map(mesh_of).collect();
        located
    }

    /// Returns the points of all surfaces that places in the unit square are mapped to, uniform in area, and the
    /// normals there. Triangles follow each other along x. Returns `None` when the set has no area.
    pub fn area_points(
        &self,
        thread: &mut dyn GridShader<'_, O>,
        places: &[[f32; 2]],
    ) -> Option<Vec<(Vec3, Vec3)>> {
        let areas = match self.areas.get() {
            Some(areas) => areas,
            None => {
                let made = self.areas(thread);
                self.areas.get_or_init(|| made)
            }
        };
        let of_mesh = |mesh: &RayMesh, triangle: u32, (b1, b2): (f32, f32)| {
            let [a, b, c] = mesh.corners(triangle);
            let p = a * (1.0 - b1 - b2) + b * b1 + c * b2;
            let place = MeshHit { triangle, b1, b2, p, i: Vec3::ZERO, width: 0.0 };
            (p, mesh.normal(&place))
        };
        let mut out = Vec::with_capacity(places.len());
        if self.settled() == areas.static_meshes.len() && self.parts.is_empty() {
            for place in places {
                let (part, triangle, [b1, b2]) = areas.place(place)?;
                out.push(of_mesh(&areas.static_meshes[part as usize], triangle, (b1, b2)));
            }
            return Some(out);
        }
        let mut hits = Vec::with_capacity(places.len());
        for place in places {
            let (part, triangle, [b1, b2]) = areas.place(place)?;
            hits.push(SetHit { t: 0.0, b1, b2, part, triangle, level: Level::FINEST });
        }
        let located = self.locate(thread, &hits);
        for (k, hit) in hits.iter().enumerate() {
            let (mesh, triangle) = located.get(k)?;
            out.push(of_mesh(mesh, triangle, (hit.b1, hit.b2)));
        }
        Some(out)
    }

    fn areas(&self, thread: &mut dyn GridShader<'_, O>) -> Areas {
        let all = |static_mesh: &StaticMesh<O>| (0..static_mesh.facets() as u32).collect::<Vec<u32>>();
        let few = self.static_meshes.iter().map(StaticMesh::facets).sum::<usize>() <= FEW_FACETS;
        let static_meshes = self
            .static_meshes
            .iter()
            .filter(|_| few)
            .map(|static_mesh| static_mesh.mesh_of(&all(static_mesh), thread));
        let static_meshes = static_meshes.collect::<Option<Vec<RayMesh>>>().unwrap_or_default();
        Areas { table: self.area_table(thread), static_meshes }
    }

    /// Returns the areas of all triangles at the finest level.
    fn area_table(&self, thread: &mut dyn GridShader<'_, O>) -> AreaTable {
        use granita_trace::Triangles;
        let mut table = AreaTable::default();
        for (part, static_mesh) in self.static_meshes.iter().enumerate() {
            for t in 0..static_mesh.count() {
                if let Some([a, b, c]) = static_mesh.triangle(t) {
                    table.push(part as u32, t as u32, area(a, b, c));
                }
            }
        }
        let mut add = |part: usize, mesh: &RayMesh| {
            for t in 0..mesh.triangles() {
                let [a, b, c] = mesh.corners(t);
                table.push(part as u32, t, area(a, b, c));
            }
        };
        for (k, mesh) in self.residents.iter().enumerate() {
            add(self.static_meshes.len() + k, mesh);
        }
        for k in 0..self.parts.len() {
            let part = self.settled() + k;
            let made = self.part(thread, part as u32, Level::FINEST);
            if let Some(mesh) = &made.mesh {
                add(part, mesh);
            }
        }
        table
    }
}

/// Returns the ray from the end of the margin on, where hits of all objects count.
fn beyond(ray: &Ray, leaving: Leaving) -> Ray {
    Ray { tmin: ray.tmin.max(leaving.margin()), ..*ray }
}

/// Returns a hit as a place in world space.
pub fn mesh_hit(request: &RayRequest, hit: &SetHit, triangle: u32) -> MeshHit {
    let i = request.ray.dir * hit.t;
    MeshHit {
        triangle,
        b1: hit.b1,
        b2: hit.b2,
        p: request.ray.origin + i,
        i,
        width: request.width + request.spread * hit.t,
    }
}

#[cfg(test)]
mod tests;
