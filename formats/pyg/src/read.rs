//! The reader: flat statements at full speed, everything else by Python.

use crate::bytes::Bytes;
use crate::flat::{Parser, Statement, Why};
use crate::value::Value;
use crate::{calls, hint, names};
use granita_base::{Location, Reporter, Severity};
use granita_scene::{SceneSink, Stop};
use std::fs::File;
use std::io::{self, Read};
use std::path::PathBuf;
use std::sync::Arc;

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

    fn open(self) -> Result<Box<dyn Read>, PygError> {
        Ok(match self {
            Self::Path(path) => match File::open(&path) {
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
    /// Refuse scripts: for scenes from strangers.
    pub safe: bool,
    /// Most bytes of one statement.
    pub statement_limit: usize,
}

impl Default for PygOptions {
    fn default() -> Self {
        Self {
            always_pyglet: false,
            never_pyglet: false,
            chunking: Chunking::Auto,
            python: None,
            safe: false,
            statement_limit: 1 << 32,
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
    let stream = source.open()?;
    let parser = Parser::new(Bytes::new(stream, options.statement_limit));
    Reader { file, parser, sink, options, reporter }.run()
}

struct Reader<'a> {
    file: Arc<str>,
    parser: Parser,
    sink: &'a mut dyn SceneSink,
    options: &'a PygOptions,
    reporter: &'a Reporter,
}

impl Reader<'_> {
    fn run(&mut self) -> Result<(), PygError> {
        loop {
            let statement = self.parser.statement();
            let statement =
                statement.map_err(|source| PygError::Io { path: self.file.to_string(), source })?;
            match statement {
                Statement::End => return Ok(()),
                Statement::Nothing => {}
                Statement::Call { name, args, line } => self.flat_call(&name, args, line)?,
                Statement::Python { line, why } => return self.python(line, &why),
            }
        }
    }

    fn flat_call(&mut self, name: &str, args: Vec<Value>, line: u32) -> Result<(), PygError> {
        let at = Location::line(&self.file, line);
        match calls::call(name, args) {
            Some(Ok(call)) => self.sink.call(call, &at)?,
            Some(Err(mistake)) => {
                self.reporter.say(Severity::Error, &at, format!("{mistake}: the call is ignored"))
            }
            // What it returns is not used.
            None if name == "GetAttribute" => {}
            None => {
                let hint = hint(granita_scene::suggestion(name, names::CALLS));
                let cause = format!("pyg unknown call {name}");
                self.reporter.once(&cause, Severity::Error, &at, format!("unknown call \"{name}\"{hint}"));
            }
        }
        Ok(())
    }

    fn python(&mut self, line: u32, why: &Why) -> Result<(), PygError> {
        let at = Location::line(&self.file, line);
        let _ = self.options;
        let what = format!("{} at line {}: Python in scene files is not supported yet", why.what, why.line);
        Err(PygError::Malformed { what, at })
    }
}
