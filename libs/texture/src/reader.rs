//! The access of one thread to a cache.

use crate::file::TextureFile;
use crate::made::TileMaker;
use crate::sampler::{Held, Sampler};
use crate::shared::Shared;
use crate::statistics::add;
use crate::{TextureCache, TextureId};

/// Looks up points and keeps the few tiles that it used last, so that threads with many lookups do not access the
/// shared cache for each. [`TextureCache::reader`] makes it. Results are those of the cache. Its counts are added
/// to the statistics when it is dropped.
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
    fn new(cache: &'a TextureCache, maker: Option<&'a dyn TileMaker>) -> Self {
        Self { cache, maker, held: Held::new(cache.shared()), lookups: 0, probes: 0 }
    }

    /// Returns the cache that it reads.
    pub fn cache(&self) -> &'a TextureCache {
        self.cache
    }

    /// Returns the file for the lookup of a point.
    pub(crate) fn look_up(&mut self, id: TextureId) -> &'a TextureFile {
        self.lookups += 1;
        self.cache.file(id)
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

impl TextureCache {
    /// Returns a reader for many lookups from one thread.
    pub fn reader(&self) -> TextureReader<'_> {
        TextureReader::new(self, None)
    }

    /// Returns a reader whose tiles of maps without a file come from `maker`. For other readers such maps are
    /// empty.
    pub fn reader_with<'a>(&'a self, maker: &'a dyn TileMaker) -> TextureReader<'a> {
        TextureReader::new(self, Some(maker))
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
