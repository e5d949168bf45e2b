//! Measures how fast Pyg scene files are read (flat, binary, and through Python), and how much memory reading needs.
//!
//! `cargo run --release -p granita-benches --bin reading [MEGABYTES]`. The scene is a row of meshes that are made here.

#![forbid(unsafe_code)]
#![allow(clippy::print_stdout, reason = "a table for a terminal")]

use granita_base::{Location, Param, ParamData, Params, Reporter, ShapeDesc};
use granita_benches::measure;
use granita_pyg::{PygOptions, PygSource, Writer, WriterOptions, read};
use granita_scene::{Call, SceneSink, Stop};
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use std::process::{Command, ExitCode};

/// The number of points of each side of a mesh.
const SIDE: usize = 256;

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let done = match args.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        // This is the child process. It reads one file and keeps nothing.
        ["--read", file, how] => read_one(file, how),
        [] => compare(200),
        [megabytes] => megabytes.parse().map_err(|_| format!("{megabytes} is no size")).and_then(compare),
        _ => Err("reading [MEGABYTES]".into()),
    };
    granita_benches::exit("reading", done)
}

/// A sink that counts calls and drops them.
#[derive(Default)]
struct Counter {
    calls: usize,
}

impl SceneSink for Counter {
    fn call(&mut self, _: Call, _: &Location) -> Result<(), Stop> {
        self.calls += 1;
        Ok(())
    }
}

fn read_one(file: &str, how: &str) -> Result<(), String> {
    let options = PygOptions { never_pyglet: how == "python", ..PygOptions::default() };
    let mut sink = Counter::default();
    read(PygSource::Path(file.into()), &mut sink, &options, &Reporter::silent())
        .map_err(|e| e.to_string())?;
    if sink.calls < 3 { Err(format!("{} calls", sink.calls)) } else { Ok(()) }
}

/// Returns a wavy sheet. Each `k` gives a different one.
fn sheet(k: usize) -> (ShapeDesc, Params) {
    let mut points = Vec::with_capacity(3 * SIDE * SIDE);
    for j in 0..SIDE {
        for i in 0..SIDE {
            let (x, y) = (i as f32 / SIDE as f32, j as f32 / SIDE as f32);
            points.extend([x * 10.0, y * 10.0, (x * 7.0 + k as f32).sin() * (y * 5.0).cos()]);
        }
    }
    let faces = (SIDE - 1) * (SIDE - 1);
    let corner = |f: usize, n: usize| {
        let (i, j) = (f % (SIDE - 1), f / (SIDE - 1));
        (i + (n == 1 || n == 2) as usize + (j + (n > 1) as usize) * SIDE) as i32
    };
    let verts: Vec<i32> = (0..faces).flat_map(|f| (0..4).map(move |n| corner(f, n))).collect();
    let shape = ShapeDesc::Mesh { subdivide: false, nverts: vec![4; faces].into(), verts: verts.into() };
    let p =
        Param::declared("vertex point P", ParamData::Float(points.into())).expect("invariant: a declaration");
    (shape, [p].into_iter().collect())
}

fn write(file: &Path, binary: bool, bytes: u64) -> Result<u64, String> {
    let out = BufWriter::new(File::create(file).map_err(|e| e.to_string())?);
    let mut writer = Writer::with_options(out, WriterOptions { binary, ..WriterOptions::default() });
    let at = Location::default();
    let size = |file: &Path| file.metadata().map_or(0, |m| m.len());
    let mut k = 0;
    while size(file) < bytes {
        let (shape, params) = sheet(k);
        k += 1;
        writer.call(Call::Shape { shape: Box::new(shape), params }, &at).map_err(|e| e.to_string())?;
    }
    writer.into_inner().map_err(|e| e.to_string())?.into_inner().map_err(|e| e.to_string())?;
    Ok(size(file))
}

fn compare(megabytes: u64) -> Result<(), String> {
    let place = tempfile::tempdir().map_err(|e| e.to_string())?;
    let own = std::env::current_exe().map_err(|e| e.to_string())?;
    let text = place.path().join("text.pyg");
    let size = write(&text, false, megabytes << 20)?;
    let binary = place.path().join("binary.pyg");
    // The scene is the same. Binary arrays need about half the bytes.
    let binary_size = write(&binary, true, (size as f64 * 0.47) as u64)?;
    println!("{:<24} {:>8} {:>10} {:>10} {:>10}", "reading", "MB", "seconds", "MB/s", "peak MB");
    let mut seconds = Vec::new();
    for (name, file, size, how, times) in [
        ("flat text", &text, size, "flat", 3),
        ("binary", &binary, binary_size, "flat", 3),
        ("the same text by Python", &text, size, "python", 1),
    ] {
        let cost = measure(times, || {
            let mut command = Command::new(&own);
            command.arg("--read").arg(file).arg(how);
            command
        })?;
        let wall = cost.wall.as_secs_f64();
        let (mb, peak) = (size as f64 / 1e6, cost.peak_bytes.map_or(f64::NAN, |b| b as f64 / 1e6));
        println!("{name:<24} {mb:>8.1} {wall:>10.3} {:>10.0} {peak:>10.0}", mb / wall);
        // The number is the seconds for one megabyte of text.
        let text_mb = if how == "flat" && file == &binary { mb / 0.47 } else { mb };
        seconds.push(wall / text_mb);
    }
    println!(
        "flat text {:.1} times, binary {:.1} times as fast as Python",
        seconds[2] / seconds[0],
        seconds[2] / seconds[1]
    );
    Ok(())
}
