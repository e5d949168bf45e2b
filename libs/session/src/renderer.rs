//! The renderer behind the graphics state.

use crate::archive::call_text;
use crate::assets::{self, Listed, Listing, Sources};
use crate::commands::{self, CommandContext};
use crate::denoisers::{self, Denoisers};
use crate::looking::Looking;
use crate::net::{self, Net, WorkerCoordinator};
use crate::outputs::{DeskFrame, RequestedImages, Special};
use crate::passes;
use crate::patches::Deferral;
use crate::records::{self, FrameRecord};
use crate::running::{Busy, Tracked};
use crate::shaders::Shaders;
use crate::{SessionOptions, outputs};
use granita_base::{Location, Param, Params, Reporter, SearchPath, Severity};
use granita_image::{FormatRegistry, Limits};
use granita_inputs::Inputs;
use granita_plugin::{NativeShaders, Plugins};
use granita_render::{Kept, Priority, Progress, RenderEnvironment, RenderError, Renderer, Spread};
use granita_scene::attribute::{Key, scope};
use granita_scene::{DeferredInput, FoundInput, FrameRenderer, InputPaths, Scene, ShaderGroup, Stop, attr};
use granita_sdb::Databases;
use parking_lot::{Mutex, MutexGuard};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Instant;

/// The records of a session about its frames. Clones share them.
#[derive(Clone, Default)]
pub(crate) struct Finished(pub(crate) Arc<Record>);

/// The data of [`Finished`].
#[derive(Default)]
pub(crate) struct Record {
    /// All frames, in order.
    pub(crate) frames: Mutex<Vec<FrameRecord>>,
}

impl Record {
    /// Returns the records of all frames, in order.
    pub(crate) fn frames(&self) -> MutexGuard<'_, Vec<FrameRecord>> {
        self.frames.lock()
    }
}

/// Renders frames, runs commands and finds inputs for one session.
pub(crate) struct SessionRenderer {
    options: Arc<SessionOptions>,
    reporter: Reporter,
    progress: Arc<Tracked>,
    registry: FormatRegistry,
    databases: Arc<Databases>,
    commands: CommandContext,
    inputs: Inputs,
    plugins: Plugins,
    /// Compiles shaders to machine code, if that is requested.
    native: Option<Arc<NativeShaders>>,
    denoisers: Denoisers,
    finished: Finished,
    success: bool,
    /// The file for messages, from "error:filename".
    error_file: Arc<str>,
    /// The statistics of the frames so far, for "statistics:filename".
    statistics: String,
    net: Arc<Net>,
    /// How the next frame is rendered.
    looking: Arc<Mutex<Option<Looking>>>,
    /// The frame of a desk that the next frame is.
    desk: Arc<Mutex<Option<DeskFrame>>>,
    /// The frames of a scene that a patch follows.
    deferral: Arc<Mutex<Deferral>>,
    listing: Listing,
    /// The address of the viewer, once it was requested.
    viewer: OnceLock<Option<String>>,
    /// The images of the current frame that go to the program.
    requested: RequestedImages,
    /// What the frames of a scene in re-rendering mode keep for the next one.
    kept: Kept,
    /// What the coarse frames of a desk keep, which have another resolution.
    coarse_kept: Kept,
    /// True while a frame is rendered that keeps its images when it is stopped, and while they are written.
    busy: Arc<AtomicBool>,
    /// The beginning of the session, or the end of the frame before.
    idle_since: Instant,
    /// The coordinator that this session renders buckets for.
    master: Option<Arc<WorkerCoordinator>>,
}

impl SessionRenderer {
    pub(crate) fn new(
        options: Arc<SessionOptions>,
        reporter: Reporter,
        progress: Arc<dyn Progress>,
        finished: Finished,
        master: Option<Arc<WorkerCoordinator>>,
    ) -> Self {
        let plugins = Plugins::new(reporter.clone(), options.run.plugin_rules());
        // A run of an untrusted scene starts no programs.
        let native = (options.native && !options.run.safe).then(|| {
            Arc::new(NativeShaders::new(&options.run.environment, &options.run.supervisor, &reporter))
        });
        let mut registry = granita_plugin::bundled_formats(Limits {
            files: options.run.environment.files().clone(),
            ..Limits::default()
        });
        registry.find_with(Arc::new(plugins.clone()));
        Self {
            databases: Arc::new(Databases::new(registry.clone(), reporter.clone())),
            progress: Arc::new(Tracked {
                inner: progress,
                total: AtomicU64::new(0),
                done: AtomicU64::new(0),
                over: AtomicBool::new(false),
            }),
            registry,
            commands: CommandContext {
                reporter: reporter.clone(),
                stop: Arc::default(),
                priority: Arc::default(),
            },
            inputs: Inputs::with_plugins(Arc::new(options.run.clone()), reporter.clone(), plugins.clone()),
            plugins,
            native,
            denoisers: Denoisers::default(),
            net: Arc::new(Net::new(options.clone(), reporter.clone())),
            looking: Arc::default(),
            desk: Arc::default(),
            deferral: Arc::default(),
            viewer: OnceLock::new(),
            requested: RequestedImages::default(),
            kept: Kept::default(),
            coarse_kept: Kept::default(),
            busy: Arc::default(),
            idle_since: Instant::now(),
            master,
            options,
            reporter,
            finished,
            listing: Listing::default(),
            success: false,
            error_file: "".into(),
            statistics: String::new(),
        }
    }

    /// Writes the records of a frame that the scene and the options request (reference 4.3.7).
    fn record(&mut self, scene: &Scene, record: FrameRecord) {
        let level = scene.get(attr::STATISTICS_LEVEL).max(self.options.statistics);
        if level > 0 {
            let text = record.text(level, &self.reporter)
                + &self.net.report()
                + &self.options.accelerator.as_ref().map_or_else(String::new, |a| a.report());
            let file = scene.get(attr::STATISTICS_FILENAME);
            if file.is_empty() {
                self.reporter.say(Severity::Message, &Location::default(), text);
            } else {
                self.statistics += &text;
                records::write_whole(
                    Path::new(&*file),
                    &self.statistics,
                    self.options.run.environment.files(),
                    &self.reporter,
                );
            }
        }
        let list = scene.get(attr::DEBUG_FILESREAD);
        if !list.is_empty() {
            records::write_files_read(
                Path::new(&*list),
                self.options.run.environment.files(),
                &self.reporter,
            );
        }
        self.finished.0.frames().push(record);
    }

    /// Opens "error:filename".
    fn log_errors(&mut self, file: &Arc<str>) {
        if self.error_file == *file {
            return;
        }
        if file.is_empty() {
            self.reporter.set_log(None);
        } else {
            match records::error_log(Path::new(&**file), self.options.run.environment.files()) {
                Ok(log) => self.reporter.set_log(Some(log)),
                Err(error) => return self.reporter.error(format!("\"error:filename\" {error}")),
            }
        }
        self.error_file = file.clone();
    }

    fn search_path(&self, scene: &Scene, key: Key<scope::Global, Arc<str>>) -> SearchPath {
        SearchPath::parse(&scene.get(key), &SearchPath::default(), &self.options.run.environment)
    }

    /// Returns the inputs, with this session's plugins.
    pub(crate) fn inputs(&self) -> Inputs {
        self.inputs.clone()
    }

    /// Returns the place that holds how the next frame is rendered.
    pub(crate) fn looking(&self) -> Arc<Mutex<Option<Looking>>> {
        self.looking.clone()
    }

    /// Returns the place that holds the frame of a desk that the next frame is.
    pub(crate) fn desk(&self) -> Arc<Mutex<Option<DeskFrame>>> {
        self.desk.clone()
    }

    /// Returns the place that holds the frames of a scene that a patch follows.
    pub(crate) fn deferral(&self) -> Arc<Mutex<Deferral>> {
        self.deferral.clone()
    }

    /// Returns the place that holds the list of files.
    pub(crate) fn listing(&self) -> Listing {
        self.listing.clone()
    }

    /// Returns the list of files, when they are listed.
    fn listed(&self) -> Option<Listed> {
        self.listing.lock().clone()
    }

    pub(crate) fn plugins(&self) -> Plugins {
        self.plugins.clone()
    }

    /// Returns its image formats, with this session's plugins.
    pub(crate) fn registry(&self) -> FormatRegistry {
        self.registry.clone()
    }

    /// Returns the images that go to the program. They are set before a frame.
    pub(crate) fn requested(&self) -> RequestedImages {
        self.requested.clone()
    }

    pub(crate) fn stop(&self) -> Arc<AtomicBool> {
        self.commands.stop.clone()
    }

    /// Returns the flag that is true while a frame is rendered that keeps its images when it is stopped.
    pub(crate) fn busy(&self) -> Arc<AtomicBool> {
        self.busy.clone()
    }

    pub(crate) fn priority(&self) -> Arc<Priority> {
        self.commands.priority.clone()
    }

    /// Applies the plugin settings of the scene.
    fn configure_plugins(&self, scene: &Scene) {
        self.plugins.set_image_path(self.search_path(scene, attr::PATH_IMAGEIO));
    }

    /// Renders a frame, or all frames of a turntable.
    fn frames(&mut self, scene: Arc<Scene>, camera: Option<&str>) -> Result<(), Stop> {
        if let Some(Listed { assets, .. }) = self.listed() {
            self.configure_plugins(&scene);
            let requested = self.requested.lock().clone();
            let special = Special { requested: &requested, looking: None, desk: None };
            let scene = outputs::amended(&scene, &self.options, special, &self.registry, &self.reporter);
            let shaders = self.shaders(&scene);
            let textures = self.search_path(&scene, attr::PATH_TEXTURE);
            let sources = Sources {
                shaders: &shaders,
                textures: &textures,
                registry: &self.registry,
                plugins: &self.plugins,
                variables: &self.options.run.environment,
                reporter: &self.reporter,
                opened: self.inputs.opened(),
            };
            assets::collect(&scene, sources, &mut assets.lock());
            return Ok(());
        }
        let looking = self.looking.lock().take();
        let Some(looking) = looking else { return self.frame(scene, camera, None) };
        for frame in 0..looking.frames() {
            self.frame(looking.scene(&scene, frame), camera, Some((&looking, frame)))?;
            if self.commands.stop.load(Ordering::Relaxed) {
                break;
            }
        }
        Ok(())
    }

    /// Renders one frame, of a turntable where `looking` says so.
    fn frame(
        &mut self,
        scene: Arc<Scene>,
        camera: Option<&str>,
        looking: Option<(&Looking, u32)>,
    ) -> Result<(), Stop> {
        let begin = Instant::now();
        let supervisor = self.options.run.supervisor.clone();
        let _activity = supervisor.begin(format!("rendering frame {}", self.finished.0.frames().len() + 1));
        self.commands.stop.store(false, Ordering::SeqCst);
        if supervisor.has_ended() {
            return Err(Stop::Exit);
        }
        self.configure_plugins(&scene);
        let has_images = |name: &&str| {
            let mut own = scene.outputs.iter().filter(|o| &*o.camera == *name);
            // Maps that are made on demand are not files. Only depths can be dynamic.
            own.any(|o| !o.get(attr::DYNAMIC) || !matches!(&*o.data, "z" | "avgz"))
        };
        let requested = self.requested.lock().clone();
        let camera = camera.filter(|name| has_images(name) || requested.is_of(name));
        let desk = *self.desk.lock();
        let special = Special { requested: &requested, looking, desk };
        let mut scene = outputs::amended(&scene, &self.options, special, &self.registry, &self.reporter);
        // Workers show no images.
        let safe = self.options.run.safe;
        if safe && !self.options.extra_outputs.iter().any(outputs::is_iv) {
            scene = outputs::without_viewers(&scene, &self.reporter);
        }
        if let (true, unnamed) = outputs::shows(&scene, safe)
            && self.master.is_none()
        {
            let viewer = if unnamed { self.viewer() } else { None };
            scene = outputs::displayed(&scene, viewer, safe, &self.reporter);
        }
        // Frames of desks keep their noise.
        let denoise = match desk {
            Some(_) => 0,
            None => denoisers::requested(&scene, self.options.denoise, self.options.run.safe, &self.reporter),
        };
        scene = denoisers::prepared(&scene, denoise);
        let environment = self.environment(&scene);
        let keeps_images = self.options.keep_partial || environment.passes.is_some();
        let _busy = keeps_images.then(|| Busy::new(&self.busy));
        if keeps_images && supervisor.has_ended() {
            return Err(Stop::Exit);
        }
        let renderer = Renderer::new(environment);
        self.progress.over.store(false, Ordering::Relaxed);
        let keeps = scene.get(attr::RERENDER) && !self.options.rerenders_anew;
        let is_coarse = desk.is_some_and(|desk| desk.coarse);
        let kept = if is_coarse { &mut self.coarse_kept } else { &mut self.kept };
        let result = match keeps {
            true => renderer.rerender(&scene, camera, kept),
            false => renderer.render(&scene, camera),
        };
        if !keeps {
            (self.kept, self.coarse_kept) = (Kept::default(), Kept::default());
        }
        let report = match result {
            Ok(report) => Some(report),
            // A desk stops frames all the time.
            Err(RenderError::Stopped) if desk.is_some() => None,
            Err(RenderError::Stopped) => {
                self.reporter.warning(RenderError::Stopped.to_string());
                None
            }
            Err(error) => {
                self.reporter.error(error.to_string());
                None
            }
        };
        self.idle_since = Instant::now();
        self.progress.over.store(true, Ordering::Relaxed);
        let record = FrameRecord::new(report, scene.inputs, begin.elapsed());
        self.success = record.complete;
        if desk.is_none() {
            self.record(&scene, record);
        }
        Ok(())
    }

    fn shaders(&self, scene: &Scene) -> Shaders {
        Shaders::new(self.search_path(scene, attr::PATH_SHADER), self.plugins.clone(), self.reporter.clone())
    }

    fn environment(&self, scene: &Scene) -> RenderEnvironment {
        RenderEnvironment {
            registry: self.registry.clone(),
            databases: self.databases.clone(),
            shaders: Arc::new(
                self.shaders(scene)
                    .with_native(self.native.clone())
                    .with_accelerator(self.options.accelerator.clone()),
            ),
            texture_path: self.search_path(scene, attr::PATH_TEXTURE),
            variables: self.options.run.environment.clone(),
            reporter: self.reporter.clone(),
            progress: self.progress.clone(),
            threads: self.threads(scene),
            open_files: self.options.open_files,
            stop: self.commands.stop.clone(),
            keep_partial: self.options.keep_partial,
            crop: self.options.crop.filter(|_| self.desk.lock().is_none()),
            call_text,
            scene_files: self.options.scene_files.clone(),
            spread: self.spread(scene),
            priority: self.commands.priority.clone(),
            passes: passes::plan(self.options.passes, scene, self.idle_since, &self.reporter)
                .filter(|_| self.desk.lock().is_none()),
            // A worker leaves it to its coordinator.
            denoiser: match scene.get(attr::RENDER_DENOISE) != 0 && self.master.is_none() {
                true => self.denoisers.of(scene, self.options.run.environment.files(), &self.reporter),
                false => None,
            },
        }
    }

    /// Returns the number of threads to render a scene with.
    fn threads(&self, scene: &Scene) -> usize {
        let of_scene = || scene.given(attr::LIMITS_THREADS).map(|n| usize::try_from(n).unwrap_or(1).max(1));
        match self.options.threads {
            0 => of_scene().unwrap_or(self.options.default_threads).max(1),
            threads => threads,
        }
    }

    /// Returns the viewer of images that do not name one.
    fn viewer(&self) -> Option<&str> {
        let found = self.viewer.get_or_init(|| match self.options.viewer.0.as_ref()?() {
            Ok(address) => Some(address),
            Err(what) => {
                self.reporter
                    .warning(format!("{what}; one that listens on this machine is used, if any does"));
                None
            }
        });
        found.as_deref()
    }

    /// Returns the processes that render the buckets, from "net:workers", "net:workercmd" and "net:timeout".
    fn spread(&self, scene: &Scene) -> Spread {
        if let Some(master) = &self.master {
            return Spread::For(master.clone());
        }
        if self.listed().is_some() {
            return Spread::Alone;
        }
        let named = scene.get(attr::NET_WORKERS);
        let lists: Vec<&str> = match self.options.net_workers.is_empty() {
            true => vec![&named],
            false => self.options.net_workers.iter().map(|list| &**list).collect(),
        };
        if lists.iter().all(|list| list.trim().is_empty()) {
            return Spread::Alone;
        }
        let patience = scene.get(attr::NET_TIMEOUT);
        if self.options.run.safe {
            net::refuse(&self.reporter, "programs are not allowed");
        } else if self.net.start(lists, &scene.get(attr::NET_WORKERCMD), patience) {
            self.net.set_alone(self.databases.hold_memory());
            return Spread::Over(self.net.clone());
        }
        Spread::Alone
    }
}

impl FrameRenderer for SessionRenderer {
    /// Renders the images of the camera that `Render` names. When none is named, or the named one has no images, the
    /// images of all cameras are rendered. Exporters name their main camera also in shadow passes, in which only the
    /// lights' cameras have images.
    fn render(&mut self, scene: Arc<Scene>, camera: Option<&str>) -> Result<(), Stop> {
        let due = self.deferral.lock().take(scene, camera);
        due.map_or(Ok(()), |(scene, camera)| self.frames(scene, camera.as_deref()))
    }

    fn check_light(&mut self, name: &str, group: &ShaderGroup, shader_path: &str, at: &Location) -> bool {
        let path = SearchPath::parse(shader_path, &SearchPath::default(), &self.options.run.environment);
        let shaders = Shaders::new(path, self.plugins.clone(), self.reporter.clone());
        let good = granita_render::check_light(name, group, &shaders, &self.reporter);
        if !good {
            let text = format!(
                "light \"{name}\": it cannot be used as it is declared; the last good one stays, if there is one"
            );
            self.reporter.say(Severity::Warning, at, text);
        }
        good
    }

    fn command(&mut self, name: &str, params: &Params, at: &Location) -> Result<bool, Stop> {
        let due = self.deferral.lock().release();
        if let Some((scene, camera)) = due {
            self.frames(scene, camera.as_deref())?;
        }
        if let Some(master) = &self.master {
            // The coordinator runs it.
            return if master.command() { Ok(true) } else { Err(Stop::Exit) };
        }
        if self.options.run.supervisor.has_ended() {
            return Err(Stop::Exit);
        }
        if let Some(Listed { assets, .. }) = self.listed() {
            if name.trim() == "fileread" {
                return Ok(commands::run(name, params, at, &self.options, &self.commands));
            }
            assets.lock().commands.push(commands::text(name, params));
            return Ok(true);
        }
        let known = commands::run(name, params, at, &self.options, &self.commands);
        self.net.command_done();
        Ok(known)
    }

    fn input(
        &mut self,
        command: &str,
        paths: InputPaths<'_>,
        at: &Location,
    ) -> Result<Option<FoundInput>, Stop> {
        match self.inputs.find(command, paths) {
            Ok(input) => {
                if let Some(Listed { assets, .. }) = self.listed() {
                    assets.lock().add_program(command, &input);
                }
                Ok(Some(input.found(command, at)))
            }
            Err(error) => {
                let text = error.to_string();
                self.reporter.once(&format!("input {text}"), Severity::Error, at, text);
                Ok(None)
            }
        }
    }

    fn needed(&mut self, scene: &Arc<Scene>, unread: &[DeferredInput]) -> Vec<bool> {
        if self.listed().is_some_and(|listed| listed.all_inputs) {
            return vec![true; unread.len()];
        }
        self.configure_plugins(scene);
        let requested = self.requested.lock().clone();
        let special = Special { requested: &requested, looking: None, desk: None };
        let scene = outputs::amended(scene, &self.options, special, &self.registry, &self.reporter);
        Renderer::new(self.environment(&denoisers::prepared(&scene, 0))).needed(&scene, unread)
    }

    fn attribute(&mut self, param: &Param) {
        if let Some(level) = attr::VERBOSITY.given(param)
            && self.options.verbosity.is_none()
        {
            self.reporter.set_verbosity(u8::try_from(level.clamp(0, 2)).unwrap_or(1));
        }
        if let Some(debug) = attr::DEBUG_DSO.given(param) {
            self.plugins.set_debug(debug);
        }
        if let Some(file) = attr::ERROR_FILENAME.given(param)
            && self.listed().is_none()
        {
            self.log_errors(&file);
        }
    }

    fn query(&self, name: &str) -> Option<Param> {
        if attr::RENDER_SUCCESS.is_named(name) {
            return Some(attr::RENDER_SUCCESS.param(self.success));
        }
        if !attr::RENDER_PROGRESS.is_named(name) {
            return None;
        }
        let (done, total) =
            (self.progress.done.load(Ordering::Relaxed), self.progress.total.load(Ordering::Relaxed));
        let part = if total == 0 { 0.0 } else { done as f32 / total as f32 };
        let over = self.progress.over.load(Ordering::Relaxed);
        Some(attr::RENDER_PROGRESS.param(if over { 1.0 } else { part.min(0.999_999) }))
    }
}
