//! Tests on a device. They run on any adapter of Vulkan, also software, and are skipped without one.

use crate::{
    Access, Choice, Device, GpuAccelerator, GpuError, GpuTracer, INPUTS, Kernel, Limits, OcclusionPoint,
    Pages, adapters, occlusion_on_cpu, rays_agree, selftest,
};
use granita_base::{Reporter, Severity, Vec3, hash};
use granita_rays::sampling::ConeCells;
use granita_trace::{Accelerator, Hit, Ray, Tracer, TracerBuilder, TriangleMesh};
use std::sync::Arc;

/// Returns a device with limits; `None`, and a notice, when no adapter traces rays. The fastest adapter is used.
fn device(limits: Limits) -> Option<Arc<Device>> {
    let usable = adapters().into_iter().filter(|a| a.abilities.trace_rays());
    let Some(adapter) = usable.min_by_key(|a| a.kind == "software") else {
        granita_needs::skip("Vulkan (no adapter traces rays)");
        return None;
    };
    Device::open(Choice::Index(adapter.index), limits).unwrap()
}

/// Returns a number from 0 to 1.
fn unit(a: u32, b: u32) -> f32 {
    hash::unit(hash::words(&[a, b]))
}

fn point(a: u32, b: u32) -> Vec3 {
    Vec3::new(unit(a, 3 * b), unit(a, 3 * b + 1), unit(a, 3 * b + 2)) * 2.0 - 1.0
}

/// Returns meshes of small and large random triangles, a bumpy closed surface, and triangles that coincide.
fn meshes(seed: u32) -> Vec<TriangleMesh> {
    let soup = |n: u32, size: f32| {
        let corners = |t: u32| {
            let p = point(seed, 10 * t);
            [p, p + point(seed, 10 * t + 1) * size, p + point(seed, 10 * t + 2) * size]
        };
        TriangleMesh {
            times: vec![0.0],
            positions: vec![(0..n).flat_map(corners).collect()],
            triangles: (0..n).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
        }
    };
    let surface = {
        let (n, mut positions, mut triangles) = (40_u32, Vec::new(), Vec::new());
        for v in 0..=n {
            for u in 0..n {
                let (phi, theta) =
                    (u as f32 / n as f32 * std::f32::consts::TAU, v as f32 / n as f32 * std::f32::consts::PI);
                let r = 0.4 + 0.1 * (5.0 * phi).sin() * (3.0 * theta).sin();
                positions.push(Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()) * r);
            }
        }
        for v in 0..n {
            for u in 0..n {
                let [a, b] = [v * n + u, v * n + (u + 1) % n];
                triangles.extend([[a, b, b + n], [a, b + n, a + n]]);
            }
        }
        TriangleMesh { times: vec![0.0], positions: vec![positions], triangles }
    };
    // Of triangles at one place, the first is hit.
    let twice = surface.clone();
    vec![soup(3000, 0.05), surface, soup(20, 1.5), twice]
}

fn tracer(meshes: Vec<TriangleMesh>) -> Arc<Tracer> {
    let mut builder = TracerBuilder::new();
    for mesh in meshes {
        builder.add(mesh);
    }
    Arc::new(builder.build(2))
}

/// Returns rays of all kinds: random, through vertices and edges, along axes, of limited length, and unusual ones.
fn rays(meshes: &[TriangleMesh], seed: u32, n: u32) -> Vec<Ray> {
    let vertices: Vec<Vec3> = meshes.iter().flat_map(|m| m.positions[0].iter().copied()).collect();
    let vertex = |k: u32| vertices[hash::words(&[seed, k]) as usize % vertices.len()];
    (0..n)
        .map(|k| {
            let origin = point(seed ^ 77, 4 * k) * 1.5;
            let aim = match k % 8 {
                0..=2 => point(seed ^ 78, 4 * k),
                3 => vertex(k) - origin,
                4 => {
                    (vertex(k) + vertices[hash::words(&[seed, k, 9]) as usize % vertices.len()]) * 0.5
                        - origin
                }
                5 => [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z][k as usize / 8 % 6],
                6 => Vec3::new(0.0, 1.0, unit(k, 5) - 0.5),
                _ => point(seed ^ 79, k),
            };
            let usual = Ray { origin, tmin: 0.0, dir: aim, tmax: f32::INFINITY, time: 0.0 };
            match k % 101 {
                1 => Ray { tmax: unit(k, 6), ..usual },
                2 => Ray { tmin: unit(k, 7), ..usual },
                3 => Ray { tmin: 1.0, tmax: 0.5, ..usual },
                4 => Ray { dir: aim * 1e-20, ..usual },
                5 => Ray { dir: aim * 1e20, ..usual },
                6 => Ray { origin: origin - aim * 1e6, ..usual },
                7 => Ray { dir: Vec3::ZERO, ..usual },
                8 => Ray { dir: Vec3::new(f32::NAN, 1.0, 0.0), ..usual },
                9 => Ray { origin: Vec3::new(f32::INFINITY, 0.0, 0.0), ..usual },
                10 => Ray { time: f32::NAN, ..usual },
                11 => Ray { tmin: f32::NAN, ..usual },
                12 => Ray { tmin: f32::NEG_INFINITY, ..usual },
                // It starts on the surface.
                13 => Ray { origin: vertex(k), ..usual },
                _ => usual,
            }
        })
        .collect()
}

/// Compares all bits of the hits of a device with those of the CPU. Returns the number of hits.
fn compare(tracer: &Tracer, resident: &GpuTracer, rays: &[Ray]) -> usize {
    let mut expected = vec![Hit::MISS; rays.len()];
    tracer.closest(rays, &mut expected);
    let mut got = expected.clone();
    got.fill(Hit { mesh: 7, ..Hit::MISS });
    let traced = resident.closest(rays, &mut got).unwrap();
    assert_eq!(traced.rays, rays.len() as u64);
    let bits = |h: &Hit| (h.t.to_bits(), h.mesh, h.triangle, h.b1.to_bits(), h.b2.to_bits());
    for ((ray, expected), got) in rays.iter().zip(&expected).zip(&got) {
        assert_eq!(bits(got), bits(expected), "{ray:?}: {got:?}, {expected:?}");
    }
    let mut blocked = vec![true; rays.len()];
    resident.any(rays, &mut blocked).unwrap();
    for ((ray, expected), blocked) in rays.iter().zip(&expected).zip(&blocked) {
        assert_eq!(*blocked, expected.is_hit(), "{ray:?}");
    }
    expected.iter().filter(|h| h.is_hit()).count()
}

#[test]
fn functions_have_the_bits_of_the_cpu() {
    let Some(device) = device(Limits::default()) else { return };
    let mut failed = Vec::new();
    let n = if cfg!(debug_assertions) { INPUTS / 8 } else { INPUTS };
    let all = selftest(&device, n, &mut |agreement| {
        if !agreement.holds() {
            failed.push(agreement.to_string());
        }
    });
    assert!(all.unwrap() && failed.is_empty(), "{failed:#?}");
}

#[test]
fn hits_have_the_bits_of_the_cpu() {
    let Some(device) = device(Limits::default()) else { return };
    for seed in 0..3 {
        let meshes = meshes(seed);
        let rays = rays(&meshes, seed, 20_000);
        let tracer = tracer(meshes);
        let resident = GpuTracer::new(device.clone(), tracer.clone()).unwrap();
        let hits = compare(&tracer, &resident, &rays);
        assert!(hits > 7000, "{hits} hits");
    }
    assert!(device.statistics().runs > 0 && device.statistics().peak_bytes > 0);
}

#[test]
fn hits_do_not_depend_on_the_size_and_place_of_the_scene() {
    let Some(device) = device(Limits::default()) else { return };
    for (size, place) in [(1e-12, 0.0), (1e12, 0.0), (1.0, 1000.0), (3e-3, -7.0)] {
        let mut meshes = meshes(5);
        let moved = |p: Vec3| p * size + Vec3::splat(place);
        for mesh in &mut meshes {
            mesh.positions[0].iter_mut().for_each(|p| *p = moved(*p));
        }
        let mut rays = rays(&meshes, 5, 4000);
        for ray in rays.iter_mut().filter(|r| r.origin.length() < 3.0) {
            ray.origin = moved(ray.origin);
        }
        let tracer = tracer(meshes);
        let resident = GpuTracer::new(device.clone(), tracer.clone()).unwrap();
        compare(&tracer, &resident, &rays);
    }
}

#[test]
fn trees_in_many_pages_and_rays_in_many_batches_give_the_same_hits() {
    // Pages of 1024 nodes and 2048 triangles.
    let limits = Limits { binding_bytes: 100_000, batch: 1000, ..Limits::default() };
    let Some(device) = device(limits) else { return };
    let meshes = meshes(3);
    let rays = rays(&meshes, 3, 5000);
    let tracer = tracer(meshes);
    let resident = GpuTracer::new(device.clone(), tracer.clone()).unwrap();
    assert!(resident.bytes() > 200_000, "{}", resident.bytes());
    compare(&tracer, &resident, &rays);
}

#[test]
fn empty_and_tiny_scenes_are_traced() {
    let Some(device) = device(Limits::default()) else { return };
    let few = rays(&meshes(1), 1, 200);
    let nothing = tracer(Vec::new());
    let resident = GpuTracer::new(device.clone(), nothing.clone()).unwrap();
    assert_eq!((compare(&nothing, &resident, &few), resident.bytes()), (0, 0));
    assert_eq!(compare(&nothing, &resident, &[]), 0);
    for n in [1, 2, 5] {
        let mesh = TriangleMesh {
            times: vec![0.0],
            positions: vec![vec![
                Vec3::new(-1.0, -1.0, 0.1),
                Vec3::new(1.0, -1.0, 0.1),
                Vec3::new(0.0, 1.0, 0.1),
            ]],
            triangles: vec![[0, 1, 2]; n],
        };
        let tracer = tracer(vec![mesh]);
        let resident = GpuTracer::new(device.clone(), tracer.clone()).unwrap();
        assert!(compare(&tracer, &resident, &few) > 0);
    }
}

/// Returns points on a sphere, with axes that point outward.
fn points(n: u32) -> Vec<OcclusionPoint> {
    (0..n)
        .map(|k| {
            let axis = point(9, k).normalize_or(Vec3::Z);
            let angle = [std::f32::consts::FRAC_PI_2, 0.3, 0.0, 3.0, f32::NAN][k as usize % 5];
            OcclusionPoint {
                p: axis * 0.55 * if k % 50 == 49 { 1e9 } else { 1.0 },
                axis,
                tmin: 1e-4,
                tmax: if k % 3 == 0 { 0.5 } else { f32::INFINITY },
                time: 0.0,
                cells: ConeCells::new(k % 97, angle, k % 2 == 0),
                seed: hash::words(&[k]),
            }
        })
        .collect()
}

#[test]
fn occlusion_has_the_bits_of_the_cpu() {
    for batch in [1 << 20, 100] {
        let Some(device) = device(Limits { batch, ..Limits::default() }) else { return };
        let tracer = tracer(meshes(2));
        let resident = GpuTracer::new(device.clone(), tracer.clone()).unwrap();
        let points = points(800);
        let (got, traced) = resident.occlusion(&points).unwrap();
        assert!(traced.by_cpu > 0 && traced.rays > 20_000, "{traced:?}");
        let mut blocked = 0;
        for (point, got) in points.iter().zip(&got) {
            let expected = occlusion_on_cpu(&tracer, point);
            let bits = |v: Vec3| v.to_array().map(f32::to_bits);
            assert_eq!((got.rays, got.blocked), (expected.rays, expected.blocked), "{point:?}");
            assert_eq!(bits(got.open), bits(expected.open), "{point:?}: {got:?}, {expected:?}");
            blocked += got.blocked;
        }
        assert!(blocked > 1000, "{blocked}");
        let empty = self::tracer(Vec::new());
        let resident = GpuTracer::new(device.clone(), empty.clone()).unwrap();
        let (open, _) = resident.occlusion(&points).unwrap();
        assert!(open.iter().all(|o| o.blocked == 0));
    }
}

#[test]
fn scenes_that_move_are_not_supported() {
    let Some(device) = device(Limits::default()) else { return };
    let mut mesh = meshes(1).remove(2);
    mesh.times = vec![0.0, 1.0];
    mesh.positions.push(mesh.positions[0].clone());
    let tracer = tracer(vec![mesh]);
    let error = GpuTracer::new(device, tracer.clone()).err();
    assert!(matches!(error, Some(GpuError::Unsupported { what, .. }) if what.contains("move")));
}

#[test]
fn a_lost_device_is_an_error_of_every_call() {
    let Some(device) = device(Limits::default()) else { return };
    let meshes = meshes(1);
    let rays = rays(&meshes, 1, 100);
    let tracer = tracer(meshes);
    let resident = GpuTracer::new(device.clone(), tracer.clone()).unwrap();
    let mut hits = vec![Hit::MISS; rays.len()];
    assert!(resident.closest(&rays, &mut hits).is_ok());
    device.lose();
    let lost = |error: Option<GpuError>| matches!(error, Some(GpuError::Lost { .. }));
    assert!(lost(resident.closest(&rays, &mut hits).err()));
    assert!(lost(resident.any(&rays, &mut vec![false; rays.len()]).err()));
    assert!(lost(resident.occlusion(&points(3)).err()));
    assert!(lost(GpuTracer::new(device.clone(), tracer.clone()).err()));
    assert!(lost(selftest(&device, 10, &mut |_| ()).err()));
}

#[test]
fn memory_beyond_the_limit_is_an_error_and_is_given_back() {
    let Some(device) = device(Limits { memory_bytes: 1 << 19, ..Limits::default() }) else { return };
    let meshes = meshes(1);
    let rays = rays(&meshes, 1, 100_000);
    let few = tracer(meshes[2..3].to_vec());
    let resident = GpuTracer::new(device.clone(), few.clone()).unwrap();
    let used = device.statistics().bytes;
    assert_eq!(used, resident.bytes());
    let error = resident.closest(&rays, &mut vec![Hit::MISS; rays.len()]).err();
    assert!(matches!(error, Some(GpuError::Memory { asked: 3_600_000, .. })), "{error:?}");
    assert_eq!(device.statistics().bytes, used);
    let many = tracer(meshes);
    assert!(matches!(GpuTracer::new(device.clone(), many.clone()).err(), Some(GpuError::Memory { .. })));
    assert_eq!(device.statistics().bytes, used);
    // The device still works.
    compare(&few, &resident, &rays[..1000]);
}

#[test]
fn more_pages_than_bindings_are_an_error() {
    let Some(device) = device(Limits { binding_bytes: 2000, bindings: 16, ..Limits::default() }) else {
        return;
    };
    let tracer = tracer(meshes(1));
    let error = GpuTracer::new(device, tracer.clone()).err();
    assert!(matches!(error, Some(GpuError::Limit { what: "buffers of a kernel", .. })), "{error:?}");
}

#[test]
fn kernels_that_are_not_valid_are_errors_with_the_place() {
    let Some(device) = device(Limits::default()) else { return };
    let error = Kernel::new(&device, "broken", "fn main() { let x = y; }", &[Access::Read]).unwrap_err();
    let GpuError::Failed { what } = error else { panic!("{error}") };
    assert!(what.contains("broken") && what.contains("let x = y"), "{what}");
    assert_eq!(device.check(), Ok(()));
    let words: Vec<u32> = (0..40).collect();
    let pages = Pages::of(&device, "x", &words, 4).unwrap();
    assert_eq!((pages.buffers().len(), pages.bytes()), (1, 160));
}

#[test]
fn accelerators_trace_large_batches_and_warn_once_when_the_device_is_lost() {
    let Some(device) = device(Limits::default()) else { return };
    assert_eq!(rays_agree(&device), Ok(true));
    let reporter = Reporter::silent();
    let accelerator = GpuAccelerator::new(device.clone(), reporter.clone());
    let meshes = meshes(4);
    let rays = rays(&meshes, 4, 10_000);
    let tracer = tracer(meshes);
    let copy = accelerator.copy(&tracer).unwrap();
    let (mut hits, mut blocked) = (vec![Hit::MISS; rays.len()], vec![false; rays.len()]);
    // Few rays are left to the CPU.
    assert!(!copy.closest(&rays[..10], &mut hits[..10]) && !copy.any(&rays[..10], &mut blocked[..10]));
    assert!(copy.closest(&rays, &mut hits) && copy.any(&rays, &mut blocked));
    let mut expected = hits.clone();
    tracer.closest(&rays, &mut expected);
    assert!(hits == expected && hits.iter().zip(&blocked).all(|(h, b)| h.is_hit() == *b));
    assert_eq!(accelerator.traced().rays, 2 * rays.len() as u64);
    device.lose();
    for _ in 0..3 {
        assert!(!copy.closest(&rays, &mut hits) && !copy.any(&rays, &mut blocked));
    }
    assert!(accelerator.copy(&tracer).is_none());
    assert_eq!(reporter.count(Severity::Warning), 1);
}
