//! The images of a frame, with their content ([`plan`]), the collection of buckets ([`canvas`]), sums of
//! passes ([`accumulated`]) and of halves of them ([`halves`]), their files
//! ([`writer`]), files of several images ([`gather`], [`parts`]), the files of frames that were ended early
//! ([`partial`]), ids and coverages of objects ([`cryptomatte`]), and grids as scenes ([`griddump`]).

pub(crate) mod accumulated;
pub(crate) mod canvas;
pub(crate) mod cryptomatte;
pub(crate) mod gather;
pub(crate) mod griddump;
pub(crate) mod halves;
pub(crate) mod partial;
pub(crate) mod parts;
pub(crate) mod plan;
pub(crate) mod writer;
