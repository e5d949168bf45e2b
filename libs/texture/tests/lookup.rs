//! Compares `texture ()` with known results.
#![allow(clippy::unwrap_used, reason = "tests")]

mod support;

use granita_image::{ImageSpec, PixelType};
use granita_texture::make::MakeOptions;
use granita_texture::{CacheOptions, Lookup, Use, Wrap};
use support::{Folder, at, bits, random, value, wide};

fn options() -> MakeOptions {
    MakeOptions::default()
}

fn wrapped(swrap: Wrap, twrap: Wrap) -> MakeOptions {
    MakeOptions { swrap, twrap, ..options() }
}

/// Returns lookups of all sorts at hashed positions.
fn hashed_lookups(n: u32) -> Vec<Lookup> {
    (0..n)
        .map(|i| {
            let r = |k| random(i, k);
            let scale = 0.5_f32.powf(12.0 * r(2)) * 2.0;
            Lookup {
                s: r(0) * 3.0 - 1.0,
                t: r(1) * 3.0 - 1.0,
                dsdx: (r(3) - 0.5) * scale,
                dtdx: (r(4) - 0.5) * scale,
                dsdy: (r(5) - 0.5) * scale,
                dtdy: (r(6) - 0.5) * scale,
                sblur: if i % 3 == 0 { r(7) * 0.1 } else { 0.0 },
                tblur: if i % 5 == 0 { r(8) * 0.1 } else { 0.0 },
                swrap: [None, Some(Wrap::Periodic), Some(Wrap::Clamp), Some(Wrap::Mirror)][i as usize % 4],
                ..Lookup::default()
            }
        })
        .collect()
}

#[test]
fn a_constant_is_exact_everywhere() {
    let folder = Folder::new();
    for (w, h) in [(64, 64), (100, 37), (1, 1), (1, 70), (3, 1)] {
        for noresize in [false, true] {
            folder.image("c.tif", (w, h), 3, |_, _, c| 0.1 + 0.3 * c as f32);
            let o = MakeOptions { resize: !noresize, ..wrapped(Wrap::Periodic, Wrap::Clamp) };
            folder.make(&["c.tif"], "c.tx", &o).unwrap();
            let (cache, id) = folder.open("c.tx");
            for lookup in hashed_lookups(400) {
                let mut out = [0.0; 4];
                cache.texture(id, &Lookup { fill: 7.0, ..lookup }, &mut out);
                assert_eq!(out, [0.1, 0.4, 0.1 + 0.3 * 2.0, 7.0], "{w}x{h} {lookup:?}");
            }
        }
    }
}

#[test]
fn without_footprint_texels_are_exact() {
    let folder = Folder::new();
    let f = |x: u32, y: u32, c: usize| random(x + 256 * y, c as u32);
    folder.image("n.tif", (64, 32), 2, f);
    folder.make(&["n.tif"], "n.tx", &options()).unwrap();
    let (cache, id) = folder.open("n.tx");
    for y in 0..32 {
        for x in 0..64 {
            let mut out = [0.0; 2];
            cache.texture(id, &at((x as f32 + 0.5) / 64.0, (y as f32 + 0.5) / 32.0), &mut out);
            assert_eq!(out, [f(x, y, 0), f(x, y, 1)]);
        }
    }
    // Half way between two texels the value is their mean.
    let v = value(&cache, id, &at(11.0 / 64.0, 5.5 / 32.0));
    assert!((v - 0.5 * (f(10, 5, 0) + f(11, 5, 0))).abs() < 1e-6);
}

#[test]
fn a_filtered_ramp_is_the_ramp() {
    let folder = Folder::new();
    folder.image("r.tif", (256, 256), 1, |x, y, _| (x as f32 + 2.0 * y as f32 + 1.5) / 256.0);
    folder.make(&["r.tif"], "r.tx", &wrapped(Wrap::Clamp, Wrap::Clamp)).unwrap();
    let (cache, id) = folder.open("r.tx");
    for (i, mut lookup) in hashed_lookups(2000).into_iter().enumerate() {
        let r = |k| random(i as u32, k);
        let scale = 0.03
            / 0.01_f32.max(lookup.dsdx.abs() + lookup.dtdx.abs() + lookup.dsdy.abs() + lookup.dtdy.abs());
        lookup = Lookup {
            s: 0.35 + 0.3 * r(20),
            t: 0.35 + 0.3 * r(21),
            dsdx: lookup.dsdx * scale,
            dtdx: lookup.dtdx * scale,
            dsdy: lookup.dsdy * scale,
            dtdy: lookup.dtdy * scale,
            sblur: 0.0,
            tblur: 0.0,
            ..lookup
        };
        let v = value(&cache, id, &lookup);
        assert!((v - (lookup.s + 2.0 * lookup.t)).abs() < 1e-4, "{lookup:?}: {v}");
    }
}

#[test]
fn a_checkerboard_becomes_grey_as_the_footprint_grows() {
    let folder = Folder::new();
    folder.image("k.tif", (256, 256), 1, |x, y, _| ((x / 8 + y / 8) % 2) as f32);
    folder.make(&["k.tif"], "k.tx", &wrapped(Wrap::Periodic, Wrap::Periodic)).unwrap();
    let (cache, id) = folder.open("k.tx");
    let contrast = |width: f32| {
        (0..500)
            .map(|i| (value(&cache, id, &wide(random(i, 0), random(i, 1), width)) - 0.5).abs())
            .fold(0.0, f32::max)
    };
    let sharp = contrast(0.0);
    assert_eq!(sharp, 0.5);
    let widths = [2.0, 4.0, 8.0, 16.0, 32.0].map(|w| contrast(w / 256.0));
    assert!(widths.windows(2).all(|w| w[1] <= w[0] + 1e-6), "{widths:?}");
    assert!(widths[3] < 0.02 && widths[4] < 1e-6, "{widths:?}");
    // A long, narrow footprint along the diagonal of the squares covers one colour. Across rows it covers both.
    let along = Lookup { dsdx: 64.0 / 256.0, dtdx: 64.0 / 256.0, ..at(4.0 / 256.0, 4.0 / 256.0) };
    assert!(value(&cache, id, &along) < 0.2, "{}", value(&cache, id, &along));
    let across = Lookup { dsdx: 64.0 / 256.0, ..at(4.0 / 256.0, 4.0 / 256.0) };
    assert!((value(&cache, id, &across) - 0.5).abs() < 0.1, "{}", value(&cache, id, &across));
}

/// Stripes are kept along their direction, and averaged across it. The footprint is not made round.
#[test]
fn footprints_are_anisotropic() {
    let folder = Folder::new();
    folder.image("s.tif", (256, 256), 1, |x, _, _| (x / 16 % 2) as f32);
    folder.make(&["s.tif"], "s.tx", &wrapped(Wrap::Periodic, Wrap::Periodic)).unwrap();
    let (cache, id) = folder.open("s.tx");
    let middle_of_white = 24.0 / 256.0;
    let along = Lookup { dtdy: 16.0 / 256.0, dsdx: 1.0 / 256.0, ..at(middle_of_white, 0.4) };
    assert_eq!(value(&cache, id, &along), 1.0);
    let across = Lookup { dsdx: 64.0 / 256.0, dtdy: 4.0 / 256.0, ..at(middle_of_white, 0.4) };
    assert!((value(&cache, id, &across) - 0.5).abs() < 0.1);
}

#[test]
fn wrap_modes_apply_in_each_direction() {
    let folder = Folder::new();
    let row = [1.0, 2.0, 3.0, 4.0];
    folder.image("w.tif", (4, 1), 1, |x, _, _| row[x as usize]);
    folder.make(&["w.tif"], "w.tx", &wrapped(Wrap::Mirror, Wrap::Clamp)).unwrap();
    let (cache, id) = folder.open("w.tx");
    let read = |swrap: Option<Wrap>| -> Vec<f32> {
        (-5..9).map(|x| value(&cache, id, &Lookup { swrap, ..at((x as f32 + 0.5) / 4.0, 0.5) })).collect()
    };
    let mirror = [4., 4., 3., 2., 1., 1., 2., 3., 4., 4., 3., 2., 1., 1.];
    assert_eq!(read(None), mirror);
    assert_eq!(read(Some(Wrap::Mirror)), mirror);
    assert_eq!(read(Some(Wrap::Black)), [0., 0., 0., 0., 0., 1., 2., 3., 4., 0., 0., 0., 0., 0.]);
    assert_eq!(read(Some(Wrap::Clamp)), [1., 1., 1., 1., 1., 1., 2., 3., 4., 4., 4., 4., 4., 4.]);
    assert_eq!(read(Some(Wrap::Periodic)), [4., 1., 2., 3., 4., 1., 2., 3., 4., 1., 2., 3., 4., 1.]);
    // The modes also hold far away.
    assert_eq!(value(&cache, id, &Lookup { swrap: Some(Wrap::Clamp), ..at(1e30, 0.5) }), 4.0);
    assert_eq!(value(&cache, id, &Lookup { swrap: Some(Wrap::Black), ..at(-1e30, 0.5) }), 0.0);
}

#[test]
fn blur_and_width_enlarge_the_footprint() {
    let folder = Folder::new();
    folder.image("b.tif", (128, 128), 1, |x, _, _| if x < 64 { 0.0 } else { 1.0 });
    folder.make(&["b.tif"], "b.tx", &wrapped(Wrap::Clamp, Wrap::Clamp)).unwrap();
    let (cache, id) = folder.open("b.tx");
    let blurred = |s: f32, sblur: f32, tblur: f32| value(&cache, id, &Lookup { sblur, tblur, ..at(s, 0.5) });
    assert_eq!(blurred(0.40, 0.0, 0.0), 0.0);
    assert_eq!(blurred(0.40, 0.0, 0.02), 0.0, "blur in t leaves an edge in s alone");
    let soft = blurred(0.45, 0.25, 0.25);
    // A Gaussian of deviation 0.125 has 34.5 % of its weight beyond 0.05.
    assert!((soft - 0.345).abs() < 0.06, "{soft}");
    assert!((blurred(0.5, 0.25, 0.25) - 0.5).abs() < 0.01);
    // Width 0 switches the footprint off, and width 2 doubles it.
    let w = |width: f32, d: f32| {
        value(&cache, id, &Lookup { swidth: width, twidth: width, ..wide(0.45, 0.5, d) })
    };
    assert_eq!(w(0.0, 0.5), 0.0);
    assert_eq!(w(2.0, 0.1), w(1.0, 0.2));
}

/// Results do not depend on the division of an image into tiles, to the bit, for all types and wrap modes. In a file of
/// one tile, whole footprints are summed at once.
#[test]
fn results_do_not_depend_on_tiles() {
    for (pixel_type, image) in [
        (PixelType::U8, "a.tif"),
        (PixelType::U16, "a.tif"),
        (PixelType::Half, "a.exr"),
        (PixelType::Float, "a.tif"),
    ] {
        let folder = Folder::new();
        let spec = ImageSpec::new(150, 90, 3, pixel_type);
        folder.image_of(image, spec, |x, y, c| random(x + 150 * y, c as u32));
        let names = [(16, "small.tx"), (64, "usual.tx"), (256, "whole.tx")].map(|(tile, name)| {
            let options = MakeOptions { tile_size: (tile, tile), ..options() };
            folder.make(&[image], name, &options).unwrap();
            name
        });
        // With little memory, a thread holds one tile.
        let results: Vec<Vec<u32>> = [(0, 1 << 30), (1, 1 << 30), (2, 1 << 30), (0, 1 << 14)]
            .iter()
            .map(|&(name, memory_bytes)| {
                let cache = folder.cache(CacheOptions { memory_bytes, ..CacheOptions::default() });
                let id = cache.find(names[name]).unwrap();
                let mut reader = cache.reader();
                let lookups = hashed_lookups(if memory_bytes < 1 << 20 { 100 } else { 3000 });
                lookups
                    .iter()
                    .flat_map(|lookup| {
                        let mut values = [f32::NAN; 4];
                        reader.texture(id, lookup, &mut values);
                        bits(&values)
                    })
                    .collect()
            })
            .collect();
        assert_eq!(results[0], results[1], "{pixel_type:?}");
        assert_eq!(results[0], results[2], "{pixel_type:?}");
        assert_eq!(results[0][..results[3].len()], results[3], "{pixel_type:?}");
    }
}

/// A footprint of at most one texel is the bilinear value, to the bit.
#[test]
fn footprints_below_a_texel_are_bilinear_values() {
    let folder = Folder::new();
    folder.image("a.tif", (64, 32), 3, |x, y, c| random(x + 64 * y, c as u32) - 0.5);
    folder.make(&["a.tif"], "a.tx", &wrapped(Wrap::Periodic, Wrap::Mirror)).unwrap();
    let (cache, id) = folder.open("a.tx");
    let look = |lookup: &Lookup| {
        let mut values = [f32::NAN; 3];
        cache.texture(id, lookup, &mut values);
        values
    };
    for i in 0..2000 {
        let (s, t) = (random(i, 20) * 3.0 - 1.0, random(i, 21) * 3.0 - 1.0);
        let (sin, cos) = (random(i, 22) * 6.3).sin_cos();
        let sharp = look(&at(s, t));
        let q = Lookup { dsdx: 0.99 * cos / 64.0, dtdx: 0.99 * sin / 32.0, ..at(s, t) };
        assert_eq!(bits(&look(&q)), bits(&sharp), "{s} {t}");
        // The four texels around, looked up at their centres.
        let (x, y) = (s * 64.0 - 0.5, t * 32.0 - 0.5);
        let texel =
            |dx: f32, dy: f32| look(&at((x.floor() + dx + 0.5) / 64.0, (y.floor() + dy + 0.5) / 32.0));
        let (fx, fy) = (x - x.floor(), y - y.floor());
        let [a, b, c, d] = [texel(0.0, 0.0), texel(1.0, 0.0), texel(0.0, 1.0), texel(1.0, 1.0)];
        for k in 0..3 {
            let (top, bottom) = (a[k] + (b[k] - a[k]) * fx, c[k] + (d[k] - c[k]) * fx);
            assert!((sharp[k] - (top + (bottom - top) * fy)).abs() < 1e-4, "{s} {t}");
        }
    }
}

#[test]
fn missing_channels_have_the_fill_value() {
    let folder = Folder::new();
    folder.image("f.tif", (8, 8), 6, |_, _, c| c as f32);
    folder.make(&["f.tif"], "f.tx", &wrapped(Wrap::Clamp, Wrap::Clamp)).unwrap();
    let (cache, id) = folder.open("f.tx");
    let read = |first_channel: u32, n: usize| {
        let mut out = vec![9.0; n];
        cache.texture(id, &Lookup { first_channel, fill: 0.5, ..wide(0.5, 0.5, 0.3) }, &mut out);
        out
    };
    assert_eq!(read(0, 4), [0.0, 1.0, 2.0, 3.0]);
    assert_eq!(read(4, 4), [4.0, 5.0, 0.5, 0.5]);
    assert_eq!(read(0, 7), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 0.5]);
    assert_eq!(read(u32::MAX, 2), [0.5, 0.5]);
    assert_eq!(read(0, 0), [0.0; 0]);
}

#[test]
fn invalid_texels_and_coordinates_give_finite_results() {
    let folder = Folder::new();
    folder.image("x.tif", (32, 32), 1, |x, y, _| if (x, y) == (3, 3) { f32::NAN } else { 0.5 });
    folder.make(&["x.tif"], "x.tx", &wrapped(Wrap::Periodic, Wrap::Clamp)).unwrap();
    for name in ["x.tx", "x.tif"] {
        let (cache, id) = folder.open(name);
        let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN_POSITIVE, -1e20, 0.3];
        for a in odd {
            for b in odd {
                for lookup in [
                    at(a, b),
                    Lookup { dsdx: a, dtdy: b, ..at(0.5, 0.5) },
                    Lookup { sblur: a, tblur: b, ..at(0.5, 0.5) },
                    Lookup { swidth: a, twidth: b, ..wide(0.5, 0.5, 0.1) },
                ] {
                    let v = value(&cache, id, &lookup);
                    assert!((0.0..=0.5).contains(&v), "{name} {lookup:?}: {v}");
                }
            }
        }
    }
}

#[test]
fn automatic_mip_maps_equal_maketx_without_resizing() {
    let folder = Folder::new();
    folder.image("a.tif", (100, 60), 3, |x, y, c| random(x + 100 * y, c as u32));
    let o = MakeOptions { resize: false, ..options() };
    folder.make(&["a.tif"], "a.tx", &o).unwrap();
    let ((made, id), (auto, auto_id)) = (folder.open("a.tx"), folder.open("a.tif"));
    for lookup in hashed_lookups(500) {
        let (mut a, mut b) = ([0.0; 4], [0.0; 4]);
        made.texture(id, &lookup, &mut a);
        auto.texture(auto_id, &lookup, &mut b);
        assert_eq!(bits(&a), bits(&b), "{lookup:?}");
    }
    assert_eq!(auto.statistics().automipmaps, 1);
    assert!(folder.texts().iter().any(|t| t.contains("a.tif is not tiled")));
    // When automipmap is off, the file is refused.
    let strict = folder.cache(CacheOptions { automipmap: false, ..CacheOptions::default() });
    assert!(strict.find("a.tif").is_none() && strict.find("a.tx").is_some());
}

#[test]
fn missing_files_are_named_once() {
    let folder = Folder::new();
    folder.image("s.tif", (8, 8), 1, |_, _, _| 0.25);
    let cache = folder.cache(CacheOptions::default());
    for _ in 0..3 {
        assert!(cache.find_for("nothing.tx", Use::Texture).is_none());
    }
    let about: Vec<_> = folder.texts().into_iter().filter(|t| t.contains("nothing.tx")).collect();
    assert_eq!(about.len(), 1, "{about:?}");
    assert_eq!(cache.statistics().missing, 1);
    // A substitute replaces it, for textures only.
    let cache = folder
        .cache(CacheOptions { substitute_texture: Some("s.tif".to_owned()), ..CacheOptions::default() });
    let id = cache.find_for("nothing.tx", Use::Texture).unwrap();
    assert_eq!(
        value(&cache, id, &Lookup { swrap: Some(Wrap::Clamp), twrap: Some(Wrap::Clamp), ..at(0.5, 0.5) }),
        0.25
    );
    assert!(cache.find_for("nothing.tx", Use::Environment).is_none());
}

#[test]
fn pixel_types_keep_their_values() {
    use granita_image::{ImageSpec, PixelType};
    let folder = Folder::new();
    for pixel_type in [PixelType::U8, PixelType::U16, PixelType::Half, PixelType::Float] {
        let spec = ImageSpec::new(16, 16, 4, pixel_type);
        folder.image_of("p.tif", spec, |x, y, c| ((x + y + c as u32) % 5) as f32 / 5.0 * 51.0 / 51.0);
        folder.make(&["p.tif"], "p.tx", &options()).unwrap();
        let (cache, id) = folder.open("p.tx");
        let mut out = [0.0; 4];
        cache.texture(id, &at(2.5 / 16.0, 1.5 / 16.0), &mut out);
        for (c, v) in out.iter().enumerate() {
            assert!((v - ((3 + c) % 5) as f32 / 5.0).abs() < 1e-3, "{pixel_type:?} {out:?}");
        }
    }
}
