//! Depth maps without a file, whose tiles are made on demand.

use crate::TextureId;
use granita_base::Transform;

/// A depth map without a file, for [`TextureCache::declare`](crate::TextureCache::declare).
#[derive(Clone, Copy, Debug)]
pub struct MadeShadow {
    /// The width and height in pixels.
    pub resolution: [u32; 2],
    /// The width and height of a tile in pixels.
    pub tile: u32,
    /// The transformation from "common" space to that of the light's camera, where z is the depth.
    pub world_to_camera: Transform,
    /// The transformation from "common" space to the map, which spans -1 to 1 in x and y, with y upward.
    pub world_to_screen: Transform,
}

/// Makes the tiles of declared maps ([`TextureCache::declare`](crate::TextureCache::declare)).
///
/// A tile may be requested again after the cache dropped it, and must then be the same to the bit. Several threads
/// call it at once.
pub trait TileMaker: Sync {
    /// Returns the depths of tile (`tx`, `ty`) of a map, row by row from the top. Values outside the map are not
    /// used. A tile of any other length than tile x tile counts as empty.
    fn tile(&self, map: TextureId, tx: u32, ty: u32) -> Vec<f32>;
}
