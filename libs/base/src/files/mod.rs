//! Files: every file that a run reads or writes is opened through one [`Files`].
//!
//! By default it opens whatever the process may open. [`Files::confined`] is for scenes from strangers: what is read must
//! lie beneath one of a list of folders, and what is written beneath one folder that belongs to the scene (see
//! [`Confinement`] for the rules). The value travels with the variables of a session ([`crate::Environment`]), so search
//! paths, readers and writers obey it without asking.
//!
//! ```
//! use granita_base::Files;
//! let files = Files::default();
//! assert!(files.is_file("Cargo.toml".as_ref()));
//! ```

mod atomic;
mod confined;

pub use atomic::{AtomicFile, remove_unfinished};
pub use confined::{Confinement, Rules};

use confined::Confined;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A file that cannot be opened, read or written.
#[derive(Debug, thiserror::Error)]
#[error("{}: {source}", path.display())]
pub struct FileError {
    /// The file, as it was named.
    pub path: PathBuf,
    /// What the system said, or why the rules of the run refuse it ([`io::ErrorKind::PermissionDenied`]).
    pub source: io::Error,
}

/// True when two names mean one file that exists: what is written as one would replace the other.
pub fn is_same_file(a: &Path, b: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        if let (Ok(a), Ok(b)) = (a.metadata(), b.metadata()) {
            return (a.dev(), a.ino()) == (b.dev(), b.ino()) && a.is_file();
        }
    }
    matches!((std::fs::canonicalize(a), std::fs::canonicalize(b)), (Ok(a), Ok(b)) if a == b && a.is_file())
}

/// Opens the files of a run; clones share the rules.
#[derive(Clone, Default)]
pub struct Files {
    rules: Option<Arc<Confined>>,
    /// Where files lie that vanish, if not beside results.
    temporary: Option<Arc<Path>>,
}

impl std::fmt::Debug for Files {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(if self.is_confined() { "Files(confined)" } else { "Files" })
    }
}

/// Two values are equal when they share their rules.
impl PartialEq for Files {
    fn eq(&self, other: &Self) -> bool {
        let same = match (&self.rules, &other.rules) {
            (None, None) => true,
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            _ => false,
        };
        same && self.temporary == other.temporary
    }
}

impl Eq for Files {}

impl Files {
    /// Opens files by the rules of `confinement`.
    pub fn confined(confinement: Confinement) -> Self {
        Self { rules: Some(Arc::new(Confined::new(confinement))), temporary: None }
    }

    /// Reads the files and folders that the user `named`, and what lies beneath the folders of the files; writes anywhere. For
    /// tools whose user names all results, while files name other files.
    pub fn reading<'a>(named: impl IntoIterator<Item = &'a Path>) -> Self {
        let files = Self::confined(Confinement::default());
        named.into_iter().for_each(|path| files.add_named(path));
        files
    }

    /// Lets a file that the user named be read, and what lies beneath its folder; or all beneath a folder that the user named.
    pub fn add_named(&self, path: &Path) {
        self.grant(path);
        match path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            _ if path.is_dir() => self.add_root(path),
            Some(folder) => self.add_root(folder),
            None => self.add_root(Path::new(".")),
        }
    }

    /// Puts files that vanish with their handles into `folder` instead of beside results.
    #[must_use]
    pub fn with_temporary(self, folder: &Path) -> Self {
        Self { temporary: Some(folder.into()), ..self }
    }

    /// The folder of files that belong beside no result: what [`Files::with_temporary`] said, or the system's.
    pub fn temporary_folder(&self) -> PathBuf {
        self.temporary.as_deref().map_or_else(std::env::temp_dir, Path::to_owned)
    }

    /// True when rules restrict what is opened.
    pub fn is_confined(&self) -> bool {
        self.rules.is_some()
    }

    /// Lets files beneath `folder` be read. A folder that does not exist, or a relative one, adds nothing.
    pub fn add_root(&self, folder: &Path) {
        if let Some(confined) = &self.rules {
            confined.add_root(folder);
        }
    }

    /// Lets this one file be read, whatever the rules: the user named it.
    pub fn grant(&self, file: &Path) {
        if let Some(confined) = &self.rules {
            confined.grant(file, false);
        }
    }

    /// Lets this one file be written and read, whatever the rules: the user named it as a result.
    pub fn grant_output(&self, file: &Path) {
        if let Some(confined) = &self.rules {
            confined.grant(file, true);
        }
    }

    /// What the rules say now; `None` without rules.
    pub fn rules(&self) -> Option<Rules> {
        self.rules.as_ref().map(|confined| confined.rules())
    }

    /// Opens a file for reading.
    ///
    /// # Errors
    /// What the system says; [`io::ErrorKind::PermissionDenied`] when the rules refuse it.
    pub fn open(&self, path: &Path) -> io::Result<File> {
        match &self.rules {
            None => File::open(path),
            Some(confined) => confined.open(path),
        }
    }

    /// All bytes of a file.
    ///
    /// # Errors
    /// As [`Files::open`].
    pub fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        let mut file = self.open(path)?;
        let size = file.metadata().map_or(0, |m| m.len());
        let mut bytes = Vec::with_capacity(usize::try_from(size).unwrap_or(0).min(1 << 28));
        file.read_to_end(&mut bytes)?;
        Ok(bytes)
    }

    /// All of a file's text.
    ///
    /// # Errors
    /// As [`Files::open`]; [`io::ErrorKind::InvalidData`] for what is not UTF-8.
    pub fn read_to_string(&self, path: &Path) -> io::Result<String> {
        String::from_utf8(self.read(path)?).map_err(|e| io::Error::new(io::ErrorKind::InvalidData, e))
    }

    /// True when `path` is a file that may be read.
    pub fn is_file(&self, path: &Path) -> bool {
        match &self.rules {
            None => path.is_file(),
            Some(confined) => confined.is_file(path),
        }
    }

    /// The place of a file that the run itself wrote under the relative name `path`, where that is not `path`.
    pub fn written(&self, path: &Path) -> Option<PathBuf> {
        self.rules.as_ref()?.written(path)
    }

    /// Begins a file that appears under its name whole or not at all.
    ///
    /// # Errors
    /// [`FileError`]: what the system says, or which rule refuses the name.
    pub fn create(&self, path: &Path) -> Result<AtomicFile, FileError> {
        match &self.rules {
            None => AtomicFile::create(path),
            Some(confined) => confined.create(path),
        }
    }

    /// Creates a file that can be read by others while it is written, as a log; an older one is replaced.
    ///
    /// # Errors
    /// As [`Files::create`].
    pub fn create_log(&self, path: &Path) -> Result<File, FileError> {
        match &self.rules {
            None => File::create(path).map_err(|source| FileError { path: path.to_owned(), source }),
            Some(confined) => confined.create_log(path),
        }
    }

    /// Opens a file for writing behind what it holds; one that does not exist is made.
    ///
    /// # Errors
    /// As [`Files::create`].
    pub fn append(&self, path: &Path) -> Result<File, FileError> {
        match &self.rules {
            None => {
                let opened = File::options().append(true).create(true).open(path);
                opened.map_err(|source| FileError { path: path.to_owned(), source })
            }
            Some(confined) => confined.append(path),
        }
    }

    /// Finds out whether [`Files::create`] would begin the file, without leaving anything behind.
    ///
    /// # Errors
    /// As [`Files::create`].
    pub fn check_create(&self, path: &Path) -> Result<(), FileError> {
        let special = self.rules.is_none() && path.metadata().is_ok_and(|m| !m.is_file() && !m.is_dir());
        // What is written directly may not be opened twice.
        if special { Ok(()) } else { self.create(path).map(drop) }
    }

    /// A file without a name that vanishes with its handle: in the folder of [`Files::with_temporary`], without one in the
    /// folder of `beside` where that can be, as files that are large belong on the disk of the result, otherwise in the
    /// system's folder for temporary files.
    ///
    /// # Errors
    /// What the system says.
    pub fn scratch(&self, beside: &Path) -> io::Result<File> {
        let folder = match (&self.temporary, &self.rules) {
            (Some(folder), _) => folder.to_path_buf(),
            (None, Some(confined)) => confined.scratch_folder(beside),
            (None, None) => beside.parent().unwrap_or(Path::new("")).to_owned(),
        };
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { &folder };
        tempfile::tempfile_in(folder).or_else(|_| tempfile::tempfile())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(target_os = "linux")]
    fn files_that_vanish_lie_beside_results_or_where_they_are_told() {
        use std::os::fd::AsRawFd;
        let dir = tempfile::tempdir().unwrap();
        let (results, temporary) = (dir.path().join("results"), dir.path().join("temporary"));
        [&results, &temporary].into_iter().for_each(|folder| std::fs::create_dir(folder).unwrap());
        let plain = Files::default();
        let confined =
            Files::confined(Confinement { write: Some(results.clone()), ..Confinement::default() });
        for files in [plain, confined] {
            let lies_in = |files: &Files, folder: &Path| {
                let file = files.scratch(&results.join("a.sdb")).unwrap();
                let link = std::fs::read_link(format!("/proc/self/fd/{}", file.as_raw_fd())).unwrap();
                assert!(link.starts_with(std::fs::canonicalize(folder).unwrap()), "{}", link.display());
            };
            lies_in(&files, &results);
            let told = files.clone().with_temporary(&temporary);
            lies_in(&told, &temporary);
            assert!(told != files && told.temporary_folder() == temporary);
            assert_eq!(told.is_confined(), files.is_confined());
        }
        for folder in [results, temporary] {
            assert_eq!(std::fs::read_dir(folder).unwrap().count(), 0, "nothing is left");
        }
    }

    #[test]
    fn one_file_has_many_names() {
        let dir = tempfile::tempdir().unwrap();
        let (a, b) = (dir.path().join("a"), dir.path().join("b"));
        assert!(!is_same_file(&a, &a), "nothing is there");
        std::fs::write(&a, "a").unwrap();
        std::fs::write(&b, "a").unwrap();
        assert!(is_same_file(&a, &dir.path().join(".").join("a")));
        assert!(!is_same_file(&a, &b) && !is_same_file(dir.path(), dir.path()));
        #[cfg(unix)]
        {
            let (soft, hard) = (dir.path().join("soft"), dir.path().join("hard"));
            std::os::unix::fs::symlink("a", &soft).unwrap();
            std::fs::hard_link(&a, &hard).unwrap();
            assert!(is_same_file(&a, &soft) && is_same_file(&hard, &a) && !is_same_file(&b, &hard));
        }
    }
}
