//! Makes the buckets of a frame by all threads.

use super::{Frame, FrameShader, Jobs, panic_text};
use crate::output::canvas::Canvas;
use crate::priority::Turns;
use crate::statistics::{BucketTimes, add};
use granita_base::report::MessageOrder;
use parking_lot::Mutex;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::time::Instant;

/// The pixels of a bucket, image by image.
pub(super) type BucketPixels = Vec<Vec<f32>>;

/// How the buckets of a frame are made. `T` is the state of a thread.
pub(super) struct BucketWork<'w, T> {
    /// Returns the pixels of every image; `None` to end the frame.
    pub(super) make: &'w (dyn Fn(usize, &mut T) -> Option<BucketPixels> + Sync),
    /// Receives a bucket that failed, and the reason.
    pub(super) fails: &'w (dyn Fn(usize, &str) + Sync),
    /// Returns the number of progress steps of a bucket.
    pub(super) cost: &'w (dyn Fn(usize) -> u64 + Sync),
}

impl<'a, S: FrameShader> Frame<'a, S> {
    /// Renders buckets and returns the number of those that failed. The others are on the canvases, those of an eye
    /// one after the other.
    pub(super) fn run(
        &self,
        jobs: &Jobs<S::Object>,
        canvases: &[Mutex<Canvas>],
        threads: usize,
        list: &[usize],
    ) -> usize {
        let failed = AtomicUsize::new(0);
        let make =
            |index: usize, thread: &mut S::Thread<'a>| Some(self.bucket(jobs, &self.whole(index), thread));
        let fails = |index: usize, what: &str| {
            failed.fetch_add(1, Ordering::Relaxed);
            self.report_panic(index, what);
        };
        self.each_bucket(
            canvases,
            threads,
            list,
            &BucketWork { make: &make, fails: &fails, cost: &|k| jobs.cost(k) },
        );
        failed.into_inner()
    }

    /// Makes buckets in their order by all threads, and stores them on the canvases. It ends early when the frame must
    /// end, or when a bucket cannot be made.
    pub(super) fn each_bucket(
        &self,
        canvases: &[Mutex<Canvas>],
        threads: usize,
        list: &[usize],
        work: &BucketWork<'_, S::Thread<'a>>,
    ) {
        let (done, ends) = (AtomicU64::new(0), AtomicBool::new(false));
        let turns = Mutex::new((Turns::new(list.iter().copied(), self.priority()), 0_usize..));
        let order = MessageOrder::new(self.options.reporter);
        let next = || {
            self.hear(canvases);
            if self.is_stopped() || ends.load(Ordering::Relaxed) {
                return None;
            }
            let (turns, numbers) = &mut *turns.lock();
            turns.next(&self.buckets, self.priority()).zip(numbers.next())
        };
        *self.counters.bucket_times.lock() = BucketTimes::default();
        let first = Instant::now();
        std::thread::scope(|scope| {
            for _ in 0..threads.min(list.len()) {
                scope.spawn(|| {
                    let mut thread = self.thread();
                    while let Some((index, number)) = next() {
                        let _part = order.begin(number);
                        self.begin(canvases, index);
                        let begin = Instant::now();
                        let result = catch_unwind(AssertUnwindSafe(|| (work.make)(index, &mut thread)));
                        match result {
                            // Shaders ended early, so these pixels are not valid.
                            Ok(_) if self.is_stopped() => break,
                            Ok(Some(values)) => {
                                for (k, (canvas, values)) in canvases.iter().zip(values).enumerate() {
                                    let rect = self.buckets.order[index];
                                    match &self.passes {
                                        None => self.store(canvas, &rect, &values),
                                        Some(passes) => self.hold((passes, k), canvas, rect, values),
                                    }
                                }
                            }
                            Ok(None) => ends.store(true, Ordering::Relaxed),
                            Err(panic) => {
                                (work.fails)(index, &panic_text(&*panic));
                                // Its state is inconsistent after a panic.
                                thread = self.thread();
                            }
                        }
                        self.counters.bucket_times.lock().of_buckets.push((number, begin.elapsed()));
                        let cost = (work.cost)(index);
                        self.options.progress.done(done.fetch_add(cost, Ordering::Relaxed) + cost);
                    }
                });
            }
        });
        self.counters.bucket_times.lock().all = first.elapsed();
        add(&self.counters.buckets, list.len());
    }
}
