//! Tests of cameras, later frames, inputs, spaces and primitives.

use crate::fixture::*;
use granita_base::{BaseType, Location, Param, ParamData, Params, ShapeDesc, Transform, TrimDesc, Vec3};
use granita_scene::{Call, SceneSink, Stop, TransformTarget, attr};
use std::sync::Arc;

#[test]
fn cameras_and_outputs_are_rendered_with_their_attributes() {
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
    let kept = run.kept.0.lock();
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
fn after_render_calls_are_errors_unless_rerendering() {
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
        attr("int limits:texturememory", 64),
        Call::World,
        Call::Render { camera: None },
    ]);
    let kept = run.kept.0.lock();
    assert!(Arc::ptr_eq(&kept[0].0.primitives[0], &kept[1].0.primitives[0]));
    assert_eq!(kept[1].0.get(attr::LIMITS_TEXTUREMEMORY), 64);
    assert!(run.messages().is_empty());
}

#[test]
fn attributes_can_be_read_back() {
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
fn inputs_with_a_bound_do_not_change_the_state() {
    let input = |bound| Call::Input { command: "move".into(), bound };
    let mut run = Run::new();
    run.calls([Call::World, input(Some([0.0; 6])), sphere(), input(None), sphere()]);
    let scene = run.scene();
    assert_eq!([0, 1].map(|i| origin(&scene, i).x), [0.0, 7.0]);
}

#[test]
fn set_transform_accepts_named_spaces() {
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
    // A raster position is mapped back to where the camera sees it.
    let p = Vec3::new(0.3, -0.2, 2.0);
    let c = &scene.cameras[0];
    let raster = c.camera_to_raster().point(c.world_to_camera.first().point(p));
    let back = scene.primitives[1].attributes.to_world.first().point(raster);
    assert!((back - p).length() < 1e-3, "{back}");
}

#[test]
fn invalid_trim_curves_are_refused() {
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
fn undeclared_parameters_of_primitives_have_standard_types() {
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
fn faces_take_saved_attributes() {
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
fn a_singular_camera_is_reported() {
    let mut run = Run::new();
    run.calls([Call::Scale([1.0, 1.0, 0.0]), Call::World, sphere()]);
    assert!(run.message().contains("cannot be inverted"));
    let scene = run.scene();
    assert_eq!(*scene.primitives[0].attributes.to_world.first(), Transform::IDENTITY);
}

#[test]
fn the_exit_command_stops_the_scene() {
    let mut run = Run::new();
    let exit = Call::Command { name: "exit".into(), params: Params::new() };
    assert!(matches!(run.state.call(exit, &Location::default()), Err(Stop::Exit)));
}

/// Compares the table with the names, types and defaults of the reference's list.
#[test]
fn the_attribute_table_equals_the_reference() {
    use granita_scene::attribute::{DefaultValue, Scope};
    let list = include_str!("../data/attributes.tsv");
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
            DefaultValue::Text(text) | DefaultValue::OneOf(&[text, ..]) => {
                assert_eq!(text, default.trim_matches('"'), "{name}");
            }
            DefaultValue::OneOf(&[]) => panic!("{name} has no words"),
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
    // The table has no attribute that is not in the list.
    assert_eq!(seen, granita_scene::attribute::TABLE.len());
}
