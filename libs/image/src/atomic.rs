//! Files that appear whole or not at all.

use crate::{ImageError, Result};
use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// A file being written beside its final name; [`AtomicFile::commit`] puts it there.
///
/// Dropped without `commit`, nothing is left and a file that had the name before is untouched. A
/// symbolic link is followed: the file it points to is replaced, not the link. Something that is no
/// plain file (a device, a pipe) is written to directly, because it cannot be replaced.
#[derive(Debug)]
pub struct AtomicFile {
    path: PathBuf,
    target: Target,
}

#[derive(Debug)]
enum Target {
    /// A temporary file in the same folder, and the name it will get.
    Beside(BufWriter<NamedTempFile>, PathBuf),
    /// The thing itself.
    Direct(BufWriter<File>),
}

impl AtomicFile {
    /// Begins a file that will be called `path`. The folder must exist.
    pub fn create(path: &Path) -> Result<Self> {
        let io = |source| ImageError::Io { path: path.to_owned(), source };
        // A link to nothing cannot be resolved; then the link itself is replaced.
        let destination = std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let special = std::fs::metadata(&destination).is_ok_and(|m| !m.is_file());
        let target = if special {
            Target::Direct(BufWriter::new(File::options().write(true).open(&destination).map_err(io)?))
        } else {
            let folder = match destination.parent() {
                Some(p) if !p.as_os_str().is_empty() => p,
                _ => Path::new("."),
            };
            let mut builder = tempfile::Builder::new();
            builder.prefix(".granita-").suffix(".part");
            #[cfg(unix)]
            {
                // Rights as if the file had been created in the usual way; the process's mask applies.
                use std::os::unix::fs::PermissionsExt;
                builder.permissions(std::fs::Permissions::from_mode(0o666));
            }
            let file = builder.tempfile_in(folder).map_err(io)?;
            Target::Beside(BufWriter::with_capacity(1 << 16, file), destination)
        };
        Ok(Self { path: path.to_owned(), target })
    }

    /// The final name, as it was given.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes everything through to the disk and gives the file its name.
    pub fn commit(self) -> Result<()> {
        let Self { path, target } = self;
        let io = |source| ImageError::Io { path: path.clone(), source };
        match target {
            Target::Direct(writer) => {
                writer.into_inner().map_err(|e| io(e.into_error()))?;
            }
            Target::Beside(writer, destination) => {
                let file = writer.into_inner().map_err(|e| io(e.into_error()))?;
                file.as_file().sync_all().map_err(io)?;
                file.persist(&destination).map_err(|e| io(e.error))?;
                // The name itself is durable only once the folder is. Not every system lets a folder be
                // synchronised, and the file is complete in any case, so a refusal is no error.
                #[cfg(unix)]
                if let Some(folder) = destination.parent() {
                    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
                    if let Ok(folder) = File::open(folder) {
                        let _ = folder.sync_all();
                    }
                }
            }
        }
        Ok(())
    }

    /// An error of this file from one of the system.
    pub fn io_error(&self, source: io::Error) -> ImageError {
        ImageError::Io { path: self.path.clone(), source }
    }
}

impl Write for AtomicFile {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        match &mut self.target {
            Target::Beside(w, _) => w.write(buf),
            Target::Direct(w) => w.write(buf),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match &mut self.target {
            Target::Beside(w, _) => w.flush(),
            Target::Direct(w) => w.flush(),
        }
    }
}

impl Seek for AtomicFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match &mut self.target {
            Target::Beside(w, _) => w.seek(to),
            Target::Direct(w) => w.seek(to),
        }
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

    #[test]
    fn dropped_leaves_nothing_and_keeps_the_old() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.tif");
        AtomicFile::create(&path).unwrap().write_all(b"half").unwrap();
        assert!(names(dir.path()).is_empty());
        std::fs::write(&path, "old").unwrap();
        AtomicFile::create(&path).unwrap().write_all(b"half").unwrap();
        assert_eq!(names(dir.path()), ["a.tif"]);
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
    }

    #[test]
    fn committed_replaces() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.tif");
        std::fs::write(&path, "old").unwrap();
        let mut f = AtomicFile::create(&path).unwrap();
        f.write_all(b"0123456789").unwrap();
        f.seek(SeekFrom::Start(2)).unwrap();
        f.write_all(b"xx").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        f.commit().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"01xx456789");
        assert_eq!(names(dir.path()), ["a.tif"]);
    }

    #[test]
    fn a_missing_folder_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let error = AtomicFile::create(&dir.path().join("no/a.tif")).unwrap_err().to_string();
        assert!(error.contains("a.tif"), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed_and_rights_are_usual() {
        use std::os::unix::fs::PermissionsExt;
        let dir = tempfile::tempdir().unwrap();
        let (file, link) = (dir.path().join("real"), dir.path().join("link"));
        std::fs::write(&file, "old").unwrap();
        let usual = std::fs::metadata(&file).unwrap().permissions().mode();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        let mut f = AtomicFile::create(&link).unwrap();
        f.write_all(b"new").unwrap();
        f.commit().unwrap();
        assert!(std::fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(std::fs::read(&file).unwrap(), b"new");
        assert_eq!(std::fs::metadata(&file).unwrap().permissions().mode(), usual);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn devices_are_written_directly() {
        let mut f = AtomicFile::create(Path::new("/dev/null")).unwrap();
        f.write_all(b"gone").unwrap();
        f.commit().unwrap();
    }
}
