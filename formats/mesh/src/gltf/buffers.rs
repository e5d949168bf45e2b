//! The binary data of a glTF file, which is a chunk of the file itself, files beside it, or text inside of it.

use super::document::{Document, item};
use crate::source::{Stream, open_file};
use base64::Engine;
use base64::engine::general_purpose::{STANDARD, STANDARD_NO_PAD};
use granita_base::{Files, Reporter};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::PathBuf;

/// Opens buffers when they are first read.
pub(super) struct Buffers {
    stream: Box<dyn Stream>,
    /// The offset and the length of the binary chunk, in bytes.
    chunk: Option<(u64, u64)>,
    folder: Option<PathBuf>,
    /// The opener of files.
    files: Files,
    /// The receiver of the names of files that are read.
    reporter: Reporter,
    open: BTreeMap<usize, Result<Data, String>>,
}

enum Data {
    Chunk { offset: u64, length: u64 },
    File { file: File, length: u64 },
    Inline(Vec<u8>),
}

impl Buffers {
    pub(super) fn new(
        stream: Box<dyn Stream>,
        chunk: Option<(u64, u64)>,
        folder: Option<PathBuf>,
        files: Files,
        reporter: Reporter,
    ) -> Self {
        Self { stream, chunk, folder, files, reporter, open: BTreeMap::new() }
    }

    /// Reads `length` bytes from `offset` of a buffer.
    ///
    /// # Errors
    /// Returns a text when a buffer is missing or too short.
    pub(super) fn read(
        &mut self,
        document: &Document,
        buffer: usize,
        offset: u64,
        length: usize,
    ) -> Result<Vec<u8>, String> {
        let (chunk, folder, files, reporter) = (self.chunk, &self.folder, &self.files, &self.reporter);
        let data = self.open.entry(buffer);
        let data = data.or_insert_with(|| open(document, buffer, chunk, folder.as_ref(), files, reporter));
        let data = data.as_mut().map_err(|e| e.clone())?;
        let all = match data {
            Data::Chunk { length, .. } | Data::File { length, .. } => *length,
            Data::Inline(bytes) => bytes.len() as u64,
        };
        let end = offset.checked_add(length as u64).filter(|end| *end <= all);
        let Some(end) = end else {
            let want = offset.saturating_add(length as u64);
            return Err(format!("buffer {buffer} has {all} bytes of the {want} that are needed"));
        };
        match data {
            Data::Chunk { offset: begin, .. } => {
                read_at(&mut self.stream, begin.saturating_add(offset), length)
            }
            Data::File { file, .. } => read_at(file, offset, length),
            // `end` is within the length, so both numbers fit.
            Data::Inline(bytes) => Ok(bytes[offset as usize..end as usize].to_vec()),
        }
        .map_err(|e: std::io::Error| format!("buffer {buffer}: {e}"))
    }
}

fn read_at(stream: &mut (impl Read + Seek), offset: u64, length: usize) -> std::io::Result<Vec<u8>> {
    stream.seek(SeekFrom::Start(offset))?;
    let mut bytes = vec![0; length];
    stream.read_exact(&mut bytes)?;
    Ok(bytes)
}

fn open(
    document: &Document,
    buffer: usize,
    chunk: Option<(u64, u64)>,
    folder: Option<&PathBuf>,
    files: &Files,
    reporter: &Reporter,
) -> Result<Data, String> {
    let Some(described) = item(&document.buffers, buffer) else {
        return Err(format!("there is no buffer {buffer}"));
    };
    match (&described.uri, chunk) {
        (None, Some((offset, length))) if buffer == 0 => Ok(Data::Chunk { offset, length }),
        (None, _) => Err(format!("buffer {buffer} has no data")),
        (Some(uri), _) => match data_of_uri(uri) {
            Some(bytes) => bytes.map(Data::Inline).map_err(|e| format!("buffer {buffer}: {e}")),
            None => {
                let path = path_of_uri(uri, folder).map_err(|e| format!("buffer {buffer}: {e}"))?;
                let (file, length) =
                    open_file(&path, files).map_err(|e| format!("{}: {e}", path.display()))?;
                reporter.file_read(&path);
                Ok(Data::File { file, length })
            }
        },
    }
}

/// Returns the bytes of a `data:` URI; `None` for any other URI.
pub(super) fn data_of_uri(uri: &str) -> Option<Result<Vec<u8>, String>> {
    let (kind, text) = uri.strip_prefix("data:")?.split_once(',')?;
    if !kind.ends_with(";base64") {
        return Some(Err("a data URI that is not base64".into()));
    }
    let engine = if text.ends_with('=') || text.len().is_multiple_of(4) { STANDARD } else { STANDARD_NO_PAD };
    Some(engine.decode(text).map_err(|e| format!("base64: {e}")))
}

/// Returns the path of the file that a relative URI names.
///
/// # Errors
/// Returns a text for other addresses and for sources without a folder.
pub(super) fn path_of_uri(uri: &str, folder: Option<&PathBuf>) -> Result<PathBuf, String> {
    let shown: String = uri.chars().take(80).collect();
    if uri.contains("://") {
        return Err(format!("\"{shown}\" is no file beside this one"));
    }
    let Some(folder) = folder else {
        return Err(format!("\"{shown}\" is looked for beside the file, and there is no file"));
    };
    Ok(folder.join(percent_decoded(uri)))
}

/// Replaces `%20` and similar codes.
fn percent_decoded(uri: &str) -> String {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let [first, tail @ ..] = rest {
        let code = (*first == b'%')
            .then(|| tail.get(..2))
            .flatten()
            .filter(|code| code.iter().all(u8::is_ascii_hexdigit));
        let code = code.and_then(|c| u8::from_str_radix(std::str::from_utf8(c).ok()?, 16).ok());
        match code {
            Some(byte) => {
                bytes.push(byte);
                rest = &tail[2..];
            }
            None => {
                bytes.push(*first);
                rest = tail;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uris() {
        assert_eq!(data_of_uri("data:application/octet-stream;base64,AQID").unwrap().unwrap(), [1, 2, 3]);
        assert_eq!(data_of_uri("data:;base64,AQ==").unwrap().unwrap(), [1]);
        assert_eq!(data_of_uri("data:;base64,AQ").unwrap().unwrap(), [1]);
        assert!(data_of_uri("data:;base64,A!").unwrap().is_err());
        assert!(data_of_uri("data:text/plain,abc").unwrap().is_err());
        assert!(data_of_uri("a.bin").is_none());
        let folder = PathBuf::from("d");
        assert_eq!(path_of_uri("a%20b%2.bin", Some(&folder)).unwrap(), PathBuf::from("d/a b%2.bin"));
        assert_eq!(path_of_uri("a%+5.bin", Some(&folder)).unwrap(), PathBuf::from("d/a%+5.bin"));
        assert!(path_of_uri("http://x/a.bin", Some(&folder)).is_err());
        assert!(path_of_uri("a.bin", None).is_err());
    }
}
