//! Finds the inputs that scenes and command lines name, and reads them.
//!
//! An input is a scene file, the output of a program, a string, or anything else that a generator reads.
//! [`Inputs::find`] resolves its name (reference 2.9), and [`Input::read`] passes its calls to a
//! [`granita_scene::SceneSink`]. Generators are those of [`RunOptions::plugins`], then the bundled ones, then
//! `NAME.generator.so` in the folders of "path:generator", then programs in those folders.
//!
//! [`RunOptions`] holds what a run takes from its process. [`shell`] and [`program`] return the commands for programs
//! that a scene runs.
//!
//! This crate does not read the environment, print or exit, and it depends on no renderer.

#![forbid(unsafe_code)]

mod inputs;
mod options;
mod programs;

pub use inputs::{Input, InputError, Inputs};
pub use options::{OwnTools, RunOptions};
pub use programs::{prepare, program, shell};
