//! A cache of the tessellations that rays need.
//!
//! The first ray that needs a part of a primitive at a level makes its tessellation. The cache evicts tessellations
//! when its limit of bytes is exceeded. A tessellation that is made again is the same to the bit, so that the cache
//! affects the time of a render and never its result.

use crate::mesh::{Level, RayMesh};
use granita_base::Lru;
use granita_trace::Tracer;
use parking_lot::{Mutex, MutexGuard};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

/// The default limit of the tessellations of a frame, in bytes. More is kept only while it is in use.
pub const CACHE_BYTES: u64 = 1 << 30;

/// The identity of a tessellation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Key {
    /// The index of the geometry set.
    pub set: u32,
    /// The index of the part in the set.
    pub part: u32,
    /// The level of the tessellation.
    pub level: Level,
}

/// The tessellation of a part at a level.
#[derive(Debug)]
pub struct Tessellation {
    /// The mesh from which hits are shaded; `None` when there is no surface.
    pub mesh: Option<RayMesh>,
    /// The triangles that rays are traced against.
    pub tracer: Tracer,
}

impl Tessellation {
    /// The number of bytes of memory that it occupies.
    pub fn bytes(&self) -> u64 {
        let mesh = self.mesh.as_ref().map_or(0, RayMesh::bytes);
        (mesh + self.tracer.bytes() + size_of::<Self>()) as u64
    }

    /// The number of triangles.
    pub fn triangles(&self) -> u64 {
        self.mesh.as_ref().map_or(0, |mesh| u64::from(mesh.triangles()))
    }
}

/// A tessellation that exists or is being made.
#[derive(Debug, Default)]
struct Slot {
    made: OnceLock<Arc<Tessellation>>,
    /// True when the tessellation is part of the sums of [`Kept`] and may be evicted. It changes only under their
    /// lock.
    counted: AtomicBool,
}

#[derive(Debug, Default)]
struct Kept {
    /// The weights are the bytes of the tessellations that are counted.
    slots: Lru<Key, Arc<Slot>>,
    triangles: u64,
}

impl Kept {
    /// Returns the slot of a key, which is a new one when there is none.
    fn slot(&mut self, key: Key) -> Arc<Slot> {
        if let Some(slot) = self.slots.get(&key) {
            return slot.clone();
        }
        let slot = Arc::<Slot>::default();
        self.slots.insert(key, slot.clone(), 0);
        slot
    }
}

/// Tessellations by their keys. The cache is shared between threads.
#[derive(Debug)]
pub struct TessellationCache {
    limit: AtomicU64,
    kept: Mutex<Kept>,
    made: AtomicU64,
    given_up: AtomicU64,
    peak: AtomicU64,
}

/// The statistics of a cache.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CacheCounts {
    /// The number of tessellations made, including those made again.
    pub made: u64,
    /// The number of them that were evicted.
    pub given_up: u64,
    /// The number of triangles held now.
    pub triangles: u64,
    /// The number of bytes held now.
    pub bytes: u64,
    /// The largest number of bytes held at once.
    pub peak_bytes: u64,
}

impl TessellationCache {
    /// Returns an empty cache with a limit of `limit` bytes.
    pub fn new(limit: u64) -> Self {
        let zero = || AtomicU64::new(0);
        Self {
            limit: AtomicU64::new(limit),
            kept: Mutex::default(),
            made: zero(),
            given_up: zero(),
            peak: zero(),
        }
    }

    /// The limit, in bytes.
    pub fn limit(&self) -> u64 {
        self.limit.load(Ordering::Relaxed)
    }

    /// Changes the limit, in bytes, from now on.
    pub fn set_limit(&self, limit: u64) {
        self.limit.store(limit, Ordering::Relaxed);
    }

    fn kept(&self) -> MutexGuard<'_, Kept> {
        self.kept.lock()
    }

    /// Returns the tessellation of this key, made by `make` unless it exists. Other threads that request it meanwhile
    /// wait.
    pub fn get(&self, key: Key, make: impl FnOnce() -> Tessellation) -> Arc<Tessellation> {
        let slot = self.kept().slot(key);
        let mut new = false;
        let found = slot.made.get_or_init(|| {
            new = true;
            Arc::new(make())
        });
        if new {
            self.made.fetch_add(1, Ordering::Relaxed);
            self.keep(key, &slot, found);
        }
        found.clone()
    }

    /// Counts the new tessellation of a slot, and evicts the least recently used ones when the limit is exceeded.
    /// Other threads may already find the tessellation before this call, and they leave it in place.
    fn keep(&self, key: Key, slot: &Arc<Slot>, new: &Tessellation) {
        let kept = &mut *self.kept();
        debug_assert!(kept.slots.peek(&key).is_some_and(|own| Arc::ptr_eq(own, slot)));
        slot.counted.store(true, Ordering::Relaxed);
        kept.slots.set_weight(&key, new.bytes());
        kept.triangles += new.triangles();
        self.peak.fetch_max(kept.slots.weight(), Ordering::Relaxed);
        while kept.slots.weight() > self.limit() {
            let counted = |_: &Key, slot: &Arc<Slot>| slot.counted.load(Ordering::Relaxed);
            let Some((_, old)) = kept.slots.evict(counted) else { break };
            kept.triangles -= old.made.get().map_or(0, |old| old.triangles());
            self.given_up.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Returns the statistics so far.
    pub fn counts(&self) -> CacheCounts {
        let kept = self.kept();
        CacheCounts {
            made: self.made.load(Ordering::Relaxed),
            given_up: self.given_up.load(Ordering::Relaxed),
            triangles: kept.triangles,
            bytes: kept.slots.weight(),
            peak_bytes: self.peak.load(Ordering::Relaxed),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_trace::TracerBuilder;

    fn key(part: u32) -> Key {
        Key { set: 0, part, level: Level::default() }
    }

    fn tessellation() -> Tessellation {
        Tessellation { mesh: None, tracer: TracerBuilder::new().build(1) }
    }

    /// Returns the number of bytes of all tessellations that exist.
    fn held(cache: &TessellationCache) -> u64 {
        let made = |slot: &Arc<Slot>| slot.made.get().map_or(0, |made| made.bytes());
        cache.kept().slots.iter().map(|(_, slot)| made(slot)).sum()
    }

    #[test]
    fn tessellations_in_use_are_not_evicted_before_they_are_counted() {
        let cache = TessellationCache::new(3 * tessellation().bytes());
        // One thread has made a tessellation, and other threads run before its next step.
        let slot = cache.kept().slot(key(0));
        let made = slot.made.get_or_init(|| Arc::new(tessellation())).clone();
        for part in 1..20 {
            cache.get(key(part), tessellation);
        }
        assert!(Arc::ptr_eq(&made, &cache.get(key(0), || panic!("it is there"))));
        cache.keep(key(0), &slot, &made);
        let counts = cache.counts();
        assert_eq!((counts.bytes, counts.bytes <= cache.limit()), (held(&cache), true));
    }

    #[test]
    fn the_cache_size_stays_correct_under_concurrent_eviction() {
        let cache = TessellationCache::new(2 * tessellation().bytes());
        std::thread::scope(|scope| {
            for thread in 0..8 {
                let cache = &cache;
                scope.spawn(move || {
                    (0..2000_u32).for_each(|i| drop(cache.get(key(i * (thread + 1) % 7), tessellation)));
                });
            }
        });
        let counts = cache.counts();
        assert_eq!(counts.bytes, held(&cache));
        assert!(counts.given_up > 0 && counts.bytes <= cache.limit(), "{counts:?}");
    }
}
