//! Folders whose files are at another place than their names say.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

/// Folders whose files were copied elsewhere, such as those of a packed scene.
///
/// A file directly in one of the folders is at the new place, whether it exists there or not. Folders beneath a moved
/// folder are not moved with it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MovedFolders {
    origin: PathBuf,
    here: PathBuf,
    folders: BTreeMap<PathBuf, PathBuf>,
}

impl MovedFolders {
    /// Returns the folders. `origin` is the absolute folder that relative names with ".." were relative to, and `here`
    /// is the absolute folder that they are relative to now. `folders` maps absolute folders, without "." and "..", to
    /// their new places, which are relative to `here`; an empty one is `here` itself.
    pub fn new(origin: &Path, here: &Path, folders: BTreeMap<PathBuf, PathBuf>) -> Self {
        Self { origin: without_dots(origin), here: without_dots(here), folders }
    }

    /// Returns the place of a file or of a folder. Relative names without ".." are not changed, and neither are
    /// absolute names beneath the current folder.
    pub fn place<'a>(&self, path: &'a Path) -> Cow<'a, Path> {
        let is_parent = |part| matches!(part, Component::ParentDir);
        if path.is_relative() && !path.components().any(is_parent) {
            return Cow::Borrowed(path);
        }
        let whole = without_dots(&self.origin.join(path));
        if path.is_absolute() && whole.starts_with(&self.here) {
            return Cow::Borrowed(path);
        }
        if let Some(place) = self.folders.get(&whole) {
            return Cow::Owned(if place.as_os_str().is_empty() { PathBuf::from(".") } else { place.clone() });
        }
        let moved = whole.parent().and_then(|folder| self.folders.get(folder)).zip(whole.file_name());
        moved.map_or(Cow::Borrowed(path), |(folder, name)| Cow::Owned(folder.join(name)))
    }
}

/// Returns an absolute path without "." and "..". Links are not followed.
pub fn without_dots(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for part in path.components() {
        match part {
            Component::CurDir => (),
            // The parent of the root is the root.
            Component::ParentDir => {
                plain.pop();
            }
            part => plain.push(part),
        }
    }
    plain
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(unix)]
    fn files_of_moved_folders_are_at_their_new_place() {
        let pairs = [("/show/tex", "files/show/tex"), ("/show/shot", ""), ("/", "files")];
        let folders = pairs.map(|(from, to)| (PathBuf::from(from), PathBuf::from(to))).into();
        let moved = MovedFolders::new(Path::new("/show/shot"), Path::new("/show/shot/packed"), folders);
        for (name, place) in [
            ("a.tx", "a.tx"),
            ("./b/a.tx", "./b/a.tx"),
            ("/show/tex/a.tx", "files/show/tex/a.tx"),
            ("/show/./x/../tex//a.tx", "files/show/tex/a.tx"),
            ("../tex/a.tx", "files/show/tex/a.tx"),
            ("b/../../tex", "files/show/tex"),
            ("/show/tex/deep/a.tx", "/show/tex/deep/a.tx"),
            ("/show/shot/a.pyg", "a.pyg"),
            ("/show/shot", "."),
            ("b/../a.pyg", "a.pyg"),
            ("/show/shot/packed/a.pyg", "/show/shot/packed/a.pyg"),
            ("/a", "files/a"),
            ("/dev/null", "/dev/null"),
            ("../../other/a", "../../other/a"),
        ] {
            assert_eq!(moved.place(Path::new(name)), Path::new(place), "{name}");
        }
        assert_eq!(without_dots(Path::new("/../a/./b/..")), Path::new("/a"));
    }
}
