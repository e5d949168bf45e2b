//! Renders frames whose samples see what they saw before (reference 11).

use super::kept::{Basis, ImageKey, KeptFrames, ViewKey};
use super::running::BucketWork;
use super::{Frame, FrameShader};
use crate::output::canvas::Canvas;
use crate::output::plan::OutputImage;
use parking_lot::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

impl<'a, S: FrameShader> Frame<'a, S> {
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
        let image = |image: &OutputImage| (image.layers.clone(), image.opaque_width);
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
        let broken = AtomicBool::new(false);
        let make = |index: usize, thread: &mut S::Thread<'a>| {
            let made = self.bucket_again(kept, index, thread).ok();
            broken.fetch_or(made.is_none(), Ordering::Relaxed);
            made
        };
        // The whole frame is rendered then, and reports the bucket that fails.
        let fails = |_, _: &str| broken.store(true, Ordering::Relaxed);
        self.options.progress.begin(self.first_image(), list.len() as u64);
        self.each_bucket(canvases, threads, &list, &BucketWork { make: &make, fails: &fails, cost: &|_| 1 });
        self.options.progress.end();
        if broken.into_inner() && !self.is_stopped() {
            kept.drop_views_but(None);
            canvases.iter().for_each(|canvas| canvas.lock().restart());
            return list;
        }
        Vec::new()
    }
}
