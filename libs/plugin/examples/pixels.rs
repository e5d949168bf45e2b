//! Prints the pixels of images as floats, for comparisons with other readers.
//!
//! `cargo run -p granita-plugin --example pixels -- FILE ...`
//!
//! For each file it writes a line to standard output, `WIDTH HEIGHT CHANNELS TYPE NAMES` with the names of the channels
//! separated by commas, and then the values of the first image in rows, little-endian. Integers of 8 and 16 bits are
//! fractions of their largest value. A file that cannot be read has the line `error: REASON` and no values.

use granita_image::{FormatRegistry, Limits};
use std::io::Write;
use std::path::Path;

fn main() -> std::io::Result<()> {
    let formats = granita_plugin::bundled_formats(Limits::default());
    let mut out = std::io::BufWriter::new(std::io::stdout().lock());
    for name in std::env::args_os().skip(1) {
        match read(&formats, Path::new(&name)) {
            Ok((head, values)) => {
                writeln!(out, "{head}")?;
                for value in values {
                    out.write_all(&value.to_le_bytes())?;
                }
            }
            Err(error) => writeln!(out, "error: {}", error.to_string().replace('\n', " "))?,
        }
    }
    out.flush()
}

/// Returns the description of the first image of a file, and its values.
fn read(formats: &FormatRegistry, path: &Path) -> granita_image::Result<(String, Vec<f32>)> {
    let input = formats.open(path)?;
    let values = input.read_level(0, 0)?.to_floats();
    let head = input.spec(0, 0).map_or_else(String::new, |spec| {
        let (n, names) = (spec.nchannels(), spec.channels.join(","));
        format!("{} {} {n} {} {names}", spec.width, spec.height, spec.pixel_type.word())
    });
    Ok((head, values))
}
