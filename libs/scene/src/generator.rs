//! Generators, which make scene calls from a file, the output of a program or a string (reference 2.9, 12).

use crate::{SceneSink, Stop};
use granita_base::{Files, Reporter};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The source of a generator.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum GeneratorSource {
    /// A file. For a generator that is called by its name, it is the argument after the name.
    File {
        /// The path of the file.
        path: PathBuf,
        /// Opens the file and the files that it names.
        files: Files,
    },
    /// Bytes with a name for messages: the output of a program, `name << text`, or a bundled file.
    Bytes {
        /// The name of the bytes in messages.
        name: String,
        /// The whole contents.
        bytes: Arc<[u8]>,
        /// Opens the files that the bytes name.
        files: Files,
    },
}

impl GeneratorSource {
    /// Returns a file that the process may open.
    pub fn file(path: impl Into<PathBuf>) -> Self {
        Self::File { path: path.into(), files: Files::default() }
    }

    /// Returns bytes with a name for messages.
    pub fn bytes(name: impl Into<String>, bytes: impl Into<Arc<[u8]>>) -> Self {
        Self::Bytes { name: name.into(), bytes: bytes.into(), files: Files::default() }
    }

    /// Returns the same source, opened by `files`, which also opens the files that it names.
    pub fn with_files(mut self, by: &Files) -> Self {
        let (Self::File { files, .. } | Self::Bytes { files, .. }) = &mut self;
        *files = by.clone();
        self
    }

    /// Returns the opener of the source and of the files that it names.
    pub fn files(&self) -> &Files {
        let (Self::File { files, .. } | Self::Bytes { files, .. }) = self;
        files
    }

    /// Returns the name of the source in messages.
    pub fn name(&self) -> String {
        match self {
            Self::File { path, .. } => path.display().to_string(),
            Self::Bytes { name, .. } => name.clone(),
        }
    }

    /// Returns the folder in which relative names inside of the file start; `None` for bytes.
    pub fn folder(&self) -> Option<&Path> {
        match self {
            Self::File { path, .. } => path.parent(),
            Self::Bytes { .. } => None,
        }
    }
}

/// The reason why a generator ended early. Errors after which it can continue are reported with their location
/// instead.
#[derive(Debug, thiserror::Error)]
pub enum GeneratorError {
    /// The source cannot be read.
    #[error("{name}: {source}")]
    Io {
        /// The source.
        name: String,
        /// The system's error.
        source: std::io::Error,
    },
    /// The source is malformed. The text begins with the name, and the line if there is one.
    #[error("{0}")]
    Malformed(String),
    /// The source uses a feature that the generator does not support.
    #[error("{0}")]
    Unsupported(String),
    /// The receiver accepts no more calls.
    #[error(transparent)]
    Stopped(#[from] Stop),
}

/// A generator for one kind of source. Implementations are streams. Their memory does not grow with the file, except
/// for the data of a single call.
pub trait Generator: Send + Sync {
    /// Returns its name in `Input ("name argument")`, in lower case.
    fn name(&self) -> &'static str;

    /// Returns the extensions of its files, in lower case and without the first dot: "obj", "rib.gz".
    fn extensions(&self) -> &'static [&'static str];

    /// True when its sources are whole scenes, with a camera, `World` and `Render`, instead of objects for a scene.
    fn makes_frames(&self) -> bool {
        false
    }

    /// Returns the bound of everything in `source`, in the space of the `Input` call: xmin, xmax, ymin, ymax, zmin,
    /// zmax. `None` when it cannot be determined without reading everything.
    fn bound(&self, source: &GeneratorSource) -> Option<[f32; 6]> {
        let _ = source;
        None
    }

    /// Makes the calls of `source`. Calls have the location in the source from which they come.
    ///
    /// # Errors
    /// See [`GeneratorError`].
    fn run(
        &self,
        source: &GeneratorSource,
        sink: &mut dyn SceneSink,
        reporter: &Reporter,
    ) -> Result<(), GeneratorError>;
}

/// The generators of a session.
#[derive(Clone, Default)]
pub struct GeneratorRegistry {
    all: Vec<Arc<dyn Generator>>,
}

impl std::fmt::Debug for GeneratorRegistry {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.all.iter().map(|g| g.name())).finish()
    }
}

impl GeneratorRegistry {
    /// Adds a generator. Of two with the same name or extension the later one is used.
    pub fn add(&mut self, generator: Arc<dyn Generator>) {
        self.all.push(generator);
    }

    /// Returns the generator called `name`.
    pub fn by_name(&self, name: &str) -> Option<&Arc<dyn Generator>> {
        self.all.iter().rev().find(|g| g.name() == name)
    }

    /// Returns the generator for the extension of `path`, ignoring case.
    pub fn by_extension(&self, path: &Path) -> Option<&Arc<dyn Generator>> {
        let name = path.file_name()?.to_str()?.to_ascii_lowercase();
        let ends = |extension: &&str| name.strip_suffix(extension).is_some_and(|stem| stem.ends_with('.'));
        self.all.iter().rev().find(|g| g.extensions().iter().any(ends))
    }

    /// Returns all generators, in the order in which they were added.
    pub fn iter(&self) -> impl Iterator<Item = &Arc<dyn Generator>> {
        self.all.iter()
    }
}
