//! Noise (reference 5.8.6): functions of 1 to 4 numbers, deterministic everywhere.
//!
//! It is gradient noise after Perlin (Improving Noise, SIGGRAPH 2002): a lattice of hashed gradients, blended by
//! the quintic 6t^5 - 15t^4 + 10t^3. It is zero on the lattice and scaled to lie within [-1, 1]. Components of
//! triples come from independent lattices. Periodic noise repeats its lattice.

use crate::run::noise_lanes::open_unit;
use granita_base::hash::mix32;

/// Hashes one word into a running hash.
fn step(h: u32, i: i32) -> u32 {
    mix32(h ^ i as u32).wrapping_add(0x9e37_79b9)
}

/// Returns a number in (0, 1) for the bits of `x`.
pub(crate) fn hashed(x: &[f32], component: u32) -> f32 {
    let mut h = step(0x7261_6e64, component as i32 ^ ((x.len() as i32) << 8));
    for &x in x {
        // Adding 0 makes -0 the same as 0.
        h = step(h, (x + 0.0).to_bits() as i32);
    }
    open_unit(mix32(h))
}

/// Returns a number in (0, 1) for three words.
pub(crate) fn drawn(words: &[u32], component: u32) -> f32 {
    let mut h = step(0x6472_6177, component as i32);
    for &w in words {
        h = step(h, w as i32);
    }
    open_unit(mix32(h))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::noise_lanes::{NoiseKind, one, period, scale};

    fn fade(t: f32) -> f32 {
        t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
    }

    fn snoise<const D: usize>(x: [f32; D], periods: [u32; 4], component: u32) -> f32 {
        let periodic = periods != [0; 4];
        one::<D>(x, std::array::from_fn(|k| periods[k]), periodic, NoiseKind::Signed, component)
    }

    fn cellnoise<const D: usize>(x: &[f32; D], component: u32) -> f32 {
        one::<D>(*x, [0; D], false, NoiseKind::Cell, component)
    }

    /// Points of a space-filling sequence over `size` cells.
    fn points<const D: usize>(n: u32, size: f32) -> impl Iterator<Item = [f32; D]> {
        (0..n).map(move |i| std::array::from_fn(|k| (hashed(&[i as f32], 90 + k as u32) - 0.5) * size))
    }

    fn statistics<const D: usize>() -> (f32, f32, f32, f32) {
        let (mut sum, mut sum2, mut low, mut high) = (0.0_f64, 0.0_f64, 1.0_f32, -1.0_f32);
        let n = 40_000;
        for x in points::<D>(n, 1000.0) {
            let v = snoise(x, [0; 4], 0);
            sum += f64::from(v);
            sum2 += f64::from(v * v);
            low = low.min(v);
            high = high.max(v);
        }
        let mean = sum / f64::from(n);
        (mean as f32, (sum2 / f64::from(n) - mean * mean).sqrt() as f32, low, high)
    }

    #[test]
    fn noise_has_mean_zero_and_stays_within_bounds() {
        for (d, (mean, deviation, low, high)) in
            [(1, statistics::<1>()), (2, statistics::<2>()), (3, statistics::<3>()), (4, statistics::<4>())]
        {
            assert!(mean.abs() < 0.01, "{d}: mean {mean}");
            assert!((0.18..0.45).contains(&deviation), "{d}: deviation {deviation}");
            assert!(low >= -1.0 && high <= 1.0 && low < -0.6 && high > 0.6, "{d}: {low} to {high}");
        }
    }

    #[test]
    fn noise_stays_within_bounds_without_the_clamp() {
        // The worst gradients all point at the point: search a cell for the largest sum.
        let worst = |d: usize, t: &[f32]| -> f32 {
            (0..1 << d)
                .map(|corner: usize| {
                    let off: Vec<f32> = (0..d).map(|k| (t[k] - (corner >> k & 1) as f32).abs()).collect();
                    let w: f32 = (0..d)
                        .map(|k| if corner >> k & 1 == 1 { fade(t[k]) } else { 1.0 - fade(t[k]) })
                        .product();
                    let least = off.iter().copied().fold(f32::MAX, f32::min);
                    w * (off.iter().sum::<f32>() - least)
                })
                .sum()
        };
        for d in [3, 4] {
            let mut most = 0.0_f32;
            let side: usize = if d == 3 { 33 } else { 17 };
            for k in 0..side.pow(d as u32) {
                let t: Vec<f32> =
                    (0..d).map(|j| (k / side.pow(j as u32) % side) as f32 / (side - 1) as f32).collect();
                most = most.max(worst(d, &t));
            }
            assert!(most * scale(d) <= 1.0001 && most * scale(d) > 0.97, "{d}: {most}");
        }
    }

    #[test]
    fn noise_is_continuous_and_zero_on_the_lattice() {
        for k in -20..20 {
            let x = k as f32;
            assert_eq!(snoise([x, 3.0, -7.0], [0; 4], 1), 0.0);
            let (a, b) = (snoise([x - 1e-3], [0; 4], 0), snoise([x + 1e-3], [0; 4], 0));
            assert!((a - b).abs() < 0.01);
        }
    }

    #[test]
    fn periodic_noise_repeats() {
        for x in points::<4>(500, 40.0) {
            let p = [3, 5, 1, 7];
            let shifted = [x[0] + 3.0, x[1] - 10.0, x[2] + 4.0, x[3] + 7.0];
            let (a, b) = (snoise(x, p, 2), snoise(shifted, p, 2));
            assert!((a - b).abs() < 2e-4, "{x:?} {a} {b}");
        }
        assert_eq!([period(3.9), period(0.2), period(-4.0), period(f32::NAN)], [3, 1, 1, 1]);
        // Far away from the end of the period, a periodic lattice is the ordinary one.
        assert_eq!(snoise([2.5], [100, 0, 0, 0], 0), snoise([2.5], [0; 4], 0));
    }

    #[test]
    fn noise_components_are_not_correlated() {
        let (mut xy, mut xx) = (0.0, 0.0);
        for p in points::<3>(20_000, 500.0) {
            let (a, b) = (snoise(p, [0; 4], 0), snoise(p, [0; 4], 1));
            xy += a * b;
            xx += a * a;
        }
        assert!((xy / xx).abs() < 0.03, "{}", xy / xx);
    }

    #[test]
    fn cell_noise_is_constant_in_cells_and_uniform() {
        assert_eq!(cellnoise(&[2.1, -3.9], 0), cellnoise(&[2.9, -3.1], 0));
        assert_ne!(cellnoise(&[2.9], 0), cellnoise(&[3.0], 0));
        assert_ne!(cellnoise(&[2.9], 0), cellnoise(&[2.9], 1));
        let mut bins = [0_u32; 10];
        for i in 0..10_000 {
            bins[(cellnoise(&[i as f32, 5.0], 0) * 10.0) as usize] += 1;
        }
        // 1000 expected each; five standard deviations are 150.
        assert!(bins.iter().all(|b| b.abs_diff(1000) < 150), "{bins:?}");
    }

    #[test]
    fn noise_of_any_input_is_finite() {
        for x in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -1e30, 2_147_483_648.0] {
            let v = snoise([x, 0.5, x], [0; 4], 0);
            assert!((-1.0..=1.0).contains(&v), "{x} {v}");
            assert!((0.0..=1.0).contains(&cellnoise(&[x], 0)));
        }
        assert_eq!(hashed(&[0.0], 0), hashed(&[-0.0], 0));
    }
}
