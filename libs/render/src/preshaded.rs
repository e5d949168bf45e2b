//! The parameters of preshaded grids that only the dump writes. They hold the data that the hider needs of a grid
//! besides its points and colours (reference 4.3.7).

use granita_base::Params;
use granita_dicing::Leaf;

/// The name of `"int grid:primitive"`. Grids of one primitive have the same number.
pub(crate) const PRIMITIVE: &str = "grid:primitive";
/// The name of `"float[4] grid:rim"`, the widths in raster pixels by which the sides at v = 0, u = 1, v = 1 and u = 0
/// are widened to close the hairline gap to their neighbours. The width is 0 for a side inside of a trimmed grid.
pub(crate) const RIM: &str = "grid:rim";

/// The largest number of points of a grid that is taken whole. Larger ones are split.
pub(crate) const MOST_POINTS: usize = 1 << 12;

/// The properties of a grid that the hider needs.
pub(crate) struct GridTraits {
    /// The primitive that it was part of.
    pub(crate) primitive: Option<u32>,
    /// The widening of its boundary edges in raster pixels.
    pub(crate) rim_px: Option<f32>,
    /// True for each side that is a boundary edge, in the order v = 0, u = 1, v = 1, u = 0.
    pub(crate) sides: [bool; 4],
}

impl GridTraits {
    /// The properties of a grid that is not preshaded. Its primitive and the width of its boundary edges follow the
    /// defaults.
    pub(crate) const NOTHING: Self = Self { primitive: None, rim_px: None, sides: [true; 4] };

    /// Returns the properties of a part of a curve. The curve ends at its two borders along v, so that no neighbour
    /// continues it there, however near another curve is.
    pub(crate) fn of_curve(leaf: &Leaf) -> Self {
        let [u0, u1, ..] = leaf.piece.domain();
        Self { sides: [true, u1 != 1.0, true, u0 != 0.0], ..Self::NOTHING }
    }

    /// Returns the properties of a part of a preshaded grid.
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
