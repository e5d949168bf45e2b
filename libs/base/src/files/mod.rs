//! Files. Every file that a run reads or writes is opened through one [`Files`].
//!
//! By default it opens every file that the process may open. [`Files::confined`] is for untrusted scenes. Files that
//! are read must then be beneath one of a list of folders, and files that are written beneath one folder of the scene
//! (see [`Confinement`] for the rules). The value is passed with the variables of a session ([`crate::Environment`]),
//! so that search paths, readers and writers apply it automatically.
//!
//! ```
//! use granita_base::Files;
//! let files = Files::default();
//! assert!(files.is_file("Cargo.toml".as_ref()));
//! ```

mod atomic;
mod confined;
mod moved;

pub use atomic::{AtomicFile, remove_unfinished};
pub use confined::{Confinement, Rules};
pub use moved::{MovedFolders, without_dots};

use confined::Confined;
use std::borrow::Cow;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

/// The state of a file on disk. A file that was written again has another one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FileStamp {
    modified: Option<SystemTime>,
    bytes: u64,
    /// The number of the file in its file system; 0 where there is none.
    number: u64,
}

impl FileStamp {
    fn of(metadata: &std::fs::Metadata) -> Self {
        #[cfg(unix)]
        let number = std::os::unix::fs::MetadataExt::ino(metadata);
        #[cfg(not(unix))]
        let number = 0;
        Self { modified: metadata.modified().ok(), bytes: metadata.len(), number }
    }
}

/// A file that cannot be opened, read or written.
#[derive(Debug, thiserror::Error)]
#[error("{}: {source}", path.display())]
pub struct FileError {
    /// The file, as it was named.
    pub path: PathBuf,
    /// The system's error, or the reason why the rules of the run refuse the file
    /// ([`io::ErrorKind::PermissionDenied`]).
    pub source: io::Error,
}

/// True when two names refer to one existing file, so that writing one would replace the other.
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
    /// The folder of temporary files; `None` when they are beside results.
    temporary: Option<Arc<Path>>,
    /// The modification time of files that are written; `None` for the time of writing.
    modified: Option<SystemTime>,
    /// The folders whose files are elsewhere.
    moved: Option<Arc<MovedFolders>>,
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
            && self.modified == other.modified
            && self.moved == other.moved
    }
}

impl Eq for Files {}

impl Files {
    /// Returns an opener with the rules of `confinement`.
    pub fn confined(confinement: Confinement) -> Self {
        Self { rules: Some(Arc::new(Confined::new(confinement))), ..Self::default() }
    }

    /// Returns an opener that writes anywhere. It reads the files and folders that the user `named`, and everything
    /// beneath the folders of these files. It is for tools whose user names all results, while files name other files.
    pub fn reading<'a>(named: impl IntoIterator<Item = &'a Path>) -> Self {
        let files = Self::confined(Confinement::default());
        named.into_iter().for_each(|path| files.add_named(path));
        files
    }

    /// Allows reading a file that the user named and everything beneath its folder, or everything beneath a folder
    /// that the user named.
    pub fn add_named(&self, path: &Path) {
        self.grant(path);
        match path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            _ if path.is_dir() => self.add_root(path),
            Some(folder) => self.add_root(folder),
            None => self.add_root(Path::new(".")),
        }
    }

    /// Puts temporary files, which are deleted with their handles, into `folder` instead of beside results.
    #[must_use]
    pub fn with_temporary(self, folder: &Path) -> Self {
        Self { temporary: Some(folder.into()), ..self }
    }

    /// Sets `modified` as the modification time of files of [`Files::create`].
    #[must_use]
    pub fn with_modified(self, modified: SystemTime) -> Self {
        Self { modified: Some(modified), ..self }
    }

    /// Looks for the files of `moved` at their new places, for reading and for writing.
    #[must_use]
    pub fn with_moved(self, moved: Arc<MovedFolders>) -> Self {
        Self { moved: Some(moved), ..self }
    }

    /// Returns the folders whose files are elsewhere, if there are any.
    pub fn moved(&self) -> Option<&Arc<MovedFolders>> {
        self.moved.as_ref()
    }

    /// Returns the place of a file or folder, which differs from its name when it was moved ([`Files::with_moved`]).
    pub fn place<'a>(&self, path: &'a Path) -> Cow<'a, Path> {
        self.moved.as_ref().map_or(Cow::Borrowed(path), |moved| moved.place(path))
    }

    /// Returns the folder of files that do not belong beside a result, which is that of [`Files::with_temporary`] or
    /// the system's.
    pub fn temporary_folder(&self) -> PathBuf {
        self.temporary.as_deref().map_or_else(std::env::temp_dir, Path::to_owned)
    }

    /// True when rules restrict what is opened.
    pub fn is_confined(&self) -> bool {
        self.rules.is_some()
    }

    /// Allows reading files beneath `folder`. A folder that does not exist, or a relative one, has no effect.
    pub fn add_root(&self, folder: &Path) {
        if let Some(confined) = &self.rules {
            confined.add_root(&self.place(folder));
        }
    }

    /// Allows reading this one file, whatever the rules, because the user named it.
    pub fn grant(&self, file: &Path) {
        if let Some(confined) = &self.rules {
            confined.grant(&self.place(file), false);
        }
    }

    /// Allows writing and reading this one file, whatever the rules, because the user named it as a result.
    pub fn grant_output(&self, file: &Path) {
        if let Some(confined) = &self.rules {
            confined.grant(&self.place(file), true);
        }
    }

    /// Returns the current rules; `None` without rules.
    pub fn rules(&self) -> Option<Rules> {
        self.rules.as_ref().map(|confined| confined.rules())
    }

    /// Opens a file for reading.
    ///
    /// # Errors
    /// Returns the system's error, or [`io::ErrorKind::PermissionDenied`] when the rules refuse the file.
    pub fn open(&self, path: &Path) -> io::Result<File> {
        let path = &*self.place(path);
        match &self.rules {
            None => File::open(path),
            Some(confined) => confined.open(path),
        }
    }

    /// Returns all bytes of a file.
    ///
    /// # Errors
    /// Returns the errors of [`Files::open`].
    pub fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        let mut file = self.open(path)?;
        let size = file.metadata().map_or(0, |m| m.len());
        let mut bytes = Vec::with_capacity(usize::try_from(size).unwrap_or(0).min(1 << 28));
        file.read_to_end(&mut bytes)?;
        Ok(bytes)
    }

    /// Returns the text of a file.
    ///
    /// # Errors
    /// Returns the errors of [`Files::open`], or [`io::ErrorKind::InvalidData`] when the text is not UTF-8.
    pub fn read_to_string(&self, path: &Path) -> io::Result<String> {
        String::from_utf8(self.read(path)?).map_err(|e| io::Error::new(io::ErrorKind::InvalidData, e))
    }

    /// True when `path` is a file that may be read.
    pub fn is_file(&self, path: &Path) -> bool {
        let path = &*self.place(path);
        match &self.rules {
            None => path.is_file(),
            Some(confined) => confined.is_file(path),
        }
    }

    /// Returns the stamp of a file; `None` when there is no such file, or none that may be read.
    pub fn stamp(&self, path: &Path) -> Option<FileStamp> {
        let path = &*self.place(path);
        let metadata = match &self.rules {
            None => path.metadata().ok()?,
            Some(_) => self.open(path).ok()?.metadata().ok()?,
        };
        Some(FileStamp::of(&metadata))
    }

    /// Returns the location of the file that the run itself wrote under the relative name `path`; `None` when it wrote
    /// no such file.
    pub fn written(&self, path: &Path) -> Option<PathBuf> {
        self.rules.as_ref()?.written(path)
    }

    /// Begins a file that appears under its name complete or not at all.
    ///
    /// # Errors
    /// Returns [`FileError`] with the system's error, or with the rule that refuses the name.
    pub fn create(&self, path: &Path) -> Result<AtomicFile, FileError> {
        let path = &*self.place(path);
        let file = match &self.rules {
            None => AtomicFile::create(path),
            Some(confined) => confined.create(path),
        };
        file.map(|file| file.with_modified(self.modified))
    }

    /// Creates a file that others can read while it is written, such as a log. An existing file is replaced.
    ///
    /// # Errors
    /// Returns the errors of [`Files::create`].
    pub fn create_log(&self, path: &Path) -> Result<File, FileError> {
        let path = &*self.place(path);
        match &self.rules {
            None => File::create(path).map_err(|source| FileError { path: path.to_owned(), source }),
            Some(confined) => confined.create_log(path),
        }
    }

    /// Opens a file for appending. A file that does not exist is created.
    ///
    /// # Errors
    /// Returns the errors of [`Files::create`].
    pub fn append(&self, path: &Path) -> Result<File, FileError> {
        let path = &*self.place(path);
        match &self.rules {
            None => {
                let opened = File::options().append(true).create(true).open(path);
                opened.map_err(|source| FileError { path: path.to_owned(), source })
            }
            Some(confined) => confined.append(path),
        }
    }

    /// Checks whether [`Files::create`] would begin the file, without leaving a file.
    ///
    /// # Errors
    /// Returns the errors of [`Files::create`].
    pub fn check_create(&self, path: &Path) -> Result<(), FileError> {
        let special =
            self.rules.is_none() && self.place(path).metadata().is_ok_and(|m| !m.is_file() && !m.is_dir());
        // A special file is written directly, and must not be opened twice.
        if special { Ok(()) } else { self.create(path).map(drop) }
    }

    /// Returns a file without a name that is deleted with its handle. It is in the folder of
    /// [`Files::with_temporary`] if that is set. Otherwise it is in the folder of `beside` where possible, because
    /// large files belong on the disk of the result, and else in the system's folder for temporary files.
    ///
    /// # Errors
    /// Returns the system's error.
    pub fn scratch(&self, beside: &Path) -> io::Result<File> {
        let folder = match (&self.temporary, &self.rules) {
            (Some(folder), _) => folder.to_path_buf(),
            (None, Some(confined)) => confined.scratch_folder(beside),
            (None, None) => self.place(beside).parent().unwrap_or(Path::new("")).to_owned(),
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
    fn temporary_files_are_beside_the_results_or_in_the_named_folder() {
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
    fn files_have_the_requested_modification_time() {
        use std::io::Write;
        let dir = tempfile::tempdir().unwrap();
        let then = SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(1_000_000_000);
        let write = Some(dir.path().to_owned());
        let extensions = vec!["tif".to_owned()];
        let confined = Files::confined(Confinement { write, extensions, ..Confinement::default() });
        for (files, path) in [(Files::default(), dir.path().join("a")), (confined, PathBuf::from("b.tif"))] {
            let old = files.clone().with_modified(then);
            assert!(old != files);
            // The cases are a new file, a file that replaces another, and a file without a set time.
            for (files, is_then) in [(&old, true), (&old, true), (&files, false)] {
                let mut file = files.create(&path).unwrap();
                file.write_all(b"text").unwrap();
                file.commit().unwrap();
                let place = dir.path().join(&path);
                assert_eq!(std::fs::metadata(place).unwrap().modified().unwrap() == then, is_then);
            }
        }
    }

    #[test]
    fn different_names_of_one_file_are_recognised() {
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
