//! Quadrics and tori as rational patches, which represent them exactly.
//!
//! u sweeps about the z axis and v follows the profile, as in the RenderMan interface. Circles are rational quadratic
//! arcs of at most a quarter turn each. Points lie on the surface. Between the ends of an arc, u differs slightly from
//! the angle.

use granita_base::shape::KnotSpan;
use granita_base::{BaseType, Interp, Param, ParamData, ParamType, ShapeDesc};
use std::sync::Arc;

/// A homogeneous point: two coordinates and the weight. The coordinates are not multiplied by the weight.
type Point = [f64; 3];

/// The curve that is swept about the axis.
struct Profile {
    /// The points, each with the distance from the axis, the angle about it in radians, the height and the weight.
    points: Vec<[f64; 4]>,
    span: KnotSpan,
}

/// The number of arcs of each circle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Arcs {
    /// The least number of arcs for the angle.
    Fewest,
    /// At least four arcs for any angle, so that keys of a motion block have the same number of control points.
    Four,
}

/// Returns an arc of a circle about the origin from `from` to `to` (radians). The control points are (cosine, sine,
/// weight).
fn arc(from: f64, to: f64, arcs: Arcs) -> (Vec<Point>, KnotSpan) {
    let least = if arcs == Arcs::Four { 4 } else { 1 };
    let quarters =
        (((to - from).abs() / std::f64::consts::FRAC_PI_2 - 1e-9).ceil() as usize).clamp(least, 64);
    let step = (to - from) / quarters as f64;
    let weight = libm::cos(step * 0.5);
    let mut points = Vec::with_capacity(2 * quarters + 1);
    let mut knots = vec![0.0; 3];
    for k in 0..quarters {
        let angle = from + step * k as f64;
        points.push([exact_cos(angle), exact_sin(angle), 1.0]);
        let middle = angle + step * 0.5;
        points.push([libm::cos(middle) / weight, libm::sin(middle) / weight, weight]);
        let end = (k + 1) as f32 / quarters as f32;
        knots.extend(if k + 1 < quarters { vec![end; 2] } else { vec![1.0; 3] });
    }
    points.push([exact_cos(to), exact_sin(to), 1.0]);
    let span = KnotSpan { n: points.len(), order: 3, knots: knots.into(), min: 0.0, max: 1.0 };
    (points, span)
}

/// Returns the cosine of an angle in radians. Zeros are exact, so that shared edges close and poles are points.
fn exact_cos(angle: f64) -> f64 {
    let c = libm::cos(angle);
    if c.abs() < 1e-15 { 0.0 } else { c }
}

fn exact_sin(angle: f64) -> f64 {
    let s = libm::sin(angle);
    if s.abs() < 1e-15 { 0.0 } else { s }
}

fn line(a: [f64; 3], b: [f64; 3]) -> Profile {
    let knots: Arc<[f32]> = [0.0, 0.0, 1.0, 1.0].into();
    Profile {
        points: [a, b].map(|[x, y, z]| [libm::hypot(x, y), libm::atan2(y, x), z, 1.0]).to_vec(),
        span: KnotSpan { n: 2, order: 2, knots, min: 0.0, max: 1.0 },
    }
}

/// Returns the surface of a profile that turns by `thetamax_deg`, and its parameter "Pw".
fn swept(profile: &Profile, thetamax_deg: f64, arcs: Arcs) -> (ShapeDesc, Param) {
    let (circle, u) = arc(0.0, thetamax_deg.to_radians(), arcs);
    let mut values = Vec::with_capacity(4 * circle.len() * profile.points.len());
    for [r, offset, z, w] in &profile.points {
        let (sin, cos) = libm::sincos(*offset);
        for [x, y, weight] in &circle {
            let (x, y) = (x * cos - y * sin, x * sin + y * cos);
            let w = w * weight;
            values.extend([r * x * w, r * y * w, z * w, w].map(|v| v as f32));
        }
    }
    let ty = ParamType::of(BaseType::HPoint).with_interp(Interp::Vertex);
    let pw = Param { name: "Pw".into(), ty, data: ParamData::Float(values.into()) };
    (ShapeDesc::Nurbs { u, v: profile.span.clone() }, pw)
}

/// Returns a sphere as a patch, for spheres whose arguments change while they move. One without a radius or a height is
/// a point or a ring.
pub(crate) fn sphere([radius, zmin, zmax, thetamax]: [f64; 4]) -> (ShapeDesc, Param) {
    let half = std::f64::consts::FRAC_PI_2;
    let angle = |z: f64| libm::asin((z / radius.abs()).clamp(-1.0, 1.0));
    let (from, to) = if radius == 0.0 { (-half, half) } else { (angle(zmin), angle(zmax)) };
    swept(&circle_profile(0.0, radius, from, to, Arcs::Four), thetamax, Arcs::Four)
}

fn circle_profile(centre: f64, radius: f64, from: f64, to: f64, arcs: Arcs) -> Profile {
    let (points, span) = arc(from, to, arcs);
    Profile {
        points: points.iter().map(|[c, s, w]| [centre + radius * c, 0.0, radius * s, *w]).collect(),
        span,
    }
}

/// Returns `Cone height radius thetamax`.
pub(crate) fn cone([height, radius, thetamax]: [f64; 3], arcs: Arcs) -> (ShapeDesc, Param) {
    swept(&line([radius, 0.0, 0.0], [0.0, 0.0, height]), thetamax, arcs)
}

/// Returns `Cylinder radius zmin zmax thetamax`.
pub(crate) fn cylinder([radius, zmin, zmax, thetamax]: [f64; 4], arcs: Arcs) -> (ShapeDesc, Param) {
    swept(&line([radius, 0.0, zmin], [radius, 0.0, zmax]), thetamax, arcs)
}

/// Returns `Disk height radius thetamax`.
pub(crate) fn disk([height, radius, thetamax]: [f64; 3], arcs: Arcs) -> (ShapeDesc, Param) {
    swept(&line([radius, 0.0, height], [0.0, 0.0, height]), thetamax, arcs)
}

/// Returns `Hyperboloid p1 p2 thetamax`.
pub(crate) fn hyperboloid(p1: [f64; 3], p2: [f64; 3], thetamax: f64, arcs: Arcs) -> (ShapeDesc, Param) {
    swept(&line(p1, p2), thetamax, arcs)
}

/// Returns `Paraboloid rmax zmin zmax thetamax`; `None` when it has no surface.
pub(crate) fn paraboloid([rmax, zmin, zmax, thetamax]: [f64; 4], arcs: Arcs) -> Option<(ShapeDesc, Param)> {
    if zmax == 0.0 || zmin / zmax < 0.0 {
        return None;
    }
    // z is proportional to the square of r. A parabola is a quadratic Bezier curve over r.
    let r0 = rmax * (zmin / zmax).sqrt();
    let height = |a: f64, b: f64| zmax * (a / rmax) * (b / rmax);
    let points = [(r0, r0), (r0, rmax), (rmax, rmax)].map(|(a, b)| [(a + b) * 0.5, 0.0, height(a, b), 1.0]);
    let knots: Arc<[f32]> = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0].into();
    let span = KnotSpan { n: 3, order: 3, knots, min: 0.0, max: 1.0 };
    (rmax != 0.0).then(|| swept(&Profile { points: points.to_vec(), span }, thetamax, arcs))
}

/// Returns `Torus majorradius minorradius phimin phimax thetamax`.
pub(crate) fn torus([major, minor, phimin, phimax, thetamax]: [f64; 5], arcs: Arcs) -> (ShapeDesc, Param) {
    swept(&circle_profile(major, minor, phimin.to_radians(), phimax.to_radians(), arcs), thetamax, arcs)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a B-spline basis function by its recursion.
    fn basis(i: usize, order: usize, t: f64, knots: &[f32]) -> f64 {
        let k = |i: usize| f64::from(knots[i]);
        if order == 1 {
            let last = k(i) < k(i + 1) && t == 1.0 && k(i + 1) == 1.0;
            return f64::from(u8::from((k(i) <= t && t < k(i + 1)) || last));
        }
        let part = |num: f64, den: f64, rest: f64| if den == 0.0 { 0.0 } else { num / den * rest };
        part(t - k(i), k(i + order - 1) - k(i), basis(i, order - 1, t, knots))
            + part(k(i + order) - t, k(i + order) - k(i + 1), basis(i + 1, order - 1, t, knots))
    }

    fn points((shape, pw): &(ShapeDesc, Param)) -> Vec<[f64; 3]> {
        let ShapeDesc::Nurbs { u, v } = shape else { panic!() };
        let ParamData::Float(values) = &pw.data else { panic!() };
        assert_eq!(values.len(), 4 * u.n * v.n);
        let mut all = Vec::new();
        for a in 0..=12 {
            for b in 0..=8 {
                let (s, t) = (f64::from(a) / 12.0, f64::from(b) / 8.0);
                let mut sum = [0.0; 4];
                for j in 0..v.n {
                    for i in 0..u.n {
                        let w = basis(i, u.order, s, &u.knots) * basis(j, v.order, t, &v.knots);
                        (0..4).for_each(|c| sum[c] += w * f64::from(values[4 * (j * u.n + i) + c]));
                    }
                }
                all.push([sum[0] / sum[3], sum[1] / sum[3], sum[2] / sum[3]]);
            }
        }
        all
    }

    fn hold(surface: &(ShapeDesc, Param), thetamax: f64, error: impl Fn([f64; 3]) -> f64) {
        let all = points(surface);
        for p in &all {
            assert!(error(*p).abs() < 1e-5, "{p:?} {}", error(*p));
        }
        // The sweep begins in the plane y = 0 and ends at the given angle.
        let [x, y, _] = all[9 * 12];
        let r = x.hypot(y);
        let (ex, ey) = (r * thetamax.to_radians().cos(), r * thetamax.to_radians().sin());
        assert!((x - ex).hypot(y - ey) < 1e-5, "{x} {y}");
    }

    #[test]
    fn points_lie_on_the_surfaces() {
        let angles = [360.0, 270.0, 100.0, 33.0, -360.0];
        for (thetamax, arcs) in angles.iter().flat_map(|a| [(*a, Arcs::Fewest), (*a, Arcs::Four)]) {
            hold(&cylinder([2.0, -1.0, 1.0, thetamax], arcs), thetamax, |[x, y, _]| x.hypot(y) - 2.0);
            hold(&cone([3.0, 2.0, thetamax], arcs), thetamax, |[x, y, z]| x.hypot(y) - 2.0 * (1.0 - z / 3.0));
            hold(&disk([0.5, 2.0, thetamax], arcs), thetamax, |[_, _, z]| z - 0.5);
            let surface = paraboloid([2.0, 0.5, 3.0, thetamax], arcs).unwrap();
            hold(&surface, thetamax, |[x, y, z]| (x * x + y * y) - 4.0 * z / 3.0);
            let surface = torus([2.0, 0.5, 20.0, 300.0, thetamax], arcs);
            hold(&surface, thetamax, |[x, y, z]| (x.hypot(y) - 2.0).hypot(z) - 0.5);
            let surface = sphere([1.5, -1.0, 1.2, thetamax]);
            hold(&surface, thetamax, |[x, y, z]| (x * x + y * y + z * z).sqrt() - 1.5);
            let surface = sphere([1.5, -1.5, 1.5, thetamax]);
            assert!(points(&surface).iter().all(|p| p[2].abs() <= 1.5 + 1e-6));
        }
        // Both lines of the hyperboloid lie on x^2 + y^2 = 1 + z^2.
        let surface = hyperboloid([1.0, -1.0, -1.0], [1.0, 1.0, 1.0], 360.0, Arcs::Fewest);
        for p in points(&surface) {
            assert!((p[0] * p[0] + p[1] * p[1] - 1.0 - p[2] * p[2]).abs() < 1e-5);
        }
        assert!(paraboloid([1.0, -1.0, 1.0, 360.0], Arcs::Fewest).is_none());
        assert!(points(&sphere([0.0, 0.0, 0.0, 360.0])).iter().all(|p| *p == [0.0; 3]));
    }

    #[test]
    fn quadrics_have_the_requested_heights_and_limits() {
        let z = |s: &(ShapeDesc, Param)| {
            points(s).iter().fold([f64::MAX, f64::MIN], |a, p| [a[0].min(p[2]), a[1].max(p[2])])
        };
        let near =
            |a: [f64; 2], b: [f64; 2]| assert!((a[0] - b[0]).abs() + (a[1] - b[1]).abs() < 1e-5, "{a:?}");
        near(z(&paraboloid([2.0, 0.5, 3.0, 90.0], Arcs::Fewest).unwrap()), [0.5, 3.0]);
        near(z(&cone([3.0, 2.0, 90.0], Arcs::Fewest)), [0.0, 3.0]);
        near(z(&sphere([1.5, -1.0, 1.2, 90.0])), [-1.0, 1.2]);
    }
}
