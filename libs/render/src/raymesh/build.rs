//! The tessellation of a primitive for rays.

use super::{Quad, RayData, RayMesh, RayPrimvar};
use crate::CameraView;
use crate::dicing::{
    self, DiceSettings, GridView, Leaf, Measure, Placement, Rates, SceneDicing, Viewer, Viewpoint,
};
use crate::object::ObjectState;
use crate::shading::ShaderThread;
use granita_base::{MotionTransform, Severity, Vec3};
use granita_geom::{Dice, Piece, ShapeKey, SplitDirection, Surface};
use granita_scene::Primitive;
use granita_shade::{Grid, PrimvarData, RayKind};
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
    let dicing = SceneDicing::new(&frame.scene);
    let trim = dicing::trimming(attributes, dicing.trim_quality);
    let pieces = match granita_geom::build(&primitive.shape, &keys, trim, &mut report) {
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
        let settings = DiceSettings::new(attributes, &dicing, camera);
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
    let Builder { mut mesh, mut triangles, .. } = build;
    mesh.shrink();
    triangles.positions.iter_mut().for_each(Vec::shrink_to_fit);
    triangles.triangles.shrink_to_fit();
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
        let rates = Rates { nu: points(nu), nv: points(nv), ..Rates::default() };
        leaves.push(Leaf { piece, rates: Box::new(rates) });
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
        let mask = dice.mask.as_ref().map(|mask| mask.micropolygons(nu));
        for j in 0..nv - 1 {
            for i in 0..nu - 1 {
                if mask.as_ref().is_some_and(|m| m[j * (nu - 1) + i] != kept_value) {
                    continue;
                }
                let quad =
                    Quad { corner: (first + j * nu + i) as u32, stride: nu as u32, piece: self.pieces };
                mesh.quads.push(quad);
                self.triangles.triangles.extend(quad.triangles());
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
