//! Trim curves: closed loops of rational curves in the parameters of a patch (reference 2.8.1).

use crate::bezier::{bernstein, symmetric_sum};
use crate::spline::Spline;
use granita_base::TrimDesc;
use granita_base::shape::KnotSpan;

/// Points per polynomial segment of a trim curve of degree above one.
const STEPS: usize = 24;

/// The trimmed region as polygons; a point is inside when a line from it crosses them an odd number of times.
#[derive(Clone, Debug)]
pub(crate) struct Trim {
    /// Edges `(u0, v0, u1, v1)` with `v0 != v1`.
    edges: Vec<[f64; 4]>,
    /// Smallest and largest v of all edges.
    range_v: (f64, f64),
}

impl Trim {
    /// Flattens the curves. Errors say what is wrong with them.
    pub(crate) fn new(desc: &TrimDesc) -> Result<Self, String> {
        let mut edges = Vec::new();
        let (mut curve, mut knot, mut point) = (0_usize, 0_usize, 0_usize);
        for (index, &ncurves) in desc.ncurves.iter().enumerate() {
            let mut outline: Vec<[f64; 2]> = Vec::new();
            for _ in 0..ncurves.max(0) {
                let at = |list: &[i32]| list.get(curve).and_then(|&x| usize::try_from(x).ok());
                let (n, order) = at(&desc.n).zip(at(&desc.order)).ok_or("too few curves")?;
                let limits = desc.min.get(curve).zip(desc.max.get(curve)).ok_or("too few curve ranges")?;
                let knots_end = n.checked_add(order).and_then(|k| k.checked_add(knot));
                let points_end = n.checked_mul(3).and_then(|k| k.checked_add(point));
                let knots = knots_end.and_then(|end| desc.knots.get(knot..end)).ok_or("too few knots")?;
                let uvw = points_end.and_then(|end| desc.uvw.get(point..end)).ok_or("too few points")?;
                if !uvw.iter().all(|x| x.is_finite()) {
                    return Err(format!("a point of curve {curve} is not finite"));
                }
                let span = KnotSpan { n, order, knots: knots.into(), min: *limits.0, max: *limits.1 };
                flatten(&span, uvw, curve, &mut outline)?;
                knot += knots.len();
                point += uvw.len();
                curve += 1;
            }
            if outline.is_empty() {
                return Err(format!("loop {index} has no curves"));
            }
            for (i, &[u0, v0]) in outline.iter().enumerate() {
                let [u1, v1] = outline[(i + 1) % outline.len()];
                if v0 != v1 {
                    edges.push([u0, v0, u1, v1]);
                }
            }
        }
        let all_v = edges.iter().flat_map(|e| [e[1], e[3]]);
        let range_v = all_v.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)));
        Ok(Self { edges, range_v })
    }

    /// Whether `(u, v)` is inside of the loops.
    pub(crate) fn contains(&self, u: f64, v: f64) -> bool {
        if v < self.range_v.0 || v > self.range_v.1 {
            return false;
        }
        let crosses = |e: &&[f64; 4]| {
            let [u0, v0, u1, v1] = **e;
            (v0 <= v) != (v1 <= v) && u < u0 + (v - v0) / (v1 - v0) * (u1 - u0)
        };
        self.edges.iter().filter(crosses).count() % 2 == 1
    }
}

/// Appends the points of a curve.
fn flatten(span: &KnotSpan, uvw: &[f32], curve: usize, out: &mut Vec<[f64; 2]>) -> Result<(), String> {
    let spline = Spline::nurbs("TrimCurve", &format!("in curve {curve}"), span).map_err(|e| e.to_string())?;
    let m = spline.degree + 1;
    let steps = if spline.degree == 1 { 1 } else { STEPS };
    let mut net = vec![[0.0; 3]; m];
    for segment in &spline.segments {
        for (j, vertex) in net.iter_mut().enumerate() {
            *vertex = std::array::from_fn(|c| {
                (0..m)
                    .map(|k| {
                        let weight =
                            segment.matrix.as_ref().map_or(f64::from(u8::from(j == k)), |w| w[j * m + k]);
                        weight * f64::from(uvw[(segment.first + k) * 3 + c])
                    })
                    .sum()
            });
        }
        let mut w = vec![0.0; m];
        for step in 0..=steps {
            let b = step as f64 / steps as f64;
            bernstein(spline.degree, 1.0 - b, b, &mut w);
            let p: [f64; 3] = std::array::from_fn(|c| symmetric_sum(&w, |k| net[k][c]));
            let place = [p[0] / p[2], p[1] / p[2]];
            if !(place[0].is_finite() && place[1].is_finite()) {
                return Err(format!("curve {curve} has a weight of zero"));
            }
            if out.last() != Some(&place) {
                out.push(place);
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn circle() -> TrimDesc {
        TrimDesc {
            ncurves: [1].into(),
            n: [9].into(),
            order: [3].into(),
            knots: [0.0, 0.0, 0.0, 0.25, 0.25, 0.5, 0.5, 0.75, 0.75, 1.0, 1.0, 1.0].into(),
            min: [0.0].into(),
            max: [1.0].into(),
            uvw: [
                1.0, 0.5, 1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 0.0, 1.0, 1.0, 0.0, 0.5, 1.0, 0.0, 0.0, 1.0,
                1.0, 0.0, 2.0, 1.0, 0.0, 1.0, 1.0, 0.5, 1.0,
            ]
            .into(),
        }
    }

    #[test]
    fn the_references_example_is_a_round_region() {
        let trim = Trim::new(&circle()).unwrap();
        assert!(trim.contains(0.5, 0.5));
        assert!(!trim.contains(0.01, 0.01) && !trim.contains(0.99, 0.99));
        assert!(!trim.contains(0.5, 1.5) && !trim.contains(-0.5, 0.5) && !trim.contains(1.5, 0.5));
    }

    #[test]
    fn a_hole_in_a_hole_is_outside() {
        let square = |lo: f32, hi: f32| [lo, lo, 1.0, hi, lo, 1.0, hi, hi, 1.0, lo, hi, 1.0];
        let knots = [0.0, 0.0, 1.0, 2.0, 3.0, 3.0];
        let desc = TrimDesc {
            ncurves: [1, 1].into(),
            n: [4, 4].into(),
            order: [2, 2].into(),
            knots: [knots, knots].concat().into(),
            min: [0.0, 0.0].into(),
            max: [3.0, 3.0].into(),
            uvw: [square(0.1, 0.9), square(0.4, 0.6)].concat().into(),
        };
        let trim = Trim::new(&desc).unwrap();
        assert!(trim.contains(0.2, 0.5) && !trim.contains(0.5, 0.5) && !trim.contains(0.05, 0.5));
    }

    #[test]
    fn broken_curves_are_errors() {
        let good = circle();
        for bad in [
            TrimDesc { ncurves: [2].into(), ..good.clone() },
            TrimDesc { ncurves: [0].into(), ..good.clone() },
            TrimDesc { n: [i32::MAX].into(), ..good.clone() },
            TrimDesc { n: [-1].into(), ..good.clone() },
            TrimDesc { order: [i32::MIN].into(), ..good.clone() },
            TrimDesc { uvw: [0.0; 27].into(), ..good.clone() },
            TrimDesc { uvw: [f32::NAN; 27].into(), ..good.clone() },
            TrimDesc { min: [].into(), ..good.clone() },
        ] {
            assert!(Trim::new(&bad).is_err(), "{bad:?}");
        }
    }
}
