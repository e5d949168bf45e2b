//! The picture of `-trade`: error against time, both logarithmic.

use super::{ERRORS, Outcome, Scene, Setting, Wanted, best};
use std::fmt::Write;

const SIZE: [f64; 2] = [720.0, 480.0];
const MARGIN: f64 = 60.0;
const COLORS: [&str; 7] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#777777"];

/// The range of an axis, as logarithms to the base 10.
#[derive(Clone, Copy)]
struct Axis {
    low: f64,
    high: f64,
    /// The pixels of both ends.
    pixels: [f64; 2],
}

impl Axis {
    fn new(values: impl Iterator<Item = f64>, pixels: [f64; 2]) -> Self {
        let logs = values.filter(|value| *value > 0.0).map(f64::log10);
        let (low, high) =
            logs.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
        Self { low: low - 0.1, high: high + 0.1, pixels }
    }

    fn at(&self, value: f64) -> f64 {
        let [a, b] = self.pixels;
        a + (value.max(1e-9).log10() - self.low) / (self.high - self.low) * (b - a)
    }

    /// Returns 1, 2 and 5 of each power of ten within the axis.
    fn ticks(&self) -> impl Iterator<Item = f64> {
        let Self { low, high, .. } = *self;
        let powers = low.floor() as i32..=high.ceil() as i32;
        powers
            .flat_map(|power| [1.0, 2.0, 5.0].map(|digit| digit * 10_f64.powi(power)))
            .filter(move |value| (low..=high).contains(&value.log10()))
    }
}

/// Returns a picture with one line for each setting. The settings that are best for an error are drawn in colour.
pub(super) fn plot(scene: &Scene, outcomes: &[Outcome], name: &str) -> String {
    let times = outcomes.iter().flat_map(|outcome| ERRORS.map(|error| outcome.time(error)));
    let x = Axis::new(times, [MARGIN, SIZE[0] - MARGIN]);
    let y = Axis::new(ERRORS.into_iter(), [SIZE[1] - MARGIN, MARGIN]);
    let name = name.replace('&', "&amp;").replace('<', "&lt;");
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{}\" font-family=\"sans-serif\" font-size=\"12\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n<text x=\"{MARGIN}\" y=\"24\">{name}: error against time</text>\n",
        SIZE[0], SIZE[1]
    );
    // Writing to a string does not fail.
    for value in x.ticks() {
        let (at, to) = (x.at(value), SIZE[1] - MARGIN);
        let _ = writeln!(
            out,
            "<path d=\"M{at:.1} {MARGIN}V{to}\" stroke=\"#ddd\"/><text x=\"{at:.1}\" y=\"{}\" text-anchor=\"middle\">{value} s</text>",
            to + 18.0
        );
    }
    for value in y.ticks() {
        let (at, to) = (y.at(value), SIZE[0] - MARGIN);
        let _ = writeln!(
            out,
            "<path d=\"M{MARGIN} {at:.1}H{to}\" stroke=\"#ddd\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{} %</text>",
            MARGIN - 6.0,
            at + 4.0,
            (value * 1e4).round() / 100.0
        );
    }
    let is_best = |setting: Setting| {
        ERRORS
            .iter()
            .any(|error| best(outcomes, Wanted::Error(*error)).is_some_and(|best| best.setting == setting))
    };
    let mut named = 0;
    for outcome in outcomes {
        let points: Vec<String> = ERRORS
            .iter()
            .map(|error| format!("{:.1},{:.1}", x.at(outcome.time(*error)), y.at(*error)))
            .collect();
        let is_own = outcome.setting == Setting::OWN;
        let is_named = is_own || is_best(outcome.setting);
        let color = match (is_own, is_named) {
            (true, _) => "black",
            (_, true) => COLORS[named % COLORS.len()],
            _ => "#ccc",
        };
        let _ = writeln!(out, "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\"/>", points.join(" "));
        if is_named {
            let ([across, down], samples) = outcome.setting.values(scene);
            let own = if is_own { " (as it is)" } else { "" };
            let at = 40.0 + 16.0 * named as f64;
            let _ = writeln!(
                out,
                "<path d=\"M{} {}h16\" stroke=\"{color}\"/><text x=\"{}\" y=\"{at}\">{across} x {down}, {samples}{own}</text>",
                SIZE[0] - 200.0,
                at - 4.0,
                SIZE[0] - 178.0
            );
            named += 1;
        }
    }
    out + "</svg>\n"
}
