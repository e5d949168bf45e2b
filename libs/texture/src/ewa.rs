//! The weighted mean of all texels of a level under an ellipse (Heckbert, Fundamentals of Texture Mapping and Image
//! Warping, 1989, section 3.5: elliptical weighted average). Rows are summed up in `simd`.

use crate::Wrap;
use crate::gaussian::{Gaussian, floor};
use crate::sampler::Sampler;
use crate::simd::{Row, Sums};

impl Sampler<'_> {
    /// Returns the mean of a level around (s, t), which are finite, under a Gaussian.
    pub(crate) fn gaussian(
        &mut self,
        level: usize,
        s: f32,
        t: f32,
        g: &Gaussian,
        wrap: (Wrap, Wrap),
    ) -> [f32; 4] {
        let l = self.level(level);
        let (width, height) = (l.width as i32, l.height as i32);
        let (cx, cy) = (wrap.0.reduce(s) * l.width as f32 - 0.5, wrap.1.reduce(t) * l.height as f32 - 0.5);
        let mut sums = Sums::new(g.xx, g.is_long());
        let (mut y, end) = (1 + floor(cy - g.reach.1), 1 + floor(cy + g.reach.1));
        // Nearly always the whole footprint lies inside of one tile. Rounding may place the end of a row one texel
        // farther, so the columns have a margin of one texel.
        let columns = (floor(cx - g.reach.0), 1 + floor(cx + g.reach.0));
        if columns.0 >= 0 && columns.1 < width && 0 <= y && y < end && end <= height {
            let tile = (columns.0 as u32 / l.tile_width, y as u32 / l.tile_height);
            let whole = columns.1 as u32 - tile.0 * l.tile_width < l.tile_width
                && end as u32 - tile.1 * l.tile_height <= l.tile_height;
            if whole && self.add_tile(level, tile, (y, end), ((cx, cy), g), &mut sums) {
                return self.mean_of(&sums).unwrap_or_else(|| self.bilinear(level, s, t, wrap));
            }
        }
        while y < end {
            // The rows up to the end of a tile, or those above or below the image.
            let to = match wrap.1 {
                Wrap::Periodic => {
                    let inside = y.rem_euclid(height) as u32;
                    let below = (inside / l.tile_height + 1) * l.tile_height;
                    y + (below.min(l.height) - inside) as i32
                }
                _ if y < 0 => 0,
                _ if y >= height => end,
                _ => (((y as u32 / l.tile_height + 1) * l.tile_height) as i32).min(height),
            };
            let rows = (y, to.min(end));
            y = rows.1;
            if !self.add_band(level, rows, wrap, ((cx, cy), g), &mut sums) {
                for y in rows.0..rows.1 {
                    self.add_row((level, (cx, cy), wrap), y, g, &mut sums);
                }
            }
        }
        self.mean_of(&sums).unwrap_or_else(|| self.bilinear(level, s, t, wrap))
    }

    /// Adds row `y` of an ellipse, which may lie anywhere.
    fn add_row(
        &mut self,
        (level, (cx, cy), wrap): (usize, (f32, f32), (Wrap, Wrap)),
        y: i32,
        g: &Gaussian,
        sums: &mut Sums,
    ) {
        let l = self.level(level);
        let (width, height) = (l.width as i32, l.height as i32);
        let dy = y as f32 - cy;
        let Some((mut x, end)) = g.row(cx, dy) else { return };
        let mut row = Row::new(g.exponents(dy), x as f32 - cx);
        let inside_y = wrap.1.index(y, height);
        while x < end {
            // Nearly always the whole row is inside. An image that repeats is read copy by copy.
            let inside =
                if wrap.0 == Wrap::Periodic && !(0..width).contains(&x) { x.rem_euclid(width) } else { x };
            if let (Some(y), true) = (inside_y, (0..width).contains(&inside)) {
                let most = (end - x).min(width - inside) as u32;
                x += self.add_run(level, (inside as u32, y as u32), most, &mut row, sums) as i32;
                continue;
            }
            let value = match (wrap.0.index(x, width), inside_y) {
                (Some(x), Some(y)) => self.raw_texel(level, x as u32, y as u32),
                _ => [0.0; 4],
            };
            sums.add(&mut row, value);
            x += 1;
        }
    }

    #[inline]
    pub(crate) fn mean_of(&self, sums: &Sums) -> Option<[f32; 4]> {
        sums.mean().map(|raw| raw.map(|v| self.file.number(v)))
    }
}
