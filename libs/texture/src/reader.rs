//! One thread's way into a cache.

use crate::file::TextureFile;
use crate::made::TileMaker;
use crate::sampler::{Held, Sampler};
use crate::shared::Shared;
use crate::statistics::add;
use crate::{TextureCache, TextureId};

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
    fn new(cache: &'a TextureCache, maker: Option<&'a dyn TileMaker>) -> Self {
        Self { cache, maker, held: Held::new(cache.shared()), lookups: 0, probes: 0 }
    }

    /// The cache it reads.
    pub fn cache(&self) -> &'a TextureCache {
        self.cache
    }

    /// The file to look up a point in.
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
    /// For many lookups from one thread.
    pub fn reader(&self) -> TextureReader<'_> {
        TextureReader::new(self, None)
    }

    /// The same; tiles of maps without a file come from `maker`. To other readers there is nothing in such maps.
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
