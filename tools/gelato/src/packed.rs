//! The list of a folder that `-pack` made, and runs in such a folder.

use granita_base::{Environment, MovedFolders};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

/// The name of the list in the folder.
pub(crate) const LIST: &str = "gelato.pack.json";

/// The version of the list.
const VERSION: u32 = 1;

/// What a packed folder holds. Its names are relative to the folder, with "/" between their parts.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PackList {
    /// The version of the list.
    pub(crate) pack: u32,
    /// The version of the program that made it.
    pub(crate) granita: String,
    /// The folder in which the scene was packed.
    pub(crate) folder: PathBuf,
    /// The scene files.
    pub(crate) scene: Vec<String>,
    /// The folders whose files are elsewhere, and their places.
    pub(crate) moved: BTreeMap<PathBuf, String>,
    /// The files that are read before scenes, instead of those of the user.
    pub(crate) startup: Vec<String>,
    /// The plugins and folders of plugins that the packing user named (`-plugins`), by those names.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) plugins: Vec<PathBuf>,
    /// The variables that the scene uses, and their values.
    pub(crate) variables: BTreeMap<String, String>,
    /// The files.
    pub(crate) files: Vec<PackedFile>,
    /// The images that the scene writes, by the names of the scene.
    pub(crate) outputs: Vec<String>,
    /// The commands that the scene runs.
    pub(crate) commands: Vec<String>,
    /// Names of textures, maps and databases that were of no file.
    pub(crate) missing: Vec<String>,
}

/// A packed file.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PackedFile {
    pub(crate) name: String,
    /// The file that it is a copy of.
    pub(crate) from: PathBuf,
    pub(crate) kind: String,
    pub(crate) bytes: u64,
    pub(crate) sha1: String,
}

impl PackList {
    /// Returns a list without files.
    pub(crate) fn new(folder: PathBuf) -> Self {
        Self {
            pack: VERSION,
            granita: env!("CARGO_PKG_VERSION").to_owned(),
            folder,
            scene: Vec::new(),
            moved: BTreeMap::new(),
            startup: Vec::new(),
            plugins: Vec::new(),
            variables: BTreeMap::new(),
            files: Vec::new(),
            outputs: Vec::new(),
            commands: Vec::new(),
            missing: Vec::new(),
        }
    }

    /// Reads the list of the folder `here`; `None` where it is not a packed one.
    ///
    /// # Errors
    /// Returns a message that names the list, when it is wrong.
    pub(crate) fn read(here: &Path) -> Result<Option<Self>, String> {
        let file = here.join(LIST);
        let text = match std::fs::read_to_string(&file) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(format!("{}: {error}", file.display())),
        };
        let list = Self::parse(&text).map_err(|what| format!("{}: {what}", file.display()))?;
        Ok(Some(list))
    }

    fn parse(text: &str) -> Result<Self, String> {
        let list: Self = serde_json::from_str(text).map_err(|error| error.to_string())?;
        if list.pack != VERSION {
            return Err(format!("\"pack\" is {}; this version reads {VERSION}", list.pack));
        }
        let is_inside =
            |name: &&String| Path::new(name).components().all(|p| matches!(p, Component::Normal(_)));
        match list.moved.values().chain(&list.startup).find(|name| !is_inside(name)) {
            Some(name) => Err(format!("\"{name}\" is not a name inside of the folder")),
            None => Ok(list),
        }
    }

    /// Makes a run in the folder `here` use its files and variables. Returns the files that are read before scenes.
    pub(crate) fn enter(&self, here: &Path, variables: &mut Environment) -> Vec<PathBuf> {
        for (name, value) in &self.variables {
            variables.set(name, value);
        }
        let folders =
            self.moved.iter().map(|(folder, place)| (folder.clone(), PathBuf::from(place))).collect();
        let moved = MovedFolders::new(&self.folder, here, folders);
        let files = variables.files().clone().with_moved(Arc::new(moved));
        variables.set_files(files);
        self.startup.iter().map(PathBuf::from).collect()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

    use super::*;

    #[test]
    fn lists_that_lead_outside_of_their_folder_are_refused() {
        let mut list = PackList::new(PathBuf::from("/shot"));
        list.moved.insert(PathBuf::from("/tex"), "files/tex".to_owned());
        list.moved.insert(PathBuf::from("/shot"), String::new());
        let text = serde_json::to_string(&list).unwrap();
        assert!(PackList::parse(&text).is_ok());
        for (from, to, part) in [
            ("files/tex", "../tex", "\"../tex\" is not a name inside"),
            ("files/tex", "/tex", "\"/tex\" is not a name inside"),
            ("\"pack\":1", "\"pack\":9", "\"pack\" is 9"),
            ("\"pack\"", "\"sack\"", "unknown field `sack`"),
            ("{", "", "line 1"),
        ] {
            let error = PackList::parse(&text.replacen(from, to, 1)).unwrap_err();
            assert!(error.contains(part), "{error}");
        }
    }
}
