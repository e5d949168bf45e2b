//! The tile cache. It is sharded and bounded in memory, and each tile is read once for any number of threads.

use crate::statistics::{Counters, add as count};
use crate::tiles::Tile;
use granita_base::{Lru, hash};
use parking_lot::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

/// Identifies a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct TileKey {
    pub(crate) file: u32,
    pub(crate) level: u32,
    pub(crate) tx: u32,
    pub(crate) ty: u32,
}

impl TileKey {
    fn hash(self) -> u32 {
        hash::words(&[self.file, self.level, self.tx, self.ty])
    }
}

/// The memory of the bound that a tile uses until it is dropped.
#[derive(Debug)]
struct Room {
    bytes: u64,
    now: Arc<AtomicU64>,
}

impl Drop for Room {
    fn drop(&mut self) {
        self.now.fetch_sub(self.bytes, Ordering::Relaxed);
    }
}

/// A tile that is available, or being read by one thread while others wait.
#[derive(Debug, Default)]
pub(crate) struct Cell {
    tile: OnceLock<Tile>,
    /// Its share of the bound; `None` outside of the cache.
    _room: Option<Room>,
}

impl Cell {
    /// Returns a cell with a tile outside of the cache.
    pub(crate) fn of(tile: Tile) -> Self {
        Self { tile: OnceLock::from(tile), _room: None }
    }

    /// Returns the tile, which must be available.
    #[inline]
    pub(crate) fn tile(&self) -> &Tile {
        self.tile.get().expect("invariant: cells are handed out with their tile")
    }
}

/// A part of the tiles, with a lock of its own.
type Shard = Lru<TileKey, Arc<Cell>>;

/// Removes the tile that was requested longest ago, among those that no thread holds.
fn evict(shard: &mut Shard) -> Option<(TileKey, Arc<Cell>)> {
    shard.evict(|_, cell| Arc::strong_count(cell) == 1)
}

/// The number of shards of each [`Origin`].
const SHARDS: usize = 32;

/// The source of a tile. Tiles of files are dropped first, because it takes a thousand times as long to make one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Origin {
    /// It is read from a file.
    File,
    /// It is made on demand.
    Made,
}

/// The tiles of all textures.
pub(crate) struct TileCache {
    /// The shards of tiles of files, and then those of made tiles.
    shards: [Mutex<Shard>; 2 * SHARDS],
    max_bytes: u64,
    /// The bytes of made tiles that tiles of files do not displace. The rest of the bound is large enough that files
    /// are not read again for each lookup.
    kept_bytes: u64,
    /// The bytes of all existing tiles, including those that only a thread holds.
    now: Arc<AtomicU64>,
}

impl std::fmt::Debug for TileCache {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "TileCache({} bytes)", self.max_bytes)
    }
}

impl TileCache {
    pub(crate) fn new(max_bytes: u64) -> Self {
        Self {
            shards: std::array::from_fn(|_| Mutex::default()),
            max_bytes,
            kept_bytes: max_bytes / 8 * 7,
            now: Arc::default(),
        }
    }

    /// Returns the bound in bytes.
    pub(crate) fn max_bytes(&self) -> u64 {
        self.max_bytes
    }

    /// Returns the tile, which `read` reads or makes when it is not cached. `bytes` is its size. When there is no
    /// memory left, even without the tiles that no thread holds and that may be dropped, it is read for this caller
    /// alone.
    pub(crate) fn get(
        &self,
        key: TileKey,
        (origin, bytes): (Origin, u64),
        counters: &Counters,
        read: impl FnOnce() -> Tile,
    ) -> Arc<Cell> {
        let read = || {
            let tile = read();
            count(&counters.tiles_read, 1);
            count(&counters.tile_bytes, tile.bytes());
            tile
        };
        let own = key.hash() as usize % SHARDS;
        let home = if origin == Origin::Made { own + SHARDS } else { own };
        let found = self.shards[home].lock().get(&key).cloned();
        let cell = match found {
            Some(cell) => cell,
            None => {
                let Some(room) = self.make_room(home, bytes, counters) else {
                    return self.keep_small((home, key), bytes, counters, read());
                };
                let mut shard = self.shards[home].lock();
                // Another thread may have inserted it meanwhile.
                shard.get(&key).cloned().unwrap_or_else(|| {
                    let cell = Arc::new(Cell { tile: OnceLock::new(), _room: Some(room) });
                    shard.insert(key, cell.clone(), bytes);
                    cell
                })
            }
        };
        cell.tile.get_or_init(read);
        cell
    }

    /// Returns a tile that was read for one caller. It is kept when it takes less than the `bytes` that did not fit. It
    /// then holds black texels in place of a large tile, which every lookup would otherwise try to read again.
    fn keep_small(
        &self,
        (home, key): (usize, TileKey),
        bytes: u64,
        counters: &Counters,
        tile: Tile,
    ) -> Arc<Cell> {
        let room = (tile.bytes() < bytes).then(|| self.make_room(home, tile.bytes(), counters)).flatten();
        let Some(room) = room else { return Arc::new(Cell::of(tile)) };
        let mut shard = self.shards[home].lock();
        shard.get(&key).cloned().unwrap_or_else(|| {
            let weight = tile.bytes();
            let cell = Arc::new(Cell { tile: OnceLock::from(tile), _room: Some(room) });
            shard.insert(key, cell.clone(), weight);
            cell
        })
    }

    /// Drops the tiles of a file.
    pub(crate) fn forget(&mut self, file: u32) {
        for shard in &mut self.shards {
            shard.get_mut().retain(|key, _| key.file != file);
        }
    }

    /// Drops tiles until `bytes` more fit, tiles of files before made ones, and of the tile's own shard `home` before
    /// others; `None` when they do not fit.
    fn make_room(&self, home: usize, bytes: u64, counters: &Counters) -> Option<Room> {
        let own = home % SHARDS;
        let mut empty = 0;
        loop {
            let fits = |now: u64| now.checked_add(bytes).filter(|&sum| sum <= self.max_bytes);
            if let Ok(before) = self.now.fetch_update(Ordering::Relaxed, Ordering::Relaxed, fits) {
                counters.peak_bytes.fetch_max(before + bytes, Ordering::Relaxed);
                return Some(Room { bytes, now: self.now.clone() });
            }
            let of_made = empty >= SHARDS;
            let is_over =
                || empty == 2 * SHARDS || of_made && home < SHARDS && self.made_bytes() <= self.kept_bytes;
            if bytes > self.max_bytes || is_over() {
                return None;
            }
            let shard = (own + empty) % SHARDS + if of_made { SHARDS } else { 0 };
            let gone = evict(&mut self.shards[shard].lock());
            empty += usize::from(gone.is_none());
        }
    }

    /// Returns the bytes of the made tiles.
    fn made_bytes(&self) -> u64 {
        self.shards[SHARDS..].iter().map(|shard| shard.lock().weight()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tiles::Layout;
    use granita_image::{PixelType, Pixels};

    fn tile(value: f32) -> Tile {
        Tile::new(Pixels::Float(vec![value; 4]), 2, 1, Layout::Planes)
    }

    fn key(i: u32) -> TileKey {
        TileKey { file: 0, level: 0, tx: i, ty: 0 }
    }

    #[test]
    fn the_tile_cache_stays_within_its_limit() {
        let (cache, counters) = (TileCache::new(16 * 10), Counters::default());
        for round in 0..3 {
            for i in 0..100 {
                let t = cache.get(key(i), (Origin::File, 16), &counters, || tile(i as f32));
                assert_eq!(t.tile().texel(1, 1, 0, 1)[0], i as f32, "round {round}");
                assert!(counters.read().peak_bytes <= 160);
            }
        }
        let before = counters.read().tiles_read;
        for _ in 0..10 {
            cache.get(key(99), (Origin::File, 16), &counters, || tile(99.0));
        }
        assert_eq!(counters.read().tiles_read, before, "the last tile is still there");
    }

    /// Made tiles stay while files are read, up to their part of the bound. Both are used in turns.
    #[test]
    fn made_tiles_outlive_those_of_files() {
        let (cache, counters) = (TileCache::new(16 * 16), Counters::default());
        let mut made = 0;
        for round in 0..5 {
            for i in 0..14 {
                let t = cache.get(key(1000 + i), (Origin::Made, 16), &counters, || {
                    made += 1;
                    tile(i as f32)
                });
                assert_eq!(t.tile().texel(0, 0, 0, 1)[0], i as f32, "round {round}");
                for file in 0..20 {
                    let t = cache.get(key(file), (Origin::File, 16), &counters, || tile(0.5));
                    assert_eq!(t.tile().texel(0, 0, 0, 1)[0], 0.5);
                }
            }
        }
        assert_eq!(made, 14, "each was made once");
        // More of them displace each other, and leave room for files.
        (0..100).for_each(|i| drop(cache.get(key(2000 + i), (Origin::Made, 16), &counters, || tile(1.0))));
        let before = counters.read().tiles_read;
        cache.get(key(7), (Origin::File, 16), &counters, || tile(0.5));
        cache.get(key(7), (Origin::File, 16), &counters, || tile(0.5));
        assert_eq!(counters.read().tiles_read, before + 1);
        assert!(counters.read().peak_bytes <= 16 * 16);
    }

    #[test]
    fn a_tile_larger_than_the_cache_is_read_every_time() {
        let (cache, counters) = (TileCache::new(15), Counters::default());
        for n in 1..4 {
            cache.get(key(0), (Origin::File, 16), &counters, || tile(0.0));
            assert_eq!(counters.read().tiles_read, n);
        }
        assert_eq!(counters.read().peak_bytes, 0);
    }

    #[test]
    fn a_black_tile_takes_little_memory() {
        let side = 65_535;
        let black = || Tile::black(PixelType::U16, side, 4);
        assert_eq!(black().bytes(), 2 * side as u64);
        assert_eq!(black().texel(side - 1, side - 1, 0, 4), [0.0; 4]);
        assert_eq!(black().with_texel(side - 1, side - 1, <[f32]>::to_vec), [0.0; 4]);
        let (cache, counters) = (TileCache::new(1 << 20), Counters::default());
        let promised = (side * side * 8) as u64;
        for _ in 0..3 {
            cache.get(key(0), (Origin::File, promised), &counters, black);
        }
        let done = counters.read();
        assert_eq!((done.tiles_read, done.peak_bytes), (1, 2 * side as u64));
    }

    #[test]
    fn a_tile_is_read_once_for_many_threads() {
        let (cache, counters) = (TileCache::new(1 << 20), Counters::default());
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| {
                    for i in 0..50 {
                        assert_eq!(
                            cache.get(key(i), (Origin::File, 16), &counters, || tile(1.0)).tile().bytes(),
                            16
                        );
                    }
                });
            }
        });
        assert_eq!(counters.read().tiles_read, 50);
    }
}
