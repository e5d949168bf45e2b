//! Pictures of error against time.

use std::fmt::Write;

const SIZE: [f64; 2] = [720.0, 480.0];
const MARGIN: f64 = 60.0;
/// The smallest value of both axes.
const LEAST: f64 = 1e-9;

/// The range of a logarithmic axis.
#[derive(Clone, Copy, Debug)]
struct Axis {
    /// The logarithms to the base 10 of both ends.
    low: f64,
    high: f64,
    /// The pixels of both ends.
    pixels: [f64; 2],
}

impl Axis {
    fn new(values: impl Iterator<Item = f64>, pixels: [f64; 2]) -> Self {
        let logs = values.map(|value| value.max(LEAST).log10());
        let (low, high) =
            logs.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
        Self { low: low - 0.1, high: high + 0.1, pixels }
    }

    fn at(&self, value: f64) -> f64 {
        let [a, b] = self.pixels;
        a + (value.max(LEAST).log10() - self.low) / (self.high - self.low) * (b - a)
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

/// A picture of error against time as SVG, of 720 x 480 pixels. Both axes are logarithmic. Times are in seconds, and
/// errors are fractions, which are shown in percent.
///
/// ```
/// use granita_cli::ErrorPlot;
/// let mut plot = ErrorPlot::new("a scene", [1.0, 16.0].into_iter(), [0.01, 0.04].into_iter());
/// plot.line(&[(1.0, 0.04), (16.0, 0.01)], ErrorPlot::BLACK);
/// plot.name("as it is", ErrorPlot::BLACK);
/// assert!(plot.finish().contains("a scene: error against time"));
/// ```
#[derive(Clone, Debug)]
pub struct ErrorPlot {
    x: Axis,
    y: Axis,
    text: String,
    names: u32,
}

/// Returns a text for XML.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}

// Writing to a string does not fail.
impl ErrorPlot {
    /// Colours that people who do not see all colours can tell apart (Okabe and Ito 2008).
    pub const COLORS: [&str; 7] =
        ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#777777"];
    /// The colour of what stands out.
    pub const BLACK: &str = "#000000";
    /// The colour of what does not matter.
    pub const FAINT: &str = "#cccccc";

    /// Returns a picture without curves whose axes include these seconds and errors.
    pub fn new(title: &str, seconds: impl Iterator<Item = f64>, errors: impl Iterator<Item = f64>) -> Self {
        let x = Axis::new(seconds, [MARGIN, SIZE[0] - MARGIN]);
        let y = Axis::new(errors, [SIZE[1] - MARGIN, MARGIN]);
        let mut text = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{}\" font-family=\"sans-serif\" font-size=\"12\">\n\
             <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n<text x=\"{MARGIN}\" y=\"24\">{}: error against time</text>\n",
            SIZE[0],
            SIZE[1],
            escaped(title)
        );
        for value in x.ticks() {
            let (at, to) = (x.at(value), SIZE[1] - MARGIN);
            let _ = writeln!(
                text,
                "<path d=\"M{at:.1} {MARGIN}V{to}\" stroke=\"#ddd\"/><text x=\"{at:.1}\" y=\"{}\" text-anchor=\"middle\">{value} s</text>",
                to + 18.0
            );
        }
        for value in y.ticks() {
            let (at, to) = (y.at(value), SIZE[0] - MARGIN);
            let _ = writeln!(
                text,
                "<path d=\"M{MARGIN} {at:.1}H{to}\" stroke=\"#ddd\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{} %</text>",
                MARGIN - 6.0,
                at + 4.0,
                (value * 1e4).round() / 100.0
            );
        }
        Self { x, y, text, names: 0 }
    }

    /// Draws a line through points of seconds and errors.
    pub fn line(&mut self, points: &[(f64, f64)], color: &str) {
        let at = |(x, y): &(f64, f64)| format!("{:.1},{:.1}", self.x.at(*x), self.y.at(*y));
        let points: Vec<String> = points.iter().map(at).collect();
        let points = points.join(" ");
        let _ = writeln!(self.text, "<polyline points=\"{points}\" fill=\"none\" stroke=\"{color}\"/>");
    }

    /// Draws a dot at seconds and an error. Its name appears under the mouse.
    pub fn dot(&mut self, (seconds, error): (f64, f64), name: &str, color: &str) {
        let (x, y, name) = (self.x.at(seconds), self.y.at(error), escaped(name));
        let dot = format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"{color}\">");
        let _ = writeln!(self.text, "{dot}<title>{name}</title></circle>");
    }

    /// Adds a name to the list of colours.
    pub fn name(&mut self, name: &str, color: &str) {
        let (x, y) = (SIZE[0] - 200.0, 40.0 + 16.0 * f64::from(self.names));
        let (line, to, name) = (y - 4.0, x + 22.0, escaped(name));
        let line = format!("<path d=\"M{x} {line}h16\" stroke=\"{color}\" stroke-width=\"3\"/>");
        let _ = writeln!(self.text, "{line}<text x=\"{to}\" y=\"{y}\">{name}</text>");
        self.names += 1;
    }

    /// Returns the picture.
    pub fn finish(self) -> String {
        self.text + "</svg>\n"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_at_their_logarithms_and_names_are_escaped() {
        let mut plot = ErrorPlot::new("a<b", [1.0, 10.0, 100.0].into_iter(), [0.01, 0.1].into_iter());
        let middle = plot.x.at(10.0);
        assert!((plot.x.at(1.0) + plot.x.at(100.0) - 2.0 * middle).abs() < 1e-9);
        assert!(plot.y.at(0.1) < plot.y.at(0.01));
        assert_eq!(plot.x.ticks().collect::<Vec<_>>(), [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0]);
        plot.dot((10.0, 0.1), "x & y", ErrorPlot::BLACK);
        // A value of 0 has a place.
        plot.line(&[(0.0, 0.01), (10.0, 0.1)], ErrorPlot::FAINT);
        let text = plot.finish();
        assert!(text.contains("a&lt;b: error") && text.contains("x &amp; y</title>"), "{text}");
        assert!(text.contains(">2 %<") && !text.contains("NaN"), "{text}");
    }
}
