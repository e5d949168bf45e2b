//! Inputs that are needed as a whole.

use super::MakeOptions;
use super::color::Conversion;
use super::source::{Source, Units};
use crate::error::Result;
use crate::image::Image;
use granita_base::Params;
use granita_image::{FormatRegistry, ImageSpec, PixelType};
use std::path::{Path, PathBuf};

/// One input in its whole display window, with linear colours.
pub(crate) struct Input {
    pub(crate) path: PathBuf,
    pub(crate) image: Image,
    pub(crate) pixel_type: PixelType,
    pub(crate) channels: Vec<String>,
    pub(crate) attributes: Params,
    /// The description in the file.
    pub(crate) spec: ImageSpec,
    /// True when its format stores environments with +y up, right handed.
    pub(crate) exr: bool,
    pub(crate) conversion: Conversion,
    pub(crate) note: Option<String>,
}

impl Input {
    /// Reads the first image of a file, and converts its colours to linear light.
    pub(crate) fn read(path: &Path, options: &MakeOptions, registry: &FormatRegistry) -> Result<Self> {
        Self::open(path, options, registry, true)
    }

    /// Reads the first image of a file without conversion, for depths.
    pub(crate) fn read_raw(path: &Path, options: &MakeOptions, registry: &FormatRegistry) -> Result<Self> {
        Self::open(path, options, registry, false)
    }

    fn open(path: &Path, options: &MakeOptions, registry: &FormatRegistry, colors: bool) -> Result<Self> {
        let source = Source::open(path, options, registry)?;
        let conversion = source.conversion(options);
        let image = source.image(colors.then_some(&conversion), Units::Fractions)?;
        Ok(Self {
            path: path.to_owned(),
            image,
            pixel_type: source.spec.pixel_type,
            channels: source.spec.channels.clone(),
            attributes: source.spec.attributes.clone(),
            exr: source.format_name() == "exr",
            conversion,
            note: source.notes(),
            spec: source.spec,
        })
    }

    /// Returns a matrix that the file contains.
    pub(crate) fn matrix(&self, name: &str) -> Option<[f32; 16]> {
        self.attributes.floats(name)?.get(..16)?.try_into().ok()
    }

    /// Keeps one channel: the one named "z" or "Z", or else the first.
    pub(crate) fn only_depth(&mut self) {
        let n = self.image.channels;
        let depth = self.channels.iter().position(|c| c.eq_ignore_ascii_case("z")).unwrap_or(0);
        if n > 1 {
            self.image.data = self.image.data.chunks_exact(n).map(|texel| texel[depth]).collect();
            self.image.channels = 1;
        }
        self.channels = vec!["Z".to_owned()];
    }
}
