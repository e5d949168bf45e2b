//! Tests images whose noise a library removes: what it gets, and which images change.

use super::live::{Viewer, ViewerFormat};
use super::{CONSTANT, finish};
use crate::{FrameReport, PassPlan, RenderEnvironment, Renderer};
use granita_base::{Param, Params};
use granita_fixture::{Fixture, param};
use granita_image::{Denoiser, Limits, NoisyImage};
use granita_scene::Output;
use parking_lot::Mutex;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// What the library got: the size, the albedo and the normals of each image.
type Seen = ([usize; 2], Vec<f32>, Vec<f32>);

/// A library that negates colours, fails, or keeps the noise.
#[derive(Default)]
struct Negative {
    seen: Mutex<Vec<Seen>>,
    /// True when the last albedo and normals were said to have noise.
    has_noisy_features: AtomicBool,
    fails: bool,
    keeps: bool,
    takes: Duration,
}

impl Denoiser for Negative {
    fn name(&self) -> &str {
        "Negative 1.0"
    }

    fn denoise(&self, image: &NoisyImage<'_>) -> Result<Vec<f32>, String> {
        assert_eq!(image.color.len(), 3 * image.width * image.height);
        let seen = ([image.width, image.height], image.albedo.to_vec(), image.normal.to_vec());
        self.seen.lock().push(seen);
        self.has_noisy_features.store(image.has_noisy_features, Ordering::Relaxed);
        std::thread::sleep(self.takes);
        match self.fails {
            true => Err("it is broken".to_owned()),
            false if self.keeps => Ok(image.color.to_vec()),
            false => Ok(image.color.iter().map(|v| -v).collect()),
        }
    }
}

/// Renders a square in the middle of the image, whose edges are noisy, in a file of each data: `0.exr`, `1.exr` and so
/// on. `change` completes the inputs.
fn render(
    folder: &Path,
    data: &[(&str, i32)],
    change: impl Fn(&mut RenderEnvironment),
) -> (FrameReport, Vec<Vec<f32>>, Vec<String>) {
    render_as(folder, data, Vec::new(), change)
}

/// Does the same with these parameters of the camera as well.
fn render_as(
    folder: &Path,
    data: &[(&str, i32)],
    camera: Vec<Param>,
    change: impl Fn(&mut RenderEnvironment),
) -> (FrameReport, Vec<Vec<f32>>, Vec<String>) {
    let mut f = Fixture::new(&[CONSTANT]);
    f.scene.cameras[0].params = Params(vec![
        param("int[2] resolution", &[24, 20][..]),
        param("float[4] crop", &[0.0_f32, 0.5, 0.0, 1.0][..]),
    ]);
    f.scene.cameras[0].params.0.extend(camera);
    let attributes = f.attributes("constant", &["camera"], &[param("color C", &[0.5, 0.25, 3.0][..])]);
    f.rectangle([-6.3; 2], [6.4; 2], 0.0, attributes);
    for (k, (data, denoise)) in data.iter().enumerate() {
        let name = match *data {
            "shown" => "shown".to_owned(),
            _ => folder.join(format!("{k}.exr")).to_str().unwrap().to_owned(),
        };
        let is_shown = *data == "shown";
        let mut params = vec![
            param("string filter", "box"),
            param("float[2] filterwidth", &[1.0_f32, 1.0][..]),
            param("int denoise", *denoise),
        ];
        if !is_shown {
            params.push(param("string pixeltype", "float"));
        }
        f.scene.outputs.push(Output {
            name: (&*name).into(),
            format: if is_shown { "iv" } else { "exr" }.into(),
            data: if is_shown { "rgba" } else { data }.into(),
            camera: "cam".into(),
            params: Params(params),
        });
    }
    let (scene, _, mut environment) = finish(&f);
    environment.registry = granita_plugin::bundled_formats(Limits::default());
    change(&mut environment);
    let report = Renderer::new(environment.clone()).render(&scene, None).unwrap();
    let image = |k: usize| {
        let file = environment.registry.open(&folder.join(format!("{k}.exr")));
        file.map(|file| file.read_level(0, 0).unwrap().to_floats()).unwrap_or_default()
    };
    (report, (0..data.len()).map(image).collect(), f.complaints())
}

#[test]
fn colours_are_denoised_with_albedo_and_normals_and_data_are_not() {
    let folder = tempfile::tempdir().unwrap();
    let data = [("rgba", 1), ("rgba", 0), ("z", 1), ("rgb, normal N, color C", 1), ("shown", 1)];
    let viewer = Arc::new(Viewer::default());
    let with = |library: Option<Arc<Negative>>| {
        let viewer = viewer.clone();
        render(folder.path(), &data, move |environment| {
            environment.registry.register(Arc::new(ViewerFormat(viewer.clone())));
            environment.denoiser = library.clone().map(|library| library as Arc<dyn Denoiser>);
        })
    };
    let (_, plain, _) = with(None);
    let library = Arc::<Negative>::default();
    let (report, images, complaints) = with(Some(library.clone()));
    assert!(report.complete && complaints.is_empty(), "{complaints:?}");
    let denoised = report.statistics[0].1.denoised.as_ref().unwrap();
    assert_eq!(denoised.library, "Negative 1.0");
    // The image with alpha, two layers of the third image, and what is shown.
    let seen = library.seen.lock();
    assert_eq!(seen.len(), 4);
    let (size, albedo, normal) = &seen[0];
    assert_eq!(*size, [12, 20]);
    let middle = 3 * (10 * 12 + 11);
    assert_eq!(albedo[middle..][..3], [0.5, 0.25, 1.0], "an albedo is at most 1");
    assert_eq!(normal[middle..][..3], [0.0, 0.0, 1.0]);
    assert_eq!([&albedo[..3], &normal[..3]], [[0.0; 3]; 2], "nothing is there");
    for (k, (own, plain)) in images[0].chunks(4).zip(plain[0].chunks(4)).enumerate() {
        assert_eq!(own, [-plain[0], -plain[1], -plain[2], plain[3]], "{k}");
    }
    assert!(images[1] == plain[1] && images[2] == plain[2]);
    for (own, plain) in images[3].chunks(9).zip(plain[3].chunks(9)) {
        let expected: Vec<f32> =
            plain.iter().enumerate().map(|(c, v)| if (3..6).contains(&c) { *v } else { -v }).collect();
        assert_eq!(own, expected);
    }
    assert!(viewer.seen.lock().pixels == images[0], "the viewer shows the image without noise at the end");
    let says = |k: usize| {
        let registry = granita_plugin::bundled_formats(Limits::default());
        let file = registry.open(&folder.path().join(format!("{k}.exr"))).unwrap();
        file.spec(0, 0).unwrap().string("granita/denoised").map(str::to_owned)
    };
    assert_eq!([says(0), says(1)], [Some("Negative 1.0".to_owned()), None]);
}

#[test]
fn a_library_that_fails_leaves_the_noise() {
    let folder = tempfile::tempdir().unwrap();
    let run = |fails: Option<bool>| {
        render(folder.path(), &[("rgb", 1)], |environment| {
            environment.denoiser =
                fails.map(|fails| Arc::new(Negative { fails, ..Negative::default() }) as Arc<dyn Denoiser>);
        })
    };
    let (_, plain, _) = run(None);
    let (report, images, complaints) = run(Some(true));
    assert!(!report.complete && images == plain);
    assert_eq!(complaints, ["error: camera \"cam\": its images keep their noise: it is broken"]);
    // Nothing but data: nothing is rendered for the library.
    let library = Arc::<Negative>::default();
    let (report, ..) = render(folder.path(), &[("z", 1), ("color many[2]", 1)], |environment| {
        environment.denoiser = Some(library.clone() as Arc<dyn Denoiser>);
    });
    assert!(report.complete && report.statistics[0].1.denoised.is_none());
    assert_eq!(library.seen.lock().len(), 0);
}

#[test]
fn passes_are_denoised_in_time_and_their_error_is_measured() {
    let folder = tempfile::tempdir().unwrap();
    let run = |passes: Option<u32>, seconds: Option<f32>, library: Option<Duration>| {
        let library = library.map(|takes| Arc::new(Negative { takes, ..Negative::default() }));
        let (report, images, _) = render(folder.path(), &[("rgb", 1)], |environment| {
            environment.denoiser = library.clone().map(|library| library as Arc<dyn Denoiser>);
            let deadline = seconds.map(|seconds| Instant::now() + Duration::from_secs_f32(seconds));
            environment.passes = Some(PassPlan { passes, deadline, ..PassPlan::default() });
        });
        let count = library.map_or(0, |library| library.seen.lock().len());
        let statistics = &report.statistics[0].1;
        let error = statistics.denoised.as_ref().and_then(|done| done.error);
        (statistics.passes.as_ref().unwrap().passes, images, count, error)
    };
    let plain = run(Some(3), None, None);
    let denoised = run(Some(3), None, Some(Duration::ZERO));
    // The image, and both halves of its passes.
    assert_eq!((plain.0, denoised.0, denoised.2), (3, 3, 3));
    assert!(plain.1[0].iter().zip(&denoised.1[0]).all(|(a, b)| *a == -b));
    let mean = |f: fn(&f32) -> f32| plain.1[0].iter().map(f).sum::<f32>() / plain.1[0].len() as f32;
    let expected = f64::from(2.0 * mean(|v| v * v).sqrt() / mean(|v| *v));
    let found = denoised.3.unwrap();
    assert!((found.error - expected).abs() < 0.02 * expected, "{found:?} {expected}");
    assert!(found.bound > found.error, "{found:?}");
    let registry = granita_plugin::bundled_formats(Limits::default());
    let spec = registry.open(&folder.path().join("0.exr")).unwrap().spec(0, 0).unwrap().clone();
    let stored =
        ["granita/denoisederror", "granita/denoisederror95"].map(|name| spec.string(name).unwrap().parse());
    assert_eq!(stored, [Ok(found.error), Ok(found.bound)]);
    // One pass has no halves.
    let one = run(Some(1), None, Some(Duration::ZERO));
    assert_eq!((one.2, one.3), (1, None));
    // With a deadline, the time of the library is measured before, and is left at the end: 0.6 s of 1 s are over after
    // the measurement, and the other 0.4 s do not suffice for the library.
    let slow = run(None, Some(1.0), Some(Duration::from_millis(600)));
    assert_eq!((slow.0, slow.2), (1, 2));
    assert!(run(None, Some(1.0), Some(Duration::ZERO)).0 > 1);
}

#[test]
fn passes_end_when_the_error_without_noise_is_reached() {
    let folder = tempfile::tempdir().unwrap();
    let run = |error: f32, passes: Option<u32>, seconds: Option<u64>, library: Negative| {
        let library = Arc::new(library);
        let (report, _, mut complaints) = render(folder.path(), &[("rgb", 1), ("z", 1)], |environment| {
            environment.denoiser = Some(library.clone() as Arc<dyn Denoiser>);
            let deadline = seconds.map(|seconds| Instant::now() + Duration::from_secs(seconds));
            let grace = Duration::ZERO;
            environment.passes =
                Some(PassPlan { passes, deadline, grace, error: Some(error), ..PassPlan::default() });
        });
        let statistics = &report.statistics[0].1;
        let denoised = statistics.denoised.as_ref().and_then(|done| done.error);
        complaints.retain(|text| !text.starts_with("camera"));
        (statistics.passes.clone().unwrap(), denoised, complaints, statistics.denoised.clone())
    };
    // A library that keeps the noise has the error of the passes.
    let keeps = || Negative { keeps: true, ..Negative::default() };
    let (report, denoised, complaints, _) = run(0.01, None, None, keeps());
    let (found, noise) = (denoised.unwrap(), report.error.unwrap());
    assert!(report.passes > 2 && report.requested == Some(0.01) && !report.is_short, "{report:?}");
    assert!(found.bound <= 0.01 * 1.05 && complaints.is_empty(), "{found:?} {complaints:?}");
    assert!((found.error / noise.error - 1.0).abs() < 0.5, "{found:?} {noise:?}");
    // An error that is larger than that of the first passes needs no more.
    assert_eq!(run(10.0, None, None, keeps()).0.passes, 2);
    // With a time as well, whichever is first ends the passes.
    assert_eq!(run(10.0, None, Some(60), keeps()).0.passes, 2);
    // An image keeps its noise where the library leaves more than the requested error, and noise less.
    let (report, denoised, complaints, done) = run(0.01, None, None, Negative::default());
    assert!(report.error.unwrap().bound <= 0.01 * 1.05 && !report.is_short, "{report:?}");
    assert_eq!((denoised, complaints), (None, Vec::new()));
    assert!(done.unwrap().rejected.unwrap().error > 0.5);
    let spec = granita_plugin::bundled_formats(Limits::default());
    let spec = spec.open(&folder.path().join("0.exr")).unwrap().spec(0, 0).unwrap().clone();
    assert_eq!(spec.string("granita/denoised"), None);
    // Where both are more, that is said.
    let (report, _, complaints, _) = run(0.001, Some(5), None, Negative::default());
    assert!(report.is_short && report.passes == 5);
    assert_eq!(
        complaints,
        ["warning: camera \"cam\": the error of 0.100 % was not reached before the passes ended"]
    );
    // Nobody waits for an error that is never known.
    let (report, denoised, complaints, _) =
        run(0.05, None, None, Negative { fails: true, ..Negative::default() });
    assert_eq!((report.passes, denoised), (2, None));
    assert!(complaints[0].contains("keep their noise: it is broken"), "{complaints:?}");
}

#[test]
fn features_have_noise_where_the_camera_is_out_of_focus() {
    let folder = tempfile::tempdir().unwrap();
    let lens = ["float fstop", "float focallength", "float focaldistance"].map(|name| param(name, 2.0));
    for (camera, is_noisy) in [(Vec::new(), false), (lens.to_vec(), true)] {
        let library = Arc::<Negative>::default();
        let (report, ..) = render_as(folder.path(), &[("rgb", 1)], camera, |environment| {
            environment.denoiser = Some(library.clone() as Arc<dyn Denoiser>);
        });
        assert!(report.complete && library.seen.lock().len() == 1);
        assert_eq!(library.has_noisy_features.load(Ordering::Relaxed), is_noisy);
    }
}
