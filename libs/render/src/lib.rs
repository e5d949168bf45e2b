//! A frame: buckets, split, dice, displace, shade, hide, filter, write.
//!
//! [`Renderer::render`] takes a finished [`granita_scene::Scene`] and writes the images that its
//! `Output` calls asked for. Everything from outside (formats, shaders, search paths, messages) comes
//! in through a [`RenderEnvironment`]; nothing here reads the process's environment, prints or exits.
//!
//! The way of a primitive: `geom` builds it into pieces; `dicing` bounds, culls and splits the pieces
//! until each dices into a grid of a bearable size; the grid is displaced and shaded **once**, in
//! "common" space (the world, or that moved: `nearby`), however many buckets need it; `hider` samples its micropolygons at
//! jittered places, times and lens points; `output` filters
//! the samples into pixels and writes them. What shaders ask for is answered by `services`, with `rays` and `lighting`.
//!
//! # Invariants
//!
//! - Pixels are the same to the bit for any number of threads, bucket order, bucket size and crop:
//!   splitting and dicing depend on the primitive and the camera only, samples are hashed from
//!   (absolute pixel, sample, dimension), and every sum has a fixed order.
//! - A grid is shaded at most once, and only when a bucket that must be rendered may see it.
//! - A panic while a bucket is rendered is reported with the bucket; the other buckets go on.
//!
//! # Deliberately absent
//!
//! File formats, scene parsing, the shading language; those are handed in.

#![forbid(unsafe_code)]

mod bucket;
mod camera;
mod dicing;
mod dynamic;
mod environment;
mod error;
mod finite;
mod frame;
mod hider;
mod lighting;
mod nearby;
mod object;
mod output;
mod preshaded;
mod preview;
mod priority;
mod rays;
mod renderer;
mod sampling;
mod services;
mod shading;
mod spaces;
mod spread;
mod statistics;
mod texts;
mod unknown;
mod unread;

#[cfg(test)]
mod fixture;
#[cfg(test)]
mod tests;

pub use camera::{CameraView, EyeProjection, Lens, PreviewLimits, Projection, ShadedFrom, Stereo};
pub use environment::{CallText, NoShader, Progress, RenderEnvironment, ShaderLibrary, Silent};
pub use error::RenderError;
pub use granita_image::PixelRect;
pub use priority::Priority;
pub use renderer::{FrameReport, Renderer};
pub use spread::{BucketPixels, Buckets, Coordinator, Spread, Workers};
pub use statistics::{ShadingStatistics, Statistics};

/// How a shader's lookups are answered from texture files: for who runs shaders without a frame.
pub mod lookups {
    pub use crate::services::maps::{environment, shadow, texture, texture3d};
}
