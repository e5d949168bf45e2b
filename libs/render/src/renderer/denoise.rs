//! Removes the noise of images with a library, which gets the albedo and the normal of surfaces beside the colours.
//!
//! Both come from a frame of their own, in which surfaces are lit by white light and no rays are traced. It has the
//! samples of the first pass, so that what is blurred by motion or out of focus is blurred there as well.

use crate::frame::{self, FrameOptions};
use crate::output::halves::{DenoisedError, DenoisedSum, HalfMeans};
use crate::output::plan::{FEATURES, OutputImage, OutputSet};
use crate::passes::PassPlan;
use crate::statistics::Denoised;
use crate::{CameraView, PixelRect, RenderEnvironment, RenderError};
use granita_base::{Reporter, Vec3};
use granita_dicing::camera::is_moving;
use granita_image::{Denoiser, NoisyImage};
use granita_scene::{Scene, attr};
use granita_shading::ShadingContext;
use parking_lot::Mutex;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Returns the factor of "shadingquality" of what cameras see. The points of a surface share their colours with the
/// pixels around them. At twice as many along each side, the noise of pixels is independent.
pub(super) fn finer(scene: &Scene) -> f32 {
    if scene.get(attr::RENDER_DENOISE) == 1 { 2.0 } else { 1.0 }
}

/// The albedo and the normals of the pixels that an eye sees, with three values for each pixel.
struct Features {
    albedo: Vec<f32>,
    normal: Vec<f32>,
}

/// The denoiser of the images of a camera.
pub(super) struct CameraDenoiser {
    library: Arc<dyn Denoiser>,
    /// The pixels of the images.
    crop: PixelRect,
    /// One for each eye.
    features: Vec<Features>,
    /// True when the features have noise.
    is_blurred: bool,
    threads: usize,
    /// The time of the library so far.
    spent: Mutex<Duration>,
    done: Denoised,
}

impl CameraDenoiser {
    /// Renders the features of the images of a camera. `outputs` are those of each eye. Returns `None` when none of
    /// them is denoised.
    ///
    /// # Errors
    /// Returns [`RenderError::Stopped`] when the frame was stopped.
    pub(super) fn new(
        environment: &RenderEnvironment,
        (scene, shading): (&Scene, &ShadingContext),
        (view, dicing_view): (&CameraView, &CameraView),
        eyes: &[CameraView],
        outputs: &mut [OutputSet],
        threads: usize,
    ) -> Result<Option<Self>, RenderError> {
        let Some(library) = environment.denoiser.clone() else { return Ok(None) };
        let selected: Vec<bool> = outputs.iter_mut().map(OutputSet::select_denoised).collect();
        if !selected.contains(&true) {
            return Ok(None);
        }
        let begin = Instant::now();
        let mut sets: Vec<OutputSet> = outputs.iter().map(|_| OutputSet::features()).collect();
        let silent = Reporter::silent();
        let options = FrameOptions {
            eyes,
            dicing_camera: dicing_view,
            threads,
            finer: finer(scene),
            ..FrameOptions::new(view, &silent, &environment.stop)
        };
        frame::render(scene, shading, options, &mut sets, None)?;
        let features = sets.iter_mut().flat_map(|set| &mut set.images).map(|image| {
            let pixels = std::mem::take(&mut image.pixels);
            let of_pixels = pixels.as_chunks::<FEATURES>().0;
            let albedo = of_pixels.iter().flat_map(|pixel| [0, 1, 2].map(|c| tame(pixel[c], 0.0, 1.0)));
            // Shaders see normals of any length.
            let normal = of_pixels
                .iter()
                .flat_map(|pixel| Vec3::new(pixel[3], pixel[4], pixel[5]).normalize_or_zero().to_array());
            Features { albedo: albedo.collect(), normal: normal.collect() }
        });
        let features = features.collect();
        let done =
            Denoised { library: library.name().to_owned(), features: begin.elapsed(), ..Denoised::default() };
        let is_blurred = is_moving(scene, view) || view.has_depth_of_field();
        Ok(Some(Self {
            library,
            crop: view.crop,
            features,
            is_blurred,
            threads,
            spent: Mutex::default(),
            done,
        }))
    }

    /// Returns the plan of passes that end early enough to be denoised in time. The time is measured with the albedo.
    pub(super) fn in_time(&self, plan: PassPlan, outputs: &[OutputSet]) -> PassPlan {
        let Some(deadline) = plan.deadline else { return plan };
        let begin = Instant::now();
        let Some(features) = self.features.first() else { return plan };
        // An error is reported when images are denoised.
        drop(self.filter(features, &features.albedo));
        let images = outputs.iter().flat_map(|set| &set.images).filter(|image| image.is_denoised);
        let count: usize = images.map(|image| image.denoisable().len()).sum();
        let time = begin.elapsed() * u32::try_from(count).unwrap_or(1);
        PassPlan { deadline: deadline.checked_sub(time).or(Some(deadline)), ..plan }
    }

    /// Returns the error that an image of an eye has without its noise, from halves of its passes; `None` where it is
    /// not known. An error of the library is reported when images are denoised.
    pub(super) fn measure(
        &self,
        eye: usize,
        image: &OutputImage,
        halves: &HalfMeans,
    ) -> Option<DenoisedError> {
        let features = self.features.get(eye)?;
        let mut sum = DenoisedSum::default();
        for first in image.denoisable() {
            let noisy =
                halves.colors(first)?.map(|color| color.into_iter().map(finite).collect::<Vec<f32>>());
            let [a, b] = &noisy;
            sum.add(halves, &noisy, &[self.filter(features, a).ok()?, self.filter(features, b).ok()?]);
        }
        sum.error()
    }

    /// Removes the noise of all images. Those that have a requested error only with their noise keep it. Returns what
    /// was done.
    ///
    /// # Errors
    /// Returns the message of the library. Images that were not denoised keep their noise.
    pub(super) fn apply(
        mut self,
        outputs: &mut [OutputSet],
        requested: Option<f32>,
    ) -> Result<Denoised, String> {
        for (set, features) in outputs.iter_mut().zip(&self.features) {
            for image in set.images.iter_mut().filter(|image| image.is_denoised) {
                let passes = image.passes.as_ref();
                let found = passes.and_then(|passes| passes.denoised);
                let noisy = passes.and_then(|passes| passes.error);
                let keeps = |(found, most): (DenoisedError, f32)| found.is_worse_than(noisy, most);
                let largest = match found.zip(requested).is_some_and(keeps) {
                    true => &mut self.done.rejected,
                    false => {
                        self.denoise(image, features)?;
                        &mut self.done.error
                    }
                };
                let errors = largest.take().into_iter().chain(found);
                *largest = errors.max_by(|a, b| a.error.total_cmp(&b.error));
            }
        }
        self.done.filter = self.spent.into_inner();
        Ok(self.done)
    }

    fn denoise(&self, image: &mut OutputImage, features: &Features) -> Result<(), String> {
        let channels = image.channels();
        if image.pixels.is_empty() || channels == 0 {
            return Ok(());
        }
        for first in image.denoisable() {
            let pixels = image.pixels.chunks_exact(channels);
            let color: Vec<f32> =
                pixels.flat_map(|pixel| [0, 1, 2].map(|c| finite(pixel[first + c]))).collect();
            let clean = self.filter(features, &color)?;
            let pixels = image.pixels.chunks_exact_mut(channels);
            pixels.zip(clean.as_chunks::<3>().0).for_each(|(to, from)| {
                to[first..first + 3].copy_from_slice(from);
            });
        }
        image.denoised_by = Some(self.done.library.clone());
        Ok(())
    }

    fn filter(&self, features: &Features, color: &[f32]) -> Result<Vec<f32>, String> {
        let begin = Instant::now();
        let [width, height] = [self.crop.width(), self.crop.height()];
        let clean = self.library.denoise(&NoisyImage {
            width,
            height,
            color,
            albedo: &features.albedo,
            normal: &features.normal,
            has_noisy_features: self.is_blurred,
            threads: self.threads,
        });
        *self.spent.lock() += begin.elapsed();
        clean
    }
}

/// Returns a finite value, which is 0 for one that is not a number.
fn finite(value: f32) -> f32 {
    tame(value, f32::MIN, f32::MAX)
}

/// Returns a value within limits, and 0 for one that is not a number.
fn tame(value: f32, least: f32, most: f32) -> f32 {
    if value.is_nan() { 0.0 } else { value.clamp(least, most) }
}
