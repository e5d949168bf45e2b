//! Measures the cost of the suite, with kernels and frames apart.
//!
//! - `cargo bench -p granita-benches` measures kernels: dicing, closest hits, texture lookups;
//! - `cargo run --release -p granita-benches --bin frames` renders whole frames in child processes and prints wall
//!   clock time and peak memory, with one thread and with all;
//! - `cargo run --release -p granita-benches --bin views` measures the cost of a second eye, more samples, a second
//!   thread and preview mode, as ratios;
//! - `cargo run --release -p granita-benches --bin viewer` opens and pans images in `iv` under Xvfb;
//! - `cargo run --release -p granita-benches --bin rays` compares rays with Embree, and `--example trees` compares our
//!   tree with those of the crate `obvhs`;
//! - `cargo run --release -p granita-benches --bin growth` measures how time and memory grow with pixels,
//!   micropolygons, primitives, lights, textures and rays;
//! - `cargo run --release -p granita-benches --bin relight` compares re-rendered frames with frames rendered anew;
//! - `cargo run --release -p granita-benches --bin desk` measures how quickly the desk for lighting answers, in a page
//!   and in a window;
//! - `cargo run --release -p granita-benches --bin bounces` measures reflections of reflections and further bounces of
//!   indirect light;
//! - `cargo run --release -p granita-benches --bin errors` renders twelve scenes at requested errors, and compares what
//!   was reached with converged images;
//! - `cargo xtask trade SCENE` measures the time and the error of each parameter of indirect light and occlusion;
//! - `cargo run --release -p granita-benches --bin peers` runs our tools and the public ones of the field, prints
//!   ratios, and reports which tools it could not find;
//! - `python3 benches/peers/light.py` compares indirect light with Mitsuba and Cycles, and `benches/peers/aqsis.py`
//!   compares whole frames with Aqsis on the same RIB files.
//!
//! The current numbers are in `docs/performance.md`, with the commands that print them.

#![forbid(unsafe_code)]

mod fur;
mod measure;
mod meshes;
mod screen;

pub use fur::Fur;
pub use measure::{Cost, copy_files, find_program, measure, measure_into, release_tool, repository};
pub use meshes::{BLOCKS, KINDS, blocks, rays, read_mesh, soup, sphere};
pub use screen::Screen;

/// Prints the message of a benchmark that failed, after its name. Returns the status of the program.
#[allow(clippy::print_stderr, reason = "a message for a terminal")]
pub fn exit(name: &str, done: Result<(), String>) -> std::process::ExitCode {
    match done {
        Ok(()) => std::process::ExitCode::SUCCESS,
        Err(what) => {
            eprintln!("{name}: {what}");
            std::process::ExitCode::FAILURE
        }
    }
}
