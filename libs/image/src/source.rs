//! Reads at given offsets of an open file, counted and checked.

use crate::{ImageError, Result};
use granita_base::Files;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// An open file that any number of threads may read at once, each at its own offset.
///
/// Lengths are checked against the size of the file before memory is allocated, so that a damaged length in a header
/// cannot request more memory than the file has bytes.
#[derive(Debug)]
pub struct FileSource {
    file: File,
    path: PathBuf,
    format: &'static str,
    len: u64,
    bytes_read: AtomicU64,
}

impl FileSource {
    /// Opens `path` with `files`. `format` is the name used in errors, such as "TIFF".
    ///
    /// # Errors
    /// An error when the file cannot be opened, and when it is not a plain file.
    pub fn open(path: &Path, format: &'static str, files: &Files) -> Result<Self> {
        let io = |source| ImageError::Io { path: path.to_owned(), source };
        let file = files.open(path).map_err(io)?;
        let meta = file.metadata().map_err(io)?;
        if meta.is_dir() {
            return Err(io(std::io::Error::new(std::io::ErrorKind::IsADirectory, "is a directory")));
        }
        Ok(Self { file, path: path.to_owned(), format, len: meta.len(), bytes_read: AtomicU64::new(0) })
    }

    /// The size of the file in bytes, at the time it was opened.
    pub fn len(&self) -> u64 {
        self.len
    }

    /// True when the file has no bytes.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The number of bytes read so far.
    pub fn bytes_read(&self) -> u64 {
        self.bytes_read.load(Ordering::Relaxed)
    }

    /// Fills `buf` from `offset`. `what` describes the data that is read, for the error.
    ///
    /// # Errors
    /// An error when the file ends before, or cannot be read.
    pub fn read_at(&self, offset: u64, buf: &mut [u8], what: &str) -> Result<()> {
        self.check(offset, buf.len() as u64, what)?;
        self.bytes_read.fetch_add(buf.len() as u64, Ordering::Relaxed);
        let io = |source| ImageError::Io { path: self.path.clone(), source };
        #[cfg(unix)]
        {
            use std::os::unix::fs::FileExt;
            self.file.read_exact_at(buf, offset).map_err(io)
        }
        #[cfg(windows)]
        {
            use std::os::windows::fs::FileExt;
            let mut done = 0;
            while done < buf.len() {
                match self.file.seek_read(&mut buf[done..], offset + done as u64).map_err(io)? {
                    0 => return Err(io(std::io::ErrorKind::UnexpectedEof.into())),
                    n => done += n,
                }
            }
            Ok(())
        }
    }

    /// Returns `len` bytes from `offset`; see [`FileSource::read_at`].
    ///
    /// # Errors
    /// The errors of [`FileSource::read_at`]. No memory is allocated when the file is too short.
    pub fn read_vec(&self, offset: u64, len: u64, what: &str) -> Result<Vec<u8>> {
        self.check(offset, len, what)?;
        let len = usize::try_from(len).map_err(|_| self.malformed(format!("{what} has {len} bytes")))?;
        let mut buf = vec![0; len];
        self.read_at(offset, &mut buf, what)?;
        Ok(buf)
    }

    /// Returns a `Malformed` error of this file.
    pub fn malformed(&self, what: impl Into<String>) -> ImageError {
        ImageError::Malformed { path: self.path.clone(), format: self.format, what: what.into() }
    }

    /// Returns an `Unsupported` error of this file.
    pub fn unsupported(&self, what: impl Into<String>) -> ImageError {
        ImageError::Unsupported { path: self.path.clone(), what: what.into() }
    }

    /// Returns a `Misuse` error of this file.
    pub fn misuse(&self, what: impl Into<String>) -> ImageError {
        ImageError::Misuse { path: self.path.clone(), what: what.into() }
    }

    fn check(&self, offset: u64, len: u64, what: &str) -> Result<()> {
        match offset.checked_add(len) {
            Some(end) if end <= self.len => Ok(()),
            _ => Err(self.malformed(format!(
                "{what} is {len} bytes at byte {offset}, but the file ends at byte {}",
                self.len
            ))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_source_counts_bytes_and_refuses_reads_beyond_its_end() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("f");
        std::fs::write(&path, b"0123456789").unwrap();
        let s = FileSource::open(&path, "TEST", &Files::default()).unwrap();
        assert_eq!(s.read_vec(3, 4, "x").unwrap(), b"3456");
        assert_eq!(s.bytes_read(), 4);
        assert_eq!(s.read_vec(10, 0, "x").unwrap(), b"");
        let e = s.read_vec(8, 3, "the header").unwrap_err().to_string();
        assert!(e.contains("the header is 3 bytes at byte 8") && e.contains("byte 10"), "{e}");
        assert!(s.read_vec(u64::MAX, 3, "x").is_err());
        assert!(s.read_vec(0, u64::MAX, "x").is_err());
    }

    #[test]
    fn folders_are_refused_as_files() {
        let dir = tempfile::tempdir().unwrap();
        assert!(matches!(
            FileSource::open(dir.path(), "TEST", &Files::default()),
            Err(ImageError::Io { .. })
        ));
    }
}
