//! The seeds of random numbers of the lanes of a run.

use super::Run;
use granita_base::sample::Draw;
use granita_base::{NoiseSource, hash};
use granita_shade::{Grid, IlluminateQuery, Lane3, Rect};
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

impl Run<'_, '_> {
    /// Returns the lane whose seed a lane has for the sequences that neighbours share, its number among them, and their
    /// number.
    ///
    /// The points of a rectangle share one sequence, in the order of a curve that keeps neighbours together. The
    /// samples of a point are then well distributed among those of the points around it (after Ahmed, Wonka:
    /// Screen-Space Blue-Noise Diffusion of Monte Carlo Sampling Error via Hierarchical Ordering of Pixels,
    /// SIGGRAPH Asia 2020).
    pub(super) fn part_of(&self, lane: usize) -> (usize, [u32; 2]) {
        match self.topology.rect_of(lane).filter(|rect| rect.lanes().contains(&lane)) {
            Some(Rect { first, nu, nv }) => {
                let curve = |column: usize, row: usize| spread(column as u32) | spread(row as u32) << 1;
                let k = lane - first;
                (first, [curve(k % nu, k / nu), curve(nu - 1, nv - 1) + 1])
            }
            None => (lane, [0, 1]),
        }
    }

    /// Returns what a lane draws in a call for `source` from a sequence that neighbours share.
    pub(super) fn draw(&self, source: NoiseSource, call: u32, lane: u32) -> Draw {
        let (seed, part) = self.shared_seed(call, lane);
        Draw { sequence: self.frame.sequence(self.frame.seed_of(source, seed)), part }
    }

    /// Returns the same when the call itself draws nothing and only passes it on.
    pub(super) fn share(&self, call: u32, lane: u32) -> Draw {
        let (seed, part) = self.shared_seed(call, lane);
        Draw { sequence: self.frame.sequence(seed), part }
    }

    /// Lanes with seeds of their own may have made another number of calls than their neighbours.
    fn shared_seed(&self, call: u32, lane: u32) -> (u32, [u32; 2]) {
        let (first, part) = self.part_of(lane as usize);
        let seed = match self.seeds.of(first) {
            Some(seed) => hash::words(&[seed, self.lane_calls[lane as usize]]),
            None => hash::words(&[self.seed, call, first as u32]),
        };
        (seed, part)
    }
}

/// Returns the lower 16 bits of a number, spread to every second place.
fn spread(x: u32) -> u32 {
    let x = (x | x << 8) & 0x00ff_00ff;
    let x = (x | x << 4) & 0x0f0f_0f0f;
    let x = (x | x << 2) & 0x3333_3333;
    (x | x << 1) & 0x5555_5555
}

impl<'q> LightSeeds<'q> {
    /// Returns those of the sample `index` of a query to the light with the seed `light`.
    pub(super) fn new(base: &'q [u32], light: u32, query: &IlluminateQuery<'q>, index: u32) -> Self {
        Self { base, light, index, ps: query.ps, active: query.batch.active }
    }

    /// Computes the seeds of all lanes.
    pub(super) fn list(&self) -> Vec<u32> {
        // Those of points that do not ask are shared with their neighbours.
        let mut seeds: Vec<u32> =
            self.base.iter().map(|seed| hash::words(&[*seed, self.light, self.index])).collect();
        for &lane in self.active {
            let i = lane as usize;
            if let (Some(base), Some(seed)) = (self.base.get(i), seeds.get_mut(i)) {
                let [x, y, z] = self.ps.get(i).to_array().map(f32::to_bits);
                *seed = hash::words(&[*base, self.light, self.index, x, y, z]);
            }
        }
        seeds
    }
}
