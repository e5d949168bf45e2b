//! Acceleration structures over moving triangles; rays in batches.
//!
//! Meshes are added to a [`TracerBuilder`], which builds a [`Tracer`]; the tracer answers rays in batches.
//!
//! # Invariants
//!
//! - **Watertight**: a ray through a shared edge or vertex hits one of the triangles around it (Woop, Benthin, Wald:
//!   "Watertight Ray/Triangle Intersection", JCGT 2(1), 2013).
//! - **Deterministic**: of several hits at one distance the one with the smallest (mesh, triangle) is returned,
//!   whatever the shape of the tree.
//! - **Any scale**: the tree is built over the normalized scene; nothing depends on absolute sizes.
//! - Rays with NaN anywhere, or with a zero direction, miss.
//!
//! # Deliberately absent
//!
//! Shading, transparency and materials: see [`Tracer::closest_where`] for the hook.
#![forbid(unsafe_code)]

mod mesh;
mod ray;
mod tracer;

pub use mesh::{MeshId, TriangleMesh};
pub use ray::{Hit, Ray};
pub use tracer::{Tracer, TracerBuilder};
