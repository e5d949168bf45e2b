//! The tiles in memory, within a bound. The least recently used ones are dropped first.

use crate::tile::Tile;
use granita_base::Lru;
use parking_lot::{Mutex, MutexGuard};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The key of a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TileKey {
    /// The page, by its id from [`TileStore::new_page`].
    pub page: u64,
    /// The level, 0 being the largest.
    pub level: u32,
    /// The column.
    pub tx: u32,
    /// The row.
    pub ty: u32,
}

/// The bounds of the memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StoreLimits {
    /// The bytes of the tiles of pages that are not visible.
    pub others: u64,
    /// The bytes that a visible page may use beyond its visible bytes, unless it is kept whole. The number counts as at
    /// least a third and at most half of the visible bytes.
    pub spare: u64,
}

impl Default for StoreLimits {
    fn default() -> Self {
        Self { others: 256 << 20, spare: 4 << 20 }
    }
}

#[derive(Debug, Default)]
struct PageUse {
    bytes: u64,
    /// The bytes of the tiles that the last frames showed.
    visible: u64,
    /// True when the page is kept whole, because reading a part of it again costs as much as reading all.
    keep: bool,
    shown: bool,
}

#[derive(Debug, Default)]
struct Inner {
    /// The weights are bytes.
    tiles: Lru<TileKey, Arc<Tile>>,
    pages: BTreeMap<u64, PageUse>,
    next_page: u64,
    most: u64,
}

/// The tiles of all open pages. Clones are cheap and share one store.
#[derive(Clone, Debug)]
pub struct TileStore {
    limits: StoreLimits,
    inner: Arc<Mutex<Inner>>,
}

impl Default for TileStore {
    fn default() -> Self {
        Self::new(StoreLimits::default())
    }
}

impl TileStore {
    /// Returns an empty store.
    pub fn new(limits: StoreLimits) -> Self {
        Self { limits, inner: Arc::default() }
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        // Nothing panics while the lock is held.
        self.inner.lock()
    }

    /// Returns an id for a page. Pages with `keep` are kept completely while they are visible.
    pub fn new_page(&self, keep: bool) -> u64 {
        let mut inner = self.lock();
        inner.next_page += 1;
        let page = inner.next_page;
        inner.pages.insert(page, PageUse { keep, ..PageUse::default() });
        page
    }

    /// Drops a page and its tiles.
    pub fn drop_page(&self, page: u64) {
        let mut inner = self.lock();
        inner.remove_if(|key| key.page == page);
        inner.pages.remove(&page);
    }

    /// Drops the tiles of a page for which `stale(level, tx, ty)` is true.
    pub fn forget(&self, page: u64, stale: impl Fn(u32, u32, u32) -> bool) {
        self.lock().remove_if(|key| key.page == page && stale(key.level, key.tx, key.ty));
    }

    /// Returns a tile that is in memory. This counts as a use.
    pub fn get(&self, key: TileKey) -> Option<Arc<Tile>> {
        self.lock().tiles.get(&key).cloned()
    }

    /// True when a tile is in memory. This does not count as a use.
    pub fn has(&self, key: TileKey) -> bool {
        self.lock().tiles.peek(&key).is_some()
    }

    /// Adds tiles, and drops others to stay within the bound.
    pub fn insert(&self, tiles: impl IntoIterator<Item = (TileKey, Arc<Tile>)>) {
        let mut inner = self.lock();
        for (key, tile) in tiles {
            inner.add(key, tile);
        }
        inner.shrink(&self.limits);
    }

    /// Sets the visible pages and the bytes of visible tiles of each. The others are kept only within the bound.
    pub fn look_at(&self, pages: &[(u64, u64)]) {
        let mut inner = self.lock();
        for (page, state) in &mut inner.pages {
            let seen = pages.iter().find(|p| p.0 == *page);
            state.shown = seen.is_some();
            if let Some((_, visible)) = seen {
                state.visible = *visible;
            }
        }
        inner.shrink(&self.limits);
    }

    /// Returns the bounds.
    pub fn limits(&self) -> &StoreLimits {
        &self.limits
    }

    /// Returns the bytes of all tiles, now and at most so far.
    pub fn bytes(&self) -> (u64, u64) {
        let inner = self.lock();
        (inner.tiles.weight(), inner.most)
    }
}

impl Inner {
    fn add(&mut self, key: TileKey, tile: Arc<Tile>) {
        let bytes = tile.bytes();
        // Tiles of a page that was dropped meanwhile are not stored.
        let Some(page) = self.pages.get_mut(&key.page) else { return };
        page.bytes += bytes;
        if let Some(old) = self.tiles.insert(key, tile, bytes) {
            page.bytes -= old.bytes();
        }
        self.most = self.most.max(self.tiles.weight());
    }

    /// Drops the least recently used tile of those that `permitted` names; false when there is none.
    fn evict(&mut self, permitted: impl Fn(&BTreeMap<u64, PageUse>, &TileKey) -> bool) -> bool {
        let Some((key, tile)) = self.tiles.evict(|key, _| permitted(&self.pages, key)) else { return false };
        if let Some(page) = self.pages.get_mut(&key.page) {
            page.bytes -= tile.bytes();
        }
        true
    }

    fn remove_if(&mut self, gone: impl Fn(&TileKey) -> bool) {
        self.tiles.retain(|key, tile| {
            let gone = gone(key);
            if gone && let Some(page) = self.pages.get_mut(&key.page) {
                page.bytes -= tile.bytes();
            }
            !gone
        });
    }

    /// Drops tiles until every visible page, and all others together, are within their bounds.
    fn shrink(&mut self, limits: &StoreLimits) {
        let shown: Vec<(u64, u64)> = (self.pages.iter())
            .filter(|(_, p)| p.shown && !p.keep)
            .map(|(page, p)| (*page, p.visible + (p.visible / 2).min(limits.spare.max(p.visible / 3))))
            .collect();
        for (page, most) in shown {
            while self.pages.get(&page).is_some_and(|p| p.bytes > most)
                && self.evict(|_, key| key.page == page)
            {}
        }
        let others = |inner: &Self| inner.pages.values().filter(|p| !p.shown).map(|p| p.bytes).sum::<u64>();
        let hidden =
            |pages: &BTreeMap<u64, PageUse>, key: &TileKey| pages.get(&key.page).is_none_or(|p| !p.shown);
        while others(self) > limits.others && self.evict(hidden) {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_image::PixelType;

    fn tile() -> Arc<Tile> {
        Arc::new(Tile::zeros(16, 16, 4, PixelType::Float))
    }

    const BYTES: u64 = 4096;

    fn key(page: u64, tx: u32) -> TileKey {
        TileKey { page, level: 0, tx, ty: 0 }
    }

    #[test]
    fn tiles_of_visible_pages_stay_and_others_are_evicted() {
        let store = TileStore::new(StoreLimits { others: 4 * BYTES, spare: BYTES });
        let (a, b) = (store.new_page(false), store.new_page(false));
        store.look_at(&[(a, 6 * BYTES)]);
        store.insert((0..20).map(|i| (key(a, i), tile())));
        assert!(store.bytes().0 <= 9 * BYTES, "{:?}", store.bytes());
        assert!(store.get(key(a, 19)).is_some() && store.get(key(a, 0)).is_none());
        store.look_at(&[(b, 2 * BYTES)]);
        assert!(store.bytes().0 <= 4 * BYTES, "those of a are now others");
        store.drop_page(a);
        assert_eq!(store.bytes().0, 0);
        store.insert([(key(a, 0), tile())]);
        assert_eq!(store.bytes().0, 0, "nobody wants them any more");
    }

    #[test]
    fn kept_pages_stay_while_visible() {
        let store = TileStore::new(StoreLimits { others: 0, spare: 0 });
        let a = store.new_page(true);
        store.look_at(&[(a, BYTES)]);
        store.insert((0..20).map(|i| (key(a, i), tile())));
        assert_eq!(store.bytes().0, 20 * BYTES);
        store.forget(a, |_, tx, _| tx < 5);
        assert_eq!(store.bytes().0, 15 * BYTES);
        store.look_at(&[]);
        assert_eq!(store.bytes().0, 0);
    }
}
