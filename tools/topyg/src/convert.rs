//! Reads the inputs and writes their calls.

use crate::output::Output;
use granita_base::{Location, Param, Params, Reporter, Severity};
use granita_cli::Status;
use granita_inputs::{Input, InputError, Inputs, RunOptions};
use granita_pyg::{PygSource, Writer, WriterOptions};
use granita_scene::{Call, FoundInput, FrameRenderer, InputPaths, Scene, SceneSink, State, Stop, attr};

use std::io;
use std::path::Path;
use std::sync::Arc;

/// The task of the tool.
#[derive(Debug)]
pub(crate) struct Job {
    pub(crate) inputs: Vec<String>,
    /// The number of levels of `Input` to expand.
    pub(crate) depth: u32,
    /// The search path of generators, which is a list of folders.
    pub(crate) generators: String,
    pub(crate) writer: WriterOptions,
    pub(crate) run: RunOptions,
}

/// Converts all inputs, one after the other.
pub(crate) fn run(job: &Job, output: Output, reporter: &Reporter) -> Status {
    let mut echo = Echo {
        job,
        finder: Inputs::new(Arc::new(job.run.clone()), reporter.clone()),
        chain: Vec::new(),
        reporter,
        writer: Writer::with_options(output, job.writer),
        state: State::new(Box::new(Nothing), Reporter::silent()),
        level: 0,
        calls: 0,
    };
    for input in &job.inputs {
        let done = match is_standard_input(input) {
            true => echo.read_standard_input(),
            false => echo.find(input).and_then(|found| echo.read(found)),
        };
        match done {
            Ok(()) => {}
            Err(error) if is_broken_pipe(&error) => return Status::Done,
            Err(error) => {
                echo.report(error, &Location::default());
                return Status::Failed;
            }
        }
    }
    if job.run.supervisor.has_ended() {
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

/// True for the names of standard input.
pub(crate) fn is_standard_input(input: &str) -> bool {
    matches!(input.split_whitespace().collect::<Vec<_>>().as_slice(), ["-"] | ["pyg", "-"])
}

fn is_broken_pipe(error: &InputError) -> bool {
    matches!(error, InputError::Stopped(Stop::Io(e)) if e.kind() == io::ErrorKind::BrokenPipe)
}

/// Writes calls. Tracks the attribute state for scripts that query it and for search paths.
struct Echo<'a> {
    job: &'a Job,
    finder: Inputs,
    /// The identities of the inputs that are being read, outermost first.
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

    /// Reads Pyg from standard input.
    fn read_standard_input(&mut self) -> Result<(), InputError> {
        let source = PygSource::Stream { name: "<stdin>".into(), stream: Box::new(io::stdin()) };
        let options = self.finder.pyg_options();
        let reporter = self.reporter;
        granita_pyg::read(source, self, &options, reporter).map_err(InputError::from)
    }

    /// Reports the reason why an input is not read, or not completely. `at` is the position of the call.
    fn report(&self, error: InputError, at: &Location) {
        match error {
            InputError::Scene { what, at } => self.reporter.say(Severity::Error, &at, what),
            other => self.reporter.say(Severity::Error, at, other.to_string()),
        }
    }

    /// Finds a file of that name, or else an input as `Input` does.
    fn find(&self, command: &str) -> Result<Input, InputError> {
        let file = Path::new(command);
        if self.chain.is_empty() && file.is_file() {
            let paths = InputPaths { input: ".", generator: &self.job.generators };
            return self.finder.file(file, paths);
        }
        let path = attr::PATH_INPUT.ask(&self.state);
        self.finder.find(command, InputPaths { input: &path, generator: &self.job.generators })
    }

    /// Expands an `Input` call, unless the last level is reached or the input cannot be found. Returns `Ok(false)` when
    /// the call must be written instead.
    fn expand(&mut self, command: &str, bound: Option<[f32; 6]>, at: &Location) -> Result<bool, Stop> {
        // "limits:inputlevels" of an untrusted scene is ignored.
        let asked = if self.job.run.safe { 0 } else { self.writer.input_levels().max(0) as u32 };
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
        // An input with a bound does not change the attribute state.
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
            // The calls before the error have been written.
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
            // These calls do not change what can be queried.
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

/// The renderer of the tracked state. It does nothing.
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
