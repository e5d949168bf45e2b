//! The images of a frame that was ended early, as files that show that they are partial.
//!
//! Such a file is not written under the name of the image. It has [`partial_path`] as its name, and the attribute
//! `ImageDescription` begins with the words "partial image". Pixels that were not rendered are 0 in all channels.

use crate::output::plan::OutputImage;
use crate::{CameraView, RenderError};
use granita_base::{BaseType, Files, Param, ParamType};
use granita_image::FormatRegistry;
use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// The attribute of the description of an image.
const DESCRIPTION: &str = "ImageDescription";

/// The number of rows that are written at once.
const ROWS: usize = 64;

/// Returns the name of the file for the partial image of `path`: `name.partial.ext` for `name.ext`.
pub fn partial_path(path: &Path) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_owned();
    name.push(".partial");
    if let Some(extension) = path.extension() {
        name.push(".");
        name.push(extension);
    }
    path.with_file_name(name)
}

/// The pixels of an image of a frame that was ended early.
pub(crate) struct Partial {
    /// The number of pixels that were rendered.
    pub(crate) rendered: usize,
    /// The number of pixels of the crop window.
    pub(crate) total: usize,
    pub(crate) pixels: PartialPixels,
}

/// The location of the pixels of a partial image.
pub(crate) enum PartialPixels {
    /// The pixels of the crop window, with interleaved channels.
    Kept(Vec<f32>),
    /// The copies of the rows of a large image.
    Copied(Result<RowCopies, std::io::Error>),
    /// The viewer keeps what it shows.
    Shown,
}

impl Partial {
    /// Returns the part of the pixels that were rendered, in whole percent from 1 to 99.
    pub(crate) fn percent(&self) -> usize {
        (self.rendered.saturating_mul(100) / self.total.max(1)).clamp(1, 99)
    }

    /// Writes the partial image of `image`, and returns its file; `None` when there is nothing to write.
    ///
    /// # Errors
    /// Returns the errors of the format and of the temporary file, and [`RenderError::Misuse`] for an image that is not
    /// a plain file.
    pub(crate) fn write(
        self,
        image: &OutputImage,
        camera: &CameraView,
        registry: &FormatRegistry,
    ) -> Result<Option<PathBuf>, RenderError> {
        let percent = self.percent();
        if self.rendered == 0 || image.is_for_program() || matches!(self.pixels, PartialPixels::Shown) {
            return Ok(None);
        }
        if image.path.metadata().is_ok_and(|m| !m.is_file()) {
            return Err(RenderError::Misuse { what: "a pipe or a device gets no partial image".to_owned() });
        }
        let path = partial_path(&image.path_alone());
        let mut file = image.partial(&path, &description(image, percent)).open(camera, registry)?;
        let chunk = camera.crop.width() * image.channels() * ROWS;
        let io = |source| RenderError::Io { path: path.clone(), source };
        match self.pixels {
            PartialPixels::Kept(pixels) => {
                pixels.chunks(chunk).try_for_each(|values| file.write(values))?;
            }
            PartialPixels::Copied(copies) => {
                let mut copies = copies.and_then(RowCopies::rewound).map_err(io)?;
                let mut left = self.total * image.channels();
                while left > 0 {
                    let values = copies.read(left.min(chunk)).map_err(io)?;
                    left -= values.len();
                    file.write(&values)?;
                }
            }
            PartialPixels::Shown => (),
        }
        file.close()?;
        Ok(Some(path))
    }
}

/// Returns the description of a partial image. It ends with that of the image itself, if there is one.
fn description(image: &OutputImage, percent: usize) -> Param {
    let mut text = format!("partial image: {percent} % of the pixels were rendered");
    if let Some(own) = image.format_parameter(DESCRIPTION) {
        text = format!("{text}; {own}");
    }
    Param { name: DESCRIPTION.into(), ty: ParamType::of(BaseType::String), data: text.as_str().into() }
}

/// The copies of the rows of an image that is written while it is rendered, in a temporary file. The file of the image
/// itself cannot become the partial one, because its name and attributes are written first.
pub(crate) struct RowCopies(BufWriter<File>);

impl RowCopies {
    /// Begins the copies, in a file beside the image or in the folder for temporary files.
    pub(crate) fn new(files: &Files, image: &Path) -> std::io::Result<Self> {
        files.scratch(image).map(|file| Self(BufWriter::new(file)))
    }

    /// Appends values.
    pub(crate) fn write(&mut self, values: &[f32]) -> std::io::Result<()> {
        values.iter().try_for_each(|value| self.0.write_all(&value.to_ne_bytes()))
    }

    fn rewound(self) -> std::io::Result<CopiedRows> {
        let mut file = self.0.into_inner().map_err(|error| error.into_error())?;
        file.seek(SeekFrom::Start(0))?;
        Ok(CopiedRows(BufReader::new(file)))
    }
}

/// The copies of rows, for reading.
struct CopiedRows(BufReader<File>);

impl CopiedRows {
    /// Returns the next `count` values.
    fn read(&mut self, count: usize) -> std::io::Result<Vec<f32>> {
        let mut bytes = vec![0; count * size_of::<f32>()];
        self.0.read_exact(&mut bytes)?;
        let (values, _) = bytes.as_chunks::<4>();
        Ok(values.iter().map(|bytes| f32::from_ne_bytes(*bytes)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn partial_files_have_names_of_their_own() {
        let name = |path: &str| partial_path(Path::new(path)).to_str().unwrap().to_owned();
        assert_eq!(name("a/first.exr"), "a/first.partial.exr");
        assert_eq!(name("x.0001.tif"), "x.0001.partial.tif");
        assert_eq!(name("plain"), "plain.partial");
    }

    #[test]
    fn percents_are_neither_nothing_nor_everything() {
        let percent = |rendered, total| Partial { rendered, total, pixels: PartialPixels::Shown }.percent();
        assert_eq!(
            [percent(1, 1000), percent(374, 1000), percent(1000, 1000), percent(1, 0)],
            [1, 37, 99, 99]
        );
    }
}
