//! Values that are made once each, when they are first requested.

use parking_lot::Mutex;
use std::collections::HashMap;
use std::hash::Hash;
use std::sync::{Arc, OnceLock};

/// Values by key, each made by the first thread that requests it.
///
/// The map is locked only while the entry of a value is looked up. Threads that request the same value wait until it
/// exists. Threads that request other values do not wait. The function that makes a value may request other values,
/// but not its own.
///
/// ```
/// let squares = granita_base::OnceMap::default();
/// assert_eq!(squares.get_or_make(3, || 9), 9);
/// assert_eq!(squares.get_or_make(3, || unreachable!()), 9);
/// ```
#[derive(Debug)]
pub struct OnceMap<K, V>(Mutex<HashMap<K, Arc<OnceLock<V>>>>);

impl<K, V> Default for OnceMap<K, V> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<K: Eq + Hash, V> FromIterator<(K, V)> for OnceMap<K, V> {
    fn from_iter<I: IntoIterator<Item = (K, V)>>(made: I) -> Self {
        Self(Mutex::new(
            made.into_iter().map(|(key, value)| (key, Arc::new(OnceLock::from(value)))).collect(),
        ))
    }
}

impl<K: Eq + Hash, V: Clone> OnceMap<K, V> {
    /// Returns the values that were made, with their keys, in any order.
    pub fn made(&self) -> Vec<(K, V)>
    where
        K: Clone,
    {
        let places = self.0.lock();
        places.iter().filter_map(|(key, place)| Some((key.clone(), place.get()?.clone()))).collect()
    }

    /// Returns the value of a key. `make` makes it when it was not requested before.
    pub fn get_or_make(&self, key: K, make: impl FnOnce() -> V) -> V {
        let place = {
            let mut places = self.0.lock();
            places.entry(key).or_default().clone()
        };
        place.get_or_init(make).clone()
    }
}

#[cfg(test)]
mod tests {
    use super::OnceMap;
    use std::sync::Barrier;
    use std::sync::atomic::{AtomicU32, Ordering};

    #[test]
    fn each_value_is_made_once() {
        let (map, made) = (OnceMap::default(), AtomicU32::new(0));
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| {
                    for key in 0..100 {
                        let make = || {
                            made.fetch_add(1, Ordering::Relaxed);
                            key * key
                        };
                        assert_eq!(map.get_or_make(key, make), key * key);
                    }
                });
            }
        });
        assert_eq!(made.into_inner(), 100);
    }

    /// Two values are made at the same time. Each waits until the other has begun.
    #[test]
    fn values_of_different_keys_are_made_concurrently() {
        let (map, both) = (OnceMap::default(), Barrier::new(2));
        std::thread::scope(|scope| {
            for key in 0..2 {
                let (map, both) = (&map, &both);
                scope.spawn(move || {
                    map.get_or_make(key, || {
                        both.wait();
                        map.get_or_make(key + 10, || key)
                    })
                });
            }
        });
        assert_eq!(map.get_or_make(1, || unreachable!()), 1);
    }
}
