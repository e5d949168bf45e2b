//! Written files are read back unchanged: every type, size, tile size and compression that keeps its values.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use granita_base::{Param, Params};
use granita_exr::ExrFormat;
use granita_image::{CreateOptions, Format, ImageError, ImageSpec, Limits, PixelType, Pixels};
use half::f16;
use proptest::prelude::*;
use std::path::Path;

const TYPES: [PixelType; 3] = [PixelType::U32, PixelType::Half, PixelType::Float];

/// Returns pixels of every bit pattern, the same for the same seed. NaN is excluded, because it does not compare equal.
fn noise(pixel_type: PixelType, n: usize, seed: u32) -> Pixels {
    let word = |i: usize| granita_base::hash::words(&[seed, (i / 3) as u32]);
    let finite = |bits: u32| if f32::from_bits(bits).is_nan() { 1.5 } else { f32::from_bits(bits) };
    let finite_half = |bits: u16| if f16::from_bits(bits).is_nan() { f16::ONE } else { f16::from_bits(bits) };
    match pixel_type {
        PixelType::U32 => Pixels::U32((0..n).map(word).collect()),
        PixelType::Half => Pixels::Half((0..n).map(|i| finite_half(word(i) as u16)).collect()),
        _ => Pixels::Float((0..n).map(|i| finite(word(i))).collect()),
    }
}

fn string(params: &mut Params, name: &str, value: &str) {
    params.set(Param::declared(&format!("string {name}"), value).unwrap());
}

fn write(path: &Path, levels: &[ImageSpec], rows_at_once: u32) -> Vec<Pixels> {
    let mut out = ExrFormat.create(path, &CreateOptions::new(&levels[0], levels.len())).unwrap();
    let mut all = Vec::new();
    for (i, spec) in levels.iter().enumerate() {
        if i > 0 {
            out.next_level(spec).unwrap();
        }
        let row = spec.width as usize * spec.nchannels();
        let pixels = noise(spec.pixel_type, row * spec.height as usize, i as u32);
        for y in (0..spec.height).step_by(rows_at_once as usize) {
            let n = rows_at_once.min(spec.height - y) as usize * row;
            let mut part = Pixels::zeros(spec.pixel_type, n);
            part.copy_from(0, &pixels, y as usize * row, n);
            out.write_rows(&part).unwrap();
        }
        all.push(pixels);
    }
    out.close().unwrap();
    all
}

proptest! {
    // The number of cases is small, because every written file is synchronised with the disk.
    #![proptest_config(ProptestConfig::with_cases(100))]
    #[test]
    fn images_survive_write_and_read(
        (width, height, channels) in (1u32..70, 1u32..70, 1usize..12),
        pixel_type in prop::sample::select(&TYPES[..]),
        tile in prop::sample::select(vec![0u32, 8, 16, 48, 64]),
        compression in prop::sample::select(vec!["none", "rle", "zip", "zips", "piz", "deflate", "zip:1", "zips:12"]),
        rows_at_once in 1u32..80,
    ) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.exr");
        let mut spec = ImageSpec::new(width, height, channels, pixel_type);
        (spec.tile_width, spec.tile_height) = (tile, tile);
        string(&mut spec.attributes, "compression", compression);
        let all = write(&path, &[spec.clone()], rows_at_once);
        let input = ExrFormat.open(&path, &Limits::default()).unwrap();
        prop_assert_eq!((input.images(), input.levels(0)), (1, 1));
        let got = input.spec(0, 0).unwrap();
        prop_assert_eq!(&got.channels, &spec.channels);
        prop_assert_eq!(got.pixel_type, pixel_type);
        prop_assert_eq!((got.width, got.height, got.tile_width, got.tile_height), (width, height, tile, tile));
        prop_assert_eq!((got.full_width, got.full_height, got.x, got.y), (width, height, 0, 0));
        prop_assert_eq!(input.read_level(0, 0).unwrap(), all[0].clone());
        let (y0, y1) = (height / 3, height - height / 4);
        let row = width as usize * channels;
        let mut expected = Pixels::zeros(pixel_type, (y1 - y0) as usize * row);
        let n = expected.len();
        expected.copy_from(0, &all[0], y0 as usize * row, n);
        prop_assert_eq!(input.read_rows(0, 0, y0, y1).unwrap(), expected);
        if tile > 0 {
            let (tx, ty) = got.tiles();
            let last = input.read_tile(0, 0, tx - 1, ty - 1).unwrap();
            prop_assert_eq!(last.len(), (tile * tile) as usize * channels);
            prop_assert!(input.read_tile(0, 0, tx, 0).is_err());
        } else {
            prop_assert!(input.read_tile(0, 0, 0, 0).is_err());
        }
    }
}

fn pyramid(
    mut width: u32,
    mut height: u32,
    channels: usize,
    pixel_type: PixelType,
    tile: u32,
) -> Vec<ImageSpec> {
    let mut levels = Vec::new();
    loop {
        levels.push(ImageSpec::new(width, height, channels, pixel_type).tiled(tile, tile));
        if width == 1 && height == 1 {
            return levels;
        }
        (width, height) = ((width / 2).max(1), (height / 2).max(1));
    }
}

#[test]
fn mip_levels_survive_write_and_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.exr");
    let levels = pyramid(300, 150, 4, PixelType::Half, 32);
    let all = write(&path, &levels, 7);
    let input = ExrFormat.open(&path, &Limits::default()).unwrap();
    assert_eq!((input.images(), input.levels(0)), (1, levels.len()));
    for (i, pixels) in all.iter().enumerate() {
        let spec = input.spec(0, i).unwrap();
        assert_eq!((spec.width, spec.height), (levels[i].width, levels[i].height));
        assert_eq!(&input.read_level(0, i).unwrap(), pixels);
    }
    assert!(input.spec(0, levels.len()).is_none());
    assert!(input.read_level(0, levels.len()).is_err());
}

#[test]
fn levels_of_wrong_sizes_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.exr");
    let first = ImageSpec::new(8, 8, 1, PixelType::Half).tiled(8, 8);
    let create = || ExrFormat.create(&path, &CreateOptions::new(&first, 4)).unwrap();
    let mut out = create();
    let wrong = ImageSpec::new(3, 4, 1, PixelType::Half).tiled(8, 8);
    assert!(out.next_level(&wrong).unwrap_err().to_string().contains("incomplete"));
    out.write_rows(&Pixels::zeros(PixelType::Half, 64)).unwrap();
    assert!(out.next_level(&wrong).unwrap_err().to_string().contains("needs 4 x 4"));
    assert!(out.close().unwrap_err().to_string().contains("level 1"));
    let flat = ImageSpec::new(8, 8, 1, PixelType::Half);
    assert!(ExrFormat.create(&path, &CreateOptions::new(&flat, 4)).is_err());
    let bytes = ImageSpec::new(8, 8, 1, PixelType::U8);
    let refused = ExrFormat.create(&path, &CreateOptions::new(&bytes, 1));
    assert!(matches!(refused, Err(ImageError::Unsupported { .. })));
    drop(create());
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
}

#[test]
fn lossy_compressions_stay_within_their_tolerance() {
    let dir = tempfile::tempdir().unwrap();
    for (compression, tolerance) in
        [("pxr24", 1e-4), ("b44", 0.05), ("b44a", 0.05), ("dwaa", 0.05), ("dwab:30", 0.05)]
    {
        for tile in [0, 64] {
            let path = dir.path().join("a.exr");
            let mut spec = ImageSpec::new(100, 90, 3, PixelType::Half);
            (spec.tile_width, spec.tile_height) = (tile, tile);
            string(&mut spec.attributes, "compression", compression);
            let smooth = |i: usize| 1.0 + (i / 3 % 100) as f32 * 0.01 + (i / 300) as f32 * 0.005;
            let pixels = Pixels::Half((0..27000).map(|i| f16::from_f32(smooth(i))).collect());
            let mut out = ExrFormat.create(&path, &CreateOptions::new(&spec, 1)).unwrap();
            out.write_rows(&pixels).unwrap();
            out.close().unwrap();
            let input = ExrFormat.open(&path, &Limits::default()).unwrap();
            assert_eq!(input.spec(0, 0).unwrap().string("compression"), Some(compression));
            let got = input.read_level(0, 0).unwrap();
            for i in 0..27000 {
                let d = (got.get(i) - pixels.get(i)).abs();
                assert!(d <= tolerance, "{compression} {tile}: value {i} is off by {d}");
            }
        }
    }
}

#[test]
fn windows_channel_names_and_attributes_survive_write_and_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.exr");
    let matrix: Vec<f32> = (0..16).map(|i| i as f32 * 0.5 - 3.0).collect();
    let mut spec = ImageSpec::new(10, 8, 4, PixelType::Float);
    (spec.x, spec.y, spec.full_x, spec.full_y) = (-3, 5, -20, -10);
    (spec.full_width, spec.full_height) = (640, 480);
    spec.channels = ["Z", "diffuse.R", "A", "any \u{e9} name"].map(str::to_owned).to_vec();
    for name in ["ImageDescription", "DocumentName", "Artist", "owner", "software"] {
        string(&mut spec.attributes, name, &format!("the {name} \u{e9}"));
    }
    string(&mut spec.attributes, "wrapmodes", "clamp,black");
    string(&mut spec.attributes, "textureformat", "LatLong Environment");
    spec.attributes.set(Param::declared("matrix worldtocamera", &matrix[..]).unwrap());
    spec.attributes.set(Param::declared("matrix worldtoscreen", &matrix[..]).unwrap());
    spec.attributes.set(Param::declared("float fovcot", 1.25).unwrap());
    let all = write(&path, &[spec.clone()], 8);
    let input = ExrFormat.open(&path, &Limits::default()).unwrap();
    let got = input.spec(0, 0).unwrap();
    for p in &spec.attributes {
        assert_eq!(got.attributes.get(&p.name), Some(p));
    }
    assert_eq!(got.channels, spec.channels);
    assert_eq!((got.x, got.y, got.full_x, got.full_y), (-3, 5, -20, -10));
    assert_eq!((got.full_width, got.full_height), (640, 480));
    assert_eq!(got.string("copyright"), got.string("owner"));
    assert_eq!(input.read_level(0, 0).unwrap(), all[0]);
}

#[test]
fn the_same_image_gives_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let (a, b) = (dir.path().join("a.exr"), dir.path().join("b.exr"));
    let mut levels = pyramid(64, 64, 3, PixelType::Float, 16);
    for name in ["one", "two", "three", "four"] {
        string(&mut levels[0].attributes, name, name);
    }
    write(&a, &levels, 1);
    write(&b, &levels, 16);
    assert!(std::fs::read(a).unwrap() == std::fs::read(b).unwrap());
}

#[test]
fn reading_one_tile_reads_few_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.exr");
    let mut levels = pyramid(512, 512, 3, PixelType::Half, 64);
    string(&mut levels[0].attributes, "compression", "none");
    write(&path, &levels, 64);
    let input = ExrFormat.open(&path, &Limits::default()).unwrap();
    let opened = input.bytes_read();
    assert!(opened <= 4096, "opening read {opened} bytes");
    input.read_tile(0, 0, 5, 3).unwrap();
    let tiles = 64 + 16 + 4 + 7;
    let tile = 20 + 64 * 64 * 6;
    assert_eq!(input.bytes_read() - opened, 8 * tiles + tile);
    let before = input.bytes_read();
    input.read_tile(0, 1, 1, 2).unwrap();
    assert_eq!(input.bytes_read() - before, tile);
}

#[test]
fn files_of_other_writers_are_read() {
    // The file has parts of different types, as the crate's own writer makes them.
    use exr::prelude::*;
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("parts.exr");
    let layer = |name: &str, offset: f32| {
        Layer::new(
            (20, 10),
            LayerAttributes::named(name),
            Encoding::SMALL_LOSSLESS,
            AnyChannels::sort(SmallVec::from_vec(vec![
                AnyChannel::new(
                    "R",
                    FlatSamples::F16((0..200).map(|i| exr::prelude::f16::from_f32(i as f32)).collect()),
                ),
                AnyChannel::new("id", FlatSamples::U32((0..200).collect())),
                AnyChannel::new("Z", FlatSamples::F32((0..200).map(|i| i as f32 + offset).collect())),
            ])),
        )
    };
    let image = Image::from_layers(
        ImageAttributes::new(IntegerBounds::from_dimensions((20, 10))),
        smallvec_of(vec![layer("one", 0.25), layer("two", 0.5)]),
    );
    image.write().to_file(&path).unwrap();
    let input = ExrFormat.open(&path, &Limits::default()).unwrap();
    assert_eq!(input.images(), 2);
    for (part, name, offset) in [(0, "one", 0.25), (1, "two", 0.5)] {
        let spec = input.spec(part, 0).unwrap();
        assert_eq!(spec.string("name"), Some(name));
        assert_eq!(spec.channels, ["R", "Z", "id"]);
        assert_eq!(spec.pixel_type, PixelType::Float);
        let got = input.read_level(part, 0).unwrap();
        for i in 0..200 {
            let pixel = [got.get(i * 3), got.get(i * 3 + 1), got.get(i * 3 + 2)];
            assert_eq!(pixel, [i as f32, i as f32 + offset, i as f32]);
        }
    }
}

fn smallvec_of<T>(list: Vec<T>) -> exr::prelude::SmallVec<[T; 2]> {
    exr::prelude::SmallVec::from_vec(list)
}

#[test]
fn exrheader_reads_our_files() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.exr");
    write(&path, &pyramid(100, 60, 4, PixelType::Half, 64), 60);
    if !granita_needs::has("exrheader") {
        return;
    }
    let run = std::process::Command::new("exrheader").arg(&path).output().unwrap();
    let text = String::from_utf8_lossy(&run.stdout);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    for line in ["dataWindow (type box2i): (0 0) - (99 59)", "mip-map", "tile size 64 by 64 pixels"] {
        assert!(text.contains(line), "{text}");
    }
}

/// The shape of the pixels is stored in the attribute of the format.
#[test]
fn the_pixel_aspect_ratio_survives_write_and_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.exr");
    let mut spec = ImageSpec::new(4, 3, 3, PixelType::Half);
    write(&path, &[spec.clone()], 3);
    let stored = |path: &Path| {
        // The attribute is "pixelAspectRatio", a float of four bytes.
        let bytes = std::fs::read(path).unwrap();
        let name = b"pixelAspectRatio\0float\0\x04\0\0\0";
        let at = bytes.windows(name.len()).position(|w| w == name).unwrap() + name.len();
        f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
    };
    assert_eq!(stored(&path), 1.0);
    spec.attributes.set(Param::declared("float pixelaspect", 1.5).unwrap());
    write(&path, &[spec], 3);
    assert_eq!(stored(&path), 1.5);
}
