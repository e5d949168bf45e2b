//! Runs shaders over grids of points in structure-of-arrays lanes.

mod grid;
mod services;

pub use grid::{Grid, Lanes3, Primvar, PrimvarData, RayKind, Topology};
pub use services::{
    Batch, EnvironmentQuery, IlluminateQuery, Lane, Lane3, LightInfo, LightResult, LightSample,
    LookupOptions, LookupResult, Services, ShadowQuery, TextureQuery, TraceQuery, TraceResult,
};
