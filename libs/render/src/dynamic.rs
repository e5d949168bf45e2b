//! Dynamic shadow maps (reference 10.1.5): depth maps that are rendered while shaders look at them.

use crate::frame::{FrameShader, OnDemand, Surroundings};
use crate::object::ObjectState;
use crate::output::plan::{OutputSet, is_dynamic};
use crate::{CameraView, RenderEnvironment, RenderError};
use granita_scene::Scene;
use granita_texture::{MadeShadow, TextureCache, TextureId};

/// Width and height of a tile in pixels.
const TILE: u32 = 64;

/// Depth where nothing is, as depth images have it.
const EMPTY: f32 = 1e30;

/// The maps of a frame.
#[derive(Default)]
pub(crate) struct DynamicMaps {
    maps: Vec<(TextureId, OnDemand<ObjectState>)>,
    threads: usize,
}

impl DynamicMaps {
    /// Declares the dynamic outputs of a scene. Renders nothing.
    ///
    /// Errors: as [`OutputSet::new`].
    pub(crate) fn new(
        scene: &Scene,
        views: &[CameraView],
        textures: &TextureCache,
        environment: &RenderEnvironment,
        threads: usize,
    ) -> Result<Self, RenderError> {
        let reporter = &environment.reporter;
        let mut maps = Vec::new();
        for output in scene.outputs.iter().filter(|o| is_dynamic(o)) {
            let Some(view) = views.iter().find(|v| v.name == output.camera) else { continue };
            let plan = OutputSet::new(&[output], view, &environment.registry, reporter)?;
            if plan.images.is_empty() {
                continue;
            }
            if view.eyes().is_some() {
                reporter.warning(format!(
                    "output \"{}\": a dynamic shadow map has one eye; that of its camera is used",
                    output.name
                ));
            }
            let map = OnDemand::new(view, plan, TILE);
            let made = MadeShadow {
                resolution: view.resolution,
                tile: TILE,
                world_to_camera: view.world_to_camera.at(view.shading_time()),
                world_to_screen: map.camera().world_to_clip(),
            };
            match textures.declare(&output.name, &made) {
                Some(id) => maps.push((id, map)),
                None => reporter.warning(format!(
                    "output \"{}\": there are two dynamic shadow maps of this name; the first one stays",
                    output.name
                )),
            }
        }
        Ok(Self { maps, threads })
    }

    /// The threads that render tiles.
    pub(crate) fn threads(&self) -> usize {
        self.threads
    }

    /// A tile of a map; nothing of one that is not among these.
    pub(crate) fn tile<S: FrameShader<Object = ObjectState>>(
        &self,
        map: TextureId,
        around: &Surroundings<'_, S>,
        (tx, ty): (u32, u32),
    ) -> Vec<f32> {
        let Some((_, map)) = self.maps.iter().find(|(id, _)| *id == map) else { return Vec::new() };
        map.tile(around, (tx, ty), EMPTY)
    }

    /// Whether there are any.
    pub(crate) fn is_empty(&self) -> bool {
        self.maps.is_empty()
    }
}
