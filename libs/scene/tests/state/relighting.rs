//! Tests of the idioms of re-rendering (reference 11.2 and 11.3): lights, crops, antialiasing and locked shading.

use crate::fixture::*;
use granita_base::{Param, Params, Vec3};
use granita_scene::{Call, Scene, TransformTarget, attr};
use std::sync::Arc;

/// Returns a scene with a camera, a light "fill" and four objects, and renders its first frame.
fn scene() -> Run {
    let mut run = Run::new();
    run.calls([
        attr("int rerender", 1),
        Call::Translate([0.0, 1.0, -6.0]),
        camera_with("maincam", &[("int[2] resolution", &[640.0, 480.0]), ("float fov", &[35.0])]),
        Call::World,
        light("fill", Some("pointlight")),
    ]);
    for object in ["truck", "car", "truck41/fender/left", "truck42/taillight/lens"] {
        run.calls([name(object), sphere()]);
    }
    run.scene();
    run
}

impl Run {
    /// Makes a frame of these calls after `World`, and returns its scene. No message is expected.
    fn relit(&mut self, calls: impl IntoIterator<Item = Call>) -> Arc<Scene> {
        self.calls([Call::World]).calls(calls);
        let scene = self.scene();
        assert_eq!(self.messages(), Vec::<String>::new());
        scene
    }
}

fn params(list: &[(&str, &[f32])]) -> Params {
    list.iter().map(|(declaration, values)| Param::declared(declaration, *values).unwrap()).collect()
}

fn camera_with(name: &str, list: &[(&str, &[f32])]) -> Call {
    Call::Camera { name: name.into(), params: params(list) }
}

fn modify(pattern: &str) -> Call {
    Call::Modify { pattern: pattern.into() }
}

fn switch(id: &str, on: bool) -> Call {
    Call::LightSwitch { id: id.into(), on }
}

fn placed(origin: [f32; 3]) -> Call {
    let [x, y, z] = origin;
    let m = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, x, y, z, 1.0];
    Call::SetTransform(TransformTarget::Matrix(Box::new(m)))
}

/// Returns the calls of a light at a place, with an intensity.
fn light_at(id: &str, origin: [f32; 3], intensity: f32) -> Vec<Call> {
    let params = params(&[("float intensity", &[intensity]), ("float falloff", &[2.0])]);
    let light = Call::Light { id: id.into(), shader: Some("spotlight".into()), layer: None, params };
    vec![Call::PushTransform, placed(origin), light, Call::PopTransform]
}

/// Returns the names of the lights that shine on each object.
fn lit(scene: &Scene) -> Vec<String> {
    let names = |lights: &granita_scene::LightSet| {
        let names: Vec<String> =
            lights.iter().map(|id| scene.lights[id.0 as usize].name.to_string()).collect();
        names.join(" ")
    };
    scene.primitives.iter().map(|p| names(&p.attributes.lights)).collect()
}

/// Returns the intensity and the place of a light.
fn state_of(scene: &Scene, id: &str) -> (Option<f32>, Vec3) {
    let light =
        scene.lights.iter().find(|light| &*light.name == id && !light.group.layers.is_empty()).unwrap();
    let layer = &light.group.layers[0];
    (layer.params.float("intensity"), layer.to_world.first().point(Vec3::ZERO))
}

#[test]
fn a_light_is_switched_for_some_objects() {
    let mut run = scene();
    let dark = run.relit([modify("truck"), switch("fill", false)]);
    assert_eq!(lit(&dark), ["", "fill", "", ""]);
    // The extended expression of the reference needs no backslashes.
    let parts = run.relit([modify("^truck4[0-9]/(fender)|(taillight)/.*"), switch("fill", true)]);
    assert_eq!(lit(&parts), ["", "fill", "fill", "fill"]);
    // Without further changes the scene stays the same, whether or not there is `World`.
    let same = run.relit([]);
    assert_eq!(same.primitives, parts.primitives);
    assert_eq!(run.scene().primitives, parts.primitives);
}

#[test]
fn an_added_light_shines_on_objects_that_are_switched() {
    let mut run = scene();
    let added = run.relit(light_at("key", [0.0, 0.0, -5.0], 10.0));
    assert_eq!(lit(&added), ["fill"; 4]);
    assert_eq!(state_of(&added, "key"), (Some(10.0), Vec3::new(0.0, 0.0, -5.0)));
    let all = run.relit([modify(""), switch("key", true)]);
    assert_eq!(lit(&all), ["fill key"; 4]);
    // Both in one frame, as the reference has it. The light may come after `Modify`, and objects stay where they are.
    let mut calls = light_at("rim", [1.0, 0.0, 0.0], 1.0);
    calls.extend([modify("car"), switch("rim", true)]);
    calls.extend(light_at("back", [2.0, 0.0, 0.0], 1.0));
    let both = run.relit(calls);
    assert_eq!(lit(&both), ["fill key", "fill key rim", "fill key", "fill key"]);
    assert_eq!(state_of(&both, "back").1, Vec3::new(2.0, 0.0, 0.0));
    assert_eq!(origin(&both, 1), Vec3::ZERO);
}

#[test]
fn a_light_is_emitted_again_with_parameters_and_place() {
    let mut run = scene();
    let mut calls = light_at("key", [0.0, 0.0, -5.0], 10.0);
    calls.extend([modify("car"), switch("key", true)]);
    run.relit(calls);
    let brighter = run.relit(light_at("key", [0.0, 0.0, -5.0], 40.0));
    assert_eq!(state_of(&brighter, "key"), (Some(40.0), Vec3::new(0.0, 0.0, -5.0)));
    let moved = run.relit(light_at("key", [3.0, 0.0, 0.0], 40.0));
    assert_eq!(state_of(&moved, "key"), (Some(40.0), Vec3::new(3.0, 0.0, 0.0)));
    // The switches of objects stay, also when the light is emitted again in modify mode.
    assert_eq!(lit(&moved), ["fill", "fill key", "fill", "fill"]);
    let mut calls = vec![modify("truck"), switch("fill", false)];
    calls.extend(light_at("fill", [0.0; 3], 1.0));
    assert_eq!(lit(&run.relit(calls)), ["", "fill key", "", ""]);
    // Its state is that of the call.
    let own = run.relit([attr("float shadow:bias", 0.5), light("key", Some("pointlight"))]);
    assert_eq!(own.lights[1].attributes.get(attr::SHADOW_BIAS), 0.5);
    assert_eq!(&*own.lights[1].group.layers[0].shader, "pointlight");
    // The attribute state is that of the first World again.
    let later = run.relit([light("key", Some("pointlight"))]);
    assert_eq!(later.lights[1].attributes.get(attr::SHADOW_BIAS), 0.01);
}

#[test]
fn lights_move_within_a_frame_and_have_layers() {
    let mut run = scene();
    let layer = |layer: &str| Call::Light {
        id: "key".into(),
        shader: Some("spotlight".into()),
        layer: Some(layer.into()),
        params: Params::new(),
    };
    let both = run.relit([
        Call::PushAttributes,
        Call::Motion([0.0, 1.0].into()),
        Call::Translate([0.0, 0.0, 0.0]),
        Call::Translate([1.0, 0.0, 0.0]),
        attr("int light:nsamples", 4),
        Call::ShaderGroupBegin,
        layer("a"),
        layer("b"),
        Call::ConnectShaders {
            source_layer: "a".into(),
            source: "x".into(),
            target_layer: "b".into(),
            target: "y".into(),
        },
        Call::ShaderGroupEnd,
        Call::PopAttributes,
    ]);
    let key = &both.lights[1];
    assert_eq!((key.group.layers.len(), key.group.connections.len()), (2, 1));
    assert!(key.group.layers[0].to_world.is_moving());
    assert_eq!(key.attributes.get(attr::LIGHT_NSAMPLES), 4);
}

#[test]
fn a_deleted_light_shines_on_nothing_and_may_be_added_again() {
    for shader in [Some("null"), None, Some("")] {
        let mut run = scene();
        let without = run.relit([light("fill", shader)]);
        assert_eq!(lit(&without), [""; 4]);
        assert!(without.lights[0].group.layers.is_empty());
        // A light of the same name is a new one, in the same frame or later.
        let again = run.relit([light("fill", Some("pointlight"))]);
        assert_eq!(lit(&again), [""; 4]);
        assert_eq!(lit(&run.relit([modify("car"), switch("fill", true)])), ["", "fill", "", ""]);
        let at_once = run.relit([light("fill", shader), light("fill", Some("spotlight"))]);
        assert_eq!((lit(&at_once), at_once.lights.len()), (vec![String::new(); 4], 1));
    }
    // The changes of modify mode are kept when a light is deleted meanwhile.
    let mut run = scene();
    let mut calls = light_at("key", [0.0; 3], 1.0);
    calls.extend([modify("car"), switch("key", true), light("fill", None), attr("int rerender:locked", 1)]);
    let frame = run.relit(calls);
    assert_eq!(lit(&frame), ["", "key", "", ""]);
    assert!(frame.primitives[1].attributes.get(attr::RERENDER_LOCKED));
}

#[test]
fn the_camera_is_emitted_again_with_a_crop_and_another_quality() {
    let mut run = scene();
    let crop: [f32; 4] = [0.25, 0.5, 0.38, 0.72];
    let emitted = |list: &[(&str, &[f32])]| {
        let mut all: Vec<(&str, &[f32])> = vec![("int[2] resolution", &[640.0, 480.0])];
        all.extend(list);
        [placed([0.0, 1.0, -6.0]), camera_with("maincam", &all), Call::World]
    };
    let mut frame = |list: &[(&str, &[f32])]| {
        run.calls(emitted(list));
        let scene = run.scene();
        assert_eq!(run.messages(), Vec::<String>::new());
        let camera = &scene.cameras[0];
        assert_eq!(camera.get(attr::FOV), 35.0);
        assert_eq!(camera.world_to_camera.first().point(Vec3::ZERO), Vec3::new(0.0, -1.0, 6.0));
        (camera.get(attr::CROP), camera.get(attr::SPATIALQUALITY))
    };
    assert_eq!(frame(&[("float[4] crop", &crop), ("int[2] spatialquality", &[4.0, 4.0])]), (crop, [4, 4]));
    assert_eq!(frame(&[("float[4] crop", &crop), ("int[2] spatialquality", &[1.0, 1.0])]), (crop, [1, 1]));
    // Without these parameters the camera has their defaults again.
    assert_eq!(frame(&[]), ([0.0, 1.0, 0.0, 1.0], [4, 4]));
    let more: [(&str, &[f32]); 2] = [("int temporalquality", &[3.0]), ("int dofquality", &[5.0])];
    frame(&more);
    let fast = run.relit([]).cameras[0].clone();
    assert_eq!((fast.get(attr::TEMPORALQUALITY), fast.get(attr::DOFQUALITY)), (3, 5));
    let order = [Param::declared("string bucketorder", "spiral").unwrap()].into_iter().collect();
    run.calls([placed([0.0, 1.0, -6.0]), Call::Camera { name: "maincam".into(), params: order }]);
    assert_eq!(&*run.relit([]).cameras[0].get(attr::BUCKETORDER), "spiral");
    // Attributes are the defaults of cameras, as in the first frame.
    run.calls([attr("float[4] crop", &crop[..]), placed([0.0, 1.0, -6.0]), camera("maincam")]);
    assert_eq!(run.relit([]).cameras[0].get(attr::CROP), crop);
}

#[test]
fn shading_is_locked_for_some_objects() {
    let mut run = scene();
    let frame = run.relit([
        modify(""),
        attr("int rerender:locked", 1),
        modify("^truck4.*"),
        attr("int rerender:locked", 0),
    ]);
    let locked: Vec<bool> =
        frame.primitives.iter().map(|p| p.attributes.get(attr::RERENDER_LOCKED)).collect();
    assert_eq!(locked, [true, true, false, false]);
}

#[test]
fn files_to_check_are_chosen_between_frames() {
    let mut run = scene();
    run.calls([attr("string rerender:filepattern", ".*\\.(sm)|(env)")]);
    assert_eq!(&*run.relit([]).get(attr::RERENDER_FILEPATTERN), ".*\\.(sm)|(env)");
}
