// tidy: long: splitting and evaluating a net of control points share its layout, which nothing else knows
//! Pieces of all primitives that consist of Bezier nets: patches, faces and subdivided faces.
//!
//! A [`Net`] computes the Bezier vertices of one segment. A [`NetPiece`] bounds, splits and dices it.

use crate::bezier::{MAX_DEGREE, bernstein, bernstein_derivative, restrict, symmetric_sum};
use crate::dice::Dice;
use crate::range::{Place, Range};
use crate::side::{Lattice, Settled, SidePart, SidePoints};
use crate::surface::{Piece, SplitDirection, Surface};
use crate::trim::Trim;
use crate::vars::{Vars, emit, position, take_normals};
use granita_base::{Bound, DVec3, Vec3};
use std::ops::Deref;
use std::sync::Arc;

/// A primitive made of parts (one for a patch, one for each face of a mesh), each with segments in u and v.
pub(crate) trait Net: Send + Sync {
    /// Returns the times of the motion keys.
    fn times(&self) -> &[f32];
    /// Returns the number of position coordinates: 3, or 4 when rational.
    fn dim(&self) -> usize;
    /// Returns the number of channels per control vertex: positions of all keys, then vertex variables.
    fn channels(&self) -> usize;
    /// Returns the primitive variables.
    fn vars(&self) -> &Vars;
    /// Returns the degree of all segments along u and v.
    fn degrees(&self) -> [usize; 2];
    /// Returns the numbers of segments of a part along u and v.
    fn segments(&self, part: usize) -> [u32; 2];
    /// Returns the parameter at a place along u (axis 0) or v (axis 1), and the length of its segment.
    fn parameter(&self, part: usize, axis: usize, place: Place) -> (f64, f64);
    /// Returns the parameters at the ends of a part along an axis.
    fn extent(&self, part: usize, axis: usize) -> (f64, f64);
    /// Replaces `out` by the Bezier vertices of a segment, u fastest, `channels` numbers each.
    fn gather(&self, part: usize, segment: [u32; 2], out: &mut Vec<f64>);
    /// Replaces `out` by the linear variables at the corners (0,0), (1,0), (0,1), (1,1) of a part.
    fn corners(&self, part: usize, out: &mut Vec<f64>);
    /// Returns the index of the face of a part.
    fn face(&self, part: usize) -> u32;
    /// Returns the box around a whole part at a motion key, when this is cheaper than from its Bezier vertices.
    fn part_bound(&self, part: usize, key: usize) -> Option<Bound>;
    /// Returns the corners of a flat part at a motion key; `None` for parts that are not flat faces.
    fn facet(&self, _part: usize, _key: usize) -> Option<[Vec3; 4]> {
        None
    }
    /// Returns the trim curves.
    fn trim(&self) -> Option<&Trim> {
        None
    }
    /// True when dicing a piece may cross the ends of segments.
    fn dices_over(&self) -> bool;
    /// True when there may be a [`Net::seam`].
    fn has_seams(&self) -> bool {
        false
    }
    /// Replaces `out` by the Bezier vertices of the segment beyond a side of a segment, when the normals there may
    /// differ.
    fn seam(&self, _part: usize, _segment: [u32; 2], _side: usize, _out: &mut Vec<f64>) -> Option<Seam> {
        None
    }
    /// Returns the largest number of segments that need not be halved, of a side of a part, or of a line inside
    /// (`None`).
    fn most_on_side(&self, _part: usize, _side: Option<usize>) -> u32 {
        if self.dices_over() { u32::MAX } else { 1 }
    }
}

/// The segment beyond a shared edge where the patches on both sides have different normals.
pub(crate) struct Seam {
    /// Maps the place of a point of the edge in its own segment to its u and v in the segment beyond.
    pub(crate) beyond: fn(Place) -> [Place; 2],
    /// True when the place of the point runs in the opposite direction.
    pub(crate) reversed: bool,
    /// The axis of its own segment that runs along the edge.
    pub(crate) along: usize,
}

/// A run of parts, or a range of one part.
pub(crate) struct NetPiece {
    net: Arc<Whole>,
    parts: std::ops::Range<usize>,
    range: [Range; 2],
    settled: Settled,
    bounds: Vec<Bound>,
}

/// The largest number of segments whose Bezier vertices bound a piece.
const MOST_HULL_SEGMENTS: usize = 16;

/// The number of parts of a block.
const BLOCK: usize = 16;

/// The data that all pieces of a primitive share.
struct Whole {
    net: Box<dyn Net>,
    /// For each motion key: boxes around every [`BLOCK`] parts, so that large groups need not evaluate each part.
    blocks: Vec<Vec<Bound>>,
}

impl Deref for Whole {
    type Target = dyn Net;

    fn deref(&self) -> &Self::Target {
        &*self.net
    }
}

impl Whole {
    fn new(net: Box<dyn Net>, parts: usize) -> Self {
        let mut whole = Self { net, blocks: Vec::new() };
        let starts = || (0..parts).step_by(BLOCK);
        let block = |key: usize, start: usize| whole.bound(start..(start + BLOCK).min(parts), key);
        whole.blocks = (0..whole.net.times().len())
            .map(|key| starts().map(|start| block(key, start)).collect())
            .collect();
        whole
    }

    /// Returns a box around these parts at a motion key.
    fn bound(&self, parts: std::ops::Range<usize>, key: usize) -> Bound {
        let mut bound = Bound::EMPTY;
        let mut part = parts.start;
        while part < parts.end {
            let block = self.blocks.get(key).and_then(|blocks| blocks.get(part / BLOCK));
            if let Some(block) = block.filter(|_| part.is_multiple_of(BLOCK) && part + BLOCK <= parts.end) {
                bound = bound.union(*block);
                part += BLOCK;
                continue;
            }
            bound = bound.union(self.net.part_bound(part, key).unwrap_or_else(|| {
                let segments = self.net.segments(part).map(Range::whole);
                net_bound(&*self.net, part, segments, key)
            }));
            part += 1;
        }
        bound
    }
}

/// Returns the whole primitive in as few pieces as possible.
pub(crate) fn pieces(net: Box<dyn Net>, parts: usize) -> Vec<Piece> {
    if parts == 0 {
        return Vec::new();
    }
    let net = Arc::new(Whole::new(net, parts));
    vec![Box::new(NetPiece::new(net, 0..parts, None, Settled::default()))]
}

impl NetPiece {
    fn new(
        net: Arc<Whole>,
        parts: std::ops::Range<usize>,
        range: Option<[Range; 2]>,
        settled: Settled,
    ) -> Self {
        let range = range.unwrap_or_else(|| net.segments(parts.start).map(Range::whole));
        let mut piece = Self { net, parts, range, settled, bounds: Vec::new() };
        piece.bounds = (0..piece.net.times().len()).map(|key| piece.find_bound(key)).collect();
        let (dim, keys) = (piece.net.dim(), piece.net.times().len());
        for [u, v] in piece.settled.outside(&piece.range) {
            let values = piece.block([&[u], &[v]], 0..keys * dim, None);
            for (bound, p) in piece.bounds.iter_mut().zip(values.chunks_exact(dim)) {
                *bound = bound.union(rounded_out(Bound::around([position(p, 3)])));
            }
        }
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
        if whole {
            self.net.bound(self.parts.clone(), key)
        } else {
            net_bound(&**self.net, self.part(), self.range, key)
        }
    }

    /// Returns the positions at a motion key of a lattice of places.
    fn positions_at(&self, key: usize, places: [&[Place]; 2]) -> impl Iterator<Item = DVec3> + use<> {
        let dim = self.net.dim();
        let key = key.min(self.bounds.len() - 1);
        let values = self.block(places, key * dim..(key + 1) * dim, None);
        precise(values, dim)
    }

    /// Does the same as [`NetPiece::positions_at`] at `n` places spread evenly over a part of a side.
    fn positions_along(&self, key: usize, part: &SidePart, n: usize) -> impl Iterator<Item = DVec3> + use<> {
        let along: Vec<Place> = (0..n).map(|i| part.range.place(i, n)).collect();
        let across = [self.range[1 - part.side / 2].place(part.side % 2, 2)];
        self.positions_at(key, if part.side < 2 { [&along[..], &across] } else { [&across, &along[..]] })
    }

    /// Returns the Bezier vertices of all segments of the piece; `None` when their hull does not contain the piece,
    /// or when they are many.
    fn vertices(&self, key: usize) -> Option<Vec<DVec3>> {
        let (dim, degrees) = (self.net.dim(), self.net.degrees());
        let segments = self.range.iter().map(|r| r.count() as usize).product::<usize>();
        // Interpolation between keys applies to the quotients, not to their weights.
        let blends = dim == 3 || self.bounds.len() == 1;
        if self.parts.len() > 1 || segments > MOST_HULL_SEGMENTS || !blends {
            return None;
        }
        let key = key.min(self.bounds.len() - 1);
        let (mut all, mut of_key, mut out) = (Vec::new(), Vec::new(), Vec::new());
        for sv in self.range[1].segments() {
            for su in self.range[0].segments() {
                self.net.gather(self.part(), [su, sv], &mut all);
                of_key.clear();
                for vertex in all.chunks_exact(self.net.channels()) {
                    of_key.extend_from_slice(&vertex[key * dim..(key + 1) * dim]);
                }
                for axis in 0..2 {
                    let range = self.range[axis];
                    cut(&mut of_key, degrees, dim, axis, range.ends(), range.is_whole());
                }
                if dim == 4 && !of_key.chunks_exact(4).all(|v| v[3] > 0.0) {
                    return None;
                }
                out.extend(
                    of_key
                        .chunks_exact(dim)
                        .map(|v| DVec3::new(v[0], v[1], v[2]) / if dim == 4 { v[3] } else { 1.0 }),
                );
            }
        }
        for [u, v] in self.settled.outside(&self.range) {
            out.extend(self.positions_at(key, [&[u], &[v]]));
        }
        Some(out)
    }

    /// Evaluates the channels `wanted` at all points. When `derivatives` is given, it also evaluates dP/du and dP/dv
    /// at key 0.
    fn evaluate(
        &self,
        lattice: &Lattice,
        wanted: std::ops::Range<usize>,
        mut derivatives: Option<(&mut [Vec3], &mut [Vec3])>,
    ) -> Vec<f64> {
        let [us, vs] = &lattice.places;
        let width = wanted.len();
        let mut out =
            self.block([us, vs], wanted.clone(), derivatives.as_mut().map(|(du, dv)| (&mut **du, &mut **dv)));
        for border in lattice.borders() {
            let n = border.at.len();
            let (mut du, mut dv) = (vec![Vec3::ZERO; n], vec![Vec3::ZERO; n]);
            let [us, vs] = &border.places;
            let values =
                self.block([us, vs], wanted.clone(), derivatives.is_some().then_some((&mut du, &mut dv)));
            for (k, at) in border.at.iter().enumerate() {
                let Some(at) = *at else { continue };
                out[at * width..(at + 1) * width].copy_from_slice(&values[k * width..(k + 1) * width]);
                if let Some((all_du, all_dv)) = &mut derivatives {
                    (all_du[at], all_dv[at]) = (du[k], dv[k]);
                }
            }
        }
        for &[corner, point] in &lattice.copies {
            out.copy_within(corner * width..(corner + 1) * width, point * width);
            if let Some((du, dv)) = &mut derivatives {
                (du[point], dv[point]) = (du[corner], dv[corner]);
            }
        }
        out
    }

    /// True when a side is a side of the part, not a line inside of it.
    fn is_outer(&self, side: usize) -> bool {
        let across = 1 - side / 2;
        let all = Range::whole(self.net.segments(self.part())[across]).span();
        let (start, end) = self.range[across].span();
        if side.is_multiple_of(2) { start == all.0 } else { end == all.1 }
    }

    /// Rotates the derivatives at shared edges so that both sides have the same normal, which is the mean of theirs.
    fn close_seams(&self, lattice: &Lattice, du: &mut [Vec3], dv: &mut [Vec3]) {
        if !self.net.has_seams() {
            return;
        }
        let (mut own, mut other) = (Vec::new(), Vec::new());
        for side in (0..4).filter(|side| self.is_outer(*side)) {
            let mut known: Option<([u32; 2], Option<Seam>)> = None;
            for (at, [u, v]) in lattice.side(side) {
                let segment = [u.segment, v.segment];
                if known.as_ref().is_none_or(|(of, _)| *of != segment) {
                    known = Some((segment, self.net.seam(self.part(), segment, side, &mut other)));
                    self.net.gather(self.part(), segment, &mut own);
                }
                let Some((_, Some(seam))) = &known else { continue };
                let place = [u, v][seam.along];
                let place = if seam.reversed { Place { a: place.b, b: place.a, ..place } } else { place };
                let (a, b) = (self.normal(&own, [u, v]), self.normal(&other, (seam.beyond)(place)));
                let mut n: [f64; 3] = std::array::from_fn(|x| a[x] + b[x]);
                // The neighbours have opposite windings.
                if (0..3).map(|x| a[x] * b[x]).sum::<f64>() < 0.0 {
                    n = std::array::from_fn(|x| a[x] - b[x]);
                }
                let n = Vec3::from(n.map(|x| x as f32)).normalize_or_zero();
                for d in [&mut du[at], &mut dv[at]] {
                    *d -= n * d.dot(n);
                }
            }
        }
    }

    /// Returns the unit normal of a segment, or zero where it has none.
    fn normal(&self, net: &[f64], [u, v]: [Place; 2]) -> [f64; 3] {
        let net = self.segment_net(net);
        let mut normal = [0.0; 3];
        net.derivatives(&[u], &[v], |_, _, [du, dv]| normal = cross(du, dv));
        let size = length(normal);
        if size > 0.0 { normal.map(|x| x / size) } else { normal }
    }

    fn segment_net<'n>(&self, net: &'n [f64]) -> SegmentNet<'n> {
        SegmentNet {
            net,
            channels: self.net.channels(),
            positions: self.net.dim() * self.net.times().len(),
            degrees: self.net.degrees(),
            dim: self.net.dim(),
        }
    }

    /// Does the same as [`NetPiece::evaluate`] at every u with every v.
    fn block(
        &self,
        [us, vs]: [&[Place]; 2],
        wanted: std::ops::Range<usize>,
        mut derivatives: Option<(&mut [Vec3], &mut [Vec3])>,
    ) -> Vec<f64> {
        let (nu, width) = (us.len(), wanted.len());
        let mut out = vec![0.0; nu * vs.len() * width];
        let mut net = Vec::new();
        if self.net.degrees() == [1, 1] && self.net.dim() == 3 && self.net.segments(self.part()) == [1, 1] {
            self.net.gather(self.part(), [0, 0], &mut net);
            let segment = self.segment_net(&net);
            segment.bilinear(us, vs, wanted, &mut out);
            if let Some((du, dv)) = &mut derivatives {
                let lengths = [0, 1].map(|axis| self.net.parameter(self.part(), axis, us[0]).1);
                segment.derivatives(us, vs, |i, j, d| {
                    du[j * nu + i] = scaled(d[0], lengths[0]);
                    dv[j * nu + i] = scaled(d[1], lengths[1]);
                });
            }
            return out;
        }
        for rows in runs(vs) {
            for columns in runs(us) {
                let segment = [us[columns.start].segment, vs[rows.start].segment];
                self.net.gather(self.part(), segment, &mut net);
                let segment = self.segment_net(&net);
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

/// Returns positions from their channels, divided by weights if there are any.
fn precise(values: Vec<f64>, dim: usize) -> impl Iterator<Item = DVec3> {
    (0..values.len() / dim).map(move |i| DVec3::from_slice(&values[i * dim..]))
}

fn scaled(d: [f64; 3], length: f64) -> Vec3 {
    Vec3::new((d[0] / length) as f32, (d[1] / length) as f32, (d[2] / length) as f32)
}

/// Returns the runs of places that are in one segment.
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
    /// The number of channels that are positions.
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
    /// Passes the `wanted` channels of each point to `sink`. They start at a whole position. The positions of a
    /// rational net are divided by their weights, and the weights are 1.
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

    /// Does the same as [`SegmentNet::values`], to the bit, for a net of four vertices that is not rational, one
    /// point after the other.
    fn bilinear(&self, us: &[Place], vs: &[Place], wanted: std::ops::Range<usize>, out: &mut [f64]) {
        let c = self.channels;
        let mut points = out.chunks_exact_mut(wanted.len());
        for v in vs {
            for u in us {
                let Some(point) = points.next() else { return };
                for (slot, ch) in point.iter_mut().zip(wanted.clone()) {
                    // The sum begins at 0, as in `symmetric_sum`.
                    let at = |i: usize| 0.0 + (v.a * self.net[i * c + ch] + v.b * self.net[(2 + i) * c + ch]);
                    *slot = 0.0 + (u.a * at(0) + u.b * at(1));
                }
            }
        }
    }

    /// Passes the derivatives of the first key's position along the segment's u and v to `sink`.
    ///
    /// Where they are parallel or vanish, the derivatives slightly further inside are used, which is the limit from
    /// inside.
    fn derivatives(&self, us: &[Place], vs: &[Place], mut sink: impl FnMut(usize, usize, [[f64; 3]; 2])) {
        let size = [self.longest(0), self.longest(1)];
        // Scene files have about five digits, so that the points of a pole of a patch may differ slightly.
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

    /// Returns the longest derivative estimated from the control vertices.
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

    /// Returns the derivatives along u and v at one place of a row.
    fn frame(&self, column: &Column, rows: &[[[f64; 4]; 2]]) -> [[f64; 3]; 2] {
        // The sums are the value, the derivative along u, and the derivative along v.
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

/// The weights along u at one place.
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

/// Returns a place slightly nearer to the middle of its segment.
fn inset(place: &Place) -> Place {
    const STEP: f64 = 1e-3;
    Place { b: place.b + (0.5 - place.b) * STEP, a: place.a + (0.5 - place.a) * STEP, ..*place }
}

fn sub(x: [f64; 3], y: [f64; 3]) -> [f64; 3] {
    [x[0] - y[0], x[1] - y[1], x[2] - y[2]]
}

/// Returns the cross product.
pub(crate) fn cross(x: [f64; 3], y: [f64; 3]) -> [f64; 3] {
    [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]]
}

fn length(x: [f64; 3]) -> f64 {
    (x[0] * x[0] + x[1] * x[1] + x[2] * x[2]).sqrt()
}

/// Returns a box around the convex hull of a range of a part.
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

/// Returns the box padded for the rounding of positions to single precision.
pub(crate) fn rounded_out(bound: Bound) -> Bound {
    if bound.is_empty() {
        return bound;
    }
    let room = bound.min.abs().max(bound.max.abs()) * 2.4e-7;
    Bound { min: bound.min - room, max: bound.max + room }
}

/// Returns a box around the Bezier vertices (`dim` numbers each) of a range of one segment.
pub(crate) fn hull(net: &mut [f64], degrees: [usize; 2], dim: usize, range: [Range; 2], depth: u32) -> Bound {
    let (nu, nv) = (degrees[0] + 1, degrees[1] + 1);
    cut(net, degrees, dim, 0, range[0].ends(), range[0].is_whole());
    cut(net, degrees, dim, 1, range[1].ends(), range[1].is_whole());
    if dim == 3 || net.chunks_exact(4).all(|v| v[3] > 0.0) {
        return Bound::around(net.chunks_exact(dim).map(|v| position(v, dim)));
    }
    // With weights that are not positive the hull does not bound the surface, but parts of the surface may have
    // positive weights.
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
        let Lattice { places: [us, vs], .. } = Lattice::even(&self.range, [nu.max(2), nv.max(2)]);
        out.clear();
        out.extend(self.positions_at(key, [&us, &vs]).map(|p| p.as_vec3()));
    }

    fn hull(&self, key: usize, out: &mut Vec<DVec3>) {
        out.clear();
        match self.vertices(key) {
            Some(vertices) => out.extend(vertices),
            None => out.extend(self.bound(key).corners().map(|p| p.as_dvec3())),
        }
    }

    fn precise_positions(&self, key: usize, nu: usize, nv: usize, out: &mut Vec<DVec3>) {
        let Lattice { places: [us, vs], .. } = Lattice::even(&self.range, [nu.max(2), nv.max(2)]);
        out.clear();
        out.extend(self.positions_at(key, [&us, &vs]));
    }

    fn precise_side_positions(&self, key: usize, part: &SidePart, n: usize, out: &mut Vec<DVec3>) {
        out.clear();
        out.extend(self.positions_along(key, part, n));
    }

    fn precise_between(&self, key: usize, size: [usize; 2], sides: &[SidePoints; 4]) -> Option<Vec<DVec3>> {
        let dim = self.net.dim();
        let key = key.min(self.bounds.len() - 1);
        let lattice = Lattice::between(&self.range, size.map(|n| n.max(2)), &self.settled, sides);
        Some(precise(self.evaluate(&lattice, key * dim..(key + 1) * dim, None), dim).collect())
    }

    fn side(&self, side: usize) -> Option<SidePart> {
        if self.parts.len() > 1 || self.settled.is_settled(side) {
            return None;
        }
        let most = self.net.most_on_side(self.part(), self.is_outer(side).then_some(side));
        Some(SidePart { side, range: self.range[side / 2], most })
    }

    fn settled_steps(&self, side: usize) -> Option<usize> {
        self.settled.steps(side, &self.range)
    }

    fn side_positions(&self, key: usize, part: &SidePart, n: usize, out: &mut Vec<Vec3>) {
        out.clear();
        out.extend(self.positions_along(key, part, n).map(|p| p.as_vec3()));
    }

    fn facets(&self) -> usize {
        let flat = self.net.facet(self.part(), 0).is_some();
        let whole = self.range.iter().all(|r| *r == Range::whole(1));
        if flat && whole { self.parts.len() } else { 0 }
    }

    fn facet(&self, facet: usize, key: usize) -> [Vec3; 4] {
        let part = self.parts.start + facet;
        let known = self.net.facet(part, key.min(self.bounds.len() - 1)).filter(|_| part < self.parts.end);
        known.unwrap_or([Vec3::ZERO; 4])
    }

    fn facet_piece(&self, facet: usize) -> Option<Piece> {
        let part = self.parts.start + facet;
        (facet < self.facets()).then(|| -> Piece {
            Box::new(Self::new(self.net.clone(), part..part + 1, None, Settled::default()))
        })
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
        // Where one parameter can no longer be divided, dividing the other would give equally long parts.
        self.must_split() || self.range.iter().all(|r| r.halves().is_some())
    }

    fn is_group(&self) -> bool {
        self.parts.len() > 1
    }

    fn must_split(&self) -> bool {
        self.is_group() || (!self.net.dices_over() && self.range.iter().any(|r| r.count() > 1))
    }

    fn split(&self, direction: SplitDirection) -> Vec<Piece> {
        self.split_settled(direction, [None; 4])
    }

    fn split_settled(&self, direction: SplitDirection, steps: [Option<u32>; 4]) -> Vec<Piece> {
        let piece =
            |parts, range, settled| -> Piece { Box::new(Self::new(self.net.clone(), parts, range, settled)) };
        if self.parts.len() > 1 {
            let middle = self.parts.start + self.parts.len() / 2;
            // The piece is divided between blocks if there are several.
            let between = middle.next_multiple_of(BLOCK);
            let middle = if between < self.parts.end { between } else { middle };
            return [self.parts.start..middle, middle..self.parts.end]
                .map(|parts| piece(parts, None, Settled::default()))
                .into();
        }
        let mut axis = usize::from(direction == SplitDirection::V);
        let other = 1 - axis;
        // Segments are separated first.
        if self.must_split() && self.range[axis].count() == 1 && self.range[other].count() > 1 {
            axis = other;
        }
        if self.range[axis].halves().is_none() {
            axis = 1 - axis;
        }
        let Some((left, right)) = self.range[axis].halves() else { return Vec::new() };
        let with = |half, settled| {
            let mut range = self.range;
            range[axis] = half;
            piece(self.parts.clone(), Some(range), settled)
        };
        let [of_left, of_right] = self.settled.halves(&self.range, axis, steps);
        vec![with(left, of_left), with(right, of_right)]
    }

    fn dice(&self, nu: usize, nv: usize) -> Dice {
        self.dice_between(nu, nv, &Default::default())
    }

    fn dice_between(&self, nu: usize, nv: usize, sides: &[SidePoints; 4]) -> Dice {
        let (nu, nv) = (nu.max(2), nv.max(2));
        let (net, part, n) = (&**self.net, self.part(), nu * nv);
        let (dim, channels, keys) = (net.dim(), net.channels(), net.times().len());
        let lattice = Lattice::between(&self.range, [nu, nv], &self.settled, sides);
        let (mut dpdu, mut dpdv) = (vec![Vec3::ZERO; n], vec![Vec3::ZERO; n]);
        let values = self.evaluate(&lattice, 0..channels, Some((&mut dpdu, &mut dpdv)));
        self.close_seams(&lattice, &mut dpdu, &mut dpdv);
        let p = (0..keys)
            .map(|key| values.chunks_exact(channels).map(|v| position(&v[key * dim..], 3)).collect())
            .collect();
        let along = |axis: usize| lattice.along(axis, |p| net.parameter(part, axis, *p).0);
        let (us, vs) = (along(0), along(1));
        let u = us.iter().map(|u| *u as f32).collect();
        let v = vs.iter().map(|v| *v as f32).collect();
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
        let mask = net.trim().map(|trim| {
            let [u, v] = [0, 1].map(|axis| -> Vec<f64> {
                lattice.places[axis].iter().map(|p| net.parameter(part, axis, *p).0).collect()
            });
            let mut mask = trim.mask(&u, &v);
            if !lattice.is_even() {
                trim.correct(&mut mask, &us, &vs, nu);
            }
            mask
        });
        let normals = take_normals(n, &mut primvars);
        let (places, face) = (lattice.in_steps(), net.face(part));
        Dice { nu, nv, p, n: normals, dpdu, dpdv, u, v, places, primvars, face, mask, facing: None }
    }
}
