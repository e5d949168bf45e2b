//! Frames whose buckets are rendered by several processes (reference 6.6.3).
//!
//! All processes read the same scene and cut its frames into the same buckets. One hands out the numbers of
//! buckets and puts their pixels together; the others, its workers, render them. How they talk is not known here.

use crate::bucket;
use crate::priority::{Priority, Turns};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// The pixels of a bucket: for each image (those of an eye one after the other) its channels side by side, row by row.
pub type BucketPixels = Vec<Vec<f32>>;

/// Who renders the buckets of frames.
#[derive(Clone, Default)]
pub enum Spread {
    /// This process.
    #[default]
    Alone,
    /// These workers.
    Over(Arc<dyn Workers>),
    /// This process is a worker; it writes nothing.
    For(Arc<dyn Coordinator>),
}

/// What a worker's conversation needs from the frame.
pub trait Buckets {
    /// The number of a bucket to be rendered. With `wait`, waits until there is one or nothing is left to do for anybody;
    /// without, tells only of what is there at once.
    fn take(&self, wait: bool) -> Option<usize>;
    /// Whether the frame needs no buckets any more: all are done, or it is being stopped.
    fn is_over(&self) -> bool;
    /// The pixels of a bucket that was taken, or why the worker has none.
    ///
    /// # Errors
    /// What is wrong with them.
    fn put(&self, index: usize, pixels: Result<BucketPixels, String>) -> Result<(), String>;
}

/// Processes that render buckets for this one.
pub trait Workers: Send + Sync {
    /// A frame begins: how many workers there are for it.
    fn begin(&self) -> usize;
    /// Keeps a worker busy until no bucket is left. Called by a thread for each.
    ///
    /// # Errors
    /// Why the worker is of no more use; what it had taken is done by others.
    fn work(&self, worker: usize, buckets: &dyn Buckets) -> Result<(), String>;
    /// The frame is over.
    fn end(&self);
}

/// The process that this one renders buckets for.
pub trait Coordinator: Send + Sync {
    /// A frame begins.
    fn begin(&self);
    /// The number of a bucket to be rendered; `None` when the frame is over. Called by several threads.
    fn next(&self) -> Option<usize>;
    /// The pixels of a bucket, or why there are none.
    fn done(&self, index: usize, pixels: Result<&BucketPixels, &str>);
}

/// How long a stop may go unseen.
const GLANCE: Duration = Duration::from_millis(100);

/// Buckets of a frame that are not done.
pub(crate) struct Queue {
    state: Mutex<State>,
    changed: Condvar,
}

struct State {
    waiting: Turns,
    /// Taken by somebody.
    taken: usize,
    /// Those that no worker could render.
    failed: Vec<usize>,
}

impl Queue {
    pub(crate) fn new(buckets: usize, priority: Option<&Priority>) -> Self {
        let state = State { waiting: Turns::new(0..buckets, priority), taken: 0, failed: Vec::new() };
        Self { state: Mutex::new(state), changed: Condvar::new() }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// As [`Buckets::take`].
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
            // Whoever stops a frame does not tell here.
            (state, _) = self.changed.wait_timeout(state, GLANCE).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Whether no bucket is waiting or taken.
    pub(crate) fn is_done(&self) -> bool {
        let state = self.state();
        state.taken == 0 && state.waiting.is_empty()
    }

    /// A bucket that was taken is done; `failed`: not by a worker.
    pub(crate) fn finish(&self, index: usize, failed: bool) {
        let mut state = self.state();
        state.taken -= 1;
        if failed {
            state.failed.push(index);
        }
        drop(state);
        self.changed.notify_all();
    }

    /// Buckets that were taken in vain are there again.
    pub(crate) fn give_back(&self, indices: &[usize]) {
        let mut state = self.state();
        state.taken -= indices.len();
        state.waiting.give_back(indices);
        drop(state);
        self.changed.notify_all();
    }

    /// What nobody rendered, in order.
    pub(crate) fn left(self) -> Vec<usize> {
        let state = self.state.into_inner().unwrap_or_else(PoisonError::into_inner);
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
