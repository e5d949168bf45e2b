//! Bernstein weights and Bezier nets of any number of channels, in double precision.

/// The highest degree that is accepted.
pub(crate) const MAX_DEGREE: usize = 23;

/// Computes the weights of the `degree + 1` control vertices at a place `a + b = 1`. Exchanging `a` and `b` reverses
/// the weights to the bit. At the ends they are exactly 0 and 1.
pub(crate) fn bernstein(degree: usize, a: f64, b: f64, out: &mut [f64]) {
    let (mut pa, mut pb) = ([1.0_f64; MAX_DEGREE + 1], [1.0_f64; MAX_DEGREE + 1]);
    for k in 1..=degree {
        pa[k] = pa[k - 1] * a;
        pb[k] = pb[k - 1] * b;
    }
    let mut binomial = 1.0_f64;
    for i in 0..=degree {
        // The products are formed so that reversal only exchanges factors.
        out[i] = binomial * (pa[degree - i] * pb[i]);
        binomial = (binomial * (degree - i) as f64 / (i + 1) as f64).round();
    }
}

/// Computes the weights of the derivative with respect to `b`.
pub(crate) fn bernstein_derivative(degree: usize, a: f64, b: f64, out: &mut [f64]) {
    if degree == 0 {
        out[0] = 0.0;
        return;
    }
    let mut low = [0.0_f64; MAX_DEGREE + 1];
    bernstein(degree - 1, a, b, &mut low);
    let d = degree as f64;
    for (i, out) in out.iter_mut().enumerate().take(degree + 1) {
        let left = if i > 0 { low[i - 1] } else { 0.0 };
        let right = if i < degree { low[i] } else { 0.0 };
        *out = d * (left - right);
    }
}

/// Returns the weighted sum of `weights.len()` values. The sum is the same to the bit when weights and values are
/// reversed.
pub(crate) fn symmetric_sum(weights: &[f64], value: impl Fn(usize) -> f64) -> f64 {
    let n = weights.len();
    let mut sum = 0.0;
    for i in 0..n / 2 {
        sum += weights[i] * value(i) + weights[n - 1 - i] * value(n - 1 - i);
    }
    if n % 2 == 1 {
        sum += weights[n / 2] * value(n / 2);
    }
    sum
}

/// Replaces the control vertices of a curve by those of its part from `s0` to `s1`. Channel `c` of vertex `i` is at
/// `i * stride + c` of `net`, for the first `channels` channels.
pub(crate) fn restrict(net: &mut [f64], degree: usize, stride: usize, channels: usize, s0: f64, s1: f64) {
    let lerp = |x: f64, y: f64, s: f64| x * (1.0 - s) + y * s;
    if s1 < 1.0 {
        // De Casteljau's algorithm, which keeps the left part.
        for r in 1..=degree {
            for i in (r..=degree).rev() {
                for c in 0..channels {
                    net[i * stride + c] = lerp(net[(i - 1) * stride + c], net[i * stride + c], s1);
                }
            }
        }
    }
    if s0 > 0.0 {
        let s = s0 / s1;
        for r in 1..=degree {
            for i in 0..=degree - r {
                for c in 0..channels {
                    net[i * stride + c] = lerp(net[i * stride + c], net[(i + 1) * stride + c], s);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_exact_at_the_ends_and_symmetric() {
        for degree in 0..=MAX_DEGREE {
            let (mut w, mut r) = ([0.0; MAX_DEGREE + 1], [0.0; MAX_DEGREE + 1]);
            bernstein(degree, 1.0, 0.0, &mut w);
            assert_eq!(w[0], 1.0);
            assert!(w[1..=degree].iter().all(|&x| x == 0.0));
            let (a, b) = (5.0 / 7.0, 2.0 / 7.0);
            bernstein(degree, a, b, &mut w);
            bernstein(degree, b, a, &mut r);
            for i in 0..=degree {
                assert_eq!(w[i].to_bits(), r[degree - i].to_bits());
            }
            assert!((w[..=degree].iter().sum::<f64>() - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn restricting_a_bezier_curve_keeps_its_shape() {
        let curve = [0.0, 2.0, -1.0, 5.0];
        let at = |net: &[f64], s: f64| {
            let mut w = [0.0; 4];
            bernstein(3, 1.0 - s, s, &mut w);
            symmetric_sum(&w, |i| net[i])
        };
        let mut part = curve;
        restrict(&mut part, 3, 1, 1, 0.25, 0.75);
        for k in 0..=10 {
            let s = k as f64 / 10.0;
            assert!((at(&part, s) - at(&curve, 0.25 + 0.5 * s)).abs() < 1e-12);
        }
    }
}
