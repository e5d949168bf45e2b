//! Damaged files result in an error that names the file, and never in a panic, a hang or a huge allocation.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use granita_base::Param;
use granita_exr::ExrFormat;
use granita_image::{CreateOptions, Format, ImageSpec, Limits, PixelType, Pixels};
use proptest::prelude::*;
use std::path::Path;

const COMPRESSIONS: [&str; 8] = ["none", "rle", "zip", "zips", "piz", "pxr24", "b44", "dwaa"];

fn sample(path: &Path, compression: &str, tiled: bool) -> Vec<u8> {
    let mut spec = ImageSpec::new(23, 19, 3, PixelType::Half);
    if tiled {
        spec = spec.tiled(16, 16);
    }
    spec.attributes.set(Param::declared("string compression", compression).unwrap());
    let mut out = ExrFormat.create(path, &CreateOptions::new(&spec, 1)).unwrap();
    let ramp: Vec<f32> = (0..23 * 19 * 3).map(|i| (i % 37) as f32 * 0.1).collect();
    out.write_rows(&Pixels::from_floats(PixelType::Half, &ramp)).unwrap();
    out.close().unwrap();
    std::fs::read(path).unwrap()
}

/// Reads all images and levels that can be read.
fn read(path: &Path, bytes: &[u8]) -> granita_image::Result<()> {
    let limits = Limits { dimension: 4096, pixels: 1 << 22, bytes: 16 << 20, ..Limits::default() };
    std::fs::write(path, bytes).unwrap();
    let input = ExrFormat.open(path, &limits)?;
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
    let path = dir.path().join("damaged.exr");
    for tiled in [false, true] {
        let good = sample(&path, "zip", tiled);
        for n in 0..good.len() {
            let error = read(&path, &good[..n]).unwrap_err().to_string();
            assert!(error.contains("damaged.exr"), "{error}");
        }
        read(&path, &good).unwrap();
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]
    #[test]
    fn files_with_flipped_bits_do_not_panic(
        flips in prop::collection::vec((0.0f64..1.0, 0u8..8), 1..5),
        header_only in any::<bool>(),
        kind in 0..COMPRESSIONS.len() * 2,
    ) {
        // The samples are written once, because they do not depend on the case.
        use std::sync::OnceLock;
        static SAMPLES: OnceLock<Vec<Vec<u8>>> = OnceLock::new();
        let samples = SAMPLES.get_or_init(|| {
            let dir = tempfile::tempdir().unwrap();
            (0..COMPRESSIONS.len() * 2)
                .map(|i| sample(&dir.path().join("a.exr"), COMPRESSIONS[i / 2], i % 2 == 1))
                .collect()
        });
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("damaged.exr");
        let mut bytes = samples[kind].clone();
        let range = if header_only { bytes.len().min(500) } else { bytes.len() };
        for (x, bit) in flips {
            bytes[(x * range as f64) as usize] ^= 1 << bit;
        }
        if let Err(error) = read(&path, &bytes) {
            prop_assert!(error.to_string().contains("damaged.exr"), "{}", error);
        }
    }
}

#[test]
fn a_window_of_a_million_pixels_a_side_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("damaged.exr");
    for tiled in [false, true] {
        let mut bytes = sample(&path, "zip", tiled);
        // Both windows are four numbers after their name, type and size.
        for name in [&b"dataWindow\0box2i\0"[..], b"displayWindow\0box2i\0"] {
            let at = bytes.windows(name.len()).position(|w| w == name).unwrap() + name.len() + 12;
            bytes[at..at + 4].copy_from_slice(&999_999i32.to_le_bytes());
            bytes[at + 4..at + 8].copy_from_slice(&999_999i32.to_le_bytes());
        }
        std::fs::write(&path, &bytes).unwrap();
        // The limits are the defaults. Even so, nothing of that size may be allocated.
        let error = match ExrFormat.open(&path, &Limits::default()) {
            Ok(input) => input.read_level(0, 0).unwrap_err(),
            Err(error) => error,
        };
        assert!(error.to_string().contains("damaged.exr"), "{error}");
    }
}

/// Thousands of channels are refused before any work for each pair of them.
#[test]
fn the_number_of_channels_is_limited() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.exr");
    let attribute = |name: &str, kind: &str, value: &[u8]| {
        [name.as_bytes(), b"\0", kind.as_bytes(), b"\0", &(value.len() as u32).to_le_bytes(), value].concat()
    };
    let window: Vec<u8> = [0_i32, 0, 3, 0].iter().flat_map(|n| n.to_le_bytes()).collect();
    let file = |channels: usize| {
        let mut list = Vec::new();
        for i in 0..channels {
            list.extend(format!("c{i:06}\0").bytes());
            list.extend([1_u32, 0, 1, 1].iter().flat_map(|n| n.to_le_bytes()));
        }
        list.push(0);
        let header = [
            attribute("channels", "chlist", &list),
            attribute("compression", "compression", &[0]),
            attribute("dataWindow", "box2i", &window),
            attribute("displayWindow", "box2i", &window),
            attribute("lineOrder", "lineOrder", &[0]),
            attribute("pixelAspectRatio", "float", &1_f32.to_le_bytes()),
            attribute("screenWindowCenter", "v2f", &[0; 8]),
            attribute("screenWindowWidth", "float", &1_f32.to_le_bytes()),
        ];
        let front = [&[0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0][..], &header.concat(), &[0]].concat();
        let pixels = vec![0; 8 * channels];
        let at = (front.len() as u64 + 8).to_le_bytes();
        [&front[..], &at, &[0; 4], &(pixels.len() as u32).to_le_bytes(), &pixels].concat()
    };
    assert!(read(&path, &file(100)).is_ok());
    let error = read(&path, &file(60_000)).unwrap_err().to_string();
    assert!(error.contains("number of channels 60000 exceeds the limit of 1024"), "{error}");
}
