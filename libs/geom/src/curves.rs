//! Curves (reference 2.8.3), which are ribbons along splines, with u across and v along.
//!
//! With "N" a ribbon is perpendicular to N. Without it the ribbon faces the viewer; see [`crate::Dice::facing`].

use crate::GeomError;
use crate::bezier::{MAX_DEGREE, bernstein, bernstein_derivative, symmetric_sum};
use crate::dice::{Dice, Facing, View};
use crate::key::ShapeKey;
use crate::net::{hull, rounded_out};
use crate::order::spatial_order;
use crate::range::{Place, Range};
use crate::spline::Spline;
use crate::surface::{Piece, SplitDirection, Surface};
use crate::vars::{Control, Counts, Report, Vars, control, emit, position, take_normals, vertex_count};
use crate::width::{WidthCounts, Widths};
use granita_base::{Bound, Severity, Vec3};
use std::sync::Arc;

const CALL: &str = "Curves";

/// The largest number of segments that are diced together.
const MOST_SEGMENTS: u32 = 8;

/// The angle in radians between segments from which on they form a crease.
const CREASE: f32 = 0.01;

struct Curves {
    times: Vec<f32>,
    spline: Spline,
    /// The number of control vertices of a curve.
    nverts: usize,
    control: Control,
    vars: Vars,
    /// The widths for each key.
    widths: Vec<Widths>,
    /// The indices of the curves that can be drawn, ordered so that neighbours are together.
    order: Vec<u32>,
}

struct CurvePiece {
    all: Arc<Curves>,
    /// The positions in the order.
    curves: std::ops::Range<usize>,
    range: [Range; 2],
    bounds: Vec<Bound>,
}

/// Builds `ncurves` (at least one) curves of `nverts` control vertices each.
pub(crate) fn build(
    keys: &[ShapeKey<'_>],
    spline: Spline,
    ncurves: usize,
    nverts: usize,
    report: Report<'_>,
) -> Result<Vec<Piece>, GeomError> {
    let fail = |what: String| GeomError::Malformed { call: CALL, what };
    let n =
        ncurves.checked_mul(nverts).ok_or_else(|| fail(format!("{ncurves} x {nverts} control vertices")))?;
    vertex_count(CALL, keys, report)?;
    let ends = ncurves.saturating_mul(2);
    let counts = Counts { vertex: Some(n), linear: Some(ends), perpiece: Some(ncurves) };
    let vars = Vars::collect(CALL, keys[0].params, counts, report);
    let control = control(CALL, keys, n, &vars, report)?;
    let counts = WidthCounts { perpiece: ncurves, linear: ends, vertex: n };
    let widths = Widths::collect(CALL, keys, "width", counts, report)
        .unwrap_or_else(|| vec![Widths::Constant(1.0); keys.len()]);
    let vertices = |c: usize| c * nverts..(c + 1) * nverts;
    let good: Vec<u32> =
        (0..ncurves).filter(|&c| vertices(c).all(|i| control.is_finite(i))).map(|c| c as u32).collect();
    if good.len() < ncurves {
        let bad = ncurves - good.len();
        report(
            Severity::Warning,
            format!("{CALL}: {bad} of {ncurves} curves have vertices that are not finite and are left out"),
        );
    }
    let centres: Vec<Vec3> =
        good.iter().map(|&c| control.position(c as usize * nverts + nverts / 2, 0)).collect();
    let order: Vec<u32> = spatial_order(&centres).into_iter().map(|i| good[i as usize]).collect();
    if order.is_empty() {
        return Ok(Vec::new());
    }
    let times = keys.iter().map(|k| k.time).collect();
    let curves = 0..order.len();
    let all = Arc::new(Curves { times, spline, nverts, control, vars, widths, order });
    Ok(vec![Box::new(CurvePiece::new(all, curves, None))])
}

/// The evaluated values at one place of a curve.
struct Point {
    /// The control channels, divided by weights.
    values: Vec<f64>,
    /// The derivative along v at each key.
    tangents: Vec<Vec3>,
    /// The width at each key.
    widths: Vec<f32>,
    v: f64,
}

impl Curves {
    /// Gathers the Bezier vertices of a segment: the control channels, then the vertex widths of each key.
    fn gather(&self, curve: usize, segment: u32, out: &mut Vec<f64>) {
        let s = &self.spline.segments[segment as usize];
        let (m, c, stride) = (self.spline.degree + 1, self.control.channels, self.stride());
        out.clear();
        out.resize(m * stride, 0.0);
        for j in 0..m {
            for k in 0..m {
                let w = s.matrix.as_ref().map_or(f64::from(u8::from(j == k)), |w| w[j * m + k]);
                if w == 0.0 {
                    continue;
                }
                let index = curve * self.nverts + s.first + k;
                let vertex = self.control.vertex(index);
                let at = &mut out[j * stride..][..stride];
                for (o, x) in at.iter_mut().zip(vertex) {
                    *o += w * x;
                }
                let weight = if self.control.dim == 4 { vertex[3] } else { 1.0 };
                for (o, widths) in at[c..].iter_mut().zip(&self.widths) {
                    if let Widths::Vertex(list) = widths {
                        *o += w * f64::from(list[index]) * weight;
                    }
                }
            }
        }
    }

    fn stride(&self) -> usize {
        self.control.channels + self.times.len()
    }

    /// Returns the width at a key and a fraction along the curve, when it is not interpolated like the vertices.
    fn width(&self, key: usize, curve: usize, fraction: f64) -> Option<f64> {
        match &self.widths[key] {
            Widths::Constant(w) => Some(f64::from(*w)),
            Widths::PerPiece(list) => Some(f64::from(list[curve])),
            Widths::Linear(list) => {
                let [a, b] = [list[2 * curve], list[2 * curve + 1]].map(f64::from);
                Some(a * (1.0 - fraction) + b * fraction)
            }
            Widths::Vertex(_) => None,
        }
    }

    fn point(&self, curve: usize, place: Place, net: &mut Vec<f64>) -> Point {
        let dim = self.control.dim;
        let (mut values, mut tangents) = self.raw(curve, place, net);
        if let Some(beside) = self.beside(place) {
            // Segments may have an angle between them. Their ribbons share an edge when both take the direction in
            // between.
            let (_, others) = self.raw(curve, beside, net);
            for (t, other) in tangents.iter_mut().zip(others) {
                let between = t.normalize_or_zero() + other.normalize_or_zero();
                let length = (t.length() + other.length()) * 0.5;
                *t = between.try_normalize().map_or(*t, |d| d * length);
            }
        }
        if dim == 4 {
            let safe = |w: f64| if w == 0.0 { 1.0 } else { w };
            let first = safe(values[3]);
            let (positions, others) = values.split_at_mut(self.control.vars_offset());
            for p in positions.chunks_exact_mut(4) {
                let w = safe(p[3]);
                p[..3].iter_mut().for_each(|x| *x /= w);
                p[3] = 1.0;
            }
            others.iter_mut().for_each(|x| *x /= first);
        }
        let v = self.spline.parameter(place.segment, place.a, place.b);
        let (v0, v1) = self.spline.extent();
        let widths = (0..self.times.len())
            .map(|key| {
                let like_vertices = values[self.control.channels + key];
                self.width(key, curve, (v - v0) / (v1 - v0)).unwrap_or(like_vertices).max(0.0) as f32
            })
            .collect();
        Point { values, tangents, widths, v }
    }

    /// Returns all channels at a place, not divided by weights, and the derivative along v at each key.
    fn raw(&self, curve: usize, place: Place, net: &mut Vec<f64>) -> (Vec<f64>, Vec<Vec3>) {
        self.gather(curve, place.segment, net);
        let (stride, degree) = (self.stride(), self.spline.degree);
        let segment = &self.spline.segments[place.segment as usize];
        let mut w = [0.0; MAX_DEGREE + 1];
        bernstein(degree, place.a, place.b, &mut w);
        let values: Vec<f64> =
            (0..stride).map(|c| symmetric_sum(&w[..=degree], |k| net[k * stride + c])).collect();
        let length = (segment.t1 - segment.t0) as f32;
        let tangents =
            (0..self.times.len()).map(|key| self.tangent(net, key, place, &values) / length).collect();
        (values, tangents)
    }

    /// Returns the same place as the end of the neighbouring segment, if there is one.
    fn beside(&self, place: Place) -> Option<Place> {
        if place.b == 0.0 && place.segment > 0 {
            Some(Place { segment: place.segment - 1, a: 0.0, b: 1.0 })
        } else if place.a == 0.0 && place.segment + 1 < self.spline.count() {
            Some(Place { segment: place.segment + 1, a: 1.0, b: 0.0 })
        } else {
            None
        }
    }

    /// Returns the derivative within the segment at a key. Where it vanishes, the derivative slightly further inside
    /// is returned.
    fn tangent(&self, net: &[f64], key: usize, place: Place, values: &[f64]) -> Vec3 {
        let (stride, dim, degree) = (self.stride(), self.control.dim, self.spline.degree);
        let mut d = [0.0; MAX_DEGREE + 1];
        let at = |d: &[f64], c: usize| symmetric_sum(&d[..=degree], |k| net[k * stride + key * dim + c]);
        bernstein_derivative(degree, place.a, place.b, &mut d);
        let x = &values[key * dim..];
        let direct = |d: &[f64], x: &dyn Fn(usize) -> f64| -> [f64; 3] {
            if dim == 3 {
                return std::array::from_fn(|c| at(d, c));
            }
            let w = if x(3) == 0.0 { 1.0 } else { x(3) };
            std::array::from_fn(|c| (at(d, c) - x(c) / w * at(d, 3)) / w)
        };
        let t = direct(&d, &|c| x[c]);
        let size = (1..=degree)
            .flat_map(|k| (0..3).map(move |c| (k, c)))
            .map(|(k, c)| (net[k * stride + key * dim + c] - net[(k - 1) * stride + key * dim + c]).abs())
            .fold(0.0, f64::max);
        let largest = |t: [f64; 3]| t.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        if largest(t) > 1e-6 * size {
            return Vec3::from(t.map(|x| x as f32));
        }
        let (a, b) = (place.a + (0.5 - place.a) * 1e-3, place.b + (0.5 - place.b) * 1e-3);
        let mut w = [0.0; MAX_DEGREE + 1];
        bernstein(degree, a, b, &mut w);
        bernstein_derivative(degree, a, b, &mut d);
        Vec3::from(direct(&d, &|c| at(&w, c)).map(|x| x as f32))
    }
}

impl CurvePiece {
    fn new(all: Arc<Curves>, curves: std::ops::Range<usize>, range: Option<[Range; 2]>) -> Self {
        let range = range.unwrap_or([Range::whole(1), Range::whole(all.spline.count())]);
        let mut piece = Self { all, curves, range, bounds: Vec::new() };
        piece.bounds = (0..piece.all.times.len()).map(|key| piece.find_bound(key)).collect();
        piece
    }

    fn curve(&self) -> usize {
        self.all.order[self.curves.start] as usize
    }

    fn find_bound(&self, key: usize) -> Bound {
        let all = &*self.all;
        let (stride, dim) = (all.stride(), all.control.dim);
        let (mut net, mut of_key) = (Vec::new(), Vec::new());
        let mut bound = Bound::EMPTY;
        for &curve in &all.order[self.curves.clone()] {
            let mut widest = 0.0_f64;
            let mut centre = Bound::EMPTY;
            for segment in self.range[1].segments() {
                all.gather(curve as usize, segment, &mut net);
                of_key.clear();
                for vertex in net.chunks_exact(stride) {
                    of_key.extend_from_slice(&vertex[key * dim..(key + 1) * dim]);
                    let weight = if dim == 4 && vertex[3] > 0.0 { vertex[3] } else { 1.0 };
                    widest = widest.max(vertex[all.control.channels + key] / weight);
                }
                let range = [Range::whole(1), self.range[1]];
                centre = centre.union(hull(&mut of_key, [0, all.spline.degree], dim, range, 6));
            }
            for end in [0.0, 1.0] {
                widest = widest.max(all.width(key, curve as usize, end).unwrap_or(0.0));
            }
            bound = bound.union(centre.padded(widest as f32 * 0.5));
        }
        rounded_out(bound)
    }
}

/// Appends `nu` points on each line from one border of a ribbon to the other. A ribbon is straight across.
fn spread_across(borders: &[Vec3], nu: usize, out: &mut Vec<Vec3>) {
    let last = nu.max(2) - 1;
    out.clear();
    out.reserve(borders.len() / 2 * (last + 1));
    for ends in borders.chunks_exact(2) {
        out.push(ends[0]);
        out.extend((1..last).map(|i| ends[0].lerp(ends[1], i as f32 / last as f32)));
        out.push(ends[1]);
    }
}

impl Surface for CurvePiece {
    fn key_times(&self) -> &[f32] {
        &self.all.times
    }

    fn bound(&self, key: usize) -> Bound {
        self.bounds[key.min(self.bounds.len() - 1)]
    }

    fn positions(&self, key: usize, nu: usize, nv: usize, out: &mut Vec<Vec3>) {
        let dice = self.dice(2, nv);
        spread_across(&dice.p[key.min(self.bounds.len() - 1)], nu, out);
    }

    fn positions_towards(
        &self,
        key: usize,
        nu: usize,
        nv: usize,
        view: &dyn Fn(usize, Vec3) -> View,
        out: &mut Vec<Vec3>,
    ) {
        let mut dice = self.dice(2, nv);
        dice.turn(view);
        spread_across(&dice.p[key.min(self.bounds.len() - 1)], nu, out);
    }

    fn domain(&self) -> [f32; 4] {
        let (u0, u1) = self.range[0].ends();
        let v = [0, 1].map(|i| {
            let place = self.range[1].place(i, 2);
            self.all.spline.parameter(place.segment, place.a, place.b) as f32
        });
        [u0 as f32, u1 as f32, v[0], v[1]]
    }

    fn is_splittable(&self) -> bool {
        // Where one parameter can no longer be divided, the width is so large that dividing the other parameter would
        // give equally wide parts.
        self.must_split() || self.range.iter().all(|r| r.halves().is_some())
    }

    fn is_group(&self) -> bool {
        self.curves.len() > 1
    }

    fn must_split(&self) -> bool {
        let segments = self.range[1].count();
        let most = if self.all.spline.degree == 1 { 1 } else { MOST_SEGMENTS };
        self.is_group() || segments > most
    }

    fn split(&self, direction: SplitDirection) -> Vec<Piece> {
        let piece = |curves, range| -> Piece { Box::new(Self::new(self.all.clone(), curves, range)) };
        if self.curves.len() > 1 {
            let middle = self.curves.start + self.curves.len() / 2;
            return vec![piece(self.curves.start..middle, None), piece(middle..self.curves.end, None)];
        }
        let mut axis = usize::from(direction == SplitDirection::V || self.must_split());
        if self.range[axis].halves().is_none() {
            axis = 1 - axis;
        }
        let Some((left, right)) = self.range[axis].halves() else { return Vec::new() };
        let with = |half| {
            let mut range = self.range;
            range[axis] = half;
            piece(self.curves.clone(), Some(range))
        };
        vec![with(left), with(right)]
    }

    fn dice(&self, nu: usize, nv: usize) -> Dice {
        let (nu, nv) = (nu.max(2), nv.max(2));
        let (all, curve, n) = (&*self.all, self.curve(), nu * nv);
        let (dim, keys) = (all.control.dim, all.times.len());
        let mut net = Vec::new();
        let points: Vec<Point> =
            (0..nv).map(|j| all.point(curve, self.range[1].place(j, nv), &mut net)).collect();
        let across: Vec<f64> = (0..nu).map(|i| self.range[0].place(i, nu).b).collect();
        let mut dice = Dice { nu, nv, face: curve as u32, ..Dice::default() };
        dice.u = (0..n).map(|i| across[i % nu] as f32).collect();
        dice.v = (0..n).map(|i| points[i / nu].v as f32).collect();
        dice.primvars = all.vars.uniform(curve);
        let values: Vec<f64> = (0..n).flat_map(|i| points[i / nu].values.iter().copied()).collect();
        emit(&all.vars.vertex, &values, n, all.stride(), keys * dim, &mut dice.primvars);
        if !all.vars.linear.is_empty() {
            let mut corners = Vec::new();
            for end in [0, 0, 1, 1] {
                all.vars.push_linear(curve * 2 + end, &mut corners);
            }
            let (v0, v1) = all.spline.extent();
            let s: Vec<f64> = (0..n).map(|i| across[i % nu]).collect();
            let t: Vec<f64> = (0..n).map(|i| (points[i / nu].v - v0) / (v1 - v0)).collect();
            all.vars.emit_linear(&corners, &s, &t, &mut dice.primvars);
        }
        dice.n = take_normals(n, &mut dice.primvars);
        let lanes = |f: &dyn Fn(&Point) -> Vec3| (0..n).map(|i| f(&points[i / nu])).collect::<Vec<_>>();
        let facing = Facing {
            centre: (0..keys).map(|k| lanes(&|p| position(&p.values[k * dim..], 3))).collect(),
            tangent: (0..keys).map(|k| lanes(&|p| p.tangents[k])).collect(),
            width: (0..keys).map(|k| (0..n).map(|i| points[i / nu].widths[k]).collect()).collect(),
            raster: false,
            offset: (0..n).map(|i| [(2.0 * across[i % nu] - 1.0) as f32, 0.0]).collect(),
        };
        dice.facing = Some(facing);
        match dice.n.clone() {
            Some(normals) => {
                // The normals replace the viewer permanently.
                dice.turn_by(&|_, i, _| View { toward: normals[i], pixel: 1.0 });
                dice.facing = None;
            }
            None => dice.turn(&|_, _| View { toward: Vec3::Z, pixel: 1.0 }),
        }
        dice
    }

    fn is_facing(&self) -> bool {
        !self.all.vars.has_normals()
    }

    fn is_curve(&self) -> bool {
        true
    }

    fn has_crease(&self) -> bool {
        let mut net = Vec::new();
        let mut tangents = |place| self.all.raw(self.curve(), place, &mut net).1;
        let mut segments = self.range[1].segments();
        let Some(mut segment) = segments.next() else { return false };
        for next in segments {
            let before = tangents(Place { segment, a: 0.0, b: 1.0 });
            let after = tangents(Place { segment: next, a: 1.0, b: 0.0 });
            if before.iter().zip(&after).any(|(a, b)| a.angle_between(*b) > CREASE) {
                return true;
            }
            segment = next;
        }
        false
    }
}
