//! The rules for untrusted scenes.

use super::{AtomicFile, FileError};
use cap_std::ambient_authority;
use cap_std::fs::{Dir, OpenOptions};
use parking_lot::{Mutex, RwLock};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{self, Read, Write};
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

/// The files that a run for an untrusted scene may open.
///
/// **Reading.** A run reads regular files beneath one of `read` or beneath `write`. Absolute names and `..` are
/// allowed. The resolved name is checked, so that a link that leads outside is refused. Files are opened beneath a
/// handle of the folder, so that a link that is exchanged meanwhile has no effect.
///
/// **Writing.** A run writes files beneath `write` only, by relative names without `..`. No part of a name may begin
/// with a dot or be a link, the name must end in one of `extensions`, and control characters are refused. Missing
/// folders are created. An existing file is replaced only when a run of this `scene` made it. The names of such files
/// are in `.granita-made` in the folder.
#[derive(Clone, Debug, Default)]
pub struct Confinement {
    /// The identity of the scene, which separates it from others that write to the same folder.
    pub scene: String,
    /// The folders beneath which files may be read. A folder that does not exist has no effect.
    pub read: Vec<PathBuf>,
    /// The folder beneath which files are written. It is made with the first file. Without it writing has no rules,
    /// for tools whose user names all results.
    pub write: Option<PathBuf>,
    /// The allowed extensions of files that are written, in lower case and without the dot.
    pub extensions: Vec<String>,
}

/// The current rules of a [`crate::Files`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rules {
    /// The folders beneath which files are read.
    pub read: Vec<PathBuf>,
    /// The folder beneath which files are written; `None` when writing has no rules.
    pub write: Option<PathBuf>,
    /// The files that the user named to be read.
    pub inputs: Vec<PathBuf>,
    /// The files that the user named to be written.
    pub outputs: Vec<PathBuf>,
}

/// The list of files that runs made, in the folder beneath which they are written. Each line holds the scene, a tab
/// and the name.
const LIST: &str = ".granita-made";

/// The length of the longest list that is read, in bytes.
const LONGEST_LIST: u64 = 64 << 20;

/// A folder beneath which files may be read.
struct Root {
    path: PathBuf,
    folder: Dir,
}

pub(super) struct Confined {
    rules: Confinement,
    roots: RwLock<Vec<Arc<Root>>>,
    /// The files that the user named; true for results.
    granted: Mutex<BTreeMap<PathBuf, bool>>,
    made: Mutex<Made>,
}

/// The files that runs of this scene wrote, by relative name.
#[derive(Default)]
struct Made {
    /// The folder, once it is open.
    folder: Option<Arc<Dir>>,
    /// The files of earlier runs and this one.
    listed: BTreeSet<PathBuf>,
    /// The files of this run.
    now: BTreeSet<PathBuf>,
}

fn denied(why: impl Into<String>) -> io::Error {
    io::Error::new(io::ErrorKind::PermissionDenied, why.into())
}

impl Confined {
    pub(super) fn new(rules: Confinement) -> Self {
        let confined = Self {
            roots: RwLock::default(),
            granted: Mutex::default(),
            made: Mutex::default(),
            rules: Confinement { read: Vec::new(), ..rules.clone() },
        };
        rules.read.iter().for_each(|folder| confined.add_root(folder));
        confined
    }

    pub(super) fn add_root(&self, folder: &Path) {
        let Ok(path) = std::fs::canonicalize(folder) else { return };
        let Ok(folder) = Dir::open_ambient_dir(&path, ambient_authority()) else { return };
        let mut roots = self.roots.write();
        if !roots.iter().any(|root| root.path == path) {
            roots.push(Arc::new(Root { path, folder }));
        }
    }

    pub(super) fn grant(&self, file: &Path, output: bool) {
        *self.granted.lock().entry(plain(file)).or_default() |= output;
    }

    fn is_granted(&self, file: &Path) -> bool {
        self.granted.lock().contains_key(&plain(file))
    }

    fn is_granted_output(&self, file: &Path) -> bool {
        self.granted.lock().get(&plain(file)) == Some(&true)
    }

    pub(super) fn rules(&self) -> Rules {
        let roots = self.roots.read();
        let granted = self.granted.lock();
        let named =
            |output| granted.iter().filter(|(_, is)| **is == output).map(|(path, _)| path.clone()).collect();
        Rules {
            read: roots.iter().map(|root| root.path.clone()).collect(),
            write: self.rules.write.clone(),
            inputs: named(false),
            outputs: named(true),
        }
    }

    /// Returns a handle of the folder for writing, and loads the names in its list; `None` while there is no folder.
    fn folder(&self, made: &mut Made, create: bool) -> io::Result<Option<Arc<Dir>>> {
        if let Some(folder) = &made.folder {
            return Ok(Some(folder.clone()));
        }
        let Some(write) = &self.rules.write else { return Ok(None) };
        match std::fs::symlink_metadata(write) {
            Ok(kind) if kind.is_symlink() => {
                return Err(denied(format!("{} is a link: no file is written there", write.display())));
            }
            Ok(_) => (),
            Err(error) if error.kind() == io::ErrorKind::NotFound && !create => return Ok(None),
            Err(error) if error.kind() == io::ErrorKind::NotFound => std::fs::create_dir(write)?,
            Err(error) => return Err(error),
        }
        let folder = Arc::new(Dir::open_ambient_dir(write, ambient_authority())?);
        if let Ok(list) = self.open_regular(&folder, Path::new(LIST)) {
            let mut text = String::new();
            list.take(LONGEST_LIST).read_to_string(&mut text)?;
            let own = text.lines().filter_map(|line| line.split_once('\t'));
            made.listed =
                own.filter(|(scene, _)| *scene == self.rules.scene).map(|(_, name)| name.into()).collect();
        }
        made.folder = Some(folder.clone());
        Ok(Some(folder))
    }

    /// Opens a regular file beneath a folder. It never waits for the writer of a pipe.
    fn open_regular(&self, folder: &Dir, name: &Path) -> io::Result<File> {
        let mut options = OpenOptions::new();
        options.read(true);
        #[cfg(unix)]
        {
            use cap_std::fs::OpenOptionsExt;
            options.custom_flags(i32::try_from(rustix::fs::OFlags::NONBLOCK.bits()).unwrap_or_default());
        }
        let file = folder.open_with(name, &options)?.into_std();
        if file.metadata()?.is_file() { Ok(file) } else { Err(denied("it is not a regular file")) }
    }

    /// Returns the relative name of the file that this run wrote as `path`.
    fn made_now(&self, path: &Path) -> Option<PathBuf> {
        let name = plain(path);
        self.made.lock().now.contains(&name).then_some(name)
    }

    pub(super) fn written(&self, path: &Path) -> Option<PathBuf> {
        Some(self.rules.write.as_ref()?.join(self.made_now(path)?))
    }

    pub(super) fn open(&self, path: &Path) -> io::Result<File> {
        if let Some(name) = self.made_now(path)
            && let Some(folder) = self.folder(&mut self.made.lock(), false)?
        {
            return self.open_regular(&folder, &name);
        }
        if self.is_granted(path) {
            return File::open(path);
        }
        let (root, name) = self.beneath(path)?;
        self.open_regular(&root.folder, &name)
    }

    /// Returns the root that contains a file, and the resolved name relative to it.
    fn beneath(&self, path: &Path) -> io::Result<(Arc<Root>, PathBuf)> {
        let resolved = std::fs::canonicalize(path)?;
        let inside = |root: &Root| resolved.strip_prefix(&root.path).ok().map(Path::to_owned);
        {
            let roots = self.roots.read();
            if let Some(found) = roots.iter().find_map(|root| Some((root.clone(), inside(root)?))) {
                return Ok(found);
            }
        }
        // The folder for writing may have been created since.
        let write = self.rules.write.as_ref().and_then(|write| std::fs::canonicalize(write).ok());
        let write = write.unwrap_or_default();
        if let Some(folder) = self.folder(&mut self.made.lock(), false)?
            && let Ok(name) = resolved.strip_prefix(&write)
            && !write.as_os_str().is_empty()
        {
            return Ok((
                Arc::new(Root { path: write.clone(), folder: folder.try_clone()? }),
                name.to_owned(),
            ));
        }
        Err(denied("it lies outside of the folders that this scene may read (-safe)"))
    }

    pub(super) fn is_file(&self, path: &Path) -> bool {
        self.made_now(path).is_some()
            || self.is_granted(path) && path.is_file()
            || self
                .beneath(path)
                .is_ok_and(|(root, name)| root.folder.metadata(name).is_ok_and(|m| m.is_file()))
    }

    /// Returns the name by which a file may be written.
    fn output_name(&self, path: &Path) -> io::Result<PathBuf> {
        let mut name = PathBuf::new();
        for part in path.components() {
            match part {
                Component::CurDir => (),
                Component::Normal(part) => {
                    let text = part.to_string_lossy();
                    if text.starts_with('.') {
                        return Err(denied("names that begin with a dot are not written (-safe)"));
                    }
                    if text.chars().any(char::is_control) {
                        return Err(denied("names with control characters are not written (-safe)"));
                    }
                    name.push(part);
                }
                _ => return Err(denied("only relative names without \"..\" are written (-safe)")),
            }
        }
        let extension =
            name.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        if !self.rules.extensions.contains(&extension) {
            return Err(denied(format!(
                "files with the extension \"{extension}\" are not written, only images, textures, databases and logs (-safe)"
            )));
        }
        Ok(name)
    }

    /// Returns the folder of `path`, created where it is missing, and the last part of the name. It refuses a file
    /// that must not be replaced.
    fn place(&self, path: &Path) -> io::Result<(Dir, PathBuf, PathBuf)> {
        let name = self.output_name(path)?;
        let mut made = self.made.lock();
        let Some(root) = self.folder(&mut made, true)? else { return Err(io::ErrorKind::NotFound.into()) };
        let mut folder = root.try_clone()?;
        let mut parts: Vec<_> = name.iter().collect();
        let last = parts.pop().unwrap_or_default();
        for part in parts {
            match folder.symlink_metadata(part) {
                Ok(kind) if kind.is_symlink() => {
                    return Err(denied("no file is written through a link (-safe)"));
                }
                Ok(_) => (),
                Err(error) if error.kind() == io::ErrorKind::NotFound => folder.create_dir(part)?,
                Err(error) => return Err(error),
            }
            folder = folder.open_dir(part)?;
        }
        match folder.symlink_metadata(last) {
            Ok(kind) if kind.is_symlink() => return Err(denied("no file is written through a link (-safe)")),
            Ok(kind) if !kind.is_file() => {
                return Err(denied("the existing file is not a regular file (-safe)"));
            }
            Ok(_) if !made.listed.contains(&name) => {
                return Err(denied("the existing file was not made by a run of this scene (-safe)"));
            }
            Ok(_) => (),
            Err(error) if error.kind() == io::ErrorKind::NotFound => (),
            Err(error) => return Err(error),
        }
        Ok((folder, last.into(), name))
    }

    /// Records that a run of this scene made a file.
    fn claim(&self, name: &Path) -> io::Result<()> {
        let mut made = self.made.lock();
        if made.listed.insert(name.to_owned())
            && let Some(folder) = &made.folder
        {
            let mut options = OpenOptions::new();
            options.append(true).create(true);
            let mut list = folder.open_with(LIST, &options)?;
            let text = name.to_str().ok_or_else(|| denied("the name is not valid text (-safe)"))?;
            list.write_all(format!("{}\t{text}\n", self.rules.scene).as_bytes())?;
        }
        made.now.insert(name.to_owned());
        Ok(())
    }

    pub(super) fn create(self: &Arc<Self>, path: &Path) -> Result<AtomicFile, FileError> {
        let Some(write) = self.rules.write.as_ref().filter(|_| !self.is_granted_output(path)) else {
            return AtomicFile::create(path);
        };
        let begin = || -> io::Result<AtomicFile> {
            let (folder, last, name) = self.place(path)?;
            let folder_path = write.join(&name).parent().map(Path::to_owned).unwrap_or_default();
            let rules = self.clone();
            Ok(AtomicFile::create_in(path, folder, folder_path, &last)?
                .with_claim(Box::new(move || rules.claim(&name))))
        };
        begin().map_err(|source| FileError { path: path.to_owned(), source })
    }

    pub(super) fn create_log(&self, path: &Path) -> Result<File, FileError> {
        let begin = || -> io::Result<File> {
            if self.rules.write.is_none() || self.is_granted_output(path) {
                return File::create(path);
            }
            let (folder, last, name) = self.place(path)?;
            self.claim(&name)?;
            // The file is not truncated, because it could have a second name elsewhere.
            match folder.remove_file(&last) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
                _ => (),
            }
            let mut options = OpenOptions::new();
            options.write(true).create_new(true);
            Ok(folder.open_with(&last, &options)?.into_std())
        };
        begin().map_err(|source| FileError { path: path.to_owned(), source })
    }

    pub(super) fn append(&self, path: &Path) -> Result<File, FileError> {
        let begin = || -> io::Result<File> {
            if self.rules.write.is_none() || self.is_granted_output(path) {
                return File::options().append(true).create(true).open(path);
            }
            let (folder, last, name) = self.place(path)?;
            self.claim(&name)?;
            let mut options = OpenOptions::new();
            options.append(true).create(true);
            let file = folder.open_with(&last, &options)?.into_std();
            if file.metadata()?.is_file() { Ok(file) } else { Err(denied("it is not a regular file")) }
        };
        begin().map_err(|source| FileError { path: path.to_owned(), source })
    }

    pub(super) fn scratch_folder(&self, beside: &Path) -> PathBuf {
        match &self.rules.write {
            Some(write) if !self.is_granted_output(beside) => write.clone(),
            _ => beside.parent().unwrap_or(Path::new("")).to_owned(),
        }
    }
}

/// Returns a name without its "./".
fn plain(path: &Path) -> PathBuf {
    path.components().filter(|part| *part != Component::CurDir).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Files;

    struct Place {
        dir: tempfile::TempDir,
    }

    impl Place {
        fn new() -> Self {
            let dir = tempfile::tempdir().unwrap();
            for folder in ["scene", "scene/textures", "library", "secret"] {
                std::fs::create_dir(dir.path().join(folder)).unwrap();
            }
            for file in ["scene/a.tif", "scene/textures/b.tif", "library/c.tif", "secret/d.tif"] {
                std::fs::write(dir.path().join(file), file).unwrap();
            }
            Self { dir }
        }

        fn path(&self, name: &str) -> PathBuf {
            self.dir.path().join(name)
        }

        fn files(&self, scene: &str) -> Files {
            Files::confined(Confinement {
                scene: scene.to_owned(),
                read: vec![self.path("scene"), self.path("library"), self.path("nowhere")],
                write: Some(self.path("scene.out")),
                extensions: vec!["tif".to_owned(), "log".to_owned()],
            })
        }
    }

    fn write(files: &Files, name: &str, text: &str) -> Result<(), String> {
        let mut file = files.create(Path::new(name)).map_err(|e| e.to_string())?;
        file.write_all(text.as_bytes()).unwrap();
        file.commit().map_err(|e| e.to_string())
    }

    #[test]
    fn confined_files_are_read_only_beneath_the_roots() {
        let place = Place::new();
        let files = place.files("s");
        for good in [
            "scene/a.tif",
            "scene/textures/b.tif",
            "library/c.tif",
            "scene/../library/./c.tif",
            "secret/../scene/a.tif",
        ] {
            assert!(files.is_file(&place.path(good)), "{good}");
            assert!(files.open(&place.path(good)).is_ok(), "{good}");
        }
        for bad in ["secret/d.tif", "scene/../secret/d.tif", "scene", "scene/textures", "scene/no.tif"] {
            assert!(!files.is_file(&place.path(bad)), "{bad}");
            assert!(files.open(&place.path(bad)).is_err(), "{bad}");
        }
        for bad in ["/etc/hostname", "/proc/self/environ", "/dev/zero"] {
            assert!(files.open(Path::new(bad)).is_err(), "{bad}");
        }
        files.grant(&place.path("secret/d.tif"));
        assert!(files.create(&place.path("secret/d.tif")).is_err());
        assert_eq!(files.read_to_string(&place.path("secret/d.tif")).unwrap(), "secret/d.tif");
    }

    #[cfg(unix)]
    #[test]
    fn links_out_of_the_roots_and_pipes_are_refused() {
        let place = Place::new();
        let files = place.files("s");
        let link = |from: &str, to: &str| {
            std::os::unix::fs::symlink(place.path(from), place.path(to)).unwrap();
        };
        link("secret/d.tif", "scene/out.tif");
        link("secret", "scene/folder");
        link("library/c.tif", "scene/in.tif");
        assert!(files.open(&place.path("scene/out.tif")).is_err());
        assert!(files.open(&place.path("scene/folder/d.tif")).is_err());
        assert!(files.open(&place.path("scene/in.tif")).is_ok());
        #[cfg(target_os = "linux")]
        {
            use rustix::fs::{CWD, FileType, Mode, mknodat};
            mknodat(CWD, place.path("scene/pipe"), FileType::Fifo, Mode::from_raw_mode(0o600), 0).unwrap();
            assert!(files.open(&place.path("scene/pipe")).is_err());
        }
        // These cases write through links in the folder, or to a link as the folder itself.
        std::fs::create_dir(place.path("scene.out")).unwrap();
        link("secret", "scene.out/sub");
        link("secret/d.tif", "scene.out/d.tif");
        link("secret/new.tif", "scene.out/new.tif");
        for name in ["sub/x.tif", "d.tif", "new.tif"] {
            assert!(write(&files, name, "x").unwrap_err().contains("link"), "{name}");
        }
        std::fs::remove_dir_all(place.path("scene.out")).unwrap();
        link("secret", "scene.out");
        assert!(write(&place.files("s"), "x.tif", "x").unwrap_err().contains("is a link"));
        assert_eq!(std::fs::read_dir(place.path("secret")).unwrap().count(), 1);
    }

    #[test]
    fn confined_files_are_written_beneath_one_folder_only() {
        let place = Place::new();
        let files = place.files("s");
        for bad in [
            "../x.tif",
            "a/../../x.tif",
            "/x.tif",
            ".x.tif",
            ".config/x.tif",
            "x",
            "x.sh",
            "x.pyg",
            "x.tif.py",
            "a\nb.tif",
            "",
            "..",
        ] {
            assert!(write(&files, bad, "x").is_err(), "{bad:?}");
            assert!(files.create_log(Path::new(bad)).is_err(), "{bad:?}");
        }
        assert_eq!(files.written(Path::new("x.tif")), None);
        write(&files, "x.tif", "one").unwrap();
        write(&files, "./deep/er/x.tif", "two").unwrap();
        write(&files, "x.tif", "three").unwrap();
        assert_eq!(std::fs::read_to_string(place.path("scene.out/x.tif")).unwrap(), "three");
        assert_eq!(std::fs::read_to_string(place.path("scene.out/deep/er/x.tif")).unwrap(), "two");
        // The file is found by the name under which it was written, before any other file of that name.
        assert_eq!(files.written(Path::new("x.tif")), Some(place.path("scene.out/x.tif")));
        assert_eq!(files.read_to_string(Path::new("./x.tif")).unwrap(), "three");
        assert!(files.is_file(&place.path("scene.out/x.tif")));
        // The next run of the same scene replaces it. Another scene does not, and no scene replaces a file that a
        // user put there.
        write(&place.files("s"), "x.tif", "four").unwrap();
        assert!(
            write(&place.files("other"), "x.tif", "five")
                .unwrap_err()
                .contains("not made by a run of this scene")
        );
        std::fs::write(place.path("scene.out/mine.tif"), "mine").unwrap();
        assert!(write(&place.files("s"), "mine.tif", "x").is_err());
        assert!(place.files("s").create_log(Path::new("mine.tif")).is_err());
        assert_eq!(std::fs::read_to_string(place.path("scene.out/mine.tif")).unwrap(), "mine");
        files.create_log(Path::new("run.log")).unwrap().write_all(b"log").unwrap();
        place.files("s").create_log(Path::new("run.log")).unwrap();
    }

    #[test]
    fn checking_a_path_creates_no_file() {
        let place = Place::new();
        let files = place.files("s");
        files.check_create(Path::new("x.tif")).unwrap();
        assert!(files.check_create(Path::new("../x.tif")).is_err());
        assert!(!place.path("scene.out/x.tif").exists());
    }
}
