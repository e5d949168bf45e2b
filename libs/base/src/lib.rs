//! Types and functions that all crates of the suite share.
//!
//! This crate does not depend on file formats, shaders, cameras or images. An item is added to it when three crates
//! need it, and it contains no policy:
//!
//! - [`transform`]: 4x4 matrices acting on row vectors, and matrices that move over time;
//! - [`bound`]: axis-aligned boxes;
//! - [`number`]: fast conversion of text to numbers;
//! - [`math`]: powers and logarithms that have the same bits on every machine;
//! - [`OnceMap`]: values that are made once each, by the first thread that requests them;
//! - [`Lru`]: values within a limit, of which the least recently used ones are evicted;
//! - [`parallel_map`]: work on many items by several threads;
//! - [`param`]: typed, named values as the scene interface passes them (`"vertex point P"`);
//! - [`shape`]: the description of a geometric primitive, shared by scene, readers and geometry;
//! - [`process`]: the activities of a run, and the processes that it started;
//! - [`report`]: messages for the user, sorted by severity, and reported once per cause;
//! - [`search`]: search paths with `&` and variables;
//! - [`files`]: every file that is read or written is opened here, by the rules of the run;
//! - [`filter`]: reconstruction filters by name;
//! - [`hash`] and [`sample`]: random numbers that depend only on their coordinates;
//! - [`PassNumbers`]: those of the passes of an image, by what they are used for ([`NoiseSource`]).
//!
//! The conventions of the whole suite are these. Points are **row vectors**. Matrices are stored row by row, with the
//! translation in the last row, and `a.then(b)` applies `a` first. "camera" space is left handed: x right, y up, z
//! into the screen.
//!
//! ```
//! use granita_base::{Transform, Vec3};
//! let m = Transform::scale(Vec3::splat(2.0)).then(&Transform::translate(Vec3::new(0.0, 0.0, 5.0)));
//! assert_eq!(m.point(Vec3::new(1.0, 0.0, 0.0)), Vec3::new(2.0, 0.0, 5.0));
//! ```

#![forbid(unsafe_code)]

mod bits;
pub mod bound;
pub mod files;
pub mod filter;
pub mod hash;
mod lru;
pub mod math;
mod noise;
pub mod number;
mod once;
mod parallel;
pub mod param;
pub mod process;
pub mod report;
pub mod sample;
pub mod search;
pub mod shape;
mod spelling;
pub mod transform;

pub use bound::Bound;
pub use files::{AtomicFile, Confinement, FileError, FileStamp, Files, MovedFolders, Rules};
pub use filter::Filter;
pub use glam::{DMat4, DVec3, Vec2, Vec3, Vec4};
pub use lru::Lru;
pub use noise::{NoiseSource, NoiseSources, PassNumbers};
pub use number::{Number, scan_number};
pub use once::OnceMap;
pub use parallel::parallel_map;
pub use param::{BaseType, Interp, Param, ParamData, ParamType, Params};
pub use process::Supervisor;
pub use report::{Location, Reporter, Severity};
pub use search::{Environment, SearchPath};
pub use shape::{CurveBasis, ShapeDesc, TrimDesc};
pub use spelling::suggestion;
pub use transform::{MotionTransform, Transform};

/// A colour: three linear components, by default in "rgb" space.
pub type Color = Vec3;

/// The version of the suite, as `-version` prints it.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
