//! Images whose noise is removed: whether a frame is, and the library that does it.

use granita_base::{Files, Location, Reporter, Severity};
use granita_image::Denoiser;
use granita_plugin::OpenImageDenoise;
use granita_scene::{Scene, attr};
use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// The factor of the samples of lights and rays with "render:denoise" 1. Surfaces then have four times as many points,
/// so that the number of rays stays the same.
const SAMPLES: f32 = 0.25;

/// Returns the "render:denoise" of a frame: what the scene says, or 1 with the option `-denoise`. It is 0, with a
/// warning, where noise cannot be removed.
pub(crate) fn requested(scene: &Scene, is_asked: bool, is_safe: bool, reporter: &Reporter) -> i32 {
    let warn = |text: String| reporter.once(&text.clone(), Severity::Warning, &Location::default(), text);
    let asked = match scene.get(attr::RENDER_DENOISE) {
        0 => i32::from(is_asked),
        asked @ 1..=2 => asked,
        other => {
            warn(format!("\"render:denoise\" {other} is not 0, 1 or 2; 1 is used"));
            1
        }
    };
    let refused = if is_safe {
        "\"render:denoise\" loads a library, which -safe does not permit"
    } else {
        "\"render:denoise\" has no part in re-rendering"
    };
    if asked != 0 && (is_safe || scene.get(attr::RERENDER)) {
        warn(format!("images keep their noise: {refused}"));
        return 0;
    }
    asked
}

/// Returns a scene with this "render:denoise", and with the samples that it needs.
pub(crate) fn prepared(scene: &Arc<Scene>, denoise: i32) -> Arc<Scene> {
    if denoise == 0 && scene.get(attr::RENDER_DENOISE) == 0 {
        return scene.clone();
    }
    let mut scene = (**scene).clone();
    let mut set = vec![attr::RENDER_DENOISE.param(denoise)];
    if denoise == 1 {
        set.push(attr::RENDER_SAMPLES.param(SAMPLES * scene.get(attr::RENDER_SAMPLES)));
    }
    scene.globals.extend(set.into_iter().map(|param| (param.name.clone(), param)));
    Arc::new(scene)
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
