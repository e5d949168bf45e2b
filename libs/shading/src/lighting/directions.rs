//! Samples directions by the light of an environment map, with more samples where it is bright.
//!
//! The sphere is divided into cells of a latitude-longitude grid. Each cell has its mean light, and a probability
//! in proportion to it. A small part of the probability is uniform, so that every direction can be drawn. The
//! radiance over pdf of a sample needs no lookup in the map.
//!
//! Cells are grouped in blocks. For a surface that gathers in front of it, the probability of a block is multiplied
//! by the cosine with the bright part of it ([`EnvironmentSampler::before`]). Hardly any sample is then lost below
//! the horizon, and the remaining noise is that of shadows. Within a block the probabilities stay the same
//! (products of two factors by a hierarchy, after Clarberg, Jarosz, Akenine-Moeller, Jensen: Wavelet Importance
//! Sampling, SIGGRAPH 2005, of two levels). Rows are drawn first, then columns (Pharr, Jakob and Humphreys,
//! Physically Based Rendering, 4th edition 2023, A.5.3, piecewise constant distributions).

use granita_base::{Vec3, parallel_map};
use granita_machine::widest;
use std::f64::consts::{PI, TAU};

/// The number of blocks from pole to pole, and around the sphere.
const ROWS: usize = 32;
const COLUMNS: usize = 64;
/// The number of cells along each side of a block.
const SIDE: usize = 8;
/// The number of cells from pole to pole, and around the sphere.
const ALL_ROWS: usize = ROWS * SIDE;
const ALL_COLUMNS: usize = COLUMNS * SIDE;
/// The share of directions that are distributed uniformly.
const EVEN: f64 = 0.01;
/// The lower bound of the cosine, for blocks with a part above the horizon.
const LEAST: f32 = 0.02;
/// The sine of the largest angle between two directions of a block.
const WITHIN: f32 = 0.14;

/// The radiance of a direction: the first channels of a map.
pub(crate) type Seen = [f32; 4];

/// A number for each block, column by column.
type Blocks = [[f32; ROWS]; COLUMNS];

/// Samples directions of an environment map.
#[derive(Debug)]
pub(crate) struct EnvironmentSampler {
    /// The probability of each block.
    pdfs: Box<Blocks>,
    /// The unit vector to the mean position of the light of each block.
    middles: Box<[Blocks; 3]>,
    /// The weights for directions over the whole sphere.
    whole: DirectionWeights,
    /// For each block, row by row: the cumulative probabilities of the rows of its cells, up to 1.
    rows: Vec<[f32; SIDE]>,
    /// For each row of cells and each block in it, the cumulative probabilities of its cells.
    columns: Vec<[f32; SIDE]>,
    /// The heights (z) of the borders between rows of cells.
    heights: Vec<f32>,
    /// The sine and cosine of the azimuths of the centres of columns of cells.
    turns: Vec<[f32; 2]>,
    /// The mean radiance of each cell.
    seen: Vec<Seen>,
}

/// Cumulative weights of blocks: for each row of blocks over its columns, and over the rows.
#[derive(Clone, Debug)]
pub(crate) struct DirectionWeights {
    columns: Box<Blocks>,
    rows: [f32; ROWS],
}

/// The number of directions that are drawn together.
pub(crate) const TOGETHER: usize = 16;

/// A direction that was drawn.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct DirectionSample {
    /// A unit vector.
    pub(crate) dir: Vec3,
    /// Its pdf in 1/sr.
    pub(crate) pdf: f32,
    /// The mean radiance of its cell.
    pub(crate) seen: Seen,
}

/// A cell during the search, and the position in it.
#[derive(Clone, Copy, Default)]
struct Cell {
    row: usize,
    column: usize,
    x: f32,
    y: f32,
    pdf: f32,
}

/// Returns the direction at fractions of the way around and from pole to pole.
fn towards(around: f64, down: f64) -> Vec3 {
    let ((s, c), (sin, cos)) = (libm::sincos(TAU * around), libm::sincos(PI * down));
    Vec3::new((c * sin) as f32, (s * sin) as f32, cos as f32)
}

impl DirectionWeights {
    /// Sums the rows, after the sums over columns were stored.
    #[inline(always)]
    fn sum_rows(&mut self) {
        let mut sum = 0.0;
        for (to, row) in self.rows.iter_mut().zip(self.columns[COLUMNS - 1]) {
            sum += row;
            *to = sum;
        }
    }

    /// Returns empty weights.
    pub(crate) fn new() -> Self {
        Self { columns: Box::new([[0.0; ROWS]; COLUMNS]), rows: [0.0; ROWS] }
    }

    /// Stores the cumulative weights of the blocks.
    #[inline(always)]
    fn fill(&mut self, pdf: impl Fn(usize, usize) -> f32) {
        let mut sums = [0.0; ROWS];
        for (column, out) in self.columns.iter_mut().enumerate() {
            for (row, sum) in sums.iter_mut().enumerate() {
                *sum += pdf(column, row);
            }
            *out = sums;
        }
        self.sum_rows();
    }
}

impl EnvironmentSampler {
    /// Builds the sampler. Each of up to `threads` threads makes a function with `looker`, which returns the
    /// radiance in a direction over an angle in radians.
    pub(crate) fn new<L: FnMut(Vec3, f32) -> Seen>(threads: usize, looker: &(impl Fn() -> L + Sync)) -> Self {
        let heights: Vec<f64> =
            (0..=ALL_ROWS).map(|row| libm::cos(PI * row as f64 / ALL_ROWS as f64)).collect();
        let mean = |look: &mut L, cell: usize| {
            let around = ((cell % ALL_COLUMNS) as f64 + 0.5) / ALL_COLUMNS as f64;
            let down = ((cell / ALL_COLUMNS) as f64 + 0.5) / ALL_ROWS as f64;
            look(towards(around, down), Self::cell()).map(|x| if x.is_finite() { x } else { 0.0 })
        };
        let mut seen = vec![Seen::default(); ALL_ROWS * ALL_COLUMNS];
        let part = seen.len().div_ceil(threads.max(1));
        parallel_map(seen.chunks_mut(part).enumerate(), threads, looker, |look, (k, part_seen)| {
            let cells = part_seen.iter_mut().enumerate();
            cells.for_each(|(cell, seen)| *seen = mean(look, k * part + cell));
        });
        let solid_angle = |row: usize| (heights[row] - heights[row + 1]) * TAU / ALL_COLUMNS as f64;
        let mut pdf: Vec<f64> = seen
            .iter()
            .enumerate()
            .map(|(k, [r, g, b, _])| f64::from((r + g + b).max(0.0)) * solid_angle(k / ALL_COLUMNS))
            .collect();
        let all: f64 = pdf.iter().sum();
        for (k, pdf) in pdf.iter_mut().enumerate() {
            let even = solid_angle(k / ALL_COLUMNS) / (4.0 * PI);
            *pdf = if all > 0.0 { *pdf / all * (1.0 - EVEN) + even * EVEN } else { even };
        }
        let mut pdfs = Box::new([[0.0; ROWS]; COLUMNS]);
        let mut middles = Box::new([[[0.0; ROWS]; COLUMNS]; 3]);
        let mut rows = Vec::with_capacity(ROWS * COLUMNS);
        let mut columns = vec![[0.0; SIDE]; ALL_ROWS * COLUMNS];
        for block in 0..ROWS * COLUMNS {
            let (row, column) = (block / COLUMNS, block % COLUMNS);
            let mut by_row = [0.0; SIDE];
            let mut middle = Vec3::ZERO;
            for (j, row_chance) in by_row.iter_mut().enumerate() {
                let cell_row = row * SIDE + j;
                let first = cell_row * ALL_COLUMNS + column * SIDE;
                let own = &pdf[first..first + SIDE];
                columns[cell_row * COLUMNS + column] = sums(own.try_into().unwrap_or(&[1.0; SIDE]));
                *row_chance = own.iter().sum::<f64>();
                for (i, pdf) in own.iter().enumerate() {
                    let at = (column * SIDE + i) as f64 + 0.5;
                    let down = (cell_row as f64 + 0.5) / ALL_ROWS as f64;
                    middle += towards(at / ALL_COLUMNS as f64, down) * *pdf as f32;
                }
            }
            rows.push(sums(&by_row));
            pdfs[column][row] = by_row.iter().sum::<f64>() as f32;
            let middle = middle.normalize_or_zero();
            (0..3).for_each(|axis| middles[axis][column][row] = middle[axis]);
        }
        let mut whole = DirectionWeights::new();
        whole.fill(|column, row| pdfs[column][row]);
        let turn = |column: usize| libm::sincos(TAU * (column as f64 + 0.5) / ALL_COLUMNS as f64);
        let turns = (0..ALL_COLUMNS).map(turn).map(|(s, c)| [s as f32, c as f32]).collect();
        let heights = heights.into_iter().map(|z| z as f32).collect();
        Self { pdfs, middles, whole, rows, columns, heights, turns, seen }
    }

    /// Returns the directions for points of the unit square: in front of a surface with a unit normal, or over the
    /// whole sphere.
    pub(crate) fn draw(
        &self,
        normal: Option<Vec3>,
        points: &[(f32, f32); TOGETHER],
        room: &mut DirectionWeights,
    ) -> [DirectionSample; TOGETHER] {
        // Vector code gives the same results.
        widest!({
            let among = match normal {
                Some(normal) => {
                    self.before(normal, room);
                    &*room
                }
                None => &self.whole,
            };
            let mut out = [DirectionSample::default(); TOGETHER];
            self.at(among, points, &mut out);
            out
        })
    }

    /// Computes weights for directions in front of a surface: each block is also weighted by its approximate
    /// cosine. Few directions are behind the surface.
    #[inline(always)]
    fn before(&self, normal: Vec3, out: &mut DirectionWeights) {
        let [x, y, z] = &*self.middles;
        out.fill(|column, row| {
            let cos = normal.x * x[column][row] + normal.y * y[column][row] + normal.z * z[column][row];
            let counts = if cos > -WITHIN { cos.max(LEAST) } else { 0.0 };
            self.pdfs[column][row] * counts
        });
    }

    /// Returns the directions for points of the unit square.
    ///
    /// Each step runs for all of them together, so that their memory accesses overlap.
    #[inline(always)]
    fn at(
        &self,
        around: &DirectionWeights,
        points: &[(f32, f32); TOGETHER],
        out: &mut [DirectionSample; TOGETHER],
    ) {
        let mut cells = [Cell::default(); TOGETHER];
        for (cell, &(x, y)) in cells.iter_mut().zip(points) {
            let (row, y, of_row) = pick(&around.rows, y);
            let (column, x, of_column) = pick_of(COLUMNS, x, |k| around.columns[k][row]);
            *cell = Cell { row, column, x, y, pdf: of_row * of_column };
        }
        for cell in &mut cells {
            let (j, y, of_cells) = pick(&self.rows[cell.row * COLUMNS + cell.column], cell.y);
            *cell = Cell { row: cell.row * SIDE + j, y, pdf: cell.pdf * of_cells, ..*cell };
        }
        for cell in &mut cells {
            let (i, x, of_cell) = pick(&self.columns[cell.row * COLUMNS + cell.column], cell.x);
            *cell = Cell { column: cell.column * SIDE + i, x, pdf: cell.pdf * of_cell, ..*cell };
        }
        for (out, cell) in out.iter_mut().zip(&cells) {
            // The position is uniform over the cell: in height, and by a small rotation from its centre.
            let (top, bottom) = (self.heights[cell.row], self.heights[cell.row + 1]);
            let z = top + (bottom - top) * cell.y;
            let turn = (cell.x - 0.5) * (TAU / ALL_COLUMNS as f64) as f32;
            let (sin, cos) = (turn * (1.0 - turn * turn / 6.0), 1.0 - 0.5 * turn * turn);
            let [s, c] = self.turns[cell.column];
            let flat = (1.0 - z * z).max(0.0).sqrt();
            *out = DirectionSample {
                dir: Vec3::new((c * cos - s * sin) * flat, (s * cos + c * sin) * flat, z),
                pdf: cell.pdf / ((top - bottom) * (TAU / ALL_COLUMNS as f64) as f32),
                seen: self.seen[cell.row * ALL_COLUMNS + cell.column],
            };
        }
    }

    /// Returns the angle across a cell in radians.
    pub(crate) fn cell() -> f32 {
        (PI / ALL_ROWS as f64) as f32
    }
}

/// Returns cumulative sums up to 1. They are uniform when all probabilities are zero.
fn sums(pdfs: &[f64; SIDE]) -> [f32; SIDE] {
    let all: f64 = pdfs.iter().sum();
    let mut sum = 0.0;
    let mut out = [0.0; SIDE];
    for (k, (out, pdf)) in out.iter_mut().zip(pdfs).enumerate() {
        sum += pdf;
        *out = if all > 0.0 { sum / all } else { (k + 1) as f64 / SIDE as f64 } as f32;
    }
    out
}

/// Returns the part of cumulative sums that a fraction of the whole falls into, the position in it, and its share
/// of the whole.
#[inline(always)]
fn pick<const N: usize>(sums: &[f32; N], fraction: f32) -> (usize, f32, f32) {
    let at = fraction * sums[N - 1];
    // A comparison with all sums is faster than bisection of so few.
    let below: u32 = sums.iter().map(|sum| u32::from(*sum <= at)).sum();
    part(N, below as usize, at, |k| sums[k])
}

/// Does the same for `n` sums (a power of two) that are not contiguous.
#[inline(always)]
fn pick_of(n: usize, fraction: f32, sum: impl Fn(usize) -> f32) -> (usize, f32, f32) {
    let at = fraction * sum(n - 1);
    let (mut below, mut half) = (0, n / 2);
    while half > 0 {
        below += if sum(below + half - 1) <= at { half } else { 0 };
        half /= 2;
    }
    part(n, below, at, sum)
}

/// Does the same as [`pick`] for the part after `below` sums that are not larger than `at`.
#[inline(always)]
fn part(n: usize, below: usize, at: f32, sum: impl Fn(usize) -> f32) -> (usize, f32, f32) {
    let mut k = below.min(n - 1);
    // When rounding leads beyond the end, the last part that is not empty is taken.
    while k > 0 && sum(k) <= sum(k - 1) {
        k -= 1;
    }
    let before = if k > 0 { sum(k - 1) } else { 0.0 };
    let (size, all) = (sum(k) - before, sum(n - 1));
    let within = if size > 0.0 { ((at - before) / size).clamp(0.0, 1.0) } else { 0.5 };
    (k, within, if all > 0.0 { size / all } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::sample;

    /// Returns `count` directions, a multiple of those drawn together.
    fn drawn(
        directions: &EnvironmentSampler,
        normal: Option<Vec3>,
        count: u32,
        seed: u32,
    ) -> Vec<DirectionSample> {
        let mut room = DirectionWeights::new();
        let part = |part: u32| {
            let at = |k: usize| sample::square(part * TOGETHER as u32 + k as u32, seed);
            directions.draw(normal, &std::array::from_fn(at), &mut room)
        };
        (0..count / TOGETHER as u32).flat_map(part).collect()
    }

    /// Returns the mean of `what (direction) / pdf` over `count` samples, and its standard deviation.
    fn integral(directions: &EnvironmentSampler, count: u32, what: impl Fn(Vec3, Seen) -> f32) -> (f64, f64) {
        integral_over(directions, None, count, what)
    }

    fn integral_over(
        directions: &EnvironmentSampler,
        normal: Option<Vec3>,
        count: u32,
        what: impl Fn(Vec3, Seen) -> f32,
    ) -> (f64, f64) {
        let (mut sum, mut squares) = (0.0, 0.0);
        for DirectionSample { dir, pdf, seen } in drawn(directions, normal, count, 7) {
            assert!((dir.length() - 1.0).abs() < 1e-5 && pdf > 0.0, "{dir} {pdf}");
            let value = f64::from(what(dir, seen) / pdf);
            sum += value;
            squares += value * value;
        }
        let mean = sum / f64::from(count);
        (mean, (squares / f64::from(count) - mean * mean).max(0.0).sqrt())
    }

    #[test]
    fn parts_are_sampled_as_by_linear_search() {
        let pdfs: [f32; 64] =
            std::array::from_fn(|k| if k % 7 < 3 { 0.0 } else { (k * k % 31) as f32 + 1e-3 });
        let mut sum = 0.0;
        let sums = pdfs.map(|pdf| {
            sum += pdf;
            sum
        });
        let last = (0..64).rfind(|k| pdfs[*k] > 0.0).unwrap();
        for i in 0..=5000 {
            let fraction = i as f32 / 5000.0;
            let (k, within, share) = pick(&sums, fraction);
            assert_eq!(pick_of(64, fraction, |k| sums[k]), (k, within, share));
            let due = sums.partition_point(|sum| *sum <= fraction * sums[63]).min(last);
            assert_eq!(k, due);
            assert!((share - pdfs[k] / sums[63]).abs() < 1e-6 && (0.0..=1.0).contains(&within));
        }
        // Nothing at all.
        assert_eq!(pick(&[0.0; 4], 0.7).2, 0.0);
    }

    #[test]
    fn sampling_the_front_hemisphere_gives_the_same_integral() {
        let sun = Vec3::new(0.3, -0.5, 0.2).normalize();
        let directions = EnvironmentSampler::new(2, &|| {
            |d: Vec3, _| [if d.dot(sun) > 0.999 { 1e3 } else { 1.0 + d.x }; 4]
        });
        for normal in [sun, -sun, Vec3::X, Vec3::NEG_Z, Vec3::new(1.0, 2.0, -3.0).normalize()] {
            let light = |d: Vec3, seen: Seen| seen[0] * d.dot(normal).max(0.0);
            let (due, of_all) = integral_over(&directions, None, 1 << 16, light);
            let (mean, deviation) = integral_over(&directions, Some(normal), 1 << 14, light);
            assert!((mean / due - 1.0).abs() < 0.01, "{normal}: {mean} for {due}");
            assert!(deviation < 0.5 * mean && deviation < 0.7 * of_all, "{deviation} of {mean}; {of_all}");
            // Hardly anything is lost.
            let count = 4096;
            let all = drawn(&directions, Some(normal), count, 3);
            let below = all.iter().filter(|d| d.dir.dot(normal) <= 0.0);
            assert!(below.count() < 300);
        }
    }

    #[test]
    fn a_uniform_sky_is_integrated_exactly() {
        let directions = EnvironmentSampler::new(1, &|| |_, _| [3.0; 4]);
        let (mean, deviation) = integral(&directions, 4096, |_, seen| seen[1]);
        assert!((mean / (12.0 * PI) - 1.0).abs() < 1e-4 && deviation < 1e-3 * mean, "{mean} {deviation}");
        // The same without any light.
        let (mean, _) = integral(&EnvironmentSampler::new(1, &|| |_, _| [f32::NAN; 4]), 4096, |_, _| 1.0);
        assert!((mean / (4.0 * PI) - 1.0).abs() < 1e-4, "{mean}");
    }

    #[test]
    fn a_small_sun_receives_nearly_all_samples() {
        // A disc of 1 degree, 10000 times as bright as the sky.
        let axis = Vec3::new(0.3, -0.5, 0.6).normalize();
        let cos = 0.5_f32.to_radians().cos();
        let light = |d: Vec3| if d.dot(axis) > cos { 1e4 } else { 1.0 };
        // As a filtered lookup would see it.
        let seen = |d: Vec3, angle: f32| {
            let (u, v) = granita_rays::sampling::basis(d);
            let at = |i: u32| {
                let (x, y) = sample::square(i, 1);
                (d + (u * (x - 0.5) + v * (y - 0.5)) * angle).normalize()
            };
            [(0..64).map(|i| light(at(i))).sum::<f32>() / 64.0; 4]
        };
        let directions = EnvironmentSampler::new(2, &|| seen);
        let exact = 4.0 * PI + 9999.0 * TAU * f64::from(1.0 - cos);
        // What is there, and what the cells say of it.
        for mean in [
            integral(&directions, 1 << 16, |d, _| light(d)),
            integral(&directions, 1 << 16, |_, seen| seen[0]),
        ] {
            assert!((mean.0 / exact - 1.0).abs() < 0.02, "{} for {exact}", mean.0);
        }
        let (_, deviation) = integral(&directions, 1 << 16, |_, seen| seen[0]);
        let (_, even) = integral(&EnvironmentSampler::new(1, &|| |_, _| [1.0; 4]), 1 << 16, |d, _| light(d));
        assert!(deviation < 0.02 * even, "{deviation}, and {even} of even directions");
    }
}
