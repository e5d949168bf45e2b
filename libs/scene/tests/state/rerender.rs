//! Tests of the rules of re-rendering (reference 2.11 and 11.1): what later frames may change, and what is refused.

use crate::fixture::*;
use granita_base::{Param, ParamData, Params, TrimDesc, Vec3};
use granita_scene::attribute::{Scope, TABLE};
use granita_scene::{Call, Scene, SceneSink, TransformTarget, attr};
use std::sync::Arc;

/// Returns a scene with a camera, an output, two lights and two objects, after its first frame.
fn scene() -> Run {
    let mut run = Run::new();
    run.calls([
        attr("int rerender", 1),
        attr("int limits:gridsize", 128),
        Call::Rotate { angle_deg: 33.0, axis: [1.0, 2.0, 3.0] },
        Call::Translate([0.3, 1.7, -6.1]),
        camera_with(&[param("float fov", 35.25), param("float[2] shutter", &[0.0, 1.0][..])]),
        output("a.tif", "tiff", &[param("string filter", "box"), param("float gain", 2.0)]),
        Call::World,
        light("key", Some("pointlight")),
        light("fill", Some("pointlight")),
        name("truck"),
        sphere(),
        name("car"),
        sphere(),
    ]);
    run.scene();
    assert_eq!(run.messages(), Vec::<String>::new());
    run
}

fn param(declaration: &str, data: impl Into<ParamData>) -> Param {
    Param::declared(declaration, data).unwrap()
}

fn camera_with(params: &[Param]) -> Call {
    Call::Camera { name: "main".into(), params: params.iter().cloned().collect() }
}

fn output(name: &str, format: &str, params: &[Param]) -> Call {
    Call::Output {
        name: name.into(),
        format: format.into(),
        data: "rgba".into(),
        camera: "main".into(),
        params: params.iter().cloned().collect(),
    }
}

fn modify(pattern: &str) -> Call {
    Call::Modify { pattern: pattern.into() }
}

fn switch(id: &str, on: bool) -> Call {
    Call::LightSwitch { id: id.into(), on }
}

/// Returns the calls that place the camera where it is.
fn at_camera() -> [Call; 2] {
    [Call::Rotate { angle_deg: 33.0, axis: [1.0, 2.0, 3.0] }, Call::Translate([0.3, 1.7, -6.1])]
}

impl Run {
    /// Returns the messages since the last call, without their locations.
    fn new_messages(&mut self) -> Vec<String> {
        let all = std::mem::take(&mut *self.messages.lock());
        all.iter().map(|message| format!("{:?}: {}", message.severity, message.text)).collect()
    }

    /// Makes a frame of these calls before and after `World`. Returns its scene, and the messages.
    fn frame<const A: usize, const B: usize>(
        &mut self,
        before: [Call; A],
        world: [Call; B],
    ) -> (Arc<Scene>, Vec<String>) {
        self.calls(before).calls([Call::World]).calls(world);
        (self.scene(), self.new_messages())
    }

    /// Returns the only message of a frame, and its scene.
    fn refused<const A: usize, const B: usize>(
        &mut self,
        before: [Call; A],
        world: [Call; B],
    ) -> (Arc<Scene>, String) {
        let (scene, messages) = self.frame(before, world);
        assert_eq!(messages.len(), 1, "{messages:?}");
        (scene, messages[0].clone())
    }
}

/// The attributes that may change are those of the reference, those of re-rendering itself, those of passes, and
/// "verbosity".
#[test]
fn the_table_marks_the_attributes_that_may_change() {
    let marked = |scope: Scope| -> Vec<&str> {
        TABLE.iter().filter(|row| row.scope == scope && row.rerender).map(|row| row.name).collect()
    };
    let camera = ["crop", "spatialquality", "temporalquality", "dofquality", "bucketorder"];
    assert_eq!(marked(Scope::Camera), camera);
    assert_eq!(marked(Scope::Output), ["gamma", "gain", "quantize", "dither"]);
    assert_eq!(marked(Scope::Object), ["rerender:locked"]);
    let scene = |name: &str| {
        let is_memory = name.starts_with("limits:") && name.ends_with("memory");
        let begins =
            ["rerender:", "path:", "statistics:", "render:"].iter().any(|word| name.starts_with(word));
        is_memory || begins || name == "verbosity"
    };
    for row in TABLE.iter().filter(|row| row.scope == Scope::Global) {
        assert_eq!(row.rerender, scene(row.name), "{}", row.name);
    }
    assert!(marked(Scope::ReadOnly).is_empty() && marked(Scope::Writer).is_empty());
}

#[test]
fn only_some_global_attributes_change() {
    let mut run = scene();
    let (frame, said) = run.frame(
        [
            attr("int limits:texturememory", 1000),
            attr("int rerender:memory", 2000),
            attr("int rerender:reshaderays", 0),
            attr("string path:texture", "/maps:&"),
            attr("int statistics:level", 2),
            attr("int verbosity", 2),
            // The same value again is no change.
            attr("int limits:gridsize", 128),
            attr("int ray:maxdepth", 2),
            attr("int rerender", 1),
        ],
        [],
    );
    assert_eq!(said, Vec::<String>::new());
    assert_eq!((frame.get(attr::LIMITS_TEXTUREMEMORY), frame.get(attr::RERENDER_MEMORY)), (1000, 2000));
    assert!(!frame.get(attr::RERENDER_RESHADERAYS));
    assert!(frame.get(attr::PATH_TEXTURE).starts_with("/maps:."));
    let rule =
        "cannot change in a re-render (only memory limits, search paths and statistics may); the value stays";
    for (name, value) in
        [("limits:gridsize", 64), ("ray:maxdepth", 3), ("rerender", 0), ("limits:threads", 7)]
    {
        let (frame, said) = run.refused([attr(&format!("int {name}"), value)], []);
        assert_eq!(said, format!("Warning: attribute \"{name}\" {rule}"));
        assert_eq!((frame.get(attr::LIMITS_GRIDSIZE), frame.get(attr::RAY_MAXDEPTH)), (128, 2));
    }
    let (_, said) = run.refused([attr("string spatialdb:read", "a.sdb")], []);
    assert!(said.contains("\"spatialdb:read\" cannot change"), "{said}");
    // After World the attributes of the scene are fixed, as in the first frame.
    let (frame, said) = run.refused([], [attr("int limits:texturememory", 9)]);
    assert!(said.contains("cannot be set after World"), "{said}");
    assert_eq!(frame.get(attr::LIMITS_TEXTUREMEMORY), 1000);
}

#[test]
fn refused_changes_are_reported_once_in_each_frame() {
    let mut run = scene();
    for _ in 0..2 {
        let (frame, said) = run.frame([], [sphere(), sphere(), points(&[0.0; 3])]);
        let rule = "geometry cannot be added in a re-render; the call is ignored";
        assert_eq!(said, [format!("Warning: Sphere: {rule}"), format!("Warning: Points: {rule}")]);
        assert_eq!(frame.primitives.len(), 2);
    }
    run.calls([Call::World, sphere()]);
    let last = run.line;
    assert!(run.messages()[0].starts_with(&format!("t.pyg:{last}: ")), "{:?}", run.messages());
}

#[test]
fn a_camera_changes_only_its_quality() {
    let mut run = scene();
    let [rotate, place] = at_camera();
    // Everything that it had, written again.
    let same =
        [param("float fov", 35.25), param("float[2] shutter", &[0.0, 1.0][..]), param("float near", 0.1)];
    let screen = param("float[4] screen", &[-640.0 / 480.0, 640.0 / 480.0, -1.0, 1.0][..]);
    let all: Vec<Param> = same.into_iter().chain([screen]).collect();
    let (_, said) = run.frame([rotate.clone(), place.clone(), camera_with(&all)], []);
    assert_eq!(said, Vec::<String>::new());
    let rule = "cannot change in a re-render (only \"crop\", \"spatialquality\", \"temporalquality\", \"dofquality\" and \
                \"bucketorder\" may); the old value stays";
    for (name, value) in [
        ("fov", param("float fov", 36.0)),
        ("resolution", param("int[2] resolution", &[64, 48][..])),
        ("screen", param("float[4] screen", &[-1.0, 1.0, -1.0, 1.0][..])),
        ("fstop", param("float fstop", 4.0)),
        ("limits:bucketsize", param("int[2] limits:bucketsize", &[8, 8][..])),
        ("projection", param("string projection", "orthographic")),
    ] {
        let crop = param("float[4] crop", &[0.0, 0.5, 0.0, 0.5][..]);
        let (frame, said) = run.refused([rotate.clone(), place.clone(), camera_with(&[value, crop])], []);
        assert_eq!(said, format!("Warning: Camera \"main\": \"{name}\" {rule}"));
        let camera = &frame.cameras[0];
        assert_eq!((camera.get(attr::FOV), camera.get(attr::CROP)), (35.25, [0.0, 0.5, 0.0, 0.5]));
        assert_eq!((camera.resolution(), camera.get(attr::FSTOP)), ([640, 480], 1e30));
    }
    // A parameter in error leaves the value as it was.
    let wrong = camera_with(&[param("float[4] crop", &[0.5][..]), param("string dofquality", "good")]);
    let (frame, said) = run.frame([rotate, place, wrong], []);
    assert!(said.len() == 2 && said[0].contains("needs 4 values"), "{said:?}");
    assert_eq!(frame.cameras[0].get(attr::CROP), [0.0, 0.5, 0.0, 0.5]);
}

#[test]
fn a_camera_stays_where_it_is() {
    let mut run = scene();
    let crop = param("float[4] crop", &[0.0, 0.5, 0.0, 0.5][..]);
    let before = run.kept.0.lock()[0].0.cameras[0].clone();
    // The matrix as text of six digits.
    let text =
        before.world_to_camera.inverse().first().to_rows().map(|x| format!("{x:.5e}").parse().unwrap());
    assert_ne!(text, before.world_to_camera.inverse().first().to_rows());
    let as_text = Call::SetTransform(TransformTarget::Matrix(Box::new(text)));
    let (frame, said) = run.frame([as_text, camera_with(std::slice::from_ref(&crop))], []);
    assert_eq!((&frame.cameras[0].world_to_camera, said), (&before.world_to_camera, Vec::new()));
    let [rotate, _] = at_camera();
    let moved = [rotate, Call::Translate([0.3, 1.7, -6.0])];
    let rule = "Warning: Camera \"main\": a camera cannot move in a re-render; it stays where it was";
    for place in [moved, [Call::Comment("".into()), Call::Comment("".into())]] {
        let [one, other] = place;
        let (frame, said) = run.refused([one, other, camera_with(std::slice::from_ref(&crop))], []);
        assert_eq!(said, rule);
        assert_eq!(frame.cameras[0].world_to_camera, before.world_to_camera);
        assert_eq!(frame.cameras[0].get(attr::CROP), [0.0, 0.5, 0.0, 0.5]);
    }
    let [rotate, place] = at_camera();
    let moving = [
        rotate,
        Call::Motion([0.0, 1.0].into()),
        Call::Translate([0.3, 1.7, -6.1]),
        Call::Translate([0.3, 1.7, -6.2]),
        camera("main"),
    ];
    assert_eq!(run.refused(moving, []).1, rule);
    let (frame, said) = run.refused([place, camera("mian")], []);
    let rule = "a camera cannot be added in a re-render; the call is ignored; did you mean \"main\"?";
    assert_eq!((said, frame.cameras.len()), (format!("Warning: Camera \"mian\": {rule}"), 1));
}

#[test]
fn a_moving_camera_may_be_emitted_again() {
    let moving = |x: f32| {
        [
            Call::Motion([0.0, 1.0].into()),
            Call::Translate([0.0; 3]),
            Call::Translate([x, 0.0, 0.0]),
            camera("main"),
        ]
    };
    let mut run = Run::new();
    run.calls([attr("int rerender", 1)]).calls(moving(1.0)).calls([Call::World, sphere()]);
    run.scene();
    assert_eq!(run.frame(moving(1.0), []).1, Vec::<String>::new());
    assert!(run.refused(moving(2.0), []).1.contains("cannot move"));
}

#[test]
fn attributes_of_cameras_change_the_camera_that_world_made() {
    let mut run = Run::new();
    run.calls([
        attr("int rerender", 1),
        attr("float fov", 30.0),
        Call::Translate([0.0, 0.0, 5.0]),
        Call::World,
    ]);
    run.calls([sphere()]).scene();
    let crop = || attr("float[4] crop", &[0.0, 0.5, 0.0, 0.5][..]);
    let (frame, said) = run.frame([crop(), attr("float fov", 30.0)], []);
    assert_eq!((frame.cameras[0].get(attr::CROP), said), ([0.0, 0.5, 0.0, 0.5], Vec::new()));
    let (frame, said) = run.refused([attr("float fov", 40.0)], []);
    let rule = "cannot change in a re-render (of cameras only \"crop\", \"spatialquality\", \"temporalquality\", \
                \"dofquality\" and \"bucketorder\" may); the value stays";
    assert_eq!(said, format!("Warning: attribute \"fov\" {rule}"));
    assert_eq!(frame.cameras[0].get(attr::FOV), 30.0);
}

#[test]
fn outputs_are_added_changed_and_deleted() {
    let mut run = scene();
    let names = |scene: &Scene| scene.outputs.iter().map(|o| o.name.to_string()).collect::<Vec<_>>();
    let (frame, said) = run.frame([output("b.exr", "exr", &[param("string filter", "sinc")])], []);
    assert_eq!((names(&frame), said), (vec!["a.tif".to_owned(), "b.exr".into()], Vec::new()));
    let bright = [
        param("float gamma", 2.2),
        param("float gain", 3.0),
        param("int[4] quantize", &[0, 65535, 0, 65535][..]),
        param("float dither", 0.0),
        param("string filter", "box"),
    ];
    let (frame, said) = run.frame([output("a.tif", "tiff", &bright)], []);
    assert_eq!(said, Vec::<String>::new());
    let a = &frame.outputs[0];
    assert_eq!((a.get(attr::GAMMA), a.get(attr::GAIN), a.get(attr::DITHER)), (2.2, 3.0, 0.0));
    assert_eq!((a.get(attr::QUANTIZE), &*a.get(attr::FILTER)), ([0, 65535, 0, 65535], "box"));
    // What is left out has its default again, if it may change, or stays.
    let (frame, said) = run.frame([output("a.tif", "tiff", &[param("float gamma", 1.5)])], []);
    assert_eq!(said, Vec::<String>::new());
    let a = &frame.outputs[0];
    assert_eq!((a.get(attr::GAMMA), a.get(attr::GAIN), &*a.get(attr::FILTER)), (1.5, 1.0, "box"));
    for null in ["null", ""] {
        run.frame([output("b.exr", "exr", &[])], []);
        let (frame, said) = run.frame([output("b.exr", null, &[])], []);
        assert_eq!((names(&frame), said), (vec!["a.tif".to_owned()], Vec::new()));
    }
    let (_, said) = run.refused([output("b.tif", "null", &[])], []);
    assert!(
        said.contains("cannot remove \"b.tif\", there is no such output; did you mean \"a.tif\"?"),
        "{said}"
    );
    // An output is deleted and added again to change everything.
    let again = [output("a.tif", "null", &[]), output("a.tif", "exr", &[param("string filter", "sinc")])];
    let (frame, said) = run.frame(again, []);
    assert_eq!((&*frame.outputs[0].get(attr::FILTER), said), ("sinc", Vec::new()));
}

#[test]
fn an_output_changes_only_its_exposure() {
    let mut run = scene();
    let rule = "cannot change in a re-render (only \"gamma\", \"gain\", \"quantize\" and \"dither\" may); the old value stays";
    for value in
        [param("string filter", "sinc"), param("float[2] filterwidth", &[1.0, 1.0][..]), param("int own", 3)]
    {
        let name = value.name.clone();
        let (frame, said) = run.refused([output("a.tif", "tiff", &[value, param("float gain", 4.0)])], []);
        assert_eq!(said, format!("Warning: Output \"a.tif\": \"{name}\" {rule}"));
        let a = &frame.outputs[0];
        assert_eq!((&*a.get(attr::FILTER), a.get(attr::GAIN), a.params.0.len()), ("box", 4.0, 2));
    }
    let changed = |format: &str, data: &str, camera: &str| Call::Output {
        name: "a.tif".into(),
        format: format.into(),
        data: data.into(),
        camera: camera.into(),
        params: Params::new(),
    };
    for (call, what, old) in [
        (changed("exr", "rgba", "main"), "format", "tiff"),
        (changed("tiff", "z", ""), "data", "rgba"),
        (changed("tiff", "rgba", "other"), "camera", "main"),
    ] {
        let (frame, said) = run.refused([call], []);
        let rule = format!("the {what} cannot change in a re-render; \"{old}\" stays");
        assert_eq!(said, format!("Warning: Output \"a.tif\": {rule}"));
        let a = &frame.outputs[0];
        assert_eq!((&*a.format, &*a.data, &*a.camera), ("tiff", "rgba", "main"));
    }
    run.frame([output("a.tif", "tiff", &[param("float gain", 4.0)])], []);
    let (frame, said) = run.refused([output("a.tif", "tiff", &[param("string gain", "much")])], []);
    assert!(said.starts_with("Error: Output \"a.tif\": \"gain\" needs float"), "{said}");
    assert_eq!(frame.outputs[0].get(attr::GAIN), 4.0);
}

#[test]
fn objects_stay_as_they_are() {
    let mut run = scene();
    let before = run.kept.0.lock()[0].0.primitives.clone();
    let trim = TrimDesc {
        ncurves: [1].into(),
        n: [2].into(),
        order: [2].into(),
        knots: [0.0, 0.0, 1.0, 1.0].into(),
        min: [0.0].into(),
        max: [1.0].into(),
        uvw: [0.0; 6].into(),
    };
    let shaders = "Shader: the shaders of objects cannot change in a re-render; the call is ignored";
    let cases: [(Vec<Call>, &str); 7] = [
        (vec![sphere()], "Sphere: geometry cannot be added in a re-render; the call is ignored"),
        (
            vec![Call::Motion([0.0, 1.0].into()), points(&[0.0; 3]), points(&[1.0; 3])],
            "Points: geometry cannot be added in a re-render; the call is ignored",
        ),
        (
            vec![Call::Input { command: "move".into(), bound: None }],
            "Input: objects cannot be added in a re-render; the call is ignored",
        ),
        (
            vec![Call::TrimCurve(Some(Box::new(trim)))],
            "TrimCurve: trim curves cannot change in a re-render; the call is ignored",
        ),
        (vec![shader("surface", "matte", None)], shaders),
        (vec![modify("car"), shader("displacement", "bumps", None)], shaders),
        (
            vec![
                Call::ShaderGroupBegin,
                shader("surface", "a", Some("a")),
                shader("surface", "b", Some("b")),
                Call::ConnectShaders {
                    source_layer: "a".into(),
                    source: "x".into(),
                    target_layer: "b".into(),
                    target: "y".into(),
                },
                Call::ShaderGroupEnd,
            ],
            shaders,
        ),
    ];
    for (calls, rule) in cases {
        run.calls([Call::World]).calls(calls);
        let frame = run.scene();
        assert_eq!(run.new_messages(), [format!("Warning: {rule}")]);
        assert_eq!(frame.primitives, before);
        assert!(run.kept.1.lock().is_empty());
    }
}

#[test]
fn modify_changes_only_light_switches_and_locks() {
    let mut run = scene();
    let before = run.kept.0.lock()[0].0.primitives.clone();
    let color = || attr("color C", &[1.0, 0.0, 0.0][..]);
    let rule = "cannot change the objects of Modify \"truck\" in a re-render (only LightSwitch and Attribute \
                \"rerender:locked\" may)";
    let restore = Call::RestoreAttributes { name: "old".into(), attributes: None };
    run.frame([], [Call::SaveAttributes { name: "old".into(), attributes: None }]);
    for (call, what) in [
        (color(), "Attribute \"C\""),
        (attr("float user:x", 1.0), "Attribute \"user:x\""),
        (attr("string geometryset", "-camera"), "Attribute \"geometryset\""),
        (attr("string orientation", "inside"), "Attribute \"orientation\""),
        (attr("float shadow:bias", 1.0), "Attribute \"shadow:bias\""),
        (Call::Translate([1.0, 0.0, 0.0]), "Translate"),
        (restore, "RestoreAttributes"),
    ] {
        let (frame, said) = run.refused([], [modify("truck"), call.clone(), call]);
        assert_eq!((&frame.primitives, said), (&before, format!("Warning: {what} {rule}")));
    }
    let motion = [Call::Motion([0.0, 1.0].into()), Call::Translate([0.0; 3]), Call::Translate([1.0; 3])];
    let [begin, first, last] = motion;
    let (frame, said) = run.refused([], [modify("truck"), begin, first, last]);
    assert_eq!((&frame.primitives, said), (&before, format!("Warning: Translate {rule}")));
    // What belongs to a light that follows is not refused.
    let bias = attr("float shadow:bias", 1.0);
    let (frame, said) = run.refused(
        [],
        [modify("truck"), color(), Call::Translate([1.0, 0.0, 0.0]), bias, light("key", Some("spotlight"))],
    );
    assert_eq!((&frame.primitives, said), (&before, format!("Warning: Attribute \"C\" {rule}")));
    assert_eq!(frame.lights[0].attributes.get(attr::SHADOW_BIAS), 1.0);
    assert_eq!(frame.lights[0].group.layers[0].to_world.first().point(Vec3::ZERO).x, 1.0);
    let (frame, said) =
        run.frame([], [modify("truck"), switch("key", false), attr("int rerender:locked", 1)]);
    assert_eq!(said, Vec::<String>::new());
    let locked = |i: usize| frame.primitives[i].attributes.get(attr::RERENDER_LOCKED);
    assert_eq!([0, 1].map(locked), [true, false]);
    assert_eq!([0, 1].map(|i| frame.primitives[i].attributes.lights.len()), [1, 2]);
    assert!(Arc::ptr_eq(&frame.primitives[1], &before[1]));
}

#[test]
fn modify_changes_lights_that_match_alone() {
    let mut run = Run::new();
    run.calls([attr("int rerender", 1), Call::World, name("lamp"), light("key", Some("pointlight"))]);
    run.calls([name("truck"), sphere()]).scene();
    let (frame, said) = run.frame([], [modify("lamp"), Call::Translate([0.0, 2.0, 0.0])]);
    assert_eq!(said, Vec::<String>::new());
    assert_eq!(frame.lights[0].group.layers[0].to_world.first().point(Vec3::ZERO).y, 2.0);
    assert_eq!(origin(&frame, 0), Vec3::ZERO);
}

#[test]
fn names_that_match_nothing_are_reported() {
    let mut run = scene();
    for _ in 0..2 {
        let (_, said) = run.refused([], [modify("trukc"), modify("trukc")]);
        let rule = "no object or light has a name that matches; did you mean \"truck\"?";
        assert_eq!(said, format!("Warning: Modify \"trukc\": {rule}"));
    }
    let (_, said) = run.refused([], [modify("\\(a")]);
    assert_eq!(said, "Error: Modify: cannot read the regular expression \"\\(a\"");
    let (_, said) = run.refused([], [modify(""), switch("kye", true)]);
    assert_eq!(said, "Error: LightSwitch: no light \"kye\"; did you mean \"key\"?");
    let (_, said) = run.refused([], [light("kye", Some("null"))]);
    assert_eq!(said, "Warning: Light: cannot remove \"kye\", there is no such light; did you mean \"key\"?");
    // A deleted light is unknown, and is off.
    let (_, said) = run.refused([], [light("key", None), light("key", None), switch("key", false)]);
    assert_eq!(said, "Warning: Light: cannot remove \"key\", there is no such light");
    let (frame, said) = run.refused([], [modify(""), switch("key", true)]);
    assert_eq!(said, "Error: LightSwitch: no light \"key\"");
    assert!(frame.primitives.iter().all(|p| p.attributes.lights.len() == 1));
}

#[test]
fn a_light_in_error_stays_as_it_was() {
    let mut run = scene();
    let before = run.kept.0.lock()[0].0.lights.clone();
    let emitted = |id: &str, shader: &str, params: &[Param]| Call::Light {
        id: id.into(),
        shader: Some(shader.into()),
        layer: None,
        params: params.iter().cloned().collect(),
    };
    let wrong = || [param("float intensity", "bright"), param("float falloff", 1.0)];
    let (frame, said) = run.refused([], [emitted("key", "spotlight", &wrong())]);
    assert_eq!(said, "Error: Light \"spotlight\": \"float intensity\" is given strings");
    assert_eq!(frame.lights, before);
    // A layer in error.
    let group = [
        Call::ShaderGroupBegin,
        emitted("key", "spotlight", &[]),
        emitted("key", "spotlight", &wrong()),
        Call::ShaderGroupEnd,
    ];
    let (frame, said) = run.refused([], group);
    assert!(said.contains("is given strings"), "{said}");
    assert_eq!(frame.lights, before);
    // A new light is not added. Its switch causes no further message in this frame.
    let (frame, said) =
        run.refused([], [emitted("rim", "spotlight", &wrong()), modify(""), switch("rim", true)]);
    assert!(said.contains("is given strings"), "{said}");
    assert_eq!(frame.lights, before);
    assert!(run.refused([], [modify(""), switch("rim", true)]).1.contains("no light \"rim\""));
    // The renderer checks what the state does not know. It has reported the error.
    assert!(run.kept.1.lock().is_empty());
    let (frame, said) = run.frame(
        [attr("string path:shader", "/lights:&")],
        [emitted("key", MISSING, &[]), emitted("rim", MISSING, &[]), modify("car"), switch("rim", true)],
    );
    assert_eq!((&frame.lights, said), (&before, Vec::new()));
    let checked = std::mem::take(&mut *run.kept.1.lock());
    assert!(checked.len() == 2 && checked[0].starts_with("key t.pyg:"), "{checked:?}");
    assert!(checked.iter().all(|line| line.contains(" /lights:.:")), "{checked:?}");
    // A light that is good replaces it.
    let (frame, said) = run.frame([], [emitted("key", "spotlight", &[]), emitted("rim", "spotlight", &[])]);
    assert_eq!(
        (&*frame.lights[0].group.layers[0].shader, frame.lights.len(), said),
        ("spotlight", 3, Vec::new())
    );
}

#[test]
fn the_state_after_each_frame_is_that_of_the_first_world() {
    let mut run = Run::new();
    run.calls([
        attr("int rerender", 1),
        Call::PushAttributes,
        attr("float shadow:bias", 0.25),
        Call::Translate([0.0, 0.0, 5.0]),
        Call::World,
        Call::Translate([1.0, 0.0, 0.0]),
        light("key", Some("pointlight")),
        sphere(),
        Call::PopAttributes,
    ]);
    run.scene();
    for frame in 0..3 {
        let bias = |run: &Run| run.state.attribute("float shadow:bias").unwrap().data;
        assert_eq!(bias(&run), ParamData::from(0.25), "{frame}");
        let at = run.state.attribute("transform").unwrap().data.to_floats().unwrap();
        assert_eq!(at[12..15], [0.0; 3], "{frame}");
        // The entry of the stack from before World is there again, and what is pushed before World may stay open.
        run.calls([Call::PushTransform, Call::Translate([9.0, 0.0, 0.0])]);
        if frame < 2 {
            run.calls([Call::World]);
        } else {
            run.calls([Call::PopTransform]);
        }
        run.calls([attr("float shadow:bias", 0.75), Call::PopAttributes]);
        let scene = run.scene();
        assert_eq!((scene.primitives.len(), scene.lights.len()), (1, 1));
        assert_eq!(origin(&scene, 0), Vec3::new(1.0, 0.0, 0.0));
    }
    // The frames with World end PushTransform with the block around it.
    let said = run.new_messages();
    assert!(said.iter().all(|text| text.contains("PushTransform without PopTransform")), "{said:?}");
}

#[test]
fn lights_and_modify_are_accepted_before_world() {
    let mut run = scene();
    let (frame, said) = run
        .frame([light("rim", Some("pointlight")), modify("car"), switch("rim", true)], [switch("key", true)]);
    assert_eq!(said, Vec::<String>::new());
    assert_eq!([0, 1].map(|i| frame.primitives[i].attributes.lights.len()), [2, 3]);
    // `Render` without `World` makes a frame too.
    run.calls([modify("truck"), switch("rim", true)]);
    assert_eq!(run.scene().primitives[0].attributes.lights.len(), 3);
    assert_eq!(run.new_messages(), Vec::<String>::new());
}
