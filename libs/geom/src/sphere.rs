//! Spheres (reference 2.8.4).

use crate::GeomError;
use crate::build::ShapeKey;
use crate::dice::Dice;
use crate::net::rounded_out;
use crate::range::{Place, Range};
use crate::side::{Lattice, Settled, SidePart, SidePoints};
use crate::surface::{Piece, SplitDirection, Surface};
use crate::vars::{Counts, Report, Vars, take_normals};
use granita_base::{Bound, DVec3, Severity, Vec3};
use std::sync::Arc;

const CALL: &str = "Sphere";

/// Largest radius: squares of larger ones are no numbers any more.
const LARGEST: f32 = 1e18;

struct Sphere {
    radius: f64,
    /// Latitudes in degrees at v = 0 and v = 1.
    phi_deg: [f64; 2],
    /// Sweep in degrees.
    theta_deg: f64,
    time: [f32; 1],
    vars: Vars,
}

struct SpherePiece {
    sphere: Arc<Sphere>,
    range: [Range; 2],
    settled: Settled,
    bound: Bound,
}

/// Builds a sphere; nothing (with a warning) when it has no area. It does not deform.
pub(crate) fn build(
    keys: &[ShapeKey<'_>],
    [radius, zmin, zmax, theta_deg]: [f32; 4],
    report: Report<'_>,
) -> Result<Vec<Piece>, GeomError> {
    if ![radius, zmin, zmax, theta_deg].iter().all(|x| x.is_finite()) {
        let what = format!("arguments {radius}, {zmin}, {zmax}, {theta_deg} are not all finite");
        return Err(GeomError::Malformed { call: CALL, what });
    }
    if radius.abs() > LARGEST {
        let what = format!("radius {radius:?} is larger than {LARGEST:?}");
        return Err(GeomError::Malformed { call: CALL, what });
    }
    let (radius, size) = (f64::from(radius), f64::from(radius.abs()));
    let latitude = |z: f64| (z / radius).clamp(-1.0, 1.0).asin().to_degrees();
    let (zmin, zmax) = (f64::from(zmin), f64::from(zmax));
    let lower = if zmin > -size { latitude(zmin) } else { -90.0 };
    let upper = if zmax < size { latitude(zmax) } else { 90.0 };
    if radius == 0.0 || theta_deg == 0.0 || lower == upper {
        report(Severity::Warning, format!("{CALL}: a sphere without area is not drawn"));
        return Ok(Vec::new());
    }
    let counts = Counts { vertex: None, linear: Some(4), perpiece: None };
    let vars = Vars::collect(CALL, keys[0].params, counts, report);
    let sphere = Sphere {
        radius,
        phi_deg: [lower, upper],
        theta_deg: f64::from(theta_deg),
        time: [keys[0].time],
        vars,
    };
    let whole = [Range::whole(1), Range::whole(1)];
    Ok(vec![Box::new(SpherePiece::new(Arc::new(sphere), whole, Settled::default()))])
}

/// Sine and cosine of an angle in degrees, exact at multiples of 90: so seams close and poles are points.
fn sin_cos_deg(x: f64) -> (f64, f64) {
    let quarter = (x / 90.0).round();
    let (s, c) = (x - quarter * 90.0).to_radians().sin_cos();
    match (quarter as i64).rem_euclid(4) {
        0 => (s, c),
        1 => (c, -s),
        2 => (-s, -c),
        _ => (-c, s),
    }
}

/// Smallest and largest cosine over a range of degrees.
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

impl SpherePiece {
    fn new(sphere: Arc<Sphere>, range: [Range; 2], settled: Settled) -> Self {
        let mut piece = Self { sphere, range, settled, bound: Bound::EMPTY };
        piece.bound = piece.find_bound();
        for [u, v] in piece.settled.outside(&piece.range) {
            let p = piece.point(piece.angle(0, &u), piece.angle(1, &v));
            piece.bound = piece.bound.union(rounded_out(Bound::around([p])));
        }
        piece
    }

    fn find_bound(&self) -> Bound {
        let [x, y, z] = self.extents();
        rounded_out(Bound {
            min: Vec3::new(x.0 as f32, y.0 as f32, z.0 as f32),
            max: Vec3::new(x.1 as f32, y.1 as f32, z.1 as f32),
        })
    }

    /// Smallest and largest x, y and z.
    fn extents(&self) -> [(f64, f64); 3] {
        let s = &*self.sphere;
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

    /// Sine and cosine of an angle.
    fn angle(&self, axis: usize, place: &Place) -> (f64, f64) {
        let s = &*self.sphere;
        let [from, to] = if axis == 0 { [0.0, s.theta_deg] } else { s.phi_deg };
        sin_cos_deg(place.a * from + place.b * to)
    }

    /// The point at two angles.
    fn point(&self, u: (f64, f64), v: (f64, f64)) -> Vec3 {
        self.precise_point(u, v).as_vec3()
    }

    fn precise_point(&self, (st, ct): (f64, f64), (sp, cp): (f64, f64)) -> DVec3 {
        let r = self.sphere.radius;
        DVec3::new(r * ct * cp, r * st * cp, r * sp)
    }

    /// The points of a lattice.
    fn points(&self, lattice: &Lattice) -> impl Iterator<Item = DVec3> + '_ {
        let [us, vs] = [0, 1].map(|axis| lattice.along(axis, |p| self.angle(axis, p)));
        us.into_iter().zip(vs).map(|(u, v)| self.precise_point(u, v))
    }

    /// Points spread evenly over a part of a side.
    fn along_side(&self, part: &SidePart, n: usize) -> impl Iterator<Item = DVec3> + '_ {
        let (axis, range) = (part.side / 2, part.range);
        let across = self.angle(1 - axis, &self.range[1 - axis].place(part.side % 2, 2));
        let along = (0..n).map(move |i| self.angle(axis, &range.place(i, n)));
        along.map(
            move |x| {
                if axis == 0 { self.precise_point(x, across) } else { self.precise_point(across, x) }
            },
        )
    }
}

impl Surface for SpherePiece {
    fn key_times(&self) -> &[f32] {
        &self.sphere.time
    }

    fn bound(&self, _key: usize) -> Bound {
        self.bound
    }

    fn positions(&self, _key: usize, nu: usize, nv: usize, out: &mut Vec<Vec3>) {
        out.clear();
        let lattice = Lattice::even(&self.range, [nu.max(2), nv.max(2)]);
        out.extend(self.points(&lattice).map(|p| p.as_vec3()));
    }

    fn hull(&self, _key: usize, out: &mut Vec<DVec3>) {
        let extents = self.extents();
        let corner = |i: usize| -> [f64; 3] {
            std::array::from_fn(|x| if i >> x & 1 == 0 { extents[x].0 } else { extents[x].1 })
        };
        out.clear();
        out.extend((0..8).map(|i| DVec3::from(corner(i))));
        let outside = self.settled.outside(&self.range);
        out.extend(outside.iter().map(|[u, v]| self.precise_point(self.angle(0, u), self.angle(1, v))));
    }

    fn precise_positions(&self, _key: usize, nu: usize, nv: usize, out: &mut Vec<DVec3>) {
        out.clear();
        out.extend(self.points(&Lattice::even(&self.range, [nu.max(2), nv.max(2)])));
    }

    fn precise_side_positions(&self, _key: usize, part: &SidePart, n: usize, out: &mut Vec<DVec3>) {
        out.clear();
        out.extend(self.along_side(part, n));
    }

    fn precise_between(
        &self,
        _key: usize,
        nu: usize,
        nv: usize,
        sides: &[SidePoints; 4],
    ) -> Option<Vec<DVec3>> {
        let size = [nu.max(2), nv.max(2)];
        Some(self.points(&Lattice::between(&self.range, size, &self.settled, sides)).collect())
    }

    fn side(&self, side: usize) -> Option<SidePart> {
        let range = self.range[side / 2];
        (!self.settled.is_settled(side)).then_some(SidePart { side, range, most: u32::MAX })
    }

    fn settled_steps(&self, side: usize) -> Option<usize> {
        self.settled.steps(side, &self.range)
    }

    fn side_positions(&self, _key: usize, part: &SidePart, n: usize, out: &mut Vec<Vec3>) {
        out.clear();
        out.extend(self.along_side(part, n).map(|p| p.as_vec3()));
    }

    fn domain(&self) -> [f32; 4] {
        let (u, v) = (self.range[0].ends(), self.range[1].ends());
        [u.0 as f32, u.1 as f32, v.0 as f32, v.1 as f32]
    }

    fn is_splittable(&self) -> bool {
        // Where one parameter no longer divides, parts along the other would be as long.
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
        let s = &*self.sphere;
        let (along_u, along_v) =
            (s.radius * s.theta_deg.to_radians(), s.radius * (s.phi_deg[1] - s.phi_deg[0]).to_radians());
        let [us, vs] = [0, 1].map(|axis| lattice.along(axis, |p| (p.b, self.angle(axis, p))));
        let (mut p, mut dpdu, mut dpdv) =
            (Vec::with_capacity(n), Vec::with_capacity(n), Vec::with_capacity(n));
        for (&(_, u), &(_, v)) in us.iter().zip(&vs) {
            let ((st, ct), (sp, cp)) = (u, v);
            // At the pole dP/du vanishes; a short one keeps the direction it has beside it.
            let around = if cp < 1e-6 { 1e-3 } else { cp };
            let du = [-st * around * along_u, ct * around * along_u, 0.0];
            let dv = [-ct * sp * along_v, -st * sp * along_v, cp * along_v];
            p.push(self.point(u, v));
            dpdu.push(Vec3::from(du.map(|x| x as f32)));
            dpdv.push(Vec3::from(dv.map(|x| x as f32)));
        }
        let mut primvars = s.vars.uniform(0);
        if !s.vars.linear.is_empty() {
            let mut corners = Vec::new();
            (0..4).for_each(|corner| s.vars.push_linear(corner, &mut corners));
            let [s_of, t_of] = [&us, &vs].map(|list| list.iter().map(|x| x.0).collect::<Vec<_>>());
            s.vars.emit_linear(&corners, &s_of, &t_of, &mut primvars);
        }
        let u = us.iter().map(|x| x.0 as f32).collect();
        let v = vs.iter().map(|x| x.0 as f32).collect();
        let normals = take_normals(n, &mut primvars);
        let places = lattice.in_steps();
        Dice { nu, nv, p: vec![p], n: normals, dpdu, dpdv, u, v, places, primvars, ..Dice::default() }
    }
}
