//! Files that are read again because they changed.

use crate::TextureCache;
use crate::shared::Shared;

impl TextureCache {
    /// Forgets what is known about a name. The next search opens the file again, and finds a file that did not exist
    /// before. For the name of a set, all its textures are forgotten. Open files are closed, and the memory of tiles
    /// and of levels is released.
    ///
    /// Identifiers that were found before are those of the old file. Lookups with them are black.
    pub fn invalidate(&mut self, name: &str) {
        self.shared_mut().forget(name);
    }

    /// Does the same as [`TextureCache::invalidate`] for all names. The counts of the statistics stay.
    pub fn invalidate_all(&mut self) {
        let names = self.shared_mut().files.names();
        for name in names {
            self.shared_mut().forget(&name);
        }
    }
}

impl Shared {
    fn forget(&mut self, name: &str) {
        self.forget_reason(name);
        let Some(index) = self.files.forget(name) else { return };
        self.close(index);
        let members: Vec<String> = match self.files.get_mut(index) {
            Some(file) => {
                file.release();
                file.set.iter().flat_map(|set| set.names().map(str::to_owned)).collect()
            }
            None => Vec::new(),
        };
        for member in members {
            self.forget(&member);
        }
    }
}
