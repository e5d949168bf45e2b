//! Frames that are rendered one after the other (`-frames`).
//!
//! Each frame is a process of its own, so that one that fails costs no other.

use crate::Options;
use crate::again::{Again, passed_on};
use granita_base::{Reporter, Supervisor};
use granita_cli::{Given, Status};
use granita_farm::{FrameRange, numbered};
use std::ffi::OsString;
use std::process::ExitStatus;

/// The options that are for the whole range, or that each frame gets in another form.
const OF_THE_RANGE: [&str; 9] =
    ["frames", "chunk", "task", "submit", "files", "number", "share", "more", "timeout"];

/// The options whose values are names of files of one frame.
const NAMES: [&str; 3] = ["output", "statistics_json", "safeout"];

/// The status after something outside of the program ended its work, so that trying again may help (`EX_TEMPFAIL` of
/// `sysexits.h`).
const TRY_AGAIN: u8 = 75;

/// Returns the words of the options that frames take over, for frame `number`.
pub(crate) fn words(options: &Options, given: &[Given], number: Option<i32>) -> Vec<OsString> {
    let name = |name: &str| number.map_or_else(|| name.to_owned(), |number| numbered(name, number));
    let mut words = Vec::new();
    for option in passed_on(given, &OF_THE_RANGE) {
        let is_name = NAMES.contains(&&*option.id);
        words.extend(option.words.iter().map(|word| match word.to_str() {
            Some(text) if is_name => name(text).into(),
            _ => word.clone(),
        }));
    }
    if let Some(number) = number {
        words.extend(["-number".to_owned(), number.to_string()].map(OsString::from));
    }
    words.push("--".into());
    words.extend(options.files.iter().map(|file| OsString::from(name(file))));
    words
}

/// Returns the frames of a task, or all of them without one.
///
/// # Errors
/// Returns a message when there is no such task.
fn of_task<'a>(frames: &'a FrameRange, options: &Options) -> Result<&'a [i32], String> {
    let chunk = options.chunk.unwrap_or(1) as usize;
    match options.task {
        None => Ok(frames.numbers()),
        Some(task) => frames.chunks(chunk).nth(task as usize).ok_or_else(|| {
            format!("-task {task}: there are {} tasks, the first is 0", frames.chunks(chunk).len())
        }),
    }
}

/// Renders the frames.
pub(crate) fn run(
    options: &Options,
    given: &[Given],
    supervisor: &Supervisor,
    reporter: &Reporter,
) -> Status {
    let Some(frames) = &options.frames else { return Status::Failed };
    let numbers = match of_task(frames, options) {
        Ok(numbers) => numbers,
        Err(what) => {
            reporter.error(what);
            return Status::Failed;
        }
    };
    let again = match Again::new(supervisor) {
        Ok(again) => again,
        Err(what) => {
            reporter.error(format!("-frames: {what}"));
            return Status::Failed;
        }
    };
    if options.files.is_empty() {
        reporter.error("no scene file was given (try -help)");
        return Status::Failed;
    }
    let (mut worst, mut failed) = (Status::Done, 0);
    for (done, number) in numbers.iter().enumerate() {
        if supervisor.has_ended() {
            return Status::WithErrors;
        }
        let part = 100.0 / numbers.len() as f64;
        let mut command = again.command();
        if options.progress.is_some() {
            command.args(["-share".to_owned(), (done as f64 * part).to_string(), part.to_string()]);
        }
        // Workers that join stay for the next frame.
        let stay = done + 1 < numbers.len() && !options.net.is_empty();
        command.args(stay.then_some("-more"));
        command.args(words(options, given, Some(*number)));
        reporter.info(format!("frame {number}, {} of {}", done + 1, numbers.len()));
        match again.run(command, &format!("rendering frame {number} of -frames")) {
            Ok(status) => match code(status) {
                Ok(0) => (),
                Ok(_) => {
                    failed += 1;
                    worst = Status::WithErrors;
                }
                Err(signal) => {
                    reporter.error(format!("frame {number}: its process was ended by signal {signal}"));
                    return Status::Other(TRY_AGAIN);
                }
            },
            Err(error) => {
                reporter.error(format!("frame {number}: {error}"));
                failed += 1;
                worst = Status::WithErrors;
            }
        }
    }
    if failed > 0 {
        reporter.error(format!("{failed} of {} frames have errors", numbers.len()));
    }
    worst
}

/// Returns the status of a process, or the signal that ended it.
fn code(status: ExitStatus) -> Result<i32, i32> {
    #[cfg(unix)]
    if let Some(signal) = std::os::unix::process::ExitStatusExt::signal(&status) {
        return Err(signal);
    }
    Ok(status.code().unwrap_or(1))
}
