//! The content of a file, as text.

use granita_base::{Param, ParamData};
use granita_image::{DeepSamples, FormatRegistry, ImageSpec};
use granita_texture::TextureKind;
use granita_view::{Image, Page};
use std::fmt::Write;

/// Returns a value as one word or line.
fn value(param: &Param) -> String {
    match &param.data {
        ParamData::Float(v) => v.iter().map(|v| v.to_string()).collect::<Vec<_>>().join(" "),
        ParamData::Int(v) if &*param.name == "preview" && v.len() > 2 => {
            format!("{} x {} pixels", v[0], v[1])
        }
        ParamData::Int(v) => v.iter().map(|v| v.to_string()).collect::<Vec<_>>().join(" "),
        ParamData::String(v) => {
            let text = v.iter().map(|v| format!("\"{}\"", v.escape_debug())).collect::<Vec<_>>().join(" ");
            match text.char_indices().nth(200) {
                Some((at, _)) => format!("{}... ({} characters)", &text[..at], text.chars().count()),
                None => text,
            }
        }
    }
}

/// Returns the size, channels and storage of a level, on one line.
pub(crate) fn summary(spec: &ImageSpec) -> String {
    let names = match spec.nchannels() {
        0..=8 => spec.channels.join(" "),
        _ => format!("{} ... {}", spec.channels[..7].join(" "), spec.channels[spec.nchannels() - 1]),
    };
    let n = spec.nchannels();
    let s = if n == 1 { "" } else { "s" };
    format!("{} x {}, {n} channel{s} ({names}) of {}", spec.width, spec.height, spec.pixel_type.word())
}

/// Counts the samples of the deep images of a file. All of these are read. `None` for other images.
///
/// # Errors
/// Returns an error when the file cannot be read.
pub(crate) fn deep_samples(
    image: &Image,
    formats: &FormatRegistry,
) -> Result<Vec<Option<DeepSamples>>, String> {
    if !image.pages.iter().any(|page| page.spec().string("deep").is_some()) {
        return Ok(vec![None; image.pages.len()]);
    }
    let input = formats.open(&image.path).map_err(|e| e.to_string())?;
    (0..image.pages.len()).map(|page| input.deep_samples(page, 0).map_err(|e| e.to_string())).collect()
}

fn page_text(page: &Page, deep: Option<DeepSamples>) -> String {
    let spec = page.spec();
    let mut text = format!("  {}\n", summary(spec));
    // Writing to a string cannot fail.
    let mut line = |what: &str, value: String| {
        let _ = writeln!(text, "    {what:<16} {value}");
    };
    if spec.is_tiled() {
        line("tiles", format!("{} x {}", spec.tile_width, spec.tile_height));
    }
    if page.specs.len() > 1 {
        let sizes: Vec<String> = page.specs.iter().map(|s| format!("{}x{}", s.width, s.height)).collect();
        line("levels", format!("{}: {}", sizes.len(), sizes.join(" ")));
    }
    if (spec.x, spec.y) != (0, 0) {
        line("position", format!("{} {}", spec.x, spec.y));
    }
    let full = (spec.full_x, spec.full_y, spec.full_width, spec.full_height);
    if full != (spec.x, spec.y, spec.width, spec.height) && page.layout.is_none() {
        line("display window", format!("{} x {} at {} {}", full.2, full.3, full.0, full.1));
    }
    if !page.colors.text.is_empty() {
        line("colours", page.colors.text.clone());
    }
    if page.kind != TextureKind::Plain {
        line("kind", page.kind.word().to_owned());
    }
    if let Some((size, _)) = page.layout.and_then(|l| l.face_size(spec)) {
        line("faces", format!("6 of {size} x {size}"));
    }
    if page.layers.len() > 1 {
        let names: Vec<String> = page.layers.iter().map(|l| l.title(&spec.channels)).collect();
        line("layers", names.join(", "));
    }
    if let Some(DeepSamples { total, most_per_pixel }) = deep {
        line("deep samples", format!("{total}, at most {most_per_pixel} per pixel"));
    }
    for param in spec.attributes.iter().filter(|p| &*p.name != "name") {
        line(&param.name, value(param));
    }
    text
}

/// Returns everything about a file except its pixels, with a line for the file and a block for each image. `deep` holds
/// the samples of deep images, if they were counted.
pub(crate) fn text(image: &Image, deep: &[Option<DeepSamples>]) -> String {
    let n = image.pages.len();
    let mut text = format!("{}: {}", image.path.display(), image.format);
    if n > 1 {
        let _ = write!(text, ", {n} images");
    }
    text.push('\n');
    for (i, page) in image.pages.iter().enumerate() {
        if n > 1 {
            let name = if page.name.is_empty() { String::new() } else { format!(" \"{}\"", page.name) };
            let _ = writeln!(text, "  image {i}{name}");
        }
        text.push_str(&page_text(page, deep.get(i).copied().flatten()));
    }
    text
}
