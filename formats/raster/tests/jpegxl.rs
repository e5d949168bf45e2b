//! JPEG XL that is written and read back, and damaged.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use granita_base::Param;
use granita_image::{CreateOptions, Format, ImageSpec, Limits, PixelType, Pixels};
use granita_raster::JpegXlFormat;
use std::path::Path;

fn write(path: &Path, spec: &ImageSpec, pixels: &Pixels) {
    let mut out = JpegXlFormat.create(path, &CreateOptions::new(spec, 1)).unwrap();
    out.write_rows(pixels).unwrap();
    out.close().unwrap();
}

/// Returns values that are smooth in a part of the image, equal in another, and noise in the rest.
fn values(spec: &ImageSpec) -> Pixels {
    let (w, n) = (spec.width as usize, spec.nchannels());
    let value = |i: usize| {
        let (x, y, c) = (i / n % w, i / n / w, i % n);
        match (x / 8 + y / 8) % 3 {
            0 => (x * 3 + y * 5 + c * 40) as f32 / 1000.0,
            1 => 0.25,
            _ => granita_base::hash::words(&[i as u32]) as f32 / u32::MAX as f32,
        }
    };
    Pixels::from_floats(spec.pixel_type, &(0..w * spec.height as usize * n).map(value).collect::<Vec<_>>())
}

#[test]
fn jpeg_xl_survives_write_and_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.jxl");
    for pixel_type in [PixelType::U8, PixelType::U16] {
        for n in (1..=4).filter(|n| pixel_type == PixelType::U8 || n % 2 == 1) {
            for (width, height) in [(2, 2), (17, 3), (3, 40), (64, 64), (300, 270)] {
                let mut spec = ImageSpec::new(width, height, n, pixel_type);
                spec.attributes.set(Param::declared("int unassociatedalpha", 1).unwrap());
                let pixels = values(&spec);
                write(&path, &spec, &pixels);
                let input = JpegXlFormat.open(&path, &Limits::default()).unwrap();
                let got = input.spec(0, 0).unwrap();
                assert_eq!((&got.channels, got.pixel_type), (&spec.channels, pixel_type));
                assert_eq!(got.attributes.int("unassociatedalpha").is_some(), n % 2 == 0);
                assert!(input.read_level(0, 0).unwrap() == pixels, "{pixel_type:?} {n} {width} x {height}");
            }
        }
    }
}

#[test]
fn jpeg_xl_that_cannot_be_written_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    for (width, n, pixel_type, word) in
        [(4, 3, PixelType::Float, "Float"), (4, 5, PixelType::U8, "not 5"), (1, 3, PixelType::U8, "1 x 4")]
    {
        let spec = ImageSpec::new(width, 4, n, pixel_type);
        let error =
            JpegXlFormat.create(&folder.path().join("a"), &CreateOptions::new(&spec, 1)).err().unwrap();
        assert!(error.to_string().contains(word), "{error}");
    }
}

#[test]
fn damaged_jpeg_xl_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.jxl");
    let spec = ImageSpec::new(40, 30, 3, PixelType::U8);
    write(&path, &spec, &values(&spec));
    let good = std::fs::read(&path).unwrap();
    let limits = Limits { dimension: 4096, pixels: 1 << 20, bytes: 16 << 20, ..Limits::default() };
    let read = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        JpegXlFormat.open(&path, &limits).and_then(|input| input.read_level(0, 0))
    };
    for cut in [0, 1, 2, 5, 20, good.len() / 2, good.len() - 1] {
        let text = read(&good[..cut]).unwrap_err().to_string();
        assert!(text.contains("a.jxl: malformed JPEG XL"), "{cut}: {text}");
    }
    let mut damaged = 0;
    for i in 0..200_u32 {
        let mut bad = good.clone();
        let at = granita_base::hash::words(&[i, 1]) as usize % bad.len();
        bad[at] ^= 1 << (i % 8);
        damaged += u32::from(read(&bad).is_err());
    }
    assert!(damaged > 20, "{damaged} of 200 damaged files are refused");
}
