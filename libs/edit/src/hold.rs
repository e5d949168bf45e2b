//! Sources that keep rows of other sources.

use crate::Result;
use crate::image::{Shape, Source};
use granita_image::Pixels;
use parking_lot::Mutex;
use std::sync::Arc;

/// All pixels of an image in memory.
pub(crate) struct Held {
    pub(crate) shape: Shape,
    pub(crate) pixels: Pixels,
}

impl Held {
    /// Returns an image of floats.
    pub(crate) fn floats((width, height): (u32, u32), channels: usize, values: Vec<f32>) -> Self {
        let shape = Shape { width, height, channels, pixel_type: granita_image::PixelType::Float };
        Self { shape, pixels: Pixels::Float(values) }
    }
}

impl Source for Held {
    fn shape(&self) -> Shape {
        self.shape
    }

    fn rows(&self, y0: u32, y1: u32) -> Result<Pixels> {
        Ok(part(&self.pixels, &self.shape, y0, y1))
    }
}

/// Returns rows `y0..y1` of a block.
fn part(pixels: &Pixels, shape: &Shape, y0: u32, y1: u32) -> Pixels {
    let (from, count) = (y0 as usize * shape.row(), (y1 - y0) as usize * shape.row());
    let mut out = Pixels::zeros(shape.pixel_type, count);
    out.copy_from(0, pixels, from, count);
    out
}

/// A source whose rows are read in slabs, of which the last one is kept. It makes requests of decreasing rows cheap: a
/// file that is decoded from its beginning is decoded once for each slab.
pub(crate) struct Slabs {
    from: Arc<dyn Source>,
    rows: u32,
    last: Mutex<Option<(u32, Arc<Pixels>)>>,
}

impl Slabs {
    /// Returns a source whose slabs have at most `memory_bytes`, or one row.
    pub(crate) fn new(from: Arc<dyn Source>, memory_bytes: u64) -> Self {
        let shape = from.shape();
        let rows = (memory_bytes / shape.row_bytes().max(1)).clamp(1, u64::from(shape.height.max(1))) as u32;
        Self { from, rows, last: Mutex::new(None) }
    }

    /// Returns a slab.
    fn slab(&self, number: u32) -> Result<Arc<Pixels>> {
        let y0 = number * self.rows;
        let y1 = y0.saturating_add(self.rows).min(self.from.shape().height);
        let read = || self.from.rows(y0, y1).map(Arc::new);
        // A request from another thread does not wait.
        let Some(mut last) = self.last.try_lock() else { return read() };
        if let Some((held, pixels)) = &*last
            && *held == number
        {
            return Ok(pixels.clone());
        }
        // The memory of the old slab is returned before that of the new one is needed.
        *last = None;
        let pixels = read()?;
        *last = Some((number, pixels.clone()));
        Ok(pixels)
    }
}

impl Source for Slabs {
    fn shape(&self) -> Shape {
        self.from.shape()
    }

    fn rows(&self, y0: u32, y1: u32) -> Result<Pixels> {
        let shape = self.shape();
        let mut out = Pixels::zeros(shape.pixel_type, (y1 - y0) as usize * shape.row());
        let mut y = y0;
        while y < y1 {
            let number = y / self.rows;
            let top = number * self.rows;
            let end = top.saturating_add(self.rows).min(y1);
            let slab = self.slab(number)?;
            let from = (y - top) as usize * shape.row();
            out.copy_from((y - y0) as usize * shape.row(), &slab, from, (end - y) as usize * shape.row());
            y = end;
        }
        Ok(out)
    }
}
