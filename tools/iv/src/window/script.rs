//! Scripts for tests and for the images of the manual. A script holds the actions of a user, line by line.
//!
//! | line | meaning |
//! |---|---|
//! | `wait` | waits until everything in sight is read and computed |
//! | `frames N` | waits for N frames |
//! | `sleep S` | waits for S seconds, at most 60 |
//! | `key KEY` | presses a key of the table of keys, such as `Shift+L` |
//! | `move X Y` | moves the pointer, in pixels of the screen |
//! | `click X Y [Shift+][Ctrl+]` | clicks with the primary button |
//! | `drag X Y X Y [Shift+][Ctrl+]` | drags with the primary button, in eight steps |
//! | `desk` | waits until the desk for lighting is there, shows all edits and renders nothing, at most 60 s |
//! | `light ID DX DY` | chooses a light of the desk and drags it in the image by DX and DY pixels of the screen, in eight steps |
//! | `light ID DX DY S` | the same within S seconds, at most 60, in 30 steps each second |
//! | `latency` | waits until the image shows all edits of the desk, at most 60 s, and prints the milliseconds from each edit to the first image with it, and from the last input to the final image |
//! | `scroll X Y N` | turns the wheel by N steps away from the user |
//! | `type TEXT` | enters text at a prompt |
//! | `file NAME` | adds an image file and shows it |
//! | `screenshot FILE` | saves the whole window |
//! | `canvas FILE` | saves the image alone |
//! | `print` | prints the status line, the side panel, the message and the times until the image was shown |
//! | `bench N` | pans N frames, and prints frames per second and memory |
//! | `expect TEXT` | fails with exit status 1 unless the text of `print` contains this one |
//! | `quit` | closes the window |

use eframe::egui::Event;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// One line of a script.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Step {
    Wait,
    Frames(u32),
    Sleep(f64),
    Key(String),
    Move(f32, f32),
    Click(f32, f32, String),
    Drag([f32; 4], String),
    Desk,
    /// The id of a light, the distance, and the seconds that the drag takes; 0 for one step in each frame.
    Light(String, [f32; 2], f32),
    Latency,
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
/// Returns the first line that is invalid, with its number, or the error of the file.
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
        "desk" => Step::Desk,
        "light" => {
            let seconds = if words.len() > 3 { number(3)?.clamp(0.0, 60.0) } else { 0.0 };
            Step::Light((*words.first()?).to_owned(), [number(1)?, number(2)?], seconds)
        }
        "latency" => Step::Latency,
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

/// A script that is being executed.
pub(super) struct Running {
    pub(super) steps: VecDeque<Step>,
    /// The events of the next frames. The first list belongs to the next frame.
    pub(super) events: VecDeque<Vec<Event>>,
    /// The time between two of these lists, or zero for one in each frame, and the time of the next one.
    pub(super) interval: Duration,
    pub(super) due: Instant,
    pub(super) frames: u32,
    pub(super) until: Option<Instant>,
    /// The number of consecutive frames in which everything was loaded.
    pub(super) quiet: u32,
    /// The time at which the last step began.
    pub(super) since: Instant,
    pub(super) bench: Option<Bench>,
    pub(super) screenshot: Option<PathBuf>,
}

impl Running {
    /// Returns the script before its first step.
    pub(super) fn new(steps: Vec<Step>, now: Instant) -> Self {
        Self {
            steps: steps.into(),
            events: VecDeque::new(),
            interval: Duration::ZERO,
            due: now,
            frames: 0,
            until: None,
            quiet: 0,
            since: now,
            bench: None,
            screenshot: None,
        }
    }

    /// Returns the events of a frame that begins now: the next list, or with an interval all lists that are due.
    pub(super) fn events(&mut self, now: Instant) -> Vec<Event> {
        if self.interval.is_zero() {
            return self.events.pop_front().unwrap_or_default();
        }
        let mut events = Vec::new();
        while self.due <= now
            && let Some(next) = self.events.pop_front()
        {
            events.extend(next);
            self.due += self.interval;
        }
        if self.events.is_empty() {
            self.interval = Duration::ZERO;
        }
        events
    }
}

/// A measurement of frames.
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
    fn events_keep_their_pace() {
        let begin = Instant::now();
        let at = |ms: u64| begin + Duration::from_millis(ms);
        let mut running = Running::new(Vec::new(), begin);
        running.events = vec![vec![Event::PointerGone]; 3].into();
        (running.interval, running.due) = (Duration::from_millis(30), begin);
        let counts = [0, 10, 29, 65, 90].map(|ms| running.events(at(ms)).len());
        assert_eq!(counts, [1, 0, 0, 2, 0]);
        running.events = vec![vec![Event::PointerGone]; 2].into();
        let counts = [90, 90].map(|ms| running.events(at(ms)).len());
        assert_eq!(counts, [1, 1], "the pace ended with its events");
    }

    #[test]
    fn lines_of_scripts_are_parsed_or_refused() {
        assert_eq!(step("drag 1 2 3 4 Shift+"), Some(Step::Drag([1., 2., 3., 4.], "Shift+".to_owned())));
        assert_eq!(step("light key 3 -4"), Some(Step::Light("key".to_owned(), [3., -4.], 0.0)));
        assert_eq!(step("light key 3 -4 1.5"), Some(Step::Light("key".to_owned(), [3., -4.], 1.5)));
        assert_eq!(step("key Ctrl+S"), Some(Step::Key("Ctrl+S".to_owned())));
        assert_eq!(step("expect a b"), Some(Step::Expect("a b".to_owned())));
        for bad in ["key Nothing", "move 1", "light key 3", "light key 3 4 x", "frames x", "dance"] {
            assert_eq!(step(bad), None, "{bad}");
        }
    }
}
