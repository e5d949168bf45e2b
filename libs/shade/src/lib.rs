//! Runs shaders over grids of points in structure-of-arrays lanes.

mod error;
mod executor;
mod grid;
mod group;
mod services;

pub use error::ShadeError;
pub use executor::Executor;
pub use grid::{Grid, Lanes3, Message, Primvar, PrimvarData, RayKind, Topology};
pub use group::{ConnectionSource, Group, LayerSource};
pub use services::{
    Batch, EnvironmentQuery, IlluminateQuery, Lane, Lane3, LightInfo, LightResult, LightSample,
    LookupOptions, LookupResult, Services, ShadowQuery, TextureQuery, TraceQuery, TraceResult,
};
