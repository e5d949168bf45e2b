//! Answers do not depend on memory, files, threads or order.
#![allow(clippy::unwrap_used, reason = "tests")]

mod support;

use granita_texture::make::MakeOptions;
use granita_texture::{CacheOptions, Lookup, TextureCache, Wrap};
use support::{Folder, bits, random};

const FILES: u32 = 5;

fn folder() -> Folder {
    let folder = Folder::new();
    for i in 0..FILES {
        folder.picture("n.tif", (200 + i, 150), 3, |x, y, c| random(x + 1000 * y, c as u32 + 10 * i));
        let o = MakeOptions { swrap: Wrap::Periodic, resize: i % 2 == 0, ..MakeOptions::default() };
        folder.make(&["n.tif"], &format!("{i}.tx"), &o).unwrap();
    }
    folder
}

fn lookup(i: u32) -> Lookup {
    let r = |k| random(i, k);
    let scale = 0.5_f32.powf(10.0 * r(2));
    Lookup {
        s: r(0),
        t: r(1),
        dsdx: (r(3) - 0.5) * scale,
        dtdx: (r(4) - 0.5) * scale,
        dsdy: (r(5) - 0.5) * scale,
        dtdy: (r(6) - 0.5) * scale,
        ..Lookup::default()
    }
}

fn answer(cache: &TextureCache, i: u32) -> Vec<u32> {
    let id = cache.find(&format!("{}.tx", i % FILES)).unwrap();
    let mut out = [0.0; 4];
    cache.texture(id, &lookup(i), &mut out);
    bits(&out)
}

const N: u32 = 2000;

#[test]
fn memory_and_file_bounds_change_nothing() {
    let folder = folder();
    let all = folder.cache(CacheOptions { memory_bytes: 1 << 30, ..CacheOptions::default() });
    let expected: Vec<_> = (0..N).map(|i| answer(&all, i)).collect();
    let tile = 64 * 64 * 3 * 4;
    for memory_bytes in [0, tile, 3 * tile + 5, 40 * tile] {
        for max_files in [1, 3] {
            let cache = folder.cache(CacheOptions { memory_bytes, max_files, ..CacheOptions::default() });
            // Backwards: the order does not matter either.
            for i in (0..N / 10).rev() {
                assert_eq!(answer(&cache, i), expected[i as usize], "{memory_bytes} {max_files} {i}");
            }
            let s = cache.statistics();
            assert!(s.peak_bytes <= memory_bytes, "{s:?}");
            assert!(s.peak_files_open <= max_files as u64, "{s:?}");
            assert!(s.tiles_read >= all.statistics().tiles_read.min(100));
        }
    }
}

#[test]
fn many_threads_are_one() {
    let folder = folder();
    let one = folder.cache(CacheOptions::default());
    let expected: Vec<_> = (0..N).map(|i| answer(&one, i)).collect();
    for memory_bytes in [64 * 64 * 3 * 4 * 4, 1 << 30] {
        let many = folder.cache(CacheOptions { memory_bytes, max_files: 2, ..CacheOptions::default() });
        std::thread::scope(|scope| {
            for thread in 0..8 {
                let (many, expected) = (&many, &expected);
                scope.spawn(move || {
                    for k in 0..N / 4 {
                        let i = (k * 7 + thread * 31) % N;
                        assert_eq!(answer(many, i), expected[i as usize]);
                    }
                });
            }
        });
        let s = many.statistics();
        assert!(s.peak_bytes <= memory_bytes && s.peak_files_open <= 2, "{s:?}");
    }
}

#[test]
fn only_tiles_that_are_looked_at_are_read() {
    let folder = Folder::new();
    folder.picture("big.tif", (512, 512), 1, |x, _, _| x as f32);
    folder.make(&["big.tif"], "big.tx", &MakeOptions::default()).unwrap();
    let (cache, id) = folder.open("big.tx");
    assert_eq!(cache.statistics().tiles_read, 0);
    let mut out = [0.0];
    cache.texture(id, &support::at(100.5 / 512.0, 100.5 / 512.0), &mut out);
    assert_eq!(out[0], 100.0);
    let s = cache.statistics();
    assert_eq!((s.tiles_read, s.tile_bytes, s.files, s.files_opened), (1, 64 * 64 * 4, 1, 1));
}

#[test]
fn a_damaged_tile_is_black_and_said_once() {
    let folder = Folder::new();
    folder.picture("d.tif", (128, 128), 1, |x, y, _| random(x, y));
    folder.make(&["d.tif"], "d.tx", &MakeOptions::default()).unwrap();
    let path = folder.path("d.tx");
    let mut bytes = std::fs::read(&path).unwrap();
    // The tiles stand before the directories.
    let end = bytes.len() / 2;
    bytes[64..end].fill(0xff);
    std::fs::write(&path, bytes).unwrap();
    let (cache, id) = folder.open("d.tx");
    let mut out = [1.0];
    for _ in 0..2 {
        cache.texture(id, &support::at(0.2, 0.2), &mut out);
        assert!(out[0].is_finite());
    }
    let errors = folder.texts().into_iter().filter(|t| t.contains("cannot be read")).count();
    assert_eq!(errors, 1, "{:?}", folder.texts());
}

#[test]
fn information() {
    let folder = Folder::new();
    folder.picture("i.tif", (64, 32), 3, |_, _, _| 0.5);
    folder.make(&["i.tif"], "i.tx", &MakeOptions::default()).unwrap();
    let (cache, _) = folder.open("i.tx");
    let floats = |what| cache.info("i.tx", what).and_then(|p| p.data.to_floats()).map(|v| v.to_vec());
    assert_eq!(floats("resolution"), Some(vec![64.0, 32.0]));
    assert_eq!(floats("channels"), Some(vec![3.0]));
    assert_eq!(cache.info("i.tx", "type").unwrap().data, "texture".into());
    assert_eq!(cache.info("i.tx", "textureformat").unwrap().data, "Plain Texture".into());
    assert!(cache.info("i.tx", "viewingmatrix").is_none());
    assert!(cache.info("i.tx", "colour").is_none());
    assert!(cache.info("no.tx", "type").is_none());
}
