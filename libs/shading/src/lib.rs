//! Runs shaders in a frame, and answers their requests for textures, lights, rays, indirect light and databases.
//!
//! A [`ShadingContext`] is made once per frame and shared by all threads. It links lights at once, object states
//! when they are first requested, and builds ray structures when the first ray needs them. A [`ShaderThread`] holds
//! the state that one thread writes to while it shades. It displaces and shades grids, and it shades ray hits as
//! grids with the same executor. The module `services` answers the calls of shaders, with the sets of
//! [`granita_rays`] and the records, areas and maps of `lighting`.
//!
//! # Invariants
//!
//! The result of a shader at a point depends on the point and the scene. It does not depend on the grid, the thread
//! or the order of shading.
//!
//! # Deliberately absent
//!
//! This crate does not handle pixels, samples or images. Dynamic shadow maps are passed in as [`DepthMaps`].

#![forbid(unsafe_code)]

mod context;
mod environment;
mod files_used;
mod lighting;
mod memo;
mod object;
pub mod preshaded;
mod renew;
mod run;
mod services;
mod spaces;
mod statistics;
mod texts;
mod thread;
mod trace;

#[cfg(test)]
mod fixture;
#[cfg(test)]
mod tests;

pub use context::{DepthMaps, ShadingContext};
pub use environment::{NoShader, ShaderLibrary, ShadingEnvironment};
pub use memo::{Changes, Memo, MemoBytes};
pub use object::{DEFAULT_SURFACE, LinkedShaders, ObjectState, check_light};
pub use spaces::{Spaces, Units};
pub use statistics::ShadingStatistics;
pub use thread::ShaderThread;

/// Answers the lookups of a shader from texture files, for programs that run shaders without a frame.
pub mod lookups {
    pub use crate::services::maps::{environment, shadow, texture, texture3d};
}
