//! Which shared libraries may be loaded, and which come before what is bundled.

use std::path::{Path, PathBuf};

/// What may be loaded as a plugin.
///
/// A library runs its own code as soon as it is loaded, so none is taken from a folder just because the program was
/// started there: of search paths, absolute folders count. Reference 2.4, 12 and 13 look into the current folder as well.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PluginRules {
    /// No plugin at all: for scenes from strangers.
    pub none: bool,
    /// Folders and libraries that the user named (`-plugins`): they come first, relative ones count, and a library that is named
    /// itself comes before what is bundled under its name.
    pub named: Vec<PathBuf>,
    /// Relative folders of search paths may hold generators and shader functions that a scene names: for programs in which
    /// a scene runs scripts anyway.
    pub current_folder: bool,
}

impl PluginRules {
    /// Libraries that the user named, by the file names that `wanted` accepts.
    pub(crate) fn libraries(&self, wanted: impl Fn(&str) -> bool) -> Option<PathBuf> {
        let is_wanted = |path: &&PathBuf| {
            path.is_file() && path.file_name().and_then(|name| name.to_str()).is_some_and(&wanted)
        };
        self.named.iter().find(is_wanted).cloned()
    }

    /// Folders to look into, in order: those that the user named, then those of a search path. The flag is false for a folder
    /// that is passed over.
    pub(crate) fn folders<'a>(
        &'a self,
        path: &'a [PathBuf],
        scene_names_it: bool,
    ) -> impl Iterator<Item = (&'a Path, bool)> {
        let relative = scene_names_it && self.current_folder;
        let named = self.named.iter().filter(|path| path.is_dir()).map(|path| (path.as_path(), true));
        named.chain(path.iter().map(move |folder| (folder.as_path(), relative || folder.is_absolute())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn relative_folders_count_when_they_are_asked_for() {
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
