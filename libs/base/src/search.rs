//! Search paths: colon-separated folders, with `&` for the previous path and variables (reference 4.3.6). The
//! environment is passed as a value. The process's own environment is not read here.

use crate::Files;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// The environment of a run: variables that search paths and scenes may name, and [`Files`]. Tools fill it from the
/// process's environment.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Environment {
    variables: BTreeMap<String, String>,
    files: Files,
}

impl Environment {
    /// Returns an environment without variables.
    pub fn empty() -> Self {
        Self::default()
    }

    /// Sets the opener of files.
    pub fn set_files(&mut self, files: Files) {
        self.files = files;
    }

    /// Returns the opener of the files of the run.
    pub fn files(&self) -> &Files {
        &self.files
    }

    /// Sets one variable.
    pub fn set(&mut self, name: impl Into<String>, value: impl Into<String>) {
        self.variables.insert(name.into(), value.into());
    }

    /// Returns the value of a variable.
    pub fn get(&self, name: &str) -> Option<&str> {
        self.variables.get(name).map(String::as_str)
    }

    /// Returns all variables, in order of their names.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &str)> {
        self.variables.iter().map(|(name, value)| (name.as_str(), value.as_str()))
    }

    /// Replaces `$VAR`, `${VAR}`, `$(VAR)` and `%VAR%`. References to variables that are not set are not changed.
    pub fn expand(&self, text: &str) -> String {
        let mut out = String::with_capacity(text.len());
        let mut rest = text;
        while let Some(at) = rest.find(['$', '%']) {
            out.push_str(&rest[..at]);
            rest = &rest[at..];
            let (name, length) = match Self::variable(rest) {
                Some(found) => found,
                None => {
                    out.push_str(&rest[..1]);
                    rest = &rest[1..];
                    continue;
                }
            };
            out.push_str(self.get(name).unwrap_or(&rest[..length]));
            rest = &rest[length..];
        }
        out.push_str(rest);
        out
    }

    /// Returns the name of the variable reference that `text` begins with, and the length of the reference.
    fn variable(text: &str) -> Option<(&str, usize)> {
        let closed = |open: usize, close: char| {
            let end = text[open..].find(close)? + open;
            let name = &text[open..end];
            let word = !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
            word.then_some((name, end + 1))
        };
        match text.as_bytes() {
            [b'%', ..] => closed(1, '%'),
            [b'$', b'{', ..] => closed(2, '}'),
            [b'$', b'(', ..] => closed(2, ')'),
            [b'$', rest @ ..] => {
                let n = rest.iter().take_while(|c| c.is_ascii_alphanumeric() || **c == b'_').count();
                (n > 0).then(|| (&text[1..=n], n + 1))
            }
            _ => None,
        }
    }
}

impl FromIterator<(String, String)> for Environment {
    fn from_iter<T: IntoIterator<Item = (String, String)>>(iter: T) -> Self {
        Self { variables: iter.into_iter().collect(), files: Files::default() }
    }
}

/// Collects the variables of the system. Those that are not text are left out.
impl FromIterator<(OsString, OsString)> for Environment {
    fn from_iter<T: IntoIterator<Item = (OsString, OsString)>>(iter: T) -> Self {
        iter.into_iter().filter_map(|(k, v)| Some((k.into_string().ok()?, v.into_string().ok()?))).collect()
    }
}

/// A list of folders to search, in order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SearchPath {
    folders: Vec<PathBuf>,
    files: Files,
}

impl SearchPath {
    /// Parses a colon-separated list. `&` stands for `previous`, variables are replaced, and empty entries are
    /// skipped. A folder that is named twice has its first place.
    pub fn parse(text: &str, previous: &Self, environment: &Environment) -> Self {
        let mut folders: Vec<PathBuf> = Vec::new();
        let mut add = |folder: &Path| {
            if !folders.iter().any(|f| f == folder) {
                folders.push(folder.to_owned());
            }
        };
        for part in environment.expand(text).split(':').filter(|p| !p.is_empty()) {
            if part == "&" {
                previous.folders.iter().for_each(|f| add(f));
            } else {
                add(Path::new(part));
            }
        }
        Self { folders, files: environment.files.clone() }
    }

    /// Returns the folders in order.
    pub fn folders(&self) -> &[PathBuf] {
        &self.folders
    }

    /// Returns the opener of the files of the run.
    pub fn files(&self) -> &Files {
        &self.files
    }

    /// Returns the first path at which `name` is a readable file, or else the first path at which it is a file that
    /// may not be read, so that opening it reports the reason. Absolute names, and names that begin with `./` or
    /// `../`, are not searched for. The current folder is searched only when it is on the path. Files that the run
    /// itself wrote under this name elsewhere ([`Files::written`]) come first.
    pub fn find(&self, name: &str) -> Option<PathBuf> {
        let path = Path::new(name);
        if let Some(written) = self.files.written(path) {
            return Some(written);
        }
        if path.is_absolute() || name.starts_with("./") || name.starts_with("../") {
            return self.files.place(path).is_file().then(|| path.to_owned());
        }
        let places = || self.folders.iter().map(|f| f.join(path));
        let found = places()
            .find(|p| self.files.is_file(p))
            .or_else(|| places().find(|p| self.files.place(p).is_file()));
        found.map(|p| match p.strip_prefix(".") {
            Ok(plain) => plain.to_owned(),
            Err(_) => p,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn environment_variables_are_expanded() {
        let mut env = Environment::empty();
        env.set("HOME", "/h");
        env.set("A_1", "x");
        assert_eq!(env.expand("$HOME/lib:${A_1}y:$(HOME):%A_1%:$NO/a:%"), "/h/lib:xy:/h:x:$NO/a:%");
        assert_eq!(env.expand("100%:$:${:$()"), "100%:$:${:$()");
    }

    #[test]
    fn search_paths_insert_the_previous_path() {
        let env = Environment::empty();
        let old = SearchPath::parse(".:/a", &SearchPath::default(), &env);
        let new = SearchPath::parse("/b::&:/a", &old, &env);
        assert_eq!(new.folders(), [Path::new("/b"), Path::new("."), Path::new("/a")]);
    }

    #[test]
    fn files_are_found_along_the_search_path() {
        let here = SearchPath::parse("/nowhere:.", &SearchPath::default(), &Environment::empty());
        assert_eq!(here.find("Cargo.toml"), Some(PathBuf::from("Cargo.toml")));
        assert_eq!(here.find("no such file"), None);
        assert!(SearchPath::default().find("./Cargo.toml").is_some());
    }
}
