//! The images of a frame, with their content ([`plan`]), the collection of buckets ([`canvas`]), the files of frames
//! that were ended early ([`partial`]), and grids as scenes ([`griddump`]).

pub(crate) mod canvas;
pub(crate) mod griddump;
pub(crate) mod partial;
pub(crate) mod plan;
