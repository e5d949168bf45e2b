//! Tests that tiles of all levels in any order give the same image as levels one after the other, in every format for
//! textures.
#![allow(clippy::unwrap_used, reason = "tests")]

use granita_image::{CreateOptions, ImageSpec, Limits, PixelType, Pixels};
use granita_plugin::bundled_formats;

/// The formats with tiles and levels.
const FORMATS: [&str; 2] = ["tiff", "OpenEXR"];

fn tile(level: usize, tx: u32, ty: u32) -> Pixels {
    Pixels::Float((0..256).map(|i| (i + 1000 * level) as f32 + tx as f32 * 0.25 + ty as f32 * 0.5).collect())
}

#[test]
fn tiles_of_levels_are_written_in_any_order() {
    FORMATS.into_iter().for_each(in_any_order);
}

fn in_any_order(format: &str) {
    let registry = bundled_formats(Limits::default());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    let specs: Vec<ImageSpec> = (0..7)
        .map(|level| ImageSpec::new(64 >> level, (40 >> level).max(1), 1, PixelType::Float).tiled(16, 16))
        .collect();
    let options = CreateOptions::new(&specs[0], specs.len());
    let mut out = registry.create(&path, format, &options).unwrap();
    assert!(out.select_level(1).is_err(), "nothing is planned yet");
    assert!(out.plan_levels(&specs[1..]).unwrap());
    assert!(out.next_level(&specs[1]).is_err());
    assert!(out.select_level(7).is_err());
    let mut all = Vec::new();
    for (level, spec) in specs.iter().enumerate() {
        let (across, down) = spec.tiles();
        all.extend((0..across * down).map(|i| (level, i % across, i / across)));
    }
    // The order is neither that of levels nor that of positions.
    all.sort_by_key(|(level, tx, ty)| (tx + ty * 7 + 3 * *level as u32) % 5);
    for &(level, tx, ty) in &all {
        out.select_level(level).unwrap();
        out.write_tile(tx, ty, &tile(level, tx, ty)).unwrap();
    }
    out.close().unwrap();
    let file = registry.open(&path).unwrap();
    assert_eq!(file.levels(0), 7, "{format}");
    for (level, tx, ty) in all {
        let s = file.spec(0, level).unwrap();
        assert_eq!((s.width, s.height), (specs[level].width, specs[level].height));
        let (got, wanted) = (file.read_tile(0, level, tx, ty).unwrap(), tile(level, tx, ty));
        for i in 0..256 {
            let inside = tx * 16 + i % 16 < s.width && ty * 16 + i / 16 < s.height;
            assert!(
                !inside || got.get(i as usize) == wanted.get(i as usize),
                "{format} {level} {tx} {ty} {i}"
            );
        }
    }
}

#[test]
fn a_missing_tile_of_any_level_is_an_error() {
    FORMATS.into_iter().for_each(missing_tile);
}

fn missing_tile(format: &str) {
    let registry = bundled_formats(Limits::default());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    let spec = |n: u32| ImageSpec::new(n, n, 1, PixelType::Float).tiled(16, 16);
    let first = spec(2);
    let mut out = registry.create(&path, format, &CreateOptions::new(&first, 2)).unwrap();
    assert!(out.plan_levels(&[spec(1)]).unwrap());
    out.select_level(1).unwrap();
    out.write_tile(0, 0, &tile(1, 0, 0)).unwrap();
    assert!(out.close().unwrap_err().to_string().contains("level 0 is incomplete"));
    assert!(!path.exists());
}
