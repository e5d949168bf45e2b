//! Reading some rows does not read the whole file, and the order of requests does not matter.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use granita_base::Param;
use granita_image::{CreateOptions, Format, ImageSpec, Limits, PixelType, Pixels};
use granita_raster::formats;
use half::f16;
use proptest::prelude::*;
use std::path::Path;
use std::sync::Arc;

fn format(name: &str) -> Arc<dyn Format> {
    formats().into_iter().find(|f| f.name() == name).unwrap()
}

fn noise(pixel_type: PixelType, n: usize, seed: u32) -> Pixels {
    let word = |i: usize| granita_base::hash::words(&[seed, (i / 2) as u32]);
    match pixel_type {
        PixelType::U8 => Pixels::U8((0..n).map(|i| word(i) as u8).collect()),
        PixelType::U16 => Pixels::U16((0..n).map(|i| word(i) as u16).collect()),
        PixelType::Half => Pixels::Half((0..n).map(|i| f16::from_f32((word(i) % 1000) as f32)).collect()),
        _ => Pixels::Float((0..n).map(|i| word(i) as f32 - 1e9).collect()),
    }
}

fn write(path: &Path, format: &dyn Format, levels: &[(ImageSpec, Pixels)]) {
    let options = CreateOptions::new(&levels[0].0, levels.len());
    let mut out = format.create(path, &options).unwrap();
    for (i, (spec, pixels)) in levels.iter().enumerate() {
        if i > 0 {
            out.next_level(spec).unwrap();
        }
        out.write_rows(pixels).unwrap();
    }
    out.close().unwrap();
}

#[test]
fn a_few_rows_are_read_without_reading_the_whole_file() {
    let dir = tempfile::tempdir().unwrap();
    // The list has the format, the type, and the largest share of the file that may be read for 8 of 1024 rows in its
    // middle.
    for (name, pixel_type, share) in [
        ("pfm", PixelType::Float, 0.02),
        ("pnm", PixelType::U16, 0.02),
        // The table of rows is a large part of so narrow an image.
        ("sgi", PixelType::U8, 0.09),
        // The part is a row of tiles of 64.
        ("iff", PixelType::U16, 0.15),
        ("dds", PixelType::Float, 0.02),
        ("dpx", PixelType::U16, 0.02),
        // All rows up to these are decoded, but not the later ones, and the front twice.
        ("png", PixelType::U8, 0.7),
    ] {
        let path = dir.path().join(name);
        let mut spec = ImageSpec::new(100, 1024, 3, pixel_type);
        let pixels = noise(pixel_type, 307_200, 5);
        spec.attributes.set(Param::declared("int unassociatedalpha", 1).unwrap());
        write(&path, &*format(name), &[(spec.clone(), pixels.clone())]);
        let input = format(name).open(&path, &Limits::default()).unwrap();
        let got = input.read_rows(0, 0, 500, 508).unwrap();
        let mut expected = Pixels::zeros(pixel_type, 2400);
        expected.copy_from(0, &pixels, 150_000, 2400);
        assert_eq!(got, expected, "{name}");
        let size = std::fs::metadata(&path).unwrap().len() as f64;
        let read = input.bytes_read() as f64;
        assert!(read <= size * share, "{name}: {read} of {size} bytes");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]
    #[test]
    fn rows_are_read_in_any_order(ranges in prop::collection::vec((0u32..70, 0u32..70), 1..12)) {
        let dir = tempfile::tempdir().unwrap();
        for (name, pixel_type) in [
            ("pfm", PixelType::Float),
            ("pnm", PixelType::U8),
            ("sgi", PixelType::U16),
            ("iff", PixelType::U8),
            ("dds", PixelType::U8),
            ("dpx", PixelType::U8),
            ("png", PixelType::U16),
            ("tga", PixelType::U8),
        ] {
            let path = dir.path().join(name).with_extension(format(name).extensions()[0]);
            let spec = ImageSpec::new(13, 70, 3, pixel_type);
            let pixels = noise(pixel_type, 13 * 70 * 3, 5);
            write(&path, &*format(name), &[(spec, pixels.clone())]);
            let input = format(name).open(&path, &Limits::default()).unwrap();
            for (a, b) in &ranges {
                let (y0, y1) = (*a.min(b), *a.max(b));
                let mut expected = Pixels::zeros(pixel_type, (y1 - y0) as usize * 39);
                let n = expected.len();
                expected.copy_from(0, &pixels, y0 as usize * 39, n);
                prop_assert_eq!(input.read_rows(0, 0, y0, y1).unwrap(), expected, "{}", name);
            }
            prop_assert!(input.read_rows(0, 0, 3, 71).is_err());
            prop_assert!(input.read_rows(0, 1, 0, 1).is_err());
            prop_assert!(input.read_tile(0, 0, 0, 0).is_err());
        }
    }
}

#[test]
fn dds_stores_all_types_and_mip_levels() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.dds");
    for (pixel_type, counts) in [
        (PixelType::U8, &[1, 2, 3, 4][..]),
        (PixelType::U16, &[1, 2, 4]),
        (PixelType::Half, &[1, 2, 4]),
        (PixelType::Float, &[1, 2, 3, 4]),
    ] {
        for n in counts {
            let mut levels = Vec::new();
            for (w, h) in [(20, 9), (10, 4), (5, 2), (2, 1), (1, 1)] {
                let mut spec = ImageSpec::new(w, h, *n, pixel_type);
                spec.attributes.set(Param::declared("int unassociatedalpha", 1).unwrap());
                levels.push((spec, noise(pixel_type, (w * h) as usize * n, w)));
            }
            write(&path, &*format("dds"), &levels);
            let input = format("dds").open(&path, &Limits::default()).unwrap();
            assert_eq!((input.images(), input.levels(0)), (1, 5));
            for (i, (spec, pixels)) in levels.iter().enumerate() {
                assert_eq!(&input.read_level(0, i).unwrap(), pixels, "{pixel_type:?} {n} level {i}");
                assert_eq!(input.spec(0, i).unwrap().nchannels(), spec.nchannels());
            }
        }
    }
    // The sizes are not halves, and a level is missing.
    let spec = ImageSpec::new(8, 8, 3, PixelType::U8);
    let begin = || format("dds").create(&path, &CreateOptions::new(&spec, 2)).unwrap();
    let mut out = begin();
    out.write_rows(&Pixels::zeros(PixelType::U8, 192)).unwrap();
    assert!(out.next_level(&ImageSpec::new(3, 4, 3, PixelType::U8)).is_err());
    assert!(out.close().unwrap_err().to_string().contains("level 1"));
    assert!(begin().next_level(&spec).is_err());
}

#[test]
fn dds_records_whether_alpha_is_multiplied_in() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.dds");
    let spec = ImageSpec::new(1, 1, 4, PixelType::U8);
    write(&path, &*format("dds"), &[(spec, Pixels::U8(vec![10, 20, 40, 80]))]);
    let input = format("dds").open(&path, &Limits::default()).unwrap();
    assert_eq!(input.read_level(0, 0).unwrap(), Pixels::U8(vec![32, 64, 128, 80]));
    assert_eq!(input.spec(0, 0).unwrap().attributes.int("unassociatedalpha"), Some(1));
    // The second header declares that colours are multiplied.
    let spec = ImageSpec::new(1, 1, 4, PixelType::Half);
    let values = Pixels::Half([0.1, 0.2, 0.3, 0.4].map(f16::from_f32).to_vec());
    write(&path, &*format("dds"), &[(spec, values.clone())]);
    let input = format("dds").open(&path, &Limits::default()).unwrap();
    assert_eq!(input.read_level(0, 0).unwrap(), values);
    assert_eq!(input.spec(0, 0).unwrap().attributes.int("unassociatedalpha"), None);
}

#[test]
fn iff_stores_depth_and_texts() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.iff");
    for colors in [3, 4] {
        let n = colors + 1;
        let mut spec = ImageSpec::new(90, 70, n, PixelType::Float);
        spec.channels = ["R", "G", "B", "A"][..colors].iter().map(|s| (*s).to_owned()).collect();
        spec.channels.push("Z".to_owned());
        for (name, text) in [("Artist", "J\u{f6}rg"), ("DateTime", "2005:06:07 08:09:10")] {
            spec.attributes.set(Param::declared(&format!("string {name}"), text).unwrap());
        }
        // Colours are kept to 16 bits, and depths to all of theirs.
        let value = |i: usize| match i % n {
            c if c < colors => (i * 7 % 65536) as f32 / 65535.0,
            _ => -1.0 / (1.0 + i as f32),
        };
        let pixels = Pixels::Float((0..90 * 70 * n).map(value).collect());
        write(&path, &*format("iff"), &[(spec.clone(), pixels.clone())]);
        let input = format("iff").open(&path, &Limits::default()).unwrap();
        let got = input.spec(0, 0).unwrap();
        assert_eq!((&got.channels, got.pixel_type), (&spec.channels, PixelType::Float));
        assert_eq!(
            (got.string("Artist"), got.string("DateTime")),
            (spec.string("Artist"), spec.string("DateTime"))
        );
        assert_eq!(input.read_level(0, 0).unwrap(), pixels);
    }
}

#[test]
fn sgi_stores_the_image_name_and_the_compression() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.sgi");
    let mut sizes = Vec::new();
    for word in ["none", "rle"] {
        let mut spec = ImageSpec::new(80, 60, 3, PixelType::U16);
        spec.attributes.set(Param::declared("string compression", word).unwrap());
        spec.attributes.set(Param::declared("string ImageDescription", "sunset, take 3").unwrap());
        let pixels = Pixels::U16((0..14_400).map(|i| i / 1000).collect());
        write(&path, &*format("sgi"), &[(spec.clone(), pixels.clone())]);
        let input = format("sgi").open(&path, &Limits::default()).unwrap();
        assert_eq!(input.spec(0, 0).unwrap().attributes, spec.attributes);
        assert_eq!(input.read_level(0, 0).unwrap(), pixels);
        sizes.push(std::fs::metadata(&path).unwrap().len());
    }
    assert!(sizes[1] * 4 < sizes[0], "{sizes:?}");
}

/// Returns the header of a DDS file of blocks, with 10^6 pixels a side and little data.
fn bomb_dds() -> Vec<u8> {
    let mut h = vec![0u8; 200];
    h[..4].copy_from_slice(b"DDS ");
    for (at, v) in [(4, 124), (12, 1_000_000), (16, 1_000_000), (76, 32), (80, 4), (84, 0x3154_5844u32)] {
        h[at..at + 4].copy_from_slice(&v.to_le_bytes());
    }
    h
}

#[test]
fn headers_that_claim_a_million_pixels_a_side_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let million = 1_000_000u32;
    let mut png = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR".to_vec();
    png.extend(million.to_be_bytes());
    png.extend(million.to_be_bytes());
    png.extend([8, 2, 0, 0, 0, 0, 0, 0, 0]);
    let mut bmp = b"BM\0\0\0\0\0\0\0\0\x36\0\0\0\x28\0\0\0".to_vec();
    bmp.extend(million.to_le_bytes());
    bmp.extend(million.to_le_bytes());
    bmp.extend([1, 0, 24, 0]);
    bmp.resize(100, 0);
    let mut iff = b"FOR4\0\0\0\x30CIMGTBHD\0\0\0\x20".to_vec();
    iff.extend(million.to_be_bytes());
    iff.extend(million.to_be_bytes());
    iff.extend([0, 1, 0, 1, 0, 0, 0, 3]);
    iff.resize(60, 0);
    let mut sgi = vec![0x01, 0xda, 1, 1, 0, 3, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff];
    sgi.resize(600, 0);
    let mut qoi = b"qoif".to_vec();
    qoi.extend(million.to_be_bytes());
    qoi.extend(million.to_be_bytes());
    qoi.extend([4, 0, 0, 0, 0, 0]);
    let mut jpeg = b"\xff\xd8\xff\xc0\0\x11\x08\xff\xff\xff\xff\x03\x01\x11\0\x02\x11\0\x03\x11\0".to_vec();
    jpeg.resize(100, 0);
    let mut tga = vec![0, 0, 10, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff, 0xff, 0xff, 32, 0];
    tga.resize(60, 0);
    for (name, bytes) in [
        ("a.png", png),
        ("a.bmp", bmp),
        ("a.iff", iff),
        ("a.sgi", sgi),
        ("a.qoi", qoi),
        ("a.jpg", jpeg),
        ("a.tga", tga),
        ("a.dds", bomb_dds()),
        ("a.ppm", b"P6\n1000000 1000000\n255\nxxxxxxxxxx".to_vec()),
        ("a.pgm", b"P2\n1000000 1000000\n255\n1 2 3 4".to_vec()),
        ("a.pfm", b"PF\n1000000 1000000\n-1.0\nxxxxxxxxxx".to_vec()),
        ("a.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1000000 +X 1000000\nxxxx".to_vec()),
    ] {
        let path = dir.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let extension = path.extension().unwrap().to_str().unwrap();
        let by_extension = formats().into_iter().find(|f| f.extensions().contains(&extension)).unwrap();
        // The memory is that of ten pixels a row. More must not even be requested.
        let limits = Limits { bytes: 1 << 26, pixels: 1 << 40, ..Limits::default() };
        let error = match by_extension.open(&path, &limits) {
            Ok(input) => input.read_level(0, 0).unwrap_err(),
            Err(error) => error,
        };
        assert!(error.to_string().contains(name), "{error}");
    }
}
