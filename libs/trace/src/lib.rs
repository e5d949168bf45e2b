//! Acceleration structures over still and moving triangles, for batches of rays.
//!
//! Meshes are added to a [`TracerBuilder`], which builds a [`Tracer`]. The tracer finds the hits of rays in batches.
//!
//! # Invariants
//!
//! - **Watertight**: a ray through a shared edge or vertex hits one of the triangles around it (Woop, Benthin, Wald:
//!   "Watertight Ray/Triangle Intersection", JCGT 2(1), 2013).
//! - **Exact**: a tree finds the same hits as a test of all triangles, to the bit. Of several hits at one distance it
//!   returns the one with the smallest (mesh, triangle).
//! - **Deterministic**: the number of threads, the order of a batch, the rays that are traversed together and the
//!   machine (AVX2 or not; no multiply-add is fused) do not change a bit of the result.
//! - **Any scale**: coordinates are scaled by a power of two. Results do not depend on absolute sizes.
//! - Rays with a NaN in any number, or with a zero direction, miss.
//! - **Independent of the division into parts**: tracers that are made [`TracerBuilder::within`] one bound find the
//!   same hits as a single tracer of all their meshes. A [`BoxTree`] finds the tracers that a ray passes.
//!
//! # Deliberately absent
//!
//! Shading, transparency and materials. [`Tracer::closest_where`] is the hook for them.
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
#![forbid(unsafe_code)]

mod accelerator;
mod boxes;
mod build;
mod group;
mod layout;
mod mesh;
mod moving;
mod order;
mod packet;
mod probe;
mod ray;
mod resident;
mod scene;
mod single;
mod still;
mod trace;
mod tracer;
mod tree;

#[cfg(test)]
mod tests;

pub use accelerator::{Accelerator, TracerCopy};
pub use boxes::{BoxScratch, BoxTree, Passage};
pub use mesh::{MeshId, TriangleMesh};
pub use ray::{Hit, Ray};
pub use resident::Resident;
pub use single::RayScratch;
pub use still::Triangles;
pub use tracer::{Tracer, TracerBuilder};
