//! Piecewise polynomials along one parameter, with the Bezier extraction of each piece.

use crate::GeomError;
use crate::bezier::MAX_DEGREE;
use granita_base::CurveBasis;
use granita_base::shape::KnotSpan;
use std::sync::Arc;

/// One polynomial segment.
#[derive(Clone, Debug)]
pub(crate) struct Segment {
    /// The first control vertex.
    pub(crate) first: usize,
    /// The parameter at the start.
    pub(crate) t0: f64,
    /// The parameter at the end.
    pub(crate) t1: f64,
    /// Bezier vertex `j` is the sum over `k` of `matrix[j * (degree + 1) + k]` times control vertex `first + k`.
    /// `None` is the identity.
    pub(crate) matrix: Option<Arc<[f64]>>,
}

/// All segments along one parameter.
#[derive(Clone, Debug)]
pub(crate) struct Spline {
    /// The degree of the segments.
    pub(crate) degree: usize,
    /// The segments in order; at least one.
    pub(crate) segments: Vec<Segment>,
}

const BSPLINE: [f64; 16] = {
    const S: f64 = 1.0 / 6.0;
    const F: f64 = 4.0 / 6.0;
    const A: f64 = 2.0 / 3.0;
    const B: f64 = 1.0 / 3.0;
    [S, F, S, 0.0, 0.0, A, B, 0.0, 0.0, B, A, 0.0, 0.0, S, F, S]
};

const CATMULL_ROM: [f64; 16] = {
    const S: f64 = 1.0 / 6.0;
    [0.0, 1.0, 0.0, 0.0, -S, 1.0, S, 0.0, 0.0, S, 1.0, -S, 0.0, 0.0, 1.0, 0.0]
};

impl Spline {
    /// Returns the spline of `n` control vertices of a uniform basis, with parameters in [0, 1] (reference 2.8.1).
    pub(crate) fn uniform(
        call: &'static str,
        what: &str,
        basis: CurveBasis,
        n: usize,
    ) -> Result<Self, GeomError> {
        if !basis.accepts(n) {
            let want = match basis {
                CurveBasis::Linear => "at least 2",
                CurveBasis::Bezier => "4, 7, 10 and so on",
                CurveBasis::BSpline | CurveBasis::CatmullRom => "at least 4",
            };
            let what = format!("{n} control vertices {what} with \"{}\", which takes {want}", basis.word());
            return Err(GeomError::Malformed { call, what });
        }
        let (degree, step, count, matrix): (_, _, _, Option<Arc<[f64]>>) = match basis {
            CurveBasis::Linear => (1, 1, n - 1, None),
            CurveBasis::Bezier => (3, 3, (n - 1) / 3, None),
            CurveBasis::BSpline => (3, 1, n - 3, Some(BSPLINE.into())),
            CurveBasis::CatmullRom => (3, 1, n - 3, Some(CATMULL_ROM.into())),
        };
        let t = |i: usize| i as f64 / count as f64;
        let segments = (0..count)
            .map(|i| Segment { first: i * step, t0: t(i), t1: t(i + 1), matrix: matrix.clone() })
            .collect();
        Ok(Self { degree, segments })
    }

    /// Returns the spline of a knot vector, by Bezier extraction with blossoms over each knot span within
    /// `[min, max]`.
    pub(crate) fn nurbs(call: &'static str, what: &str, span: &KnotSpan) -> Result<Self, GeomError> {
        let fail = |text: String| GeomError::Malformed { call, what: format!("{text} {what}") };
        let (n, order) = (span.n, span.order);
        if order < 2 || n < order {
            return Err(fail(format!("order {order} with {n} control vertices")));
        }
        if order > MAX_DEGREE + 1 {
            return Err(GeomError::Limit {
                call,
                what: "order",
                asked: order as u64,
                max: MAX_DEGREE as u64 + 1,
            });
        }
        let wanted = n.checked_add(order);
        if wanted != Some(span.knots.len()) {
            return Err(fail(format!(
                "{} knots instead of {} (vertices plus order)",
                span.knots.len(),
                wanted.unwrap_or(0)
            )));
        }
        if !span.knots.iter().all(|t| t.is_finite()) || span.knots.windows(2).any(|w| w[0] > w[1]) {
            return Err(fail("knots that decrease or are not finite".into()));
        }
        let knots: Vec<f64> = span.knots.iter().map(|&t| f64::from(t)).collect();
        let p = order - 1;
        let (min, max) = (f64::from(span.min).max(knots[p]), f64::from(span.max).min(knots[n]));
        if min >= max {
            return Err(fail(format!(
                "the range {} to {} is empty within the knots {} to {}",
                span.min, span.max, knots[p], knots[n]
            )));
        }
        let mut segments: Vec<Segment> = Vec::new();
        for k in p..n {
            let (a, b) = (knots[k].max(min), knots[k + 1].min(max));
            if a >= b {
                continue;
            }
            let mut matrix = extraction(&knots, k, p, a, b);
            let first = k - p;
            if let Some(last) = segments.last() {
                share_end(last, &mut matrix, first, p);
            }
            segments.push(Segment { first, t0: a, t1: b, matrix: Some(matrix.into()) });
        }
        Ok(Self { degree: p, segments })
    }

    /// Returns the parameter at a place.
    pub(crate) fn parameter(&self, segment: u32, a: f64, b: f64) -> f64 {
        let s = &self.segments[segment as usize];
        a * s.t0 + b * s.t1
    }

    /// Returns the first and last parameter.
    pub(crate) fn extent(&self) -> (f64, f64) {
        let last = self.segments.len() - 1;
        (self.segments[0].t0, self.segments[last].t1)
    }

    /// The number of segments.
    pub(crate) fn count(&self) -> u32 {
        self.segments.len() as u32
    }
}

/// Returns the extraction matrix of knot span `[t_k, t_{k+1}]` for the Bezier segment over `[a, b]` inside of it.
fn extraction(knots: &[f64], k: usize, p: usize, a: f64, b: f64) -> Vec<f64> {
    let m = p + 1;
    let mut matrix = vec![0.0; m * m];
    let mut d = vec![0.0; m];
    for j in 0..m {
        for unit in 0..m {
            d.fill(0.0);
            d[unit] = 1.0;
            // The blossom at p - j times a and j times b is computed by de Boor's recursion.
            for r in 1..=p {
                let x = if r <= p - j { a } else { b };
                for i in (r..=p).rev() {
                    let (lo, hi) = (knots[k - p + i], knots[k + 1 + i - r]);
                    let alpha = (x - lo) / (hi - lo);
                    d[i] = (1.0 - alpha) * d[i - 1] + alpha * d[i];
                }
            }
            matrix[j * m + unit] = d[p];
        }
    }
    matrix
}

/// Copies the last row of the segment before into the first row of a segment, where both depend on the same control
/// vertices. The common edge is then the same to the bit.
fn share_end(last: &Segment, matrix: &mut [f64], first: usize, p: usize) {
    let m = p + 1;
    let shift = first - last.first;
    let Some(before) = &last.matrix else { return };
    let end = &before[p * m..];
    // At a knot of full multiplicity no vertices are shared, because the curve may jump there.
    if shift > p || end[..shift].iter().any(|w| w.abs() > 1e-9) {
        return;
    }
    for unit in 0..m {
        matrix[unit] = if unit + shift < m { end[unit + shift] } else { 0.0 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniform_knots_give_the_uniform_bspline_matrix() {
        let span =
            KnotSpan { n: 6, order: 4, knots: (0..10).map(|i| i as f32).collect(), min: 3.0, max: 6.0 };
        let s = Spline::nurbs("Patch", "along u", &span).unwrap();
        assert_eq!((s.degree, s.segments.len()), (3, 3));
        for segment in &s.segments {
            let m = segment.matrix.as_ref().unwrap();
            for (x, y) in m.iter().zip(BSPLINE) {
                assert!((x - y).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn bezier_knots_give_the_identity_matrix() {
        let span = KnotSpan {
            n: 4,
            order: 4,
            knots: [0.0, 0.0, 0.0, 0.0, 2.0, 2.0, 2.0, 2.0].into(),
            min: 0.0,
            max: 2.0,
        };
        let s = Spline::nurbs("Patch", "along u", &span).unwrap();
        let m = s.segments[0].matrix.as_ref().unwrap();
        for j in 0..4 {
            for k in 0..4 {
                assert_eq!(m[j * 4 + k], f64::from(u8::from(j == k)));
            }
        }
    }

    #[test]
    fn invalid_knots_are_errors() {
        let good =
            KnotSpan { n: 3, order: 3, knots: [0.0, 0.0, 0.0, 1.0, 1.0, 1.0].into(), min: 0.0, max: 1.0 };
        assert!(Spline::nurbs("Patch", "", &good).is_ok());
        for bad in [
            KnotSpan { order: 1, ..good.clone() },
            KnotSpan { order: 0, ..good.clone() },
            KnotSpan { n: 2, ..good.clone() },
            KnotSpan { n: usize::MAX, ..good.clone() },
            KnotSpan { order: 4, ..good.clone() },
            KnotSpan { min: 1.0, ..good.clone() },
            KnotSpan { min: f32::NAN, max: f32::NAN, ..good.clone() },
            KnotSpan { knots: [0.0, 0.0, 1.0, 0.0, 1.0, 1.0].into(), ..good.clone() },
            KnotSpan { knots: [0.0, 0.0, f32::NAN, 1.0, 1.0, 1.0].into(), ..good.clone() },
            KnotSpan { knots: [0.0; 6].into(), ..good.clone() },
        ] {
            // NaN limits are replaced by the range of the knots. All other invalid values fail.
            if !bad.min.is_nan() {
                assert!(Spline::nurbs("Patch", "", &bad).is_err(), "{bad:?}");
            }
        }
    }
}
