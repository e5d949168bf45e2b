//! Maps of all directions in other layouts.

use crate::hold::Held;
use crate::image::{Image, Window, float_rows};
use crate::{EditError, Result};
use granita_base::Param;
use granita_texture::Up;
use granita_texture::make::{Directions, Panorama};
use std::sync::Arc;

impl Image {
    /// Returns a map of all directions in another layout. `size` is the width of a face of a cube, or of the whole of
    /// the other layouts; without it, the result has as many pixels per degree as the image. The display window is the
    /// map.
    ///
    /// The image and the result are held as floats.
    ///
    /// # Errors
    /// [`EditError::Limit`] when they need more than `memory_bytes`, [`EditError::Texture`] when the size does not fit
    /// the layout, and the error of reading.
    pub fn directions(
        &self,
        (from, to): (Directions, Directions),
        up: Up,
        size: Option<u32>,
        memory_bytes: u64,
    ) -> Result<Self> {
        let image = self.associated().crop_to_full()?;
        let shape = image.source.shape();
        let (width, height) = (shape.width as usize, shape.height as usize);
        let size = to.size(from.density((width, height))?, size.map(|n| n as usize));
        let values = |(w, h): (usize, usize)| {
            (w as u64).saturating_mul(h as u64).saturating_mul(shape.channels as u64)
        };
        let bytes = values((width, height)).saturating_add(values(size)).saturating_mul(4);
        if bytes > memory_bytes {
            let what = "MiB of memory for a map of directions, which -memory allows";
            let mib = |b: u64| b.div_ceil(1 << 20);
            return Err(EditError::Limit { what, asked: mib(bytes), max: mib(memory_bytes) });
        }
        let values = float_rows(&*image.source, 0, shape.height)?;
        let map = Panorama { width, height, channels: shape.channels, values };
        let map = map.converted((from, to), up, size)?;
        let (width, height) = (map.width as u32, map.height as u32);
        let held = Held::floats((width, height), map.channels, map.values);
        let mut image = image.with_source(Arc::new(held)).placed(0, 0)?;
        image.ready = true;
        image
            .spec
            .attributes
            .0
            .retain(|param: &Param| !matches!(&*param.name, "textureformat" | "wrapmodes"));
        image.with_full(Window { x: 0, y: 0, width, height })
    }
}
