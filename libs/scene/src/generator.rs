//! Generators: whatever makes scene calls out of a file, a program's output or a string (reference 2.9, 12).

use crate::{SceneSink, Stop};
use granita_base::{Files, Reporter};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What a generator reads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum GeneratorSource {
    /// A file; for a generator called by its name, whatever follows the name.
    File {
        /// Its name.
        path: PathBuf,
        /// Opens it, and what it names.
        files: Files,
    },
    /// Bytes with a name for messages: a program's output, `name << text`, a bundled file.
    Bytes {
        /// Stands for the bytes in messages.
        name: String,
        /// The whole contents.
        bytes: Arc<[u8]>,
        /// Opens what they name.
        files: Files,
    },
}

impl GeneratorSource {
    /// A file that the process may open.
    pub fn file(path: impl Into<PathBuf>) -> Self {
        Self::File { path: path.into(), files: Files::default() }
    }

    /// Bytes under a name for messages.
    pub fn bytes(name: impl Into<String>, bytes: impl Into<Arc<[u8]>>) -> Self {
        Self::Bytes { name: name.into(), bytes: bytes.into(), files: Files::default() }
    }

    /// The same, opened by `files`, as is what it names.
    pub fn with_files(mut self, by: &Files) -> Self {
        let (Self::File { files, .. } | Self::Bytes { files, .. }) = &mut self;
        *files = by.clone();
        self
    }

    /// What opens it, and what it names.
    pub fn files(&self) -> &Files {
        let (Self::File { files, .. } | Self::Bytes { files, .. }) = self;
        files
    }

    /// What messages call it.
    pub fn name(&self) -> String {
        match self {
            Self::File { path, .. } => path.display().to_string(),
            Self::Bytes { name, .. } => name.clone(),
        }
    }

    /// The folder that relative names inside of the file start from; `None` for bytes.
    pub fn folder(&self) -> Option<&Path> {
        match self {
            Self::File { path, .. } => path.parent(),
            Self::Bytes { .. } => None,
        }
    }
}

/// Why a generator gave up. Mistakes that it can go on after are reported instead, with their place.
#[derive(Debug, thiserror::Error)]
pub enum GeneratorError {
    /// The source cannot be read.
    #[error("{name}: {source}")]
    Io {
        /// What was read.
        name: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// The source is not what it claims to be; begins with the name, and the line where there is one.
    #[error("{0}")]
    Malformed(String),
    /// The source uses something that the generator does not know.
    #[error("{0}")]
    Unsupported(String),
    /// The receiver of the calls wants no more.
    #[error(transparent)]
    Stopped(#[from] Stop),
}

/// One kind of source. Implementations are streams: what they hold does not grow with the file, except for what one
/// call must carry whole.
pub trait Generator: Send + Sync {
    /// Its name in `Input ("name argument")`; in lower case.
    fn name(&self) -> &'static str;

    /// The endings, in lower case and without the first dot, of the files that belong to it: "obj", "rib.gz".
    fn extensions(&self) -> &'static [&'static str];

    /// Whether its sources are whole scenes, with a camera, `World` and `Render`, rather than objects for a scene.
    fn makes_frames(&self) -> bool {
        false
    }

    /// Where everything lies that `source` describes, in the space of the `Input` call: xmin, xmax, ymin, ymax, zmin,
    /// zmax; `None` when that is not known without reading it all.
    fn bound(&self, source: &GeneratorSource) -> Option<[f32; 6]> {
        let _ = source;
        None
    }

    /// Makes the calls that `source` stands for. Calls carry the place in the source that they come from.
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
    /// Adds one; a later one of the same name or ending wins.
    pub fn add(&mut self, generator: Arc<dyn Generator>) {
        self.all.push(generator);
    }

    /// The generator called `name`.
    pub fn by_name(&self, name: &str) -> Option<&Arc<dyn Generator>> {
        self.all.iter().rev().find(|g| g.name() == name)
    }

    /// The generator that the ending of `path` belongs to, whatever its case.
    pub fn by_extension(&self, path: &Path) -> Option<&Arc<dyn Generator>> {
        let name = path.file_name()?.to_str()?.to_ascii_lowercase();
        let ends = |extension: &&str| name.strip_suffix(extension).is_some_and(|stem| stem.ends_with('.'));
        self.all.iter().rev().find(|g| g.extensions().iter().any(ends))
    }

    /// All of them, in the order in which they were added.
    pub fn iter(&self) -> impl Iterator<Item = &Arc<dyn Generator>> {
        self.all.iter()
    }
}
