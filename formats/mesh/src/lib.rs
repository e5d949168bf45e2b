//! Mesh files as scenes: Wavefront OBJ, Stanford PLY, glTF 2.

#![forbid(unsafe_code)]

mod emit;
mod faults;
mod obj;
mod ply;
mod source;
mod text;
#[cfg(test)]
mod trial;

pub use obj::Obj;
pub use ply::Ply;

use granita_scene::Generator;
use std::sync::Arc;

/// The generators of this crate.
pub fn generators() -> Vec<Arc<dyn Generator>> {
    vec![Arc::new(Obj), Arc::new(Ply)]
}
