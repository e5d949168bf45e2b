//! Names of files with the number of a frame.
//!
//! `#` stands for a number of four digits, `@` for one of one digit, several of them for the sum of both, and `%04d`
//! for a number as in C. A range before it selects frames: `shot.1-24x2#.exr`.

use crate::{EditError, Result};
use std::path::{Path, PathBuf};

/// The largest number of frames.
const MOST: usize = 1 << 20;

/// A name with a place for the number of a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameName {
    before: String,
    after: String,
    /// The number of digits, filled with zeros.
    digits: usize,
    /// The frames in the name.
    frames: Option<Vec<i64>>,
}

impl FrameName {
    /// Returns the parts of a name; `None` when it has no place for a number. `file#2` is an image of a file, and has
    /// none.
    pub fn parse(name: &str) -> Option<Self> {
        let folder = name.rfind('/').map_or(0, |at| at + 1);
        let file = &name[folder..];
        let (at, end, digits) = if let Some(at) = file.find(['#', '@']) {
            let marks: String = file[at..].chars().take_while(|c| matches!(c, '#' | '@')).collect();
            let end = at + marks.len();
            let is_image = !file[end..].is_empty() && file[end..].bytes().all(|b| b.is_ascii_digit());
            if is_image && marks == "#" {
                return None;
            }
            (at, end, marks.chars().map(|c| if c == '#' { 4 } else { 1 }).sum())
        } else {
            let at = file.find('%')?;
            let rest = &file[at + 1..];
            let length = rest.bytes().take_while(u8::is_ascii_digit).count();
            if !rest[length..].starts_with('d') || length > 3 {
                return None;
            }
            (at, at + length + 2, rest[..length].parse().unwrap_or(1))
        };
        // A range belongs to the place when it contains a dash or stands before the place alone.
        let is_range = |c: char| c.is_ascii_digit() || matches!(c, '-' | 'x' | 'y' | ',');
        let start = file[..at].rfind(|c| !is_range(c)).map_or(0, |i| i + 1);
        let range = file[start..at].trim_start_matches(['-', 'x', 'y', ',']);
        let frames = if range.contains('-') { frames(range).ok() } else { None };
        let start = if frames.is_some() { at - range.len() } else { at };
        Some(Self {
            before: name[..folder + start].to_owned(),
            after: name[folder + end..].to_owned(),
            digits: usize::min(digits, 16),
            frames,
        })
    }

    /// Returns the frames that the name selects.
    pub fn frames(&self) -> Option<&[i64]> {
        self.frames.as_deref()
    }

    /// Returns the name of a frame.
    pub fn file(&self, frame: i64) -> String {
        let sign = if frame < 0 { "-" } else { "" };
        format!("{}{sign}{:0digits$}{}", self.before, frame.unsigned_abs(), self.after, digits = self.digits)
    }

    /// Returns the frames whose files exist, in order.
    pub fn existing(&self) -> Vec<i64> {
        let path = PathBuf::from(format!("{}{}", self.before, self.after));
        let folder = match self.before.rfind('/') {
            Some(0) => Path::new("/"),
            Some(at) => Path::new(&self.before[..at]),
            None => Path::new("."),
        };
        let start = self.before.rfind('/').map_or(0, |at| at + 1);
        let (before, after) = (&self.before[start..], &self.after);
        if after.contains('/') || path.as_os_str().is_empty() {
            return Vec::new();
        }
        let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
        let number = |name: &str| -> Option<i64> {
            let digits = name.strip_prefix(before)?.strip_suffix(after.as_str())?;
            let frame: i64 = digits.parse().ok()?;
            (self.file(frame).ends_with(name) && digits.trim_start_matches('-').len() >= self.digits)
                .then_some(frame)
        };
        let mut frames: Vec<i64> = entries
            .filter_map(|entry| entry.ok())
            .filter_map(|entry| number(entry.file_name().to_str()?))
            .collect();
        frames.sort_unstable();
        frames.dedup();
        frames
    }
}

/// Reads a list of frames: `1-24`, `1-24x2` (every second one), `24-1`, `1,5,10-12`. With `y` in place of `x` it is all
/// frames but these.
///
/// # Errors
/// [`EditError::Misuse`] for other texts, and for more than 1048576 frames.
pub fn frames(text: &str) -> Result<Vec<i64>> {
    let wrong =
        || EditError::misuse(format!("\"{text}\" is not a list of frames like 1-24, 1-24x2 or 1,5,10-12"));
    let mut all = Vec::new();
    for part in text.split(',') {
        let number = |word: &str| word.trim().parse::<i32>().map(i64::from).map_err(|_| wrong());
        // The first character may be the sign of a number.
        let dash = part.char_indices().skip(1).find(|(_, c)| *c == '-').map(|(at, _)| at);
        let Some(dash) = dash else {
            all.push(number(part)?);
            continue;
        };
        let (begin, rest) = (number(&part[..dash])?, &part[dash + 1..]);
        let (end, step, others) = match rest.find(['x', 'y']) {
            Some(at) => (number(&rest[..at])?, number(&rest[at + 1..])?, rest[at..].starts_with('y')),
            None => (number(rest)?, 1, false),
        };
        let count = begin.abs_diff(end) as usize + 1;
        if step < 1 || all.len() + count > MOST {
            return Err(wrong());
        }
        let sign = if end < begin { -1 } else { 1 };
        for i in 0..count as i64 {
            if (i % step == 0) != others {
                all.push(begin + sign * i);
            }
        }
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_of_frames_are_read() {
        for (text, expected) in [
            ("7", vec![7]),
            ("1-4", vec![1, 2, 3, 4]),
            ("1-7x3", vec![1, 4, 7]),
            ("1-4y2", vec![2, 4]),
            ("3-1,10", vec![3, 2, 1, 10]),
            ("-2-1", vec![-2, -1, 0, 1]),
        ] {
            assert_eq!(frames(text).unwrap(), expected, "{text}");
        }
        for text in ["", "a", "1-", "1-4x0", "1-2-3", "1-9999999", "1,,2"] {
            assert!(frames(text).is_err(), "{text}");
        }
    }

    #[test]
    fn names_of_frames_are_made() {
        for (name, expected) in [
            ("a/shot.#.exr", "a/shot.0007.exr"),
            ("shot.@@.exr", "shot.07.exr"),
            ("shot#@", "shot00007"),
            ("shot.%04d.exr", "shot.0007.exr"),
            ("shot.%d.exr", "shot.7.exr"),
            ("%3d", "007"),
        ] {
            assert_eq!(FrameName::parse(name).map(|f| f.file(7)).as_deref(), Some(expected), "{name}");
        }
        let ranged = FrameName::parse("shot.1-5x2#.exr").unwrap();
        assert_eq!((ranged.frames(), &*ranged.file(3)), (Some(&[1, 3, 5][..]), "shot.0003.exr"));
        let plain = FrameName::parse("take2-#.exr").unwrap();
        assert_eq!((plain.frames(), &*plain.file(3)), (None, "take2-0003.exr"));
        for name in ["a.exr", "a.exr#2", "50%", "a#b/c.exr", "100%x", "%s"] {
            assert_eq!(FrameName::parse(name), None, "{name}");
        }
    }

    #[test]
    fn existing_frames_are_found() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["s.0002.png", "s.0010.png", "s.10.png", "s.12345.png", "t.0003.png", "s.0004.exr"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let name = folder.path().join("s.#.png");
        let found = FrameName::parse(&name.to_string_lossy()).unwrap().existing();
        assert_eq!(found, [2, 10, 12345]);
    }
}
