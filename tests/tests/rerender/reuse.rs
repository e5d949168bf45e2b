//! Tests of what a frame takes from those before it: what is not done again, the bound of its memory, and frames that
//! end early.

use crate::model::{Output, Stage};
use crate::play::{Place, both, compare};
use crate::player::Player;
use crate::scenes;
use granita_render::Reuse;
use granita_session::FrameRecord;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Indices of the scenes "spots" and "rays".
const SPOTS: usize = 0;
const RAYS: usize = 1;

/// Returns calls that multiply the intensity of a light, and render.
fn brighter(stage: &mut Stage, id: &str, factor: f32) -> String {
    let light = stage.lights.iter_mut().find(|light| light.id == id).unwrap();
    light.params.set("float intensity", [10.0 * factor].into());
    format!("World ()\n{}Render ()\n", light.pyg())
}

/// Returns the records of all frames, and what each took from those before it.
fn records(player: Player) -> Vec<(FrameRecord, Reuse)> {
    let frames = player.finish().frames;
    frames
        .into_iter()
        .map(|frame| {
            let reuse = frame.cameras[0].1.reuse.unwrap();
            (frame, reuse)
        })
        .collect()
}

#[test]
fn a_light_that_changes_its_intensity_traces_no_shadow_and_dices_no_object_again() {
    let mut stage = scenes::scene(RAYS);
    let place = Place::new(&stage);
    let mut keeping = place.keeping(2);
    keeping.frame(&(stage.pyg() + "Render ()\n")).unwrap();
    keeping.frame(&brighter(&mut stage, "key", 3.0)).unwrap();
    keeping.frame("World ()\nRender ()\n").unwrap();
    let frames = records(keeping);
    let [(first, begun), (second, changed), (third, same)] = &frames[..] else { panic!("{frames:?}") };
    assert!(begun.is_anew && !changed.is_anew && !same.is_anew, "{begun:?}, {changed:?}, {same:?}");
    assert!(first.shading.shadow_rays > 1000 && first.shading.rays > 1000, "{:?}", first.shading);
    assert_eq!(second.shading.shadow_rays, 0);
    assert_eq!((second.cameras[0].1.grids, second.cameras[0].1.grids_shaded), (0, 0));
    assert_eq!((changed.lights_changed, changed.files_changed, changed.objects_changed), (1, 0, 0));
    assert!(changed.batches_shaded > 0 && changed.buckets_composited > 0, "{changed:?}");
    assert_eq!((third.shading.rays, third.shading.shadow_rays), (0, 0));
    assert_eq!((same.lights_changed, same.batches_shaded, same.buckets_composited), (0, 0, 0));
    assert!(same.buckets_kept > 0, "{same:?}");
}

#[test]
fn what_is_kept_stays_within_the_memory_of_rerendering() {
    let mut needs = None;
    // Without a limit, and with limits from which layer after layer has to be given up.
    for share in [None, Some(0.6), Some(0.1)] {
        let mut stage = scenes::scene(RAYS);
        let place = Place::new(&stage);
        let (mut keeping, mut anew) = (place.keeping(1), place.anew(1));
        let limit_kb =
            share.zip(needs).map_or(0, |(share, needs): (f64, u64)| 1 + (share * needs as f64) as u64 / 1024);
        let limit = format!("Attribute (\"int rerender:memory\", {limit_kb})\n");
        both(&mut keeping, &mut anew, &(limit + &stage.pyg() + "Render ()\n")).unwrap();
        for factor in [3.0, 0.5] {
            both(&mut keeping, &mut anew, &brighter(&mut stage, "key", factor)).unwrap();
        }
        for (_, reuse) in records(keeping) {
            let bytes = reuse.light_bytes + reuse.query_bytes + reuse.grid_bytes + reuse.sample_bytes;
            match needs {
                None => needs = Some(bytes),
                Some(_) if share.is_none() => {}
                Some(_) => assert!(bytes <= limit_kb * 1024, "{bytes} bytes, limit {limit_kb} KB: {reuse:?}"),
            }
        }
    }
    assert!(needs.unwrap() > 1 << 20);
}

/// A surface that is transparent where no light is.
const GHOST: &str = "surface ghost () {\n\
    color light = diffuse (faceforward (normalize (N), I));\n\
    opacity = clamp (light, 0, 1);\n\
    C = opacity * color (1, 0.5, 0.2);\n}\n";

#[test]
fn opacity_that_depends_on_a_light_is_right_in_each_crop() {
    let mut stage = scenes::scene(SPOTS);
    stage.texts.push(("ghost.gsl", GHOST));
    stage.objects = stage.objects.replace("\"greenmarble\"", "\"ghost\"");
    let place = Place::new(&stage);
    let (mut keeping, mut anew) = (place.keeping(1), place.anew(2));
    let first = both(&mut keeping, &mut anew, &(stage.pyg() + "Render ()\n")).unwrap();
    let crop = |stage: &mut Stage, crop: [f32; 4]| {
        stage.cameras[0].params.set("float[4] crop", crop.into());
        stage.cameras[0].pyg()
    };
    // The light changes while only a part of the image is rendered.
    let text = crop(&mut stage, [0.4, 0.7, 0.3, 0.7]) + &brighter(&mut stage, "fill", 0.0);
    both(&mut keeping, &mut anew, &text).unwrap();
    let text = crop(&mut stage, [0.0, 1.0, 0.0, 1.0]) + "World ()\nRender ()\n";
    let last = both(&mut keeping, &mut anew, &text).unwrap();
    assert!(compare(&last, &first).is_err(), "the light has an effect");
}

#[test]
fn frames_after_one_that_was_stopped_are_right() {
    for wait_ms in [5, 40] {
        let mut stage = scenes::scene(RAYS);
        stage.outputs.retain(|output: &Output| output.name == "main.exr");
        let place = Place::new(&stage);
        let (mut keeping, mut anew) = (place.keeping(1), place.anew(1));
        both(&mut keeping, &mut anew, &(stage.pyg() + "Render ()\n")).unwrap();
        let text = brighter(&mut stage, "key", 3.0);
        let stop = keeping.stop();
        let stopper = std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(wait_ms));
            stop.store(true, Ordering::SeqCst);
        });
        // It may end before it is stopped.
        _ = keeping.frame(&text);
        stopper.join().unwrap();
        keeping.forget_messages();
        anew.frame(&text).unwrap();
        both(&mut keeping, &mut anew, "World ()\nRender ()\n").unwrap();
        both(&mut keeping, &mut anew, &brighter(&mut stage, "back", 2.0)).unwrap();
    }
}
