//! Light that arrives at points: lights and their areas, maps as lights, and the cache of indirect light.

pub(crate) mod area;
pub(crate) mod cache;
pub(crate) mod directions;
pub(crate) mod lights;
pub(crate) mod subsurface;
