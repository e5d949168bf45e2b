//! The conversion of linear light to the values of a screen as a table, for programs that draw by themselves, such as
//! the page of `iv -serve`.

use granita_color::Processor;
use rayon::prelude::*;

/// The number of colours that one task converts.
const CHUNK: usize = 4096;

/// The entries of the curves and the logarithms of their first and last place. Graphics interfaces have textures of so
/// many texels at least.
pub const CURVES: (usize, (f32, f32)) = (2048, (-16.0, 12.0));
/// The same for an edge of the cube.
pub const CUBE: (usize, (f32, f32)) = (65, (-10.0, 6.0));

/// A matrix and an offset, a cube behind them where colours are mixed in other ways, and curves behind these. Places in
/// tables are logarithms: entry 0 is the value at 0, and the others are at equal steps of the logarithm to the base 2.
/// Between entries, values are interpolated linearly. Places outside are clamped.
#[derive(Clone, Debug, PartialEq)]
pub struct ScreenTable {
    /// The matrix, row by row: each row gives one component of the result.
    pub matrix: [[f32; 3]; 3],
    /// The offset that is added to the product.
    pub offset: [f32; 3],
    /// The entries of the cube, red fastest; empty where there is none.
    pub cube: Vec<[f32; 3]>,
    /// The entries of the curves of the three components: values of the screen, from 0 to 1.
    pub curves: Vec<[f32; 3]>,
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

impl ScreenTable {
    /// Returns the table of a conversion.
    pub fn new(to_screen: &Processor) -> Self {
        let (matrix, offset, rest) = to_screen.split_matrix();
        let (mixed, last) = rest.split_curves();
        let n = CUBE.0;
        let mut cube: Vec<[f32; 3]> = match mixed.is_identity() {
            true => Vec::new(),
            false => (0..n * n * n).map(|k| [k % n, k / n % n, k / n / n].map(|i| at(i, CUBE))).collect(),
        };
        cube.par_chunks_mut(CHUNK).for_each(|colors| mixed.apply(colors.as_flattened_mut(), 3));
        let mut curves: Vec<[f32; 3]> = (0..CURVES.0).map(|i| [at(i, CURVES); 3]).collect();
        last.apply(curves.as_flattened_mut(), 3);
        curves.as_flattened_mut().iter_mut().for_each(|v| *v = if *v > 0.0 { v.min(1.0) } else { 0.0 });
        let matrix = matrix.map(|row| row.map(|v| v as f32));
        Self { matrix, offset: offset.map(|v| v as f32), cube, curves }
    }

    /// Returns a colour by the table, as a program that has it computes it.
    pub fn map(&self, rgb: [f32; 3]) -> [f32; 3] {
        let mut v =
            [0, 1, 2].map(|c| self.offset[c] + (0..3).map(|k| self.matrix[c][k] * rgb[k]).sum::<f32>());
        if !self.cube.is_empty() {
            let places = v.map(|v| place(v, CUBE));
            v = [0.0; 3];
            for corner in 0..8 {
                let (mut weight, mut index) = (1.0, 0);
                for (c, (i, t)) in places.iter().enumerate().rev() {
                    let upper = corner >> c & 1;
                    weight *= if upper == 1 { *t } else { 1.0 - t };
                    index = index * CUBE.0 + i + upper;
                }
                v.iter_mut().zip(self.cube[index]).for_each(|(v, entry)| *v += weight * entry);
            }
        }
        [0, 1, 2].map(|c| {
            let (i, t) = place(v[c], CURVES);
            self.curves[i][c] * (1.0 - t) + self.curves[i + 1][c] * t
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::hash;
    use granita_color::Config;

    /// Returns the permitted difference of light, as a part of white. Cubes are coarse where a dark component is the
    /// difference of bright ones, the more so far above white.
    fn tolerance(table: &ScreenTable, color: [f32; 3]) -> f32 {
        match (table.cube.is_empty(), color.iter().all(|v| *v <= 1.0)) {
            (true, _) => 0.004,
            (false, true) => 0.015,
            (false, false) => 0.25,
        }
    }

    #[test]
    fn tables_agree_with_the_views_of_the_built_in_configuration() {
        let config = Config::built_in();
        let (mut curves, mut cubes) = (0, 0);
        for display in config.displays() {
            for view in config.views(display) {
                let processor = config.display_processor("ACEScg", display, view).unwrap();
                let table = ScreenTable::new(&processor);
                *(if table.cube.is_empty() { &mut curves } else { &mut cubes }) += 1;
                for i in 0..2000_u32 {
                    let stops = hash::unit(hash::words(&[i, 9])) * 12.0 - 7.0;
                    let color = [0, 1, 2].map(|c| hash::unit(hash::words(&[i, c])) * stops.exp2());
                    let exact = processor.map(color).map(|v| v.clamp(0.0, 1.0));
                    let got = table.map(color);
                    let light = |v: f32| v.powf(2.2);
                    let differences = exact.iter().zip(got).map(|(a, b)| (light(*a) - light(b)).abs());
                    let worst = differences.fold(0.0, f32::max);
                    assert!(
                        worst <= tolerance(&table, color),
                        "{display} {view} {color:?}: {got:?} {exact:?}"
                    );
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
        let table = ScreenTable::new(&Processor::power(0.5));
        assert_eq!(table.map([f32::INFINITY, -1.0, 0.0]), [1.0, 0.0, 0.0]);
        assert!((table.map([0.25; 3])[0] - 0.5).abs() < 1e-4);
    }
}
