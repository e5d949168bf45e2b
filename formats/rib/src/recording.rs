//! Requests that a file stores under a name (`ArchiveBegin`, `ArchiveEnd`).

use crate::request::Request;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The stored requests, and the file that they belong to.
pub(crate) type Kept = (Arc<str>, Arc<[Request]>);

/// An archive that is being stored.
pub(crate) struct Recording {
    pub(crate) name: Arc<str>,
    pub(crate) line: u32,
    pub(crate) requests: Vec<Request>,
    /// The number of open `ArchiveBegin` inside of it.
    pub(crate) inner: usize,
}

/// The archives of the file itself.
#[derive(Default)]
pub(crate) struct Archives {
    pub(crate) recording: Option<Recording>,
    pub(crate) kept: BTreeMap<Arc<str>, Kept>,
    /// The names of the archives that are being read, outermost first.
    pub(crate) reading: Vec<Arc<str>>,
}

impl Archives {
    /// Returns the line of an `ArchiveBegin` without an end, and discards the archive.
    pub(crate) fn unfinished(&mut self) -> Option<u32> {
        self.recording.take().map(|r| r.line)
    }

    /// True when there is an archive of this name.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.kept.contains_key(name)
    }
}
