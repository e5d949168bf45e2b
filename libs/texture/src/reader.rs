//! One thread's way into a cache.

use crate::file::{TextureFile, TileMaker};
use crate::sampler::{Held, Sampler};
use crate::shared::Shared;
use crate::statistics::add;
use crate::{EnvLookup, Lookup, Lookup3d, ShadowLookup, TextureCache, TextureId};
use crate::{environment, plain, shadow, slices};

/// Looks up one point after another and keeps the few tiles it used last: threads that ask for many points do not
/// meet in the cache for each. Made by [`TextureCache::reader`]; answers are those of the cache. What it looked up
/// enters the statistics when it is dropped.
pub struct TextureReader<'a> {
    cache: &'a TextureCache,
    maker: Option<&'a dyn TileMaker>,
    held: Held,
    lookups: u64,
    pub(crate) probes: u64,
}

impl std::fmt::Debug for TextureReader<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "TextureReader({} lookups)", self.lookups)
    }
}

impl<'a> TextureReader<'a> {
    pub(crate) fn new(cache: &'a TextureCache, maker: Option<&'a dyn TileMaker>) -> Self {
        Self { cache, maker, held: Held::new(cache.shared()), lookups: 0, probes: 0 }
    }

    /// The cache it reads.
    pub fn cache(&self) -> &'a TextureCache {
        self.cache
    }

    /// See [`TextureCache::texture`].
    pub fn texture(&mut self, id: TextureId, lookup: &Lookup, out: &mut [f32]) {
        self.lookups += 1;
        plain::texture(self, self.cache.file(id), lookup, out);
    }

    /// See [`TextureCache::texture3d`].
    pub fn texture3d(&mut self, id: TextureId, lookup: &Lookup3d, out: &mut [f32]) {
        self.lookups += 1;
        slices::texture3d(self, self.cache.file(id), lookup, out);
    }

    /// See [`TextureCache::environment`].
    pub fn environment(&mut self, id: TextureId, lookup: &EnvLookup, out: &mut [f32]) {
        self.lookups += 1;
        environment::environment(self, self.cache.file(id), lookup, out);
    }

    /// See [`TextureCache::shadow`].
    pub fn shadow(&mut self, id: TextureId, lookup: &ShadowLookup) -> f32 {
        self.lookups += 1;
        shadow::shadow(self, self.cache.file(id), lookup)
    }

    pub(crate) fn shared(&self) -> &'a Shared {
        self.cache.shared()
    }

    /// Reads texels of channels `first .. first + channels`, at most four, all of them in the file.
    pub(crate) fn sampler<'s>(
        &'s mut self,
        file: &'s TextureFile,
        first: usize,
        channels: usize,
    ) -> Sampler<'s> {
        Sampler::new((self.cache.shared(), self.maker), &mut self.held, file, first, channels)
    }
}

impl Drop for TextureReader<'_> {
    fn drop(&mut self) {
        let counters = &self.shared().counters;
        add(&counters.lookups, self.lookups);
        add(&counters.probes, self.probes);
        add(&counters.tile_requests, self.held.requests);
    }
}
