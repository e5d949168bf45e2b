//! Running: registers, masks, control flow.

pub(crate) mod control;
pub(crate) mod executor;
pub(crate) mod kernel;
pub(crate) mod light;
pub(crate) mod machine;
pub(crate) mod params;
pub(crate) mod store;
pub(crate) mod strings;
