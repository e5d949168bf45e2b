//! The parameters of a primitive at one motion key.

use granita_base::Params;

/// The parameters of a primitive at one motion key.
#[derive(Clone, Copy, Debug)]
pub struct ShapeKey<'a> {
    /// The time of the key.
    pub time: f32,
    /// The control vertices and primitive variables, in object space.
    pub params: &'a Params,
}

/// The names of parameters that define the shape of a primitive and are not passed to shaders.
pub(crate) const SPECIAL: [&str; 12] = [
    "P",
    "Pw",
    "border",
    "holes",
    "creaselengths",
    "creaseindices",
    "creasesharpnesses",
    "cornerindices",
    "cornersharpnesses",
    "__arguments",
    "__attributes",
    "__attributesindex",
];
