//! Compares our tree of triangles without motion with those of the crate `obvhs`, on the same meshes and rays in one
//! run.
//!
//! `cargo run --release -p granita-benches --example trees -- [MESH.ply|MESH.obj ...]`
//!
//! The built-in meshes are a displaced sphere of 250,000 triangles and 200,000 random triangles. Other meshes are
//! files. The table has these columns for each tree:
//!
//! - the seconds of processor time of a build, and the wall clock seconds with two threads;
//! - the millions of rays per second of processor time with one thread, for each of three kinds of rays;
//! - the same for all kinds together with two threads, by the slower of both;
//! - the number of rays, of 393,216, whose distance differs from ours in any bit.
//!
//! Each value is the better of two runs.

#![forbid(unsafe_code)]
#![allow(clippy::print_stdout, reason = "a table for a terminal")]

use cpu_time::{ProcessTime, ThreadTime};
use granita_benches::{KINDS, rays, read_mesh, soup, sphere};
use granita_trace::{Hit, Ray, Tracer, TracerBuilder, TriangleMesh};
use obvhs::BvhBuildParams;
use obvhs::bvh2::{Bvh2, builder::build_bvh2_from_tris};
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh_from_tris};
use obvhs::ray::{Ray as TheirRay, RayHit};
use obvhs::rt_triangle::RtTriangle;
use obvhs::triangle::Triangle;
use std::path::Path;
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// The number of runs of each measurement.
const TURNS: usize = 2;

fn main() -> ExitCode {
    granita_benches::exit("trees", run())
}

fn run() -> Result<(), String> {
    println!(
        "{:<18} {:<16} {:>8} {:>8}  {:>8} {:>8} {:>8}  {:>9} {:>7}",
        "mesh", "tree", "build s", "2 thr s", KINDS[0], KINDS[1], KINDS[2], "2 threads", "differ"
    );
    compare("displaced sphere", &sphere(500))?;
    compare("soup", &soup(200_000))?;
    for file in std::env::args().skip(1) {
        let file = Path::new(&file);
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        compare(&name, &read_mesh(file)?)?;
    }
    Ok(())
}

/// A tree, with the triangles in the order that it needs.
enum Tree {
    Ours(Tracer),
    Two(Bvh2, Vec<RtTriangle>),
    Wide(CwBvh, Vec<RtTriangle>),
}

/// The kinds of trees.
#[derive(Clone, Copy)]
enum Kind {
    Ours,
    Two(BvhBuildParams),
    Wide(BvhBuildParams),
}

const TREES: [(&str, Kind); 5] = [
    ("ours", Kind::Ours),
    ("BVH2 medium", Kind::Two(BvhBuildParams::medium_build())),
    ("CWBVH fast", Kind::Wide(BvhBuildParams::fast_build())),
    ("CWBVH medium", Kind::Wide(BvhBuildParams::medium_build())),
    ("CWBVH slow", Kind::Wide(BvhBuildParams::slow_build())),
];

impl Tree {
    fn new(kind: Kind, mesh: TriangleMesh, triangles: &[Triangle], threads: usize) -> Self {
        let in_order = |indices: &[u32]| indices.iter().map(|i| (&triangles[*i as usize]).into()).collect();
        match kind {
            Kind::Ours => {
                let mut builder = TracerBuilder::new();
                builder.add(mesh);
                Self::Ours(builder.build(threads))
            }
            Kind::Two(params) => {
                let bvh = build_bvh2_from_tris(triangles, params, &mut Duration::default());
                let triangles = in_order(&bvh.primitive_indices);
                Self::Two(bvh, triangles)
            }
            Kind::Wide(params) => {
                let bvh = build_cwbvh_from_tris(triangles, params, &mut Duration::default());
                let triangles = in_order(&bvh.primitive_indices);
                Self::Wide(bvh, triangles)
            }
        }
    }

    /// Stores the distances to the closest hits; infinite for a miss.
    fn closest(&self, rays: &[Ray], hits: &mut [Hit], distances: &mut [f32]) {
        let theirs =
            |r: &Ray| TheirRay::new(r.origin.to_array().into(), r.dir.to_array().into(), r.tmin, r.tmax);
        match self {
            Self::Ours(tracer) => {
                tracer.closest(rays, hits);
                for (distance, hit) in distances.iter_mut().zip(hits) {
                    *distance = if hit.is_hit() { hit.t } else { f32::INFINITY };
                }
            }
            Self::Two(bvh, triangles) => {
                for (distance, ray) in distances.iter_mut().zip(rays) {
                    let mut hit = RayHit::none();
                    bvh.ray_traverse(theirs(ray), &mut hit, |ray, id| triangles[id].intersect(ray));
                    *distance = hit.t;
                }
            }
            Self::Wide(bvh, triangles) => {
                for (distance, ray) in distances.iter_mut().zip(rays) {
                    let mut hit = RayHit::none();
                    bvh.ray_traverse(theirs(ray), &mut hit, |ray, id| triangles[id].intersect(ray));
                    *distance = hit.t;
                }
            }
        }
    }
}

/// The best of all runs with a tree, in seconds.
#[derive(Clone, Copy)]
struct Times {
    build: f64,
    build_two: f64,
    kinds: [f64; 3],
    two: f64,
    /// The number of rays whose distance differs from ours in any bit.
    differ: usize,
}

fn compare(name: &str, mesh: &TriangleMesh) -> Result<(), String> {
    // Uses every eighth ray.
    let rays: Vec<Vec<Ray>> =
        KINDS.iter().map(|kind| rays(mesh, kind).into_iter().step_by(8).collect()).collect();
    let p = |v: u32| mesh.positions[0][v as usize].to_array();
    let triangle = |t: &[u32; 3]| Triangle { v0: p(t[0]).into(), v1: p(t[1]).into(), v2: p(t[2]).into() };
    let triangles: Vec<Triangle> = mesh.triangles.iter().map(triangle).collect();
    let pool = |threads: usize| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().map_err(|e| e.to_string())
    };
    let pools = [pool(1)?, pool(2)?];
    let most = rays.iter().map(Vec::len).max().unwrap_or(0);
    let mut distances = vec![0.0; most];
    let mut hits = vec![Hit::MISS; most];
    let mut ours: Vec<Vec<f32>> = Vec::new();
    let none = Times { build: f64::MAX, build_two: f64::MAX, kinds: [f64::MAX; 3], two: f64::MAX, differ: 0 };
    let mut all = [none; TREES.len()];
    for _ in 0..TURNS {
        for ((_, kind), times) in TREES.iter().zip(&mut all) {
            let copy = mesh.clone();
            let start = Instant::now();
            drop(pools[1].install(|| Tree::new(*kind, copy, &triangles, 2)));
            times.build_two = times.build_two.min(start.elapsed().as_secs_f64());
            let copy = mesh.clone();
            let start = ProcessTime::now();
            let tree = pools[0].install(|| Tree::new(*kind, copy, &triangles, 1));
            times.build = times.build.min(start.elapsed().as_secs_f64());
            times.differ = 0;
            for (k, rays) in rays.iter().enumerate() {
                let start = ThreadTime::now();
                tree.closest(rays, &mut hits[..rays.len()], &mut distances[..rays.len()]);
                times.kinds[k] = times.kinds[k].min(start.elapsed().as_secs_f64());
                let got = &distances[..rays.len()];
                if ours.len() == k {
                    ours.push(got.to_vec());
                }
                times.differ += got.iter().zip(&ours[k]).filter(|(a, b)| a.to_bits() != b.to_bits()).count();
            }
            let seconds: f64 = rays.iter().map(|rays| by_two(&tree, rays, &mut hits, &mut distances)).sum();
            times.two = times.two.min(seconds);
        }
    }
    let rate = |rays: usize, seconds: f64| rays as f64 / seconds * 1e-6;
    for ((tree, _), times) in TREES.iter().zip(&all) {
        let [a, b, c] = [0, 1, 2].map(|k| rate(rays[k].len(), times.kinds[k]));
        println!(
            "{name:<18} {tree:<16} {:>8.3} {:>8.3}  {a:>8.2} {b:>8.2} {c:>8.2}  {:>9.2} {:>7}",
            times.build,
            times.build_two,
            rate(rays.iter().map(Vec::len).sum(), times.two),
            times.differ
        );
    }
    println!("{} triangles", mesh.triangles.len());
    Ok(())
}

/// Returns the seconds that two threads need, by the processor time of the slower one.
fn by_two(tree: &Tree, rays: &[Ray], hits: &mut [Hit], distances: &mut [f32]) -> f64 {
    let half = rays.len() / 2;
    let (first, second) = rays.split_at(half);
    let (first_hits, second_hits) = hits[..rays.len()].split_at_mut(half);
    let (first_distances, second_distances) = distances[..rays.len()].split_at_mut(half);
    let trace = |rays: &[Ray], hits: &mut [Hit], distances: &mut [f32]| {
        let start = ThreadTime::now();
        tree.closest(rays, hits, distances);
        start.elapsed().as_secs_f64()
    };
    std::thread::scope(|scope| {
        let other = scope.spawn(|| trace(second, second_hits, second_distances));
        let own = trace(first, first_hits, first_distances);
        own.max(other.join().unwrap_or(f64::MAX))
    })
}
