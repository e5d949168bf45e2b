//! The reader: flat statements at full speed, everything else by Python.

use crate::bytes::Bytes;
use crate::flat::{Parser, Statement, Why};
use crate::python::{Event, Python};
use crate::value::Value;
use crate::{calls, hint, names, script};
use granita_base::{Environment, Location, Reporter, Severity};
use granita_scene::{SceneSink, Stop};
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
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
    /// Variables that scripts see beside those of this process.
    pub environment: Environment,
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
            environment: Environment::empty(),
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
    let path = match &source {
        PygSource::Path(path) => Some(path.clone()),
        PygSource::Bytes { .. } | PygSource::Stream { .. } => None,
    };
    let stream = source.open()?;
    if let Some(path) = path {
        reporter.file_read(&path);
    }
    let parser = Parser::new(Bytes::new(stream, options.statement_limit));
    Reader { file, parser, sink, options, reporter, python: None, rebound: false, unread: 0 }.run()
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
            let hint = hint(granita_scene::suggestion(name, names::CALLS));
            let cause = format!("pyg unknown call {name}");
            reporter.counted(&cause, Severity::Error, at, format!("unknown call \"{name}\"{hint}"));
        }
    }
    Ok(())
}

/// The name of the object that is being made, for messages; nothing when it has none.
fn object(sink: &dyn SceneSink) -> String {
    match sink.attribute("string name").map(|p| p.data) {
        Some(granita_base::ParamData::String(name)) if name.first().is_some_and(|n| !n.is_empty()) => {
            format!(" (object \"{}\")", name[0])
        }
        _ => String::new(),
    }
}

struct Reader<'a> {
    file: Arc<str>,
    parser: Parser,
    sink: &'a mut dyn SceneSink,
    options: &'a PygOptions,
    reporter: &'a Reporter,
    python: Option<Python>,
    /// The script changed what the names of calls mean: nothing is flat any more.
    rebound: bool,
    /// Statements that could not be read and were passed over.
    unread: usize,
}

/// Whether to go on reading.
#[derive(PartialEq)]
enum Next {
    More,
    End,
}

/// How a piece of script failed.
enum Failed {
    /// It is no Python; nothing of it was executed, and the interpreter goes on.
    Unread(PygError),
    /// In its course.
    Ended(PygError),
}

impl From<PygError> for Failed {
    fn from(error: PygError) -> Self {
        Self::Ended(error)
    }
}

impl From<Failed> for PygError {
    fn from(failed: Failed) -> Self {
        let (Failed::Unread(error) | Failed::Ended(error)) = failed;
        error
    }
}

/// So many statements that cannot be read are passed over; a file with more of them is no scene.
const MAX_UNREAD: usize = 20;

/// Python statements are gathered up to this size. Finding the line of a call takes Python longer the longer the piece is.
const BATCH: usize = 1 << 15;

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
                    let next = if self.options.chunking == Chunking::Never || self.rebound {
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
    fn statement(&mut self) -> Result<Statement, PygError> {
        let (scripted, rebound) = (self.python.is_some(), self.rebound);
        self.parser.may_drop = !scripted;
        let is_flat =
            |name: &str| !rebound && (names::is_call(name) || !(scripted || names::is_python_builtin(name)));
        self.parser.statement(&is_flat).map_err(|source| self.io(source))
    }

    fn io(&self, source: io::Error) -> PygError {
        PygError::Io { path: self.file.to_string(), source }
    }

    fn flat_call(&mut self, name: &str, args: Vec<Value>, line: u32) -> Result<(), PygError> {
        let at = Location::line(&self.file, line);
        Ok(pass_on(name, args, &at, self.sink, self.reporter)?)
    }

    /// Gathers statements until the next flat one, and executes them.
    fn some_python(&mut self, line: u32, why: &Why) -> Result<Next, PygError> {
        let mut code = Vec::new();
        if let Some(missing) = self.take(&mut code)? {
            let at = Location::line(&self.file, line);
            self.unread += 1;
            let text = format!("{missing}: the call is ignored{}", object(self.sink));
            self.reporter.say(Severity::Error, &at, text);
            return Ok(Next::More);
        }
        self.start(why)?;
        let mut flat = None;
        // Where each statement begins: its line and its place in the code.
        let mut begins = vec![(line, 0)];
        loop {
            if code.last() != Some(&b'\n') {
                code.push(b'\n');
            }
            if code.len() >= BATCH {
                break;
            }
            match self.statement()? {
                Statement::Python { line: next, .. } => {
                    // Keeps the lines in step over comments that were left out.
                    let lines = code.iter().filter(|c| **c == b'\n').count() as u32;
                    let missing = (next - line).saturating_sub(lines);
                    code.extend(std::iter::repeat_n(b'\n', missing as usize));
                    let end = code.len();
                    let mark = self.parser.bytes.mark();
                    if self.take(&mut code)?.is_some() {
                        // Dealt with when it comes up again.
                        code.truncate(end);
                        self.parser.bytes.back_to(mark);
                        break;
                    }
                    begins.push((next, end));
                }
                other => {
                    flat = Some(other);
                    break;
                }
            }
        }
        let next = match self.execute(line, &code) {
            Err(Failed::Unread(_)) => self.one_by_one(&code, &begins)?,
            other => other?,
        };
        if next == Next::End {
            return Ok(Next::End);
        }
        match flat {
            None | Some(Statement::Nothing | Statement::Python { .. }) => Ok(Next::More),
            Some(Statement::End) => Ok(Next::End),
            Some(Statement::Broken(why)) => Err(self.malformed(why)),
            Some(Statement::Call { name, args, line }) => {
                // The piece just executed may have changed what the name means.
                if self.rebound {
                    self.parser.again();
                    return Ok(Next::More);
                }
                self.flat_call(&name, args, line).map(|()| Next::More)
            }
        }
    }

    /// Takes the next statement for Python. A call of the scene interface that is none, because a string or a bracket has
    /// no end, is passed over up to the next line with a call; what is missing is returned.
    fn take(&mut self, code: &mut Vec<u8>) -> Result<Option<&'static str>, PygError> {
        let mark = self.parser.bytes.mark();
        let start = code.len();
        let missing =
            script::take_statement(&mut self.parser.bytes, code).map_err(|source| self.io(source))?;
        let is_call = script::begins_with_call(&code[start..]);
        if missing.is_none() || !is_call || self.unread >= MAX_UNREAD {
            return Ok(None);
        }
        self.parser.bytes.back_to(mark);
        script::skip_to_call(&mut self.parser.bytes).map_err(|source| self.io(source))?;
        Ok(missing)
    }

    /// Executes statements one after the other. Of those that cannot be read, calls of the scene interface are reported
    /// and passed over, as other mistakes of single calls are; anything else ends the script.
    fn one_by_one(&mut self, code: &[u8], begins: &[(u32, usize)]) -> Result<Next, PygError> {
        for (i, &(line, start)) in begins.iter().enumerate() {
            let end = begins.get(i + 1).map_or(code.len(), |b| b.1);
            let statement = code.get(start..end).unwrap_or_default();
            match self.execute(line, statement) {
                Err(Failed::Unread(PygError::Malformed { what, at }))
                    if script::begins_with_call(statement) && self.unread < MAX_UNREAD =>
                {
                    self.unread += 1;
                    let text = format!("{what}: the call is ignored{}", object(self.sink));
                    self.reporter.say(Severity::Error, &at, text);
                }
                Ok(Next::More) => {}
                other => return Ok(other?),
            }
        }
        Ok(Next::More)
    }

    fn malformed(&self, why: Why) -> PygError {
        PygError::Malformed { what: why.what, at: Location::line(&self.file, why.line) }
    }

    /// Gathers statements, whatever they are, and executes them.
    fn next_python(&mut self, why: &Why) -> Result<Next, PygError> {
        self.start(why)?;
        self.parser.bytes.forget();
        let line = self.parser.bytes.line();
        let mut code = Vec::new();
        while code.len() < BATCH && self.parser.bytes.peek().map_err(|source| self.io(source))?.is_some() {
            let taken = script::take_statement(&mut self.parser.bytes, &mut code);
            taken.map_err(|source| self.io(source))?;
        }
        if code.is_empty() { Ok(Next::End) } else { Ok(self.execute(line, &code)?) }
    }

    /// Executes all that is left.
    fn all_python(&mut self, why: &Why) -> Result<Next, PygError> {
        self.start(why)?;
        let line = self.parser.bytes.line();
        let mut code = Vec::new();
        let taken = script::take_rest(&mut self.parser.bytes, &mut code);
        taken.map_err(|source| self.io(source))?;
        self.execute(line, &code)?;
        Ok(Next::End)
    }

    /// Starts the interpreter, if scripts are allowed.
    fn start(&mut self, why: &Why) -> Result<(), PygError> {
        if self.python.is_some() {
            return Ok(());
        }
        let at = Location::line(&self.file, why.line);
        let reason = &why.what;
        if self.options.always_pyglet {
            let what = format!("{reason} is not part of a flat scene, and only flat scenes are to be read");
            return Err(PygError::Malformed { what, at });
        }
        if self.options.safe {
            let what = format!("{at}: {reason} makes this a script, and scripts are not to be run");
            return Err(PygError::Unsupported(what));
        }
        let default = Path::new("python3");
        let program = self.options.python.as_deref().unwrap_or(default);
        match Python::start(program, &self.file, self.options.environment.iter()) {
            Ok(python) => self.python = Some(python),
            Err(error) => {
                let program = program.display();
                let what = format!(
                    "{at}: {reason} makes this a Python script, but {program} cannot be started: {error}"
                );
                return Err(PygError::Unsupported(what));
            }
        }
        Ok(())
    }

    /// Executes a piece of script and passes its calls on.
    fn execute(&mut self, line: u32, code: &[u8]) -> Result<Next, Failed> {
        let Some(mut python) = self.python.take() else { return Ok(Next::End) };
        let next = self.converse(&mut python, line, code);
        // After any other failure nobody knows what state the script is in.
        if matches!(next, Ok(_) | Err(Failed::Unread(_))) {
            self.python = Some(python);
        }
        next
    }

    fn converse(&mut self, python: &mut Python, line: u32, code: &[u8]) -> Result<Next, Failed> {
        let at = Location::line(&self.file, line);
        let broken = |what: io::Error| PygError::Malformed { what: what.to_string(), at: at.clone() };
        python.execute(line, code).map_err(broken)?;
        let mut printed = String::new();
        loop {
            match python.event().map_err(broken)? {
                Event::Call { line, name, args } => self.flat_call(&name, args, line)?,
                Event::Get(name) => {
                    let value = self.sink.attribute(&name);
                    python.answer(value.as_ref()).map_err(broken)?;
                }
                // Only programs that start the renderer send these.
                Event::File(_) | Event::Wait => {}
                Event::Printed(text) => {
                    printed.push_str(&text);
                    while let Some(end) = printed.find('\n') {
                        let rest = printed.split_off(end + 1);
                        self.reporter.say(Severity::Message, &Location::default(), printed);
                        printed = rest;
                    }
                }
                Event::Done { rebound } => {
                    self.rebound |= rebound;
                    self.say_rest(printed);
                    return Ok(Next::More);
                }
                Event::Error { line, kind, text, name, unread } => {
                    self.say_rest(printed);
                    let hint =
                        hint(granita_scene::suggestion(&name, names::CALLS).filter(|_| !name.is_empty()));
                    let what = format!("{kind}: {text}{hint}");
                    let error = PygError::Malformed { what, at: Location::line(&self.file, line) };
                    return Err(if unread { Failed::Unread(error) } else { Failed::Ended(error) });
                }
                Event::Exit { line, code, text } => {
                    self.say_rest(printed);
                    if code == 0 {
                        return Ok(Next::End);
                    }
                    let text = if text.is_empty() { format!("the script ended with {code}") } else { text };
                    return Err(
                        PygError::Malformed { what: text, at: Location::line(&self.file, line) }.into()
                    );
                }
            }
        }
    }

    /// A last printed line without an end.
    fn say_rest(&self, mut printed: String) {
        if !printed.is_empty() {
            printed.push('\n');
            self.reporter.say(Severity::Message, &Location::default(), printed);
        }
    }
}
