//! Files whose parts are several images of a frame.

use crate::RenderError;
use granita_base::Files;
use granita_image::{Format, ImageError, ImageOutput, ImageSpec, Pixels, Result};
use parking_lot::Mutex;
use std::path::PathBuf;
use std::sync::Arc;

/// The part that an image becomes.
#[derive(Clone, Debug)]
pub(crate) struct Part {
    /// Its name.
    pub(crate) name: Arc<str>,
    /// The eye that sees the image, for a stereo camera.
    pub(crate) view: Option<&'static str>,
    /// The file, and the index of the part in it, once all parts are known.
    pub(crate) place: Option<(Arc<PartFile>, usize)>,
}

impl Part {
    /// Returns the part of this name.
    pub(crate) fn new(name: Arc<str>) -> Self {
        Self { name, view: None, place: None }
    }
}

/// A file of several parts. It is created when the first of its parts is opened, and complete when all of them are
/// closed.
#[derive(Debug)]
pub(crate) struct PartFile {
    path: PathBuf,
    specs: Vec<ImageSpec>,
    open: Mutex<Option<Arc<Mutex<Open>>>>,
}

/// The file while it is written.
struct Open {
    /// `None` when it is complete or has failed.
    file: Option<Box<dyn ImageOutput>>,
    /// The number of parts that are not closed.
    left: usize,
    is_complete: bool,
}

impl std::fmt::Debug for Open {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Open").field("left", &self.left).finish_non_exhaustive()
    }
}

impl PartFile {
    /// Returns a file with these parts that does not exist yet.
    pub(crate) fn new(path: PathBuf, specs: Vec<ImageSpec>) -> Self {
        Self { path, specs, open: Mutex::new(None) }
    }

    /// Checks that the format stores the parts and that the file can be created.
    ///
    /// # Errors
    /// Returns the errors of the format.
    pub(crate) fn check(&self, format: &dyn Format, files: &Files) -> std::result::Result<(), RenderError> {
        Ok(format.create_images(&self.path, &self.specs, files).map(drop)?)
    }

    /// Opens a part, which takes rows only.
    ///
    /// # Errors
    /// Returns the errors of the format when the file cannot be created.
    pub(crate) fn part(
        &self,
        index: usize,
        format: &dyn Format,
        files: &Files,
    ) -> Result<Box<dyn ImageOutput>> {
        let mut open = self.open.lock();
        let shared = match &*open {
            Some(shared) => shared.clone(),
            None => {
                let file = format.create_images(&self.path, &self.specs, files)?;
                let new = Open { file: Some(file), left: self.specs.len(), is_complete: false };
                open.insert(Arc::new(Mutex::new(new))).clone()
            }
        };
        Ok(Box::new(PartOutput { path: self.path.clone(), shared, index }))
    }

    /// True when all parts were written and the file has its name.
    pub(crate) fn is_complete(&self) -> bool {
        self.open.lock().as_ref().is_some_and(|open| open.lock().is_complete)
    }
}

/// A part that is being written.
struct PartOutput {
    path: PathBuf,
    shared: Arc<Mutex<Open>>,
    index: usize,
}

impl PartOutput {
    fn misuse(&self, what: &str) -> ImageError {
        ImageError::Misuse { path: self.path.clone(), what: format!("part {}: {what}", self.index) }
    }
}

impl ImageOutput for PartOutput {
    fn write_rows(&mut self, pixels: &Pixels) -> Result<()> {
        let mut open = self.shared.lock();
        let file = open.file.as_mut().ok_or_else(|| self.misuse("the file has failed"))?;
        file.select_image(self.index)?;
        file.write_rows(pixels)
    }

    fn write_tile(&mut self, _tx: u32, _ty: u32, _pixels: &Pixels) -> Result<()> {
        Err(self.misuse("a tile of an image that is written in rows"))
    }

    fn next_level(&mut self, _spec: &ImageSpec) -> Result<()> {
        Err(self.misuse("it has one level"))
    }

    fn close(self: Box<Self>) -> Result<()> {
        let mut open = self.shared.lock();
        open.left = open.left.saturating_sub(1);
        if open.left > 0 {
            return Ok(());
        }
        let file = open.file.take().ok_or_else(|| self.misuse("the file has failed"))?;
        file.close()?;
        open.is_complete = true;
        Ok(())
    }
}
