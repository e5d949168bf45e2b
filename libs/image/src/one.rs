//! One image of a file that holds several, selected by its name: `parts.exr#2`.

use crate::{ImageError, ImageInput, ImageSpec, Pixels, Result};
use std::path::{Path, PathBuf};

/// Returns the file and the index of the image in a name of the form `file#2`. Images are counted from 0. `None` for
/// other names. A file with exactly such a name has precedence.
pub fn split_image_name(name: &str) -> Option<(&str, usize)> {
    let (file, number) = name.rsplit_once('#')?;
    let digits = (1..=6).contains(&number.len()) && number.bytes().all(|b| b.is_ascii_digit());
    if file.is_empty() || !digits {
        return None;
    }
    Some((file, number.parse().ok()?))
}

/// Does the same as [`split_image_name`] for a path.
pub(crate) fn split_path(path: &Path) -> Option<(PathBuf, usize)> {
    let (file, image) = split_image_name(path.to_str()?)?;
    Some((file.into(), image))
}

/// Returns an input whose only image is image `image` of a file.
///
/// # Errors
/// [`ImageError::Unsupported`] when there is no such image, or the error of reading it.
pub(crate) fn one_image(
    input: Box<dyn ImageInput>,
    path: &Path,
    image: usize,
) -> Result<Box<dyn ImageInput>> {
    let n = input.images();
    if image < n && input.spec(image, 0).is_some() {
        return Ok(if n == 1 { input } else { Box::new(OneImage { input, image }) });
    }
    if image < n {
        // Formats that open their images one by one report errors of the image now.
        input.read_rows(image, 0, 0, 0)?;
    }
    let what = format!("there is no image {image}, the file has {n}, counted from 0");
    Err(ImageError::Unsupported { path: path.to_owned(), what })
}

struct OneImage {
    input: Box<dyn ImageInput>,
    image: usize,
}

impl OneImage {
    /// Returns the index in the file. For all images but the first it is an index that does not exist.
    fn of(&self, image: usize) -> usize {
        if image == 0 { self.image } else { usize::MAX }
    }
}

impl ImageInput for OneImage {
    fn format_name(&self) -> &'static str {
        self.input.format_name()
    }

    fn levels(&self, image: usize) -> usize {
        if image == 0 { self.input.levels(self.image) } else { 0 }
    }

    fn spec(&self, image: usize, level: usize) -> Option<&ImageSpec> {
        if image == 0 { self.input.spec(self.image, level) } else { None }
    }

    fn rows_together(&self, image: usize, level: usize) -> Option<u32> {
        self.input.rows_together(self.of(image), level)
    }

    fn read_rows(&self, image: usize, level: usize, y0: u32, y1: u32) -> Result<Pixels> {
        self.input.read_rows(self.of(image), level, y0, y1)
    }

    fn read_tile(&self, image: usize, level: usize, tx: u32, ty: u32) -> Result<Pixels> {
        self.input.read_tile(self.of(image), level, tx, ty)
    }

    fn bytes_read(&self) -> u64 {
        self.input.bytes_read()
    }

    fn working_bytes(&self, image: usize, level: usize) -> u64 {
        self.input.working_bytes(self.of(image), level)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn image_names_are_split_into_file_and_number() {
        assert_eq!(split_image_name("./a b.glb#12"), Some(("./a b.glb", 12)));
        assert_eq!(split_image_name("a#1#0"), Some(("a#1", 0)));
        for name in ["a.tif", "a#", "#1", "a#x1", "a#-1", "a#1 ", "a#1234567"] {
            assert_eq!(split_image_name(name), None, "{name}");
        }
    }
}
