//! The region that a lookup averages, and its probes in environments and in narrow footprints.
//!
//! A footprint is an ellipse of full widths `a >= b`. Its filter is a Gaussian with the value exp(-2) at the ellipse
//! (Heckbert, Fundamentals of Texture Mapping and Image Warping, 1989, section 3.5), so its standard deviation is half
//! the width along each axis. One trilinear probe into the MIP level whose texels are `b` wide has exactly that
//! deviation across. A texel's box has the variance b^2/12 and the tent between texels b^2/6, together (b/2)^2. Along
//! the ellipse, probes with Gaussian weights of deviation sqrt(a^2 - b^2)/2 add the rest (compare McCormack and others,
//! Feline, SIGGRAPH 1999).

/// The largest ratio of `a` to `b` that is filtered unchanged. Beyond it the footprint is made wider.
pub(crate) const MAX_ANISOTROPY: f64 = 16.0;

/// A symmetric 2 x 2 matrix of squared widths.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Spread {
    pub(crate) xx: f64,
    pub(crate) xy: f64,
    pub(crate) yy: f64,
}

/// Converts a number to one between -1e12 and 1e12. NaN becomes 0.
fn finite(v: f32) -> f64 {
    if v.is_nan() { 0.0 } else { f64::from(v).clamp(-1e12, 1e12) }
}

impl Spread {
    /// Adds a side of a parallelogram. The region of a pixel has two of them.
    pub(crate) fn add(&mut self, x: f32, y: f32) {
        let (x, y) = (finite(x), finite(y));
        self.xx += x * x;
        self.xy += x * y;
        self.yy += y * y;
    }

    /// Returns the spread in other units.
    pub(crate) fn scaled(self, x: f64, y: f64) -> Self {
        Self { xx: self.xx * x * x, xy: self.xy * x * y, yy: self.yy * y * y }
    }

    /// Returns the spread with `least` as the smallest width.
    pub(crate) fn at_least(self, least: f64) -> Self {
        self.ellipse().at_least(least, f64::INFINITY).spread()
    }

    /// Returns the squared widths of the ellipse, the larger first.
    pub(crate) fn squares(self) -> (f64, f64) {
        let (mean, difference) = (0.5 * (self.xx + self.yy), 0.5 * (self.xx - self.yy));
        let root = (difference * difference + self.xy * self.xy).sqrt();
        (mean + root, (mean - root).max(0.0))
    }

    /// Returns the ellipse.
    pub(crate) fn ellipse(self) -> Ellipse {
        let Self { xx, xy, yy } = self;
        let (large, small) = self.squares();
        let difference = 0.5 * (xx - yy);
        // There is no overflow, because `finite` bounds the values.
        let root = (difference * difference + xy * xy).sqrt();
        // Of the two formulas for the axis, this one has no cancellation.
        let (x, y) = if difference >= 0.0 { (difference + root, xy) } else { (xy, root - difference) };
        let length = (x * x + y * y).sqrt();
        let axis = if length > 0.0 { [(x / length) as f32, (y / length) as f32] } else { [1.0, 0.0] };
        Ellipse { axis, a: large.sqrt(), b: small.sqrt() }
    }
}

/// An ellipse by its long axis and full widths, `a >= b >= 0`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ellipse {
    pub(crate) axis: [f32; 2],
    pub(crate) a: f64,
    pub(crate) b: f64,
}

impl Ellipse {
    /// Returns an ellipse with a width of at least `least` and a length of at most `ratio` times the width.
    pub(crate) fn at_least(self, least: f64, ratio: f64) -> Self {
        let b = self.b.max(self.a / ratio).max(least);
        Self { a: self.a.max(b), b, ..self }
    }

    /// Returns the squared widths along x and y.
    pub(crate) fn spread(&self) -> Spread {
        let [x, y] = self.axis.map(f64::from);
        let (a, b) = (self.a * self.a, self.b * self.b);
        Spread { xx: a * x * x + b * y * y, xy: (a - b) * x * y, yy: a * y * y + b * x * x }
    }

    /// Returns probes of width at least `least`.
    pub(crate) fn probes(&self, least: f64) -> Probes {
        let exact = self.b.max(self.a / MAX_ANISOTROPY);
        let width = exact.max(least);
        let reach = (self.a * self.a - width * width).max(0.0).sqrt();
        let count = (2.0 * reach / width).ceil().clamp(1.0, 2.0 * MAX_ANISOTROPY) as u32;
        Probes { count, reach: reach as f32, width: width as f32, exact: exact as f32 }
    }
}

/// Round probes along the long axis of an ellipse.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Probes {
    pub(crate) count: u32,
    /// The largest distance of a probe from the centre.
    reach: f32,
    /// The full width of each, at least the requested minimum.
    pub(crate) width: f32,
    /// The full width without that bound. It is 0 for an empty footprint.
    pub(crate) exact: f32,
}

impl Probes {
    /// Returns the distance from the centre and the weight (not normalised) of each.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (f32, f32)> + use<> {
        let Self { count, reach, .. } = *self;
        (0..count).map(move |i| {
            let x = (2 * i + 1) as f32 / count as f32 - 1.0;
            (x * reach, libm::expf(-2.0 * x * x))
        })
    }
}

/// A weighted mean of texels that is exact when all are equal.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Mean {
    value: [f32; 4],
    weight: f32,
}

impl Mean {
    /// Adds a value with a positive weight.
    #[inline]
    pub(crate) fn add(&mut self, value: [f32; 4], weight: f32) {
        self.weight += weight;
        let share = weight / self.weight;
        for (m, v) in self.value.iter_mut().zip(value) {
            *m += (v - *m) * share;
        }
    }

    pub(crate) fn value(&self) -> [f32; 4] {
        self.value
    }
}

/// Returns `a` at 0 and `b` at 1. It is exactly `a` when both are equal.
#[inline]
pub(crate) fn mix(a: [f32; 4], b: [f32; 4], f: f32) -> [f32; 4] {
    std::array::from_fn(|c| a[c] + (b[c] - a[c]) * f)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn footprint_axes_are_those_of_the_ellipse() {
        let mut s = Spread::default();
        s.add(3.0, 0.0);
        s.add(0.0, 4.0);
        let e = s.ellipse();
        assert_eq!((e.a, e.b, e.axis), (4.0, 3.0, [0.0, 1.0]));
        let mut s = Spread::default();
        s.add(5.0, 5.0);
        let e = s.ellipse();
        assert!((e.a - 50.0_f64.sqrt()).abs() < 1e-9 && e.b < 1e-6);
        assert!((e.axis[0] - e.axis[1]).abs() < 1e-6);
        let e = Spread::default().ellipse();
        assert_eq!((e.a, e.b, e.axis), (0.0, 0.0, [1.0, 0.0]));
    }

    #[test]
    fn any_derivatives_give_a_finite_ellipse() {
        let odd = [0.0, 1.0, -1e-30, 1e30, f32::MAX, f32::INFINITY, f32::NEG_INFINITY, f32::NAN];
        for a in odd {
            for b in odd {
                let mut s = Spread::default();
                s.add(a, b);
                s.add(b, 0.0);
                let e = s.scaled(4096.0, 1.0).ellipse();
                assert!(e.a.is_finite() && e.b.is_finite() && e.a >= e.b, "{a} {b}: {e:?}");
                let p = e.probes(1.0);
                assert!((1..=32).contains(&p.count) && p.width >= 1.0);
                assert!(p.iter().all(|(x, w)| x.is_finite() && w > 0.1));
            }
        }
    }

    #[test]
    fn round_footprints_take_one_probe() {
        let mut s = Spread::default();
        s.add(8.0, 0.0);
        s.add(0.0, 8.0);
        let p = s.ellipse().probes(1.0);
        assert_eq!((p.count, p.width), (1, 8.0));
        assert_eq!(Spread::default().ellipse().probes(1.0).count, 1);
    }

    #[test]
    fn probes_have_the_standard_deviation_of_the_ellipse() {
        let mut s = Spread::default();
        s.add(10.0, 0.0);
        s.add(0.0, 1.0);
        let p = s.ellipse().probes(1.0);
        let (mut sum, mut squares) = (0.0, 0.0);
        for (x, w) in p.iter() {
            sum += w;
            squares += w * x * x;
        }
        // A Gaussian cut off at two deviations keeps 0.7737 of its variance.
        let variance = squares / sum;
        assert!((variance / (99.0 / 4.0) - 0.7737).abs() < 0.02, "{variance}");
    }
}
