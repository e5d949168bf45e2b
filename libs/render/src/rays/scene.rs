//! Geometry sets as rays meet them.
//!
//! Flat meshes that neither move nor are displaced lie in one tree as they are, and so do the tessellations of small
//! primitives as long as there are few of these. Of everything else a tree over boxes
//! says which parts a ray passes; these are tessellated when the first ray comes in, as finely as the ray is wide
//! there, and kept in a [`TessellationCache`](crate::rays::cache::TessellationCache).
//!
//! # Why nothing leaks
//!
//! The level is chosen by the ray and the primitive: for one ray all parts of a primitive are at one level, and the
//! sides of their grids agree (after Christensen, Laur, Fong, Wooten, Batali: "Ray Differentials and Multiresolution
//! Geometry Caching for Distribution Ray Tracing in Complex Scenes", Eurographics 2003, where the levels of neighbouring
//! patches may differ and rays may pass between). Distances are those of a single tree, to the bit
//! ([`TracerBuilder::within`]). A ray that starts in the box of a primitive sees it at the finest level, which is what
//! the margin around the surface it leaves is made for.

use crate::object::ObjectState;
use crate::rays::areas::{AreaTable, area};
use crate::rays::cache::{Key, Tessellation};
use crate::rays::mesh::{self, Flat, Level, Member, MeshHit, RayMesh, Solid};
use crate::rays::request::{Leaving, RayRequest, asks_parent};
use crate::rays::{GridShader, GridShaders};
use granita_base::{Bound, Vec3};
use granita_trace::{BoxRoom, BoxTree, Hit, Ray, RayRoom, Tracer, TracerBuilder};
use rustc_hash::{FxHashMap, FxHashSet};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// Bytes of a tessellation, about, for each triangle.
const TRIANGLE_BYTES: f32 = 128.0;
/// What part of the cache's limit small primitives may take together to be resident.
const RESIDENT_SHARE: f32 = 1.0 / 8.0;

/// A geometry set, ready for rays.
pub(crate) struct RayScene {
    /// Which of the frame's sets.
    set: u32,
    /// Meshes that are as they are; parts of the set from 0 on.
    flats: Vec<Flat>,
    /// Of the meshes, and of what is resident.
    tracer: Tracer,
    /// What is tessellated, small ones first.
    solids: Vec<Solid>,
    /// Tessellations of the first of them: parts of the set after the meshes.
    residents: Vec<RayMesh>,
    /// Of the parts that follow, which are tessellated on demand: solid, and part of it.
    parts: Vec<(u32, u32)>,
    /// Of these parts.
    boxes: BoxTree,
    /// Nothing in it lets light through.
    pub(crate) opaque_to_shadows: bool,
    /// Addresses of the states of objects that are tessellated: these are not quite where rays leave them.
    rough: FxHashSet<usize>,
    /// Some of its shaders ask the shaders whose rays meet them.
    pub(crate) asks_parents: bool,
    /// Made when the first light shines from it.
    areas: OnceLock<Areas>,
}

/// Where a ray met a set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SetHit {
    /// Distance; infinite for a miss.
    pub(crate) t: f32,
    /// Barycentric coordinates of the second and third vertex.
    b1: f32,
    b2: f32,
    /// Part of the set; `u32::MAX` for a miss.
    part: u32,
    triangle: u32,
    level: Level,
}

impl SetHit {
    /// No hit.
    pub(crate) const MISS: Self =
        Self { t: f32::INFINITY, b1: 0.0, b2: 0.0, part: u32::MAX, triangle: u32::MAX, level: Level::FINEST };

    /// Whether something was hit.
    pub(crate) fn is_hit(&self) -> bool {
        self.part != u32::MAX
    }

    fn flat(hit: &Hit) -> Self {
        Self {
            t: hit.t,
            b1: hit.b1,
            b2: hit.b2,
            part: hit.mesh,
            triangle: hit.triangle,
            level: Level::FINEST,
        }
    }

    /// Of what is settled; also of a miss.
    fn of(hit: &Hit) -> Self {
        if hit.is_hit() { Self::flat(hit) } else { Self::MISS }
    }

    /// What sorts hits at one distance, whatever found them.
    pub(crate) fn order(&self) -> (u32, u32) {
        (self.part, self.triangle)
    }
}

/// Tessellations that a thread has at hand while it traces a batch.
#[derive(Default)]
struct AtHand {
    made: FxHashMap<(u32, Level), Arc<Tessellation>>,
    bytes: u64,
}

/// What light shines from.
struct Areas {
    table: AreaTable,
    /// All of the flat meshes as they are hit, where they are few.
    flats: Vec<RayMesh>,
}

/// Facets of flat meshes that are few.
const FEW_FACETS: usize = 1 << 12;

/// Where hits are: meshes, and the places of the hits in them.
pub(crate) struct Located<'a> {
    residents: &'a [RayMesh],
    meshes: Vec<Arc<Tessellation>>,
    temporary: Vec<RayMesh>,
    places: Vec<Place>,
}

/// Facets of a flat mesh that were hit.
#[derive(Default)]
struct HitFacets {
    /// Which mesh is made of them.
    mesh: u32,
    /// In the order in which they were met first.
    facets: Vec<u32>,
    /// Where they stand in it.
    known: FxHashMap<u32, u32>,
}

/// Mesh and triangle of one hit.
#[derive(Clone, Copy)]
enum Place {
    Kept(u32, u32),
    Resident(u32, u32),
    Temporary(u32, u32),
}

impl Place {
    /// Where a hit is that follows one at this place, if that is easy to say.
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
    /// The mesh of hit `k`, and the triangle in it.
    pub(crate) fn get(&self, k: usize) -> Option<(&RayMesh, u32)> {
        match self.places[k] {
            Place::Kept(mesh, triangle) => Some((self.meshes[mesh as usize].mesh.as_ref()?, triangle)),
            Place::Resident(mesh, triangle) => Some((&self.residents[mesh as usize], triangle)),
            Place::Temporary(mesh, triangle) => Some((&self.temporary[mesh as usize], triangle)),
        }
    }
}

impl RayScene {
    /// Gets the members ready, on up to `threads` threads. Tessellates nothing yet, but for displaced primitives that
    /// do not say how far they move.
    pub(crate) fn build(
        set: u32,
        members: &[u32],
        shaders: &dyn GridShaders,
        threads: usize,
        motion: bool,
    ) -> Self {
        let seen = shaders.seen();
        let next = AtomicUsize::new(0);
        let made: Mutex<Vec<(usize, Member)>> = Mutex::default();
        let work = || {
            let mut thread = shaders.thread();
            while let Some(member) = members.get(next.fetch_add(1, Ordering::Relaxed)) {
                let primitive = &seen.scene.primitives[*member as usize];
                let object = shaders.object(primitive);
                if let Some(ready) = mesh::prepare(primitive, &object, motion, &mut *thread) {
                    let k = *member as usize;
                    made.lock().unwrap_or_else(PoisonError::into_inner).push((k, ready));
                }
            }
        };
        std::thread::scope(|scope| {
            for _ in 1..threads.min(members.len()) {
                scope.spawn(work);
            }
            work();
        });
        let mut made = made.into_inner().unwrap_or_else(PoisonError::into_inner);
        made.sort_by_key(|m| m.0);
        let (mut flats, mut solids) = (Vec::new(), Vec::new());
        for (_, member) in made {
            match member {
                Member::Flat(flat) => flats.push(flat),
                Member::Solid(solid) => solids.push(solid),
            }
        }
        // First, so that hits at one distance have the same order whether they are resident or not.
        solids.sort_by_key(|solid: &Solid| !solid.is_small());
        let mut residents = Vec::new();
        let mut builder = TracerBuilder::new();
        flats.iter().for_each(|flat| _ = builder.add_triangles(flat));
        let small = || solids.iter().filter(|solid| solid.is_small());
        let bytes = small().map(|solid| solid.triangles() * TRIANGLE_BYTES).sum::<f32>();
        if bytes <= seen.cache.limit() as f32 * RESIDENT_SHARE {
            let mut thread = shaders.thread();
            for solid in small() {
                let (mesh, triangles) = solid.tessellate(0, Level::FINEST, &mut *thread).unwrap_or_default();
                builder.add(triangles);
                residents.push(mesh);
            }
        }
        let tracer = builder.build(threads);
        let each = solids.iter().enumerate().skip(residents.len());
        let parts: Vec<(u32, u32)> = each
            .clone()
            .flat_map(|(s, solid)| (0..solid.parts.len()).map(move |p| (s as u32, p as u32)))
            .collect();
        let bounds: Vec<Bound> = each.clone().flat_map(|(_, s)| s.parts.iter().map(|p| p.bound)).collect();
        let objects = || flats.iter().map(|f| &f.object).chain(solids.iter().map(|s| &s.object));
        Self {
            set,
            opaque_to_shadows: objects().all(|object| object.opaque_to_shadows),
            asks_parents: objects().any(|object| asks_parent(object)),
            rough: solids
                .iter()
                .map(|solid| std::ptr::from_ref::<ObjectState>(&solid.object).addr())
                .collect(),
            boxes: BoxTree::new(&bounds),
            tracer,
            flats,
            solids,
            residents,
            parts,
            areas: OnceLock::new(),
        }
    }

    /// Triangles of meshes that are as they are, and the bytes that these and all structures but tessellations take.
    pub(crate) fn size(&self) -> (u64, u64) {
        let triangles: usize = self.flats.iter().map(Flat::triangles).sum();
        let solids: usize = self.solids.iter().map(Solid::bytes).sum();
        let parts = self.parts.capacity() * size_of::<(u32, u32)>();
        let residents: usize = self.residents.iter().map(RayMesh::bytes).sum();
        let triangles = triangles + self.residents.iter().map(|m| m.triangles() as usize).sum::<usize>();
        (triangles as u64, (self.tracer.bytes() + self.boxes.bytes() + parts + solids + residents) as u64)
    }

    /// Whether rays meet an object about where it is only: a tessellation stands for its curved surface, or it is displaced for the
    /// camera but not for rays.
    pub(crate) fn is_rough(&self, object: &ObjectState) -> bool {
        self.rough.contains(&std::ptr::from_ref(object).addr())
            || object.displacement.is_some() && !object.displaces_rays() && !self.solids.is_empty()
    }

    /// Whether nothing is tessellated on demand: it does not matter how wide rays are.
    pub(crate) fn is_settled(&self) -> bool {
        self.parts.is_empty()
    }

    /// The object that was hit.
    pub(crate) fn object(&self, hit: &SetHit) -> &Arc<ObjectState> {
        match self.solid_of(hit.part) {
            Some(solid) => &self.solids[solid].object,
            None => &self.flats[hit.part as usize].object,
        }
    }

    /// Which primitive was hit: a number for sorting, and its identity.
    pub(crate) fn primitive(&self, hit: &SetHit) -> (u32, u32) {
        match self.solid_of(hit.part) {
            Some(solid) => ((self.flats.len() + solid) as u32, self.solids[solid].primitive.id),
            None => (hit.part, self.flats[hit.part as usize].primitive.id),
        }
    }

    /// Parts that are not made on demand.
    fn settled(&self) -> usize {
        self.flats.len() + self.residents.len()
    }

    /// Which solid a part is of.
    fn solid_of(&self, part: u32) -> Option<usize> {
        match self.solid(part) {
            Some((solid, _)) => Some(solid),
            None => (part as usize).checked_sub(self.flats.len()),
        }
    }

    /// Of a part that is made on demand: the solid, and which part of it.
    fn solid(&self, part: u32) -> Option<(usize, u32)> {
        let (solid, own) = *self.parts.get((part as usize).checked_sub(self.settled())?)?;
        Some((solid as usize, own))
    }

    /// A part that is made on demand, at a level.
    fn part(&self, thread: &mut dyn GridShader<'_>, part: u32, level: Level) -> Arc<Tessellation> {
        let cache = thread.seen().cache;
        cache.get(Key { set: self.set, part, level }, || {
            let solid = self.solid(part);
            let made = solid.and_then(|(solid, own)| self.solids[solid].tessellate(own, level, thread));
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
        thread: &mut dyn GridShader<'_>,
        hand: &'h mut AtHand,
        part: u32,
        level: Level,
    ) -> &'h Tessellation {
        // What one thread holds must not be much of what all may keep.
        if hand.bytes > thread.seen().cache.limit() / 16 {
            *hand = AtHand::default();
        }
        hand.made.entry((part, level)).or_insert_with(|| {
            let made = self.part(thread, part, level);
            hand.bytes += made.bytes();
            made
        })
    }

    /// Tells `passed` of the parts on a ray, nearest first, until it answers with a negative distance; otherwise it
    /// answers how far the ray still goes.
    fn along(
        &self,
        thread: &mut dyn GridShader<'_>,
        (hand, room): (&mut AtHand, &mut BoxRoom),
        (ray, [width, spread]): (&Ray, [f32; 2]),
        reach: f32,
        passed: &mut dyn FnMut(&Tracer, u32, Level) -> f32,
    ) {
        let ray = Ray { tmax: reach.min(ray.tmax), ..*ray };
        let mut known: Option<(u32, Level)> = None;
        self.boxes.visit(&ray, room, &mut |passage| {
            let (solid, _) = self.parts[passage.index as usize];
            let level = match known {
                Some((of, level)) if of == solid => level,
                _ => {
                    let own = &self.solids[solid as usize];
                    own.level(ray.origin, ray.dir, width, spread)
                }
            };
            known = Some((solid, level));
            let part = self.settled() as u32 + passage.index;
            let made = self.part_at_hand(thread, hand, part, level);
            passed(&made.tracer, part, level)
        });
    }

    /// The closest hit of each ray.
    pub(crate) fn closest(&self, thread: &mut dyn GridShader<'_>, requests: &[RayRequest]) -> Vec<SetHit> {
        let rays: Vec<Ray> = requests.iter().map(|r| beyond(&r.ray, r.leaving)).collect();
        let mut hits: Vec<SetHit> = self.closest_of_settled(&rays).iter().map(SetHit::of).collect();
        let widths = |k: usize| requests[k].widths();
        self.closest_of_parts(thread, &rays, &widths, &mut hits);
        for (request, hit) in requests.iter().zip(&mut hits) {
            let near = self.near(thread, &request.ray, request.leaving, request.widths());
            if near.is_hit() {
                *hit = near;
            }
        }
        hits
    }

    /// The closest hit of a ray before the margin of what it leaves, which is of something else.
    fn near(
        &self,
        thread: &mut dyn GridShader<'_>,
        ray: &Ray,
        leaving: Leaving,
        [width, spread]: [f32; 2],
    ) -> SetHit {
        let margin = leaving.margin();
        if margin <= ray.tmin {
            return SetHit::MISS;
        }
        let ray = Ray { tmax: margin.min(ray.tmax), ..*ray };
        let request = RayRequest { lane: 0, name: 0, ray, leaving, width, spread };
        self.closest_where(thread, &request, &mut |hit| !leaving.hides(self.object(hit), hit.t))
    }

    fn closest_of_settled(&self, rays: &[Ray]) -> Vec<Hit> {
        let mut hits = vec![Hit::MISS; rays.len()];
        self.tracer.closest(rays, &mut hits);
        hits
    }

    /// Puts nearer hits of what is made on demand in the place of others.
    fn closest_of_parts(
        &self,
        thread: &mut dyn GridShader<'_>,
        rays: &[Ray],
        widths: &dyn Fn(usize) -> [f32; 2],
        hits: &mut [SetHit],
    ) {
        if self.parts.is_empty() {
            return;
        }
        let (mut hand, mut boxes, mut room) = (AtHand::default(), BoxRoom::default(), RayRoom::default());
        for (k, (whole, best)) in rays.iter().zip(hits).enumerate() {
            let along = (whole, widths(k));
            self.along(thread, (&mut hand, &mut boxes), along, best.t, &mut |tracer, part, level| {
                let ray = Ray { tmax: best.t.min(whole.tmax), ..*whole };
                let hit = tracer.closest_of_one(&ray, &mut room);
                if hit.is_hit() {
                    let hit = SetHit { part, level, ..SetHit::flat(&hit) };
                    if hit.t < best.t || hit.t == best.t && hit.order() < best.order() {
                        *best = hit;
                    }
                }
                best.t
            });
        }
    }

    /// How far each ray goes; infinite where it meets nothing. `widths` as [`RayRequest::widths`] and what it leaves, by number.
    pub(crate) fn distances(
        &self,
        thread: &mut dyn GridShader<'_>,
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

    /// Whether each ray hits anything; as [`RayScene::distances`].
    pub(crate) fn any(
        &self,
        thread: &mut dyn GridShader<'_>,
        rays: &[Ray],
        widths: &dyn Fn(usize) -> [f32; 2],
        leaving: &dyn Fn(usize) -> Leaving,
    ) -> Vec<bool> {
        let far: Vec<Ray> = rays.iter().enumerate().map(|(k, ray)| beyond(ray, leaving(k))).collect();
        let mut blocked = vec![false; rays.len()];
        self.tracer.any(&far, &mut blocked);
        if !self.parts.is_empty() {
            let (mut hand, mut boxes, mut room) = (AtHand::default(), BoxRoom::default(), RayRoom::default());
            for (k, (ray, blocked)) in far.iter().zip(&mut blocked).enumerate().filter(|(_, (_, b))| !**b) {
                let along = (ray, widths(k));
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

    /// The closest hit that `accept` lets pass; it is asked about some of the hits, in no particular order, about each at
    /// most once, and must answer by the hit alone.
    pub(crate) fn closest_where(
        &self,
        thread: &mut dyn GridShader<'_>,
        request: &RayRequest,
        accept: &mut dyn FnMut(&SetHit) -> bool,
    ) -> SetHit {
        let hit = self.tracer.closest_where(&request.ray, &mut |h| accept(&SetHit::flat(h)));
        let mut best = SetHit::of(&hit);
        if self.parts.is_empty() {
            return best;
        }
        let (mut hand, mut boxes) = (AtHand::default(), BoxRoom::default());
        let along = (&request.ray, request.widths());
        self.along(thread, (&mut hand, &mut boxes), along, best.t, &mut |tracer, part, level| {
            let ray = Ray { tmax: best.t.min(request.ray.tmax), ..request.ray };
            let of_part = |h: &Hit| SetHit { part, level, ..SetHit::flat(h) };
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

    /// The meshes of some hits.
    pub(crate) fn locate(&self, thread: &mut dyn GridShader<'_>, hits: &[SetHit]) -> Located<'_> {
        let residents = &self.residents[..];
        let mut located = Located {
            residents,
            meshes: Vec::new(),
            temporary: Vec::new(),
            places: Vec::with_capacity(hits.len()),
        };
        let mut kept: FxHashMap<(u32, Level), u32> = FxHashMap::default();
        let mut flats: FxHashMap<u32, HitFacets> = FxHashMap::default();
        for (k, hit) in hits.iter().enumerate() {
            // Hits come in order: mostly they are where the one before was.
            let before = k.checked_sub(1).map(|k| (&hits[k], located.places[k]));
            if let Some(place) = before.and_then(|(before, place)| place.next_to(before, hit)) {
                located.places.push(place);
            } else if self.solid(hit.part).is_some() {
                let mesh = *kept.entry((hit.part, hit.level)).or_insert_with(|| {
                    located.meshes.push(self.part(thread, hit.part, hit.level));
                    located.meshes.len() as u32 - 1
                });
                located.places.push(Place::Kept(mesh, hit.triangle));
            } else if let Some(k) = (hit.part as usize).checked_sub(self.flats.len()) {
                located.places.push(Place::Resident(k as u32, hit.triangle));
            } else {
                let mesh = flats.len() as u32;
                let flat = flats.entry(hit.part).or_insert(HitFacets { mesh, ..HitFacets::default() });
                let facet = *flat.known.entry(hit.triangle / 2).or_insert_with(|| {
                    flat.facets.push(hit.triangle / 2);
                    flat.facets.len() as u32 - 1
                });
                located.places.push(Place::Temporary(flat.mesh, 2 * facet + hit.triangle % 2));
            }
        }
        let mut flats: Vec<(u32, HitFacets)> = flats.into_iter().collect();
        flats.sort_unstable_by_key(|(_, flat)| flat.mesh);
        let mesh_of =
            |(part, flat): &(u32, HitFacets)| self.flats[*part as usize].mesh_of(&flat.facets, thread);
        located.temporary = flats.iter().filter_map(mesh_of).collect();
        located
    }

    /// Points at fractions of the area of all surfaces, at barycentric coordinates of their triangles, and the normals
    /// there. `None` without any area.
    pub(crate) fn area_points(
        &self,
        thread: &mut dyn GridShader<'_>,
        places: &[(f32, f32, f32)],
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
        if self.settled() == areas.flats.len() && self.parts.is_empty() {
            for &(fraction, b1, b2) in places {
                let (part, triangle) = areas.table.at(fraction)?;
                out.push(of_mesh(&areas.flats[part as usize], triangle, (b1, b2)));
            }
            return Some(out);
        }
        let mut hits = Vec::with_capacity(places.len());
        for &(fraction, b1, b2) in places {
            let (part, triangle) = areas.table.at(fraction)?;
            hits.push(SetHit { t: 0.0, b1, b2, part, triangle, level: Level::FINEST });
        }
        let located = self.locate(thread, &hits);
        for (k, hit) in hits.iter().enumerate() {
            let (mesh, triangle) = located.get(k)?;
            out.push(of_mesh(mesh, triangle, (hit.b1, hit.b2)));
        }
        Some(out)
    }

    fn areas(&self, thread: &mut dyn GridShader<'_>) -> Areas {
        let all = |flat: &Flat| (0..flat.facets() as u32).collect::<Vec<u32>>();
        let few = self.flats.iter().map(Flat::facets).sum::<usize>() <= FEW_FACETS;
        let flats = self.flats.iter().filter(|_| few).map(|flat| flat.mesh_of(&all(flat), thread));
        let flats = flats.collect::<Option<Vec<RayMesh>>>().unwrap_or_default();
        Areas { table: self.area_table(thread), flats }
    }

    /// Areas of all triangles at the finest level.
    fn area_table(&self, thread: &mut dyn GridShader<'_>) -> AreaTable {
        use granita_trace::Triangles;
        let mut table = AreaTable::default();
        for (part, flat) in self.flats.iter().enumerate() {
            for t in 0..flat.count() {
                if let Some([a, b, c]) = flat.triangle(t) {
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
            add(self.flats.len() + k, mesh);
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

/// A ray from where all that it may hit counts.
fn beyond(ray: &Ray, leaving: Leaving) -> Ray {
    Ray { tmin: ray.tmin.max(leaving.margin()), ..*ray }
}

/// A hit as a place in the world.
pub(crate) fn mesh_hit(request: &RayRequest, hit: &SetHit, triangle: u32) -> MeshHit {
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
