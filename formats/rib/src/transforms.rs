//! Transformations and named spaces.

use crate::options::{exactly, string};
use crate::reader::{Done, Fault, Reader};
use crate::request::Request;
use granita_scene::{Call, TransformTarget};

/// Returns a shear along `d2` that turns direction `d1` towards `d2` by an angle in degrees; `None` when the directions
/// are parallel or the angle is too large.
fn skew(angle_deg: f32, d1: [f32; 3], d2: [f32; 3]) -> Option<[f32; 16]> {
    let length = |d: [f64; 3]| d.iter().map(|x| x * x).sum::<f64>().sqrt();
    let unit = |d: [f32; 3]| {
        let d = d.map(f64::from);
        let l = length(d);
        (l > 0.0).then(|| d.map(|x| x / l))
    };
    let (a, b) = (unit(d1)?, unit(d2)?);
    let cosine: f64 = (0..3).map(|i| a[i] * b[i]).sum();
    // The shear is proportional to the component of d1 that is perpendicular to d2.
    let side: [f64; 3] = std::array::from_fn(|i| a[i] - cosine * b[i]);
    let height = length(side);
    if height < 1.0e-9 {
        return None;
    }
    let side = side.map(|x| x / height);
    let now = libm::atan2(height, cosine);
    let then = now - f64::from(angle_deg).to_radians();
    if then <= 1.0e-6 {
        return None;
    }
    let amount = 1.0 / libm::tan(then) - 1.0 / libm::tan(now);
    let mut m = [0.0; 16];
    for i in 0..3 {
        for j in 0..3 {
            let one = if i == j { 1.0 } else { 0.0 };
            m[4 * i + j] = (one + side[i] * b[j] * amount) as f32;
        }
    }
    m[15] = 1.0;
    Some(m)
}

impl Reader<'_> {
    /// Executes transformation requests. Returns `None` for other requests.
    pub(crate) fn transform_request(&mut self, request: &Request) -> Option<Done> {
        let call = match request.name.as_str() {
            "Identity" => {
                let mut m = [0.0; 16];
                [0, 5, 10, 15].into_iter().for_each(|i| m[i] = 1.0);
                Ok(Call::SetTransform(TransformTarget::Matrix(Box::new(m))))
            }
            "Transform" => {
                exactly::<16>(request).map(|m| Call::SetTransform(TransformTarget::Matrix(Box::new(m))))
            }
            "ConcatTransform" => exactly::<16>(request).map(|m| Call::AppendTransform(Box::new(m))),
            "Translate" => exactly::<3>(request).map(Call::Translate),
            "Rotate" => {
                exactly::<4>(request).map(|[a, x, y, z]| Call::Rotate { angle_deg: a, axis: [x, y, z] })
            }
            "Scale" => exactly::<3>(request).map(Call::Scale),
            "Skew" => exactly::<7>(request).and_then(|[a, x1, y1, z1, x2, y2, z2]| {
                let m = skew(a, [x1, y1, z1], [x2, y2, z2]);
                m.map(|m| Call::AppendTransform(Box::new(m))).ok_or_else(|| {
                    Fault::Mistake("the directions and the angle do not define a skew".to_owned())
                })
            }),
            "Perspective" => exactly::<1>(request).and_then(|[fov]| {
                if !(fov > 0.0 && fov < 180.0) {
                    return Err(Fault::Mistake(format!("a field of view of {fov}")));
                }
                let t = libm::tanf(fov.to_radians() * 0.5);
                let mut m = [0.0; 16];
                (m[0], m[5], m[10], m[11], m[14]) = (1.0, 1.0, t, t, -t);
                Ok(Call::AppendTransform(Box::new(m)))
            }),
            "CoordinateSystem" | "ScopedCoordinateSystem" => string(request, 0)
                .map(|name| Call::SaveAttributes { name, attributes: Some("transform".into()) }),
            "CoordSysTransform" => {
                string(request, 0).map(|name| Call::SetTransform(TransformTarget::Named(name)))
            }
            _ => return None,
        };
        Some(call.and_then(|call| self.emit(call)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::{Transform, Vec3};

    #[test]
    fn skew_keeps_the_perpendicular_plane_fixed() {
        // y is turned towards x by 45 degrees. Its y coordinate does not change.
        let m = skew(45.0, [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]).unwrap();
        let p = Transform::from_rows(&m).point(Vec3::new(0.0, 1.0, 0.0));
        assert!((p - Vec3::new(1.0, 1.0, 0.0)).length() < 1e-6, "{p}");
        let fixed = Transform::from_rows(&m).point(Vec3::new(3.0, 0.0, 5.0));
        assert_eq!(fixed, Vec3::new(3.0, 0.0, 5.0));
        assert!(skew(90.0, [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]).is_none());
        assert!(skew(10.0, [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]).is_none());
    }
}
