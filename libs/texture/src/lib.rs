//! Tile cache, filtered lookups, environment and shadow maps, and the making of textures.

mod cache;
mod error;
mod kind;
mod lookup;
pub mod make;
mod statistics;
mod wrap;

pub use cache::{CacheOptions, TextureCache, TextureId, Use};
pub use error::{Result, TextureError};
pub use kind::TextureKind;
pub use lookup::{EnvLookup, Lookup, ShadowLookup, Up};
pub use statistics::CacheStatistics;
pub use wrap::Wrap;
