// tidy: long: tessellations of one part at three levels must agree at their edges to the bit
//! Parts of primitives, and the tessellation of a part for rays.
//!
//! An [`OnDemandMesh`] is a primitive that is tessellated as rays need it. Its parts are small enough to be
//! tessellated, cached and evicted one by one, each at any [`Level`]. All parts at one level together are as
//! watertight as the primitive diced at once, because a part is always reached by the same splits, with the same
//! settled sides.

use super::{Quad, RayData, RayMesh, RayPrimvar};
use crate::convex::ConvexSurface;
use crate::{GridShader, RayDisplacement, RayObject};
use granita_base::{Bound, Interp, MotionTransform, ParamData, Severity, Vec3};
use granita_dicing::{
    self, CameraView, DiceSettings, GridView, Measure, Placement, Rates, SceneDicing, Viewer, Viewpoint,
};
use granita_geom::{Dice, Piece, ShapeKey, SplitDirection, Surface};
use granita_scene::{Primitive, attr};
use granita_shade::{Grid, PrimvarData, RayKind};
use granita_trace::{TriangleMesh, Triangles};
use std::sync::Arc;

/// The largest deviation of the finest tessellation from the surface, in pixels of the camera.
pub const FLATNESS_PX: f32 = 0.1;
/// The largest turning angle between segments of the finest tessellation, in degrees.
const CURVATURE_DEG: f32 = 10.0;
/// The number of points of a grid: 64 segments in each direction.
const GRID_POINTS: usize = 65 * 65;
/// The approximate number of triangles of a part at the finest level.
const PART_TRIANGLES: f32 = 4096.0;
/// The largest number of nested splits. A piece that would need more splits is part of a part.
const MAX_SPLITS: usize = 40;
/// A triangle that no ray hits.
const NO_TRIANGLE: [u32; 3] = [u32::MAX; 3];
/// The padding around parts of points and curves, which turn towards the camera, relative to their size.
const TURNING_ROOM: f32 = 0.1;

/// How finely a primitive is tessellated. At level `k` the micropolygons may be `4^k` times as large as at level 0,
/// or the deviation from the surface may be `4^k` times as large. Level 0 is as fine as the camera's grids.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Level(u8);

impl Level {
    /// The finest level.
    pub const FINEST: Self = Self(0);
    /// All levels, the finest first.
    ///
    /// A coarser level than these would have parts of less than a micropolygon, whose corners would coincide.
    pub const ALL: [Self; 3] = [Self(0), Self(1), Self(2)];

    /// Returns the level for a ray of a width in pixels of the camera. Micropolygons are not larger than the ray is
    /// wide.
    pub fn for_width(width_px: f32) -> Self {
        // NaN compares false and gives the finest level.
        let fits = |level: &&Self| width_px >= level.scale();
        *Self::ALL[1..].iter().rev().find(fits).unwrap_or(&Self::FINEST)
    }

    /// The factor by which micropolygons are larger than at level 0.
    pub fn scale(self) -> f32 {
        f32::from(1_u16 << (2 * self.0))
    }
}

/// One split on the path from a root to a part of it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Step {
    direction: SplitDirection,
    child: u32,
}

/// A part of an on-demand mesh.
#[derive(Debug)]
pub struct Part {
    /// The index of the root piece.
    root: u32,
    /// The splits that lead from the root to the part.
    path: Box<[Step]>,
    /// The box around the part in world space at all times, displacement included.
    pub bound: Bound,
}

/// A primitive that is tessellated when rays need it.
pub struct OnDemandMesh<O> {
    /// The primitive.
    pub primitive: Arc<Primitive>,
    /// The state of its object.
    pub object: Arc<O>,
    placement: Placement,
    /// The pieces that are the same at every level.
    roots: Vec<Piece>,
    settings: DiceSettings,
    displaced: bool,
    /// The parts, in the order of the surface.
    pub parts: Vec<Part>,
    /// The box around the primitive in world space at all times, displacement included.
    pub bound: Bound,
    /// The size of a pixel of the camera, in world units, at the point of the box that is farthest from the camera.
    pixel_world: f32,
    /// The approximate number of triangles at the finest level.
    triangles: f32,
    /// The surface, when it is known to be convex.
    pub(crate) convex: Option<Box<ConvexSurface>>,
}

/// A mesh of flat faces that neither moves nor is displaced. Rays are traced against its own triangles.
pub struct StaticMesh<O> {
    /// The primitive.
    pub primitive: Arc<Primitive>,
    /// The state of its object.
    pub object: Arc<O>,
    placement: Placement,
    piece: Piece,
}

/// A primitive as a member of a geometry set.
pub enum Member<O> {
    /// A mesh that is traced as it is.
    StaticMesh(StaticMesh<O>),
    /// A primitive that is tessellated on demand.
    OnDemandMesh(OnDemandMesh<O>),
}

/// Prepares a primitive for rays, with motion keys when `motion` is true. Returns `None` for a primitive without a
/// surface, for one that does not exist while the shutter is open, and for one that cannot be built (which is
/// reported).
pub fn prepare<O: RayObject>(
    primitive: &Arc<Primitive>,
    object: &Arc<O>,
    motion: bool,
    thread: &mut dyn GridShader<'_, O>,
) -> Option<Member<O>> {
    let frame = thread.ray_frame();
    let (camera, reporter) = (frame.camera, frame.reporter);
    let attributes = &primitive.attributes;
    let keys: Vec<ShapeKey<'_>> =
        primitive.keys.iter().map(|k| ShapeKey { time: k.time, params: &k.params }).collect();
    let mut report = |severity: Severity, text: String| {
        let text =
            if object.name().is_empty() { text } else { format!("object \"{}\": {text}", object.name()) };
        reporter.once(&format!("primitive {} {text}", primitive.id), severity, &primitive.at, text);
    };
    let dicing = SceneDicing::new(frame.scene);
    let trim = granita_dicing::trimming(attributes, dicing.trim_quality);
    let mut pieces = match granita_geom::build(&primitive.shape, &keys, trim, &mut report) {
        Ok(pieces) => pieces,
        Err(error) => {
            report(Severity::Error, error.to_string());
            return None;
        }
    };
    let shutter = if motion { camera.shutter } else { [camera.shading_time(); 2] };
    let alive = camera.existence(primitive, shutter)?;
    let shape_times = pieces.first().map_or(&[][..], |p| p.key_times()).to_vec();
    let still: [&MotionTransform; 0] = [];
    let mut placement = Placement::new(&attributes.to_world, &shape_times, &still, alive);
    placement
        .look_from(std::iter::once(camera), granita_dicing::largest_coordinates(pieces.iter().map(|p| &**p)));
    let displaced = matches!(object.displacement(), RayDisplacement::Moves { .. });
    // Hits of faces with different strings cannot share a grid. The parts of an on-demand mesh keep the strings
    // apart.
    let many_strings = primitive.keys[0]
        .params
        .iter()
        .any(|p| p.ty.interp == Interp::PerPiece && matches!(p.data, ParamData::String(_)));
    let static_mesh = !displaced && !many_strings && placement.times().len() == 1;
    if static_mesh && pieces.len() == 1 && pieces[0].facets() > 0 {
        let (primitive, object) = (primitive.clone(), object.clone());
        let piece = pieces.remove(0);
        return Some(Member::StaticMesh(StaticMesh { primitive, object, placement, piece }));
    }
    let moves = displaced || placement.times().len() != 1;
    let at = attributes.to_world.at(camera.shading_time());
    let convex = ConvexSurface::new(primitive, &at, moves).map(Box::new);
    let mut on_demand = OnDemandMesh {
        primitive: primitive.clone(),
        object: object.clone(),
        placement,
        roots: Vec::new(),
        settings: ray_settings(DiceSettings::new(attributes, &dicing, camera), displaced),
        displaced,
        parts: Vec::new(),
        bound: Bound::EMPTY,
        pixel_world: 0.0,
        triangles: 0.0,
        convex,
    };
    let most = dicing.most_points();
    // Each point has at least two triangles.
    on_demand.divide(pieces, camera, 2.0 * most as f32);
    if on_demand.triangles > 2.0 * most as f32 {
        report(
            Severity::Error,
            format!(
                "its {} needs more than {most} points and is left out for rays; lower \"shadingquality\", or raise \"limits:primitivepoints\"",
                on_demand.primitive.shape.call_name()
            ),
        );
        return None;
    }
    on_demand.find_bounds(thread);
    (!on_demand.parts.is_empty()).then_some(Member::OnDemandMesh(on_demand))
}

/// Returns the settings with which a primitive is diced for rays, from those for the camera.
fn ray_settings(settings: DiceSettings, displaced: bool) -> DiceSettings {
    if displaced {
        return settings;
    }
    // Rays need only the shape, because the shader is evaluated at the hit.
    DiceSettings {
        gridsize: GRID_POINTS,
        fixed: None,
        motionfactor: 0.0,
        binary: true,
        curvature: CURVATURE_DEG.to_radians(),
        ..settings
    }
}

/// Returns a slightly larger box, because positions are rounded in the transform to world space.
fn rounded(bound: Bound) -> Bound {
    if bound.is_empty() {
        return bound;
    }
    bound.padded(4e-6 * bound.min.abs().max(bound.max.abs()).max_element())
}

impl<O: RayObject> OnDemandMesh<O> {
    /// True when the mesh is a single part of few triangles that no shader displaces. One level suffices for it.
    pub fn is_small(&self) -> bool {
        !self.displaced && self.parts.len() == 1 && self.triangles <= PART_TRIANGLES
    }

    /// The approximate number of triangles at the finest level.
    pub fn triangles(&self) -> f32 {
        self.triangles
    }

    /// Returns the level at which a ray sees the mesh. It follows from the width of the ray where it enters the box.
    /// The level is the finest for rays that start inside of the box and for small meshes.
    pub fn level(&self, origin: Vec3, dir: Vec3, width: f32, spread: f32) -> Level {
        let (a, b) = ((self.bound.min - origin) / dir, (self.bound.max - origin) / dir);
        let enters = a.min(b).max_element();
        if !self.is_small() && enters > 0.0 && enters.is_finite() && self.pixel_world > 0.0 {
            Level::for_width((width + spread * enters) / self.pixel_world)
        } else {
            Level::FINEST
        }
    }

    /// The size of a pixel of the camera, in world units, that ray widths are compared with.
    #[cfg(test)]
    pub fn pixel(&self) -> f32 {
        self.pixel_world
    }

    /// The number of bytes of memory without tessellations and control vertices.
    pub fn bytes(&self) -> usize {
        self.parts.capacity() * size_of::<Part>()
            + self.parts.iter().map(|p| p.path.len() * size_of::<Step>()).sum::<usize>()
    }

    fn measure<'a>(&self, camera: &'a CameraView, level: Level) -> (Measure<'a>, DiceSettings) {
        let mut settings = self.settings.clone();
        let scale = level.scale();
        settings.curvature *= scale.sqrt();
        if self.displaced {
            // Displaced surfaces must be sampled as finely as for the camera.
            settings.quality /= scale;
            (Measure::by_distance(camera), settings)
        } else {
            (Measure::by_flatness(camera, FLATNESS_PX * scale), settings)
        }
    }

    /// Divides the pieces into parts.
    fn divide(&mut self, pieces: Vec<Piece>, camera: &CameraView, most: f32) {
        let mut division = Division {
            displacement: match self.object.displacement() {
                RayDisplacement::Moves { bound_world } => bound_world,
                _ => 0.0,
            },
            placement: &self.placement,
            camera,
            measures: Level::ALL.map(|level| self.measure(camera, level)),
            roots: Vec::new(),
            parts: Vec::new(),
            triangles: 0.0,
            most,
        };
        for piece in pieces {
            if let Some((piece, _)) = division.run(piece) {
                division.add_root(piece);
            }
        }
        let Division { roots, parts, triangles, .. } = division;
        (self.roots, self.parts, self.triangles) = (roots, parts, triangles);
    }

    /// Finds the box around the mesh, and the size of a pixel there.
    fn find_bounds(&mut self, thread: &mut dyn GridShader<'_, O>) {
        if self.object.displacement() == (RayDisplacement::Moves { bound_world: 0.0 }) {
            // No attribute bounds the displacement, so the parts are tessellated once to find their boxes.
            for k in 0..self.parts.len() {
                let bound = self.tessellate(k as u32, Level::FINEST, thread).map_or(Bound::EMPTY, |made| {
                    Bound::around(made.1.positions.iter().flatten().copied().filter(|p| p.is_finite()))
                });
                self.parts[k].bound = rounded(bound);
            }
        }
        self.bound = self.parts.iter().fold(Bound::EMPTY, |all, part| all.union(part.bound));
        let frame = thread.ray_frame();
        self.pixel_world = self.bound.corners().iter().map(|corner| frame.pixel(*corner)).fold(0.0, f32::max);
    }

    /// Tessellates a part. Returns `None` when it has no surface.
    pub fn tessellate(
        &self,
        part: u32,
        level: Level,
        thread: &mut dyn GridShader<'_, O>,
    ) -> Option<(RayMesh, TriangleMesh)> {
        let camera = thread.ray_frame().camera;
        let (measure, settings) = self.measure(camera, level);
        let part = &self.parts[part as usize];
        let root = &*self.roots[part.root as usize];
        let mut found: Option<Piece> = None;
        for step in &*part.path {
            let piece = found.as_deref().unwrap_or(root);
            let children = measure.split(piece, &self.placement, &settings, step.direction);
            found = Some(children.into_iter().nth(step.child as usize)?);
        }
        let piece = found.as_deref().unwrap_or(root);
        let mut build = Builder::new(&self.primitive, &*self.object, &self.placement, camera);
        granita_dicing::tessellate(piece, &self.placement, &measure, &settings, &mut |piece, rates| {
            build.add(piece, rates, self.displaced, thread);
        });
        build.finish()
    }
}

impl<O: RayObject> StaticMesh<O> {
    /// The number of facets.
    pub fn facets(&self) -> usize {
        self.piece.facets()
    }

    /// The number of triangles.
    pub fn triangles(&self) -> usize {
        (0..self.count()).filter(|t| self.triangle(*t).is_some()).count()
    }

    /// Returns a mesh of the given facets, two triangles each, in their order.
    pub fn mesh_of(&self, facets: &[u32], thread: &mut dyn GridShader<'_, O>) -> Option<RayMesh> {
        let mut build =
            Builder::new(&self.primitive, &*self.object, &self.placement, thread.ray_frame().camera);
        let rates = Rates { nu: 2, nv: 2, ..Rates::default() };
        for facet in facets {
            let piece = self.piece.facet_piece(*facet as usize)?;
            build.add(&*piece, &rates, false, thread);
        }
        build.mesh.number_strings();
        Some(build.mesh)
    }
}

impl<O: RayObject> Triangles for StaticMesh<O> {
    fn count(&self) -> usize {
        2 * self.facets()
    }

    fn triangle(&self, triangle: usize) -> Option<[Vec3; 3]> {
        let to_world = self.placement.to_world.at(self.placement.times()[0]);
        let corners = self.piece.facet(triangle / 2, 0);
        let [a, b, c] =
            Quad { corner: 0, stride: 2, piece: 0 }.triangles()[triangle % 2].map(|v| corners[v as usize]);
        // A facet of three corners has one triangle.
        (a != b && b != c && c != a).then(|| [a, b, c].map(|p| to_world.point(p)))
    }
}

/// An on-demand mesh while it is divided into parts.
struct Division<'a> {
    displacement: f32,
    placement: &'a Placement,
    camera: &'a CameraView,
    /// The measure and settings of each level.
    measures: [(Measure<'a>, DiceSettings); Level::ALL.len()],
    roots: Vec<Piece>,
    parts: Vec<Part>,
    /// The number of triangles so far of all pieces that are not divided further.
    triangles: f32,
    /// The limit of `triangles`. Pieces beyond it are not divided further.
    most: f32,
}

impl Division<'_> {
    /// Divides a piece. Returns the piece and its number of triangles when it is small enough to be part of a larger
    /// part.
    fn run(&mut self, piece: Piece) -> Option<(Piece, f32)> {
        // A piece of several faces, curves or particles splits in the same way at all levels.
        let parts_alike = piece.must_split() && (0..4).all(|side| piece.side(side).is_none());
        if parts_alike && piece.is_splittable() {
            let mut small = Vec::new();
            let (mut all, mut sum) = (true, 0.0);
            for child in piece.split(SplitDirection::U) {
                match self.run(child) {
                    Some((child, triangles)) => {
                        sum += triangles;
                        small.push(child);
                    }
                    None => all = false,
                }
            }
            if all && sum <= PART_TRIANGLES {
                return Some((piece, sum));
            }
            small.into_iter().for_each(|child| self.add_root(child));
            return None;
        }
        let first = self.parts.len();
        match self.inside([&*piece; Level::ALL.len()], &mut Vec::new()) {
            Some(triangles) => Some((piece, triangles)),
            None => {
                let root = self.roots.len() as u32;
                self.parts[first..].iter_mut().for_each(|part| part.root = root);
                self.roots.push(piece);
                None
            }
        }
    }

    /// Makes a piece a root with a single part.
    fn add_root(&mut self, piece: Piece) {
        self.add_part([&*piece; Level::ALL.len()], &[]);
        let root = self.roots.len() as u32;
        self.parts.iter_mut().rev().take(1).for_each(|part| part.root = root);
        self.roots.push(piece);
    }

    /// Divides the piece at the end of a path, given as it is at each level. Returns its number of triangles when it
    /// is small.
    fn inside(&mut self, pieces: [&dyn Surface; Level::ALL.len()], path: &mut Vec<Step>) -> Option<f32> {
        let piece = pieces[0];
        let must_split = piece.must_split();
        let (measure, settings) = &self.measures[0];
        // The rates of a piece that must be split are undefined.
        let [u, v] = if must_split { [1.0; 2] } else { measure.asked(piece, self.placement, settings) };
        let triangles = 2.0 * u.ceil() * v.ceil();
        let small = !must_split && triangles <= PART_TRIANGLES;
        if small || !piece.is_splittable() || path.len() >= MAX_SPLITS || self.triangles > self.most {
            self.triangles += triangles;
            return Some(triangles);
        }
        let direction = if u >= v { SplitDirection::U } else { SplitDirection::V };
        let children: [Vec<Piece>; Level::ALL.len()] = std::array::from_fn(|level| {
            let (measure, settings) = &self.measures[level];
            measure.split(pieces[level], self.placement, settings, direction)
        });
        let child_of = |child: usize| -> Option<[&dyn Surface; Level::ALL.len()]> {
            let [a, b, c] = [0, 1, 2].map(|level: usize| children[level].get(child));
            Some([&**a?, &**b?, &**c?])
        };
        let first = self.parts.len();
        let (mut sum, mut small) = (0.0, Vec::new());
        for child in 0..children[0].len() {
            let Some(pieces) = child_of(child) else { continue };
            path.push(Step { direction, child: child as u32 });
            match self.inside(pieces, path) {
                Some(triangles) => {
                    sum += triangles;
                    small.push((child, pieces));
                }
                None => sum = f32::INFINITY,
            }
            path.pop();
        }
        if self.parts.len() == first && sum <= PART_TRIANGLES {
            return Some(sum);
        }
        for (child, pieces) in small {
            path.push(Step { direction, child: child as u32 });
            self.add_part(pieces, path);
            path.pop();
        }
        None
    }

    /// Makes a piece a part. The settled sides of the piece, and with them its box, differ between the levels.
    fn add_part(&mut self, pieces: [&dyn Surface; Level::ALL.len()], path: &[Step]) {
        let piece = pieces[0];
        let mut bound = Bound::EMPTY;
        for &time in self.placement.times() {
            let of_levels = pieces.iter().map(|piece| Placement::object_bound(*piece, time));
            let mut own = of_levels.fold(Bound::EMPTY, Bound::union);
            if own.is_empty() {
                continue;
            }
            if piece.is_facing() {
                own = own.padded((own.max - own.min).length() * TURNING_ROOM);
            }
            bound = bound.union(own.transformed(&self.placement.to_world.at(time)));
        }
        if !bound.is_empty() {
            let raster = piece.raster_width();
            if raster > 0.0 {
                let eye = self.camera.position_world();
                let far = bound.corners().iter().map(|c| eye.distance(*c)).fold(self.camera.near, f32::max);
                bound = bound.padded(raster / self.camera.raster_scale(far).abs().max_element());
            }
            bound = bound.padded(self.displacement);
        }
        self.parts.push(Part { root: 0, path: path.into(), bound: rounded(bound) });
    }
}

/// A tessellation under construction.
struct Builder<'a, O> {
    primitive: &'a Primitive,
    object: &'a O,
    camera: &'a CameraView,
    placement: &'a Placement,
    mesh: RayMesh,
    triangles: TriangleMesh,
    pieces: u32,
}

impl<'a, O: RayObject> Builder<'a, O> {
    fn new(
        primitive: &'a Primitive,
        object: &'a O,
        placement: &'a Placement,
        camera: &'a CameraView,
    ) -> Self {
        let times = placement.times().to_vec();
        Self {
            primitive,
            object,
            camera,
            placement,
            mesh: RayMesh {
                quads: Vec::new(),
                p: Vec::new(),
                n: Vec::new(),
                ng: Vec::new(),
                dpdu: Vec::new(),
                dpdv: Vec::new(),
                uv: Vec::new(),
                primvars: Vec::new(),
                string_set: Vec::new(),
                string_keys: Vec::new(),
                flat_faces: false,
            },
            triangles: TriangleMesh {
                positions: vec![Vec::new(); times.len()],
                times,
                triangles: Vec::new(),
            },
            pieces: 0,
        }
    }

    fn finish(self) -> Option<(RayMesh, TriangleMesh)> {
        let Self { mut mesh, mut triangles, .. } = self;
        mesh.number_strings();
        mesh.shrink();
        triangles.positions.iter_mut().for_each(Vec::shrink_to_fit);
        triangles.triangles.shrink_to_fit();
        (!triangles.triangles.is_empty()).then_some((mesh, triangles))
    }

    fn add(
        &mut self,
        piece: &dyn Surface,
        rates: &Rates,
        displaced: bool,
        thread: &mut dyn GridShader<'_, O>,
    ) {
        let key_times = piece.key_times();
        let dice: Dice = rates.dice(piece, &Viewer::new(self.camera, self.placement, key_times));
        let (nu, nv) = (dice.nu, dice.nv);
        if nu < 2 || nv < 2 {
            return;
        }
        let view = GridView {
            viewpoint: Viewpoint::From(self.camera.position_world()),
            time: self.triangles.times[0],
            dtime: 0.0,
            ray: RayKind::default(),
        };
        let mut grid = granita_dicing::make_grid(&dice, key_times, self.primitive, self.placement, &view);
        let before = grid.p.clone();
        if displaced {
            thread.displace_for_rays(self.object, &mut grid);
        }
        let first = self.mesh.p.len();
        let count = nu * nv;
        for (time, out) in self.triangles.times.iter().zip(&mut self.triangles.positions) {
            let to_world = self.placement.to_world.at(*time);
            let points = granita_dicing::points_at(&dice.p, key_times, *time, &to_world);
            out.extend(points.iter().enumerate().map(|(i, p)| *p + (grid.p.get(i) - before.get(i))));
        }
        let mesh = &mut self.mesh;
        mesh.flat_faces |= grid.lift.is_some() && !displaced;
        for i in 0..count {
            mesh.p.push(grid.p.get(i));
            // The lengths of normals have no meaning, but they would weigh the normals in the interpolation.
            mesh.n.push(grid.n.get(i).normalize_or_zero());
            mesh.ng.push(grid.ng.get(i).normalize_or_zero());
            mesh.dpdu.push(grid.dpdu.get(i));
            mesh.dpdv.push(grid.dpdv.get(i));
            mesh.uv.push([grid.u[i], grid.v[i]]);
        }
        let strings = add_primvars(mesh, &grid, self.pieces);
        mesh.string_set.push(strings);
        let kept_value = &*self.primitive.attributes.get(attr::TRIMCURVE_SENSE) != "outside";
        let mask = dice.mask.as_ref().map(|mask| mask.micropolygons(nu));
        for j in 0..nv - 1 {
            for i in 0..nu - 1 {
                if mask.as_ref().is_some_and(|m| m[j * (nu - 1) + i] != kept_value) {
                    continue;
                }
                let quad =
                    Quad { corner: (first + j * nu + i) as u32, stride: nu as u32, piece: self.pieces };
                mesh.quads.push(quad);
                for triangle in quad.triangles() {
                    let one_place = |a: usize, b: usize| {
                        let at = |positions: &Vec<Vec3>| {
                            positions[triangle[a] as usize] == positions[triangle[b] as usize]
                        };
                        self.triangles.positions.iter().all(at)
                    };
                    // Sides with fewer points than their grid have triangles without an area, which no ray may hit.
                    let line = one_place(0, 1) || one_place(1, 2) || one_place(2, 0);
                    self.triangles.triangles.push(if line { NO_TRIANGLE } else { triangle });
                }
            }
        }
        self.pieces += 1;
    }
}

/// Appends a grid's variables to a mesh, and returns the index of its combination of strings.
///
/// All pieces of a primitive have the same variables. A variable that is uniform in the first piece and varying in
/// another takes the value at the first point of that piece.
fn add_primvars(mesh: &mut RayMesh, grid: &Grid, piece: u32) -> u32 {
    let n = grid.len();
    if piece == 0 {
        mesh.primvars = grid
            .primvars
            .iter()
            .map(|v| RayPrimvar {
                name: v.name.clone(),
                ty: v.ty,
                data: match &v.data {
                    PrimvarData::Floats { varying: true, .. } => RayData::Vertex(Vec::new()),
                    PrimvarData::Floats { varying: false, .. } => RayData::Piece(Vec::new()),
                    PrimvarData::Strings(_) => RayData::Strings(Vec::new()),
                },
            })
            .collect();
    }
    let mut strings: Vec<&[Arc<str>]> = Vec::new();
    for var in &mut mesh.primvars {
        let width = var.ty.width();
        let found = grid.primvars.iter().find(|v| v.name == var.name).map(|v| &v.data);
        match (&mut var.data, found) {
            (RayData::Vertex(out), Some(PrimvarData::Floats { values, varying })) => {
                let at = |c: usize, i: usize| if *varying { values[c * n + i] } else { values[c] };
                out.extend((0..n).flat_map(|i| (0..width).map(move |c| at(c, i))));
            }
            (RayData::Vertex(out), _) => out.extend(std::iter::repeat_n(0.0, n * width)),
            (RayData::Piece(out), Some(PrimvarData::Floats { values, varying })) => {
                out.extend((0..width).map(|c| if *varying { values[c * n] } else { values[c] }));
            }
            (RayData::Piece(out), _) => out.extend(std::iter::repeat_n(0.0, width)),
            (RayData::Strings(_), Some(PrimvarData::Strings(values))) => strings.push(values),
            (RayData::Strings(_), _) => strings.push(&[]),
        }
    }
    // Searches the known combinations. The combination is nearly always the last or the only one.
    let string_vars = || {
        mesh.primvars.iter().filter_map(|v| match &v.data {
            RayData::Strings(sets) => Some(sets),
            _ => None,
        })
    };
    let known = string_vars().map(Vec::len).next().unwrap_or(0);
    if strings.is_empty() {
        return 0;
    }
    let same = |set: &usize| string_vars().zip(&strings).all(|(sets, s)| sets[*set] == **s);
    if let Some(set) = (0..known).rev().find(same) {
        return set as u32;
    }
    let own: Vec<Vec<Arc<str>>> = strings.iter().map(|s| s.to_vec()).collect();
    let mut own = own.into_iter();
    for var in &mut mesh.primvars {
        if let RayData::Strings(sets) = &mut var.data {
            sets.extend(own.next());
        }
    }
    known as u32
}
