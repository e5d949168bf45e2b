//! Spheres (reference 2.8.4).

use crate::GeomError;
use crate::dice::Dice;
use crate::key::ShapeKey;
use crate::moving;
use crate::net::rounded_out;
use crate::range::{Place, Range};
use crate::side::{Lattice, Settled, SidePart, SidePoints};
use crate::surface::{Piece, SplitDirection, Surface};
use crate::vars::{Counts, Report, Vars, take_normals};
use granita_base::{Bound, DVec3, Severity, Vec3};
use std::sync::Arc;

const CALL: &str = "Sphere";

/// The largest radius. The squares of larger radii overflow.
const LARGEST: f32 = 1e18;

/// The largest angle in degrees by which the points of a sphere with changing arguments may turn from one motion key
/// to the next. Points move along chords of their arcs.
const MOST_TURN_DEG: f64 = 3.0;

struct Sphere {
    keys: Vec<SphereKey>,
    times: Vec<f32>,
    vars: Vars,
}

/// A sphere at one motion key.
#[derive(Clone, Copy, Debug, PartialEq)]
struct SphereKey {
    radius: f64,
    /// The latitudes in degrees at v = 0 and v = 1.
    phi_deg: [f64; 2],
    /// The sweep angle in degrees.
    theta_deg: f64,
}

impl SphereKey {
    /// Returns the sphere of a radius, a lower and upper cut, and a sweep angle.
    fn new([radius, zmin, zmax, theta_deg]: [f64; 4]) -> Self {
        let size = radius.abs();
        let latitude = |z: f64| libm::asin((z / radius).clamp(-1.0, 1.0)).to_degrees();
        let lower = if zmin > -size { latitude(zmin) } else { -90.0 };
        let upper = if zmax < size { latitude(zmax) } else { 90.0 };
        Self { radius, phi_deg: [lower, upper], theta_deg }
    }

    fn has_area(&self) -> bool {
        self.radius != 0.0 && self.theta_deg != 0.0 && self.phi_deg[0] != self.phi_deg[1]
    }

    /// Returns the angle in degrees that a point turns on its way to another key.
    fn turn_deg(&self, other: &Self) -> f64 {
        let [a, b] = [0, 1].map(|k| (self.phi_deg[k] - other.phi_deg[k]).abs());
        a.max(b).max((self.theta_deg - other.theta_deg).abs())
    }
}

struct SpherePiece {
    sphere: Arc<Sphere>,
    range: [Range; 2],
    settled: Settled,
    /// The bounds at each motion key.
    bounds: Vec<Bound>,
}

/// Builds a sphere, or nothing (with a warning) when it has no area. The arguments at other motion keys are in the
/// parameter "__arguments". Between keys they change linearly.
pub(crate) fn build(
    keys: &[ShapeKey<'_>],
    given: [f32; 4],
    report: Report<'_>,
) -> Result<Vec<Piece>, GeomError> {
    let arguments: Vec<[f32; 4]> = keys.iter().map(|key| moving::arguments(key).unwrap_or(given)).collect();
    for [radius, zmin, zmax, theta_deg] in &arguments {
        if ![radius, zmin, zmax, theta_deg].iter().all(|x| x.is_finite()) {
            let what = format!("arguments {radius}, {zmin}, {zmax}, {theta_deg} are not all finite");
            return Err(GeomError::Malformed { call: CALL, what });
        }
        if radius.abs() > LARGEST {
            let what = format!("radius {radius:?} is larger than {LARGEST:?}");
            return Err(GeomError::Malformed { call: CALL, what });
        }
    }
    let (times, spheres) = over_time(keys, &arguments);
    if !spheres.iter().any(SphereKey::has_area) {
        report(Severity::Warning, format!("{CALL}: a sphere without area is not drawn"));
        return Ok(Vec::new());
    }
    let counts = Counts { vertex: None, linear: Some(4), perpiece: None };
    let vars = Vars::collect(CALL, keys[0].params, counts, report);
    let sphere = Sphere { keys: spheres, times, vars };
    let whole = [Range::whole(1), Range::whole(1)];
    Ok(vec![Box::new(SpherePiece::new(Arc::new(sphere), whole, Settled::default()))])
}

/// Returns the motion keys, with as many keys between them as are needed to keep points near their arcs.
fn over_time(keys: &[ShapeKey<'_>], arguments: &[[f32; 4]]) -> (Vec<f32>, Vec<SphereKey>) {
    let arguments: Vec<[f64; 4]> = arguments.iter().map(|list| list.map(f64::from)).collect();
    let mut times = vec![keys[0].time];
    let mut spheres = vec![SphereKey::new(arguments[0])];
    for (pair, ends) in keys.windows(2).zip(arguments.windows(2)) {
        let turn = SphereKey::new(ends[0]).turn_deg(&SphereKey::new(ends[1]));
        let steps = (turn / MOST_TURN_DEG).ceil().clamp(1.0, 256.0) as u32;
        for step in 1..=steps {
            let alpha = f64::from(step) / f64::from(steps);
            let at = |k: usize| ends[0][k] * (1.0 - alpha) + ends[1][k] * alpha;
            let time = match step == steps {
                true => pair[1].time,
                false => pair[0].time + (pair[1].time - pair[0].time) * alpha as f32,
            };
            if times.last().is_none_or(|last| time > *last) {
                times.push(time);
                spheres.push(SphereKey::new(std::array::from_fn(at)));
            }
        }
    }
    (times, spheres)
}

/// Returns the sine and cosine of an angle in degrees. They are exact at multiples of 90, so that the sphere closes
/// and its poles are points.
fn sin_cos_deg(x: f64) -> (f64, f64) {
    let quarter = (x / 90.0).round();
    let (s, c) = libm::sincos((x - quarter * 90.0).to_radians());
    match (quarter as i64).rem_euclid(4) {
        0 => (s, c),
        1 => (c, -s),
        2 => (-s, -c),
        _ => (-c, s),
    }
}

/// Returns the smallest and largest cosine over a range of degrees.
fn cos_range(a: f64, b: f64) -> (f64, f64) {
    let (lo, hi) = (a.min(b), a.max(b));
    if hi - lo >= 360.0 {
        return (-1.0, 1.0);
    }
    let (c0, c1) = (sin_cos_deg(lo).1, sin_cos_deg(hi).1);
    let holds = |x: f64| ((lo - x) / 360.0).ceil() * 360.0 + x <= hi;
    let least = if holds(180.0) { -1.0 } else { c0.min(c1) };
    let most = if holds(0.0) { 1.0 } else { c0.max(c1) };
    (least, most)
}

fn product((a, b): (f64, f64), (c, d): (f64, f64)) -> (f64, f64) {
    let all = [a * c, a * d, b * c, b * d];
    all.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), &x| (lo.min(x), hi.max(x)))
}

impl SphereKey {
    /// Returns the sine and cosine of the angle at a place.
    fn angle(&self, axis: usize, place: &Place) -> (f64, f64) {
        let [from, to] = if axis == 0 { [0.0, self.theta_deg] } else { self.phi_deg };
        sin_cos_deg(place.a * from + place.b * to)
    }
}

/// Returns the point of a sphere at the sines and cosines of two angles.
fn point(s: &SphereKey, (st, ct): (f64, f64), (sp, cp): (f64, f64)) -> DVec3 {
    let r = s.radius;
    DVec3::new(r * ct * cp, r * st * cp, r * sp)
}

impl SpherePiece {
    fn new(sphere: Arc<Sphere>, range: [Range; 2], settled: Settled) -> Self {
        let mut piece = Self { sphere, range, settled, bounds: Vec::new() };
        let outside: Vec<_> = piece.settled.outside(&piece.range).into_iter().collect();
        for (k, key) in piece.sphere.keys.iter().enumerate() {
            let mut bound = match k.checked_sub(1).filter(|before| piece.sphere.keys[*before] == *key) {
                Some(before) => piece.bounds[before],
                None => piece.find_bound(key),
            };
            for [u, v] in &outside {
                let p = point(key, key.angle(0, u), key.angle(1, v)).as_vec3();
                bound = bound.union(rounded_out(Bound::around([p])));
            }
            piece.bounds.push(bound);
        }
        piece
    }

    fn key(&self, key: usize) -> &SphereKey {
        let keys = &self.sphere.keys;
        &keys[key.min(keys.len() - 1)]
    }

    fn find_bound(&self, key: &SphereKey) -> Bound {
        let [x, y, z] = self.extents(key);
        rounded_out(Bound {
            min: Vec3::new(x.0 as f32, y.0 as f32, z.0 as f32),
            max: Vec3::new(x.1 as f32, y.1 as f32, z.1 as f32),
        })
    }

    /// Returns the smallest and largest x, y and z.
    fn extents(&self, s: &SphereKey) -> [(f64, f64); 3] {
        let (u, v) = (self.range[0].ends(), self.range[1].ends());
        let theta = (u.0 * s.theta_deg, u.1 * s.theta_deg);
        let [p0, p1] = s.phi_deg;
        let phi = [v.0, v.1].map(|b| p0 * (1.0 - b) + p1 * b);
        let r = (s.radius, s.radius);
        let around = product(r, cos_range(phi[0], phi[1]));
        let x = product(around, cos_range(theta.0, theta.1));
        let y = product(around, cos_range(theta.0 - 90.0, theta.1 - 90.0));
        let z = product(r, cos_range(phi[0] - 90.0, phi[1] - 90.0));
        [x, y, z]
    }

    /// Returns the points of a lattice.
    fn points(&self, key: usize, lattice: &Lattice) -> impl Iterator<Item = DVec3> + '_ {
        let s = self.key(key);
        let [us, vs] = [0, 1].map(|axis| lattice.along(axis, |p| s.angle(axis, p)));
        us.into_iter().zip(vs).map(|(u, v)| point(s, u, v))
    }

    /// Returns points spread evenly over a part of a side.
    fn along_side(&self, key: usize, part: &SidePart, n: usize) -> impl Iterator<Item = DVec3> + '_ {
        let s = self.key(key);
        let (axis, range) = (part.side / 2, part.range);
        let across = s.angle(1 - axis, &self.range[1 - axis].place(part.side % 2, 2));
        let along = (0..n).map(move |i| s.angle(axis, &range.place(i, n)));
        along.map(move |x| if axis == 0 { point(s, x, across) } else { point(s, across, x) })
    }
}

impl Surface for SpherePiece {
    fn key_times(&self) -> &[f32] {
        &self.sphere.times
    }

    fn measured_key(&self) -> Option<usize> {
        let keys = &self.sphere.keys;
        let size =
            |key: &SphereKey| key.radius.powi(2) * key.theta_deg.abs() * (key.phi_deg[1] - key.phi_deg[0]);
        let larger = |a: &usize, b: &usize| size(&keys[*a]).total_cmp(&size(&keys[*b]));
        keys.iter().any(|key| *key != keys[0]).then(|| (0..keys.len()).max_by(larger).unwrap_or(0))
    }

    fn bound(&self, key: usize) -> Bound {
        self.bounds[key.min(self.bounds.len() - 1)]
    }

    fn positions(&self, key: usize, nu: usize, nv: usize, out: &mut Vec<Vec3>) {
        out.clear();
        let lattice = Lattice::even(&self.range, [nu.max(2), nv.max(2)]);
        out.extend(self.points(key, &lattice).map(|p| p.as_vec3()));
    }

    fn hull(&self, key: usize, out: &mut Vec<DVec3>) {
        let s = self.key(key);
        let extents = self.extents(s);
        let corner = |i: usize| -> [f64; 3] {
            std::array::from_fn(|x| if i >> x & 1 == 0 { extents[x].0 } else { extents[x].1 })
        };
        out.clear();
        out.extend((0..8).map(|i| DVec3::from(corner(i))));
        let outside = self.settled.outside(&self.range);
        out.extend(outside.iter().map(|[u, v]| point(s, s.angle(0, u), s.angle(1, v))));
    }

    fn precise_positions(&self, key: usize, nu: usize, nv: usize, out: &mut Vec<DVec3>) {
        out.clear();
        out.extend(self.points(key, &Lattice::even(&self.range, [nu.max(2), nv.max(2)])));
    }

    fn precise_side_positions(&self, key: usize, part: &SidePart, n: usize, out: &mut Vec<DVec3>) {
        out.clear();
        out.extend(self.along_side(key, part, n));
    }

    fn precise_between(&self, key: usize, size: [usize; 2], sides: &[SidePoints; 4]) -> Option<Vec<DVec3>> {
        let size = size.map(|n| n.max(2));
        Some(self.points(key, &Lattice::between(&self.range, size, &self.settled, sides)).collect())
    }

    fn side(&self, side: usize) -> Option<SidePart> {
        let range = self.range[side / 2];
        (!self.settled.is_settled(side)).then_some(SidePart { side, range, most: u32::MAX })
    }

    fn settled_steps(&self, side: usize) -> Option<usize> {
        self.settled.steps(side, &self.range)
    }

    fn side_positions(&self, key: usize, part: &SidePart, n: usize, out: &mut Vec<Vec3>) {
        out.clear();
        out.extend(self.along_side(key, part, n).map(|p| p.as_vec3()));
    }

    fn domain(&self) -> [f32; 4] {
        let (u, v) = (self.range[0].ends(), self.range[1].ends());
        [u.0 as f32, u.1 as f32, v.0 as f32, v.1 as f32]
    }

    fn is_splittable(&self) -> bool {
        // Where one parameter can no longer be divided, dividing the other would give equally long parts.
        self.range.iter().all(|r| r.halves().is_some())
    }

    fn split(&self, direction: SplitDirection) -> Vec<Piece> {
        self.split_settled(direction, [None; 4])
    }

    fn split_settled(&self, direction: SplitDirection, steps: [Option<u32>; 4]) -> Vec<Piece> {
        let mut axis = usize::from(direction == SplitDirection::V);
        if self.range[axis].halves().is_none() {
            axis = 1 - axis;
        }
        let Some((left, right)) = self.range[axis].halves() else { return Vec::new() };
        let with = |half, settled| -> Piece {
            let mut range = self.range;
            range[axis] = half;
            Box::new(Self::new(self.sphere.clone(), range, settled))
        };
        let [of_left, of_right] = self.settled.halves(&self.range, axis, steps);
        vec![with(left, of_left), with(right, of_right)]
    }

    fn dice(&self, nu: usize, nv: usize) -> Dice {
        self.dice_between(nu, nv, &Default::default())
    }

    fn dice_between(&self, nu: usize, nv: usize, sides: &[SidePoints; 4]) -> Dice {
        let (nu, nv) = (nu.max(2), nv.max(2));
        let n = nu * nv;
        let lattice = Lattice::between(&self.range, [nu, nv], &self.settled, sides);
        let s = &self.sphere.keys[0];
        let [us, vs] = [0, 1].map(|axis| lattice.along(axis, |p| (p.b, s.angle(axis, p))));
        let (du, dv) = derivatives(s, &us, &vs);
        let first: Vec<Vec3> = us.iter().zip(&vs).map(|(u, v)| point(s, u.1, v.1).as_vec3()).collect();
        debug_assert_eq!(first.len(), n);
        let mut p = vec![first];
        for key in 1..self.sphere.keys.len() {
            let same = self.sphere.keys[key] == self.sphere.keys[key - 1];
            p.push(match same {
                true => p[key - 1].clone(),
                false => self.points(key, &lattice).map(|p| p.as_vec3()).collect(),
            });
        }
        let vars = &self.sphere.vars;
        let mut primvars = vars.uniform(0);
        if !vars.linear.is_empty() {
            let mut corners = Vec::new();
            (0..4).for_each(|corner| vars.push_linear(corner, &mut corners));
            let [s_of, t_of] = [&us, &vs].map(|list| list.iter().map(|x| x.0).collect::<Vec<_>>());
            vars.emit_linear(&corners, &s_of, &t_of, &mut primvars);
        }
        let u = us.iter().map(|x| x.0 as f32).collect();
        let v = vs.iter().map(|x| x.0 as f32).collect();
        let normals = take_normals(n, &mut primvars);
        let places = lattice.in_steps();
        Dice { nu, nv, p, n: normals, dpdu: du, dpdv: dv, u, v, places, primvars, ..Dice::default() }
    }
}

/// Returns dP/du and dP/dv of a sphere at points along u and along v, each with the sine and cosine of its angle.
///
/// Where a derivative vanishes, at a pole or at a motion key without area, a short vector with the direction of
/// neighbouring points is returned.
fn derivatives(s: &SphereKey, us: &[(f64, (f64, f64))], vs: &[(f64, (f64, f64))]) -> (Vec<Vec3>, Vec<Vec3>) {
    let turn = |deg: f64| if deg == 0.0 { 1e-3 } else { deg.to_radians() };
    let radius = if s.radius == 0.0 { 1e-3 } else { s.radius };
    let (along_u, along_v) = (radius * turn(s.theta_deg), radius * turn(s.phi_deg[1] - s.phi_deg[0]));
    us.iter()
        .zip(vs)
        .map(|(&(_, (st, ct)), &(_, (sp, cp)))| {
            let around = if cp < 1e-6 { 1e-3 } else { cp };
            let du = [-st * around * along_u, ct * around * along_u, 0.0];
            let dv = [-ct * sp * along_v, -st * sp * along_v, cp * along_v];
            (Vec3::from(du.map(|x| x as f32)), Vec3::from(dv.map(|x| x as f32)))
        })
        .unzip()
}
