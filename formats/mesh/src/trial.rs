//! Common code of the tests. It runs a generator over text and returns its calls as Pyg, and its messages.

use granita_base::{Location, Param, Reporter};
use granita_pyg::Writer;
use granita_scene::{Call, Generator, GeneratorError, GeneratorSource, SceneSink, Stop};

/// The calls as Pyg, the messages as lines, and the error if the run ended early.
pub(crate) struct Trial {
    pub(crate) pyg: String,
    pub(crate) messages: Vec<String>,
    pub(crate) error: Option<GeneratorError>,
}

impl Trial {
    /// Returns the calls of a run without errors and messages.
    pub(crate) fn clean(self) -> String {
        assert!(self.messages.is_empty() && self.error.is_none(), "{:?} {:?}", self.messages, self.error);
        self.pyg
    }
}

/// Runs `generator` over `bytes`, which have the name "t" in messages.
pub(crate) fn run(generator: &dyn Generator, bytes: impl AsRef<[u8]>) -> Trial {
    run_source(generator, &self::bytes(bytes))
}

/// Runs `generator` over a source.
pub(crate) fn run_source(generator: &dyn Generator, source: &GeneratorSource) -> Trial {
    run_in(generator, source, true, None)
}

/// A writer that is before or after `World`, and has one attribute.
struct Place {
    writer: Writer<Vec<u8>>,
    in_world: bool,
    attribute: Option<Param>,
}

impl SceneSink for Place {
    fn call(&mut self, call: Call, at: &Location) -> Result<(), Stop> {
        self.writer.call(call, at)
    }

    fn in_world(&self) -> bool {
        self.in_world
    }

    fn attribute(&self, declaration: &str) -> Option<Param> {
        self.attribute.clone().filter(|a| &*a.name == declaration)
    }
}

/// Runs `generator` like [`run_source`], before or after `World`, with an attribute set.
pub(crate) fn run_in(
    generator: &dyn Generator,
    source: &GeneratorSource,
    in_world: bool,
    attribute: Option<Param>,
) -> Trial {
    let mut place = Place { writer: Writer::new(Vec::new()), in_world, attribute };
    let (reporter, kept) = Reporter::collecting();
    reporter.set_verbosity(2);
    let error = generator.run(source, &mut place, &reporter).err();
    let pyg = String::from_utf8(place.writer.into_inner().unwrap()).unwrap();
    let messages = kept.lock().iter().map(ToString::to_string).collect();
    Trial { pyg, messages, error }
}

/// Returns text as a source with the name "t".
pub(crate) fn bytes(bytes: impl AsRef<[u8]>) -> GeneratorSource {
    GeneratorSource::bytes("t", bytes.as_ref())
}

/// Joins the lines that the writer broke.
pub(crate) fn flat(text: &str) -> String {
    text.replace("\n    ", " ")
}
