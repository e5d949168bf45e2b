//! The meshes and rays with which trees are measured.

use granita_base::{Location, ParamData, Reporter, ShapeDesc, Vec3, hash};
use granita_scene::{Call, GeneratorSource, SceneSink, Stop};
use granita_trace::{Hit, Ray, Tracer, TriangleMesh};
use std::path::Path;

/// The number of pixels of each side of the camera's image. The other kinds have as many rays.
const SIDE: u32 = 1024;
/// The kinds of rays whose coherence differs.
pub const KINDS: [&str; 3] = ["camera", "random", "bounce"];
/// The kinds of rays that come in blocks of similar rays, as those of a renderer do: a camera's in tiles of 8 x 8
/// pixels, and those from the visible surface to a light in grids of 16 x 16 points.
pub const BLOCKS: [&str; 2] = ["tiles", "shadow"];

fn random(i: u32, d: u32) -> f32 {
    hash::unit(hash::words(&[i, d]))
}

/// Returns a direction, distributed uniformly over the sphere.
fn direction(i: u32, d: u32) -> Vec3 {
    let (z, angle) = (random(i, d) * 2.0 - 1.0, random(i, d + 1) * std::f32::consts::TAU);
    let r = (1.0 - z * z).sqrt();
    Vec3::new(r * angle.cos(), r * angle.sin(), z)
}

/// Returns a million rays of a kind for a mesh: those of a camera, those from around the mesh through its box, or those
/// from its surface.
pub fn rays(mesh: &TriangleMesh, kind: &str) -> Vec<Ray> {
    let p = &mesh.positions[0];
    let lo = p.iter().fold(Vec3::INFINITY, |a, b| a.min(*b));
    let hi = p.iter().fold(Vec3::NEG_INFINITY, |a, b| a.max(*b));
    let (middle, radius) = ((lo + hi) * 0.5, (hi - lo).length() * 0.5);
    let eye = middle + Vec3::new(0.3, 0.4, -2.2) * radius;
    let forward = (middle - eye).normalize_or_zero();
    let right = forward.cross(Vec3::Y).normalize_or_zero();
    let up = right.cross(forward);
    let ray = |i: u32| match kind {
        "camera" => {
            let at = |k: u32| ((k as f32 + 0.5) / SIDE as f32 * 2.0 - 1.0) * 0.42;
            (eye, forward + right * at(i % SIDE) + up * at(i / SIDE))
        }
        "random" => {
            let origin = middle + direction(i, 0) * radius * 1.5;
            let target = lo + Vec3::new(random(i, 2), random(i, 3), random(i, 4)) * (hi - lo);
            (origin, target - origin)
        }
        _ => {
            let t =
                mesh.triangles[(random(i, 5) * mesh.triangles.len() as f32) as usize % mesh.triangles.len()];
            let [a, b, c] = t.map(|v| p[v as usize]);
            let (s, u) = (random(i, 6).sqrt(), random(i, 7));
            let normal = (b - a).cross(c - a).normalize_or_zero();
            // The directions are distributed by the cosine, and the origins lie slightly above the surface.
            let at = a * (1.0 - s) + b * (s * (1.0 - u)) + c * (s * u);
            (at + normal * 1e-4 * radius, normal + direction(i, 8) * 0.999)
        }
    };
    (0..SIDE * SIDE)
        .map(ray)
        .map(|(origin, dir)| Ray { origin, tmin: 0.0, dir, tmax: f32::INFINITY, time: 0.0 })
        .collect()
}

/// Returns the rays of a kind of [`BLOCKS`] for a mesh and its tracer. The shadow rays are those of the pixels that
/// show the mesh.
pub fn blocks(mesh: &TriangleMesh, tracer: &Tracer, kind: &str) -> Vec<Ray> {
    let camera = rays(mesh, "camera");
    let tiled = |size: u32| -> Vec<Ray> {
        let per_row = SIDE / size;
        let at = |i: u32| {
            let (tile, own) = (i / (size * size), i % (size * size));
            let (x, y) = (tile % per_row * size + own % size, tile / per_row * size + own / size);
            camera[(y * SIDE + x) as usize]
        };
        (0..SIDE * SIDE).map(at).collect()
    };
    if kind == "tiles" {
        return tiled(8);
    }
    let eyes = tiled(16);
    let mut hits = vec![Hit::MISS; eyes.len()];
    tracer.closest(&eyes, &mut hits);
    let bound = tracer.bound();
    let radius = (bound.max - bound.min).length() * 0.5;
    let light = (bound.min + bound.max) * 0.5 + Vec3::new(-1.0, 2.0, -1.5) * radius;
    let of = |(eye, hit): (&Ray, &Hit)| {
        let origin = eye.origin + eye.dir * (hit.t * 0.9999);
        let to_light = light - origin;
        let distance = to_light.length();
        Ray { origin, tmin: 1e-4 * radius, dir: to_light / distance, tmax: distance * 0.999, time: 0.0 }
    };
    eyes.iter().zip(&hits).filter(|(_, hit)| hit.is_hit()).map(of).collect()
}

/// Returns a closed sphere of `n * n` triangles with waves of several lengths. The normals of its triangles point
/// inward.
pub fn sphere(n: u32) -> TriangleMesh {
    let (around, down) = (n, n / 2);
    let mut positions = Vec::with_capacity((around * (down + 1)) as usize);
    for j in 0..=down {
        for i in 0..around {
            let (t, f) = (
                i as f32 / around as f32 * std::f32::consts::TAU,
                j as f32 / down as f32 * std::f32::consts::PI,
            );
            let p = Vec3::new(t.cos() * f.sin(), t.sin() * f.sin(), f.cos());
            let waves = 0.05 * (9.0 * p.x).sin() * (7.0 * p.y).cos()
                + 0.02 * (31.0 * p.z + 5.0 * p.x).sin() * (37.0 * p.y).cos()
                + 0.004 * (150.0 * p.x).sin() * (170.0 * p.y).sin() * (160.0 * p.z).sin();
            positions.push(p * (1.0 + waves));
        }
    }
    let at = |i: u32, j: u32| j * around + i % around;
    let mut triangles = Vec::with_capacity((2 * around * down) as usize);
    for j in 0..down {
        for i in 0..around {
            triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    TriangleMesh { times: vec![0.0], positions: vec![positions], triangles }
}

/// Returns `n` random triangles of all sizes up to a tenth of the box that they lie in.
pub fn soup(n: u32) -> TriangleMesh {
    let vertex = |t: u32, v: u32| {
        let at = |seed: u32, d: u32| random(seed, d) * 2.0 - 1.0;
        let size = 0.1 * random(t, 20).powi(4);
        let middle = Vec3::new(at(t, 21), at(t, 22), at(t, 23));
        middle + size * Vec3::new(at(t, 24 + 3 * v), at(t, 25 + 3 * v), at(t, 26 + 3 * v))
    };
    let positions = (0..n).flat_map(|t| (0..3).map(move |v| vertex(t, v))).collect();
    let triangles = (0..n).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    TriangleMesh { times: vec![0.0], positions: vec![positions], triangles }
}

/// A sink that collects the meshes of a file as triangles.
#[derive(Default)]
struct Meshes {
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

impl SceneSink for Meshes {
    fn call(&mut self, call: Call, _: &Location) -> Result<(), Stop> {
        let Call::Shape { shape, params } = call else { return Ok(()) };
        let ShapeDesc::Mesh { nverts, verts, .. } = *shape else { return Ok(()) };
        let Some(p) = params.iter().find(|p| &*p.name == "P") else { return Ok(()) };
        let ParamData::Float(p) = &p.data else { return Ok(()) };
        let base = self.positions.len() as u32;
        self.positions.extend(p.chunks_exact(3).map(|p| Vec3::new(p[0], p[1], p[2])));
        let mut first = 0;
        for &n in nverts.iter() {
            let n = usize::try_from(n).unwrap_or(0);
            let corner = |k: usize| base + verts[first + k] as u32;
            self.triangles.extend((2..n).map(|k| [corner(0), corner(k - 1), corner(k)]));
            first += n;
        }
        Ok(())
    }
}

/// Returns the triangles of a file that a bundled generator reads.
///
/// # Errors
/// Returns a message when no generator reads such files, when the file is damaged, or when it has no triangles.
pub fn read_mesh(file: &Path) -> Result<TriangleMesh, String> {
    let source = GeneratorSource::file(file.to_owned());
    let mut meshes = Meshes::default();
    let silent = Reporter::silent();
    let generators = granita_plugin::bundled_generators();
    let reader = generators.by_extension(file).ok_or_else(|| format!("{}: no mesh file", file.display()))?;
    reader.run(&source, &mut meshes, &silent).map_err(|e| e.to_string())?;
    if meshes.triangles.is_empty() {
        return Err(format!("{}: no triangles", file.display()));
    }
    Ok(TriangleMesh { times: vec![0.0], positions: vec![meshes.positions], triangles: meshes.triangles })
}
