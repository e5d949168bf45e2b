//! Tile cache, filtered lookups, environment and shadow maps, and the making of textures.

mod cache;
mod cube;
mod environment;
mod error;
mod file;
mod files;
mod footprint;
mod kind;
mod lookup;
pub mod make;
mod picture;
mod plain;
mod sampler;
mod shadow;
mod shared;
mod statistics;
mod tiles;
mod volume;
mod wrap;

pub use cache::{CacheOptions, TextureCache, TextureId, Use};
pub use error::{Result, TextureError};
pub use kind::TextureKind;
pub use lookup::{EnvLookup, Lookup, ShadowLookup, Up};
pub use statistics::CacheStatistics;
pub use wrap::Wrap;
