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

/// Combined with the seed of a sequence for that of its order.
const SHUFFLED: u32 = 0x68bc_21eb;

/// The dimension of a sequence that orders its samples.
const ORDER: u32 = 0x6f72_6472;

/// Returns point `i` of a scrambled (0,2)-sequence in the unit square. Every run of 2^k points is stratified in all
/// elementary intervals. `seed` identifies the pixel and the dimension.
#[inline]
pub const fn square(i: u32, seed: u32) -> (f32, f32) {
    // The order is shuffled too, so that different seeds are paired independently.
    point(owen(i, mix32(seed ^ SHUFFLED)), seed)
}

/// Returns point `i` of a scrambled (0,2)-sequence in its own order.
#[inline]
const fn point(i: u32, seed: u32) -> (f32, f32) {
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

/// A sequence of random numbers that the passes of an image continue. Each round draws `n` more of its points, so that
/// those of all rounds together are spread as evenly as those of one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sequence {
    /// Identifies the sequence.
    pub seed: u32,
    /// The round that draws, from 0. The points of round 0 are those of [`square`] and [`line()`].
    pub round: u32,
}

impl Sequence {
    /// Returns the sequence of a seed in round 0.
    pub const fn new(seed: u32) -> Self {
        Self { seed, round: 0 }
    }

    /// Returns the sequence of another dimension in the same round.
    #[inline]
    pub const fn dimension(self, number: u32) -> Self {
        Self { seed: crate::hash::words(&[self.seed, number]), ..self }
    }

    /// Returns the place of the round in an order of its own for each seed, so that the rounds of different sequences
    /// are paired independently. Every run of 2^k rounds that begins with a multiple of 2^k has such places.
    #[inline]
    const fn place(self) -> u32 {
        if self.round == 0 {
            return 0;
        }
        let seed = mix32(self.seed ^ 0x3c6e_f372);
        owen(self.round, seed) ^ owen(0, seed)
    }

    /// Returns a number below `n` that differs from round to round, 0 in round 0. Those of 2^k rounds are spread
    /// evenly.
    #[inline]
    pub const fn offset(self, n: u32) -> u32 {
        // Places that samples are moved by have another order. Otherwise each offset would have one of them.
        let order = self.dimension(ORDER);
        ((van_der_corput(order.place()) as u64 * n as u64) >> 32) as u32
    }

    /// Returns the image of `k` under a permutation of `0..n`. In many rounds it is each of them.
    pub const fn shuffled(self, k: u32, n: u32) -> u32 {
        permute((k + self.offset(n)) % n, n, !self.seed)
    }

    /// Returns the cell, of `nx * ny`, that sample `k` of as many in a round has. Where both numbers are powers of two,
    /// the sample's place in the order, the column and the row form a (0, m, 3)-net: not only does each sample have a
    /// cell of its own, but also those of any half, quarter or eighth of the samples are spread evenly (Hammersley
    /// points; Niederreiter, Random Number Generation and Quasi-Monte Carlo Methods, 1992). For other numbers it is a
    /// random permutation. Each round has another order, so that in many rounds each sample has all cells.
    pub const fn cell(self, k: u32, [nx, ny]: [u32; 2]) -> u32 {
        let n = nx * ny;
        if !nx.is_power_of_two() || !ny.is_power_of_two() {
            return self.shuffled(k, n);
        }
        let (x, y) = point(k ^ self.offset(n), self.seed);
        (x * nx as f32) as u32 + nx * (y * ny as f32) as u32
    }

    /// Returns point `i` of the `n` points that each round has in the unit square. Points of the same index in
    /// different sequences are paired independently in each round.
    #[inline]
    pub const fn square(self, i: u32, n: u32) -> (f32, f32) {
        let i = i.wrapping_add(self.round.wrapping_mul(block(n)));
        point(owen(i, mix32(self.seed ^ SHUFFLED)), self.seed)
    }

    /// Returns point `i` of the `n` points that each round has between 0 and 1.
    #[inline]
    pub const fn line(self, i: u32, n: u32) -> f32 {
        if self.round == 0 {
            return line(i, self.seed);
        }
        let n = block(n);
        let shuffled = owen(i.wrapping_add(self.round.wrapping_mul(n)), mix32(self.seed ^ SHUFFLED));
        line(shuffled & (n - 1) | self.place().wrapping_mul(n), self.seed)
    }

    /// Returns where a random place between 0 and 1 (1 excluded) is in this round. It is the place itself in round 0.
    #[inline]
    pub fn moved_on_line(self, x: f32) -> f32 {
        if self.round == 0 { x } else { shifted(x, van_der_corput(self.place())) }
    }

    /// Returns where a random place in the unit square (1 excluded) is in this round. It is the place itself in round
    /// 0. The places of 2^k rounds are stratified as those of [`square`] (a digital shift).
    #[inline]
    pub fn moved(self, [x, y]: [f32; 2]) -> [f32; 2] {
        if self.round == 0 {
            return [x, y];
        }
        let place = self.place();
        [shifted(x, van_der_corput(place)), shifted(y, sobol_2(place))]
    }
}

/// A part of a sequence, which neighbours share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Draw {
    /// The sequence.
    pub sequence: Sequence,
    /// The number of the part, and the number of parts.
    pub part: [u32; 2],
}

impl Draw {
    /// Returns a sequence that is not shared.
    pub const fn alone(sequence: Sequence) -> Self {
        Self { sequence, part: [0, 1] }
    }

    /// Returns the index of one of `of` points that each part draws among all points of the sequence, and the number of
    /// these. The points of each part are stratified, and so are those of 2^k parts that begin with a multiple of 2^k.
    #[inline]
    pub const fn place(self, index: u32, of: u32) -> [u32; 2] {
        let (n, [part, parts]) = (block(of), self.part);
        [part.wrapping_mul(n).wrapping_add(index), parts.saturating_mul(n)]
    }

    /// Returns point `index` of the `of` points that each part draws in the unit square.
    #[inline]
    pub const fn square(self, index: u32, of: u32) -> (f32, f32) {
        let [index, of] = self.place(index, of);
        self.sequence.square(index, of)
    }
}

/// Returns the length of a part of a sequence that has at least `n` points.
const fn block(n: u32) -> u32 {
    if n > 1 << 31 { 1 << 31 } else { n.next_power_of_two() }
}

/// Returns a fraction whose bits differ from those of `x` where `bits` are set.
fn shifted(x: f32, bits: u32) -> f32 {
    const ONE: f32 = (1_u32 << 24) as f32;
    // Both conversions are exact, except that the bits below 2^-24 of small numbers are lost.
    (((x * ONE) as u32 ^ bits >> 8) as f32 / ONE).min(1.0 - f32::EPSILON / 2.0)
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
            // The sum may be more than a number holds.
            let rest = n - seed % n;
            return if i < rest { i + (n - rest) } else { i - rest };
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

    /// True when each of `nx * ny` cells has one of the points.
    fn are_in_all_cells(points: &[[f32; 2]], [nx, ny]: [usize; 2]) -> bool {
        let mut seen = vec![false; nx * ny];
        for [x, y] in points {
            let cell = (x * nx as f32) as usize + nx * (y * ny as f32) as usize;
            if std::mem::replace(&mut seen[cell], true) {
                return false;
            }
        }
        points.len() == seen.len()
    }

    /// True when there is one point in each cell of each division of the square into as many cells as points.
    fn are_stratified(points: &[[f32; 2]]) -> bool {
        let divisions = (0..=points.len().ilog2()).map(|k| [points.len() >> k, 1 << k]);
        divisions.into_iter().all(|cells| are_in_all_cells(points, cells))
    }

    #[test]
    fn rounds_continue_a_sequence() {
        for seed in [0, 1, 77, u32::MAX] {
            let of = |round| Sequence { seed, round };
            for n in [1, 4, 16] {
                assert!((0..n).all(|i| of(0).square(i, n) == square(i, seed)));
                assert!((0..n).all(|i| of(0).line(i, n) == line(i, seed)));
                // All rounds together, and those of each half of them.
                for rounds in [0..16, 0..8, 8..16, 0..2, 2..4, 5..6] {
                    let all = || rounds.clone().flat_map(|round| (0..n).map(move |i| (of(round), i)));
                    let points: Vec<[f32; 2]> = all().map(|(s, i)| s.square(i, n).into()).collect();
                    assert!(are_stratified(&points), "{seed} {n} {rounds:?}");
                    let places: Vec<[f32; 2]> = all().map(|(s, i)| [s.line(i, n), 0.0]).collect();
                    assert!(are_in_all_cells(&places, [places.len(), 1]), "{seed} {n} {rounds:?}");
                }
            }
            let mut offsets: Vec<u32> = (0..16).map(|round| of(round).offset(16)).collect();
            assert_eq!((offsets[0], of(3).offset(1)), (0, 0));
            offsets.sort_unstable();
            assert!(offsets.into_iter().eq(0..16));
            for start in [[0.0, 0.0], [0.3, 0.99999994], [0.123, 0.5]] {
                assert_eq!(of(0).moved(start), start);
                let places: Vec<[f32; 2]> = (0..16).map(|round| of(round).moved(start)).collect();
                assert!(are_stratified(&places), "{seed} {places:?}");
                let on_line = |round| [of(round).moved_on_line(start[0]), 0.0];
                assert!(are_in_all_cells(&(0..16).map(on_line).collect::<Vec<_>>(), [16, 1]));
            }
        }
    }

    #[test]
    fn cells_of_a_pixel_are_spread_over_its_samples() {
        for seed in [0, 1, 77] {
            for cells in [[4, 4], [8, 2], [3, 5], [1, 1]] {
                let [nx, ny] = cells;
                let n = nx * ny;
                let rounds: Vec<Vec<u32>> = (0..16)
                    .map(|round| (0..n).map(|k| Sequence { seed, round }.cell(k, cells)).collect())
                    .collect();
                for round in &rounds {
                    let mut all = round.clone();
                    all.sort_unstable();
                    assert!(all.into_iter().eq(0..n), "{seed} {cells:?}");
                }
                if cells == [4, 4] {
                    // Four samples in a row have all columns, all rows and all quarters of the pixel.
                    for four in rounds.iter().flat_map(|round| round.chunks(4)) {
                        let parts: [fn(u32) -> u32; 3] =
                            [|cell| cell % 4, |cell| cell / 4, |cell| cell % 4 / 2 + 2 * (cell / 8)];
                        for part in parts {
                            let mut seen: Vec<u32> = four.iter().map(|cell| part(*cell)).collect();
                            seen.sort_unstable();
                            assert_eq!(seen, [0, 1, 2, 3], "{seed} {four:?}");
                        }
                    }
                    let mut of_one: Vec<u32> = rounds.iter().map(|round| round[5]).collect();
                    of_one.sort_unstable();
                    assert!(of_one.into_iter().eq(0..16));
                }
            }
        }
    }

    #[test]
    fn parts_share_a_sequence() {
        for seed in [0, 77, u32::MAX] {
            for round in [0, 3] {
                let of = Sequence { seed, round };
                let points = |parts: std::ops::Range<u32>| -> Vec<[f32; 2]> {
                    let draw = |part| Draw { sequence: of, part: [part, 8] };
                    parts.flat_map(|part| (0..3).map(move |i| draw(part).square(i, 3).into())).collect()
                };
                let all = points(0..8);
                assert_eq!(points(5..6), all[15..18]);
                // With the fourth point that no part draws, they are stratified.
                let cell = |p: &[f32; 2]| (p[0] * 32.0) as usize;
                let cells: std::collections::HashSet<usize> = all.iter().map(cell).collect();
                assert_eq!(cells.len(), 24);
            }
        }
        assert_eq!(Draw::alone(Sequence::new(7)).place(2, 5), [2, 8]);
    }

    /// Points of one index must not stay paired, because passes would never show what other pairs give.
    #[test]
    fn sequences_are_paired_independently_in_each_round() {
        type Draw = fn(Sequence, u32) -> f32;
        let draws: [Draw; 4] = [
            |s, i| s.line(i, 4),
            |s, i| s.square(i, 4).0,
            |s, i| s.square(i, 4).1,
            |s, _| s.moved([0.3, 0.7])[0],
        ];
        for (a, first) in draws.iter().enumerate() {
            for (b, second) in draws.iter().enumerate() {
                for seed in 0..20 {
                    let mut counts = [0; 16];
                    for round in 0..256 {
                        let of = Sequence { seed, round };
                        let [x, y] = [first(of.dimension(1), 2), second(of.dimension(2), 2)];
                        counts[(x * 4.0) as usize + 4 * (y * 4.0) as usize] += 1;
                    }
                    assert!(counts.iter().all(|n| (2..=36).contains(n)), "{a} {b} {seed}: {counts:?}");
                }
            }
        }
    }

    /// The order of samples and the places within their cells come from one sequence.
    #[test]
    fn samples_of_a_cell_have_all_places_in_it() {
        for seed in 0..20 {
            let mut counts = [0; 16];
            for round in 0..256 {
                let of = Sequence { seed, round };
                counts[of.offset(4) as usize + 4 * (of.moved([0.3, 0.7])[0] * 4.0) as usize] += 1;
            }
            assert!(counts.iter().all(|n| (2..=36).contains(n)), "{seed}: {counts:?}");
        }
    }

    #[test]
    fn permutations_contain_each_index_once() {
        for n in [1, 2, 3, 16, 17, 100] {
            for seed in [0, 5, 0xdead_beef, u32::MAX, u32::MAX - 7] {
                let mut all: Vec<u32> = (0..n).map(|i| permute(i, n, seed)).collect();
                all.sort_unstable();
                assert!(all.iter().copied().eq(0..n), "n {n} seed {seed}");
            }
        }
    }
}
