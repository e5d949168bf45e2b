//! The records of a session about its frames, which are statistics, lists of files and error logs.

use granita_base::report::Sink;
use granita_base::{FileError, Files, Reporter};
use granita_render::{FrameReport, ShadingStatistics, Statistics};
use granita_scene::InputCounts;
use parking_lot::Mutex;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// The record of one `Render`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameRecord {
    /// True when every pixel was rendered and every image written.
    pub complete: bool,
    /// The time from the call to its end.
    pub time: Duration,
    /// The statistics of each camera that has images, by its name.
    pub cameras: Vec<(Arc<str>, Statistics)>,
    /// The statistics of shading, for all cameras together.
    pub shading: ShadingStatistics,
    /// The counts of inputs with a bound.
    pub inputs: InputCounts,
    /// The written files, in order of declaration.
    pub images: Vec<PathBuf>,
}

impl FrameRecord {
    /// Makes the record of a frame that ended, or that was aborted (`None`).
    pub(crate) fn new(report: Option<FrameReport>, inputs: InputCounts, time: Duration) -> Self {
        match report {
            Some(report) => Self {
                complete: report.complete,
                time,
                cameras: report.statistics,
                shading: report.shading,
                inputs,
                images: report.images,
            },
            None => Self { time, inputs, ..Self::default() },
        }
    }

    /// Returns a text for people, in the detail of "statistics:level".
    pub(crate) fn text(&self, level: i32, reporter: &Reporter) -> String {
        let mut text = String::new();
        for (camera, statistics) in &self.cameras {
            text += &statistics.report(camera);
            text.push('\n');
        }
        text += &self.shading.report();
        text.push('\n');
        if self.inputs != InputCounts::default() {
            let InputCounts { read, unread } = self.inputs;
            text += &format!("  {:<34} {}\n", "inputs with a bound", read + unread);
            text += &format!("  {:<34} {unread}\n", "  never read");
        }
        if level >= 2 {
            let files = reporter.files_read();
            text += &format!("  {:<34} {}\n", "files read", files.len());
            files.iter().for_each(|f| text += &format!("    {}\n", f.display()));
        }
        text
    }
}

/// Writes a text so that the file appears complete or not at all. Failures are reported.
pub(crate) fn write_whole(path: &Path, text: &str, files: &Files, reporter: &Reporter) {
    let written = files.create(path).and_then(|mut file| {
        file.write_all(text.as_bytes()).map_err(|error| file.io_error(error))?;
        file.commit()
    });
    if let Err(error) = written {
        reporter.error(error.to_string());
    }
}

/// Writes "debug:filesread" (reference 4.3.7) with one name per line, in the format of `tar -T`.
pub(crate) fn write_files_read(path: &Path, files: &Files, reporter: &Reporter) {
    let mut text = String::new();
    for file in reporter.files_read() {
        let name = file.to_string_lossy();
        // `tar` would read a name with a leading dash as an option.
        if name.starts_with('-') {
            text.push_str("./");
        }
        // `tar -T` reads escapes as those of a string.
        name.chars().for_each(|c| match c {
            '\\' => text.push_str("\\\\"),
            '\n' => text.push_str("\\n"),
            c if c.is_control() => c.to_string().bytes().for_each(|b| text.push_str(&format!("\\{b:03o}"))),
            c => text.push(c),
        });
        text.push('\n');
    }
    write_whole(path, &text, files, reporter);
}

/// Opens "error:filename" (reference 4.3.7). Messages are written to this file at once as whole lines, so that the
/// log of a killed program ends with its last message.
pub(crate) fn error_log(path: &Path, files: &Files) -> Result<Sink, FileError> {
    let file = Mutex::new(files.create_log(path)?);
    Ok(Box::new(move |message| {
        let mut file = file.lock();
        // There is no other place to report a log that cannot be written.
        let _ = file.write_all(format!("{message}\n").as_bytes());
    }))
}
