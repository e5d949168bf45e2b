//! Tests of tracing rays and shading what they hit.

use super::*;
use crate::fixture::{Finish as _, Fixture, param};
use granita_base::sample::Sequence;
use granita_base::{MotionTransform, Transform};
use granita_rays::Leaving;
use granita_rays::sampling::{Distribution, in_cone};
use granita_scene::AttributeSet;
use granita_trace::Ray;

fn request(origin: Vec3, dir: Vec3, time: f32) -> RayRequest {
    let ray = Ray { origin, tmin: 0.0, dir, tmax: f32::INFINITY, time };
    RayRequest::new(ray)
}

#[test]
fn primitive_variables_follow_their_rays() {
    let ty = granita_base::ParamType::of(granita_base::BaseType::Color);
    let value = |values: &[f32], varying| Primvar {
        name: "x".into(),
        ty,
        data: PrimvarData::Floats { values: values.into(), varying },
    };
    let of = |v: &Primvar, lanes: &[u32], points| of_rays(v, lanes, points).map(|v| v.data);
    let v = value(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], true);
    // Two lanes; hits of rays of the second, the first and the second.
    let wanted = [2.0, 1.0, 2.0, 4.0, 3.0, 4.0, 6.0, 5.0, 6.0];
    assert_eq!(of(&v, &[1, 0, 1], 3), Some(value(&wanted, true).data));
    let wanted = [2.0, 2.0, 2.0, 4.0, 4.0, 4.0, 6.0, 6.0, 6.0];
    assert_eq!(of(&v, &[1], 3), Some(value(&wanted, true).data));
    assert_eq!(of(&v, &[7], 1), None);
    let same = value(&[1.0, 2.0, 3.0], false);
    assert_eq!(of(&same, &[7], 9), Some(same.data.clone()));
}

const UNSHADED: RayPurpose = RayPurpose {
    parent: RayKind { level: 0, shadow: false, indirect: false, bounces: 0 },
    indirect: false,
    bounces: 0,
    shade: false,
    dtime: 0.0,
};

/// Returns a direction in a cone.
fn direction(axis: Vec3, half_angle: f32, index: u32) -> Vec3 {
    in_cone(axis, half_angle, Distribution::Uniform, [index, 1], Sequence::new(3))
}

#[test]
fn hits_of_a_sphere_lie_on_the_sphere() {
    let mut f = Fixture::new(&[]);
    let center = Vec3::new(0.0, 1.0, 0.0);
    let ball = f.attributes("", &["set"], &[]);
    f.sphere(center, 1.0, ball);
    let (scene, camera, environment) = f.finish();
    let frame = ShadingContext::new(&scene, &camera, &environment);
    let rays: Vec<RayRequest> =
        (0..500).map(|i| request(Vec3::Z * 5.0, direction(-Vec3::Z, 0.6, i), 0.0)).collect();
    let set = frame.rays.scene("set", &frame).unwrap();
    let found = ShaderThread::new(&frame).radiance(set, &rays, UNSHADED, &[]);
    let mut hits = 0;
    for (r, found) in rays.iter().zip(found) {
        let to = center - r.ray.origin;
        let b = to.dot(r.ray.dir);
        let discriminant = b * b - (to.length_squared() - 1.0);
        // At the silhouette a fraction of a pixel decides.
        if discriminant.abs() < 0.05 {
            continue;
        }
        assert_eq!(discriminant > 0.0, found.distance.is_finite());
        if discriminant > 0.0 {
            hits += 1;
            // The distance from the sphere is at most that of the tessellation: a pixel is 0.042 units at
            // distance 10.
            let off = 1.0 - found.p.distance(center);
            assert!((-1e-5..2.0 * 0.042 * FLATNESS_PX).contains(&off), "{off}");
            assert!((found.p - (r.ray.origin + r.ray.dir * found.distance)).length() < 1e-5);
            assert!((found.n - (found.p - center).normalize()).length() < 0.02);
            assert_eq!(found.opacity, Color::ONE);
        }
    }
    assert!(hits > 50, "{hits}");
}

#[test]
fn rays_see_motion_only_with_the_attribute() {
    for motion in [0, 1] {
        let mut f = Fixture::new(&[]);
        let shutter = param("float[2] shutter", &[0.0_f32, 1.0][..]);
        f.scene.cameras[0].params.set(shutter);
        let moving = f.attributes("", &["set"], &[param("int ray:motion", motion)]);
        let keys = vec![(0.0, Transform::IDENTITY), (1.0, Transform::translate(Vec3::X * 10.0))];
        let to_world = MotionTransform::from_keys(keys).unwrap();
        f.rectangle([-1.0; 2], [1.0; 2], 0.0, AttributeSet { to_world, ..moving });
        let (scene, camera, environment) = f.finish();
        let frame = ShadingContext::new(&scene, &camera, &environment);
        let set = frame.rays.scene("set", &frame).unwrap();
        let rays = [
            request(Vec3::new(0.0, 0.0, 5.0), -Vec3::Z, 0.0),
            request(Vec3::new(0.0, 0.0, 5.0), -Vec3::Z, 0.5),
            request(Vec3::new(5.0, 0.0, 5.0), -Vec3::Z, 0.5),
        ];
        let rays = rays.map(|r| r.ray);
        let hit = set.any(&mut ShaderThread::new(&frame), &rays, &|_| [0.0; 2], &|_| Leaving::default());
        assert_eq!(hit, if motion == 1 { [true, false, true] } else { [true, true, false] });
    }
}

#[test]
fn rays_hit_primitives_only_while_they_exist() {
    // Times of the motion keys; whether rays at 0.25 and 0.75 hit, without "ray:motion" and with it.
    let cases = [
        ([0.5, 1.0], [false, false], [false, true]),
        ([-1.0, 0.5], [true, true], [true, false]),
        ([0.0, 1.0], [true, true], [true, true]),
        ([2.0, 3.0], [false, false], [false, false]),
    ];
    for (times, still, moving) in cases {
        for (motion, wanted) in [(0, still), (1, moving)] {
            let mut f = Fixture::new(&[]);
            f.scene.cameras[0].params.set(param("float[2] shutter", &[0.0_f32, 1.0][..]));
            let here = f.attributes("", &["set"], &[param("int ray:motion", motion)]);
            let primitive = f.rectangle([-1.0; 2], [1.0; 2], 0.0, here);
            let key = |time| granita_scene::ShapeKey { time, ..primitive.keys[0].clone() };
            Arc::make_mut(&mut f.scene.primitives[0]).keys = times.map(key).to_vec();
            let (scene, camera, environment) = f.finish();
            let frame = ShadingContext::new(&scene, &camera, &environment);
            let set = frame.rays.scene("set", &frame).unwrap();
            let down = |time| request(Vec3::new(0.1, 0.2, 5.0), -Vec3::Z, time).ray;
            let hit =
                set.any(&mut ShaderThread::new(&frame), &[down(0.25), down(0.75)], &|_| [0.0; 2], &|_| {
                    Leaving::default()
                });
            assert_eq!(hit, wanted, "{times:?} {motion}");
        }
    }
}

#[test]
fn triangles_take_less_than_120_bytes() {
    let mut f = Fixture::new(&[]);
    // The sphere is so near that its flatness needs many triangles.
    let ball = f.attributes("", &["set"], &[]);
    f.sphere(Vec3::ZERO, 500.0, ball);
    let (scene, camera, environment) = f.finish();
    let frame = ShadingContext::new(&scene, &camera, &environment);
    let set = frame.rays.scene("set", &frame).unwrap();
    assert_eq!(frame.rays.size().0, 0);
    // The rays start from its centre in all directions.
    let rays: Vec<RayRequest> =
        (0..5000).map(|i| request(Vec3::ZERO, direction(Vec3::Z, 3.2, i), 0.0)).collect();
    let rays: Vec<Ray> = rays.iter().map(|r| r.ray).collect();
    let blocked = set.any(&mut ShaderThread::new(&frame), &rays, &|_| [0.0; 2], &|_| Leaving::default());
    assert!(blocked.iter().all(|b| *b));
    let (triangles, bytes) = frame.rays.size();
    assert!(triangles > 10_000, "{triangles}");
    assert!(bytes < 120 * triangles, "{} bytes each", bytes as f64 / triangles as f64);
}
