//! The files of a cache. They are found by name once, never removed, and accessed without a lock.

use crate::file::TextureFile;
use parking_lot::{Mutex, RwLock};
use std::collections::HashMap;
use std::sync::{Arc, OnceLock};

/// The number of files of the first block. Each further block holds twice as many.
const FIRST: usize = 64;
const BLOCKS: usize = 24;

/// An append-only list that can be read while it grows.
struct List {
    blocks: [OnceLock<Box<[OnceLock<TextureFile>]>>; BLOCKS],
    count: Mutex<u32>,
}

/// Returns the block and position of an index.
fn place(index: u32) -> (usize, usize) {
    let n = index as usize / FIRST + 1;
    let block = n.ilog2() as usize;
    (block, index as usize - FIRST * ((1 << block) - 1))
}

impl List {
    fn get(&self, index: u32) -> Option<&TextureFile> {
        let (block, at) = place(index);
        self.blocks.get(block)?.get()?.get(at)?.get()
    }

    fn get_mut(&mut self, index: u32) -> Option<&mut TextureFile> {
        let (block, at) = place(index);
        self.blocks.get_mut(block)?.get_mut()?.get_mut(at)?.get_mut()
    }

    /// Appends the file that `make` makes for the index; `None` when it makes none.
    fn push(&self, make: impl FnOnce(u32) -> Option<TextureFile>) -> Option<u32> {
        let mut count = self.count.lock();
        let (block, at) = place(*count);
        let list =
            self.blocks.get(block)?.get_or_init(|| (0..FIRST << block).map(|_| OnceLock::new()).collect());
        list[at].set(make(*count)?).ok()?;
        *count += 1;
        Some(*count - 1)
    }
}

/// The result for one name, found by one thread while others wait.
type Answer = Arc<OnceLock<Option<u32>>>;

/// All files named so far.
pub(crate) struct Files {
    names: RwLock<HashMap<String, Answer>>,
    list: List,
}

impl std::fmt::Debug for Files {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Files")
    }
}

impl Files {
    pub(crate) fn new() -> Self {
        Self {
            names: RwLock::default(),
            list: List { blocks: std::array::from_fn(|_| OnceLock::new()), count: Mutex::new(0) },
        }
    }

    pub(crate) fn get(&self, index: u32) -> Option<&TextureFile> {
        self.list.get(index)
    }

    pub(crate) fn get_mut(&mut self, index: u32) -> Option<&mut TextureFile> {
        self.list.get_mut(index)
    }

    /// Forgets a name. Returns the index of its file, which stays in the list.
    pub(crate) fn forget(&mut self, name: &str) -> Option<u32> {
        *self.names.get_mut().remove(name)?.get()?
    }

    /// Returns all names, in order.
    pub(crate) fn names(&mut self) -> Vec<String> {
        let mut names: Vec<String> = self.names.get_mut().keys().cloned().collect();
        names.sort();
        names
    }

    /// Returns the index of the file called `name`. The first caller makes it with `open`.
    pub(crate) fn find(&self, name: &str, open: impl FnOnce(u32) -> Option<TextureFile>) -> Option<u32> {
        let known = self.names.read().get(name).cloned();
        let answer = known.unwrap_or_else(|| {
            let mut names = self.names.write();
            names.entry(name.to_owned()).or_default().clone()
        });
        *answer.get_or_init(|| self.list.push(open))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_indices_map_to_consecutive_slots() {
        assert_eq!(place(0), (0, 0));
        assert_eq!(place(63), (0, 63));
        assert_eq!(place(64), (1, 0));
        assert_eq!(place(191), (1, 127));
        assert_eq!(place(192), (2, 0));
    }
}
