//! Runs groups.

use crate::{Grid, Group, IlluminateQuery, LightResult, Services};
use granita_gsl::ir::ValueType;

/// Runs shaders; keeps its memory from run to run. One per thread, and one more per level of lights.
#[derive(Debug, Default)]
pub struct Executor {}

impl Executor {
    /// With no memory yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Runs a surface, displacement or volume group.
    pub fn run(
        &mut self,
        group: &Group,
        grid: &mut Grid,
        services: &mut dyn Services,
        wanted: &[(&str, ValueType)],
    ) -> Vec<Option<Vec<f32>>> {
        let _ = (group, grid, services);
        vec![None; wanted.len()]
    }

    /// Runs a light.
    pub fn run_light(
        &mut self,
        group: &Group,
        surface_grid: &Grid,
        query: &IlluminateQuery<'_>,
        services: &mut dyn Services,
    ) -> LightResult {
        let _ = (group, surface_grid, query, services);
        LightResult::default()
    }
}
