//! The actions of `iv` without a window.

use crate::args::Args;
use crate::{formats, info, json};
use granita_base::files::is_same_file;
use granita_base::{Location, Reporter, Severity};
use granita_cli::Status;
use granita_image::{FormatRegistry, PixelRect};
use granita_view::{
    ColorMap, Comparison, Display, FalseColor, Image, Page, Statistics, TileStore, Viewing, ascii, compare,
    difference_page, expand, flip_page, save_canvas, save_pixels, statistics, suited, thumbnail,
};
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// The common arguments of these actions.
pub(crate) struct Still<'a> {
    pub(crate) args: &'a Args,
    pub(crate) formats: &'a FormatRegistry,
    pub(crate) viewing: Option<&'a Viewing>,
    pub(crate) reporter: &'a Reporter,
}

impl Still<'_> {
    fn say(&self, text: String) {
        self.reporter.say(Severity::Message, &Location::default(), text);
    }

    /// Runs the requested action. Returns `None` when the window is requested.
    pub(crate) fn run(&self) -> Option<Status> {
        let args = self.args;
        if args.formats {
            match args.json {
                true => print_json(&formats::json(self.formats)),
                false => self.say(formats::text(self.formats)),
            }
            return Some(Status::Done);
        }
        let files = expand(&args.files, self.formats);
        let wanted = args.info || args.stats || args.compare || args.ascii || args.thumbnail.is_some();
        if !wanted {
            return None;
        }
        if files.is_empty() {
            self.reporter.error("no files are given");
            return Some(Status::Failed);
        }
        Some(if args.compare {
            self.compare(&files)
        } else {
            let mut found = Vec::new();
            let mut failed = 0;
            for file in &files {
                match self.one(file, files.len()) {
                    Ok(value) => found.extend(value),
                    Err(what) => {
                        self.reporter.error(what);
                        failed += 1;
                    }
                }
            }
            if args.json {
                print_json(&Value::Array(found));
            }
            match failed {
                0 => Status::Done,
                failed if failed == files.len() => Status::Failed,
                _ => Status::WithErrors,
            }
        })
    }

    fn open(&self, file: &Path) -> Result<Image, String> {
        let mut image = Image::open(file, self.formats, &TileStore::default()).map_err(|e| e.to_string())?;
        if self.viewing.is_some() {
            image.see_through(self.viewing);
        }
        Ok(image)
    }

    /// Returns the page and the layer that the options select, and their display.
    fn chosen<'p>(&self, image: &'p Image) -> Result<(&'p Page, usize, Display), String> {
        let look = &self.args.look;
        let name = image.path.display();
        let page = image.pages.get(look.page).ok_or_else(|| {
            format!(
                "{name}: there is no image {}, the file has {}, counted from 0",
                look.page,
                image.pages.len()
            )
        })?;
        let layer = layer_of(page, look.layer.as_deref()).map_err(|e| format!("{name}: {e}"))?;
        let display = look.display(&page.spec().channels).map_err(|e| format!("{name}: {e}"))?;
        let display = suited(page, layer, &display).map_err(|e| e.to_string())?;
        Ok((page, layer, display))
    }

    /// Does what is requested with a file. Returns what `-json` prints of it.
    fn one(&self, file: &Path, files: usize) -> Result<Option<Value>, String> {
        let args = self.args;
        let image = self.open(file)?;
        let mut found = None;
        if args.json {
            found = Some(match args.info {
                true => json::info(&image, &info::deep_samples(&image, self.formats)?),
                false => json::stats(&image)?,
            });
        } else if args.info {
            self.say(info::text(&image, &info::deep_samples(&image, self.formats)?));
        } else if args.stats {
            self.say(stats_text(&image)?);
        } else if args.ascii {
            let (page, layer, display) = self.chosen(&image)?;
            let environment = granita_cli::environment();
            let columns = environment.get("COLUMNS").and_then(|c| c.parse().ok());
            let columns = args.width.or(columns).unwrap_or(80);
            let text = ascii(page, layer, &display, columns, args.color).map_err(|e| e.to_string())?;
            if files > 1 {
                self.say(format!("{}\n", file.display()));
            }
            granita_cli::print(&text);
        } else if let Some(out) = &args.thumbnail {
            let (page, layer, display) = self.chosen(&image)?;
            let canvas = thumbnail(page, layer, &display, args.size).map_err(|e| e.to_string())?;
            let out = match files > 1 || out.is_dir() {
                true => {
                    let mut name = file.file_name().unwrap_or_default().to_owned();
                    name.push(".png");
                    out.join(name)
                }
                false => out.clone(),
            };
            if is_same_file(file, &out) {
                return Err(format!("{} is the image itself, and is not overwritten", out.display()));
            }
            save_canvas(&canvas, &out, self.formats).map_err(|e| e.to_string())?;
            self.reporter.info(format!("wrote {}: {} x {}", out.display(), canvas.width, canvas.height));
        }
        for (i, page) in image.pages.iter().enumerate() {
            if let Some(fault) = page.fault() {
                self.reporter.warning(format!("image {i} could not be read completely: {fault}"));
            }
        }
        Ok(found)
    }

    fn compare(&self, files: &[PathBuf]) -> Status {
        let [a, b] = files else {
            self.reporter.error(format!("-compare takes two files, not {}", files.len()));
            return Status::Failed;
        };
        match self.compare_two(a, b) {
            Ok(true) => Status::Done,
            Ok(false) => Status::WithErrors,
            Err(what) => {
                self.reporter.error(what);
                Status::Failed
            }
        }
    }

    /// True when two files are equal within the limits.
    fn compare_two(&self, a: &Path, b: &Path) -> Result<bool, String> {
        let (one, two) = (self.open(a)?, self.open(b)?);
        let pair = format!("{} and {}", a.display(), b.display());
        if one.pages.len() != two.pages.len() {
            return Err(format!("{pair}: {} images against {}", one.pages.len(), two.pages.len()));
        }
        let limits = &self.args.limits;
        let options = limits.options(self.args.look.exposure);
        let mut alike = true;
        let mut pages = Vec::new();
        for (i, (p, q)) in one.pages.iter().zip(&two.pages).enumerate() {
            let found = compare(p, q, &options).map_err(|e| format!("{pair}: {e}"))?;
            for (file, page) in [(a, p), (b, q)] {
                // Missing pixels must not count as black.
                if let Some(fault) = page.fault() {
                    return Err(format!("{}: not all of it can be read: {fault}", file.display()));
                }
            }
            let faults = self.beyond(&found);
            alike &= faults.is_empty();
            if self.args.json {
                pages.push(json::comparison(&found, &faults));
                continue;
            }
            if one.pages.len() > 1 {
                self.say(format!("image {i}\n"));
            }
            self.say(comparison_text(&found));
            faults.iter().for_each(|fault| self.say(format!("  beyond: {fault}\n")));
        }
        self.write_differences((a, &one), (b, &two)).map_err(|e| format!("{pair}: {e}"))?;
        if self.args.json {
            let files = [a, b].map(|file| file.display().to_string());
            print_json(&json!({ "files": files, "alike": alike, "images": pages }));
            return Ok(alike);
        }
        self.say(if alike { "alike\n".to_owned() } else { "different\n".to_owned() });
        Ok(alike)
    }

    /// Writes the images of `-diff` and `-flipmap`, for the image of `-page`.
    fn write_differences(&self, a: (&Path, &Image), b: (&Path, &Image)) -> Result<(), String> {
        let (limits, page) = (&self.args.limits, self.args.look.page);
        let (Some(p), Some(q)) = (a.1.pages.get(page), b.1.pages.get(page)) else {
            return Err(format!("there is no image {page}"));
        };
        let outs = limits.diff.iter().chain(&limits.flipmap);
        if let Some(out) = outs.clone().find(|out| is_same_file(a.0, out) || is_same_file(b.0, out)) {
            return Err(format!("{} is compared, and is not overwritten", out.display()));
        }
        let store = TileStore::default();
        if let Some(out) = &limits.diff {
            let page = difference_page(p, q, limits.diffscale, &store).map_err(|e| e.to_string())?;
            save_pixels(&page, None, out, self.formats).map_err(|e| e.to_string())?;
        }
        if let Some(out) = &limits.flipmap {
            let options = limits.options(self.args.look.exposure);
            let page = flip_page(p, q, &options, &store).map_err(|e| e.to_string())?;
            let extension = out.extension().and_then(|e| e.to_str()).unwrap_or_default();
            let has_floats = |format: &str| {
                self.formats.by_name(format).is_some_and(|f| f.supports("float") || f.supports("half"))
            };
            if has_floats(extension) {
                save_pixels(&page, None, out, self.formats).map_err(|e| e.to_string())?;
            } else {
                let colors = FalseColor { map: ColorMap::Magma, low: 0.0, high: 1.0, log: false };
                let display = Display { false_color: Some(colors), ..Display::default() };
                let longest = page.spec().width.max(page.spec().height);
                let canvas = thumbnail(&page, 0, &display, longest).map_err(|e| e.to_string())?;
                save_canvas(&canvas, out, self.formats).map_err(|e| e.to_string())?;
            }
        }
        outs.for_each(|out| self.reporter.info(format!("wrote {}", out.display())));
        Ok(())
    }

    /// Returns a description of each value that is beyond its limit.
    fn beyond(&self, found: &Comparison) -> Vec<String> {
        let limits = &self.args.limits;
        let mut faults = Vec::new();
        let others = limits.maxrms.is_some() || limits.minpsnr.is_some() || limits.maxflip.is_some();
        let pixels = f64::from(found.size.0) * f64::from(found.size.1);
        let percent = 100.0 * found.pixels_beyond as f64 / pixels;
        let broken: u64 = found.channels.iter().map(|c| c.broken).sum();
        if limits.fail.is_some() || limits.failpercent.is_some() || !others {
            let most = limits.failpercent.unwrap_or(0.0);
            if percent > most {
                let by = limits.fail.unwrap_or(0.0);
                faults.push(format!("{percent:.4} % of the pixels differ by more than {by}, {most} % may"));
            }
        } else if broken > 0 {
            faults.push(format!("{broken} values are not finite in only one of them"));
        }
        if limits.maxrms.is_some_and(|most| found.rms > most) {
            faults.push(format!(
                "root mean square {:.6} exceeds {}",
                found.rms,
                limits.maxrms.unwrap_or(0.0)
            ));
        }
        if limits.minpsnr.is_some_and(|least| found.psnr < least) {
            faults.push(format!("{:.3} dB are less than {}", found.psnr, limits.minpsnr.unwrap_or(0.0)));
        }
        if let Some(most) = limits.maxflip {
            match found.flip {
                Some((mean, _)) if mean > most => faults.push(format!("FLIP {mean:.6} exceeds {most}")),
                Some(_) => {}
                None => faults.push("FLIP is computed for colours only, of at most 64 Mi pixels".to_owned()),
            }
        }
        if !found.single.is_empty() {
            faults.push(format!("only one of them has {}", found.single.join(" ")));
        }
        faults
    }
}

fn print_json(value: &Value) {
    granita_cli::print(&format!("{value:#}\n"));
}

/// Returns the index of the layer with a name or an index; the first layer without one.
pub(crate) fn layer_of(page: &Page, name: Option<&str>) -> Result<usize, String> {
    let Some(name) = name else { return Ok(0) };
    let names: Vec<String> = page.layers.iter().map(|l| l.title(&page.spec().channels)).collect();
    let by_name = names.iter().position(|n| n == name);
    let by_number = || name.parse().ok().filter(|n| *n < names.len());
    by_name
        .or_else(by_number)
        .ok_or_else(|| format!("there is no layer \"{name}\", only {}", names.join(", ")))
}

/// Formats a number with about seven significant digits, without trailing zeros.
pub(crate) fn number(v: f64) -> String {
    if v == 0.0 || !v.is_finite() {
        return v.to_string();
    }
    let text = match v.abs() {
        1e-4..1e7 => format!("{v:.*}", (6 - v.abs().log10().floor() as i32).clamp(0, 10) as usize),
        _ => return format!("{v:.6e}"),
    };
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// Formats rows as lines with columns of equal width. The first column is aligned to the left, the others to the right.
pub(crate) fn table(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns)
        .map(|c| rows.iter().filter_map(|r| r.get(c)).map(|t| t.chars().count()).max().unwrap_or(0))
        .collect();
    let mut text = String::new();
    for row in rows {
        text.push_str("  ");
        for (c, (cell, width)) in row.iter().zip(&widths).enumerate() {
            // Writing to a string cannot fail.
            let _ = if c == 0 { write!(text, "{cell:<width$}") } else { write!(text, "  {cell:>width$}") };
        }
        text.truncate(text.trim_end().len());
        text.push('\n');
    }
    text
}

/// Formats the statistics of channels of these names, with a row for each channel and headings for the columns.
pub(crate) fn statistics_table(names: &[String], found: &[Statistics]) -> String {
    let words = ["channel", "min", "max", "mean", "deviation", "negative", "NaN", "inf"];
    let mut rows = vec![words.map(str::to_owned).to_vec()];
    for (name, s) in names.iter().zip(found) {
        let value = |v: f64| if s.count > 0 { number(v) } else { "-".to_owned() };
        rows.push(vec![
            name.clone(),
            value(f64::from(s.min)),
            value(f64::from(s.max)),
            value(s.mean),
            value(s.deviation()),
            s.negative.to_string(),
            s.nan.to_string(),
            s.infinite.to_string(),
        ]);
    }
    table(&rows)
}

fn stats_text(image: &Image) -> Result<String, String> {
    let mut text = String::new();
    for (i, page) in image.pages.iter().enumerate() {
        let spec = page.spec();
        let name = image.path.display();
        let _ = match image.pages.len() {
            1 => writeln!(text, "{name}: {}", info::summary(spec)),
            _ => writeln!(text, "{name}#{i}: {}", info::summary(spec)),
        };
        let all = PixelRect::at(0, 0, spec.width, spec.height);
        let found = statistics(page, 0, all).map_err(|e| e.to_string())?;
        text.push_str(&statistics_table(&spec.channels, &found));
    }
    Ok(text)
}

/// Formats the differences between two pages.
fn comparison_text(found: &Comparison) -> String {
    let words = ["channel", "mean", "bias", "rms", "max", "at", "beyond"];
    let mut rows = vec![words.map(str::to_owned).to_vec()];
    for c in &found.channels {
        rows.push(vec![
            c.name.clone(),
            number(c.mean),
            number(c.bias),
            number(c.rms),
            number(f64::from(c.max)),
            if c.max > 0.0 { format!("{},{}", c.max_at.0, c.max_at.1) } else { "-".to_owned() },
            c.beyond.to_string(),
        ]);
    }
    let mut text = format!("{} x {} pixels\n{}", found.size.0, found.size.1, table(&rows));
    let flip = match found.flip {
        Some((mean, max)) => format!(", FLIP {} (largest {})", number(mean), number(f64::from(max))),
        None => String::new(),
    };
    let psnr = if found.psnr.is_finite() { format!("{:.3} dB", found.psnr) } else { "infinite".to_owned() };
    let _ = writeln!(
        text,
        "  rms {}, PSNR {psnr}, max {}{flip}",
        number(found.rms),
        number(f64::from(found.max))
    );
    if found.decoded {
        text.push_str("  one stores encoded colours, which were decoded\n");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_printed_shortly() {
        for (v, text) in [
            (0.0, "0"),
            (1.0, "1"),
            (0.5, "0.5"),
            (1.0 / 3.0, "0.3333333"),
            (-1234.5678, "-1234.568"),
            (1e30, "1.000000e30"),
            (1e-9, "1.000000e-9"),
            (1e6, "1000000"),
            (f64::INFINITY, "inf"),
            (f64::NAN, "NaN"),
        ] {
            assert_eq!(number(v), text);
        }
    }

    #[test]
    fn columns_of_tables_are_aligned() {
        let rows = [vec!["a".to_owned(), "10".to_owned()], vec!["bcd".to_owned(), "2".to_owned()]];
        assert_eq!(table(&rows), "  a    10\n  bcd   2\n");
    }
}
