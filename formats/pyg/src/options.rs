//! The options for reading a scene.

use crate::python::Python;
use granita_base::{Environment, Files, Supervisor};
use parking_lot::{Mutex, MutexGuard};
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;

/// The amount of Python that is executed at once (reference 3.6).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Chunking {
    /// Statement by statement. Flat statements between them are read without Python.
    #[default]
    Auto,
    /// The same as [`Chunking::Auto`]. It is the value for "PYG_ALWAYS_CHUNK".
    Always,
    /// From the first statement that is not flat, the rest of the file is executed at once.
    Never,
}

/// The options for reading.
#[derive(Clone, Debug)]
pub struct PygOptions {
    /// True when everything must be flat, so that Python is never started (`PYG_ALWAYS_PYGLET`).
    pub always_pyglet: bool,
    /// True when everything is passed to Python (`PYG_NEVER_PYGLET`).
    pub never_pyglet: bool,
    /// The amount of Python that is executed at once.
    pub chunking: Chunking,
    /// The interpreter; `None` for `python3` on the process's path.
    pub python: Option<PathBuf>,
    /// The environment variables for scripts, in addition to those of this process.
    pub environment: Environment,
    /// True when scripts are refused, for untrusted scenes.
    pub safe: bool,
    /// The opener of files.
    pub files: Files,
    /// The supervisor of the interpreter while it runs.
    pub supervisor: Supervisor,
    /// The largest number of bytes of one statement.
    pub statement_limit: usize,
    /// The interpreter that several scenes share. Scripts that are read with the same value share their definitions.
    pub scripts: Option<Scripts>,
    /// Receives the names of the files that scripts open.
    pub opened: OpenedFiles,
}

impl Default for PygOptions {
    fn default() -> Self {
        Self {
            always_pyglet: false,
            never_pyglet: false,
            chunking: Chunking::Auto,
            python: None,
            environment: Environment::empty(),
            safe: false,
            files: Files::default(),
            supervisor: Supervisor::default(),
            statement_limit: 1 << 32,
            scripts: None,
            opened: OpenedFiles::default(),
        }
    }
}

/// The files that scripts opened for reading by themselves, and the modules that they imported. Those of the
/// interpreter's own folders are left out. Clones share the list.
#[derive(Clone, Debug, Default)]
pub struct OpenedFiles(Arc<Mutex<BTreeSet<PathBuf>>>);

impl OpenedFiles {
    pub(crate) fn add(&self, file: &str) {
        self.0.lock().insert(file.into());
    }

    /// Returns the files so far, by name.
    pub fn list(&self) -> Vec<PathBuf> {
        self.0.lock().iter().cloned().collect()
    }
}

/// The interpreter of several scenes that count as one, such as those of a command line (reference 6.1). Only one scene
/// at a time uses it. Clones share it.
#[derive(Clone, Default)]
pub struct Scripts(Arc<Mutex<Option<Python>>>);

impl std::fmt::Debug for Scripts {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Scripts")
    }
}

impl Scripts {
    pub(crate) fn python(&self) -> MutexGuard<'_, Option<Python>> {
        self.0.lock()
    }
}
