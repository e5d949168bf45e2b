//! The compressions "zip" and "zips" by libdeflate, which are compatible with those of the `exr` crate, and the reading
//! of "rle".
//!
//! Bytes of a block are first split into those at even and those at odd positions (the low and the high bytes of
//! halves). Then each byte is replaced by its difference to the one before. The result is deflated ("ZIP" of the
//! technical introduction to OpenEXR).

use granita_image::{Content, DeflateLevel, zlib_compress};
use libdeflater::Decompressor;

/// Returns the packed form of a block's little-endian bytes; `None` when it would not be shorter, because the format
/// then stores the bytes uncompressed.
pub(crate) fn compress(bytes: &[u8], content: Content, level: DeflateLevel) -> Option<Vec<u8>> {
    let first = *bytes.first()?;
    let mut parted = vec![0; bytes.len()];
    let (pairs, rest) = bytes.as_chunks::<2>();
    let (even, odd) = parted.split_at_mut(bytes.len().div_ceil(2));
    for ((pair, even), odd) in pairs.iter().zip(even.iter_mut()).zip(odd) {
        (*even, *odd) = (pair[0], pair[1]);
    }
    if let (Some(last), [byte]) = (even.last_mut(), rest) {
        *last = *byte;
    }
    let mut before = first;
    for b in &mut parted[1..] {
        let this = *b;
        *b = this.wrapping_sub(before).wrapping_add(128);
        before = this;
    }
    Some(zlib_compress(&parted, content, level)).filter(|packed| packed.len() < bytes.len())
}

/// Returns the `len` bytes of a block from its packed form; `None` when the data is damaged or of another length.
pub(crate) fn decompress(packed: &[u8], len: usize) -> Option<Vec<u8>> {
    let mut parted = vec![0; len];
    if Decompressor::new().zlib_decompress(packed, &mut parted) != Ok(len) {
        return None;
    }
    restored(parted)
}

/// Returns the `len` bytes of a block from runs of bytes ("RLE"); `None` when the data is damaged or of another length.
pub(crate) fn decompress_runs(packed: &[u8], len: usize) -> Option<Vec<u8>> {
    // A run of up to 128 bytes takes two.
    let mut parted = Vec::with_capacity(len.min(packed.len().saturating_mul(64)));
    let mut rest = packed;
    while let Some((count, after)) = rest.split_first() {
        let count = i32::from(count.cast_signed());
        if count < 0 {
            let (bytes, after) = after.split_at_checked(count.unsigned_abs() as usize)?;
            parted.extend(bytes);
            rest = after;
        } else {
            let (byte, after) = after.split_first()?;
            parted.resize(parted.len() + count as usize + 1, *byte);
            rest = after;
        }
        if parted.len() > len {
            return None;
        }
    }
    if parted.len() == len { restored(parted) } else { None }
}

/// Undoes the differences and the separation of even and odd bytes.
fn restored(mut parted: Vec<u8>) -> Option<Vec<u8>> {
    let len = parted.len();
    let mut sum = parted.first().copied()?;
    for b in &mut parted[1..] {
        sum = sum.wrapping_add(*b).wrapping_sub(128);
        *b = sum;
    }
    let mut out = vec![0; len];
    let (even, odd) = parted.split_at(len.div_ceil(2));
    for ((pair, a), b) in out.as_chunks_mut::<2>().0.iter_mut().zip(even).zip(odd) {
        *pair = [*a, *b];
    }
    if len % 2 == 1 {
        out[len - 1] = even[len / 2];
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn decompression_restores_the_bytes(seed in prop::collection::vec(0u8..4, 0..40), n in 1usize..700) {
            let bytes: Vec<u8> = (0..n).map(|i| seed.get(i % 50).copied().unwrap_or(i as u8)).collect();
            if let Some(packed) = compress(&bytes, Content::Halves, DeflateLevel::default()) {
                prop_assert!(packed.len() < n);
                prop_assert_eq!(decompress(&packed, n), Some(bytes));
                prop_assert_eq!(decompress(&packed, n + 1), None);
            }
        }

        #[test]
        fn decompressing_random_data_does_not_panic(data in prop::collection::vec(any::<u8>(), 0..100), n in 0usize..300) {
            let _ = decompress(&data, n);
        }
    }

    #[test]
    fn runs_are_unpacked() {
        // 3 literal bytes, then a run of 4 equal differences.
        let packed = [0xfd, 10, 128, 128, 3, 129];
        // The sums are 10, 10, 10, 11, 12, 13, 14, of which the first four are the even bytes.
        assert_eq!(decompress_runs(&packed, 7), Some(vec![10, 12, 10, 13, 10, 14, 11]));
        assert_eq!(decompress_runs(&packed, 8), None);
        assert_eq!(decompress_runs(&packed[..5], 7), None);
        assert_eq!(decompress_runs(&[0xfd, 1], 3), None);
        assert_eq!(decompress_runs(&[], 3), None);
    }

    #[test]
    fn data_that_does_not_shrink_is_not_compressed() {
        let pack = |bytes: &[u8]| compress(bytes, Content::Words, DeflateLevel::default());
        assert_eq!(pack(&[]), None);
        assert_eq!(pack(&[7]), None);
        assert_eq!(pack(&[7, 200, 3]), None);
        assert!(pack(&[0; 100]).is_some());
    }
}
