//! The tile cache: sharded, bounded in memory, each tile read once however many threads want it.

use crate::gaussian::{Sum, Weights};
use crate::statistics::{Counters, add as count};
use granita_base::hash;
use granita_image::Pixels;
use half::f16;
use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

/// Largest magnitude of a float texel: filtering can neither overflow nor meet infinity minus infinity.
const LARGEST: f32 = 1e30;

/// A block of texels in memory, in the type of the file.
#[derive(Debug)]
pub(crate) struct Tile {
    pixels: Pixels,
    /// Texels per row.
    width: usize,
    channels: usize,
}

impl Tile {
    /// Takes over a block of rows of `width` texels. Texels that are not numbers become 0, infinite
    /// ones finite.
    pub(crate) fn new(mut pixels: Pixels, width: usize, channels: usize) -> Self {
        match &mut pixels {
            Pixels::Float(v) => {
                for x in v {
                    *x = if x.is_nan() { 0.0 } else { x.clamp(-LARGEST, LARGEST) };
                }
            }
            Pixels::Half(v) => {
                for x in v.iter_mut().filter(|x| !x.is_finite()) {
                    *x = match (x.is_nan(), x.is_sign_negative()) {
                        (true, _) => f16::ZERO,
                        (false, false) => f16::MAX,
                        (false, true) => f16::MIN,
                    };
                }
            }
            Pixels::U8(_) | Pixels::U16(_) | Pixels::U32(_) => {}
        }
        Self { pixels, width, channels }
    }

    /// Channels `first .. first + n` (n at most 4, all of them in the file) of the texel at (x, y).
    #[inline]
    pub(crate) fn texel(&self, x: usize, y: usize, first: usize, n: usize) -> [f32; 4] {
        let at = (y * self.width + x) * self.channels + first;
        let mut out = [0.0; 4];
        match &self.pixels {
            Pixels::U8(v) => {
                for (o, v) in out[..n].iter_mut().zip(&v[at..at + n]) {
                    *o = f32::from(*v) * (1.0 / 255.0);
                }
            }
            Pixels::Half(v) => {
                for (o, v) in out[..n].iter_mut().zip(&v[at..at + n]) {
                    *o = v.to_f32();
                }
            }
            Pixels::Float(v) => out[..n].copy_from_slice(&v[at..at + n]),
            other => {
                for (i, o) in out[..n].iter_mut().enumerate() {
                    *o = other.get(at + i);
                }
            }
        }
        out
    }

    /// Adds `count` texels from (x, y) to the right to a sum that has begun: channels `first .. first + N`, as
    /// [`Tile::texel`] gives them.
    pub(crate) fn add_run<const N: usize>(
        &self,
        (x, y): (usize, usize),
        first: usize,
        count: usize,
        weights: &mut Weights,
        sum: &mut Sum,
    ) {
        let from = (y * self.width + x) * self.channels + first;
        // The last texel may end at its last channel asked for.
        let end = from + (count - 1) * self.channels + N;
        let step = self.channels;
        match &self.pixels {
            Pixels::U8(v) => {
                add::<u8, N>(&v[from..end], step, |v| f32::from(v) * (1.0 / 255.0), weights, sum)
            }
            Pixels::Half(v) => add::<f16, N>(&v[from..end], step, f16::to_f32, weights, sum),
            Pixels::Float(v) => add::<f32, N>(&v[from..end], step, |v| v, weights, sum),
            Pixels::U16(_) | Pixels::U32(_) => {
                for i in 0..count {
                    let value = self.texel(x + i, y, first, N);
                    sum.add(value, weights.next());
                }
            }
        }
    }

    /// Passes all channels of the texel at (x, y).
    pub(crate) fn with_texel<T>(&self, x: usize, y: usize, f: impl FnOnce(&[f32]) -> T) -> T {
        let at = (y * self.width + x) * self.channels;
        match &self.pixels {
            Pixels::Float(v) => f(&v[at..at + self.channels]),
            other => f(&(at..at + self.channels).map(|i| other.get(i)).collect::<Vec<f32>>()),
        }
    }

    /// Memory it takes.
    pub(crate) fn bytes(&self) -> u64 {
        (self.pixels.len() * self.pixels.pixel_type().bytes()) as u64
    }
}

/// See [`Tile::add_run`]; one texel every `step` values.
#[inline]
fn add<T: Copy, const N: usize>(
    values: &[T],
    step: usize,
    float: impl Fn(T) -> f32,
    weights: &mut Weights,
    sum: &mut Sum,
) {
    let base = sum.base;
    let (mut above, mut total) = (sum.above, sum.weight);
    for texel in values.chunks(step) {
        let weight = weights.next();
        total += weight;
        for c in 0..N {
            above[c] += weight * (float(texel[c]) - base[c]);
        }
    }
    (sum.above, sum.weight) = (above, total);
}

/// Which tile.
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

/// Mixes the four words of a key; enough for a map that is never iterated over.
#[derive(Default)]
struct KeyHasher(u64);

impl Hasher for KeyHasher {
    fn finish(&self) -> u64 {
        self.0
    }
    fn write(&mut self, bytes: &[u8]) {
        for b in bytes {
            self.write_u32(u32::from(*b));
        }
    }
    fn write_u32(&mut self, word: u32) {
        self.0 = (self.0 ^ u64::from(word)).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29);
    }
}

/// A tile that is there, or being read by one thread while others wait.
type Cell = Arc<OnceLock<Arc<Tile>>>;

struct Slot {
    key: TileKey,
    cell: Cell,
    bytes: u64,
    /// Asked for since the hand last passed.
    used: bool,
}

#[derive(Default)]
struct Shard {
    index: HashMap<TileKey, usize, BuildHasherDefault<KeyHasher>>,
    slots: Vec<Slot>,
    hand: usize,
}

impl Shard {
    fn find(&mut self, key: TileKey) -> Option<Cell> {
        let slot = &mut self.slots[*self.index.get(&key)?];
        slot.used = true;
        Some(slot.cell.clone())
    }

    fn insert(&mut self, key: TileKey, bytes: u64) -> Cell {
        let cell = Cell::default();
        self.index.insert(key, self.slots.len());
        self.slots.push(Slot { key, cell: cell.clone(), bytes, used: true });
        cell
    }

    /// Drops the next tile that was not asked for lately (the clock algorithm); its bytes.
    fn evict(&mut self) -> Option<u64> {
        loop {
            if self.slots.is_empty() {
                return None;
            }
            self.hand %= self.slots.len();
            let slot = &mut self.slots[self.hand];
            if std::mem::take(&mut slot.used) {
                self.hand += 1;
                continue;
            }
            let gone = self.slots.swap_remove(self.hand);
            self.index.remove(&gone.key);
            if let Some(moved) = self.slots.get(self.hand) {
                self.index.insert(moved.key, self.hand);
            }
            return Some(gone.bytes);
        }
    }
}

const SHARDS: usize = 32;

/// Tiles of all files.
pub(crate) struct TileCache {
    shards: [Mutex<Shard>; SHARDS],
    max_bytes: u64,
}

impl std::fmt::Debug for TileCache {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "TileCache({} bytes)", self.max_bytes)
    }
}

fn lock(shard: &Mutex<Shard>) -> MutexGuard<'_, Shard> {
    shard.lock().unwrap_or_else(PoisonError::into_inner)
}

impl TileCache {
    pub(crate) fn new(max_bytes: u64) -> Self {
        Self { shards: std::array::from_fn(|_| Mutex::default()), max_bytes }
    }

    /// The tile, read with `read` when it is not there; `bytes` is what it will take.
    ///
    /// The bound is on what the cache keeps: a thread may hold the few tiles of its lookup besides.
    pub(crate) fn get(
        &self,
        key: TileKey,
        bytes: u64,
        counters: &Counters,
        read: impl FnOnce() -> Tile,
    ) -> Arc<Tile> {
        count(&counters.tile_requests, 1);
        let read = || {
            let tile = read();
            count(&counters.tiles_read, 1);
            count(&counters.tile_bytes, tile.bytes());
            Arc::new(tile)
        };
        let home = key.hash() as usize % SHARDS;
        let found = lock(&self.shards[home]).find(key);
        if let Some(cell) = found {
            return cell.get_or_init(read).clone();
        }
        if !self.make_room(home, bytes, counters) {
            return read();
        }
        let cell = {
            let mut shard = lock(&self.shards[home]);
            match shard.find(key) {
                Some(cell) => cell,
                None => {
                    let now = count(&counters.bytes_now, bytes);
                    counters.peak_bytes.fetch_max(now, Ordering::Relaxed);
                    shard.insert(key, bytes)
                }
            }
        };
        cell.get_or_init(read).clone()
    }

    /// Drops tiles, of shard `home` first, until `bytes` more fit; false when they never will.
    fn make_room(&self, home: usize, bytes: u64, counters: &Counters) -> bool {
        if bytes > self.max_bytes {
            return false;
        }
        let mut empty = 0;
        while counters.bytes_now.load(Ordering::Relaxed) + bytes > self.max_bytes {
            let gone = lock(&self.shards[(home + empty) % SHARDS]).evict();
            match gone {
                Some(gone) => {
                    counters.bytes_now.fetch_sub(gone, Ordering::Relaxed);
                }
                None => empty += 1,
            }
            if empty == SHARDS {
                return false;
            }
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tile(value: f32) -> Tile {
        Tile::new(Pixels::Float(vec![value; 4]), 2, 1)
    }

    fn key(i: u32) -> TileKey {
        TileKey { file: 0, level: 0, tx: i, ty: 0 }
    }

    #[test]
    fn keeps_within_its_bound() {
        let (cache, counters) = (TileCache::new(16 * 10), Counters::default());
        for round in 0..3 {
            for i in 0..100 {
                let t = cache.get(key(i), 16, &counters, || tile(i as f32));
                assert_eq!(t.texel(1, 1, 0, 1)[0], i as f32, "round {round}");
                assert!(counters.read().peak_bytes <= 160);
            }
        }
        let before = counters.read().tiles_read;
        for _ in 0..10 {
            cache.get(key(99), 16, &counters, || tile(99.0));
        }
        assert_eq!(counters.read().tiles_read, before, "the last tile is still there");
    }

    #[test]
    fn too_large_a_tile_is_read_every_time() {
        let (cache, counters) = (TileCache::new(15), Counters::default());
        for n in 1..4 {
            cache.get(key(0), 16, &counters, || tile(0.0));
            assert_eq!(counters.read().tiles_read, n);
        }
        assert_eq!(counters.read().peak_bytes, 0);
    }

    #[test]
    fn texels_are_made_finite() {
        let t = Tile::new(Pixels::Float(vec![f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1.0]), 4, 1);
        let got: Vec<f32> = (0..4).map(|x| t.texel(x, 0, 0, 1)[0]).collect();
        assert_eq!(got, [0.0, 1e30, -1e30, 1.0]);
        let t = Tile::new(Pixels::Half(vec![f16::NAN, f16::INFINITY, f16::ONE, f16::NEG_INFINITY]), 4, 1);
        let got: Vec<f32> = (0..4).map(|x| t.texel(x, 0, 0, 1)[0]).collect();
        assert_eq!(got, [0.0, 65504.0, 1.0, -65504.0]);
    }

    #[test]
    fn one_read_for_many_threads() {
        let (cache, counters) = (TileCache::new(1 << 20), Counters::default());
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| {
                    for i in 0..50 {
                        assert_eq!(cache.get(key(i), 16, &counters, || tile(1.0)).bytes(), 16);
                    }
                });
            }
        });
        assert_eq!(counters.read().tiles_read, 50);
    }
}
