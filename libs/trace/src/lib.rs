//! Acceleration structures over moving triangles; rays in batches.
//!
//! Meshes are added to a [`TracerBuilder`], which builds a [`Tracer`]; the tracer answers rays in batches.
//!
//! # Invariants
//!
//! - **Watertight**: a ray through a shared edge or vertex hits one of the triangles around it (Woop, Benthin, Wald:
//!   "Watertight Ray/Triangle Intersection", JCGT 2(1), 2013).
//! - **Exact**: a tree finds what a test of all triangles finds, to the bit; of several hits at one distance the one
//!   with the smallest (mesh, triangle).
//! - **Deterministic**: neither threads, nor the order of a batch, nor the machine (AVX2 or not; no multiply-add is
//!   fused) changes a bit.
//! - **Any scale**: coordinates are scaled by a power of two; nothing depends on absolute sizes.
//! - Rays with NaN anywhere, or with a zero direction, miss.
//!
//! - **In parts as whole**: tracers made [`TracerBuilder::within`] one bound answer as a single one of all their meshes
//!   would. A [`BoxTree`] says which of them a ray passes.
//!
//! # Deliberately absent
//!
//! Shading, transparency and materials: see [`Tracer::closest_where`] for the hook.
//!
//! # Example
//!
//! ```
//! use granita_base::Vec3;
//! use granita_trace::{Hit, Ray, TracerBuilder, TriangleMesh};
//! let mut builder = TracerBuilder::new();
//! builder.add(TriangleMesh {
//!     times: vec![0.0],
//!     positions: vec![vec![Vec3::ZERO, Vec3::X, Vec3::Y]],
//!     triangles: vec![[0, 1, 2]],
//! });
//! let tracer = builder.build(1);
//! let ray = Ray { origin: Vec3::new(0.2, 0.3, 2.0), tmin: 0.0, dir: -Vec3::Z, tmax: f32::INFINITY, time: 0.0 };
//! let mut hits = [Hit::MISS];
//! tracer.closest(&[ray], &mut hits);
//! assert_eq!((hits[0].t, hits[0].triangle), (2.0, 0));
//! ```
#![deny(unsafe_code)]

mod boxes;
mod build;
mod layout;
mod mesh;
mod moving;
mod order;
mod probe;
mod ray;
mod scene;
mod simd;
mod still;
mod trace;
mod tracer;
mod tree;

#[cfg(test)]
mod tests;

pub use boxes::{BoxRoom, BoxTree, Passage};
pub use mesh::{MeshId, TriangleMesh};
pub use ray::{Hit, Ray};
pub use still::Triangles;
pub use trace::RayRoom;
pub use tracer::{Tracer, TracerBuilder};
