//! The shading language: source text to checked IR to `.gso`, and the parameter query.

mod func;
pub mod ir;

pub use func::Func;
pub use ir::Module;
