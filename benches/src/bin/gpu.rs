//! Compares the rays per second of a device with those of all cores of the CPU, on the same meshes and rays in one run,
//! and their hits to the bit.
//!
//! `cargo run --release -p granita-benches --features gpu --bin gpu [-- --adapter N] [--size N] [--ply FILE]
//! [MESH.ply|MESH.obj ...]`
//!
//! The built-in mesh is a displaced sphere of `N^2` triangles: a million by default. Other meshes are files. The kinds
//! of rays are those of the program `rays`. Occlusion has 64 rays around each of 65536 points of the surface, which the
//! device makes itself. "device" is the time by its own clock. "whole" includes the transfer of rays and hits. Each
//! number is the best of four runs. `selftest` runs first. `--ply` only writes the sphere to a file.

#![forbid(unsafe_code)]
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a table for a terminal")]

use granita_benches::{KINDS, rays, read_mesh, sphere};
use granita_gpu::{
    Choice, Device, GpuTracer, INPUTS, Limits, Occluded, OcclusionPoint, adapters, occlusion_on_cpu, selftest,
};
use granita_rays::sampling::ConeCells;
use granita_trace::{Hit, Ray, Tracer, TracerBuilder, TriangleMesh};
use rayon::prelude::*;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

/// The number of runs of each measurement.
const RUNS: usize = 4;
/// The number of rays that a thread of the CPU traces at once.
const CHUNK: usize = 1 << 14;
/// The number of points of the occlusion, and of their rays.
const POINTS: usize = 1 << 16;
const RAYS_OF_POINT: u32 = 64;

fn main() -> ExitCode {
    granita_benches::exit("gpu", run())
}

fn run() -> Result<(), String> {
    let (mut choice, mut size, mut files, mut ply) = (Choice::Auto, 1000, Vec::new(), None);
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        match &*word {
            "--adapter" => choice = words.next().unwrap_or_default().parse()?,
            "--size" => size = words.next().and_then(|w| w.parse().ok()).ok_or("--size needs a number")?,
            "--ply" => ply = words.next(),
            file => files.push(file.to_owned()),
        }
    }
    if let Some(file) = ply {
        return write_ply(&sphere(size), Path::new(&file)).map_err(|error| format!("{file}: {error}"));
    }
    adapters().iter().for_each(|adapter| println!("{adapter}"));
    let device = open(choice)?;
    println!("\nmeasured: {}, {} cores\n", device.adapter().name, rayon::current_num_threads());
    let start = Instant::now();
    let holds = selftest(&device, INPUTS, &mut |agreement| println!("{agreement}"))
        .map_err(|error| error.to_string())?;
    println!(
        "selftest: {} in {:.1} s\n",
        if holds { "all hold" } else { "NOT ALL HOLD" },
        start.elapsed().as_secs_f64()
    );
    println!(
        "{:<20} {:<22} {:>9} {:>10} {:>10} {:>8} {:>8}",
        "mesh", "Mray/s", "CPU", "device", "whole", "x whole", "differ"
    );
    compare(&device, "displaced sphere", sphere(size))?;
    for file in &files {
        compare(&device, file, read_mesh(Path::new(file))?)?;
    }
    let work = device.statistics();
    println!(
        "\n{} runs, {:.3} s on the device, {:.1} MiB at most",
        work.runs,
        work.seconds,
        work.peak_bytes as f64 / f64::from(1 << 20)
    );
    Ok(())
}

/// Writes a mesh as a binary file.
fn write_ply(mesh: &TriangleMesh, file: &Path) -> std::io::Result<()> {
    let mut out = BufWriter::new(File::create(file)?);
    let (vertices, faces) = (mesh.positions[0].len(), mesh.triangles.len());
    write!(
        out,
        "ply\nformat binary_little_endian 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\n\
         property float z\nelement face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    )?;
    for p in &mesh.positions[0] {
        out.write_all(&p.to_array().map(f32::to_le_bytes).concat())?;
    }
    for t in &mesh.triangles {
        // The other orientation, whose normals point outward.
        out.write_all(&[3])?;
        out.write_all(&[t[0], t[2], t[1]].map(u32::to_le_bytes).concat())?;
    }
    out.flush()
}

/// Opens the chosen device, or the first one where none is hardware.
fn open(choice: Choice) -> Result<Arc<Device>, String> {
    for choice in [choice, Choice::Index(0)] {
        if let Some(device) = Device::open(choice, Limits::default()).map_err(|error| error.to_string())? {
            return Ok(device);
        }
    }
    Err("no adapter".to_owned())
}

/// The best times of a measurement, in seconds.
struct Times {
    cpu: f64,
    device: f64,
    whole: f64,
}

impl Times {
    const NONE: Self = Self { cpu: f64::INFINITY, device: f64::INFINITY, whole: f64::INFINITY };

    fn print(&self, mesh: &str, kind: &str, rays: usize, differ: usize) {
        let rate = |seconds: f64| rays as f64 / seconds * 1e-6;
        println!(
            "{mesh:<20} {kind:<22} {:>9.1} {:>10.1} {:>10.1} {:>8.2} {differ:>8}",
            rate(self.cpu),
            if self.device > 0.0 { rate(self.device) } else { f64::NAN },
            rate(self.whole),
            self.cpu / self.whole
        );
    }
}

fn compare(device: &Arc<Device>, name: &str, mesh: TriangleMesh) -> Result<(), String> {
    let failed = |error: granita_gpu::GpuError| error.to_string();
    let kinds: Vec<(&str, Vec<Ray>)> = KINDS.iter().map(|kind| (*kind, rays(&mesh, kind))).collect();
    let points = points(&mesh);
    let triangles = mesh.triangles.len();
    let mut builder = TracerBuilder::new();
    builder.add(mesh);
    let start = Instant::now();
    let tracer = Arc::new(builder.build(rayon::current_num_threads()));
    let built = start.elapsed().as_secs_f64();
    let start = Instant::now();
    let resident = GpuTracer::new(device.clone(), tracer.clone()).map_err(failed)?;
    println!(
        "{name}: {triangles} triangles; trees: CPU {built:.2} s, device {:.2} s and {:.1} MiB",
        start.elapsed().as_secs_f64(),
        resident.bytes() as f64 / f64::from(1 << 20)
    );
    for (kind, rays) in &kinds {
        closest(name, kind, rays, &tracer, &resident).map_err(failed)?;
        any(name, kind, rays, &tracer, &resident).map_err(failed)?;
    }
    let (mut times, mut expected, mut got) = (Times::NONE, Vec::new(), Vec::new());
    for _ in 0..RUNS {
        let start = Instant::now();
        expected = points.par_iter().map(|point| occlusion_on_cpu(&tracer, point)).collect::<Vec<Occluded>>();
        times.cpu = times.cpu.min(start.elapsed().as_secs_f64());
        let start = Instant::now();
        let (sums, traced) = resident.occlusion(&points).map_err(failed)?;
        times.whole = times.whole.min(start.elapsed().as_secs_f64());
        times.device = times.device.min(traced.seconds);
        got = sums;
    }
    let bits = |o: &Occluded| (o.blocked, o.open.to_array().map(f32::to_bits));
    let differ = expected.iter().zip(&got).filter(|(a, b)| bits(a) != bits(b)).count();
    times.print(name, "occlusion", points.iter().map(|p| p.cells.count() as usize).sum(), differ);
    Ok(())
}

fn closest(
    name: &str,
    kind: &str,
    rays: &[Ray],
    tracer: &Tracer,
    resident: &GpuTracer,
) -> Result<(), granita_gpu::GpuError> {
    let cpu = |rays: &[Ray], hits: &mut [Hit]| tracer.closest(rays, hits);
    let device = |hits: &mut Vec<Hit>| Ok(resident.closest(rays, hits)?.seconds);
    let (times, expected, got) = timed(rays, Hit::MISS, cpu, device)?;
    let bits = |h: &Hit| (h.t.to_bits(), h.mesh, h.triangle, h.b1.to_bits(), h.b2.to_bits());
    let differ = expected.iter().zip(&got).filter(|(a, b)| bits(a) != bits(b)).count();
    times.print(name, &format!("{kind}, closest"), rays.len(), differ);
    Ok(())
}

fn any(
    name: &str,
    kind: &str,
    rays: &[Ray],
    tracer: &Tracer,
    resident: &GpuTracer,
) -> Result<(), granita_gpu::GpuError> {
    let cpu = |rays: &[Ray], blocked: &mut [bool]| tracer.any(rays, blocked);
    let device = |blocked: &mut Vec<bool>| Ok(resident.any(rays, blocked)?.seconds);
    let (times, expected, got) = timed(rays, false, cpu, device)?;
    let differ = expected.iter().zip(&got).filter(|(a, b)| a != b).count();
    times.print(name, &format!("{kind}, any"), rays.len(), differ);
    Ok(())
}

/// Traces rays on all cores and on the device, in turns. `device` returns the seconds there. Returns the least times
/// and the results of both.
fn timed<T: Clone + Send>(
    rays: &[Ray],
    none: T,
    cpu: impl Fn(&[Ray], &mut [T]) + Sync,
    device: impl Fn(&mut Vec<T>) -> Result<f64, granita_gpu::GpuError>,
) -> Result<(Times, Vec<T>, Vec<T>), granita_gpu::GpuError> {
    let (mut times, mut expected) = (Times::NONE, vec![none; rays.len()]);
    let mut got = expected.clone();
    for _ in 0..RUNS {
        let start = Instant::now();
        let parts = expected.par_chunks_mut(CHUNK).zip(rays.par_chunks(CHUNK));
        parts.for_each(|(found, rays)| cpu(rays, found));
        times.cpu = times.cpu.min(start.elapsed().as_secs_f64());
        let start = Instant::now();
        times.device = times.device.min(device(&mut got)?);
        times.whole = times.whole.min(start.elapsed().as_secs_f64());
    }
    Ok((times, expected, got))
}

/// Returns points over the surface of a mesh, slightly outside of it.
fn points(mesh: &TriangleMesh) -> Vec<OcclusionPoint> {
    let positions = &mesh.positions[0];
    let step = (mesh.triangles.len() / POINTS).max(1);
    let corners = mesh.triangles.iter().step_by(step).take(POINTS);
    corners
        .enumerate()
        .map(|(k, corners)| {
            let [a, b, c] = corners.map(|v| positions[v as usize]);
            // The normals of the sphere point inward.
            let axis = (c - a).cross(b - a).normalize_or(granita_base::Vec3::Z);
            OcclusionPoint {
                p: (a + b + c) / 3.0 + axis * 1e-4,
                axis,
                tmin: 0.0,
                tmax: f32::INFINITY,
                time: 0.0,
                cells: ConeCells::new(RAYS_OF_POINT, std::f32::consts::FRAC_PI_2, true),
                seed: k as u32,
            }
        })
        .collect()
}
