//! Tests objects that are displaced without "displace:maxradius". Their bound is measured (reference 4.4.6).

use super::*;

fn shown(build: &Build, view: &CameraView, threads: usize, by: f32) -> Vec<f32> {
    render_with(build, view, threads, ("rgba", &[]), &Painted { displace: Some(by), ..Painted::new(wavy) })
}

fn alpha(image: &[f32]) -> f32 {
    image.chunks_exact(4).map(|p| p[3]).sum()
}

#[test]
fn displacement_towards_the_camera_does_not_move_the_image() {
    let mut build = flat_camera();
    build.square(2.0, &[], at(0.0, 0.0, 5.0));
    let view = build.view(&[]);
    let still = image(&build, "rgba", &[]);
    for by in [-0.001, -2.0, 0.3] {
        let moved = shown(&build, &view, 1, by);
        // The object moves straight towards an orthographic camera, so nothing moves in the image.
        assert_eq!(alpha(&moved), alpha(&still), "{by}");
        assert!(alpha(&moved) > 500.0);
    }
}

#[test]
fn a_displaced_sphere_equals_a_larger_one() {
    let mut small = flat_camera();
    small.sphere(1.0, &[], at(0.0, 0.0, 5.0));
    let mut large = flat_camera();
    large.sphere(2.5, &[], at(0.0, 0.0, 5.0));
    let displaced = shown(&small, &small.view(&[]), 2, 1.5);
    let whole = image(&large, "rgba", &[]);
    let off = displaced.chunks_exact(4).zip(whole.chunks_exact(4)).map(|(a, b)| (a[3] - b[3]).abs());
    assert!(off.fold(0.0, f32::max) < 0.2, "displaced {} of {}", alpha(&displaced), alpha(&whole));
    assert!((alpha(&displaced) - alpha(&whole)).abs() < 0.002 * alpha(&whole));
}

#[test]
fn measured_bounds_do_not_depend_on_buckets_threads_or_crops() {
    let build = busy();
    let view = build.view(&[]);
    let reference = shown(&build, &view, 1, -0.3);
    assert!(alpha(&reference) > 500.0);
    let small = build.view(&[("int[2] limits:bucketsize", vec![7.0, 5.0])]);
    assert!(reference == shown(&build, &small, 2, -0.3), "small buckets");
    assert!(reference == shown(&build, &view, 3, -0.3), "three threads");
    let crop = build.view(&[("float[4] crop", vec![0.3, 0.8, 0.2, 0.7])]);
    let part = shown(&build, &crop, 2, -0.3);
    let (rect, width) = (crop.crop, view.crop.width());
    for (row, y) in part.chunks_exact(4 * rect.width()).zip(rect.y0 as usize..) {
        let first = 4 * (y * width + rect.x0 as usize);
        assert!(*row == reference[first..first + row.len()], "row {y}");
    }
}
