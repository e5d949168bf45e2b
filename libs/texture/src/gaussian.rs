//! The weighted mean of all texels of a level under an ellipse (Heckbert, Fundamentals of Texture Mapping and Image
//! Warping, 1989, section 3.5: elliptical weighted average).
//!
//! Weights are a Gaussian that is cut off at [`CUT`] deviations. It is made wider by as much as the cut takes from
//! its variance, and narrower by the variance of a texel, so that the whole has the spread of the footprint. Rows are
//! summed up in `simd`.

use crate::Wrap;
use crate::file::TextureFile;
use crate::footprint::Spread;
use crate::sampler::Sampler;
use crate::simd::{Exponents, Row, Sums};

/// Where the Gaussian ends, in its deviations.
pub(crate) const CUT: f32 = 3.0;

/// What is left of its variance, in each direction, when it is lowered by what it is there, so that it ends at 0:
/// `1 - (h^2 / 2) e / (1 - (1 + h) e)` with `h = CUT^2 / 2`, `e = exp (-h)`.
pub(crate) const KEPT: f64 = 0.880_202;

/// Variance of a texel.
const TEXEL: f64 = 1.0 / 12.0;

/// The largest whole number that is not above `x`; the instruction for it is not everywhere, and the library's function
/// is slow.
#[inline(always)]
fn floor(x: f32) -> i32 {
    let whole = x as i32;
    whole - i32::from(x < whole as f32)
}

/// A Gaussian around (0, 0), in texels: `2^(xx x^2 + xy x y + yy y^2)`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gaussian {
    xx: f32,
    xy: f32,
    yy: f32,
    /// Half of its extent in x and y.
    reach: (f32, f32),
    /// Where the middle of a row stands, per step in y.
    slant: f32,
    /// Square of half a row's length at the centre, and what it loses per squared step in y.
    half: (f32, f32),
}

impl Gaussian {
    /// For a footprint of these squared full widths in texels; both widths of the ellipse are at least 1.
    pub(crate) fn new(spread: Spread) -> Self {
        let variance = |squared: f64, texel: f64| (0.25 * squared - texel) * (1.0 / KEPT);
        let (xx, xy, yy) = (variance(spread.xx, TEXEL), variance(spread.xy, 0.0), variance(spread.yy, TEXEL));
        let determinant = xx * yy - xy * xy;
        // Of the exponent's matrix, and of one half and the base of the logarithm.
        let scale = -0.5 * std::f64::consts::LOG2_E / determinant;
        let cut = f64::from(CUT * CUT);
        let per_yy = 1.0 / yy;
        Self {
            xx: (yy * scale) as f32,
            xy: (-2.0 * xy * scale) as f32,
            yy: (xx * scale) as f32,
            reach: (((cut * xx) as f32).sqrt(), ((cut * yy) as f32).sqrt()),
            slant: (xy * per_yy) as f32,
            half: ((cut * determinant * per_yy) as f32, (determinant * per_yy * per_yy) as f32),
        }
    }

    /// The first texel that is covered in the row at `dy` from the centre, and the first after them; the centre is at
    /// `cx`.
    #[inline(always)]
    pub(crate) fn row(&self, cx: f32, dy: f32) -> Option<(i32, i32)> {
        let squared = self.half.0 - self.half.1 * dy * dy;
        (squared >= 0.0).then(|| {
            let (middle, half) = (cx + self.slant * dy, squared.sqrt());
            (1 + floor(middle - half), 1 + floor(middle + half))
        })
    }

    /// Of the row at `dy`.
    #[inline(always)]
    pub(crate) fn exponents(&self, dy: f32) -> Exponents {
        Exponents { a: self.xx, b: self.xy * dy, c: self.yy * dy * dy }
    }
}

impl Sampler<'_> {
    /// Mean of a level around (s, t), finite, under a Gaussian.
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
        // Nearly always all of it is inside of one tile; rounding may place a row's end by a texel otherwise.
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
                // Nearly always the whole row is inside; a picture that repeats is taken copy by copy.
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

impl TextureFile {
    /// A stored number as what lookups give.
    #[inline]
    pub(crate) fn number(&self, raw: f32) -> f32 {
        crate::tiles::from_raw(self.pixel_type, raw)
    }
}
