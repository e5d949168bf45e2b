//! Spheres (reference 2.8.4).

use crate::GeomError;
use crate::build::ShapeKey;
use crate::dice::Dice;
use crate::net::rounded_out;
use crate::range::Range;
use crate::surface::{Piece, SplitDirection, Surface};
use crate::vars::{Counts, Report, Vars, take_normals};
use granita_base::{Bound, Severity, Vec3};
use std::sync::Arc;

const CALL: &str = "Sphere";

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
    Ok(vec![Box::new(SpherePiece::new(Arc::new(sphere), whole))])
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
    fn new(sphere: Arc<Sphere>, range: [Range; 2]) -> Self {
        let mut piece = Self { sphere, range, bound: Bound::EMPTY };
        piece.bound = piece.find_bound();
        piece
    }

    fn find_bound(&self) -> Bound {
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
        rounded_out(Bound {
            min: Vec3::new(x.0 as f32, y.0 as f32, z.0 as f32),
            max: Vec3::new(x.1 as f32, y.1 as f32, z.1 as f32),
        })
    }

    /// `(sin, cos)` of the angles along an axis, with the parameter.
    fn angles(&self, axis: usize, n: usize) -> Vec<(f64, (f64, f64))> {
        let s = &*self.sphere;
        let [from, to] = if axis == 0 { [0.0, s.theta_deg] } else { s.phi_deg };
        let each = |i| {
            let place = self.range[axis].place(i, n);
            (place.b, sin_cos_deg(place.a * from + place.b * to))
        };
        (0..n).map(each).collect()
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
        let (us, vs) = (self.angles(0, nu.max(2)), self.angles(1, nv.max(2)));
        let r = self.sphere.radius;
        out.clear();
        for (_, (sp, cp)) in &vs {
            for (_, (st, ct)) in &us {
                out.push(Vec3::new((r * ct * cp) as f32, (r * st * cp) as f32, (r * sp) as f32));
            }
        }
    }

    fn domain(&self) -> [f32; 4] {
        let (u, v) = (self.range[0].ends(), self.range[1].ends());
        [u.0 as f32, u.1 as f32, v.0 as f32, v.1 as f32]
    }

    fn is_splittable(&self) -> bool {
        self.range.iter().any(|r| r.halves().is_some())
    }

    fn split(&self, direction: SplitDirection) -> Vec<Piece> {
        let mut axis = usize::from(direction == SplitDirection::V);
        if self.range[axis].halves().is_none() {
            axis = 1 - axis;
        }
        let Some((left, right)) = self.range[axis].halves() else { return Vec::new() };
        let with = |half| -> Piece {
            let mut range = self.range;
            range[axis] = half;
            Box::new(Self::new(self.sphere.clone(), range))
        };
        vec![with(left), with(right)]
    }

    fn dice(&self, nu: usize, nv: usize) -> Dice {
        let (nu, nv) = (nu.max(2), nv.max(2));
        let n = nu * nv;
        let (us, vs) = (self.angles(0, nu), self.angles(1, nv));
        let s = &*self.sphere;
        let (along_u, along_v) =
            (s.radius * s.theta_deg.to_radians(), s.radius * (s.phi_deg[1] - s.phi_deg[0]).to_radians());
        let (mut p, mut dpdu, mut dpdv) = (Vec::new(), Vec::with_capacity(n), Vec::with_capacity(n));
        self.positions(0, nu, nv, &mut p);
        for (_, (sp, cp)) in &vs {
            // At the pole dP/du vanishes; a short one keeps the direction it has beside it.
            let around = if *cp < 1e-6 { 1e-3 } else { *cp };
            for (_, (st, ct)) in &us {
                let du = [-st * around * along_u, ct * around * along_u, 0.0];
                let dv = [-ct * sp * along_v, -st * sp * along_v, cp * along_v];
                dpdu.push(Vec3::from(du.map(|x| x as f32)));
                dpdv.push(Vec3::from(dv.map(|x| x as f32)));
            }
        }
        let mut primvars = s.vars.uniform(0);
        if !s.vars.linear.is_empty() {
            let mut corners = Vec::new();
            (0..4).for_each(|corner| s.vars.push_linear(corner, &mut corners));
            let fractions = |list: &[(f64, (f64, f64))]| list.iter().map(|x| x.0).collect::<Vec<_>>();
            s.vars.emit_linear(&corners, &fractions(&us), &fractions(&vs), &mut primvars);
        }
        let u = (0..n).map(|i| us[i % nu].0 as f32).collect();
        let v = (0..n).map(|i| vs[i / nu].0 as f32).collect();
        let normals = take_normals(n, &mut primvars);
        Dice { nu, nv, p: vec![p], n: normals, dpdu, dpdv, u, v, primvars, face: 0, mask: None, facing: None }
    }
}
