//! Tests of the kernel against a test of all triangles, and of the wide vectors against the portable ones.

use crate::layout::Block;
use crate::packet::{RAYS, is_coherent};
use crate::probe::{Met, Probe, Wide};
use crate::scene::Scene;
use crate::single::{Best, RayScratch};
use crate::trace::{Batch, Task};
use crate::tree::Tree;
use crate::{Hit, Ray, Tracer, TracerBuilder, TriangleMesh};
use granita_base::{Vec3, hash};
use granita_machine::simd::Portable;

fn random(seed: u32, i: u32) -> f32 {
    hash::unit(hash::words(&[seed, i])) * 2.0 - 1.0
}

fn random_point(seed: u32, i: u32) -> Vec3 {
    Vec3::new(random(seed, i * 3), random(seed, i * 3 + 1), random(seed, i * 3 + 2))
}

/// Traces with the vectors of every machine. It is one function, because what it calls is compiled into it.
fn portable(batch: &Batch<'_>, task: Task<'_>, room: &mut RayScratch) {
    batch.run(Portable, task, room);
}

/// Tests all triangles one by one, without a tree.
fn brute_force(scene: &Scene, ray: &Ray) -> Hit {
    let Some(probe) = Probe::new(ray, scene.scale, &scene.bounds) else { return Hit::MISS };
    let wide = Wide::new(Portable, &probe);
    let mut best = Best { met: Met { t: probe.tmax, b1: 0.0, b2: 0.0 }, id: u32::MAX };
    all_of(&scene.still, scene.still.len(), &probe, &wide, &mut best);
    if !scene.moving.is_empty() {
        let moving = scene.moving.at(ray.time);
        all_of(&moving, scene.moving.len(), &probe, &wide, &mut best);
    }
    if best.id == u32::MAX { Hit::MISS } else { scene.hit(&probe, &best.met, best.id) }
}

fn all_of(tree: &impl Tree, blocks: usize, probe: &Probe, wide: &Wide<Portable>, best: &mut Best) {
    let mut room = Block::EMPTY;
    for k in 0..blocks {
        let block = tree.block(k, &mut room);
        // The candidates are found without a limit, so that the order has no effect.
        let mask = wide.candidates(Portable, block, f32::INFINITY);
        for lane in (0..4).filter(|lane| mask >> lane & 1 != 0) {
            let found = probe.meet(&block.vertices(lane), || tree.bounds(block, lane), probe.tmax);
            let Some(met) = found else { continue };
            let id = block.id[lane];
            if best.id == u32::MAX || (met.t, id) < (best.met.t, best.id) {
                *best = Best { met, id };
            }
        }
    }
}

/// Returns still and moving triangles of all sizes including zero, some coincident and some with shared edges.
fn soup(seed: u32, n: u32) -> Tracer {
    let corners = |shift: f32| {
        let at = |i: u32| {
            let t = i / 3;
            // Some triangles are on a grid, where many coincide.
            let middle = match t % 4 {
                0 => (random_point(seed, t / 2) * 4.0).round() * 0.25,
                _ => random_point(seed, t),
            };
            let size = 2.0_f32.powi((hash::words(&[seed, t, 5]) % 12) as i32 - 10);
            let p = match t % 7 {
                0 => middle + (random_point(seed ^ 1, i) * 2.0).round() * 0.25,
                1 => middle,
                2 => middle + Vec3::X * random(seed ^ 1, i) * size,
                _ => middle + random_point(seed ^ 1, i) * size,
            };
            p + random_point(seed ^ 2, i) * shift
        };
        (0..n * 3).map(at).collect::<Vec<_>>()
    };
    let triangles: Vec<[u32; 3]> = (0..n).map(|i| [i * 3, i * 3 + 1, i * 3 + 2]).collect();
    let mut builder = TracerBuilder::new();
    let still =
        TriangleMesh { times: vec![0.0], positions: vec![corners(0.0)], triangles: triangles.clone() };
    builder.add(still.clone());
    builder.add(TriangleMesh {
        times: vec![0.0, 0.3, 1.0],
        positions: vec![corners(0.0), corners(0.2), corners(0.7)],
        triangles: triangles[..n as usize / 4].to_vec(),
    });
    builder.add(TriangleMesh {
        times: vec![0.2, 0.7],
        positions: vec![corners(0.5), corners(0.0)],
        triangles: triangles[..n as usize / 8].to_vec(),
    });
    // The meshes are added twice, which makes ties.
    builder.add(still);
    builder.build(1)
}

/// Returns rays of all kinds: from inside and from far away, along axes, in planes, through vertices, with ranges and
/// with unusual values.
fn odd_ray(seed: u32, i: u32) -> Ray {
    let mut origin = random_point(seed, 2 * i) * 1.5;
    let mut dir = random_point(seed, 2 * i + 1);
    let pick = hash::words(&[seed, i, 9]);
    match pick % 16 {
        0 => origin = (origin * 4.0).round() * 0.25,
        1 => dir = (dir * 1.5).round(),
        2 => {
            origin = (origin * 4.0).round() * 0.25;
            dir = (dir * 1.5).round();
        }
        3 => dir.x = 0.0,
        4 => dir = Vec3::new(-0.0, dir.y, 0.0),
        5 => {
            origin *= 1000.0;
            dir = random_point(seed, i) - origin;
        }
        6 => dir *= 1e-30,
        7 => dir *= 1e30,
        8 => dir.y = 1e-39,
        9 => dir = random_point(seed ^ 1, pick % 97) - origin,
        10 if pick.is_multiple_of(5) => {
            dir[(pick / 7 % 3) as usize] = [f32::NAN, f32::INFINITY][(pick / 3 % 2) as usize]
        }
        11 if pick.is_multiple_of(5) => origin.z = [f32::NAN, f32::MAX][(pick / 3 % 2) as usize],
        _ => {}
    }
    let (tmin, tmax) = match pick / 16 % 8 {
        0 => (-1.0, 1.0),
        1 => (0.5, 0.75),
        2 => (0.0, 0.5),
        _ => (0.0, f32::INFINITY),
    };
    Ray { origin, tmin, dir, tmax, time: random(seed, i) * 0.7 + 0.5 }
}

#[test]
fn a_million_rays_equal_brute_force() {
    let mut found = 0;
    for seed in 0..8 {
        let tracer = soup(seed, 40);
        let rays: Vec<Ray> = (0..125_000).map(|i| odd_ray(seed, i)).collect();
        let mut hits = vec![Hit::MISS; rays.len()];
        let mut blocked = vec![false; rays.len()];
        tracer.closest(&rays, &mut hits);
        tracer.any(&rays, &mut blocked);
        for (k, ray) in rays.iter().enumerate() {
            let all = brute_force(&tracer.scene, ray);
            assert_eq!(hits[k], all, "{seed} {k} {ray:?}");
            assert_eq!(blocked[k], all.is_hit(), "{seed} {k} {ray:?}");
            found += usize::from(all.is_hit());
        }
    }
    assert!((100_000..900_000).contains(&found), "{found}");
}

/// Returns rays that are similar to one ray of [`odd_ray`], with some that are not.
fn bundle(seed: u32, i: u32) -> Vec<Ray> {
    let first = odd_ray(seed, i);
    let pick = hash::words(&[seed, i, 10]);
    let similar = |k: u32| {
        let (mut origin, mut dir) = (first.origin, first.dir);
        let size = 0.1 * dir.length();
        match pick % 5 {
            0 => dir += random_point(k, i) * size,
            1 => origin += random_point(k, i) * 0.1,
            // Origins on planes of triangles, and directions without rounding errors.
            2 => origin += (random_point(k, i) * 1.4).round() * 0.125,
            3 => dir = (dir / size * 2.0).round() + Vec3::new(0.0, random(k, i).round(), 0.0),
            _ => {
                dir += random_point(k, i) * size;
                origin += random_point(k, i + 1) * 0.1;
            }
        }
        Ray { origin, dir, time: odd_ray(k, i).time, ..first }
    };
    let odd = |k: u32| k % 11 == 3 && !k.is_multiple_of(7) && !pick.is_multiple_of(3);
    let n = 10 + hash::words(&[seed, i, 11]) % 200;
    (0..n).map(|k| if odd(k) { odd_ray(seed ^ k, i) } else { similar(k) }).collect()
}

#[test]
fn packets_equal_brute_force() {
    let (mut found, mut together, mut total) = (0, 0, 0);
    for seed in 0..8 {
        let tracer = soup(seed, 40);
        let scene = &tracer.scene;
        for i in 0..400 {
            let rays = bundle(seed, i);
            total += rays.len();
            together +=
                rays.chunks(RAYS).filter(|rays| is_coherent(rays, scene)).map(<[Ray]>::len).sum::<usize>();
            let batch = Batch { scene, rays: &rays, order: None };
            let (mut hits, mut plain) = (vec![Hit::MISS; rays.len()], vec![Hit::MISS; rays.len()]);
            let (mut blocked, mut open) = (vec![false; rays.len()], vec![true; rays.len()]);
            let mut room = RayScratch::default();
            batch.trace(Task::Closest(&mut hits), &mut room);
            portable(&batch, Task::Closest(&mut plain), &mut room);
            batch.trace(Task::Any(&mut blocked), &mut room);
            portable(&batch, Task::Any(&mut open), &mut room);
            for (k, ray) in rays.iter().enumerate() {
                let all = bits(&brute_force(scene, ray));
                assert_eq!(bits(&hits[k]), all, "{seed} {i} {k} {ray:?}");
                assert_eq!(bits(&plain[k]), all, "{seed} {i} {k} {ray:?}");
                assert_eq!([blocked[k], open[k]], [hits[k].is_hit(); 2], "{seed} {i} {k} {ray:?}");
                found += usize::from(hits[k].is_hit());
            }
        }
    }
    assert!((total / 10..total * 9 / 10).contains(&found), "{found} of {total}");
    assert!(together > total / 2, "{together} of {total}");
}

fn bits(h: &Hit) -> (u32, u32, u32, u32, u32) {
    (h.t.to_bits(), h.mesh, h.triangle, h.b1.to_bits(), h.b2.to_bits())
}

#[test]
fn wide_and_portable_traversal_agree_to_the_bit() {
    let tracer = soup(99, 500);
    let rays: Vec<Ray> = (0..20_000).map(|i| odd_ray(99, i)).collect();
    let batch = Batch { scene: &tracer.scene, rays: &rays, order: None };
    let (mut wide, mut plain) = (vec![Hit::MISS; rays.len()], vec![Hit::MISS; rays.len()]);
    let mut room = RayScratch::default();
    batch.trace(Task::Closest(&mut wide), &mut room);
    portable(&batch, Task::Closest(&mut plain), &mut room);
    for (a, b) in wide.iter().zip(&plain) {
        assert_eq!(bits(a), bits(b));
    }
    for (ray, hit) in rays.iter().zip(&plain) {
        assert_eq!(bits(&tracer.closest_of_one(ray, &mut room)), bits(hit));
        assert_eq!(tracer.any_of_one(ray, &mut room), hit.is_hit());
    }
    let (mut wide, mut plain) = (vec![false; rays.len()], vec![false; rays.len()]);
    batch.trace(Task::Any(&mut wide), &mut room);
    portable(&batch, Task::Any(&mut plain), &mut room);
    assert_eq!(wide, plain);
    for (ray, k) in rays.iter().zip(0..500) {
        let mut asked = |wide: bool| {
            let (mut hit, mut list) = (Hit::MISS, Vec::new());
            let batch = Batch { scene: &tracer.scene, rays: std::slice::from_ref(ray), order: None };
            let mut accept = |h: &Hit| {
                list.push(bits(h));
                h.triangle % 3 == k % 3
            };
            let task = Task::Where(&mut hit, &mut accept);
            if wide {
                batch.trace(task, &mut room)
            } else {
                portable(&batch, task, &mut room)
            }
            (bits(&hit), list)
        };
        assert_eq!(asked(true), asked(false));
    }
}

#[test]
fn trees_do_not_depend_on_threads() {
    let n = 40_000;
    let positions: Vec<Vec3> =
        (0..n * 3).map(|i| random_point(3, i / 3) + random_point(4, i) * 0.01).collect();
    let triangles: Vec<[u32; 3]> = (0..n).map(|i| [i * 3, i * 3 + 1, i * 3 + 2]).collect();
    let build = |threads| {
        let mut builder = TracerBuilder::new();
        let mesh = TriangleMesh {
            times: vec![0.0],
            positions: vec![positions.clone()],
            triangles: triangles.clone(),
        };
        builder.add(mesh);
        builder.build(threads)
    };
    let one = build(1);
    let rays: Vec<Ray> = (0..5000).map(|i| odd_ray(3, i)).collect();
    let hits = |tracer: &Tracer| {
        let mut hits = vec![Hit::MISS; rays.len()];
        tracer.closest(&rays, &mut hits);
        hits
    };
    for threads in [0, 2, 3, 16] {
        let other = build(threads);
        assert_eq!(one.bytes(), other.bytes());
        assert_eq!(hits(&one), hits(&other));
    }
}

#[test]
fn trees_of_indistinguishable_items_are_shallow() {
    // The sizes are all equal, or each is a thousandth of the one before.
    for scale in [1.0, 1e-3] {
        let size = |i: u32| 1e18_f32 * f32::powi(scale, (i % 12) as i32);
        let positions: Vec<Vec3> = (0..30_000).map(|i| random_point(1, i % 3) * size(i / 3)).collect();
        let triangles: Vec<[u32; 3]> = (0..10_000).map(|i| [i * 3, i * 3 + 1, i * 3 + 2]).collect();
        let mut builder = TracerBuilder::new();
        builder.add(TriangleMesh { times: vec![0.0], positions: vec![positions], triangles });
        let tracer = builder.build(1);
        for i in 0..50 {
            let ray = Ray { tmax: f32::INFINITY, ..odd_ray(1, i) };
            let mut hit = [Hit::MISS];
            tracer.closest(&[ray], &mut hit);
            assert_eq!(hit[0], brute_force(&tracer.scene, &ray));
        }
    }
}

/// Returns a closed, bumpy ball of `n` by `2 n` quads of two triangles each, with slivers at the poles.
fn ball(n: u32) -> TriangleMesh {
    let mut positions = Vec::new();
    for j in 0..=n {
        for i in 0..2 * n {
            let (t, f) = (i as f32 / n as f32, j as f32 / n as f32);
            let (t, f) = (t * std::f32::consts::PI, f * std::f32::consts::PI);
            let pole = j == 0 || j == n;
            let p = if pole {
                Vec3::Z * f.cos().round()
            } else {
                Vec3::new(t.cos() * f.sin(), t.sin() * f.sin(), f.cos())
            };
            let bump = if pole { 0.0 } else { 0.3 * random(7, j * 1000 + i) };
            positions.push(p * (1.0 + bump) + Vec3::new(0.1, -0.2, 0.3));
        }
    }
    let at = |i: u32, j: u32| j * 2 * n + i % (2 * n);
    let squares = (0..n).flat_map(|j| (0..2 * n).map(move |i| (i, j)));
    let triangles = squares.flat_map(|(i, j)| {
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)];
        [[a, b, c], [d, c, b]]
    });
    let triangles = triangles.collect();
    TriangleMesh { times: vec![0.0], positions: vec![positions], triangles }
}

/// Returns rays from inside of the ball through its vertices and points on its edges, near and far.
fn rays_at_edges(mesh: &TriangleMesh, count: u32) -> Vec<Ray> {
    let p = &mesh.positions[0];
    let ray = |i: u32| {
        let t = mesh.triangles[(hash::words(&[i, 1]) as usize) % mesh.triangles.len()];
        let corner = |k: u32| p[t[(k % 3) as usize] as usize];
        let (a, b) = (corner(hash::words(&[i, 2])), corner(hash::words(&[i, 2]) + 1));
        let part = [0.0, 0.5, 0.25, hash::unit(hash::words(&[i, 3]))][(i % 4) as usize];
        let target = a + (b - a) * part;
        let origin = random_point(5, i) * 0.3 + Vec3::new(0.1, -0.2, 0.3);
        let dir = (target - origin) * [1.0, 1e-5, 3e7][(i % 3) as usize];
        Ray { origin, tmin: 0.0, dir, tmax: f32::INFINITY, time: 0.0 }
    };
    (0..count).map(ray).collect()
}

#[test]
fn no_ray_passes_between_triangles_that_share_an_edge() {
    let mesh = ball(40);
    let rays = rays_at_edges(&mesh, 300_000);
    let whole = {
        let mut builder = TracerBuilder::new();
        builder.add(mesh.clone());
        builder.build(1)
    };
    let mut hits = vec![Hit::MISS; rays.len()];
    whole.closest(&rays, &mut hits);
    assert_eq!(hits.iter().position(|h| !h.is_hit()), None);
    // Rays do not pass between triangles of different tracers within one bound either. Together these find the same
    // hits as one tracer.
    let parts: Vec<Tracer> = (0..7)
        .map(|k| {
            let mut builder = TracerBuilder::within(whole.bound());
            let own = mesh.triangles.iter().enumerate().filter(|(t, _)| t % 7 == k).map(|(_, t)| *t);
            builder.add(TriangleMesh { triangles: own.collect(), ..mesh.clone() });
            builder.build(1)
        })
        .collect();
    for (ray, hit) in rays.iter().zip(&hits).take(100_000) {
        let mut best = Hit::MISS;
        for (k, part) in parts.iter().enumerate() {
            let mut found = [Hit::MISS];
            part.closest(std::slice::from_ref(ray), &mut found);
            let [mut found] = found;
            found.triangle = found.triangle.wrapping_mul(7).wrapping_add(k as u32);
            if found.is_hit() && (found.t, found.triangle) < (best.t, best.triangle) {
                best = found;
            }
        }
        assert_eq!(best, *hit);
    }
}

#[test]
fn triangles_of_borrowed_meshes_are_hit_like_own_ones() {
    struct Lent<'a>(&'a TriangleMesh);
    impl crate::Triangles for Lent<'_> {
        fn count(&self) -> usize {
            self.0.triangles.len()
        }
        fn triangle(&self, t: usize) -> Option<[Vec3; 3]> {
            Some(self.0.triangles[t].map(|v| self.0.positions[0][v as usize]))
        }
    }
    let mut mesh = ball(20);
    mesh.positions[0][55].x = f32::NAN;
    let rays = rays_at_edges(&mesh, 5000);
    let trace = |builder: TracerBuilder<'_>| {
        let mut hits = vec![Hit::MISS; rays.len()];
        builder.build(2).closest(&rays, &mut hits);
        hits
    };
    let lent = Lent(&mesh);
    let (mut own, mut other) = (TracerBuilder::new(), TracerBuilder::new());
    own.add(mesh.clone());
    own.add(ball(3));
    other.add_triangles(&lent);
    other.add(ball(3));
    assert_eq!(trace(own), trace(other));
}
