//! The passes that the options and the scene request.

use granita_base::{Location, Reporter, Severity};
use granita_render::PassPlan;
use granita_scene::{Scene, attr};
use std::time::{Duration, Instant};

/// The part of the time of a frame by which it may be exceeded, and the least such time.
const GRACE: (f64, Duration) = (0.04, Duration::from_millis(40));

/// The passes that an option of the command line requests. Each replaces the attribute of the scene.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PassOptions {
    /// The number of passes ("render:passes").
    pub passes: Option<u32>,
    /// The seconds of a frame ("render:seconds"). They begin with the session, or with the end of the frame before.
    pub seconds: Option<f64>,
    /// The error as a fraction of the mean of the image ("render:error").
    pub error: Option<f32>,
    /// True when the part of each noise source in the error is measured ("render:causes").
    pub causes: bool,
    /// How many times as fine surfaces are as the scene says, for a number of passes without an error
    /// ("render:finer").
    pub finer: Option<u32>,
    /// How many times the samples of pixels, and of lights and rays, such passes have ("render:larger").
    pub larger: Option<[u32; 2]>,
}

/// Returns the passes of a frame; `None` for a frame of its own. `idle_since` is the time at which the session began to
/// read its scene.
pub(crate) fn plan(
    asked: PassOptions,
    scene: &Scene,
    idle_since: Instant,
    reporter: &Reporter,
) -> Option<PassPlan> {
    let ignore = |name: &str, why: String| {
        let text = format!("\"{name}\" {why}; it is ignored");
        reporter.once(&text.clone(), Severity::Warning, &Location::default(), text);
    };
    let is_no_amount = |value: String| format!("{value} is below 0 or not a number");
    let positive = |name: &str, value: f32| {
        let is_valid = value >= 0.0 && value.is_finite();
        if !is_valid {
            ignore(name, is_no_amount(value.to_string()));
        }
        Some(value).filter(|value| is_valid && *value > 0.0)
    };
    let passes = asked.passes.or_else(|| {
        let count = scene.get(attr::RENDER_PASSES);
        if count < 0 {
            ignore(attr::RENDER_PASSES.name(), is_no_amount(count.to_string()));
        }
        u32::try_from(count).ok().filter(|count| *count > 0)
    });
    let error = asked.error.or_else(|| positive(attr::RENDER_ERROR.name(), scene.get(attr::RENDER_ERROR)));
    let of_scene = || positive(attr::RENDER_SECONDS.name(), scene.get(attr::RENDER_SECONDS));
    let time = match asked.seconds {
        Some(seconds) => Some((seconds, idle_since)),
        None => of_scene().map(|seconds| (f64::from(seconds), Instant::now())),
    };
    let causes = asked.causes || scene.get(attr::RENDER_CAUSES);
    let deadline =
        time.and_then(|(seconds, from)| from.checked_add(Duration::try_from_secs_f64(seconds).ok()?));
    let (part, least) = GRACE;
    let grace =
        time.map_or(least, |(seconds, _)| least.max(Duration::from_secs_f64((seconds * part).min(60.0))));
    // Differences between passes need two of them.
    let passes = passes.or((causes && error.is_none() && deadline.is_none()).then_some(2));
    let finer = asked.finer.map_or_else(|| scene.get(attr::RENDER_FINER), u32::cast_signed);
    let level = power_of(2, finer).filter(|level| *level <= PassPlan::FINEST).unwrap_or_else(|| {
        ignore(attr::RENDER_FINER.name(), format!("{finer} is none of 1, 2, 4, 8, 16 and 32"));
        0
    });
    let of_scene = || scene.get(attr::RENDER_LARGER);
    let larger = asked.larger.map_or_else(of_scene, |both| both.map(u32::cast_signed));
    let power = |factor| power_of(4, factor).filter(|power| *power <= PassPlan::LARGEST);
    let larger = match larger.map(power) {
        [Some(pixels), Some(shading)] => [pixels, shading],
        _ => {
            let [pixels, shading] = larger;
            ignore(attr::RENDER_LARGER.name(), format!("{pixels} {shading} is none of 1, 4 and 16"));
            [0; 2]
        }
    };
    // Time alone decides for itself how fine and large they are.
    let (level, larger) = if passes.is_some() { (level, larger) } else { (0, [0; 2]) };
    (passes.is_some() || error.is_some() || deadline.is_some()).then_some(PassPlan {
        passes,
        deadline,
        grace,
        error,
        causes,
        level,
        larger,
    })
}

/// Returns the power of a base that a number is; `None` where it is none.
fn power_of(base: u32, number: i32) -> Option<u32> {
    let number = u32::try_from(number).ok()?;
    let power = number.checked_ilog(base)?;
    (base.pow(power) == number).then_some(power)
}
