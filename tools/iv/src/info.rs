//! What is in a file, as text.

use granita_base::{Location, Reporter, Severity};
use granita_cli::Status;
use granita_image::FormatRegistry;
use std::path::PathBuf;

/// `-info`: one block of lines for each file.
pub(crate) fn run(files: &[PathBuf], formats: &FormatRegistry, reporter: &Reporter) -> Status {
    let mut done = 0;
    for file in files {
        match formats.open(file) {
            Ok(input) => {
                let spec = input.spec(0, 0);
                let (width, height) = spec.map_or((0, 0), |s| (s.width, s.height));
                let text = format!("{}: {}, {width} x {height}\n", file.display(), input.format_name());
                reporter.say(Severity::Message, &Location::default(), text);
                done += 1;
            }
            Err(error) => reporter.error(error.to_string()),
        }
    }
    match files.len() - done {
        0 => Status::Done,
        _ if done == 0 => Status::Failed,
        _ => Status::WithErrors,
    }
}
