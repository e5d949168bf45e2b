//! Renders frames, from buckets, splitting and dicing to shading, hiding, filtering and the writing of images.
//!
//! [`Renderer::render`] takes a finished [`granita_scene::Scene`] and writes the images that its `Output` calls
//! request. Everything from outside of the scene (formats, shaders, search paths, messages) is passed in as a
//! [`RenderEnvironment`]. This crate does not read the environment of the process, does not print and does not exit.
//!
//! `geom` builds a primitive into pieces. `frame` bounds, culls and splits the pieces until each dices into a grid of
//! limited size ([`granita_dicing`]). The grid is displaced and shaded once ([`granita_shading`]), in "common" space
//! (world space, or world space moved by the offset of `nearby`), for all buckets that need it. [`granita_hider`]
//! samples its micropolygons at jittered places, times and lens points, and filters the samples into pixels. `output`
//! collects the pixels and writes the images.
//!
//! # Invariants
//!
//! - Pixels are the same to the bit for any number of threads, bucket order, bucket size and crop. Splitting and dicing
//!   depend on the primitive and the camera only. Samples are hashed from the absolute pixel, the sample and the
//!   dimension. Every sum has a fixed order.
//! - A grid is shaded at most once while it is needed, and only when a bucket that is rendered may see it.
//! - A panic while a bucket is rendered is reported with the bucket, and the other buckets are rendered.
//!
//! # Deliberately absent
//!
//! This crate does not contain file formats, scene parsing or the shading language.

#![forbid(unsafe_code)]

mod accuracy;
mod bucket;
mod deferred;
mod dynamic;
mod environment;
mod error;
mod frame;
mod larger;
mod nearby;
mod output;
mod passes;
mod preshaded;
mod preview;
mod priority;
mod refine;
mod renderer;
mod schedule;
mod spread;
mod statistics;
mod unknown;

#[cfg(test)]
mod tests;

pub use environment::{CallText, Progress, RenderEnvironment, Silent};
pub use error::RenderError;
pub use granita_dicing::{CameraView, EyeProjection, PixelRect};
pub use granita_shading::{NoShader, ShaderLibrary, ShadingStatistics, check_light};
pub use output::halves::DenoisedError;
pub use output::partial::partial_path;
pub use passes::{ErrorEstimate, ImageError, PassPlan, PassReport};
pub use priority::Priority;
pub use renderer::{FrameReport, Kept, Renderer};
pub use schedule::{Answer, Schedule, Task};
pub use spread::{BucketPixels, Buckets, Coordinator, Spread, Want, Workers};
pub use statistics::{Denoised, Reuse, Statistics};
