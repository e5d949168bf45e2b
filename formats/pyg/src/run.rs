//! The part of the reader that runs scripts. It passes pieces of Python to a child interpreter, and passes its calls
//! on.
//!
//! After an error in a script, the top-level statement that contains it is lost, like a flat call with an error. The
//! script ends early only when it requests that, or when nothing in it can be read.

use crate::flat::{Statement, Why};
use crate::python::{Event, Exception, Python};
use crate::reader::{Next, Reader, object};
use crate::{PygError, hint, names, script};
use granita_base::{Location, Severity};
use granita_scene::Stop;
use std::io;
use std::path::Path;

/// The number of unreadable statements after which a file does not count as a scene.
const MAX_UNREAD: usize = 20;
/// The number of unreadable statements after which a file does not count as a scene, when nothing else could be read.
const MAX_UNREAD_ALONE: usize = 3;
/// The number of exceptions that are reported. Further ones are counted.
const MAX_TOLD: usize = 20;
/// The number of times that an interpreter that ended early is replaced.
const MAX_DEATHS: usize = 3;

/// The size, in bytes, up to which Python statements are gathered. Python takes longer to find the line of a call in a
/// longer piece.
const BATCH: usize = 1 << 15;

/// The reason why a piece of script failed.
enum Failed {
    /// The piece is not valid Python. Nothing of it was executed, and the interpreter continues.
    Unread(Exception),
    /// The interpreter has ended.
    Died(io::Error),
    /// The script, or the sink of its calls, ended the reading.
    Ended(PygError),
}

impl From<PygError> for Failed {
    fn from(error: PygError) -> Self {
        Self::Ended(error)
    }
}

/// Statements for Python, with the line of the first one.
struct Piece {
    line: u32,
    code: Vec<u8>,
    /// The line of each statement, and its index in `code`.
    begins: Vec<(u32, usize)>,
}

impl Piece {
    fn new(line: u32) -> Self {
        Self { line, code: Vec::new(), begins: Vec::new() }
    }

    /// Ends the last line, and adds empty lines up to `line` in place of comments that were left out.
    fn go_to(&mut self, line: u32) {
        if !self.code.is_empty() && self.code.last() != Some(&b'\n') {
            self.code.push(b'\n');
        }
        let lines = self.code.iter().filter(|c| **c == b'\n').count() as u32;
        let missing = (line - self.line).saturating_sub(lines);
        self.code.extend(std::iter::repeat_n(b'\n', missing as usize));
        self.begins.push((line, self.code.len()));
    }
}

impl Reader<'_> {
    /// Gathers statements until the next flat one, and executes them.
    pub(crate) fn some_python(&mut self, line: u32, why: &Why) -> Result<Next, PygError> {
        let mut piece = Piece::new(line);
        piece.go_to(line);
        if let Some(missing) = self.take(&mut piece.code)? {
            self.missing(line, missing);
            return Ok(Next::More);
        }
        self.start(why)?;
        let mut flat = None;
        while piece.code.len() < BATCH {
            match self.statement()? {
                Statement::Python { line: next, .. } => {
                    let mark = self.parser.bytes.mark();
                    let before = piece.code.len();
                    piece.go_to(next);
                    if self.take(&mut piece.code)?.is_some() {
                        // It is reported when it is read again.
                        piece.begins.pop();
                        piece.code.truncate(before);
                        self.parser.bytes.back_to(mark);
                        break;
                    }
                }
                other => {
                    flat = Some(other);
                    break;
                }
            }
        }
        if self.piece(&piece)? == Next::End {
            return Ok(Next::End);
        }
        match flat {
            None | Some(Statement::Nothing | Statement::Python { .. }) => Ok(Next::More),
            Some(Statement::End) => Ok(Next::End),
            Some(Statement::Broken(why)) => Err(self.malformed(why)),
            Some(Statement::Call { name, args, line }) => {
                // The executed piece may have changed the meaning of the name.
                if self.script.rebound {
                    self.parser.again();
                    return Ok(Next::More);
                }
                self.flat_call(&name, args, line).map(|()| Next::More)
            }
        }
    }

    /// Takes the next statement for Python. A call of the scene interface in which a string or a bracket has no end is
    /// skipped up to the next line with a call. The missing part is then returned.
    fn take(&mut self, code: &mut Vec<u8>) -> Result<Option<&'static str>, PygError> {
        let mark = self.parser.bytes.mark();
        let start = code.len();
        let missing =
            script::take_statement(&mut self.parser.bytes, code).map_err(|source| self.io(source))?;
        let is_call = script::begins_with_call(&code[start..]);
        if missing.is_none() || !is_call || self.script.unread >= MAX_UNREAD {
            return Ok(None);
        }
        self.parser.bytes.back_to(mark);
        script::skip_to_call(&mut self.parser.bytes).map_err(|source| self.io(source))?;
        Ok(missing)
    }

    /// Reports a call that has no end.
    fn missing(&mut self, line: u32, missing: &str) {
        self.script.unread += 1;
        let text = format!("{missing}: the call is ignored{}", object(self.sink));
        self.reporter.say(Severity::Error, &Location::line(&self.file, line), text);
    }

    /// Gathers statements of any kind, and executes them.
    pub(crate) fn next_python(&mut self, why: &Why) -> Result<Next, PygError> {
        self.start(why)?;
        self.parser.bytes.forget();
        let mut piece = Piece::new(self.parser.bytes.line());
        while piece.code.len() < BATCH
            && self.parser.bytes.peek().map_err(|source| self.io(source))?.is_some()
        {
            let line = self.parser.bytes.line();
            let before = piece.code.len();
            piece.go_to(line);
            if let Some(missing) = self.take(&mut piece.code)? {
                piece.begins.pop();
                piece.code.truncate(before);
                self.missing(line, missing);
                // Lines must agree with those of the file, and calls must keep their order.
                break;
            }
        }
        let end = self.parser.bytes.peek().map_err(|source| self.io(source))?.is_none();
        if piece.code.is_empty() {
            return Ok(if end { Next::End } else { Next::More });
        }
        self.piece(&piece)
    }

    /// Executes the rest of the file as one piece.
    pub(crate) fn all_python(&mut self, why: &Why) -> Result<Next, PygError> {
        self.start(why)?;
        let mut piece = Piece::new(self.parser.bytes.line());
        piece.go_to(piece.line);
        let taken = script::take_rest(&mut self.parser.bytes, &mut piece.code);
        taken.map_err(|source| self.io(source))?;
        self.piece(&piece)?;
        Ok(Next::End)
    }

    /// Starts the interpreter, if scripts are allowed.
    fn start(&mut self, why: &Why) -> Result<(), PygError> {
        if self.script.python.is_some() {
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
        let (environment, supervisor) = (&self.options.environment, &self.options.supervisor);
        match Python::start(program, &self.file, environment, supervisor) {
            Ok(python) => self.script.python = Some(python),
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

    /// Executes a piece. When it is not valid Python, its statements are executed one after the other, and the invalid
    /// ones are reported.
    fn piece(&mut self, piece: &Piece) -> Result<Next, PygError> {
        let unread = match self.execute(piece.line, &piece.code) {
            Ok(next) => return Ok(next),
            Err(Failed::Unread(unread)) => unread,
            Err(Failed::Died(error)) => return self.died(piece.line, &error),
            Err(Failed::Ended(error)) => return Err(error),
        };
        if let [_] = piece.begins[..] {
            self.unread(unread, &piece.code)?;
            return Ok(Next::More);
        }
        for (i, &(line, start)) in piece.begins.iter().enumerate() {
            let end = piece.begins.get(i + 1).map_or(piece.code.len(), |b| b.1);
            let statement = piece.code.get(start..end).unwrap_or_default();
            match self.execute(line, statement) {
                Ok(Next::More) => {}
                Ok(Next::End) => return Ok(Next::End),
                Err(Failed::Unread(unread)) => self.unread(unread, statement)?,
                // The following statements may need definitions that are lost.
                Err(Failed::Died(error)) => return self.died(line, &error),
                Err(Failed::Ended(error)) => return Err(error),
            }
        }
        Ok(Next::More)
    }

    /// Reports a statement that is not valid Python. Returns an error when there are too many of them.
    fn unread(&mut self, unread: Exception, statement: &[u8]) -> Result<(), PygError> {
        self.script.unread += 1;
        let at = Location::line(&self.file, unread.line);
        let what = format!("{}: {}", unread.kind, unread.text);
        let most = if self.script.read { MAX_UNREAD } else { MAX_UNREAD_ALONE };
        if self.script.unread >= most {
            let what = format!("{what}; after {most} such statements the rest of the file is not read");
            return Err(PygError::Malformed { what, at });
        }
        let kind = if script::begins_with_call(statement) { "call" } else { "statement" };
        let text = format!("{what}: the {kind} is ignored{}", object(self.sink));
        self.reporter.say(Severity::Error, &at, text);
        Ok(())
    }

    /// Reports a statement that ended with an exception.
    fn raised(&mut self, raised: &Exception) {
        self.script.raised += 1;
        if self.script.raised <= MAX_TOLD {
            let at = Location::line(&self.file, raised.line);
            let object = object(self.sink);
            let text = format!("{}: the rest of the statement is ignored{object}", described(raised));
            self.reporter.say(Severity::Error, &at, text);
        }
    }

    /// Reports an interpreter that ended early. Returns an error when that has happened too often.
    fn died(&mut self, line: u32, error: &io::Error) -> Result<Next, PygError> {
        if self.options.supervisor.has_ended() {
            return Err(PygError::Stopped(Stop::Exit));
        }
        self.script.deaths += 1;
        self.script.rebound = false;
        let at = Location::line(&self.file, line);
        if self.script.deaths > MAX_DEATHS {
            return Err(PygError::Malformed { what: error.to_string(), at });
        }
        let text = format!("{error}: what the script has defined is lost, and reading goes on");
        self.reporter.say(Severity::Error, &at, text);
        Ok(Next::More)
    }

    /// Waits until the renderers that the script created have processed all their calls. It must be called at the end
    /// of the file.
    pub(crate) fn finish_renderers(&mut self) -> Result<(), PygError> {
        let line = self.parser.bytes.line();
        match self.script.python.is_some().then(|| self.execute(line, b"__granita_finish__ ()\n")) {
            Some(Err(Failed::Ended(error))) => Err(error),
            Some(Err(Failed::Died(error))) => self.died(line, &error).map(|_| ()),
            _ => Ok(()),
        }
    }

    /// Reports the number of exceptions that were only counted. It must be called at the end of the file.
    pub(crate) fn sum_up(&self) {
        if let Some(more) = self.script.raised.checked_sub(MAX_TOLD).filter(|more| *more > 0) {
            let at = Location { file: self.file.clone(), ..Location::default() };
            let text = format!("{more} more statements of the script ended with an exception");
            self.reporter.say(Severity::Error, &at, text);
        }
    }

    /// Executes a piece of script and passes its calls on.
    fn execute(&mut self, line: u32, code: &[u8]) -> Result<Next, Failed> {
        let why = Why { what: "this statement".into(), line };
        self.start(&why)?;
        let Some(mut python) = self.script.python.take() else { return Ok(Next::End) };
        let next = self.converse(&mut python, line, code);
        self.script.read |= next.is_ok();
        // After any other failure, the state of the script is unknown.
        if matches!(next, Ok(_) | Err(Failed::Unread(_))) {
            self.script.python = Some(python);
        }
        next
    }

    fn converse(&mut self, python: &mut Python, line: u32, code: &[u8]) -> Result<Next, Failed> {
        python.execute(line, code).map_err(Failed::Died)?;
        let mut printed = String::new();
        loop {
            match python.event().map_err(Failed::Died)? {
                Event::Call { line, name, args } => self.flat_call(&name, args, line)?,
                Event::Get(name) => {
                    let value = self.sink.attribute(&name);
                    python.answer(value.as_ref()).map_err(Failed::Died)?;
                }
                // Only programs that start the renderer send these events.
                Event::File(_) | Event::Text(_) | Event::Wait => {}
                Event::Opened(names) => names.iter().for_each(|name| self.options.opened.add(name)),
                Event::Printed(text) => {
                    printed.push_str(&text);
                    while let Some(end) = printed.find('\n') {
                        let rest = printed.split_off(end + 1);
                        self.reporter.say(Severity::Message, &Location::default(), printed);
                        printed = rest;
                    }
                }
                Event::Raised(raised) => self.raised(&raised),
                Event::Done { rebound } => {
                    self.script.rebound |= rebound;
                    self.say_rest(printed);
                    return Ok(Next::More);
                }
                Event::Unread(unread) => return Err(Failed::Unread(unread)),
                Event::Ended(ended) => {
                    self.say_rest(printed);
                    let at = Location::line(&self.file, ended.line);
                    return Err(PygError::Malformed { what: described(&ended), at }.into());
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

    /// Reports a last printed line that has no line end.
    fn say_rest(&self, mut printed: String) {
        if !printed.is_empty() {
            printed.push('\n');
            self.reporter.say(Severity::Message, &Location::default(), printed);
        }
    }
}

/// Describes an exception. A missing name that is similar to a call is followed by the name of the call.
fn described(exception: &Exception) -> String {
    let missing = Some(&*exception.name).filter(|name| !name.is_empty());
    let hint = hint(missing.and_then(|name| granita_base::suggestion(name, names::known())));
    format!("{}: {}{hint}", exception.kind, exception.text)
}
