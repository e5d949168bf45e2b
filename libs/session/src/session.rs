//! A session, which reads scenes and renders their frames.

use crate::assets::{Listed, Listing};
use crate::connection::Connection;
use crate::forwarded::Forwarded;
use crate::looking::{Looking, MeshSink};
use crate::net::WorkerCoordinator;
use crate::outputs::{DeskFrame, RequestedImages};
use crate::patches::{self, Deferral};
use crate::programs::Programs;
use crate::renderer::{Finished, SessionRenderer};
use crate::{Assets, FrameRecord, SessionError, SessionOptions, safe};
use granita_base::{Files, Location, Param, Reporter, Severity};
use granita_image::FormatRegistry;
use granita_inputs::{Input, InputError, Inputs};
use granita_plugin::Plugins;
use granita_pyg::PygError;
use granita_pyg::{PygOptions, PygSource, Scripts};
use granita_render::{Priority, Progress, Silent};
use granita_scene::attribute::{Key, scope};
use granita_scene::{Call, InputPaths, SceneSink, State, Stop, attr};
use parking_lot::Mutex;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Receives the progress of a frame.
#[derive(Clone)]
pub struct SharedProgress(pub Arc<dyn Progress>);

impl Default for SharedProgress {
    /// Returns a receiver that ignores all progress.
    fn default() -> Self {
        Self(Arc::new(Silent))
    }
}

impl std::fmt::Debug for SharedProgress {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("SharedProgress")
    }
}

/// The result of a session.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outcome {
    /// True when a `Render` was reached.
    pub rendered: bool,
    /// True when all frames have all their pixels and images.
    pub complete: bool,
    /// The record of each frame.
    pub frames: Vec<FrameRecord>,
    /// The written images.
    pub images: Vec<PathBuf>,
    /// True when the scene files called `Command`, so that they had an effect without a frame.
    pub commanded: bool,
    /// The number of primitives that no `Render` followed.
    pub waiting: usize,
    /// The number of reported errors.
    pub errors: usize,
    /// The number of reported warnings, shown or not.
    pub warnings: usize,
    /// The files read, sorted: scenes, shaders, textures and those that the scene declares ("fileread").
    pub files_read: Vec<PathBuf>,
}

/// One renderer, which receives scene calls and renders images.
pub struct Session {
    state: State,
    reporter: Reporter,
    options: Arc<SessionOptions>,
    inputs: Inputs,
    plugins: Plugins,
    registry: FormatRegistry,
    requested: RequestedImages,
    stop: Arc<AtomicBool>,
    busy: Arc<AtomicBool>,
    priority: Arc<Priority>,
    /// The names of files of objects that were read as if they were scenes.
    objects: Vec<String>,
    /// True when the scene files called `Command`.
    commanded: bool,
    /// How the next frame is rendered.
    looking: Arc<Mutex<Option<Looking>>>,
    /// The frame of a desk that the next frames are.
    desk_frame: Arc<Mutex<Option<DeskFrame>>>,
    deferral: Arc<Mutex<Deferral>>,
    listing: Listing,
    finished: Finished,
    /// The definitions of the scripts of its scenes.
    scripts: Scripts,
    /// The coordinator of a worker.
    master: Option<Arc<WorkerCoordinator>>,
}

impl std::fmt::Debug for Session {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Session").field("options", &self.options).finish_non_exhaustive()
    }
}

impl Session {
    /// Returns a new session. It reads the startup files (reference 6.2), whose errors are reported.
    pub fn new(options: SessionOptions, reporter: Reporter, progress: SharedProgress) -> Self {
        Self::with_master(options, reporter, progress, None)
    }

    /// Returns a session that renders buckets for another one. It receives requests from `input` and answers to
    /// `output`. It runs no commands and writes no images (reference 6.6.3). `ended` is called when the connection
    /// ends, with the last words of the other session: empty at the end of its work, and `None` when there are none.
    pub fn worker(
        options: SessionOptions,
        reporter: Reporter,
        input: Box<dyn Read + Send>,
        output: Box<dyn Write + Send>,
        ended: Box<dyn FnOnce(Option<String>) + Send>,
    ) -> Self {
        let threads = if options.threads > 0 { options.threads } else { options.default_threads.max(1) };
        let master = WorkerCoordinator::new(input, output, threads, &reporter, ended);
        Self::with_master(options, reporter, SharedProgress::default(), Some(master))
    }

    fn with_master(
        options: SessionOptions,
        reporter: Reporter,
        progress: SharedProgress,
        master: Option<WorkerCoordinator>,
    ) -> Self {
        if let Some(verbosity) = options.verbosity {
            reporter.set_verbosity(verbosity);
        }
        let mut options = options;
        let master = master.map(Arc::new);
        if options.run.safe && !options.run.environment.files().is_confined() {
            let files = safe::files(&options);
            options.run.environment.set_files(files);
        }
        if let Some(folder) = options.run.environment.get("GELATOTEMP").filter(|folder| !folder.is_empty()) {
            let folder = PathBuf::from(folder);
            if folder.is_dir() {
                let files = options.run.environment.files().clone().with_temporary(&folder);
                options.run.environment.set_files(files);
            } else {
                reporter.warning(format!(
                    "GELATOTEMP: \"{}\" is no folder; temporary files lie beside the results",
                    folder.display()
                ));
            }
        }
        let options = Arc::new(options);
        let finished = Finished::default();
        let renderer = SessionRenderer::new(
            options.clone(),
            reporter.clone(),
            progress.0,
            finished.clone(),
            master.clone(),
        );
        let (inputs, plugins) = (renderer.inputs(), renderer.plugins());
        let (registry, requested) = (renderer.registry(), renderer.requested());
        let (stop, busy, priority) = (renderer.stop(), renderer.busy(), renderer.priority());
        let (looking, desk_frame, deferral) = (renderer.looking(), renderer.desk(), renderer.deferral());
        let listing = renderer.listing();
        let state = State::new(Box::new(renderer), reporter.clone());
        let scripts = Scripts::default();
        let mut session = Self {
            state,
            reporter,
            options,
            inputs,
            plugins,
            registry,
            requested,
            stop,
            busy,
            priority,
            objects: Vec::new(),
            commanded: false,
            looking,
            desk_frame,
            deferral,
            listing,
            finished,
            scripts,
            master,
        };
        session.state.fix_attributes(&session.options.set);
        session.read_startup_files();
        // Startup files are not a part of the scene.
        session.scripts = Scripts::default();
        session.commanded = false;
        if session.options.run.safe {
            safe::add_search_paths(&session.options, &session.state);
        }
        session
    }

    fn read_startup_files(&mut self) {
        if self.options.no_startup_files {
            return;
        }
        let variables = &self.options.run.environment;
        let folders = ["GELATOHOME", "HOME"].into_iter().filter_map(|name| variables.get(name));
        let own = || folders.filter(|f| !f.is_empty()).map(|f| Path::new(f).join(".gelato.pyg")).collect();
        let files: Vec<PathBuf> = self.options.startup_files.clone().unwrap_or_else(own);
        for path in files {
            if path.is_file()
                && let Err(error) = self.read(self.file(&path), &path.to_string_lossy())
            {
                self.reporter.error(error.to_string());
            }
        }
    }

    /// Reads the scene `name`, which is a file, or the input that `Input` finds under that name. Standard input is read
    /// by [`Session::read_stream`]. Scenes read one after the other count as one that contains them all (reference
    /// 6.1), so definitions of their scripts stay.
    ///
    /// Errors inside of the scene are reported and not returned.
    ///
    /// # Errors
    /// Returns [`SessionError::Missing`], [`SessionError::Io`], or [`SessionError::Exit`] when the scene stopped
    /// the session.
    pub fn read_file(&mut self, name: &str) -> Result<(), SessionError> {
        let path = Path::new(name);
        if patches::is_patch(self.files(), path) {
            self.deferral.lock().begin_patch();
        }
        if path.is_file() {
            return self.read(self.file(path), name);
        }
        if path.is_dir() {
            return Err(SessionError::Failed(format!("{name} is a folder, not a scene")));
        }
        self.input(name)
    }

    /// Prepares the session for the files that are going to be read, in this order. Where a patch of lights follows a
    /// scene, the scene is read in re-rendering mode, and its last `Render` is left out, because the patch has its own.
    ///
    /// # Errors
    /// Returns [`SessionError::Exit`] or [`SessionError::Failed`].
    pub fn expect_files(&mut self, names: &[String]) -> Result<(), SessionError> {
        let is_patch = |name: &&String| patches::is_patch(self.files(), Path::new(name));
        let patches = names.iter().skip(1).filter(is_patch).count();
        if patches > 0 {
            self.call(Call::Attribute(attr::RERENDER.param(true)))?;
            self.deferral.lock().patches = patches;
        }
        Ok(())
    }

    /// Reads a scene from a stream, as standard input. `name` identifies it in messages.
    ///
    /// # Errors
    /// Returns the errors of [`Session::read_file`].
    pub fn read_stream(&mut self, name: &str, stream: Box<dyn Read + Send>) -> Result<(), SessionError> {
        let options = PygOptions { scripts: Some(self.scripts.clone()), ..self.inputs.pyg_options() };
        let source = PygSource::Stream { name: name.into(), stream };
        let reporter = self.reporter.clone();
        let (commanded, number) = (&mut self.commanded, self.options.number);
        let read = |state: &mut State| {
            granita_pyg::read(source, &mut FileSink { state, commanded, number }, &options, &reporter)
        };
        self.state.read(name, name, read).map_err(|error| failed(InputError::from(error)))
    }

    /// Executes calls and requests from a program that started this one, until its stream ends (see
    /// `granita_pyg::serve`). Answers and images go to `output`. Addresses of images in the scene are those of the
    /// program.
    ///
    /// # Errors
    /// Returns the errors of [`Session::read_file`].
    pub fn serve(&mut self, input: &mut dyn Read, output: &Connection) -> Result<(), SessionError> {
        let images = output.clone();
        self.plugins.set_program_images(Arc::new(move |address| Arc::new(Forwarded::new(&images, address))));
        let mut programs = Programs {
            connection: output.clone(),
            registry: self.registry.clone(),
            requested: self.requested.clone(),
            reporter: self.reporter.clone(),
        };
        let (state, answers) = (&mut self.state, &mut output.clone());
        granita_pyg::serve_with(input, answers, state, &self.reporter, &mut programs).map_err(|error| {
            match error {
                PygError::Stopped(stop) => stopped(stop),
                other => SessionError::Failed(other.to_string()),
            }
        })
    }

    /// Reads an input, as the scene call `Input` without a bound does.
    ///
    /// # Errors
    /// Returns the errors of [`Session::read_file`].
    pub fn input(&mut self, command: &str) -> Result<(), SessionError> {
        let (input, generator) = (self.path(attr::PATH_INPUT), self.path(attr::PATH_GENERATOR));
        let found = self.inputs.find(command, InputPaths { input: &input, generator: &generator });
        self.read(found, command)
    }

    /// Executes one call of the scene interface.
    ///
    /// # Errors
    /// Returns [`SessionError::Exit`] or [`SessionError::Failed`].
    pub fn call(&mut self, call: Call) -> Result<(), SessionError> {
        self.state.call(call, &Location::default()).map_err(stopped)
    }

    /// Returns the graphics state, for readers and bindings that make calls themselves.
    pub fn state(&mut self) -> &mut State {
        &mut self.state
    }

    /// Returns the graphics state for reading.
    pub fn state_ref(&self) -> &State {
        &self.state
    }

    /// Ends the session after the last call. Reports blocks left open and returns the result.
    pub fn finish(mut self) -> Outcome {
        self.state.end();
        if let Some(name) = self.objects.first().filter(|_| !self.state.has_rendered()) {
            self.reporter.error(match self.state.primitive_count() {
                0 => format!("nothing was rendered: {name} holds no objects that can be drawn"),
                _ => format!(
                    "nothing was rendered: {name} holds objects and no Render (); render a scene that has Input \
                     (\"{name}\") after World (), or see it as Pyg with topyg"
                ),
            });
        }
        if let Some(master) = self.master.as_ref().filter(|_| self.state.has_rendered()) {
            master.rest();
        }
        let frames = self.finished.0.frames().clone();
        Outcome {
            rendered: self.state.has_rendered(),
            complete: frames.iter().all(|f| f.complete),
            images: frames.iter().flat_map(|f| f.images.iter().cloned()).collect(),
            frames,
            commanded: self.commanded,
            waiting: self.state.primitive_count(),
            errors: self.reporter.errors(),
            warnings: self.reporter.count(Severity::Warning),
            files_read: self.reporter.files_read(),
        }
    }

    /// Makes the session list the files of its scenes instead of rendering them and running their commands. Returns the
    /// list, which is complete after the last `Render`. With `all_inputs` it contains inputs that no frame needs.
    pub fn list_assets(&self, all_inputs: bool) -> Arc<Mutex<Assets>> {
        let assets = Arc::<Mutex<Assets>>::default();
        *self.listing.lock() = Some(Listed { assets: assets.clone(), all_inputs });
        assets
    }

    /// Returns the plugins of this session, including those that its program permits.
    pub fn plugins(&self) -> &Plugins {
        &self.plugins
    }

    /// Returns the receiver of its messages.
    pub fn reporter(&self) -> Reporter {
        self.reporter.clone()
    }

    /// Returns the object that opens its files.
    pub fn files(&self) -> &Files {
        self.options.run.environment.files()
    }

    /// Returns a flag that ends the current frame as soon as possible. Any thread may set it.
    pub fn stop(&self) -> Arc<AtomicBool> {
        self.stop.clone()
    }

    /// Returns a flag that is true while a frame is rendered that keeps its images when it is stopped, and while they
    /// are written.
    pub fn busy(&self) -> Arc<AtomicBool> {
        self.busy.clone()
    }

    /// Returns the priority of buckets of the current frame.
    pub(crate) fn priority(&self) -> Arc<Priority> {
        self.priority.clone()
    }

    fn file(&self, path: &Path) -> Result<Input, InputError> {
        let (input, generator) = (self.path(attr::PATH_INPUT), self.path(attr::PATH_GENERATOR));
        self.inputs.file(path, InputPaths { input: &input, generator: &generator })
    }

    fn path(&self, key: Key<scope::Global, Arc<str>>) -> Arc<str> {
        key.ask(&self.state)
    }

    fn read(&mut self, found: Result<Input, InputError>, name: &str) -> Result<(), SessionError> {
        let input = found.map_err(failed)?.sharing(self.scripts.clone());
        if let Some(Listed { assets, .. }) = &*self.listing.lock() {
            assets.lock().add_program(name, &input);
        }
        let identity = input.identity().clone();
        if !input.makes_frames() {
            self.objects.push(name.to_owned());
            let read = |state: &mut State| input.read(&mut MeshSink { state, is_second_reading: false });
            return self.state.read(&identity, name, read).map_err(failed);
        }
        let (commanded, number) = (&mut self.commanded, self.options.number);
        let read = |state: &mut State| input.read(&mut FileSink { state, commanded, number });
        self.state.read(&identity, name, read).map_err(failed)
    }

    /// Reads the files of objects again when the first reading took only their cameras, as before `World`.
    pub(crate) fn read_objects_beside_cameras(&mut self) -> Result<(), SessionError> {
        if self.state.in_world() || self.state.lacks_frame() || self.state.camera_names().is_empty() {
            return Ok(());
        }
        for name in self.objects.clone() {
            let path = Path::new(&name);
            let input = self.file(path).map_err(failed)?;
            let identity = input.identity().clone();
            let read = |state: &mut State| input.read(&mut MeshSink { state, is_second_reading: true });
            self.state.read(&identity, &name, read).map_err(failed)?;
        }
        Ok(())
    }

    /// Returns the name of the last scene file that holds meshes.
    pub(crate) fn objects_name(&self) -> Option<&str> {
        self.objects.last().map(String::as_str)
    }

    /// True when some of the scene files hold meshes.
    pub(crate) fn has_meshes(&self) -> bool {
        !self.objects.is_empty()
    }

    /// Returns the options of the session.
    pub(crate) fn options(&self) -> &SessionOptions {
        &self.options
    }

    /// Sets how the next frame is rendered.
    pub(crate) fn render_as(&self, looking: Looking) {
        *self.looking.lock() = Some(looking);
    }

    /// Sets the frame of a desk that the next frames are.
    pub(crate) fn render_for_desk(&self, frame: Option<DeskFrame>) {
        *self.desk_frame.lock() = frame;
    }

    /// Returns its image formats.
    pub(crate) fn registry(&self) -> FormatRegistry {
        self.registry.clone()
    }

    /// Returns the images of the frames that go to the program.
    pub(crate) fn requested(&self) -> RequestedImages {
        self.requested.clone()
    }

    /// Returns the records of the frames so far.
    pub(crate) fn frames(&self) -> Vec<FrameRecord> {
        self.finished.0.frames().clone()
    }
}

/// Receives the calls of a scene file.
struct FileSink<'a> {
    state: &'a mut State,
    /// Becomes true at a `Command`.
    commanded: &'a mut bool,
    /// The number of the frame, which replaces `$frame` in texts.
    number: Option<i32>,
}

impl SceneSink for FileSink<'_> {
    fn call(&mut self, mut call: Call, at: &Location) -> Result<(), Stop> {
        if let Some(number) = self.number {
            call.map_texts(&|text| granita_farm::with_frame(text, number));
        }
        *self.commanded |= matches!(call, Call::Command { .. });
        self.state.call(call, at)
    }

    fn in_world(&self) -> bool {
        self.state.in_world()
    }

    fn new_frame(&mut self) -> bool {
        self.state.new_frame()
    }

    fn attribute(&self, declaration: &str) -> Option<Param> {
        SceneSink::attribute(self.state, declaration)
    }
}

fn failed(error: InputError) -> SessionError {
    match error {
        InputError::Missing { command, places } => SessionError::Missing { name: command, places },
        InputError::Io { path, source } => SessionError::Io { path: path.into(), source },
        InputError::Stopped(stop) => stopped(stop),
        InputError::Scene { what, at } => SessionError::Scene { what, at },
        other => SessionError::Failed(other.to_string()),
    }
}

pub(crate) fn stopped(stop: Stop) -> SessionError {
    match stop {
        Stop::Exit => SessionError::Exit,
        other => SessionError::Failed(other.to_string()),
    }
}
