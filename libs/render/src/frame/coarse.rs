//! The coarse image of a frame whose first pass would not end in the requested time.

use super::{Frame, FrameShader};
use crate::CameraView;
use crate::accuracy::Accuracy;
use crate::output::canvas::Canvas;
use crate::passes::PassPlan;
use granita_base::NoiseSources;
use granita_dicing::camera::is_moving;
use granita_hider::SamplePattern;
use granita_scene::Scene;
use parking_lot::Mutex;
use std::time::{Duration, Instant};

/// The parts of the time between which the first pass is given up when it is not expected to end in time. The rest is
/// for the coarse image.
const TRIED: [f64; 2] = [0.3, 0.6];

/// The part of the time left that a coarse image may take by the times of the first pass, which vary over the image.
const USED: f64 = 0.8;

/// The part of the time of a pass that depends on no number of points and samples.
const FIXED: f64 = 0.1;

/// How many times as far apart the points of surfaces may be.
const FACTORS: [u32; 4] = [2, 4, 8, 16];

/// A time that is too short to see how fast a pass is.
const SHORT: Duration = Duration::from_millis(200);

/// The time that the first pass has instead, so that it is coarse only where it takes longer than that.
const INSTEAD: Duration = Duration::from_millis(500);

/// When a pass is given up.
#[derive(Clone, Copy, Debug)]
pub(super) enum Limit {
    /// At a time.
    At(Instant),
    /// Within a span of time, when it is not expected to end by then. One that `is_needed` is finished after that.
    Expected { begin: Instant, checked: [Instant; 2], end: Instant, is_needed: bool },
}

impl Limit {
    /// The number of times that an expected limit is checked.
    const CHECKS: u32 = 8;

    /// Returns the first time at which the pass may be given up.
    pub(super) fn first(&self) -> Instant {
        match *self {
            Self::At(at) => at,
            Self::Expected { checked: [from, _], .. } => from,
        }
    }

    /// Looks at a pass of which at most a part is there. What a part says of the whole is not certain, so that a pass
    /// is given up early when it would take twice the time.
    pub(super) fn look(&self, part: f64) -> Outlook {
        let Self::Expected { begin, checked: [from, to], end, is_needed } = *self else {
            return Outlook::Late;
        };
        let now = Instant::now();
        let seconds = |from: Instant, to: Instant| to.saturating_duration_since(from).as_secs_f64();
        let looked = (seconds(from, now) / seconds(from, to)).min(1.0);
        if seconds(begin, now) / part.max(1e-6) > (2.0 - looked) * seconds(begin, end) {
            Outlook::Late
        } else if now < to {
            Outlook::Unknown((now + to.saturating_duration_since(from) / Self::CHECKS).min(to))
        } else if is_needed {
            Outlook::InTime
        } else if now < end {
            Outlook::Unknown(end)
        } else {
            Outlook::Late
        }
    }
}

/// What is expected of a pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Outlook {
    /// It is given up.
    Late,
    /// It must be looked at again at a time.
    Unknown(Instant),
    /// It is finished.
    InTime,
}

/// Returns the factor of the distance between points with which a pass that takes `whole` is expected to end within
/// `left`. The number of points falls with its square.
fn factor(whole: Duration, left: Duration) -> u32 {
    let part = |factor: u32| FIXED + (1.0 - FIXED) / f64::from(factor.pow(2));
    let fits = |factor: &&u32| whole.mul_f64(part(**factor)) <= left.mul_f64(USED);
    FACTORS.iter().find(fits).copied().unwrap_or(FACTORS[FACTORS.len() - 1])
}

/// Returns a number of times or lens points of a pixel, fewer by the square of `n`. One would be none of the blur.
fn at_least_two(samples: u32, n: u32) -> u32 {
    (samples / (n * n)).max(samples.min(2))
}

/// Returns the plan of the first pass, which began at `begin`, perhaps after its time was over.
pub(super) fn of_first(plan: &PassPlan, begin: Instant) -> PassPlan {
    let is_short = |deadline: &Instant| deadline.saturating_duration_since(begin) < SHORT;
    let deadline = plan.deadline.map(|deadline| if is_short(&deadline) { begin + INSTEAD } else { deadline });
    PassPlan { deadline, ..*plan }
}

/// Returns the limit of a pass that began at `begin` and is given up early. There is none without a requested time.
fn expected(plan: &PassPlan, begin: Instant, is_needed: bool) -> Option<Limit> {
    let deadline = plan.deadline?;
    let left = deadline.saturating_duration_since(begin);
    let checked = TRIED.map(|part| begin + left.mul_f64(part));
    Some(Limit::Expected { begin, checked, end: deadline + plan.grace, is_needed })
}

impl<S: FrameShader> Frame<'_, S> {
    /// Returns the limit of the first pass, which began at `begin`. There is none without a requested time.
    pub(super) fn first_limit(&self, plan: &PassPlan, begin: Instant) -> Option<Limit> {
        expected(&of_first(plan, begin), begin, true)
    }

    /// Returns the limit of the first pass of other surfaces or samples, which began at `begin`.
    pub(super) fn tried_limit(&self, plan: &PassPlan, begin: Instant) -> Option<Limit> {
        expected(plan, begin, false)
    }

    /// Renders the first pass, by the plan of [`of_first`], with points that are far enough apart to end in time, after
    /// one that would have taken the time `whole`. Lights and rays have fewer samples in proportion, and so have pixels
    /// with four times the distance or more. Returns the number of buckets that failed; `None` when the frame was
    /// stopped.
    pub(super) fn render_coarse(
        &mut self,
        (scene, plan): (&Scene, &PassPlan),
        whole: Duration,
        canvases: &[Mutex<Canvas>],
        threads: usize,
        list: &[usize],
    ) -> Option<usize> {
        let left = plan
            .deadline
            .map_or(Duration::ZERO, |deadline| deadline.saturating_duration_since(Instant::now()));
        let factor = factor(whole, left);
        let passes = self.passes.as_mut()?;
        let level = passes.last_step().level;
        let apart = factor << (-level).max(0);
        passes.coarse = Some(apart);
        let (apart, n) = (apart as f32, factor / 2);
        let Accuracy { dicing, tolerance, .. } = Accuracy::of_level(level.max(0));
        self.set_accuracy(Accuracy {
            dicing: dicing / apart,
            tolerance: tolerance * apart,
            samples: 1.0 / apart,
        });
        self.begin_pass(scene, (0, NoiseSources::default()), plan.error.is_some(), None);
        let fewer = CameraView {
            spatialquality: self.options.camera.spatialquality.map(|samples| (samples / n).max(1)),
            temporalquality: at_least_two(self.options.camera.temporalquality, n),
            dofquality: at_least_two(self.options.camera.dofquality, n),
            ..self.options.camera.clone()
        };
        self.set_pattern(SamplePattern::new(&fewer, is_moving(scene, &fewer)));
        self.render_pass(scene, None, canvases, threads, list).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_as_far_apart_as_the_time_requires() {
        let seconds = Duration::from_secs;
        assert_eq!([4, 16, 25, 60, 5000].map(|whole| factor(seconds(whole), seconds(4))), [2, 4, 8, 16, 16]);
        assert_eq!(factor(seconds(1), Duration::ZERO), 16);
    }

    #[test]
    fn a_first_pass_that_begins_too_late_has_some_time() {
        let begin = Instant::now();
        let left = |deadline: Instant| {
            let plan = PassPlan { deadline: Some(deadline), ..PassPlan::default() };
            of_first(&plan, begin).deadline.unwrap().saturating_duration_since(begin)
        };
        let after = |milliseconds| begin + Duration::from_millis(milliseconds);
        assert_eq!([left(after(3000)), left(after(200))], [3000, 200].map(Duration::from_millis));
        let before = begin.checked_sub(Duration::from_secs(9)).unwrap();
        assert_eq!([left(after(199)), left(before)], [INSTEAD; 2]);
    }

    #[test]
    fn a_pass_is_given_up_early_only_when_it_is_clearly_late() {
        let now = Instant::now();
        let ago = |seconds: u64| now.checked_sub(Duration::from_secs(seconds)).unwrap();
        // A time of 100 s, which is looked at between 30 and 60 s.
        let limit = |seconds: u64, is_needed: bool| {
            let (begin, after) = (ago(seconds), |s| ago(seconds) + Duration::from_secs(s));
            Limit::Expected { begin, checked: [after(30), after(60)], end: after(100), is_needed }
        };
        let after = |seconds| limit(seconds, true);
        // A pass of 150 s is late, but that is known at the end.
        assert!(
            matches!(after(30).look(0.2), Outlook::Unknown(at) if at > now && at < now + Duration::from_secs(5))
        );
        assert!(matches!(after(59).look(0.4), Outlook::Late));
        assert_eq!([after(30).look(0.1), after(30).look(0.0)], [Outlook::Late; 2]);
        assert_eq!([after(60).look(0.7), after(90).look(0.95)], [Outlook::InTime; 2]);
        assert!(matches!(after(59).look(0.7), Outlook::Unknown(at) if at <= now + Duration::from_secs(1)));
        assert_eq!(Limit::At(now).look(0.99), Outlook::Late);
        // One that is not needed is given up at the end.
        let tried = |seconds| limit(seconds, false);
        assert!(matches!(tried(60).look(0.7), Outlook::Unknown(at) if at > now + Duration::from_secs(30)));
        assert_eq!([tried(100).look(0.99), tried(30).look(0.1)], [Outlook::Late; 2]);
    }
}
