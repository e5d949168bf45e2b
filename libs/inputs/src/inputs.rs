//! Resolves the names of `Input` (reference 2.9) to scene files, generators, programs and strings.

use crate::programs::Output;
use crate::{RunOptions, shell};
use granita_base::{Files, Location, Reporter, SearchPath, Severity};
use granita_plugin::Plugins;
use granita_pyg::{OpenedFiles, PygError, PygOptions, PygSource, Scripts};
use granita_scene::{
    FoundInput, Generator, GeneratorError, GeneratorRegistry, GeneratorSource, InputPaths, SceneSink, Stop,
};
use std::ffi::OsStr;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The largest number of bytes that a program may write for a generator other than "pyg".
const MAX_OUTPUT: u64 = 2 << 30;

/// The reason why an input cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum InputError {
    /// No input has that name.
    #[error("cannot find Input \"{command}\" (looked in {places})")]
    Missing {
        /// The name that was given.
        command: String,
        /// The places that were searched.
        places: String,
    },
    /// No generator reads it.
    #[error("{0}")]
    Unsupported(String),
    /// It would run a program, and programs are not permitted.
    #[error("Input \"{0}\": programs are not allowed")]
    Refused(String),
    /// It cannot be read completely.
    #[error("{path}: {source}")]
    Io {
        /// The name of the source.
        path: String,
        /// The error of the system.
        source: io::Error,
    },
    /// Its content is invalid. The text contains the position.
    #[error("{0}")]
    Malformed(String),
    /// A scene cannot be read further.
    #[error("{at}: {what}")]
    Scene {
        /// A description of the error.
        what: String,
        /// The position of the error.
        at: Location,
    },
    /// The receiver of the calls stopped.
    #[error(transparent)]
    Stopped(#[from] Stop),
}

/// Finds inputs by the names of scenes and command lines.
#[derive(Clone, Debug)]
pub struct Inputs {
    options: Arc<RunOptions>,
    generators: GeneratorRegistry,
    plugins: Plugins,
    reporter: Reporter,
    /// The files that scripts opened.
    opened: OpenedFiles,
}

/// An input that was found but not opened.
#[derive(Debug)]
pub struct Input {
    identity: Arc<str>,
    kind: Kind,
    inputs: Inputs,
    scripts: Option<Scripts>,
}

/// The reader of an input.
enum Kind {
    Pyg(Origin),
    Generator(Arc<dyn Generator>, Origin),
}

/// The source of an input.
enum Origin {
    File(PathBuf),
    /// A name for messages, and the text.
    Bytes(String, Arc<[u8]>),
    Standard,
    /// The output of a line of the shell.
    Program(String),
    /// An argument of a generator that is not a file. The generator interprets it.
    Argument(String),
}

impl std::fmt::Debug for Kind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Pyg(_) => "pyg",
            Self::Generator(generator, _) => generator.name(),
        })
    }
}

impl Inputs {
    /// Returns inputs with the bundled generators.
    pub fn new(options: Arc<RunOptions>, reporter: Reporter) -> Self {
        let plugins = Plugins::new(reporter.clone(), options.plugin_rules());
        Self::with_plugins(options, reporter, plugins)
    }

    /// Returns inputs that also have the generators of `plugins`.
    pub fn with_plugins(options: Arc<RunOptions>, reporter: Reporter, plugins: Plugins) -> Self {
        let (generators, opened) = (granita_plugin::bundled_generators(), OpenedFiles::default());
        Self { options, generators, plugins, reporter, opened }
    }

    /// Returns the files that scripts opened so far.
    pub fn opened(&self) -> Vec<PathBuf> {
        self.opened.list()
    }

    /// Returns the generator called `name`. Generators that the user named come first, then bundled ones, then
    /// installed ones.
    fn generator(&self, name: &str, paths: InputPaths<'_>) -> Option<Arc<dyn Generator>> {
        self.plugins
            .preferred_generator(name)
            .or_else(|| self.generators.by_name(&name.to_ascii_lowercase()).cloned())
            .or_else(|| self.plugins.generator(name, &self.folders(paths.generator)))
    }

    /// Finds the input that `command` names. A whole file name has precedence, so that names may contain blanks.
    /// Then follow a generator with its argument, and a program on the path of generators.
    ///
    /// # Errors
    /// Returns [`InputError::Missing`], [`InputError::Unsupported`] or [`InputError::Refused`].
    pub fn find(&self, command: &str, paths: InputPaths<'_>) -> Result<Input, InputError> {
        let command = command.trim();
        if let Some(found) = self.scene_file(command, paths) {
            return match found {
                Origin::File(path) => self.file(&path, paths),
                bundled => Ok(self.input(command, Kind::Pyg(bundled))),
            };
        }
        let (word, rest) = command.split_once(char::is_whitespace).unwrap_or((command, ""));
        let rest = rest.trim_start();
        let missing = || InputError::Missing { command: command.to_owned(), places: self.places(paths) };
        let generator = if word == "pyg" { None } else { self.generator(word, paths) };
        if word == "pyg" || generator.is_some() {
            let from = if let Some(text) = rest.strip_prefix("<<") {
                Origin::Bytes("<string>".to_owned(), text.trim_start().as_bytes().into())
            } else if let Some(program) = rest.strip_prefix('<') {
                self.program(command, program.trim().to_owned())?
            } else if let Some(found) = self.scene_file(rest.trim_end(), paths) {
                found
            } else if rest.trim_end() == "-" {
                Origin::Standard
            } else if word == "pyg" {
                return Err(missing());
            } else {
                Origin::Argument(rest.trim_end().to_owned())
            };
            return Ok(self.input(
                command,
                match generator {
                    Some(generator) => Kind::Generator(generator, from),
                    None => Kind::Pyg(from),
                },
            ));
        }
        let folders = self.folders(paths.generator);
        if word.is_empty() || word.contains('/') {
            return Err(missing());
        }
        match folders.find(word).filter(|file| is_executable(&self.files().place(file))) {
            Some(file) => {
                let line = format!("{} {rest}", self.own_program(&file));
                Ok(self.input(command, Kind::Pyg(self.program(command, line)?)))
            }
            None => Err(missing()),
        }
    }

    /// Finds a scene file by its path.
    ///
    /// # Errors
    /// Returns [`InputError::Unsupported`] when no generator reads files of its kind, or [`InputError::Refused`].
    pub fn file(&self, path: &Path, paths: InputPaths<'_>) -> Result<Input, InputError> {
        let identity = std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let identity = identity.to_string_lossy().into_owned();
        let from = Origin::File(path.to_owned());
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        let foreign = extension.as_deref().filter(|extension| !matches!(*extension, "pyg" | "py"));
        let generator = foreign
            .and_then(|extension| self.plugins.preferred_generator(extension))
            .or_else(|| self.generators.by_extension(path).cloned())
            .or_else(|| self.plugins.generator(foreign?, &self.folders(paths.generator)));
        if let Some(generator) = generator {
            return Ok(self.input(&identity, Kind::Generator(generator, from)));
        }
        match extension.as_deref() {
            Some("pyg" | "py") => Ok(self.input(&identity, Kind::Pyg(from))),
            None if is_executable(&self.files().place(path)) => {
                let program = self.program(&path.display().to_string(), self.own_program(path))?;
                Ok(self.input(&identity, Kind::Pyg(program)))
            }
            None => Ok(self.input(&identity, Kind::Pyg(from))),
            Some(extension) => {
                let known = self.generators.iter().flat_map(|g| g.extensions().iter().copied());
                let known: Vec<&str> = std::iter::once("pyg").chain(known).collect();
                Err(InputError::Unsupported(format!(
                    "{}: no generator reads files of type \"{extension}\" (known are {})",
                    path.display(),
                    known.join(", ")
                )))
            }
        }
    }

    /// Returns the options for reading a scene as Pyg.
    pub fn pyg_options(&self) -> PygOptions {
        let set = |name: &str| self.options.environment.get(name).is_some();
        PygOptions {
            always_pyglet: set("PYG_ALWAYS_PYGLET"),
            never_pyglet: set("PYG_NEVER_PYGLET"),
            chunking: match (set("PYG_ALWAYS_CHUNK"), set("PYG_NEVER_CHUNK")) {
                (_, true) => granita_pyg::Chunking::Never,
                (true, false) => granita_pyg::Chunking::Always,
                _ => granita_pyg::Chunking::Auto,
            },
            safe: self.options.safe,
            files: self.files().clone(),
            supervisor: self.options.supervisor.clone(),
            environment: self.script_environment().into_iter().collect(),
            opened: self.opened.clone(),
            ..PygOptions::default()
        }
    }

    /// Returns the environment of scripts. It includes the program that `CreateRenderer` starts, which is this one
    /// unless "GELATO" names another.
    fn script_environment(&self) -> Vec<(String, String)> {
        let mut environment = self.options.program_environment.clone();
        let own = self.options.own_tools.as_ref().filter(|own| own.names.iter().any(|name| name == "gelato"));
        if let (Some(own), None) = (own, self.options.environment.get("GELATO")) {
            environment.push(("GELATO".to_owned(), own.program.to_string_lossy().into_owned()));
        }
        environment
    }

    /// Returns the object that opens files.
    fn files(&self) -> &Files {
        self.options.environment.files()
    }

    fn input(&self, identity: &str, kind: Kind) -> Input {
        Input { identity: identity.into(), kind, inputs: self.clone(), scripts: None }
    }

    fn program(&self, command: &str, line: String) -> Result<Origin, InputError> {
        if self.options.safe {
            return Err(InputError::Refused(command.to_owned()));
        }
        Ok(Origin::Program(line))
    }

    /// Returns the word of the shell that runs a program which is a file of the scene.
    fn own_program(&self, file: &Path) -> String {
        self.reporter.file_read(file);
        quoted(&self.files().place(file))
    }

    fn scene_file(&self, name: &str, paths: InputPaths<'_>) -> Option<Origin> {
        if name.is_empty() {
            return None;
        }
        self.folders(paths.input).find(name).map(Origin::File).or_else(|| {
            let bytes = granita_bundled::input(name)?;
            Some(Origin::Bytes(format!("<bundled>/{name}"), bytes.into()))
        })
    }

    fn folders(&self, path: &str) -> SearchPath {
        SearchPath::parse(path, &SearchPath::default(), &self.options.environment)
    }

    fn places(&self, paths: InputPaths<'_>) -> String {
        let list = |path: &str| {
            let folders = self.folders(path);
            folders.folders().iter().map(|f| f.display().to_string()).collect::<Vec<_>>().join(", ")
        };
        let (files, generators) = (list(paths.input), list(paths.generator));
        format!("{files}, and the bundled inputs; for generators in {generators}, and the bundled ones")
    }
}

impl Input {
    /// Returns the identity of the input. The same file has the same identity under any name.
    pub fn identity(&self) -> &Arc<str> {
        &self.identity
    }

    /// Returns the input as a part of a scene whose parts share the definitions of their scripts.
    pub fn sharing(self, scripts: Scripts) -> Self {
        Self { scripts: Some(scripts), ..self }
    }

    /// Returns the line of the shell whose output it is; `None` when no program runs.
    pub fn program(&self) -> Option<&str> {
        match &self.kind {
            Kind::Pyg(Origin::Program(line)) | Kind::Generator(_, Origin::Program(line)) => Some(line),
            _ => None,
        }
    }

    /// Returns the files that it names: its own, or those of the words of a generator's argument.
    pub fn files(&self) -> Vec<PathBuf> {
        let files = self.inputs.files();
        match &self.kind {
            Kind::Pyg(Origin::File(path)) | Kind::Generator(_, Origin::File(path)) => vec![path.clone()],
            Kind::Generator(_, Origin::Argument(argument)) => {
                let words = std::iter::once(&**argument).chain(argument.split_whitespace());
                words.map(PathBuf::from).filter(|path| files.is_file(path)).collect()
            }
            _ => Vec::new(),
        }
    }

    /// True when it may contain a whole scene, and not only objects for one.
    pub fn makes_frames(&self) -> bool {
        match &self.kind {
            Kind::Pyg(_) => true,
            Kind::Generator(generator, _) => generator.makes_frames(),
        }
    }

    /// Returns the bound that its generator finds without reading all of it.
    pub fn bound(&self) -> Option<[f32; 6]> {
        match &self.kind {
            Kind::Generator(_, Origin::Program(_) | Origin::Standard) | Kind::Pyg(_) => None,
            Kind::Generator(generator, from) => generator.bound(&from.source(self.inputs.files())?),
        }
    }

    /// Reads the input and passes its calls to `sink`. Errors that do not end reading are reported, not returned.
    ///
    /// # Errors
    /// Returns [`InputError::Io`], [`InputError::Malformed`], [`InputError::Unsupported`] or
    /// [`InputError::Stopped`].
    pub fn read(self, sink: &mut dyn SceneSink) -> Result<(), InputError> {
        let named = self.files();
        let Self { kind, inputs, scripts, .. } = self;
        let reporter = &inputs.reporter;
        let (from, generator) = match kind {
            Kind::Pyg(from) => (from, None),
            Kind::Generator(generator, from) => (from, Some(generator)),
        };
        let doing = format!("reading {}", from.name());
        reporter.info(doing.clone());
        let _activity = inputs.options.supervisor.begin(doing);
        let Some(generator) = generator else {
            let options = PygOptions { scripts, ..inputs.pyg_options() };
            return granita_pyg::read(from.pyg(&inputs.options)?, sink, &options, reporter)
                .map_err(InputError::from);
        };
        named.iter().for_each(|file| reporter.file_read(file));
        let (name, source) = (from.name(), from.source(inputs.files()));
        let source = match (source, from) {
            (Some(source), _) => source,
            (None, from) => {
                let PygSource::Stream { mut stream, .. } = from.pyg(&inputs.options)? else {
                    return Err(InputError::Unsupported(format!("{name}: not a stream")));
                };
                let io = |source| InputError::Io { path: name.clone(), source };
                let mut bytes = Vec::new();
                stream.by_ref().take(MAX_OUTPUT + 1).read_to_end(&mut bytes).map_err(io)?;
                if bytes.len() as u64 > MAX_OUTPUT {
                    return Err(io(io::Error::other(format!("more than {MAX_OUTPUT} bytes"))));
                }
                GeneratorSource::bytes(name, bytes).with_files(inputs.files())
            }
        };
        generator.run(&source, sink, reporter).map_err(|error| match error {
            GeneratorError::Io { name, source } => InputError::Io { path: name, source },
            GeneratorError::Malformed(text) => InputError::Malformed(text),
            GeneratorError::Unsupported(text) => InputError::Unsupported(text),
            GeneratorError::Stopped(stop) => InputError::Stopped(stop),
        })
    }

    /// Returns the input for the graphics state. An error that prevents reading is reported when it is read.
    pub fn found(self, command: &str, at: &Location) -> FoundInput {
        let reporter = self.inputs.reporter.clone();
        let (command, at) = (command.to_owned(), at.clone());
        FoundInput {
            identity: self.identity.clone(),
            bound: self.bound(),
            reader: Box::new(move |sink: &mut dyn SceneSink| match self.read(sink) {
                Ok(()) => Ok(()),
                Err(InputError::Stopped(stop)) => Err(stop),
                Err(error) => {
                    match error {
                        InputError::Scene { what, at } => reporter.say(Severity::Error, &at, what),
                        other => {
                            // Most errors begin with the name of the input.
                            let text = other.to_string();
                            let named = text.starts_with(&command);
                            let text = if named { text } else { format!("Input \"{command}\": {text}") };
                            reporter.say(Severity::Error, &at, text);
                        }
                    }
                    Ok(())
                }
            }),
        }
    }
}

impl Origin {
    fn name(&self) -> String {
        match self {
            Self::File(path) => path.display().to_string(),
            Self::Bytes(name, _) => name.clone(),
            Self::Standard => "<stdin>".to_owned(),
            Self::Program(line) => format!("< {line}"),
            Self::Argument(argument) => argument.clone(),
        }
    }

    /// Returns the source for a generator; `None` for one that must be collected from a stream.
    fn source(&self, files: &Files) -> Option<GeneratorSource> {
        Some(match self {
            Self::File(path) => GeneratorSource::file(path.clone()).with_files(files),
            Self::Argument(argument) => GeneratorSource::file(argument.clone()).with_files(files),
            Self::Bytes(name, bytes) => GeneratorSource::bytes(name.clone(), bytes.clone()).with_files(files),
            Self::Standard | Self::Program(_) => return None,
        })
    }

    fn pyg(self, options: &RunOptions) -> Result<PygSource, InputError> {
        let name = self.name();
        Ok(match self {
            Self::File(path) => PygSource::Path(path),
            Self::Argument(argument) => PygSource::Path(argument.into()),
            Self::Bytes(name, bytes) => PygSource::Bytes { name: name.into(), bytes: bytes.to_vec() },
            Self::Standard => PygSource::Stream { name: name.into(), stream: Box::new(io::stdin()) },
            Self::Program(line) => {
                let stream = Output::start(shell(&line, options), line, &options.supervisor)
                    .map_err(|source| InputError::Io { path: name.clone(), source })?;
                PygSource::Stream { name: name.into(), stream: Box::new(stream) }
            }
        })
    }
}

impl From<PygError> for InputError {
    fn from(error: PygError) -> Self {
        match error {
            PygError::Io { path, source } => Self::Io { path, source },
            PygError::Stopped(stop) => Self::Stopped(stop),
            PygError::Unsupported(text) => Self::Unsupported(text),
            PygError::Malformed { what, at } => Self::Scene { what, at },
        }
    }
}

/// Returns a file name as one word of the shell. A name without a folder is not searched on `PATH`.
fn quoted(file: &Path) -> String {
    let has_folder = file.parent().is_some_and(|folder| folder != OsStr::new(""));
    let file = if has_folder { file.to_owned() } else { Path::new(".").join(file) };
    let text = file.to_string_lossy();
    if cfg!(windows) { format!("\"{text}\"") } else { format!("'{}'", text.replace('\'', "'\\''")) }
}

#[cfg(unix)]
fn is_executable(path: &Path) -> bool {
    use std::os::unix::fs::PermissionsExt;
    path.metadata().is_ok_and(|m| m.is_file() && m.permissions().mode() & 0o111 != 0)
}

#[cfg(not(unix))]
fn is_executable(path: &Path) -> bool {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    path.is_file() && matches!(extension.as_deref(), Some("exe" | "bat" | "cmd"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::Location;
    use granita_scene::Call;

    #[derive(Default)]
    struct Kept(Vec<String>);

    impl SceneSink for Kept {
        fn call(&mut self, call: Call, _: &Location) -> Result<(), Stop> {
            self.0.push(call.name().to_owned());
            Ok(())
        }
    }

    fn inputs(options: RunOptions) -> Inputs {
        Inputs::new(Arc::new(options), Reporter::silent())
    }

    fn read(command: &str, folder: &Path) -> Result<String, InputError> {
        let path = folder.to_str().unwrap();
        let mut kept = Kept::default();
        let input =
            inputs(RunOptions::default()).find(command, InputPaths { input: path, generator: path })?;
        input.read(&mut kept)?;
        Ok(kept.0.join(" "))
    }

    #[test]
    fn forms_of_input() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
        file("two words.pyg", "World ()");
        file("plain", "Render ()");
        file("some.thing", "");
        file("waves.generator.so", "");
        let read = |command: &str| read(command, folder.path());
        assert_eq!(read("two words.pyg").unwrap(), "World");
        assert_eq!(read("pyg two words.pyg").unwrap(), "World");
        assert_eq!(read("plain").unwrap(), "Render");
        assert_eq!(read("pyg << Sphere (1, -1, 1, 360)").unwrap(), "Sphere");
        assert_eq!(read("pyg < echo 'World ()'; echo 'Render ()'").unwrap(), "World Render");
        assert_eq!(read("frontplane.pyg").is_ok(), granita_bundled::input("frontplane.pyg").is_some());
        let failed = read("pyg < echo 'World ()'; exit 3").unwrap_err().to_string();
        assert!(failed.contains("failed: exit status: 3"), "{failed}");
        // A generator that is not a library is reported and not used.
        assert!(matches!(read("waves 3 4"), Err(InputError::Missing { .. })));
        let kind = read("some.thing").unwrap_err().to_string();
        assert!(kind.contains("no generator reads files of type \"thing\" (known are pyg"), "{kind}");
        for absent in ["absent.pyg", "pyg absent.pyg", "myproc 3.7 moo", "", "pyg", "nobody << text"] {
            assert!(matches!(read(absent), Err(InputError::Missing { .. })), "{absent}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn executables_on_the_path_are_generators() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("it's grass");
        let program = folder.path().join("grass");
        for path in [&file, &program] {
            granita_needs::write_script(path, "for i in \"$@\"; do echo \"Translate ($i, 0, 0)\"; done");
        }
        assert_eq!(read("grass 1 '2' 3", folder.path()).unwrap(), "Translate Translate Translate");
        assert_eq!(read("it's grass", folder.path()).unwrap(), "");
        std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o644)).unwrap();
        assert!(matches!(read("grass 1", folder.path()), Err(InputError::Missing { .. })));
        let path = folder.path().to_str().unwrap();
        std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
        let safe = inputs(RunOptions { safe: true, ..RunOptions::default() });
        for command in ["grass 1", "pyg < ls", "it's grass"] {
            let refused = safe.find(command, InputPaths { input: path, generator: path });
            assert!(matches!(refused, Err(InputError::Refused(_))), "{command}");
        }
    }

    #[test]
    fn the_same_file_has_one_identity() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.pyg"), "").unwrap();
        let path = folder.path().to_str().unwrap();
        let all = inputs(RunOptions::default());
        let found = all.find("a.pyg", InputPaths { input: path, generator: "." }).unwrap();
        let paths = InputPaths { input: path, generator: "." };
        let other = all.file(&folder.path().join(".").join("a.pyg"), paths).unwrap();
        assert_eq!(found.identity(), other.identity());
    }
}
