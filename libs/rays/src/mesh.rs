//! Tessellation of primitives for rays, and conversion of hits into grids.
//!
//! Primitives are split and diced as for the camera, but the rate follows from flatness, because rays need only the
//! shape and the shader is evaluated at the hit. Only surfaces that displacement shaders move are diced finely. All
//! positions are in world space at the time of shading. Positions have further keys when rays see motion. See `build`
//! for the parts and levels of a tessellation.

mod build;

pub use build::{FLATNESS_PX, Level, Member, OnDemandMesh, StaticMesh, prepare};

use crate::RayObject;
use granita_base::{Color, Vec3, hash};
use granita_dicing::SmoothFace;
use granita_dicing::finite;
use granita_shade::{Grid, Lanes3, Primvar, PrimvarData, RayKind, Topology};
use std::sync::Arc;

/// A quad of two triangles.
#[derive(Clone, Copy, Debug)]
struct Quad {
    /// The index of the vertex at its lower u, lower v corner.
    corner: u32,
    /// The number of vertices from one row to the next.
    stride: u32,
    /// The index of its piece, for uniform values.
    piece: u32,
}

impl Quad {
    /// Returns the vertices of its two triangles. The second triangle is the first one, rotated by 180 degrees.
    fn triangles(&self) -> [[u32; 3]; 2] {
        let (corner, stride) = (self.corner, self.stride);
        [[corner, corner + 1, corner + stride], [corner + stride + 1, corner + stride, corner + 1]]
    }
}

/// The values of a primitive variable over a tessellation.
#[derive(Clone, Debug)]
enum RayData {
    /// `width` floats per vertex.
    Vertex(Vec<f32>),
    /// `width` floats per piece.
    Piece(Vec<f32>),
    /// Combinations of strings; see [`RayMesh::strings_of`].
    Strings(Vec<Vec<Arc<str>>>),
}

#[derive(Clone, Debug)]
struct RayPrimvar {
    name: Arc<str>,
    ty: granita_base::ParamType,
    data: RayData,
}

/// A primitive, or a part of it, tessellated for rays.
#[derive(Debug, Default)]
pub struct RayMesh {
    quads: Vec<Quad>,
    p: Vec<Vec3>,
    n: Vec<Vec3>,
    ng: Vec<Vec3>,
    dpdu: Vec<Vec3>,
    dpdv: Vec<Vec3>,
    uv: Vec<[f32; 2]>,
    primvars: Vec<RayPrimvar>,
    /// For each piece: the index of its combination of strings.
    string_set: Vec<u32>,
    /// For each combination: a number that identifies its strings.
    string_keys: Vec<u64>,
    /// True when the quads are flat faces with normals of their own, which may be those of a smooth surface.
    flat_faces: bool,
}

/// The hit of a ray on a mesh.
#[derive(Clone, Copy, Debug)]
pub struct MeshHit {
    /// The index of the triangle.
    pub triangle: u32,
    /// The barycentric coordinate of the second vertex.
    pub b1: f32,
    /// The barycentric coordinate of the third vertex.
    pub b2: f32,
    /// The hit point in world space.
    pub p: Vec3,
    /// The vector from the ray's origin to `p`, in world space.
    pub i: Vec3,
    /// The width of the ray at the hit, in world units.
    pub width: f32,
}

/// The settings with which hits are shaded.
#[derive(Clone, Copy, Debug)]
pub struct HitShading {
    /// The ray level and purpose.
    pub ray: RayKind,
    /// The time of the rays.
    pub time: f32,
    /// The length of the time interval that the rays stand for.
    pub dtime: f32,
    /// The seed of `random ()`.
    pub seed: u32,
    /// True when neighbours are added, from which derivatives are computed.
    pub derivatives: bool,
}

/// A place in a quad: interpolation weights and the vertices of the corners 00, 10, 01, 11.
struct Place {
    corners: [usize; 4],
    weights: [f32; 4],
}

impl RayMesh {
    /// Returns a number that identifies the uniform strings of a triangle. Hits with different numbers cannot share a
    /// grid.
    pub fn strings_of(&self, triangle: u32) -> u64 {
        let set = self.string_set[self.quads[triangle as usize / 2].piece as usize];
        self.string_keys.get(set as usize).copied().unwrap_or(0)
    }

    /// Assigns the numbers that identify the combinations of strings.
    fn number_strings(&mut self) {
        let of = |set: usize| {
            let sets = self.primvars.iter().filter_map(|v| match &v.data {
                RayData::Strings(sets) => sets.get(set),
                _ => None,
            });
            let bytes: Vec<u8> = sets.flatten().flat_map(|s| s.bytes().chain([0])).collect();
            hash::bytes64(&bytes)
        };
        let count = self.string_set.iter().max().map_or(0, |most| *most as usize + 1);
        self.string_keys = (0..count).map(of).collect();
    }

    /// The number of triangles.
    pub fn triangles(&self) -> u32 {
        2 * self.quads.len() as u32
    }

    /// The number of bytes of memory that the mesh occupies.
    pub fn bytes(&self) -> usize {
        fn of<T>(list: &Vec<T>) -> usize {
            list.capacity() * size_of::<T>()
        }
        let vectors = [&self.p, &self.n, &self.ng, &self.dpdu, &self.dpdv].map(of).iter().sum::<usize>();
        let primvars = self.primvars.iter().map(|v| match &v.data {
            RayData::Vertex(values) | RayData::Piece(values) => of(values),
            RayData::Strings(sets) => of(sets),
        });
        of(&self.quads)
            + vectors
            + of(&self.uv)
            + primvars.sum::<usize>()
            + of(&self.string_set)
            + of(&self.string_keys)
    }

    /// Releases the spare capacity of the vectors.
    fn shrink(&mut self) {
        self.quads.shrink_to_fit();
        for list in [&mut self.p, &mut self.n, &mut self.ng, &mut self.dpdu, &mut self.dpdv] {
            list.shrink_to_fit();
        }
        self.uv.shrink_to_fit();
        for var in &mut self.primvars {
            match &mut var.data {
                RayData::Vertex(values) | RayData::Piece(values) => values.shrink_to_fit(),
                RayData::Strings(sets) => sets.shrink_to_fit(),
            }
        }
        self.string_set.shrink_to_fit();
    }

    /// Returns the vertices of a triangle in world space at the time of shading.
    pub fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.quads[triangle as usize / 2].triangles()[triangle as usize % 2].map(|v| self.p[v as usize])
    }

    /// Returns the shading normal at a hit, a unit vector.
    pub fn normal(&self, hit: &MeshHit) -> Vec3 {
        let (quad, a, b) = self.local(hit);
        self.mix(&self.place(quad, a, b), &self.n).normalize_or_zero()
    }

    /// Returns the quad of a hit and the coordinates in it. Both triangles of a quad agree along their common edge.
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

    /// Returns the vectors from a place to the estimated position of the smooth surface, on either side.
    fn lifts(&self, place: &Place, p: Vec3) -> [Vec3; 2] {
        let face = SmoothFace { p: place.corners.map(|v| self.p[v]), n: place.corners.map(|v| self.n[v]) };
        face.lifts(p, place.weights)
    }

    fn mix(&self, place: &Place, values: &[Vec3]) -> Vec3 {
        (0..4).map(|k| values[place.corners[k]] * place.weights[k]).fold(Vec3::ZERO, |s, v| s + v)
    }

    /// Returns the values of a variable. The variable is most likely the one of this index.
    fn variable(&self, index: usize, name: &str) -> Option<&RayData> {
        let there = self.primvars.get(index).filter(|v| &*v.name == name);
        there.or_else(|| self.primvars.iter().find(|v| &*v.name == name)).map(|v| &v.data)
    }

    /// Returns `width` (world units) as a fraction of a quad's side, which is one vertex step. The result is at most
    /// a few sides.
    fn step(&self, quad: Quad, width: f32, vertex_step: usize) -> f32 {
        let c = quad.corner as usize;
        let side = self.p[c].distance(self.p[c + vertex_step]);
        if side > 0.0 { (width / side).clamp(1e-4, 8.0) } else { 1e-2 }
    }
}

/// Makes hits of one object, all with the same strings, into a grid. The grid has `n` centres and, when derivatives
/// are requested, their neighbours at the distance of the ray's width.
pub fn grid_of<O: RayObject>(hits: &[(&RayMesh, MeshHit)], object: &O, how: HitShading) -> Grid {
    let n = hits.len();
    let topology = if how.derivatives { Topology::Triplets { n } } else { Topology::Scattered { n } };
    let mut grid = Grid::new(topology);
    let lanes = grid.len();
    grid.time = how.time;
    grid.dtime = how.dtime;
    grid.ray = how.ray;
    grid.seed = how.seed;
    grid.primitives = vec![how.seed];
    grid.flip_normals = object.attributes().flip_normals;
    grid.object = object.name().clone();

    // The place of each lane: the centres, then the neighbours along u, then the neighbours along v.
    let mut places: Vec<(&RayMesh, Place, u32)> = Vec::with_capacity(lanes);
    let smooth = hits.iter().any(|(mesh, _)| mesh.flat_faces);
    let mut lifts: Option<[Lanes3; 2]> = smooth.then(|| [Lanes3::zeros(lanes), Lanes3::zeros(lanes)]);
    for turn in 0..lanes / n.max(1) {
        for (k, (mesh, hit)) in hits.iter().enumerate() {
            let (quad, a, b) = mesh.local(hit);
            let (da, db) = match turn {
                0 => (0.0, 0.0),
                1 => (mesh.step(quad, hit.width, 1), 0.0),
                _ => (0.0, mesh.step(quad, hit.width, quad.stride as usize)),
            };
            let place = mesh.place(quad, a + da, b + db);
            let lane = turn * n + k;
            // Neighbours are offset from the exact hit point by the difference of their places on the tessellation.
            let moved = if turn == 0 {
                Vec3::ZERO
            } else {
                mesh.mix(&place, &mesh.p) - mesh.mix(&mesh.place(quad, a, b), &mesh.p)
            };
            grid.p.set(lane, hit.p + moved);
            grid.i.set(lane, hit.i + moved);
            grid.n.set(lane, mesh.mix(&place, &mesh.n));
            if let Some(lifts) = lifts.as_mut().filter(|_| mesh.flat_faces) {
                for (lanes, lift) in lifts.iter_mut().zip(mesh.lifts(&place, hit.p + moved)) {
                    lanes.set(lane, lift);
                }
            }
            grid.ng.set(lane, mesh.mix(&place, &mesh.ng));
            grid.dpdu.set(lane, mesh.mix(&place, &mesh.dpdu));
            grid.dpdv.set(lane, mesh.mix(&place, &mesh.dpdv));
            let uv = |c: usize| (0..4).map(|k| mesh.uv[place.corners[k]][c] * place.weights[k]).sum();
            grid.u[lane] = uv(0);
            grid.v[lane] = uv(1);
            places.push((mesh, place, quad.piece));
        }
    }
    grid.lift = lifts.map(Arc::new);
    fill_primvars(&mut grid, &places);
    set_surface_color(&mut grid, object.color_and_opacity());
    grid
}

/// Fills the primitive variables. All meshes of a primitive have the same variables, but a variable that is uniform
/// in one may vary in another.
fn fill_primvars(grid: &mut Grid, places: &[(&RayMesh, Place, u32)]) {
    let Some((first, ..)) = places.first() else { return };
    for (index, var) in first.primvars.iter().enumerate() {
        let width = var.ty.width();
        let data = if let RayData::Strings(sets) = &var.data {
            let set = first.string_set[places[0].2 as usize] as usize;
            PrimvarData::Strings(sets.get(set).cloned().unwrap_or_default())
        } else {
            let lanes = places.len();
            let mut values = vec![0.0; width * lanes];
            for (lane, (mesh, place, piece)) in places.iter().enumerate() {
                for c in 0..width {
                    values[c * lanes + lane] = match mesh.variable(index, &var.name) {
                        Some(RayData::Vertex(values)) => {
                            (0..4).map(|k| values[place.corners[k] * width + c] * place.weights[k]).sum()
                        }
                        Some(RayData::Piece(values)) => values[*piece as usize * width + c],
                        _ => 0.0,
                    };
                }
            }
            let of_piece =
                |mesh: &RayMesh| matches!(mesh.variable(index, &var.name), Some(RayData::Piece(_)));
            let uniform = places.iter().all(|(mesh, ..)| of_piece(mesh))
                && values.chunks_exact(lanes).all(|c| c.iter().all(|x| *x == c[0]));
            if uniform {
                let values = values.chunks_exact(lanes).map(|c| c[0]).collect();
                PrimvarData::Floats { values, varying: false }
            } else {
                PrimvarData::Floats { values, varying: true }
            }
        };
        grid.primvars.push(Primvar { name: var.name.clone(), ty: var.ty, data });
    }
}

/// Sets a grid's colour and opacity to the attributes of the object, or to the primitive variables "C" and "opacity"
/// where the primitive has them.
pub fn set_surface_color(grid: &mut Grid, [color, opacity]: [Color; 2]) {
    let n = grid.len();
    for (name, value) in [("C", color), ("opacity", opacity)] {
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
    finite::clamp_opacity(&mut grid.opacity);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::GridShaders;
    use crate::fixture::{Frame, Object, Thread};
    use granita_base::{Params, ShapeDesc};
    use granita_fixture::{Fixture, param};
    use granita_scene::Primitive;
    use granita_trace::TriangleMesh;

    fn with_member<T>(
        fixture: &Fixture,
        primitive: &Arc<Primitive>,
        then: impl FnOnce(Member<Object>, &mut Thread<'_>) -> T,
    ) -> T {
        let frame = Frame::new(fixture, |_| 0.0);
        let object = frame.object(primitive);
        let mut thread = Thread(&frame);
        let member = prepare(primitive, &object, false, &mut thread).unwrap();
        then(member, &mut thread)
    }

    fn parts_of(fixture: &Fixture, primitive: &Arc<Primitive>, level: Level) -> Vec<(RayMesh, TriangleMesh)> {
        with_member(fixture, primitive, |member, thread| {
            let Member::OnDemandMesh(on_demand) = member else { panic!("a mesh") };
            (0..on_demand.parts.len())
                .map(|k| on_demand.tessellate(k as u32, level, thread).unwrap())
                .collect()
        })
    }

    fn plain() -> HitShading {
        HitShading { ray: RayKind::default(), time: 0.0, dtime: 0.0, seed: 0, derivatives: true }
    }

    #[test]
    fn a_sphere_is_flat_to_a_fraction_of_a_pixel() {
        let mut f = Fixture::new(&[]);
        let ball = f.attributes("", &["set"], &[]);
        let ball = f.sphere(Vec3::new(0.5, 0.0, 1.0), 2.0, ball);
        let center = Vec3::new(0.5, 0.0, 1.0);
        // The camera has 640 x 480 pixels and a field of view of 90 degrees. At distances from 7 to 11 a pixel is 0.03
        // to 0.05 units wide.
        let mut counts = Vec::new();
        for level in Level::ALL {
            assert_eq!(Level::for_width(level.scale() * 1.5), level);
            let mut count = 0;
            for (mesh, triangles) in parts_of(&f, &ball, level) {
                let p = &triangles.positions[0];
                for t in triangles.triangles.iter().filter(|t| t[0] != u32::MAX) {
                    let middle = t.iter().map(|i| p[*i as usize]).sum::<Vec3>() / 3.0;
                    let off = 2.0 - middle.distance(center);
                    assert!((-1e-5..2.0 * 0.046 * FLATNESS_PX * level.scale()).contains(&off), "{off}");
                    count += 1;
                }
                // Normals point outward.
                for (p, n) in mesh.p.iter().zip(&mesh.n) {
                    assert!((*n - (*p - center) / 2.0).length() < 1e-3, "{p} {n}");
                }
            }
            counts.push(count);
        }
        // From level to level the number of segments is halved in each direction.
        assert!((1000..100_000).contains(&counts[0]), "{counts:?}");
        assert!(counts.windows(2).all(|w| w[1] * 2 < w[0]), "{counts:?}");
    }

    #[test]
    fn a_sphere_of_a_pixel_has_few_triangles() {
        let mut f = Fixture::new(&[]);
        let dot = f.attributes("", &["set"], &[]);
        // A pixel is about 0.04 units wide there.
        let center = Vec3::new(0.5, 0.0, 1.0);
        let dot = f.sphere(center, 0.02, dot);
        let parts = parts_of(&f, &dot, Level::FINEST);
        let triangles: usize = parts.iter().map(|(_, mesh)| mesh.triangles.len()).sum();
        assert!((8..=128).contains(&triangles), "{triangles}");
        // It is still round to the permitted deviation.
        for (_, mesh) in &parts {
            let p = &mesh.positions[0];
            for t in mesh.triangles.iter().filter(|t| t[0] != u32::MAX) {
                let middle = t.iter().map(|i| p[*i as usize]).sum::<Vec3>() / 3.0;
                let off = 0.02 - middle.distance(center);
                assert!(off < 2.0 * 0.046 * FLATNESS_PX, "{off}");
            }
        }
    }

    #[test]
    fn a_flat_polygon_is_stored_as_a_static_mesh() {
        let mut f = Fixture::new(&[]);
        let floor = f.attributes("", &["set"], &[]);
        let floor = f.rectangle([-1.0, -2.0], [3.0, 2.0], 0.5, floor);
        with_member(&f, &floor, |member, _| match member {
            Member::StaticMesh(static_mesh) => assert_eq!(static_mesh.facets(), 1),
            Member::OnDemandMesh(_) => panic!("tessellated"),
        });
    }

    #[test]
    fn hits_interpolate_variables_and_have_their_derivatives() {
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
        let (mesh, object) = with_member(&f, &floor, |member, thread| {
            let Member::StaticMesh(static_mesh) = member else { panic!("tessellated") };
            (static_mesh.mesh_of(&[0], thread).unwrap(), static_mesh.object)
        });
        for k in 0..2 {
            let corners = mesh.corners(k);
            let corner = |i: usize| corners[i];
            let (b1, b2) = (0.3, 0.2);
            let p = corner(0) * (1.0 - b1 - b2) + corner(1) * b1 + corner(2) * b2;
            let hit = MeshHit { triangle: k, b1, b2, p, i: -Vec3::Z, width: 0.01 };
            let grid = grid_of(&[(&mesh, hit)], &*object, plain());
            assert_eq!(grid.topology, Topology::Triplets { n: 1 });
            let PrimvarData::Floats { values, varying: true } =
                &grid.primvars.iter().find(|v| &*v.name == "s").unwrap().data
            else {
                panic!()
            };
            // s is x / 4 everywhere. The neighbours are one ray width away along each side.
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
