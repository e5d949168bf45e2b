//! Pieces of anything made of Bezier nets: patches, faces, subdivided faces.
//!
//! A [`Net`] knows how to give the Bezier vertices of one segment; [`NetPiece`] bounds, splits and dices it.

use crate::bezier::{MAX_DEGREE, bernstein, bernstein_derivative, restrict, symmetric_sum};
use crate::dice::Dice;
use crate::range::{Place, Range};
use crate::surface::{Piece, SplitDirection, Surface};
use crate::trim::Trim;
use crate::vars::{Vars, emit, position, take_normals};
use granita_base::{Bound, Vec3};
use std::sync::Arc;

/// A primitive made of parts (one for a patch, one a face for a mesh), each of segments in u and v.
pub(crate) trait Net: Send + Sync {
    /// Times of the motion keys.
    fn times(&self) -> &[f32];
    /// 3, or 4 when rational.
    fn dim(&self) -> usize;
    /// Numbers per control vertex: positions of all keys, then vertex variables.
    fn channels(&self) -> usize;
    /// The primitive variables.
    fn vars(&self) -> &Vars;
    /// Degree of all segments.
    fn degrees(&self) -> [usize; 2];
    /// Segments of a part along u and v.
    fn segments(&self, part: usize) -> [u32; 2];
    /// Parameter at a place along u (axis 0) or v (axis 1) and the length of its segment.
    fn parameter(&self, part: usize, axis: usize, place: Place) -> (f64, f64);
    /// Parameters at the ends of a part along an axis.
    fn extent(&self, part: usize, axis: usize) -> (f64, f64);
    /// Replaces `out` by the Bezier vertices of a segment, u fastest, `channels` numbers each.
    fn gather(&self, part: usize, segment: [u32; 2], out: &mut Vec<f64>);
    /// Replaces `out` by the linear variables at the corners (0,0), (1,0), (0,1), (1,1) of a part.
    fn corners(&self, part: usize, out: &mut Vec<f64>);
    /// Which face a part is.
    fn face(&self, part: usize) -> u32;
    /// Box around a whole part at a motion key, where it is cheaper than from its Bezier vertices.
    fn part_bound(&self, part: usize, key: usize) -> Option<Bound>;
    /// Trim curves.
    fn trim(&self) -> Option<&Trim> {
        None
    }
    /// Whether a piece may be diced over the ends of segments.
    fn dices_over(&self) -> bool;
}

/// A run of parts, or a range of one.
pub(crate) struct NetPiece {
    net: Arc<dyn Net>,
    parts: std::ops::Range<usize>,
    range: [Range; 2],
    bounds: Vec<Bound>,
}

/// The whole primitive, as few pieces as possible.
pub(crate) fn pieces(net: Arc<dyn Net>, parts: usize) -> Vec<Piece> {
    if parts == 0 {
        return Vec::new();
    }
    vec![Box::new(NetPiece::new(net, 0..parts, None))]
}

/// Evaluated lattice.
struct Lattice {
    places: [Vec<Place>; 2],
}

impl NetPiece {
    fn new(net: Arc<dyn Net>, parts: std::ops::Range<usize>, range: Option<[Range; 2]>) -> Self {
        let range = range.unwrap_or_else(|| net.segments(parts.start).map(Range::whole));
        let mut piece = Self { net, parts, range, bounds: Vec::new() };
        piece.bounds = (0..piece.net.times().len()).map(|key| piece.find_bound(key)).collect();
        piece
    }

    fn part(&self) -> usize {
        self.parts.start
    }

    fn find_bound(&self, key: usize) -> Bound {
        let whole = self.parts.len() > 1 || {
            let all = self.net.segments(self.part());
            (0..2).all(|axis| self.range[axis] == Range::whole(all[axis]))
        };
        let mut bound = Bound::EMPTY;
        if whole {
            for part in self.parts.clone() {
                let of_part = self.net.part_bound(part, key).unwrap_or_else(|| {
                    let segments = self.net.segments(part).map(Range::whole);
                    net_bound(&*self.net, part, segments, key)
                });
                bound = bound.union(of_part);
            }
            bound
        } else {
            net_bound(&*self.net, self.part(), self.range, key)
        }
    }

    fn lattice(&self, nu: usize, nv: usize) -> Lattice {
        let along = |axis: usize, n: usize| (0..n).map(|i| self.range[axis].place(i, n)).collect();
        Lattice { places: [along(0, nu), along(1, nv)] }
    }

    /// Evaluates the channels `wanted` at all points; where `derivatives` is given, also dP/du and dP/dv at key 0.
    fn evaluate(
        &self,
        lattice: &Lattice,
        wanted: std::ops::Range<usize>,
        mut derivatives: Option<(&mut [Vec3], &mut [Vec3])>,
    ) -> Vec<f64> {
        let [us, vs] = &lattice.places;
        let (nu, width) = (us.len(), wanted.len());
        let mut out = vec![0.0; nu * vs.len() * width];
        let mut net = Vec::new();
        for rows in runs(vs) {
            for columns in runs(us) {
                let segment = [us[columns.start].segment, vs[rows.start].segment];
                self.net.gather(self.part(), segment, &mut net);
                let segment = SegmentNet {
                    net: &net,
                    channels: self.net.channels(),
                    positions: self.net.dim() * self.net.times().len(),
                    degrees: self.net.degrees(),
                    dim: self.net.dim(),
                };
                segment.values(&us[columns.clone()], &vs[rows.clone()], wanted.clone(), |i, j, values| {
                    let at = ((rows.start + j) * nu + columns.start + i) * width;
                    out[at..at + width].copy_from_slice(values);
                });
                if let Some((du, dv)) = &mut derivatives {
                    let lengths = [0, 1].map(|axis| {
                        let place = if axis == 0 { us[columns.start] } else { vs[rows.start] };
                        self.net.parameter(self.part(), axis, place).1
                    });
                    segment.derivatives(&us[columns.clone()], &vs[rows.clone()], |i, j, d| {
                        let at = (rows.start + j) * nu + columns.start + i;
                        du[at] = scaled(d[0], lengths[0]);
                        dv[at] = scaled(d[1], lengths[1]);
                    });
                }
            }
        }
        out
    }
}

fn scaled(d: [f64; 3], length: f64) -> Vec3 {
    Vec3::new((d[0] / length) as f32, (d[1] / length) as f32, (d[2] / length) as f32)
}

/// Runs of places in one segment.
fn runs(places: &[Place]) -> Vec<std::ops::Range<usize>> {
    let mut runs: Vec<std::ops::Range<usize>> = Vec::new();
    for (i, place) in places.iter().enumerate() {
        match runs.last_mut() {
            Some(run) if places[run.start].segment == place.segment => run.end = i + 1,
            _ => runs.push(i..i + 1),
        }
    }
    runs
}

/// The Bezier vertices of one segment.
struct SegmentNet<'a> {
    net: &'a [f64],
    channels: usize,
    /// How many channels are positions.
    positions: usize,
    degrees: [usize; 2],
    dim: usize,
}

type Weights = [f64; MAX_DEGREE + 1];

fn all_weights(degree: usize, places: &[Place]) -> Vec<Weights> {
    let each = |p: &Place| {
        let mut w = [0.0; MAX_DEGREE + 1];
        bernstein(degree, p.a, p.b, &mut w);
        w
    };
    places.iter().map(each).collect()
}

impl SegmentNet<'_> {
    /// Hands the `wanted` channels of each point to `sink`; they start at a whole position. Of a rational net
    /// positions come divided, their weights as 1.
    fn values(
        &self,
        us: &[Place],
        vs: &[Place],
        wanted: std::ops::Range<usize>,
        mut sink: impl FnMut(usize, usize, &[f64]),
    ) {
        let ([du, dv], c) = (self.degrees, self.channels);
        let (wu, wv) = (all_weights(du, us), all_weights(dv, vs));
        let mut row = vec![0.0; (du + 1) * c];
        let mut point = vec![0.0; wanted.len()];
        let in_point = self.positions.clamp(wanted.start, wanted.end) - wanted.start;
        let safe = |w: f64| if w == 0.0 { 1.0 } else { w };
        for (j, w) in wv.iter().enumerate() {
            // Rational vertex variables need the weight of the first key.
            let first = if self.dim == 4 { 0 } else { wanted.start };
            for i in 0..=du {
                for ch in first..wanted.end {
                    row[i * c + ch] = symmetric_sum(&w[..=dv], |k| self.net[(k * (du + 1) + i) * c + ch]);
                }
            }
            for (i, w) in wu.iter().enumerate() {
                for (slot, ch) in point.iter_mut().zip(wanted.clone()) {
                    *slot = symmetric_sum(&w[..=du], |k| row[k * c + ch]);
                }
                if self.dim == 4 {
                    let weight = safe(symmetric_sum(&w[..=du], |k| row[k * c + 3]));
                    let (positions, others) = point.split_at_mut(in_point);
                    for p in positions.chunks_exact_mut(4) {
                        let weight = safe(p[3]);
                        p[..3].iter_mut().for_each(|x| *x /= weight);
                        p[3] = 1.0;
                    }
                    others.iter_mut().for_each(|x| *x /= weight);
                }
                sink(i, j, &point);
            }
        }
    }

    /// Hands the derivatives of the first key's position along the segment's u and v to `sink`.
    ///
    /// Where they are parallel or vanish, those a little further inside take their place: the limit from inside.
    fn derivatives(&self, us: &[Place], vs: &[Place], mut sink: impl FnMut(usize, usize, [[f64; 3]; 2])) {
        let size = [self.longest(0), self.longest(1)];
        // Scene files have some five digits: a pole of a patch may be a little off from itself.
        let too_small = |d: &[f64; 3], axis: usize| length(*d) <= 1e-4 * size[axis];
        let parallel = |d: &[[f64; 3]; 2]| length(cross(d[0], d[1])) <= 1e-6 * length(d[0]) * length(d[1]);
        let columns = Column::list(self.degrees[0], us);
        let mut rows = Vec::new();
        for (j, v) in vs.iter().enumerate() {
            self.rows(v, &mut rows);
            for (i, u) in us.iter().enumerate() {
                let mut d = self.frame(&columns[i], &rows);
                let small = [too_small(&d[0], 0), too_small(&d[1], 1)];
                if small[0] || small[1] || parallel(&d) {
                    let mut rows = Vec::new();
                    self.rows(&inset(v), &mut rows);
                    let inside = self.frame(&Column::list(self.degrees[0], &[inset(u)])[0], &rows);
                    for axis in 0..2 {
                        // Two long but parallel derivatives are both replaced.
                        if small[axis] || !(small[0] || small[1]) {
                            d[axis] = inside[axis];
                        }
                    }
                }
                sink(i, j, d);
            }
        }
    }

    /// Replaces `out` by the vertices of the curve of constant v and their derivatives along v.
    fn rows(&self, v: &Place, out: &mut Vec<[[f64; 4]; 2]>) {
        let ([du, dv], c) = (self.degrees, self.channels);
        let (mut w, mut g) = ([0.0; MAX_DEGREE + 1], [0.0; MAX_DEGREE + 1]);
        bernstein(dv, v.a, v.b, &mut w);
        bernstein_derivative(dv, v.a, v.b, &mut g);
        out.clear();
        out.extend((0..=du).map(|i| {
            let mut row = [[0.0; 4]; 2];
            for k in 0..=dv {
                let at = &self.net[(k * (du + 1) + i) * c..][..self.dim];
                for (x, &p) in at.iter().enumerate() {
                    row[0][x] += w[k] * p;
                    row[1][x] += g[k] * p;
                }
            }
            row
        }));
    }

    /// The longest derivative the control vertices suggest.
    fn longest(&self, axis: usize) -> f64 {
        let n = self.degrees.map(|d| d + 1);
        let p = |i: usize, j: usize| {
            let at = &self.net[(j * n[0] + i) * self.channels..];
            let w = if self.dim == 4 && at[3] != 0.0 { at[3] } else { 1.0 };
            [at[0] / w, at[1] / w, at[2] / w]
        };
        let step = [usize::from(axis == 0), usize::from(axis == 1)];
        let mut longest = 0.0_f64;
        for j in 0..n[1] - step[1] {
            for i in 0..n[0] - step[0] {
                longest = longest.max(length(sub(p(i + step[0], j + step[1]), p(i, j))));
            }
        }
        longest * self.degrees[axis] as f64
    }

    /// Derivatives along u and v at one place of a row.
    fn frame(&self, column: &Column, rows: &[[[f64; 4]; 2]]) -> [[f64; 3]; 2] {
        // Value, along u, along v.
        let mut sums = [[0.0_f64; 4]; 3];
        for (i, [value, along_v]) in rows.iter().enumerate() {
            for x in 0..self.dim {
                sums[0][x] += column.value[i] * value[x];
                sums[1][x] += column.derivative[i] * value[x];
                sums[2][x] += column.value[i] * along_v[x];
            }
        }
        let [x, xu, xv] = sums;
        let w = if self.dim == 4 && x[3] != 0.0 { x[3] } else { 1.0 };
        let quotient = |d: [f64; 4]| -> [f64; 3] {
            std::array::from_fn(|a| if self.dim == 4 { (d[a] - x[a] / w * d[3]) / w } else { d[a] })
        };
        [quotient(xu), quotient(xv)]
    }
}

/// Weights along u at one place.
struct Column {
    value: Weights,
    derivative: Weights,
}

impl Column {
    fn list(degree: usize, places: &[Place]) -> Vec<Self> {
        let each = |p: &Place| {
            let (mut value, mut derivative) = ([0.0; MAX_DEGREE + 1], [0.0; MAX_DEGREE + 1]);
            bernstein(degree, p.a, p.b, &mut value);
            bernstein_derivative(degree, p.a, p.b, &mut derivative);
            Self { value, derivative }
        };
        places.iter().map(each).collect()
    }
}

/// A place a little nearer to the middle of its segment.
fn inset(place: &Place) -> Place {
    const STEP: f64 = 1e-3;
    Place { b: place.b + (0.5 - place.b) * STEP, a: place.a + (0.5 - place.a) * STEP, ..*place }
}

fn sub(x: [f64; 3], y: [f64; 3]) -> [f64; 3] {
    [x[0] - y[0], x[1] - y[1], x[2] - y[2]]
}

/// The cross product.
pub(crate) fn cross(x: [f64; 3], y: [f64; 3]) -> [f64; 3] {
    [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]]
}

fn length(x: [f64; 3]) -> f64 {
    (x[0] * x[0] + x[1] * x[1] + x[2] * x[2]).sqrt()
}

/// Box around the convex hull of a range of a part.
pub(crate) fn net_bound(net: &dyn Net, part: usize, range: [Range; 2], key: usize) -> Bound {
    let dim = net.dim();
    let mut bound = Bound::EMPTY;
    let (mut all, mut of_key) = (Vec::new(), Vec::new());
    for sv in range[1].segments() {
        for su in range[0].segments() {
            net.gather(part, [su, sv], &mut all);
            of_key.clear();
            for vertex in all.chunks_exact(net.channels()) {
                of_key.extend_from_slice(&vertex[key * dim..(key + 1) * dim]);
            }
            bound = bound.union(hull(&mut of_key, net.degrees(), dim, range, 6));
        }
    }
    rounded_out(bound)
}

/// Room for the rounding of positions to single precision.
pub(crate) fn rounded_out(bound: Bound) -> Bound {
    if bound.is_empty() {
        return bound;
    }
    let room = bound.min.abs().max(bound.max.abs()) * 2.4e-7;
    Bound { min: bound.min - room, max: bound.max + room }
}

/// Box around the Bezier vertices (`dim` numbers each) of a range of one segment.
pub(crate) fn hull(net: &mut [f64], degrees: [usize; 2], dim: usize, range: [Range; 2], depth: u32) -> Bound {
    let (nu, nv) = (degrees[0] + 1, degrees[1] + 1);
    cut(net, degrees, dim, 0, range[0].ends(), range[0].is_whole());
    cut(net, degrees, dim, 1, range[1].ends(), range[1].is_whole());
    if dim == 3 || net.chunks_exact(4).all(|v| v[3] > 0.0) {
        return Bound::around(net.chunks_exact(dim).map(|v| position(v, dim)));
    }
    // Weights that are not positive have no hull; parts of the surface do.
    if depth == 0 {
        let places: Vec<Place> = (0..9).map(|i| Range::whole(1).place(i, 9)).collect();
        let segment = SegmentNet { net, channels: dim, positions: dim, degrees, dim };
        let mut bound = Bound::EMPTY;
        segment.values(&places, &places, 0..dim, |_, _, p| {
            let p = position(p, 3);
            if p.is_finite() {
                bound = bound.with(p);
            }
        });
        return bound;
    }
    let whole = Range::whole(1);
    let Some((left, right)) = whole.halves() else { return Bound::EMPTY };
    let axis = (depth % 2) as usize;
    let mut bound = Bound::EMPTY;
    for half in [left, right] {
        let mut part = net[..nu * nv * dim].to_vec();
        let range = if axis == 0 { [half, whole] } else { [whole, half] };
        bound = bound.union(hull(&mut part, degrees, dim, range, depth - 1));
    }
    bound
}

/// Restricts a net along one axis.
fn cut(net: &mut [f64], degrees: [usize; 2], dim: usize, axis: usize, (s0, s1): (f64, f64), whole: bool) {
    if whole {
        return;
    }
    let (nu, nv) = (degrees[0] + 1, degrees[1] + 1);
    if axis == 0 {
        for row in net.chunks_exact_mut(nu * dim).take(nv) {
            restrict(row, degrees[0], dim, dim, s0, s1);
        }
    } else {
        for column in 0..nu {
            restrict(&mut net[column * dim..], degrees[1], nu * dim, dim, s0, s1);
        }
    }
}

impl Surface for NetPiece {
    fn key_times(&self) -> &[f32] {
        self.net.times()
    }

    fn bound(&self, key: usize) -> Bound {
        self.bounds[key.min(self.bounds.len() - 1)]
    }

    fn positions(&self, key: usize, nu: usize, nv: usize, out: &mut Vec<Vec3>) {
        let dim = self.net.dim();
        let key = key.min(self.bounds.len() - 1);
        let lattice = self.lattice(nu.max(2), nv.max(2));
        let values = self.evaluate(&lattice, key * dim..(key + 1) * dim, None);
        out.clear();
        out.extend(values.chunks_exact(dim).map(|v| position(v, 3)));
    }

    fn domain(&self) -> [f32; 4] {
        let mut domain = [0.0; 4];
        for axis in 0..2 {
            for (end, i) in [(0, 0), (1, 1)] {
                let place = self.range[axis].place(i, 2);
                domain[axis * 2 + end] = self.net.parameter(self.part(), axis, place).0 as f32;
            }
        }
        domain
    }

    fn is_splittable(&self) -> bool {
        self.must_split() || self.range.iter().any(|r| r.halves().is_some())
    }

    fn must_split(&self) -> bool {
        self.parts.len() > 1 || (!self.net.dices_over() && self.range.iter().any(|r| r.count() > 1))
    }

    fn split(&self, direction: SplitDirection) -> Vec<Piece> {
        let piece = |parts, range| -> Piece { Box::new(Self::new(self.net.clone(), parts, range)) };
        if self.parts.len() > 1 {
            let middle = self.parts.start + self.parts.len() / 2;
            return vec![piece(self.parts.start..middle, None), piece(middle..self.parts.end, None)];
        }
        let mut axis = usize::from(direction == SplitDirection::V);
        let other = 1 - axis;
        // Segments have to be parted first.
        if self.must_split() && self.range[axis].count() == 1 && self.range[other].count() > 1 {
            axis = other;
        }
        if self.range[axis].halves().is_none() {
            axis = 1 - axis;
        }
        let Some((left, right)) = self.range[axis].halves() else { return Vec::new() };
        let with = |half| {
            let mut range = self.range;
            range[axis] = half;
            piece(self.parts.clone(), Some(range))
        };
        vec![with(left), with(right)]
    }

    fn dice(&self, nu: usize, nv: usize) -> Dice {
        let (nu, nv) = (nu.max(2), nv.max(2));
        let (net, part, n) = (&*self.net, self.part(), nu * nv);
        let (dim, channels, keys) = (net.dim(), net.channels(), net.times().len());
        let lattice = self.lattice(nu, nv);
        let (mut dpdu, mut dpdv) = (vec![Vec3::ZERO; n], vec![Vec3::ZERO; n]);
        let values = self.evaluate(&lattice, 0..channels, Some((&mut dpdu, &mut dpdv)));
        let p = (0..keys)
            .map(|key| values.chunks_exact(channels).map(|v| position(&v[key * dim..], 3)).collect())
            .collect();
        let along = |axis: usize| -> Vec<f64> {
            lattice.places[axis].iter().map(|p| net.parameter(part, axis, *p).0).collect()
        };
        let (us, vs) = (along(0), along(1));
        let u = (0..n).map(|i| us[i % nu] as f32).collect();
        let v = (0..n).map(|i| vs[i / nu] as f32).collect();
        let mut primvars = net.vars().uniform(net.face(part) as usize);
        emit(&net.vars().vertex, &values, n, channels, keys * dim, &mut primvars);
        if !net.vars().linear.is_empty() {
            let mut corners = Vec::new();
            net.corners(part, &mut corners);
            let fractions = |axis: usize, list: &[f64]| -> Vec<f64> {
                let (x0, x1) = net.extent(part, axis);
                list.iter().map(|x| (x - x0) / (x1 - x0)).collect()
            };
            net.vars().emit_linear(&corners, &fractions(0, &us), &fractions(1, &vs), &mut primvars);
        }
        let mask = net.trim().map(|trim| trim.mask(&us, &vs));
        let normals = take_normals(n, &mut primvars);
        Dice { nu, nv, p, n: normals, dpdu, dpdv, u, v, primvars, face: net.face(part), mask, facing: None }
    }
}
