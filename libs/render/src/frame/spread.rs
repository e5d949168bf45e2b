//! Renders the buckets of a frame in several processes.

use super::{Canvas, Frame, FrameShader, Jobs, panic_text};
use crate::PixelRect;
use crate::spread::{BucketPixels, Buckets, Coordinator, Queue, Workers};
use crate::statistics::add;
use granita_base::{Color, hash};
use parking_lot::Mutex;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};

/// The number of threads that the size of buckets is chosen for. It is the same in all processes, so that all make
/// the same buckets.
pub(super) const SHARED_BY: usize = 8;

/// The part of a worker in a frame.
struct Share<'f, 'a, S: FrameShader> {
    frame: &'f Frame<'a, S>,
    canvases: &'f [Mutex<Canvas>],
    queue: &'f Queue,
    done: &'f AtomicU64,
    /// The buckets that were taken and are not done.
    taken: Mutex<Vec<usize>>,
    /// The factor of colours ("net:tint").
    tint: Option<Color>,
}

impl<S: FrameShader> Share<'_, '_, S> {
    /// Checks that a bucket has all images of all eyes, each with the right number of values.
    fn check(&self, rect: &PixelRect, pixels: &BucketPixels) -> Result<(), String> {
        let counts = self.frame.outputs.images.iter().map(|image| image.channels());
        let expected = counts.map(|channels| rect.width() * rect.height() * channels);
        let eyes = self.frame.eyes.len();
        let right = pixels.len() == self.frame.outputs.images.len() * eyes
            && pixels.iter().zip(expected.cycle()).all(|(values, n)| values.len() == n);
        if right { Ok(()) } else { Err("its buckets have other sizes; it may read another scene".to_owned()) }
    }
}

impl<S: FrameShader> Buckets for Share<'_, '_, S> {
    fn take(&self, wait: bool) -> Option<usize> {
        let frame = self.frame;
        frame.hear(self.canvases);
        let stop = || frame.options.stop.load(Ordering::Relaxed);
        let index = self.queue.take(wait, stop, &frame.buckets, frame.priority())?;
        frame.begin(self.canvases, index);
        self.taken.lock().push(index);
        Some(index)
    }

    fn is_over(&self) -> bool {
        self.frame.options.stop.load(Ordering::Relaxed) || self.queue.is_done()
    }

    fn put(&self, index: usize, pixels: Result<BucketPixels, String>) -> Result<(), String> {
        let frame = self.frame;
        let mut taken = self.taken.lock();
        let at = taken.iter().position(|i| *i == index).ok_or("it sent a bucket that was not requested")?;
        let rect = &frame.buckets.order[index];
        if let Ok(pixels) = &pixels {
            self.check(rect, pixels)?;
        }
        taken.swap_remove(at);
        drop(taken);
        match pixels {
            Ok(mut pixels) => {
                let images = frame.outputs.images.iter().cycle();
                for ((canvas, values), image) in self.canvases.iter().zip(&mut pixels).zip(images) {
                    if let Some(tint) = self.tint {
                        image.tint(values, tint);
                    }
                    frame.store(canvas, rect, values);
                }
                self.queue.finish(index, false);
                let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
                frame.options.progress.done(done);
            }
            // The bucket is rendered again here, which reports the error.
            Err(_) => self.queue.finish(index, true),
        }
        Ok(())
    }
}

impl<S: FrameShader> Frame<'_, S> {
    /// Lets workers render all buckets. Returns those that they did not render.
    pub(super) fn spread_over(
        &self,
        workers: &dyn Workers,
        canvases: &[Mutex<Canvas>],
        tint: i32,
    ) -> Vec<usize> {
        let total = self.buckets.order.len();
        let queue = Queue::new(total, self.priority());
        let done = AtomicU64::new(0);
        self.options.progress.begin(self.first_image(), total as u64);
        // A dump of grids needs all of them in this process.
        let count = if self.options.dump.is_some() { 0 } else { workers.begin() };
        std::thread::scope(|scope| {
            for worker in 0..count {
                let share = Share {
                    frame: self,
                    canvases,
                    queue: &queue,
                    done: &done,
                    taken: Mutex::default(),
                    tint: (tint != 0).then(|| color_of(worker, tint)),
                };
                scope.spawn(move || {
                    let result = workers.work(worker, &share);
                    let taken = share.taken.into_inner();
                    share.queue.give_back(&taken);
                    if let Err(what) = result {
                        share.frame.options.reporter.warning(what);
                    }
                });
            }
        });
        workers.end();
        self.options.progress.end();
        let left = queue.left();
        add(&self.counters.buckets, total - left.len());
        left
    }

    /// Renders the buckets that a coordinator requests.
    pub(super) fn serve(&self, coordinator: &dyn Coordinator, jobs: &Jobs<S::Object>, threads: usize) {
        std::thread::scope(|scope| {
            for _ in 0..threads {
                scope.spawn(|| {
                    let mut thread = self.thread();
                    while let Some(index) = coordinator.next() {
                        if index >= self.buckets.order.len() {
                            coordinator.done(index, Err("there is no such bucket"));
                            continue;
                        }
                        let saves = self.shader.saves();
                        match catch_unwind(AssertUnwindSafe(|| self.bucket(jobs, index, &mut thread))) {
                            // The process that completes the frame must have the saved data.
                            Ok(_) if self.shader.saves() != saves => {
                                coordinator.done(index, Err("it saves to a spatial database"));
                            }
                            Ok(pixels) => coordinator.done(index, Ok(&pixels)),
                            Err(panic) => {
                                coordinator.done(index, Err(&panic_text(&*panic)));
                                thread = self.thread();
                            }
                        }
                    }
                });
            }
        });
    }
}

/// Returns the colour of a worker's buckets.
fn color_of(worker: usize, seed: i32) -> Color {
    let channel = |c: u32| hash::unit(hash::words(&[worker as u32, seed.cast_unsigned(), c]));
    Color::new(channel(0), channel(1), channel(2)) * 0.7 + Color::splat(0.3)
}
