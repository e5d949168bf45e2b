//! The format "DevIL" (reference 7.4.7), the name of the library that supported four formats.

use crate::{FORMATS, PngFormat, SgiFormat};
use granita_image::{CreateOptions, Format, ImageError, ImageInput, ImageOutput, Limits, PixelType, Result};
use std::path::Path;
use std::sync::Arc;

/// The format "DevIL", which is BMP, PNG, SGI or Targa by the extension of the file, with 8 bits per channel.
#[derive(Clone, Copy, Debug, Default)]
pub struct DevilFormat;

/// Returns the formats that it represents.
fn formats() -> Vec<Arc<dyn Format>> {
    let mut all: Vec<Arc<dyn Format>> = vec![Arc::new(PngFormat), Arc::new(SgiFormat)];
    let plain = FORMATS.iter().filter(|f| matches!(f.name(), "bmp" | "tga"));
    all.extend(plain.map(|f| Arc::new(*f) as Arc<dyn Format>));
    all
}

fn of_extension(path: &Path) -> Result<Arc<dyn Format>> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let found = formats().into_iter().find(|f| f.extensions().contains(&&*extension));
    found.ok_or_else(|| ImageError::Unsupported {
        path: path.to_owned(),
        what: format!(
            "\"DevIL\" writes bmp, png, sgi or tga, by the extension of the file name, not \"{extension}\""
        ),
    })
}

impl Format for DevilFormat {
    fn name(&self) -> &'static str {
        "DevIL"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &[]
    }

    fn recognizes(&self, _head: &[u8]) -> bool {
        // The files are recognized by the formats themselves.
        false
    }

    fn open(&self, path: &Path, limits: &Limits) -> Result<Box<dyn ImageInput>> {
        of_extension(path)?.open(path, limits)
    }

    fn supports(&self, feature: &str) -> bool {
        matches!(feature, "write" | "alpha")
    }

    fn output_type(&self, _quantized: PixelType) -> PixelType {
        PixelType::U8
    }

    fn create(&self, path: &Path, options: &CreateOptions<'_>) -> Result<Box<dyn ImageOutput>> {
        of_extension(path)?.create(path, options)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_image::{ImageSpec, Pixels};

    #[test]
    fn the_file_extension_chooses_the_format() {
        let folder = tempfile::tempdir().expect("a folder");
        let spec = ImageSpec::new(2, 1, 3, PixelType::U8);
        for (name, format) in
            [("a.png", "png"), ("a.BMP", "bmp"), ("a.rgb", "sgi"), ("a.sgi", "sgi"), ("a.tga", "tga")]
        {
            let path = folder.path().join(name);
            let mut file = DevilFormat.create(&path, &CreateOptions::new(&spec, 1)).expect("a file");
            file.write_rows(&Pixels::U8(vec![1, 2, 3, 4, 5, 6])).expect("rows");
            file.close().expect("a whole file");
            let input = DevilFormat.open(&path, &Limits::default()).expect("it opens");
            assert_eq!(input.format_name(), format);
            assert_eq!(input.read_level(0, 0).expect("pixels"), Pixels::U8(vec![1, 2, 3, 4, 5, 6]));
        }
        let error = DevilFormat.create(&folder.path().join("a.tif"), &CreateOptions::new(&spec, 1));
        assert!(error.err().is_some_and(|e| e.to_string().contains("not \"tif\"")));
        assert_eq!(DevilFormat.output_type(PixelType::Float), PixelType::U8);
    }
}
