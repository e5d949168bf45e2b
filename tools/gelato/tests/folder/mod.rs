//! A folder in which tests run the tool.

#![allow(dead_code, reason = "each file of tests uses a part of it")]

use serde_json::Value;
use std::path::Path;
use std::process::{Command, Stdio};
use tempfile::TempDir;

/// A folder, which is removed in the end.
pub(crate) struct Folder(TempDir);

/// The exit status and the messages of a run.
pub(crate) struct Ran {
    pub(crate) status: i32,
    pub(crate) said: String,
}

impl Folder {
    /// Makes a folder with these files in it.
    pub(crate) fn with(files: &[(&str, &str)]) -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        files.iter().for_each(|(name, text)| folder.write(name, text));
        folder
    }

    pub(crate) fn path(&self) -> &Path {
        self.0.path()
    }

    pub(crate) fn write(&self, name: &str, bytes: &(impl AsRef<[u8]> + ?Sized)) {
        std::fs::write(self.path().join(name), bytes).unwrap();
    }

    pub(crate) fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.path().join(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    pub(crate) fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path().join(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    pub(crate) fn has(&self, name: &str) -> bool {
        self.path().join(name).exists()
    }

    /// Returns the names of the files, sorted.
    pub(crate) fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.path()).unwrap();
        let mut names: Vec<String> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    /// True when no temporary files are left.
    pub(crate) fn is_clean(&self) -> bool {
        self.names().iter().all(|name| !name.starts_with('.'))
    }

    /// Returns a file of JSON.
    pub(crate) fn json(&self, name: &str) -> Value {
        serde_json::from_str(&self.read(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    /// Returns a command of the tool, without the settings of the user.
    pub(crate) fn command(&self, words: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_gelato"));
        command.current_dir(self.path()).args(words).stdin(Stdio::null()).env("HOME", self.path());
        for variable in ["GELATOHOME", "GELATOTEMP", "PYG_ALWAYS_PYGLET", "PYG_NEVER_PYGLET"] {
            command.env_remove(variable);
        }
        command
    }

    pub(crate) fn run(&self, words: &[&str]) -> Ran {
        Self::ran(self.command(words))
    }

    pub(crate) fn ran(mut command: Command) -> Ran {
        let output = command.output().unwrap();
        let said = String::from_utf8([output.stdout, output.stderr].concat()).unwrap();
        Ran { status: output.status.code().unwrap(), said }
    }
}
