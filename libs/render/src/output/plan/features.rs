//! The images that help to denoise those of a camera: albedo and normal.

use super::{OutputImage, OutputSet};
use crate::output::halves::DenoisedError;
use crate::output::plan::ImageLayer;
use crate::output::writer::Shown;
use granita_base::{BaseType, Filter, Param, ParamType, Params};
use granita_gsl::ir::ValueType;
use granita_hider::film::{FilterSpec, PixelFilter};
use granita_hider::{Wanted, WantedVariable};
use granita_scene::attr;
use std::path::PathBuf;

/// The number of channels of the image of features: the albedo, then the normal.
pub(crate) const FEATURES: usize = 6;

/// The filter whose pixels share no samples.
const BOX: FilterSpec = FilterSpec { filter: PixelFilter::Weighted(Filter::Box), width: [1.0; 2] };

/// Returns the metadata of an image whose noise a library removed.
pub(super) fn of_denoiser(library: &str, error: Option<DenoisedError>) -> Params {
    let ty = ParamType::of(BaseType::String);
    let text = |name: &str, value: &str| Param { name: name.into(), ty, data: value.into() };
    let mut all = vec![text("granita/denoised", library)];
    if let Some(error) = error {
        all.push(text("granita/denoisederror", &error.error.to_string()));
        all.push(text("granita/denoisederror95", &error.bound.to_string()));
    }
    Params(all)
}

impl ImageLayer {
    /// True when its noise can be removed: it is one colour, perhaps with alpha, and a mean of samples. Arrays of
    /// colours keep their noise.
    fn is_denoisable(&self) -> bool {
        self.is_color
            && matches!(self.channels.len(), 3 | 4)
            && self.mattes.is_none()
            && matches!(self.filter.filter, PixelFilter::Weighted(_))
    }
}

impl OutputImage {
    /// True when the noise of some of its layers can be removed, and the output does not forbid it.
    fn is_denoisable(&self) -> bool {
        let is_wanted = self.params.int(attr::DENOISE.name()).is_none_or(|n| n != 0);
        is_wanted && !self.is_error && !self.denoisable().is_empty()
    }

    /// Returns the first channel of each layer whose noise can be removed.
    pub(crate) fn denoisable(&self) -> Vec<usize> {
        let mut next = 0;
        let mut found = Vec::new();
        for layer in &self.layers {
            if layer.is_denoisable() {
                found.push(next);
            }
            next += layer.channels.len();
        }
        found
    }
}

impl OutputSet {
    /// Gives what can be denoised the filter whose pixels share no samples, because the library expects noise that is
    /// independent from pixel to pixel.
    pub(super) fn share_no_samples(&mut self) {
        let images = self.images.iter_mut().filter(|image| image.is_denoisable());
        let layers = images.flat_map(|image| &mut image.layers).filter(|layer| layer.is_denoisable());
        layers.for_each(|layer| layer.filter = BOX);
    }

    /// Selects the images that are denoised. Returns false when there is none.
    pub(crate) fn select_denoised(&mut self) -> bool {
        self.images.iter_mut().for_each(|image| image.is_denoised = image.is_denoisable());
        self.images.iter().any(|image| image.is_denoised)
    }

    /// Returns the image of the albedo and the normal of surfaces.
    pub(crate) fn features() -> Self {
        let normal = WantedVariable { offset: 0, width: 3, is_color: false };
        let wanted = Wanted { variables: vec![normal], ..Wanted::default() };
        let first = wanted.variable_channel(0);
        let layer = |name: &str, first: usize, is_color| ImageLayer {
            name: name.into(),
            filter: BOX,
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
