//! Numbers of frames.

use std::fmt;
use std::str::FromStr;

/// The largest number of frames of a range.
const MOST: usize = 1_000_000;

/// Some frames, in the order in which they are rendered: numbers and ranges, separated by commas. `1-10` are ten
/// frames, `10-1` the same backwards, `1-10x3` every third of them. Each frame is there once.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameRange {
    text: String,
    numbers: Vec<i32>,
}

/// The reason why a text is no range of frames.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RangeError {
    /// A part of it is neither a number nor a range.
    #[error(
        "\"{0}\" is no range of frames; expected 7, 1-240, 240-1, 1-240x4, or several of them with commas"
    )]
    Part(String),
    /// It has too many frames.
    #[error("it has more than {MOST} frames")]
    Long,
}

impl FrameRange {
    /// Returns the numbers, in their order.
    pub fn numbers(&self) -> &[i32] {
        &self.numbers
    }

    /// Returns the frames in pieces of `size`, which is at least 1.
    pub fn chunks(&self, size: usize) -> impl ExactSizeIterator<Item = &[i32]> {
        self.numbers.chunks(size.max(1))
    }
}

impl fmt::Display for FrameRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl FromStr for FrameRange {
    type Err = RangeError;

    fn from_str(text: &str) -> Result<Self, RangeError> {
        let mut numbers = Vec::new();
        for part in text.split(',') {
            let part = part.trim();
            let [from, to, step] = piece(part).ok_or_else(|| RangeError::Part(part.to_owned()))?;
            let count = (i64::from(to) - i64::from(from)).unsigned_abs() / u64::from(step.unsigned_abs()) + 1;
            if count + numbers.len() as u64 > MOST as u64 {
                return Err(RangeError::Long);
            }
            let sign = if to < from { -1 } else { 1 };
            numbers.extend((0..count as i64).map(|k| (i64::from(from) + sign * k * i64::from(step)) as i32));
        }
        let mut seen = std::collections::HashSet::new();
        numbers.retain(|number| seen.insert(*number));
        Ok(Self { text: text.trim().to_owned(), numbers })
    }
}

/// Reads a number, a range, or a range with a step. Returns the first and the last number, and the step.
fn piece(part: &str) -> Option<[i32; 3]> {
    let (range, step) = match part.split_once('x') {
        Some((range, step)) => (range, step.parse().ok().filter(|step| *step > 0)?),
        None => (part, 1),
    };
    // A minus sign may stand before each number.
    let split = range.char_indices().skip(1).find(|(_, c)| *c == '-').map(|(at, _)| at);
    let Some(at) = split else {
        let number = range.parse().ok()?;
        return (!part.contains('x')).then_some([number, number, 1]);
    };
    Some([range[..at].parse().ok()?, range[at + 1..].parse().ok()?, step])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_list_frames_in_their_order() {
        for (text, expected) in [
            ("7", &[7][..]),
            ("1-4", &[1, 2, 3, 4]),
            ("4-1", &[4, 3, 2, 1]),
            ("1-10x4", &[1, 5, 9]),
            ("10-1x4", &[10, 6, 2]),
            ("-2-1", &[-2, -1, 0, 1]),
            ("-1--3", &[-1, -2, -3]),
            ("5, 1-3,2-6", &[5, 1, 2, 3, 4, 6]),
        ] {
            let range: FrameRange = text.parse().unwrap();
            assert_eq!(range.numbers(), expected, "{text}");
            assert_eq!(range.to_string(), text);
        }
        let range: FrameRange = "1-7".parse().unwrap();
        let chunks: Vec<&[i32]> = range.chunks(3).collect();
        assert_eq!(chunks, [&[1, 2, 3][..], &[4, 5, 6], &[7]]);
    }

    #[test]
    fn other_texts_are_refused() {
        for text in ["", "a", "1-", "-", "1-2x0", "1-2x-1", "7x2", "1-2-3", "1;2", "99999999999"] {
            assert!(matches!(text.parse::<FrameRange>(), Err(RangeError::Part(_))), "{text}");
        }
        assert_eq!("1-2000000".parse::<FrameRange>(), Err(RangeError::Long));
        assert_eq!("-2147483648-2147483647".parse::<FrameRange>(), Err(RangeError::Long));
    }
}
