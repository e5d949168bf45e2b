// tidy: tests
//! Tests frames whose shaders trace rays, and images that are shown while they are rendered.

use crate::{CameraView, RenderEnvironment, ShadingStatistics, Silent};
use granita_base::{Environment, Params, SearchPath, ShapeDesc, Transform, Vec3};
use granita_fixture::{Fixture, param};
use granita_image::FormatRegistry;
use granita_scene::Scene;
use granita_sdb::Databases;
use granita_shading::ShadingContext;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

mod denoise;
mod live;

const CONSTANT: &str = "surface constant () { C *= opacity; }";
const POINT: &str = "light pointlight (float intensity = 1, string shadowname = \"\", float samples = 1)
{
    emit (point (\"shader\", 0, 0, 0)) {
        Cl = intensity / dot (L, L);
        if (shadowname) Cl *= 1 - (color) shadow (shadowname, Ps, \"samples\", samples);
    }
}";

/// Returns the finished scene of a fixture, its camera, and the inputs of a frame.
pub(crate) fn finish(fixture: &Fixture) -> (Arc<Scene>, CameraView, RenderEnvironment) {
    let environment = RenderEnvironment {
        keep_partial: false,
        registry: FormatRegistry::default(),
        shaders: Arc::new(fixture.compiled()),
        texture_path: SearchPath::default(),
        variables: Environment::empty(),
        reporter: fixture.reporter.clone(),
        progress: Arc::new(Silent),
        threads: 2,
        open_files: None,
        stop: Arc::new(AtomicBool::new(false)),
        call_text: |calls, _| Ok(format!("{calls:?}\n").into_bytes()),
        databases: Arc::new(Databases::new(FormatRegistry::default(), fixture.reporter.clone())),
        scene_files: Vec::new(),
        spread: crate::Spread::Alone,
        priority: Default::default(),
        passes: None,
        denoiser: None,
        crop: None,
    };
    let (scene, camera) = fixture.view();
    (scene, camera, environment)
}

/// Returns the "rgb" pixels of a whole frame.
fn image(fixture: &Fixture, threads: usize, bucket: i32) -> Vec<f32> {
    image_within(fixture, threads, bucket, u64::MAX).0
}

/// Returns the "rgb" pixels of a whole frame with at most `limit` bytes of tessellations for rays, and the statistics
/// of shading.
fn image_within(fixture: &Fixture, threads: usize, bucket: i32, limit: u64) -> (Vec<f32>, ShadingStatistics) {
    let (scene, _, mut environment) = finish(fixture);
    environment.registry = granita_plugin::bundled_formats(granita_image::Limits::default());
    environment.threads = threads;
    let mut camera = scene.cameras[0].clone();
    camera.params.set(param("int[2] resolution", &[40, 30][..]));
    camera.params.set(param("int[2] spatialquality", &[2, 2][..]));
    camera.params.set(param("int[2] limits:bucketsize", &[bucket, bucket][..]));
    let view = CameraView::new(&camera, &environment.reporter);
    let frame = ShadingContext::new(&scene, &view, &environment.shading());
    frame.limit_tessellations(limit);
    let output = granita_scene::Output {
        name: "never written".into(),
        format: "tiff".into(),
        data: "rgb".into(),
        camera: "cam".into(),
        params: Params::new(),
    };
    let mut outputs =
        crate::output::plan::OutputSet::new(&[&output], &view, &environment.registry, &environment.reporter)
            .unwrap();
    let options = crate::frame::FrameOptions {
        threads,
        ..crate::frame::FrameOptions::new(&view, &environment.reporter, &environment.stop)
    };
    crate::frame::render(&scene, &frame, options, std::slice::from_mut(&mut outputs), None).unwrap();
    (outputs.images.remove(0).pixels, frame.statistics())
}

#[test]
fn ray_traced_images_do_not_depend_on_threads_or_buckets() {
    let glossy = "surface glossy () {
        C *= diffuse (normalize (N)) +
             environment (\"all\", reflect (normalize (I), normalize (N)), \"blur\", 0.2, \"samples\", 2);
        C *= opacity;
    }";
    let mut f = Fixture::new(&[glossy, POINT]);
    let params =
        [param("string shadowname", "all"), param("float samples", 2.0), param("float intensity", 30.0)];
    f.light("pointlight", &params, Transform::translate(Vec3::new(3.0, 2.0, 6.0)));
    let sets = &["camera", "all"];
    let floor = f.attributes("glossy", sets, &[]);
    f.rectangle([-9.0; 2], [9.0; 2], 0.0, floor);
    for (k, opacity) in [1.0, 0.4_f32, 1.0].into_iter().enumerate() {
        let color = [param("color opacity", &[opacity; 3][..])];
        let ball = f.attributes("glossy", sets, &color);
        f.sphere(Vec3::new(2.5 * k as f32 - 2.5, 0.5, 1.2), 1.0, ball);
    }
    let reference = image(&f, 1, 32);
    assert!(reference.iter().any(|v| *v > 0.1));
    for (threads, bucket) in [(3, 32), (2, 7), (1, 64)] {
        assert!(image(&f, threads, bucket) == reference, "{threads} threads, buckets of {bucket}");
    }
    // The pixels also do not depend on whether the balls share a tree.
    let (pixels, counts) = image_within(&f, 2, 16, 100_000);
    assert!(pixels == reference && counts.ray_tessellations > 0, "{counts:?}");
}

#[test]
fn faces_of_a_subdivision_surface_share_the_records_of_their_corners() {
    let occluded = "surface occluded () {
        C = 1 - occlusion (\"all\", P, normalize (N), PI / 2, \"samples\", 4, \"maxerror\", 100,
                           \"maxpixeldist\", 1e6);
    }";
    let mut f = Fixture::new(&[occluded]);
    const SIDE: i32 = 13;
    let at = |k: i32| [(k % SIDE) as f32 * 0.5 - 3.0, (k / SIDE) as f32 * 0.5 - 3.0];
    let height = |[x, y]: [f32; 2]| 0.3 * (3.0 * x).sin() * (2.0 * y + x).cos();
    let p: Vec<f32> = (0..SIDE * SIDE).map(at).flat_map(|xy| [xy[0], xy[1], height(xy)]).collect();
    let corners = (0..SIDE - 1).flat_map(|j| (0..SIDE - 1).map(move |i| j * SIDE + i));
    let verts: Vec<i32> = corners.flat_map(|k| [k, k + 1, k + SIDE + 1, k + SIDE]).collect();
    let nverts = vec![4; verts.len() / 4];
    let shape = ShapeDesc::Mesh { subdivide: true, nverts: nverts.into(), verts: verts.into() };
    let own = f.attributes("occluded", &["camera", "all"], &[]);
    f.add(shape, Params(vec![param("vertex point P", &p[..])]), own);
    let (_, counts) = image_within(&f, 2, 16, u64::MAX);
    // Normals of two faces at a corner mostly differ in their last bits only.
    let corners = (SIDE * SIDE) as u64;
    assert!((corners / 2..corners * 5 / 4).contains(&counts.light_records), "{counts:?}");
}
