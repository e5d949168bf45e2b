//! Reads mesh files as scenes: Wavefront OBJ ([`Obj`]), Stanford PLY ([`Ply`]), STL ([`Stl`]) and glTF 2 ([`Gltf`]).
//!
//! [`GltfImages`] reads the images in glTF files, as an image format. Each other reader is a
//! [`granita_scene::Generator`]. `Input ("bunny.obj")` makes its calls with the current transformation and attributes.
//! The section "Mesh files" of the manual lists what each element of the formats becomes. The sources are the OBJ and
//! MTL specifications of Wavefront's Advanced Visualizer (1991, 1995), G. Turk's description of PLY (1994) and the glTF
//! 2.0 specification of the Khronos Group.
//!
//! Invariants:
//! - Coordinates are kept as they are in the file. Texture coordinates are measured from the upper edge of the image,
//!   as in the suite. `t` of OBJ and PLY is flipped, and `t` of glTF is not.
//! - An element that contains an error is left out. There is one message for each kind of error, with the first
//!   position and the number of further ones. No input causes a panic. No allocation is larger than the file justifies,
//!   for any header.
//! - Memory holds what faces may still refer to (the vertices of an OBJ file) and what one call must contain: a group
//!   of an OBJ file, the one mesh of a PLY file, a primitive of a glTF file.
//! - `Attribute ("int user:materials", 0)` keeps the materials of a file out of the scene, and `user:lights` its
//!   lights. `Attribute ("float user:smooth", 40)` gives meshes without normals smooth ones.
//!
//! Deliberately absent are free-form curves and surfaces of OBJ files, and animation of glTF files (skins and morph
//! targets are at rest). Each is reported by name. Compressed geometry of glTF files is decoded by the libraries of the
//! features `draco` and `meshopt`, both on by default.
//!
//! ```
//! use granita_base::Reporter;
//! use granita_mesh::Obj;
//! use granita_pyg::Writer;
//! use granita_scene::{Generator, GeneratorSource};
//! let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
//! let source = GeneratorSource::bytes("<example>", text.as_bytes());
//! let mut writer = Writer::new(Vec::new());
//! Obj.run(&source, &mut writer, &Reporter::silent())?;
//! assert!(writer.into_inner()?.starts_with(b"Mesh (\"linear\", (3,), (0, 1, 2)"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![forbid(unsafe_code)]
#![warn(unnameable_types)]

mod emit;
mod faults;
mod gltf;
mod obj;
mod ply;
mod smooth;
mod source;
mod stl;
mod text;
#[cfg(test)]
mod trial;

pub use gltf::{Glb, Gltf, GltfImages};
pub use obj::Obj;
pub use ply::Ply;
pub use stl::Stl;

use granita_scene::Generator;
use std::sync::Arc;

/// Returns the generators of this crate.
pub fn generators() -> Vec<Arc<dyn Generator>> {
    vec![Arc::new(Obj), Arc::new(Ply), Arc::new(Stl), Arc::new(Gltf), Arc::new(Glb)]
}
