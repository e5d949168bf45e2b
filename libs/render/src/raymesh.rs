//! Primitives tessellated for rays, and hits made into grids.
//!
//! A primitive is split and diced as for the camera, but by flatness: rays need the shape, the shader is
//! evaluated at the hit. Only what displacement shaders move is diced finely. Everything is in world
//! space at the time of shading; positions have further keys when rays see motion.

use crate::CameraView;
use crate::dicing::{self, DiceSettings, GridView, Leaf, Measure, Placement, Viewer, Viewpoint};
use crate::object::ObjectState;
use crate::shading::ShaderThread;
use granita_base::{MotionTransform, Severity, Vec3};
use granita_geom::{Dice, Piece, ShapeKey, SplitDirection, Surface};
use granita_scene::Primitive;
use granita_shade::{Grid, Primvar, PrimvarData, RayKind, Topology};
use granita_trace::TriangleMesh;
use std::sync::Arc;

/// Largest deviation of a tessellation from the surface, in pixels of the camera.
pub(crate) const FLATNESS_PX: f32 = 0.1;
/// Segments of a diced piece in one direction; longer pieces are split.
const MAX_SEGMENTS: usize = 64;
/// Points of the lattice that rates are judged by, in each direction.
const LATTICE: usize = 9;
/// Levels of splitting; a piece that still wants to be split is diced as it is.
const MAX_SPLITS: u32 = 24;

/// A square of two triangles.
#[derive(Clone, Copy, Debug)]
struct Quad {
    /// Vertex of its lower u, lower v corner.
    corner: u32,
    /// Vertices from one row to the next.
    stride: u32,
    /// Index of its piece, for uniform values.
    piece: u32,
}

/// Values of a primitive variable over a tessellation.
#[derive(Clone, Debug)]
enum RayData {
    /// `width` floats per vertex.
    Vertex(Vec<f32>),
    /// `width` floats per piece.
    Piece(Vec<f32>),
    /// Sets of strings; see [`RayMesh::strings_of`].
    Strings(Vec<Vec<Arc<str>>>),
}

#[derive(Clone, Debug)]
struct RayPrimvar {
    name: Arc<str>,
    ty: granita_base::ParamType,
    data: RayData,
}

/// A primitive as rays see it.
#[derive(Debug)]
pub(crate) struct RayMesh {
    /// The primitive.
    pub(crate) primitive: Arc<Primitive>,
    /// Its state.
    pub(crate) object: Arc<ObjectState>,
    quads: Vec<Quad>,
    p: Vec<Vec3>,
    n: Vec<Vec3>,
    ng: Vec<Vec3>,
    dpdu: Vec<Vec3>,
    dpdv: Vec<Vec3>,
    uv: Vec<[f32; 2]>,
    primvars: Vec<RayPrimvar>,
    /// Of each piece: which combination of strings it carries.
    string_set: Vec<u32>,
}

/// A place where a ray met a mesh.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MeshHit {
    /// Triangle of the mesh.
    pub(crate) triangle: u32,
    /// Barycentric coordinates of the second and third vertex.
    pub(crate) b1: f32,
    /// See `b1`.
    pub(crate) b2: f32,
    /// World position.
    pub(crate) p: Vec3,
    /// From the ray's origin to `p`.
    pub(crate) i: Vec3,
    /// Width of the ray there, world units.
    pub(crate) width: f32,
}

/// What hits are shaded as.
#[derive(Clone, Copy, Debug)]
pub(crate) struct HitShading {
    /// Ray level and purpose.
    pub(crate) ray: RayKind,
    /// Time of the rays.
    pub(crate) time: f32,
    /// Length of time that they stand for.
    pub(crate) dtime: f32,
    /// Seed of `random ()`.
    pub(crate) seed: u32,
    /// Make neighbours, so that derivatives exist.
    pub(crate) derivatives: bool,
}

/// Place in a quad: interpolation weights and the vertices of its corners 00, 10, 01, 11.
struct Place {
    corners: [usize; 4],
    weights: [f32; 4],
}

impl RayMesh {
    /// Which combination of uniform strings a triangle carries: hits of different ones cannot share a grid.
    pub(crate) fn strings_of(&self, triangle: u32) -> u32 {
        self.string_set[self.quads[triangle as usize / 2].piece as usize]
    }

    /// Shading normal at a hit, of length 1.
    pub(crate) fn normal(&self, hit: &MeshHit) -> Vec3 {
        let (quad, a, b) = self.local(hit);
        self.mix(&self.place(quad, a, b), &self.n).normalize_or_zero()
    }

    /// The quad of a hit and its coordinates there; both triangles agree along their common edge.
    fn local(&self, hit: &MeshHit) -> (Quad, f32, f32) {
        let quad = self.quads[hit.triangle as usize / 2];
        if hit.triangle.is_multiple_of(2) {
            (quad, hit.b1, hit.b2)
        } else {
            (quad, 1.0 - hit.b1, 1.0 - hit.b2)
        }
    }

    fn place(&self, quad: Quad, a: f32, b: f32) -> Place {
        let c = quad.corner as usize;
        let s = quad.stride as usize;
        Place {
            corners: [c, c + 1, c + s, c + s + 1],
            weights: [(1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b],
        }
    }

    fn mix(&self, place: &Place, values: &[Vec3]) -> Vec3 {
        (0..4).map(|k| values[place.corners[k]] * place.weights[k]).fold(Vec3::ZERO, |s, v| s + v)
    }

    /// Makes hits, all with the same strings, into a grid: `n` centres and, when derivatives are wanted,
    /// their neighbours at the distance of the ray's width.
    pub(crate) fn grid(&self, hits: &[MeshHit], how: HitShading) -> Grid {
        let n = hits.len();
        let topology = if how.derivatives { Topology::Triplets { n } } else { Topology::Scattered { n } };
        let mut grid = Grid::new(topology);
        let lanes = grid.len();
        grid.time = how.time;
        grid.dtime = how.dtime;
        grid.ray = how.ray;
        grid.seed = how.seed;
        grid.flip_normals = self.object.attributes.flip_normals;
        grid.object = self.object.name.clone();

        // Where each lane is: centres, then the neighbours along u, then along v.
        let mut places: Vec<(Place, u32)> = Vec::with_capacity(lanes);
        for turn in 0..lanes / n.max(1) {
            for (k, hit) in hits.iter().enumerate() {
                let (quad, a, b) = self.local(hit);
                let (da, db) = match turn {
                    0 => (0.0, 0.0),
                    1 => (self.step(quad, hit.width, 1), 0.0),
                    _ => (0.0, self.step(quad, hit.width, quad.stride as usize)),
                };
                let place = self.place(quad, a + da, b + db);
                let lane = turn * n + k;
                // Neighbours move from the true hit by the tessellation's difference.
                let moved = if turn == 0 {
                    Vec3::ZERO
                } else {
                    self.mix(&place, &self.p) - self.mix(&self.place(quad, a, b), &self.p)
                };
                grid.p.set(lane, hit.p + moved);
                grid.i.set(lane, hit.i + moved);
                grid.n.set(lane, self.mix(&place, &self.n));
                grid.ng.set(lane, self.mix(&place, &self.ng));
                grid.dpdu.set(lane, self.mix(&place, &self.dpdu));
                grid.dpdv.set(lane, self.mix(&place, &self.dpdv));
                let uv = |c: usize| (0..4).map(|k| self.uv[place.corners[k]][c] * place.weights[k]).sum();
                grid.u[lane] = uv(0);
                grid.v[lane] = uv(1);
                places.push((place, quad.piece));
            }
        }
        self.fill_primvars(&mut grid, &places);
        self.fill_color(&mut grid);
        grid
    }

    /// Fraction of a quad's side (of a vertex step) that is `width` long; at most a few sides.
    fn step(&self, quad: Quad, width: f32, vertex_step: usize) -> f32 {
        let c = quad.corner as usize;
        let side = self.p[c].distance(self.p[c + vertex_step]);
        if side > 0.0 { (width / side).clamp(1e-4, 8.0) } else { 1e-2 }
    }

    fn fill_primvars(&self, grid: &mut Grid, places: &[(Place, u32)]) {
        let lanes = places.len();
        for var in &self.primvars {
            let width = var.ty.width();
            let data = match &var.data {
                RayData::Vertex(values) => {
                    let mut out = vec![0.0; width * lanes];
                    for (lane, (place, _)) in places.iter().enumerate() {
                        for c in 0..width {
                            out[c * lanes + lane] =
                                (0..4).map(|k| values[place.corners[k] * width + c] * place.weights[k]).sum();
                        }
                    }
                    PrimvarData::Floats { values: out, varying: true }
                }
                RayData::Piece(values) => {
                    let of = |piece: u32| &values[piece as usize * width..][..width];
                    let first = places.first().map_or(0, |p| p.1);
                    if places.iter().all(|(_, piece)| of(*piece) == of(first)) {
                        PrimvarData::Floats { values: of(first).to_vec(), varying: false }
                    } else {
                        let at = |c: usize| places.iter().map(move |(_, piece)| of(*piece)[c]);
                        PrimvarData::Floats { values: (0..width).flat_map(at).collect(), varying: true }
                    }
                }
                RayData::Strings(sets) => {
                    let first = places.first().map_or(0, |p| p.1);
                    let set = self.string_set[first as usize] as usize;
                    PrimvarData::Strings(sets.get(set).cloned().unwrap_or_default())
                }
            };
            grid.primvars.push(Primvar { name: var.name.clone(), ty: var.ty, data });
        }
    }

    /// Surface colour and opacity: the object's, or the primitive's own.
    fn fill_color(&self, grid: &mut Grid) {
        set_surface_color(grid, &self.object);
    }
}

/// Starts a grid's colour and opacity with the attributes of the object or, when the primitive carries
/// variables "C" and "opacity", with those.
pub(crate) fn set_surface_color(grid: &mut Grid, object: &ObjectState) {
    let n = grid.len();
    for (name, value) in [("C", object.color), ("opacity", object.opacity)] {
        let own = grid.primvars.iter().find(|v| &*v.name == name && v.ty.width() == 3);
        let lanes = match own.map(|v| &v.data) {
            Some(PrimvarData::Floats { values, varying: true }) => {
                granita_shade::Lanes3 { xyz: std::array::from_fn(|c| values[c * n..(c + 1) * n].to_vec()) }
            }
            Some(PrimvarData::Floats { values, varying: false }) => {
                granita_shade::Lanes3::splat(Vec3::new(values[0], values[1], values[2]), n)
            }
            _ => granita_shade::Lanes3::splat(value, n),
        };
        if name == "C" { grid.c = lanes } else { grid.opacity = lanes }
    }
}

/// Tessellates a primitive for rays, with motion keys when `motion`. `None` for one without surface, or
/// that cannot be built (reported).
pub(crate) fn tessellate(
    primitive: &Arc<Primitive>,
    object: &Arc<ObjectState>,
    motion: bool,
    thread: &mut ShaderThread<'_>,
) -> Option<(RayMesh, TriangleMesh)> {
    let frame = thread.frame();
    let (camera, reporter) = (&frame.camera, &frame.reporter);
    let attributes = &primitive.attributes;
    let keys: Vec<ShapeKey<'_>> =
        primitive.keys.iter().map(|k| ShapeKey { time: k.time, params: &k.params }).collect();
    let mut report = |severity: Severity, text: String| {
        let text = if object.name.is_empty() { text } else { format!("object \"{}\": {text}", object.name) };
        reporter.once(&format!("primitive {} {text}", primitive.id), severity, &primitive.at, text);
    };
    let pieces = match granita_geom::build(&primitive.shape, &keys, attributes.trim.as_deref(), &mut report) {
        Ok(pieces) => pieces,
        Err(error) => {
            report(Severity::Error, error.to_string());
            return None;
        }
    };
    let shape_times: Vec<f32> = primitive.keys.iter().map(|k| k.time).collect();
    let shutter = if motion { camera.shutter } else { [camera.shading_time(); 2] };
    let still: [&MotionTransform; 0] = [];
    let placement = Placement::new(&attributes.to_world, &shape_times, &still, shutter);
    let times = placement.times().to_vec();
    let displaced = object.displaces_rays();
    let mut build = Builder {
        object,
        camera,
        placement: &placement,
        mesh: RayMesh {
            primitive: primitive.clone(),
            object: object.clone(),
            quads: Vec::new(),
            p: Vec::new(),
            n: Vec::new(),
            ng: Vec::new(),
            dpdu: Vec::new(),
            dpdv: Vec::new(),
            uv: Vec::new(),
            primvars: Vec::new(),
            string_set: Vec::new(),
        },
        triangles: TriangleMesh { positions: vec![Vec::new(); times.len()], times, triangles: Vec::new() },
        pieces: 0,
    };
    let leaves = if displaced {
        // What moves must be sampled as finely as for the camera.
        let settings = DiceSettings::new(attributes, frame.scene.int("limits:gridsize"), camera);
        dicing::tessellate(pieces, &placement, &Measure::by_distance(camera), &settings)
    } else {
        let flat = matches!(primitive.shape, granita_base::ShapeDesc::Mesh { subdivide: false, .. });
        let mut leaves = Vec::new();
        for piece in pieces {
            build.refine(piece, flat, 0, &mut leaves);
        }
        leaves
    };
    for leaf in leaves {
        build.add(&leaf, displaced, thread);
    }
    let Builder { mesh, triangles, .. } = build;
    (!triangles.triangles.is_empty()).then_some((mesh, triangles))
}

/// A tessellation in the making.
struct Builder<'a> {
    object: &'a Arc<ObjectState>,
    camera: &'a CameraView,
    placement: &'a Placement,
    mesh: RayMesh,
    triangles: TriangleMesh,
    pieces: u32,
}

impl Builder<'_> {
    /// Splits until a piece is small enough; the leaves come in the order of the surface.
    fn refine(&self, piece: Piece, flat: bool, depth: u32, leaves: &mut Vec<Leaf>) {
        // Rates of a piece that must be split mean nothing.
        let [nu, nv] = if flat || piece.must_split() { [1, 1] } else { self.segments(&*piece) };
        let direction = if nu >= nv { SplitDirection::U } else { SplitDirection::V };
        let too_long = nu.max(nv) > MAX_SEGMENTS;
        if depth < MAX_SPLITS && piece.is_splittable() && (piece.must_split() || too_long) {
            for part in piece.split(direction) {
                self.refine(part, flat, depth + 1, leaves);
            }
            return;
        }
        // Powers of two: neighbouring pieces meet in shared points more often.
        let points = |n: usize| n.min(MAX_SEGMENTS).next_power_of_two() + 1;
        leaves.push(Leaf { piece, nu: points(nu), nv: points(nv) });
    }

    /// Segments along u and v that keep the tessellation within the flatness.
    fn segments(&self, piece: &dyn Surface) -> [usize; 2] {
        let mut lattice = Vec::with_capacity(LATTICE * LATTICE);
        if piece.is_facing() {
            let viewer = Viewer::new(self.camera, self.placement, piece.key_times());
            piece.positions_towards(0, LATTICE, LATTICE, &|k, p| viewer.view(k, p), &mut lattice);
        } else {
            piece.positions(0, LATTICE, LATTICE, &mut lattice);
        }
        let to_world = self.placement.to_world.at(self.placement.times()[0]);
        for p in &mut lattice {
            *p = to_world.point(*p);
        }
        let at = |i: usize, j: usize| lattice[j * LATTICE + i];
        let eye = self.camera.position_world();
        let pixels_per_unit =
            |p: Vec3| self.camera.raster_scale(eye.distance(p).max(self.camera.near)).abs().max_element();
        // An arc of length l that turns by t deviates by l t / (8 n^2) from n equal chords.
        let needed = |points: [Vec3; LATTICE]| {
            let length: f32 =
                points.windows(2).map(|w| w[0].distance(w[1]) * pixels_per_unit((w[0] + w[1]) * 0.5)).sum();
            let turn: f32 = points.windows(3).map(|w| angle_between(w[1] - w[0], w[2] - w[1])).sum();
            (length * turn / (8.0 * FLATNESS_PX)).sqrt().max(turn.to_degrees() / 10.0)
        };
        let (mut u, mut v) = (1.0_f32, 1.0_f32);
        for k in 0..LATTICE {
            u = u.max(needed(std::array::from_fn(|i| at(i, k))));
            v = v.max(needed(std::array::from_fn(|j| at(k, j))));
        }
        // A twisted square deviates by a quarter of its twist from two triangles.
        let last = LATTICE - 1;
        let (a, b, c, d) = (at(0, 0), at(last, 0), at(0, last), at(last, last));
        let twist = (a - b - c + d).length() * pixels_per_unit((a + b + c + d) * 0.25);
        let by_twist = (twist / (4.0 * FLATNESS_PX)).sqrt();
        // Not a number (positions that are not finite) becomes one segment.
        let whole = |x: f32| if x.is_finite() { x.ceil().clamp(1.0, 1e6) as usize } else { 1 };
        [whole(u.max(by_twist)), whole(v.max(by_twist))]
    }

    fn add(&mut self, leaf: &Leaf, displaced: bool, thread: &mut ShaderThread<'_>) {
        let key_times = leaf.piece.key_times();
        let dice: Dice = leaf.dice(&Viewer::new(self.camera, self.placement, key_times));
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
        let mut grid = dicing::make_grid(&dice, key_times, &self.mesh.primitive, self.placement, &view);
        let before = grid.p.clone();
        if displaced {
            thread.displace(self.object, &mut grid);
        }
        let first = self.mesh.p.len();
        let count = nu * nv;
        for (time, out) in self.triangles.times.iter().zip(&mut self.triangles.positions) {
            let to_world = self.placement.to_world.at(*time);
            let points = dicing::points_at(&dice.p, key_times, *time, &to_world);
            out.extend(points.iter().enumerate().map(|(i, p)| *p + (grid.p.get(i) - before.get(i))));
        }
        let mesh = &mut self.mesh;
        for i in 0..count {
            mesh.p.push(grid.p.get(i));
            // Lengths of normals mean nothing, but would weigh them in the interpolation.
            mesh.n.push(grid.n.get(i).normalize_or_zero());
            mesh.ng.push(grid.ng.get(i).normalize_or_zero());
            mesh.dpdu.push(grid.dpdu.get(i));
            mesh.dpdv.push(grid.dpdv.get(i));
            mesh.uv.push([grid.u[i], grid.v[i]]);
        }
        let strings = add_primvars(mesh, &grid, self.pieces);
        mesh.string_set.push(strings);
        let kept_value = &*self.object.attributes.string("trimcurve:sense") != "outside";
        for j in 0..nv - 1 {
            for i in 0..nu - 1 {
                if dice.mask.as_ref().is_some_and(|m| m[j * (nu - 1) + i] != kept_value) {
                    continue;
                }
                let (corner, stride) = ((first + j * nu + i) as u32, nu as u32);
                mesh.quads.push(Quad { corner, stride, piece: self.pieces });
                self.triangles.triangles.push([corner, corner + 1, corner + stride]);
                self.triangles.triangles.push([corner + stride + 1, corner + stride, corner + 1]);
            }
        }
        self.pieces += 1;
    }
}

/// Appends a grid's variables to a mesh; returns the index of its combination of strings.
///
/// All pieces of a primitive carry the same variables; one that is uniform in the first piece and varying
/// in another is taken at the piece's first point.
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
    // Find the combination among those seen; nearly always the last one, or the only one.
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

/// Angle between two directions, radians; 0 when one is zero.
fn angle_between(a: Vec3, b: Vec3) -> f32 {
    let (sin, cos) = (a.cross(b).length(), a.dot(b));
    if sin == 0.0 && cos == 0.0 { 0.0 } else { sin.atan2(cos) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::{Fixture, param};
    use crate::shading::ShadingContext;
    use granita_base::{Params, ShapeDesc};

    fn mesh_of(fixture: &Fixture, primitive: &Arc<Primitive>) -> (RayMesh, TriangleMesh) {
        let (scene, camera, environment) = fixture.finish();
        let frame = ShadingContext::new(&scene, &camera, &environment);
        let object = frame.object(primitive);
        tessellate(primitive, &object, false, &mut ShaderThread::new(&frame)).unwrap()
    }

    fn plain() -> HitShading {
        HitShading { ray: RayKind::default(), time: 0.0, dtime: 0.0, seed: 0, derivatives: true }
    }

    #[test]
    fn a_sphere_is_flat_to_a_fraction_of_a_pixel() {
        let mut f = Fixture::new(&[]);
        let ball = f.attributes("", &["set"], &[]);
        let ball = f.sphere(Vec3::new(0.5, 0.0, 1.0), 2.0, ball);
        let (mesh, triangles) = mesh_of(&f, &ball);
        let center = Vec3::new(0.5, 0.0, 1.0);
        let p = &triangles.positions[0];
        // 640 x 480 pixels, 90 degrees: at distance 7 to 11 a pixel is 0.03 to 0.05 units.
        for t in &triangles.triangles {
            let middle = t.iter().map(|i| p[*i as usize]).sum::<Vec3>() / 3.0;
            let off = 2.0 - middle.distance(center);
            assert!((-1e-5..2.0 * 0.046 * FLATNESS_PX).contains(&off), "{off}");
        }
        let count = triangles.triangles.len();
        assert!((1000..100_000).contains(&count), "{count}");
        // Normals point outward.
        for (p, n) in mesh.p.iter().zip(&mesh.n) {
            assert!((*n - (*p - center) / 2.0).length() < 1e-3, "{p} {n}");
        }
    }

    #[test]
    fn a_polygon_is_two_triangles() {
        let mut f = Fixture::new(&[]);
        let floor = f.attributes("", &["set"], &[]);
        let floor = f.rectangle([-1.0, -2.0], [3.0, 2.0], 0.5, floor);
        let (_, triangles) = mesh_of(&f, &floor);
        assert_eq!(triangles.triangles.len(), 2);
    }

    #[test]
    fn hits_interpolate_variables_and_know_their_derivatives() {
        let mut f = Fixture::new(&[]);
        let p = [0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 4.0, 2.0, 0.0, 0.0, 2.0, 0.0_f32];
        let s = [0.0, 1.0, 1.0, 0.0_f32];
        let params = Params(vec![
            param("vertex point P", &p[..]),
            param("linear float s", &s[..]),
            param("string label", "x"),
        ]);
        let shape = ShapeDesc::Mesh { subdivide: false, nverts: [4].into(), verts: [0, 1, 2, 3].into() };
        let floor = f.attributes("", &["set"], &[]);
        let floor = f.add(shape, params, floor);
        let (mesh, triangles) = mesh_of(&f, &floor);
        let positions = &triangles.positions[0];
        for (k, t) in triangles.triangles.iter().enumerate() {
            let corner = |i: usize| positions[t[i] as usize];
            let (b1, b2) = (0.3, 0.2);
            let p = corner(0) * (1.0 - b1 - b2) + corner(1) * b1 + corner(2) * b2;
            let hit = MeshHit { triangle: k as u32, b1, b2, p, i: -Vec3::Z, width: 0.01 };
            let grid = mesh.grid(&[hit], plain());
            assert_eq!(grid.topology, Topology::Triplets { n: 1 });
            let PrimvarData::Floats { values, varying: true } =
                &grid.primvars.iter().find(|v| &*v.name == "s").unwrap().data
            else {
                panic!()
            };
            // s is x / 4 everywhere; neighbours are one width away along each side.
            for (lane, s) in values.iter().enumerate() {
                assert!((s - grid.p.get(lane).x / 4.0).abs() < 1e-5, "{k} {lane}");
            }
            assert!((grid.p.get(1).distance(p) - 0.01).abs() < 1e-4);
            assert!((grid.p.get(2).distance(p) - 0.01).abs() < 1e-4);
            assert!((grid.n.get(0).normalize() - Vec3::Z).length() < 1e-6);
            let label = grid.primvars.iter().find(|v| &*v.name == "label").unwrap();
            assert_eq!(label.data, PrimvarData::Strings(vec!["x".into()]));
        }
    }
}
