//! Mesh files as scenes: Wavefront OBJ, Stanford PLY, glTF 2.

#![forbid(unsafe_code)]

use granita_scene::Generator;
use std::sync::Arc;

/// The generators of this crate.
pub fn generators() -> Vec<Arc<dyn Generator>> {
    Vec::new()
}
