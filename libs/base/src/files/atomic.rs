//! Files that appear complete or not at all.

use super::FileError;
use cap_std::ambient_authority;
use cap_std::fs::{Dir, OpenOptions};
use parking_lot::{Mutex, MutexGuard};
use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// A file that is being written. [`AtomicFile::commit`] gives it its name.
///
/// When it is dropped without `commit`, no file is left, and a file that had the name before is unchanged. Where the
/// system supports files without names (Linux, most local disks), a program that is killed leaves no file either.
/// Elsewhere the file has a hidden name beside the final one until `commit`. [`remove_unfinished`] is for signal
/// handlers, and a file that a killed program left is removed when the same file is written next.
///
/// A symbolic link is followed. The file that it points to is replaced, not the link. A target that is not a plain
/// file (a device, a pipe) is written to directly, because it cannot be replaced.
pub struct AtomicFile {
    path: PathBuf,
    target: Target,
    claim: Option<Claim>,
    /// The modification time that the file gets; `None` for the time of writing.
    modified: Option<SystemTime>,
}

/// A function that is called right before the file gets its name.
type Claim = Box<dyn FnOnce() -> io::Result<()> + Send + Sync>;

enum Target {
    /// A file in the folder of the final name.
    Beside(BufWriter<File>, Place),
    /// The target itself.
    Direct(BufWriter<File>),
}

/// The location of the final file.
struct Place {
    folder: Dir,
    /// The path for messages and signal handlers.
    folder_path: PathBuf,
    name: PathBuf,
    /// The hidden name of the file until it gets its final name.
    draft: Option<Draft>,
}

/// A hidden name. The file is removed when this is dropped, while it is `ours`.
struct Draft {
    folder: Dir,
    name: String,
    path: PathBuf,
    ours: bool,
}

/// The hidden names that this process has created and not removed. The list is global, because a signal ends the whole
/// process.
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

fn unfinished() -> MutexGuard<'static, Vec<PathBuf>> {
    UNFINISHED.lock()
}

/// Removes the files under hidden names that this process has not finished. It is for a program that is about to end
/// by a signal.
pub fn remove_unfinished() {
    for path in std::mem::take(&mut *unfinished()) {
        // The file may already be gone or renamed. Nothing can be done for a file that cannot be removed.
        let _ = std::fs::remove_file(path);
    }
}

/// The largest number of programs that may write the same file at the same time.
const DRAFTS: u32 = 100;

/// The longest time to wait for a program that reads from a pipe.
const READER_WAIT: std::time::Duration = std::time::Duration::from_secs(2);

impl std::fmt::Debug for AtomicFile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("AtomicFile").field("path", &self.path).finish_non_exhaustive()
    }
}

impl AtomicFile {
    /// Begins a file that will be called `path`. The folder must exist.
    ///
    /// # Errors
    /// Returns the system's error, with the name.
    pub fn create(path: &Path) -> Result<Self, FileError> {
        Self::begin(path, true).map_err(|source| FileError { path: path.to_owned(), source })
    }

    /// Begins a file that will be `name` in `folder` and replaces any existing one. `path` is its name in messages.
    pub(super) fn create_in(path: &Path, folder: Dir, folder_path: PathBuf, name: &Path) -> io::Result<Self> {
        let target = Target::beside(Place { folder, folder_path, name: name.to_owned(), draft: None }, true)?;
        Ok(Self { path: path.to_owned(), target, claim: None, modified: None })
    }

    /// Sets the time of the last change that the file has when it appears. A device or a pipe keeps its own.
    pub(super) fn with_modified(self, modified: Option<SystemTime>) -> Self {
        Self { modified, ..self }
    }

    /// Sets `claim`, which is called right before the file gets its name.
    pub(super) fn with_claim(mut self, claim: Claim) -> Self {
        self.claim = Some(claim);
        self
    }

    fn begin(path: &Path, unnamed: bool) -> io::Result<Self> {
        // A link to a file that does not exist cannot be resolved. The link itself is then replaced.
        let destination = std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let special = std::fs::metadata(&destination).is_ok_and(|m| !m.is_file());
        let target = if special {
            Target::Direct(BufWriter::new(open_special(&destination)?))
        } else {
            let name =
                destination.file_name().ok_or_else(|| io::Error::other("it is not the name of a file"))?;
            let folder_path = match destination.parent() {
                Some(p) if !p.as_os_str().is_empty() => p.to_owned(),
                _ => PathBuf::from("."),
            };
            let folder = Dir::open_ambient_dir(&folder_path, ambient_authority())?;
            Target::beside(Place { folder, folder_path, name: name.into(), draft: None }, unnamed)?
        };
        Ok(Self { path: path.to_owned(), target, claim: None, modified: None })
    }

    /// Returns the final name, as it was given.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes all data to the disk and gives the file its name.
    ///
    /// # Errors
    /// Returns the system's error. No file has changed then.
    pub fn commit(self) -> Result<(), FileError> {
        let Self { path, target, claim, modified } = self;
        let finish = || -> io::Result<()> {
            match target {
                Target::Direct(writer) => writer.into_inner().map(drop).map_err(|e| e.into_error()),
                Target::Beside(writer, mut place) => {
                    let file = writer.into_inner().map_err(|e| e.into_error())?;
                    modified.map_or(Ok(()), |time| file.set_modified(time))?;
                    file.sync_all()?;
                    claim.map_or(Ok(()), |claim| claim())?;
                    place.give_name(&file)?;
                    // The name itself is durable only once the folder is. Not every system can synchronise a folder,
                    // and the file is complete in any case, so that a refusal is not an error.
                    if let Ok(folder) = place.folder.try_clone() {
                        let _ = folder.into_std_file().sync_all();
                    }
                    Ok(())
                }
            }
        };
        finish().map_err(|source| FileError { path, source })
    }

    /// Returns an error of the system together with the name of this file.
    pub fn io_error(&self, source: io::Error) -> FileError {
        FileError { path: self.path.clone(), source }
    }

    fn writer(&mut self) -> &mut BufWriter<File> {
        match &mut self.target {
            Target::Beside(writer, _) | Target::Direct(writer) => writer,
        }
    }
}

impl Target {
    fn beside(mut place: Place, unnamed: bool) -> io::Result<Self> {
        let file = match unnamed_file(&place.folder).filter(|_| unnamed) {
            Some(file) => file,
            None => {
                let (draft, file) = place.draft(|draft| {
                    let options = OpenOptions::new().read(true).write(true).create_new(true).to_owned();
                    let file = draft.folder.open_with(&draft.name, &options)?.into_std();
                    Ok((lock_draft(&file)?, file))
                })?;
                place.draft = Some(draft);
                file
            }
        };
        Ok(Self::Beside(BufWriter::with_capacity(1 << 16, file), place))
    }
}

impl Place {
    /// Finds a hidden name for which `make` succeeds. `make` returns [`io::ErrorKind::AlreadyExists`] when there is
    /// such a file, and `false` when another program removed the file as abandoned.
    fn draft<T>(&self, make: impl Fn(&Draft) -> io::Result<(bool, T)>) -> io::Result<(Draft, T)> {
        let text = self.name.to_string_lossy();
        let hash = text.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3)
        });
        for k in 0..DRAFTS {
            let name = format!(".granita-{hash:016x}-{k}.part");
            let path = self.folder_path.join(&name);
            let mut draft = Draft { folder: self.folder.try_clone()?, name, path, ours: false };
            for _ in 0..2 {
                match make(&draft) {
                    Ok((true, made)) => {
                        draft.ours = true;
                        unfinished().push(draft.path.clone());
                        return Ok((draft, made));
                    }
                    Ok((false, _)) => (),
                    Err(error) if error.kind() != io::ErrorKind::AlreadyExists => return Err(error),
                    Err(_) if draft.remove_abandoned() => (),
                    Err(_) => break,
                }
            }
        }
        Err(io::Error::other(format!("{DRAFTS} programs write this file at the same time")))
    }

    /// Gives the finished file its name.
    fn give_name(&mut self, file: &File) -> io::Result<()> {
        if self.draft.is_none() {
            match link(file, &self.folder, &self.name) {
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
                    let (draft, ()) = self.draft(|draft| {
                        link(file, &draft.folder, Path::new(&draft.name))?;
                        Ok((lock_draft(file)?, ()))
                    })?;
                    self.draft = Some(draft);
                }
                done => return done,
            }
        }
        let Some(mut draft) = self.draft.take() else { return Ok(()) };
        self.folder.rename(&draft.name, &self.folder, &self.name)?;
        draft.ours = false;
        draft.forget();
        Ok(())
    }
}

impl Draft {
    fn forget(&self) {
        unfinished().retain(|path| *path != self.path);
    }

    /// Removes a file of this name that no program is writing. The writer of a file holds a lock on it.
    fn remove_abandoned(&self) -> bool {
        let Ok(file) = self.folder.open(&self.name) else { return true };
        let file = file.into_std();
        file.try_lock().is_ok() && has_name(&file) && self.folder.remove_file(&self.name).is_ok()
    }
}

impl Drop for Draft {
    fn drop(&mut self) {
        if !self.ours {
            return;
        }
        // A file that cannot be removed is removed when the file is written again.
        let _ = self.folder.remove_file(&self.name);
        self.forget();
    }
}

/// Locks the file to show other programs that it is being written. Returns false when another program has just
/// removed its name. Systems without locks keep abandoned files.
fn lock_draft(file: &File) -> io::Result<bool> {
    match file.try_lock() {
        Ok(()) => Ok(has_name(file)),
        Err(std::fs::TryLockError::WouldBlock) => Ok(false),
        Err(std::fs::TryLockError::Error(_)) => Ok(true),
    }
}

#[cfg(unix)]
fn has_name(file: &File) -> bool {
    use std::os::unix::fs::MetadataExt;
    file.metadata().is_ok_and(|m| m.nlink() > 0)
}

#[cfg(not(unix))]
fn has_name(_: &File) -> bool {
    true
}

/// Returns a file in `folder` that has no name; `None` where the system has no such files or could not name them
/// later.
#[cfg(target_os = "linux")]
fn unnamed_file(folder: &Dir) -> Option<File> {
    use rustix::fs::{Mode, OFlags, openat};
    if !Path::new("/proc/self/fd").is_dir() {
        return None;
    }
    let flags = OFlags::TMPFILE | OFlags::RDWR | OFlags::CLOEXEC;
    openat(folder, ".", flags, Mode::from_raw_mode(0o666)).ok().map(File::from)
}

#[cfg(not(target_os = "linux"))]
fn unnamed_file(_: &Dir) -> Option<File> {
    None
}

#[cfg(target_os = "linux")]
fn link(file: &File, folder: &Dir, name: &Path) -> io::Result<()> {
    use rustix::fs::{AtFlags, CWD, linkat};
    use std::os::fd::AsRawFd;
    let unnamed = format!("/proc/self/fd/{}", file.as_raw_fd());
    Ok(linkat(CWD, unnamed, folder, name, AtFlags::SYMLINK_FOLLOW)?)
}

#[cfg(not(target_os = "linux"))]
fn link(_: &File, _: &Dir, _: &Path) -> io::Result<()> {
    Err(io::Error::other("the system does not support unnamed files"))
}

/// Opens a device or a pipe. A pipe that no program reads is an error, after a short time in which a reader may
/// start.
#[cfg(unix)]
fn open_special(path: &Path) -> io::Result<File> {
    use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
    use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
    if !path.metadata()?.file_type().is_fifo() {
        return File::options().write(true).open(path);
    }
    let begin = std::time::Instant::now();
    loop {
        let nonblocking = i32::try_from(OFlags::NONBLOCK.bits()).unwrap_or_default();
        match File::options().write(true).custom_flags(nonblocking).open(path) {
            Ok(file) => {
                fcntl_setfl(&file, fcntl_getfl(&file)? - OFlags::NONBLOCK)?;
                return Ok(file);
            }
            Err(error) if error.raw_os_error() != Some(rustix::io::Errno::NXIO.raw_os_error()) => {
                return Err(error);
            }
            Err(_) if begin.elapsed() > READER_WAIT => {
                return Err(io::Error::other(format!(
                    "no program reads from this pipe (waited for {} s)",
                    READER_WAIT.as_secs()
                )));
            }
            Err(_) => std::thread::sleep(std::time::Duration::from_millis(20)),
        }
    }
}

#[cfg(not(unix))]
fn open_special(path: &Path) -> io::Result<File> {
    File::options().write(true).open(path)
}

impl Write for AtomicFile {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        self.writer().write(buf)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.writer().flush()
    }
}

impl Seek for AtomicFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.writer().seek(to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> = std::fs::read_dir(folder)
            .unwrap()
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    /// Runs a test with both kinds of files: those without names, and those with hidden names.
    fn both(test: impl Fn(&Path, &dyn Fn(&Path) -> AtomicFile)) {
        for unnamed in [true, false] {
            let dir = tempfile::tempdir().unwrap();
            test(dir.path(), &|path| AtomicFile::begin(path, unnamed).unwrap());
        }
    }

    #[test]
    fn a_dropped_file_leaves_nothing_and_keeps_the_old_file() {
        both(|dir, create| {
            let path = dir.join("a.tif");
            create(&path).write_all(b"half").unwrap();
            assert!(names(dir).is_empty());
            std::fs::write(&path, "old").unwrap();
            create(&path).write_all(b"half").unwrap();
            assert_eq!(names(dir), ["a.tif"]);
            assert_eq!(std::fs::read(&path).unwrap(), b"old");
        });
    }

    #[test]
    fn a_committed_file_replaces_the_old_file() {
        both(|dir, create| {
            let path = dir.join("a.tif");
            for old in [None, Some("old")] {
                if let Some(old) = old {
                    std::fs::write(&path, old).unwrap();
                }
                let mut f = create(&path);
                f.write_all(b"0123456789").unwrap();
                f.seek(SeekFrom::Start(2)).unwrap();
                f.write_all(b"xx").unwrap();
                assert_eq!(std::fs::read(&path).ok().as_deref(), old.map(str::as_bytes));
                f.commit().unwrap();
                assert_eq!(std::fs::read(&path).unwrap(), b"01xx456789");
                assert_eq!(names(dir), ["a.tif"]);
            }
        });
    }

    #[test]
    fn concurrent_writers_are_independent_and_abandoned_files_removed() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.tif");
        let create = || AtomicFile::begin(&path, false).unwrap();
        let (mut one, mut two) = (create(), create());
        one.write_all(b"one").unwrap();
        two.write_all(b"two").unwrap();
        assert_eq!(names(dir.path()).len(), 2);
        two.commit().unwrap();
        one.commit().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"one");
        // A killed program leaves the file without a lock on it.
        let mut killed = create();
        killed.write_all(b"half").unwrap();
        killed.flush().unwrap();
        let name = names(dir.path()).into_iter().find(|n| n.ends_with(".part")).unwrap();
        drop(killed);
        std::fs::write(dir.path().join(&name), "half").unwrap();
        create().commit().unwrap();
        assert_eq!(names(dir.path()), ["a.tif"]);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn unnamed_files_are_not_visible_before_the_commit() {
        let dir = tempfile::tempdir().unwrap();
        if unnamed_file(&Dir::open_ambient_dir(dir.path(), ambient_authority()).unwrap()).is_none() {
            return assert!(AtomicFile::create(&dir.path().join("a")).is_ok(), "a file system without them");
        }
        let mut file = AtomicFile::create(&dir.path().join("a")).unwrap();
        file.write_all(b"half").unwrap();
        file.flush().unwrap();
        assert!(names(dir.path()).is_empty());
        file.commit().unwrap();
        assert_eq!(names(dir.path()), ["a"]);
    }

    #[test]
    fn errors_about_missing_folders_name_the_file() {
        let dir = tempfile::tempdir().unwrap();
        let error = AtomicFile::create(&dir.path().join("no/a.tif")).unwrap_err().to_string();
        assert!(error.contains("a.tif"), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn symbolic_links_are_followed_and_permissions_are_usual() {
        use std::os::unix::fs::PermissionsExt;
        both(|dir, create| {
            let (file, link) = (dir.join("real"), dir.join("link"));
            std::fs::write(&file, "old").unwrap();
            let usual = std::fs::metadata(&file).unwrap().permissions().mode();
            std::os::unix::fs::symlink(&file, &link).unwrap();
            let mut f = create(&link);
            f.write_all(b"new").unwrap();
            f.commit().unwrap();
            assert!(std::fs::symlink_metadata(&link).unwrap().is_symlink());
            assert_eq!(std::fs::read(&file).unwrap(), b"new");
            assert_eq!(std::fs::metadata(&file).unwrap().permissions().mode(), usual);
        });
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn devices_are_written_directly() {
        let mut f = AtomicFile::create(Path::new("/dev/null")).unwrap();
        f.write_all(b"gone").unwrap();
        f.commit().unwrap();
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_pipe_without_a_reader_is_an_error_without_waiting() {
        let dir = tempfile::tempdir().unwrap();
        let pipe = dir.path().join("pipe");
        rustix::fs::mknodat(
            rustix::fs::CWD,
            &pipe,
            rustix::fs::FileType::Fifo,
            rustix::fs::Mode::from_raw_mode(0o600),
            0,
        )
        .unwrap();
        let error = AtomicFile::create(&pipe).unwrap_err().to_string();
        assert!(error.contains("no program reads from this pipe"), "{error}");
        let reader = {
            let pipe = pipe.clone();
            std::thread::spawn(move || std::fs::read(pipe).unwrap())
        };
        let mut f = AtomicFile::create(&pipe).unwrap();
        f.write_all(&[7; 100_000]).unwrap();
        f.commit().unwrap();
        assert_eq!(reader.join().unwrap(), [7; 100_000]);
    }
}
