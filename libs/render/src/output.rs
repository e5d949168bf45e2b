//! The images of a frame, with their content ([`plan`]), the collection of buckets ([`canvas`]), and grids as scenes
//! ([`griddump`]).

pub(crate) mod canvas;
pub(crate) mod griddump;
pub(crate) mod plan;
