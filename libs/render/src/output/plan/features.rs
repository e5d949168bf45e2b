//! The images that help to denoise those of a camera: albedo and normal.

use super::{OutputImage, OutputSet};
use crate::output::plan::ImageLayer;
use crate::output::writer::Shown;
use granita_base::Params;
use granita_gsl::ir::ValueType;
use granita_hider::film::{FilterSpec, PixelFilter};
use granita_hider::{Wanted, WantedVariable};
use std::path::PathBuf;

/// The number of channels of the image of features: the albedo, then the normal.
pub(crate) const FEATURES: usize = 6;

impl ImageLayer {
    /// True when its noise can be removed: it is one colour, perhaps with alpha, and a mean of samples. Arrays of
    /// colours keep their noise.
    pub(crate) fn is_denoisable(&self) -> bool {
        self.is_color
            && matches!(self.channels.len(), 3 | 4)
            && self.mattes.is_none()
            && matches!(self.filter.filter, PixelFilter::Weighted(_))
    }
}

impl OutputSet {
    /// Selects the images that are denoised: those with colours, unless their parameter "denoise" is 0. Returns false
    /// when there is none.
    pub(crate) fn select_denoised(&mut self) -> bool {
        for image in &mut self.images {
            let is_wanted = image.params.int(granita_scene::attr::DENOISE.name()).is_none_or(|n| n != 0);
            image.is_denoised =
                is_wanted && !image.is_error && image.layers.iter().any(ImageLayer::is_denoisable);
        }
        self.images.iter().any(|image| image.is_denoised)
    }

    /// Returns the image of the albedo and the normal of surfaces, with the filter of the first image that is denoised.
    pub(crate) fn features(&self) -> Self {
        let denoised = self.images.iter().filter(|image| image.is_denoised);
        let mut layers = denoised.flat_map(|image| &image.layers).filter(|layer| layer.is_denoisable());
        let filter = layers.next().map_or(
            FilterSpec { filter: PixelFilter::Weighted(granita_base::Filter::Box), width: [1.0; 2] },
            |layer| layer.filter,
        );
        let normal = WantedVariable { offset: 0, width: 3, is_color: false };
        let wanted = Wanted { variables: vec![normal], ..Wanted::default() };
        let first = wanted.variable_channel(0);
        let layer = |name: &str, first: usize, is_color| ImageLayer {
            name: name.into(),
            filter,
            channels: (first..first + 3).collect(),
            is_color,
            mattes: None,
        };
        let image = OutputImage {
            path: PathBuf::from("features"),
            format: String::new(),
            layers: vec![layer("rgb", 0, true), layer("N", first, false)],
            names: vec![String::new(); FEATURES],
            params: Params::new(),
            pixels: Vec::new(),
            is_shown: false,
            shown: Shown::default(),
            written: None,
            opaque_width: None,
            is_error: false,
            is_denoised: false,
            denoised_by: None,
            part: None,
            samples: 1.0,
            passes: None,
        };
        Self {
            images: vec![image],
            variables: vec![("N".into(), ValueType::Normal)],
            wanted,
            needs_shading: true,
            needs_second_surface: false,
            shows_albedo: true,
        }
    }
}
