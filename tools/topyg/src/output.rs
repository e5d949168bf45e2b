//! Where the text goes: standard output, or a file that appears whole or not at all.

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// The destination of the conversion.
#[derive(Debug)]
pub(crate) enum Output {
    /// Standard output.
    Standard(io::Stdout),
    /// A file, written beside its final name.
    File { file: File, beside: PathBuf, path: PathBuf, finished: bool },
}

impl Output {
    /// Opens `path`, or standard output.
    pub(crate) fn open(path: Option<&Path>) -> io::Result<Self> {
        let Some(path) = path else { return Ok(Self::Standard(io::stdout())) };
        let named = |error: io::Error| {
            io::Error::new(error.kind(), format!("cannot write {}: {error}", path.display()))
        };
        let name = path.file_name().ok_or_else(|| named(io::Error::other("not a file name")))?;
        let beside = path.with_file_name(format!(".{}.{}.tmp", name.to_string_lossy(), std::process::id()));
        let file = OpenOptions::new().write(true).create(true).truncate(true).open(&beside).map_err(named)?;
        Ok(Self::File { file, beside, path: path.to_owned(), finished: false })
    }

    /// All is written: gives the file its name.
    pub(crate) fn finish(mut self) -> io::Result<()> {
        match &mut self {
            Self::Standard(out) => out.flush(),
            Self::File { file, beside, path, finished } => {
                file.sync_all()?;
                std::fs::rename(&*beside, &*path)?;
                *finished = true;
                Ok(())
            }
        }
    }
}

impl Write for Output {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        match self {
            Self::Standard(out) => out.write(buf),
            Self::File { file, .. } => file.write(buf),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Standard(out) => out.flush(),
            Self::File { .. } => Ok(()),
        }
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        if let Self::File { beside, finished: false, .. } = self {
            // Half a scene is worth nothing; if it cannot be removed there is nothing more to do.
            let _ = std::fs::remove_file(beside);
        }
    }
}
