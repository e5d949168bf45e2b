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
        let mut sums = Sums::new(g.xx, g.reach.0 > 3.5);
        let rows = (1 + floor(cy - g.reach.1), floor(cy + g.reach.1));
        // Nearly always the whole footprint lies inside of one tile. Rounding may place the end of a row one texel
        // farther, so the columns have a margin of one texel.
        let (left, right) = (floor(cx - g.reach.0), 1 + floor(cx + g.reach.0));
        let whole = left >= 0 && rows.0 >= 0 && right < width && rows.1 < height;
        if whole && self.add_rows(level, (left, right), rows, ((cx, cy), g), &mut sums) {
            return self.mean_of(&sums).unwrap_or_else(|| self.bilinear(level, s, t, wrap));
        }
        for y in rows.0..=rows.1 {
            let dy = y as f32 - cy;
            let Some((mut x, end)) = g.row(cx, dy) else { continue };
            let mut row = Row::new(g.exponents(dy), x as f32 - cx);
            let inside_y = wrap.1.index(y, height);
            while x < end {
                // Nearly always the whole row is inside. An image that repeats is read copy by copy.
                let inside = if wrap.0 == Wrap::Periodic && !(0..width).contains(&x) {
                    x.rem_euclid(width)
                } else {
                    x
                };
                if let (Some(y), true) = (inside_y, (0..width).contains(&inside)) {
                    let most = (end - x).min(width - inside) as u32;
                    x += self.add_run(level, (inside as u32, y as u32), most, &mut row, &mut sums) as i32;
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
        self.mean_of(&sums).unwrap_or_else(|| self.bilinear(level, s, t, wrap))
    }

    #[inline]
    pub(crate) fn mean_of(&self, sums: &Sums) -> Option<[f32; 4]> {
        sums.mean().map(|raw| raw.map(|v| self.file.number(v)))
    }
}
