//! The input and the output of the search for hits.

use super::SampleGrid;
use super::visible::{ShadedGrid, ViewedGrid};
use granita_base::{Vec2, Vec3};
use granita_dicing::PixelRect;

/// A grid that is rasterized over samples.
pub(super) struct Raster<'a> {
    pub(super) samples: &'a SampleGrid,
    pub(super) grid: &'a ShadedGrid,
    /// The grid as seen by the eye whose samples these are.
    pub(super) view: &'a ViewedGrid,
}

/// The corners of a micropolygon, in order around it.
pub(super) struct Corners {
    /// Their indices in the grid.
    pub(super) indices: [usize; 4],
    /// Their positions at the first and at the last key, in camera space.
    pub(super) ends: [[Vec3; 4]; 2],
}

/// A hit of a sample on a micropolygon.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hit {
    pub(super) sample: usize,
    /// The depth in camera space.
    pub(super) z: f32,
    /// The index of the lower left point of the micropolygon.
    pub(super) at: u32,
    /// The coordinates in the micropolygon.
    pub(super) u: f32,
    pub(super) v: f32,
    /// True when the micropolygon is on the boundary edge of its grid.
    pub(super) rim: bool,
    /// The direction from the sample to the grid, of any length, when the sample lies beside the grid, no farther
    /// from its boundary edge than [`ViewedGrid::rim_px`] raster pixels.
    pub(super) beside: Option<Vec2>,
}

/// Receives hits, and provides the depths beyond which hits are not needed.
pub(super) trait Sink {
    /// True when everything at depth `z` and behind it is hidden in all pixels of a rectangle.
    fn hides(&mut self, rect: &PixelRect, z: f32) -> bool;
    /// For each sample, and [`SampleGrid::PADDING`] more: the depth at and beyond which hits are not needed. `None`
    /// when all hits are needed.
    fn limits(&self) -> Option<&[f32]>;
    /// Receives a hit.
    fn hit(&mut self, hit: Hit);
}

/// The largest amount, relative to the depth, by which rounding may put a hit before all corners of its micropolygon.
const DEPTH_ROUNDING: f32 = 1e-5;

/// Returns a depth that is before all hits of micropolygons whose corners are at `z` or farther.
pub(super) fn before(z: f32) -> f32 {
    z - z.abs() * DEPTH_ROUNDING
}

/// True when a point at `from`, relative to the start of an edge `d`, is beside the edge and not beyond its ends by
/// more than about `pad`. A sharp corner whose sides are widened would otherwise have a long spike.
pub(super) fn spans(d: Vec2, from: Vec2, pad: f32) -> bool {
    // Two perpendicular sides, each widened by `pad`, intersect 1.41 `pad` away from the corner.
    let (along, length) = (from.dot(d), d.length());
    along >= -1.5 * pad * length && along <= (length + 1.5 * pad) * length
}
