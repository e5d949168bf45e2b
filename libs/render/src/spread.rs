//! Frames whose buckets are rendered by several processes (reference 6.6.3).
//!
//! All processes read the same scene and cut its frames into the same buckets. The coordinator assigns buckets, and
//! parts of them, and collects the pixels. Its workers render them. The transport is not part of this crate.

use crate::PixelRect;
use crate::bucket;
use crate::priority::{Priority, Turns};
use crate::schedule::{Schedule, Task};
use parking_lot::{Condvar, Mutex};
use std::sync::Arc;
use std::time::{Duration, Instant};

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

/// What a worker asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Want {
    /// A bucket that nobody had, for a worker whose threads all have work.
    Ahead,
    /// Any task, for a worker with an idle thread.
    Idle,
    /// Any task, for a worker without one. It waits until there is one or the frame is done.
    Wait,
}

/// The access of a worker's connection to the buckets of the frame.
pub trait Buckets {
    /// Returns a task to render; `None` when there is none.
    fn take(&self, want: Want) -> Option<Task>;
    /// Says that the worker has begun a task.
    fn begun(&self, task: Task);
    /// Returns the tasks that the worker shall give back if it has not begun them, once each.
    fn revoked(&self) -> Vec<Task>;
    /// Takes back a task that the worker has not begun.
    fn dropped(&self, task: Task);
    /// Says whether the worker is silent. Its tasks are then given to others as well.
    fn suspect(&self, is_silent: bool);
    /// True when the frame needs no more pixels, because all are there or because it is being stopped, or when this
    /// process renders the rest.
    fn is_over(&self) -> bool;
    /// Stores the pixels of a task that was taken, or the reason why the worker has none.
    ///
    /// # Errors
    /// Returns a description of invalid pixels.
    fn put(&self, task: Task, pixels: Result<BucketPixels, String>) -> Result<(), String>;
}

/// Processes that render buckets for this one.
pub trait Workers: Send + Sync {
    /// Starts a frame.
    fn begin(&self);
    /// Returns the number of workers so far. It may grow while a frame is rendered.
    fn count(&self) -> usize;
    /// Returns the time that a frame waits for workers when there is none; `None` when no worker can come.
    fn patience(&self) -> Option<Duration>;
    /// Gives tasks to a worker until none is left. Each worker has a thread that calls this function.
    ///
    /// # Errors
    /// Returns the reason why the worker is lost. Others then render its tasks.
    fn work(&self, worker: usize, buckets: &dyn Buckets) -> Result<(), String>;
    /// Ends the frame.
    fn end(&self);
}

/// The process that this one renders buckets for.
pub trait Coordinator: Send + Sync {
    /// Starts a frame.
    fn begin(&self);
    /// Returns a task; `None` when the frame is over. Called by several threads.
    fn next(&self) -> Option<Task>;
    /// Sends the pixels of a task, or the reason why there are none.
    fn done(&self, task: Task, pixels: Result<&BucketPixels, &str>);
}

/// The largest delay until a stop, or a late bucket, is noticed.
const GLANCE: Duration = Duration::from_millis(50);

/// The buckets of a frame that are not done.
pub(crate) struct Queue {
    state: Mutex<State>,
    changed: Condvar,
    begin: Instant,
}

struct State {
    /// The buckets that no worker had.
    waiting: Turns,
    schedule: Schedule,
}

impl Queue {
    pub(crate) fn new(buckets: usize, priority: Option<&Priority>) -> Self {
        let state = State { waiting: Turns::new(0..buckets, priority), schedule: Schedule::new(buckets) };
        Self { state: Mutex::new(state), changed: Condvar::new(), begin: Instant::now() }
    }

    /// Returns the seconds since the frame began.
    fn now(&self) -> f64 {
        self.begin.elapsed().as_secs_f64()
    }

    /// Adds a worker.
    pub(crate) fn join(&self, worker: usize) {
        self.change(|schedule, _| schedule.join(worker));
    }

    /// Removes a worker.
    pub(crate) fn leave(&self, worker: usize) {
        self.change(|schedule, _| schedule.leave(worker));
    }

    /// Changes the schedule. The second argument of `change` is the time.
    pub(crate) fn change<T>(&self, change: impl FnOnce(&mut Schedule, f64) -> T) -> T {
        let result = change(&mut self.state.lock().schedule, self.now());
        self.changed.notify_all();
        result
    }

    /// Takes a task as [`Buckets::take`] does.
    pub(crate) fn take(
        &self,
        worker: usize,
        want: Want,
        stop: impl Fn() -> bool,
        buckets: &bucket::Buckets,
        priority: Option<&Priority>,
    ) -> Option<Task> {
        let rect = |index: usize| buckets.order.get(index).copied().unwrap_or(PixelRect::at(0, 0, 0, 0));
        let mut state = self.state.lock();
        loop {
            if stop() {
                return None;
            }
            let State { waiting, schedule } = &mut *state;
            let mut next = || waiting.next(buckets, priority);
            if let Some(task) = schedule.take(worker, want != Want::Ahead, self.now(), &mut next, &rect) {
                return Some(task);
            }
            if want != Want::Wait || schedule.is_done() || schedule.is_abandoned() || schedule.is_stuck() {
                return None;
            }
            // A stop of the frame and the passing of time do not notify this condition.
            self.changed.wait_for(&mut state, GLANCE);
        }
    }

    /// True when no bucket is expected from workers any more.
    pub(crate) fn is_over(&self) -> bool {
        let schedule = &self.state.lock().schedule;
        schedule.is_done() || schedule.is_abandoned() || schedule.is_stuck()
    }

    /// True when no worker takes tasks.
    pub(crate) fn is_deserted(&self) -> bool {
        self.state.lock().schedule.workers() == 0
    }

    /// Waits for a change, for a moment.
    pub(crate) fn wait(&self) {
        self.changed.wait_for(&mut self.state.lock(), GLANCE);
    }

    /// Returns the buckets that were not rendered, in order.
    pub(crate) fn left(self) -> Vec<usize> {
        self.state.into_inner().schedule.left()
    }
}

/// The pixels of a bucket of which parts have arrived.
#[derive(Debug, Default)]
pub(crate) struct Assembly {
    pixels: BucketPixels,
}

impl Assembly {
    /// Adds the pixels of a part. `channels` are the channels of each image.
    pub(crate) fn add(
        &mut self,
        bucket: &PixelRect,
        part: &PixelRect,
        channels: impl Iterator<Item = usize>,
        pixels: &BucketPixels,
    ) {
        for (k, (channels, values)) in channels.zip(pixels).enumerate() {
            if self.pixels.len() <= k {
                self.pixels.push(vec![0.0; bucket.width() * bucket.height() * channels]);
            }
            let (row, of_part) = (bucket.width() * channels, part.width() * channels);
            let column = (part.x0 - bucket.x0) as usize * channels;
            for (j, line) in values.chunks_exact(of_part.max(1)).enumerate() {
                let at = ((part.y0 - bucket.y0) as usize + j) * row + column;
                self.pixels[k][at..at + of_part].copy_from_slice(line);
            }
        }
    }

    /// Returns the pixels of the bucket.
    pub(crate) fn into_pixels(self) -> BucketPixels {
        self.pixels
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
