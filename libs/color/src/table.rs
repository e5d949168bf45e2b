//! Lookup tables of one and of three dimensions.

/// The interpolation between the entries of a lookup table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Interpolation {
    /// The nearest entry. Of tables of one dimension and of three.
    Nearest,
    /// Linear in each dimension.
    #[default]
    Linear,
    /// Linear in the tetrahedra of a cell of three dimensions.
    Tetrahedral,
}

/// The largest number of entries of a table of one dimension, and the largest edge of one of three.
pub(crate) const MAX_ENTRIES: usize = 1 << 20;
pub(crate) const MAX_EDGE: usize = 256;

/// A table of one dimension. Its entries are spread evenly over [0, 1], and values outside are clamped.
#[derive(Clone, Debug, PartialEq)]
pub struct Lut1d {
    /// The entries, at least two.
    pub(crate) table: Vec<[f32; 3]>,
    /// The interpolation.
    pub(crate) interpolation: Interpolation,
}

impl Lut1d {
    /// Returns the table of entries; `None` with fewer than two.
    pub fn new(table: Vec<[f32; 3]>, interpolation: Interpolation) -> Option<Self> {
        (table.len() >= 2).then_some(Self { table, interpolation })
    }

    /// Returns the value of a channel.
    pub(crate) fn lookup(&self, v: f32, channel: usize, nearest: bool) -> f32 {
        let last = self.table.len() - 1;
        let at = f64::from(if v > 0.0 { v.min(1.0) } else { 0.0 }) * last as f64;
        if nearest {
            return self.table[(at + 0.5) as usize][channel];
        }
        let i = (at as usize).min(last.saturating_sub(1));
        let (a, b) = (f64::from(self.table[i][channel]), f64::from(self.table[(i + 1).min(last)][channel]));
        (a + (b - a) * (at - i as f64)) as f32
    }

    /// Returns the inverse of a channel.
    pub(crate) fn inverse(&self, channel: usize) -> LutInverse {
        LutInverse::new(self.table.iter().map(|row| row[channel]).collect())
    }
}

/// The inverse of a table of one dimension. The table is made monotonic: an entry against its direction becomes the
/// one before.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LutInverse {
    /// The entries in ascending order.
    ascending: Vec<f32>,
    /// True when the table descends.
    descends: bool,
}

impl LutInverse {
    fn new(mut values: Vec<f32>) -> Self {
        let descends = values.last() < values.first();
        if descends {
            for i in 1..values.len() {
                values[i] = values[i].min(values[i - 1]);
            }
            values.reverse();
        } else {
            for i in 1..values.len() {
                values[i] = values[i].max(values[i - 1]);
            }
        }
        Self { ascending: values, descends }
    }

    /// Returns the value in [0, 1] whose entry is `v`. Among several, the one nearest to where the table leaves `v`
    /// from below.
    pub(crate) fn lookup(&self, v: f32) -> f32 {
        let t = &self.ascending;
        let last = t.len() - 1;
        // Values beyond the ends are at the inner end of a flat part.
        let start = t.partition_point(|x| *x <= t[0]).saturating_sub(1);
        let end = t.partition_point(|x| *x < t[last]);
        let at = if v.is_nan() || v <= t[start] {
            start as f64
        } else if v >= t[end] {
            end as f64
        } else {
            let i = t.partition_point(|x| *x < v);
            let (a, b) = (f64::from(t[i - 1]), f64::from(t[i]));
            (i - 1) as f64 + if b > a { (f64::from(v) - a) / (b - a) } else { 0.0 }
        };
        let x = at / last as f64;
        (if self.descends { 1.0 - x } else { x }) as f32
    }
}

/// A table of three dimensions. Its entries are spread evenly over the unit cube, and values outside are clamped.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Lut3d {
    /// The number of entries along each edge, at least 2.
    pub(crate) edge: usize,
    /// The entries: blue varies fastest, red slowest.
    pub(crate) table: Vec<[f32; 3]>,
    /// The interpolation.
    pub(crate) interpolation: Interpolation,
}

impl Lut3d {
    #[inline(always)]
    fn entry(&self, r: usize, g: usize, b: usize) -> [f32; 3] {
        self.table[(r * self.edge + g) * self.edge + b]
    }

    /// Returns the interpolated entry.
    pub(crate) fn lookup(&self, rgb: [f32; 3], interpolation: Interpolation) -> [f32; 3] {
        let last = self.edge - 1;
        let at = rgb.map(|v| (if v > 0.0 { v.min(1.0) } else { 0.0 }) * last as f32);
        let low = at.map(|v| (v as usize).min(last - 1));
        let f = [0, 1, 2].map(|c| at[c] - low[c] as f32);
        let [r, g, b] = low;
        match interpolation {
            Interpolation::Nearest => {
                let near = at.map(|v| (v + 0.5) as usize);
                self.entry(near[0], near[1], near[2])
            }
            Interpolation::Linear => {
                let mix = |a: [f32; 3], b: [f32; 3], t: f32| [0, 1, 2].map(|c| a[c] + (b[c] - a[c]) * t);
                let blue = |r, g| mix(self.entry(r, g, b), self.entry(r, g, b + 1), f[2]);
                let green = |r| mix(blue(r, g), blue(r, g + 1), f[1]);
                mix(green(r), green(r + 1), f[0])
            }
            Interpolation::Tetrahedral => {
                // Walk from the lower to the upper corner along the axes, the largest fraction first.
                let mut order = [0, 1, 2];
                order.sort_by(|i, j| f[*j].total_cmp(&f[*i]));
                let mut corner = low;
                let mut found = self.entry(r, g, b);
                let mut before = found;
                for axis in order {
                    corner[axis] += 1;
                    let next = self.entry(corner[0], corner[1], corner[2]);
                    for c in 0..3 {
                        found[c] += (next[c] - before[c]) * f[axis];
                    }
                    before = next;
                }
                found
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_interpolate_and_clamp() {
        let table = [0.0, 1.0, 4.0].map(|v| [v; 3]).to_vec();
        let lut = Lut1d { table, interpolation: Interpolation::Linear };
        let got = [-1.0, 0.0, 0.25, 0.5, 0.75, 1.0, 9.0].map(|v| lut.lookup(v, 0, false));
        assert_eq!(got, [0.0, 0.0, 0.5, 1.0, 2.5, 4.0, 4.0]);
        assert_eq!([0.2, 0.3, 0.8].map(|v| lut.lookup(v, 0, true)), [0.0, 1.0, 4.0]);
        assert_eq!(lut.lookup(f32::NAN, 0, false), 0.0);
        let inverse = lut.inverse(0);
        assert_eq!(
            [-1.0, 0.0, 0.5, 1.0, 2.5, 4.0, 9.0].map(|v| inverse.lookup(v)),
            [0.0, 0.0, 0.25, 0.5, 0.75, 1.0, 1.0]
        );
    }

    #[test]
    fn inverses_of_flat_descending_and_broken_tables_are_defined() {
        let of = |values: &[f32]| LutInverse::new(values.to_vec());
        assert_eq!([1.0, 0.5, 0.0, 2.0].map(|v| of(&[1.0, 0.5, 0.0]).lookup(v)), [0.0, 0.5, 1.0, 0.0]);
        // Flat ends: the inner end is found.
        let flat = of(&[0.0, 0.0, 1.0, 1.0]);
        assert!((flat.lookup(0.0) - 1.0 / 3.0).abs() < 1e-6 && (flat.lookup(1.0) - 2.0 / 3.0).abs() < 1e-6);
        assert_eq!(of(&[0.5, 0.5]).lookup(0.7), of(&[0.5, 0.5]).lookup(0.7));
        // An entry against the direction counts as the one before.
        assert!(of(&[0.0, 0.6, 0.4, 1.0]).lookup(0.8) > 0.6);
        assert_eq!(of(&[0.0, 1.0]).lookup(f32::NAN), 0.0);
    }

    #[test]
    fn interpolations_of_a_linear_cube_agree() {
        let n = 4;
        let mut table = Vec::new();
        for i in 0..n * n * n {
            let (r, g, b) = (i / 16, i / 4 % 4, i % 4);
            table.push([r as f32 / 3.0, g as f32 / 3.0 * 0.5, b as f32 / 3.0 + r as f32]);
        }
        let lut = Lut3d { edge: n, table, interpolation: Interpolation::Linear };
        for rgb in [[0.1, 0.5, 0.9], [0.0, 1.0, 0.3], [0.99, 0.2, 0.2], [1.0, 1.0, 1.0]] {
            for kind in [Interpolation::Linear, Interpolation::Tetrahedral] {
                let got = lut.lookup(rgb, kind);
                let expected = [rgb[0], rgb[1] * 0.5, rgb[2] + rgb[0] * 3.0];
                assert!(
                    got.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5),
                    "{kind:?} {rgb:?} {got:?}"
                );
            }
        }
        assert_eq!(lut.lookup([0.2, 0.0, 0.0], Interpolation::Nearest)[0], 1.0 / 3.0);
        assert_eq!(lut.lookup([f32::NAN, -1.0, 2.0], Interpolation::Tetrahedral), [0.0, 0.0, 1.0]);
    }
}
