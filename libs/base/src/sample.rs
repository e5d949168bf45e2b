//! Low-discrepancy sequences, hashed per pixel and dimension.

use crate::hash::mix32;

/// Reverses the bits of `i` into a fraction: the base-2 radical inverse, scaled to 32 bits.
const fn van_der_corput(i: u32) -> u32 {
    i.reverse_bits()
}

/// Returns the second Sobol dimension.
///
/// Direction number `k` holds the binomials of `k`, modulo 2, from the highest bit down. With its bits reversed, the
/// result is the polynomial over the field of two elements whose coefficients are the bits of `i`, evaluated at
/// `x + 1`. As `(x + 1)^s = x^s + 1` for powers of two, this is one step for each halving of the polynomial.
const fn sobol_2(mut i: u32) -> u32 {
    i ^= i >> 16;
    i ^= (i >> 8) & 0x00ff_00ff;
    i ^= (i >> 4) & 0x0f0f_0f0f;
    i ^= (i >> 2) & 0x3333_3333;
    i ^= (i >> 1) & 0x5555_5555;
    i.reverse_bits()
}

/// Applies Owen scrambling by hashing (Laine and Karras 2011, with the constants of Burley, Practical Hash-based Owen
/// Scrambling, JCGT 2020).
const fn owen(x: u32, seed: u32) -> u32 {
    let mut x = x.reverse_bits();
    x = x.wrapping_add(seed);
    x ^= x.wrapping_mul(0x6c50_b47c);
    x ^= x.wrapping_mul(0xb82f_1e52);
    x ^= x.wrapping_mul(0xc7af_e638);
    x ^= x.wrapping_mul(0x8d22_f6e6);
    x.reverse_bits()
}

/// Returns point `i` of a scrambled (0,2)-sequence in the unit square. Every run of 2^k points is stratified in all
/// elementary intervals. `seed` identifies the pixel and the dimension.
#[inline]
pub const fn square(i: u32, seed: u32) -> (f32, f32) {
    // The order is shuffled too, so that different seeds are paired independently.
    let i = owen(i, mix32(seed ^ 0x68bc_21eb));
    (
        crate::hash::unit(owen(van_der_corput(i), mix32(seed))),
        crate::hash::unit(owen(sobol_2(i), mix32(seed ^ 0x02e5_be93))),
    )
}

/// Returns point `i` of a scrambled one-dimensional sequence. Every run of 2^k points is stratified.
#[inline]
pub const fn line(i: u32, seed: u32) -> f32 {
    crate::hash::unit(owen(van_der_corput(i), mix32(seed)))
}

/// Returns the image of `i` under a hashed permutation of `0..n` (Kensler, Correlated Multi-Jittered Sampling, 2013).
///
/// `i` must be below `n`, and `n` at least 1.
pub const fn permute(mut i: u32, n: u32, seed: u32) -> u32 {
    if n <= 1 {
        return 0;
    }
    let w = n.next_power_of_two() - 1;
    loop {
        i ^= seed;
        i = i.wrapping_mul(0xe170_893d);
        i ^= seed >> 16;
        i ^= (i & w) >> 4;
        i ^= seed >> 8;
        i = i.wrapping_mul(0x0929_eb3f);
        i ^= seed >> 23;
        i ^= (i & w) >> 1;
        i = i.wrapping_mul(1 | seed >> 27);
        i = i.wrapping_mul(0x6935_fa69);
        i ^= (i & w) >> 11;
        i = i.wrapping_mul(0x74dc_b303);
        i ^= (i & w) >> 2;
        i = i.wrapping_mul(0x9e50_1cc3);
        i ^= (i & w) >> 2;
        i = i.wrapping_mul(0xc860_a3df);
        i &= w;
        i ^= i >> 5;
        if i < n {
            return i.wrapping_add(seed) % n;
        }
    }
}

/// Chooses `count` parts of a whole, each time with probabilities in proportion to `sizes`, except for the share `even`
/// of the choices, for which all parts are alike (systematic sampling). Returns the parts that were chosen, in order,
/// how often, and a factor: the sum over them of the factor times a value estimates the sum of the value over all
/// parts.
///
/// ```
/// use granita_base::sample;
/// let chosen = sample::in_proportion(&[1.0, 0.0, 3.0, 0.0], 4, 0.0);
/// assert_eq!(chosen, [(0, 1, 1.0), (2, 3, 1.0)]);
/// ```
pub fn in_proportion(sizes: &[f64], count: usize, even: f64) -> Vec<(usize, usize, f64)> {
    let (parts, total) = (sizes.len() as f64, sizes.iter().sum::<f64>());
    let share = |size: f64| match total > 0.0 {
        true => (1.0 - even) * size / total + even / parts,
        false => 1.0 / parts,
    };
    let mut chosen = Vec::new();
    let (mut sum, mut next) = (0.0, 0);
    for (part, size) in sizes.iter().enumerate() {
        let share = share(*size);
        sum += share;
        let before = next;
        while next < count && (next as f64 + 0.5) / count as f64 <= sum {
            next += 1;
        }
        if next > before {
            chosen.push((part, next - before, (next - before) as f64 / (count as f64 * share)));
        }
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares the result with the recurrence of the direction numbers.
    #[test]
    fn the_second_sobol_dimension_equals_its_direction_numbers() {
        let by_numbers = |mut i: u32| {
            let (mut v, mut r) = (1_u32 << 31, 0);
            while i != 0 {
                r ^= if i & 1 != 0 { v } else { 0 };
                i >>= 1;
                v ^= v >> 1;
            }
            r
        };
        let wide = (0..10_000_u32).map(|i| mix32(i).wrapping_mul(2).wrapping_add(i));
        for i in (0..1000).chain(wide).chain([u32::MAX, 1 << 31]) {
            assert_eq!(sobol_2(i), by_numbers(i), "{i}");
        }
    }

    #[test]
    fn samples_of_the_square_are_stratified() {
        for seed in [0, 1, 77, u32::MAX] {
            // Of 16 points one is in each cell of 16x1, 8x2, 4x4, 2x8, 1x16.
            for (nx, ny) in [(16, 1), (8, 2), (4, 4), (2, 8), (1, 16)] {
                let mut seen = [false; 16];
                for i in 0..16 {
                    let (x, y) = square(i, seed);
                    let cell = (x * nx as f32) as usize + nx * (y * ny as f32) as usize;
                    assert!(!std::mem::replace(&mut seen[cell], true), "seed {seed}, {nx}x{ny}");
                }
            }
        }
    }

    #[test]
    fn samples_of_the_line_are_stratified() {
        let mut seen = [false; 64];
        for i in 0..64 {
            let cell = (line(i, 9) * 64.0) as usize;
            assert!(!std::mem::replace(&mut seen[cell], true));
        }
    }

    #[test]
    fn permutations_contain_each_index_once() {
        for n in [1, 2, 3, 16, 17, 100] {
            for seed in [0, 5, 0xdead_beef] {
                let mut all: Vec<u32> = (0..n).map(|i| permute(i, n, seed)).collect();
                all.sort_unstable();
                assert!(all.iter().copied().eq(0..n), "n {n} seed {seed}");
            }
        }
    }
}
