//! Tests files that are not complete, because they are cut short, damaged, still being written, or deleted.

#![allow(clippy::unwrap_used, reason = "what fails here fails the test")]

use granita_image::{CreateOptions, FormatRegistry, ImageSpec, Limits, PixelType, Pixels};
use granita_view::{Display, Image, Stamp, TileStore, thumbnail};
use std::path::Path;

fn formats() -> FormatRegistry {
    granita_plugin::bundled_formats(Limits::default())
}

fn white(path: &Path, format: &str, tiled: bool) {
    let mut spec = ImageSpec::new(256, 256, 3, PixelType::U8);
    if matches!(format, "exr" | "pfm" | "hdr") {
        spec.pixel_type = PixelType::Float;
    }
    if tiled {
        spec = spec.tiled(32, 32);
    }
    // Noise does not compress, so that a part of the file is a part of the image.
    let values: Vec<f32> = (0..256 * 256 * 3)
        .map(|i| 0.8 + 0.2 * granita_base::hash::unit(granita_base::hash::words(&[i])))
        .collect();
    let mut file = formats().create(path, format, &CreateOptions::new(&spec, 1)).unwrap();
    file.write_rows(&Pixels::from_floats(spec.pixel_type, &values)).unwrap();
    file.close().unwrap();
}

/// Returns the fraction of the image that is bright, and true when there was a reading error.
fn seen(path: &Path) -> Option<(f64, bool)> {
    let image = Image::open(path, &formats(), &TileStore::default()).ok()?;
    let page = &image.pages[0];
    let canvas = thumbnail(page, 0, &Display::default(), 256).ok()?;
    let bright = canvas.bytes.chunks(4).filter(|p| p[0] > 128).count();
    Some((bright as f64 / 65536.0, page.fault().is_some()))
}

#[test]
fn the_available_part_of_a_file_is_shown() {
    let folder = tempfile::tempdir().unwrap();
    for (format, tiled) in [
        ("exr", false),
        ("exr", true),
        ("tiff", true),
        ("png", false),
        ("pfm", false),
        ("pnm", false),
        ("jpeg", false),
        ("hdr", false),
    ] {
        let path = folder.path().join(format!("a{tiled}.{format}"));
        white(&path, format, tiled);
        assert_eq!(seen(&path), Some((1.0, false)), "{format}");
        let bytes = std::fs::read(&path).unwrap();
        // TIFF has its directory at the end. Nothing can be shown without it.
        let cut = if format == "tiff" { bytes.len() } else { bytes.len() / 2 };
        let mut part = bytes[..cut].to_vec();
        if format == "tiff" {
            let half = bytes.len() / 4..bytes.len() / 2;
            part[half].fill(0);
        }
        std::fs::write(&path, part).unwrap();
        let (share, fault) = seen(&path).unwrap_or_else(|| panic!("{format}: half a file shows nothing"));
        assert!((0.3..0.85).contains(&share), "{format} tiled {tiled}: {share}");
        assert!(fault, "{format}: it is said that something is missing");
    }
}

#[test]
fn files_truncated_anywhere_do_not_panic() {
    let folder = tempfile::tempdir().unwrap();
    for format in [
        "exr", "png", "tiff", "jpeg", "pnm", "hdr", "sgi", "iff", "dds", "dpx", "jpegxl", "qoi", "webp",
        "bmp", "tga",
    ] {
        let path = folder.path().join(format!("a.{format}"));
        let mut spec = ImageSpec::new(64, 48, 3, PixelType::U8);
        if matches!(format, "exr" | "hdr") {
            spec.pixel_type = PixelType::Float;
        }
        let mut file = formats().create(&path, format, &CreateOptions::new(&spec, 1)).unwrap();
        file.write_rows(&Pixels::from_floats(spec.pixel_type, &vec![0.5; 64 * 48 * 3])).unwrap();
        file.close().unwrap();
        let bytes = std::fs::read(&path).unwrap();
        for i in 0..24 {
            let cut = bytes.len() * i / 24;
            std::fs::write(&path, &bytes[..cut]).unwrap();
            // The call returns, whether it shows something or reports an error.
            let _ = seen(&path);
        }
    }
}

#[test]
fn changes_of_a_file_are_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.pnm");
    white(&path, "pnm", false);
    let image = Image::open(&path, &formats(), &TileStore::default()).unwrap();
    assert!(!image.has_changed());
    let mut bytes = std::fs::read(&path).unwrap();
    bytes.extend([0; 10]);
    std::fs::write(&path, bytes).unwrap();
    assert!(image.has_changed());
    std::fs::remove_file(&path).unwrap();
    assert!(!image.has_changed(), "what is gone stays on the screen");
    assert!(!Stamp::of(&path).is_there());
}
