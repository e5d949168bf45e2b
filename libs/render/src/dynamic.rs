//! Dynamic shadow maps (reference 10.1.5), which are depth maps that are rendered on demand while shaders look them
//! up.

use crate::frame::{OnDemand, Surroundings};
use crate::output::plan::{OutputSet, is_dynamic};
use crate::{CameraView, RenderEnvironment, RenderError};
use granita_scene::Scene;
use granita_shading::{DepthMaps, ObjectState, ShadingContext};
use granita_texture::{MadeShadow, TextureCache, TextureId};

/// The width and height of a tile in pixels.
const TILE: u32 = 64;

/// The depth of empty pixels, as in depth images.
const EMPTY: f32 = 1e30;

/// The maps of a frame.
pub(crate) struct DynamicMaps {
    maps: Vec<(TextureId, OnDemand<ObjectState>)>,
    threads: usize,
}

impl DynamicMaps {
    /// Declares the dynamic outputs of a scene. Renders nothing.
    ///
    /// # Errors
    /// Returns the errors of [`OutputSet::new`].
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
                    "output \"{}\": a dynamic shadow map has one view; that of its camera is used",
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
                    "output \"{}\": there are two dynamic shadow maps of this name; the first one is used",
                    output.name
                )),
            }
        }
        Ok(Self { maps, threads })
    }

    /// True when there are no dynamic maps.
    pub(crate) fn is_empty(&self) -> bool {
        self.maps.is_empty()
    }
}

impl DepthMaps for DynamicMaps {
    /// Returns an empty tile for a map that is not one of these.
    fn tile(&self, frame: &ShadingContext, map: TextureId, tile: [u32; 2]) -> Vec<f32> {
        let Some((_, map)) = self.maps.iter().find(|(id, _)| *id == map) else { return Vec::new() };
        let around = Surroundings {
            scene: &frame.scene,
            shader: frame,
            dicing_camera: &frame.camera,
            threads: self.threads,
            reporter: &frame.reporter,
        };
        map.tile(&around, tile, EMPTY)
    }
}
