//! Scripts: the actions of a user, line by line, for tests and images of the manual.
//!
//! | line | meaning |
//! |---|---|
//! | `wait` | until everything in sight has been read and computed |
//! | `frames N` | N frames |
//! | `sleep S` | S seconds |
//! | `key KEY` | a key as the table of keys has it, as `Shift+L` |
//! | `move X Y` | the pointer, in pixels of the screen |
//! | `click X Y [Shift+][Ctrl+]` | the primary button |
//! | `drag X Y X Y [Shift+][Ctrl+]` | the primary button, in eight steps |
//! | `scroll X Y N` | the wheel, N steps away from the user |
//! | `type TEXT` | text, where text is asked for |
//! | `file NAME` | a picture is added and shown |
//! | `screenshot FILE` | all of the window |
//! | `canvas FILE` | the picture alone |
//! | `print` | what the status line says |
//! | `bench N` | pans N frames; prints frames per second and memory |
//! | `expect TEXT` | the status line, the side panel or the message has this in it, or the exit status is 1 |
//! | `quit` | the end |

use eframe::egui::Event;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// One line.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Step {
    Wait,
    Frames(u32),
    Sleep(f64),
    Key(String),
    Move(f32, f32),
    Click(f32, f32, String),
    Drag([f32; 4], String),
    Scroll(f32, f32, f32),
    Type(String),
    File(PathBuf),
    Screenshot(PathBuf),
    Canvas(PathBuf),
    Print,
    Bench(u32),
    Expect(String),
    Quit,
}

/// Reads a script.
///
/// # Errors
/// The error of a line, with the line.
pub(crate) fn read(path: &Path) -> Result<Vec<Step>, String> {
    let text = std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
    let steps = text.lines().enumerate().filter(|(_, line)| {
        let line = line.trim();
        !line.is_empty() && !line.starts_with('#')
    });
    steps
        .map(|(i, line)| step(line.trim()).ok_or_else(|| format!("{}:{}: {line}", path.display(), i + 1)))
        .collect()
}

fn step(line: &str) -> Option<Step> {
    let (word, rest) = line.split_once(' ').unwrap_or((line, ""));
    let rest = rest.trim();
    let words: Vec<&str> = rest.split_whitespace().collect();
    let number = |i: usize| words.get(i)?.parse::<f32>().ok();
    let modifiers = |i: usize| words.get(i).map_or_else(String::new, |w| (*w).to_owned());
    Some(match word {
        "wait" => Step::Wait,
        "frames" => Step::Frames(rest.parse().ok()?),
        "sleep" => Step::Sleep(rest.parse().ok()?),
        "key" => {
            super::keys::parse(rest)?;
            Step::Key(rest.to_owned())
        }
        "move" => Step::Move(number(0)?, number(1)?),
        "click" => Step::Click(number(0)?, number(1)?, modifiers(2)),
        "drag" => Step::Drag([number(0)?, number(1)?, number(2)?, number(3)?], modifiers(4)),
        "scroll" => Step::Scroll(number(0)?, number(1)?, number(2)?),
        "type" => Step::Type(rest.to_owned()),
        "file" => Step::File(rest.into()),
        "screenshot" => Step::Screenshot(rest.into()),
        "canvas" => Step::Canvas(rest.into()),
        "print" => Step::Print,
        "bench" => Step::Bench(rest.parse().ok()?),
        "expect" => Step::Expect(rest.to_owned()),
        "quit" => Step::Quit,
        _ => return None,
    })
}

/// A script that runs.
pub(super) struct Running {
    pub(super) steps: VecDeque<Step>,
    /// Events, frame by frame.
    pub(super) events: VecDeque<Vec<Event>>,
    pub(super) frames: u32,
    pub(super) until: Option<Instant>,
    /// Frames in a row in which there was nothing to wait for.
    pub(super) quiet: u32,
    pub(super) bench: Option<Bench>,
    pub(super) screenshot: Option<PathBuf>,
}

/// Frames that are being measured.
pub(super) struct Bench {
    pub(super) left: u32,
    pub(super) frames: u32,
    pub(super) complete: u32,
    pub(super) since: Instant,
    pub(super) direction: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines() {
        assert_eq!(step("drag 1 2 3 4 Shift+"), Some(Step::Drag([1., 2., 3., 4.], "Shift+".to_owned())));
        assert_eq!(step("key Ctrl+S"), Some(Step::Key("Ctrl+S".to_owned())));
        assert_eq!(step("expect a b"), Some(Step::Expect("a b".to_owned())));
        for bad in ["key Nothing", "move 1", "frames x", "dance"] {
            assert_eq!(step(bad), None, "{bad}");
        }
    }
}
