//! Handles of maps with constant names.

use std::any::Any;
use std::sync::OnceLock;

/// The place where a renderer keeps the map of a call with a constant name. The name is then looked up once for a
/// linked group, and not once for each grid.
#[derive(Debug, Default)]
pub struct MapHandle(OnceLock<Box<dyn Any + Send + Sync>>);

impl MapHandle {
    /// Returns the kept value; `find` looks it up when nothing is kept yet. Returns `None` when it finds nothing,
    /// which is not kept, or when the kept value has another type.
    pub fn get_or_find<T: Any + Send + Sync>(&self, find: impl FnOnce() -> Option<T>) -> Option<&T> {
        if self.0.get().is_none() {
            let found: Box<dyn Any + Send + Sync> = Box::new(find()?);
            // Another thread may have stored the same value first.
            self.0.get_or_init(|| found);
        }
        self.0.get()?.downcast_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_handle_keeps_the_map_that_was_found() {
        let handle = MapHandle::default();
        assert_eq!(handle.get_or_find(|| None::<u32>), None);
        assert_eq!(handle.get_or_find(|| Some(3_u32)), Some(&3));
        assert_eq!(handle.get_or_find::<u32>(|| panic!("it is known")), Some(&3));
        assert_eq!(handle.get_or_find(|| Some("other")), None);
    }
}
