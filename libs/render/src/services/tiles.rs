//! Tiles of dynamic shadow maps (reference 10.1.5), rendered for the shaders that look at them.

use crate::frame::Surroundings;
use crate::shading::ShadingContext;
use granita_texture::{TextureId, TileMaker};

/// Renders tiles for the shaders of a frame.
pub(super) struct Maker<'f>(pub(super) &'f ShadingContext);

impl TileMaker for Maker<'_> {
    fn tile(&self, map: TextureId, tx: u32, ty: u32) -> Vec<f32> {
        let frame = self.0;
        let around = Surroundings {
            scene: &frame.scene,
            shader: frame,
            dicing_camera: &frame.camera,
            threads: frame.dynamic.threads(),
            reporter: &frame.reporter,
        };
        frame.dynamic.tile(map, &around, (tx, ty))
    }
}
