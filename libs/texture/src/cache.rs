//! The texture cache, which finds files by name, reads tiles and answers lookups.

use crate::file::TextureFile;
use crate::made::MadeShadow;
use crate::shared::Shared;
use crate::{
    CacheOptions, CacheStatistics, EnvLookup, Lookup, Lookup3d, ShadowLookup, TextureHandle, TextureId,
    TextureKind,
};
use granita_base::{BaseType, Param, ParamData, ParamType, Reporter, SearchPath, Transform};
use granita_image::FormatRegistry;
use std::sync::Arc;

/// The function that looks up a texture. It selects the substitute.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Use {
    /// The function `texture ()`.
    Texture,
    /// The function `environment ()`.
    Environment,
    /// The function `shadow ()`.
    Shadow,
}

/// A cache of texture files. A file is opened when it is first named, and a tile is read when it is first used.
///
/// Any number of threads may look up at once. Results do not depend on the memory bound, the file bound, the order
/// of lookups or the number of threads.
#[derive(Debug)]
pub struct TextureCache {
    shared: Shared,
    /// Identifies the cache, also among caches with a short life.
    identity: Arc<()>,
}

impl TextureCache {
    /// Returns an empty cache that finds files along `search` and opens them with `registry`.
    pub fn new(
        registry: FormatRegistry,
        search: SearchPath,
        options: CacheOptions,
        reporter: Reporter,
    ) -> Self {
        Self { shared: Shared::new(registry, search, options, reporter), identity: Arc::default() }
    }

    /// Returns the texture of this name, without substitutes: [`TextureCache::find_for`] a [`Use::Shadow`].
    pub fn find(&self, name: &str) -> Option<TextureId> {
        self.find_for(name, Use::Shadow)
    }

    /// Returns the texture of this name, or the substitute for this use. Returns `None`, after one error, when the
    /// file does not exist or cannot be used. A shader then gets `fill` in all channels and alpha 0 of a texture or
    /// environment, and no shadow.
    pub fn find_for(&self, name: &str, usage: Use) -> Option<TextureId> {
        let options = &self.shared.options;
        let substitute = match usage {
            Use::Texture => options.substitute_texture.as_deref(),
            Use::Environment => options.substitute_environment.as_deref(),
            Use::Shadow => None,
        };
        self.shared.find(substitute.filter(|s| !s.is_empty()).unwrap_or(name)).map(TextureId)
    }

    /// Does the same as [`TextureCache::find_for`], but returns a handle. [`TextureCache::id_of`] converts it
    /// without the name.
    pub fn handle_for(&self, name: &str, usage: Use) -> Option<TextureHandle> {
        self.find_for(name, usage).map(|id| TextureHandle { id, of: self.identity.clone() })
    }

    /// Returns the texture of a handle; `None` when it is of another cache.
    pub fn id_of(&self, handle: &TextureHandle) -> Option<TextureId> {
        Arc::ptr_eq(&handle.of, &self.identity).then_some(handle.id)
    }

    /// Declares a depth map under a name without a file. The [`TileMaker`](crate::TileMaker) of the reader that
    /// looks it up makes its tiles, which are cached like those of files. Returns `None` when the name is taken.
    pub fn declare(&self, name: &str, map: &MadeShadow) -> Option<TextureId> {
        self.shared.declare(name, map).map(TextureId)
    }

    /// Returns the kind of a texture.
    ///
    /// # Panics
    /// Panics when the id is of another cache, as every function here that takes an id does.
    pub fn kind(&self, id: TextureId) -> TextureKind {
        self.file(id).kind
    }

    /// Looks up the filtered value of a texture: channels `first_channel` and following into `out`. The last one is the
    /// alpha of shaders. Channels that the file lacks become `fill`. At coordinates that are not finite the other
    /// channels become 0.
    pub fn texture(&self, id: TextureId, lookup: &Lookup, out: &mut [f32]) {
        self.reader().texture(id, lookup, out);
    }

    /// Looks up the filtered value of a volume texture. The images of the file are its slices, from front to back.
    /// Channels are as in [`TextureCache::texture`]. Files whose images do not have the same size give `fill` and
    /// alpha 0, after one warning.
    pub fn texture3d(&self, id: TextureId, lookup: &Lookup3d, out: &mut [f32]) {
        self.reader().texture3d(id, lookup, out);
    }

    /// Looks up the filtered value of an environment map, with channels as in [`TextureCache::texture`]. Any map
    /// that is not a cube-face environment counts as a latitude-longitude map. A direction of zero length, or that
    /// is not finite, gives 0.
    pub fn environment(&self, id: TextureId, lookup: &EnvLookup, out: &mut [f32]) {
        self.reader().environment(id, lookup, out);
    }

    /// Returns the shadowed share of a point, from 0 to 1. Points behind the light, outside the map or not finite
    /// are not in shadow.
    pub fn shadow(&self, id: TextureId, lookup: &ShadowLookup) -> f32 {
        self.reader().shadow(id, lookup)
    }

    /// Returns data about a texture file (reference table 5.5): "resolution", "type", "textureformat", "channels",
    /// "viewingmatrix", "projectionmatrix". Returns `None` when the file (after one warning, because a shader may
    /// test for it) or the datum does not exist.
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

    /// Returns the counts so far.
    pub fn statistics(&self) -> CacheStatistics {
        self.shared.counters.read()
    }

    pub(crate) fn shared(&self) -> &Shared {
        &self.shared
    }

    pub(crate) fn shared_mut(&mut self) -> &mut Shared {
        &mut self.shared
    }

    pub(crate) fn file(&self, id: TextureId) -> &TextureFile {
        self.shared.files.get(id.0).expect("invariant: an id is made by this cache and never removed")
    }
}
