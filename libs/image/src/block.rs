//! Copies of rectangles of pixels between rows and tiles.

use crate::{ImageSpec, Pixels};
use rayon::prelude::*;

/// A rectangle to copy from one block of interleaved pixels to another.
#[derive(Clone, Copy, Debug)]
pub struct BlockCopy {
    /// The number of pixels per row of the source.
    pub from_width: usize,
    /// The column and row of the rectangle in the source.
    pub from: (usize, usize),
    /// The number of pixels per row of the destination.
    pub to_width: usize,
    /// The column and row of the rectangle in the destination.
    pub to: (usize, usize),
    /// The numbers of columns and rows of the rectangle.
    pub size: (usize, usize),
    /// The number of channels per pixel, in both.
    pub nchannels: usize,
}

impl BlockCopy {
    /// Copies the rectangle.
    ///
    /// # Panics
    /// The panics of [`Pixels::copy_from`], for different types or a rectangle that is not inside both.
    pub fn run(&self, source: &Pixels, destination: &mut Pixels) {
        let n = self.nchannels;
        for row in 0..self.size.1 {
            let from = ((self.from.1 + row) * self.from_width + self.from.0) * n;
            let to = ((self.to.1 + row) * self.to_width + self.to.0) * n;
            destination.copy_from(to, source, from, self.size.0 * n);
        }
    }
}

/// Collects the rows of a tiled level and returns rows of tiles.
///
/// It is for writers that receive rows of an image that is stored in tiles.
#[derive(Debug)]
pub struct TileRows {
    rows: Pixels,
    filled: usize,
    next_y: u32,
}

impl TileRows {
    /// Returns a buffer for one row of tiles of `spec`, which must be tiled.
    pub fn new(spec: &ImageSpec) -> Self {
        let n = spec.width as usize * spec.tile_height as usize * spec.nchannels();
        Self { rows: Pixels::zeros(spec.pixel_type, n), filled: 0, next_y: 0 }
    }

    /// Returns the next row of the image.
    pub fn next_y(&self) -> u32 {
        self.next_y
    }

    /// Adds rows (a whole number of them, no more than the image has left) and calls `tile(tx, ty, pixels)` for every
    /// tile that became complete. Missing parts of edge tiles are 0.
    ///
    /// # Errors
    /// The errors of `tile`.
    pub fn push<E>(
        &mut self,
        spec: &ImageSpec,
        pixels: &Pixels,
        mut tile: impl FnMut(u32, u32, &Pixels) -> Result<(), E>,
    ) -> Result<(), E> {
        let stride = spec.width as usize * spec.nchannels();
        let total = pixels.len() / stride.max(1);
        let mut done = 0;
        while done < total {
            let ty = self.next_y / spec.tile_height;
            let in_tile = (spec.tile_height.min(spec.height - ty * spec.tile_height)) as usize;
            let take = (in_tile - self.filled).min(total - done);
            self.rows.copy_from(self.filled * stride, pixels, done * stride, take * stride);
            self.filled += take;
            self.next_y += take as u32;
            done += take;
            if self.filled == in_tile {
                for tx in 0..spec.tiles().0 {
                    tile(tx, ty, &cut_tile(&self.rows, spec, tx, in_tile))?;
                }
                self.filled = 0;
            }
        }
        Ok(())
    }
}

/// Returns tile `tx` of one row of tiles of `spec` with `height` rows. The rest of the tile is 0.
fn cut_tile(rows: &Pixels, spec: &ImageSpec, tx: u32, height: usize) -> Pixels {
    let n = spec.tile_width as usize * spec.tile_height as usize * spec.nchannels();
    let mut tile = Pixels::zeros(spec.pixel_type, n);
    let x = tx * spec.tile_width;
    BlockCopy {
        from_width: spec.width as usize,
        from: (x as usize, 0),
        to_width: spec.tile_width as usize,
        to: (0, 0),
        size: (spec.tile_width.min(spec.width - x) as usize, height),
        nchannels: spec.nchannels(),
    }
    .run(rows, &mut tile);
    tile
}

/// Returns rows `y0..y1` of a tiled level, assembled from its tiles, which `tile(tx, ty)` returns. Tiles beside each
/// other are read at once, in the threads of the caller's pool.
///
/// The range must be inside of the level. The caller has checked the size of the result.
///
/// # Errors
/// An error of `tile`. Of several errors it is one of them.
pub fn rows_from_tiles<E: Send>(
    spec: &ImageSpec,
    y0: u32,
    y1: u32,
    tile: impl Fn(u32, u32) -> Result<Pixels, E> + Sync,
) -> Result<Pixels, E> {
    let n = spec.nchannels();
    let mut out = Pixels::zeros(spec.pixel_type, spec.width as usize * (y1 - y0) as usize * n);
    if y0 == y1 {
        return Ok(out);
    }
    for ty in y0 / spec.tile_height..=(y1 - 1) / spec.tile_height {
        let top = ty * spec.tile_height;
        let (first, last) = (y0.max(top), y1.min(top.saturating_add(spec.tile_height)));
        let across = spec.tiles().0;
        let tiles: Vec<Pixels> = if across == 1 {
            vec![tile(0, ty)?]
        } else {
            (0..across).into_par_iter().map(|tx| tile(tx, ty)).collect::<Result<_, E>>()?
        };
        for (tx, tile) in (0..across).zip(&tiles) {
            let left = tx * spec.tile_width;
            BlockCopy {
                from_width: spec.tile_width as usize,
                from: (0, (first - top) as usize),
                to_width: spec.width as usize,
                to: (left as usize, (first - y0) as usize),
                size: (spec.tile_width.min(spec.width - left) as usize, (last - first) as usize),
                nchannels: n,
            }
            .run(tile, &mut out);
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::PixelType;
    use std::convert::Infallible;

    #[test]
    fn rows_survive_conversion_to_tiles_and_back() {
        for (w, h, tw, th, step) in [(10, 7, 4, 3, 1), (10, 7, 4, 3, 2), (10, 7, 16, 16, 7), (1, 1, 8, 8, 1)]
        {
            let spec = ImageSpec::new(w, h, 2, PixelType::U16).tiled(tw, th);
            let values: Vec<u16> = (0..w * h * 2).map(|i| i as u16 + 1).collect();
            let mut tiles = std::collections::BTreeMap::new();
            let mut rows = TileRows::new(&spec);
            for chunk in values.chunks((w * 2 * step) as usize) {
                let pushed = rows.push(&spec, &Pixels::U16(chunk.to_vec()), |x, y, p| {
                    assert!(tiles.insert((x, y), p.clone()).is_none());
                    Ok::<_, Infallible>(())
                });
                assert!(pushed.is_ok());
            }
            assert_eq!(rows.next_y(), h);
            for y0 in 0..=h {
                for y1 in y0..=h {
                    let get = |x, y| Ok::<_, Infallible>(tiles[&(x, y)].clone());
                    let Ok(got) = rows_from_tiles(&spec, y0, y1, get);
                    let expected = &values[(y0 * w * 2) as usize..(y1 * w * 2) as usize];
                    assert_eq!(got, Pixels::U16(expected.to_vec()));
                }
            }
        }
    }
}
