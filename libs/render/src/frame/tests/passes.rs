//! Tests "limits:autopassreduction", which takes fewer samples where nothing blurs.

use super::*;

/// Returns a scene with a moving square on the left and a still sphere on the right.
fn half_moving() -> Build {
    let mut build = flat_camera();
    build.camera.push(("float[2] shutter", vec![0.0, 1.0]));
    let moving = MotionTransform::from_keys(vec![
        (0.0, Transform::translate(Vec3::new(-3.0, -0.3, 3.0))),
        (1.0, Transform::translate(Vec3::new(-2.0, 0.4, 3.0))),
    ])
    .unwrap();
    build.square(0.6, &[("color C", &[0.9, 0.3, 0.1])], moving);
    build.sphere(1.5, &[("color C", &[0.2, 0.4, 0.9])], at(2.0, 0.1, 5.0));
    build
}

fn with(build: &Build, more: &[(&'static str, Vec<f32>)]) -> Vec<f32> {
    let shader = Painted::new(flat);
    render_with(build, &build.view(more), 2, ("rgba", &[]), &shader)
}

#[test]
fn still_pixels_take_spatial_samples_and_moving_ones_all() {
    let build = half_moving();
    let many = ("int temporalquality", vec![64.0]);
    let reduced = with(&build, std::slice::from_ref(&many));
    let full = with(&build, &[many.clone(), ("int limits:autopassreduction", vec![0.0])]);
    let still = with(&build, &[("float[2] shutter", vec![0.0, 0.0])]);
    assert!(reduced != full);
    let (mut moving_pixels, mut still_pixels) = (0, 0);
    for y in 0..48 {
        for x in 0..64 {
            let [reduced, full, still] = [&reduced, &full, &still].map(|image| pixel(image, 4, x, y));
            // The square sweeps from x = 3 to 21 and from y = 16 to 31. The filter adds a margin.
            if x > 24 {
                assert_eq!(reduced, still, "at {x} {y}");
                still_pixels += usize::from(full != still);
            } else if (5..20).contains(&x) && (18..30).contains(&y) {
                assert_eq!(reduced, full, "at {x} {y}");
                moving_pixels += usize::from(full[3] > 0.0);
            }
        }
    }
    assert!(moving_pixels > 50 && still_pixels > 20, "{moving_pixels} {still_pixels}");
}

#[test]
fn pass_reduction_changes_only_invisible_blur() {
    let off = ("int limits:autopassreduction", vec![0.0]);
    let build = half_moving();
    assert!(with(&build, &[]) == with(&build, std::slice::from_ref(&off)), "what stands still is the same");
    // The sphere is 40 pixels wide and moves by 0.004 pixels.
    let mut slow = flat_camera();
    slow.camera.push(("float[2] shutter", vec![0.0, 1.0]));
    let moving = MotionTransform::from_keys(vec![
        (0.0, Transform::translate(Vec3::new(0.0, 0.0, 5.0))),
        (1.0, Transform::translate(Vec3::new(0.0005, 0.0, 5.0))),
    ])
    .unwrap();
    slow.sphere(2.5, &[("color C", &[0.9, 0.3, 0.1])], moving);
    let (a, b) = (with(&slow, &[]), with(&slow, std::slice::from_ref(&off)));
    let worst = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst < 0.04, "{worst}");
    let mean = a.iter().zip(&b).map(|(a, b)| f64::from(a - b)).sum::<f64>() / a.len() as f64;
    assert!(mean.abs() < 1e-4, "{mean}");
}

#[test]
fn reduced_pixels_do_not_depend_on_buckets_or_crops() {
    let mut build = busy();
    build.camera.retain(|(name, _)| *name != "float fstop");
    build.camera.push(("int temporalquality", vec![40.0]));
    let shader = Painted::new(wavy);
    let image = |view: &CameraView, threads| render_with(&build, view, threads, ("rgba", &[]), &shader);
    let reference = image(&build.view(&[]), 1);
    let all = build.view(&[("int limits:autopassreduction", vec![0.0])]);
    assert!(image(&all, 1) != reference, "some pixels have fewer samples");
    assert!(image(&build.view(&[("int[2] limits:bucketsize", vec![7.0, 5.0])]), 3) == reference);
    let crop = build.view(&[("float[4] crop", vec![0.3, 0.8, 0.2, 0.7])]);
    let rect = crop.crop;
    for (j, row) in image(&crop, 2).chunks(rect.width() * 4).enumerate() {
        let from = ((rect.y0 as usize + j) * 61 + rect.x0 as usize) * 4;
        assert!(row == &reference[from..from + row.len()], "row {j} of the crop");
    }
}

#[test]
fn depth_passes_trust_the_attribute_for_opacity() {
    let counted = |list: &[(&str, &[f32])], data: &str| {
        let mut build = flat_camera();
        build.square(2.0, list, at(0.0, 0.0, 5.0));
        let shader = Painted::new(flat);
        let (pixels, statistics) =
            render_counted(&build, &build.view(&[]), 1, (data, &box_filter()), &shader);
        (pixels[24 * 64 + 32], statistics.grids_shaded)
    };
    let (half, forced): (&[f32], &[f32]) = (&[0.5; 3], &[1.0]);
    let (z, shaded) = counted(&[("color opacity", half)], "z");
    assert!(z > 1e6 && shaded > 0, "{z} {shaded}");
    let trusted = [("color opacity", half), ("int ray:opaqueshadows", forced)];
    assert_eq!(counted(&trusted, "z"), (5.0, 0));
    // Colours still need shading.
    assert!(counted(&trusted, "rgb").1 > 0);
}
