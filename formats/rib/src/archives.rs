//! Archives. They are files that are read where they are named, or requests that a file stores under a name
//! (`ArchiveBegin`, `ArchiveEnd`, of later versions of the interface).

use crate::reader::{Done, Fault, MAX_REPEATED, Reader, handle};
use crate::recording::Recording;
use crate::request::Request;
use granita_base::{Environment, SearchPath};
use granita_scene::{GeneratorError, attr};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The largest depth of nested archives.
const MAX_DEPTH: usize = 64;

impl Reader<'_> {
    /// Moves a request into the archive that is being stored. Returns the request when no archive is being stored, or
    /// when the request ends it.
    pub(crate) fn recorded(&mut self, request: Request) -> Option<Request> {
        let Some(recording) = &mut self.archives.recording else { return Some(request) };
        match request.name.as_str() {
            "ArchiveBegin" => recording.inner += 1,
            "ArchiveEnd" if recording.inner == 0 => return Some(request),
            "ArchiveEnd" => recording.inner -= 1,
            _ => (),
        }
        recording.requests.push(request);
        None
    }

    /// Begins to store an archive, for `ArchiveBegin name`.
    pub(crate) fn archive_begin(&mut self, request: &Request) -> Done {
        let name = handle(request.args.first()).ok_or_else(|| "no name".to_owned())?;
        self.archives.recording = Some(Recording { name, line: self.line, requests: Vec::new(), inner: 0 });
        Ok(())
    }

    /// Ends the archive, for `ArchiveEnd`.
    pub(crate) fn archive_end(&mut self) -> Done {
        let Some(recording) = self.archives.recording.take() else {
            return Err(Fault::Mistake("without ArchiveBegin".to_owned()));
        };
        self.archives.kept.insert(recording.name, (self.file.clone(), recording.requests.into()));
        Ok(())
    }

    /// Executes the requests that are stored under a name.
    pub(crate) fn kept_archive(&mut self, name: &Arc<str>) -> Done {
        let Some((from, requests)) = self.archives.kept.get(name).cloned() else {
            return Err(Fault::Mistake(format!("there is no archive \"{name}\"")));
        };
        if self.archives.reading.contains(name) {
            return Err(Fault::Mistake(format!("\"{name}\" would read itself")));
        }
        if self.archives.reading.len() >= MAX_DEPTH {
            return Err(Fault::Mistake(format!("archives are nested deeper than {MAX_DEPTH}")));
        }
        self.repeated = self.repeated.saturating_add(requests.len());
        if self.repeated > MAX_REPEATED {
            return Err(Fault::Mistake(format!("archives repeat more than {MAX_REPEATED} requests")));
        }
        self.archives.reading.push(name.clone());
        let place = (std::mem::replace(&mut self.file, from), self.line);
        let mut result = Ok(());
        for request in requests.iter() {
            self.line = request.line;
            let Some(request) = self.recorded(request.clone()) else { continue };
            result = self.perform(request);
            if result.is_err() {
                break;
            }
        }
        (self.file, self.line) = place;
        self.archives.reading.pop();
        result
    }

    /// Returns the path of an archive. It is looked for beside the file that names it, then on the path of inputs.
    pub(crate) fn find_archive(&self, name: &str) -> Option<PathBuf> {
        let beside = self.files.last().and_then(|f| f.parent()).map(|folder| folder.join(name));
        if let Some(file) = beside.filter(|f| self.opens.is_file(f)) {
            return Some(file);
        }
        let set = self.attribute_value(attr::PATH_INPUT.name());
        let path = set.and_then(|set| attr::PATH_INPUT.given(&set)).unwrap_or_else(|| ".".into());
        let mut environment = Environment::empty();
        environment.set_files(self.opens.clone());
        let path = SearchPath::parse(&path.replace('&', "."), &SearchPath::default(), &environment);
        path.find(name).or_else(|| self.opens.is_file(Path::new(name)).then(|| PathBuf::from(name)))
    }

    /// Reads an archive that is stored under a name, or else a file, for `ReadArchive name`.
    pub(crate) fn archive(&mut self, request: &Request) -> Done {
        let name = request.args.first().and_then(|a| a.strings()?.first().cloned());
        let name = name.ok_or_else(|| "no file name".to_owned())?;
        if self.archives.has(&name) {
            self.quiet = false;
            return self.kept_archive(&name);
        }
        let Some(path) = self.find_archive(&name) else {
            return Err(Fault::Mistake(format!("cannot find \"{name}\"")));
        };
        let identity = std::fs::canonicalize(&path).unwrap_or_else(|_| path.clone());
        if self.files.contains(&identity) {
            let names = self.files.iter().chain([&identity]).filter_map(|f| f.file_name());
            let names: Vec<_> = names.map(|n| n.to_string_lossy().into_owned()).collect();
            return Err(Fault::Mistake(format!("\"{name}\" would read itself: {}", names.join(" -> "))));
        }
        if self.files.len() >= MAX_DEPTH {
            return Err(Fault::Mistake(format!("archives are nested deeper than {MAX_DEPTH}")));
        }
        let stream = match self.opens.open(&path) {
            Ok(file) => Box::new(file),
            Err(error) => return Err(Fault::Mistake(format!("{}: {error}", path.display()))),
        };
        self.reporter.file_read(&path);
        self.quiet = false;
        let (file, line) = (self.file.clone(), self.line);
        self.files.push(identity);
        self.file = path.to_string_lossy().as_ref().into();
        let result = self.stream(stream);
        self.files.pop();
        let result = match result {
            // The error is one of the archive, not of the file that reads it.
            Err(Fault::Ends(GeneratorError::Malformed(text))) => {
                self.reporter.error(text);
                Ok(())
            }
            other => other,
        };
        (self.file, self.line) = (file, line);
        result
    }
}
