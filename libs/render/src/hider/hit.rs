//! What the search for hits is given, and what it tells.

use super::SampleGrid;
use super::visible::{ShadedGrid, ViewedGrid};
use crate::PixelRect;
use granita_base::Vec2;

/// A grid over samples.
pub(super) struct Raster<'a> {
    pub(super) samples: &'a SampleGrid,
    pub(super) grid: &'a ShadedGrid,
    /// As the eye sees it whose samples these are.
    pub(super) view: &'a ViewedGrid,
}

/// A micropolygon at a sample.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hit {
    pub(super) sample: usize,
    /// Camera space depth.
    pub(super) z: f32,
    /// Lower left point of the micropolygon.
    pub(super) at: u32,
    /// Place in the micropolygon.
    pub(super) u: f32,
    pub(super) v: f32,
    /// The micropolygon is on the rim of its grid.
    pub(super) rim: bool,
    /// The sample lies beside the grid, no farther from its rim than [`ViewedGrid::rim_px`]: where the grid is from
    /// there, of any length.
    pub(super) beside: Option<Vec2>,
}

/// Takes hits, and knows what it no longer wants.
pub(super) trait Sink {
    /// Whether everything at depth `z` and behind it is hidden in all pixels of a rectangle.
    fn hides(&mut self, rect: &PixelRect, z: f32) -> bool;
    /// Per sample, and [`SampleGrid::PADDING`] more: hits that are not before this depth are not wanted. `None` when all
    /// are.
    fn limits(&self) -> Option<&[f32]>;
    /// A micropolygon at a sample.
    fn hit(&mut self, hit: Hit);
}

/// By how much (part of a depth) a hit may come out before all corners of its micropolygon, by rounding.
const DEPTH_ROUNDING: f32 = 1e-5;

/// A depth that is before all hits of micropolygons whose corners are at `z` or farther.
pub(super) fn before(z: f32) -> f32 {
    z - z.abs() * DEPTH_ROUNDING
}

/// Whether a place `from` the begin of an edge `d` is beside it, and not beyond its ends by more than about `pad`: a
/// sharp corner that is widened on one or both sides would have a long spike otherwise.
pub(super) fn spans(d: Vec2, from: Vec2, pad: f32) -> bool {
    // Two sides, each widened by `pad`, meet 1.41 of it from a right angle.
    let (along, length) = (from.dot(d), d.length());
    along >= -1.5 * pad * length && along <= (length + 1.5 * pad) * length
}
