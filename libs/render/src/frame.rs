//! Renders one camera's images, from primitives to filtered pixels.

mod again;
mod bias;
mod bucket;
mod cells;
mod clean;
mod coarse;
mod demand;
mod job;
mod kept;
mod larger;
mod levels;
mod limits;
mod measured;
mod passes;
mod precise;
mod refine;
mod running;
mod shade;
mod shader;
mod sighting;
mod spread;
mod summary;

use crate::bucket::{BucketOrder, Buckets};
use crate::environment::Progress;
use crate::output::canvas::{Canvas, Finished};
use crate::output::griddump::GridDump;
use crate::output::halves::{DenoisedError, HalfMeans};
use crate::output::partial::Partial;
use crate::output::plan::{ImagePasses, OutputImage, OutputSet};
use crate::output::writer::Shown;
use crate::passes::PassPlan;
use crate::priority::Priority;
use crate::spread::Spread;
use crate::statistics::{Counters, Statistics, add};
use crate::{CameraView, PixelRect, RenderError};
use granita_base::report::MessageOrder;
use granita_base::{Location, Reporter, Severity, parallel_map};
use granita_dicing::camera::is_moving;
use granita_dicing::{Measure, SceneDicing};
use granita_hider::film;
use granita_hider::{CompositeSettings, Projector, SamplePattern};
use granita_image::{FormatRegistry, Request};
use granita_scene::{Primitive, Scene, attr};
use job::{Job, Sighting};
use kept::KeptView;
use parking_lot::Mutex;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

pub(crate) use demand::{OnDemand, Surroundings};
pub(crate) use granita_scene::Holdout;
pub(crate) use kept::KeptFrames;
pub(crate) use shader::{FrameShader, ObjectTraits};

/// The options of a frame besides its scene and shaders.
pub(crate) struct FrameOptions<'a> {
    /// The camera that is rendered.
    pub(crate) camera: &'a CameraView,
    /// The views of the camera: itself, or its left and right eye. They differ only in position and window.
    pub(crate) eyes: &'a [CameraView],
    /// The first camera, which determines splitting, dicing and shading.
    pub(crate) dicing_camera: &'a CameraView,
    /// The number of threads, at least 1.
    pub(crate) threads: usize,
    pub(crate) reporter: &'a Reporter,
    pub(crate) progress: &'a dyn Progress,
    pub(crate) stop: &'a AtomicBool,
    /// Receives the grids.
    pub(crate) dump: Option<&'a GridDump>,
    /// The formats of images that are too large to be kept. Without it all are kept.
    pub(crate) registry: Option<&'a FormatRegistry>,
    /// Scene files, for messages.
    pub(crate) scene_files: &'a [String],
    /// The processes that render the buckets.
    pub(crate) spread: &'a Spread,
    /// The priority of buckets.
    pub(crate) priority: Option<&'a Priority>,
    /// The largest number of bytes that are kept for re-renders; `None` without a limit.
    pub(crate) memory_bytes: Option<usize>,
    /// Receives the images of a frame that was stopped: those of each eye one after the other, in order of declaration.
    pub(crate) partials: Option<&'a Mutex<Vec<Partial>>>,
    /// The passes whose sum the images are; `None` for a frame of its own.
    pub(crate) passes: Option<PassPlan>,
    /// What measures the errors of images whose noise is removed, when there are any.
    pub(crate) denoising: Option<Denoising<'a>>,
    /// The factor of "shadingquality".
    pub(crate) finer: f32,
}

impl<'a> FrameOptions<'a> {
    /// Returns options for all that a camera sees, in this process alone, with one thread and no other output than
    /// the images.
    pub(crate) fn new(camera: &'a CameraView, reporter: &'a Reporter, stop: &'a AtomicBool) -> Self {
        Self {
            camera,
            eyes: std::slice::from_ref(camera),
            dicing_camera: camera,
            threads: 1,
            reporter,
            progress: &crate::Silent,
            stop,
            dump: None,
            registry: None,
            scene_files: &[],
            spread: &Spread::Alone,
            priority: None,
            memory_bytes: None,
            partials: None,
            passes: None,
            denoising: None,
            finer: 1.0,
        }
    }
}

/// Measures the errors of images of passes whose noise is removed at the end.
#[derive(Clone, Copy)]
pub(crate) struct Denoising<'a> {
    /// Returns the error of an image of an eye without its noise; `None` where it is not known.
    pub(crate) measure: &'a (dyn Fn(usize, &OutputImage, &HalfMeans) -> Option<DenoisedError> + Sync),
    /// The error that ends the passes, over the mean of the image.
    pub(crate) error: Option<f32>,
}

/// One of the views that share the grids of a frame.
struct Eye<'a> {
    camera: &'a CameraView,
    projector: Projector,
}

/// A frame being rendered.
struct Frame<'a, S: FrameShader> {
    options: FrameOptions<'a>,
    shader: &'a S,
    /// The requested outputs of every eye.
    outputs: &'a OutputSet,
    eyes: Vec<Eye<'a>>,
    pattern: SamplePattern,
    /// The filter of each layer of each image.
    filters: Vec<Vec<film::Support>>,
    measure: Measure<'a>,
    composite: CompositeSettings,
    /// The attribute "limits:transparentgrids".
    layers_at_once: usize,
    buckets: Buckets,
    /// The pixels whose samples count: the crop window and the margins of the filters.
    region: PixelRect,
    margin: i32,
    dicing: SceneDicing,
    counters: Counters,
    /// For each bucket of each eye, one eye after the other: whether it has released all of its grids.
    passed: Vec<AtomicBool>,
    /// True when buckets may be rendered again.
    again: bool,
    /// True when buckets must be rendered from the top.
    from_top: bool,
    /// What is kept of the frames of this camera.
    kept: Option<&'a KeptFrames<S::Object>>,
    /// What the samples of this frame see, as far as it is kept.
    view: Option<Arc<KeptView>>,
    /// The passes whose sum the images are.
    passes: Option<levels::Passes>,
}

/// Renders one camera into the pixels of `outputs`, one set for each of its eyes, which request the same images.
/// Returns the statistics, and true when all buckets were rendered.
///
/// # Errors
/// Returns [`RenderError::Stopped`] when `options.stop` was set. The pixels are then not complete. `options.partials`
/// receives them, except when all of them were rendered before, which counts as success.
pub(crate) fn render<S: FrameShader>(
    scene: &Scene,
    shader: &S,
    options: FrameOptions<'_>,
    outputs: &mut [OutputSet],
    kept: Option<&mut KeptFrames<S::Object>>,
) -> Result<(Statistics, bool), RenderError> {
    let begin = Instant::now();
    let (camera, threads) = (options.camera, options.threads.max(1));
    let (progress, stop, registry, partials) =
        (options.progress, options.stop, options.registry, options.partials);
    let (eyes, crop) = (options.eyes, camera.crop);
    let passes = options.passes;
    // What an image with a requested error decides from, it decides from the whole image, for any crop.
    let whole = passes.filter(|plan| plan.error.is_some()).map(|_| (camera.uncropped(), uncropped(eyes)));
    let options = match &whole {
        Some((camera, eyes)) => FrameOptions { camera, eyes, ..options },
        None => options,
    };
    let Some(plan) = outputs.first() else { return Ok((Statistics::default(), true)) };
    let mut order = &*camera.bucketorder;
    let is_large = |image: &OutputImage| eyes.iter().any(|eye| Canvas::is_large(image, eye));
    let from_top = registry.is_some() && passes.is_none() && plan.images.iter().any(is_large);
    if order != "horizontal" && from_top {
        options.reporter.say(
            Severity::Warning,
            &Location::default(),
            format!("\"bucketorder\" \"{order}\": an image of this size is rendered from the top, so that it is written while it is rendered"),
        );
        order = "horizontal";
    }
    let order = BucketOrder { word: order, block: if from_top { 1 } else { camera.bucketblocksize } };
    let sharers = if matches!(options.spread, Spread::Alone) { threads } else { spread::SHARED_BY };
    let bucket = (shared(options.camera, sharers), order);
    let mut frame = Frame::new(scene, shader, options, plan, bucket);
    frame.from_top = from_top;
    let may_keep = !from_top
        && passes.is_none()
        && frame.options.dump.is_none()
        && matches!(frame.options.spread, Spread::Alone);
    if let Some(kept) = kept.filter(|_| may_keep) {
        kept.begin(frame.basis(), frame.options.memory_bytes);
        frame.kept = Some(kept);
        frame.view = kept.view(&frame.view_key());
    }
    if let Spread::For(coordinator) = frame.options.spread {
        coordinator.begin();
        if !camera.crop.is_empty() && frame.options.dump.is_none() {
            let jobs = frame.jobs(scene, threads);
            frame.serve(&**coordinator, &jobs, threads);
        }
        return Ok((frame.counters.statistics(begin.elapsed(), threads), true));
    }
    let canvas = |image: &OutputImage, eye| {
        let canvas = match passes {
            None => Canvas::new(image, eye, &frame.buckets, registry),
            Some(_) => Canvas::of_passes(image, eye, &frame.buckets, registry),
        };
        Mutex::new(match registry.filter(|_| partials.is_some()) {
            Some(registry) => canvas.copying(registry.files(), &image.path),
            None => canvas,
        })
    };
    let canvases: Vec<Mutex<Canvas>> = outputs
        .iter()
        .zip(eyes)
        .flat_map(|(set, eye)| set.images.iter().map(move |image| (image, eye)))
        .map(|(image, eye)| canvas(image, eye))
        .collect();
    if let Some(priority) = frame.options.priority {
        priority.reset();
    }
    frame.complain(&canvases);
    let mut failed = 0;
    let mut passed = None;
    let all: Vec<usize> = (0..frame.buckets.order.len()).collect();
    if let Some(plan) = passes.filter(|_| !crop.is_empty()) {
        if let Spread::Over(workers) = frame.options.spread {
            let text = "the passes of an image are rendered by one process; the others have no part in it";
            frame.options.reporter.warning(text);
            workers.begin();
            workers.end();
        }
        frame.sum_passes(crop, &plan);
        let result = frame.run_passes((scene, &plan), &canvases, threads);
        failed = result.failed;
        passed = Some(result);
    } else if !crop.is_empty() {
        let left = match frame.options.spread {
            Spread::Over(workers) => frame.spread_over(&**workers, &canvases, scene.get(attr::NET_TINT)),
            _ => all,
        };
        let left = match frame.kept.filter(|_| frame.is_kept()) {
            Some(kept) => frame.again(kept, &canvases, threads, left),
            None => left,
        };
        if !left.is_empty() {
            if let Some(kept) = frame.kept {
                frame.view = Some(kept.new_view(frame.view_key()));
            }
            let jobs = frame.jobs(scene, threads);
            progress.begin(frame.first_image(), left.iter().map(|index| jobs.cost(*index)).sum());
            failed = frame.run(&jobs, &canvases, threads, &left);
            progress.end();
        }
        if let Some(kept) = frame.kept {
            kept.sweep();
        }
    }
    let mut statistics = frame.counters.statistics(begin.elapsed(), threads);
    statistics.reuse = frame.kept.map(|kept| {
        kept.fit();
        kept.reuse(frame.shader.changes())
    });
    statistics.passes = passed.as_ref().map(|passed| passed.report.clone());
    let has_picture = passed.as_ref().is_some_and(|passed| passed.report.passes > 0);
    if stop.load(Ordering::Relaxed) && !has_picture {
        let Some(partials) = partials else { return Err(RenderError::Stopped) };
        if !canvases.iter().all(|canvas| canvas.lock().is_whole()) {
            partials.lock().extend(canvases.into_iter().map(|canvas| canvas.into_inner().into_partial()));
            return Err(RenderError::Stopped);
        }
    }
    let images = outputs.iter_mut().flat_map(|set| &mut set.images);
    for (index, (image, canvas)) in images.zip(canvases).enumerate() {
        if let Some(passed) = &mut passed {
            image.passes = Some(ImagePasses {
                count: passed.report.passes,
                coarse: passed.report.coarse,
                finer: passed.report.finer,
                larger: [passed.report.pixel_samples, passed.report.samples],
                error: passed.errors.get(index).copied().flatten(),
                denoised: passed.denoised.get(index).copied().flatten(),
            });
        }
        match canvas.into_inner().finish() {
            Finished::Kept(pixels) => image.pixels = pixels,
            Finished::Written(done) => image.written = Some(done),
            Finished::Shown(viewer, pixels) => {
                (image.shown, image.pixels) = (Shown(Mutex::new(viewer)), pixels);
            }
        }
    }
    Ok((statistics, failed == 0))
}

/// Returns views without their crop windows.
fn uncropped(views: &[CameraView]) -> Vec<CameraView> {
    views.iter().map(CameraView::uncropped).collect()
}

/// Returns the size of buckets in pixels. It is reduced from the requested size so that all threads have work, as
/// in preview mode, where one bucket covers the image. It changes no pixel.
fn shared(camera: &CameraView, threads: usize) -> [u32; 2] {
    let mut size = camera.bucketsize;
    let image = [camera.crop.width(), camera.crop.height()].map(|n| n as u32);
    let buckets = |size: [u32; 2]| image[0].div_ceil(size[0]) as usize * image[1].div_ceil(size[1]) as usize;
    while threads > 1 && buckets(size) < 4 * threads && (size[0] > 32 || size[1] > 32) {
        let longer = usize::from(size[1] > size[0]);
        size[longer] = size[longer].min(image[longer].max(1)).div_ceil(2);
    }
    size
}

impl<'a, S: FrameShader> Frame<'a, S> {
    /// Prepares a frame. `bucket` is the size of buckets and their order.
    fn new(
        scene: &Scene,
        shader: &'a S,
        options: FrameOptions<'a>,
        plan: &'a OutputSet,
        (size, order): ([u32; 2], BucketOrder<'_>),
    ) -> Self {
        let camera = options.camera;
        // Motion is tested in the whole scene and not only in view, because a crop must not change the samples.
        let moving = is_moving(scene, camera);
        let pattern = SamplePattern::new(camera, moving);
        let margin = plan.margin();
        let margin = margin[0].max(margin[1]);
        let filters = |image: &OutputImage| {
            image.layers.iter().map(|layer| film::Support::new(&layer.filter, &pattern.tables)).collect()
        };
        let eye = |camera| Eye { camera, projector: Projector::new(camera, pattern.defocus) };
        let buckets = Buckets::new(&camera.crop, size, order, pattern.per_pixel());
        let mut dicing = SceneDicing::new(scene);
        dicing.finer = options.finer;
        Self {
            shader,
            outputs: plan,
            eyes: options.eyes.iter().map(eye).collect(),
            filters: plan.images.iter().map(filters).collect(),
            measure: Measure::on_raster(options.dicing_camera),
            composite: CompositeSettings {
                opacity_threshold: scene.get(attr::LIMITS_OPACITYTHRESHOLD),
                depth_threshold: scene.get(attr::SHADOW_OPACITYTHRESHOLD),
                layers: usize::try_from(scene.get(attr::LIMITS_TRANSPARENTLAYERS)).ok(),
                depths: plan.wanted.depths,
            },
            layers_at_once: usize::try_from(scene.get(attr::LIMITS_TRANSPARENTGRIDS)).unwrap_or(0),
            passed: (0..options.eyes.len() * buckets.order.len()).map(|_| AtomicBool::new(false)).collect(),
            buckets,
            region: camera.crop.grown(margin),
            margin,
            pattern,
            dicing,
            counters: Counters::default(),
            again: false,
            from_top: false,
            kept: None,
            view: None,
            passes: None,
            options,
        }
    }

    /// Returns the state of a new thread.
    fn thread(&self) -> S::Thread<'a> {
        let shows_colors = self.outputs.needs_shading || self.options.dump.is_some();
        if self.outputs.shows_albedo {
            return self.shader.albedo_thread();
        }
        let mut thread = if shows_colors { self.shader.thread() } else { self.shader.unlit_thread() };
        // The first pass prints and saves.
        if self.passes.as_ref().is_some_and(levels::Passes::is_mute) {
            self.shader.mute(&mut thread, true);
        }
        thread
    }

    /// Returns the file name of the first image.
    fn first_image(&self) -> &Path {
        self.outputs.images.first().map_or(Path::new(""), |image| &image.path)
    }

    /// Builds the primitives that this camera sees, for their bounds, and sorts them into buckets.
    fn jobs(&self, scene: &Scene, threads: usize) -> Jobs<S::Object> {
        let numbered = scene.primitives.iter().enumerate();
        let visible: Vec<(usize, &Arc<Primitive>)> = numbered.filter(|(_, p)| self.is_visible(p)).collect();
        add(&self.counters.primitives, visible.len());
        let order = MessageOrder::new(self.options.reporter);
        let made = parallel_map(
            visible.into_iter().enumerate(),
            threads,
            || None,
            |thread, (turn, (number, primitive))| {
                let _part = order.begin(turn);
                let job = catch_unwind(AssertUnwindSafe(|| self.job(number, primitive, thread)));
                job.unwrap_or_else(|panic| {
                    let (shape, what) = (primitive.shape.call_name(), panic_text(&*panic));
                    let text = format!("a {shape} is left out: building it failed: {what}");
                    self.options.reporter.say(Severity::Error, &primitive.at, text);
                    None
                })
            },
        );
        let list: Vec<Job<S::Object>> = made.into_iter().flatten().collect();
        let mut of_bucket = vec![Vec::new(); self.buckets.order.len()];
        for (index, job) in list.iter().enumerate() {
            for Sighting { rect, .. } in &job.seen {
                for bucket in self.buckets.touching(&rect.grown(self.margin)) {
                    let here: &mut Vec<usize> = &mut of_bucket[bucket as usize];
                    if here.last() != Some(&index) {
                        here.push(index);
                    }
                }
            }
        }
        Jobs { list, of_bucket }
    }

    /// True when this camera's geometry set, or "camera", contains the primitive (reference 4.4.3).
    fn is_visible(&self, primitive: &Primitive) -> bool {
        let name = &self.options.camera.name;
        let sets = &primitive.attributes.geometry_sets;
        sets.iter().any(|set| set == name || &**set == "camera")
    }

    /// Returns the priority, where the order is free.
    fn priority(&self) -> Option<&Priority> {
        self.options.priority.filter(|_| !self.from_top)
    }

    /// Applies the requests of the viewers of the images.
    fn hear(&self, canvases: &[Mutex<Canvas>]) {
        for canvas in canvases {
            let requests = canvas.lock().requests();
            for request in requests {
                let crop = &self.options.camera.crop;
                match (request, self.options.priority) {
                    (Request::Abort, _) => self.options.stop.store(true, Ordering::Relaxed),
                    (Request::Center { x, y }, Some(priority)) => {
                        priority.center(x.saturating_add(crop.x0), y.saturating_add(crop.y0));
                    }
                    (Request::Priority(rect), Some(priority)) => {
                        priority.rectangle(rect.moved(crop.x0, crop.y0));
                    }
                    (_, None) => (),
                }
            }
        }
    }

    /// Reports to the viewers of the images that a bucket is started.
    fn begin(&self, canvases: &[Mutex<Canvas>], index: usize) {
        canvases.iter().for_each(|canvas| canvas.lock().begin(&self.buckets.order[index]));
    }

    /// Stores the pixels of a bucket.
    fn store(&self, canvas: &Mutex<Canvas>, rect: &PixelRect, values: &[f32]) {
        let mut canvas = canvas.lock();
        canvas.store(rect, values);
        let trouble = canvas.trouble();
        drop(canvas);
        self.complain_of(trouble);
    }

    /// Reports errors of viewers. Rendering continues without them.
    fn complain(&self, canvases: &[Mutex<Canvas>]) {
        for canvas in canvases {
            let trouble = canvas.lock().trouble();
            self.complain_of(trouble);
        }
    }

    fn complain_of(&self, trouble: Option<String>) {
        if let Some(what) = trouble {
            let text = format!("the image is not shown any more: {what}");
            self.options.reporter.once(&text.clone(), Severity::Warning, &Location::default(), text);
        }
    }

    /// Reports the bucket that failed, and the command that renders only that one.
    fn report_panic(&self, index: usize, what: &str) {
        let bucket = self.buckets.order[index];
        let [width, height] = self.options.camera.resolution.map(f64::from);
        let crop = [
            f64::from(bucket.x0) / width,
            f64::from(bucket.x1) / width,
            f64::from(bucket.y0) / height,
            f64::from(bucket.y1) / height,
        ];
        let crop = crop.map(|c| c.to_string()).join(" ");
        self.options.reporter.say(
            Severity::Error,
            &Location::default(),
            format!(
                "bucket x {}..{} y {}..{} of camera \"{}\" is left black: {what}; to render it alone: gelato -crop {crop} {}",
                bucket.x0,
                bucket.x1,
                bucket.y0,
                bucket.y1,
                self.options.camera.name,
                self.options.scene_files.join(" ")
            ),
        );
    }
}

/// The primitives of a frame.
struct Jobs<O> {
    list: Vec<Job<O>>,
    /// Indices into `list` of the primitives that a bucket may see.
    of_bucket: Vec<Vec<usize>>,
}

impl<O> Jobs<O> {
    /// Returns the number of progress steps of a bucket, which estimates its cost. An empty one takes nearly no
    /// time.
    fn cost(&self, index: usize) -> u64 {
        1 + 4 * self.of_bucket.get(index).map_or(0, |jobs| jobs.len().min(16)) as u64
    }
}

/// Returns the text of a panic.
fn panic_text(panic: &(dyn std::any::Any + Send)) -> String {
    panic
        .downcast_ref::<&str>()
        .map(|s| (*s).to_owned())
        .or_else(|| panic.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "an internal error without a message".to_owned())
}

#[cfg(test)]
mod tests;
