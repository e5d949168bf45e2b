//! The rules for loading shared libraries, and their precedence over bundled parts.

use granita_base::Files;
use std::path::{Path, PathBuf};

/// The rules for loading plugins.
///
/// A library runs its own code as soon as it is loaded. A library in the folder where the program was started is
/// therefore not loaded for that reason alone. Of search paths, only absolute folders count. Reference 2.4, 12 and
/// 13 also search the current folder.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PluginRules {
    /// True to load no plugin at all, for untrusted scenes.
    pub none: bool,
    /// Folders and libraries that the user named (`-plugins`). They have precedence, relative ones count, and a
    /// library that is named itself has precedence over the bundled part of its name.
    pub named: Vec<PathBuf>,
    /// True when relative folders of search paths may contain generators and shader functions that a scene names.
    /// It is for programs in which a scene runs scripts in any case.
    pub current_folder: bool,
    /// Says where libraries of moved folders are ([`Files::place`]).
    pub files: Files,
}

impl PluginRules {
    /// Returns the library that the user named whose file name `wanted` accepts.
    pub(crate) fn libraries(&self, wanted: impl Fn(&str) -> bool) -> Option<PathBuf> {
        let is_wanted = |path: &&PathBuf| {
            self.is_file(path) && path.file_name().and_then(|name| name.to_str()).is_some_and(&wanted)
        };
        self.named.iter().find(is_wanted).cloned()
    }

    /// True when there is such a library.
    pub(crate) fn is_file(&self, path: &Path) -> bool {
        self.files.place(path).is_file()
    }

    /// Returns the entries of a folder by their names there, or nothing when it cannot be read.
    pub(crate) fn entries(&self, folder: &Path) -> Option<Vec<PathBuf>> {
        let entries = std::fs::read_dir(self.files.place(folder)).ok()?;
        Some(entries.filter_map(|entry| Some(folder.join(entry.ok()?.file_name()))).collect())
    }

    /// Returns the folders to search, in order: those that the user named, then those of a search path. The flag is
    /// false for a folder that is skipped.
    pub(crate) fn folders<'a>(
        &'a self,
        path: &'a [PathBuf],
        scene_names_it: bool,
    ) -> impl Iterator<Item = (&'a Path, bool)> {
        let relative = scene_names_it && self.current_folder;
        let is_folder = |path: &&PathBuf| self.files.place(path).is_dir();
        let named = self.named.iter().filter(is_folder).map(|path| (path.as_path(), true));
        named.chain(path.iter().map(move |folder| (folder.as_path(), relative || folder.is_absolute())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn relative_folders_are_searched_when_the_rules_allow_it() {
        let path = [PathBuf::from("."), PathBuf::from("/lib")];
        let looked = |rules: &PluginRules, named: bool| -> Vec<bool> {
            rules.folders(&path, named).map(|(_, yes)| yes).collect()
        };
        let strict = PluginRules::default();
        assert_eq!(looked(&strict, true), [false, true]);
        let scene = PluginRules { current_folder: true, ..PluginRules::default() };
        assert_eq!(looked(&scene, false), [false, true]);
        assert_eq!(looked(&scene, true), [true, true]);
        let asked =
            PluginRules { named: vec![".".into(), "no such folder".into()], ..PluginRules::default() };
        assert_eq!(looked(&asked, false), [true, false, true]);
        assert_eq!(asked.folders(&path, false).next(), Some((Path::new("."), true)));
    }
}
