//! Tests cameras and scenes with extreme numbers. The result is a correct image or a message, and never a panic.

use super::*;

fn shaded(build: &Build, more: &[(&'static str, Vec<f32>)]) -> Vec<f32> {
    let shader = Painted::new(flat);
    render_with(build, &build.view(more), 2, ("rgba", &box_filter()), &shader)
}

fn square_image() -> Build {
    Build { camera: vec![("int[2] resolution", vec![64.0, 64.0])], ..Build::default() }
}

/// Returns the number of pixels that are covered.
fn area(image: &[f32]) -> f32 {
    image.chunks(4).map(|p| p[3]).sum()
}

#[test]
fn narrow_and_wide_fields_of_view_show_the_exact_area() {
    // The field of view of 0.01 degrees has 32 / tan (0.005 degrees) pixels per unit at depth 1.
    for (fov, z, radius) in [(0.01_f32, 1000.0, 0.05_f32), (0.01, 4.0e5, 20.0)] {
        let mut build = square_image();
        build.camera.extend([("float fov", vec![fov]), ("float near", vec![1e-4])]);
        build.sphere(radius, &[], at(0.0, 0.0, z));
        let scale = 32.0 / (fov.to_radians() / 2.0).tan();
        // The cone touches the sphere.
        let seen = scale * radius / (z * z - radius * radius).sqrt();
        let (found, exact) = (area(&shaded(&build, &[])), std::f32::consts::PI * seen * seen);
        assert!((found / exact - 1.0).abs() < 0.02, "{found} instead of {exact} at {fov} degrees");
    }
    // Geometry far to the side is at the right place at 179 degrees. It has x = 50 at depth 1, where half the image is
    // 114.6 units wide.
    let mut build = square_image();
    build.camera.push(("float fov", vec![179.0]));
    build.square(10.0, &[], at(50.0, 0.0, 1.0));
    let image = shaded(&build, &[]);
    let edge = |x: f32| (32.0 + 32.0 * x / 89.5_f32.to_radians().tan()) as usize;
    assert_eq!(pixel(&image, 4, edge(40.0) + 1, 32)[3], 1.0);
    assert_eq!(pixel(&image, 4, edge(60.0) - 1, 32)[3], 1.0);
    assert_eq!(pixel(&image, 4, edge(60.0) + 2, 32)[3], 0.0);
}

#[test]
fn extreme_clipping_planes_show_the_scene() {
    let mut build = square_image();
    build.camera.extend([("float near", vec![1e-6]), ("float far", vec![1e30])]);
    let floor = Transform::rotate(std::f32::consts::FRAC_PI_2, Vec3::X)
        .then(&Transform::translate(Vec3::new(0.0, -1.0, 0.0)));
    build.square(100.0, &[("color C", &[0.2, 0.4, 0.6])], floor.into());
    build.sphere(1.0, &[("color C", &[1.0, 0.5, 0.2])], at(0.0, 1.0, 5.0));
    let image = shaded(&build, &[]);
    // The floor fills the image below the horizon, and the sphere is whole.
    for y in 34..64 {
        for x in 0..64 {
            assert_eq!(pixel(&image, 4, x, y)[3], 1.0, "{x} {y}");
        }
    }
    assert_eq!(pixel(&image, 4, 32, 26)[..3], [1.0, 0.5, 0.2]);
    // A sphere at a distance of 1e13 is as large as its angle requires.
    let mut far = square_image();
    far.camera.extend([("float near", vec![1e-6]), ("float far", vec![1e30])]);
    far.sphere(1e12, &[], at(0.0, 0.0, 1e13));
    let exact = std::f32::consts::PI * 32.0 * 32.0 / 99.0;
    assert!((area(&shaded(&far, &[])) / exact - 1.0).abs() < 0.02);
}

#[test]
fn a_camera_inside_of_an_object_sees_only_this_object() {
    for radius in [0.2_f32, 1.0, 1e6] {
        let mut build = square_image();
        build.camera.extend([("float near", vec![1e-3]), ("float far", vec![1e8])]);
        build.sphere(radius, &[("color C", &[0.3, 0.6, 0.9])], at(0.0, 0.03 * radius, 0.02 * radius));
        build.sphere(radius * 0.1, &[], at(0.0, 0.0, radius * 3.0));
        let image = shaded(&build, &[]);
        for (k, pixel) in image.chunks(4).enumerate() {
            assert_eq!(pixel, [0.3, 0.6, 0.9, 1.0], "pixel {k} with radius {radius}");
        }
    }
}

#[test]
fn scenes_of_any_size_show_the_exact_area() {
    for size in [1e-6_f32, 1e-3, 1.0, 1e8] {
        let mut build = square_image();
        build.camera.extend([("float near", vec![0.1 * size]), ("float far", vec![1e3 * size])]);
        build.sphere(size, &[], at(0.0, 0.0, 4.0 * size));
        let exact = std::f32::consts::PI * 32.0 * 32.0 / 15.0;
        let found = area(&shaded(&build, &[]));
        assert!((found / exact - 1.0).abs() < 0.02, "{found} instead of {exact} at size {size}");
    }
}

#[test]
fn objects_too_far_from_the_origin_are_reported() {
    let said = |offset: f32| {
        let mut build = square_image();
        build.world_to_camera = Transform::translate(Vec3::new(-offset, 0.0, 0.0)).into();
        build.sphere(1.0, &[], at(offset, 0.0, 4.0));
        let view = build.view(&[]);
        let (reporter, kept) = Reporter::collecting();
        let mut outputs = one_output(&view, ("rgba", &[]), &reporter);
        let stop = AtomicBool::new(false);
        let options = FrameOptions::new(&view, &reporter, &stop);
        let shader = Painted::new(flat);
        render(&build.scene, &shader, options, std::slice::from_mut(&mut outputs), None).unwrap();
        kept.lock().iter().map(|m| m.to_string()).collect::<Vec<_>>()
    };
    assert!(said(0.0).is_empty() && said(1000.0).is_empty());
    let [text] = &said(1e8)[..] else { panic!() };
    assert!(text.contains("from the origin") && text.contains("move the scene"), "{text}");
}

#[test]
fn parameters_that_are_not_finite_are_replaced() {
    // The image is small because it is rendered often.
    let mut build = Build {
        camera: vec![
            ("int[2] resolution", vec![12.0, 10.0]),
            ("int[2] spatialquality", vec![2.0, 2.0]),
            ("int temporalquality", vec![4.0]),
            ("int dofquality", vec![4.0]),
            ("float[2] shutter", vec![0.0, 1.0]),
            ("float fstop", vec![2.0]),
            ("float focallength", vec![0.4]),
            ("float focaldistance", vec![5.0]),
        ],
        ..Build::default()
    };
    let moving = MotionTransform::from_keys(vec![
        (0.0, Transform::translate(Vec3::new(-1.0, 0.5, 4.0))),
        (1.0, Transform::translate(Vec3::new(0.5, 0.8, 5.0))),
    ])
    .unwrap();
    build.square(0.7, &[], moving);
    let tilted = Transform::rotate(1.4, Vec3::X).then(&Transform::translate(Vec3::new(0.0, -1.0, 3.0)));
    build.square(8.0, &[], tilted.into());
    let names = [
        ("float fov", 1),
        ("float[4] screen", 4),
        ("float pixelaspect", 1),
        ("float[4] crop", 4),
        ("float near", 1),
        ("float far", 1),
        ("float[2] shutter", 2),
        ("float fstop", 1),
        ("float focallength", 1),
        ("float focaldistance", 1),
        ("float stereo:separation", 1),
    ];
    for (name, n) in names {
        for value in [f32::NAN, f32::INFINITY, f32::MAX, 0.0] {
            let image = shaded(&build, &[(name, vec![value; n])]);
            assert!(image.iter().all(|v| v.is_finite()), "{name} {value}");
        }
    }
    let mut nowhere = build;
    for value in [f32::NAN, f32::INFINITY, 0.0] {
        nowhere.world_to_camera = Transform::scale(Vec3::splat(value)).into();
        assert!(shaded(&nowhere, &[]).iter().all(|v| v.is_finite()), "scaled by {value}");
    }
}

#[test]
fn opacities_and_colours_of_any_size_give_finite_pixels() {
    // Each of several layers is more opaque than possible. Nothing behind the first one is seen.
    for (opacity, color) in [(1e20_f32, 0.5_f32), (1.5, 0.5), (-1e20, 0.5), (0.5, 3e38), (1e20, 3e38)] {
        let mut build = square_image();
        for z in [3.0, 4.0, 5.0, 6.0] {
            build.square(1.0, &[("color opacity", &[0.5; 3])], at(0.0, 0.0, z));
        }
        let paint = move |grid: &mut Grid| {
            let n = grid.len();
            grid.c = granita_shade::Lanes3::splat(Vec3::splat(color), n);
            grid.opacity = granita_shade::Lanes3::splat(Vec3::splat(opacity), n);
        };
        let shader = Painted::new(paint);
        let image = render_with(&build, &build.view(&[]), 2, ("rgba", &box_filter()), &shader);
        assert!(image.iter().all(|v| v.is_finite()), "{opacity} {color}");
        let expected = match (opacity > 0.0, color < 1.0) {
            (true, true) => [0.5, 0.5, 0.5, 1.0],
            // The layers are clear, so the light of all four is visible.
            (false, true) => [2.0, 2.0, 2.0, 0.0],
            // The colour is too bright.
            (_, false) => [0.0, 0.0, 0.0, if opacity < 1.0 { 0.9375 } else { 1.0 }],
        };
        assert_eq!(pixel(&image, 4, 32, 32), expected, "{opacity} {color}");
    }
}
