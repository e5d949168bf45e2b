//! Tests images that are the sum of passes.

use super::timed::again_as;
use super::*;
use crate::passes::{ErrorEstimate, PassPlan, PassReport};
use granita_base::{NoiseSource, PassNumbers, hash};
use std::sync::LazyLock;
use std::sync::atomic::{AtomicU32, AtomicUsize};
use std::time::{Duration, Instant};

/// A plan of this number of passes.
pub(super) fn passes(n: u32) -> PassPlan {
    PassPlan { passes: Some(n), ..PassPlan::default() }
}

/// A plan that ends at this error.
pub(super) fn error(error: f32) -> PassPlan {
    PassPlan { passes: None, error: Some(error), ..passes(1) }
}

/// Shades with noise that differs from pass to pass, and is more on one side of each surface.
pub(super) struct Noisy {
    pub(super) pass: AtomicU32,
    /// The time that each point takes.
    pub(super) of_point: Duration,
    /// The factors of tolerances and samples that were set last.
    pub(super) factors: Mutex<[f32; 2]>,
    /// True when shading saves data.
    pub(super) saves: bool,
}

impl FrameShader for Noisy {
    type Object = ObjectTraits;
    type Thread<'a> = ();

    fn object(&self, primitive: &Primitive) -> Arc<ObjectTraits> {
        Painted::new(flat).object(primitive)
    }
    fn traits(&self, object: &ObjectTraits) -> ObjectTraits {
        ObjectTraits { saves: self.saves, ..*object }
    }
    fn thread(&self) {}
    fn begin_pass(&self, numbers: PassNumbers) {
        let all = hash::words(&[numbers.number(NoiseSource::Lights), numbers.round]);
        self.pass.store(all, Ordering::Relaxed);
    }
    fn noise_sources(&self) -> Vec<NoiseSource> {
        vec![NoiseSource::Lights]
    }
    fn set_tolerance(&self, factor: f32) {
        self.factors.lock()[0] = factor;
    }
    fn set_samples(&self, factor: f32) {
        self.factors.lock()[1] = factor;
    }
    fn displace(&self, (): &mut (), _: &ObjectTraits, _: &mut Grid) {}
    fn shade(
        &self,
        (): &mut (),
        _: &ObjectTraits,
        grid: &mut Grid,
        wanted: &[(Arc<str>, ValueType)],
    ) -> Vec<Option<Vec<f32>>> {
        std::thread::sleep(self.of_point * grid.len() as u32);
        flat(grid);
        let pass = self.pass.load(Ordering::Relaxed);
        for i in 0..grid.len() {
            let noise = hash::unit(hash::words(&[grid.seed, i as u32, pass]));
            grid.c.set(i, grid.c.get(i) * (1.0 + grid.u[i] * (noise - 0.5)));
        }
        wanted.iter().map(|_| None).collect()
    }
}

pub(super) fn noisy() -> Noisy {
    Noisy { pass: AtomicU32::new(0), of_point: Duration::ZERO, factors: Mutex::new([0.0; 2]), saves: false }
}

/// Renders passes of one output. Returns the pixels of the crop window and the report.
pub(super) fn summed<S: FrameShader>(
    build: &Build,
    view: &CameraView,
    threads: usize,
    output: (&str, &[Param]),
    (shader, plan): (&S, PassPlan),
) -> (Vec<f32>, PassReport) {
    let reporter = Reporter::silent();
    let mut outputs = one_output(view, output, &reporter);
    let stop = AtomicBool::new(false);
    let options = FrameOptions { threads, passes: Some(plan), ..FrameOptions::new(view, &reporter, &stop) };
    let (statistics, complete) =
        render(&build.scene, shader, options, std::slice::from_mut(&mut outputs), None).unwrap();
    assert!(complete);
    let image = outputs.images.remove(0);
    assert_eq!(
        image.passes.map(|passes| passes.count),
        statistics.passes.as_ref().map(|report| report.passes)
    );
    (image.pixels, statistics.passes.unwrap())
}

/// Returns the error of an image against another one, as the manual defines it.
pub(super) fn distance(a: &[f32], b: &[f32]) -> f64 {
    let squares: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    let sum: f64 = b.iter().map(|b| f64::from(*b)).sum();
    (squares / a.len() as f64).sqrt() / (sum / a.len() as f64)
}

#[test]
fn one_pass_is_the_frame_of_its_own() {
    let build = busy();
    let shader = Painted::new(wavy);
    for data in ["rgba", "rgb", "z", "normal N", "cryptomatte object"] {
        let view = build.view(&[]);
        let frame = render_with(&build, &view, 2, (data, &[]), &shader);
        let (sum, report) = summed(&build, &view, 2, (data, &[]), (&shader, passes(1)));
        assert!(frame == sum, "{data}");
        assert_eq!((report.passes, report.mean_passes, report.error), (1, 1.0, None));
    }
}

#[test]
fn passes_do_not_depend_on_threads_buckets_or_crops() {
    let build = busy();
    for plan in [passes(3), PassPlan { level: 2, ..passes(3) }, error(0.03)] {
        let (whole, report) = summed(&build, &build.view(&[]), 1, ("rgba", &[]), (&noisy(), plan));
        assert!(report.passes >= 3, "{report:?}");
        for (threads, size, order) in [(2, 7.0, "spiral"), (3, 16.0, "vertical"), (1, 64.0, "horizontal")] {
            let mut view = build.view(&[("int[2] limits:bucketsize", vec![size, size])]);
            view.bucketorder = order.into();
            let (again, other) = summed(&build, &view, threads, ("rgba", &[]), (&noisy(), plan));
            assert!(again == whole && other == report, "{threads} threads, buckets of {size}, {order}");
        }
        let view = build.view(&[("float[4] crop", vec![0.3, 0.8, 0.2, 0.9])]);
        let (part, _) = summed(&build, &view, 2, ("rgba", &[]), (&noisy(), plan));
        let crop = view.crop;
        for (k, pixel) in part.chunks_exact(4).enumerate() {
            let (x, y) = (crop.x0 as usize + k % crop.width(), crop.y0 as usize + k / crop.width());
            assert_eq!(pixel, &whole[(y * 61 + x) * 4..][..4], "{plan:?} at {x} {y}");
        }
    }
}

#[test]
fn the_mean_of_passes_converges_to_the_frame_of_many_samples() {
    let build = busy();
    let shader = Painted::new(wavy);
    let few = build.view(&[("int[2] spatialquality", vec![2.0, 2.0]), ("int temporalquality", vec![4.0])]);
    let many = build.view(&[
        ("int[2] spatialquality", vec![24.0, 24.0]),
        ("int temporalquality", vec![576.0]),
        ("int dofquality", vec![576.0]),
    ]);
    let converged = render_with(&build, &many, 2, ("rgb", &[]), &shader);
    let of = |n| summed(&build, &few, 2, ("rgb", &[]), (&shader, passes(n)));
    let [(_, _), (four, _), (sixteen, report)] = [1, 4, 16].map(of);
    let one = distance(&of(1).0, &converged);
    let (four, sixteen) = (distance(&four, &converged), distance(&sixteen, &converged));
    assert!(four < 0.65 * one && sixteen < 0.4 * one, "{one} {four} {sixteen}");
    // The passes know their error, and which block has most of it.
    let estimate = report.error.unwrap();
    assert!((0.7..1.3).contains(&(estimate.error / sixteen)), "{estimate:?} {sixteen}");
    assert!(estimate.bound > estimate.error && estimate.blocks_99 > estimate.error, "{estimate:?}");
}

#[test]
fn a_requested_error_is_reached_and_costs_passes_where_the_noise_is() {
    let build = busy();
    let view = build.view(&[("int[2] spatialquality", vec![2.0, 2.0])]);
    let (converged, _) = summed(&build, &view, 2, ("rgb", &[]), (&noisy(), passes(120)));
    for asked in [0.06, 0.03] {
        let (pixels, report) = summed(&build, &view, 2, ("rgb", &[]), (&noisy(), error(asked)));
        let reached = distance(&pixels, &converged);
        assert!(reached < 1.2 * f64::from(asked), "{asked}: {reached} {report:?}");
        assert!(!report.is_short && report.error.unwrap().bound <= f64::from(asked) * 1.05, "{report:?}");
        let is_whole = report.passes == 2;
        assert!(is_whole || report.mean_passes < f64::from(report.passes), "{report:?}");
    }
    // Where many passes are needed, they are larger, with any number of threads, but not where their number is too
    // small for the error.
    let render = |threads, plan| summed(&build, &view, threads, ("rgb", &[]), (&noisy(), plan));
    let (pixels, report) = render(2, error(0.014));
    let reached = distance(&pixels, &converged);
    assert!(
        report.samples.max(report.pixel_samples) > 1 && reached < 0.017 && !report.is_short,
        "{reached} {report:?}"
    );
    assert!(render(1, error(0.014)).0 == pixels);
    let (_, report) = render(2, PassPlan { error: Some(0.01), ..passes(40) });
    assert!(report.samples == 1 && report.passes > 16, "{report:?}");
    // An error that the number of passes does not allow is reported.
    let plan = PassPlan { error: Some(0.005), ..passes(3) };
    let (_, report) = summed(&build, &view, 2, ("rgb", &[]), (&noisy(), plan));
    assert!(report.is_short && report.passes == 3, "{report:?}");
}

#[test]
fn an_image_without_noise_takes_no_more_passes_than_it_needs() {
    let mut build = flat_camera();
    build.square(9.0, &[("color C", &[0.3, 0.6, 0.1])], at(0.0, 0.0, 5.0));
    let shader = Painted::new(flat);
    let view = build.view(&[]);
    let frame = render_with(&build, &view, 1, ("rgb", &[]), &shader);
    let (pixels, report) = summed(&build, &view, 1, ("rgb", &[]), (&shader, error(0.001)));
    assert_eq!((report.passes, report.error.unwrap().error), (2, 0.0));
    assert!(pixels == frame, "what is constant stays constant to the bit");
    // Depths have no error that passes could reach.
    let (_, report) = summed(&build, &view, 1, ("z", &[]), (&shader, error(0.001)));
    assert_eq!((report.passes, report.error, report.is_short), (1, None, false));
}

#[test]
fn the_parts_of_noise_sources_are_measured() {
    let build = busy();
    let view = build.view(&[("int[2] spatialquality", vec![2.0, 2.0])]);
    let plan = |n| PassPlan { causes: true, ..passes(n) };
    let without = summed(&build, &view, 2, ("rgb", &[]), (&noisy(), passes(8)));
    let (pixels, report) = summed(&build, &view, 2, ("rgb", &[]), (&noisy(), plan(8)));
    assert!(pixels == without.0, "what is measured is no part of the image");
    let estimate = report.error.unwrap();
    let part = |source| estimate.causes[source as usize];
    let (edges, lights) = (part(NoiseSource::Edges).unwrap(), part(NoiseSource::Lights).unwrap());
    // The busy scene moves and is out of focus.
    assert!(part(NoiseSource::Motion).is_some() && part(NoiseSource::Lens).is_some(), "{estimate:?}");
    assert_eq!(part(NoiseSource::Occlusion), None);
    // Each part is less than all, and together they are no less.
    let all: f64 = estimate.causes().iter().map(|(_, part)| part * part).sum::<f64>();
    assert!(edges > 0.0 && lights > 0.0 && all.sqrt() > 0.9 * estimate.error, "{estimate:?}");
    assert!(estimate.causes().iter().all(|(_, part)| *part < 1.1 * estimate.error), "{estimate:?}");
    // Without noise in shading there is none of this source.
    let shader = Painted::new(wavy);
    let (_, report) = summed(&build, &view, 1, ("rgb", &[]), (&shader, plan(2)));
    assert_eq!(report.error.unwrap().causes[NoiseSource::Lights as usize], None);
    // Threads and buckets do not show.
    let again = build
        .view(&[("int[2] spatialquality", vec![2.0, 2.0]), ("int[2] limits:bucketsize", vec![7.0, 9.0])]);
    let (_, other) = summed(&build, &again, 1, ("rgb", &[]), (&noisy(), plan(8)));
    assert_eq!(other.error.unwrap().causes, estimate.causes);
    assert!(estimate.worst_block >= estimate.blocks_99 && report.images.len() == 1);
}

/// Paints stripes on grey surfaces, whose edges are as soft as points are apart.
pub(super) fn striped(grid: &mut Grid) {
    flat(grid);
    for i in 0..grid.len() {
        let is_dark = (7.0 * grid.u[i] + 3.0 * grid.v[i]).fract() < 0.5;
        if grid.c.get(i).x == 0.5 && is_dark {
            grid.c.set(i, grid.c.get(i) * 0.1);
        }
    }
}

/// Makes squares with a "shadingquality". Each part of 16 x 16 pixels has edges of a surface, and one is grey.
pub(super) fn squares(quality: f32) -> Build {
    let mut build = flat_camera();
    build.camera.push(("int[2] resolution", vec![128.0, 96.0]));
    for k in 0..48_u8 {
        let (x, y) = (f32::from(k % 8) - 3.5, f32::from(k / 8) - 2.5);
        let (half, grey) = if k == 21 { (0.45, 0.5) } else { (0.3, 0.9) };
        let list: [(&str, &[f32]); 2] = [("color C", &[grey; 3]), ("float shadingquality", &[quality])];
        build.square(half, &list, at(x, y, 5.0));
    }
    build
}

/// Renders squares with a shader.
pub(super) fn drawn(quality: f32, paint: fn(&mut Grid), plan: PassPlan) -> (Vec<f32>, PassReport) {
    let build = squares(quality);
    summed(&build, &build.view(&[]), 2, ("rgb", &[]), (&Painted::new(paint), plan))
}

/// What passes of stripes converge to.
pub(super) static STRIPED: LazyLock<Vec<f32>> = LazyLock::new(|| converged(striped));
/// What passes of highlights converge to.
static HIGHLIGHTS: LazyLock<Vec<f32>> = LazyLock::new(|| converged(with_highlight));

/// Returns what passes of [`drawn`] converge to. No passes have as many samples of a pixel: an image that
/// shared them would seem to have less noise.
pub(super) fn converged(paint: fn(&mut Grid)) -> Vec<f32> {
    let build = squares(16.0);
    let view = build.view(&[("int[2] spatialquality", vec![18.0, 18.0])]);
    summed(&build, &view, 2, ("rgb", &[]), (&Painted::new(paint), passes(4))).0
}

#[test]
fn bias_is_found_where_few_pixels_have_it() {
    let bias = distance(&drawn(1.0, striped, passes(20)).0, &drawn(8.0, striped, passes(20)).0);
    assert!(bias > 0.01, "{bias}");
    let (_, report) = drawn(1.0, striped, error(1.6 * bias as f32));
    let measured = report.error.unwrap().bias.unwrap();
    assert!((0.7..1.4).contains(&(measured / bias)), "{measured} of {bias}: {report:?}");
    // Where the time is too short for parts of the image, what coarser surfaces change shows the bias.
    let slowly = |grid: &mut Grid| {
        std::thread::sleep(Duration::from_micros(50) * u32::try_from(grid.len()).unwrap());
        striped(grid);
    };
    let begin = Instant::now();
    let _ = drawn(1.0, slowly, passes(1));
    let deadline = Some(Instant::now() + begin.elapsed().mul_f64(14.0));
    let plan = PassPlan { deadline, ..error(0.3 * bias as f32) };
    let (pixels, report) = drawn(1.0, slowly, plan);
    let found = distance(&pixels, &STRIPED);
    // One pass says nothing.
    let is_right = |says: ErrorEstimate| says.bias.is_some() && (0.6..2.2).contains(&(says.error / found));
    assert!(report.error.is_none_or(is_right), "{found}: {report:?}");
    assert!(report.coarse.is_none(), "{report:?}");
    assert!(report.is_short || report.is_unsure, "{report:?}");
    assert!(pixels == drawn(1.0, striped, again_as(&report)).0);
}

/// Paints a highlight on each surface that is smaller than a pixel.
fn with_highlight(grid: &mut Grid) {
    flat(grid);
    for i in 0..grid.len() {
        let far = (grid.u[i] - 0.34).powi(2) + (grid.v[i] - 0.51).powi(2);
        grid.c.set(i, grid.c.get(i) * (1.0 + 40.0 * (-far / 0.0016).exp()));
    }
}

#[test]
fn highlights_between_the_points_of_coarse_surfaces_are_not_missed() {
    let converged = &*HIGHLIGHTS;
    let as_it_is = distance(&drawn(1.0, with_highlight, passes(20)).0, converged);
    assert!(as_it_is > 0.3, "{as_it_is}");
    for asked in [0.16, 0.08] {
        let (pixels, report) = drawn(1.0, with_highlight, error(asked));
        let found = distance(&pixels, converged);
        assert!(found < 1.2 * f64::from(asked) && !report.is_short, "{found} of {asked}: {report:?}");
        let says = report.error.unwrap();
        assert!((0.7..3.0).contains(&(says.error / found)), "{found} of {asked}: {report:?}");
    }
}

/// Paints with noise, and records what passes are rendered with.
struct Recorded {
    painted: Painted<'static>,
    noise: f32,
    tolerance: Mutex<f32>,
    /// The random numbers and the factor of tolerances of each pass.
    passes: Mutex<Vec<(PassNumbers, f32)>>,
    /// The number of points that were shaded.
    points: AtomicUsize,
}

impl FrameShader for Recorded {
    type Object = ObjectTraits;
    type Thread<'a> = ();

    fn object(&self, primitive: &Primitive) -> Arc<ObjectTraits> {
        self.painted.object(primitive)
    }
    fn traits(&self, object: &ObjectTraits) -> ObjectTraits {
        *object
    }
    fn thread(&self) {}
    fn begin_pass(&self, numbers: PassNumbers) {
        self.passes.lock().push((numbers, *self.tolerance.lock()));
    }
    fn set_tolerance(&self, factor: f32) {
        *self.tolerance.lock() = factor;
    }
    fn displace(&self, (): &mut (), _: &ObjectTraits, _: &mut Grid) {}
    fn shade(
        &self,
        thread: &mut (),
        object: &ObjectTraits,
        grid: &mut Grid,
        wanted: &[(Arc<str>, ValueType)],
    ) -> Vec<Option<Vec<f32>>> {
        self.points.fetch_add(grid.len(), Ordering::Relaxed);
        let values = self.painted.shade(thread, object, grid, wanted);
        let numbers = self.passes.lock().last().map_or_else(PassNumbers::default, |(numbers, _)| *numbers);
        for i in 0..grid.len() {
            let noise = hash::unit(hash::words(&[grid.seed, i as u32, numbers.set, numbers.round])) - 0.5;
            grid.c.set(i, grid.c.get(i) * (1.0 + self.noise * noise));
        }
        values
    }
}

/// Renders squares with a requested error, and records it.
fn recorded((paint, noise): (fn(&mut Grid), f32), plan: PassPlan) -> (Vec<f32>, PassReport, Recorded) {
    let (tolerance, passes) = (Mutex::new(1.0), Mutex::new(Vec::new()));
    let painted = Painted::new(paint);
    let shader = Recorded { painted, noise, tolerance, passes, points: AtomicUsize::new(0) };
    let build = squares(1.0);
    let (pixels, report) = summed(&build, &build.view(&[]), 2, ("rgb", &[]), (&shader, plan));
    (pixels, report, shader)
}

#[test]
fn passes_go_at_once_to_the_accuracy_that_the_error_needs() {
    let converged = &*STRIPED;
    let of_coarse = distance(&drawn(0.5, striped, passes(20)).0, converged) as f32;
    // Those with 2 or 4 times as many points along each side as the coarse ones are next, and the only ones.
    for part in [0.6, 0.25] {
        let asked = part * of_coarse;
        let (pixels, report, at_once) = recorded((striped, 0.0), error(asked));
        let found = distance(&pixels, converged);
        assert!(found < 1.2 * f64::from(asked) && !report.is_short, "{part}: {found} {report:?}");
        assert!(report.coarse.is_none(), "{report:?}");
        // Time and numbers that suffice change nothing.
        let plan = PassPlan { passes: Some(report.passes), ..error(asked) };
        let ample = Some(Instant::now() + Duration::from_secs(1000));
        for plan in [plan, PassPlan { deadline: ample, ..error(asked) }] {
            let (again, said, shader) = recorded((striped, 0.0), plan);
            assert!(again == pixels && said == report, "{part}: {said:?}");
            let points = [&shader, &at_once].map(|shader| shader.points.load(Ordering::Relaxed));
            assert_eq!(points[0], points[1], "{part}");
        }
    }
}

#[test]
fn bias_that_is_measured_twice_is_that_of_independent_passes() {
    // Highlights need more levels than are known at once.
    let converged = &*HIGHLIGHTS;
    let (pixels, report, shader) = recorded((with_highlight, 2.0), error(0.05));
    let found = distance(&pixels, converged);
    assert!(found < 0.06 && !report.is_short, "{found} {report:?}");
    // Nothing is finer than what the last passes are compared with.
    let all = shader.passes.into_inner();
    let finest = all.iter().map(|(_, tolerance)| *tolerance).fold(f32::INFINITY, f32::min);
    let sets = all.iter().filter(|(_, tolerance)| *tolerance == finest).map(|(numbers, _)| numbers.set);
    let sets: Vec<u32> = sets.collect();
    assert!(
        sets.len() > 2 && sets.iter().enumerate().all(|(k, set)| *set == k as u32),
        "{finest} {sets:?} {report:?}"
    );
}

#[test]
fn an_image_stays_coarse_where_the_error_permits_it() {
    let converged = &*STRIPED;
    let of_coarse = distance(&drawn(0.5, striped, passes(20)).0, converged) as f32;
    let asked = 3.0 * of_coarse;
    let (pixels, report) = drawn(1.0, striped, error(asked));
    assert_eq!((report.coarse, report.passes, report.is_short), (Some(2), 2, false), "{report:?}");
    let largest = report.error.unwrap().bias.unwrap();
    assert!((0.8..3.0).contains(&(largest / f64::from(of_coarse))), "{largest} of {of_coarse}");
    assert!(distance(&pixels, converged) < f64::from(asked));
    assert!(pixels == drawn(0.5, striped, passes(2)).0, "it has points twice as far apart");
    // A number of passes makes it again, and more have less noise.
    let plan = |n| PassPlan { passes: Some(n), ..error(asked) };
    let (two, report) = drawn(1.0, striped, plan(2));
    assert!(two == pixels && !report.is_unsure, "{report:?}");
    // Less than two passes say nothing of the error.
    assert_eq!(drawn(1.0, striped, plan(1)).1.coarse, None);
    // With a smaller error, none of the coarse passes is left.
    let (pixels, report) = drawn(1.0, striped, PassPlan { passes: Some(2), ..error(0.5 * of_coarse) });
    assert_eq!((report.coarse, report.passes), (None, 2), "{report:?}");
    assert!(report.is_short || report.is_unsure, "{report:?}");
    assert!(pixels == drawn(1.0, striped, passes(2)).0);
}

#[test]
fn a_frame_that_saves_is_not_coarse() {
    let build = squares(1.0);
    let view = build.view(&[]);
    let coarse = |saves| {
        let shader = Noisy { saves, ..noisy() };
        summed(&build, &view, 2, ("rgb", &[]), (&shader, error(0.5))).1.coarse
    };
    assert_eq!([coarse(false), coarse(true)], [Some(2), None]);
}
