//! Linking: from modules and scene parameters to something that runs.

mod analyse;
mod given;
mod group;
mod optimize;
mod relink;
mod wires;

pub(crate) use analyse::usage_word;
pub(crate) use group::{At, Layer, ParamPlan, Place};
pub use group::{ConnectionSource, Group, LayerSource, LinkOptions};
pub(crate) use optimize::{blocks_mut, occurrences};
pub(crate) use wires::{Tap, Wire, element_of};
