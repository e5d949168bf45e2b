//! Measures kernels: dicing, closest hits, texture lookups, and searches of spatial databases.

#![allow(missing_docs, reason = "criterion's macros")]
#![allow(clippy::unwrap_used, reason = "a bench that cannot go on ends")]

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use granita_base::{Params, Reporter, ShapeDesc, Vec3};
use granita_geom::{Piece, ShapeKey};
use granita_image::{FormatRegistry, Limits};
use granita_sdb::{Between, Density, Key, Packed, Probe, Schema, Value};
use granita_texture::make::{MakeOptions, make};
use granita_texture::{CacheOptions, Lookup, TextureCache, Use};
use granita_trace::{Hit, Ray, Tracer, TracerBuilder, TriangleMesh};
use std::hint::black_box;

/// Returns a unit sphere.
fn sphere() -> Piece {
    let shape = ShapeDesc::Sphere { radius: 1.0, zmin: -1.0, zmax: 1.0, thetamax_deg: 360.0 };
    let params = Params::new();
    let keys = [ShapeKey { time: 0.0, params: &params }];
    granita_geom::build(&shape, &keys, None, &mut |_, _| {}).unwrap().remove(0)
}

fn dice(c: &mut Criterion) {
    let sphere = sphere();
    let mut group = c.benchmark_group("dice");
    group.throughput(Throughput::Elements(17 * 17));
    group.bench_function("sphere 17x17", |b| b.iter(|| black_box(sphere.dice(17, 17))));
    group.finish();
}

/// Returns a tracer for a sphere of `2 n^2` triangles, dented so that its triangles differ.
fn dented(n: usize) -> Tracer {
    let dice = sphere().dice(n + 1, n + 1);
    let positions: Vec<Vec3> =
        dice.p[0].iter().map(|p| *p * (1.0 + 0.05 * (9.0 * p.x).sin() * (7.0 * p.y).cos())).collect();
    let at = |i: usize, j: usize| (j * (n + 1) + i) as u32;
    let mut triangles = Vec::new();
    for j in 0..n {
        for i in 0..n {
            triangles.push([at(i, j), at(i + 1, j), at(i, j + 1)]);
            triangles.push([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    let mut builder = TracerBuilder::new();
    builder.add(TriangleMesh { times: vec![0.0], positions: vec![positions], triangles });
    builder.build(1)
}

/// Returns rays from a sphere of radius 3 through random positions in the unit ball.
fn rays(count: u32) -> Vec<Ray> {
    let random = |i: u32, d: u32| granita_base::hash::unit(granita_base::hash::words(&[i, d])) * 2.0 - 1.0;
    (0..count)
        .map(|i| {
            let v = |d: u32| Vec3::new(random(i, d), random(i, d + 1), random(i, d + 2));
            let origin = v(0).normalize_or_zero() * 3.0;
            Ray { origin, tmin: 0.0, dir: v(3) - origin, tmax: f32::INFINITY, time: 0.0 }
        })
        .collect()
}

fn closest(c: &mut Criterion) {
    let tracer = dented(320);
    let rays = rays(1 << 12);
    let mut group = c.benchmark_group("closest");
    group.throughput(Throughput::Elements(rays.len() as u64));
    group.bench_function("204800 triangles, incoherent", |b| {
        b.iter_batched_ref(
            || vec![Hit::MISS; rays.len()],
            |hits| tracer.closest(&rays, hits),
            BatchSize::SmallInput,
        );
    });
    group.finish();
}

fn lookup(c: &mut Criterion) {
    let registry: FormatRegistry = granita_plugin::bundled_formats(Limits::default());
    let folder = tempfile::tempdir().unwrap();
    let texture = folder.path().join("brick.tx");
    let image = granita_benches::repository().join("examples/first/brick.png");
    make(&[image], &texture, &MakeOptions::default(), &registry, &|_, _| {}).unwrap();
    let cache = TextureCache::new(registry, Default::default(), CacheOptions::default(), Reporter::silent());
    let id = cache.find_for(&texture.to_string_lossy(), Use::Texture).unwrap();
    let mut group = c.benchmark_group("texture");
    for (name, dsdx, dtdy) in [("one texel", 1.0 / 512.0, 1.0 / 512.0), ("8:1", 8.0 / 512.0, 1.0 / 512.0)] {
        group.throughput(Throughput::Elements(64 * 64));
        group.bench_function(name, |b| {
            let mut out = [0.0; 4];
            b.iter(|| {
                for j in 0..64 {
                    for i in 0..64 {
                        let at = Lookup {
                            s: i as f32 / 64.0,
                            t: j as f32 / 64.0,
                            dsdx,
                            dtdy,
                            ..Lookup::default()
                        };
                        cache.texture(id, &at, &mut out);
                    }
                }
                black_box(out)
            });
        });
    }
    group.finish();
}

/// Returns a million photons. Half of them are spread evenly over a square. The other half are crowded along a ring, as
/// under a lens.
fn photons() -> Packed {
    let unit = |i: u32, d: u32| granita_base::hash::unit(granita_base::hash::words(&[i, d]));
    let record = |i: u32| {
        let (a, b) = (unit(i, 0), unit(i, 1));
        let [x, y] = if i.is_multiple_of(2) {
            [a, b]
        } else {
            let (s, c) = (a * std::f32::consts::TAU).sin_cos();
            let r = 0.2 + 0.02 * (b - 0.5) * b;
            [0.5 + r * c, 0.5 + r * s]
        };
        [x, y, 0.0, 0.0, 0.0, 1.0, 1.0, 0.5, 0.2]
    };
    let schema = Schema { key: Key::Oriented, value: Value::Color };
    Packed::new(schema, &(0..1_000_000).flat_map(record).collect::<Vec<f32>>())
}

fn databases(c: &mut Criterion) {
    let photons = photons();
    let unit = |i: u32, d: u32| granita_base::hash::unit(granita_base::hash::words(&[i, d]));
    let probes: Vec<Probe> = (0..4096)
        .map(|i| {
            let (x, y) = (i % 64, i / 64);
            let p = [(x as f32 + unit(i, 5)) / 64.0, (y as f32 + unit(i, 6)) / 64.0, 0.0];
            Probe { p, n: Some([0.0, 0.0, 1.0]) }
        })
        .collect();
    let mut group = c.benchmark_group("databases");
    group.sample_size(10);
    group.throughput(Throughput::Elements(probes.len() as u64));
    for minsamples in [20, 100, 500] {
        let how = Density { minsamples, maxdist: 0.1, maxerror: 0.25 };
        group.bench_function(format!("density of {minsamples} photons"), |b| {
            b.iter(|| probes.iter().filter_map(|p| photons.density(p, &how)).count());
        });
    }
    let how = Between { minsamples: 3, maxdist: 0.05, maxerror: 0.25, always: false };
    group.bench_function("values of 3 records", |b| {
        b.iter(|| probes.iter().filter_map(|p| photons.between(p, &how)).count());
    });
    group.finish();
}

criterion_group!(kernels, dice, closest, lookup, databases);
criterion_main!(kernels);
