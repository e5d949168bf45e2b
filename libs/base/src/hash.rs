//! Integer hashing, the only source of "random" numbers in the suite. The same coordinates always give the same
//! number, in every thread, bucket and crop.

/// Mixes 32 bits thoroughly (Chris Wellons' `lowbias32`).
pub const fn mix32(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

/// Hashes a sequence of words, in order.
pub const fn words(list: &[u32]) -> u32 {
    let mut h = 0x9e37_79b9;
    let mut i = 0;
    while i < list.len() {
        h = mix32(h ^ list[i]).wrapping_add(0x9e37_79b9);
        i += 1;
    }
    mix32(h)
}

/// Returns a number in [0, 1) from the upper 24 bits of a hash.
pub const fn unit(h: u32) -> f32 {
    (h >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// Returns the 64-bit FNV-1a hash of bytes, for content hashes and checksums of small data.
pub const fn bytes64(bytes: &[u8]) -> u64 {
    let mut h = 0xcbf2_9ce4_8422_2325_u64;
    let mut i = 0;
    while i < bytes.len() {
        h = (h ^ bytes[i] as u64).wrapping_mul(0x0000_0100_0000_01b3);
        i += 1;
    }
    h
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashed_unit_values_are_uniform() {
        let n = 1 << 16;
        let mut bins = [0u32; 16];
        for i in 0..n {
            let u = unit(words(&[i, 7]));
            assert!((0.0..1.0).contains(&u));
            bins[(u * 16.0) as usize] += 1;
        }
        // Each bin is expected to have 4096. Five standard deviations are about 310.
        assert!(bins.iter().all(|b| b.abs_diff(4096) < 310), "{bins:?}");
    }

    #[test]
    fn hashes_depend_on_the_order_of_words() {
        assert_ne!(words(&[1, 2]), words(&[2, 1]));
        assert_ne!(words(&[0]), words(&[0, 0]));
        assert_eq!(bytes64(b"a"), 0xaf63_dc4c_8601_ec8c);
    }
}
