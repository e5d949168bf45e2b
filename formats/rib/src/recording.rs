//! Requests that a file keeps under a name (`ArchiveBegin`, `ArchiveEnd`).

use crate::request::Request;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Requests under a name, and the file that they stand in.
pub(crate) type Kept = (Arc<str>, Arc<[Request]>);

/// An archive that is being kept.
pub(crate) struct Recording {
    pub(crate) name: Arc<str>,
    pub(crate) line: u32,
    pub(crate) requests: Vec<Request>,
    /// The number of `ArchiveBegin` within it that are open.
    pub(crate) inner: usize,
}

/// The archives of a file itself.
#[derive(Default)]
pub(crate) struct Archives {
    pub(crate) recording: Option<Recording>,
    pub(crate) kept: BTreeMap<Arc<str>, Kept>,
    /// The names of those being read, outermost first.
    pub(crate) reading: Vec<Arc<str>>,
}

impl Archives {
    /// The line of an `ArchiveBegin` without an end; the archive is discarded.
    pub(crate) fn unfinished(&mut self) -> Option<u32> {
        self.recording.take().map(|r| r.line)
    }

    /// True when there is an archive of this name.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.kept.contains_key(name)
    }
}
