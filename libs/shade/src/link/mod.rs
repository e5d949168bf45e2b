//! Linking: from modules and scene parameters to something that runs.

mod analyse;
mod given;
mod group;
mod layer;
mod optimize;
mod relink;
mod source;
mod wires;

pub(crate) use analyse::usage_word;
pub(crate) use given::same_type;
pub use group::Group;
pub(crate) use layer::{Layer, ParamPlan};
pub(crate) use optimize::{blocks_mut, occurrences};
pub use source::{ConnectionSource, LayerSource, LinkOptions};
pub(crate) use wires::{Tap, Wire, element_of};
