//! Written files are read back unchanged: every type, size, tile size, compression and planar configuration.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use granita_base::{Param, Params};
use granita_image::{CreateOptions, Format, ImageSpec, Limits, PixelType, Pixels};
use granita_tiff::{ShadowFormat, TiffFormat};
use half::f16;
use proptest::prelude::*;
use std::path::Path;

const TYPES: [PixelType; 5] =
    [PixelType::U8, PixelType::U16, PixelType::U32, PixelType::Half, PixelType::Float];

/// Returns pixels of every bit pattern, the same for the same seed. NaN is excluded, because it does not compare equal.
fn noise(pixel_type: PixelType, n: usize, seed: u32) -> Pixels {
    let word = |i: usize| granita_base::hash::words(&[seed, (i / 3) as u32]);
    let finite = |bits: u32| if f32::from_bits(bits).is_nan() { 1.5 } else { f32::from_bits(bits) };
    let finite_half = |bits: u16| if f16::from_bits(bits).is_nan() { f16::ONE } else { f16::from_bits(bits) };
    match pixel_type {
        PixelType::U8 => Pixels::U8((0..n).map(|i| word(i) as u8).collect()),
        PixelType::U16 => Pixels::U16((0..n).map(|i| word(i) as u16).collect()),
        PixelType::U32 => Pixels::U32((0..n).map(word).collect()),
        PixelType::Half => Pixels::Half((0..n).map(|i| finite_half(word(i) as u16)).collect()),
        PixelType::Float => Pixels::Float((0..n).map(|i| finite(word(i))).collect()),
    }
}

fn string(params: &mut Params, name: &str, value: &str) {
    params.set(Param::declared(&format!("string {name}"), value).unwrap());
}

fn values(spec: &ImageSpec) -> usize {
    spec.width as usize * spec.height as usize * spec.nchannels()
}

fn write(path: &Path, levels: &[ImageSpec], rows_at_once: u32) -> Vec<Pixels> {
    let mut out = TiffFormat.create(path, &CreateOptions::new(&levels[0], levels.len())).unwrap();
    let mut all = Vec::new();
    for (i, spec) in levels.iter().enumerate() {
        if i > 0 {
            out.next_level(spec).unwrap();
        }
        let pixels = noise(spec.pixel_type, values(spec), i as u32);
        let row = spec.width as usize * spec.nchannels();
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
    #![proptest_config(ProptestConfig::with_cases(300))]
    #[test]
    fn images_survive_write_and_read(
        (width, height, channels) in (1u32..70, 1u32..70, 1usize..7),
        pixel_type in prop::sample::select(&TYPES[..]),
        tile in prop::sample::select(vec![0u32, 8, 16, 48, 64]),
        compression in prop::sample::select(vec!["none", "lzw", "zip", "deflate", "packbits", "zip:1", "deflate:12"]),
        (separate, big) in any::<(bool, bool)>(),
        (rows_per_strip, rows_at_once) in (1i32..80, 1u32..80),
    ) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.tif");
        let mut spec = ImageSpec::new(width, height, channels, pixel_type);
        (spec.tile_width, spec.tile_height) = (tile, tile);
        string(&mut spec.attributes, "compression", compression);
        string(&mut spec.attributes, "planarconfig", if separate { "separate" } else { "contig" });
        spec.attributes.set(Param::declared("int rowsperstrip", rows_per_strip).unwrap());
        spec.attributes.set(Param::declared("int bigtiff", i32::from(big)).unwrap());
        let all = write(&path, &[spec.clone()], rows_at_once);
        let input = TiffFormat.open(&path, &Limits::default()).unwrap();
        prop_assert_eq!((input.images(), input.levels(0)), (1, 1));
        prop_assert_eq!(std::fs::read(&path).unwrap()[2], if big { 43 } else { 42 });
        let got = input.spec(0, 0).unwrap();
        prop_assert_eq!(&got.channels, &spec.channels);
        prop_assert_eq!(got.pixel_type, pixel_type);
        prop_assert_eq!((got.width, got.height, got.tile_width, got.tile_height), (width, height, tile, tile));
        prop_assert_eq!((got.full_width, got.full_height, got.x, got.y), (width, height, 0, 0));
        prop_assert_eq!(input.read_level(0, 0).unwrap(), all[0].clone());
        // Any range of rows can be read.
        let (y0, y1) = (height / 3, height - height / 4);
        let rows = input.read_rows(0, 0, y0, y1).unwrap();
        let row = width as usize * channels;
        let mut expected = Pixels::zeros(pixel_type, (y1 - y0) as usize * row);
        let n = expected.len();
        expected.copy_from(0, &all[0], y0 as usize * row, n);
        prop_assert_eq!(rows, expected);
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

fn pyramid(side: u32, channels: usize, pixel_type: PixelType, tile: u32) -> Vec<ImageSpec> {
    let mut levels = Vec::new();
    let mut side = side;
    loop {
        let mut spec = ImageSpec::new(side, side.div_ceil(2), channels, pixel_type).tiled(tile, tile);
        string(&mut spec.attributes, "textureformat", "Plain Texture");
        string(&mut spec.attributes, "wrapmodes", "periodic,clamp");
        levels.push(spec);
        if side == 1 {
            return levels;
        }
        side /= 2;
    }
}

#[test]
fn mip_levels_and_their_tags_survive_write_and_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tx");
    let levels = pyramid(300, 4, PixelType::Half, 32);
    let all = write(&path, &levels, 7);
    let input = TiffFormat.open(&path, &Limits::default()).unwrap();
    assert_eq!((input.images(), input.levels(0)), (1, levels.len()));
    for (i, pixels) in all.iter().enumerate() {
        let spec = input.spec(0, i).unwrap();
        assert_eq!((spec.width, spec.height), (levels[i].width, levels[i].height));
        assert_eq!(spec.string("textureformat"), Some("Plain Texture"));
        assert_eq!(spec.string("wrapmodes"), Some("periodic,clamp"));
        assert_eq!(spec.string("software"), Some(&*format!("Granita {}", granita_base::VERSION)));
        assert_eq!(&input.read_level(0, i).unwrap(), pixels);
    }
    assert!(input.spec(0, levels.len()).is_none());
    assert!(input.read_level(0, levels.len()).is_err());
}

#[test]
fn reading_one_tile_reads_few_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tx");
    let mut levels = pyramid(1024, 3, PixelType::U8, 64);
    string(&mut levels[0].attributes, "compression", "none");
    write(&path, &levels, 64);
    let size = std::fs::metadata(&path).unwrap().len();
    let input = TiffFormat.open(&path, &Limits::default()).unwrap();
    let opened = input.bytes_read();
    assert!(opened < 11 * 700, "opening read {opened} of {size} bytes");
    input.read_tile(0, 0, 5, 3).unwrap();
    let table = 2 * 4 * 16 * 8;
    assert_eq!(input.bytes_read() - opened, 64 * 64 * 3 + table);
    let before = input.bytes_read();
    input.read_tile(0, 0, 6, 3).unwrap();
    assert_eq!(input.bytes_read() - before, 64 * 64 * 3);
    // A strip is read once for all its rows.
    let mut spec = ImageSpec::new(64, 64, 1, PixelType::U8);
    string(&mut spec.attributes, "compression", "none");
    write(&path, &[spec], 64);
    let input = TiffFormat.open(&path, &Limits::default()).unwrap();
    let opened = input.bytes_read();
    for y in 0..32 {
        input.read_rows(0, 0, y, y + 1).unwrap();
    }
    assert_eq!(input.bytes_read() - opened, 64 * 32 + 2 * 4 * 2);
}

#[test]
fn tiles_are_written_in_any_order_but_only_once() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    let spec = ImageSpec::new(40, 40, 1, PixelType::Float).tiled(16, 16);
    let mut out = TiffFormat.create(&path, &CreateOptions::new(&spec, 1)).unwrap();
    let tile = |tx: u32, ty: u32| Pixels::Float(vec![(tx + 10 * ty) as f32; 256]);
    for i in (0..9).rev() {
        out.write_tile(i % 3, i / 3, &tile(i % 3, i / 3)).unwrap();
    }
    assert!(out.write_tile(0, 0, &tile(0, 0)).unwrap_err().to_string().contains("twice"));
    assert!(out.write_tile(3, 0, &tile(0, 0)).is_err());
    assert!(out.write_tile(0, 0, &Pixels::U8(vec![0; 256])).unwrap_err().to_string().contains("U8"));
    out.close().unwrap();
    let input = TiffFormat.open(&path, &Limits::default()).unwrap();
    for i in 0..9 {
        assert_eq!(input.read_tile(0, 0, i % 3, i / 3).unwrap(), tile(i % 3, i / 3));
    }
}

#[test]
fn no_file_appears_before_all_rows_are_written() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    std::fs::write(&path, "old").unwrap();
    let spec = ImageSpec::new(4, 4, 1, PixelType::U8);
    let options = CreateOptions::new(&spec, 1);
    let mut out = TiffFormat.create(&path, &options).unwrap();
    out.write_rows(&Pixels::U8(vec![1; 12])).unwrap();
    assert!(out.write_rows(&Pixels::U8(vec![1; 8])).is_err());
    assert!(out.write_rows(&Pixels::U8(vec![1; 3])).is_err());
    let error = out.close().unwrap_err().to_string();
    assert!(error.contains("a.tif") && error.contains("incomplete"), "{error}");
    drop(TiffFormat.create(&path, &options).unwrap());
    assert_eq!(std::fs::read(&path).unwrap(), b"old");
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
}

#[test]
fn the_same_image_gives_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let (a, b) = (dir.path().join("a.tif"), dir.path().join("b.tif"));
    let levels = pyramid(64, 3, PixelType::Float, 16);
    write(&a, &levels, 1);
    write(&b, &levels, 16);
    assert!(std::fs::read(a).unwrap() == std::fs::read(b).unwrap());
}

#[test]
fn metadata_windows_and_matrices_survive_write_and_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    let matrix: Vec<f32> = (0..16).map(|i| i as f32 * 0.5 - 3.0).collect();
    let mut spec = ImageSpec::new(10, 8, 4, PixelType::U16);
    (spec.x, spec.y, spec.full_width, spec.full_height) = (3, 5, 640, 480);
    for name in ["ImageDescription", "DocumentName", "Artist", "copyright", "software"] {
        string(&mut spec.attributes, name, &format!("the {name} \u{e9}"));
    }
    // Settings of the renderer are in a packet of XMP.
    string(&mut spec.attributes, "granita/camera", "main <&>");
    string(&mut spec.attributes, "granita/filter/N", "closest");
    spec.attributes.set(Param::declared("matrix worldtocamera", &matrix[..]).unwrap());
    spec.attributes.set(Param::declared("float fovcot", 1.25).unwrap());
    spec.attributes.set(Param::declared("int unassociatedalpha", 1).unwrap());
    write(&path, &[spec.clone()], 8);
    let input = TiffFormat.open(&path, &Limits::default()).unwrap();
    let got = input.spec(0, 0).unwrap();
    for p in &spec.attributes {
        assert_eq!(got.attributes.get(&p.name), Some(p));
    }
    assert_eq!((got.x, got.y, got.full_width, got.full_height), (3, 5, 640, 480));
    assert_eq!(got.string("compression"), Some("zip"));
    assert_eq!((got.attributes.get("worldtoscreen"), got.attributes.get("XMP")), (None, None));
}

/// A data window may begin left of and above the display window. Its position is then a signed fraction.
#[test]
fn windows_left_of_and_above_the_display_window_survive() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    for (position, full, expected) in [
        ((-3, -5), (0, 0), (-3, -5)),
        ((-3, 5), (0, 0), (-3, 5)),
        ((i32::MIN, i32::MAX), (0, 0), (i32::MIN, i32::MAX)),
        // TIFF has no other origin than the corner of the display window.
        ((-3, -5), (-10, 4), (7, -9)),
        ((i32::MIN, 0), (100, 0), (i32::MIN, 0)),
    ] {
        let mut spec = ImageSpec::new(10, 8, 3, PixelType::U8);
        (spec.x, spec.y) = position;
        (spec.full_x, spec.full_y, spec.full_width, spec.full_height) = (full.0, full.1, 640, 480);
        write(&path, &[spec], 8);
        let input = TiffFormat.open(&path, &Limits::default()).unwrap();
        let got = input.spec(0, 0).unwrap();
        assert_eq!((got.x, got.y, got.full_x, got.full_y), (expected.0, expected.1, 0, 0));
        assert_eq!((got.full_width, got.full_height), (640, 480));
        let kinds = tags(&std::fs::read(&path).unwrap());
        assert!(kinds.iter().any(|t| t.0 == 286) && kinds.iter().any(|t| t.0 == 287));
    }
}

#[test]
fn shadow_maps_survive_write_and_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.sm");
    let matrix: Vec<f32> = (0..16).map(|i| i as f32).collect();
    let mut spec = ImageSpec::new(70, 50, 1, PixelType::Float);
    spec.attributes.set(Param::declared("matrix worldtocamera", &matrix[..]).unwrap());
    spec.attributes.set(Param::declared("matrix worldtoscreen", &matrix[..]).unwrap());
    let mut out = ShadowFormat.create(&path, &CreateOptions::new(&spec, 1)).unwrap();
    let depth = Pixels::Float((0..3500).map(|i| i as f32).collect());
    out.write_rows(&depth).unwrap();
    out.close().unwrap();
    let input = ShadowFormat.open(&path, &Limits::default()).unwrap();
    let got = input.spec(0, 0).unwrap();
    assert_eq!((got.tile_width, got.tile_height), (64, 64));
    assert_eq!(got.channels, ["Z"]);
    assert_eq!(got.string("textureformat"), Some("Shadow"));
    assert_eq!(got.matrix("worldtoscreen").unwrap()[..], matrix);
    assert_eq!(input.read_level(0, 0).unwrap(), depth);
    spec.pixel_type = PixelType::U8;
    assert!(ShadowFormat.create(&path, &CreateOptions::new(&spec, 1)).is_err());
}

/// Returns the tags of the first directory, each with its number and the bytes of its text or numbers.
fn tags(bytes: &[u8]) -> Vec<(u16, Vec<u8>)> {
    let u16_at = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
    let u32_at = |at: usize| u32::from_le_bytes(*bytes[at..].first_chunk().unwrap()) as usize;
    assert_eq!(&bytes[..4], b"II*\0");
    let directory = u32_at(4);
    (0..usize::from(u16_at(directory)))
        .map(|i| {
            let entry = directory + 2 + 12 * i;
            let size = match u16_at(entry + 2) {
                1 | 2 => 1,
                3 => 2,
                4 | 11 => 4,
                // The values are fractions, unsigned or signed.
                5 | 10 => 8,
                other => panic!("type {other} of tag {}", u16_at(entry)),
            };
            let length = size * u32_at(entry + 4);
            let place = if length <= 4 { entry + 8 } else { u32_at(entry + 8) };
            (u16_at(entry), bytes[place..place + length].to_vec())
        })
        .collect()
}

/// The private tags of reference 9.2, which are read without the tested reader.
#[test]
fn private_tags_have_the_numbers_of_the_reference() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.env");
    let matrix = |k: f32| (0..16).map(|i| i as f32 * k).collect::<Vec<_>>();
    let mut spec = ImageSpec::new(192, 128, 3, PixelType::U8).tiled(64, 64);
    (spec.full_width, spec.full_height) = (50, 40);
    string(&mut spec.attributes, "textureformat", "CubeFace Environment");
    string(&mut spec.attributes, "wrapmodes", "black,mirror");
    spec.attributes.set(Param::declared("matrix worldtoscreen", &matrix(0.5)[..]).unwrap());
    spec.attributes.set(Param::declared("matrix worldtocamera", &matrix(-2.0)[..]).unwrap());
    write(&path, &[spec], 128);
    let found = tags(&std::fs::read(&path).unwrap());
    let of = |tag: u16| {
        let tag = found.iter().find(|t| t.0 == tag).unwrap_or_else(|| panic!("no tag {tag}"));
        tag.1.clone()
    };
    let number = |tag: u16| of(tag).iter().rev().fold(0, |n, byte| n << 8 | u32::from(*byte));
    assert_eq!((number(256), number(257)), (192, 128));
    assert_eq!((number(33300), number(33301)), (50, 40));
    assert_eq!(of(33302), b"CubeFace Environment\0");
    assert_eq!(of(33303), b"black,mirror\0");
    let floats = |tag: u16| {
        of(tag).chunks(4).map(|b| f32::from_le_bytes(*b.first_chunk().unwrap())).collect::<Vec<_>>()
    };
    assert_eq!((floats(33305), floats(33306)), (matrix(0.5), matrix(-2.0)));
}

#[test]
fn pages_are_written_one_after_the_other() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("pages.tif");
    let pages = [ImageSpec::new(5, 4, 3, PixelType::U8), ImageSpec::new(3, 9, 1, PixelType::Float)];
    let pixels = [Pixels::U8((0..60).collect()), Pixels::Float((0..27).map(|i| i as f32).collect())];
    let files = granita_base::Files::default();
    let mut file = TiffFormat.create_images(&path, &pages, &files).unwrap();
    assert!(file.select_image(2).is_err());
    for (page, pixels) in pixels.iter().enumerate() {
        file.select_image(page).unwrap();
        file.write_rows(pixels).unwrap();
    }
    assert!(file.select_image(0).is_err(), "a page is not written again");
    file.close().unwrap();
    let input = TiffFormat.open(&path, &Limits::default()).unwrap();
    assert_eq!((input.images(), input.levels(0)), (2, 1));
    for (page, pixels) in pixels.iter().enumerate() {
        assert_eq!(input.read_level(page, 0).unwrap(), *pixels);
    }
    let mut file = TiffFormat.create_images(&path, &pages, &files).unwrap();
    file.write_rows(&pixels[0]).unwrap();
    assert!(file.close().is_err(), "a page is missing");
}
