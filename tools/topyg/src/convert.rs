//! Reads the inputs and writes their calls.

use crate::output::Output;
use granita_base::{Location, Param, Params, Reporter, Severity};
use granita_cli::Status;
use granita_pyg::{Writer, WriterOptions};
use granita_scene::{Call, FoundInput, FrameRenderer, InputPaths, Scene, SceneSink, State, Stop, attr};
use granita_session::{Input, InputError, Inputs, SessionOptions};
use std::io;
use std::path::Path;
use std::sync::Arc;

/// The actions.
#[derive(Debug)]
pub(crate) struct Job {
    pub(crate) inputs: Vec<String>,
    /// Levels of `Input` to expand.
    pub(crate) depth: u32,
    /// The search path of generators: a list of folders.
    pub(crate) generators: String,
    pub(crate) writer: WriterOptions,
    pub(crate) session: SessionOptions,
}

/// Converts all inputs, one behind the other.
pub(crate) fn run(job: &Job, output: Output, reporter: &Reporter) -> Status {
    let mut echo = Echo {
        job,
        finder: Inputs::new(Arc::new(job.session.clone()), reporter.clone()),
        chain: Vec::new(),
        reporter,
        writer: Writer::with_options(output, job.writer),
        state: State::new(Box::new(Nothing), Reporter::silent()),
        level: 0,
        calls: 0,
    };
    for input in &job.inputs {
        match echo.find(input).and_then(|found| echo.read(found)) {
            Ok(()) => {}
            Err(error) if is_broken_pipe(&error) => return Status::Done,
            Err(error) => {
                echo.report(error, &Location::default());
                return Status::Failed;
            }
        }
    }
    if job.session.supervisor.has_ended() {
        // The input is incomplete, so no file appears.
        return Status::Failed;
    }
    reporter.info(format!("{} calls", echo.calls));
    match echo.writer.into_inner().and_then(Output::finish) {
        Ok(()) if reporter.errors() > 0 => Status::WithErrors,
        Ok(()) => Status::Done,
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Status::Done,
        Err(error) => {
            reporter.error(format!("cannot write: {error}"));
            Status::Failed
        }
    }
}

fn is_broken_pipe(error: &InputError) -> bool {
    matches!(error, InputError::Stopped(Stop::Io(e)) if e.kind() == io::ErrorKind::BrokenPipe)
}

/// Writes calls, and tracks the attribute state for scripts that query it and for search paths.
struct Echo<'a> {
    job: &'a Job,
    finder: Inputs,
    /// The inputs being read, outermost first.
    chain: Vec<Arc<str>>,
    reporter: &'a Reporter,
    writer: Writer<Output>,
    state: State,
    level: u32,
    calls: u64,
}

impl Echo<'_> {
    fn read(&mut self, input: Input) -> Result<(), InputError> {
        self.chain.push(input.identity().clone());
        let result = input.read(self);
        self.chain.pop();
        result
    }

    /// The reason why an input is not read, or not completely; `at` is the position of the call.
    fn report(&self, error: InputError, at: &Location) {
        match error {
            InputError::Scene { what, at } => self.reporter.say(Severity::Error, &at, what),
            other => self.reporter.say(Severity::Error, at, other.to_string()),
        }
    }

    /// A file of that name, then what `Input` finds.
    fn find(&self, command: &str) -> Result<Input, InputError> {
        let file = Path::new(command);
        if self.chain.is_empty() && file.is_file() {
            let paths = InputPaths { input: ".", generator: &self.job.generators };
            return self.finder.file(file, paths);
        }
        let path = attr::PATH_INPUT.ask(&self.state);
        self.finder.find(command, InputPaths { input: &path, generator: &self.job.generators })
    }

    /// `Input` below the last level that is expanded; `Ok (false)` when it is to be echoed.
    fn expand(&mut self, command: &str, bound: Option<[f32; 6]>, at: &Location) -> Result<bool, Stop> {
        // "limits:inputlevels" of an untrusted scene is ignored.
        let asked = if self.job.session.safe { 0 } else { self.writer.input_levels().max(0) as u32 };
        let depth = self.job.depth.max(asked);
        if self.level >= depth {
            return Ok(false);
        }
        let found = match self.find(command) {
            Ok(found) if self.chain.contains(found.identity()) => {
                Err(format!("Input \"{command}\" would read itself"))
            }
            Ok(found) => Ok(found),
            Err(error) => Err(error.to_string()),
        };
        let found = match found {
            Ok(found) => found,
            Err(text) => {
                self.reporter.say(Severity::Error, at, format!("{text}; it is not expanded"));
                return Ok(false);
            }
        };
        // An input with a bound leaves no traces in the attribute state.
        let bound = bound.or(found.bound());
        if bound.is_some() {
            self.call(Call::PushAttributes, at)?;
        }
        self.level += 1;
        let result = self.read(found);
        self.level -= 1;
        match result {
            Ok(()) => {}
            Err(InputError::Stopped(stop)) => return Err(stop),
            // As far as it could be read.
            Err(error) => self.report(error, at),
        }
        if bound.is_some() {
            self.call(Call::PopAttributes, at)?;
        }
        Ok(true)
    }
}

impl SceneSink for Echo<'_> {
    fn call(&mut self, call: Call, at: &Location) -> Result<(), Stop> {
        self.calls += 1;
        match &call {
            Call::Input { command, bound } => {
                let (command, bound) = (command.clone(), *bound);
                if self.expand(&command, bound, at)? {
                    return Ok(());
                }
            }
            // Nothing that these change can be asked for.
            Call::Shape { .. }
            | Call::Command { .. }
            | Call::Comment(_)
            | Call::Parameter(_)
            | Call::Render { .. } => {}
            other => self.state.call(other.clone(), at)?,
        }
        self.writer.call(call, at)
    }

    fn in_world(&self) -> bool {
        self.state.in_world()
    }

    fn attribute(&self, declaration: &str) -> Option<Param> {
        let (_, name) = granita_base::ParamType::parse(declaration).ok()?;
        if name.starts_with("pyg:")
            || attr::PYG_BINARY.is_named(&name)
            || attr::LIMITS_INPUTLEVELS.is_named(&name)
        {
            return self.writer.attribute(declaration);
        }
        self.state.attribute(declaration)
    }
}

/// The renderer behind the followed state: there is none.
struct Nothing;

impl FrameRenderer for Nothing {
    fn render(&mut self, _: Arc<Scene>, _: Option<&str>) -> Result<(), Stop> {
        Ok(())
    }

    fn command(&mut self, _: &str, _: &Params, _: &Location) -> Result<bool, Stop> {
        Ok(true)
    }

    fn input(&mut self, _: &str, _: InputPaths<'_>, _: &Location) -> Result<Option<FoundInput>, Stop> {
        Ok(None)
    }
}
