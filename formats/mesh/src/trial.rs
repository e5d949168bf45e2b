//! What tests share: runs a generator over text and gives its calls as Pyg, and its messages.

use granita_base::Reporter;
use granita_pyg::Writer;
use granita_scene::{Generator, GeneratorError, GeneratorSource};

/// Calls as Pyg, messages as lines, and the error if the run ended early.
pub(crate) struct Trial {
    pub(crate) pyg: String,
    pub(crate) messages: Vec<String>,
    pub(crate) error: Option<GeneratorError>,
}

impl Trial {
    /// The calls of a source without mistakes.
    pub(crate) fn clean(self) -> String {
        assert!(self.messages.is_empty() && self.error.is_none(), "{:?} {:?}", self.messages, self.error);
        self.pyg
    }
}

/// Runs `generator` over `bytes`, which messages call "t".
pub(crate) fn run(generator: &dyn Generator, bytes: impl AsRef<[u8]>) -> Trial {
    run_source(generator, &GeneratorSource::Bytes { name: "t".into(), bytes: bytes.as_ref().into() })
}

/// Runs `generator` over a source.
pub(crate) fn run_source(generator: &dyn Generator, source: &GeneratorSource) -> Trial {
    let mut writer = Writer::new(Vec::new());
    let (reporter, kept) = Reporter::collecting();
    reporter.set_verbosity(2);
    let error = generator.run(source, &mut writer, &reporter).err();
    let pyg = String::from_utf8(writer.into_inner().unwrap()).unwrap();
    let messages = kept.lock().unwrap().iter().map(ToString::to_string).collect();
    Trial { pyg, messages, error }
}
