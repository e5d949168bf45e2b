//! Damaged files result in an error that names the file, and never in a panic, a hang or a huge allocation.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use granita_base::Param;
use granita_image::{CreateOptions, Format, ImageError, ImageSpec, Limits, PixelType, Pixels};
use granita_tiff::TiffFormat;
use proptest::prelude::*;
use std::path::Path;
use std::sync::OnceLock;

fn sample(path: &Path, compression: &str, pixel_type: PixelType, tiled: bool, separate: bool) -> Vec<u8> {
    let mut spec = ImageSpec::new(23, 19, 3, pixel_type);
    if tiled {
        spec = spec.tiled(16, 16);
    }
    let planes = if separate { "separate" } else { "contig" };
    spec.attributes.set(Param::declared("string compression", compression).unwrap());
    spec.attributes.set(Param::declared("string planarconfig", planes).unwrap());
    spec.attributes.set(Param::declared("string textureformat", "Plain Texture").unwrap());
    spec.attributes.set(Param::declared("matrix worldtocamera", &[0.5; 16][..]).unwrap());
    let mut small = spec.clone();
    (small.width, small.height) = (11, 9);
    let mut out = TiffFormat.create(path, &CreateOptions::new(&spec, 2)).unwrap();
    for (level, spec) in [&spec, &small].into_iter().enumerate() {
        if level > 0 {
            out.next_level(spec).unwrap();
        }
        let ramp: Vec<f32> = (0..spec.width * spec.height * 3).map(|i| (i % 37) as f32 * 0.02).collect();
        out.write_rows(&Pixels::from_floats(pixel_type, &ramp)).unwrap();
    }
    out.close().unwrap();
    std::fs::read(path).unwrap()
}

fn limits() -> Limits {
    Limits { dimension: 4096, pixels: 1 << 22, bytes: 16 << 20, ..Limits::default() }
}

/// Reads all images and levels that can be read.
fn read(path: &Path, bytes: &[u8]) -> granita_image::Result<()> {
    std::fs::write(path, bytes).unwrap();
    let input = TiffFormat.open(path, &limits())?;
    for image in 0..input.images() {
        for level in 0..input.levels(image) {
            input.read_level(image, level)?;
        }
    }
    Ok(())
}

#[test]
fn every_truncation_is_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("damaged.tif");
    for tiled in [false, true] {
        let good = sample(&path, "zip", PixelType::Half, tiled, !tiled);
        for n in 0..good.len() {
            let error = read(&path, &good[..n]).unwrap_err().to_string();
            assert!(error.contains("damaged.tif"), "{error}");
        }
        read(&path, &good).unwrap();
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1500))]
    #[test]
    fn files_with_flipped_bits_do_not_panic(
        flips in prop::collection::vec((0.0f64..1.0, 0u8..8), 1..5),
        directories_only in any::<bool>(),
        kind in 0usize..16,
    ) {
        // The samples are written once, because they do not depend on the case.
        static SAMPLES: OnceLock<Vec<Vec<u8>>> = OnceLock::new();
        let samples = SAMPLES.get_or_init(|| {
            let dir = tempfile::tempdir().unwrap();
            let path = dir.path().join("a.tif");
            (0..16)
                .map(|i| {
                    let compression = ["none", "lzw", "zip", "packbits"][i % 4];
                    let pixel_type = [PixelType::U8, PixelType::U16, PixelType::Half, PixelType::Float][i / 4];
                    sample(&path, compression, pixel_type, i % 3 == 0, i % 2 == 0)
                })
                .collect()
        });
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("damaged.tif");
        let mut bytes = samples[kind].clone();
        // The two directories and their values are the last part of the file, with about 500 bytes each.
        let first = if directories_only { bytes.len().saturating_sub(1000) } else { 0 };
        let range = bytes.len() - first;
        for (x, bit) in flips {
            bytes[first + (x * range as f64) as usize] ^= 1 << bit;
        }
        if let Err(error) = read(&path, &bytes) {
            prop_assert!(error.to_string().contains("damaged.tif"), "{}", error);
        }
    }
}

/// Returns a file of a header, one directory at byte 8, and then `data`.
fn by_hand(big_endian: bool, entries: &[(u16, u16, u32, u32)], data: &[u8]) -> Vec<u8> {
    let short = |n: u16| if big_endian { n.to_be_bytes() } else { n.to_le_bytes() };
    let long = |n: u32| if big_endian { n.to_be_bytes() } else { n.to_le_bytes() };
    let mut bytes = if big_endian { b"MM\0\x2a".to_vec() } else { b"II\x2a\0".to_vec() };
    bytes.extend(long(8));
    bytes.extend(short(entries.len() as u16));
    for (tag, kind, count, value) in entries {
        bytes.extend(short(*tag));
        bytes.extend(short(*kind));
        bytes.extend(long(*count));
        // A single short is in the first half of the field.
        match (kind, count) {
            (3, 1) => bytes.extend([short(*value as u16), [0, 0]].concat()),
            _ => bytes.extend(long(*value)),
        }
    }
    bytes.extend(long(0));
    bytes.extend_from_slice(data);
    bytes
}

/// Returns the offset of `data` of [`by_hand`].
fn data_at(entries: usize) -> u32 {
    8 + 2 + 12 * entries as u32 + 4
}

#[test]
fn layouts_that_are_only_read_are_decoded() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    let read = |bytes: Vec<u8>| {
        std::fs::write(&path, bytes).unwrap();
        let input = TiffFormat.open(&path, &limits()).unwrap();
        (input.spec(0, 0).unwrap().channels.len(), input.read_level(0, 0).unwrap())
    };
    for big_endian in [false, true] {
        // There is one bit per pixel, 0 is white, and one row has two bytes.
        let entries = [
            (256, 3, 1, 10),
            (257, 3, 1, 1),
            (258, 3, 1, 1),
            (262, 3, 1, 0),
            (273, 4, 1, data_at(6)),
            (279, 4, 1, 2),
        ];
        let (n, pixels) = read(by_hand(big_endian, &entries, &[0b1010_0000, 0b0100_0000]));
        assert_eq!(n, 1);
        assert_eq!(pixels, Pixels::U8(vec![0, 255, 0, 255, 255, 255, 255, 255, 255, 0]));

        // The values are 4-bit indices into a palette of 16.
        let entries = [
            (256, 3, 1, 3),
            (257, 3, 1, 1),
            (258, 3, 1, 4),
            (262, 3, 1, 3),
            (273, 4, 1, data_at(7)),
            (279, 4, 1, 2),
            (320, 3, 48, data_at(7) + 2),
        ];
        let mut data = vec![0x1f, 0x20];
        for i in 0..48u16 {
            data.extend(if big_endian { (i << 8).to_be_bytes() } else { (i << 8).to_le_bytes() });
        }
        let (n, pixels) = read(by_hand(big_endian, &entries, &data));
        assert_eq!(n, 3);
        assert_eq!(pixels, Pixels::U8(vec![1, 17, 33, 15, 31, 47, 2, 18, 34]));

        // The values are 16-bit grey.
        let entries = [
            (256, 3, 1, 2),
            (257, 3, 1, 1),
            (258, 3, 1, 16),
            (262, 3, 1, 1),
            (273, 4, 1, data_at(6)),
            (279, 4, 1, 4),
        ];
        let (_, pixels) = read(by_hand(big_endian, &entries, &[1, 2, 3, 4]));
        let expected = if big_endian { vec![0x0102, 0x0304] } else { vec![0x0201, 0x0403] };
        assert_eq!(pixels, Pixels::U16(expected));
    }
}

#[test]
fn unsupported_features_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    for (tag, value, word) in [
        (259, 2, "ccitt data of 1 channels of 8 bits"),
        (259, 3, "group3 data of 1 channels of 8 bits"),
        (259, 4, "group4 data of 1 channels of 8 bits"),
        (259, 6, "old-style JPEG (of 1992)"),
        (259, 34676, "LogLuv"),
        (259, 34712, "JPEG 2000"),
        (259, 34887, "LERC"),
        (259, 34677, "sgilog24 data of other than LogLuv"),
        (259, 50001, "webp data of other than 3 or 4 channels"),
        (259, 999, "999"),
        (262, 10, "ITU L*a*b*"),
        (262, 32845, "LogLuv"),
        (317, 3, "predictor 3"),
        (339, 5, "8-bit complex"),
        (258, 6, "6-bit unsigned integer"),
        (258, 17, "17-bit"),
        (258, 24, "24-bit"),
        (258, 128, "128-bit"),
    ] {
        let mut entries =
            vec![(256, 3, 1, 1), (257, 3, 1, 1), (258, 3, 1, 8), (273, 4, 1, 8), (279, 4, 1, 1)];
        entries.retain(|e| e.0 != tag);
        entries.push((tag, 3, 1, value));
        std::fs::write(&path, by_hand(false, &entries, &[0])).unwrap();
        let Err(error) = TiffFormat.open(&path, &limits()) else { panic!("{word}") };
        assert!(matches!(error, ImageError::Unsupported { .. }), "{error}");
        assert!(error.to_string().contains(word), "{error}");
    }
}

#[test]
fn sizes_in_headers_are_checked_before_memory_is_allocated() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    let open = |entries: &[(u16, u16, u32, u32)]| {
        std::fs::write(&path, by_hand(false, entries, &[0; 16])).unwrap();
        TiffFormat.open(&path, &Limits::default()).and_then(|i| i.read_level(0, 0).map(|_| ()))
    };
    let base = |w, h| vec![(256, 4, 1, w), (257, 4, 1, h), (258, 3, 1, 8), (273, 4, 1, 8), (279, 4, 1, 16)];
    let error = open(&base(u32::MAX, 1)).unwrap_err();
    assert!(matches!(error, ImageError::Limit { .. }), "{error}");
    // The size is within the limits, but would be 4 GiB out of 16 bytes.
    let error = open(&base(1 << 16, 1 << 16)).unwrap_err().to_string();
    assert!(error.contains("16 bytes cannot hold"), "{error}");
    // The size is a million a side, with every compression.
    for compression in [1, 5, 7, 8, 32773, 34925, 50000] {
        let mut entries = base(1_000_000, 1_000_000);
        entries.push((259, 3, 1, compression));
        entries.push((277, 3, 1, 1));
        open(&entries).unwrap_err();
    }
    let mut tiles = base(1 << 16, 1 << 16);
    tiles.extend([(322, 4, 1, 16), (323, 4, 1, 16)]);
    let error = open(&tiles).unwrap_err().to_string();
    assert!(error.contains("1 positions of strips or tiles, 16777216 needed"), "{error}");
    // The directory is its own successor.
    let mut loops = by_hand(false, &base(4, 4), &[0; 16]);
    let next = data_at(5) as usize - 4;
    loops[next] = 8;
    std::fs::write(&path, loops).unwrap();
    let Err(error) = TiffFormat.open(&path, &limits()) else { panic!() };
    assert!(error.to_string().contains("loops"), "{error}");
}
