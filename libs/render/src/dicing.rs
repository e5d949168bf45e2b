//! From surfaces to grids: how finely, where to split, and the grid itself.
//!
//! Everything here is a function of the primitive and the (first) camera only; crops, buckets and other
//! primitives never change where a surface is split or how it is diced.

mod grid;
mod lift;
mod motion;
mod rate;

pub(crate) use grid::{GridView, Viewpoint, make_grid};
pub(crate) use lift::SmoothFace;
pub(crate) use motion::{
    Placement, Viewer, key_at, largest_coordinates, pixels_at, points_at, precise_point, shows,
};
pub(crate) use rate::{DiceSettings, Measure, Plan, Rates, SceneDicing};

use granita_geom::{Dice, Piece, Surface, Trimming};
use granita_scene::{AttributeSet, attr};

/// A piece that is small enough, and the grid it is to be diced into.
pub(crate) struct Leaf {
    /// The surface.
    pub(crate) piece: Piece,
    /// The lattice.
    pub(crate) rates: Box<Rates>,
}

impl Rates {
    /// Dices a piece at these rates; points and curves turn towards `viewer`.
    pub(crate) fn dice(&self, piece: &dyn Surface, viewer: &Viewer) -> Dice {
        let mut dice = piece.dice_between(self.nu, self.nv, &self.sides);
        if dice.facing.is_some() {
            dice.turn(&|key, p| viewer.view(key, p));
        }
        dice
    }
}

/// Splits a piece until each part dices into a grid within the limits, for ray tracing: nothing is culled, and what is
/// not in view is diced by its distance from the camera. Parts go to `out` in the order of the surface.
pub(crate) fn tessellate(
    piece: &dyn Surface,
    placement: &Placement,
    measure: &Measure<'_>,
    settings: &DiceSettings,
    out: &mut dyn FnMut(&dyn Surface, &Rates),
) {
    let mut stack: Vec<(Piece, u32)> = Vec::new();
    let mut plan = |piece: &dyn Surface, depth: u32, stack: &mut Vec<(Piece, u32)>| {
        match measure.plan(piece, placement, settings, depth) {
            Plan::Dice(rates) => out(piece, &rates),
            Plan::Split(direction, settled) => {
                // The first half comes out first.
                let parts = piece.split_settled(direction, settled);
                stack.extend(parts.into_iter().rev().map(|p| (p, depth + 1)));
            }
        }
    };
    plan(piece, 0, &mut stack);
    while let Some((piece, depth)) = stack.pop() {
        plan(&*piece, depth, &mut stack);
    }
}

/// The trim curves of an object with its and the scene's attributes (reference 4.3.4, 4.4.8).
pub(crate) fn trimming<'a>(attributes: &'a AttributeSet, quality: f32) -> Option<Trimming<'a>> {
    let curvature_deg = attributes.get(attr::TRIMCURVE_CURVATURE);
    attributes.trim.as_deref().map(|desc| Trimming { desc, curvature_deg, quality })
}

#[cfg(test)]
mod tests;
