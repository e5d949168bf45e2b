//! Runs `spline` (reference 5.8.6) with five bases, and their inverses.

use super::compute_as;
use crate::Lane;
use crate::program::Op;
use crate::run::machine::Machine;
use granita_gsl::ir::{SymbolId, ValueType};

/// A basis of splines.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Basis {
    /// The weights of four values for t^3, t^2, t and 1.
    weights: [[f32; 4]; 4],
    /// The number of values from one segment to the next.
    step: usize,
}

/// Returns the basis of a name.
fn basis(word: &str) -> Option<Basis> {
    Some(match word {
        "catmull-rom" => Basis {
            weights: [
                [-0.5, 1.5, -1.5, 0.5],
                [1.0, -2.5, 2.0, -0.5],
                [-0.5, 0.0, 0.5, 0.0],
                [0.0, 1.0, 0.0, 0.0],
            ],
            step: 1,
        },
        "bezier" => Basis {
            weights: [
                [-1.0, 3.0, -3.0, 1.0],
                [3.0, -6.0, 3.0, 0.0],
                [-3.0, 3.0, 0.0, 0.0],
                [1.0, 0.0, 0.0, 0.0],
            ],
            step: 3,
        },
        "bspline" | "b-spline" => {
            const S: f32 = 1.0 / 6.0;
            Basis {
                weights: [
                    [-S, 0.5, -0.5, S],
                    [0.5, -1.0, 0.5, 0.0],
                    [-0.5, 0.0, 0.5, 0.0],
                    [S, 4.0 * S, S, 0.0],
                ],
                step: 1,
            }
        }
        // The order is value, slope, value, slope.
        "hermite" => Basis {
            weights: [
                [2.0, 1.0, -2.0, 1.0],
                [-3.0, -2.0, 3.0, -1.0],
                [0.0, 1.0, 0.0, 0.0],
                [1.0, 0.0, 0.0, 0.0],
            ],
            step: 2,
        },
        // As with Catmull-Rom, the first and last values are not used.
        "linear" => {
            Basis { weights: [[0.0; 4], [0.0; 4], [0.0, -1.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0]], step: 1 }
        }
        _ => return None,
    })
}

impl Basis {
    /// Returns the number of segments of `n` values. At least 4 values are needed.
    fn segments(&self, n: usize) -> usize {
        if n < 4 { 0 } else { (n - 4) / self.step + 1 }
    }

    /// Returns the value at `x` in [0, 1] of the values `y (0)` to `y (n - 1)`.
    fn value(&self, x: f32, n: usize, y: impl Fn(usize) -> f32) -> f32 {
        let segments = self.segments(n);
        if segments == 0 {
            return 0.0;
        }
        let s = if x.is_nan() { 0.0 } else { x.clamp(0.0, 1.0) } * segments as f32;
        let segment = (s as usize).min(segments - 1);
        self.in_segment(segment, s - segment as f32, y)
    }

    /// Returns the value at `t` in [0, 1] of a segment.
    fn in_segment(&self, segment: usize, t: f32, y: impl Fn(usize) -> f32) -> f32 {
        let first = segment * self.step;
        let knots: [f32; 4] = std::array::from_fn(|k| y(first + k));
        let [a, b, c, d] =
            self.weights.map(|w| w[0] * knots[0] + w[1] * knots[1] + w[2] * knots[2] + w[3] * knots[3]);
        ((a * t + b) * t + c) * t + d
    }

    /// Returns the position in [0, 1] where a monotonic spline has `value`; its nearer end outside of its range.
    fn solve(&self, value: f32, n: usize, y: impl Fn(usize) -> f32 + Copy) -> f32 {
        let segments = self.segments(n);
        if segments == 0 || value.is_nan() {
            return 0.0;
        }
        let (start, end) = (self.in_segment(0, 0.0, y), self.in_segment(segments - 1, 1.0, y));
        // A falling spline is processed as a rising one with the opposite sign.
        let sign = if end < start { -1.0 } else { 1.0 };
        let above = |v: f32| sign * v >= sign * value;
        if above(start) {
            return 0.0;
        }
        let segment = (0..segments).find(|&s| above(self.in_segment(s, 1.0, y)));
        let Some(segment) = segment else { return 1.0 };
        let (mut low, mut high) = (0.0_f32, 1.0_f32);
        for _ in 0..26 {
            let middle = 0.5 * (low + high);
            if above(self.in_segment(segment, middle, y)) {
                high = middle;
            } else {
                low = middle;
            }
        }
        (segment as f32 + 0.5 * (low + high)) / segments as f32
    }
}

/// The values of a spline: elements of an array, or operands.
enum Knots<'s> {
    Array(SymbolId, usize),
    List(&'s [SymbolId]),
}

impl Knots<'_> {
    fn count(&self) -> usize {
        match self {
            Self::Array(_, n) => *n,
            Self::List(list) => list.len(),
        }
    }

    fn lane<'v>(&self, m: &'v Machine<'_>, k: usize, c: usize) -> Lane<'v> {
        match self {
            Self::Array(symbol, _) => m.view(*symbol).lane_at(k, c),
            Self::List(list) => m.view(list[k]).lane(c),
        }
    }
}

/// `spline ([basis,] x, y0, ...)` or `spline ([basis,] x, y[])`.
pub(super) fn run(m: &mut Machine<'_>, op: &Op) {
    let Some(dst) = op.dst else { return };
    let named = m.type_of(op.args[0]) == ValueType::String;
    let given = named.then(|| m.string(op.args[0]));
    let name = given.as_deref().unwrap_or("catmull-rom");
    let (word, inverse) = match name.strip_prefix("solve") {
        Some(word) => (word, true),
        None => (name, false),
    };
    let args = &op.args[usize::from(named)..];
    let basis = basis(word).unwrap_or_else(|| {
        m.complain(op.at, &format!("there is no spline basis \"{name}\""));
        basis("catmull-rom").expect("invariant: the name is in the table")
    });
    let Some((&x, values)) = args.split_first() else { return };
    let knots = match values {
        [array] if m.place(*array).array => Knots::Array(*array, m.place(*array).elements as usize),
        list => Knots::List(list),
    };
    let n = knots.count();
    if n < 4 {
        m.complain(op.at, &format!("a spline needs 4 values, not {n}"));
    }
    let components = m.type_of(dst).components();
    let varying = m.varies(args);
    compute_as(m, dst, varying, components, |m, out, work| {
        let x = m.view(x).lane(0);
        for c in 0..components {
            // Short splines need no allocation. Long ones are rare.
            const FEW: usize = 32;
            let mut few = [Lane { values: &[0.0], stride: 0 }; FEW];
            let many: Vec<Lane<'_>>;
            let lanes: &[Lane<'_>] = if n <= FEW {
                few.iter_mut().enumerate().take(n).for_each(|(k, lane)| *lane = knots.lane(m, k, c));
                &few[..n]
            } else {
                many = (0..n).map(|k| knots.lane(m, k, c)).collect();
                &many
            };
            work.each(|i| {
                let y = |k: usize| lanes[k].get(i);
                let v = if inverse { basis.solve(x.get(i), n, y) } else { basis.value(x.get(i), n, y) };
                out.set(c, i, v);
            });
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(word: &str, x: f32, y: &[f32]) -> f32 {
        basis(word).unwrap().value(x, y.len(), |k| y[k])
    }

    #[test]
    fn splines_have_known_values_at_knots() {
        let y = [0.0, 1.0, 4.0, 2.0, 7.0];
        assert_eq!(value("catmull-rom", 0.0, &y), 1.0);
        assert_eq!(value("catmull-rom", 0.5, &y), 4.0);
        assert_eq!(value("catmull-rom", 1.0, &y), 2.0);
        assert_eq!(value("linear", 0.25, &y), 2.5);
        assert_eq!(value("linear", 2.0, &y), 2.0);
        assert_eq!(value("linear", f32::NAN, &y), 1.0);
        let y = [0.0, 1.0, 4.0, 2.0, 7.0, 8.0, 9.0];
        assert_eq!(value("bezier", 0.0, &y), 0.0);
        assert_eq!(value("bezier", 0.5, &y), 2.0);
        assert_eq!(value("bezier", 1.0, &y), 9.0);
        let y = [0.0, 1.0, 4.0, 2.0, 7.0, 8.0];
        assert_eq!(
            (value("hermite", 0.0, &y), value("hermite", 0.5, &y), value("hermite", 1.0, &y)),
            (0.0, 4.0, 7.0)
        );
        // Slope of the first segment at its start is 1 per segment.
        assert!((value("hermite", 0.001, &y) - 0.002).abs() < 1e-4);
        assert!((value("bspline", 0.0, &[0.0, 6.0, 0.0, 0.0]) - 4.0).abs() < 1e-6);
    }

    #[test]
    fn lines_are_kept_by_all_smooth_bases() {
        let y: Vec<f32> = (0..7).map(|k| k as f32).collect();
        for k in 0..=10 {
            let x = k as f32 / 10.0;
            assert!((value("catmull-rom", x, &y) - (1.0 + 4.0 * x)).abs() < 1e-5);
            assert!((value("bspline", x, &y) - (1.0 + 4.0 * x)).abs() < 1e-5);
            assert!((value("bezier", x, &y) - 6.0 * x).abs() < 1e-5);
        }
    }

    #[test]
    fn solving_a_spline_inverts_its_evaluation() {
        let rising = [0.0, 0.1, 0.4, 0.5, 0.9, 1.0, 1.2];
        for word in ["catmull-rom", "linear", "bspline", "bezier"] {
            for y in [rising, rising.map(|v| 3.0 - v)] {
                let b = basis(word).unwrap();
                for k in 0..=20 {
                    let x = k as f32 / 20.0;
                    let v = b.value(x, 7, |k| y[k]);
                    let back = b.solve(v, 7, |k| y[k]);
                    assert!((back - x).abs() < 1e-3, "{word} {x} {back}");
                }
                assert_eq!(b.solve(if y[0] < 1.0 { -9.0 } else { 9.0 }, 7, |k| y[k]), 0.0);
                assert_eq!(b.solve(if y[0] < 1.0 { 9.0 } else { -9.0 }, 7, |k| y[k]), 1.0);
            }
        }
    }

    #[test]
    fn splines_of_too_few_values_are_zero() {
        assert_eq!(value("catmull-rom", 0.5, &[1.0, 2.0, 3.0]), 0.0);
        assert!(basis("cubic").is_none());
    }
}
