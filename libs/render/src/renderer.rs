//! The door to this crate: a scene in, image files out.

use crate::dynamic::DynamicMaps;
use crate::environment::RenderEnvironment;
use crate::frame::{self, FrameOptions, FrameShader, ObjectTraits};
use crate::object::{Holdout, ObjectState};
use crate::output::griddump::GridDump;
use crate::output::plan::{OutputSet, WrittenFiles, is_dynamic};
use crate::shading::{ShaderThread, ShadingContext};
use crate::spread::Spread;
use crate::{CameraView, RenderError, ShadingStatistics, Statistics, hider, nearby, preview, unknown};
use granita_base::{Location, Severity, Vec3};
use granita_gsl::ir::ValueType;
use granita_scene::{Output, Primitive, Scene, attr};
use granita_shade::Grid;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Renders scenes. Holds nothing of a scene after its frame is done.
#[derive(Clone, Debug)]
pub struct Renderer {
    pub(crate) environment: RenderEnvironment,
}

/// What came out of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameReport {
    /// Files written, in order of declaration; of a stereo camera the left one before the right.
    pub images: Vec<PathBuf>,
    /// Spatial databases written, by name.
    pub databases: Vec<PathBuf>,
    /// Whether every pixel was rendered and every image and database written.
    pub complete: bool,
    /// What was done for each camera that has images, by its name.
    pub statistics: Vec<(Arc<str>, Statistics)>,
    /// What shading looked up and built, for all of them together.
    pub shading: ShadingStatistics,
}

impl Renderer {
    /// A renderer with these formats, shaders and so on.
    pub fn new(environment: RenderEnvironment) -> Self {
        Self { environment }
    }

    /// Renders the images of `camera`, or of all cameras that have any.
    ///
    /// What goes wrong with one image or one bucket is reported and leaves the others alone; see
    /// [`FrameReport::complete`].
    ///
    /// Errors: [`RenderError::Misuse`] when there is no camera (of that name),
    /// [`RenderError::Limit`] for images that are too large, [`RenderError::Stopped`].
    pub fn render(&self, scene: &Arc<Scene>, camera: Option<&str>) -> Result<FrameReport, RenderError> {
        let environment = &self.environment;
        let reporter = &environment.reporter;
        let views = self.views(scene);
        let origin = views.first().map_or(Vec3::ZERO, nearby::common_origin);
        let scene = &nearby::moved(scene, origin, &*environment.shaders);
        let views: Vec<CameraView> = views.into_iter().map(|view| view.nearby(origin)).collect();
        let first = views
            .first()
            .map(CameraView::shading_view)
            .ok_or_else(|| RenderError::Misuse { what: "the scene has no camera".to_owned() })?;
        if let Some(name) = camera
            && !views.iter().any(|v| &*v.name == name)
        {
            return Err(RenderError::Misuse { what: format!("the scene has no camera \"{name}\"") });
        }
        let threads = match environment.threads {
            0 => usize::try_from(scene.get(attr::LIMITS_THREADS)).unwrap_or(1).max(1),
            n => n,
        };
        environment.databases.begin();
        let is_worker = matches!(environment.spread, Spread::For(_));
        let scene = &preview::simplified(scene, &first, reporter);
        let mut report = FrameReport { complete: true, ..FrameReport::default() };
        let mut files = WrittenFiles::default();
        if !is_worker {
            unknown::report(scene, &*environment.shaders, reporter);
        }
        let mut shown = Vec::new();
        let mut shading = None;
        for view in views.iter().filter(|v| camera.is_none_or(|name| &*v.name == name)) {
            let own = |o: &&Output| o.camera == view.name && !is_dynamic(o);
            let outputs: Vec<&Output> = scene.outputs.iter().filter(own).collect();
            let plan = OutputSet::new(&outputs, view, &environment.registry, reporter)?;
            if plan.images.is_empty() {
                continue;
            }
            if view.crop.is_empty() {
                reporter.error(format!("camera \"{}\": its crop window holds no pixel", view.name));
                report.complete = false;
                continue;
            }
            let eyes = view.eyes().map_or_else(|| vec![view.clone()], Vec::from);
            let mut outputs = match &eyes[..] {
                [_] => vec![plan],
                _ => plan.for_eyes(reporter),
            };
            let refused = if is_worker { Vec::new() } else { self.refused(&eyes, &outputs, &mut files) };
            report.complete &= refused.is_empty();
            if refused.len() == eyes.len() * outputs[0].images.len() {
                continue;
            }
            // Of several views the first one that is rendered.
            let dump = if report.statistics.is_empty() { self.dump(scene, &views[0]) } else { None };
            // Shading always looks from the first camera (reference 7.7), so all share what it builds.
            let shading = match &mut shading {
                Some(shading) => &*shading,
                none => {
                    let mut context = ShadingContext::new(scene, &first, environment);
                    context.dynamic =
                        DynamicMaps::new(scene, &views, &context.textures, environment, threads)?;
                    &*none.insert(context)
                }
            };
            let options = FrameOptions {
                camera: view,
                eyes: &eyes,
                dicing_camera: &first,
                threads,
                reporter,
                progress: &*environment.progress,
                dump: dump.as_ref(),
                stop: &environment.stop,
                registry: Some(&environment.registry),
                scene_files: &environment.scene_files,
                spread: &environment.spread,
                priority: Some(&environment.priority),
            };
            let (statistics, complete) = frame::render(scene, shading, options, &mut outputs)?;
            report.statistics.push((view.name.clone(), statistics));
            if is_worker {
                continue;
            }
            if let Some(dump) = dump {
                report.complete &= self.finish_dump(dump, complete);
            }
            report.complete &= complete;
            for k in 0..outputs[0].images.len() {
                for (eye, set) in eyes.iter().zip(&mut outputs) {
                    let image = &mut set.images[k];
                    if refused.iter().any(|path| path.as_os_str() == image.path.as_os_str()) {
                        continue;
                    }
                    if image.is_shown {
                        shown.extend(std::mem::take(&mut image.shown).0.into_inner().ok().flatten());
                        continue;
                    }
                    let written = match image.written.take() {
                        Some(done) => done,
                        None => image.write(eye, &environment.registry).map_err(|e| e.to_string()),
                    };
                    match written {
                        Ok(()) => report.images.push(image.path.clone()),
                        Err(error) => {
                            reporter.error(format!("output \"{}\": {error}", image.path.display()));
                            report.complete = false;
                        }
                    }
                }
            }
        }
        if let Some(shading) = &shading {
            report.complete &= shading.texts.finish(&shading.files, reporter);
        }
        if is_worker {
            return Ok(report);
        }
        match environment.databases.finish(&environment.texture_path) {
            Ok(finished) => report.databases = finished.written,
            Err(errors) => {
                let say = |error| reporter.error(format!("a spatial database is not written: {error}"));
                errors.iter().for_each(say);
                report.complete = false;
            }
        }
        // Files first: a slow viewer may take its time.
        for viewer in shown {
            if let Err(error) = viewer.close() {
                let text = format!("an image is not shown whole: {error}");
                reporter.once(&text.clone(), Severity::Warning, &Location::default(), text);
            }
        }
        report.shading = shading.map(|s| s.statistics()).unwrap_or_default();
        Ok(report)
    }

    /// Names of images that cannot be written, each reported; `files` are those of images before them.
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

    /// "griddump:filename".
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

    /// Writes a dump, of a frame that is `complete`. Whether that went well.
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

    /// The cameras, with the crop window that the environment asks for.
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

impl FrameShader for ShadingContext {
    type Object = ObjectState;
    type Thread<'a> = ShaderThread<'a>;

    fn object(&self, primitive: &Primitive) -> Arc<ObjectState> {
        ShadingContext::object(self, primitive)
    }

    fn traits(&self, object: &ObjectState) -> ObjectTraits {
        ObjectTraits {
            opaque: object.opaque,
            opaque_in_depth: object.opaque_to_shadows,
            holdout: match object.holdout {
                Holdout::No => hider::Holdout::None,
                Holdout::Matte => hider::Holdout::Matte,
                Holdout::Shaded => hider::Holdout::Shaded,
            },
            displaces: object.displacement.is_some(),
            max_displacement_world: object.max_displacement_world,
            measures: object.max_displacement_world <= 0.0 && object.moves_points(),
            preshaded: object.preshaded,
            joins: object.joins,
            saves: object.saves,
        }
    }

    fn thread(&self) -> ShaderThread<'_> {
        ShaderThread::new(self)
    }

    fn unlit_thread(&self) -> ShaderThread<'_> {
        let mut thread = ShaderThread::new(self);
        thread.is_unlit = true;
        thread
    }

    fn mute(&self, thread: &mut ShaderThread<'_>, mute: bool) {
        thread.is_mute = mute;
    }

    fn saves(&self) -> u64 {
        self.databases.saves()
    }

    fn displace(&self, thread: &mut ShaderThread<'_>, object: &ObjectState, grid: &mut Grid) {
        thread.displace(object, grid);
    }

    fn shade(
        &self,
        thread: &mut ShaderThread<'_>,
        object: &ObjectState,
        grid: &mut Grid,
        wanted: &[(Arc<str>, ValueType)],
    ) -> Vec<Option<Vec<f32>>> {
        let mut found = thread.shade(object, grid, wanted);
        // Images show where in the world surfaces are. What other points are relative to is known to the shader alone.
        let origin = self.camera.common_origin;
        let is_place = |(name, ty): &(Arc<str>, ValueType)| &**name == "P" && *ty == ValueType::Point;
        let points = found.iter_mut().zip(wanted).filter(|(_, wanted)| is_place(wanted));
        for values in points.filter_map(|(values, _)| values.as_mut()).filter(|_| origin != Vec3::ZERO) {
            let n = (values.len() / 3).max(1);
            for (component, from) in values.chunks_exact_mut(n).zip(origin.to_array()) {
                component.iter_mut().for_each(|x| *x += from);
            }
        }
        found
    }
}
