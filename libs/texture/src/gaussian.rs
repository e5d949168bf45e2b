//! The weighted mean of all texels of a level under an ellipse (Heckbert, Fundamentals of Texture Mapping and Image
//! Warping, 1989, section 3.5: elliptical weighted average).
//!
//! Weights are a Gaussian that is cut off at [`CUT`] deviations. It is made wider by as much as the cut takes from
//! its variance, and narrower by the variance of a texel, so that the whole has the spread of the footprint.

use crate::Wrap;
use crate::footprint::Spread;
use crate::sampler::Sampler;

/// Where the Gaussian ends, in its deviations.
const CUT: f32 = 3.0;

/// What it is there, and is lowered by, so that it ends at 0: `e = exp (-h)` with `h = CUT^2 / 2`.
const FLOOR: f32 = 0.011_109;

/// What is left of its variance, in each direction: `1 - (h^2 / 2) e / (1 - (1 + h) e)`.
const KEPT: f64 = 0.880_202;

/// Variance of a texel.
const TEXEL: f64 = 1.0 / 12.0;

/// `exp (x)` for `x` in [-80, 80], other numbers taken to these, within 1e-6 of itself. The library's would cost more
/// than the rest of a row.
#[inline]
fn exp(x: f32) -> f32 {
    /// 1.5 * 2^23: adding it rounds to whole numbers, which stand in the lowest bits of the sum.
    const ROUND: f32 = 12_582_912.0;
    let x = x.clamp(-80.0, 80.0) * std::f32::consts::LOG2_E;
    let rounded = x + ROUND;
    let f = x - (rounded - ROUND);
    // 2^f in [-0.5, 0.5], by least squares at Chebyshev's points.
    let p = 1.339_987e-3 + f * 1.533_758_5e-4;
    let p = 5.550_329e-2 + f * (9.618_52e-3 + f * p);
    let p = 1.0 + f * (std::f32::consts::LN_2 + f * (0.240_226_47 + f * p));
    p * f32::from_bits((rounded.to_bits() << 23).wrapping_add(127 << 23))
}

/// The largest whole number that is not above `x`; the instruction for it is not everywhere, and the library's function
/// is slow.
#[inline]
fn floor(x: f32) -> i32 {
    let whole = x as i32;
    whole - i32::from(x < whole as f32)
}

/// A Gaussian around (0, 0), in texels: `exp (-(xx x^2 + 2 xy x y + yy y^2) / 2)`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gaussian {
    xx: f32,
    xy: f32,
    yy: f32,
    /// Half of its extent in y.
    reach: f32,
    /// Where the middle of a row stands, per step in y.
    slant: f32,
    /// Square of half a row's length at the centre, and what it loses per squared step in y.
    half: (f32, f32),
    /// Factor from one step between texels to the next.
    bend: f32,
}

impl Gaussian {
    /// For a footprint of these squared full widths in texels; both widths of the ellipse are at least 1.
    pub(crate) fn new(spread: Spread) -> Self {
        let variance = |squared: f64, texel: f64| (0.25 * squared - texel) / KEPT;
        let (xx, xy, yy) = (variance(spread.xx, TEXEL), variance(spread.xy, 0.0), variance(spread.yy, TEXEL));
        let scale = 1.0 / (xx * yy - xy * xy);
        let inverse = (yy * scale) as f32;
        Self {
            xx: inverse,
            xy: (-xy * scale) as f32,
            yy: (xx * scale) as f32,
            reach: CUT * (yy as f32).sqrt(),
            slant: (xy / yy) as f32,
            half: (CUT * CUT * inverse.recip(), (1.0 / (scale * yy * yy)) as f32),
            bend: exp(-inverse),
        }
    }

    /// From where to where the row at `dy` is covered, relative to the centre.
    fn row(&self, dy: f32) -> Option<(f32, f32)> {
        // xx x^2 + 2 xy x dy + yy dy^2 = CUT^2
        let squared = self.half.0 - self.half.1 * dy * dy;
        (squared >= 0.0).then(|| {
            let (middle, half) = (self.slant * dy, squared.sqrt());
            (middle - half, middle + half)
        })
    }

    /// The weights from (dx, dy) on to the right.
    fn weights(&self, dx: f32, dy: f32) -> Weights {
        let exponent = self.xx * dx * dx + 2.0 * self.xy * dx * dy + self.yy * dy * dy;
        let change = self.xx * (2.0 * dx + 1.0) + 2.0 * self.xy * dy;
        Weights { weight: exp(-0.5 * exponent), step: exp(-0.5 * change), bend: self.bend }
    }
}

/// Weights of texels side by side: each is the one before times a factor, which itself changes by a factor.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Weights {
    weight: f32,
    step: f32,
    bend: f32,
}

impl Weights {
    /// The weight of the next texel.
    #[inline]
    pub(crate) fn next(&mut self) -> f32 {
        let weight = (self.weight - FLOOR).max(0.0);
        self.weight *= self.step;
        self.step *= self.bend;
        weight
    }
}

/// A weighted sum, taken relative to its first value: the mean of values that are all alike is that value, exactly.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sum {
    pub(crate) base: [f32; 4],
    pub(crate) above: [f32; 4],
    pub(crate) weight: f32,
    begun: bool,
}

impl Sum {
    /// Adds one value.
    pub(crate) fn add(&mut self, value: [f32; 4], weight: f32) {
        self.begin(value);
        for ((above, value), base) in self.above.iter_mut().zip(value).zip(self.base) {
            *above += weight * (value - base);
        }
        self.weight += weight;
    }

    /// Takes a value as the base when there is none.
    #[inline]
    pub(crate) fn begin(&mut self, value: [f32; 4]) {
        if !std::mem::replace(&mut self.begun, true) {
            self.base = value;
        }
    }

    fn mean(&self) -> [f32; 4] {
        std::array::from_fn(|c| self.base[c] + self.above[c] / self.weight)
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
        let tile_width = l.tile_width as i32;
        let (cx, cy) = (wrap.0.reduce(s) * l.width as f32 - 0.5, wrap.1.reduce(t) * l.height as f32 - 0.5);
        let mut sum = Sum::default();
        for y in 1 + floor(cy - g.reach)..=floor(cy + g.reach) {
            let dy = y as f32 - cy;
            let Some((left, right)) = g.row(dy) else { continue };
            let (mut x, end) = (1 + floor(cx + left), 1 + floor(cx + right));
            let mut weights = g.weights(x as f32 - cx, dy);
            let row = wrap.1.index(y, height);
            while x < end {
                // Nearly always the whole row is inside; a picture that repeats is taken copy by copy.
                let inside = if wrap.0 == Wrap::Periodic { x.rem_euclid(width) } else { x };
                if let (Some(row), true) = (row, (0..width).contains(&inside)) {
                    let count = (tile_width - inside % tile_width).min(width - inside).min(end - x);
                    let at = (inside as u32, row as u32);
                    self.add_run(level, at, count as usize, &mut weights, &mut sum);
                    x += count;
                    continue;
                }
                let value = match (wrap.0.index(x, width), row) {
                    (Some(x), Some(row)) => self.texel(level, x as u32, row as u32),
                    _ => [0.0; 4],
                };
                sum.add(value, weights.next());
                x += 1;
            }
        }
        if sum.weight > 0.0 { sum.mean() } else { self.bilinear(level, s, t, wrap) }
    }
}
