//! Writes tiles into the file.

use super::{Costs, MakeOptions, Progress};
use crate::error::Result;
use granita_image::{BlockCopy, CreateOptions, FormatRegistry, ImageOutput, ImageSpec, Pixels};
use rayon::prelude::*;
use std::path::Path;
use std::time::Instant;

/// A tile with its column and row.
pub(crate) type Tile = (u32, u32, Pixels);

/// A file that is being written, all its levels at once where the format permits that.
pub(crate) struct Writer<'a> {
    output: Box<dyn ImageOutput>,
    specs: Vec<ImageSpec>,
    /// True when tiles of any level may be written at any time. Otherwise those of later levels wait.
    any_order: bool,
    waiting: Vec<Vec<Tile>>,
    progress: Progress<'a>,
    done: u64,
    total: u64,
    pub(crate) costs: Costs,
}

impl<'a> Writer<'a> {
    /// Begins a file with these levels.
    pub(crate) fn create(
        path: &Path,
        specs: Vec<ImageSpec>,
        options: &MakeOptions,
        registry: &FormatRegistry,
        progress: Progress<'a>,
    ) -> Result<Self> {
        let create = CreateOptions::new(&specs[0], specs.len());
        let mut output = registry.create(path, &options.format, &create)?;
        let any_order = specs.len() > 1 && output.plan_levels(&specs[1..])?;
        let total = specs.iter().map(|s| u64::from(s.tiles().0) * u64::from(s.tiles().1)).sum();
        progress(0, total);
        let waiting = specs.iter().map(|_| Vec::new()).collect();
        let costs = Costs::default();
        Ok(Self { output, specs, any_order, waiting, progress, done: 0, total, costs })
    }

    /// Writes tiles of a level. They are compressed in the threads of the pool, and stored in this order.
    pub(crate) fn write(&mut self, level: usize, mut tiles: Vec<Tile>) -> Result<()> {
        if tiles.is_empty() {
            return Ok(());
        }
        if !self.any_order && level > 0 {
            self.waiting[level].append(&mut tiles);
            return Ok(());
        }
        if self.any_order {
            self.output.select_level(level)?;
        }
        self.put(&tiles)
    }

    fn put(&mut self, tiles: &[Tile]) -> Result<()> {
        let start = Instant::now();
        self.output.write_tiles(tiles)?;
        self.costs.write += start.elapsed();
        self.done += tiles.len() as u64;
        (self.progress)(self.done, self.total);
        Ok(())
    }

    /// Completes the file under its final name.
    pub(crate) fn finish(mut self) -> Result<Costs> {
        if !self.any_order {
            for level in 1..self.specs.len() {
                self.output.next_level(&self.specs[level])?;
                let tiles = std::mem::take(&mut self.waiting[level]);
                self.put(&tiles)?;
            }
        }
        let start = Instant::now();
        self.output.close()?;
        self.costs.close = start.elapsed();
        Ok(self.costs)
    }
}

/// The rows of one level that do not fill a row of tiles yet.
pub(crate) struct Shelf {
    spec: ImageSpec,
    rows: Pixels,
    filled: usize,
    ty: u32,
}

impl Shelf {
    /// Returns an empty shelf for a tiled level.
    pub(crate) fn new(spec: &ImageSpec) -> Self {
        Self { spec: spec.clone(), rows: Pixels::zeros(spec.pixel_type, 0), filled: 0, ty: 0 }
    }

    /// Returns the pixel type of the level.
    pub(crate) fn pixel_type(&self) -> granita_image::PixelType {
        self.spec.pixel_type
    }

    /// Adds whole rows. Returns the tiles that became complete, row by row. Texels of a tile outside the image are 0.
    pub(crate) fn push(&mut self, pixels: &Pixels) -> Vec<Tile> {
        let row = self.spec.width as usize * self.spec.nchannels();
        let count = pixels.len() / row;
        let mut tiles = Vec::new();
        let mut done = 0;
        while done < count {
            let needed =
                self.spec.tile_height.min(self.spec.height - self.ty * self.spec.tile_height) as usize;
            if self.filled == 0 && count - done >= needed {
                self.cut(pixels, done, needed, &mut tiles);
                done += needed;
                continue;
            }
            if self.rows.is_empty() {
                let size = self.spec.tile_height.min(self.spec.height) as usize * row;
                self.rows = Pixels::zeros(self.spec.pixel_type, size);
            }
            let take = (needed - self.filled).min(count - done);
            self.rows.copy_from(self.filled * row, pixels, done * row, take * row);
            self.filled += take;
            done += take;
            if self.filled == needed {
                let rows = std::mem::replace(&mut self.rows, Pixels::zeros(self.spec.pixel_type, 0));
                self.cut(&rows, 0, needed, &mut tiles);
                self.rows = rows;
                self.filled = 0;
            }
        }
        tiles
    }

    /// Cuts `rows` rows, from row `y` on, into the next row of tiles.
    fn cut(&mut self, pixels: &Pixels, y: usize, rows: usize, tiles: &mut Vec<Tile>) {
        let (spec, ty) = (&self.spec, self.ty);
        let n = spec.tile_width as usize * spec.tile_height as usize * spec.nchannels();
        tiles.par_extend((0..spec.tiles().0).into_par_iter().map(|tx| {
            let mut tile = Pixels::zeros(spec.pixel_type, n);
            let x = tx * spec.tile_width;
            BlockCopy {
                from_width: spec.width as usize,
                from: (x as usize, y),
                to_width: spec.tile_width as usize,
                to: (0, 0),
                size: (spec.tile_width.min(spec.width - x) as usize, rows),
                nchannels: spec.nchannels(),
            }
            .run(pixels, &mut tile);
            (tx, ty, tile)
        }));
        self.ty += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_image::PixelType;

    #[test]
    fn batches_of_rows_make_the_same_tiles() {
        let spec = ImageSpec::new(10, 7, 2, PixelType::U16).tiled(4, 3);
        let all = Pixels::U16((1..=140).collect());
        let whole = Shelf::new(&spec).push(&all);
        assert_eq!(whole.len(), 9);
        assert_eq!(whole[8].2.get(0), 137.0 / 65535.0);
        assert_eq!(whole[8].2.get(4), 0.0);
        for portion in 1..7 {
            let mut shelf = Shelf::new(&spec);
            let mut got = Vec::new();
            for y in (0..7).step_by(portion) {
                let rows = portion.min(7 - y);
                let mut part = Pixels::zeros(PixelType::U16, rows * 20);
                part.copy_from(0, &all, y * 20, rows * 20);
                got.extend(shelf.push(&part));
            }
            assert_eq!(got, whole);
        }
    }
}
