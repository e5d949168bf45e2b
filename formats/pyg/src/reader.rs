//! Reads the statements of a scene one by one. Flat statements become calls. The text of the others is kept for Python.

use crate::flat::{Parser, Statement, Why};
use crate::python::Python;
use crate::value::Value;
use crate::{PygError, PygOptions, calls, hint, names};
use granita_base::{Location, Reporter, Severity};
use granita_scene::{SceneSink, Stop};
use std::io;
use std::sync::Arc;

pub(crate) struct Reader<'a> {
    pub(crate) file: Arc<str>,
    pub(crate) parser: Parser,
    pub(crate) sink: &'a mut dyn SceneSink,
    pub(crate) options: &'a PygOptions,
    pub(crate) reporter: &'a Reporter,
    /// The state of the script.
    pub(crate) script: Script,
}

/// The state of the reading after a step.
#[derive(PartialEq)]
pub(crate) enum Next {
    More,
    End,
}

/// Makes a call from its name and arguments, and passes it on. Errors are reported.
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
        // Its return value is not used.
        None if name == "GetAttribute" => {}
        None => {
            let hint = hint(granita_base::suggestion(name, names::known()));
            let cause = format!("pyg unknown call {name}");
            reporter.counted(&cause, Severity::Error, at, format!("unknown call \"{name}\"{hint}"));
        }
    }
    Ok(())
}

/// The state of the script in a scene file.
#[derive(Default)]
pub(crate) struct Script {
    pub(crate) python: Option<Python>,
    /// True when the script changed the meaning of names of calls. Nothing is flat after that.
    pub(crate) rebound: bool,
    /// The number of statements that could not be read and were skipped.
    pub(crate) unread: usize,
    /// True when anything could be read.
    pub(crate) read: bool,
    /// The number of statements that ended with an exception.
    pub(crate) raised: usize,
    /// The number of interpreters that ended early.
    pub(crate) deaths: usize,
}

/// Returns the name of the current object, for messages; an empty string when it has none.
pub(crate) fn object(sink: &dyn SceneSink) -> String {
    match &*granita_scene::attr::NAME.ask(sink) {
        "" => String::new(),
        name => format!(" (object \"{name}\")"),
    }
}

impl Reader<'_> {
    /// Reads the next statement. A call of a name that only the script defines is a statement for Python.
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
