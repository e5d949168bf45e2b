//! The size and tiling of MIP levels.

/// The size and tiling of one MIP level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Level {
    /// The size in texels of the whole image.
    pub(crate) width: u32,
    pub(crate) height: u32,
    /// The size of one face, or of the whole image when it is not a cube.
    pub(crate) face_width: u32,
    pub(crate) face_height: u32,
    /// The distance between the upper left corners of neighbouring faces.
    pub(crate) step_x: u32,
    pub(crate) step_y: u32,
    /// The size of a tile, or the whole level when it is held in memory.
    pub(crate) tile_width: u32,
    pub(crate) tile_height: u32,
}

/// Returns the level of an image that is not a cube.
pub(crate) fn plain_level(width: u32, height: u32, tile: (u32, u32)) -> Level {
    Level {
        width,
        height,
        face_width: width,
        face_height: height,
        step_x: width,
        step_y: height,
        tile_width: tile.0,
        tile_height: tile.1,
    }
}
