//! Trim curves: closed loops of rational curves in the parameters of a patch (reference 2.8.1).

use crate::bezier::{bernstein, symmetric_sum};
use crate::spline::Spline;
use granita_base::TrimDesc;
use granita_base::shape::KnotSpan;

/// The trim curves of a patch, and the accuracy of their polygons.
#[derive(Clone, Copy, Debug)]
pub struct Trimming<'a> {
    /// The loops.
    pub desc: &'a TrimDesc,
    /// The attribute "trimcurve:curvature": the angle in degrees by which a curve may turn before it gets another
    /// segment.
    pub curvature_deg: f32,
    /// The attribute "trimcurve:quality": divides the angle, and multiplies the number of cells of a micropolygon.
    pub quality: f32,
}

impl<'a> Trimming<'a> {
    /// Returns a value with the default angle and quality.
    pub fn new(desc: &'a TrimDesc) -> Self {
        Self { desc, curvature_deg: 10.0, quality: 1.0 }
    }
}

/// The cells of a trimmed lattice that are outside of the loops.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TrimMask {
    /// The number of cells along each side of a micropolygon, at least 1.
    pub per_side: usize,
    /// For each cell (`per_side * (nu - 1)` along u, u fastest): true when its middle is outside of the trimmed
    /// region. Such cells are kept under "trimcurve:sense" `"inside"` and discarded under `"outside"`.
    pub outside: Vec<bool>,
}

impl TrimMask {
    /// Returns for each micropolygon of a lattice of `nu` points along u whether most of its cells are outside.
    pub fn micropolygons(&self, nu: usize) -> Vec<bool> {
        let (k, mu) = (self.per_side, nu - 1);
        let mv = self.outside.len() / (mu * k * k);
        let cells = |at: usize| {
            let (i, j) = (at % mu, at / mu);
            let rows = (0..k).map(move |row| ((j * k + row) * mu + i) * k);
            rows.flat_map(|from| self.outside[from..from + k].iter()).filter(|outside| **outside).count()
        };
        (0..mu * mv).map(|at| cells(at) * 2 > k * k).collect()
    }
}

/// The number of cells along each side of a micropolygon at quality 1, and its maximum.
const CELLS: f32 = 4.0;
const MOST_CELLS: f32 = 16.0;

/// The least and largest number of halvings of a segment of degree above one.
const LEAST_DEPTH: u32 = 2;
const MOST_DEPTH: u32 = 12;

/// The largest deviation of a polygon from its curve, relative to the curve's extent, at the default angle and
/// quality 1. A circle gets about 256 edges, so that no corners are visible.
const SAG: f64 = 5e-5;

/// Beyond this number of edges, curves are halved only as often as necessary.
const MANY_EDGES: usize = 1 << 20;

/// The number of bands of v that speed up the search for edges.
const BANDS: usize = 64;

/// The trimmed region as polygons. A point is inside when a line from it crosses them an odd number of times.
#[derive(Clone, Debug)]
pub(crate) struct Trim {
    /// The edges `(u0, v0, u1, v1)` with `v0 != v1`.
    edges: Vec<[f64; 4]>,
    /// The edges that touch each of [`BANDS`] equal bands between the smallest and largest v.
    bands: Vec<Vec<u32>>,
    /// The smallest and largest v of all edges.
    range_v: (f64, f64),
    /// The number of cells along each side of a micropolygon.
    per_side: usize,
}

impl Trim {
    /// Flattens the curves into polygons. The error describes why the curves are invalid.
    pub(crate) fn new(trimming: Trimming<'_>) -> Result<Self, String> {
        let desc = trimming.desc;
        let positive = |x: f32, default: f32| if x.is_finite() && x > 0.0 { x } else { default };
        let quality = positive(trimming.quality, 1.0).clamp(0.01, 100.0);
        let asked_deg = positive(trimming.curvature_deg, 10.0).clamp(0.01, 180.0);
        // Twice the angle gives edges of twice the length, whose deviation is four times as large. Below the default
        // angle the tolerance depends increasingly on the angle itself.
        let scale = f64::from(asked_deg / 10.0);
        let tolerance = Tolerance {
            angle: f64::from((asked_deg / quality).clamp(0.01, 180.0).to_radians()),
            sag: SAG * (scale * scale.max(1.0)) / f64::from(quality),
        };
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
                flatten(&span, uvw, curve, &tolerance, &mut outline)?;
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
        let per_side = (CELLS * quality).round().clamp(1.0, MOST_CELLS) as usize;
        let mut trim = Self { edges, bands: vec![Vec::new(); BANDS], range_v, per_side };
        for (index, e) in trim.edges.iter().enumerate() {
            let (lo, hi) = (trim.band(e[1].min(e[3])), trim.band(e[1].max(e[3])));
            trim.bands[lo..=hi].iter_mut().for_each(|band| band.push(index as u32));
        }
        Ok(trim)
    }

    /// Returns the band of a v.
    fn band(&self, v: f64) -> usize {
        let (lo, hi) = self.range_v;
        (((v - lo) / (hi - lo) * BANDS as f64) as usize).min(BANDS - 1)
    }

    /// Finds the places, in order, where a line of constant v crosses the loops.
    fn crossings(&self, v: f64, out: &mut Vec<f64>) {
        out.clear();
        if !(v >= self.range_v.0 && v <= self.range_v.1) {
            return;
        }
        for &index in &self.bands[self.band(v)] {
            let [u0, v0, u1, v1] = self.edges[index as usize];
            if (v0 <= v) != (v1 <= v) {
                out.push(u0 + (v - v0) / (v1 - v0) * (u1 - u0));
            }
        }
        out.sort_by(f64::total_cmp);
    }

    /// Returns the mask of a lattice with points at these parameters.
    pub(crate) fn mask(&self, us: &[f64], vs: &[f64]) -> TrimMask {
        let k = self.per_side;
        let middles = |list: &[f64]| -> Vec<f64> {
            let cell = |w: &[f64], c: usize| w[0] + (w[1] - w[0]) * ((c as f64 + 0.5) / k as f64);
            list.windows(2).flat_map(|w| (0..k).map(move |c| cell(w, c))).collect()
        };
        let (us, vs) = (middles(us), middles(vs));
        let mut outside = Vec::with_capacity(us.len() * vs.len());
        let mut crossings = Vec::new();
        for v in vs {
            self.crossings(v, &mut crossings);
            outside.extend(us.iter().map(|u| {
                let beyond = crossings.len() - crossings.partition_point(|x| x <= u);
                beyond % 2 == 0
            }));
        }
        TrimMask { per_side: k, outside }
    }

    /// Corrects a mask for the micropolygons on the border of a lattice whose points were moved there. `us` and `vs`
    /// hold the parameters of each point. Cells are placed like the two triangles of a micropolygon, which is divided
    /// from its first to its last corner.
    pub(crate) fn correct(&self, mask: &mut TrimMask, us: &[f64], vs: &[f64], nu: usize) {
        let (k, mu, mv) = (self.per_side, nu - 1, us.len() / nu - 1);
        let mut crossings = Vec::new();
        for at in
            (0..mu * mv).filter(|at| at % mu == 0 || at % mu == mu - 1 || at / mu == 0 || at / mu == mv - 1)
        {
            let (i, j) = (at % mu, at / mu);
            let corner = j * nu + i;
            for cell in 0..k * k {
                let [x, y] = [cell % k, cell / k].map(|c| (c as f64 + 0.5) / k as f64);
                let weights = if x >= y { [1.0 - x, x - y, 0.0, y] } else { [1.0 - y, 0.0, y - x, x] };
                let mean = |list: &[f64]| -> f64 {
                    let corners = [corner, corner + 1, corner + nu, corner + nu + 1];
                    corners.into_iter().zip(weights).map(|(c, w)| list[c] * w).sum()
                };
                let (u, v) = (mean(us), mean(vs));
                self.crossings(v, &mut crossings);
                let beyond = crossings.iter().filter(|x| **x > u).count();
                mask.outside[(j * k + cell / k) * mu * k + i * k + cell % k] = beyond % 2 == 0;
            }
        }
    }
}

/// The accuracy of polygons relative to their curves.
struct Tolerance {
    /// The largest turning angle from edge to edge, in radians.
    angle: f64,
    /// The largest deviation of an edge, relative to the curve's extent.
    sag: f64,
}

/// Appends the points of a curve.
fn flatten(
    span: &KnotSpan,
    uvw: &[f32],
    curve: usize,
    tolerance: &Tolerance,
    out: &mut Vec<[f64; 2]>,
) -> Result<(), String> {
    let spline = Spline::nurbs("TrimCurve", &format!("in curve {curve}"), span).map_err(|e| e.to_string())?;
    let m = spline.degree + 1;
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
        let arc = Arc { net: &net, degree: spline.degree };
        let ends = [0.0, 1.0].map(|b| arc.at(b));
        let [Some(first), Some(last)] = ends else {
            return Err(format!("curve {curve} has a weight of zero"));
        };
        let sag = tolerance.sag * arc.extent();
        if out.last() != Some(&first) {
            out.push(first);
        }
        arc.halve([0.0, 1.0], [first, last], 0, &Tolerance { sag, ..*tolerance }, out)
            .ok_or_else(|| format!("curve {curve} has a weight of zero"))?;
    }
    Ok(())
}

/// One polynomial segment of a curve.
struct Arc<'a> {
    net: &'a [[f64; 3]],
    degree: usize,
}

impl Arc<'_> {
    /// Returns the point at `b`; `None` where the weight vanishes.
    fn at(&self, b: f64) -> Option<[f64; 2]> {
        let mut w = [0.0; crate::bezier::MAX_DEGREE + 1];
        bernstein(self.degree, 1.0 - b, b, &mut w);
        let p: [f64; 3] = std::array::from_fn(|c| symmetric_sum(&w[..=self.degree], |k| self.net[k][c]));
        let place = [p[0] / p[2], p[1] / p[2]];
        (place[0].is_finite() && place[1].is_finite()).then_some(place)
    }

    /// Returns the size of the box around the control points.
    fn extent(&self) -> f64 {
        let size = |c: usize| {
            let x = self.net.iter().map(|p| p[c] / p[2]).filter(|x| x.is_finite());
            let (lo, hi) = x.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), x| (lo.min(x), hi.max(x)));
            (hi - lo).max(0.0)
        };
        size(0).max(size(1))
    }

    /// Appends the points of a part behind its first. `tolerance.sag` is a length here. Returns `None` where a weight
    /// vanishes.
    fn halve(
        &self,
        [b0, b1]: [f64; 2],
        [p0, p1]: [[f64; 2]; 2],
        depth: u32,
        tolerance: &Tolerance,
        out: &mut Vec<[f64; 2]>,
    ) -> Option<()> {
        if self.degree > 1 && depth < MOST_DEPTH {
            let b = 0.5 * (b0 + b1);
            let p = self.at(b)?;
            let sub = |x: [f64; 2], y: [f64; 2]| [x[0] - y[0], x[1] - y[1]];
            let cross = |x: [f64; 2], y: [f64; 2]| x[0] * y[1] - x[1] * y[0];
            let (before, after, chord) = (sub(p, p0), sub(p1, p), sub(p1, p0));
            // The directions of the halves differ by half of the turning angle of the whole part.
            let turn =
                2.0 * libm::atan2(cross(before, after).abs(), before[0] * after[0] + before[1] * after[1]);
            let length = libm::hypot(chord[0], chord[1]);
            let off = if length > 0.0 {
                cross(before, chord).abs() / length
            } else {
                libm::hypot(before[0], before[1])
            };
            let curved = (turn > tolerance.angle || off > tolerance.sag) && out.len() < MANY_EDGES;
            if depth < LEAST_DEPTH || curved {
                self.halve([b0, b], [p0, p], depth + 1, tolerance, out)?;
                return self.halve([b, b1], [p, p1], depth + 1, tolerance, out);
            }
        }
        if out.last() != Some(&p1) {
            out.push(p1);
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    impl Trim {
        fn contains(&self, u: f64, v: f64) -> bool {
            let mut crossings = Vec::new();
            self.crossings(v, &mut crossings);
            crossings.iter().filter(|x| **x > u).count() % 2 == 1
        }

        /// The area of the region.
        fn area(&self) -> f64 {
            self.edges.iter().map(|[u0, v0, u1, v1]| 0.5 * (u0 + u1) * (v1 - v0)).sum::<f64>().abs()
        }
    }

    fn trim(desc: &TrimDesc) -> Trim {
        Trim::new(Trimming::new(desc)).unwrap()
    }

    fn edges(desc: &TrimDesc, curvature_deg: f32, quality: f32) -> usize {
        Trim::new(Trimming { desc, curvature_deg, quality }).unwrap().edges.len()
    }

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
    fn the_trim_example_of_the_reference_is_a_disc() {
        let trim = trim(&circle());
        assert!(trim.contains(0.5, 0.5));
        assert!(!trim.contains(0.01, 0.01) && !trim.contains(0.99, 0.99));
        assert!(!trim.contains(0.5, 1.5) && !trim.contains(-0.5, 0.5) && !trim.contains(1.5, 0.5));
    }

    #[test]
    fn trimmed_regions_have_the_area_of_their_curves() {
        let exact = std::f64::consts::PI / 4.0;
        let area = |curvature_deg, quality| {
            Trim::new(Trimming { desc: &circle(), curvature_deg, quality }).unwrap().area()
        };
        // A polygon of n corners has (2 pi / n)^2 / 6 less area than its circle.
        assert!((area(10.0, 1.0) / exact - 1.0).abs() < 2e-4, "{}", area(10.0, 1.0));
        assert!((area(1.0, 1.0) / exact - 1.0).abs() < 6e-5, "{}", area(1.0, 1.0));
        assert!((area(0.1, 1.0) / exact - 1.0).abs() < 6e-7, "{}", area(0.1, 1.0));
        assert!((area(10.0, 100.0) / exact - 1.0).abs() < 2e-6, "{}", area(10.0, 100.0));
        // The region is under a cubic. B(t) of heights 0, 1, 1, 0 over [0, 1] has mean 1/2.
        let cubic = TrimDesc {
            ncurves: [1].into(),
            n: [4].into(),
            order: [4].into(),
            knots: [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0].into(),
            min: [0.0].into(),
            max: [1.0].into(),
            uvw: [0.0, 0.0, 1.0, 1.0 / 3.0, 1.0, 1.0, 2.0 / 3.0, 1.0, 1.0, 1.0, 0.0, 1.0].into(),
        };
        assert!((trim(&cubic).area() - 0.5).abs() < 2e-4, "{}", trim(&cubic).area());
    }

    #[test]
    fn smaller_angles_and_higher_quality_give_more_segments() {
        let circle = circle();
        // Every edge turns by at most the angle.
        for (curvature_deg, quality) in [(10.0, 1.0), (1.0, 1.0), (10.0, 10.0), (0.1, 1.0), (1.0, 4.0)] {
            let n = edges(&circle, curvature_deg, quality) as f32;
            assert!(n >= 360.0 * quality / curvature_deg, "{n} edges at {curvature_deg} and {quality}");
        }
        // The angles go from very fine to coarse and include the default of 10 degrees.
        let counts = [0.1, 0.5, 2.0, 10.0, 40.0, 120.0].map(|angle| edges(&circle, angle, 1.0));
        assert!(counts.windows(2).all(|n| n[0] > n[1]), "{counts:?}");
        assert!(edges(&circle, 10.0, 10.0) > edges(&circle, 10.0, 1.0));
        // A value that is not a number is replaced by the default.
        assert_eq!(edges(&circle, f32::NAN, 0.0), edges(&circle, 10.0, 1.0));
    }

    #[test]
    fn masks_have_several_samples_per_micropolygon() {
        let axis: Vec<f64> = (0..=8).map(|i| f64::from(i) / 8.0).collect();
        for (quality, per_side) in [(1.0, 4_usize), (2.0, 8), (0.1, 1), (50.0, 16)] {
            let trim = Trim::new(Trimming { desc: &circle(), curvature_deg: 1.0, quality }).unwrap();
            let mask = trim.mask(&axis, &axis);
            assert_eq!((mask.per_side, mask.outside.len()), (per_side, (8 * per_side).pow(2)));
            let inside = mask.outside.iter().filter(|o| !**o).count() as f64 / mask.outside.len() as f64;
            let error = (inside - std::f64::consts::PI / 4.0).abs();
            assert!(error < 0.1 / per_side as f64, "{error} at {per_side}");
            let coarse = mask.micropolygons(9);
            assert_eq!(coarse.len(), 64);
            assert!(coarse[0] && !coarse[27] && coarse[63]);
        }
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
        let trim = trim(&desc);
        assert!(trim.contains(0.2, 0.5) && !trim.contains(0.5, 0.5) && !trim.contains(0.05, 0.5));
    }

    #[test]
    fn invalid_trim_curves_are_errors() {
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
            assert!(Trim::new(Trimming::new(&bad)).is_err(), "{bad:?}");
        }
    }
}
