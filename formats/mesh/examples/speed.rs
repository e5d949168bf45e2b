//! Measures how fast a mesh file is read: `cargo run --release -p granita-mesh --example speed -- FILE [COPIES]`.
//!
//! The file is read COPIES times (10), from memory, into a receiver that counts its calls. The measured time is that of
//! the processor.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program of its own")]

use cpu_time::ProcessTime;
use granita_base::{Location, Reporter, ShapeDesc};
use granita_scene::{Call, GeneratorRegistry, GeneratorSource, SceneSink, Stop};
use std::path::Path;
use std::process::ExitCode;

#[derive(Default)]
struct Count {
    calls: usize,
    faces: usize,
}

impl SceneSink for Count {
    fn call(&mut self, call: Call, _: &Location) -> Result<(), Stop> {
        self.calls += 1;
        if let Call::Shape { shape, .. } = call
            && let ShapeDesc::Mesh { nverts, .. } = &*shape
        {
            self.faces += nverts.len();
        }
        Ok(())
    }
}

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let Some(file) = args.first() else {
        eprintln!("speed FILE [COPIES]");
        return ExitCode::from(2);
    };
    let copies: u32 = args.get(1).and_then(|a| a.parse().ok()).unwrap_or(10);
    let mut generators = GeneratorRegistry::default();
    granita_mesh::generators().into_iter().for_each(|g| generators.add(g));
    let (Some(generator), Ok(bytes)) = (generators.by_extension(Path::new(file)), std::fs::read(file)) else {
        eprintln!("{file}: no mesh file that can be read");
        return ExitCode::from(2);
    };
    let source = GeneratorSource::bytes(file.clone(), bytes);
    let GeneratorSource::Bytes { bytes, .. } = &source else { return ExitCode::FAILURE };
    let mut count = Count::default();
    let begin = ProcessTime::now();
    for _ in 0..copies {
        if let Err(error) = generator.run(&source, &mut count, &Reporter::silent()) {
            eprintln!("{error}");
            return ExitCode::FAILURE;
        }
    }
    let seconds = begin.elapsed().as_secs_f64();
    let megabytes = bytes.len() as f64 * f64::from(copies) / 1.0e6;
    println!(
        "{megabytes:.0} MB in {seconds:.3} s: {:.0} MB/s, {} calls, {} faces",
        megabytes / seconds,
        count.calls,
        count.faces
    );
    ExitCode::SUCCESS
}
