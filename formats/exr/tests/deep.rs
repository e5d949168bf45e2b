//! Deep files that OpenEXR's library wrote, and files of several parts.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use granita_base::{Files, Param};
use granita_exr::ExrFormat;
use granita_image::{DeepSamples, Format, ImageError, ImageInput, ImageSpec, Limits, PixelType, Pixels};
use std::path::{Path, PathBuf};

const KINDS: [&str; 6] = ["rows-none", "rows-rle", "rows-zips", "tiles-none", "tiles-rle", "tiles-zips"];

fn deep_file(kind: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/data/deep-{kind}.exr"))
}

fn open(path: &Path) -> Box<dyn ImageInput> {
    ExrFormat.open(path, &Limits::default()).unwrap()
}

#[test]
fn deep_files_are_flattened() {
    // The table has R, G, B, A and Z of each pixel, by the functions of OpenImageIO that split and merge samples.
    let table = include_str!("data/deep.tsv");
    let expected: Vec<f32> = table.split_whitespace().map(|word| word.parse().unwrap()).collect();
    for kind in KINDS {
        let input = open(&deep_file(kind));
        let spec = input.spec(0, 0).unwrap();
        assert_eq!((spec.width, spec.height, spec.is_tiled()), (6, 20, kind.starts_with("tiles")), "{kind}");
        assert_eq!(spec.channels, ["R", "G", "B", "A", "Z"], "{kind}");
        assert_eq!((spec.pixel_type, spec.string("deep")), (PixelType::Float, Some("flattened")), "{kind}");
        let got = input.read_level(0, 0).unwrap().to_floats();
        assert_eq!(got.len(), expected.len());
        for (k, (got, expected)) in got.iter().zip(&expected).enumerate() {
            // The functions round parts of volumes to halves.
            assert!((got - expected).abs() < 2e-3, "{kind}: value {k} is {got}, not {expected}");
        }
        let rows = input.read_rows(0, 0, 3, 5).unwrap().to_floats();
        assert_eq!(rows, got[3 * 30..5 * 30], "{kind}");
        let counts = DeepSamples { total: 240, most_per_pixel: 4 };
        assert_eq!(input.deep_samples(0, 0).unwrap(), Some(counts), "{kind}");
    }
}

#[test]
fn damaged_deep_files_are_refused_or_flattened() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.exr");
    let mut refused = 0;
    for kind in ["rows-none", "tiles-zips", "rows-rle"] {
        let whole = std::fs::read(deep_file(kind)).unwrap();
        for k in 0..400_usize {
            let mut bytes = whole.clone();
            let random = |n: usize| granita_base::hash::words(&[k as u32, n as u32]) as usize;
            let at = random(0) % bytes.len();
            match k % 4 {
                0 => bytes.truncate(at),
                1 => bytes[at] = random(1) as u8,
                2 => bytes[at] = 0xff,
                _ => {
                    let end = bytes.len().min(at + 8);
                    bytes[at..end].fill(0x7f);
                }
            }
            std::fs::write(&path, &bytes).unwrap();
            let limits = Limits { bytes: 1 << 24, ..Limits::default() };
            let read = ExrFormat.open(&path, &limits).and_then(|input| {
                input.deep_samples(0, 0)?;
                input.read_level(0, 0)
            });
            if let Err(error) = read {
                refused += 1;
                assert!(error.to_string().contains("damaged.exr"), "{error}");
            }
        }
    }
    assert!(refused > 400, "{refused}");
}

fn text(name: &str, value: &str) -> Param {
    Param::declared(&format!("string {name}"), value).unwrap()
}

/// Returns three parts: of halves, of floats, and of floats in tiles.
fn parts() -> Vec<(ImageSpec, Pixels)> {
    let spec = |n: usize, ty, name: Option<&str>| {
        let mut spec = ImageSpec::new(9, 40, n, ty);
        if let Some(name) = name {
            spec.attributes.set(text("name", name));
        }
        spec
    };
    let mut first = spec(4, PixelType::Half, Some("beauty.left"));
    first.attributes.set(text("view", "left"));
    first.attributes.set(text("compression", "piz"));
    let mut second = spec(1, PixelType::Float, None);
    second.channels = vec!["Z".to_owned()];
    let third = spec(2, PixelType::U32, Some("ids")).tiled(8, 16);
    let pixels = |spec: &ImageSpec, seed: u32| {
        let n = (spec.width * spec.height) as usize * spec.nchannels();
        let word = |i: usize| granita_base::hash::words(&[seed, i as u32]);
        match spec.pixel_type {
            PixelType::Half => {
                Pixels::Half((0..n).map(|i| half::f16::from_f32(word(i) as f32 / 1e6)).collect())
            }
            PixelType::U32 => Pixels::U32((0..n).map(word).collect()),
            _ => Pixels::Float((0..n).map(|i| word(i) as f32).collect()),
        }
    };
    let with_pixels = |(seed, spec): (u32, ImageSpec)| {
        let pixels = pixels(&spec, seed);
        (spec, pixels)
    };
    (0..).zip([first, second, third]).map(with_pixels).collect()
}

fn write(path: &Path, order: &[(usize, u32, u32)]) -> Result<(), ImageError> {
    let parts = parts();
    let specs: Vec<ImageSpec> = parts.iter().map(|(spec, _)| spec.clone()).collect();
    let mut file = ExrFormat.create_images(path, &specs, &Files::default())?;
    for (image, y0, y1) in order {
        file.select_image(*image)?;
        let (spec, pixels) = &parts[*image];
        let row = spec.width as usize * spec.nchannels();
        let n = (y1 - y0) as usize * row;
        let mut rows = Pixels::zeros(spec.pixel_type, n);
        rows.copy_from(0, pixels, *y0 as usize * row, n);
        file.write_rows(&rows)?;
    }
    file.close()
}

#[test]
fn parts_survive_write_and_read_in_any_order() {
    let folder = tempfile::tempdir().unwrap();
    let orders = [
        vec![(0, 0, 40), (1, 0, 40), (2, 0, 40)],
        vec![(2, 0, 7), (0, 0, 33), (2, 7, 40), (1, 0, 1), (0, 33, 40), (1, 1, 40)],
    ];
    for (k, order) in orders.iter().enumerate() {
        let path = folder.path().join(format!("{k}.exr"));
        write(&path, order).unwrap();
        let input = open(&path);
        assert_eq!(input.images(), 3);
        for (image, (spec, pixels)) in parts().iter().enumerate() {
            let got = input.spec(image, 0).unwrap();
            assert_eq!((&got.channels, got.pixel_type), (&spec.channels, spec.pixel_type));
            assert_eq!(got.is_tiled(), image == 2);
            assert_eq!(input.read_level(image, 0).unwrap(), *pixels, "part {image}");
        }
        let name = |image: usize, name: &str| input.spec(image, 0).unwrap().string(name).map(str::to_owned);
        assert_eq!(name(0, "name").as_deref(), Some("beauty.left"));
        assert_eq!(name(0, "view").as_deref(), Some("left"));
        assert_eq!(name(1, "name").as_deref(), Some("part1"));
        assert_eq!((name(1, "view"), name(0, "compression").as_deref()), (None, Some("piz")));
    }
}

#[test]
fn incomplete_parts_and_parts_of_one_name_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let error = write(&path, &[(0, 0, 40), (2, 0, 40), (1, 0, 39)]).unwrap_err();
    assert!(matches!(error, ImageError::Misuse { .. }) && error.to_string().contains("part 1"), "{error}");
    assert!(write(&path, &[(3, 0, 1)]).is_err());
    let mut spec = ImageSpec::new(2, 2, 1, PixelType::Half);
    spec.attributes.set(text("name", "a"));
    assert!(ExrFormat.create_images(&path, &[spec.clone(), spec.clone()], &Files::default()).is_err());
    assert!(ExrFormat.create_images(&path, &[], &Files::default()).is_err());
    let mut other = spec.clone();
    other.attributes.set(text("name", "b"));
    other.full_width = 5;
    assert!(
        ExrFormat.create_images(&path, &[spec, other], &Files::default()).is_err(),
        "two display windows"
    );
    assert!(!path.exists());
}
