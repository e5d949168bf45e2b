//! Copies an image into another format, row by row. Run it as `cargo run --example imagecopy IN OUT FORMAT`.
#![allow(clippy::print_stderr, reason = "an example")]

use granita_image::{CreateOptions, ImageError, Limits};
use std::path::Path;
use std::process::ExitCode;

/// Copies the largest level of the first image, with its attributes.
fn copy(from: &Path, to: &Path, format: &str) -> Result<(), ImageError> {
    let formats = granita_plugin::bundled_formats(Limits::default());
    let input = formats.open(from)?;
    let Some(spec) = input.spec(0, 0) else { return Ok(()) };
    let mut spec = spec.clone();
    // The output is stored in rows, with the default compression of its format.
    (spec.tile_width, spec.tile_height) = (0, 0);
    spec.attributes.0.retain(|p| &*p.name != "compression");
    if let Some(known) = formats.by_name(format) {
        spec.pixel_type = known.output_type(spec.pixel_type);
    }
    let mut output = formats.create(to, format, &CreateOptions::new(&spec, 1))?;
    for y in (0..spec.height).step_by(64) {
        let rows = input.read_rows(0, 0, y, spec.height.min(y + 64))?;
        output.write_rows(&rows.converted(spec.pixel_type))?;
    }
    output.close()
}

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().collect();
    let [_, from, to, format] = &args[..] else {
        eprintln!("imagecopy IN OUT FORMAT");
        return ExitCode::from(2);
    };
    match copy(from.as_ref(), to.as_ref(), format) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::from(1)
        }
    }
}
