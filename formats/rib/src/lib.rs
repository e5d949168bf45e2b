//! RIB files as scenes (RenderMan interface 3.2).

#![forbid(unsafe_code)]

use granita_scene::Generator;
use std::sync::Arc;

/// The generators of this crate.
pub fn generators() -> Vec<Arc<dyn Generator>> {
    Vec::new()
}
