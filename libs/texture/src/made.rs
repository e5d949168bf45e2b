//! Depth maps without a file: their tiles are made when they are looked at.

use crate::TextureId;
use granita_base::Transform;

/// A depth map that is no file: [`TextureCache::declare`](crate::TextureCache::declare).
#[derive(Clone, Copy, Debug)]
pub struct MadeShadow {
    /// Width and height in pixels.
    pub resolution: [u32; 2],
    /// Width and height of a tile.
    pub tile: u32,
    /// From "common" space to that of the light's camera, z being the depth.
    pub world_to_camera: Transform,
    /// From "common" space to the map, which spans -1 to 1 in x and y, y upwards.
    pub world_to_screen: Transform,
}

/// Makes the tiles of maps that were declared ([`TextureCache::declare`](crate::TextureCache::declare)).
///
/// A tile may be asked for again after the cache dropped it: it must be the same to the bit. Several threads ask at once.
pub trait TileMaker: Sync {
    /// The depths of tile (`tx`, `ty`) of a map, row by row from the top; what lies outside the map is not looked at.
    /// A tile of any other length than tile x tile counts as one in which nothing is.
    fn tile(&self, map: TextureId, tx: u32, ty: u32) -> Vec<f32>;
}
