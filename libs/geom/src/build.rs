//! From descriptions to pieces.

use crate::{GeomError, Piece};
use granita_base::{Params, Severity, ShapeDesc, TrimDesc};

/// The parameters of a primitive at one motion key.
#[derive(Clone, Copy, Debug)]
pub struct ShapeKey<'a> {
    /// Time of the key.
    pub time: f32,
    /// Control vertices and primitive variables, in object space.
    pub params: &'a Params,
}

/// Builds the pieces of a primitive.
///
/// `keys` are the motion keys, times increasing, all with the same parameters; other keys than the first give
/// positions (and curve widths) only. `trim` applies to patches. Mistakes that leave something to draw (an index out
/// of range, a primitive variable of a wrong size, `"vertex normal P"`) go to `report` as warnings.
///
/// Errors: [`GeomError`] when nothing can be drawn.
pub fn build(
    shape: &ShapeDesc,
    keys: &[ShapeKey<'_>],
    trim: Option<&TrimDesc>,
    report: &mut dyn FnMut(Severity, String),
) -> Result<Vec<Piece>, GeomError> {
    let _ = (shape, keys, trim);
    report(Severity::Warning, format!("{} is not supported yet", shape.call_name()));
    Ok(Vec::new())
}
