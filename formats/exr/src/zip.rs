//! The compressions "zip" and "zips" by libdeflate, which are compatible with those of the `exr` crate.
//!
//! Bytes of a block are first split into those at even and those at odd positions (the low and the high bytes of
//! halves). Then each byte is replaced by its difference to the one before. The result is deflated ("ZIP" of the
//! technical introduction to OpenEXR).

use granita_image::{Content, DeflateLevel, zlib_compress};
use libdeflater::Decompressor;

/// Returns the packed form of a block's little-endian bytes; `None` when it would not be shorter, because the format
/// then stores the bytes uncompressed.
pub(crate) fn compress(bytes: &[u8], content: Content, level: DeflateLevel) -> Option<Vec<u8>> {
    let mut parted: Vec<u8> = Vec::with_capacity(bytes.len());
    parted.extend(bytes.iter().step_by(2));
    parted.extend(bytes.iter().skip(1).step_by(2));
    let mut before = parted.first().copied()?;
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
    fn data_that_does_not_shrink_is_not_compressed() {
        let pack = |bytes: &[u8]| compress(bytes, Content::Words, DeflateLevel::default());
        assert_eq!(pack(&[]), None);
        assert_eq!(pack(&[7]), None);
        assert_eq!(pack(&[7, 200, 3]), None);
        assert!(pack(&[0; 100]).is_some());
    }
}
