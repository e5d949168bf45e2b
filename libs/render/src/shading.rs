//! A frame as shaders see it, and the threads that run them.
//!
//! [`ShadingContext`] is made once per frame and shared: lights are linked at once, object states when they
//! are first asked for, structures for rays when the first ray needs them. A [`ShaderThread`] holds what
//! one thread writes to while it shades.

mod context;
mod run;
mod thread;

pub(crate) use context::ShadingContext;
pub(crate) use thread::{MAX_RAY_LEVELS, MORE_NESTED, ShaderThread};
