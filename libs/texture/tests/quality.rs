//! Compares filtering with brute force.
#![allow(clippy::unwrap_used, reason = "tests")]

mod brute;
mod support;

use brute::{Brute, footprint};
use granita_image::{FormatRegistry, Limits};
use granita_texture::make::{MakeOptions, make};
use granita_texture::{CacheOptions, Lookup, Wrap};
use support::{Folder, random, wide};

fn repeating() -> MakeOptions {
    MakeOptions { swrap: Wrap::Periodic, twrap: Wrap::Periodic, ..MakeOptions::default() }
}

/// The error is less than one code value of 255 on a photograph of bricks, with footprints of all directions and ratios
/// up to 64 : 1.
#[test]
fn filtering_a_photograph_equals_brute_force() {
    let folder = Folder::new();
    let photo = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/first/brick.png");
    let formats: FormatRegistry = granita_plugin::bundled_formats(Limits::default());
    make(&[photo.into()], &folder.path("b.tx"), &repeating(), &formats, &|_, _| ()).unwrap();
    let (cache, id) = folder.open("b.tx");
    let brute = Brute::read(&cache, "b.tx");
    let (mut squares, mut worst, n) = (0.0_f64, 0.0_f64, 1500);
    let mut reader = cache.reader();
    for i in 0..n {
        let (_, lookup) = footprint(i, brute.size());
        let mut value = [0.0];
        reader.texture(id, &lookup, &mut value);
        let error = f64::from(value[0] - brute.mean(&lookup)[0]) * 255.0;
        squares += error * error;
        worst = worst.max(error.abs());
    }
    let rms = (squares / f64::from(n)).sqrt();
    assert!(rms < 0.6 && worst < 5.0, "{rms} {worst}");
}

/// A checker of single texels, seen from farther and farther away, at all angles, is grey without any pattern.
#[test]
fn the_finest_checkerboard_becomes_grey_without_moire() {
    let folder = Folder::new();
    folder.image("k.tif", (128, 128), 1, |x, y, _| ((x + y) % 2) as f32);
    folder.make(&["k.tif"], "k.tx", &repeating()).unwrap();
    let (cache, id) = folder.open("k.tx");
    let mut reader = cache.reader();
    let mut contrast = |width: f32, ratio: f32| {
        (0..400).fold(0.0_f32, |most, i| {
            let (angle, r) = (random(i, 7) * 6.3, width / 128.0);
            let lookup = Lookup {
                dsdx: r * ratio * angle.cos(),
                dtdx: r * ratio * angle.sin(),
                dsdy: -r * angle.sin(),
                dtdy: r * angle.cos(),
                ..wide(random(i, 0), random(i, 1), 0.0)
            };
            let mut value = [0.0];
            reader.texture(id, &lookup, &mut value);
            most.max((value[0] - 0.5).abs())
        })
    };
    for ratio in [1.0, 4.0, 40.0] {
        let widths = [1.5, 2.0, 3.0, 5.0, 8.0, 30.0].map(|w| contrast(w, ratio));
        assert!(widths[0] < 0.06 && widths[1..].iter().all(|&c| c < 0.01), "{ratio}: {widths:?}");
    }
}

/// The tiles that a reader holds do not change the result of any lookup.
#[test]
fn readers_give_the_results_of_the_cache() {
    let folder = Folder::new();
    for name in ["a", "b"] {
        folder.image("p.tif", (200, 150), 3, |x, y, c| random(x + 200 * y, c as u32 + name.len() as u32));
        folder.make(&["p.tif"], &format!("{name}.tx"), &repeating()).unwrap();
    }
    let cache = folder.cache(CacheOptions { memory_bytes: 100_000, ..CacheOptions::default() });
    let ids = ["a.tx", "b.tx"].map(|n| cache.find(n).unwrap());
    let before = cache.statistics().lookups;
    let mut reader = cache.reader();
    for i in 0..600 {
        let (_, lookup) = footprint(i, (200, 150));
        let (mut a, mut b) = ([0.0; 4], [0.0; 4]);
        reader.texture(ids[i as usize % 2], &lookup, &mut a);
        cache.texture(ids[i as usize % 2], &lookup, &mut b);
        assert_eq!(a.map(f32::to_bits), b.map(f32::to_bits));
    }
    drop(reader);
    assert_eq!(cache.statistics().lookups, before + 1200);
}
