//! Writes a page that shows the reference, result and difference of every reference image.

use crate::{Image, Outcome};
use std::fmt::Write;
use std::path::Path;

/// Writes `folder/index.html` and the images beside it.
///
/// # Errors
/// Returns an error when a file cannot be written.
pub fn write_report(folder: &Path, outcomes: &[Outcome]) -> Result<(), String> {
    let mut page = String::from(
        "<!doctype html><meta charset=utf-8><title>Suite</title><style>body{font:14px sans-serif}\
         img{image-rendering:pixelated;width:256px;background:#888}td{padding:4px}.bad{color:#b00}</style>\
         <table><tr><th>case<th>reference<th>result<th>difference &times; 8",
    );
    for outcome in outcomes {
        let class = if outcome.faults.is_empty() { "" } else { " class=bad" };
        if outcome.images.is_empty() {
            if !outcome.faults.is_empty() {
                let _ = write!(page, "<tr><td{class}>{}<td colspan=3><pre>", outcome.name);
                outcome.faults.iter().for_each(|fault| page.push_str(&escaped(fault)));
                page.push_str("</pre>");
            }
            continue;
        }
        for (title, reference, result) in &outcome.images {
            let _ = write!(page, "<tr><td{class}>{}<br>{}", outcome.name, escaped(title));
            let stem = format!("{}-{title}", outcome.name).replace(['/', '.'], "-");
            let (kept, made) = (Image::read(reference).ok(), Image::read(result).ok());
            let difference = match (&kept, &made) {
                (Some(a), Some(b)) if a.difference(b).is_ok() => Some(a.difference_image(b)),
                _ => None,
            };
            for (what, image) in [("reference", kept), ("result", made), ("difference", difference)] {
                let name = format!("{stem}-{what}.png");
                match image {
                    Some(image) => {
                        image.write_png(&folder.join(&name))?;
                        let _ = write!(page, "<td><img src=\"{name}\">");
                    }
                    None => page.push_str("<td>none"),
                }
            }
        }
    }
    page.push_str("</table>\n");
    let index = folder.join("index.html");
    std::fs::write(&index, page).map_err(|e| format!("{}: {e}", index.display()))
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}
