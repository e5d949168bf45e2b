// tidy: tests
//! The state machine from outside: calls in, scene and messages out.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test, with a line number")]

use granita_base::{
    BaseType, Location, Param, ParamData, Params, Reporter, ShapeDesc, Transform, TrimDesc, Vec3,
};
use granita_scene::{
    Call, FoundInput, FrameRenderer, InputPaths, InputReader, LightId, Scene, SceneSink, State, Stop,
    TransformTarget,
};
use std::sync::{Arc, Mutex};

/// Keeps the scenes that it is given.
#[derive(Clone, Default)]
struct Keeper(Arc<Mutex<Vec<Rendered>>>);

/// A scene and the camera asked for.
type Rendered = (Arc<Scene>, Option<String>);

impl FrameRenderer for Keeper {
    fn render(&mut self, scene: Arc<Scene>, camera: Option<&str>) -> Result<(), Stop> {
        self.0.lock().unwrap().push((scene, camera.map(str::to_owned)));
        Ok(())
    }
    fn command(&mut self, name: &str, _: &Params, _: &Location) -> Result<bool, Stop> {
        Ok(name.starts_with("system"))
    }
    fn input(
        &mut self,
        command: &str,
        paths: InputPaths<'_>,
        _: &Location,
    ) -> Result<Option<FoundInput>, Stop> {
        assert!(paths.input.starts_with(".") && paths.generator.starts_with("."));
        let found = |reader: InputReader| Some(FoundInput { identity: command.into(), bound: None, reader });
        let again = |command: String| -> InputReader {
            Box::new(move |sink| {
                sink.call(Call::Input { command: command.into(), bound: None }, &Location::default())
            })
        };
        Ok(match command {
            "move" => {
                found(Box::new(|sink| sink.call(Call::Translate([7.0, 0.0, 0.0]), &Location::default())))
            }
            "itself" => found(again("between".to_owned())),
            "between" => found(again("itself".to_owned())),
            number => number.parse::<u32>().ok().and_then(|n| found(again((n + 1).to_string()))),
        })
    }
}

struct Run {
    state: State,
    kept: Keeper,
    messages: Arc<Mutex<Vec<granita_base::report::Message>>>,
    line: u32,
}

impl Run {
    fn new() -> Self {
        let kept = Keeper::default();
        let (reporter, messages) = Reporter::collecting();
        Self { state: State::new(Box::new(kept.clone()), reporter), kept, messages, line: 0 }
    }

    fn calls(&mut self, calls: impl IntoIterator<Item = Call>) -> &mut Self {
        for call in calls {
            self.line += 1;
            self.state.call(call, &Location::line(&"t.pyg".into(), self.line)).unwrap();
        }
        self
    }

    fn messages(&self) -> Vec<String> {
        self.messages.lock().unwrap().iter().map(ToString::to_string).collect()
    }

    /// The only message.
    fn message(&self) -> String {
        let all = self.messages();
        assert_eq!(all.len(), 1, "{all:?}");
        all[0].clone()
    }

    fn scene(&mut self) -> Arc<Scene> {
        self.calls([Call::Render { camera: None }]);
        self.kept.0.lock().unwrap().last().unwrap().0.clone()
    }
}

fn attr(declaration: &str, data: impl Into<ParamData>) -> Call {
    Call::Attribute(Param::declared(declaration, data).unwrap())
}

fn sphere() -> Call {
    let shape = ShapeDesc::Sphere { radius: 1.0, zmin: -1.0, zmax: 1.0, thetamax_deg: 360.0 };
    Call::Shape { shape: Box::new(shape), params: Params::new() }
}

fn points(p: &[f32]) -> Call {
    let params = [Param::declared("vertex point P", p).unwrap()].into_iter().collect();
    Call::Shape { shape: Box::new(ShapeDesc::Points { n: p.len() / 3 }), params }
}

fn camera(name: &str) -> Call {
    Call::Camera { name: name.into(), params: Params::new() }
}

fn light(id: &str, shader: Option<&str>) -> Call {
    Call::Light { id: id.into(), shader: shader.map(Into::into), layer: None, params: Params::new() }
}

fn shader(usage: &str, name: &str, layer: Option<&str>) -> Call {
    Call::Shader {
        usage: usage.into(),
        name: Some(name.into()),
        layer: layer.map(Into::into),
        params: Params::new(),
    }
}

fn name(n: &str) -> Call {
    attr("string name", n)
}

fn origin(scene: &Scene, i: usize) -> Vec3 {
    scene.primitives[i].attributes.to_world.first().point(Vec3::ZERO)
}

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
    // World stands 5 in front of the camera; the light, declared before World, at world's origin.
    assert_eq!(scene.cameras[0].world_to_camera.first().point(Vec3::ZERO), Vec3::new(0.0, 0.0, 5.0));
    assert_eq!(scene.lights[0].group.layers[0].to_world.first().point(Vec3::ZERO), Vec3::ZERO);
    assert_eq!(origin(&scene, 0), Vec3::X);
    assert_eq!(scene.outputs.len(), 1);
    assert!(run.messages().is_empty());
}

#[test]
fn with_a_camera_it_begins_in_world_space() {
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
fn transformations_prepend() {
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
fn stacks_restore_and_imbalance_is_told() {
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
    let red = |i: usize| scene.primitives[i].attributes.floats("C")[1] == 0.0;
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
fn calls_out_of_place() {
    let group = || [Call::World, Call::ShaderGroupBegin];
    let table: Vec<(Vec<Call>, &str)> = vec![
        (vec![sphere()], "Sphere before World"),
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
        (vec![attr("string renderer:name", "x")], "can be asked for, not set"),
        (vec![attr("string filter", "box")], "is a parameter of Output"),
        (vec![attr("int[2] resolution", 20)], "\"resolution\" wants 2 values (int[2]), not 1"),
        (vec![attr("string C", "red")], "\"C\" wants color, not a string"),
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
        // Twice: the second time nothing new is told.
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
    assert_eq!((set(0).float("shadingquality"), set(100).float("shadingquality")), (2.0, 3.0));
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
fn lights_switch_replace_and_vanish() {
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
    // "b" was removed, also from objects declared before.
    assert_eq!([lights(0), lights(1), lights(2), lights(3)], [vec![0], vec![], vec![0], vec![0]]);
    assert!(scene.lights[1].group.layers.is_empty());

    let mut run = Run::new();
    run.calls([Call::World, light("a", Some("x")), sphere(), light("a", Some("y")), light("a", Some("z"))]);
    let scene = run.scene();
    assert_eq!(&*scene.lights[0].group.layers[0].shader, "z");
    assert_eq!(scene.primitives[0].attributes.lights[..], [LightId(0)]);
    assert!(run.message().contains("declared again"));
}

#[test]
fn shader_groups_and_connections() {
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

    // Layers of a light share its id.
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
fn motion_blocks_of_transformations() {
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
fn motion_of_every_kind_and_several_segments() {
    let shift = |x: f32| {
        let mut m = Box::new([0.0; 16]);
        (0..4).for_each(|i| m[5 * i] = 1.0);
        m[12] = x;
        m
    };
    let set = |x: f32| Call::SetTransform(TransformTarget::Matrix(shift(x)));
    let append = |x: f32| Call::AppendTransform(shift(x));
    // Times may lie anywhere; the shutter does not limit them. After 4 nothing moves.
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
    // Two blocks with different times on one object, and a camera that moves.
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
fn motion_blocks_of_primitives() {
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
fn orientation_and_handedness() {
    let flip = |calls: Vec<Call>| {
        let mut run = Run::new();
        // The camera's world is mirrored: lh and rh refer to camera space.
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
    // Object to camera has a negative determinant: lh is as inside.
    assert!(flip(vec![orient("lh")]));
    assert!(!flip(vec![orient("rh")]));
    // Mirrored once more it is positive: lh is as outside, which is flipped in a mirrored space.
    assert!(flip(vec![orient("lh"), mirror()]));
    assert!(!flip(vec![orient("lh"), orient("reverse")]));
}

#[test]
fn saving_and_restoring() {
    let save = |name: &str, items: Option<&str>| Call::SaveAttributes {
        name: name.into(),
        attributes: items.map(Into::into),
    };
    let restore = |name: &str, items: Option<&str>| Call::RestoreAttributes {
        name: name.into(),
        attributes: items.map(Into::into),
    };
    let mut run = Run::new();
    run.calls([
        Call::World,
        Call::Translate([1.0, 0.0, 0.0]),
        attr("color C", &[1.0, 0.0, 0.0][..]),
        attr("float user:temperature", 98.6),
        shader("surface", "matte", None),
        save("arm", None),
        save("look", Some("shaders, C")),
        Call::SetTransform(TransformTarget::Named("world".into())),
        attr("color C", &[0.0, 1.0, 0.0][..]),
        shader("surface", "plastic", None),
        Call::PushAttributes,
        restore("look", None),
        sphere(),
        Call::PopAttributes,
        restore("arm", Some("transform,user")),
        sphere(),
        restore("arm", None),
        sphere(),
        Call::SetTransform(TransformTarget::Named("world".into())),
        Call::SetTransform(TransformTarget::Named("arm".into())),
        sphere(),
    ]);
    let scene = run.scene();
    let look = |i: usize| {
        let set = &scene.primitives[i].attributes;
        let shader = set.surface.as_ref().unwrap().layers[0].shader.to_string();
        (origin(&scene, i).x, set.floats("C")[0], shader, set.float("user:temperature"))
    };
    assert_eq!(look(0), (0.0, 1.0, "matte".into(), 98.6));
    assert_eq!(look(1), (1.0, 0.0, "plastic".into(), 98.6));
    assert_eq!(look(2), (1.0, 1.0, "matte".into(), 98.6));
    assert_eq!(look(3).0, 1.0);
    // Only states with their transformation are coordinate systems.
    assert_eq!(scene.coordinate_systems.keys().map(|k| &**k).collect::<Vec<_>>(), ["arm"]);
    assert!(run.messages().is_empty(), "{:?}", run.messages());

    let mut run = Run::new();
    run.calls([save("x", Some("C, opacty")), restore("x", Some("C,opacity"))]);
    let told = run.messages();
    assert!(told[0].contains("\"opacty\"; did you mean \"opacity\"?"), "{told:?}");
    assert!(told[1].contains("\"opacity\" was not saved as part of \"x\""), "{told:?}");
}

#[test]
fn parts_of_the_state_are_saved_apart() {
    let trim = || TrimDesc {
        ncurves: [1].into(),
        n: [4].into(),
        order: [2].into(),
        knots: [0.0, 0.0, 1.0, 2.0, 3.0, 3.0].into(),
        min: [0.0].into(),
        max: [3.0].into(),
        uvw: [0.0, 0.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 1.0].into(),
    };
    let all = [
        "transform",
        "surface",
        "displacement",
        "volume",
        "lights",
        "trimcurve",
        "user:x",
        "name",
        "geometryset",
    ];
    let of = |set: &granita_scene::AttributeSet| {
        [
            set.to_world.first().point(Vec3::ZERO).x == 1.0,
            set.surface.is_some(),
            set.displacement.is_some(),
            set.volume.is_some(),
            set.lights.len() == 1,
            set.trim.is_some(),
            set.float("user:x") == 2.0,
            &*set.name() == "thing",
            set.geometry_sets.len() == 2,
        ]
    };
    let groups = [("shaders", &all[1..4]), ("user", &all[6..7])];
    let cases = all.iter().map(|item| (*item, std::slice::from_ref(item))).chain(groups);
    for (item, parts) in cases {
        let mut run = Run::new();
        run.calls([
            Call::World,
            light("key", Some("pointlight")),
            Call::LightSwitch { id: "key".into(), on: false },
            Call::PushAttributes,
            Call::Translate([1.0, 0.0, 0.0]),
            shader("surface", "a", None),
            shader("displacement", "b", None),
            shader("atmosphere", "c", None),
            Call::LightSwitch { id: "key".into(), on: true },
            Call::TrimCurve(Some(Box::new(trim()))),
            attr("float user:x", 2.0),
            name("thing"),
            attr("string geometryset", "+mirror"),
            Call::SaveAttributes { name: "part".into(), attributes: Some(item.into()) },
            Call::SaveAttributes { name: "whole".into(), attributes: None },
            Call::PopAttributes,
        ]);
        for restore in [("part", None), ("part", Some(item)), ("whole", Some(item))] {
            let (saved, attributes) = (restore.0.into(), restore.1.map(Into::into));
            run.calls([
                Call::PushAttributes,
                Call::RestoreAttributes { name: saved, attributes },
                sphere(),
                Call::PopAttributes,
            ]);
        }
        let scene = run.scene();
        assert!(run.messages().is_empty(), "{:?}", run.messages());
        for primitive in &scene.primitives {
            let expected = all.map(|part| parts.contains(&part));
            assert_eq!(of(&primitive.attributes), expected, "{item}");
        }
    }
}

#[test]
fn modify_everything_and_what_comes_later() {
    let mut run = Run::new();
    let save = |n: &str| Call::SaveAttributes { name: n.into(), attributes: None };
    run.calls([
        Call::World,
        name("a1"),
        sphere(),
        save("first"),
        name("b"),
        sphere(),
        Call::PushAttributes,
        // Without a pattern everything changes, whatever its name, saved states too.
        Call::Modify { pattern: "".into() },
        attr("float shadingquality", 0.5),
        // Another call replaces what is being modified.
        Call::Modify { pattern: "^a[0-9]\\{1,2\\}$".into() },
        attr("int twosided", 0),
        // Attributes of the current state do not change (its name is "b"), nor those of what it makes.
        sphere(),
        attr("int holdout", 1),
        Call::PopAttributes,
        Call::RestoreAttributes { name: "first".into(), attributes: None },
        sphere(),
        // Now the current state and what it makes are called "a1" and change.
        Call::Modify { pattern: "a1".into() },
        sphere(),
        attr("float dice:curvature", 3.0),
        attr("string name", "renamed"),
    ]);
    let scene = run.scene();
    let state = |i: usize| {
        let set = &scene.primitives[i].attributes;
        let numbers = (set.float("shadingquality"), set.int("twosided"), set.int("holdout"));
        (set.name().to_string(), numbers, set.float("dice:curvature"))
    };
    assert_eq!(state(0), ("renamed".into(), (0.5, 0, 1), 3.0));
    assert_eq!(state(1), ("b".into(), (0.5, 1, 0), 10.0));
    assert_eq!(state(2), ("b".into(), (0.5, 1, 0), 10.0));
    assert_eq!(state(3), ("renamed".into(), (0.5, 0, 1), 3.0));
    assert_eq!(state(4), ("renamed".into(), (0.5, 0, 1), 3.0));
    assert!(run.messages().is_empty(), "{:?}", run.messages());
}

#[test]
fn modify_reaches_declared_objects() {
    let mut run = Run::new();
    run.calls([
        Call::World,
        light("rim", Some("pointlight")),
        name("obj1"),
        sphere(),
        name("obj2"),
        sphere(),
        sphere(),
        Call::PushAttributes,
        Call::Modify { pattern: "^obj2$".into() },
        Call::LightSwitch { id: "rim".into(), on: false },
        Call::Translate([1.0, 0.0, 0.0]),
        attr("color C", &[0.0, 0.0, 0.0][..]),
        Call::PopAttributes,
        attr("color C", &[0.5, 0.5, 0.5][..]),
        sphere(),
    ]);
    let scene = run.scene();
    let state = |i: usize| {
        let set = &scene.primitives[i].attributes;
        (set.lights.len(), origin(&scene, i).x, set.floats("C")[0])
    };
    assert_eq!(state(0), (1, 0.0, 1.0));
    assert_eq!(state(1), (0, 1.0, 0.0));
    assert_eq!(state(2), (0, 1.0, 0.0));
    // The current state was modified too, and restored by the pop.
    assert_eq!(state(3), (1, 0.0, 0.5));
    assert!(Arc::ptr_eq(&scene.primitives[1].attributes, &scene.primitives[2].attributes));
}

#[test]
fn cameras_outputs_and_render() {
    let output = |name: &str, format: &str, camera: &str| Call::Output {
        name: name.into(),
        format: format.into(),
        data: "rgba".into(),
        camera: camera.into(),
        params: [Param::declared("float[4] quantize", &[0.0, 65535.0, 0.0, 65535.0][..]).unwrap()]
            .into_iter()
            .collect(),
    };
    let mut run = Run::new();
    run.calls([
        attr("float fov", 30.0),
        attr("int[2] resolution", &[64, 48][..]),
        Call::Camera {
            name: "main".into(),
            params: [Param::declared("fov", 45).unwrap(), Param::declared("float nera", 1.0).unwrap()]
                .into_iter()
                .collect(),
        },
        output("a.tif", "tiff", "main"),
        output("a.tif", "OpenEXR", "main"),
        output("b.tif", "tiff", "main"),
        output("b.tif", "null", "main"),
        output("c.tif", "tiff", ""),
        Call::World,
        Call::Render { camera: Some("mian".into()) },
    ]);
    let kept = run.kept.0.lock().unwrap();
    let (scene, wanted) = &kept[0];
    assert_eq!(*wanted, None);
    let c = &scene.cameras[0];
    assert_eq!((c.params.float("fov"), c.resolution()), (Some(45.0), [64, 48]));
    assert_eq!(c.params.float("near"), Some(0.1));
    assert!(c.params.get("screen").is_none());
    let outputs: Vec<_> = scene.outputs.iter().map(|o| (&*o.name, &*o.format, &*o.camera)).collect();
    assert_eq!(outputs, [("a.tif", "OpenEXR", "main"), ("c.tif", "tiff", "main")]);
    assert_eq!(
        scene.outputs[0].params.get("quantize").unwrap().data,
        ParamData::from(&[0, 65535, 0, 65535][..])
    );
    let told = run.messages();
    assert!(told[0].contains("unknown parameter \"nera\"; did you mean \"near\"?"), "{told:?}");
    assert!(told[1].contains("no camera \"mian\"; did you mean \"main\"?"), "{told:?}");
}

#[test]
fn after_render() {
    let mut run = Run::new();
    run.calls([
        Call::World,
        sphere(),
        Call::Render { camera: None },
        sphere(),
        sphere(),
        Call::Comment("c".into()),
    ]);
    assert!(run.message().contains("Sphere after Render"));
    assert_eq!(run.state.attribute("float render:progress").unwrap().data, ParamData::from(1.0));

    let mut run = Run::new();
    run.calls([
        attr("int rerender", 1),
        Call::World,
        sphere(),
        Call::Translate([4.0, 0.0, 0.0]),
        Call::Render { camera: None },
        attr("int limits:gridsize", 64),
        Call::World,
        sphere(),
        Call::Render { camera: None },
    ]);
    let kept = run.kept.0.lock().unwrap();
    assert_eq!((kept[0].0.primitives.len(), kept[1].0.primitives.len()), (1, 2));
    assert_eq!(origin(&kept[1].0, 1), Vec3::ZERO);
    assert_eq!(kept[1].0.int("limits:gridsize"), 64);
    assert!(run.messages().is_empty());
}

#[test]
fn attributes_can_be_asked_for() {
    let mut run = Run::new();
    run.calls([
        attr("float fov", 30.0),
        attr("string path:shader", "/a:&"),
        attr("string spatialdb:read", "a.sdb"),
        attr("string spatialdb:read", "b.sdb"),
        attr("string geometryset", "+mirror"),
        Call::Translate([1.0, 2.0, 3.0]),
    ]);
    let floats = |d: &str| run.state.attribute(d).unwrap().data.to_floats().unwrap().to_vec();
    let text = |d: &str| match run.state.attribute(d).unwrap().data {
        ParamData::String(v) => v.join(";"),
        _ => panic!("{d}"),
    };
    assert_eq!(floats("float fov"), [30.0]);
    assert_eq!(floats("int[2] resolution"), [640.0, 480.0]);
    assert_eq!(floats("transform")[12..15], [1.0, 2.0, 3.0]);
    assert_eq!(text("path:shader"), "/a:.:$GELATOHOME/shaders");
    assert_eq!(text("string spatialdb:read"), "a.sdb;b.sdb");
    assert_eq!(text("geometryset"), "camera,mirror");
    assert_eq!(text("renderer:name"), "Granita");
    assert_eq!(floats("int[4] renderer:version").len(), 4);
    assert_eq!(floats("color C"), [1.0; 3]);
    assert!(run.state.attribute("int fov").is_none());
    assert!(run.state.attribute("float no:such").is_none());
    assert!(run.state.attribute("focallength").is_none());
    assert_eq!(floats("float[4] screen"), [-640.0 / 480.0, 640.0 / 480.0, -1.0, 1.0]);
}

#[test]
fn inputs_with_a_bound_leave_no_traces() {
    let input = |bound| Call::Input { command: "move".into(), bound };
    let mut run = Run::new();
    run.calls([Call::World, input(Some([0.0; 6])), sphere(), input(None), sphere()]);
    let scene = run.scene();
    assert_eq!([0, 1].map(|i| origin(&scene, i).x), [0.0, 7.0]);
}

#[test]
fn named_spaces() {
    let named = |n: &str| Call::SetTransform(TransformTarget::Named(n.into()));
    let mut run = Run::new();
    run.calls([
        Call::Translate([0.0, 0.0, 5.0]),
        Call::World,
        Call::Translate([1.0, 1.0, 1.0]),
        named("camera"),
        sphere(),
        named("raster"),
        sphere(),
    ]);
    let scene = run.scene();
    assert_eq!(origin(&scene, 0), Vec3::new(0.0, 0.0, -5.0));
    // A raster position comes back to where the camera sees it.
    let p = Vec3::new(0.3, -0.2, 2.0);
    let c = &scene.cameras[0];
    let raster = c.camera_to_raster().point(c.world_to_camera.first().point(p));
    let back = scene.primitives[1].attributes.to_world.first().point(raster);
    assert!((back - p).length() < 1e-3, "{back}");
}

#[test]
fn trim_curves_are_checked() {
    let trim = |n: &[i32]| TrimDesc {
        ncurves: [1].into(),
        n: n.into(),
        order: [2].into(),
        knots: [0.0, 0.0, 1.0, 1.0].into(),
        min: [0.0].into(),
        max: [1.0].into(),
        uvw: [0.0; 6].into(),
    };
    let mut run = Run::new();
    run.calls([Call::World, Call::TrimCurve(Some(Box::new(trim(&[2])))), sphere()]);
    run.calls([Call::TrimCurve(Some(Box::new(trim(&[3])))), sphere(), Call::TrimCurve(None), sphere()]);
    let scene = run.scene();
    let has = |i: usize| scene.primitives[i].attributes.trim.is_some();
    assert_eq!([has(0), has(1), has(2)], [true, true, false]);
    assert!(run.message().contains("4 knots where 5 are needed"));
}

#[test]
fn undeclared_parameters_of_primitives() {
    let params = |list: &[(&str, &[f32])]| {
        list.iter().map(|(d, v)| Param::declared(d, *v).unwrap()).collect::<Params>()
    };
    let shape = |p: Params| Call::Shape { shape: Box::new(ShapeDesc::Points { n: 2 }), params: p };
    let mut run = Run::new();
    run.calls([
        Call::World,
        shape(params(&[("P", &[0.0; 6]), ("width", &[1.0, 2.0]), ("C", &[1.0; 3]), ("foo", &[1.0])])),
    ]);
    let scene = run.scene();
    let types: Vec<String> = scene.primitives[0].keys[0].params.iter().map(Param::declaration).collect();
    assert_eq!(types, ["vertex point P", "vertex float width", "color C"]);
    assert_eq!(scene.primitives[0].keys[0].params.get("P").unwrap().ty.base, BaseType::Point);
    assert!(run.message().contains("parameter \"foo\" needs a type"));
}

#[test]
fn faces_with_attributes_of_their_own() {
    let save = |name: &str, items: Option<&str>| Call::SaveAttributes {
        name: name.into(),
        attributes: items.map(Into::into),
    };
    let mesh = |names: Vec<Param>| {
        let mut params: Params = names.into_iter().collect();
        params.set(Param::declared("vertex point P", &[0.0; 12][..]).unwrap());
        params.set(Param::declared("int[1] holes", 3).unwrap());
        let nverts: Arc<[i32]> = [3, 3, 3, 3].into();
        let verts: Arc<[i32]> = [0, 1, 2, 1, 2, 3, 2, 3, 0, 3, 0, 1].into();
        Call::Shape { shape: Box::new(ShapeDesc::Mesh { subdivide: true, nverts, verts }), params }
    };
    let strings = |d: &str, v: &[&str]| {
        let data = ParamData::String(v.iter().map(|s| Arc::from(*s)).collect());
        Param::declared(d, data).unwrap()
    };
    let index = Param::declared("perpiece int __attributesindex", &[1, 0, 1, 0][..]).unwrap();
    for names in [
        vec![strings("perpiece string __attributes", &["b", "a", "b", "a"])],
        vec![strings("string[2] __attributes", &["a", "b"]), index],
    ] {
        let mut run = Run::new();
        run.calls([
            Call::World,
            Call::PushAttributes,
            Call::Translate([9.0, 0.0, 0.0]),
            shader("surface", "one", None),
            save("a", None),
            shader("surface", "two", None),
            save("b", Some("shaders")),
            Call::PopAttributes,
            mesh(names),
        ]);
        let scene = run.scene();
        assert_eq!(scene.primitives.len(), 2);
        let part = |i: usize| {
            let p = &scene.primitives[i];
            let holes = p.keys[0].params.get("holes").unwrap().data.to_ints().unwrap().to_vec();
            assert!(p.keys[0].params.get("__attributes").is_none());
            (p.attributes.surface.as_ref().unwrap().layers[0].shader.to_string(), holes)
        };
        assert_eq!(part(0), ("two".into(), vec![1, 3]));
        assert_eq!(part(1), ("one".into(), vec![0, 2, 3]));
        assert_eq!([0, 1].map(|i| origin(&scene, i).x), [0.0; 2]);
        assert!(run.messages().is_empty());
    }
    for (names, expected) in [
        (strings("perpiece string __attributes", &["x", "x", "x", "x"]), "no attributes were saved as \"x\""),
        (strings("perpiece string __attributes", &["x"]), "1 values of \"__attributes\" for 4 faces"),
    ] {
        let mut run = Run::new();
        run.calls([Call::World, mesh(vec![names])]);
        assert_eq!(run.scene().primitives.len(), 1);
        assert!(run.message().contains(expected), "{}", run.message());
    }
}

#[test]
fn a_singular_camera_is_told() {
    let mut run = Run::new();
    run.calls([Call::Scale([1.0, 1.0, 0.0]), Call::World, sphere()]);
    assert!(run.message().contains("cannot be inverted"));
    let scene = run.scene();
    assert_eq!(*scene.primitives[0].attributes.to_world.first(), Transform::IDENTITY);
}

#[test]
fn exit_stops() {
    let mut run = Run::new();
    let exit = Call::Command { name: "exit".into(), params: Params::new() };
    assert!(matches!(run.state.call(exit, &Location::default()), Err(Stop::Exit)));
}

/// The names, types and defaults of the reference's list.
#[test]
fn the_table_is_the_reference_s() {
    use granita_scene::attribute::{DefaultValue, Scope};
    let list = include_str!("data/attributes.tsv");
    let mut seen = 0;
    for line in list.lines() {
        let mut columns = line.split('\t');
        let (scope, declaration) = (columns.next().unwrap(), columns.next().unwrap());
        let default = columns.next().unwrap_or("");
        let (ty, name) = granita_base::ParamType::parse(declaration).unwrap();
        let row = granita_scene::attribute_row(&name).unwrap_or_else(|| panic!("no row for {name}"));
        assert_eq!(row.ty, ty, "{name}");
        let scopes: &[Scope] = match scope {
            "camera" => &[Scope::Camera],
            "output" => &[Scope::Output],
            "scene" => &[Scope::Global, Scope::Writer, Scope::ReadOnly],
            _ => &[Scope::Object, Scope::ReadOnly],
        };
        assert!(scopes.contains(&row.scope), "{name}");
        match row.default {
            _ if default.is_empty() => assert_eq!(row.default, DefaultValue::Unset, "{name}"),
            DefaultValue::Text(text) => assert_eq!(text, default.trim_matches('"'), "{name}"),
            DefaultValue::Unset => assert_eq!(default, "-", "{name}"),
            DefaultValue::Floats(v) => {
                let want: Vec<f32> = default.split(' ').map(|w| w.parse().unwrap()).collect();
                assert_eq!(v, want, "{name}");
            }
            DefaultValue::Ints(v) => {
                let want: Vec<i32> = default.split(' ').map(|w| w.parse().unwrap()).collect();
                assert_eq!(v, want, "{name}");
            }
        }
        seen += 1;
    }
    // Nothing in the table that is not in the list.
    assert_eq!(seen, granita_scene::attribute::TABLE.len());
}
