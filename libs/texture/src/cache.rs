//! The texture cache: names to files, files to tiles, tiles to answers.

use crate::file::{MadeShadow, TextureFile, TileMaker};
use crate::shared::Shared;
use crate::{CacheStatistics, EnvLookup, Lookup, Lookup3d, ShadowLookup, TextureKind, TextureReader};
use granita_base::{BaseType, Param, ParamData, ParamType, Reporter, SearchPath, Transform, Vec3};
use granita_image::FormatRegistry;

/// Bounds and behaviour of a [`TextureCache`].
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

/// What a texture is asked for; decides about substitutes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Use {
    /// `texture ()`.
    Texture,
    /// `environment ()`.
    Environment,
    /// `shadow ()`.
    Shadow,
}

/// A texture file of one [`TextureCache`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TextureId(pub(crate) u32);

/// Texture files, opened when first named, of which tiles are read when first looked at.
///
/// Any number of threads look up at once. Answers do not depend on the memory bound, the file bound, the
/// order of lookups or the number of threads.
#[derive(Debug)]
pub struct TextureCache {
    shared: Shared,
}

impl TextureCache {
    /// An empty cache that looks for files along `search` and opens them with `registry`.
    pub fn new(
        registry: FormatRegistry,
        search: SearchPath,
        options: CacheOptions,
        reporter: Reporter,
    ) -> Self {
        Self { shared: Shared::new(registry, search, options, reporter) }
    }

    /// The texture of this name, without regard to substitutes: [`TextureCache::find_for`] a
    /// [`Use::Shadow`].
    pub fn find(&self, name: &str) -> Option<TextureId> {
        self.find_for(name, Use::Shadow)
    }

    /// The texture of this name, or the substitute for this use. `None`, after one error, when there is
    /// no such file or it cannot be used; a shader then gets `fill` in all channels and alpha 0 of a
    /// texture or environment, and no shadow.
    pub fn find_for(&self, name: &str, usage: Use) -> Option<TextureId> {
        let options = &self.shared.options;
        let substitute = match usage {
            Use::Texture => options.substitute_texture.as_deref(),
            Use::Environment => options.substitute_environment.as_deref(),
            Use::Shadow => None,
        };
        self.shared.find(substitute.filter(|s| !s.is_empty()).unwrap_or(name)).map(TextureId)
    }

    /// A depth map under a name that is no file: its tiles are made by the [`TileMaker`](crate::TileMaker) of the reader
    /// that looks at them, and held and dropped as those of files are. `None` when the name is taken.
    pub fn declare(&self, name: &str, map: &MadeShadow) -> Option<TextureId> {
        self.shared.declare(name, map).map(TextureId)
    }

    /// The kind of a texture.
    ///
    /// # Panics
    /// As every function here that takes an id: when the id is of another cache.
    pub fn kind(&self, id: TextureId) -> TextureKind {
        self.file(id).kind
    }

    /// For many lookups from one thread.
    pub fn reader(&self) -> TextureReader<'_> {
        TextureReader::new(self, None)
    }

    /// The same; tiles of maps without a file come from `maker`. To other readers there is nothing in such maps.
    pub fn reader_with<'a>(&'a self, maker: &'a dyn TileMaker) -> TextureReader<'a> {
        TextureReader::new(self, Some(maker))
    }

    /// Filtered value of a texture: channels `first_channel` and following into `out`, of which the last
    /// is the one that shaders call alpha. Channels that the file lacks become `fill`; at coordinates that
    /// are not finite the others become 0.
    pub fn texture(&self, id: TextureId, lookup: &Lookup, out: &mut [f32]) {
        self.reader().texture(id, lookup, out);
    }

    /// Filtered value of a picture that has depth: the images of the file are its slices, from front to back. Channels as of
    /// [`TextureCache::texture`]; files whose images do not fit together give `fill` and alpha 0, after one warning.
    pub fn texture3d(&self, id: TextureId, lookup: &Lookup3d, out: &mut [f32]) {
        self.reader().texture3d(id, lookup, out);
    }

    /// Filtered value of an environment map, as [`TextureCache::texture`]. Any map that is not a cube-face
    /// environment is taken for a latitude-longitude map. A direction of no length, or that is not finite,
    /// gives 0.
    pub fn environment(&self, id: TextureId, lookup: &EnvLookup, out: &mut [f32]) {
        self.reader().environment(id, lookup, out);
    }

    /// How much of a point is in shadow, 0 (none) to 1 (all). Points behind the light, outside the map or
    /// not finite are not in shadow.
    pub fn shadow(&self, id: TextureId, lookup: &ShadowLookup) -> f32 {
        self.reader().shadow(id, lookup)
    }

    /// Data about a texture file (reference table 5.5): "resolution", "type", "textureformat", "channels",
    /// "viewingmatrix", "projectionmatrix". `None` when there is no such file (after one warning: it may be the question) or
    /// datum.
    pub fn info(&self, name: &str, what: &str) -> Option<Param> {
        let file = self.file(self.shared.find_to_ask(name).map(TextureId)?);
        let matrix = |m: &Option<Transform>| m.map(|m| ParamData::from(&m.to_rows()[..]));
        let (ty, data) = match what {
            "resolution" => {
                let level = &file.levels[0];
                let size = [level.width as f32, level.height as f32];
                (ParamType::array(BaseType::Float, 2), ParamData::from(&size[..]))
            }
            "type" => (ParamType::of(BaseType::String), file.told_kind().type_word().into()),
            "textureformat" => (ParamType::of(BaseType::String), file.told_kind().word().into()),
            "channels" => (ParamType::of(BaseType::Float), (file.channels as f32).into()),
            "viewingmatrix" => (ParamType::of(BaseType::Matrix), matrix(&file.world_to_camera)?),
            "projectionmatrix" => (ParamType::of(BaseType::Matrix), matrix(&file.world_to_screen)?),
            _ => return None,
        };
        Some(Param { name: what.into(), ty, data })
    }

    /// What was done so far.
    pub fn statistics(&self) -> CacheStatistics {
        self.shared.counters.read()
    }

    pub(crate) fn shared(&self) -> &Shared {
        &self.shared
    }

    pub(crate) fn file(&self, id: TextureId) -> &TextureFile {
        self.shared.files.get(id.0).expect("invariant: an id is made by this cache and never removed")
    }
}
