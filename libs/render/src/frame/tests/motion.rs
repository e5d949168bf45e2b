//! Tests primitives that exist for a part of the shutter, and primitive variables that change (reference 2.7).

use super::*;
use granita_base::Vec2;

/// Adds a square of half side 1 with a key at each of some times. The numbers of a key are the offset along x, the grey
/// and the opacity.
fn moving_square(build: &mut Build, keys: &[(f32, [f32; 3])], to_world: MotionTransform) {
    let (shape, _) = square(1.0);
    build.add(shape, Params::new(), attributes(&[], to_world));
    let primitive = Arc::make_mut(build.scene.primitives.last_mut().unwrap());
    primitive.keys = keys
        .iter()
        .map(|(time, [x, grey, opacity])| {
            let points = [-1.0, -1.0, 0.0, 1.0, -1.0, 0.0, -1.0, 1.0, 0.0, 1.0, 1.0, 0.0];
            let moved: Vec<f32> =
                points.iter().enumerate().map(|(i, p)| if i % 3 == 0 { p + x } else { *p }).collect();
            let params = Params(vec![
                param("vertex point P", &moved),
                param("color C", &[*grey; 3]),
                param("color opacity", &[*opacity; 3]),
            ]);
            ShapeKey { time: *time, params }
        })
        .collect();
}

fn open_shutter() -> Build {
    let mut build = flat_camera();
    build.camera.push(("float[2] shutter", vec![0.0, 1.0]));
    build.camera.push(("int[2] spatialquality", vec![8.0, 8.0]));
    build
}

fn means(build: &Build, more: &[(&'static str, Vec<f32>)]) -> [f32; 2] {
    let shader = Painted::new(flat);
    let image = render_with(build, &build.view(more), 2, ("rgba", &box_filter()), &shader);
    let [r, .., a] = *pixel(&image, 4, 32, 24) else { panic!("four channels") };
    [r, a]
}

#[test]
fn variables_are_blended_at_the_time_of_each_sample() {
    for (keys, [color, alpha]) in [
        (vec![(0.0, [0.0, 0.0, 1.0]), (1.0, [0.0, 1.0, 1.0])], [0.5, 1.0]),
        (vec![(0.0, [0.0, 1.0, 1.0]), (0.25, [0.0, 1.0, 0.0]), (1.0, [0.0, 1.0, 0.0])], [0.125, 0.125]),
        // The keys lie beyond the shutter. The part inside of the shutter counts.
        (vec![(-1.0, [0.0, 0.0, 1.0]), (1.0, [0.0, 1.0, 1.0])], [0.75, 1.0]),
        // The square covers the pixel for a quarter of the shutter, with a mean grey of 0.4.
        (vec![(0.0, [-4.0, 0.0, 1.0]), (1.0, [4.0, 0.8, 1.0])], [0.1, 0.25]),
        (vec![(0.5, [0.0, 0.0, 1.0]), (1.0, [0.0, 1.0, 1.0])], [0.25, 0.5]),
    ] {
        let mut build = open_shutter();
        moving_square(&mut build, &keys, at(0.0, 0.0, 5.0));
        let [r, a] = means(&build, &[]);
        assert!((r - color).abs() < 0.01 && (a - alpha).abs() < 0.02, "{keys:?}: {r} {a}");
    }
}

#[test]
fn one_instant_shows_the_state_of_that_time() {
    let mut build = open_shutter();
    moving_square(&mut build, &[(0.5, [0.0, 0.2, 1.0]), (1.0, [0.0, 1.0, 1.0])], at(0.0, 0.0, 5.0));
    for (time, wanted) in [(0.25, [0.0, 0.0]), (0.5, [0.2, 1.0]), (0.75, [0.6, 1.0]), (2.0, [0.0, 0.0])] {
        let shown = means(&build, &[("float[2] shutter", vec![time, time])]);
        assert!((Vec2::from(shown) - Vec2::from(wanted)).length() < 1e-5, "{time}: {shown:?}");
    }
    // Without a shutter, the primitive is shown at its earliest time.
    let [r, a] = means(&build, &[("float[2] shutter", vec![0.0, 0.0])]);
    assert!((r - 0.2).abs() < 1e-5 && a == 1.0, "{r} {a}");
}

#[test]
fn pixels_do_not_depend_on_threads_buckets_or_crops() {
    let mut build = busy();
    moving_square(&mut build, &[(0.3, [-0.5, 0.1, 0.9]), (0.8, [1.5, 1.0, 0.2])], at(0.0, 0.0, 3.0));
    moving_square(&mut build, &[(-1.0, [1.0, 0.7, 1.0]), (0.4, [-1.0, 0.3, 1.0])], at(0.5, 0.5, 3.5));
    let shader = Painted::new(wavy);
    let view = build.view(&[]);
    let render = |view: &CameraView, threads| render_with(&build, view, threads, ("rgba", &[]), &shader);
    let reference = render(&view, 1);
    let small = build.view(&[("int[2] limits:bucketsize", vec![7.0, 5.0])]);
    let blocks = build
        .view(&[("int[2] limits:bucketsize", vec![7.0, 5.0]), ("int limits:bucketblocksize", vec![3.0])]);
    for (what, view, threads) in [("threads", &view, 3), ("buckets", &small, 2), ("blocks", &blocks, 1)] {
        assert!(render(view, threads) == reference, "{what}");
    }
    let crop = build.view(&[("float[4] crop", vec![0.3, 0.8, 0.2, 0.7])]);
    let (rect, width) = (crop.crop, view.crop.width());
    for (row, y) in render(&crop, 2).chunks_exact(4 * rect.width()).zip(rect.y0 as usize..) {
        let first = 4 * (y * width + rect.x0 as usize);
        assert!(*row == reference[first..first + row.len()], "row {y}");
    }
}
