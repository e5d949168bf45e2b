//! Tessellations that rays need, kept as long as there is room.
//!
//! A part of a primitive at a level is made by the first ray that asks, kept while memory lasts, and made again when it
//! was given up meanwhile: always the same, to the bit. What is in the cache decides how long something takes and never
//! what comes out.

use crate::rays::mesh::{Level, RayMesh};
use granita_trace::Tracer;
use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

/// Bytes of tessellations of a frame that are kept, unless more are in use at once.
pub(crate) const CACHE_BYTES: u64 = 1 << 30;

/// Which tessellation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct Key {
    /// Geometry set.
    pub(crate) set: u32,
    /// Part of a primitive in it.
    pub(crate) part: u32,
    /// How finely.
    pub(crate) level: Level,
}

/// A part at a level.
#[derive(Debug)]
pub(crate) struct Tessellation {
    /// What hits are shaded from; `None` where there is no surface.
    pub(crate) mesh: Option<RayMesh>,
    /// What rays meet.
    pub(crate) tracer: Tracer,
}

impl Tessellation {
    /// Bytes of memory that it takes.
    pub(crate) fn bytes(&self) -> u64 {
        let mesh = self.mesh.as_ref().map_or(0, RayMesh::bytes);
        (mesh + self.tracer.bytes() + size_of::<Self>()) as u64
    }

    /// How many triangles there are.
    pub(crate) fn triangles(&self) -> u64 {
        self.mesh.as_ref().map_or(0, |mesh| u64::from(mesh.triangles()))
    }
}

/// A tessellation that is there, or is being made.
#[derive(Debug, Default)]
struct Slot {
    made: OnceLock<Arc<Tessellation>>,
    /// When it was last asked for.
    used: AtomicU64,
}

#[derive(Debug, Default)]
struct Kept {
    slots: HashMap<Key, Arc<Slot>>,
    /// Of those that are made.
    bytes: u64,
    triangles: u64,
}

/// Tessellations by what they are of. Shared between threads.
#[derive(Debug)]
pub(crate) struct TessellationCache {
    limit: AtomicU64,
    kept: Mutex<Kept>,
    clock: AtomicU64,
    made: AtomicU64,
    given_up: AtomicU64,
    peak: AtomicU64,
}

/// What a cache did, and holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct CacheCounts {
    /// Tessellations made, those made again included.
    pub(crate) made: u64,
    /// Of them, those given up for others.
    pub(crate) given_up: u64,
    /// Triangles held now.
    pub(crate) triangles: u64,
    /// Bytes held now.
    pub(crate) bytes: u64,
    /// Most bytes held at once.
    pub(crate) peak_bytes: u64,
}

impl TessellationCache {
    /// An empty one that keeps `limit` bytes.
    pub(crate) fn new(limit: u64) -> Self {
        let zero = || AtomicU64::new(0);
        Self {
            limit: AtomicU64::new(limit),
            kept: Mutex::default(),
            clock: zero(),
            made: zero(),
            given_up: zero(),
            peak: zero(),
        }
    }

    /// Bytes that are kept.
    pub(crate) fn limit(&self) -> u64 {
        self.limit.load(Ordering::Relaxed)
    }

    /// Changes how much is kept from now on.
    #[cfg(test)]
    pub(crate) fn set_limit(&self, limit: u64) {
        self.limit.store(limit, Ordering::Relaxed);
    }

    fn kept(&self) -> MutexGuard<'_, Kept> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The tessellation of this key, made by `make` unless it is there. Whoever asks while it is being made waits.
    pub(crate) fn get(&self, key: Key, make: impl FnOnce() -> Tessellation) -> Arc<Tessellation> {
        let slot = self.kept().slots.entry(key).or_default().clone();
        slot.used.store(self.clock.fetch_add(1, Ordering::Relaxed), Ordering::Relaxed);
        let mut new = false;
        let found = slot.made.get_or_init(|| {
            new = true;
            Arc::new(make())
        });
        if new {
            self.made.fetch_add(1, Ordering::Relaxed);
            self.keep(found);
        }
        found.clone()
    }

    /// Counts a new tessellation, and gives up those not used for longest when there are too many.
    fn keep(&self, new: &Tessellation) {
        let mut kept = self.kept();
        kept.bytes += new.bytes();
        kept.triangles += new.triangles();
        self.peak.fetch_max(kept.bytes, Ordering::Relaxed);
        let limit = self.limit();
        if kept.bytes <= limit {
            return;
        }
        // Some room at once: looking for the oldest takes time.
        let wanted = limit - limit / 8;
        let made = kept.slots.iter().filter(|(_, slot)| slot.made.get().is_some());
        let mut by_age: Vec<(u64, Key)> =
            made.map(|(key, slot)| (slot.used.load(Ordering::Relaxed), *key)).collect();
        by_age.sort_unstable();
        for (_, key) in by_age {
            if kept.bytes <= wanted {
                break;
            }
            let Some(old) = kept.slots.remove(&key).and_then(|slot| slot.made.get().cloned()) else {
                continue;
            };
            kept.bytes = kept.bytes.saturating_sub(old.bytes());
            kept.triangles = kept.triangles.saturating_sub(old.triangles());
            self.given_up.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// What happened so far.
    pub(crate) fn counts(&self) -> CacheCounts {
        let kept = self.kept();
        CacheCounts {
            made: self.made.load(Ordering::Relaxed),
            given_up: self.given_up.load(Ordering::Relaxed),
            triangles: kept.triangles,
            bytes: kept.bytes,
            peak_bytes: self.peak.load(Ordering::Relaxed),
        }
    }
}
