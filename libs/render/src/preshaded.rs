//! Grids that come shaded: what one frame dumped, or another program made, and a later frame takes as it is (reference
//! 4.3.7).
//!
//! A linear `Patch` with a colour "C" at every vertex, under the surface shader "nullsurface" alone and without a
//! displacement, is such a grid: its vertices are the points of the grid, and no shader runs. Parameters that
//! only the dump writes say what else the hider knew of the grid.

use crate::dicing::Leaf;
use crate::object::LinkedShaders;
use granita_base::{CurveBasis, Interp, Params, ShapeDesc};
use granita_scene::Primitive;
use std::sync::Arc;

/// The surface shader that asks for it.
const SURFACE: &str = "nullsurface";

/// `"int grid:primitive"`: grids of one primitive have the same number.
pub(crate) const PRIMITIVE: &str = "grid:primitive";
/// `"float[4] grid:rim"`: by how many pixels the sides at v = 0, u = 1, v = 1 and u = 0 are widened to close the
/// hairline between them and their neighbours; 0 for a side inside of a trimmed grid.
pub(crate) const RIM: &str = "grid:rim";

/// Most points of a grid that is taken whole; others are taken in parts.
pub(crate) const MOST_POINTS: usize = 1 << 12;

/// The points along u and v of a primitive that is a grid with colours of its own, whatever its shaders are.
pub(crate) fn lattice(primitive: &Primitive) -> Option<[usize; 2]> {
    let ShapeDesc::Patch { u: CurveBasis::Linear, v: CurveBasis::Linear, nu, nv } = primitive.shape else {
        return None;
    };
    let color = primitive.keys.first()?.params.get("C")?;
    (color.ty.interp == Interp::Vertex && color.ty.width() == 3).then_some([nu, nv])
}

/// Whether these shaders ask for grids to be taken as they are.
pub(crate) fn asked_by(surface: &LinkedShaders, displacement: Option<&Arc<LinkedShaders>>) -> bool {
    displacement.is_none() && matches!(&surface.names[..], [name] if &**name == SURFACE)
}

/// What the hider is to know of a grid.
pub(crate) struct GridTraits {
    /// The primitive that it was part of.
    pub(crate) primitive: Option<u32>,
    /// Widening of its rim in pixels.
    pub(crate) rim_px: Option<f32>,
    /// Which of its sides are rims: at v = 0, u = 1, v = 1 and u = 0.
    pub(crate) sides: [bool; 4],
}

impl GridTraits {
    /// Of a grid that does not come shaded: its primitive and the width of its rim are as everywhere.
    pub(crate) const NOTHING: Self = Self { primitive: None, rim_px: None, sides: [true; 4] };

    /// Of a part of a primitive.
    pub(crate) fn new(params: &Params, leaf: &Leaf) -> Self {
        let [u0, u1, v0, v1] = leaf.piece.domain();
        let outer = [v0 == 0.0, u1 == 1.0, v1 == 1.0, u0 == 0.0];
        let rim: Option<[f32; 4]> = params
            .floats(RIM)
            .and_then(|rim| rim.get(..4)?.try_into().ok())
            .filter(|rim: &[f32; 4]| rim.iter().all(|w| (0.0..=64.0).contains(w)));
        Self {
            primitive: params.int(PRIMITIVE).map(i32::cast_unsigned),
            rim_px: rim.map(|rim| rim.into_iter().fold(0.0, f32::max)),
            sides: std::array::from_fn(|k| outer[k] && rim.is_none_or(|rim| rim[k] > 0.0)),
        }
    }
}
