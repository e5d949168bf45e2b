//! Numbers of frames, the names of their files, and jobs for the engines of render farms.
//!
//! A [`FrameRange`] is what people write for some frames, such as `1-240` or `1-10x2,20`. [`numbered`] puts the number
//! of a frame into a name, such as `shot.####.pyg`. A [`Job`] is a small graph of steps, read from a file, which
//! [`slurm`] and [`openjd`] write in the languages of two engines.
//!
//! ```
//! use granita_farm::{FrameRange, numbered};
//! let frames: FrameRange = "1-10x3".parse().unwrap();
//! assert_eq!(frames.numbers(), [1, 4, 7, 10]);
//! assert_eq!(numbered("shot.####.pyg", 4), "shot.0004.pyg");
//! ```
//!
//! This crate starts no program and reads no file.

#![forbid(unsafe_code)]

mod job;
mod names;
pub mod openjd;
mod range;
pub mod slurm;

pub use job::{Job, JobError, Step, Work};
pub use names::{has_number, numbered, unnumbered, with_frame};
pub use range::{FrameRange, RangeError};
