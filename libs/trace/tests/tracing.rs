//! Tests of the tree against all triangles one by one, with closed surfaces, motion, scale and unusual rays.

use granita_base::{Vec3, hash};
use granita_trace::{Hit, Ray, Tracer, TracerBuilder, TriangleMesh};
use proptest::prelude::*;

fn build(meshes: Vec<TriangleMesh>) -> Tracer {
    let mut builder = TracerBuilder::new();
    for mesh in meshes {
        builder.add(mesh);
    }
    builder.build(2)
}

fn still(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> TriangleMesh {
    TriangleMesh { times: vec![0.0], positions: vec![positions], triangles }
}

fn ray(origin: Vec3, dir: Vec3) -> Ray {
    Ray { origin, tmin: 0.0, dir, tmax: f32::INFINITY, time: 0.0 }
}

fn closest(tracer: &Tracer, ray: Ray) -> Hit {
    let mut hits = [Hit::MISS];
    tracer.closest(&[ray], &mut hits);
    hits[0]
}

fn random(seed: u32, i: u32) -> f32 {
    hash::unit(hash::words(&[seed, i])) * 2.0 - 1.0
}

fn random_point(seed: u32, i: u32) -> Vec3 {
    Vec3::new(random(seed, i * 3), random(seed, i * 3 + 1), random(seed, i * 3 + 2))
}

/// Puts every triangle into a tracer of its own, so that the tree has no effect.
fn brute_force(meshes: &[TriangleMesh], ray: Ray) -> Hit {
    let mut best = Hit::MISS;
    for (m, mesh) in meshes.iter().enumerate() {
        for (t, &triangle) in mesh.triangles.iter().enumerate() {
            let one = build(vec![TriangleMesh { triangles: vec![triangle], ..mesh.clone() }]);
            let hit = closest(&one, ray);
            if hit.is_hit() && (hit.t, m as u32, t as u32) < (best.t, best.mesh, best.triangle) {
                best = Hit { mesh: m as u32, triangle: t as u32, ..hit };
            }
        }
    }
    best
}

/// Returns a sphere of `2 * n * n` triangles.
fn sphere(n: u32) -> TriangleMesh {
    let mut positions = Vec::new();
    for j in 0..=n {
        for i in 0..n {
            let (t, p) =
                (i as f32 / n as f32 * std::f32::consts::TAU, j as f32 / n as f32 * std::f32::consts::PI);
            positions.push(Vec3::new(t.cos() * p.sin(), t.sin() * p.sin(), p.cos()));
        }
    }
    // There is one vertex at each pole, so that the surface is closed.
    let at = |i: u32, j: u32| {
        if j == 0 {
            0
        } else if j == n {
            n * n
        } else {
            j * n + i % n
        }
    };
    let mut triangles = Vec::new();
    for j in 0..n {
        for i in 0..n {
            triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    still(positions, triangles)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn tree_equals_brute_force(seed: u32, n in 1_u32..80, size in 0.05_f32..1.0) {
        let soup = |seed: u32, moving: bool| {
            let corners = |shift: f32| (0..n * 3).map(|i| {
                random_point(seed, i / 3) + random_point(seed ^ 1, i) * size + shift * random_point(seed ^ 2, i)
            }).collect::<Vec<_>>();
            TriangleMesh {
                times: if moving { vec![0.0, 1.0] } else { vec![0.0] },
                positions: if moving { vec![corners(0.0), corners(1.0)] } else { vec![corners(0.0)] },
                triangles: (0..n).map(|i| [i * 3, i * 3 + 1, i * 3 + 2]).collect(),
            }
        };
        let meshes = vec![soup(seed, false), soup(seed ^ 77, true)];
        let tracer = build(meshes.clone());
        for i in 0..20 {
            let mut dir = random_point(seed ^ 5, i);
            if i % 4 == 0 { dir[(i / 4 % 3) as usize] = 0.0; }
            if i % 5 == 0 { dir = Vec3::new(0.0, -0.0, dir.z); }
            let r = Ray { time: i as f32 / 19.0, ..ray(random_point(seed ^ 4, i) * 2.0, dir) };
            let (a, b) = (closest(&tracer, r), brute_force(&meshes, r));
            prop_assert_eq!(a, b);
            let mut blocked = [false];
            tracer.any(&[r], &mut blocked);
            prop_assert_eq!(blocked[0], b.is_hit());
            if b.is_hit() {
                // Without the closest triangle the next one is found, which is not nearer.
                let next = tracer.closest_where(&r, &mut |h| (h.mesh, h.triangle) != (b.mesh, b.triangle));
                prop_assert!(!next.is_hit() || next.t >= b.t);
                let shorter = Ray { tmax: b.t * 0.999, ..r };
                prop_assert!(!closest(&tracer, shorter).is_hit());
            }
        }
    }

    #[test]
    fn no_ray_passes_through_closed_surfaces(seed: u32, scale_exp in -30_i32..30, far in 0.0_f32..100.0) {
        let scale = 2.0_f32.powi(scale_exp);
        let shift = random_point(seed, 9) * far * scale;
        let mut mesh = sphere(24);
        for p in &mut mesh.positions[0] { *p = *p * scale + shift; }
        let tracer = build(vec![mesh.clone()]);
        let inside = shift + random_point(seed, 3) * 0.3 * scale;
        for i in 0..300 {
            // Rays are aimed at vertices, at middles of edges, and at other points.
            let [a, b, _] = mesh.triangles[(i * 7 % mesh.triangles.len() as u32) as usize];
            let (a, b) = (mesh.positions[0][a as usize], mesh.positions[0][b as usize]);
            let dir = match i % 3 { 0 => a - inside, 1 => (a + b) * 0.5 - inside, _ => random_point(seed, i) };
            prop_assert!(closest(&tracer, ray(inside, dir)).is_hit(), "{} {}", i, dir);
        }
    }
}

#[test]
fn equal_hits_resolve_to_the_smallest_index() {
    let square = vec![Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Y, Vec3::Y];
    // The same triangles are repeated many times in several meshes.
    let many: Vec<[u32; 3]> = (0..50).flat_map(|_| [[0, 1, 2], [0, 2, 3]]).collect();
    let tracer = build(vec![still(square.clone(), many.clone()), still(square, many)]);
    for (x, y) in [(0.3, 0.2), (0.2, 0.3), (0.5, 0.5), (0.0, 0.0), (1.0, 1.0)] {
        let hit = closest(&tracer, ray(Vec3::new(x, y, 3.0), -Vec3::Z));
        assert_eq!((hit.t, hit.mesh), (3.0, 0));
        assert_eq!(hit.triangle, u32::from(y > x));
    }
    // The order is the same when the first hit is not accepted.
    let r = ray(Vec3::new(0.3, 0.2, 3.0), -Vec3::Z);
    let hit = tracer.closest_where(&r, &mut |h| h.mesh == 1 && h.triangle > 10);
    assert_eq!((hit.mesh, hit.triangle), (1, 12));
}

#[test]
fn barycentric_weights_give_the_hit_point() {
    let p = [Vec3::new(0.0, 0.0, 1.0), Vec3::new(2.0, 0.0, 2.0), Vec3::new(0.0, 3.0, 0.0)];
    let tracer = build(vec![still(p.to_vec(), vec![[0, 1, 2]])]);
    let r = ray(Vec3::new(0.4, 0.9, 5.0), Vec3::new(0.02, -0.03, -2.0));
    let hit = closest(&tracer, r);
    let on_triangle = p[0] * (1.0 - hit.b1 - hit.b2) + p[1] * hit.b1 + p[2] * hit.b2;
    assert!((r.origin + r.dir * hit.t - on_triangle).length() < 1e-5);
    // The triangle is also hit from behind.
    assert!(closest(&tracer, ray(Vec3::new(0.4, 0.9, -5.0), Vec3::Z)).is_hit());
}

#[test]
fn moving_triangles_are_hit_where_they_are() {
    let p = [Vec3::ZERO, Vec3::X, Vec3::Y];
    let up = |z: f32| p.iter().map(|p| *p + Vec3::Z * z).collect::<Vec<_>>();
    let mesh = TriangleMesh {
        times: vec![0.0, 0.5, 1.0],
        positions: vec![up(0.0), up(1.0), up(5.0)],
        triangles: vec![[0, 1, 2]],
    };
    let tracer = build(vec![mesh]);
    for (time, z) in [(0.0, 0.0), (0.25, 0.5), (0.5, 1.0), (0.75, 3.0), (1.0, 5.0)] {
        let r = Ray { time, ..ray(Vec3::new(0.2, 0.2, 10.0), -Vec3::Z) };
        assert_eq!(closest(&tracer, r).t, 10.0 - z, "{time}");
    }
    // The mesh does not exist before and after its keys.
    for time in [-1.0, -1e-6, 1.000_001, 7.0] {
        assert!(
            !closest(&tracer, Ray { time, ..ray(Vec3::new(0.2, 0.2, 10.0), -Vec3::Z) }).is_hit(),
            "{time}"
        );
    }
    assert!(!closest(&tracer, Ray { time: f32::NAN, ..ray(Vec3::new(0.2, 0.2, 10.0), -Vec3::Z) }).is_hit());
}

#[test]
fn invalid_rays_and_triangles_are_never_hit() {
    let empty = build(vec![]);
    assert!(!closest(&empty, ray(Vec3::ZERO, Vec3::Z)).is_hit());
    assert!(empty.bound().is_empty());
    let p = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::splat(f32::NAN), Vec3::splat(f32::INFINITY)];
    // Triangles with indices out of range, vertices that are not finite, or no area are never hit and never block
    // others.
    let triangles = vec![[0, 1, 9], [0, 1, 3], [0, 4, 2], [0, 0, 0], [0, 1, 1], [0, 1, 2]];
    let bad =
        TriangleMesh { times: vec![1.0, 0.0], positions: vec![p.clone(); 2], triangles: triangles.clone() };
    let short =
        TriangleMesh { times: vec![0.0, 1.0], positions: vec![p.clone()], triangles: triangles.clone() };
    let tracer = build(vec![bad, short, TriangleMesh::default(), still(p, triangles)]);
    let good = ray(Vec3::new(0.25, 0.25, 1.0), -Vec3::Z);
    let hit = closest(&tracer, good);
    assert_eq!((hit.mesh, hit.triangle, hit.t), (3, 5, 1.0));
    let nan = f32::NAN;
    for bad in [
        Ray { dir: Vec3::ZERO, ..good },
        Ray { dir: Vec3::new(0.0, nan, -1.0), ..good },
        Ray { dir: Vec3::new(0.0, f32::INFINITY, -1.0), ..good },
        Ray { origin: Vec3::new(nan, 0.25, 1.0), ..good },
        Ray { origin: Vec3::new(0.25, 0.25, f32::INFINITY), ..good },
        Ray { tmin: nan, ..good },
        Ray { tmax: nan, ..good },
        Ray { tmin: 2.0, tmax: 1.0, ..good },
        Ray { tmax: 0.5, ..good },
        Ray { tmin: 1.5, ..good },
    ] {
        assert_eq!(closest(&tracer, bad), Hit::MISS, "{bad:?}");
    }
    // Both ends of the range are included. Distances may be negative.
    assert!(closest(&tracer, Ray { tmin: 1.0, tmax: 1.0, ..good }).is_hit());
    assert_eq!(closest(&tracer, Ray { tmin: -5.0, dir: Vec3::Z, ..good }).t, -1.0);
    // Rays within the plane of a triangle miss it.
    assert!(!closest(&tracer, ray(Vec3::new(-1.0, 0.2, 0.0), Vec3::X)).is_hit());
}

#[test]
fn ray_directions_may_have_any_length() {
    let p = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
    let tracer = build(vec![still(p, vec![[0, 1, 2]])]);
    for exp in [-37, -30, -10, 0, 10, 30, 37] {
        let length = 10.0_f32.powi(exp);
        let hit = closest(&tracer, ray(Vec3::new(0.25, 0.25, 2.0), Vec3::Z * -length));
        assert!((hit.t * length - 2.0).abs() < 1e-5, "{exp}: {hit:?}");
    }
    let hit = closest(&tracer, ray(Vec3::new(0.25, 0.25, 1e-3), Vec3::Z * -1e-40));
    assert!(hit.is_hit());
}

#[test]
fn rays_hit_scenes_of_any_size() {
    for exp in [-36, -20, 0, 20, 36] {
        let s = 10.0_f32.powi(exp);
        let mut mesh = sphere(12);
        mesh.positions[0].iter_mut().for_each(|p| *p *= s);
        let tracer = build(vec![mesh]);
        for i in 0..200 {
            let hit = closest(&tracer, ray(Vec3::ZERO, random_point(3, i) * s));
            assert!(hit.is_hit(), "{exp} {i}");
        }
    }
}

#[test]
fn batches_equal_single_rays() {
    let tracer = build(vec![sphere(20)]);
    let rays: Vec<Ray> = (0..500).map(|i| ray(random_point(1, i) * 2.0, random_point(2, i))).collect();
    let mut hits = vec![Hit::MISS; rays.len()];
    let mut blocked = vec![false; rays.len()];
    tracer.closest(&rays, &mut hits);
    tracer.any(&rays, &mut blocked);
    for (i, r) in rays.iter().enumerate() {
        assert_eq!(hits[i], closest(&tracer, *r));
        assert_eq!(blocked[i], hits[i].is_hit());
        assert_eq!(hits[i], tracer.closest_where(r, &mut |_| true));
    }
    assert!(blocked.iter().any(|b| *b) && blocked.iter().any(|b| !*b));
}

/// Möller and Trumbore's test in double precision. It returns the distance and the least of the three weights.
fn double(p: [Vec3; 3], ray: &Ray) -> Option<(f64, f64)> {
    let d = |v: Vec3| [f64::from(v.x), f64::from(v.y), f64::from(v.z)];
    let sub = |a: [f64; 3], b: [f64; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let (e1, e2, s) = (sub(d(p[1]), d(p[0])), sub(d(p[2]), d(p[0])), sub(d(ray.origin), d(p[0])));
    let h = cross(d(ray.dir), e2);
    let det = dot(e1, h);
    if det == 0.0 {
        return None;
    }
    let (b1, q) = (dot(s, h) / det, cross(s, e1));
    let b2 = dot(d(ray.dir), q) / det;
    Some((dot(e2, q) / det, b1.min(b2).min(1.0 - b1 - b2)))
}

#[test]
fn hits_equal_those_of_double_precision() {
    let mut mesh = sphere(24);
    // The surface has waves, so that rays pass through it several times.
    for (i, p) in mesh.positions[0].iter_mut().enumerate() {
        *p *= 1.0 + 0.3 * random(7, i as u32);
    }
    let tracer = build(vec![mesh.clone()]);
    for i in 0..5000 {
        let r = ray(random_point(1, i) * 2.0, random_point(2, i));
        let hit = closest(&tracer, r);
        // The hit of the tree is valid, and no certain hit lies before it.
        let corners = |t: usize| mesh.triangles[t].map(|v| mesh.positions[0][v as usize]);
        if hit.is_hit() {
            let (t, weight) = double(corners(hit.triangle as usize), &r).unwrap();
            assert!((t - f64::from(hit.t)).abs() < 1e-6 * t && weight > -1e-4, "{i}: {hit:?} {t} {weight}");
        }
        for t in 0..mesh.triangles.len() {
            let Some((t, weight)) = double(corners(t), &r) else { continue };
            assert!(!(weight > 1e-4 && t > 0.0 && t < f64::from(hit.t) * (1.0 - 1e-6)), "{i}: {hit:?} {t}");
        }
    }
}

#[test]
fn no_ray_passes_between_triangles() {
    let n = 96;
    let mut mesh = sphere(n);
    for (i, p) in mesh.positions[0].iter_mut().enumerate() {
        *p *= 1.0 + 0.2 * random(11, i as u32);
    }
    let tracer = build(vec![mesh.clone()]);
    let p = &mesh.positions[0];
    let mut rays = Vec::new();
    for (k, t) in mesh.triangles.iter().enumerate() {
        let k = k as u32;
        let [a, b, c] = t.map(|v| p[v as usize]);
        let origin = random_point(5, k) * 0.3;
        // Rays are aimed at vertices and at points on edges.
        let targets = [a, a + (b - a) * hash::unit(k), b + (c - b) * 0.5, c + (a - c) * hash::unit(k ^ 77)];
        rays.extend(targets.map(|p| ray(origin, p - origin)));
    }
    let mut hits = vec![Hit::MISS; rays.len()];
    tracer.closest(&rays, &mut hits);
    for (ray, hit) in rays.iter().zip(&hits) {
        assert!(hit.is_hit(), "{ray:?}");
    }
}

#[test]
fn large_batches_equal_single_rays_in_any_order() {
    let tracer = build(vec![sphere(40)]);
    let rays: Vec<Ray> =
        (0..300_000).map(|i| ray(random_point(1, i % 30_011) * 2.0, random_point(2, i % 20_011))).collect();
    let mut hits = vec![Hit::MISS; rays.len()];
    tracer.closest(&rays, &mut hits);
    let mut back = vec![Hit::MISS; rays.len()];
    let reversed: Vec<Ray> = rays.iter().rev().copied().collect();
    tracer.closest(&reversed, &mut back);
    back.reverse();
    assert_eq!(hits, back);
    for i in (0..rays.len()).step_by(97) {
        assert_eq!(hits[i], closest(&tracer, rays[i]));
    }
}
