//! The camera, and the dicing of surfaces at the rate that the camera needs.
//!
//! [`CameraView`] maps "common" space to camera space, the screen and the raster. A [`Placement`] maps a primitive to
//! "common" space. [`Measure`] computes the raster size of a piece at the shading rate, and returns [`Plan::Split`]
//! or [`Plan::Dice`] with [`Rates`]. [`make_grid`] turns the points of a diced piece into a grid for shaders.
//! [`tessellate`] does all of this for ray tracing, where nothing is culled.
//!
//! # Invariants
//!
//! All results are functions of the primitive and the (first) camera only. Crops, buckets and other primitives do not
//! change where a surface is split or how it is diced.

#![forbid(unsafe_code)]

pub mod camera;
pub mod finite;
mod grid;
mod lift;
mod motion;
mod rate;

pub use grid::{GridView, Viewpoint, make_grid};
pub use lift::SmoothFace;
pub use motion::{
    Placement, Viewer, key_at, largest_coordinates, pixels_at, points_at, precise_point, shows,
};
pub use rate::{DiceSettings, Measure, Plan, Rates, SceneDicing};

pub use camera::{CameraView, EyeProjection, Lens, PreviewLimits, Projection, ShadedFrom, Stereo};
pub use granita_image::PixelRect;

use granita_base::Vec3;
use granita_geom::{Dice, Piece, Surface, Trimming};
use granita_scene::{AttributeSet, attr};

/// A piece that is small enough to be diced, and the rates of its grid.
pub struct Leaf {
    /// The surface.
    pub piece: Piece,
    /// The rates of the grid.
    pub rates: Box<Rates>,
}

impl Rates {
    /// Dices a piece at these rates. Points and curves turn towards `viewer`.
    pub fn dice(&self, piece: &dyn Surface, viewer: &Viewer) -> Dice {
        piece.dice_towards(self.nu, self.nv, &self.sides, &|key, p| viewer.view(key, p))
    }
}

/// Splits a piece until each part dices into a grid within the limits, for ray tracing. Nothing is culled, and pieces
/// outside of the view are diced by their distance from the camera. The parts are passed to `out` in the order of the
/// surface.
pub fn tessellate(
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
                // The first half must be popped first.
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

/// Returns the length of the longest of the three transformed unit axes.
pub fn longest_axis(vector: impl Fn(Vec3) -> Vec3) -> f32 {
    [Vec3::X, Vec3::Y, Vec3::Z].into_iter().map(|v| vector(v).length()).fold(0.0, f32::max)
}

/// Returns the trim curves of an object, with its own and the scene's attributes (reference 4.3.4, 4.4.8).
pub fn trimming<'a>(attributes: &'a AttributeSet, quality: f32) -> Option<Trimming<'a>> {
    let curvature_deg = attributes.get(attr::TRIMCURVE_CURVATURE);
    attributes.trim.as_deref().map(|desc| Trimming { desc, curvature_deg, quality })
}

#[cfg(test)]
mod tests;
