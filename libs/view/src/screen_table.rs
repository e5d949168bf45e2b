//! The conversion of linear light to the values of a screen as a table, for programs that draw by themselves, such as
//! the page of `iv -serve`.

use granita_color::Processor;
use granita_color::primaries::{IDENTITY, Matrix3, inverse};
use rayon::prelude::*;

/// The number of colours that one task converts.
const CHUNK: usize = 4096;

/// The entries of the curves and the logarithms of their first and last place. Graphics interfaces have textures of so
/// many texels at least. White is at an entry, because many curves end there.
pub const CURVES: (usize, (f32, f32)) = (16 * 73 + 12 * 73 + 1, (-16.0, 12.0));
/// The same for an edge of the cube.
pub const CUBE: (usize, (f32, f32)) = (18 * 4 + 1, (-10.0, 8.0));
/// The scale of the entries of the cube: much smaller values are stored linearly, and greater ones as logarithms.
pub const SMALL: f32 = 1.0 / 4096.0;
/// The largest value of linear light. Greater ones, which would make differences of infinities, are limited to it
/// first.
const LARGEST: f32 = 1.0e30;

/// Where colours are mixed in other ways than by a matrix, a matrix and a cube. Then a matrix and an offset, then
/// curves. Places in tables are logarithms: entry 0 is the value at 0, and the others are at equal steps of
/// the logarithm to the base 2. Places outside are clamped. Between the entries of curves, values are interpolated
/// linearly.
///
/// Entries of the cube are logarithms too: v is stored as the logarithm to the base 2 of 1 + |v| / [`SMALL`], with the
/// sign of v. A colour lies in one of the six tetrahedra of entries that share the diagonal of their cell, and the four
/// entries are interpolated linearly. The first matrix leads to the space in which the conversion has its curves, where
/// it is close to a curve for each component. So such a coarse cube suffices.
#[derive(Clone, Debug, PartialEq)]
pub struct ScreenTable {
    /// The matrix before the cube, row by row. Each row gives one component of the result.
    pub first: [[f32; 3]; 3],
    /// The entries of the cube, red fastest; empty where there is none.
    pub cube: Vec<[f32; 3]>,
    /// The matrix after the cube, row by row.
    pub last: [[f32; 3]; 3],
    /// The offset that is added after it.
    pub offset: [f32; 3],
    /// The entries of the curves of the three components: values of the screen, from 0 to 1.
    pub curves: Vec<[f32; 3]>,
}

/// Returns the product of a matrix and a colour.
fn product(matrix: &[[f32; 3]; 3], v: [f32; 3]) -> [f32; 3] {
    matrix.map(|row| row.iter().zip(v).map(|(m, v)| m * v).sum())
}

/// Returns the value at an entry.
fn at(i: usize, (edge, (low, high)): (usize, (f32, f32))) -> f32 {
    if i == 0 { 0.0 } else { (low + (high - low) * i as f32 / (edge - 1) as f32).exp2() }
}

/// Returns the entry below a value, and the part of the step to the next one.
fn place(v: f32, (edge, (low, high)): (usize, (f32, f32))) -> (usize, f32) {
    let place = (v.max(low.exp2()).log2() - low) / (high - low) * (edge - 1) as f32;
    let place = place.clamp(0.0, (edge - 1) as f32);
    let i = (place as usize).min(edge - 2);
    (i, place - i as f32)
}

/// Returns an entry of the cube for a value.
fn encoded(v: f32) -> f32 {
    (1.0 + v.abs() / SMALL).log2().copysign(v)
}

/// Returns the value of an entry of the cube.
fn decoded(v: f32) -> f32 {
    ((v.abs().exp2() - 1.0) * SMALL).copysign(v)
}

impl ScreenTable {
    /// Returns the table of a conversion.
    pub fn new(to_screen: &Processor) -> Self {
        let (rest, curves_of_screen) = to_screen.split_curves();
        let (mixed, matrix, offset) = rest.split_matrix();
        let floats = |matrix: Matrix3| matrix.map(|row| row.map(|v| v as f32));
        let (last, offset) = (floats(matrix), offset.map(|v| v as f32));
        let mut curves: Vec<[f32; 3]> = (0..CURVES.0).map(|i| [at(i, CURVES); 3]).collect();
        curves_of_screen.apply(curves.as_flattened_mut(), 3);
        curves.as_flattened_mut().iter_mut().for_each(|v| *v = if *v > 0.0 { v.min(1.0) } else { 0.0 });
        if mixed.is_identity() {
            return Self { first: floats(IDENTITY), cube: Vec::new(), last, offset, curves };
        }
        let (first, back) = match mixed.first_matrices() {
            first if let Some(back) = inverse(&first) => (first, back),
            _ => (IDENTITY, IDENTITY),
        };
        let n = CUBE.0;
        let back = floats(back);
        let color = |k: usize| product(&back, [k % n, k / n % n, k / n / n].map(|i| at(i, CUBE)));
        let mut cube: Vec<[f32; 3]> = (0..n * n * n).map(color).collect();
        cube.par_chunks_mut(CHUNK).for_each(|colors| {
            mixed.apply(colors.as_flattened_mut(), 3);
            colors.as_flattened_mut().iter_mut().for_each(|v| *v = encoded(*v));
        });
        Self { first: floats(first), cube, last, offset, curves }
    }

    /// Returns a colour by the table, as a program that has it computes it.
    pub fn map(&self, rgb: [f32; 3]) -> [f32; 3] {
        let mut v = product(&self.first, rgb.map(|v| v.clamp(-LARGEST, LARGEST)));
        if !self.cube.is_empty() {
            let [(i, x), (j, y), (k, z)] = v.map(|v| place(v, CUBE));
            // The axes by which the second and the last entry differ from their neighbours on the diagonal.
            let one = if x >= y && x >= z { 0 } else { 2 - usize::from(y >= z) };
            let other = if x < y && x < z { 0 } else { 2 - usize::from(y < z) };
            let step = [1, CUBE.0, CUBE.0 * CUBE.0];
            let start = i + j * step[1] + k * step[2];
            let end = start + step.iter().sum::<usize>();
            let (most, least) = ([x, y, z][one], [x, y, z][other]);
            let middle = x + y + z - most - least;
            let corners = [
                (start, 1.0 - most),
                (start + step[one], most - middle),
                (end - step[other], middle - least),
                (end, least),
            ];
            let entry = |c: usize| corners.iter().map(|(at, weight)| weight * self.cube[*at][c]).sum();
            v = [0, 1, 2].map(|c| decoded(entry(c)));
        }
        let v = product(&self.last, v);
        [0, 1, 2].map(|c| {
            let (i, t) = place(v[c] + self.offset[c], CURVES);
            self.curves[i][c] * (1.0 - t) + self.curves[i + 1][c] * t
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::hash;
    use granita_color::Config;

    #[test]
    fn tables_agree_with_the_views_of_the_built_in_configuration() {
        let config = Config::built_in();
        let (mut curves, mut cubes) = (0, 0);
        for display in config.displays() {
            for view in config.views(display) {
                let processor = config.display_processor("ACEScg", display, view).unwrap();
                let table = ScreenTable::new(&processor);
                *(if table.cube.is_empty() { &mut curves } else { &mut cubes }) += 1;
                // Differences of light, as parts of white.
                let [dark, bright] = if table.cube.is_empty() { [0.0005; 2] } else { [0.005, 0.014] };
                for i in 0..4000_u32 {
                    let stops = hash::unit(hash::words(&[i, 9])) * 15.0 - 7.0;
                    let color = [0, 1, 2].map(|c| hash::unit(hash::words(&[i, c])) * stops.exp2());
                    let exact = processor.map(color).map(|v| v.clamp(0.0, 1.0));
                    let got = table.map(color);
                    let light = |v: f32| v.powf(2.2);
                    let differences = exact.iter().zip(got).map(|(a, b)| (light(*a) - light(b)).abs());
                    let worst = differences.fold(0.0, f32::max);
                    let permitted = if color.iter().all(|v| *v <= 1.0) { dark } else { bright };
                    assert!(worst <= permitted, "{display} {view} {color:?}: {got:?} {exact:?} {worst}");
                }
                assert!(
                    table
                        .map([0.0; 3])
                        .iter()
                        .zip(processor.map([0.0; 3]))
                        .all(|(a, b)| (a - b).abs() < 0.005)
                );
            }
        }
        assert!(curves > 3 && cubes > 1, "{curves} {cubes}");
    }

    #[test]
    fn values_that_are_not_finite_have_a_colour() {
        let config = Config::built_in();
        let cube = config.display_processor("ACEScg", "sRGB - Display", "ACES 1.0 - SDR Video").unwrap();
        let seen = ScreenTable::new(&cube).map([f32::INFINITY, -1.0, 0.0]);
        assert!(seen.iter().all(|v| (0.0..=1.0).contains(v)), "{seen:?}");
        let table = ScreenTable::new(&Processor::power(0.5));
        assert_eq!(table.map([f32::INFINITY, -1.0, 0.0]), [1.0, 0.0, 0.0]);
        assert!((table.map([0.25; 3])[0] - 0.5).abs() < 1e-4);
    }
}
