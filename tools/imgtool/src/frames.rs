//! Sequences of files: one run of the command line for each frame.

use crate::parse::Step;
use crate::stack::Done;
use crate::table::Action;
use granita_edit::{FrameName, frames};

/// The frames of a command line. Each run has the numbers of the names with places for one, in their order.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Runs {
    /// The frames of each name with a place, and of each run.
    numbers: Vec<Vec<i64>>,
    /// The number of runs, at least 1.
    pub(crate) count: usize,
}

/// True for values of options that are names of files.
fn names_file(action: Action) -> bool {
    matches!(action, Action::Input | Action::Output)
}

/// Returns the names in a command line that have a place for a number, each with `true` when it is written.
fn names(steps: &[Step]) -> Vec<(FrameName, bool)> {
    let name = |step: &Step| match step {
        Step::Image(name) => Some((FrameName::parse(name)?, false)),
        Step::Option(given) if names_file(given.row.action) => {
            Some((FrameName::parse(&given.values[0])?, given.row.action == Action::Output))
        }
        Step::Option(_) => None,
    };
    steps.iter().filter_map(name).collect()
}

/// Returns the runs of a command line. `list` is the value of `-frames`.
///
/// # Errors
/// A message when names have different numbers of frames, or when none are known.
pub(crate) fn runs(steps: &[Step], list: Option<&str>) -> Done<Runs> {
    let names = names(steps);
    if names.is_empty() {
        return match list {
            None => Ok(Runs { numbers: Vec::new(), count: 1 }),
            Some(_) => Err("-frames: there is no name with # or %04d".into()),
        };
    }
    let common = match list {
        Some(list) => Some(frames(list).map_err(|e| format!("-frames: {e}"))?),
        None => {
            // The frames of the first input that selects some or has files are those of names that select none.
            let own = |name: &FrameName| name.frames().map(<[i64]>::to_vec).or_else(|| Some(name.existing()));
            let first = names.iter().find(|(_, is_written)| !is_written).or(names.first());
            first.and_then(|(name, _)| own(name))
        }
    };
    let common = common.unwrap_or_default();
    let numbers: Vec<Vec<i64>> = (names.iter())
        .map(|(name, _)| match (list, name.frames()) {
            (None, Some(own)) => own.to_vec(),
            _ => common.clone(),
        })
        .collect();
    let count = numbers[0].len();
    if count == 0 {
        return Err(format!("no files of {} exist; -frames names frames", names[0].0.file(0)).into());
    }
    if let Some(other) = numbers.iter().find(|frames| frames.len() != count) {
        return Err(format!("sequences of {count} and of {} frames in one command line", other.len()).into());
    }
    Ok(Runs { numbers, count })
}

impl Runs {
    /// Returns the command line of one run.
    pub(crate) fn steps(&self, run: usize, steps: &[Step]) -> Vec<Step> {
        let mut steps = steps.to_vec();
        let mut places = self.numbers.iter();
        for step in &mut steps {
            let name = match step {
                Step::Image(name) => name,
                Step::Option(given) if names_file(given.row.action) => &mut given.values[0],
                Step::Option(_) => continue,
            };
            if let Some(place) = FrameName::parse(name)
                && let Some(frames) = places.next()
            {
                *name = place.file(frames[run]);
            }
        }
        steps
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parse;

    fn steps(line: &str) -> Vec<Step> {
        let words: Vec<std::ffi::OsString> = line.split(' ').map(Into::into).collect();
        parse::steps(&words).unwrap()
    }

    #[test]
    fn names_of_sequences_go_in_step() {
        let line = steps("imgtool a.1-5x2#.exr b.%02d.exr -over -o:type=half c.101-103@@@.exr");
        let runs = runs(&line, None).unwrap();
        assert_eq!(runs.count, 3);
        let text = format!("{:?}", runs.steps(1, &line));
        for name in ["a.0003.exr", "b.03.exr", "c.102.exr"] {
            assert!(text.contains(name), "{text}");
        }
    }

    #[test]
    fn frames_are_counted() {
        assert_eq!(runs(&steps("imgtool a.exr -o b.exr"), None).unwrap().count, 1);
        assert_eq!(runs(&steps("imgtool -create 4x4 3 -o b.#.exr"), Some("1-24x2")).unwrap().count, 12);
        for (line, list, expected) in [
            ("imgtool a.exr -o b.exr", Some("1-2"), "no name with #"),
            ("imgtool a.1-3#.exr -o b.1-2#.exr", None, "3 and of 2 frames"),
            ("imgtool /nowhere/a.#.exr -o b.#.exr", None, "/nowhere/a.0000.exr"),
            ("imgtool a.#.exr", Some("x"), "-frames"),
        ] {
            let fault = runs(&steps(line), list).unwrap_err();
            assert!(fault.what.contains(expected), "{}", fault.what);
        }
    }
}
