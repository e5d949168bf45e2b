//! Preshaded grids, which an earlier frame dumped or another program made, and which a frame takes unchanged
//! (reference 4.3.7).
//!
//! A linear `Patch` with a colour "C" at every vertex, under the surface shader "nullsurface" alone and without a
//! displacement, is such a grid. Its vertices are the points of the grid, and no shader runs.

use crate::object::LinkedShaders;
use granita_base::{CurveBasis, Interp, ShapeDesc};
use granita_scene::Primitive;
use std::sync::Arc;

/// The surface shader that marks preshaded grids.
const SURFACE: &str = "nullsurface";

/// Returns the number of points along u and v of a primitive that is a grid with its own colours, whatever its
/// shaders are.
pub fn lattice(primitive: &Primitive) -> Option<[usize; 2]> {
    let ShapeDesc::Patch { u: CurveBasis::Linear, v: CurveBasis::Linear, nu, nv } = primitive.shape else {
        return None;
    };
    let color = primitive.keys.first()?.params.get("C")?;
    (color.ty.interp == Interp::Vertex && color.ty.width() == 3).then_some([nu, nv])
}

/// True when these shaders request that grids are taken unchanged.
pub(crate) fn is_requested_by(surface: &LinkedShaders, displacement: Option<&Arc<LinkedShaders>>) -> bool {
    displacement.is_none() && matches!(&surface.names[..], [name] if &**name == SURFACE)
}
