//! Pixels in memory, as the source of a page.

use crate::Result;
use crate::source::{Access, Source};
use crate::tile::{TILE, Tile, tile_size};
use granita_image::{PixelType, Pixels};

/// An image of floats in memory.
pub(crate) struct Plane {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) channels: usize,
    /// The values: rows from the top, and all channels of a pixel one after the other.
    pub(crate) values: Vec<f32>,
}

impl Source for Plane {
    fn levels(&self) -> usize {
        1
    }

    fn size(&self, _level: usize) -> (u32, u32) {
        (self.width, self.height)
    }

    fn channels(&self) -> usize {
        self.channels
    }

    fn pixel_type(&self) -> PixelType {
        PixelType::Float
    }

    fn access(&self) -> Access {
        Access::Tiles
    }

    fn read(&self, _level: usize, tx: u32, ty: u32) -> Result<Vec<((u32, u32), Tile)>> {
        let (width, height) = tile_size((self.width, self.height), tx, ty);
        let row = |y: u32| {
            let at = (ty * TILE + y) as usize * self.width as usize + (tx * TILE) as usize;
            &self.values[at * self.channels..(at + width as usize) * self.channels]
        };
        let pixels = Pixels::Float((0..height).flat_map(row).copied().collect());
        Ok(vec![((tx, ty), Tile { width, height, channels: self.channels, pixels, missing: false })])
    }
}
