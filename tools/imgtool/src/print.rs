//! What is printed on request: descriptions, statistics, comparisons.

use crate::parse::Given;
use crate::stack::{Done, Entry, Fault, Machine};
use crate::table::Action;
use granita_base::{Param, ParamData};
use granita_edit::{DiffLimits, Difference, Verdict, difference, statistics};
use granita_image::ImageSpec;
use std::fmt::Write;

/// Carries out an option that prints.
pub(crate) fn act(machine: &mut Machine<'_>, given: &Given) -> Done {
    match given.row.action {
        Action::Info => {
            let verbose = given.flag("verbose", machine.settings.verbose)?;
            match machine.stack.is_empty() {
                true => {
                    machine.info = Some(verbose);
                    Ok(())
                }
                false => info(machine, verbose),
            }
        }
        Action::Stats => match machine.stack.is_empty() {
            true => {
                machine.stats = true;
                Ok(())
            }
            false => stats(machine),
        },
        Action::Echo => {
            machine.say(format!("{}\n", given.values[0]));
            Ok(())
        }
        _ => compare(machine),
    }
}

/// Returns a value as one line.
fn value(param: &Param) -> String {
    fn list<T: ToString>(values: &[T]) -> String {
        values.iter().map(T::to_string).collect::<Vec<_>>().join(" ")
    }
    match &param.data {
        ParamData::Float(v) => list(v),
        ParamData::Int(v) => list(v),
        ParamData::String(v) => {
            let text = v.iter().map(|v| format!("\"{}\"", v.escape_debug())).collect::<Vec<_>>().join(" ");
            match text.char_indices().nth(200) {
                Some((at, _)) => format!("{}... ({} characters)", &text[..at], text.chars().count()),
                None => text,
            }
        }
    }
}

/// Returns the size, the channels and the type of an image, on one line.
fn summary(entry: &Entry) -> String {
    let spec = entry.image.spec();
    let n = spec.nchannels();
    let names = match n {
        0..=8 => spec.channels.join(" "),
        _ => format!("{} ... {}", spec.channels[..7].join(" "), spec.channels[n - 1]),
    };
    let s = if n == 1 { "" } else { "s" };
    let kind = entry.image.stored().word();
    let mut text =
        format!("{}: {} x {}, {n} channel{s} ({names}) of {kind}", entry.name, spec.width, spec.height);
    if let Some((file, image, _)) = &entry.file {
        text.push_str(&format!(", {}", file.format()));
        for (count, what) in [(file.images(), "images"), (file.levels(*image), "levels")] {
            if count > 1 {
                text.push_str(&format!(", {count} {what}"));
            }
        }
    }
    text
}

fn details(spec: &ImageSpec) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    let mut line = |what: &str, value: String| {
        let _ = writeln!(text, "  {what:<18} {value}");
    };
    if spec.is_tiled() {
        line("tiles", format!("{} x {}", spec.tile_width, spec.tile_height));
    }
    if (spec.x, spec.y) != (0, 0) {
        line("position", format!("{} {}", spec.x, spec.y));
    }
    if (spec.full_x, spec.full_y, spec.full_width, spec.full_height)
        != (spec.x, spec.y, spec.width, spec.height)
    {
        let at = format!("{} {}", spec.full_x, spec.full_y);
        line("display window", format!("{} x {} at {at}", spec.full_width, spec.full_height));
    }
    for param in &spec.attributes {
        line(&param.name, value(param));
    }
    text
}

/// Prints the description of the last image.
pub(crate) fn info(machine: &mut Machine<'_>, verbose: bool) -> Done {
    let Some(entry) = machine.stack.last() else { return Ok(()) };
    let mut text = summary(entry);
    text.push('\n');
    if verbose {
        text.push_str(&details(entry.image.spec()));
    }
    machine.say(text);
    Ok(())
}

/// Formats a number with about seven significant digits.
fn number(v: f64) -> String {
    if v == 0.0 || !v.is_finite() {
        return v.to_string();
    }
    match v.abs() {
        1e-4..1e7 => {
            let text = format!("{v:.*}", (6 - v.abs().log10().floor() as i32).clamp(0, 10) as usize);
            match text.contains('.') {
                true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
                false => text,
            }
        }
        _ => format!("{v:.6e}"),
    }
}

/// Prints the statistics of the last image.
pub(crate) fn stats(machine: &mut Machine<'_>) -> Done {
    machine.hold_top()?;
    let Some(entry) = machine.stack.last() else { return Ok(()) };
    let found = statistics(&entry.image)?;
    let mut rows = vec![
        "channel min max mean deviation negative NaN inf".split(' ').map(str::to_owned).collect::<Vec<_>>(),
    ];
    for (name, s) in entry.image.spec().channels.iter().zip(&found) {
        let value = |v: f64| if s.count > 0 { number(v) } else { "-".to_owned() };
        let numbers = [f64::from(s.min), f64::from(s.max), s.mean, s.deviation()].map(value);
        let counts = [s.negative, s.nan, s.infinite].map(|n| n.to_string());
        rows.push([name.clone()].into_iter().chain(numbers).chain(counts).collect());
    }
    let mut text = format!("{}\n", summary(entry));
    let width = |c: usize| rows.iter().map(|row| row[c].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..rows[0].len()).map(width).collect();
    for row in &rows {
        let _ = write!(text, "  {:<1$}", row[0], widths[0]);
        for (cell, width) in row.iter().zip(&widths).skip(1) {
            let _ = write!(text, "  {cell:>width$}");
        }
        text.push('\n');
    }
    machine.say(text);
    Ok(())
}

/// Compares the last two images.
fn compare(machine: &mut Machine<'_>) -> Done {
    let [.., a, b] = &*machine.stack else { return Err("there are no two images".into()) };
    let size = |entry: &Entry| (entry.image.data(), entry.image.spec().nchannels());
    let is_size = size(a) != size(b);
    let names = format!("Comparing \"{}\" and \"{}\"\n", a.name, b.name);
    let limits = machine.limits;
    let found = difference(&a.image, &b.image, &limits);
    let channels = a.image.spec().channels.clone();
    let found = found.map_err(|error| Fault { what: error.to_string(), is_size })?;
    let verdict = found.verdict(&limits);
    machine.verdict = machine.verdict.max(Some(verdict));
    let text = names + &comparison(&found, &channels, &limits, verdict);
    machine.say(text);
    Ok(())
}

/// Formats a comparison.
fn comparison(found: &Difference, channels: &[String], limits: &DiffLimits, verdict: Verdict) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    let mut line = |what: String| {
        let _ = writeln!(text, "  {what}");
    };
    if verdict == Verdict::Pass && found.max == 0.0 {
        return "PASS\n".to_owned();
    }
    line(format!("Mean error = {}", number(found.mean)));
    line(format!("RMS error = {}", number(found.rms)));
    line(format!("Peak SNR = {}", number(found.psnr)));
    let (x, y, c) = found.max_at;
    let values = |list: &[f32]| list.iter().map(|v| number(f64::from(*v))).collect::<Vec<_>>().join(", ");
    let name = channels.get(c).map_or("", |name| name);
    line(format!(
        "Max error  = {} @ ({x}, {y}, {name})  values are {} vs {}",
        number(f64::from(found.max)),
        values(&found.max_values[0]),
        values(&found.max_values[1])
    ));
    for (count, limit) in [(found.warned, limits.warn), (found.failed, limits.fail)] {
        let percent = 100.0 * count as f64 / found.pixels.max(1) as f64;
        line(format!("{count} pixels ({}%) over {limit}", number(percent)));
    }
    text.push_str(match verdict {
        Verdict::Pass => "PASS\n",
        Verdict::Warning => "WARNING\n",
        Verdict::Failure => "FAILURE\n",
    });
    text
}
