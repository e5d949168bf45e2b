//! Runs code: registers, masks, control flow.

pub mod approx;
pub(crate) mod control;
pub(crate) mod executor;
pub(crate) mod gather;
pub(crate) mod kernel;
pub(crate) mod lanes;
pub(crate) mod light;
pub(crate) mod machine;
pub(crate) mod noise_lanes;
pub(crate) mod params;
pub(crate) mod parts;
pub(crate) mod simd;
pub(crate) mod store;
pub(crate) mod strings;
