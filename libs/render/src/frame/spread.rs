//! Renders the buckets of a frame in several processes.

use super::bucket::Area;
use super::{Canvas, Frame, FrameShader, Jobs, panic_text};
use crate::PixelRect;
use crate::schedule::{Answer, Task};
use crate::spread::{Assembly, BucketPixels, Buckets, Coordinator, Queue, Want, Workers};
use crate::statistics::add;
use granita_base::{Color, hash};
use parking_lot::Mutex;
use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// The number of threads that the size of buckets is chosen for. It is the same in all processes, so that all make
/// the same buckets.
pub(super) const SHARED_BY: usize = 8;

/// The part of a worker in a frame.
struct Share<'f, 'a, S: FrameShader> {
    frame: &'f Frame<'a, S>,
    canvases: &'f [Mutex<Canvas>],
    queue: &'f Queue,
    done: &'f AtomicU64,
    /// The pixels of buckets of which parts have arrived.
    assemblies: &'f Mutex<HashMap<usize, Assembly>>,
    /// The number of the worker.
    worker: usize,
    /// The factor of colours ("net:tint").
    tint: Option<Color>,
}

impl<S: FrameShader> Share<'_, '_, S> {
    /// Checks that there are all images of all eyes, each with the right number of values.
    fn check(&self, rect: &PixelRect, pixels: &BucketPixels) -> Result<(), String> {
        let counts = self.frame.outputs.images.iter().map(|image| image.channels());
        let expected = counts.map(|channels| rect.width() * rect.height() * channels);
        let eyes = self.frame.eyes.len();
        let right = pixels.len() == self.frame.outputs.images.len() * eyes
            && pixels.iter().zip(expected.cycle()).all(|(values, n)| values.len() == n);
        if right { Ok(()) } else { Err("its buckets have other sizes; it may read another scene".to_owned()) }
    }

    /// Stores the pixels of a task on the canvases when its bucket is complete, and beside them otherwise.
    fn store(&self, task: Task, pixels: &BucketPixels, worth: Answer) {
        let (frame, bucket) = (self.frame, &self.frame.buckets.order[task.bucket]);
        let channels = frame.outputs.images.iter().map(|image| image.channels()).cycle();
        let mut assemblies = self.assemblies.lock();
        if task.part == 0 {
            assemblies.remove(&task.bucket);
        } else {
            assemblies.entry(task.bucket).or_default().add(bucket, &task.rect(bucket), channels, pixels);
        }
        if worth != Answer::Whole {
            return;
        }
        let assembly = assemblies.remove(&task.bucket).map(Assembly::into_pixels);
        drop(assemblies);
        for (canvas, values) in self.canvases.iter().zip(assembly.as_ref().unwrap_or(pixels)) {
            frame.store(canvas, bucket, values);
        }
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        frame.options.progress.done(done);
    }
}

impl<S: FrameShader> Buckets for Share<'_, '_, S> {
    fn take(&self, want: Want) -> Option<Task> {
        let frame = self.frame;
        frame.hear(self.canvases);
        let stop = || frame.is_stopped();
        let task = self.queue.take(self.worker, want, stop, &frame.buckets, frame.priority())?;
        frame.begin(self.canvases, task.bucket);
        Some(task)
    }

    fn begun(&self, task: Task) {
        self.queue.change(|schedule, now| schedule.begun(self.worker, task, now));
    }

    fn revoked(&self) -> Vec<Task> {
        self.queue.change(|schedule, _| schedule.revoked(self.worker))
    }

    fn dropped(&self, task: Task) {
        self.queue.change(|schedule, _| schedule.dropped(self.worker, task));
    }

    fn suspect(&self, is_silent: bool) {
        self.queue.change(|schedule, _| schedule.suspect(self.worker, is_silent));
    }

    fn is_over(&self) -> bool {
        self.frame.is_stopped() || self.queue.is_over()
    }

    fn put(&self, task: Task, pixels: Result<BucketPixels, String>) -> Result<(), String> {
        let bucket = self.frame.buckets.order.get(task.bucket).ok_or("it sent a bucket that there is not")?;
        let mut pixels = match pixels {
            Ok(pixels) => pixels,
            // The bucket is rendered again here, which reports the error.
            Err(_) => {
                self.queue.change(|schedule, _| schedule.fail(self.worker, task));
                return Ok(());
            }
        };
        self.check(&task.rect(bucket), &pixels)?;
        let images = self.frame.outputs.images.iter().cycle();
        if let Some(tint) = self.tint {
            pixels.iter_mut().zip(images).for_each(|(values, image)| image.tint(values, tint));
        }
        let worth = self.queue.change(|schedule, now| schedule.finish(self.worker, task, now));
        match worth.ok_or("it sent a bucket that was not requested")? {
            Answer::Late => (),
            worth => self.store(task, &pixels, worth),
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
        let assemblies = Mutex::default();
        self.options.progress.begin(self.first_image(), total as u64);
        workers.begin();
        let share = |worker| Share {
            frame: self,
            canvases,
            queue: &queue,
            done: &done,
            assemblies: &assemblies,
            worker,
            tint: (tint != 0).then(|| color_of(worker, tint)),
        };
        let work = |worker: usize| {
            let result = workers.work(worker, &share(worker));
            queue.leave(worker);
            if let Err(what) = result {
                self.options.reporter.warning(what);
            }
        };
        std::thread::scope(|scope| {
            let (mut known, mut deserted) = (0, Instant::now());
            // A dump of grids needs all of them in this process.
            while self.options.dump.is_none() && !self.is_stopped() && !queue.is_over() {
                for worker in known..workers.count() {
                    queue.join(worker);
                    scope.spawn(move || work(worker));
                }
                known = known.max(workers.count());
                if !queue.is_deserted() {
                    deserted = Instant::now();
                } else if workers.patience().is_none_or(|patience| deserted.elapsed() >= patience) {
                    break;
                }
                queue.wait();
            }
        });
        workers.end();
        self.options.progress.end();
        let left = queue.left();
        add(&self.counters.buckets, total - left.len());
        left
    }

    /// Renders the tasks that a coordinator requests.
    pub(super) fn serve(&self, coordinator: &dyn Coordinator, jobs: &Jobs<S::Object>, threads: usize) {
        std::thread::scope(|scope| {
            for _ in 0..threads {
                scope.spawn(|| {
                    let mut thread = self.thread();
                    while let Some(task) = coordinator.next() {
                        let Some(bucket) = self.buckets.order.get(task.bucket) else {
                            coordinator.done(task, Err("there is no such bucket"));
                            continue;
                        };
                        let area = Area { index: task.bucket, rect: task.rect(bucket) };
                        if area.rect.is_empty() {
                            coordinator.done(task, Err("there is no such part of the bucket"));
                            continue;
                        }
                        let saves = self.shader.saves();
                        match catch_unwind(AssertUnwindSafe(|| self.bucket(jobs, &area, &mut thread))) {
                            // The process that completes the frame must have the saved data.
                            Ok(_) if self.shader.saves() != saves => {
                                coordinator.done(task, Err("it saves to a spatial database"));
                            }
                            Ok(pixels) => coordinator.done(task, Ok(&pixels)),
                            Err(panic) => {
                                coordinator.done(task, Err(&panic_text(&*panic)));
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
