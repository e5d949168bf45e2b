//! The statistics of the cache.

use std::sync::atomic::{AtomicU64, Ordering};

/// The counts since the cache was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CacheStatistics {
    /// The number of lookups of all kinds.
    pub lookups: u64,
    /// The number of filter probes, each of which reads up to eight texels.
    pub probes: u64,
    /// The number of times a thread requested a tile that it did not hold.
    pub tile_requests: u64,
    /// The number of times a tile had to be read or made.
    pub tiles_read: u64,
    /// The uncompressed bytes of these tiles.
    pub tile_bytes: u64,
    /// The largest number of bytes of tiles held at once.
    pub peak_bytes: u64,
    /// The number of texture files in use.
    pub files: u64,
    /// The number of times a file was opened, including reopening.
    pub files_opened: u64,
    /// The largest number of files open at once.
    pub peak_files_open: u64,
    /// The number of files for which MIP levels or tiles were made in memory.
    pub automipmaps: u64,
    /// The bytes of these levels and tiles, which do not count for the memory bound.
    pub automipmap_bytes: u64,
    /// The number of names that could not be used.
    pub missing: u64,
}

/// The counters behind [`CacheStatistics`].
#[derive(Debug, Default)]
pub(crate) struct Counters {
    pub(crate) lookups: AtomicU64,
    pub(crate) probes: AtomicU64,
    pub(crate) tile_requests: AtomicU64,
    pub(crate) tiles_read: AtomicU64,
    pub(crate) tile_bytes: AtomicU64,
    pub(crate) peak_bytes: AtomicU64,
    pub(crate) files: AtomicU64,
    pub(crate) files_opened: AtomicU64,
    pub(crate) peak_files_open: AtomicU64,
    pub(crate) automipmaps: AtomicU64,
    pub(crate) automipmap_bytes: AtomicU64,
    pub(crate) missing: AtomicU64,
}

/// Adds to a counter.
pub(crate) fn add(counter: &AtomicU64, n: u64) -> u64 {
    counter.fetch_add(n, Ordering::Relaxed) + n
}

impl Counters {
    pub(crate) fn read(&self) -> CacheStatistics {
        let get = |c: &AtomicU64| c.load(Ordering::Relaxed);
        CacheStatistics {
            lookups: get(&self.lookups),
            probes: get(&self.probes),
            tile_requests: get(&self.tile_requests),
            tiles_read: get(&self.tiles_read),
            tile_bytes: get(&self.tile_bytes),
            peak_bytes: get(&self.peak_bytes),
            files: get(&self.files),
            files_opened: get(&self.files_opened),
            peak_files_open: get(&self.peak_files_open),
            automipmaps: get(&self.automipmaps),
            automipmap_bytes: get(&self.automipmap_bytes),
            missing: get(&self.missing),
        }
    }
}
