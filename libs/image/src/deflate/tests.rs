//! Tests of the streams: round trips, levels, sizes.

use super::*;
use proptest::prelude::*;
use std::io::Read;

/// The bytes of a stream, as two decoders read them.
fn decoded(stream: &[u8], len: usize) -> Vec<u8> {
    let mut fast = vec![0; len];
    let got = libdeflater::Decompressor::new().zlib_decompress(stream, &mut fast);
    assert_eq!(got, Ok(len));
    let mut other = Vec::new();
    flate2::read::ZlibDecoder::new(stream).read_to_end(&mut other).unwrap();
    assert_eq!(fast, other);
    fast
}

/// The streams of all levels, which decode to the data.
fn streams(data: &[u8]) -> Vec<Vec<u8>> {
    let streams: Vec<_> =
        (1..=12).map(|l| zlib_compress(data, Content::Bytes, DeflateLevel::new(l).unwrap())).collect();
    for stream in &streams {
        assert!(decoded(stream, data.len()) == data, "{} bytes", data.len());
    }
    for level in [1, 6, 12] {
        for content in [Content::Halves, Content::Words] {
            let stream = zlib_compress(data, content, DeflateLevel::new(level).unwrap());
            assert!(decoded(&stream, data.len()) == data, "{} bytes", data.len());
        }
    }
    streams
}

fn libdeflate(data: &[u8], level: i32) -> usize {
    let mut compressor = Compressor::new(CompressionLvl::new(level).unwrap());
    let mut out = vec![0; compressor.zlib_compress_bound(data.len())];
    compressor.zlib_compress(data, &mut out).unwrap()
}

/// Differences between neighbours in a noisy image: small numbers around zero, most of them near it.
fn noise(n: usize) -> Vec<u8> {
    let unit = |i: usize, k: u32| granita_base::hash::unit(granita_base::hash::words(&[i as u32, k]));
    (0..n).map(|i| (8.0 * (unit(i, 0) + unit(i, 1) + unit(i, 2) - 1.5)).round() as i32 as u8).collect()
}

proptest! {
    #[test]
    fn all_levels_restore_the_bytes(
        data in prop::collection::vec(prop_oneof![Just(0u8), 0..9u8, any::<u8>()], 0..900),
        times in 1usize..60,
    ) {
        streams(&data.repeat(times));
    }
}

#[test]
fn lengths_without_contents_are_restored() {
    for n in [0, 1, 2, 3, 4, 5, 255, 16384, 16385, 70000] {
        for data in [vec![0; n], noise(n), (0..n).map(|i| i as u8).collect()] {
            streams(&data);
        }
    }
}

#[test]
fn noise_is_shorter_as_literals_than_with_references() {
    let data = noise(12288);
    let stream = zlib_compress(&data, Content::Bytes, DeflateLevel::default());
    assert!((1..=9).all(|level| stream.len() < libdeflate(&data, level)));
    assert!(streams(&data).iter().all(|s| s.len() <= stream.len()));
}

#[test]
fn data_that_repeats_is_left_to_libdeflate() {
    let grey: Vec<u8> = noise(4096).into_iter().flat_map(|b| [b; 3]).collect();
    let text = b"Deflate stores repeated strings as references. ".repeat(300);
    for data in [grey, text, vec![0; 12288]] {
        for level in 1..=12 {
            let stream = zlib_compress(&data, Content::Bytes, DeflateLevel::new(level).unwrap());
            assert!(stream.len() <= libdeflate(&data, i32::from(level)), "level {level}");
        }
    }
}

#[test]
fn random_bytes_are_stored() {
    let data: Vec<u8> = (0..40000).map(|i| granita_base::hash::words(&[i]) as u8).collect();
    assert!(streams(&data).iter().all(|s| s.len() < data.len() + 30));
}

#[test]
fn the_smooth_half_of_a_block_is_compressed_beside_its_noise() {
    let mut data = noise(12288);
    data.extend(std::iter::repeat_n([128, 128, 129, 127, 128, 128, 131, 90], 1536).flatten());
    let stream = zlib_compress(&data, Content::Halves, DeflateLevel::default());
    let (ours, alone) = (stream.len(), libdeflate(&data, 6));
    assert!(
        ours < alone
            && ours < zlib_compress(&data[..12288], Content::Bytes, DeflateLevel::default()).len() + 200,
        "{ours} {alone}"
    );
    streams(&data);
}

#[test]
fn rare_bytes_get_codes_of_limited_length() {
    // The counts are Fibonacci's numbers, whose best code has a length for each symbol.
    let mut data = Vec::new();
    let (mut a, mut b) = (1, 1);
    for byte in 0..20u8 {
        data.extend(std::iter::repeat_n(byte, a));
        (a, b) = (b, a + b);
    }
    let mut mixed = vec![0; data.len()];
    data.iter().enumerate().for_each(|(i, b)| mixed[i * 7919 % data.len()] = *b);
    streams(&data);
    streams(&mixed);
}

#[test]
fn levels_are_numbers_from_1_to_12() {
    let level = |n| DeflateLevel::new(n);
    assert_eq!(DeflateLevel::split("zip:12"), Ok(("zip", level(12))));
    assert_eq!(DeflateLevel::split("deflate"), Ok(("deflate", None)));
    assert_eq!(DeflateLevel::split("dwaa:45"), Ok(("dwaa:45", None)));
    for word in ["0", "13", "-1", "", "9x", "1.5", "256"] {
        let refused = DeflateLevel::split(&format!("zips:{word}")).unwrap_err();
        assert!(refused.contains("from 1 to 12"), "{refused}");
    }
}
