//! Cubic bases, and their conversion to Bezier control values.

use granita_base::CurveBasis;

/// A 4x4 matrix that acts on columns of control values. The rows belong to powers 3, 2, 1, 0 of the parameter.
pub(crate) type Matrix4 = [[f64; 4]; 4];

/// A basis of the RenderMan interface, with its step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Basis {
    pub(crate) matrix: Matrix4,
    pub(crate) step: usize,
    /// The same basis of the scene interface, if it has one with this step.
    pub(crate) native: Option<CurveBasis>,
}

const BEZIER: Matrix4 =
    [[-1.0, 3.0, -3.0, 1.0], [3.0, -6.0, 3.0, 0.0], [-3.0, 3.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]];

/// The inverse of `BEZIER`. It converts powers to control values.
const FROM_POWERS: Matrix4 = [
    [0.0, 0.0, 0.0, 1.0],
    [0.0, 0.0, 1.0 / 3.0, 1.0],
    [0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0],
    [1.0, 1.0, 1.0, 1.0],
];

/// Solves a system of four equations by elimination. Returns `None` when there is no solution.
fn solved(matrix: &Matrix4, right: [f64; 4]) -> Option<[f64; 4]> {
    let mut rows: [[f64; 5]; 4] =
        std::array::from_fn(|i| std::array::from_fn(|j| if j < 4 { matrix[i][j] } else { right[i] }));
    for c in 0..4 {
        let pivot = (c..4).max_by(|a, b| rows[*a][c].abs().total_cmp(&rows[*b][c].abs()))?;
        rows.swap(c, pivot);
        if rows[c][c].abs() < 1e-12 {
            return None;
        }
        for i in (0..4).filter(|i| *i != c) {
            let pivot_row = rows[c];
            let factor = rows[i][c] / pivot_row[c];
            for (value, pivot) in rows[i].iter_mut().zip(pivot_row).skip(c) {
                *value -= factor * pivot;
            }
        }
    }
    Some(std::array::from_fn(|i| rows[i][4] / rows[i][i]))
}

impl Basis {
    /// The default basis.
    pub(crate) const BEZIER: Self = Self { matrix: BEZIER, step: 3, native: Some(CurveBasis::Bezier) };

    /// Returns a basis by its name, with the step that belongs to it.
    pub(crate) fn named(name: &str) -> Option<Self> {
        let sixth = 1.0 / 6.0;
        Some(match name {
            "bezier" => Self::BEZIER,
            "b-spline" | "bspline" => Self {
                matrix: [
                    [-sixth, 0.5, -0.5, sixth],
                    [0.5, -1.0, 0.5, 0.0],
                    [-0.5, 0.0, 0.5, 0.0],
                    [sixth, 4.0 * sixth, sixth, 0.0],
                ],
                step: 1,
                native: Some(CurveBasis::BSpline),
            },
            "catmull-rom" => Self {
                matrix: [
                    [-0.5, 1.5, -1.5, 0.5],
                    [1.0, -2.5, 2.0, -0.5],
                    [-0.5, 0.0, 0.5, 0.0],
                    [0.0, 1.0, 0.0, 0.0],
                ],
                step: 1,
                native: Some(CurveBasis::CatmullRom),
            },
            "hermite" => Self {
                matrix: [
                    [2.0, 1.0, -2.0, 1.0],
                    [-3.0, -2.0, 3.0, -1.0],
                    [0.0, 1.0, 0.0, 0.0],
                    [1.0, 0.0, 0.0, 0.0],
                ],
                step: 2,
                native: None,
            },
            "power" => Self {
                matrix: [
                    [1.0, 0.0, 0.0, 0.0],
                    [0.0, 1.0, 0.0, 0.0],
                    [0.0, 0.0, 1.0, 0.0],
                    [0.0, 0.0, 0.0, 1.0],
                ],
                step: 4,
                native: None,
            },
            _ => return None,
        })
    }

    /// Returns the basis of any matrix.
    pub(crate) fn of(matrix: &[f32], step: usize) -> Option<Self> {
        let rows: [f32; 16] = matrix.try_into().ok()?;
        let matrix = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(rows[4 * i + j])));
        Some(Self { matrix, step, native: None }.recognised())
    }

    /// Returns the same basis with another step.
    pub(crate) fn with_step(self, step: usize) -> Self {
        Self { step, ..self }.recognised()
    }

    /// Sets the basis of the scene interface. A matrix and step that are those of a named basis count as that basis.
    fn recognised(self) -> Self {
        let native =
            ["bezier", "b-spline", "catmull-rom"].into_iter().filter_map(Self::named).find(|named| {
                let close = |i: usize| (self.matrix[i / 4][i % 4] - named.matrix[i / 4][i % 4]).abs() < 1e-6;
                named.step == self.step && (0..16).all(close)
            });
        Self { native: native.and_then(|n| n.native), ..self }
    }

    /// Returns the number of segments of `n` control values; `None` when that number does not make whole segments.
    pub(crate) fn segments(&self, n: usize, periodic: bool) -> Option<usize> {
        if self.step == 0 {
            None
        } else if periodic {
            (n > 0 && n.is_multiple_of(self.step)).then_some(n / self.step)
        } else {
            (n >= 4 && (n - 4).is_multiple_of(self.step)).then(|| (n - 4) / self.step + 1)
        }
    }

    /// Returns the `n` control values of the curve that is its own parameter, from 0 to 1 over all segments; `None`
    /// when the basis has no such curve.
    pub(crate) fn parameter(&self, n: usize, periodic: bool) -> Option<Vec<f64>> {
        let segments = self.segments(n, periodic)?;
        let one = solved(&self.matrix, [0.0, 0.0, 0.0, 1.0])?;
        let slope = solved(&self.matrix, [0.0, 0.0, 1.0, 0.0])?;
        let mut values = vec![None; n];
        for segment in 0..segments {
            for j in 0..4 {
                let value = (slope[j] + segment as f64 * one[j]) / segments as f64;
                values[(segment * self.step + j) % n].get_or_insert(value);
            }
        }
        // With steps larger than four, some control values belong to no segment.
        Some(values.into_iter().map(Option::unwrap_or_default).collect())
    }

    /// Returns the weights of the four control values for each Bezier control value of a segment.
    pub(crate) fn to_bezier(self) -> Matrix4 {
        let product = |i: usize, j: usize| (0..4).map(|k| FROM_POWERS[i][k] * self.matrix[k][j]).sum();
        std::array::from_fn(|i| std::array::from_fn(|j| product(i, j)))
    }

    /// Converts `n` control items of `width` numbers to Bezier control items. There are three for each segment and one
    /// at the end. A periodic curve repeats its first item there.
    pub(crate) fn converted(&self, values: &[f32], width: usize, n: usize, periodic: bool) -> Vec<f32> {
        let Some(segments) = self.segments(n, periodic) else { return Vec::new() };
        let weights = self.to_bezier();
        let mut out = Vec::with_capacity((3 * segments + 1) * width);
        let mut point = |segment: usize, row: usize| {
            for c in 0..width {
                let sum: f64 = (0..4)
                    .map(|j| {
                        let item = (segment * self.step + j) % n;
                        weights[row][j] * f64::from(values[item * width + c])
                    })
                    .sum();
                out.push(sum as f32);
            }
        };
        for segment in 0..segments {
            (0..3).for_each(|row| point(segment, row));
        }
        point(segments - 1, 3);
        if periodic {
            let first = out[..width].to_vec();
            let at = out.len() - width;
            out[at..].copy_from_slice(&first);
        }
        out
    }
}

/// Converts values at the ends of segments to Bezier control values, which blend linearly in between.
pub(crate) fn linear_as_bezier(values: &[f32], width: usize) -> Vec<f32> {
    let n = values.len() / width.max(1);
    let mut out = Vec::with_capacity((3 * n).saturating_sub(2) * width);
    for i in 0..n.saturating_sub(1) {
        for k in 0..3 {
            for c in 0..width {
                let (a, b) = (values[i * width + c], values[(i + 1) * width + c]);
                out.push(a + (b - a) * (k as f32 / 3.0));
            }
        }
    }
    if n > 0 {
        out.extend(&values[(n - 1) * width..n * width]);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn basis_parameters_vary_linearly_along_the_bezier_curve() {
        for (name, n) in [("bezier", 7), ("b-spline", 6), ("catmull-rom", 5), ("hermite", 6), ("power", 8)] {
            let basis = Basis::named(name).unwrap();
            let values: Vec<f32> = basis.parameter(n, false).unwrap().iter().map(|v| *v as f32).collect();
            let bezier = basis.converted(&values, 1, n, false);
            let last = (bezier.len() - 1) as f32;
            for (k, value) in bezier.iter().enumerate() {
                assert!((value - k as f32 / last).abs() < 1e-6, "{name}: {bezier:?}");
            }
        }
        assert!(Basis::of(&[0.0; 16], 1).unwrap().parameter(4, false).is_none());
    }

    fn at(basis: &Basis, p: [f64; 4], t: f64) -> f64 {
        let powers = [t * t * t, t * t, t, 1.0];
        (0..4).map(|i| powers[i] * (0..4).map(|j| basis.matrix[i][j] * p[j]).sum::<f64>()).sum()
    }

    #[test]
    fn conversion_to_bezier_keeps_the_curve_for_all_bases() {
        let values = [1.0_f32, -2.0, 0.5, 4.0, 3.0, -1.0, 2.0, 0.0, 1.5, 2.5];
        for name in ["bezier", "b-spline", "catmull-rom", "hermite", "power"] {
            let basis = Basis::named(name).unwrap();
            let n = 4 + basis.step;
            let bezier = basis.converted(&values, 1, n, false);
            assert_eq!(bezier.len(), 7, "{name}");
            for segment in 0..2 {
                let p = std::array::from_fn(|j| f64::from(values[segment * basis.step + j]));
                let q = std::array::from_fn(|j| f64::from(bezier[3 * segment + j]));
                for t in [0.0, 0.3, 0.9] {
                    let (a, b) = (at(&basis, p, t), at(&Basis::BEZIER, q, t));
                    // At the joint of two segments, only continuous curves have one value.
                    let joined = !matches!(name, "power");
                    assert!((a - b).abs() < 1e-5 || !joined, "{name} {segment} {t}: {a} {b}");
                }
            }
            assert_eq!(basis.segments(n + 1, false).is_some(), basis.step == 1, "{name}");
        }
        let closed = Basis::named("b-spline").unwrap().converted(&values[..5], 1, 5, true);
        assert_eq!((closed.len(), closed[0]), (16, closed[15]));
        assert_eq!(linear_as_bezier(&[0.0, 3.0, 0.0], 1), [0.0, 1.0, 2.0, 3.0, 2.0, 1.0, 0.0]);
    }

    #[test]
    fn known_bases_are_recognised_by_their_matrix() {
        let rows: Vec<f32> =
            Basis::named("b-spline").unwrap().matrix.iter().flatten().map(|x| *x as f32).collect();
        assert_eq!(Basis::of(&rows, 1).unwrap().native, Some(CurveBasis::BSpline));
        assert_eq!(Basis::of(&rows, 3).unwrap().native, None);
        assert_eq!(Basis::BEZIER.with_step(1).native, None);
        assert!(Basis::of(&rows[1..], 1).is_none());
    }
}
