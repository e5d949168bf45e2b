//! Determines the available rows of JPEG files that end early.
//!
//! The decoder fills missing data without an error. So a file without its end mark is decoded again with bytes after
//! its end, and with their opposites. Rows that come out the same are from the file.

/// The end of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ending {
    /// The file has the end mark.
    Marked,
    /// The file does not have the end mark.
    Open {
        /// True when all rows are stored in several passes, each finer than the ones before.
        progressive: bool,
    },
}

/// Searches for the end mark, from segment to segment.
pub(crate) fn ending(bytes: &[u8]) -> Ending {
    let mut progressive = false;
    let mut at = 2;
    // Between segments, and in packed data, a mark is a byte 255 that is followed by neither 0 nor another one.
    while let Some(found) = bytes.get(at..).and_then(|rest| rest.iter().position(|b| *b == 0xff)) {
        at += found + 1;
        match bytes.get(at) {
            // A byte of packed data, a filler, or a mark of restart is not followed by a length.
            Some(0 | 0x01 | 0xd0..=0xd8 | 0xff) => {}
            Some(0xd9) => return Ending::Marked,
            Some(kind) => {
                progressive |= matches!(kind, 0xc2 | 0xc6 | 0xca | 0xce);
                let Some([a, b]) = bytes.get(at + 1..at + 3) else { break };
                at += 1 + usize::from(u16::from_be_bytes([*a, *b]));
            }
            None => break,
        }
    }
    Ending::Open { progressive }
}

/// Removes half of a mark at the end.
pub(crate) fn without_half_a_mark(bytes: &mut Vec<u8>) {
    while bytes.last() == Some(&0xff) {
        bytes.pop();
    }
}

/// Returns the same file with other bytes after its end, none of which is a mark. With `opposite` each of their bits is
/// inverted, so that one of the two continues differently from the file.
pub(crate) fn with_noise(bytes: &[u8], opposite: bool) -> Vec<u8> {
    const NOISE: usize = 4096;
    let mut out = bytes.to_vec();
    let flip = if opposite { 0xff } else { 0 };
    out.extend(noise().take(NOISE).map(|byte| byte ^ flip));
    out
}

/// Returns pseudorandom bytes, except 0 and 255.
pub(crate) fn noise() -> impl Iterator<Item = u8> {
    let next = |n: &u32| Some(n.wrapping_mul(747_796_405).wrapping_add(2_891_336_453));
    std::iter::successors(Some(0x5a00_0000), next).map(|n| ((n >> 24) as u8).clamp(1, 254))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_end_of_image_mark_is_found_or_missed() {
        let begin = [0xff, 0xd8, 0xff, 0xe0, 0, 5, 0xff, 0xd9, 7, 0xff, 0xda, 0, 3, 9, 1, 2, 0xff, 0, 3];
        let with = |rest: &[u8]| [&begin[..], rest].concat();
        assert_eq!(ending(&with(&[0xff, 0xd3, 4, 0xff, 0xd9])), Ending::Marked);
        assert_eq!(ending(&with(&[0xff, 0xff, 0xd9, 0, 0])), Ending::Marked);
        let open = Ending::Open { progressive: false };
        for rest in [&[][..], &[0xff], &[0xff, 0xc4], &[0xff, 0xc4, 0, 9, 1, 0xff, 0xd9]] {
            assert_eq!(ending(&with(rest)), open, "{rest:?}");
        }
        assert_eq!(ending(&with(&[0xff, 0xc2, 0, 3, 1])), Ending::Open { progressive: true });
        assert_eq!(ending(&[]), open);
        let mut cut = with(&[0xff]);
        without_half_a_mark(&mut cut);
        assert_eq!(cut, begin);
        for opposite in [false, true] {
            assert!(!with_noise(&cut, opposite)[begin.len()..].contains(&0xff));
        }
    }
}
