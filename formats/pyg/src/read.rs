//! The reader: flat statements at full speed, everything else by Python.

use crate::bytes::Bytes;
use crate::flat::{Parser, Statement, Why};
use crate::python::Python;
use crate::run::{Script, object};
use crate::value::Value;
use crate::{calls, hint, names};
use granita_base::{Environment, Files, Location, Reporter, Severity, Supervisor};
use granita_scene::{SceneSink, Stop};
use std::io::{self, Read};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Where a Pyg scene comes from.
pub enum PygSource {
    /// A file.
    Path(PathBuf),
    /// Text in memory, under the name that messages give it.
    Bytes {
        /// Shown in messages, as `<string>`.
        name: Arc<str>,
        /// The scene.
        bytes: Vec<u8>,
    },
    /// A stream, as standard input, under the name that messages give it.
    Stream {
        /// Shown in messages, as `<stdin>`.
        name: Arc<str>,
        /// The scene.
        stream: Box<dyn Read + Send>,
    },
}

impl std::fmt::Debug for PygSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "PygSource({})", self.name())
    }
}

impl PygSource {
    /// The name that messages give it.
    pub fn name(&self) -> Arc<str> {
        match self {
            Self::Path(path) => path.to_string_lossy().as_ref().into(),
            Self::Bytes { name, .. } | Self::Stream { name, .. } => name.clone(),
        }
    }

    fn open(self, files: &Files) -> Result<Box<dyn Read>, PygError> {
        Ok(match self {
            Self::Path(path) => match files.open(&path) {
                Ok(file) => Box::new(file),
                Err(source) => {
                    return Err(PygError::Io { path: path.to_string_lossy().into_owned(), source });
                }
            },
            Self::Bytes { bytes, .. } => Box::new(io::Cursor::new(bytes)),
            Self::Stream { stream, .. } => stream,
        })
    }
}

/// How much Python is executed at once (reference 3.6).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Chunking {
    /// Statement by statement; flat statements between them without Python.
    #[default]
    Auto,
    /// As [`Chunking::Auto`].
    Always,
    /// From the first statement that is not flat, the whole rest of the file at once.
    Never,
}

/// How to read.
#[derive(Clone, Debug)]
pub struct PygOptions {
    /// Everything is flat: never start Python (`PYG_ALWAYS_PYGLET`).
    pub always_pyglet: bool,
    /// Nothing is flat: give everything to Python (`PYG_NEVER_PYGLET`).
    pub never_pyglet: bool,
    /// How much Python is executed at once.
    pub chunking: Chunking,
    /// The interpreter; `python3` on the process's path when `None`.
    pub python: Option<PathBuf>,
    /// Variables that scripts see beside those of this process.
    pub environment: Environment,
    /// Refuse scripts: for scenes from strangers.
    pub safe: bool,
    /// Opens files.
    pub files: Files,
    /// Knows the interpreter as long as it runs.
    pub supervisor: Supervisor,
    /// Most bytes of one statement.
    pub statement_limit: usize,
    /// What scripts that were read with the same value have defined is known to this one as well, and the other way round.
    pub scripts: Option<Scripts>,
}

/// The interpreter of several scenes that count as one, as those of a command line do (reference 6.1). One at a time has
/// it; clones share it.
#[derive(Clone, Default)]
pub struct Scripts(Arc<Mutex<Option<Python>>>);

impl std::fmt::Debug for Scripts {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Scripts")
    }
}

impl Scripts {
    fn python(&self) -> MutexGuard<'_, Option<Python>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Default for PygOptions {
    fn default() -> Self {
        Self {
            always_pyglet: false,
            never_pyglet: false,
            chunking: Chunking::Auto,
            python: None,
            environment: Environment::empty(),
            safe: false,
            files: Files::default(),
            supervisor: Supervisor::default(),
            statement_limit: 1 << 32,
            scripts: None,
        }
    }
}

/// Why reading ended early. Mistakes inside of the scene are reported, not returned.
#[derive(Debug, thiserror::Error)]
pub enum PygError {
    /// The source cannot be read.
    #[error("cannot read {path}: {source}")]
    Io {
        /// Name of the source.
        path: String,
        /// What the system said.
        source: io::Error,
    },
    /// A text that is neither flat nor Python.
    #[error("{at}: {what}")]
    Malformed {
        /// What is wrong.
        what: String,
        /// Where.
        at: Location,
    },
    /// A script where none is allowed, or without an interpreter.
    #[error("{0}")]
    Unsupported(String),
    /// The sink wants no more.
    #[error(transparent)]
    Stopped(#[from] Stop),
}

/// Reads a scene and passes its calls on, one by one.
///
/// Mistakes of single calls go to `reporter` with file and line, and reading goes on. The result is an error
/// only when the rest cannot be read, or when the sink stops.
pub fn read(
    source: PygSource,
    sink: &mut dyn SceneSink,
    options: &PygOptions,
    reporter: &Reporter,
) -> Result<(), PygError> {
    let file = source.name();
    let path = match &source {
        PygSource::Path(path) => Some(path.clone()),
        PygSource::Bytes { .. } | PygSource::Stream { .. } => None,
    };
    let stream = source.open(&options.files)?;
    if let Some(path) = path {
        reporter.file_read(&path);
    }
    let parser = Parser::new(Bytes::new(stream, options.statement_limit));
    let mut script = Script::default();
    if let Some(mut python) = options.scripts.as_ref().and_then(|scripts| scripts.python().take())
        && !options.safe
        && !options.always_pyglet
        // One that has died is replaced when a script needs it.
        && let Ok(rebound) = python.go_on(&file)
    {
        script.rebound = rebound;
        script.python = Some(python);
    }
    let mut reader = Reader { file, parser, sink, options, reporter, script };
    let result = reader.run().and_then(|()| reader.finish_renderers());
    reader.sum_up();
    if let Some(scripts) = &options.scripts {
        *scripts.python() = reader.script.python.take();
    }
    result
}

/// Makes a call of its name and arguments, and passes it on; mistakes are reported.
pub(crate) fn pass_on(
    name: &str,
    args: Vec<Value>,
    at: &Location,
    sink: &mut dyn SceneSink,
    reporter: &Reporter,
) -> Result<(), Stop> {
    match calls::call(name, args) {
        Some(Ok(call)) => sink.call(call, at)?,
        Some(Err(mistake)) => {
            let text = format!("{mistake}: the call is ignored{}", object(sink));
            reporter.say(Severity::Error, at, text);
        }
        // What it returns is not used.
        None if name == "GetAttribute" => {}
        None => {
            let hint = hint(granita_base::suggestion(name, names::CALLS));
            let cause = format!("pyg unknown call {name}");
            reporter.counted(&cause, Severity::Error, at, format!("unknown call \"{name}\"{hint}"));
        }
    }
    Ok(())
}

pub(crate) struct Reader<'a> {
    pub(crate) file: Arc<str>,
    pub(crate) parser: Parser,
    pub(crate) sink: &'a mut dyn SceneSink,
    pub(crate) options: &'a PygOptions,
    pub(crate) reporter: &'a Reporter,
    /// Runs what is not flat.
    pub(crate) script: Script,
}

/// Whether to go on reading.
#[derive(PartialEq)]
pub(crate) enum Next {
    More,
    End,
}

impl Reader<'_> {
    fn run(&mut self) -> Result<(), PygError> {
        if self.options.never_pyglet {
            let why = Why { what: "every scene file".into(), line: 1 };
            if self.options.chunking == Chunking::Never {
                return self.all_python(&why).map(drop);
            }
            while self.next_python(&why)? == Next::More {}
            return Ok(());
        }
        loop {
            match self.statement()? {
                Statement::End => return Ok(()),
                Statement::Nothing => {}
                Statement::Call { name, args, line } => self.flat_call(&name, args, line)?,
                Statement::Broken(why) => return Err(self.malformed(why)),
                Statement::Python { line, why } => {
                    let next = if self.options.chunking == Chunking::Never || self.script.rebound {
                        self.all_python(&why)?
                    } else {
                        self.some_python(line, &why)?
                    };
                    if next == Next::End {
                        return Ok(());
                    }
                }
            }
        }
    }

    /// The next statement; names that only the script knows make it one for Python.
    pub(crate) fn statement(&mut self) -> Result<Statement, PygError> {
        let (scripted, rebound) = (self.script.python.is_some(), self.script.rebound);
        self.parser.may_drop = !scripted;
        let is_flat =
            |name: &str| !rebound && (names::is_call(name) || !(scripted || names::is_python_builtin(name)));
        self.parser.statement(&is_flat).map_err(|source| self.io(source))
    }

    pub(crate) fn io(&self, source: io::Error) -> PygError {
        PygError::Io { path: self.file.to_string(), source }
    }

    pub(crate) fn flat_call(&mut self, name: &str, args: Vec<Value>, line: u32) -> Result<(), PygError> {
        self.script.read = true;
        let at = Location::line(&self.file, line);
        Ok(pass_on(name, args, &at, self.sink, self.reporter)?)
    }

    pub(crate) fn malformed(&self, why: Why) -> PygError {
        PygError::Malformed { what: why.what, at: Location::line(&self.file, why.line) }
    }
}
