//! A primitive at one motion key.

use granita_base::Params;

/// The parameters of a primitive at one motion key.
#[derive(Clone, Copy, Debug)]
pub struct ShapeKey<'a> {
    /// Time of the key.
    pub time: f32,
    /// Control vertices and primitive variables, in object space.
    pub params: &'a Params,
}

/// Names that shape a primitive and are not handed to shaders.
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
