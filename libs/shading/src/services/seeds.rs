//! The seeds of random numbers of the lanes of a run.

use granita_base::hash;
use granita_shade::{Grid, IlluminateQuery, Lane3};
use std::cell::OnceCell;

/// The seed of each lane, for grids whose lanes have their own ([`Grid::names`]). On other grids, the seed of the grid
/// and the index of the lane are used.
#[derive(Default)]
pub(super) struct LaneSeeds<'q> {
    /// Those that are known.
    pub(super) own: OnceCell<Vec<u32>>,
    /// How those of a light are made, when its shader draws the first random number. Most lights draw none.
    pub(super) of_light: Option<LightSeeds<'q>>,
}

impl<'q> LaneSeeds<'q> {
    /// Returns those of a grid.
    pub(super) fn of_grid(grid: &Grid) -> Self {
        let own = OnceCell::new();
        if !grid.names.is_empty() {
            own.get_or_init(|| grid.names.clone());
        }
        Self { own, of_light: None }
    }

    /// Returns the seeds of all lanes; `None` when the lanes have none.
    pub(super) fn list(&self) -> Option<&[u32]> {
        match &self.of_light {
            Some(light) => Some(self.own.get_or_init(|| light.list())),
            None => self.own.get().map(Vec::as_slice),
        }
    }

    /// Returns the seed of a lane, if it has one.
    pub(super) fn of(&self, lane: usize) -> Option<u32> {
        self.list()?.get(lane).copied()
    }
}

/// What the lane seeds of a light follow from. They depend only on the query, so that a kept result equals one that is
/// computed again.
pub(super) struct LightSeeds<'q> {
    /// The seeds of the lanes of the surface.
    base: &'q [u32],
    light: u32,
    index: u32,
    ps: Lane3<'q>,
    active: &'q [u32],
}

impl<'q> LightSeeds<'q> {
    /// Returns those of the sample `index` of a query to the light with the seed `light`.
    pub(super) fn new(base: &'q [u32], light: u32, query: &IlluminateQuery<'q>, index: u32) -> Self {
        Self { base, light, index, ps: query.ps, active: query.batch.active }
    }

    /// Computes the seeds of all lanes.
    pub(super) fn list(&self) -> Vec<u32> {
        let mut seeds = self.base.to_vec();
        for &lane in self.active {
            if let Some(seed) = seeds.get_mut(lane as usize) {
                let [x, y, z] = self.ps.get(lane as usize).to_array().map(f32::to_bits);
                *seed = hash::words(&[*seed, self.light, self.index, x, y, z]);
            }
        }
        seeds
    }
}
