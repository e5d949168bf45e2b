//! Directions drawn by the light of an environment map: where it is bright, there are many.
//!
//! The sphere is divided into cells of a latitude-longitude grid, of which each has a chance by the light that it and its
//! neighbours send; a little of it is even, so that no direction is left out. Rows first, then cells of a row (Pharr, Jakob and
//! Humphreys, Physically Based Rendering, 4th edition 2023, A.5.3, piecewise constant distributions).

use granita_base::Vec3;
use std::f64::consts::{PI, TAU};

/// Cells around the sphere, and from pole to pole.
const COLUMNS: usize = 512;
const ROWS: usize = 256;
/// How much the light of neighbours counts.
const BLUR: f64 = 0.3;
/// Share of directions that are spread evenly.
const EVEN: f64 = 0.05;

/// Chances of directions.
#[derive(Debug)]
pub(crate) struct Directions {
    /// Sums of chances up to and with each row.
    rows: Vec<f64>,
    /// Of each row, the same for its cells.
    cells: Vec<f64>,
}

/// The solid angle of a cell of a row.
fn solid_angle(row: usize) -> f64 {
    let z = |row: usize| (PI * row as f64 / ROWS as f64).cos();
    (z(row) - z(row + 1)) * TAU / COLUMNS as f64
}

/// A direction at fractions of the way around and from pole to pole.
fn towards(around: f64, down: f64) -> Vec3 {
    let ((s, c), (sin, cos)) = ((TAU * around).sin_cos(), (PI * down).sin_cos());
    Vec3::new((c * sin) as f32, (s * sin) as f32, cos as f32)
}

impl Directions {
    /// From what is seen in a direction, and within an angle (radians) of it.
    pub(crate) fn new(mut seen: impl FnMut(Vec3, f32) -> f32) -> Self {
        let angle = (PI / ROWS as f64) as f32;
        let middle = |i: usize, of: usize| (i as f64 + 0.5) / of as f64;
        let light: Vec<f64> = (0..ROWS * COLUMNS)
            .map(|k| seen(towards(middle(k % COLUMNS, COLUMNS), middle(k / COLUMNS, ROWS)), angle))
            .map(|light| if light.is_finite() { f64::from(light.max(0.0)) } else { 0.0 })
            .collect();
        // What is between cells is seen from both.
        let mut chance: Vec<f64> = (0..ROWS * COLUMNS)
            .map(|k| {
                let (row, column) = (k / COLUMNS, k % COLUMNS);
                let rows = row.saturating_sub(1)..=(row + 1).min(ROWS - 1);
                let columns = [column + COLUMNS - 1, column, column + 1].map(|c| c % COLUMNS);
                let near = rows.flat_map(|r| columns.map(|c| light[r * COLUMNS + c]));
                let (count, sum) = near.fold((0, 0.0), |(count, sum), light| (count + 1, sum + light));
                ((1.0 - BLUR) * light[k] + BLUR * sum / f64::from(count)) * solid_angle(row)
            })
            .collect();
        let all: f64 = chance.iter().sum();
        for (k, chance) in chance.iter_mut().enumerate() {
            let even = solid_angle(k / COLUMNS) / (4.0 * PI);
            *chance = if all > 0.0 { *chance / all * (1.0 - EVEN) + even * EVEN } else { even };
        }
        let sums = |chances: &[f64]| {
            let mut sum = 0.0;
            chances
                .iter()
                .map(|chance| {
                    sum += chance;
                    sum
                })
                .collect::<Vec<f64>>()
        };
        let rows = sums(&chance.chunks_exact(COLUMNS).map(|row| row.iter().sum()).collect::<Vec<f64>>());
        Self { rows, cells: chance.chunks_exact(COLUMNS).flat_map(sums).collect() }
    }

    /// The direction for a point of the unit square, and its chance per steradian.
    pub(crate) fn at(&self, x: f32, y: f32) -> (Vec3, f32) {
        let (row, down, _) = pick(&self.rows, f64::from(y));
        let (column, around, chance) = pick(&self.cells[row * COLUMNS..][..COLUMNS], f64::from(x));
        // Even over the cell: by height.
        let z = |row: usize| (PI * row as f64 / ROWS as f64).cos();
        let down = (z(row) + (z(row + 1) - z(row)) * down).clamp(-1.0, 1.0).acos() / PI;
        let dir = towards((column as f64 + around) / COLUMNS as f64, down);
        (dir, (chance / solid_angle(row)) as f32)
    }

    /// The angle across a cell, in radians.
    pub(crate) fn cell() -> f32 {
        (PI / ROWS as f64) as f32
    }
}

/// The part of growing sums that a fraction of the whole falls into, how far into it, and how large it is.
fn pick(sums: &[f64], fraction: f64) -> (usize, f64, f64) {
    let last = sums.len() - 1;
    let at = fraction.clamp(0.0, 1.0) * sums[last];
    let k = sums.partition_point(|sum| *sum <= at).min(last);
    let before = if k > 0 { sums[k - 1] } else { 0.0 };
    let size = sums[k] - before;
    (k, if size > 0.0 { ((at - before) / size).clamp(0.0, 1.0) } else { 0.5 }, size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::sample;

    /// Mean of `what (direction) / chance` over so many samples, and its standard deviation.
    fn integral(directions: &Directions, count: u32, what: impl Fn(Vec3) -> f32) -> (f64, f64) {
        let (mut sum, mut squares) = (0.0, 0.0);
        for i in 0..count {
            let (x, y) = sample::square(i, 7);
            let (dir, chance) = directions.at(x, y);
            assert!((dir.length() - 1.0).abs() < 1e-5 && chance > 0.0, "{dir} {chance}");
            let value = f64::from(what(dir) / chance);
            sum += value;
            squares += value * value;
        }
        let mean = sum / f64::from(count);
        (mean, (squares / f64::from(count) - mean * mean).max(0.0).sqrt())
    }

    #[test]
    fn an_even_sky_is_exact() {
        let directions = Directions::new(|_, _| 3.0);
        let (mean, deviation) = integral(&directions, 4096, |_| 3.0);
        assert!((mean / (12.0 * PI) - 1.0).abs() < 1e-4 && deviation < 1e-3 * mean, "{mean} {deviation}");
        // The same without any light.
        let (mean, _) = integral(&Directions::new(|_, _| f32::NAN), 4096, |_| 1.0);
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
            (0..64).map(|i| light(at(i))).sum::<f32>() / 64.0
        };
        let directions = Directions::new(seen);
        let exact = 4.0 * PI + 9999.0 * TAU * f64::from(1.0 - cos);
        let (mean, deviation) = integral(&directions, 1 << 16, light);
        assert!((mean / exact - 1.0).abs() < 0.02, "{mean} for {exact}");
        let (_, even) = integral(&Directions::new(|_, _| 1.0), 1 << 16, light);
        assert!(deviation < 0.2 * even, "{deviation}, and {even} of even directions");
    }
}
