//! The session itself.

use crate::net::Master;
use crate::renderer::{Finished, SessionRenderer};
use crate::{FrameRecord, Input, InputError, Inputs, SessionError, SessionOptions, inputs, safe};
use granita_base::{Files, Location, Reporter, Severity};
use granita_plugin::Plugins;
use granita_pyg::PygError;
use granita_pyg::{PygOptions, PygSource, Scripts};
use granita_render::{Priority, Progress, Silent};
use granita_scene::attribute::{Key, scope};
use granita_scene::{Call, InputPaths, SceneSink, State, Stop, attr};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Is told how far a frame is.
#[derive(Clone)]
pub struct SharedProgress(pub Arc<dyn Progress>);

impl Default for SharedProgress {
    /// Tells nobody.
    fn default() -> Self {
        Self(Arc::new(Silent))
    }
}

impl std::fmt::Debug for SharedProgress {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("SharedProgress")
    }
}

/// What a session did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outcome {
    /// Whether a `Render` was reached.
    pub rendered: bool,
    /// Whether all frames have all their pixels and images.
    pub complete: bool,
    /// What each frame did.
    pub frames: Vec<FrameRecord>,
    /// Images written.
    pub images: Vec<PathBuf>,
    /// Primitives that wait for a `Render` that never came.
    pub waiting: usize,
    /// Errors reported.
    pub errors: usize,
    /// Warnings reported, shown or not.
    pub warnings: usize,
    /// Files read, sorted: scenes, shaders, textures and what the scene itself says ("fileread").
    pub files_read: Vec<PathBuf>,
}

/// One renderer: scene calls go in, images come out.
pub struct Session {
    state: State,
    reporter: Reporter,
    options: Arc<SessionOptions>,
    inputs: Inputs,
    plugins: Plugins,
    stop: Arc<AtomicBool>,
    priority: Arc<Priority>,
    /// A file that holds objects for a scene, and was read as if it were one.
    objects: Option<String>,
    finished: Finished,
    /// What the scripts of its scenes have defined.
    scripts: Scripts,
}

impl std::fmt::Debug for Session {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Session").field("options", &self.options).finish_non_exhaustive()
    }
}

impl Session {
    /// A fresh session; reads the startup files (reference 6.2), whose mistakes are reported.
    pub fn new(options: SessionOptions, reporter: Reporter, progress: SharedProgress) -> Self {
        Self::with_master(options, reporter, progress, None)
    }

    /// A session that renders buckets for another one, which it hears by `input` and answers by `output`: it runs no commands and
    /// writes no images (reference 6.6.3).
    pub fn worker(
        options: SessionOptions,
        reporter: Reporter,
        input: Box<dyn Read + Send>,
        output: Box<dyn Write + Send>,
    ) -> Self {
        let master = Master::new(input, output, options.threads.max(1), &reporter);
        Self::with_master(options, reporter, SharedProgress::default(), Some(master))
    }

    fn with_master(
        options: SessionOptions,
        reporter: Reporter,
        progress: SharedProgress,
        master: Option<Master>,
    ) -> Self {
        if let Some(verbosity) = options.verbosity {
            reporter.set_verbosity(verbosity);
        }
        let mut options = options;
        if options.safe && !options.environment.files().is_confined() {
            let files = safe::files(&options);
            options.environment.set_files(files);
        }
        if let Some(folder) = options.environment.get("GELATOTEMP").filter(|folder| !folder.is_empty()) {
            let folder = PathBuf::from(folder);
            if folder.is_dir() {
                let files = options.environment.files().clone().with_temporary(&folder);
                options.environment.set_files(files);
            } else {
                reporter.warning(format!(
                    "GELATOTEMP: \"{}\" is no folder; temporary files lie beside the results",
                    folder.display()
                ));
            }
        }
        let options = Arc::new(options);
        let finished = Finished::default();
        let renderer =
            SessionRenderer::new(options.clone(), reporter.clone(), progress.0, finished.clone(), master);
        let (inputs, plugins) = (renderer.inputs(), renderer.plugins());
        let (stop, priority) = (renderer.stop(), renderer.priority());
        let state = State::new(Box::new(renderer), reporter.clone());
        let scripts = Scripts::default();
        let mut session = Self {
            state,
            reporter,
            options,
            inputs,
            plugins,
            stop,
            priority,
            objects: None,
            finished,
            scripts,
        };
        session.read_startup_files();
        // Startup files are not a part of the scene.
        session.scripts = Scripts::default();
        if session.options.safe {
            safe::add_search_paths(&session.options, &session.state);
        }
        session
    }

    fn read_startup_files(&mut self) {
        if self.options.no_startup_files {
            return;
        }
        for variable in ["GELATOHOME", "HOME"] {
            let Some(folder) = self.options.environment.get(variable).filter(|f| !f.is_empty()) else {
                continue;
            };
            let path = Path::new(folder).join(".gelato.pyg");
            if path.is_file()
                && let Err(error) = self.read(self.file(&path), &path.to_string_lossy())
            {
                self.reporter.error(error.to_string());
            }
        }
    }

    /// Reads the scene `name`: "-" is standard input, handed in by [`Session::read_stream`]; otherwise a file, or
    /// what `Input` would find under that name. Scenes read one after the other count as one that contains them all
    /// (reference 6.1): what their scripts define goes on.
    ///
    /// Mistakes inside of the scene are reported and are no errors.
    ///
    /// # Errors
    /// [`SessionError::Missing`], [`SessionError::Io`]; [`SessionError::Exit`] when the scene asked to stop.
    pub fn read_file(&mut self, name: &str) -> Result<(), SessionError> {
        let path = Path::new(name);
        if path.is_file() {
            return self.read(self.file(path), name);
        }
        if path.is_dir() {
            return Err(SessionError::Failed(format!("{name} is a folder, not a scene")));
        }
        self.input(name)
    }

    /// Reads a scene from a stream, as standard input; `name` stands for it in messages.
    ///
    /// # Errors
    /// As [`Session::read_file`].
    pub fn read_stream(&mut self, name: &str, stream: Box<dyn Read + Send>) -> Result<(), SessionError> {
        let options = PygOptions { scripts: Some(self.scripts.clone()), ..self.inputs.pyg_options() };
        let source = PygSource::Stream { name: name.into(), stream };
        let reporter = self.reporter.clone();
        let read = |state: &mut State| granita_pyg::read(source, state, &options, &reporter);
        self.state.read(name, name, read).map_err(|error| failed(inputs::pyg_error(error)))
    }

    /// Takes calls from a program that started this one, until its stream ends; answers go to `output` (see
    /// `granita_pyg::serve`).
    ///
    /// # Errors
    /// As [`Session::read_file`].
    pub fn serve(&mut self, input: &mut dyn Read, output: &mut dyn Write) -> Result<(), SessionError> {
        granita_pyg::serve(input, output, &mut self.state, &self.reporter).map_err(|error| match error {
            PygError::Stopped(stop) => stopped(stop),
            other => SessionError::Failed(other.to_string()),
        })
    }

    /// As the scene call `Input` without a bound.
    ///
    /// # Errors
    /// As [`Session::read_file`].
    pub fn input(&mut self, command: &str) -> Result<(), SessionError> {
        let (input, generator) = (self.path(attr::PATH_INPUT), self.path(attr::PATH_GENERATOR));
        let found = self.inputs.find(command, InputPaths { input: &input, generator: &generator });
        self.read(found, command)
    }

    /// Takes one call of the scene interface.
    ///
    /// # Errors
    /// [`SessionError::Exit`], [`SessionError::Failed`].
    pub fn call(&mut self, call: Call) -> Result<(), SessionError> {
        self.state.call(call, &Location::default()).map_err(stopped)
    }

    /// The graphics state, for readers and bindings that make calls themselves.
    pub fn state(&mut self) -> &mut State {
        &mut self.state
    }

    /// The same, to be looked at.
    pub fn state_ref(&self) -> &State {
        &self.state
    }

    /// To be called when nothing more comes: reports blocks left open and sums up.
    pub fn finish(mut self) -> Outcome {
        self.state.end();
        if let Some(name) = self.objects.filter(|_| !self.state.has_rendered()) {
            self.reporter.error(format!(
                "nothing was rendered: {name} holds objects and no Render (); render a scene that has Input (\"{name}\") \
                 after World (), or see it as Pyg with topyg"
            ));
        }
        let frames = self.finished.0.frames().clone();
        Outcome {
            rendered: self.state.has_rendered(),
            complete: frames.iter().all(|f| f.complete),
            images: frames.iter().flat_map(|f| f.images.iter().cloned()).collect(),
            frames,
            waiting: self.state.primitive_count(),
            errors: self.reporter.errors(),
            warnings: self.reporter.count(Severity::Warning),
            files_read: self.reporter.files_read(),
        }
    }

    /// The plugins that this session finds, and what its program lets it use.
    pub fn plugins(&self) -> &Plugins {
        &self.plugins
    }

    /// Where its messages go.
    pub fn reporter(&self) -> Reporter {
        self.reporter.clone()
    }

    /// What opens its files.
    pub fn files(&self) -> &Files {
        self.options.environment.files()
    }

    /// Set from any thread, it ends the frame that is being rendered as soon as that can be.
    pub fn stop(&self) -> Arc<AtomicBool> {
        self.stop.clone()
    }

    /// What comes first of the frame that is being rendered.
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
        if !input.makes_frames() {
            self.objects = Some(name.to_owned());
        }
        let identity = input.identity().clone();
        self.state.read(&identity, name, |state| input.read(state)).map_err(failed)
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

fn stopped(stop: Stop) -> SessionError {
    match stop {
        Stop::Exit => SessionError::Exit,
        other => SessionError::Failed(other.to_string()),
    }
}
