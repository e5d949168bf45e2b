//! Entries in the order of their last use, of which the oldest are evicted.

use hashlink::LinkedHashMap;
use rustc_hash::FxBuildHasher;
use std::hash::Hash;

/// Values by their keys, each with a weight (bytes, for example), in the order of their last use.
///
/// The owner decides what is bounded: it calls [`Lru::evict`] until its limit is met. So one map can be one of several
/// under a common limit, and values that are in use can stay.
///
/// ```
/// use granita_base::Lru;
/// let mut held = Lru::default();
/// for (key, bytes) in [("a", 30), ("b", 50), ("c", 40)] {
///     held.insert(key, (), bytes);
/// }
/// held.get(&"a");
/// while held.weight() > 100 && held.evict(|_, _| true).is_some() {}
/// assert_eq!(held.iter().map(|(key, _)| *key).collect::<Vec<_>>(), ["c", "a"]);
/// ```
#[derive(Debug)]
pub struct Lru<K, V> {
    /// The least recently used entry comes first.
    entries: LinkedHashMap<K, Entry<V>, FxBuildHasher>,
    weight: u64,
}

#[derive(Debug)]
struct Entry<V> {
    value: V,
    weight: u64,
}

impl<K, V> Default for Lru<K, V> {
    fn default() -> Self {
        Self { entries: LinkedHashMap::with_hasher(FxBuildHasher), weight: 0 }
    }
}

impl<K: Hash + Eq + Clone, V> Lru<K, V> {
    /// Returns a value. This is a use of it.
    pub fn get(&mut self, key: &K) -> Option<&V> {
        self.entries.to_back(key).map(|entry| &entry.value)
    }

    /// Returns a value. This is not a use of it.
    pub fn peek(&self, key: &K) -> Option<&V> {
        self.entries.get(key).map(|entry| &entry.value)
    }

    /// Adds a value, as the last one used. Returns the value that it replaces.
    pub fn insert(&mut self, key: K, value: V, weight: u64) -> Option<V> {
        let old = self.remove(&key);
        self.weight += weight;
        self.entries.insert(key, Entry { value, weight });
        old
    }

    /// Changes the weight of a value; false when there is none of this key.
    pub fn set_weight(&mut self, key: &K, weight: u64) -> bool {
        let Some(entry) = self.entries.get_mut(key) else { return false };
        self.weight = self.weight - entry.weight + weight;
        entry.weight = weight;
        true
    }

    /// Removes and returns a value.
    pub fn remove(&mut self, key: &K) -> Option<V> {
        let entry = self.entries.remove(key)?;
        self.weight -= entry.weight;
        Some(entry.value)
    }

    /// Removes and returns the least recently used entry among those for which `permitted` is true, which is asked in
    /// that order; `None` when there is none.
    pub fn evict(&mut self, mut permitted: impl FnMut(&K, &V) -> bool) -> Option<(K, V)> {
        let key = self.iter().find(|(key, value)| permitted(key, value))?.0.clone();
        let value = self.remove(&key)?;
        Some((key, value))
    }

    /// Keeps only the entries for which `wanted` is true.
    pub fn retain(&mut self, mut wanted: impl FnMut(&K, &V) -> bool) {
        let weight = &mut self.weight;
        self.entries.retain(|key, entry| {
            let keep = wanted(key, &entry.value);
            *weight -= if keep { 0 } else { entry.weight };
            keep
        });
    }

    /// Returns the entries, the least recently used one first.
    pub fn iter(&self) -> impl Iterator<Item = (&K, &V)> {
        self.entries.iter().map(|(key, entry)| (key, &entry.value))
    }

    /// Returns the sum of all weights.
    pub fn weight(&self) -> u64 {
        self.weight
    }

    /// Returns the number of entries.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// True when there is no entry.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(lru: &Lru<u32, char>) -> Vec<u32> {
        lru.iter().map(|(key, _)| *key).collect()
    }

    #[test]
    fn the_least_recently_used_evictable_entry_is_evicted() {
        let mut lru = Lru::default();
        for (key, value) in [(1, 'a'), (2, 'b'), (3, 'c'), (4, 'd')] {
            assert_eq!(lru.insert(key, value, 10), None);
        }
        assert_eq!((lru.get(&1).copied(), lru.get(&9).copied()), (Some('a'), None));
        assert_eq!(lru.peek(&2), Some(&'b'));
        assert_eq!(keys(&lru), [2, 3, 4, 1]);
        assert_eq!(lru.evict(|key, _| *key != 2), Some((3, 'c')));
        assert_eq!(lru.evict(|_, value| *value == 'z'), None);
        assert_eq!((keys(&lru), lru.weight(), lru.len()), (vec![2, 4, 1], 30, 3));
    }

    #[test]
    fn the_weight_is_the_sum_of_the_entries() {
        let mut lru = Lru::default();
        lru.insert(1, 'a', 5);
        lru.insert(2, 'b', 7);
        assert_eq!((lru.insert(1, 'c', 11), lru.weight()), (Some('a'), 18));
        assert_eq!(keys(&lru), [2, 1], "a new value is the last one used");
        assert!(lru.set_weight(&2, 1) && !lru.set_weight(&3, 1));
        assert_eq!(lru.weight(), 12);
        lru.retain(|key, _| *key == 2);
        assert_eq!((keys(&lru), lru.weight()), (vec![2], 1));
        assert_eq!((lru.remove(&2), lru.remove(&2), lru.weight()), (Some('b'), None, 0));
        assert!(lru.is_empty());
    }
}
