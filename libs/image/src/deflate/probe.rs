//! Estimates whether references to earlier strings shorten a piece, without a search for them.
//!
//! Both limits were found on tiles of photographs (`docs/formats.md`): with them the tiles of eleven photographs are
//! together not longer than libdeflate makes them.

/// The part of the bytes, in percent, that equal the byte before although those of independent bytes would not. Above
/// it references pay: grey images in three channels have 65, photographs in colour 0 to 13.
const EQUAL_PERCENT: i64 = 14;

/// The part of the bytes, in percent, that begin a string of eight that occurred before. Above it references pay: flat
/// areas have almost 100, photographs less than 3.
const REPEATED_PERCENT: i64 = 6;

/// Returns the number of bytes by which the piece repeats more than the limits, which is negative for a piece that
/// hardly repeats. `counts` has the number of each byte.
pub(super) fn gain(bytes: &[u8], counts: &[u32]) -> i64 {
    let len = bytes.len() as i64;
    let equal = bytes.array_windows().filter(|[a, b]| a == b).count() as i64;
    let independent = counts.iter().map(|n| i64::from(*n) * i64::from(*n)).sum::<i64>() / len.max(1);
    let gain = equal - independent - len * EQUAL_PERCENT / 100;
    if gain > 0 { gain } else { gain.max(repeated(bytes) - len * REPEATED_PERCENT / 100) }
}

/// Returns the number of strings of eight bytes that equal the last one with the same hash.
fn repeated(bytes: &[u8]) -> i64 {
    let mut last = [0u32; 1 << 12];
    let mut count = 0;
    for string in bytes.array_windows() {
        let hash = u64::from_le_bytes(*string).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        // The upper bits select the entry, and bits below them stand for the string.
        let slot = &mut last[(hash >> 52) as usize];
        let mark = (hash >> 20) as u32;
        count += i64::from(*slot == mark);
        *slot = mark;
    }
    count
}
