//! The settings of the renderer that images have as metadata.
//!
//! All of them are texts, so that formats without numbers as attributes store them as well. They depend on the scene
//! alone, so that the same frame results in the same file.

use super::ImageLayer;
use crate::CameraView;
use crate::output::halves::DenoisedError;
use crate::passes::ErrorEstimate;
use granita_base::{BaseType, Param, ParamType, Params};
use granita_hider::film::{FilterSpec, PixelFilter};

/// Returns the settings of an image of `camera` with these layers. `samples` is the attribute "render:samples".
pub(crate) fn settings(camera: &CameraView, layers: &[ImageLayer], samples: f32) -> Params {
    let mut params = Params::new();
    let mut set = |name: &str, text: String| {
        let ty = ParamType::of(BaseType::String);
        params.set(Param { name: format!("granita/{name}").into(), ty, data: text.as_str().into() });
    };
    set("camera", camera.name.to_string());
    let [x, y] = camera.spatialquality;
    set("samples", format!("{x} {y}"));
    if camera.has_motion_blur() {
        let [open, close] = camera.shutter;
        set("shutter", format!("{open} {close}"));
        set("temporalquality", camera.temporalquality.to_string());
    }
    if camera.has_depth_of_field() {
        set("dofquality", camera.dofquality.to_string());
    }
    if samples != 1.0 {
        set("render:samples", samples.to_string()); // tidy: attribute: the name of metadata
    }
    match layers {
        [one] => set("filter", filter_text(&one.filter)),
        many => many.iter().for_each(|l| set(&format!("filter/{}", l.name), filter_text(&l.filter))),
    }
    params
}

/// The passes whose sum an image is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct ImagePasses {
    /// Their number.
    pub(crate) count: u32,
    /// How many times as far apart the points of surfaces are, in a coarse image.
    pub(crate) coarse: Option<u32>,
    /// How many times as fine surfaces are as the scene says.
    pub(crate) finer: u32,
    /// How many times the samples of pixels, and of lights and rays, of a frame without passes its passes have.
    pub(crate) larger: [u32; 2],
    /// The error of the image; `None` where it is not known.
    pub(crate) error: Option<ErrorEstimate>,
    /// The error without its noise; `None` where that was not measured.
    pub(crate) denoised: Option<DenoisedError>,
}

/// Returns what an image of passes says about itself: `granita/passes`, and once there are two, `granita/error`,
/// `granita/error95`, `granita/bias`, `granita/blocks99`, `granita/worstblock` and `granita/error/SOURCE` as fractions
/// of the mean of the image.
pub(crate) fn of_passes(passes: Option<ImagePasses>) -> Params {
    let mut params = Params::new();
    let Some(ImagePasses { count, coarse, finer, larger: [pixels, shading], error, .. }) = passes else {
        return params;
    };
    let mut set = |name: &str, text: String| {
        let ty = ParamType::of(BaseType::String);
        params.set(Param { name: format!("granita/{name}").into(), ty, data: text.as_str().into() });
    };
    set("passes", count.to_string());
    if finer > 1 {
        set("finer", finer.to_string());
    }
    if pixels.max(shading) > 1 {
        set("larger", format!("{pixels} {shading}"));
    }
    if let Some(factor) = coarse {
        set("coarse", factor.to_string());
    }
    if let Some(estimate) = error {
        let ErrorEstimate { error, bound, blocks_99, worst_block, worst_at: [x, y], .. } = estimate;
        set("error", format!("{error:.6}"));
        set("error95", format!("{bound:.6}"));
        if let Some(bias) = estimate.bias {
            set("bias", format!("{bias:.6}"));
        }
        set("blocks99", format!("{blocks_99:.6}"));
        set("worstblock", format!("{worst_block:.6} at {x} {y}"));
        for (source, part) in estimate.causes() {
            set(&format!("error/{}", source.name()), format!("{part:.6}"));
        }
    }
    params
}

/// Returns the name and the widths of a filter.
fn filter_text(filter: &FilterSpec) -> String {
    let word = match filter.filter {
        PixelFilter::Weighted(shape) => shape.word(),
        PixelFilter::Min => "min",
        PixelFilter::Max => "max",
        PixelFilter::Average => "average",
        PixelFilter::Closest => return "closest".to_owned(),
    };
    let [x, y] = filter.width;
    format!("{word} {x} {y}")
}
