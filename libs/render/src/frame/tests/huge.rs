//! Tests ground that reaches to the horizon. It is flat, round, displaced, moving, out of focus, or far from the
//! origin.

use super::*;
use granita_base::CurveBasis::{Bezier, Linear};
use granita_base::shape::KnotSpan;

/// Returns the fraction of the image that is covered.
fn alpha(build: &Build, more: &[(&'static str, Vec<f32>)], displace: Option<f32>) -> f32 {
    let shader = Painted { displace, ..Painted::new(flat) };
    let image = render_with(build, &build.view(more), 2, ("rgba", &box_filter()), &shader);
    image.chunks(4).map(|p| p[3]).sum::<f32>() / (image.len() / 4) as f32
}

/// Returns a camera one unit above the ground that looks along z.
fn standing(resolution: [f32; 2]) -> Build {
    Build {
        camera: vec![("int[2] resolution", resolution.to_vec()), ("float far", vec![1e12])],
        world_to_camera: Transform::translate(Vec3::new(0.0, -1.0, 0.0)).into(),
        ..Build::default()
    }
}

/// Returns the corners of a square of half side `s` in the xy plane, in the order (0,0), (1,0), (0,1), (1,1).
pub(super) fn corners_of(s: f32) -> [f32; 12] {
    [-s, -s, 0.0, s, -s, 0.0, -s, s, 0.0, s, s, 0.0]
}

#[derive(Clone, Copy, Debug)]
enum Kind {
    Patch,
    Cubic,
    Mesh,
    Sphere,
    Nurbs,
}

fn ground(build: &mut Build, kind: Kind, s: f32, to_world: MotionTransform, list: &[(&str, &[f32])]) {
    let corners = [-s, 0.0, -s, -s, 0.0, s, s, 0.0, -s, s, 0.0, s];
    match kind {
        Kind::Patch => {
            let shape = ShapeDesc::Patch { u: Linear, v: Linear, nu: 2, nv: 2 };
            build.add(shape, Params(vec![param("vertex point P", &corners)]), attributes(list, to_world));
        }
        Kind::Cubic => {
            let points: Vec<f32> = (0..16)
                .flat_map(|i| [(i / 4) as f32 / 1.5 - 1.0, 0.0, (i % 4) as f32 / 1.5 - 1.0].map(|x| x * s))
                .collect();
            let shape = ShapeDesc::Patch { u: Bezier, v: Bezier, nu: 4, nv: 4 };
            build.add(shape, Params(vec![param("vertex point P", &points)]), attributes(list, to_world));
        }
        Kind::Mesh => {
            let verts: [i32; 4] = [0, 1, 3, 2];
            let shape = ShapeDesc::Mesh { subdivide: false, nverts: [4].into(), verts: verts.into() };
            build.add(shape, Params(vec![param("vertex point P", &corners)]), attributes(list, to_world));
        }
        Kind::Sphere => {
            let turned = Transform::rotate(std::f32::consts::FRAC_PI_2, Vec3::X)
                .then(&Transform::translate(Vec3::new(0.0, -s, 0.0)));
            let to_world = MotionTransform::from(turned).then(&to_world);
            build.add(sphere(s), Params::new(), attributes(list, to_world));
        }
        Kind::Nurbs => {
            let span = || KnotSpan { n: 2, order: 2, knots: [0.0, 0.0, 1.0, 1.0].into(), min: 0.0, max: 1.0 };
            let shape = ShapeDesc::Nurbs { u: span(), v: span() };
            build.add(shape, Params(vec![param("vertex point P", &corners)]), attributes(list, to_world));
        }
    }
}

const ALL: [Kind; 5] = [Kind::Patch, Kind::Cubic, Kind::Mesh, Kind::Nurbs, Kind::Sphere];

/// Returns the fraction of the image that is covered by a flat or round ground, for a camera at height 1 that looks
/// along z. The horizon is slightly below the middle.
fn seen(kind: Kind, s: f32) -> f32 {
    let below = match kind {
        Kind::Sphere => (2.0 / s).sqrt(),
        _ => 1.0 / s,
    };
    0.5 - 0.5 * below
}

#[test]
fn ground_reaches_the_horizon() {
    for kind in ALL {
        for s in [3e4, 1e6, 1e8] {
            let mut build = standing([64.0, 48.0]);
            ground(&mut build, kind, s, MotionTransform::default(), &[]);
            let (found, exact) = (alpha(&build, &[], None), seen(kind, s));
            // One row of samples is 1/192 of the image.
            let room = if matches!(kind, Kind::Sphere) { 1e-3 + 1.0 / 384.0 } else { 1e-3 };
            assert!((found - exact).abs() < room, "{kind:?} {s:e}: {found} instead of {exact}");
        }
    }
    let mut build = standing([480.0, 270.0]);
    ground(&mut build, Kind::Patch, 1e7, MotionTransform::default(), &[]);
    let found = alpha(&build, &[], None);
    assert!((found - 0.5).abs() < 1e-3, "{found}");
}

#[test]
fn ground_reaches_the_horizon_of_tilted_cameras() {
    // The horizon is a straight line in the image, tan (pitch) above its middle.
    let pitch = 0.35_f32;
    for kind in ALL {
        for s in [1e6, 1e8] {
            let mut build = standing([64.0, 48.0]);
            let looks = Transform::rotate(0.6, Vec3::Y).then(&Transform::rotate(-pitch, Vec3::X));
            build.world_to_camera = build.world_to_camera.first().then(&looks).into();
            ground(&mut build, kind, s, MotionTransform::default(), &[]);
            let (found, exact) = (alpha(&build, &[], None), 0.5 + 0.5 * pitch.tan());
            assert!((found - exact).abs() < 3e-3, "{kind:?} {s:e}: {found} instead of {exact}");
        }
    }
}

#[test]
fn displaced_moving_or_blurred_ground_reaches_the_horizon() {
    let moving = MotionTransform::from_keys(vec![
        (0.0, Transform::translate(Vec3::new(-0.3, 0.0, 0.2))),
        (1.0, Transform::translate(Vec3::new(0.4, 0.0, -0.5))),
    ])
    .unwrap();
    let shutter = ("float[2] shutter", vec![0.0, 1.0]);
    let lens = [("float fstop", 2.0), ("float focallength", 0.4), ("float focaldistance", 5.0)]
        .map(|(name, v)| (name, vec![v]));
    let s = 1e8;
    for kind in ALL {
        for (what, to_world, camera, displace) in [
            ("displaced", MotionTransform::default(), vec![], Some(0.1)),
            ("moving", moving.clone(), vec![shutter.clone()], None),
            ("moving and displaced", moving.clone(), vec![shutter.clone()], Some(0.1)),
            ("out of focus", MotionTransform::default(), lens.to_vec(), None),
        ] {
            let mut build = standing([64.0, 48.0]);
            build.camera.extend(camera);
            ground(&mut build, kind, s, to_world, &[("float displace:maxradius", &[0.1])]);
            let found = alpha(&build, &[], displace);
            // The tolerance is that of a sharp horizon, with twice the part for the rows of samples because a horizon
            // may be blurred.
            let room = if matches!(kind, Kind::Sphere) { 1e-3 + 1.0 / 192.0 } else { 1e-3 };
            assert!((found - 0.5).abs() < room, "{kind:?} {s:e} {what}: {found}");
        }
    }
}

#[test]
fn cameras_far_from_the_origin_show_the_same_image() {
    let eye = Vec3::new(1e7, 3e6, -2e7);
    let looks = Transform::rotate(0.3, Vec3::new(0.2, 1.0, 0.1));
    let scene = |from: Vec3, moves: f32| {
        let mut build = standing([64.0, 48.0]);
        build.camera.push(("float[2] shutter", vec![0.0, 1.0]));
        build.world_to_camera = Transform::translate(-from).then(&looks).into();
        let back = looks.inverse();
        let place = |x: f32, y: f32, z: f32| {
            let at = |x: f32| {
                Transform::translate(Vec3::new(x, y, z)).then(&back).then(&Transform::translate(from))
            };
            if moves == 0.0 {
                return at(x).into();
            }
            MotionTransform::from_keys(vec![(0.0, at(x)), (1.0, at(x + moves))]).unwrap()
        };
        build.sphere(1.0, &[("color C", &[1.0, 0.5, 0.2])], place(0.3, 0.2, 4.0));
        build.square(1.0, &[("color C", &[0.2, 0.5, 1.0])], place(-1.5, 0.0, 5.0));
        ground(&mut build, Kind::Mesh, 1e6, place(0.0, -1.0, 0.0), &[]);
        build
    };
    let shader = Painted::new(flat);
    for moves in [0.0, 0.5] {
        let pixels = |from: Vec3| {
            let build = scene(from, moves);
            render_with(&build, &build.view(&[]), 2, ("rgba", &box_filter()), &shader)
        };
        let (near, far) = (pixels(Vec3::ZERO), pixels(eye));
        let off = near.iter().zip(&far).map(|(a, b)| (a - b).abs()).sum::<f32>() / near.len() as f32;
        assert!(off < 1e-3, "{off} with motion {moves}");
    }
}

#[test]
fn large_ground_does_not_depend_on_threads_buckets_or_crops() {
    let mut build = standing([61.0, 47.0]);
    build.world_to_camera = build.world_to_camera.first().then(&Transform::rotate(0.2, Vec3::X)).into();
    ground(&mut build, Kind::Cubic, 1e7, MotionTransform::default(), &[("color C", &[0.3, 0.6, 0.9])]);
    ground(&mut build, Kind::Sphere, 1e7, at(0.0, -0.2, 0.0), &[]);
    let shader = Painted::new(wavy);
    let whole = render_with(&build, &build.view(&[]), 1, ("rgba", &[]), &shader);
    let small = build.view(&[("int[2] limits:bucketsize", vec![7.0, 5.0])]);
    assert!(whole == render_with(&build, &small, 3, ("rgba", &[]), &shader));
    let crop = build.view(&[("float[4] crop", vec![0.3, 0.8, 0.2, 0.7])]);
    let part = render_with(&build, &crop, 2, ("rgba", &[]), &shader);
    let rect = crop.crop;
    for (j, row) in part.chunks(rect.width() * 4).enumerate() {
        let from = ((rect.y0 as usize + j) * 61 + rect.x0 as usize) * 4;
        assert!(row == &whole[from..from + row.len()], "row {j}");
    }
}
