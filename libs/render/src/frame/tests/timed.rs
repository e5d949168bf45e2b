//! Tests images of passes that end with their time, or that are stopped.

use super::summed::{
    Noisy, STRIPED, converged, distance, drawn, error, noisy, passes, squares, striped, summed,
};
use super::*;
use crate::passes::{PassPlan, PassReport};
use granita_base::{PassNumbers, hash};
use std::time::{Duration, Instant};

/// Returns the plan that makes the image of a report again.
pub(super) fn again_as(report: &PassReport) -> PassPlan {
    let power = |factor: u32| factor.ilog2() / 2;
    let larger = [report.pixel_samples, report.samples].map(power);
    PassPlan { level: report.finer.ilog2(), larger, ..passes(report.passes) }
}

/// Returns the first image of several passes that has what `is_wanted` looks for, of images that take twice as long
/// each. One pass has no error.
fn in_time(paint: fn(&mut Grid), is_wanted: impl Fn(&PassReport) -> bool) -> Option<(Vec<f32>, PassReport)> {
    let in_time = |seconds: f64| {
        let deadline = Some(Instant::now() + Duration::from_secs_f64(seconds));
        drawn(1.0, paint, PassPlan { passes: None, deadline, ..passes(1) })
    };
    [0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0]
        .into_iter()
        .map(in_time)
        .find(|(_, report)| report.passes > 1 && is_wanted(report))
}

#[test]
fn time_decides_only_the_number_of_passes_and_how_fine_surfaces_are() {
    let build = busy();
    let view = build.view(&[]);
    let deadline = Instant::now() + Duration::from_millis(400);
    let plan =
        PassPlan { passes: None, deadline: Some(deadline), grace: Duration::from_millis(50), ..passes(1) };
    let (pixels, report) = summed(&build, &view, 2, ("rgba", &[]), (&noisy(), plan));
    assert!(report.passes >= 1, "{report:?}");
    // On a machine on which a pass takes as long, the image is coarse.
    if report.coarse.is_none() {
        let plan = again_as(&report);
        let (again, same) = summed(&build, &view, 2, ("rgba", &[]), (&noisy(), plan));
        assert!(pixels == again, "{report:?}");
        // A number of passes measures no bias.
        let is_measured = report.error.is_some_and(|error| error.bias.is_some());
        let shown = |report: &PassReport| (report.passes, report.mean_passes, report.finer);
        assert!(shown(&same) == shown(&report) && (is_measured || same == report), "{report:?} {same:?}");
    }
    // Finer surfaces pay where noise is small. A slow machine has more time.
    let converged = &*STRIPED;
    let bias = distance(&drawn(1.0, striped, passes(20)).0, converged);
    let (pixels, report) = in_time(striped, |report| report.finer > 1).expect("finer surfaces");
    let found = distance(&pixels, converged);
    assert!(found < 0.7 * bias, "{found} {bias} {report:?}");
    let error = report.error.unwrap();
    assert!(error.bias.is_some() && (0.6..2.2).contains(&(error.error / found)), "{found} {report:?}");
    let again = drawn(1.0, striped, again_as(&report)).0;
    assert!(again == pixels, "{report:?}");
    // A number of passes leaves surfaces as they are.
    let deadline = Instant::now() + Duration::from_secs(1000);
    let (_, report) = drawn(1.0, striped, PassPlan { deadline: Some(deadline), ..passes(12) });
    assert_eq!((report.passes, report.finer), (12, 1));
    // One pass is always finished.
    let late = PassPlan { deadline: Some(Instant::now()), grace: Duration::ZERO, ..plan };
    let (_, report) = summed(&build, &view, 2, ("rgba", &[]), (&noisy(), late));
    assert_eq!(report.passes, 1);
}

#[test]
fn time_decides_only_the_number_of_passes_of_a_requested_error() {
    let build = busy();
    let view = build.view(&[]);
    let render = |plan| summed(&build, &view, 2, ("rgba", &[]), (&noisy(), plan));
    // The number of passes that end in a time varies with the machine, but not what they make.
    let run = |times: f64| {
        let begin = Instant::now();
        render(passes(1));
        let deadline = Instant::now() + begin.elapsed().mul_f64(times);
        let (pixels, report) = render(PassPlan { deadline: Some(deadline), ..error(0.05) });
        // The time may end before the bias of coarse passes was measured.
        if report.coarse.is_some() && report.error.is_none_or(|error| error.bias.is_none()) {
            return 0;
        }
        // Where the time is too short for the error, the image is that of passes without a requested error.
        let of_error = PassPlan { passes: Some(report.passes), ..error(0.05) };
        let again = [of_error, again_as(&report)].map(|plan| render(plan).0);
        assert!(again.contains(&pixels), "{times} times: {report:?}");
        report.passes
    };
    assert!((3..60_u8).any(|times| run(times.into()) >= 3), "there was never time for a third pass");
}

#[test]
fn a_time_that_is_too_short_for_the_error_is_used_as_if_none_was_requested() {
    let slowly = |grid: &mut Grid| {
        std::thread::sleep(Duration::from_micros(20) * u32::try_from(grid.len()).unwrap());
        striped(grid);
    };
    let begin = Instant::now();
    let _ = drawn(1.0, slowly, passes(1));
    let deadline = Some(Instant::now() + begin.elapsed() * 40);
    let (pixels, report) = drawn(1.0, slowly, PassPlan { deadline, ..error(0.001) });
    // Those passes are best used with finer surfaces.
    assert!(report.finer > 1 && report.coarse.is_none(), "{report:?}");
    assert!(report.is_short || report.is_unsure, "{report:?}");
    assert!(drawn(1.0, striped, again_as(&report)).0 == pixels, "{report:?}");
}

#[test]
fn a_stopped_frame_has_the_passes_that_were_completed() {
    /// Stops the frame in its fifth pass.
    struct Stops<'a>(Noisy, &'a AtomicBool);
    impl FrameShader for Stops<'_> {
        type Object = ObjectTraits;
        type Thread<'b>
            = ()
        where
            Self: 'b;
        fn object(&self, primitive: &Primitive) -> Arc<ObjectTraits> {
            self.0.object(primitive)
        }
        fn traits(&self, object: &ObjectTraits) -> ObjectTraits {
            *object
        }
        fn thread(&self) {}
        fn begin_pass(&self, numbers: PassNumbers) {
            self.0.begin_pass(numbers);
        }
        fn displace(&self, (): &mut (), _: &ObjectTraits, _: &mut Grid) {}
        fn shade(
            &self,
            (): &mut (),
            object: &ObjectTraits,
            grid: &mut Grid,
            wanted: &[(Arc<str>, ValueType)],
        ) -> Vec<Option<Vec<f32>>> {
            let found = self.0.shade(&mut (), object, grid, wanted);
            self.1.store(self.0.pass.load(Ordering::Relaxed) == hash::words(&[0, 2]), Ordering::Relaxed);
            found
        }
    }
    let build = busy();
    let view = build.view(&[]);
    let reporter = Reporter::silent();
    let mut outputs = one_output(&view, ("rgba", &[]), &reporter);
    let stop = AtomicBool::new(false);
    let options =
        FrameOptions { threads: 2, passes: Some(passes(100)), ..FrameOptions::new(&view, &reporter, &stop) };
    let shader = Stops(noisy(), &stop);
    let (statistics, _) =
        render(&build.scene, &shader, options, std::slice::from_mut(&mut outputs), None).unwrap();
    assert_eq!(statistics.passes.unwrap().passes, 4);
    let (whole, _) = summed(&build, &view, 2, ("rgba", &[]), (&noisy(), passes(4)));
    assert!(outputs.images[0].pixels == whole);
}

#[test]
fn a_pass_that_would_not_end_in_time_is_coarse() {
    let build = busy();
    let view = build.view(&[("int[2] limits:bucketsize", vec![8.0; 2])]);
    let begin = Instant::now();
    let plan = PassPlan { passes: None, deadline: Some(begin + Duration::from_secs(1)), ..passes(1) };
    // A whole pass takes many times as long.
    let slow = Noisy { of_point: Duration::from_millis(5), ..noisy() };
    let (pixels, report) = summed(&build, &view, 2, ("rgba", &[]), (&slow, plan));
    let factor = report.coarse.unwrap();
    assert_eq!(*slow.factors.lock(), [1.0; 2], "the next camera is not coarse");
    assert_eq!((report.passes, report.error, factor), (1, None, 16));
    assert!(begin.elapsed() < Duration::from_secs(60), "{:?}", begin.elapsed());
    // It is the frame with points as far apart, and with fewer samples.
    let one = ("int[2] spatialquality", vec![1.0; 2]);
    let fewer = build.view(&[one, ("int temporalquality", vec![2.0]), ("int dofquality", vec![2.0])]);
    let reporter = Reporter::silent();
    let mut outputs = one_output(&fewer, ("rgba", &[]), &reporter);
    let stop = AtomicBool::new(false);
    let finer = 1.0 / factor as f32;
    let options =
        FrameOptions { finer, passes: Some(passes(1)), ..FrameOptions::new(&fewer, &reporter, &stop) };
    render(&build.scene, &noisy(), options, std::slice::from_mut(&mut outputs), None).unwrap();
    assert!(outputs.images[0].pixels == pixels);
}

#[test]
fn a_frame_that_begins_after_its_time_is_coarse() {
    let build = busy();
    let view = build.view(&[("int[2] limits:bucketsize", vec![8.0; 2])]);
    let plan = PassPlan { passes: None, deadline: Some(Instant::now()), ..passes(1) };
    let slow = Noisy { of_point: Duration::from_millis(2), ..noisy() };
    let (_, report) = summed(&build, &view, 2, ("rgba", &[]), (&slow, plan));
    assert_eq!((report.passes, report.coarse), (1, Some(16)));
}

#[test]
fn one_pass_of_finer_surfaces_is_enough_where_bias_is_most_of_the_error() {
    // Points take so long that the time of a pass is in proportion to their number.
    let slowly = |grid: &mut Grid| {
        std::thread::sleep(Duration::from_micros(20) * u32::try_from(grid.len()).unwrap());
        striped(grid);
    };
    let begin = Instant::now();
    let _ = drawn(1.0, slowly, passes(1));
    let pass = begin.elapsed();
    let of_passes = |n: u32| {
        let deadline = Some(Instant::now() + pass * n);
        drawn(1.0, slowly, PassPlan { passes: None, deadline, ..passes(1) })
    };
    let is_single = |(_, report): &(_, PassReport)| report.passes == 1 && report.finer > 1;
    let (pixels, report) = (7..14).map(of_passes).find(is_single).expect("one finer pass");
    assert!(report.error.is_none(), "{report:?}");
    assert!(drawn(1.0, striped, again_as(&report)).0 == pixels, "{report:?}");
}

#[test]
fn finer_surfaces_that_take_longer_than_expected_cost_a_part_of_the_time_alone() {
    // Finer points take ten times as long each.
    let slowly = |grid: &mut Grid| {
        let is_finer = grid.len() > 1 && (grid.u[1] - grid.u[0]).abs() < 0.05;
        let of_point = Duration::from_micros(if is_finer { 200 } else { 20 });
        std::thread::sleep(of_point * u32::try_from(grid.len()).unwrap());
        striped(grid);
    };
    let begin = Instant::now();
    let _ = drawn(1.0, slowly, passes(1));
    let pass = begin.elapsed();
    let deadline = Instant::now() + pass * 30;
    let plan = PassPlan { passes: None, deadline: Some(deadline), ..passes(1) };
    let (pixels, report) = drawn(1.0, slowly, plan);
    assert!(report.passes > 4 && (report.finer, report.pixel_samples) == (1, 1), "{report:?}");
    assert!(drawn(1.0, striped, passes(report.passes)).0 == pixels, "{report:?}");
    assert!(Instant::now() < deadline + pass * 10, "{pass:?}");
}

#[test]
fn passes_with_more_samples_pay_where_pixels_have_most_of_the_noise() {
    let (pixels, report) = in_time(flat, |report| report.pixel_samples > 1).expect("larger passes");
    assert!(drawn(1.0, flat, again_as(&report)).0 == pixels, "{report:?}");
    assert_eq!((report.samples, report.finer), (1, 1), "{report:?}");
    let found = distance(&pixels, &converged(flat));
    let says = report.error.unwrap().error;
    assert!((0.5..2.0).contains(&(says / found)), "{says} {found}");
    // A number of passes has what is requested, with any buckets and crops.
    let build = squares(1.0);
    let painted = Painted::new(flat);
    let plan = PassPlan { larger: [1, 0], ..passes(2) };
    let (whole, report) = summed(&build, &build.view(&[]), 2, ("rgb", &[]), (&painted, plan));
    assert_eq!((report.pixel_samples, report.passes), (4, 2));
    let view = build.view(&[("int[2] limits:bucketsize", vec![50.0; 2])]);
    assert!(summed(&build, &view, 1, ("rgb", &[]), (&painted, plan)).0 == whole);
    let fine = build.view(&[("int[2] spatialquality", vec![8.0; 2])]);
    assert!(summed(&build, &fine, 1, ("rgb", &[]), (&painted, passes(2))).0 == whole);
}
