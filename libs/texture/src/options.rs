//! Bounds and behaviour of a cache.

use granita_base::Vec3;

/// Bounds and behaviour of a [`TextureCache`](crate::TextureCache).
#[derive(Clone, Debug, PartialEq)]
pub struct CacheOptions {
    /// Most bytes of tiles held at once (attribute "limits:texturememory" times 1024).
    pub memory_bytes: u64,
    /// Most files open at once, at least 1 (attribute "limits:texturefiles").
    pub max_files: usize,
    /// Whether files without tiles or MIP levels are used, with levels made in memory
    /// (attribute "texture:automipmap").
    pub automipmap: bool,
    /// Used in the place of every texture (attribute "texture:substtexture").
    pub substitute_texture: Option<String>,
    /// Used in the place of every environment map (attribute "texture:substenv").
    pub substitute_environment: Option<String>,
    /// Where in the world "common" space begins. The matrices of files are of the world, lookups and answers in "common" space.
    pub common_origin: Vec3,
}

impl Default for CacheOptions {
    /// The defaults of the attributes: 20 MB, 1000 files, automipmap, no substitutes.
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
