//! The times of drags, and their table.

use std::time::Duration;

/// The largest allowed time from an event of a drag to the first image with its change.
const FIRST: Duration = Duration::from_millis(150);
/// The largest allowed time from the end of a drag to the final image.
const FINAL: Duration = Duration::from_secs(2);

/// The times of drags of one kind, in milliseconds.
#[derive(Debug, Default)]
pub(crate) struct Times {
    /// From the first event of each drag to the first image with its change.
    pub(crate) first: Vec<f64>,
    /// From each event, also while an earlier one is rendered, to the first image with its change.
    pub(crate) events: Vec<f64>,
    /// From each release to the final image.
    pub(crate) last: Vec<f64>,
}

/// Prints the head of the table.
pub(crate) fn head() {
    println!("{:<44} {:>18} {:>22} {:>18}", "", "first event, ms", "each event, ms", "release, ms");
    println!(
        "{:<44} {:>8} {:>9} {:>6} {:>6} {:>8} {:>8} {:>9}",
        "drag", "median", "maximum", "number", "median", "maximum", "median", "maximum"
    );
}

impl Times {
    /// Prints a row. A time is missed when its median is above its bar.
    pub(crate) fn print(&mut self, what: &str) -> Result<(), String> {
        let [first, each, last] = [&mut self.first, &mut self.events, &mut self.last].map(|v| summary(v));
        let ((first, first_most), (each, each_most), (last, last_most)) = (first?, each?, last?);
        let bars = [("first event", first, FIRST), ("each event", each, FIRST), ("release", last, FINAL)];
        let missed: Vec<String> = bars
            .iter()
            .filter(|(_, median, bar)| *median > bar.as_secs_f64() * 1e3)
            .map(|(name, _, bar)| format!("{name} (bar {} ms)", bar.as_millis()))
            .collect();
        let missed =
            if missed.is_empty() { String::new() } else { format!("  missed: {}", missed.join(", ")) };
        println!(
            "{what:<44} {first:>8.0} {first_most:>9.0} {:>6} {each:>6.0} {each_most:>8.0} {last:>8.0} {last_most:>9.0}{missed}",
            self.events.len()
        );
        Ok(())
    }
}

/// Returns the median and the maximum.
fn summary(values: &mut [f64]) -> Result<(f64, f64), String> {
    values.sort_by(f64::total_cmp);
    let most = values.last().ok_or("a drag without an image")?;
    Ok((values[values.len() / 2], *most))
}
