//! Directions drawn by the light of an environment map: where it is bright, there are many.
//!
//! The sphere is divided into cells of a latitude-longitude grid, of which each sends its mean light and has a chance by it; a little
//! of the chances is even, so that no direction is left out. Rows first, then cells of a row (Pharr, Jakob and Humphreys,
//! Physically Based Rendering, 4th edition 2023, A.5.3, piecewise constant distributions). What a direction brings over its chance
//! is the same for nearly all of them, and costs no lookup.

use granita_base::Vec3;
use std::f64::consts::{PI, TAU};

/// Cells around the sphere, and from pole to pole.
const COLUMNS: usize = 512;
const ROWS: usize = 256;
/// Share of directions that are spread evenly.
const EVEN: f64 = 0.01;
/// Places along each side of a cell that its mean is taken from.
const LOOKS: usize = 2;

/// What is seen in a direction: the first channels of a map.
pub(crate) type Seen = [f32; 4];

/// Chances of directions.
#[derive(Debug)]
pub(crate) struct Directions {
    /// Sums of chances up to and with each row.
    rows: Sums,
    /// Of each row, the same for its cells.
    cells: Vec<Sums>,
    /// Heights of the borders between rows.
    heights: Vec<f64>,
    /// What each cell sends, on average.
    seen: Vec<Seen>,
}

/// A direction that was drawn.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Drawn {
    /// Of length 1.
    pub(crate) dir: Vec3,
    /// Its chance, per steradian.
    pub(crate) chance: f32,
    /// What its cell sends, on average.
    pub(crate) seen: Seen,
}

/// A direction at fractions of the way around and from pole to pole.
fn towards(around: f64, down: f64) -> Vec3 {
    let ((s, c), (sin, cos)) = ((TAU * around).sin_cos(), (PI * down).sin_cos());
    Vec3::new((c * sin) as f32, (s * sin) as f32, cos as f32)
}

impl Directions {
    /// From what is seen in a direction, over an angle (radians) across.
    pub(crate) fn new(mut look: impl FnMut(Vec3, f32) -> Seen) -> Self {
        let heights: Vec<f64> = (0..=ROWS).map(|row| (PI * row as f64 / ROWS as f64).cos()).collect();
        let angle = Self::cell() / LOOKS as f32;
        let place =
            |cell: usize, k: usize, of: usize| (cell as f64 + (k as f64 + 0.5) / LOOKS as f64) / of as f64;
        let mut mean = |cell: usize| {
            let mut sum = Seen::default();
            for k in 0..LOOKS * LOOKS {
                let around = place(cell % COLUMNS, k % LOOKS, COLUMNS);
                let down = place(cell / COLUMNS, k / LOOKS, ROWS);
                for (sum, x) in sum.iter_mut().zip(look(towards(around, down), angle)) {
                    *sum += if x.is_finite() { x / (LOOKS * LOOKS) as f32 } else { 0.0 };
                }
            }
            sum
        };
        let seen: Vec<Seen> = (0..ROWS * COLUMNS).map(&mut mean).collect();
        let solid_angle = |row: usize| (heights[row] - heights[row + 1]) * TAU / COLUMNS as f64;
        let mut chance: Vec<f64> = seen
            .iter()
            .enumerate()
            .map(|(k, [r, g, b, _])| f64::from((r + g + b).max(0.0)) * solid_angle(k / COLUMNS))
            .collect();
        let all: f64 = chance.iter().sum();
        for (k, chance) in chance.iter_mut().enumerate() {
            let even = solid_angle(k / COLUMNS) / (4.0 * PI);
            *chance = if all > 0.0 { *chance / all * (1.0 - EVEN) + even * EVEN } else { even };
        }
        let rows: Vec<f64> = chance.chunks_exact(COLUMNS).map(|row| row.iter().sum()).collect();
        let cells = chance.chunks_exact(COLUMNS).map(Sums::new).collect();
        Self { rows: Sums::new(&rows), cells, heights, seen }
    }

    /// The direction for a point of the unit square.
    pub(crate) fn at(&self, x: f32, y: f32) -> Drawn {
        let (row, down, _) = self.rows.pick(f64::from(y));
        let (column, around, chance) = self.cells[row].pick(f64::from(x));
        // Even over the cell: by height.
        let (top, bottom) = (self.heights[row], self.heights[row + 1]);
        let z = top + (bottom - top) * down;
        let (s, c) = (TAU * (column as f64 + around) / COLUMNS as f64).sin_cos();
        let sin = (1.0 - z * z).max(0.0).sqrt();
        let dir = Vec3::new((c * sin) as f32, (s * sin) as f32, z as f32);
        let chance = (chance * COLUMNS as f64 / ((top - bottom) * TAU)) as f32;
        Drawn { dir, chance, seen: self.seen[row * COLUMNS + column] }
    }

    /// The angle across a cell, in radians.
    pub(crate) fn cell() -> f32 {
        (PI / ROWS as f64) as f32
    }
}

/// Growing sums of chances, and where to look for a fraction of them.
#[derive(Debug)]
struct Sums {
    sums: Vec<f64>,
    /// For as many equal steps of the whole as there are sums, the first sum that is larger than where the step begins.
    guide: Vec<u16>,
}

impl Sums {
    fn new(chances: &[f64]) -> Self {
        let mut sum = 0.0;
        let mut add = |chance: &f64| {
            sum += chance;
            sum
        };
        let sums: Vec<f64> = chances.iter().map(&mut add).collect();
        let n = sums.len();
        let begin = |step: usize| sum * step as f64 / n as f64;
        let first = |step: usize| sums.partition_point(|sum| *sum <= begin(step)).min(n - 1) as u16;
        let guide = (0..n).map(first).collect();
        Self { sums, guide }
    }

    /// The part that a fraction of the whole falls into, how far into it, and how large it is.
    fn pick(&self, fraction: f64) -> (usize, f64, f64) {
        let sums = &self.sums[..];
        let last = sums.len() - 1;
        let fraction = fraction.clamp(0.0, 1.0);
        let at = fraction * sums[last];
        let mut k = usize::from(self.guide[((fraction * sums.len() as f64) as usize).min(last)]);
        while k < last && sums[k] <= at {
            k += 1;
        }
        // Rounding may have led one too far.
        while k > 0 && sums[k - 1] > at {
            k -= 1;
        }
        let before = if k > 0 { sums[k - 1] } else { 0.0 };
        let size = sums[k] - before;
        (k, if size > 0.0 { ((at - before) / size).clamp(0.0, 1.0) } else { 0.5 }, size)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::sample;

    /// Mean of `what (direction) / chance` over so many samples, and its standard deviation.
    fn integral(directions: &Directions, count: u32, what: impl Fn(Vec3, Seen) -> f32) -> (f64, f64) {
        let (mut sum, mut squares) = (0.0, 0.0);
        for i in 0..count {
            let (x, y) = sample::square(i, 7);
            let Drawn { dir, chance, seen } = directions.at(x, y);
            assert!((dir.length() - 1.0).abs() < 1e-5 && chance > 0.0, "{dir} {chance}");
            let value = f64::from(what(dir, seen) / chance);
            sum += value;
            squares += value * value;
        }
        let mean = sum / f64::from(count);
        (mean, (squares / f64::from(count) - mean * mean).max(0.0).sqrt())
    }

    #[test]
    fn parts_are_found_as_by_looking_at_all() {
        let chances: Vec<f64> =
            (0..97).map(|k| if k % 7 < 3 { 0.0 } else { f64::from(k * k % 31) + 1e-9 }).collect();
        let sums = Sums::new(&chances);
        let all = sums.sums[96];
        for i in 0..=5000 {
            let fraction = f64::from(i) / 5000.0;
            let (k, within, size) = sums.pick(fraction);
            let due = sums.sums.partition_point(|sum| *sum <= fraction * all).min(96);
            assert_eq!((k, size), (due, sums.sums[due] - if due > 0 { sums.sums[due - 1] } else { 0.0 }));
            assert!((0.0..=1.0).contains(&within));
        }
    }

    #[test]
    fn an_even_sky_is_exact() {
        let directions = Directions::new(|_, _| [3.0; 4]);
        let (mean, deviation) = integral(&directions, 4096, |_, seen| seen[1]);
        assert!((mean / (12.0 * PI) - 1.0).abs() < 1e-4 && deviation < 1e-3 * mean, "{mean} {deviation}");
        // The same without any light.
        let (mean, _) = integral(&Directions::new(|_, _| [f32::NAN; 4]), 4096, |_, _| 1.0);
        assert!((mean / (4.0 * PI) - 1.0).abs() < 1e-4, "{mean}");
    }

    #[test]
    fn a_small_sun_takes_nearly_all_samples() {
        // A disc of 1 degree, 10000 times as bright as the sky.
        let axis = Vec3::new(0.3, -0.5, 0.6).normalize();
        let cos = 0.5_f32.to_radians().cos();
        let light = |d: Vec3| if d.dot(axis) > cos { 1e4 } else { 1.0 };
        // As a filtered lookup would see it.
        let seen = |d: Vec3, angle: f32| {
            let (u, v) = crate::sampling::basis(d);
            let at = |i: u32| {
                let (x, y) = sample::square(i, 1);
                (d + (u * (x - 0.5) + v * (y - 0.5)) * angle).normalize()
            };
            [(0..64).map(|i| light(at(i))).sum::<f32>() / 64.0; 4]
        };
        let directions = Directions::new(seen);
        let exact = 4.0 * PI + 9999.0 * TAU * f64::from(1.0 - cos);
        // What is there, and what the cells say of it.
        for mean in [
            integral(&directions, 1 << 16, |d, _| light(d)),
            integral(&directions, 1 << 16, |_, seen| seen[0]),
        ] {
            assert!((mean.0 / exact - 1.0).abs() < 0.02, "{} for {exact}", mean.0);
        }
        let (_, deviation) = integral(&directions, 1 << 16, |_, seen| seen[0]);
        let (_, even) = integral(&Directions::new(|_, _| [1.0; 4]), 1 << 16, |d, _| light(d));
        assert!(deviation < 0.02 * even, "{deviation}, and {even} of even directions");
    }
}
