//! Tests of tessellation on demand: levels, leaks and the cache.

use super::*;
use crate::fixture::{Frame, Object, Thread};
use crate::sampling::{Distribution, in_cone};
use granita_base::sample::Sequence;
use granita_base::{CurveBasis, MotionTransform, Params, ShapeDesc, Transform, hash};
use granita_fixture::{Fixture, param, shader};
use granita_scene::{AttributeSet, Primitive};

fn any(set: &RayScene<Object>, thread: &mut Thread<'_>, requests: &[RayRequest]) -> Vec<bool> {
    let rays: Vec<Ray> = requests.iter().map(|r| r.ray).collect();
    set.any(thread, &rays, &|k| requests[k].widths(), &|k| requests[k].leaving)
}

/// The displacement of points along their normals.
fn bumps(p: Vec3) -> f32 {
    0.3 * (7.0 * p.x).sin() * (9.0 * p.y).sin() * (8.0 * p.z).sin()
}

fn point(seed: u32, i: u32) -> Vec3 {
    let x = |d| hash::unit(hash::words(&[seed, i, d])) * 2.0 - 1.0;
    Vec3::new(x(0), x(1), x(2))
}

/// Returns a request with a unit direction and `width` at the origin.
fn request(origin: Vec3, to: Vec3, width: f32, spread: f32) -> RayRequest {
    let dir = (to - origin).normalize();
    let ray = Ray { origin, tmin: 0.0, dir, tmax: f32::INFINITY, time: 0.0 };
    RayRequest { width, spread, ..RayRequest::new(ray) }
}

fn bumpy(f: &Fixture, radius: f32) -> AttributeSet {
    let displacement = Some(shader("bumps", &[], Transform::IDENTITY));
    let own = [param("float displace:maxradius", 0.3), param("float shadingquality", 4.0 / radius)];
    AttributeSet { displacement, ..f.attributes("", &["set"], &own) }
}

/// Returns a subdivision cube of half side `r`.
fn cube(f: &mut Fixture, r: f32, attributes: AttributeSet) -> Arc<Primitive> {
    let p: Vec<f32> =
        (0..8).flat_map(|i| [i & 1, i >> 1 & 1, i >> 2]).map(|x| (2 * x - 1) as f32 * r).collect();
    let verts = [0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4, 2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5];
    let shape = ShapeDesc::Mesh { subdivide: true, nverts: [4; 6].into(), verts: verts.into() };
    f.add(shape, Params(vec![param("vertex point P", &p[..])]), attributes)
}

/// Returns closed surfaces around the origin, each alone in its scene, with the radius of a ball inside of each.
fn closed() -> Vec<(&'static str, Fixture, f32)> {
    let mut list = Vec::new();
    for radius in [2.0, 60.0] {
        let mut f = Fixture::new(&[]);
        let own = f.attributes("", &["set"], &[]);
        f.sphere(Vec3::ZERO, radius, own);
        list.push(("a sphere", f, radius * 0.6));
        let mut f = Fixture::new(&[]);
        let own = f.attributes("", &["set"], &[]);
        cube(&mut f, radius, own);
        list.push(("a subdivided cube", f, radius * 0.3));
    }
    let mut f = Fixture::new(&[]);
    let own = bumpy(&f, 3.0);
    f.sphere(Vec3::ZERO, 3.0, own);
    list.push(("a displaced sphere", f, 2.0));
    let mut f = Fixture::new(&[]);
    let own = bumpy(&f, 5.0);
    cube(&mut f, 5.0, own);
    list.push(("a displaced cube", f, 2.0));
    list
}

#[test]
fn no_ray_passes_through_closed_meshes_at_any_level() {
    for (name, f, inner) in closed() {
        let frame = Frame::new(&f, bumps);
        let set = frame.rays.scene("set", &frame).unwrap();
        assert_eq!(set.on_demand_meshes.len(), 1);
        let mut thread = Thread(&frame);
        let mut levels = [0; 3];
        let mut leaks = [0; 3];
        let on_demand = &set.on_demand_meshes[0];
        let mut requests = Vec::new();
        let far = on_demand.bound.max.length();
        for i in 0..6000 {
            let width = on_demand.pixel() * [0.5, 5.0, 20.0][(i % 3) as usize];
            let origin = point(1, i).normalize() * far * 3.0;
            // The ray ends inside of the ball, so that it must hit the surface in front of the ball.
            requests.push(request(origin, point(2, i).normalize_or_zero() * inner * 0.5, width, 0.0));
        }
        for (r, hit) in requests.iter().zip(set.closest(&mut thread, &requests)) {
            let level = on_demand.level(r.ray.origin, r.ray.dir, r.width, r.spread);
            levels[level.scale().log(4.0).round() as usize] += 1;
            let p = r.ray.origin + r.ray.dir * hit.t;
            let leaks = &mut leaks[level.scale().log(4.0).round() as usize];
            *leaks += usize::from(!hit.is_hit() || p.length() < inner || r.ray.dir.dot(p) > 0.0);
        }
        // Small meshes have one level.
        assert!(on_demand.is_small() || levels.iter().all(|n| *n > 1000), "{name}: {levels:?}");
        assert_eq!(leaks, [0; 3], "{name}");
        // Rays from inside use the finest level.
        let out: Vec<RayRequest> = (0..6000)
            .map(|i| request(point(3, i) * inner * 0.3, point(4, i) * far * 9.0, 0.0, 0.01))
            .collect();
        assert!(any(set, &mut thread, &out).iter().all(|hit| *hit), "{name}");
    }
}

#[test]
fn edges_of_neighbouring_parts_share_their_points() {
    for (name, f, _) in closed() {
        let frame = Frame::new(&f, bumps);
        let set = frame.rays.scene("set", &frame).unwrap();
        let mut thread = Thread(&frame);
        let on_demand = &set.on_demand_meshes[0];
        for level in Level::ALL {
            // Every edge of the whole surface belongs to two triangles, which may be of different parts.
            let mut edges: FxHashMap<[[u32; 3]; 2], i32> = FxHashMap::default();
            for part in 0..on_demand.parts.len() {
                let (_, mesh) = on_demand.tessellate(part as u32, level, &mut thread).unwrap();
                for t in mesh.triangles.iter().filter(|t| t[0] != u32::MAX) {
                    let at =
                        |k: usize| (mesh.positions[0][t[k % 3] as usize] + 0.0).to_array().map(f32::to_bits);
                    for k in 0..3 {
                        let mut edge = [at(k), at(k + 1)];
                        edge.sort_unstable();
                        *edges.entry(edge).or_insert(0) += 1;
                    }
                }
            }
            let open = edges.values().filter(|n| **n % 2 != 0).count();
            // Displaced points on edges between faces move along normals that are rounded in single precision.
            if name != "a displaced cube" {
                assert_eq!(
                    open,
                    0,
                    "{name}, {level:?}: of {} edges, {} parts",
                    edges.len(),
                    on_demand.parts.len()
                );
            }
        }
    }
}

/// Returns a scene of balls, bumps, hair and a flat floor.
fn mixed() -> Fixture {
    let mut f = Fixture::new(&[]);
    let floor = f.attributes("", &["set"], &[]);
    f.rectangle([-20.0; 2], [20.0; 2], -4.0, floor);
    for k in 0..4 {
        let own = f.attributes("", &["set"], &[]);
        f.sphere(point(7, k) * 6.0, 1.0 + k as f32 * 0.3, own);
    }
    let own = bumpy(&f, 4.0);
    f.sphere(Vec3::new(0.0, 5.0, 0.0), 4.0, own);
    let own = AttributeSet { to_world: Transform::translate(Vec3::X * 6.0).into(), ..bumpy(&f, 3.0) };
    cube(&mut f, 3.0, own);
    let hair: Vec<f32> =
        (0..200).flat_map(|i| (point(8, i / 4) * 5.0 + point(9, i) * 0.7).to_array()).collect();
    let own = f.attributes("", &["set"], &[]);
    let shape = ShapeDesc::Curves { basis: CurveBasis::CatmullRom, ncurves: 50, nverts: 4 };
    f.add(shape, Params(vec![param("vertex point P", &hair[..]), param("float width", 0.05)]), own);
    f
}

/// Returns rays from all directions, thin and wide.
fn everywhere(n: u32) -> Vec<RayRequest> {
    (0..n)
        .map(|i| {
            let (origin, to) = (point(20, i) * 15.0, point(21, i) * 6.0);
            let spread = [0.0, 0.002, 0.05, 1.0][(i % 4) as usize];
            request(origin, to, [0.0, 0.02, 0.1][(i % 3) as usize], spread)
        })
        .collect()
}

#[test]
fn hits_do_not_depend_on_cache_threads_or_order() {
    let f = mixed();
    let requests = everywhere(600);
    let trace = |limit: u64, threads: usize, backwards: bool| {
        let frame = Frame::new(&f, bumps);
        frame.rays.cache.set_limit(limit);
        let set = frame.rays.scene("set", &frame).unwrap();
        let mut order: Vec<usize> = (0..requests.len()).collect();
        if backwards {
            order.reverse();
        }
        let share = order.len().div_ceil(threads);
        let mut found = vec![(SetHit::MISS, false); order.len()];
        let all: Vec<(usize, SetHit, bool)> = std::thread::scope(|scope| {
            let work = order.chunks(share).map(|own| {
                let (frame, requests) = (&frame, &requests);
                scope.spawn(move || {
                    let mut thread = Thread(frame);
                    let own_requests: Vec<RayRequest> = own.iter().map(|k| requests[*k]).collect();
                    let hits = set.closest(&mut thread, &own_requests);
                    let any = any(set, &mut thread, &own_requests);
                    own.iter().zip(hits).zip(any).map(|((k, h), a)| (*k, h, a)).collect::<Vec<_>>()
                })
            });
            let work: Vec<_> = work.collect();
            work.into_iter().flat_map(|w| w.join().unwrap()).collect()
        });
        for (k, hit, any) in all {
            found[k] = (hit, any);
        }
        (found, frame.rays.cache.counts())
    };
    let (reference, all) = trace(u64::MAX, 1, false);
    assert!(reference.iter().all(|(hit, any)| hit.is_hit() == *any));
    assert!(reference.iter().filter(|r| r.1).count() > 200);
    assert_eq!((all.given_up, all.bytes), (0, all.peak_bytes));
    let (found, counts) = trace(u64::MAX, 3, true);
    assert_eq!((&found, counts.made), (&reference, all.made));
    for (limit, threads) in [(all.bytes / 3, 1), (all.bytes / 3, 3), (all.bytes / 12, 1)] {
        let (found, counts) = trace(limit, threads, threads == 3);
        assert_eq!(found, reference);
        assert!(counts.given_up > 0 && counts.made > all.made, "{counts:?}");
        // A tessellation that was just made may exceed the limit.
        assert!(counts.peak_bytes < limit + all.bytes / 8, "{counts:?} {limit}");
        assert!(counts.bytes <= limit + all.bytes / 8, "{counts:?} {limit}");
    }
}

#[test]
fn wide_rays_tessellate_coarsely_and_only_where_they_pass() {
    let triangles = |width: f32, one_side: bool| {
        let mut f = Fixture::new(&[]);
        let own = bumpy(&f, 4.0);
        f.sphere(Vec3::ZERO, 5.0, own);
        let frame = Frame::new(&f, bumps);
        let set = frame.rays.scene("set", &frame).unwrap();
        assert_eq!(frame.rays.cache.counts().made, 0);
        let width = width * set.on_demand_meshes[0].pixel();
        let rays: Vec<RayRequest> = (0..4000)
            .map(|i| {
                let axis = in_cone(
                    Vec3::X,
                    if one_side { 0.1 } else { 4.0 },
                    Distribution::Uniform,
                    [i, 4000],
                    Sequence::new(5),
                );
                request(axis * 30.0, Vec3::ZERO, width, 0.0)
            })
            .collect();
        assert!(set.closest(&mut Thread(&frame), &rays).iter().all(SetHit::is_hit));
        let counts = frame.rays.cache.counts();
        (counts.triangles, counts.made)
    };
    let (all, parts) = triangles(1.0, false);
    assert!(parts > 10, "{parts}");
    let (near, some) = triangles(1.0, true);
    assert!(some * 4 < parts && near * 4 < all, "{some} of {parts}, {near} of {all}");
    // Edges four times as long give a sixteenth of the triangles, except for the remainders on small sides.
    let (coarse, _) = triangles(4.5, false);
    let (coarser, _) = triangles(17.0, false);
    assert!(coarse * 10 < all && coarser * 8 < coarse, "{all} {coarse} {coarser}");
}

#[test]
fn tessellations_stay_inside_the_bounds_of_their_parts() {
    let f = {
        let mut f = mixed();
        let shutter = param("float[2] shutter", &[0.0_f32, 1.0][..]);
        f.scene.cameras[0].params.set(shutter);
        let moving = f.attributes("", &["set"], &[param("int ray:motion", 1)]);
        let turned = Transform::translate(Vec3::X * 5.0).then(&Transform::rotate(1.0, Vec3::Z));
        let keys = vec![(0.0, Transform::IDENTITY), (0.4, turned), (1.0, Transform::scale(Vec3::splat(0.3)))];
        let to_world = MotionTransform::from_keys(keys).unwrap();
        let own = AttributeSet { to_world: to_world.clone(), ..moving.clone() };
        cube(&mut f, 2.0, own);
        f.rectangle([-1.0; 2], [1.0; 2], 0.0, AttributeSet { to_world, ..moving });
        let own = f.attributes("", &["set"], &[]);
        let p: Vec<f32> = (0..60).flat_map(|i| (point(12, i) * 5.0).to_array()).collect();
        let width = param("vertex float width", &(0..60).map(|i| 0.01 * i as f32).collect::<Vec<f32>>()[..]);
        f.add(ShapeDesc::Points { n: 60 }, Params(vec![param("vertex point P", &p[..]), width]), own);
        f
    };
    let frame = Frame::new(&f, bumps);
    let set = frame.rays.scene("set", &frame).unwrap();
    let mut thread = Thread(&frame);
    assert_eq!(set.static_meshes.len(), 1);
    let mut seen = 0;
    for on_demand in &set.on_demand_meshes {
        for (k, part) in on_demand.parts.iter().enumerate() {
            for level in Level::ALL {
                let (_, mesh) = on_demand.tessellate(k as u32, level, &mut thread).unwrap();
                for p in mesh.positions.iter().flatten() {
                    let outside = (part.bound.min - *p).max(*p - part.bound.max).max_element();
                    assert!(
                        outside <= 0.0,
                        "{:?}: {p} outside of {:?}",
                        on_demand.primitive.shape,
                        part.bound
                    );
                    seen += 1;
                }
            }
        }
    }
    assert!(seen > 10_000, "{seen}");
}

#[test]
fn a_primitive_of_too_many_triangles_is_skipped_alone() {
    let mut f = Fixture::new(&[]);
    let own = [param("float displace:maxradius", 0.3), param("float dice:highcurvature", 1e-20_f32)];
    let displacement = Some(shader("bumps", &[], Transform::IDENTITY));
    let own = AttributeSet { displacement, ..f.attributes("", &["set"], &own) };
    f.sphere(Vec3::ZERO, 1.0, own);
    let own = f.attributes("", &["set"], &[]);
    f.sphere(Vec3::X * 8.0, 1.0, own);
    f.global("int limits:primitivepoints", 100_000);
    let frame = Frame::new(&f, bumps);
    let set = frame.rays.scene("set", &frame).unwrap();
    let mut thread = Thread(&frame);
    let rays = [0.0, 8.0].map(|x| request(Vec3::new(x, 0.0, -9.0), Vec3::new(x, 0.0, 0.0), 0.0, 0.0));
    assert_eq!(any(set, &mut thread, &rays), [false, true]);
    let said = f.complaints();
    assert!(said.len() == 1 && said[0].contains("100000 points and is left out for rays"), "{said:?}");
}

/// A processor that has half of the rays traced by the tracer itself, and counts the batches that it traced.
#[derive(Clone, Debug, Default)]
struct Moody {
    copies: Arc<std::sync::atomic::AtomicUsize>,
    traced: Arc<std::sync::atomic::AtomicUsize>,
}

#[derive(Debug)]
struct MoodyCopy(Moody, Arc<Tracer>);

impl Accelerator for Moody {
    fn copy(&self, tracer: &Arc<Tracer>) -> Option<Box<dyn TracerCopy>> {
        self.copies.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        Some(Box::new(MoodyCopy(self.clone(), tracer.clone())))
    }

    fn report(&self) -> String {
        String::new()
    }
}

impl MoodyCopy {
    /// True for every second batch.
    fn takes(&self) -> bool {
        self.0.traced.fetch_add(1, std::sync::atomic::Ordering::Relaxed).is_multiple_of(2)
    }
}

impl TracerCopy for MoodyCopy {
    fn closest(&self, rays: &[Ray], hits: &mut [Hit]) -> bool {
        self.1.closest(rays, hits);
        let takes = self.takes();
        if !takes {
            // What a failed copy leaves behind is not used.
            hits.fill(Hit { t: 1e-9, mesh: 0, triangle: 0, b1: 0.0, b2: 0.0 });
        }
        takes
    }

    fn any(&self, rays: &[Ray], blocked: &mut [bool]) -> bool {
        self.1.any(rays, blocked);
        let takes = self.takes();
        if !takes {
            blocked.iter_mut().for_each(|b| *b = !*b);
        }
        takes
    }
}

#[test]
fn sets_have_the_same_hits_with_an_accelerator_that_fails_now_and_then() {
    let mut f = Fixture::new(&[]);
    let own = f.attributes("", &["set"], &[]);
    let corners: Vec<f32> = (0..30).flat_map(|i| (point(8, i) * 2.0).to_array()).collect();
    let shape = ShapeDesc::Mesh {
        subdivide: false,
        nverts: [3; 10].into(),
        verts: (0..30).collect::<Vec<_>>().into(),
    };
    f.add(shape, Params(vec![param("vertex point P", &corners[..])]), own);
    let plain = Frame::new(&f, |_| 0.0);
    let moody = Moody::default();
    let mut with = Frame::new(&f, |_| 0.0);
    with.rays = with.rays.with_accelerator(Some(Arc::new(moody.clone())));
    let rays: Vec<RayRequest> =
        (0..400).map(|i| request(point(9, i) * 3.0, point(10, i), 0.0, 0.0)).collect();
    let (expected, got) = (plain.rays.scene("set", &plain).unwrap(), with.rays.scene("set", &with).unwrap());
    for _ in 0..3 {
        let hits = any(expected, &mut Thread(&plain), &rays);
        assert_eq!(any(got, &mut Thread(&with), &rays), hits);
        assert!(hits.iter().any(|hit| *hit) && !hits.iter().all(|hit| *hit));
        let only: Vec<Ray> = rays.iter().map(|r| r.ray).collect();
        let distances = |set: &RayScene<Object>, frame: &Frame| {
            set.distances(&mut Thread(frame), &only, &|_| [0.0; 2], &|_| Leaving::default())
        };
        assert_eq!(distances(got, &with), distances(expected, &plain));
    }
    let count = |n: &std::sync::atomic::AtomicUsize| n.load(std::sync::atomic::Ordering::Relaxed);
    assert_eq!((count(&moody.copies), count(&moody.traced)), (1, 6));
}
