//! Written files are read back unchanged, and damaged files are refused.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use granita_base::Param;
use granita_image::{CreateOptions, Format, ImageError, ImageSpec, Limits, PixelType, Pixels};
use granita_raster::formats;
use proptest::prelude::*;
// Every written file is synchronised with the disk, so the numbers of cases are small.
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
        PixelType::Half => Pixels::Half((0..n).map(|i| half::f16::from_f32(word(i) as u16 as f32)).collect()),
        _ => Pixels::Float((0..n).map(|i| word(i) as f32 - 1e9).collect()),
    }
}

fn write(path: &Path, format: &dyn Format, spec: &ImageSpec, pixels: &Pixels, rows: u32) {
    let mut out = format.create(path, &CreateOptions::new(spec, 1)).unwrap();
    let row = spec.width as usize * spec.nchannels();
    for y in (0..spec.height).step_by(rows as usize) {
        let n = rows.min(spec.height - y) as usize * row;
        let mut part = Pixels::zeros(spec.pixel_type, n);
        part.copy_from(0, pixels, y as usize * row, n);
        out.write_rows(&part).unwrap();
    }
    out.close().unwrap();
}

/// The formats that keep every value, with their types and numbers of channels.
const LOSSLESS: [(&str, &[PixelType], &[usize]); 11] = [
    ("png", &[PixelType::U8, PixelType::U16], &[1, 2, 3, 4]),
    ("pnm", &[PixelType::U8, PixelType::U16], &[1, 2, 3, 4]),
    ("pfm", &[PixelType::Float], &[1, 3]),
    ("tga", &[PixelType::U8], &[1, 3, 4]),
    ("bmp", &[PixelType::U8], &[3, 4]),
    ("qoi", &[PixelType::U8], &[3, 4]),
    ("webp", &[PixelType::U8], &[3, 4]),
    ("sgi", &[PixelType::U8, PixelType::U16], &[1, 2, 3, 4, 7]),
    ("iff", &[PixelType::U8, PixelType::U16], &[3, 4]),
    ("dds", &[PixelType::U8], &[1, 2, 3, 4]),
    ("dpx", &[PixelType::U8, PixelType::U16], &[1, 3, 4]),
];

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]
    #[test]
    fn lossless_formats_survive_write_and_read((width, height, rows) in (1u32..50, 1u32..50, 1u32..60), seed in any::<u32>()) {
        let dir = tempfile::tempdir().unwrap();
        for (name, types, channels) in LOSSLESS {
            for pixel_type in types {
                for n in channels {
                    let path = dir.path().join(name);
                    let mut spec = ImageSpec::new(width, height, *n, *pixel_type);
                    spec.attributes.set(Param::declared("int unassociatedalpha", 1).unwrap());
                    let pixels = noise(*pixel_type, (width * height) as usize * n, seed);
                    write(&path, &*format(name), &spec, &pixels, rows);
                    let input = format(name).open(&path, &Limits::default()).unwrap();
                    let got = input.spec(0, 0).unwrap();
                    prop_assert_eq!((got.width, got.height, got.pixel_type), (width, height, *pixel_type), "{}", name);
                    prop_assert_eq!(&got.channels, &spec.channels, "{}", name);
                    prop_assert_eq!(&input.read_level(0, 0).unwrap(), &pixels, "{} {:?} {}", name, pixel_type, n);
                    let last = input.read_rows(0, 0, height - 1, height).unwrap();
                    prop_assert_eq!(last.get(0), pixels.get(pixels.len() - width as usize * n));
                }
            }
        }
    }
}

#[test]
fn lossy_formats_stay_within_their_tolerance() {
    let dir = tempfile::tempdir().unwrap();
    for n in [1, 3, 4] {
        let path = dir.path().join("a.jpg");
        let spec = ImageSpec::new(40, 30, n, PixelType::U8);
        let ramp = |i: usize| (i / n % 40 * 4 + i / n / 40 * 2 + i % n * 9) as u8;
        let pixels = Pixels::U8((0..1200 * n).map(ramp).collect());
        write(&path, &*format("jpeg"), &spec, &pixels, 30);
        let input = format("jpeg").open(&path, &Limits::default()).unwrap();
        let kept = n.min(3);
        assert_eq!(input.spec(0, 0).unwrap().nchannels(), kept);
        let got = input.read_level(0, 0).unwrap();
        for i in 0..1200 {
            for c in 0..kept {
                let d = got.get(i * kept + c) - pixels.get(i * n + c);
                assert!(d.abs() < 8.0 / 255.0, "channel {c} of {n}, pixel {i}: {d}");
            }
        }
    }
    let path = dir.path().join("a.hdr");
    let spec = ImageSpec::new(40, 30, 3, PixelType::Float);
    let mut pixels = Pixels::Float((0..3600).map(|i| 0.01 * 1.003f32.powi(i)).collect());
    write(&path, &*format("hdr"), &spec, &pixels, 7);
    let got = format("hdr").open(&path, &Limits::default()).unwrap().read_level(0, 0).unwrap();
    for i in 0..3600 {
        assert!((got.get(i) / pixels.get(i) - 1.0).abs() < 0.02, "{i}: {} {}", got.get(i), pixels.get(i));
    }
    if let Pixels::Float(v) = &mut pixels {
        v[..5].copy_from_slice(&[f32::NAN, -1.0, 0.0, f32::INFINITY, f32::MAX]);
    }
    write(&path, &*format("hdr"), &spec, &pixels, 30);
    let got = format("hdr").open(&path, &Limits::default()).unwrap().read_level(0, 0).unwrap();
    assert_eq!([got.get(0), got.get(1), got.get(2)], [0.0; 3]);
    assert!(got.get(3) > 9e37 && got.get(3).is_finite() && got.get(4) == got.get(3));
}

#[test]
fn unsupported_types_and_channels_are_refused_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a");
    for (name, n, pixel_type, word) in [
        ("png", 3, PixelType::Float, "Float"),
        ("png", 5, PixelType::U8, "5"),
        ("jpeg", 3, PixelType::U16, "U16"),
        ("tga", 3, PixelType::Half, "Half"),
        ("hdr", 3, PixelType::U8, "U8"),
        ("gif", 3, PixelType::U8, "not written"),
        ("pfm", 4, PixelType::Float, "4"),
        ("hdr", 2, PixelType::Float, "2"),
        ("qoi", 2, PixelType::U8, "2"),
        ("dpx", 2, PixelType::U8, "2"),
        ("dpx", 3, PixelType::Float, "Float"),
    ] {
        let spec = ImageSpec::new(4, 4, n, pixel_type);
        let result = format(name).create(&path, &CreateOptions::new(&spec, 1));
        let Err(ImageError::Unsupported { what, .. }) = result else { panic!("{name}") };
        assert!(what.contains(word), "{what}");
    }
    let tiled = ImageSpec::new(4, 4, 3, PixelType::U8).tiled(16, 16);
    assert!(format("png").create(&path, &CreateOptions::new(&tiled, 1)).is_err());
    assert!(!path.exists());
}

#[test]
fn no_file_appears_before_all_rows_are_written() {
    let dir = tempfile::tempdir().unwrap();
    for f in formats().iter().filter(|f| f.supports("write")) {
        let path = dir.path().join(f.name());
        let spec = ImageSpec::new(4, 4, 3, f.output_type(PixelType::U8));
        let mut out = f.create(&path, &CreateOptions::new(&spec, 1)).unwrap();
        out.write_rows(&Pixels::zeros(spec.pixel_type, 24)).unwrap();
        let error = out.close().unwrap_err().to_string();
        assert!(error.contains(f.name()) && error.contains("2 of 4 rows"), "{error}");
    }
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
}

#[test]
fn alpha_is_divided_out_on_write() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["png", "webp", "qoi"] {
        let path = dir.path().join(name);
        let spec = ImageSpec::new(1, 1, 4, PixelType::U8);
        write(&path, &*format(name), &spec, &Pixels::U8(vec![10, 20, 40, 80]), 1);
        let input = format(name).open(&path, &Limits::default()).unwrap();
        assert_eq!(input.read_level(0, 0).unwrap(), Pixels::U8(vec![32, 64, 128, 80]), "{name}");
        assert_eq!(input.spec(0, 0).unwrap().attributes.int("unassociatedalpha"), Some(1), "{name}");
    }
}

#[test]
fn texts_of_png_survive_write_and_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.png");
    let mut spec = ImageSpec::new(1, 1, 1, PixelType::U16);
    for (name, text) in [
        ("ImageDescription", "\u{3b1}\u{3b2}"),
        ("Artist", "J\u{f6}rg"),
        ("png:Comment", "other"),
        ("png:Source", "\u{3b1}"),
    ] {
        spec.attributes.set(Param::declared(&format!("string {name}"), text).unwrap());
    }
    write(&path, &*format("png"), &spec, &Pixels::U16(vec![1]), 1);
    let input = format("png").open(&path, &Limits::default()).unwrap();
    assert_eq!(input.spec(0, 0).unwrap().attributes, spec.attributes);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    #[test]
    fn damaged_files_do_not_panic(cut in 0.0f64..1.0, flips in prop::collection::vec((0.0f64..1.0, 0u8..8), 1..4)) {
        let dir = tempfile::tempdir().unwrap();
        let limits = Limits { dimension: 4096, pixels: 1 << 20, bytes: 4 << 20, ..Limits::default() };
        for f in formats().iter().filter(|f| f.supports("write")) {
            let path = dir.path().join(format!("damaged.{}", f.extensions()[0]));
            let spec = ImageSpec::new(19, 13, 3, f.output_type(PixelType::U8));
            write(&path, &**f, &spec, &noise(spec.pixel_type, 19 * 13 * 3, 1), 13);
            let good = std::fs::read(&path).unwrap();
            let at = |x: f64| (x * good.len() as f64) as usize;
            let read = |bytes: &[u8]| {
                std::fs::write(&path, bytes).unwrap();
                f.open(&path, &limits).and_then(|i| i.read_level(0, 0))
            };
            if let Err(error) = read(&good[..at(cut)]) {
                prop_assert!(error.to_string().contains("damaged."), "{}", error);
            }
            let mut bad = good.clone();
            for (x, bit) in &flips {
                bad[at(*x)] ^= 1 << bit;
            }
            if let Err(error) = read(&bad) {
                prop_assert!(error.to_string().contains("damaged."), "{}", error);
            }
        }
    }
}

#[test]
fn formats_are_recognised_by_their_first_bytes() {
    let find =
        |head: &[u8]| formats().iter().filter(|f| f.recognizes(head)).map(|f| f.name()).collect::<Vec<_>>();
    assert_eq!(find(b"\x89PNG\r\n\x1a\n...."), ["png"]);
    assert_eq!(find(b"\xff\xd8\xff\xe0"), ["jpeg"]);
    assert_eq!(find(b"P6\n3 3"), ["pnm"]);
    assert_eq!(find(b"PF\n3 3"), ["pfm"]);
    assert_eq!(find(b"RIFF....WEBPVP8 "), ["webp"]);
    assert_eq!(find(b"SDPX\0\0"), ["dpx"]);
    assert_eq!(find(b"XPDS\0\0"), ["dpx"]);
    assert_eq!(find(b"Parameter (\"x\")"), [""; 0]);
    assert_eq!(find(b""), [""; 0]);
}

/// Returns Exif data with only an orientation, as a segment of a JPEG file.
fn exif(orientation: u8, big_endian: bool) -> Vec<u8> {
    let mut segment = b"\xff\xe1\x00\x22Exif\0\0".to_vec();
    segment.extend(match big_endian {
        // There is one entry, the orientation, which is one short.
        false => {
            [&b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0"[..], &[orientation, 0, 0, 0], &[0; 4]].concat()
        }
        true => {
            [&b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01"[..], &[0, orientation, 0, 0], &[0; 4]].concat()
        }
    });
    segment
}

/// The table has the corner of the upright image that is the first stored pixel, for all eight orientations, as (right,
/// bottom). It also has whether the first row became a column (Exif, tag 274).
#[test]
fn jpeg_files_are_turned_upright() {
    let dir = tempfile::tempdir().unwrap();
    let (plain, path) = (dir.path().join("plain.jpg"), dir.path().join("turned.jpg"));
    let spec = ImageSpec::new(32, 16, 1, PixelType::U8);
    // The upper left quarter is white, the upper right one light grey, the rest dark.
    let value = |x: u32, y: u32| match (x < 16, y < 8) {
        (true, true) => 250,
        (false, true) => 150,
        _ => 20,
    };
    let pixels = Pixels::U8((0..32 * 16).map(|i| value(i % 32, i / 32)).collect());
    write(&plain, &*format("jpeg"), &spec, &pixels, 16);
    let file = std::fs::read(&plain).unwrap();
    for (number, right, bottom, transposed) in [
        (1, false, false, false),
        (2, true, false, false),
        (3, true, true, false),
        (4, false, true, false),
        (5, false, false, true),
        (6, true, false, true),
        (7, true, true, true),
        (8, false, true, true),
        // Without an orientation the image is as it is stored.
        (9, false, false, false),
    ] {
        for big_endian in [false, true] {
            std::fs::write(&path, [&file[..2], &exif(number, big_endian), &file[2..]].concat()).unwrap();
            let input = format("jpeg").open(&path, &Limits::default()).unwrap();
            let (w, h) = if transposed { (16, 32) } else { (32, 16) };
            let spec = input.spec(0, 0).unwrap();
            assert_eq!((spec.width, spec.height), (w, h), "{number}");
            assert!(spec.attributes.get("orientation").is_none());
            let Pixels::U8(all) = input.read_level(0, 0).unwrap() else { panic!() };
            // Returns the middle of a quarter, counted from the corner of the first stored pixel.
            let at = |along_x: bool, along_y: bool| {
                let x = if along_x == right { w / 4 } else { 3 * w / 4 };
                let y = if along_y == bottom { h / 4 } else { 3 * h / 4 };
                all[(y * w + x) as usize]
            };
            // From that corner the image is light grey along the first row, and dark along the first column.
            let (row, column) = if transposed {
                (at(false, true), at(true, false))
            } else {
                (at(true, false), at(false, true))
            };
            assert!(at(false, false) > 240 && (140..160).contains(&row) && column < 40, "{number}: {all:?}");
            // Rows that are requested alone are those of the upright image.
            let Pixels::U8(last) = input.read_rows(0, 0, h - 1, h).unwrap() else { panic!() };
            assert_eq!(last, all[((h - 1) * w) as usize..]);
        }
    }
}

/// Programs that read .ppm and .pgm expect P6 and P5.
#[test]
fn the_extension_chooses_the_pnm_kind() {
    let dir = tempfile::tempdir().unwrap();
    let format = format("pnm");
    for (name, n, head, kept) in [
        ("a.ppm", 4, "P6", 3),
        ("a.PPM", 4, "P6", 3),
        ("a.pgm", 2, "P5", 1),
        ("a.pam", 4, "P7", 4),
        ("a.pnm", 4, "P7", 4),
        ("a.ppm", 3, "P6", 3),
    ] {
        let path = dir.path().join(name);
        let spec = ImageSpec::new(2, 1, n, PixelType::U8);
        let values: Vec<u8> = (1..=2 * n as u8).collect();
        write(&path, &*format, &spec, &Pixels::U8(values.clone()), 1);
        assert!(std::fs::read(&path).unwrap().starts_with(head.as_bytes()), "{name}");
        let input = format.open(&path, &Limits::default()).unwrap();
        assert_eq!(input.spec(0, 0).unwrap().nchannels(), kept);
        let expected: Vec<u8> = values.chunks(n).flat_map(|p| p[..kept].to_vec()).collect();
        assert_eq!(input.read_level(0, 0).unwrap(), Pixels::U8(expected));
        assert_eq!(format.leaves_out(&path, n).is_some(), kept < n, "{name}");
    }
}

/// The largest image of the file is read. Its colours are not multiplied by alpha.
#[test]
fn the_largest_image_of_an_icon_is_read() {
    let dir = tempfile::tempdir().unwrap();
    // Each image is a bitmap of 32 bits with the rows of its colours and of a mask, from the lowest on.
    let bitmap = |side: u32, value: u8| {
        let mut out: Vec<u8> = [40, side, 2 * side, 32 << 16 | 1, 0, 0, 0, 0, 0, 0]
            .iter()
            .flat_map(|w: &u32| w.to_le_bytes())
            .collect();
        out.extend((0..side * side).flat_map(|i| [value, 2, 3, if i == 0 { 128 } else { 255 }]));
        out.extend(vec![0; (side * 4) as usize]);
        out
    };
    let images = [bitmap(1, 9), bitmap(2, 7)];
    let mut file = vec![0, 0, 1, 0, 2, 0];
    let mut at = 6 + 32;
    for (image, side) in images.iter().zip([1, 2]) {
        file.extend([side, side, 0, 0, 1, 0, 32, 0]);
        file.extend((image.len() as u32).to_le_bytes());
        file.extend((at as u32).to_le_bytes());
        at += image.len();
    }
    file.extend(images.concat());
    let path = dir.path().join("a.ico");
    std::fs::write(&path, &file).unwrap();
    assert!(format("ico").recognizes(&file[..38]));
    let input = format("ico").open(&path, &Limits::default()).unwrap();
    let spec = input.spec(0, 0).unwrap();
    assert_eq!((spec.width, spec.height, spec.attributes.int("unassociatedalpha")), (2, 2, Some(1)));
    let expected = [3, 2, 7, 255, 3, 2, 7, 255, 3, 2, 7, 128, 3, 2, 7, 255];
    assert_eq!(input.read_level(0, 0).unwrap(), Pixels::U8(expected.to_vec()));
    for cut in 0..file.len() {
        std::fs::write(&path, &file[..cut]).unwrap();
        let read = format("ico").open(&path, &Limits::default()).and_then(|input| input.read_level(0, 0));
        assert!(read.is_ok() || read.is_err_and(|e| e.to_string().contains("a.ico")), "{cut}");
    }
}
