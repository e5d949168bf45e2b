//! The image formats of this build, as text and as JSON.

use granita_image::{Format, FormatRegistry};
use serde_json::{Value, json};
use std::fmt::Write;

/// True for formats whose images are in a window, not in files. These are not read.
fn is_window(format: &dyn Format) -> bool {
    format.supports("rectangles")
}

/// Returns the types of values that the format stores, beside 8-bit integers where it stores these.
fn types(format: &dyn Format) -> Vec<&'static str> {
    ["u16", "half", "float"].into_iter().filter(|word| format.supports(word)).collect()
}

/// Returns a line for each format, in the order in which files are tried.
pub(crate) fn text(formats: &FormatRegistry) -> String {
    let mut text =
        format!("{:<12} {:<6} {:<8} {:<24} {}\n", "format", "reads", "writes", "extensions", "also");
    for format in formats.formats() {
        let word = |yes: bool| if yes { "yes" } else { "-" };
        let (reads, writes) = (word(!is_window(&**format)), word(format.supports("write")));
        let (extensions, aliases) = (format.extensions().join(" "), format.aliases().join(" "));
        let line = format!("{:<12} {reads:<6} {writes:<8} {extensions:<24} {aliases}", format.name());
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{}", line.trim_end());
    }
    if formats.by_name("heif").is_none() {
        text.push_str("HEIF and AVIF need a plugin (heif.imageio.so), and there is none\n");
    }
    text
}

/// Returns the same as JSON, with the further types that are written.
pub(crate) fn json(formats: &FormatRegistry) -> Value {
    let of = |format: &dyn Format| {
        json!({
            "name": format.name(),
            "aliases": format.aliases(),
            "extensions": format.extensions(),
            "reads": !is_window(format),
            "writes": format.supports("write"),
            "types": types(format),
        })
    };
    Value::Array(formats.formats().iter().map(|format| of(&**format)).collect())
}
