//! What a session knows of its running frame.

use granita_render::Progress;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Tracks the number of steps of the running frame and the number of those done, for "render:progress".
pub(crate) struct Tracked {
    pub(crate) inner: Arc<dyn Progress>,
    pub(crate) total: AtomicU64,
    pub(crate) done: AtomicU64,
    /// True when the frame has ended, early or not.
    pub(crate) over: AtomicBool,
}

impl Progress for Tracked {
    fn begin(&self, image: &Path, total: u64) {
        self.total.store(total, Ordering::Relaxed);
        self.done.store(0, Ordering::Relaxed);
        self.inner.begin(image, total);
    }

    fn done(&self, steps: u64) {
        self.done.fetch_max(steps, Ordering::Relaxed);
        self.inner.done(steps);
    }

    fn end(&self) {
        self.inner.end();
    }

    fn wrote(&self, path: &Path) {
        self.inner.wrote(path);
    }
}

/// Sets a flag until this is dropped.
pub(crate) struct Busy(Arc<AtomicBool>);

impl Busy {
    pub(crate) fn new(flag: &Arc<AtomicBool>) -> Self {
        flag.store(true, Ordering::SeqCst);
        Self(flag.clone())
    }
}

impl Drop for Busy {
    fn drop(&mut self) {
        self.0.store(false, Ordering::SeqCst);
    }
}
