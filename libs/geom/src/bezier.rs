//! Bernstein weights and Bezier nets of any number of channels, in double precision.

/// The highest degree that is accepted.
pub(crate) const MAX_DEGREE: usize = 23;

/// Computes the weights of the `degree + 1` control vertices at a place `a + b = 1`. Exchanging `a` and `b` reverses
/// the weights to the bit. At the ends they are exactly 0 and 1.
pub(crate) fn bernstein(degree: usize, a: f64, b: f64, out: &mut [f64]) {
    if degree == 3 {
        // The products of the loops below, without those that are exact.
        let (aa, bb) = (a * a, b * b);
        out[..4].copy_from_slice(&[aa * a, 3.0 * (aa * b), 3.0 * (a * bb), bb * b]);
        return;
    }
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
    if degree == 3 {
        let low = [a * a, 2.0 * (a * b), b * b];
        let weights = [0.0 - low[0], low[0] - low[1], low[1] - low[2], low[2] - 0.0];
        out[..4].copy_from_slice(&weights.map(|w| 3.0 * w));
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

/// Appends the sums of [`symmetric_sum`] for each of some channels. `vertices` holds those of the control vertices,
/// `stride` numbers each.
pub(crate) fn symmetric_sums(
    weights: &[f64],
    vertices: &[f64],
    stride: usize,
    channels: usize,
    out: &mut Vec<f64>,
) {
    let n = weights.len();
    let vertex = |k: usize| &vertices[k * stride..][..channels];
    let first = out.len();
    out.resize(first + channels, 0.0);
    let out = &mut out[first..];
    for i in 0..n / 2 {
        let (v, w) = ([vertex(i), vertex(n - 1 - i)], [weights[i], weights[n - 1 - i]]);
        for ((sum, a), b) in out.iter_mut().zip(v[0]).zip(v[1]) {
            *sum += w[0] * a + w[1] * b;
        }
    }
    if n % 2 == 1 {
        for (sum, a) in out.iter_mut().zip(vertex(n / 2)) {
            *sum += weights[n / 2] * a;
        }
    }
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
    fn cubic_weights_are_those_of_the_general_formula() {
        for (a, b) in [(1.0, 0.0), (0.0, 1.0), (5.0 / 7.0, 2.0 / 7.0), (0.3, 0.7), (0.1, 0.9), (0.5, 0.5)] {
            let powers = |x: f64| [1.0, x, x * x, x * x * x];
            let (pa, pb) = (powers(a), powers(b));
            let (mut w, mut d, mut low) = ([0.0; 4], [0.0; 4], [0.0; 3]);
            bernstein(3, a, b, &mut w);
            bernstein_derivative(3, a, b, &mut d);
            bernstein(2, a, b, &mut low);
            let bits = |list: [f64; 4]| list.map(f64::to_bits);
            assert_eq!(bits(w), bits([0, 1, 2, 3].map(|i| [1.0, 3.0, 3.0, 1.0][i] * (pa[3 - i] * pb[i]))));
            let at = |i: usize| low.get(i).copied().unwrap_or(0.0);
            assert_eq!(bits(d), bits([0_usize, 1, 2, 3].map(|i| 3.0 * (at(i.wrapping_sub(1)) - at(i)))));
        }
    }

    #[test]
    fn sums_of_channels_are_those_of_each_channel() {
        for degree in 1..6 {
            let mut w = [0.0; MAX_DEGREE + 1];
            bernstein(degree, 0.3, 0.7, &mut w);
            let (w, stride) = (&w[..=degree], 5);
            let net: Vec<f64> = (0..w.len() * stride).map(|i| (i as f64 * 0.7).sin()).collect();
            let mut sums = vec![9.0];
            symmetric_sums(w, &net, stride, 4, &mut sums);
            let expected = |c: usize| symmetric_sum(w, |k| net[k * stride + c]);
            assert_eq!(sums, [9.0, expected(0), expected(1), expected(2), expected(3)]);
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
