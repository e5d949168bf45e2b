//! The reader. It reads flat statements itself, and everything else with Python.

use crate::bytes::Bytes;
use crate::flat::{Parser, Statement, Why};
use crate::reader::{Next, Reader, Script};
use crate::{Chunking, PygError, PygOptions};
use granita_base::{Files, Reporter};
use granita_scene::SceneSink;
use std::io::{self, Read};
use std::path::PathBuf;
use std::sync::Arc;

/// The source of a Pyg scene.
pub enum PygSource {
    /// A file.
    Path(PathBuf),
    /// Text in memory.
    Bytes {
        /// The name in messages, such as `<string>`.
        name: Arc<str>,
        /// The text of the scene.
        bytes: Vec<u8>,
    },
    /// A stream, such as standard input.
    Stream {
        /// The name in messages, such as `<stdin>`.
        name: Arc<str>,
        /// The text of the scene.
        stream: Box<dyn Read + Send>,
    },
}

impl std::fmt::Debug for PygSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "PygSource({})", self.name())
    }
}

impl PygSource {
    /// Returns the name of the source in messages.
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

/// Reads a scene and passes its calls on, one by one.
///
/// Errors in single calls go to `reporter` with file and line, and reading continues. The result is an error only
/// when the rest cannot be read, or when the sink stops.
///
/// # Errors
/// Returns an error when the input cannot be read, when the rest of it cannot be parsed, and when the sink stops.
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
    // An interpreter that is not used here stays with the other files of the session.
    let scripts = options.scripts.as_ref().filter(|_| !options.safe && !options.always_pyglet);
    if let Some(scripts) = scripts
        && let Some(mut python) = scripts.python().take()
        // An interpreter that has ended is replaced when a script needs one.
        && let Ok(rebound) = python.go_on(&file)
    {
        script.rebound = rebound;
        script.python = Some(python);
    }
    let mut reader = Reader { file, parser, sink, options, reporter, script };
    let result = reader.run().and_then(|()| reader.finish_renderers());
    reader.sum_up();
    if let Some(scripts) = scripts {
        *scripts.python() = reader.script.python.take();
    }
    result
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
}
