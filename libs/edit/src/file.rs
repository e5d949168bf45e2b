//! Images that are read from files.

use crate::hold::Slabs;
use crate::image::{Image, Shape, Source};
use crate::{EditError, Result};
use granita_image::{FormatRegistry, ImageInput, Pixels};
use std::path::Path;
use std::sync::Arc;

/// One level of one image of a file.
struct FileLevel {
    input: Arc<dyn ImageInput>,
    image: usize,
    level: usize,
    shape: Shape,
    any_order: bool,
}

impl Source for FileLevel {
    fn shape(&self) -> Shape {
        self.shape
    }

    fn rows(&self, y0: u32, y1: u32) -> Result<Pixels> {
        Ok(self.input.read_rows(self.image, self.level, y0, y1)?)
    }

    fn any_order(&self) -> bool {
        self.any_order
    }
}

/// A file with one or more images, each with one or more MIP levels.
#[derive(Clone)]
pub struct File {
    input: Arc<dyn ImageInput>,
    path: Arc<Path>,
}

impl std::fmt::Debug for File {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("File").field("path", &self.path).finish_non_exhaustive()
    }
}

impl File {
    /// Opens a file. `file#2` is its third image.
    ///
    /// # Errors
    /// The errors of [`FormatRegistry::open`].
    pub fn open(path: &Path, formats: &FormatRegistry) -> Result<Self> {
        Ok(Self { input: formats.open(path)?.into(), path: path.into() })
    }

    /// The number of images.
    pub fn images(&self) -> usize {
        self.input.images()
    }

    /// The number of MIP levels of an image; 0 when there is no such image.
    pub fn levels(&self, image: usize) -> usize {
        self.input.levels(image)
    }

    /// Returns the name of the format.
    pub fn format(&self) -> &'static str {
        self.input.format_name()
    }

    /// Returns a level of an image. Its pixels are read when they are needed.
    ///
    /// # Errors
    /// [`EditError::Unsupported`] when the file has no such image or level.
    pub fn image(&self, image: usize, level: usize) -> Result<Image> {
        let Some(spec) = self.input.spec(image, level) else {
            let what = match self.input.levels(image) {
                0 => {
                    format!("there is no image {image}, the file has {}, counted from 0", self.input.images())
                }
                n => format!("there is no level {level}, the image has {n}, counted from 0"),
            };
            return Err(EditError::Unsupported { path: self.path.to_path_buf(), what });
        };
        let shape = Shape {
            width: spec.width,
            height: spec.height,
            channels: spec.nchannels(),
            pixel_type: spec.pixel_type,
        };
        // Formats that are decoded as a whole hold all pixels after the first request.
        let whole = self.input.working_bytes(image, level) >= shape.row_bytes() * u64::from(shape.height);
        let any_order = spec.is_tiled() || whole || self.input.rows_together(image, level).is_some();
        let source = FileLevel { input: self.input.clone(), image, level, shape, any_order };
        let spec = spec.clone();
        Ok(Image {
            stored: spec.pixel_type,
            format: self.input.format_name(),
            ready: true,
            spec,
            source: Arc::new(source),
        })
    }
}

impl Image {
    /// Returns the image with pixels that may be requested in any order at the same cost, with at most `memory_bytes`
    /// of rows in memory at once.
    pub(crate) fn in_any_order(&self, memory_bytes: u64) -> Self {
        if self.source.any_order() {
            return self.clone();
        }
        self.with_source(Arc::new(Slabs::new(self.source.clone(), memory_bytes)))
    }
}
