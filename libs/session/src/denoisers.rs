//! Images whose noise is removed: how their frames are rendered, and the library that does it.
//!
//! The library expects noise that is independent from pixel to pixel. A filter that is wider than a pixel shares
//! samples between pixels, and the points of a surface share their colours with the pixels around them. So these
//! images have a box filter of one pixel, and surfaces have points twice as close along each side, with a quarter of
//! the samples of lights and rays at each.

use granita_base::{Files, Location, Param, Reporter, Severity};
use granita_image::Denoiser;
use granita_plugin::OpenImageDenoise;
use granita_scene::{Output, Scene, attr};
use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// How the noise of a frame is removed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Denoising {
    /// It is not.
    Off,
    /// Surfaces have more points with fewer samples each.
    Finer,
    /// Surfaces and samples are as the scene says.
    AsItIs,
}

impl Denoising {
    /// Returns what a scene or the option `-denoise` requests.
    pub(crate) fn of(scene: &Scene, is_asked: bool, is_safe: bool, reporter: &Reporter) -> Self {
        let asked = match scene.get(attr::RENDER_DENOISE) {
            0 if is_asked => Self::Finer,
            0 => return Self::Off,
            2 => Self::AsItIs,
            _ => Self::Finer,
        };
        let refuse = |why: &str| {
            let text = format!("images keep their noise: {why}");
            reporter.once(&text.clone(), Severity::Warning, &Location::default(), text);
            Self::Off
        };
        if is_safe {
            return refuse("\"render:denoise\" loads a library, which -safe does not permit");
        }
        if scene.get(attr::RERENDER) {
            return refuse("\"render:denoise\" has no part in re-rendering");
        }
        asked
    }

    /// Returns the factor of "shadingquality".
    pub(crate) fn finer(self) -> f32 {
        if self == Self::Finer { 2.0 } else { 1.0 }
    }

    /// Returns a scene whose frame is denoised.
    pub(crate) fn prepared(self, scene: &Arc<Scene>) -> Arc<Scene> {
        let mut scene = (**scene).clone();
        scene.outputs.iter_mut().filter(|output| output.get(attr::DENOISE)).for_each(sharpen);
        if self == Self::Finer {
            let points = self.finer() * self.finer();
            let samples = attr::RENDER_SAMPLES.param(scene.get(attr::RENDER_SAMPLES) / points);
            scene.globals.insert(samples.name.clone(), samples);
        }
        Arc::new(scene)
    }
}

/// Gives the colours of an image the filter that shares no samples between pixels.
fn sharpen(output: &mut Output) {
    let is_color =
        |data: &str| matches!(data, "rgb" | "rgba") || data.starts_with("color ") && !data.ends_with(']');
    let names: Vec<String> = output.layers().filter(|data| is_color(data)).map(str::to_owned).collect();
    let is_one_of = output.layers().count() > 1;
    for data in names {
        let mut filter: Param = attr::FILTER.param("box".into());
        if is_one_of {
            let name = data.split_whitespace().last().unwrap_or(&data);
            filter.name = format!("filter:{name}").into();
        }
        output.params.set(filter);
        output.params.set(attr::FILTERWIDTH.param([1.0; 2]));
    }
}

/// The libraries that scenes named, by their names; `None` for one that cannot be used.
#[derive(Default)]
pub(crate) struct Denoisers(Mutex<BTreeMap<Arc<str>, Option<Arc<OpenImageDenoise>>>>);

impl Denoisers {
    /// Returns the library for a scene; `None` (reported once) when there is none.
    pub(crate) fn of(&self, scene: &Scene, files: &Files, reporter: &Reporter) -> Option<Arc<dyn Denoiser>> {
        let name = scene.get(attr::RENDER_DENOISELIBRARY);
        let mut known = self.0.lock();
        if let Some(known) = known.get(&name) {
            return known.clone().map(|library| library as Arc<dyn Denoiser>);
        }
        let place = (!name.is_empty()).then(|| files.place(Path::new(&*name)));
        let found = OpenImageDenoise::find(place.as_deref());
        let found = found.map_err(|error| reporter.error(format!("images keep their noise: {error}")));
        let library = found.ok().map(Arc::new);
        known.insert(name, library.clone());
        library.map(|library| library as Arc<dyn Denoiser>)
    }
}
