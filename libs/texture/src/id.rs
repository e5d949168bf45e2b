//! Textures by number.

/// A texture file of one [`TextureCache`](crate::TextureCache).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TextureId(pub(crate) u32);
