//! Compares our rays per second with those of Embree, on the same meshes and rays in one run, with one thread.
//!
//! `cargo run --release -p granita-benches --bin rays [-- --python PROGRAM] [--large] [MESH.ply|MESH.obj ...]`
//!
//! The built-in mesh is a displaced sphere of a million triangles. Other meshes are files. There are five kinds of
//! rays: those of a camera (coherent, in rows and in tiles), those from the visible surface to a light (coherent),
//! those from around the mesh through its box, and those from its surface (both incoherent).
//!
//! Embree comes from the Python package `embreex`, which is found by the option or in `python3`. It is measured through
//! the package, and, where there is a C compiler (`cc`), also through its own calls: those of single rays, and the
//! fastest of those of packets of 8 and 16 rays, with and without the hint that the rays are coherent. The ratio is
//! that to the fastest of all its own calls. The programs alternate, and the fastest of four runs counts.
//!
//! `--large` also measures the memory of ten million triangles in a geometry set: in a tree, and in whole frames of
//! `gelato` in which a mirror reflects a mesh, or a displaced patch that rays tessellate.

#![forbid(unsafe_code)]
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a table for a terminal")]

use cpu_time::ThreadTime;
use granita_benches::{
    BLOCKS, KINDS, blocks, find_program, measure as cost_of, rays, read_mesh, release_tool, repository,
    sphere,
};
use granita_trace::{Hit, Ray, Tracer, TracerBuilder, TriangleMesh};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::time::Instant;

/// The number of runs of each measurement.
const RUNS: usize = 4;

fn main() -> ExitCode {
    granita_benches::exit("rays", run())
}

fn run() -> Result<(), String> {
    let mut python = find_program("python3");
    let (mut large, mut files) = (false, Vec::new());
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        match &*word {
            "--python" => python = words.next().map(PathBuf::from),
            "--large" => large = true,
            file => files.push(PathBuf::from(file)),
        }
    }
    let place = tempfile::tempdir().map_err(|e| e.to_string())?;
    let embree = Embree::find(python, place.path());
    println!(
        "{:<28} {:<15} {:>9} {:>9} {:>9} {:>9} {:>7}",
        "mesh", "Mray/s", "ours", "single", "packets", "embreex", "ratio"
    );
    compare("displaced sphere", &sphere(1000), &embree, place.path())?;
    for file in files {
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        compare(&name, &read_mesh(&file)?, &embree, place.path())?;
    }
    if large {
        memory(place.path())?;
    }
    Ok(())
}

fn build(mesh: TriangleMesh, threads: usize) -> Tracer {
    let mut builder = TracerBuilder::new();
    builder.add(mesh);
    builder.build(threads)
}

/// Prints the memory of ten million triangles in a tree, and in frames whose mirror reflects them.
fn memory(place: &Path) -> Result<(), String> {
    let mesh = sphere(3163);
    let n = mesh.triangles.len();
    write_ply(&mesh, &place.join("ball.ply")).map_err(|e| e.to_string())?;
    let start = Instant::now();
    let tracer = build(mesh, 2);
    let wall = start.elapsed().as_secs_f64();
    println!(
        "{n} triangles: {:.1} bytes each, built in {wall:.1} s by two threads",
        per_triangle(&tracer, n)
    );
    drop(tracer);
    let gelato = release_tool("gelato")?;
    println!(
        "\n{:<20} {:>10} {:>9} {:>12} {:>15} {:>8}",
        "a mirror sees", "triangles", "peak MiB", "no ray, MiB", "bytes/triangle", "wall"
    );
    let ball = "Input (\"ball.ply\")\n";
    let bumps = "Shader (\"displacement\", \"bumpy\")\nAttribute (\"float displace:maxradius\", 0.01)\n\
                 Attribute (\"float shadingquality\", 3.5)\n\
                 Patch (\"linear\", 2, 2, \"vertex point P\", (-2, -2, -6, 2, -2, -6, -2, 2, -6, 2, 2, -6))\n";
    for (what, seen) in [("a mesh", ball), ("a displaced patch", bumps)] {
        let run = |surface: &str| {
            let scene = format!(
                "Attribute (\"int[2] resolution\", (640, 480))\nAttribute (\"string projection\", \"perspective\")\n\
                 Attribute (\"float fov\", 40)\nAttribute (\"string units:length\", \"cm\")\n\
                 Output (\"memory.tif\", \"tiff\", \"rgb\", \"camera\")\nWorld ()\nPushAttributes ()\n\
                 Shader (\"surface\", \"constant\")\nAttribute (\"string geometryset\", \"seen\")\n{seen}\
                 PopAttributes ()\nShader (\"surface\", {surface})\nPatch (\"linear\", 2, 2, \"vertex point P\", \
                 (-3, -3, 2, 3, -3, 2, -3, 3, 2, 3, 3, 2))\nRender ()\n"
            );
            std::fs::write(place.join("memory.pyg"), scene).map_err(|e| e.to_string())?;
            let command = || {
                let mut command = Command::new(&gelato);
                command.current_dir(place).args(["-threads", "2", "-statistics", "memory.pyg"]);
                command
            };
            let told = output(&mut command());
            Ok::<_, String>((cost_of(1, command)?, told))
        };
        let (without, _) = run("\"constant\"")?;
        let (with, told) = run("\"shiny\", \"float Kr\", 1, \"string envname\", \"seen\"")?;
        // The line has the form "structures built 1 of 1 (10004569 triangles, 123456 KB)".
        let row = told.lines().find(|line| line.contains("structures built")).unwrap_or_default();
        let count =
            row.split('(').nth(1).and_then(|rest| rest.split_whitespace().next()?.parse::<u64>().ok());
        let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
        if let (Some(n), Some(peak), Some(base)) = (count, with.peak_bytes, without.peak_bytes) {
            println!(
                "{what:<20} {n:>10} {:>9.0} {:>12.0} {:>15.1} {:>7.1}s",
                mib(peak),
                mib(base),
                peak.saturating_sub(base) as f64 / n as f64,
                with.wall.as_secs_f64()
            );
        } else {
            println!("{what:<20} no numbers: {told}");
        }
    }
    Ok(())
}

/// Writes a mesh as a binary file.
fn write_ply(mesh: &TriangleMesh, file: &Path) -> std::io::Result<()> {
    let mut out = BufWriter::new(File::create(file)?);
    write!(
        out,
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        mesh.positions[0].len(),
        mesh.triangles.len()
    )?;
    for p in &mesh.positions[0] {
        // The mesh is moved behind the camera.
        for x in [p.x, p.y, p.z - 5.0] {
            out.write_all(&x.to_le_bytes())?;
        }
    }
    for t in &mesh.triangles {
        out.write_all(&[3])?;
        for v in t {
            out.write_all(&v.to_le_bytes())?;
        }
    }
    out.flush()
}

fn per_triangle(tracer: &Tracer, triangles: usize) -> f64 {
    tracer.bytes() as f64 / triangles as f64
}

/// The least seconds of all runs, and the number of hits, by the kind of rays and the kind of query.
#[derive(Debug, Default)]
struct Times(BTreeMap<(String, String), (f64, usize)>);

impl Times {
    fn add(&mut self, kind: &str, question: &str, seconds: f64, hits: usize) {
        let best = self.0.entry((kind.into(), question.into())).or_insert((f64::INFINITY, hits));
        best.0 = best.0.min(seconds);
        best.1 = hits;
    }

    /// Returns the rate in millions of rays per second.
    fn rate(&self, kind: &str, question: &str, rays: usize) -> Option<f64> {
        self.0.get(&(kind.into(), question.into())).map(|t| rays as f64 / t.0 * 1e-6)
    }

    /// Adds the times that one of the other programs printed.
    fn read(&mut self, text: &str) {
        for line in text.lines() {
            let words: Vec<&str> = line.split_whitespace().collect();
            let [kind, question, seconds, hits] = words[..] else { continue };
            if let (Ok(seconds), Ok(hits)) = (seconds.parse(), hits.parse()) {
                self.add(kind, question, seconds, hits);
            }
        }
    }
}

fn compare(name: &str, mesh: &TriangleMesh, embree: &Embree, place: &Path) -> Result<(), String> {
    let tracer = build(mesh.clone(), 2);
    let plain = KINDS.iter().map(|kind| (*kind, rays(mesh, kind)));
    let all: Vec<Batch> =
        plain.chain(BLOCKS.iter().map(|kind| (*kind, blocks(mesh, &tracer, kind)))).collect();
    drop(tracer);
    write(mesh, &all, place).map_err(|e| e.to_string())?;
    let (mut ours, mut alone, mut package) = (Times::default(), Times::default(), Times::default());
    let n = mesh.triangles.len();
    let mut walls = [f64::INFINITY; 2];
    for _ in 0..RUNS {
        for threads in [2, 1] {
            let copy = mesh.clone();
            let start = Instant::now();
            let tracer = build(copy, threads);
            walls[threads - 1] = walls[threads - 1].min(start.elapsed().as_secs_f64());
            if threads == 1 {
                measure(&tracer, &all, &mut ours);
            }
        }
        alone.read(&embree.alone(place));
        package.read(&embree.package(place));
    }
    for (kind, rays) in &all {
        for question in ["closest", "any"] {
            let rate = |times: &Times, question: &str| times.rate(kind, question, rays.len());
            let text = |x: Option<f64>| x.map_or("-".to_owned(), |x| format!("{x:.2}"));
            let (own, single) = (rate(&ours, question), rate(&alone, question));
            let packets = rate(&alone, &format!("{question}-packets"));
            let best = single.map(|rate| rate.max(packets.unwrap_or_default()));
            println!(
                "{name:<28} {:<15} {:>9} {:>9} {:>9} {:>9} {:>7}",
                format!("{kind} {question}"),
                text(own),
                text(single),
                text(packets),
                text(rate(&package, question)),
                text(own.zip(best).map(|(a, b)| a / b)),
            );
        }
    }
    let bytes = per_triangle(&build(mesh.clone(), 1), n);
    println!(
        "{n} triangles: {bytes:.1} bytes each, built in {:.2} s, {:.2} s by two threads",
        walls[0], walls[1]
    );
    for (key, (_, hits)) in &ours.0 {
        if let Some((_, theirs)) = alone.0.get(key).filter(|t| t.1 != *hits) {
            println!("{} {}: {hits} hits, Embree {theirs}", key.0, key.1);
        }
    }
    Ok(())
}

/// The name of a kind of rays, and the rays.
type Batch = (&'static str, Vec<Ray>);

fn measure(tracer: &Tracer, all: &[Batch], times: &mut Times) {
    for (kind, rays) in all {
        let mut hits = vec![Hit::MISS; rays.len()];
        let start = ThreadTime::now();
        tracer.closest(rays, &mut hits);
        let seconds = start.elapsed().as_secs_f64();
        times.add(kind, "closest", seconds, hits.iter().filter(|h| h.is_hit()).count());
        let mut blocked = vec![false; rays.len()];
        let start = ThreadTime::now();
        tracer.any(rays, &mut blocked);
        let seconds = start.elapsed().as_secs_f64();
        times.add(kind, "any", seconds, blocked.iter().filter(|b| **b).count());
    }
}

/// The parts of Embree that are available.
struct Embree {
    python: Option<PathBuf>,
    /// The program of Embree's own calls, and the library.
    alone: Option<(PathBuf, PathBuf)>,
}

impl Embree {
    /// Searches for Embree, and prints which parts are missing.
    fn find(python: Option<PathBuf>, place: &Path) -> Self {
        let script = peer("embree_rays.py");
        let library = python.as_ref().and_then(|python| {
            let told = Command::new(python).arg(&script).arg("--library").output().ok()?;
            let path = String::from_utf8(told.stdout).ok()?;
            told.status.success().then(|| PathBuf::from(path.trim()))
        });
        let Some(library) = library else {
            println!("embreex is not here (--python, or python3 on the search path): ours alone");
            return Self { python: None, alone: None };
        };
        let program = place.join("embree_rays");
        let built = Command::new("cc")
            .arg("-O2")
            .arg(peer("embree_rays.c"))
            .arg("-o")
            .arg(&program)
            .arg("-ldl")
            .output()
            .is_ok_and(|o| o.status.success());
        if !built {
            println!("no C compiler (cc): Embree as embreex calls it alone");
        }
        Self { python, alone: built.then_some((program, library)) }
    }

    /// Runs the program of Embree's own calls, and returns its output.
    fn alone(&self, place: &Path) -> String {
        let Some((program, library)) = &self.alone else { return String::new() };
        output(Command::new(program).arg(library).arg(place))
    }

    /// Runs the package, and returns its output.
    fn package(&self, place: &Path) -> String {
        let Some(python) = &self.python else { return String::new() };
        output(Command::new(python).arg(peer("embree_rays.py")).arg(place))
    }
}

fn peer(file: &str) -> PathBuf {
    repository().join("benches").join("peers").join(file)
}

fn output(command: &mut Command) -> String {
    match command.output() {
        Ok(o) if o.status.success() => String::from_utf8_lossy(&o.stdout).into_owned(),
        Ok(o) => {
            eprintln!("{command:?}: {}", String::from_utf8_lossy(&o.stderr));
            String::new()
        }
        Err(e) => {
            eprintln!("{command:?}: {e}");
            String::new()
        }
    }
}

fn write(mesh: &TriangleMesh, all: &[Batch], place: &Path) -> std::io::Result<()> {
    let floats = |list: &mut dyn Iterator<Item = f32>| list.flat_map(f32::to_le_bytes).collect::<Vec<u8>>();
    std::fs::write(place.join("mesh.v"), floats(&mut mesh.positions[0].iter().flat_map(|p| p.to_array())))?;
    let indices: Vec<u8> = mesh.triangles.iter().flatten().flat_map(|i| i.to_le_bytes()).collect();
    std::fs::write(place.join("mesh.f"), indices)?;
    for (kind, rays) in all {
        let numbers =
            floats(&mut rays.iter().flat_map(|r| {
                [r.origin.x, r.origin.y, r.origin.z, r.tmin, r.dir.x, r.dir.y, r.dir.z, r.tmax]
            }));
        std::fs::write(place.join(format!("{kind}.rays")), numbers)?;
    }
    Ok(())
}
