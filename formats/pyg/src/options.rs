//! Options for reading a scene.

use crate::python::Python;
use granita_base::{Environment, Files, Supervisor};
use parking_lot::{Mutex, MutexGuard};
use std::path::PathBuf;
use std::sync::Arc;

/// The amount of Python that is executed at once (reference 3.6).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Chunking {
    /// Statement by statement; flat statements between them without Python.
    #[default]
    Auto,
    /// The same as [`Chunking::Auto`]: the value for "PYG_ALWAYS_CHUNK".
    Always,
    /// From the first statement that is not flat, the rest of the file is executed at once.
    Never,
}

/// The options for reading.
#[derive(Clone, Debug)]
pub struct PygOptions {
    /// Everything is flat: never start Python (`PYG_ALWAYS_PYGLET`).
    pub always_pyglet: bool,
    /// Nothing is flat: give everything to Python (`PYG_NEVER_PYGLET`).
    pub never_pyglet: bool,
    /// The amount of Python that is executed at once.
    pub chunking: Chunking,
    /// The interpreter; `python3` on the process's path when `None`.
    pub python: Option<PathBuf>,
    /// Variables of the environment for scripts, beside those of this process.
    pub environment: Environment,
    /// Refuse scripts: for scenes from strangers.
    pub safe: bool,
    /// Opens files.
    pub files: Files,
    /// Knows the interpreter as long as it runs.
    pub supervisor: Supervisor,
    /// Most bytes of one statement.
    pub statement_limit: usize,
    /// Scripts that are read with the same value share their definitions.
    pub scripts: Option<Scripts>,
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
        }
    }
}

/// The interpreter of several scenes that count as one, as those of a command line do (reference 6.1). One at a time
/// has it; clones share it.
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
