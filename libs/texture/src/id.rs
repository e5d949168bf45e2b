//! Identifiers of textures.

use std::sync::Arc;

/// The texture that a cache found by a name, to be kept with the name. Another cache rejects it.
#[derive(Clone, Debug)]
pub struct TextureHandle {
    pub(crate) id: TextureId,
    /// The cache.
    pub(crate) of: Arc<()>,
}

/// A texture file of one [`TextureCache`](crate::TextureCache).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TextureId(pub(crate) u32);
