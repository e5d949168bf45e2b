//! Tests of motion blocks and orientation.

use crate::fixture::*;
use granita_base::{Param, Params, ShapeDesc, Vec3};
use granita_scene::{Call, TransformTarget};

#[test]
fn motion_blocks_make_moving_transformations() {
    let mut run = Run::new();
    run.calls([
        Call::World,
        Call::Scale([2.0, 2.0, 2.0]),
        Call::Motion([0.0, 1.0].into()),
        Call::Translate([0.0, 0.0, 0.0]),
        Call::Translate([1.0, 0.0, 0.0]),
        Call::Rotate { angle_deg: 0.0, axis: [0.0, 0.0, 1.0] },
        sphere(),
    ]);
    let scene = run.scene();
    let m = &scene.primitives[0].attributes.to_world;
    assert_eq!(m.at(0.5).point(Vec3::ZERO), Vec3::new(1.0, 0.0, 0.0));
    assert_eq!(m.at(9.0).point(Vec3::ZERO), Vec3::new(2.0, 0.0, 0.0));
    assert!(run.messages().is_empty());

    for (calls, expected) in [
        (
            vec![Call::Translate([0.0; 3]), Call::Scale([1.0; 3])],
            "Scale in a Motion block that began with Translate",
        ),
        (vec![Call::Translate([0.0; 3]), Call::PushAttributes], "Motion with 2 times, but 1 call follows"),
        (
            vec![Call::Translate([0.0; 3]), sphere()],
            "Sphere in a Motion block: a primitive follows transformations",
        ),
        (
            vec![sphere(), points(&[0.0; 3])],
            "Points in a Motion block: it began with another primitive, Sphere",
        ),
        (vec![points(&[0.0; 3]), points(&[0.0; 6])], "the arguments of Points differ"),
    ] {
        let mut run = Run::new();
        run.calls([Call::World, Call::Motion([0.0, 1.0].into())]).calls(calls);
        run.state.end();
        assert!(run.messages().iter().any(|m| m.contains(expected)), "{expected}: {:?}", run.messages());
    }
}

#[test]
fn every_transformation_moves_over_several_segments() {
    let shift = |x: f32| {
        let mut m = Box::new([0.0; 16]);
        (0..4).for_each(|i| m[5 * i] = 1.0);
        m[12] = x;
        m
    };
    let set = |x: f32| Call::SetTransform(TransformTarget::Matrix(shift(x)));
    let append = |x: f32| Call::AppendTransform(shift(x));
    // Times may be outside of the shutter. After 4 nothing moves.
    for (three, at) in [
        ([set(0.0), set(2.0), set(3.0)], [0.0, 1.0, 2.0, 2.5, 3.0]),
        ([append(0.0), append(2.0), append(3.0)], [10.0, 11.0, 12.0, 12.5, 13.0]),
    ] {
        let mut run = Run::new();
        run.calls([Call::World, Call::Translate([10.0, 0.0, 0.0]), Call::Motion([0.0, 2.0, 4.0].into())]);
        run.calls(three).calls([sphere()]);
        let scene = run.scene();
        let m = &scene.primitives[0].attributes.to_world;
        let x = [-1.0, 1.0, 2.0, 3.0, 9.0].map(|t| m.at(t).point(Vec3::ZERO).x);
        assert_eq!(x, at);
        assert!(run.messages().is_empty());
    }
    // One object has two blocks with different times, and the camera moves.
    let mut run = Run::new();
    run.calls([
        Call::Motion([0.0, 1.0].into()),
        Call::Scale([1.0; 3]),
        Call::Scale([2.0; 3]),
        camera("main"),
        Call::World,
        Call::Motion([0.0, 1.0].into()),
        Call::Translate([0.0; 3]),
        Call::Translate([4.0, 0.0, 0.0]),
        Call::Motion([0.5, 1.5].into()),
        Call::Rotate { angle_deg: 0.0, axis: [0.0, 0.0, 1.0] },
        Call::Rotate { angle_deg: 90.0, axis: [0.0, 0.0, 1.0] },
        sphere(),
    ]);
    let scene = run.scene();
    let m = &scene.primitives[0].attributes.to_world;
    assert_eq!(m.at(0.5).point(Vec3::X), Vec3::new(3.0, 0.0, 0.0));
    assert!((m.at(1.5).point(Vec3::X) - Vec3::new(4.0, 1.0, 0.0)).length() < 1e-6);
    let camera = &scene.cameras[0].world_to_camera;
    assert_eq!(camera.at(1.0).point(Vec3::X).x, 0.5);
    assert!(run.messages().is_empty(), "{:?}", run.messages());
}

#[test]
fn motion_blocks_make_moving_primitives() {
    let mut run = Run::new();
    run.calls([
        Call::World,
        Call::Motion([1.0, 2.0].into()),
        Call::Parameter(Param::declared("float Kd", 1.0).unwrap()),
        points(&[0.0; 3]),
        Call::Parameter(Param::declared("float Kd", 2.0).unwrap()),
        points(&[1.0; 3]),
        points(&[5.0; 3]),
    ]);
    let scene = run.scene();
    assert_eq!(scene.primitives.len(), 2);
    let keys = &scene.primitives[0].keys;
    assert_eq!((keys.len(), keys[0].time, keys[1].time), (2, 1.0, 2.0));
    assert_eq!(keys[1].params.float("Kd"), Some(2.0));
    assert_eq!(scene.primitives[1].keys.len(), 1);
    assert!(run.messages().is_empty());
}

#[test]
fn moving_spheres_may_change_all_their_arguments() {
    let ball = |radius: f32, zmin: f32, thetamax_deg: f32| Call::Shape {
        shape: Box::new(ShapeDesc::Sphere { radius, zmin, zmax: radius, thetamax_deg }),
        params: Params::new(),
    };
    let mut run = Run::new();
    run.calls([Call::World, Call::Motion([0.0, 1.0].into()), ball(1.0, -1.0, 360.0), ball(2.0, 0.5, 90.0)]);
    run.calls([Call::Motion([0.0, 1.0].into()), ball(3.0, -3.0, 360.0), ball(3.0, -3.0, 360.0)]);
    let scene = run.scene();
    let of = |primitive: usize, key: usize| {
        scene.primitives[primitive].keys[key].params.floats("__arguments").map(|v| v.to_vec())
    };
    assert_eq!(of(0, 0), Some(vec![1.0, -1.0, 1.0, 360.0]));
    assert_eq!(of(0, 1), Some(vec![2.0, 0.5, 2.0, 90.0]));
    // A sphere with the same arguments at all keys does not store them.
    assert_eq!((of(1, 0), of(1, 1)), (None, None));
    assert!(run.messages().is_empty(), "{:?}", run.messages());
}

#[test]
fn orientation_and_handedness_flip_normals() {
    let flip = |calls: Vec<Call>| {
        let mut run = Run::new();
        // The camera's world is mirrored. lh and rh refer to camera space.
        run.calls([Call::Scale([1.0, 1.0, -1.0]), Call::World]).calls(calls).calls([sphere()]);
        run.scene().primitives[0].attributes.flip_normals
    };
    let orient = |word: &str| attr("string orientation", word);
    let mirror = || Call::Scale([-1.0, 1.0, 1.0]);
    assert!(!flip(vec![]));
    assert!(flip(vec![mirror()]));
    assert!(flip(vec![orient("inside")]));
    assert!(!flip(vec![orient("inside"), mirror()]));
    assert!(flip(vec![orient("reverse")]));
    assert!(!flip(vec![orient("reverse"), orient("reverse")]));
    // The transform from object to camera has a negative determinant, so that lh is the same as inside.
    assert!(flip(vec![orient("lh")]));
    assert!(!flip(vec![orient("rh")]));
    // Mirrored once more the determinant is positive. lh is then the same as outside, which is flipped in a mirrored
    // space.
    assert!(flip(vec![orient("lh"), mirror()]));
    assert!(!flip(vec![orient("lh"), orient("reverse")]));
}
