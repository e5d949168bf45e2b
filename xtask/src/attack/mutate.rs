//! Changes files at random. The same seed gives the same changes on every machine.

/// Random numbers (Steele, Lea and Flood 2014, "SplitMix").
#[derive(Clone, Debug)]
pub(crate) struct Random(u64);

impl Random {
    /// Returns the random numbers of a seed and a number under it.
    pub(crate) fn new(seed: u64, number: u64) -> Self {
        let mut random = Self(seed ^ number.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        random.next();
        random
    }

    /// Returns 64 random bits.
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Returns a random number less than `count`, which counts as at least 1.
    pub(crate) fn below(&mut self, count: usize) -> usize {
        (self.next() >> 33) as usize % count.max(1)
    }

    /// Returns a random number from 0 to 1.
    pub(crate) fn share(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// The largest size of a changed file, in bytes.
const MOST_BYTES: usize = 1 << 20;

/// The values at the ends of the ranges of integers and floats.
const EXTREMES: [u64; 14] = [
    0,
    1,
    0x7f,
    0x80,
    0xff,
    0x7fff,
    0x8000,
    0xffff,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    0x7f80_0000,
    0x7fc0_0000,
    u64::MAX,
];

/// The replacements for numbers of a text.
const NUMBERS: [&str; 16] = [
    "0",
    "-1",
    "1",
    "255",
    "65536",
    "2147483647",
    "2147483648",
    "-2147483648",
    "4294967295",
    "99999999999999999999",
    "1e38",
    "-1e30",
    "1e-40",
    "1e999",
    "nan",
    "inf",
];

/// Returns a file after one to four changes, which may insert pieces of `other`.
pub(crate) fn mutated(seed: &[u8], other: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    let is_text = !seed.contains(&0) && std::str::from_utf8(seed).is_ok();
    for _ in 0..=random.below(4) {
        change(&mut bytes, other, is_text, random);
        bytes.truncate(MOST_BYTES);
    }
    bytes
}

/// Applies one random change.
fn change(bytes: &mut Vec<u8>, other: &[u8], is_text: bool, random: &mut Random) {
    if bytes.is_empty() {
        bytes.extend_from_slice(other);
        return;
    }
    // Headers are short and have the greatest effect, so that half of the changes are near the beginning.
    let reach = if random.below(2) == 0 { bytes.len().min(128) } else { bytes.len() };
    let at = random.below(reach);
    match random.below(if is_text { 12 } else { 9 }) {
        0 => bytes[at] ^= 1 << random.below(8),
        1 => bytes.truncate(at),
        2 => {
            let from = random.below(other.len());
            let count = random.below(64).min(other.len() - from);
            let end = (at + random.below(64)).min(bytes.len());
            bytes.splice(at..end, other[from..from + count].iter().copied());
        }
        3 | 4 => {
            let width = [1, 2, 4, 8][random.below(4)];
            let value = EXTREMES[random.below(EXTREMES.len())];
            put(bytes, at / width * width, width, value, random.below(2) == 0);
        }
        5 => {
            let end = (at + 1 + random.below(256)).min(bytes.len());
            let block = bytes[at..end].to_vec();
            let times = 1 << random.below(12);
            let repeated: Vec<u8> =
                block.iter().copied().cycle().take((block.len() * times).min(MOST_BYTES)).collect();
            bytes.splice(at..at, repeated);
        }
        6 | 7 => change_length(bytes, random),
        8 => {
            let end = (at + 1 + random.below(64)).min(bytes.len());
            bytes.drain(at..end);
        }
        _ => change_number(bytes, at, random),
    }
}

/// Writes an integer if it fits into the bytes.
fn put(bytes: &mut [u8], at: usize, width: usize, value: u64, big: bool) {
    let mut word = value.to_le_bytes()[..width].to_vec();
    if big {
        word.reverse();
    }
    if let Some(place) = bytes.get_mut(at..at + width) {
        place.copy_from_slice(&word);
    }
}

/// Changes an integer that may be a length or an offset, that is, one that is not larger than the file.
fn change_length(bytes: &mut [u8], random: &mut Random) {
    let width = [2, 4, 8][random.below(3)];
    let start = random.below(bytes.len() / width);
    let big = random.below(2) == 0;
    for k in (start..bytes.len() / width).take(64) {
        let mut word = bytes[k * width..(k + 1) * width].to_vec();
        if big {
            word.reverse();
        }
        let value = word.iter().rev().fold(0_u64, |sum, b| (sum << 8) | u64::from(*b));
        if value == 0 || value > bytes.len() as u64 {
            continue;
        }
        let largest = u64::MAX >> (64 - 8 * width);
        let changed = [value - 1, value + 1, value * 2, largest, largest / 2, bytes.len() as u64, 0];
        put(bytes, k * width, width, changed[random.below(changed.len())], big);
        return;
    }
}

/// Replaces the next number of a text.
fn change_number(bytes: &mut Vec<u8>, at: usize, random: &mut Random) {
    let is_part = |b: &u8| b.is_ascii_digit() || matches!(b, b'.' | b'-');
    let Some(from) = bytes[at..].iter().position(u8::is_ascii_digit).map(|k| at + k) else { return };
    let end = bytes[from..].iter().position(|b| !is_part(b)).map_or(bytes.len(), |k| from + k);
    bytes.splice(from..end, NUMBERS[random.below(NUMBERS.len())].bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mutations_are_determined_by_the_seed() {
        let (seed, other) = ("width 640 height -400.5\n".repeat(9).into_bytes(), vec![7; 300]);
        let all = |seed_number| -> Vec<Vec<u8>> {
            (0..500).map(|n| mutated(&seed, &other, &mut Random::new(seed_number, n))).collect()
        };
        let (a, b) = (all(1), all(1));
        assert!(a == b && a != all(2));
        let changed = a.iter().filter(|bytes| **bytes != seed).count();
        assert!(changed > 450, "{changed} of 500 differ");
        assert!(
            a.iter().any(|bytes| bytes.len() > 4 * seed.len()) && a.iter().all(|b| b.len() <= MOST_BYTES)
        );
        // An empty file is accepted, too.
        for n in 0..200 {
            mutated(&[], &[], &mut Random::new(3, n));
            mutated(&[0], &[], &mut Random::new(3, n));
        }
    }
}
