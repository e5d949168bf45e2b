//! The entry point of this crate, which renders a scene to image files.

mod denoise;
mod shader;

use crate::dynamic::DynamicMaps;
use crate::environment::RenderEnvironment;
use crate::frame::{self, Denoising, FrameOptions, KeptFrames};
use crate::output::gather::gather_parts;
use crate::output::griddump::GridDump;
use crate::output::halves::HalfMeans;
use crate::output::partial::Partial;
use crate::output::plan::{OutputImage, OutputSet, WrittenFiles, is_dynamic};
use crate::output::writer::ImageWriter;
use crate::passes::{PassPlan, PassReport, percent};
use crate::spread::Spread;
use crate::statistics::Denoised;
use crate::{CameraView, PixelRect, RenderError, ShadingStatistics, Statistics, nearby, preview, unknown};
use denoise::CameraDenoiser;
use granita_base::{Location, Severity, Vec3};
use granita_scene::{Output, Scene, attr};
use granita_shading::{ObjectState, ShadingContext};
use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Renders scenes. It keeps nothing of a scene after its frame is done.
#[derive(Clone, Debug)]
pub struct Renderer {
    pub(crate) environment: RenderEnvironment,
}

/// The results of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameReport {
    /// The written files, in order of declaration. For a stereo camera the left one is before the right.
    pub images: Vec<PathBuf>,
    /// The written spatial databases, by name.
    pub databases: Vec<PathBuf>,
    /// True when every pixel was rendered and every image and database was written.
    pub complete: bool,
    /// The statistics of each camera that has images, by its name.
    pub statistics: Vec<(Arc<str>, Statistics)>,
    /// The statistics of shading, for all cameras together.
    pub shading: ShadingStatistics,
}

impl Renderer {
    /// Returns a renderer with these inputs.
    pub fn new(environment: RenderEnvironment) -> Self {
        Self { environment }
    }

    /// Renders the images of `camera`, or of all cameras that have any.
    ///
    /// An error in one image or one bucket is reported and does not affect the others. See [`FrameReport::complete`].
    ///
    /// # Errors
    /// Returns [`RenderError::Misuse`] when there is no camera (of that name), [`RenderError::Limit`] for images that
    /// are too large, and [`RenderError::Stopped`] when the frame was stopped.
    pub fn render(&self, scene: &Arc<Scene>, camera: Option<&str>) -> Result<FrameReport, RenderError> {
        let mut frame = FrameInProgress::begin(self, scene, camera)?;
        frame.render_cameras(camera)?;
        Ok(frame.finish().0)
    }

    /// Renders as [`Renderer::render`], with what an earlier call kept, and keeps what a later one may use. The pixels
    /// are those of [`Renderer::render`], to the bit.
    ///
    /// # Errors
    /// Returns the errors of [`Renderer::render`].
    pub fn rerender(
        &self,
        scene: &Arc<Scene>,
        camera: Option<&str>,
        kept: &mut Kept,
    ) -> Result<FrameReport, RenderError> {
        let mut frame = FrameInProgress::begin(self, scene, camera)?;
        frame.kept = Some(
            kept.0
                .take()
                .and_then(|kept| kept.renewed(&frame))
                .unwrap_or_else(|| Box::new(KeptFrame::new(&frame))),
        );
        frame.shading = frame.kept.as_mut().and_then(|kept| kept.shading.take());
        let built = frame.shading.as_ref().map(ShadingContext::built_for_rays);
        if let Err(error) = frame.render_cameras(camera) {
            // What was built for rays while shaders ended early is not valid.
            let same = frame.shading.as_ref().map(ShadingContext::built_for_rays) == built;
            kept.0 = if same { frame.into_kept() } else { None };
            return Err(error);
        }
        let (report, frame) = frame.finish();
        kept.0 = frame;
        Ok(report)
    }

    /// Returns the file names of images that cannot be written, and reports each. `files` holds the files of earlier
    /// images.
    fn refused(&self, eyes: &[CameraView], outputs: &[OutputSet], files: &mut WrittenFiles) -> Vec<PathBuf> {
        let Self { environment } = self;
        let mut refused = Vec::new();
        for (eye, set) in eyes.iter().zip(outputs) {
            for image in &set.images {
                if let Some(other) = files.taken_by(image) {
                    environment.reporter.error(format!(
                        "output \"{}\": it is the file of output \"{}\" already; two outputs need two files",
                        image.path.display(),
                        other.display()
                    ));
                    refused.push(image.path.clone());
                } else if let Err(error) = image.check(eye, &environment.registry) {
                    environment.reporter.error(format!("output \"{}\": {error}", image.path.display()));
                    refused.push(image.path.clone());
                }
            }
        }
        refused
    }

    /// Starts the dump of "griddump:filename".
    fn dump(&self, scene: &Scene, camera: &CameraView) -> Option<GridDump> {
        let path = scene.get(attr::GRIDDUMP_FILENAME);
        if path.is_empty() {
            return None;
        }
        let report =
            |error: &RenderError| self.environment.reporter.error(format!("\"griddump:filename\": {error}"));
        let files = self.environment.variables.files();
        let path = Path::new(&*path);
        files.check_create(path).map_err(RenderError::from).inspect_err(report).ok()?;
        let binary = scene.get(attr::GRIDDUMP_BINARY);
        GridDump::new(path, files, binary, self.environment.call_text, camera).inspect_err(report).ok()
    }

    /// Writes a dump of a frame that is `complete`. Returns false when that failed.
    fn finish_dump(&self, dump: GridDump, complete: bool) -> bool {
        let reporter = &self.environment.reporter;
        if !complete {
            reporter.warning("\"griddump:filename\": the frame is not complete; its grids are not written");
            return false;
        }
        match dump.finish() {
            Ok(()) => true,
            Err(error) => {
                reporter.error(format!("\"griddump:filename\": {error}"));
                false
            }
        }
    }

    /// Writes the partial images of a frame that was stopped, and reports them. `partials` holds the images of one eye
    /// after those of the other.
    fn keep(&self, eyes: &[CameraView], outputs: &[OutputSet], refused: &[PathBuf], partials: Vec<Partial>) {
        let Self { environment } = self;
        let images = eyes.iter().zip(outputs).flat_map(|(eye, set)| set.images.iter().map(move |i| (eye, i)));
        for ((eye, image), partial) in images.zip(partials) {
            if refused.iter().any(|path| path.as_os_str() == image.path.as_os_str()) {
                continue;
            }
            let (percent, path) = (partial.percent(), image.path.display());
            match partial.write(image, eye, &environment.registry) {
                Ok(None) => (),
                Ok(Some(file)) => environment.reporter.warning(format!(
                    "output \"{path}\": the frame was ended early; \"{}\" keeps the {percent} % of the pixels that were \
                     rendered",
                    file.display()
                )),
                Err(error) => {
                    environment.reporter.error(format!("output \"{path}\": its partial image is not kept: {error}"));
                }
            }
        }
    }

    /// Returns the cameras, with the crop window of the environment.
    pub(crate) fn views(&self, scene: &Scene) -> Vec<CameraView> {
        let reporter = &self.environment.reporter;
        let view = |camera| CameraView::new(camera, reporter).at_earliest(scene);
        let mut views: Vec<CameraView> = scene.cameras.iter().map(view).collect();
        if let Some(crop) = self.environment.crop {
            for view in &mut views {
                view.crop = CameraView::crop_pixels(crop, view.resolution);
            }
        }
        views
    }
}

/// The state of a call of [`Renderer::render`]. It holds the data that the cameras share and the results so far.
struct FrameInProgress<'r> {
    renderer: &'r Renderer,
    scene: Arc<Scene>,
    views: Vec<CameraView>,
    /// The view for dicing and shading. It is that of the first camera, whichever camera is rendered (reference 7.7).
    shading_view: CameraView,
    threads: usize,
    /// True when the buckets are rendered for a coordinator, which writes the images.
    is_worker: bool,
    /// The files of the images so far.
    files: WrittenFiles,
    /// The viewers of images that are complete.
    viewers: Vec<ImageWriter>,
    /// The context of shading, which is made for the first camera that is rendered. All cameras share what it builds.
    shading: Option<ShadingContext>,
    /// What is kept of the frames of its cameras, for a frame that may be rendered again.
    kept: Option<Box<KeptFrame>>,
    report: FrameReport,
}

/// What the frames of a scene in re-rendering mode keep for the next one.
#[derive(Default)]
pub struct Kept(Option<Box<KeptFrame>>);

impl std::fmt::Debug for Kept {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Kept").field(&self.0.is_some()).finish()
    }
}

/// The data of [`Kept`].
struct KeptFrame {
    /// The cameras of the frame.
    views: Vec<CameraView>,
    shading: Option<ShadingContext>,
    /// By the name of the camera.
    cameras: BTreeMap<Arc<str>, KeptFrames<ObjectState>>,
}

impl KeptFrame {
    fn new(frame: &FrameInProgress<'_>) -> Self {
        Self { views: frame.views.clone(), shading: None, cameras: BTreeMap::new() }
    }

    /// Prepares what was kept for a frame. Returns `None` when the frame cannot use it.
    fn renewed(mut self: Box<Self>, frame: &FrameInProgress<'_>) -> Option<Box<Self>> {
        let environment = &frame.renderer.environment;
        if frame.is_worker || !matches!(environment.spread, Spread::Alone) {
            return None;
        }
        let same = |(a, b): (&CameraView, &CameraView)| a.differs_in_quality_only(b);
        if self.views.len() != frame.views.len() || !self.views.iter().zip(&frame.views).all(same) {
            return None;
        }
        // The first camera decides how finely surfaces are diced for all cameras, for rays and for maps on demand, and
        // more coarsely where they are out of focus.
        let defocus = |views: &[CameraView]| views.first().map(CameraView::has_depth_of_field);
        if defocus(&self.views) != defocus(&frame.views) {
            return None;
        }
        self.views.clone_from(&frame.views);
        let shading = self.shading.as_mut()?;
        shading.renew(&frame.scene, &environment.shading()).then_some(self)
    }
}

impl<'r> FrameInProgress<'r> {
    /// Prepares the scene.
    fn begin(renderer: &'r Renderer, scene: &Arc<Scene>, camera: Option<&str>) -> Result<Self, RenderError> {
        let environment = &renderer.environment;
        let reporter = &environment.reporter;
        let views = renderer.views(scene);
        let origin = views.first().map_or(Vec3::ZERO, nearby::common_origin);
        let scene = &nearby::moved(scene, origin, &*environment.shaders);
        let views: Vec<CameraView> = views.into_iter().map(|view| view.nearby(origin)).collect();
        let misuse = |what: String| RenderError::Misuse { what };
        let first = views.first().ok_or_else(|| misuse("the scene has no camera".to_owned()))?;
        let shading_view = first.shading_view();
        if let Some(name) = camera
            && !views.iter().any(|v| &*v.name == name)
        {
            return Err(misuse(format!("the scene has no camera \"{name}\"")));
        }
        let threads = match environment.threads {
            0 => usize::try_from(scene.get(attr::LIMITS_THREADS)).unwrap_or(1).max(1),
            n => n,
        };
        environment.databases.begin();
        let is_worker = matches!(environment.spread, Spread::For(_));
        let scene = preview::simplified(scene, &shading_view, reporter);
        if !is_worker {
            unknown::report(&scene, &*environment.shaders, reporter);
        }
        Ok(Self {
            renderer,
            scene,
            views,
            shading_view,
            threads,
            is_worker,
            files: WrittenFiles::default(),
            viewers: Vec::new(),
            shading: None,
            kept: None,
            report: FrameReport { complete: true, ..FrameReport::default() },
        })
    }

    /// Renders the images of `camera`, or of all cameras that have any.
    fn render_cameras(&mut self, camera: Option<&str>) -> Result<(), RenderError> {
        let views = self.views.clone();
        let scene = self.scene.clone();
        let has_images =
            |view: &CameraView| scene.outputs.iter().any(|o| o.camera == view.name && !is_dynamic(o));
        let chosen: Vec<&CameraView> =
            views.iter().filter(|v| camera.is_none_or(|name| &*v.name == name)).collect();
        let mut left = chosen.iter().filter(|view| has_images(view)).count();
        for view in chosen {
            let plan = self.renderer.environment.passes.filter(|_| !self.is_worker);
            let frames = u32::try_from(left).unwrap_or(u32::MAX);
            self.render_camera(view, plan.map(|plan| plan.shared_by(frames)))?;
            left -= usize::from(has_images(view));
        }
        Ok(())
    }

    /// Returns what the frame keeps.
    fn into_kept(self) -> Option<Box<KeptFrame>> {
        let Self { shading, kept, .. } = self;
        kept.map(|kept| Box::new(KeptFrame { shading, ..*kept }))
    }

    /// Renders and writes the images of a camera, if it has any.
    fn render_camera(&mut self, view: &CameraView, passes: Option<PassPlan>) -> Result<(), RenderError> {
        let environment = &self.renderer.environment;
        let reporter = &environment.reporter;
        let own = |o: &&Output| o.camera == view.name && !is_dynamic(o);
        let outputs: Vec<&Output> =
            self.scene.outputs.iter().filter(own).filter(|o| !self.is_taken(o)).collect();
        let mut plan = OutputSet::new(&outputs, view, &environment.registry, reporter)?;
        plan.set_scene(&self.scene);
        // A worker has the same images, without another message.
        let left_out = if passes.is_none() { plan.leave_out_errors() } else { Vec::new() };
        for path in left_out.iter().filter(|_| !self.is_worker) {
            reporter.error(format!(
                "output \"{}\": it is left out, because \"error\" is known of passes alone; request \
                 \"render:passes\" (-passes), \"render:error\" (-error) or \"render:seconds\" (-seconds)",
                path.display()
            ));
            self.report.complete = false;
        }
        if plan.images.is_empty() {
            return Ok(());
        }
        if view.crop.is_empty() {
            reporter.error(format!("camera \"{}\": its crop window holds no pixel", view.name));
            self.report.complete = false;
            return Ok(());
        }
        let eyes = view.eyes().map_or_else(|| vec![view.clone()], Vec::from);
        let mut outputs = match &eyes[..] {
            [_] => vec![plan],
            _ => plan.for_eyes(reporter),
        };
        gather_parts(&mut outputs, &eyes, &environment.registry)?;
        let refused = match self.is_worker {
            true => Vec::new(),
            false => self.renderer.refused(&eyes, &outputs, &mut self.files),
        };
        self.report.complete &= refused.is_empty();
        if refused.len() == eyes.len() * outputs[0].images.len() {
            return Ok(());
        }
        // Of several cameras, the first one that is rendered writes the dump.
        let is_first = self.report.statistics.is_empty();
        let dump = if is_first { self.renderer.dump(&self.scene, &self.views[0]) } else { None };
        self.begin_shading()?;
        let Some(shading) = &self.shading else { return Ok(()) };
        let denoiser = match self.is_worker || self.kept.is_some() {
            true => None,
            false => {
                let (scene, views) = ((&*self.scene, shading), (view, &self.shading_view));
                CameraDenoiser::new(environment, scene, views, &eyes, &mut outputs, self.threads)?
            }
        };
        // Without noise, the requested error is that of the images without it.
        let requested = passes.and_then(|plan| plan.error);
        let passes = passes.map(|plan| match &denoiser {
            Some(denoiser) => PassPlan { error: None, ..denoiser.in_time(plan, &outputs) },
            None => plan,
        });
        let measure =
            |eye, image: &OutputImage, halves: &HalfMeans| denoiser.as_ref()?.measure(eye, image, halves);
        let denoising = denoiser.as_ref().map(|_| Denoising { measure: &measure, error: requested });
        let partials = Mutex::new(Vec::new());
        let options = FrameOptions {
            camera: view,
            eyes: &eyes,
            dicing_camera: &self.shading_view,
            threads: self.threads,
            reporter,
            progress: &*environment.progress,
            dump: dump.as_ref(),
            stop: &environment.stop,
            registry: Some(&environment.registry),
            scene_files: &environment.scene_files,
            spread: &environment.spread,
            priority: Some(&environment.priority),
            memory_bytes: match self.scene.get(attr::RERENDER_MEMORY) {
                0 => None,
                kb => Some(usize::try_from(kb).unwrap_or(0).saturating_mul(1024)),
            },
            partials: (environment.keep_partial && !self.is_worker).then_some(&partials),
            passes,
            denoising,
            finer: denoise::finer(&self.scene),
        };
        let frames = self.kept.as_mut().map(|kept| kept.cameras.entry(view.name.clone()).or_default());
        let rendered = frame::render(&self.scene, shading, options, &mut outputs, frames)
            .inspect_err(|_| self.renderer.keep(&eyes, &outputs, &refused, partials.into_inner()));
        let (mut statistics, complete) = rendered?;
        if let Some(denoiser) = denoiser {
            match denoiser.apply(&mut outputs, requested) {
                Ok(done) => statistics.denoised = Some(done),
                Err(what) => {
                    reporter.error(format!("camera \"{}\": its images keep their noise: {what}", view.name));
                    self.report.complete = false;
                }
            }
        }
        if let Some(passes) = &statistics.passes {
            self.tell(view, passes, statistics.denoised.as_ref());
        }
        self.report.statistics.push((view.name.clone(), statistics));
        if self.is_worker {
            return Ok(());
        }
        if let Some(dump) = dump {
            self.report.complete &= self.renderer.finish_dump(dump, complete);
        }
        self.report.complete &= complete;
        self.write(&eyes, &mut outputs, &refused);
        Ok(())
    }

    /// Prints the passes of the images of a camera, and their error without noise.
    fn tell(&self, view: &CameraView, passes: &PassReport, denoised: Option<&Denoised>) {
        let reporter = &self.renderer.environment.reporter;
        if reporter.verbosity() > 0 {
            let denoised = denoised.map(Denoised::errors).unwrap_or_default();
            let text = format!("camera \"{}\": {}{denoised}\n", view.name, passes.text());
            reporter.say(Severity::Message, &Location::default(), text);
        }
        if let Some(requested) = passes.requested.filter(|_| passes.is_short || passes.is_unsure) {
            let end = if passes.is_short {
                "was not reached before the passes ended"
            } else {
                "is not known to be reached: the passes ended before the bias was measured well enough"
            };
            reporter.warning(format!(
                "camera \"{}\": the error of {} {end}",
                view.name,
                percent(requested.into())
            ));
        }
    }

    /// True when the file of a part was reported as written.
    fn has_written(&self, image: &OutputImage) -> bool {
        image.part.is_some() && self.report.images.contains(&image.path)
    }

    /// True (and reported) when an output has the file of parts that show an earlier camera.
    fn is_taken(&self, output: &Output) -> bool {
        let scene = &self.scene;
        let order = |name: &Arc<str>| scene.cameras.iter().position(|camera| camera.name == *name);
        let other = scene.outputs.iter().find(|other| {
            other.name == output.name
                && other.format == output.format
                && !(other.part().is_empty() && output.part().is_empty())
                && order(&other.camera) < order(&output.camera)
        });
        if let Some(other) = other {
            self.renderer.environment.reporter.error(format!(
                "output \"{}\": its other parts show the camera \"{}\"; the parts of a file show one camera",
                output.name, other.camera
            ));
        }
        other.is_some()
    }

    /// Makes the context of shading, unless it exists.
    fn begin_shading(&mut self) -> Result<(), RenderError> {
        if self.shading.is_some() {
            return Ok(());
        }
        let Self { renderer: Renderer { environment }, scene, views, .. } = self;
        let mut shading = ShadingContext::new(scene, &self.shading_view, &environment.shading());
        shading.keeps = self.kept.is_some();
        let maps = DynamicMaps::new(scene, views, &shading.textures, environment, self.threads)?;
        if !maps.is_empty() {
            shading.dynamic = Some(Box::new(maps));
        }
        self.shading = Some(shading);
        Ok(())
    }

    /// Writes the images of a camera, except the refused ones. Viewers are kept until the end of the frame.
    fn write(&mut self, eyes: &[CameraView], outputs: &mut [OutputSet], refused: &[PathBuf]) {
        let environment = &self.renderer.environment;
        for k in 0..outputs[0].images.len() {
            for (eye, set) in eyes.iter().zip(&mut *outputs) {
                let image = &mut set.images[k];
                if refused.iter().any(|path| path.as_os_str() == image.path.as_os_str()) {
                    continue;
                }
                if image.is_shown {
                    let viewer = std::mem::take(&mut image.shown).0.into_inner();
                    self.viewers.extend(viewer.and_then(|viewer| self.show_denoised(viewer, image, eye)));
                    continue;
                }
                let written = match image.written.take() {
                    Some(done) => done,
                    None => image.write(eye, &environment.registry).map_err(|e| e.to_string()),
                };
                match written {
                    // The last part completes the file.
                    Ok(()) if !image.is_written() || self.has_written(image) => (),
                    Ok(()) => {
                        environment.progress.wrote(&image.path);
                        self.report.images.push(image.path.clone());
                    }
                    Err(error) => {
                        environment.reporter.error(format!("output \"{}\": {error}", image.path.display()));
                        self.report.complete = false;
                    }
                }
            }
        }
    }

    /// Shows an image again that was denoised. Returns the viewer, unless it failed.
    fn show_denoised(
        &self,
        mut viewer: ImageWriter,
        image: &OutputImage,
        eye: &CameraView,
    ) -> Option<ImageWriter> {
        if image.denoised_by.is_none() {
            return Some(viewer);
        }
        const ROWS: i32 = 64;
        let PixelRect { y0, y1, .. } = eye.crop;
        let bands = (y0..y1).step_by(ROWS.unsigned_abs() as usize);
        let values = eye.crop.width() * image.channels() * ROWS.unsigned_abs() as usize;
        let shown = bands.zip(image.pixels.chunks(values.max(1))).try_for_each(|(y, pixels)| {
            let rect = PixelRect { y0: y, y1: (y + ROWS).min(y1), ..eye.crop };
            viewer.begin(&rect);
            viewer.write_rectangle(&rect, pixels)
        });
        if let Err(error) = &shown {
            let text = format!("the image is not shown any more: {error}");
            self.renderer.environment.reporter.warning(text);
        }
        shown.is_ok().then_some(viewer)
    }

    /// Writes the texts of shaders and the spatial databases, and closes the viewers.
    fn finish(self) -> (FrameReport, Option<Box<KeptFrame>>) {
        let Self { renderer: Renderer { environment }, shading, viewers, mut report, kept, .. } = self;
        let with = |shading| kept.map(|kept| Box::new(KeptFrame { shading, ..*kept }));
        let reporter = &environment.reporter;
        if let Some(shading) = &shading {
            report.complete &= shading.finish_texts();
        }
        if self.is_worker {
            return (report, None);
        }
        match environment.databases.finish(&environment.texture_path) {
            Ok(finished) => report.databases = finished.written,
            Err(errors) => {
                let say = |error| reporter.error(format!("a spatial database is not written: {error}"));
                errors.iter().for_each(say);
                report.complete = false;
            }
        }
        // The files are written before this, because a viewer may close slowly.
        for viewer in viewers {
            if let Err(error) = viewer.close() {
                let text = format!("an image is not shown whole: {error}");
                reporter.once(&text.clone(), Severity::Warning, &Location::default(), text);
            }
        }
        report.shading = shading.as_ref().map(|s| s.statistics()).unwrap_or_default();
        (report, with(shading))
    }
}
