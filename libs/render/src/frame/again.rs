//! Renders frames whose samples see what they saw before (reference 11).

use super::kept::{Basis, Broken, ImageKey, KeptFrames, ViewKey};
use super::{Frame, FrameShader};
use crate::output::canvas::Canvas;
use crate::output::plan::OutputImage;
use crate::priority::Turns;
use crate::statistics::add;
use granita_base::report::MessageOrder;
use parking_lot::Mutex;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};

impl<S: FrameShader> Frame<'_, S> {
    /// True when the frame must end. Results of shaders after that are not valid.
    pub(super) fn is_stopped(&self) -> bool {
        self.options.stop.load(Ordering::Relaxed)
    }

    /// Returns the properties of the frame that kept grids depend on.
    pub(super) fn basis(&self) -> Basis {
        Basis {
            variables: self.outputs.variables.clone(),
            needs_shading: self.outputs.needs_shading,
            blurs: [self.pattern.blur, self.pattern.defocus],
        }
    }

    /// Returns the properties of the frame that decide what its samples see.
    pub(super) fn view_key(&self) -> ViewKey {
        ViewKey {
            crop: self.options.camera.crop,
            strata: [self.pattern.strata, self.pattern.still_strata],
            margin: self.margin,
            composite: self.composite,
            needs_second_surface: self.outputs.needs_second_surface,
        }
    }

    /// Returns the channels and filters of its images.
    pub(super) fn image_key(&self) -> ImageKey {
        let image = |image: &OutputImage| (image.channels.clone(), image.filter, image.opaque_width);
        ImageKey {
            wanted: self.outputs.wanted.clone(),
            images: self.outputs.images.iter().map(image).collect(),
        }
    }

    /// True when what the samples of all buckets see is kept.
    pub(super) fn is_kept(&self) -> bool {
        self.view.as_ref().is_some_and(|view| view.has_all(&self.buckets.order))
    }

    /// Renders the buckets of a frame whose samples see what they saw before. Returns the buckets that are left, which
    /// are all when something that was needed is lost or hides something else now.
    pub(super) fn again(
        &self,
        kept: &KeptFrames<S::Object>,
        canvases: &[Mutex<Canvas>],
        threads: usize,
        list: Vec<usize>,
    ) -> Vec<usize> {
        let broken: Mutex<Option<Broken>> = Mutex::new(None);
        let turns = Mutex::new(Turns::new(list.iter().copied(), self.priority()));
        let order = MessageOrder::new(self.options.reporter);
        let numbers = AtomicUsize::new(0);
        self.options.progress.begin(self.first_image(), list.len() as u64);
        let next = || {
            self.hear(canvases);
            if self.options.stop.load(Ordering::Relaxed) || broken.lock().is_some() {
                return None;
            }
            let index = turns.lock().next(&self.buckets, self.priority())?;
            Some((index, numbers.fetch_add(1, Ordering::Relaxed)))
        };
        std::thread::scope(|scope| {
            for _ in 0..threads.min(list.len()) {
                scope.spawn(|| {
                    let mut thread = self.thread();
                    while let Some((index, number)) = next() {
                        let _part = order.begin(number);
                        self.begin(canvases, index);
                        let result =
                            catch_unwind(AssertUnwindSafe(|| self.bucket_again(kept, index, &mut thread)));
                        match result {
                            // Shaders ended early, so these pixels are not valid.
                            Ok(_) if self.options.stop.load(Ordering::Relaxed) => break,
                            Ok(Ok(values)) => {
                                for (canvas, values) in canvases.iter().zip(&values) {
                                    self.store(canvas, &self.buckets.order[index], values);
                                }
                            }
                            Ok(Err(why)) => *broken.lock() = Some(why),
                            // The whole frame is rendered, and reports the bucket that fails.
                            Err(_) => {
                                *broken.lock() = Some(Broken::Lost);
                                thread = self.thread();
                            }
                        }
                        self.options.progress.done(number as u64 + 1);
                    }
                });
            }
        });
        add(&self.counters.buckets, list.len());
        self.options.progress.end();
        match broken.into_inner() {
            None => Vec::new(),
            Some(_) => {
                kept.drop_views();
                list
            }
        }
    }
}
