//! The images of a frame: what goes into them ([`plan`]), samples to pixels ([`film`]), buckets to images ([`canvas`]), and grids
//! as scenes ([`griddump`]).

pub(crate) mod canvas;
pub(crate) mod film;
pub(crate) mod griddump;
pub(crate) mod plan;
