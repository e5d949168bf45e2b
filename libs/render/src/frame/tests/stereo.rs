//! Tests two eyes that share their grids.

use super::*;
use granita_base::hash;
use granita_dicing::{EyeProjection, ShadedFrom, Stereo};

const STEREO: Stereo = Stereo {
    separation: 0.4,
    convergence: 4.5,
    projection: EyeProjection::OffAxis,
    shade: ShadedFrom::Center,
};

/// Returns the images of the eyes, and the statistics of the frame.
fn seen<S: FrameShader>(
    build: &Build,
    view: &CameraView,
    eyes: &[CameraView],
    threads: usize,
    shader: &S,
) -> (Vec<Vec<f32>>, Statistics) {
    let reporter = Reporter::silent();
    let set = one_output(view, ("rgba", &box_filter()), &reporter);
    let mut outputs = vec![set; eyes.len()];
    let stop = AtomicBool::new(false);
    let options = FrameOptions {
        eyes,
        dicing_camera: &view.shading_view(),
        threads,
        ..FrameOptions::new(view, &reporter, &stop)
    };
    let (statistics, complete) = render(&build.scene, shader, options, &mut outputs, None).unwrap();
    assert!(complete);
    (outputs.into_iter().map(|mut set| set.images.remove(0).pixels).collect(), statistics)
}

fn stereo_images(build: &Build, stereo: Stereo) -> Vec<Vec<f32>> {
    let view = CameraView { stereo: Some(stereo), ..build.view(&[]) };
    seen(build, &view, &view.eyes().unwrap(), 1, &Painted::new(flat)).0
}

#[test]
fn eyes_at_the_camera_give_the_image_of_the_camera() {
    let build = busy();
    let shader = Painted { displace: Some(0.02), ..Painted::new(wavy) };
    let view = build.view(&[]);
    let mono = render_with(&build, &view, 1, ("rgba", &box_filter()), &shader);
    for projection in [EyeProjection::OffAxis, EyeProjection::Parallel, EyeProjection::ToeIn] {
        let eye = view.eye(&Stereo { projection, ..STEREO }, 0.0);
        let (images, _) = seen(&build, &view, &[eye.clone(), eye], 1, &shader);
        assert!(images[0] == mono && images[1] == mono, "{projection:?}");
    }
}

#[test]
fn stereo_images_do_not_depend_on_threads_buckets_or_crops() {
    let build = busy();
    let shader = Painted { displace: Some(0.02), ..Painted::new(wavy) };
    for projection in [EyeProjection::OffAxis, EyeProjection::ToeIn] {
        let stereo = |more: &[(&'static str, Vec<f32>)]| CameraView {
            stereo: Some(Stereo { projection, ..STEREO }),
            ..build.view(more)
        };
        let images =
            |view: &CameraView, threads| seen(&build, view, &view.eyes().unwrap(), threads, &shader).0;
        let whole = stereo(&[]);
        let reference = images(&whole, 1);
        assert!(reference[0] != reference[1]);
        assert!(images(&whole, 3) == reference, "three threads");
        let small = stereo(&[("int[2] limits:bucketsize", vec![7.0, 5.0])]);
        assert!(images(&small, 2) == reference, "small buckets");
        let crop = stereo(&[("float[4] crop", vec![0.3, 0.8, 0.2, 0.7])]);
        let rect = crop.crop;
        for (part, whole) in images(&crop, 2).iter().zip(&reference) {
            for (j, row) in part.chunks(rect.width() * 4).enumerate() {
                let from = ((rect.y0 as usize + j) * 61 + rect.x0 as usize) * 4;
                assert!(row == &whole[from..from + row.len()], "row {j} of the crop");
            }
        }
    }
}

/// Returns the column of the centre of mass of the alpha, in pixels.
fn middle(image: &[f32], width: usize) -> f32 {
    let (mut mass, mut first) = (0.0, 0.0);
    for (k, pixel) in image.chunks(4).enumerate() {
        mass += pixel[3];
        first += pixel[3] * ((k % width) as f32 + 0.5);
    }
    first / mass
}

#[test]
fn objects_are_apart_by_their_disparity() {
    // The image is 64 pixels high and covers 90 degrees, which is 32 pixels per unit at depth 1.
    let base = || Build {
        camera: vec![("int[2] resolution", vec![96.0, 64.0]), ("int[2] spatialquality", vec![16.0, 16.0])],
        ..Build::default()
    };
    for (z, lens, moves) in [(4.5, false, false), (2.0, false, false), (9.0, false, true), (3.0, true, false)]
    {
        let mut build = base();
        if lens {
            // The depth of convergence is in focus. The square here is not.
            build.camera.extend([
                ("float fstop", vec![2.0]),
                ("float focallength", vec![0.5]),
                ("float focaldistance", vec![4.5]),
                ("int dofquality", vec![256.0]),
            ]);
        }
        let still = Transform::translate(Vec3::new(0.1, 0.05, z));
        let to_world = if moves {
            build.camera.push(("float[2] shutter", vec![0.0, 1.0]));
            let end = Transform::translate(Vec3::new(0.9, 0.05, z));
            MotionTransform::from_keys(vec![(0.0, still), (1.0, end)]).unwrap()
        } else {
            still.into()
        };
        build.square(z / 16.0, &[], to_world);
        for projection in [EyeProjection::OffAxis, EyeProjection::Parallel] {
            let [l, r] = &stereo_images(&build, Stereo { projection, ..STEREO })[..] else { panic!() };
            let zero = if projection == EyeProjection::OffAxis { 1.0 / 4.5 } else { 0.0 };
            let exact = 32.0 * 0.4 * (1.0 / z - zero);
            let found = middle(l, 96) - middle(r, 96);
            let tolerance = if lens { 0.05 } else { 0.02 };
            assert!((found - exact).abs() < tolerance, "{found} instead of {exact} at {z}, {projection:?}");
        }
    }
}

#[test]
fn objects_that_one_eye_alone_sees_are_rendered() {
    // The frustum of the middle ends at x = 3 at this depth, and that of the right eye at 3.5.
    let mut build = Build {
        camera: vec![("int[2] resolution", vec![64.0, 64.0]), ("int[2] limits:bucketsize", vec![16.0, 16.0])],
        ..Build::default()
    };
    build.square(0.2, &[], at(3.25, 0.0, 3.0));
    let stereo = Stereo { separation: 1.0, projection: EyeProjection::Parallel, ..STEREO };
    let mass = |image: &[f32]| image.chunks(4).map(|p| p[3]).sum::<f32>();
    for shade in [ShadedFrom::Center, ShadedFrom::Left, ShadedFrom::Right] {
        let images = stereo_images(&build, Stereo { shade, ..stereo });
        assert_eq!(mass(&images[0]), 0.0);
        // The square has 0.4 units per side, and a unit is 32 / 3 pixels.
        let exact = (0.4 * 32.0 / 3.0_f32).powi(2);
        assert!((mass(&images[1]) / exact - 1.0).abs() < 0.02, "{}", mass(&images[1]));
    }
}

#[test]
fn grids_are_shaded_once_for_both_eyes() {
    let build = busy();
    let shader = Painted::new(wavy);
    let view = CameraView { stereo: Some(STEREO), ..build.view(&[]) };
    let [left, right] = view.eyes().unwrap();
    let points = |eyes: &[CameraView]| seen(&build, &view, eyes, 2, &shader).1.points_shaded;
    let (one, other) = (points(std::slice::from_ref(&left)), points(std::slice::from_ref(&right)));
    let both = points(&[left, right]);
    assert!(both < one + other / 4 && both >= one.max(other), "{both} for both, {one} and {other} alone");
}

#[test]
fn extreme_stereo_values_give_finite_pixels() {
    let build = busy();
    let shader = Painted::new(flat);
    let odd = [1e-30, 1e30, f32::MAX, -3.0, 1e-3];
    for (k, separation) in odd.into_iter().enumerate() {
        for convergence in odd {
            let projection = [EyeProjection::OffAxis, EyeProjection::Parallel, EyeProjection::ToeIn]
                [hash::mix32(k as u32) as usize % 3];
            let stereo = Stereo { separation, convergence, projection, ..STEREO };
            let view = CameraView { stereo: Some(stereo), ..build.view(&[]) };
            let (images, _) = seen(&build, &view, &view.eyes().unwrap(), 1, &shader);
            assert!(images.iter().flatten().all(|v| v.is_finite()), "{stereo:?}");
        }
    }
}
