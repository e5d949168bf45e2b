//! The formats of a session, and the selection of the format that reads or writes a file.

use crate::one;
use crate::{CreateOptions, Format, ImageError, ImageInput, ImageOutput, Limits, Result};
use granita_base::Files;
use std::path::Path;
use std::sync::Arc;

/// Finds formats beyond those of a registry, when they are requested.
pub trait FormatFinder: Send + Sync {
    /// Returns the format with exactly this name that precedes the registry's own, because the user named it.
    fn preferred(&self, name: &str) -> Option<Arc<dyn Format>>;

    /// Returns the format that is installed under exactly this name. It follows the registry's own.
    fn named(&self, name: &str) -> Option<Arc<dyn Format>>;

    /// Returns a format that declares to write, or read, files with this extension. It follows the registry's own.
    fn listed(&self, extension: &str, writes: bool) -> Option<Arc<dyn Format>>;

    /// Returns all formats that read, to be tried in order.
    fn readers(&self) -> Vec<Arc<dyn Format>>;
}

/// The formats of one session, in order of registration.
#[derive(Clone, Default)]
pub struct FormatRegistry {
    formats: Vec<Arc<dyn Format>>,
    /// Names that stand for one of the formats. They have no files of their own.
    names: Vec<Arc<dyn Format>>,
    limits: Limits,
    finder: Option<Arc<dyn FormatFinder>>,
}

impl std::fmt::Debug for FormatRegistry {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.formats.iter().map(|f| f.name())).finish()
    }
}

/// Returns the name of a well-known format that is not bundled, and that of a plugin for it, from the first bytes of a
/// file.
fn missing(head: &[u8]) -> Option<(&'static str, &'static str)> {
    // The kind of the first box, and the main brand of the file (ISO/IEC 23008-12, 10; AV1 Image File Format, 6).
    match (head.get(4..8)?, head.get(8..12)?) {
        (b"ftyp", b"avif" | b"avis") => Some(("AVIF", "heif")),
        (b"ftyp", b"heic" | b"heix" | b"hevc" | b"hevx" | b"heim" | b"heis" | b"mif1" | b"msf1") => {
            Some(("HEIF", "heif"))
        }
        _ => None,
    }
}

impl FormatRegistry {
    /// Returns a registry without formats.
    pub fn new(limits: Limits) -> Self {
        Self { formats: Vec::new(), names: Vec::new(), limits, finder: None }
    }

    /// Adds a format. Of two with one name the later is used.
    pub fn register(&mut self, format: Arc<dyn Format>) {
        self.formats.retain(|f| f.name() != format.name());
        self.formats.push(format);
    }

    /// Adds a name that stands for other formats. [`FormatRegistry::by_name`] finds it, and
    /// [`FormatRegistry::formats`] does not contain it.
    pub fn register_name(&mut self, name: Arc<dyn Format>) {
        self.names.push(name);
    }

    /// Adds `finder` to the search for formats. Clones that are made later use it too.
    pub fn find_with(&mut self, finder: Arc<dyn FormatFinder>) {
        self.finder = Some(finder);
    }

    /// Returns the format of a name, alias or extension.
    pub fn by_name(&self, name: &str) -> Option<Arc<dyn Format>> {
        let same = |other: &str| other.eq_ignore_ascii_case(name);
        let finder = self.finder.as_ref();
        let own = || {
            self.formats
                .iter()
                .find(|f| same(f.name()) || f.aliases().iter().any(|a| same(a)))
                .or_else(|| self.formats.iter().find(|f| f.extensions().iter().any(|e| same(e))))
                .or_else(|| self.names.iter().find(|f| same(f.name())))
                .cloned()
        };
        finder
            .and_then(|f| f.preferred(name))
            .or_else(own)
            .or_else(|| finder.and_then(|f| f.named(name)))
            .or_else(|| finder.and_then(|f| f.listed(name, true)))
    }

    /// Returns the limits of its readers.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// Returns all formats, in order of registration.
    pub fn formats(&self) -> &[Arc<dyn Format>] {
        &self.formats
    }

    /// Returns the names of all formats.
    pub fn names(&self) -> Vec<&'static str> {
        self.formats.iter().map(|f| f.name()).collect()
    }

    /// Opens a file, or one of its images. `parts.exr#2` is the third image of `parts.exr`, unless there is a file of
    /// exactly that name. Formats that recognise its first bytes are tried first, then those of its extension.
    ///
    /// # Errors
    /// The system's error; [`ImageError::Unsupported`] when no format supports it or there is no such image; the
    /// format's own errors.
    pub fn open(&self, path: &Path) -> Result<Box<dyn ImageInput>> {
        match one::split_path(path) {
            Some((file, image)) if !self.limits.files.is_file(path) => {
                one::one_image(self.open_file(&file)?, path, image)
            }
            _ => self.open_file(path),
        }
    }

    /// Opens an image in memory by its first bytes. `path` is its name in errors.
    ///
    /// # Errors
    /// [`ImageError::Unsupported`] when no format supports it; the format's own errors.
    pub fn open_bytes(&self, path: &Path, bytes: Arc<[u8]>) -> Result<Box<dyn ImageInput>> {
        let head = &bytes[..bytes.len().min(64)];
        match self.formats.iter().find(|f| f.recognizes(head)) {
            Some(format) => format.open_bytes(path, bytes, &self.limits),
            None => Err(self.unknown(path, head)),
        }
    }

    fn unknown(&self, path: &Path, head: &[u8]) -> ImageError {
        let what = match missing(head) {
            Some((name, plugin)) => {
                format!(
                    "an image of the format {name}, which only a plugin reads ({plugin}.imageio.so), and there is none"
                )
            }
            None => format!("not an image of a known format ({})", self.names().join(", ")),
        };
        ImageError::Unsupported { path: path.to_owned(), what }
    }

    fn open_file(&self, path: &Path) -> Result<Box<dyn ImageInput>> {
        use std::io::Read;
        let io = |source| ImageError::Io { path: path.to_owned(), source };
        let mut head = Vec::with_capacity(64);
        self.limits.files.open(path).map_err(io)?.take(64).read_to_end(&mut head).map_err(io)?;
        if head.is_empty() {
            return Err(ImageError::Unsupported {
                path: path.to_owned(),
                what: "the file is empty".to_owned(),
            });
        }
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        let format = (self.formats.iter().find(|f| f.recognizes(&head)))
            .or_else(|| self.formats.iter().find(|f| f.extensions().contains(&extension.as_str())));
        let Some(finder) = &self.finder else {
            return match format {
                Some(format) => format.open(path, &self.limits),
                None => Err(self.unknown(path, &head)),
            };
        };
        let mut refused = None;
        if let Some(plugin) = finder.preferred(&extension) {
            match plugin.open(path, &self.limits) {
                Ok(input) => return Ok(input),
                Err(error) => refused = Some(error),
            }
        }
        if let Some(format) = format {
            // The error of the plugin is ignored, because the bundled format recognises the contents of the file.
            return format.open(path, &self.limits);
        }
        if let Some(plugin) = finder.named(&extension).or_else(|| finder.listed(&extension, false)) {
            return plugin.open(path, &self.limits);
        }
        let probed = finder.readers().into_iter().find_map(|plugin| plugin.open(path, &self.limits).ok());
        probed.ok_or_else(|| refused.unwrap_or_else(|| self.unknown(path, &head)))
    }

    /// Returns the opener of its files.
    pub fn files(&self) -> &Files {
        &self.limits.files
    }

    /// Returns the same formats with files that `files` opens.
    #[must_use]
    pub fn with_files(&self, files: Files) -> Self {
        let mut other = self.clone();
        other.limits.files = files;
        other
    }

    /// Creates a file in the format called `format`, with [`FormatRegistry::files`].
    ///
    /// # Errors
    /// An error when there is no such format, and the errors of [`Format::create`].
    pub fn create(
        &self,
        path: &Path,
        format: &str,
        options: &CreateOptions<'_>,
    ) -> Result<Box<dyn ImageOutput>> {
        self.by_name(format)
            .ok_or_else(|| ImageError::Unsupported {
                path: path.to_owned(),
                what: format!("unknown image format \"{format}\" (known: {})", self.names().join(", ")),
            })?
            .create(path, &CreateOptions::new(options.spec, options.levels).with_files(self.files()))
    }
}
