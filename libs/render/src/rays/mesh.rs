//! Primitives tessellated for rays, and hits made into grids.
//!
//! Primitives are split and diced as for the camera, but by flatness: rays need the shape, the shader is
//! evaluated at the hit. Only what displacement shaders move is diced finely. Everything is in world
//! space at the time of shading; positions have further keys when rays see motion. See `build` for what is made when.

mod build;

pub(crate) use build::{FLATNESS_PX, Flat, Level, Member, Solid, prepare};

use crate::dicing::SmoothFace;
use crate::finite;
use crate::object::ObjectState;
use granita_base::{Vec3, hash};
use granita_shade::{Grid, Lanes3, Primvar, PrimvarData, RayKind, Topology};
use std::sync::Arc;

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

impl Quad {
    /// Vertices of its two triangles; the second is the first, turned by half a circle.
    fn triangles(&self) -> [[u32; 3]; 2] {
        let (corner, stride) = (self.corner, self.stride);
        [[corner, corner + 1, corner + stride], [corner + stride + 1, corner + stride, corner + 1]]
    }
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

/// A primitive, or a part of it, as rays see it.
#[derive(Debug, Default)]
pub(crate) struct RayMesh {
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
    /// Of each combination: the number of its strings.
    string_keys: Vec<u64>,
    /// Its squares are flat faces with normals of their own, perhaps those of a smooth surface.
    flat_faces: bool,
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
    /// A number for the uniform strings that a triangle carries: hits of different ones cannot share a grid.
    pub(crate) fn strings_of(&self, triangle: u32) -> u64 {
        let set = self.string_set[self.quads[triangle as usize / 2].piece as usize];
        self.string_keys.get(set as usize).copied().unwrap_or(0)
    }

    /// Gives the combinations of strings their numbers.
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

    /// How many triangles there are.
    pub(crate) fn triangles(&self) -> u32 {
        2 * self.quads.len() as u32
    }

    /// Bytes of memory that it takes.
    pub(crate) fn bytes(&self) -> usize {
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

    /// Gives back the room that was left for more.
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

    /// Vertices of a triangle at the time of shading.
    pub(crate) fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.quads[triangle as usize / 2].triangles()[triangle as usize % 2].map(|v| self.p[v as usize])
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

    /// From a place to about where the smooth surface lies, on either side.
    fn lifts(&self, place: &Place, p: Vec3) -> [Vec3; 2] {
        let face = SmoothFace { p: place.corners.map(|v| self.p[v]), n: place.corners.map(|v| self.n[v]) };
        face.lifts(p, place.weights)
    }

    fn mix(&self, place: &Place, values: &[Vec3]) -> Vec3 {
        (0..4).map(|k| values[place.corners[k]] * place.weights[k]).fold(Vec3::ZERO, |s, v| s + v)
    }

    /// The values of a variable, which is most likely the one of this index.
    fn variable(&self, index: usize, name: &str) -> Option<&RayData> {
        let there = self.primvars.get(index).filter(|v| &*v.name == name);
        there.or_else(|| self.primvars.iter().find(|v| &*v.name == name)).map(|v| &v.data)
    }

    /// Fraction of a quad's side (of a vertex step) that is `width` long; at most a few sides.
    fn step(&self, quad: Quad, width: f32, vertex_step: usize) -> f32 {
        let c = quad.corner as usize;
        let side = self.p[c].distance(self.p[c + vertex_step]);
        if side > 0.0 { (width / side).clamp(1e-4, 8.0) } else { 1e-2 }
    }
}

/// Makes hits of one object, all with the same strings, into a grid: `n` centres and, when derivatives are wanted,
/// their neighbours at the distance of the ray's width.
pub(crate) fn grid_of(hits: &[(&RayMesh, MeshHit)], object: &ObjectState, how: HitShading) -> Grid {
    let n = hits.len();
    let topology = if how.derivatives { Topology::Triplets { n } } else { Topology::Scattered { n } };
    let mut grid = Grid::new(topology);
    let lanes = grid.len();
    grid.time = how.time;
    grid.dtime = how.dtime;
    grid.ray = how.ray;
    grid.seed = how.seed;
    grid.flip_normals = object.attributes.flip_normals;
    grid.object = object.name.clone();

    // Where each lane is: centres, then the neighbours along u, then along v.
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
            // Neighbours move from the true hit by the tessellation's difference.
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
    set_surface_color(&mut grid, object);
    grid
}

/// All meshes of a primitive carry the same variables; what is uniform in one may vary in another.
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
    finite::clamp_opacity(&mut grid.opacity);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::{Fixture, param};
    use crate::shading::ShaderThread;
    use crate::shading::ShadingContext;
    use granita_base::{Params, ShapeDesc};
    use granita_scene::Primitive;
    use granita_trace::TriangleMesh;

    fn with_member<T>(
        fixture: &Fixture,
        primitive: &Arc<Primitive>,
        then: impl FnOnce(Member, &mut ShaderThread<'_>) -> T,
    ) -> T {
        let (scene, camera, environment) = fixture.finish();
        let frame = ShadingContext::new(&scene, &camera, &environment);
        let object = frame.object(primitive);
        let mut thread = ShaderThread::new(&frame);
        let member = prepare(primitive, &object, false, &mut thread).unwrap();
        then(member, &mut thread)
    }

    fn parts_of(fixture: &Fixture, primitive: &Arc<Primitive>, level: Level) -> Vec<(RayMesh, TriangleMesh)> {
        with_member(fixture, primitive, |member, thread| {
            let Member::Solid(solid) = member else { panic!("a mesh") };
            (0..solid.parts.len()).map(|k| solid.tessellate(k as u32, level, thread).unwrap()).collect()
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
        // 640 x 480 pixels, 90 degrees: at distance 7 to 11 a pixel is 0.03 to 0.05 units.
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
        // Half as many segments each way from level to level.
        assert!((1000..100_000).contains(&counts[0]), "{counts:?}");
        assert!(counts.windows(2).all(|w| w[1] * 2 < w[0]), "{counts:?}");
    }

    #[test]
    fn a_polygon_is_two_triangles() {
        let mut f = Fixture::new(&[]);
        let floor = f.attributes("", &["set"], &[]);
        let floor = f.rectangle([-1.0, -2.0], [3.0, 2.0], 0.5, floor);
        with_member(&f, &floor, |member, _| match member {
            Member::Flat(flat) => assert_eq!(flat.facets(), 1),
            Member::Solid(_) => panic!("tessellated"),
        });
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
        let (mesh, object) = with_member(&f, &floor, |member, thread| {
            let Member::Flat(flat) = member else { panic!("tessellated") };
            (flat.mesh_of(&[0], thread).unwrap(), flat.object)
        });
        for k in 0..2 {
            let corners = mesh.corners(k);
            let corner = |i: usize| corners[i];
            let (b1, b2) = (0.3, 0.2);
            let p = corner(0) * (1.0 - b1 - b2) + corner(1) * b1 + corner(2) * b2;
            let hit = MeshHit { triangle: k, b1, b2, p, i: -Vec3::Z, width: 0.01 };
            let grid = grid_of(&[(&mesh, hit)], &object, plain());
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
