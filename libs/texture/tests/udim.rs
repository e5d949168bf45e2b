//! Looks up sets of textures that continue each other.
#![allow(clippy::unwrap_used, reason = "tests")]

mod support;

use granita_base::Filter;
use granita_texture::make::{Made, MakeOptions, Neighbour};
use granita_texture::{Lookup, Wrap};
use support::{Folder, at, random, value, wide};

const SIZE: u32 = 64;

/// A pattern over the plane, in texels. Rows of squares go upward, so that square 1011 lies above 1001.
fn pattern(x: i64, y: i64) -> f32 {
    let wave = (x as f32 * 0.17).sin() * (y as f32 * 0.11).cos();
    0.5 + 0.3 * wave + 0.2 * random(x.rem_euclid(512) as u32, y.rem_euclid(512) as u32)
}

/// Makes the texture of a square, and returns its name.
fn square(folder: &Folder, (column, row): (i64, i64), name: &str) -> String {
    let name = format!("{name}.{}", 1001 + column + 10 * row);
    let (image, texture) = (format!("{name}.tif"), format!("{name}.tx"));
    let n = i64::from(SIZE);
    folder
        .image(&image, (SIZE, SIZE), 1, |x, y, _| pattern(column * n + i64::from(x), i64::from(y) - row * n));
    folder.make(&[&image], &texture, &MakeOptions::default()).unwrap();
    texture
}

/// Lookups of all widths, some near edges of squares, in columns 0 and 1 and rows 0 and 1.
fn lookups() -> Vec<Lookup> {
    (0..600)
        .map(|i| {
            let r = |k| random(i, 100 + k);
            let scale = 0.5_f32.powf(2.5 + 7.0 * r(2));
            let near = |x: f32, k: u32| if i % 3 == 0 { x.round() + 0.02 * (r(k) - 0.5) } else { x };
            Lookup {
                s: near(2.0 * r(0), 9).clamp(0.001, 1.999),
                t: near(2.0 * r(1) - 1.0, 10).clamp(-0.999, 0.999),
                dsdx: (r(3) - 0.5) * scale,
                dtdx: (r(4) - 0.5) * scale,
                dsdy: (r(5) - 0.5) * scale,
                dtdy: (r(6) - 0.5) * scale,
                sblur: if i % 4 == 0 { r(7) * 0.05 } else { 0.0 },
                ..Lookup::default()
            }
        })
        .collect()
}

/// Four squares give the values of one image of the whole, where both have the same texels and levels.
#[test]
fn squares_continue_each_other_without_seams() {
    let folder = Folder::new();
    for place in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        square(&folder, place, "wall");
    }
    let n = i64::from(SIZE);
    folder.image("whole.tif", (2 * SIZE, 2 * SIZE), 1, |x, y, _| pattern(i64::from(x), i64::from(y) - n));
    let clamp = MakeOptions { swrap: Wrap::Clamp, twrap: Wrap::Clamp, ..MakeOptions::default() };
    folder.make(&["whole.tif"], "whole.tx", &clamp).unwrap();
    let (set, set_id) = folder.open("wall.<UDIM>.tx");
    let (whole, whole_id) = folder.open("whole.tx");
    let mut crossed = 0;
    for q in lookups() {
        let half = |x: f32| 0.5 * x;
        let of_whole = Lookup {
            s: half(q.s),
            t: half(q.t + 1.0),
            dsdx: half(q.dsdx),
            dtdx: half(q.dtdx),
            dsdy: half(q.dsdy),
            dtdy: half(q.dtdy),
            sblur: half(q.sblur),
            ..q
        };
        let (got, expected) = (value(&set, set_id, &q), value(&whole, whole_id, &of_whole));
        // A coordinate is rounded by 6e-8, which is 8e-6 of a texel, and neighbouring texels differ by up to 0.4.
        assert!((got - expected).abs() < 1e-5, "{got} {expected} {q:?}");
        crossed += u32::from((q.s - q.s.round()).abs() < 0.02 || (q.t - q.t.round()).abs() < 0.02);
    }
    assert!(crossed > 100, "{crossed}");
    assert!(folder.texts().is_empty(), "{:?}", folder.texts());
}

/// A set with a gap continues its border texels there, at all widths, and is black inside the gap.
#[test]
fn gaps_are_black_and_borders_continue() {
    let folder = Folder::new();
    for column in [0, 2] {
        let name = format!("c.{}.tif", 1001 + column);
        folder.image(&name, (SIZE, SIZE), 3, |_, _, c| 0.25 + 0.25 * c as f32);
        folder.make(&[&name], &name.replace("tif", "tx"), &MakeOptions::default()).unwrap();
    }
    let (cache, id) = folder.open("c.<UDIM>.tx");
    for i in 0..300 {
        let (r, width) = (|k| random(i, k), 0.5_f32.powf(1.5 + 8.0 * random(i, 3)));
        let s = if i % 2 == 0 { r(0) } else { r(0).round() };
        let mut out = [0.0; 5];
        cache.texture(id, &Lookup { fill: 7.0, ..wide(s, r(1), width) }, &mut out);
        for (got, expected) in out.iter().zip([0.25, 0.5, 0.75, 7.0, 7.0]) {
            assert!((got - expected).abs() < 1e-6, "{out:?} {s} {width}");
        }
    }
    for (s, t) in [(1.5, 0.5), (0.5, 1.5), (0.5, -0.5), (-0.5, 0.5), (11.5, 0.5), (1.5, 0.25)] {
        let mut out = [9.0; 5];
        cache.texture(id, &Lookup { fill: 7.0, ..at(s, t) }, &mut out);
        assert_eq!(out, [0.0, 0.0, 0.0, 7.0, 7.0], "{s} {t}");
    }
    let texts = folder.texts();
    assert_eq!(texts.len(), 5, "one for each square: {texts:?}");
    assert!(texts[0].contains("c.<UDIM>.tx") && texts[0].contains("column 1, row 0"), "{texts:?}");
}

#[test]
fn sets_without_files_and_with_broken_ones_are_reported() {
    let folder = Folder::new();
    let cache = folder.cache(granita_texture::CacheOptions::default());
    assert!(cache.find("none.<UDIM>.tx").is_none());
    assert!(folder.texts()[0].contains("none.<UDIM>.tx"), "{:?}", folder.texts());
    square(&folder, (0, 0), "d");
    std::fs::write(folder.path("d.1002.tx"), "no image").unwrap();
    let (cache, id) = folder.open("d.<UDIM>.tx");
    assert_eq!(value(&cache, id, &at(1.5, 0.5)), 0.0);
    assert_eq!(value(&cache, id, &at(1.25, 0.5)), 0.0);
    let texts = folder.texts();
    assert!(texts.len() == 2 && texts[1].contains("d.1002.tx"), "{texts:?}");
    // Data of a set are those of its first file.
    assert!(cache.info("d.<UDIM>.tx", "resolution").is_some());
}

/// With neighbours, levels of wide filters are the parts of the levels of the whole image.
#[test]
fn filters_use_texels_of_neighbours() {
    let folder = Folder::new();
    let places = [(0, 0), (1, 0), (0, 1), (1, 1)];
    for place in places {
        square(&folder, place, "w");
    }
    let n = i64::from(SIZE);
    folder.image("whole.tif", (2 * SIZE, 2 * SIZE), 1, |x, y, _| pattern(i64::from(x), i64::from(y) - n));
    let clamp =
        |filter| MakeOptions { filter, swrap: Wrap::Clamp, twrap: Wrap::Clamp, ..MakeOptions::default() };
    let level = |name: &str, level: usize| {
        let file = folder.registry.open(&folder.path(name)).unwrap();
        file.read_level(0, level).unwrap().to_floats()
    };
    for filter in [Filter::Gaussian, Filter::CatmullRom, Filter::Sinc] {
        folder.make(&["whole.tif"], "whole.tx", &clamp(filter)).unwrap();
        let name = |(column, row): (i64, i64)| format!("w.{}.tif", 1001 + column + 10 * row);
        for (column, row) in places {
            let around = [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];
            let neighbours =
                around.iter().filter(|(across, down)| places.contains(&(column + across, row - down)));
            let neighbours: Vec<Neighbour> = neighbours
                .map(|&(across, down)| Neighbour {
                    across: across as i8,
                    down: down as i8,
                    path: folder.path(&name((column + across, row - down))),
                })
                .collect();
            assert_eq!(neighbours.len(), 3);
            let mut options = clamp(filter);
            folder.make(&[&name((column, row))], "alone.tx", &options).unwrap();
            options.flat.neighbours = neighbours;
            folder.make(&[&name((column, row))], "seams.tx", &options).unwrap();
            for l in 1..4 {
                let side = SIZE as usize >> l;
                let whole = level("whole.tx", l);
                let (x0, y0) = (column as usize * side, (1 - row) as usize * side);
                let part: Vec<f32> =
                    (0..side).flat_map(|y| whole[(y0 + y) * 2 * side + x0..][..side].to_vec()).collect();
                let worst = |name: &str| {
                    let got = level(name, l);
                    got.iter().zip(&part).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
                };
                let (seams, alone) = (worst("seams.tx"), worst("alone.tx"));
                assert!(seams < 1e-6 && alone > 1e-3, "{filter:?} {column} {row} {l}: {seams} {alone}");
            }
            assert_eq!(level("seams.tx", 6).len(), 1);
        }
    }
    // Neighbours of another size are not used, which a note says. Images that are resized are refused.
    folder.image("small.tif", (32, 64), 1, |_, _, _| 0.5);
    let other = |path: &str| {
        let mut options = clamp(Filter::Gaussian);
        options.flat.neighbours = vec![Neighbour { across: 1, down: 0, path: folder.path(path) }];
        options
    };
    let Made::Written { notes, .. } = folder.make(&["w.1001.tif"], "s.tx", &other("small.tif")).unwrap()
    else {
        panic!("it is new")
    };
    assert!(notes.len() == 1 && notes[0].contains("another size"), "{notes:?}");
    folder.image("odd.tif", (50, 64), 1, |_, _, _| 0.5);
    let what = folder.make(&["odd.tif"], "s.tx", &other("small.tif")).unwrap_err().to_string();
    assert!(what.contains("powers of two"), "{what}");
}
