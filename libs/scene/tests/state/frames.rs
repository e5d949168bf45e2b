//! Tests of the frame, transformations, stacks, lights, shader groups and parameters.

use crate::fixture::*;
use granita_base::{Param, Params, Vec3};
use granita_scene::{Call, LightId, TransformTarget, attr};
use std::sync::Arc;

#[test]
fn without_a_camera_the_frame_begins_in_camera_space() {
    let mut run = Run::new();
    run.calls([
        Call::Translate([0.0, 0.0, 5.0]),
        light("before", Some("pointlight")),
        Call::World,
        Call::Translate([1.0, 0.0, 0.0]),
        sphere(),
    ]);
    let scene = run.scene();
    assert_eq!(scene.cameras.len(), 1);
    assert_eq!(&*scene.cameras[0].name, "camera");
    // World is 5 units in front of the camera. The light, declared before World, is at world's origin.
    assert_eq!(scene.cameras[0].world_to_camera.first().point(Vec3::ZERO), Vec3::new(0.0, 0.0, 5.0));
    assert_eq!(scene.lights[0].group.layers[0].to_world.first().point(Vec3::ZERO), Vec3::ZERO);
    assert_eq!(origin(&scene, 0), Vec3::X);
    assert_eq!(scene.outputs.len(), 1);
    assert!(run.messages().is_empty());
}

#[test]
fn with_a_camera_the_frame_begins_in_world_space() {
    let mut run = Run::new();
    run.calls([
        Call::PushTransform,
        Call::Translate([0.0, 0.0, -5.0]),
        camera("main"),
        Call::PopTransform,
        Call::Translate([3.0, 0.0, 0.0]),
        light("before", Some("pointlight")),
        Call::World,
        sphere(),
    ]);
    let scene = run.scene();
    assert_eq!(scene.cameras[0].world_to_camera.first().point(Vec3::ZERO), Vec3::new(0.0, 0.0, 5.0));
    assert_eq!(scene.lights[0].group.layers[0].to_world.first().point(Vec3::ZERO), Vec3::new(3.0, 0.0, 0.0));
    assert_eq!(origin(&scene, 0), Vec3::ZERO);
    assert_eq!(scene.primitives[0].attributes.geometry_sets.join(","), "camera,main");
}

#[test]
fn transformations_are_prepended() {
    let mut run = Run::new();
    run.calls([
        Call::World,
        Call::Translate([1.0, 0.0, 0.0]),
        Call::Scale([2.0, 2.0, 2.0]),
        points(&[1.0, 0.0, 0.0]),
    ]);
    let scene = run.scene();
    let m = scene.primitives[0].attributes.to_world.first();
    assert_eq!(m.point(Vec3::X), Vec3::new(3.0, 0.0, 0.0));
}

#[test]
fn stacks_restore_the_state_and_imbalance_is_reported() {
    let mut run = Run::new();
    run.calls([
        Call::World,
        Call::PushAttributes,
        Call::Translate([1.0, 0.0, 0.0]),
        attr("color C", &[1.0, 0.0, 0.0][..]),
        Call::PushTransform,
        Call::Translate([1.0, 0.0, 0.0]),
        sphere(),
        Call::PopTransform,
        sphere(),
        Call::PopAttributes,
        sphere(),
    ]);
    let scene = run.scene();
    assert_eq!([0, 1, 2].map(|i| origin(&scene, i).x), [2.0, 1.0, 0.0]);
    let red = |i: usize| scene.primitives[i].attributes.get(attr::COLOR)[1] == 0.0;
    assert_eq!([red(0), red(1), red(2)], [true, true, false]);
    assert!(run.messages().is_empty());

    for (calls, expected) in [
        (
            vec![Call::PopAttributes],
            "t.pyg:1: error: PopAttributes without PushAttributes: the call is ignored",
        ),
        (vec![Call::PopTransform], "t.pyg:1: error: PopTransform without PushTransform: the call is ignored"),
        (
            vec![
                Call::PushTransform,
                Call::PushAttributes,
                Call::PopTransform,
                Call::PopAttributes,
                Call::PopTransform,
            ],
            "t.pyg:3: error: PopTransform inside a PushAttributes that came later than PushTransform: the call is ignored",
        ),
        (
            vec![Call::PushAttributes, Call::PushTransform, Call::PopAttributes],
            "t.pyg:2: error: PushTransform without PopTransform",
        ),
        (vec![Call::PushAttributes], "t.pyg:1: warning: PushAttributes without PopAttributes"),
    ] {
        let mut run = Run::new();
        run.calls(calls);
        run.state.end();
        assert_eq!(run.message(), expected);
    }
}

#[test]
fn calls_out_of_order_are_errors() {
    let group = || [Call::World, Call::ShaderGroupBegin];
    let table: Vec<(Vec<Call>, &str)> = vec![
        (vec![sphere(), Call::World], "Sphere before World"),
        (vec![Call::Render { camera: None }], "Render before World"),
        (vec![Call::World, Call::World], "World after World"),
        (vec![Call::World, camera("c")], "Camera after World"),
        (vec![Call::ShaderGroupEnd], "ShaderGroupEnd without ShaderGroupBegin"),
        (
            group()
                .into_iter()
                .chain([sphere(), shader("surface", "a", None), Call::ShaderGroupEnd])
                .collect(),
            "Sphere inside a shader group",
        ),
        (vec![Call::Motion([].into())], "Motion without times"),
        (vec![Call::World, attr("float fov", 20.0)], "attribute \"fov\" cannot be set after World"),
        (
            vec![Call::World, attr("int limits:gridsize", 20)],
            "attribute \"limits:gridsize\" cannot be set after World",
        ),
        (vec![attr("string renderer:name", "x")], "can be read, not set"),
        (vec![attr("string filter", "box")], "is a parameter of Output"),
        (vec![attr("int[2] resolution", 20)], "\"resolution\" needs 2 values (int[2]), not 1"),
        (vec![attr("string C", "red")], "\"C\" needs color, not a string"),
        (vec![attr("float opacty", 20.0)], "unknown attribute \"opacty\"; did you mean \"opacity\"?"),
        (vec![attr("user:x", 20.0)], "attribute \"user:x\" needs a type"),
        (vec![attr("string orientation", "outsied")], "cannot be \"outsied\"; did you mean \"outside\"?"),
        (vec![attr("float shadingquality", -1.0)], "cannot be negative"),
        (vec![shader("surfac", "x", None)], "unknown usage \"surfac\"; did you mean \"surface\"?"),
        (vec![Call::LightSwitch { id: "kye".into(), on: true }], "no light \"kye\""),
        (vec![Call::RestoreAttributes { name: "x".into(), attributes: None }], "nothing was saved as \"x\""),
        (
            vec![Call::SetTransform(TransformTarget::Named("wrold".into()))],
            "no coordinate system \"wrold\"; did you mean \"world\"?",
        ),
        (vec![Call::Translate([f32::NAN, 0.0, 0.0])], "numbers that are not finite"),
        (vec![Call::Rotate { angle_deg: 10.0, axis: [0.0; 3] }], "axis of length zero"),
        (vec![Call::Rotate { angle_deg: 10.0, axis: [f32::NAN, 0.0, 1.0] }], "numbers that are not finite"),
        (
            vec![Call::Rotate { angle_deg: 10.0, axis: [0.0, f32::INFINITY, 0.0] }],
            "numbers that are not finite",
        ),
        (
            vec![Call::Command { name: "sytsem ls".into(), params: Params::new() }],
            "unknown command \"sytsem\"; did you mean \"system\"?",
        ),
        (vec![Call::Modify { pattern: "[".into() }], "cannot read the regular expression \"[\""),
        (
            vec![Call::Input { command: "itself".into(), bound: None }],
            "would read itself: itself -> between -> itself",
        ),
        (vec![Call::Input { command: "1".into(), bound: None }], "nested deeper than 64: 1 -> 2 -> 3"),
    ];
    for (calls, expected) in table {
        let mut run = Run::new();
        // The calls are made twice. The second time no new message is reported.
        run.calls(calls);
        assert!(run.message().contains(expected), "{expected}: {}", run.message());
    }
}

#[test]
fn one_message_per_cause_with_the_object_s_name() {
    let mut run = Run::new();
    run.calls([Call::World, name("ball")]);
    run.calls((0..50).map(|_| points(&[0.0, 0.0, 0.0, 0.0, f32::NAN, 0.0])));
    assert_eq!(run.message(), "t.pyg:3: error: Points: \"P\" of vertex 1 is NaN (object \"ball\")");
    assert!(run.scene().primitives.is_empty());
}

#[test]
fn attribute_sets_are_shared() {
    let mut run = Run::new();
    run.calls([Call::World, attr("float shadingquality", 2.0)]);
    run.calls((0..100).map(|_| sphere()));
    run.calls([attr("float shadingquality", 3.0), sphere()]);
    let scene = run.scene();
    let set = |i: usize| &scene.primitives[i].attributes;
    assert!((1..100).all(|i| Arc::ptr_eq(set(0), set(i))));
    assert_eq!((set(0).get(attr::SHADINGQUALITY), set(100).get(attr::SHADINGQUALITY)), (2.0, 3.0));
    // Another transformation shares the values.
    let mut run = Run::new();
    run.calls([
        Call::World,
        attr("float shadingquality", 2.0),
        sphere(),
        Call::Translate([1.0; 3]),
        sphere(),
    ]);
    let scene = run.scene();
    assert!(Arc::ptr_eq(&scene.primitives[0].attributes.values, &scene.primitives[1].attributes.values));
}

#[test]
fn lights_are_switched_replaced_and_removed() {
    let mut run = Run::new();
    run.calls([
        Call::World,
        light("a", Some("pointlight")),
        light("b", Some("pointlight")),
        sphere(),
        Call::LightSwitch { id: "a".into(), on: false },
        sphere(),
        Call::LightSwitch { id: "a".into(), on: true },
        sphere(),
        light("b", None),
        sphere(),
    ]);
    let scene = run.scene();
    let lights = |i: usize| scene.primitives[i].attributes.lights.iter().map(|l| l.0).collect::<Vec<_>>();
    // "b" was removed, also from objects that were declared before.
    assert_eq!([lights(0), lights(1), lights(2), lights(3)], [vec![0], vec![], vec![0], vec![0]]);
    assert!(scene.lights[1].group.layers.is_empty());

    let mut run = Run::new();
    run.calls([Call::World, light("a", Some("x")), sphere(), light("a", Some("y")), light("a", Some("z"))]);
    let scene = run.scene();
    assert_eq!(&*scene.lights[0].group.layers[0].shader, "z");
    assert_eq!(scene.primitives[0].attributes.lights.iter().collect::<Vec<_>>(), [LightId(0)]);
    assert!(run.message().contains("declared again"));
}

#[test]
fn shader_groups_have_their_layers_and_connections() {
    let connect = |from: &str, to: &str| Call::ConnectShaders {
        source_layer: from.into(),
        source: "out".into(),
        target_layer: to.into(),
        target: "Ks".into(),
    };
    let mut run = Run::new();
    run.calls([
        Call::World,
        Call::ShaderGroupBegin,
        shader("surface", "texmap", Some("one")),
        shader("surface", "plastic", Some("two")),
        shader("displacement", "dents", Some("three")),
        connect("one", "two"),
        Call::ShaderGroupEnd,
        sphere(),
        shader("surface", "matte", None),
        Call::Shader { usage: "displacement".into(), name: None, layer: None, params: Params::new() },
        sphere(),
    ]);
    let scene = run.scene();
    let set = &scene.primitives[0].attributes;
    let surface = set.surface.as_ref().unwrap();
    assert_eq!((surface.layers.len(), surface.connections.len()), (2, 1));
    assert_eq!(set.displacement.as_ref().unwrap().layers.len(), 1);
    let set = &scene.primitives[1].attributes;
    assert_eq!(set.surface.as_ref().unwrap().layers.len(), 1);
    assert!(set.displacement.is_none());
    assert!(run.messages().is_empty());

    for (from, to, expected) in [
        ("one", "tow", "no layer \"tow\" in the group; did you mean \"two\"?"),
        ("two", "one", "does not run before"),
        ("one", "three", "different usages"),
    ] {
        let mut run = Run::new();
        run.calls([
            Call::ShaderGroupBegin,
            shader("surface", "texmap", Some("one")),
            shader("surface", "plastic", Some("two")),
            shader("displacement", "dents", Some("three")),
            connect(from, to),
        ]);
        assert!(run.message().contains(expected), "{}", run.message());
    }

    // The layers of a light share its id.
    let layer = |id: &str, layer: &str| Call::Light {
        id: id.into(),
        shader: Some("l".into()),
        layer: Some(layer.into()),
        params: Params::new(),
    };
    let mut run = Run::new();
    run.calls([
        Call::World,
        Call::ShaderGroupBegin,
        layer("key", "a"),
        layer("key", "b"),
        layer("other", "c"),
        Call::ShaderGroupEnd,
        sphere(),
    ]);
    let scene = run.scene();
    assert_eq!((scene.lights.len(), scene.lights[0].group.layers.len()), (1, 2));
    assert!(run.message().contains("in a group that began with light \"key\""));
}

#[test]
fn pending_parameters_go_to_the_next_call_that_takes_them() {
    let param = |d: &str, v: f32| Param::declared(d, v).unwrap();
    let mut run = Run::new();
    run.calls([
        Call::World,
        Call::Parameter(param("float Kd", 0.5)),
        Call::Parameter(param("float Ks", 0.5)),
        Call::PushTransform,
        Call::Shader {
            usage: "surface".into(),
            name: Some("plastic".into()),
            layer: None,
            params: [param("float Ks", 0.25)].into_iter().collect(),
        },
        Call::PopTransform,
        sphere(),
    ]);
    let scene = run.scene();
    let params = &scene.primitives[0].attributes.surface.as_ref().unwrap().layers[0].params;
    assert_eq!((params.float("Kd"), params.float("Ks")), (Some(0.5), Some(0.25)));
    assert!(scene.primitives[0].keys[0].params.is_empty());

    let mut run = Run::new();
    run.calls([Call::Parameter(param("float Kd", 0.5))]);
    run.state.end();
    assert_eq!(run.message(), "warning: no call took the parameters \"Kd\"");
}

#[test]
fn objects_without_a_frame_are_given_one() {
    let mut run = Run::new();
    let red = attr("color C", [1.0, 0.0, 0.0].as_slice());
    let ball = |place: [f32; 3]| [Call::PushTransform, Call::Translate(place), sphere(), Call::PopTransform];
    run.calls([red].into_iter().chain(ball([5.0, 0.0, 0.0])));
    assert!(run.state.lacks_frame());
    run.state.begin_stage().unwrap();
    let points = run.state.staged_points();
    let low = points.iter().map(|(p, _)| p.x).fold(f32::MAX, f32::min);
    let high = points.iter().map(|(p, _)| p.x).fold(f32::MIN, f32::max);
    assert!((low - 4.0).abs() < 1e-4 && (high - 6.0).abs() < 1e-4, "{low} {high}");
    run.calls([
        camera("eye"),
        Call::World,
        light("key", Some("distantlight")),
        attr("string name", "studio"),
        sphere(),
    ]);
    run.calls([attr("string name", ""), attr("color C", [0.0, 0.0, 1.0].as_slice())]);
    run.calls([attr("string geometryset", "+cast"), shader("surface", "plain", None)]);
    run.state.adopt();
    let scene = run.scene();
    let [ball, floor] = &scene.primitives[..] else { panic!("{}", scene.primitives.len()) };
    // The object keeps what it has, and takes what it lacks.
    assert_eq!(ball.attributes.get(granita_scene::attr::COLOR), granita_base::Color::new(1.0, 0.0, 0.0));
    assert_eq!(&*ball.attributes.surface.as_ref().unwrap().layers[0].shader, "plain");
    assert!(
        ball.attributes.lights.len() == 1 && ball.attributes.geometry_sets.iter().any(|s| &**s == "cast")
    );
    assert!(
        floor.attributes.surface.is_none() && floor.attributes.geometry_sets.iter().all(|s| &**s != "cast")
    );
    // A turn takes the camera, and what has the name.
    let mut turned = (*scene).clone();
    turned.turn_around("studio", &granita_base::Transform::translate(granita_base::Vec3::Y));
    let moved =
        |p: &granita_scene::Primitive| p.attributes.to_world.first().point(granita_base::Vec3::ZERO).y;
    assert_eq!((moved(&turned.primitives[0]), moved(&turned.primitives[1])), (0.0, 1.0));
    assert_eq!(turned.cameras[0].world_to_camera.first().point(granita_base::Vec3::Y).y, 0.0);
}

#[test]
fn a_scene_that_describes_a_frame_is_left_alone() {
    for (calls, lacks) in [
        (vec![], false),
        (vec![sphere()], true),
        (vec![Call::World, sphere()], true),
        (vec![camera("eye"), Call::World, sphere()], false),
        (vec![Call::Translate([0.0, 0.0, 1.0]), Call::World, sphere()], false),
        (vec![Call::World, sphere(), Call::Render { camera: None }], false),
        (vec![Call::World], false),
    ] {
        let mut run = Run::new();
        run.calls(calls.clone());
        assert_eq!(run.state.lacks_frame(), lacks, "{calls:?}");
    }
}
