//! Data about textures, single texels, and files that are read again.
#![allow(clippy::unwrap_used, reason = "tests")]

mod support;

use granita_image::{ImageSpec, PixelType};
use granita_texture::make::{MakeOptions, Mode};
use granita_texture::{CacheOptions, Lookup, Square, TextureKind, Up, Wrap};
use support::{Folder, at, value};

#[test]
fn textures_are_described() {
    let folder = Folder::new();
    folder.image_of("a.tif", ImageSpec::new(128, 64, 2, PixelType::U8), |x, _, c| {
        if c == 0 { f32::from(u8::try_from(x).unwrap()) / 255.0 } else { 0.2 }
    });
    let options = MakeOptions { swrap: Wrap::Mirror, twrap: Wrap::Clamp, ..MakeOptions::default() };
    folder.make(&["a.tif"], "a.tx", &options).unwrap();
    let (cache, id) = folder.open("a.tx");
    let about = cache.describe(id);
    assert_eq!(
        (about.path, about.kind, about.pixel_type),
        (folder.path("a.tx"), TextureKind::Plain, PixelType::U8)
    );
    assert_eq!((about.channels, about.levels.len(), about.levels[1]), (2, 8, [64, 32]));
    assert_eq!((about.face, about.tile), ([128, 64], Some([64, 64])));
    assert_eq!((about.swrap, about.twrap, about.squares), (Wrap::Mirror, Wrap::Clamp, Vec::new()));
    assert_eq!((about.world_to_camera, about.world_to_screen), (None, None));
    assert_eq!(cache.spec(id).unwrap().string("wrapmodes"), Some("mirror,clamp"));
    let mean = cache.mean(id).unwrap();
    assert!((mean[0] - 63.5 / 255.0).abs() < 1.5 / 255.0 && (mean[1] - 0.2).abs() < 1e-6, "{mean:?}");
    // The same image has no tiles.
    let id = cache.find("a.tif").unwrap();
    let about = cache.describe(id);
    assert_eq!((about.tile, about.levels.len()), (None, 8));
    assert!((cache.mean(id).unwrap()[1] - 0.2).abs() < 1e-6);
    // A panorama has the orientation of its format.
    let options = MakeOptions { mode: Mode::EnvLatLong, format: "OpenEXR".into(), ..MakeOptions::default() };
    folder.image("b.exr", (64, 32), 1, |_, _, _| 0.5);
    folder.make(&["b.exr"], "b.env", &options).unwrap();
    let id = cache.find("b.env").unwrap();
    let about = cache.describe(id);
    assert_eq!((about.kind, about.up), (TextureKind::LatLongEnvironment, Up::Y));
    assert_eq!(cache.mean(id), Some(vec![0.5]));
    assert!(folder.messages.lock().iter().all(|m| !m.text.contains("b.env")));
}

#[test]
fn names_that_cannot_be_used_have_a_reason_and_no_message() {
    let folder = Folder::new();
    std::fs::write(folder.path("text.tx"), "no image").unwrap();
    let cache = folder.cache(CacheOptions::default());
    for _ in 0..2 {
        assert!(cache.try_find("none.tx").unwrap_err().starts_with("texture \"none.tx\" not found"));
        assert!(cache.try_find("text.tx").unwrap_err().contains("text.tx: malformed TIFF"));
    }
    assert!(folder.messages.lock().is_empty());
    // A lookup without a file still reports it.
    assert_eq!(cache.find("none.tx"), None);
    assert_eq!(folder.messages.lock().len(), 1);
}

#[test]
fn texels_are_read_by_level_and_place() {
    let folder = Folder::new();
    folder.image("a.tif", (100, 80), 6, |x, y, c| (x + 100 * y + 10_000 * c as u32) as f32);
    folder.make(&["a.tif"], "a.tx", &MakeOptions { resize: false, ..MakeOptions::default() }).unwrap();
    let (cache, id) = folder.open("a.tx");
    let mut reader = cache.reader();
    let mut out = [0.0; 6];
    assert!(reader.texel(id, (0, 70, 66), 1, -1.0, &mut out));
    assert_eq!(out, [16_670.0, 26_670.0, 36_670.0, 46_670.0, 56_670.0, -1.0]);
    assert!(reader.texel(id, (1, 0, 0), 0, 0.0, &mut out[..1]));
    assert_eq!(out[0], 50.5);
    for place in [(0, 100, 0), (0, 0, 80), (7, 0, 0), (usize::MAX, 0, 0)] {
        assert!(!reader.texel(id, place, 0, 7.0, &mut out));
        assert_eq!(out, [7.0; 6]);
    }
}

#[test]
fn the_nearest_texel_follows_wrap_modes_and_sets() {
    let folder = Folder::new();
    for (name, add) in [("a.1001", 0), ("a.1012", 1000)] {
        folder.image(&format!("{name}.tif"), (64, 64), 1, |x, y, _| (add + x + 64 * y) as f32);
        folder.make(&[&format!("{name}.tif")], &format!("{name}.tx"), &MakeOptions::default()).unwrap();
    }
    let (cache, id) = folder.open("a.1001.tx");
    let nearest = |id, q: Lookup| {
        let mut out = [0.0];
        cache.reader().nearest(id, &q, &mut out);
        out[0]
    };
    let point =
        |s: f32, t: f32| Lookup { s: s / 64.0, t: t / 64.0, dsdx: 1.0, sblur: 1.0, ..Lookup::default() };
    assert_eq!(nearest(id, point(3.9, 2.1)), 131.0);
    assert_eq!(nearest(id, point(64.1, 2.1)), 0.0);
    let periodic = Some(Wrap::Periodic);
    assert_eq!(nearest(id, Lookup { swrap: periodic, ..point(65.5, 2.1) }), 129.0);
    assert_eq!(nearest(id, Lookup { swrap: Some(Wrap::Clamp), ..point(-5.0, 2.1) }), 128.0);
    assert_eq!(nearest(id, Lookup { swrap: Some(Wrap::Mirror), ..point(-0.5, 2.1) }), 128.0);
    assert_eq!(nearest(id, point(f32::NAN, 2.1)), 0.0);
    assert_eq!(nearest(id, Lookup { first_channel: 1, fill: 9.0, ..point(1.0, 1.0) }), 9.0);
    let set = cache.find("a.<UDIM>.tx").unwrap();
    let square = |column, row| Square { column, row };
    assert_eq!(cache.describe(set).squares, [square(0, 0), square(1, 1)]);
    assert_eq!(nearest(set, point(3.9, 2.1)), 131.0);
    assert_eq!(nearest(set, point(64.0 + 3.9, 2.1 - 64.0)), 1131.0);
    assert_eq!(nearest(set, point(64.0 + 3.9, 2.1)), 0.0);
    assert_eq!(
        folder.messages.lock().iter().filter(|m| m.text.contains("has no file for column 1")).count(),
        1
    );
}

/// A cache reads changed files after they are invalidated, also those of sets and those that did not exist.
#[test]
fn changed_files_are_read_again() {
    let folder = Folder::new();
    let write = |name: &str, size: u32, value: f32| {
        folder.image("a.tif", (size, size), 1, |_, _, _| value);
        folder.make(&["a.tif"], name, &MakeOptions::default()).unwrap();
    };
    write("a.1001.tx", 64, 0.25);
    folder.image("b.tif", (30, 20), 1, |_, _, _| 0.5);
    let mut cache = folder.cache(CacheOptions::default());
    let look = |cache: &granita_texture::TextureCache, name: &str, s: f32| {
        cache.try_find(name).map(|id| value(cache, id, &Lookup { s, t: 0.5, ..Lookup::default() }))
    };
    assert_eq!(look(&cache, "a.1001.tx", 0.5), Ok(0.25));
    assert_eq!(look(&cache, "a.<UDIM>.tx", 0.5), Ok(0.25));
    assert_eq!(look(&cache, "b.tif", 0.5), Ok(0.5));
    assert!(look(&cache, "c.tx", 0.5).is_err());
    let (old, old_b) = (cache.find("a.1001.tx").unwrap(), cache.find("b.tif").unwrap());
    write("a.1001.tx", 128, 0.75);
    write("a.1002.tx", 64, 1.0);
    write("c.tx", 64, 0.125);
    folder.image("b.tif", (7, 9), 1, |_, _, _| 1.5);
    assert_eq!(look(&cache, "a.1001.tx", 0.5), Ok(0.25));
    assert!(look(&cache, "c.tx", 0.5).is_err());
    cache.invalidate("a.<UDIM>.tx");
    assert_eq!(look(&cache, "a.<UDIM>.tx", 0.5), Ok(0.75));
    assert_eq!(look(&cache, "a.<UDIM>.tx", 1.5), Ok(1.0));
    assert!(look(&cache, "c.tx", 0.5).is_err());
    cache.invalidate("c.tx");
    assert_eq!(look(&cache, "c.tx", 0.5), Ok(0.125));
    cache.invalidate("b.tif");
    assert_eq!(look(&cache, "b.tif", 0.5), Ok(1.5));
    cache.invalidate_all();
    assert_eq!(look(&cache, "a.1001.tx", 0.5), Ok(0.75));
    // What was found before is black, and never a mixture of two files.
    for id in [old, old_b] {
        assert_eq!(value(&cache, id, &at(0.5, 0.5)), 0.0);
        assert_eq!(value(&cache, id, &Lookup { dsdx: 0.3, dtdy: 0.3, ..at(0.5, 0.5) }), 0.0);
    }
    cache.invalidate("none of these");
    std::fs::remove_file(folder.path("c.tx")).unwrap();
    cache.invalidate_all();
    assert!(look(&cache, "c.tx", 0.5).is_err());
    assert_eq!(cache.find("c.tx"), None);
    cache.invalidate("c.tx");
}
