//! What the suite costs, kernels and frames apart.
//!
//! - `cargo bench -p granita-benches` measures kernels: dicing, closest hits, texture lookups;
//! - `cargo run --release -p granita-benches --bin frames` renders whole frames in child processes and prints wall
//!   clock and peak memory, with one thread and with all;
//! - `cargo run --release -p granita-benches --bin views` measures what a second eye, more samples, a second thread and
//!   preview mode cost, as ratios;
//! - `cargo run --release -p granita-benches --bin viewer` opens and pans pictures in `iv` under Xvfb;
//! - `cargo run --release -p granita-benches --bin rays` measures rays beside Embree, `--example trees` our tree beside
//!   those of the crate `obvhs`;
//! - `cargo xtask trade SCENE` measures what each knob of indirect light and occlusion costs and buys;
//! - `cargo run --release -p granita-benches --bin peers` runs our tools and the public ones of the field side by
//!   side, as ratios, and says which it could not find.
//!
//! Numbers worth keeping stand in `docs/performance.md`, with the command that prints them.

#![forbid(unsafe_code)]

mod fur;
mod measure;
mod meshes;

pub use fur::Fur;
pub use measure::{Cost, find_program, measure, measure_into, release_tool, repository};
pub use meshes::{KINDS, rays, read_mesh, soup, sphere};
