//! Reads RIB files as scenes. The requests of the RenderMan interface 3.2 become calls of the scene interface.
//!
//! One reader accepts the text form, the binary encoding (appendix C of the specification), and either of them
//! compressed by gzip. The source is read as a stream. The memory does not grow with the file, except for one request,
//! for objects until their instances, and for the requests before `WorldBegin`, which are sent when the world begins.
//!
//! - Each `WorldEnd` renders. A source with several frames requests a new one from its receiver in between
//!   ([`granita_scene::SceneSink::new_frame`]).
//! - A source without a world is a part of the scene that reads it.
//! - A request that contains an error is left out. The error is reported with file, line and the name of the request.
//!   Unsupported features are reported once.
//!
//! The manual (`docs/scenes.md`) lists the calls that each request becomes.
//!
//! Deliberately absent: blobbies, constructive solid geometry, all but the finest level of detail, imager shaders.

#![forbid(unsafe_code)]

mod archives;
mod basis;
mod branches;
mod condition;
mod curves;
mod declare;
mod frame;
mod geometry;
mod lex;
mod loops;
mod names;
mod options;
mod patches;
mod primvars;
mod quadrics;
mod reader;
mod recording;
mod request;
mod shaders;
mod textures;
mod transforms;

use granita_base::Reporter;
use granita_scene::{Generator, GeneratorError, GeneratorSource, SceneSink};
use std::sync::Arc;

/// Returns the generators of this crate. There is one, called "rib".
pub fn generators() -> Vec<Arc<dyn Generator>> {
    vec![Arc::new(Rib)]
}

/// The generator that reads RIB.
#[derive(Clone, Copy, Debug)]
struct Rib;

impl Generator for Rib {
    fn name(&self) -> &'static str {
        "rib"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["rib", "ribz", "rib.gz"]
    }

    fn makes_frames(&self) -> bool {
        true
    }

    fn run(
        &self,
        source: &GeneratorSource,
        sink: &mut dyn SceneSink,
        reporter: &Reporter,
    ) -> Result<(), GeneratorError> {
        reader::Reader::new(sink, reporter, &source.name()).run(source)
    }
}
