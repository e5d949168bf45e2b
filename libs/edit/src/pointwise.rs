//! Sources whose values follow from the values at the same place.

use crate::Result;
use crate::image::{Shape, Source, float_rows};
use granita_image::{PixelType, Pixels};
use rayon::prelude::*;
use std::sync::Arc;

/// The values of a source, changed by a function of one row. The function receives the index of the row and its
/// values, channels interleaved.
pub(crate) struct Map<F> {
    shape: Shape,
    from: Arc<dyn Source>,
    change: F,
}

impl<F: Fn(u32, &mut [f32]) + Send + Sync> Map<F> {
    /// Returns a source of floats with the size of another one.
    pub(crate) fn new(like: &dyn Source, from: Arc<dyn Source>, change: F) -> Self {
        Self { shape: Shape { pixel_type: PixelType::Float, ..like.shape() }, from, change }
    }
}

impl<F: Fn(u32, &mut [f32]) + Send + Sync> Source for Map<F> {
    fn shape(&self) -> Shape {
        self.shape
    }

    fn rows(&self, y0: u32, y1: u32) -> Result<Pixels> {
        let mut values = float_rows(&*self.from, y0, y1)?;
        let rows = values.par_chunks_mut(self.shape.row().max(1)).enumerate();
        rows.for_each(|(i, row)| (self.change)(y0 + i as u32, row));
        Ok(Pixels::Float(values))
    }

    fn any_order(&self) -> bool {
        self.from.any_order()
    }
}

/// The values of several sources of one size, combined by a function of one row. The function receives the row of the
/// first source, which it replaces, and the rows of the others.
pub(crate) struct Combine<F> {
    shape: Shape,
    from: Vec<Arc<dyn Source>>,
    change: F,
}

impl<F: Fn(&mut [f32], &[&[f32]]) + Send + Sync> Combine<F> {
    /// Returns a source of floats. There is at least one source.
    pub(crate) fn new(from: Vec<Arc<dyn Source>>, change: F) -> Self {
        Self { shape: Shape { pixel_type: PixelType::Float, ..from[0].shape() }, from, change }
    }
}

impl<F: Fn(&mut [f32], &[&[f32]]) + Send + Sync> Source for Combine<F> {
    fn shape(&self) -> Shape {
        self.shape
    }

    fn rows(&self, y0: u32, y1: u32) -> Result<Pixels> {
        let mut first = float_rows(&*self.from[0], y0, y1)?;
        let others = self.from[1..].iter().map(|s| float_rows(&**s, y0, y1)).collect::<Result<Vec<_>>>()?;
        let width = self.shape.row().max(1);
        first.par_chunks_mut(width).enumerate().for_each(|(i, row)| {
            let rows: Vec<&[f32]> = others.iter().map(|v| &v[i * width..][..row.len()]).collect();
            (self.change)(row, &rows);
        });
        Ok(Pixels::Float(first))
    }

    fn any_order(&self) -> bool {
        self.from.iter().all(|s| s.any_order())
    }
}
