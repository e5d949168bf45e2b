//! Links modules and scene parameters to groups that can run.

mod analyse;
mod calls;
mod connections;
mod given;
mod group;
mod layer;
mod linking;
mod optimize;
mod parts;
mod relink;
mod source;

pub(crate) use analyse::usage_word;
pub(crate) use connections::{Connection, Endpoint, element_of};
pub(crate) use given::same_type;
pub use group::Group;
pub(crate) use layer::{Code, Layer, ParamPlan};
pub(crate) use optimize::{blocks_mut, occurrences};
pub(crate) use parts::{Part, Parts};
pub use source::{ConnectionSource, LayerSource, LinkOptions};
