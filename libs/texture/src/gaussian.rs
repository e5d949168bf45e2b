//! The weights of texels under an ellipse, which are a Gaussian that is cut off at [`CUT`] deviations.
//!
//! It is made wider to compensate for the variance that the cut removes, and narrower by the variance of a texel,
//! so that the total filter has the spread of the footprint.

use crate::footprint::Spread;

/// The end of the Gaussian, in standard deviations.
pub(crate) const CUT: f32 = 3.0;

/// The remaining part of the Gaussian's variance in each direction, after its value at the end is subtracted so that it
/// ends at 0. It is `1 - (h^2 / 2) e / (1 - (1 + h) e)` with `h = CUT^2 / 2`, `e = exp (-h)`.
pub(crate) const KEPT: f64 = 0.880_202;

/// The variance of a texel, in squared texels.
const TEXEL: f64 = 1.0 / 12.0;

/// Returns the largest whole number that is not above `x`. The instruction for it does not exist on all machines,
/// and the library's function is slow.
#[inline(always)]
pub(crate) fn floor(x: f32) -> i32 {
    let whole = x as i32;
    whole - i32::from(x < whole as f32)
}

/// The exponents of 2 along a row: `a dx^2 + b dx + c`, where dx is the distance from the centre in texels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Exponents {
    pub(crate) a: f32,
    pub(crate) b: f32,
    pub(crate) c: f32,
}

/// A Gaussian around (0, 0), in texels: `2^(xx x^2 + xy x y + yy y^2)`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gaussian {
    pub(crate) xx: f32,
    xy: f32,
    yy: f32,
    /// Half the extent in x and y, in texels.
    pub(crate) reach: (f32, f32),
    /// The shift of the centre of a row, per step in y.
    slant: f32,
    /// The square of half a row's length at the centre, and its decrease per squared step in y.
    half: (f32, f32),
}

/// The shape of the rows of a [`Gaussian`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct RowShape {
    pub(crate) slant: f32,
    pub(crate) half: (f32, f32),
    /// The exponents `b` and `c` of a row, per step and per squared step in y.
    pub(crate) b: f32,
    pub(crate) c: f32,
}

impl Gaussian {
    /// Makes a Gaussian for a footprint of these squared full widths in texels. Both widths of the ellipse are at
    /// least 1.
    pub(crate) fn new(spread: Spread) -> Self {
        let variance = |squared: f64, texel: f64| (0.25 * squared - texel) * (1.0 / KEPT);
        let (xx, xy, yy) = (variance(spread.xx, TEXEL), variance(spread.xy, 0.0), variance(spread.yy, TEXEL));
        let determinant = xx * yy - xy * xy;
        // The factor of all exponents, from the determinant of the variances, one half, and the logarithm to base 2.
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

    /// True when a row may be longer than eight texels.
    #[inline]
    pub(crate) fn is_long(&self) -> bool {
        self.reach.0 > 3.5
    }

    /// Returns the numbers of which [`Gaussian::row`] and [`Gaussian::exponents`] compute their results.
    #[inline(always)]
    pub(crate) fn row_shape(&self) -> RowShape {
        RowShape { slant: self.slant, half: self.half, b: self.xy, c: self.yy }
    }

    /// Returns the first covered texel in the row at `dy` from the centre, and the first one after them. The centre
    /// is at `cx`.
    #[inline(always)]
    pub(crate) fn row(&self, cx: f32, dy: f32) -> Option<(i32, i32)> {
        let squared = self.half.0 - self.half.1 * dy * dy;
        (squared >= 0.0).then(|| {
            let (middle, half) = (cx + self.slant * dy, squared.sqrt());
            (1 + floor(middle - half), 1 + floor(middle + half))
        })
    }

    /// Returns bounds of the columns that the rows `y.0 .. y.1` cover. The centre is at `(cx, cy)`. A margin of up to
    /// one texel on each side covers rounding.
    #[inline]
    pub(crate) fn bounds(&self, (cx, cy): (f32, f32), (y, end): (i32, i32)) -> (i32, i32) {
        let (from, to) = (y as f32 - cy, (end - 1) as f32 - cy);
        // The row that is nearest to the centre is the longest.
        let nearest = 0.0_f32.max(from).min(to);
        let half = (self.half.0 - self.half.1 * nearest * nearest).max(0.0).sqrt();
        let (a, b) = (self.slant * from, self.slant * to);
        (floor(cx + a.min(b) - half), 1 + floor(cx + a.max(b) + half))
    }

    /// Returns the first and the last column that the rows `y.0 .. y.1` cover, and `None` when they cover none. The
    /// centre is at `(cx, cy)`.
    pub(crate) fn columns(&self, (cx, cy): (f32, f32), (mut y, end): (i32, i32)) -> Option<(i32, i32)> {
        let mut columns: Option<(i32, i32)> = None;
        while y < end {
            if let Some((from, to)) = self.row(cx, y as f32 - cy)
                && from < to
            {
                let (first, last) = columns.unwrap_or((from, to - 1));
                columns = Some((first.min(from), last.max(to - 1)));
            }
            y += 1;
        }
        columns
    }

    /// Returns the exponents of the row at `dy`.
    #[inline(always)]
    pub(crate) fn exponents(&self, dy: f32) -> Exponents {
        Exponents { a: self.xx, b: self.xy * dy, c: self.yy * dy * dy }
    }
}
