//! Values that are not finite.

use crate::Result;
use crate::image::{Image, Shape, Source, float_rows};
use granita_image::{PixelType, Pixels};
use rayon::prelude::*;
use std::sync::Arc;

/// A source in which NaN and infinite values are replaced.
struct Repaired {
    from: Arc<dyn Source>,
    /// True for the mean of the finite values around a place, false for 0.
    around: bool,
}

impl Source for Repaired {
    fn shape(&self) -> Shape {
        Shape { pixel_type: PixelType::Float, ..self.from.shape() }
    }

    fn rows(&self, y0: u32, y1: u32) -> Result<Pixels> {
        let shape = self.shape();
        let (n, width) = (shape.channels, shape.row());
        let margin = u32::from(self.around);
        let (first, last) = (y0.saturating_sub(margin), y1.saturating_add(margin).min(shape.height));
        let block = float_rows(&*self.from, first, last)?;
        let mut out = block[(y0 - first) as usize * width..][..(y1 - y0) as usize * width].to_vec();
        out.par_chunks_mut(width.max(1)).enumerate().for_each(|(i, row)| {
            let y = (y0 - first) as usize + i;
            let lines = y.saturating_sub(1)..(y + 2).min((last - first) as usize);
            for (at, v) in row.iter_mut().enumerate().filter(|(_, v)| !v.is_finite()) {
                *v = 0.0;
                if !self.around {
                    continue;
                }
                let (x, c) = (at / n, at % n);
                let columns = x.saturating_sub(1)..(x + 2).min(shape.width as usize);
                let (mut sum, mut count) = (0.0, 0.0_f32);
                for line in lines.clone() {
                    for x in columns.clone() {
                        let near = block[line * width + x * n + c];
                        if near.is_finite() {
                            sum += near;
                            count += 1.0;
                        }
                    }
                }
                if count > 0.0 {
                    *v = sum / count;
                }
            }
        });
        Ok(Pixels::Float(out))
    }

    fn any_order(&self) -> bool {
        self.from.any_order()
    }
}

impl Image {
    /// Returns an image in which NaN and infinite values are replaced: by 0, or with `around` by the mean of the finite
    /// values of the channel in the 3 x 3 pixels around them, and by 0 where there are none.
    #[must_use]
    pub fn finite(&self, around: bool) -> Self {
        let image = self.associated();
        image.with_source(Arc::new(Repaired { from: image.source.clone(), around }))
    }
}
