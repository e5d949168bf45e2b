//! Tests of attributes that permit differences: locked objects, and rays that are not shaded again.

use crate::model::Stage;
use crate::play::{Place, both, compare};
use crate::scenes;

/// Index of the scene "rays", which has surfaces that trace rays.
const RAYS: usize = 1;

/// Index of the scene "hair", whose first camera has depth of field.
const HAIR: usize = 2;

fn modified(pattern: &str, calls: &str) -> String {
    format!("PushAttributes ()\nModify (\"{pattern}\")\n{calls}PopAttributes ()\n")
}

fn change(stage: &mut Stage, id: &str, factor: f32) -> String {
    let light = stage.lights.iter_mut().find(|light| light.id == id).unwrap();
    light.params.set("float intensity", [10.0 * factor].into());
    light.pyg()
}

/// Each scene renders with all of its lights and outputs without a message, and each light changes its image.
#[test]
fn every_light_of_the_scenes_shines() {
    for index in 0..scenes::COUNT {
        let mut stage = scenes::scene(index);
        stage.lights.iter_mut().for_each(|light| light.exists = true);
        stage.outputs.iter_mut().for_each(|output| output.exists = true);
        let place = Place::new(&stage);
        let render = |stage: &Stage| place.anew(2).frame(&(stage.pyg() + "Render ()\n")).unwrap();
        let all = render(&stage);
        assert!(all.len() >= stage.outputs.iter().filter(|output| !output.is_dynamic()).count());
        for i in 0..stage.lights.len() {
            let mut less = stage.clone();
            less.lights[i].exists = false;
            assert!(compare(&render(&less), &all).is_err(), "{}: {}", stage.name, stage.lights[i].id);
        }
    }
}

/// Objects that a light does not illuminate may be locked while it changes. An unlocked object is shaded again.
#[test]
fn locked_objects_that_nothing_changes_are_the_same_to_the_bit() {
    let mut stage = scenes::scene(0);
    let place = Place::new(&stage);
    let (mut keeping, mut anew) = (place.keeping(1), place.anew(1));
    let off = modified("", "LightSwitch (\"fill\", 0)\n") + &modified("red", "LightSwitch (\"fill\", 1)\n");
    let text = stage.pyg() + "Render ()\n";
    both(&mut keeping, &mut anew, &text).unwrap();
    let first = both(&mut keeping, &mut anew, &format!("World ()\n{off}Render ()\n")).unwrap();
    let lock = modified("", "Attribute (\"int rerender:locked\", 1)\n")
        + &modified("red", "Attribute (\"int rerender:locked\", 0)\n");
    let locked = both(&mut keeping, &mut anew, &format!("World ()\n{lock}Render ()\n")).unwrap();
    assert_eq!(compare(&locked, &first), Ok(()));
    for factor in [3.0, 0.5] {
        let text = format!("World ()\n{}Render ()\n", change(&mut stage, "fill", factor));
        let images = both(&mut keeping, &mut anew, &text).unwrap();
        assert!(compare(&images, &locked).is_err(), "the unlocked object is shaded again");
    }
    // Objects that are unlocked receive changes again.
    let unlock = modified("", "Attribute (\"int rerender:locked\", 0)\n");
    let text = format!("World ()\n{unlock}{}Render ()\n", change(&mut stage, "key", 3.0));
    both(&mut keeping, &mut anew, &text).unwrap();
}

/// A light that becomes ambient is seen by `ambient ()`, and no longer by `diffuse ()`.
#[test]
fn lights_become_ambient_and_back() {
    let mut stage = scenes::scene(0);
    let place = Place::new(&stage);
    let (mut keeping, mut anew) = (place.keeping(1), place.anew(1));
    let mut before = both(&mut keeping, &mut anew, &(stage.pyg() + "Render ()\n")).unwrap();
    for shader in ["ambientlight", "pointlight", "ambientlight"] {
        let light = stage.lights.iter_mut().find(|light| light.id == "fill").unwrap();
        light.shader = shader;
        light.params.0.retain(|(name, _)| *name == "float intensity");
        let text = format!("World ()\n{}Render ()\n", light.pyg());
        let images = both(&mut keeping, &mut anew, &text).unwrap();
        assert!(compare(&images, &before).is_err(), "{shader}");
        before = images;
    }
}

/// The first camera decides how finely surfaces are diced for all cameras, more coarsely where it blurs them. When its
/// depth of field ends, the images of other cameras change as well.
#[test]
fn all_cameras_are_diced_again_when_the_first_one_gets_sharp() {
    let mut stage = scenes::scene(HAIR);
    let place = Place::new(&stage);
    let (mut keeping, mut anew) = (place.keeping(1), place.anew(1));
    let mut before = both(&mut keeping, &mut anew, &(stage.pyg() + "Render ()\n")).unwrap();
    for quality in [1.0, 4.0] {
        stage.cameras[0].params.set("int dofquality", [quality].into());
        let text = format!("{}World ()\nRender ()\n", stage.cameras[0].pyg());
        let images = both(&mut keeping, &mut anew, &text).unwrap();
        assert!(compare(&images, &before).is_err(), "\"dofquality\" {quality}");
        before = images;
    }
}

/// With "rerender:reshaderays" 0, images may show old reflections only. They are right when it is 1 again, and when
/// no reflected object changes.
#[test]
fn rays_are_shaded_again_when_they_are_switched_on_again() {
    let mut stage = scenes::scene(RAYS);
    let place = Place::new(&stage);
    let (mut keeping, mut anew) = (place.keeping(2), place.anew(1));
    both(&mut keeping, &mut anew, &(stage.pyg() + "Render ()\n")).unwrap();
    let switch = |on: u8| format!("Attribute (\"int rerender:reshaderays\", {on})\n");
    both(&mut keeping, &mut anew, &format!("{}World ()\nRender ()\n", switch(0))).unwrap();
    // An output's gain changes no ray.
    let output = stage.outputs[0].clone().with("float gain", [0.5]).pyg();
    both(&mut keeping, &mut anew, &format!("{output}World ()\nRender ()\n")).unwrap();
    let changed = change(&mut stage, "key", 4.0);
    let text = format!("{}World ()\n{changed}Render ()\n", switch(0));
    // Their pixels may differ where surfaces trace rays.
    for player in [&mut keeping, &mut anew] {
        assert!(!player.frame(&text).unwrap().is_empty());
    }
    both(&mut keeping, &mut anew, &format!("{}World ()\nRender ()\n", switch(1))).unwrap();
    let text = format!("World ()\n{}Render ()\n", change(&mut stage, "key", 1.0));
    both(&mut keeping, &mut anew, &text).unwrap();
}
