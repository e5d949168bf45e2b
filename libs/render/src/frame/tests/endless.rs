//! Tests scenes that require more resources than any machine has. The visible parts are rendered, and the others are
//! left out with a message.

use super::huge::corners_of;
use super::*;
use granita_base::CurveBasis::{Bezier, Linear};

/// Returns the pixels and the messages.
fn rendered(build: &Build) -> (Vec<f32>, Vec<String>) {
    let (reporter, kept) = Reporter::collecting();
    let view = build.view_reporting(&[], &reporter);
    let mut outputs = one_output(&view, ("rgba", &box_filter()), &reporter);
    let stop = AtomicBool::new(false);
    let options = FrameOptions { threads: 2, ..FrameOptions::new(&view, &reporter, &stop) };
    let shader = Painted::new(flat);
    render(&build.scene, &shader, options, std::slice::from_mut(&mut outputs), None).unwrap();
    let said = kept.lock().iter().map(|m| m.to_string()).collect();
    (outputs.images.remove(0).pixels, said)
}

fn small() -> Build {
    Build { camera: vec![("int[2] resolution", vec![64.0, 64.0])], ..Build::default() }
}

fn quad(build: &mut Build, mesh: bool, corners: &[f32; 12], list: &[(&str, &[f32])]) {
    let params = Params(vec![param("vertex point P", corners)]);
    let shape = match mesh {
        true => ShapeDesc::Mesh { subdivide: false, nverts: [4].into(), verts: [0, 1, 3, 2].into() },
        false => ShapeDesc::Patch { u: Linear, v: Linear, nu: 2, nv: 2 },
    };
    build.add(shape, params, attributes(list, at(0.0, 0.0, 4.0)));
}

/// Returns the fraction of the image that is covered, and the messages. Checks that every pixel is finite.
fn covered(build: &Build) -> (f32, Vec<String>) {
    let (image, said) = rendered(build);
    assert!(image.iter().all(|v| v.is_finite()), "{said:?}");
    (image.chunks(4).map(|p| p[3]).sum::<f32>() / (image.len() / 4) as f32, said)
}

#[test]
fn one_vertex_far_away_does_not_change_the_image() {
    let directions = [[1.0, 1.0, 0.0], [1.0, 0.3, 0.7], [1.0, 0.5, -1.0], [0.0, 0.0, 1.0], [-0.2, 0.1, -1.0]];
    for d in directions {
        let with = |mesh: bool, size: f32| {
            let mut build = small();
            let mut corners = corners_of(1.0);
            (0..3).for_each(|x| corners[9 + x] = d[x] * size);
            quad(&mut build, mesh, &corners, &[]);
            covered(&build).0
        };
        let near = with(false, 1e5);
        for (mesh, size) in [(false, 1e8_f32), (true, 1e8), (false, 1e12)] {
            let found = with(mesh, size);
            assert!((found - near).abs() < 1e-3, "{found} instead of {near}, {d:?} {size:e} mesh {mesh}");
        }
        // Positions that are no longer distinguishable may be rendered in any way, but rendering ends.
        with(true, 1e15);
    }
}

#[test]
fn one_bezier_vertex_far_away_does_not_panic() {
    for size in [1e10_f32, 1e20, 1e30] {
        let mut build = small();
        let mut points: Vec<f32> =
            (0..16).flat_map(|i| [(i % 4) as f32 / 1.5 - 1.0, (i / 4) as f32 / 1.5 - 1.0, 0.0]).collect();
        points[15] = size;
        let shape = ShapeDesc::Patch { u: Bezier, v: Bezier, nu: 4, nv: 4 };
        build.add(shape, Params(vec![param("vertex point P", &points)]), attributes(&[], at(0.0, 0.0, 4.0)));
        covered(&build);
    }
}

#[test]
fn tiny_fields_of_view_are_rendered_and_reported() {
    for fov in [1e-3, 1e-5, 1e-6, 1e-10, 1e-30, f32::NAN] {
        let mut build = small();
        build.camera.push(("float fov", vec![fov]));
        build.sphere(1.0, &[], at(0.0, 0.0, 4.0));
        build.square(9.0, &[], at(0.0, 1.0, 5.0));
        let (alpha, said) = covered(&build);
        assert_eq!((alpha, said.len()), (1.0, usize::from(fov.is_nan() || fov < 1e-6)), "{fov:e}: {said:?}");
    }
}

#[test]
fn dicing_rates_are_limited_and_reported() {
    let sphere = |quality: f32| {
        let mut build = small();
        build.sphere(0.1, &[("float shadingquality", &[quality])], at(0.0, 0.0, 4.0));
        covered(&build)
    };
    let (usual, _) = sphere(1.0);
    for quality in [1e6, 1e30] {
        let (alpha, said) = sphere(quality);
        assert!((alpha - usual).abs() < 1e-3 && said.len() == 1, "{alpha} {usual} {said:?}");
        assert!(said[0].contains("is more than 100"), "{said:?}");
    }
    let mut build = small();
    build.camera.push(("float preview", vec![1e30]));
    build.sphere(0.1, &[], at(0.0, 0.0, 4.0));
    let (alpha, said) = covered(&build);
    assert!(alpha > 0.0 && said.len() == 1 && said[0].contains("\"preview\""), "{alpha} {said:?}");
}

#[test]
fn a_primitive_of_too_many_points_is_skipped_alone() {
    for (name, value) in
        [("float[2] dice:fixed", &[1e20_f32, 1e20][..]), ("float dice:highcurvature", &[1e-20])]
    {
        let mut build = small();
        build.sphere(0.5, &[(name, value)], at(0.0, 0.0, 4.0));
        build.square(10.0, &[], at(0.0, 0.0, 5.0));
        let most = param("int limits:primitivepoints", &[100_000.0]);
        build.scene.globals.insert("limits:primitivepoints".into(), most);
        let (alpha, said) = covered(&build);
        assert!(alpha == 1.0 && said.len() == 1, "{alpha} {said:?}");
        assert!(said[0].contains("100000 points") && said[0].contains("limits:primitivepoints"), "{said:?}");
    }
}

#[test]
fn objects_with_invalid_transformations_are_skipped_and_reported() {
    let mut rows = Transform::IDENTITY.to_rows();
    rows[3] = 1.0;
    let through_zero = Transform::from_rows(&rows).then(&Transform::translate(Vec3::Z * 4.0));
    for (to_world, word) in [
        (through_zero, "which include 0"),
        (Transform::scale(Vec3::new(f32::NAN, 1.0, 1.0)), "not finite"),
        (Transform::translate(Vec3::new(0.0, f32::INFINITY, 4.0)), "not finite"),
    ] {
        let mut build = small();
        build.square(2.0, &[], to_world.into());
        build.square(10.0, &[], at(0.0, 0.0, 5.0));
        let (alpha, said) = covered(&build);
        assert!(alpha == 1.0 && said.len() == 1 && said[0].contains(word), "{alpha} {said:?}");
    }
    let mut build = small();
    build.world_to_camera = Transform::scale(Vec3::splat(f32::NAN)).into();
    build.square(10.0, &[], at(0.0, 0.0, 5.0));
    build.sphere(1.0, &[], at(0.0, 0.0, 5.0));
    let (alpha, said) = covered(&build);
    assert!(alpha == 1.0 && said.len() == 1 && said[0].contains("not finite"), "{alpha} {said:?}");
}

#[test]
fn objects_with_infinite_vertices_are_skipped_and_reported() {
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for mesh in [false, true] {
            let mut build = small();
            let mut corners = corners_of(1.0);
            corners[4] = bad;
            quad(&mut build, mesh, &corners, &[]);
            build.square(10.0, &[], at(0.0, 0.0, 5.0));
            let (alpha, said) = covered(&build);
            assert!(alpha == 1.0 && said.len() == 1 && said[0].contains("not finite"), "{alpha} {said:?}");
        }
    }
}
