//! The bounds and the behaviour of a cache.

use granita_base::Vec3;

/// The bounds and the behaviour of a [`TextureCache`](crate::TextureCache).
#[derive(Clone, Debug, PartialEq)]
pub struct CacheOptions {
    /// The largest number of bytes of tiles held at once (attribute "limits:texturememory" times 1024).
    pub memory_bytes: u64,
    /// The largest number of files open at once, at least 1 (attribute "limits:texturefiles").
    pub max_files: usize,
    /// True when files without tiles or MIP levels are accepted, with levels made in memory (attribute
    /// "texture:automipmap").
    pub automipmap: bool,
    /// Replaces every texture (attribute "texture:substtexture").
    pub substitute_texture: Option<String>,
    /// Replaces every environment map (attribute "texture:substenv").
    pub substitute_environment: Option<String>,
    /// The origin of "common" space in world space. The matrices of files are in world space. Lookups and results are
    /// in "common" space.
    pub common_origin: Vec3,
}

impl Default for CacheOptions {
    /// Returns the defaults of the attributes: 20 MB, 1000 files, automipmap, no substitutes.
    fn default() -> Self {
        Self {
            memory_bytes: 20480 * 1024,
            max_files: 1000,
            automipmap: true,
            substitute_texture: None,
            substitute_environment: None,
            common_origin: Vec3::ZERO,
        }
    }
}
