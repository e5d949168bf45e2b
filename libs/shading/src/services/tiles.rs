//! Tiles of dynamic shadow maps (reference 10.1.5), rendered for the shaders that look them up.

use crate::{DepthMaps, ShadingContext};
use granita_texture::{TextureId, TileMaker};

/// Renders tiles for the shaders of a frame.
pub(super) struct Maker<'f> {
    pub(super) frame: &'f ShadingContext,
    pub(super) maps: &'f dyn DepthMaps,
}

impl TileMaker for Maker<'_> {
    fn tile(&self, map: TextureId, tx: u32, ty: u32) -> Vec<f32> {
        self.maps.tile(self.frame, map, [tx, ty])
    }
}
