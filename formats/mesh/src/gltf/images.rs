//! The images of a glTF file, including those inside of it, for textures and `maketx`.

use super::buffers::{Buffers, data_of_uri, path_of_uri};
use super::container;
use super::document::{Document, item};
use crate::faults::Faults;
use crate::source::{Opened, open};
use granita_base::Reporter;
use granita_image::{Format, FormatRegistry, ImageError, ImageInput, ImageSpec, Limits, Pixels, Result};
use granita_scene::{GeneratorError, GeneratorSource};
use parking_lot::Mutex;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// Reads the images of `.gltf` and `.glb` files as images of one file, with the indices of the list `images` in the
/// file. `model.glb#2` is the third image. Each image is opened and read when it is first used.
///
/// Images may be in a buffer view, in a `data:` URI, or in a file beside it.
#[derive(Debug)]
pub struct GltfImages {
    /// The formats that images may have.
    formats: FormatRegistry,
}

impl GltfImages {
    /// Returns the format. `formats` read the images themselves.
    pub fn new(formats: FormatRegistry) -> Self {
        Self { formats }
    }
}

impl Format for GltfImages {
    fn name(&self) -> &'static str {
        "gltf"
    }

    fn aliases(&self) -> &'static [&'static str] {
        &["glb"]
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["gltf", "glb"]
    }

    fn recognizes(&self, head: &[u8]) -> bool {
        head.starts_with(b"glTF")
    }

    fn open(&self, path: &Path, limits: &Limits) -> Result<Box<dyn ImageInput>> {
        let malformed = |what: String| ImageError::Malformed { path: path.to_owned(), format: "glTF", what };
        let failed = |error: GeneratorError| match error {
            GeneratorError::Io { source, .. } => ImageError::Io { path: path.to_owned(), source },
            // The texts of other errors begin with the name.
            other => {
                let text = other.to_string();
                malformed(text.strip_prefix(&format!("{}: ", path.display())).unwrap_or(&text).to_owned())
            }
        };
        let source = GeneratorSource::file(path).with_files(&limits.files);
        let Opened { name, mut stream, size } = open(&source).map_err(failed)?;
        let (json, chunk) = container(&name, &mut stream, size).map_err(failed)?;
        // The generator reports the errors of the file when it reads the scene.
        let silent = Reporter::silent();
        let document = Document::parse(&json, &mut Faults::new(&silent, name)).map_err(malformed)?;
        let count = document.images.len();
        if count == 0 {
            let what = "it holds no images".to_owned();
            return Err(ImageError::Unsupported { path: path.to_owned(), what });
        }
        limits.within(path, "number of images", count as u64, u64::from(limits.images))?;
        let folder = path.parent().map(Path::to_path_buf);
        let buffers = Buffers::new(stream, chunk, folder.clone(), limits.files.clone(), silent.clone());
        Ok(Box::new(Images {
            path: path.to_owned(),
            folder,
            formats: self.formats.clone(),
            limits: limits.clone(),
            document,
            buffers: Mutex::new(buffers),
            open: (0..count).map(|_| OnceLock::new()).collect(),
        }))
    }
}

/// An open file.
struct Images {
    path: PathBuf,
    folder: Option<PathBuf>,
    formats: FormatRegistry,
    limits: Limits,
    document: Document,
    buffers: Mutex<Buffers>,
    open: Vec<OnceLock<std::result::Result<Box<dyn ImageInput>, String>>>,
}

impl Images {
    fn input(&self, image: usize) -> Result<&dyn ImageInput> {
        let unsupported = |what: String| ImageError::Unsupported { path: self.path.clone(), what };
        let Some(slot) = self.open.get(image) else {
            return Err(unsupported(format!("there is no image {image}")));
        };
        match slot.get_or_init(|| self.opened(image)) {
            Ok(input) => Ok(&**input),
            Err(what) => Err(unsupported(what.clone())),
        }
    }

    fn opened(&self, image: usize) -> std::result::Result<Box<dyn ImageInput>, String> {
        let document = &self.document;
        let described = item(&document.images, image).ok_or_else(|| format!("image {image} is no image"))?;
        let shown = PathBuf::from(format!("{}#{image}", self.path.display()));
        let bytes = match (&described.uri, described.buffer_view) {
            (Some(uri), _) => match data_of_uri(uri) {
                Some(bytes) => bytes.map_err(|why| format!("image {image}: {why}"))?,
                None => {
                    let path = path_of_uri(uri, self.folder.as_ref());
                    let path = path.map_err(|why| format!("image {image}: {why}"))?;
                    return self.formats.open(&path).map_err(|error| error.to_string());
                }
            },
            (None, Some(view)) => {
                let view = item(&document.buffer_views, view)
                    .ok_or_else(|| format!("image {image}: there is no buffer view {view}"))?;
                let limit = self.limits.bytes.min(isize::MAX as u64);
                if view.byte_length > limit {
                    let asked = view.byte_length;
                    return Err(format!("image {image}: {asked} bytes, of at most {limit}"));
                }
                let mut buffers = self.buffers.lock();
                buffers
                    .read(document, view.buffer, view.byte_offset, view.byte_length as usize)
                    .map_err(|why| format!("image {image}: {why}"))?
            }
            (None, None) => return Err(format!("image {image} has neither a URI nor a buffer view")),
        };
        self.formats.open_bytes(&shown, Arc::from(bytes)).map_err(|error| error.to_string())
    }
}

impl ImageInput for Images {
    fn format_name(&self) -> &'static str {
        "gltf"
    }

    fn images(&self) -> usize {
        self.open.len()
    }

    fn levels(&self, image: usize) -> usize {
        self.input(image).map_or(0, |p| p.levels(0))
    }

    fn spec(&self, image: usize, level: usize) -> Option<&ImageSpec> {
        self.input(image).ok()?.spec(0, level)
    }

    fn read_rows(&self, image: usize, level: usize, y0: u32, y1: u32) -> Result<Pixels> {
        self.input(image)?.read_rows(0, level, y0, y1)
    }

    fn read_tile(&self, image: usize, level: usize, tx: u32, ty: u32) -> Result<Pixels> {
        self.input(image)?.read_tile(0, level, tx, ty)
    }

    fn bytes_read(&self) -> u64 {
        self.open.iter().filter_map(|p| p.get()?.as_ref().ok()).map(|p| p.bytes_read()).sum()
    }
}
