//! Tests of saving, restoring and modifying.

use crate::fixture::*;
use granita_base::{TrimDesc, Vec3};
use granita_scene::{AttributeSet, Call, TransformTarget, attr};
use std::sync::Arc;

/// Returns the number in a user attribute; 0 when it is not set.
fn user(set: &AttributeSet, name: &str) -> f32 {
    set.values.get(name).and_then(|p| p.data.to_floats()).map_or(0.0, |v| v[0])
}

#[test]
fn saved_attributes_are_restored() {
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
        (origin(&scene, i).x, set.get(attr::COLOR)[0], shader, user(set, "user:temperature"))
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
fn parts_of_the_state_are_saved_separately() {
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
            user(set, "user:x") == 2.0,
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
fn modify_without_a_pattern_changes_all_objects() {
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
        // Without a pattern all states change, whatever their names, and saved states too.
        Call::Modify { pattern: "".into() },
        attr("float shadingquality", 0.5),
        // Another call replaces the set of modified states.
        Call::Modify { pattern: "^a[0-9]\\{1,2\\}$".into() },
        attr("int twosided", 0),
        // Attributes of the current state (its name is "b") and of the objects that it makes do not change.
        sphere(),
        attr("int holdout", 1),
        Call::PopAttributes,
        Call::RestoreAttributes { name: "first".into(), attributes: None },
        sphere(),
        // The current state and its objects are now called "a1" and change.
        Call::Modify { pattern: "a1".into() },
        sphere(),
        attr("float dice:curvature", 3.0),
        attr("string name", "renamed"),
    ]);
    let scene = run.scene();
    let state = |i: usize| {
        let set = &scene.primitives[i].attributes;
        let numbers = (set.get(attr::SHADINGQUALITY), set.get(attr::TWOSIDED), set.get(attr::HOLDOUT));
        (set.name().to_string(), numbers, set.get(attr::DICE_CURVATURE))
    };
    assert_eq!(state(0), ("renamed".into(), (0.5, false, 1), 3.0));
    assert_eq!(state(1), ("b".into(), (0.5, true, 0), 10.0));
    assert_eq!(state(2), ("b".into(), (0.5, true, 0), 10.0));
    assert_eq!(state(3), ("renamed".into(), (0.5, false, 1), 3.0));
    assert_eq!(state(4), ("renamed".into(), (0.5, false, 1), 3.0));
    assert!(run.messages().is_empty(), "{:?}", run.messages());
}

#[test]
fn modify_changes_declared_objects_that_match() {
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
        (set.lights.len(), origin(&scene, i).x, set.get(attr::COLOR)[0])
    };
    assert_eq!(state(0), (1, 0.0, 1.0));
    assert_eq!(state(1), (0, 1.0, 0.0));
    assert_eq!(state(2), (0, 1.0, 0.0));
    // The current state was modified too, and restored by the pop.
    assert_eq!(state(3), (1, 0.0, 0.5));
    assert!(Arc::ptr_eq(&scene.primitives[1].attributes, &scene.primitives[2].attributes));
}

#[test]
fn modify_changes_lights_and_shader_spaces() {
    let mut run = Run::new();
    run.calls([
        Call::World,
        Call::Translate([10.0, 0.0, 0.0]),
        name("lamp"),
        light("key", Some("pointlight")),
        name("wood"),
        shader("surface", "oak", None),
        // The object has another name and does not match. The state of its shader matches.
        name("table"),
        sphere(),
        sphere(),
        Call::PushAttributes,
        name("clay"),
        shader("surface", "clay", None),
        sphere(),
        Call::PopAttributes,
        Call::PushAttributes,
        Call::Modify { pattern: "^lamp$".into() },
        Call::Translate([0.0, 5.0, 0.0]),
        Call::Modify { pattern: "^wood$".into() },
        Call::Translate([0.0, 0.0, 7.0]),
        Call::Translate([0.0, 0.0, 1.0]),
        Call::PopAttributes,
        sphere(),
    ]);
    let scene = run.scene();
    let place = |m: &granita_base::MotionTransform| m.first().point(Vec3::ZERO);
    let light = &scene.lights[0];
    assert_eq!(place(&light.group.layers[0].to_world), Vec3::new(10.0, 5.0, 0.0));
    assert_eq!(place(&light.attributes.to_world), Vec3::new(10.0, 5.0, 0.0));
    let shown = |i: usize| {
        let set = &scene.primitives[i].attributes;
        let layer = &set.surface.as_ref().unwrap().layers[0];
        (layer.shader.to_string(), place(&layer.to_world), place(&set.to_world))
    };
    let ten = Vec3::new(10.0, 0.0, 0.0);
    // The space of the shader moved, and the object did not.
    assert_eq!(shown(0), ("oak".into(), Vec3::new(10.0, 0.0, 8.0), ten));
    assert_eq!(shown(2), ("clay".into(), ten, ten));
    // The state after the pop has the moved shader too.
    assert_eq!(shown(3), shown(0));
    assert!(Arc::ptr_eq(&scene.primitives[0].attributes, &scene.primitives[1].attributes));
    assert!(run.messages().is_empty(), "{:?}", run.messages());
}

#[test]
fn a_set_that_removes_objects_from_the_camera_gives_a_warning() {
    let set = |value: &str| attr("string geometryset", value);
    let shown = |calls: Vec<Call>| {
        let mut run = Run::new();
        run.calls([camera("main"), Call::World]).calls(calls).calls([Call::Render { camera: None }]);
        run.messages()
    };
    let said = shown(vec![set("trees, rocks"), sphere(), set("rocks"), sphere()]);
    assert_eq!(said.len(), 1, "{said:?}");
    assert!(said[0].contains("camera \"main\" shows nothing"), "{said:?}");
    assert!(
        said[0].contains("\"trees, rocks\"") && said[0].contains("\"+trees,+rocks\" keeps it"),
        "{said:?}"
    );
    for fine in [
        vec![set("+trees"), sphere()],
        vec![sphere(), set("trees"), sphere()],
        vec![set("camera"), sphere()],
        vec![set("trees"), set("+main"), sphere()],
        vec![set("trees")],
    ] {
        assert_eq!(shown(fine.clone()), Vec::<String>::new(), "{fine:?}");
    }
}
