//! Making textures: everything that `maketx` does (reference 9.1).

mod options;

pub use options::{Made, MakeOptions, Mode};
