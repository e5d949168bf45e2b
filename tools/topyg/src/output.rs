//! The destination of the text, which is standard output or a file that appears complete or not at all.

use granita_base::{AtomicFile, FileError, Files};
use std::io::{self, Write};
use std::path::Path;

/// The destination of the conversion.
#[derive(Debug)]
pub(crate) enum Output {
    /// Standard output.
    Standard(io::Stdout),
    /// A file. An output that is dropped before [`Output::finish`] leaves no file, because a part of a scene is
    /// useless.
    File(AtomicFile),
}

impl Output {
    /// Opens `path`; standard output without one.
    pub(crate) fn open(path: Option<&Path>, files: &Files) -> Result<Self, FileError> {
        Ok(match path {
            Some(path) => Self::File(files.create(path)?),
            None => Self::Standard(io::stdout()),
        })
    }

    /// Completes the output. A file gets its name now.
    pub(crate) fn finish(self) -> io::Result<()> {
        match self {
            Self::Standard(mut out) => out.flush(),
            Self::File(file) => file.commit().map_err(|error| error.source),
        }
    }
}

impl Write for Output {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        match self {
            Self::Standard(out) => out.write(buf),
            Self::File(file) => file.write(buf),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Standard(out) => out.flush(),
            Self::File(file) => file.flush(),
        }
    }
}
