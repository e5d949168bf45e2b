//! Writes the calls of a program to a file instead of executing them (reference 2.3, "pyg").

use crate::SessionError;
use granita_base::{Location, Reporter};
use granita_pyg::{PygError, Writer, WriterOptions};
use granita_scene::{Call, SceneSink, Stop};
use std::io::{Read, Write};

/// Writes the calls of a stream as Pyg to `out` until the stream ends, and returns it. Queries are answered on
/// `answers` (see `granita_pyg::serve`). Errors of single calls are reported.
///
/// # Errors
/// Returns [`SessionError::Failed`] for an invalid stream, and when `out` cannot be written.
pub fn archive_calls<W: Write>(
    input: &mut dyn Read,
    answers: &mut dyn Write,
    out: W,
    reporter: &Reporter,
) -> Result<W, SessionError> {
    let mut writer = Writer::new(out);
    match granita_pyg::serve(input, answers, &mut writer, reporter) {
        Ok(()) => (),
        Err(PygError::Stopped(stop)) => return Err(SessionError::Failed(stop.to_string())),
        Err(other) => return Err(SessionError::Failed(other.to_string())),
    }
    writer.into_inner().map_err(|error| SessionError::Failed(format!("the archive: {error}")))
}

/// Converts calls to Pyg.
pub(crate) fn call_text(calls: Vec<Call>, binary: bool) -> std::io::Result<Vec<u8>> {
    let mut writer = Writer::with_options(Vec::new(), WriterOptions { binary, ..WriterOptions::default() });
    for call in calls {
        match writer.call(call, &Location::default()) {
            Ok(()) => (),
            Err(Stop::Io(error)) => return Err(error),
            Err(other) => return Err(std::io::Error::other(other.to_string())),
        }
    }
    writer.into_inner()
}
