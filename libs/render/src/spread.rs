//! Frames whose buckets are rendered by several processes (reference 6.6.3).
//!
//! All processes read the same scene and cut its frames into the same buckets. The coordinator assigns bucket
//! indices and collects the pixels. Its workers render them. The transport is not part of this crate.

use crate::bucket;
use crate::priority::{Priority, Turns};
use parking_lot::{Condvar, Mutex, MutexGuard};
use std::sync::Arc;
use std::time::Duration;

/// The pixels of a bucket. Each image has a list of interleaved channels, row by row. The images of an eye follow one
/// another.
pub type BucketPixels = Vec<Vec<f32>>;

/// The processes that render the buckets of frames.
#[derive(Clone, Default)]
pub enum Spread {
    /// This process renders all buckets.
    #[default]
    Alone,
    /// These workers render the buckets.
    Over(Arc<dyn Workers>),
    /// This process is a worker, which writes no files.
    For(Arc<dyn Coordinator>),
}

/// The access of a worker's connection to the buckets of the frame.
pub trait Buckets {
    /// Returns the index of a bucket to render. With `wait`, waits until there is one or the frame is done. Without
    /// it, returns `None` when none is available at once.
    fn take(&self, wait: bool) -> Option<usize>;
    /// True when the frame needs no more buckets, because all are done or because it is being stopped.
    fn is_over(&self) -> bool;
    /// Stores the pixels of a bucket that was taken, or the reason why the worker has none.
    ///
    /// # Errors
    /// Returns a description of invalid pixels.
    fn put(&self, index: usize, pixels: Result<BucketPixels, String>) -> Result<(), String>;
}

/// Processes that render buckets for this one.
pub trait Workers: Send + Sync {
    /// Starts a frame. Returns the number of workers for it.
    fn begin(&self) -> usize;
    /// Gives buckets to a worker until none is left. Each worker has a thread that calls this function.
    ///
    /// # Errors
    /// Returns the reason why the worker is lost. Others then render its buckets.
    fn work(&self, worker: usize, buckets: &dyn Buckets) -> Result<(), String>;
    /// Ends the frame.
    fn end(&self);
}

/// The process that this one renders buckets for.
pub trait Coordinator: Send + Sync {
    /// Starts a frame.
    fn begin(&self);
    /// Returns the index of a bucket to render; `None` when the frame is over. Called by several threads.
    fn next(&self) -> Option<usize>;
    /// Sends the pixels of a bucket, or the reason why there are none.
    fn done(&self, index: usize, pixels: Result<&BucketPixels, &str>);
}

/// The largest delay until a stop is noticed.
const GLANCE: Duration = Duration::from_millis(100);

/// The buckets of a frame that are not done.
pub(crate) struct Queue {
    state: Mutex<State>,
    changed: Condvar,
}

struct State {
    waiting: Turns,
    /// The number of taken buckets.
    taken: usize,
    /// The buckets that no worker could render.
    failed: Vec<usize>,
}

impl Queue {
    pub(crate) fn new(buckets: usize, priority: Option<&Priority>) -> Self {
        let state = State { waiting: Turns::new(0..buckets, priority), taken: 0, failed: Vec::new() };
        Self { state: Mutex::new(state), changed: Condvar::new() }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock()
    }

    /// Takes a bucket as [`Buckets::take`] does.
    pub(crate) fn take(
        &self,
        wait: bool,
        stop: impl Fn() -> bool,
        buckets: &bucket::Buckets,
        priority: Option<&Priority>,
    ) -> Option<usize> {
        let mut state = self.state();
        loop {
            if stop() {
                return None;
            }
            if let Some(index) = state.waiting.next(buckets, priority) {
                state.taken += 1;
                return Some(index);
            }
            if !wait || state.taken == 0 {
                return None;
            }
            // A stop of the frame does not notify this condition.
            self.changed.wait_for(&mut state, GLANCE);
        }
    }

    /// True when no bucket is waiting or taken.
    pub(crate) fn is_done(&self) -> bool {
        let state = self.state();
        state.taken == 0 && state.waiting.is_empty()
    }

    /// Marks a taken bucket as done. `failed` is true when the worker could not render it.
    pub(crate) fn finish(&self, index: usize, failed: bool) {
        let mut state = self.state();
        state.taken -= 1;
        if failed {
            state.failed.push(index);
        }
        drop(state);
        self.changed.notify_all();
    }

    /// Returns buckets that were taken but not rendered.
    pub(crate) fn give_back(&self, indices: &[usize]) {
        let mut state = self.state();
        state.taken -= indices.len();
        state.waiting.give_back(indices);
        drop(state);
        self.changed.notify_all();
    }

    /// Returns the buckets that were not rendered, in order.
    pub(crate) fn left(self) -> Vec<usize> {
        let state = self.state.into_inner();
        let mut left: Vec<usize> = state.waiting.left().chain(state.failed).collect();
        left.sort_unstable();
        left
    }
}

impl std::fmt::Debug for Spread {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Alone => "Alone",
            Self::Over(_) => "Over",
            Self::For(_) => "For",
        })
    }
}
