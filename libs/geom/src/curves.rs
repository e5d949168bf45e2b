//! Curves (reference 2.8.3), which are ribbons along splines, with u across and v along.
//!
//! With "N" a ribbon is perpendicular to N. Without it the ribbon faces the viewer; see [`crate::Dice::facing`].

use crate::GeomError;
use crate::curve::{Curves, Evaluator, Points};
use crate::dice::{Dice, Facing, View, on_ribbon, ribbon_side};
use crate::key::ShapeKey;
use crate::net::rounded_out;
use crate::order::spatial_order;
use crate::range::{Place, Range};
use crate::side::SidePoints;
use crate::spline::Spline;
use crate::surface::{Piece, SplitDirection, Surface};
use crate::vars::{Counts, Report, Vars, control, emit, position, take_normals, vertex_count};
use crate::width::{WidthCounts, Widths};
use granita_base::{Bound, Severity, Vec3};
use std::sync::Arc;

const CALL: &str = "Curves";

/// The largest number of segments that are diced together.
const MOST_SEGMENTS: u32 = 8;

/// The angle in radians between segments from which on they form a crease.
const CREASE: f32 = 0.01;

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
    let mut all = Curves { times, spline, nverts, control, vars, widths, order, bounds: Vec::new() };
    let (whole, mut net) = (Range::whole(all.spline.count()), Vec::new());
    let mut bounds_at =
        |key| all.order.iter().map(|&curve| all.bound(curve as usize, whole, key, &mut net)).collect();
    all.bounds = (0..keys.len()).map(&mut bounds_at).collect();
    Ok(vec![Box::new(CurvePiece::new(Arc::new(all), curves, None))])
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
        let mut bound = Bound::EMPTY;
        match all.bounds.get(key) {
            Some(bounds) if self.range == [Range::whole(1), Range::whole(all.spline.count())] => {
                bound = bounds[self.curves.clone()].iter().copied().fold(bound, Bound::union);
            }
            _ => {
                let mut net = Vec::new();
                for &curve in &all.order[self.curves.clone()] {
                    bound = bound.union(all.bound(curve as usize, self.range[1], key, &mut net));
                }
            }
        }
        rounded_out(bound)
    }

    /// Returns the evaluated values at `n` places along the piece.
    fn points(&self, n: usize, evaluator: Evaluator<'_>) -> Points {
        evaluator.points((0..n).map(|j| self.range[1].place(j, n)))
    }

    /// Replaces `out` by the positions of a ribbon that faces the viewer; see [`Surface::positions_towards`].
    fn ribbon(
        &self,
        key: usize,
        [nu, nv]: [usize; 2],
        view: &dyn Fn(usize, Vec3) -> View,
        out: &mut Vec<Vec3>,
    ) {
        let (nv, key, dim) = (nv.max(2), key.min(self.bounds.len() - 1), self.all.control.dim);
        let points = self.points(nv, Evaluator::new(&self.all, self.curve(), key..key + 1));
        let place = |i: usize| (2.0 * self.range[0].place(i, 2).b - 1.0) as f32;
        let ends = [0, 1].map(place);
        let mut borders = Vec::with_capacity(2 * nv);
        for (j, values) in points.values.chunks_exact(self.all.stride()).enumerate() {
            let centre = position(&values[key * dim..], 3);
            let side = ribbon_side(points.tangents[j], view(key, centre).direction());
            borders.extend(ends.map(|x| on_ribbon(centre, side, x, points.widths[j])));
        }
        spread_across(&borders, nu, out);
    }

    /// Dices the piece. Unless it has normals, it has no positions yet; see [`Dice::turn`].
    fn unturned(&self, nu: usize, nv: usize) -> Dice {
        let (nu, nv) = (nu.max(2), nv.max(2));
        let (all, curve, n) = (&*self.all, self.curve(), nu * nv);
        let (dim, keys, stride) = (all.control.dim, all.times.len(), all.stride());
        let points = self.points(nv, Evaluator::new(all, curve, 0..keys).with_variables());
        let across: Vec<f64> = (0..nu).map(|i| self.range[0].place(i, nu).b).collect();
        let mut dice = Dice { nu, nv, face: curve as u32, ..Dice::default() };
        dice.u = across.iter().map(|u| *u as f32).collect::<Vec<f32>>().repeat(nv);
        dice.v = spread(nu, points.v.iter().map(|v| *v as f32));
        dice.primvars = all.vars.uniform(curve);
        if !all.vars.vertex.is_empty() {
            let rows = points.values.chunks_exact(stride);
            let values: Vec<f64> =
                rows.flat_map(|row| std::iter::repeat_n(row, nu)).flatten().copied().collect();
            emit(&all.vars.vertex, &values, n, stride, keys * dim, &mut dice.primvars);
        }
        if !all.vars.linear.is_empty() {
            let mut corners = Vec::new();
            for end in [0, 0, 1, 1] {
                all.vars.push_linear(curve * 2 + end, &mut corners);
            }
            let (v0, v1) = all.spline.extent();
            let s = across.repeat(nv);
            let t = spread(nu, points.v.iter().map(|v| (v - v0) / (v1 - v0)));
            all.vars.emit_linear(&corners, &s, &t, &mut dice.primvars);
        }
        dice.n = take_normals(n, &mut dice.primvars);
        let offset: Vec<[f32; 2]> = across.iter().map(|u| [(2.0 * u - 1.0) as f32, 0.0]).collect();
        let centre = |key: usize| move |values: &[f64]| position(&values[key * dim..], 3);
        let facing = Facing {
            centre: (0..keys)
                .map(|k| spread(nu, points.values.chunks_exact(stride).map(centre(k))))
                .collect(),
            tangent: (0..keys)
                .map(|k| spread(nu, points.tangents.iter().skip(k).step_by(keys).copied()))
                .collect(),
            width: (0..keys)
                .map(|k| spread(nu, points.widths.iter().skip(k).step_by(keys).copied()))
                .collect(),
            raster: false,
            offset: offset.repeat(nv),
        };
        dice.facing = Some(facing);
        if let Some(normals) = dice.n.clone() {
            // The normals replace the viewer permanently.
            dice.turn_by(&|_, i, _| View { toward: normals[i], pixel: 1.0 });
            dice.facing = None;
        }
        dice
    }
}

/// Returns a list in which each value of another list comes `nu` times.
fn spread<T: Copy>(nu: usize, values: impl ExactSizeIterator<Item = T>) -> Vec<T> {
    let mut out = Vec::with_capacity(values.len() * nu);
    for value in values {
        out.resize(out.len() + nu, value);
    }
    out
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
        self.positions_towards(key, nu, nv, &|_, _| View::ALONG_Z, out);
    }

    fn positions_towards(
        &self,
        key: usize,
        nu: usize,
        nv: usize,
        view: &dyn Fn(usize, Vec3) -> View,
        out: &mut Vec<Vec3>,
    ) {
        if self.is_facing() {
            self.ribbon(key, [nu, nv], view, out);
        } else {
            let dice = self.dice(2, nv);
            spread_across(&dice.p[key.min(self.bounds.len() - 1)], nu, out);
        }
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
        let mut dice = self.unturned(nu, nv);
        dice.turn(&|_, _| View::ALONG_Z);
        dice
    }

    fn dice_towards(
        &self,
        nu: usize,
        nv: usize,
        _: &[SidePoints; 4],
        view: &dyn Fn(usize, Vec3) -> View,
    ) -> Dice {
        let mut dice = self.unturned(nu, nv);
        dice.turn(view);
        dice
    }

    fn is_facing(&self) -> bool {
        !self.all.vars.has_normals()
    }

    fn is_curve(&self) -> bool {
        true
    }

    fn has_crease(&self) -> bool {
        let keys = 0..self.all.times.len();
        let mut evaluator = Evaluator::new(&self.all, self.curve(), keys);
        let mut tangents = |place| {
            let mut out = Points::default();
            evaluator.raw(place, &mut out);
            out.tangents
        };
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
