//! The opened source of a generator.

use granita_base::Files;
use granita_scene::{GeneratorError, GeneratorSource};
use std::fs::File;
use std::io::{self, Cursor, Read, Seek};
use std::path::Path;
use std::sync::Arc;

/// A source that can be read from any position.
pub(crate) trait Stream: Read + Seek + Send {}
impl<T: Read + Seek + Send> Stream for T {}

/// An open source.
pub(crate) struct Opened {
    /// The name in messages.
    pub(crate) name: Arc<str>,
    pub(crate) stream: Box<dyn Stream>,
    pub(crate) size: u64,
}

/// Opens the file or the bytes of a source.
pub(crate) fn open(source: &GeneratorSource) -> Result<Opened, GeneratorError> {
    let name: Arc<str> = source.name().into();
    match source {
        GeneratorSource::File { path, .. } => match open_file(path, source.files()) {
            Ok((file, size)) => Ok(Opened { name, stream: Box::new(file), size }),
            Err(source) => Err(GeneratorError::Io { name: name.to_string(), source }),
        },
        GeneratorSource::Bytes { bytes, .. } => {
            let size = bytes.len() as u64;
            Ok(Opened { name, stream: Box::new(Cursor::new(bytes.clone())), size })
        }
    }
}

/// Opens a file and returns its size. Pipes and devices are refused, because they may never end.
pub(crate) fn open_file(path: &Path, files: &Files) -> io::Result<(File, u64)> {
    let data = std::fs::metadata(path)?;
    if !data.is_file() {
        let what = if data.is_dir() { "a folder, not a file" } else { "not a regular file" };
        return Err(io::Error::other(what));
    }
    Ok((files.open(path)?, data.len()))
}

/// Returns an error of reading the source `name`.
pub(crate) fn io_error(name: &str, source: io::Error) -> GeneratorError {
    GeneratorError::Io { name: name.to_owned(), source }
}
