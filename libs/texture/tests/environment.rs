//! Tests of `environment ()`: directions, seams, poles and edges.
#![allow(clippy::unwrap_used, reason = "tests")]

mod support;

use granita_base::Vec3;
use granita_texture::make::{MakeOptions, Mode};
use granita_texture::{EnvLookup, TextureCache, TextureId, TextureKind, Up};
use std::f32::consts::{PI, TAU};
use support::{FACES, FRAMES, Folder, random};

fn options(mode: Mode) -> MakeOptions {
    MakeOptions { mode, ..MakeOptions::default() }
}

fn look(cache: &TextureCache, id: TextureId, lookup: &EnvLookup) -> [f32; 3] {
    let mut out = [f32::NAN; 3];
    cache.environment(id, lookup, &mut out);
    out
}

fn toward(r: Vec3) -> EnvLookup {
    EnvLookup { r, ..EnvLookup::default() }
}

/// Returns a direction, evenly distributed over the sphere.
fn any_direction(i: u32) -> Vec3 {
    let (z, phi) = (random(i, 50) * 2.0 - 1.0, random(i, 51) * TAU);
    let around = (1.0 - z * z).sqrt();
    Vec3::new(around * phi.cos(), around * phi.sin(), z)
}

/// Returns a smooth colour for every direction, between 0 and 1.
fn sky(d: Vec3, c: usize) -> f32 {
    let d = d.normalize();
    0.5 + 0.5 * [d.x, d.y, d.z][c]
}

/// Makes a cube map of `f` from six views.
fn cube_of(folder: &Folder, n: u32, options: &MakeOptions, f: impl Fn(Vec3, usize) -> f32) {
    for (name, [forward, up, right]) in FACES.iter().zip(FRAMES) {
        folder.image(name, (n, n), 3, |x, y, c| {
            let ndc = |v: u32| 2.0 * (v as f32 + 0.5) / n as f32 - 1.0;
            f(forward + right * ndc(x) - up * ndc(y), c)
        });
    }
    folder.make(&FACES, "cube.env", options).unwrap();
}

/// Makes a latitude-longitude map of `f` with +z up.
fn latlong_of(folder: &Folder, (w, h): (u32, u32), f: impl Fn(Vec3, usize) -> f32) {
    folder.image("ll.tif", (w, h), 3, |x, y, c| {
        let (phi, theta) = (((x as f32 + 0.5) / w as f32 - 0.5) * TAU, (y as f32 + 0.5) / h as f32 * PI);
        f(Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()), c)
    });
    folder.make(&["ll.tif"], "ll.env", &options(Mode::EnvLatLong)).unwrap();
}

#[test]
fn environment_lookups_find_their_direction() {
    let folder = Folder::new();
    cube_of(&folder, 64, &options(Mode::EnvCube), sky);
    latlong_of(&folder, (256, 128), sky);
    for (name, kind) in
        [("cube.env", TextureKind::CubeFaceEnvironment), ("ll.env", TextureKind::LatLongEnvironment)]
    {
        let (cache, id) = folder.open(name);
        assert_eq!(cache.kind(id), kind);
        for i in 0..2000 {
            let d = any_direction(i);
            let v = look(&cache, id, &toward(d * (0.1 + 10.0 * random(i, 3))));
            for (c, v) in v.iter().enumerate() {
                assert!((v - sky(d, c)).abs() < 0.01, "{name} {d} {c}: {v} {}", sky(d, c));
            }
        }
    }
}

/// "width" scales the footprint, in one direction or both, and nothing else.
#[test]
fn widths_scale_the_footprint() {
    let folder = Folder::new();
    cube_of(&folder, 64, &options(Mode::EnvCube), sky);
    latlong_of(&folder, (256, 128), sky);
    for name in ["cube.env", "ll.env"] {
        let (cache, id) = folder.open(name);
        for d in [Vec3::new(0.3, 0.5, -0.2), Vec3::X, Vec3::new(-1.0, 0.9, 0.1)] {
            // The vectors are around the axis of the map, and towards its poles.
            let axis = if name == "cube.env" { Vec3::Y } else { Vec3::Z };
            let east = axis.cross(d).normalize() * 0.2;
            let north = d.normalize().cross(east);
            let at = |x: f32, y: f32, s: f32, t: f32| {
                let q = EnvLookup { drdx: east * x, drdy: north * y, swidth: s, twidth: t, ..toward(d) };
                look(&cache, id, &q)
            };
            assert_eq!(at(1.0, 1.0, 0.0, 0.0), look(&cache, id, &toward(d)), "{name} {d}");
            for ((x, y), (s, t)) in
                [((2.0, 2.0), (2.0, 2.0)), ((2.0, 1.0), (2.0, 1.0)), ((0.0, 1.0), (0.0, 1.0))]
            {
                let (scaled, wide) = (at(1.0, 1.0, s, t), at(x, y, 1.0, 1.0));
                for c in 0..3 {
                    assert!((scaled[c] - wide[c]).abs() < 1e-4, "{name} {d} {s} {t}: {scaled:?} {wide:?}");
                }
            }
            assert_ne!(at(1.0, 1.0, 4.0, 4.0), at(1.0, 1.0, 1.0, 1.0));
        }
    }
}

/// With a blur over the whole sphere, both maps are near the mean of the sky. A wide cone at +x contains more of +x.
#[test]
fn environment_blur_averages_over_its_angle() {
    let folder = Folder::new();
    cube_of(&folder, 64, &options(Mode::EnvCube), sky);
    latlong_of(&folder, (256, 128), sky);
    for name in ["cube.env", "ll.env"] {
        let (cache, id) = folder.open(name);
        for d in [Vec3::X, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z, Vec3::ONE] {
            let by_angle = |angle| look(&cache, id, &EnvLookup { angle: Some(angle), ..toward(d) });
            let by_blur = |b| look(&cache, id, &EnvLookup { sblur: b, tblur: b, ..toward(d) });
            assert_eq!(by_angle(0.25 * PI * 0.5), by_blur(0.5), "half angle against full width in quarters");
            let quick = EnvLookup { quick: true, sblur: 0.5, tblur: 0.5, ..toward(d) };
            assert_eq!(look(&cache, id, &quick), by_blur(0.5), "a wide blur is not cut in quick lookups");
            for c in 0..3 {
                // Averaging a plane wave over a cone moves it nearer to one half, never beyond.
                let (sharp, soft) = (by_angle(0.0)[c] - 0.5, by_angle(0.5)[c] - 0.5);
                assert!(soft.abs() <= sharp.abs() + 0.05, "{name} {d} {c}: {sharp} {soft}");
                assert!(soft * sharp >= -0.01, "{name} {d} {c}: {sharp} {soft}");
            }
        }
    }
}

#[test]
fn constants_are_exact_in_all_directions() {
    let folder = Folder::new();
    cube_of(&folder, 20, &options(Mode::EnvCube), |_, c| 0.1 + 0.7 * c as f32);
    latlong_of(&folder, (33, 17), |_, c| 0.1 + 0.7 * c as f32);
    for name in ["cube.env", "ll.env"] {
        let (cache, id) = folder.open(name);
        for i in 0..1500 {
            let r = |k| random(i, k);
            let jump = |k: u32| (any_direction(i + 7777 * k)) * r(60 + k) * r(61) * 2.0;
            let lookup = EnvLookup {
                drdx: jump(1),
                drdy: jump(2),
                sblur: if i % 3 == 0 { r(5) } else { 0.0 },
                tblur: if i % 4 == 0 { r(6) } else { 0.0 },
                ..toward(any_direction(i))
            };
            let v = look(&cache, id, &lookup);
            if name == "ll.env" {
                assert_eq!(v, [0.1, 0.8, 0.1 + 0.7 * 2.0], "{name} {lookup:?}");
            } else {
                // The missing texel at the corner is a mean of three, which is exact except for rounding.
                for (c, v) in v.iter().enumerate() {
                    assert!((v - (0.1 + 0.7 * c as f32)).abs() < 1e-6, "{name} {lookup:?}");
                }
            }
        }
    }
}

/// The sum of many quick lookups is that of exact ones, in cubes and latitude-longitude maps, and each is near its
/// exact one.
#[test]
fn quick_lookups_have_the_mean_of_exact_ones() {
    let folder = Folder::new();
    let spotted = |d: Vec3, c: usize| sky(d, c) + if d.normalize().dot(Vec3::X) > 0.9 { 4.0 } else { 0.0 };
    cube_of(&folder, 64, &options(Mode::EnvCube), spotted);
    latlong_of(&folder, (128, 64), spotted);
    for name in ["cube.env", "ll.env"] {
        let (cache, id) = folder.open(name);
        for angle in [0.02, 0.1, 0.4] {
            let (mut sums, mut far) = ([0.0_f64; 2], 0.0_f32);
            for i in 0..20000 {
                let exact = EnvLookup { angle: Some(angle), ..toward(any_direction(i)) };
                let quick = EnvLookup { quick: true, ..exact };
                let values = [exact, quick].map(|lookup| look(&cache, id, &lookup)[1]);
                sums.iter_mut().zip(values).for_each(|(sum, v)| *sum += f64::from(v));
                if exact.r.x < 0.0 {
                    far = far.max((values[0] - values[1]).abs());
                }
            }
            assert!((sums[1] / sums[0] - 1.0).abs() < 0.01, "{name} {angle}: {sums:?}");
            assert!(far < 0.01 + 0.2 * angle, "{name} {angle}: {far}");
        }
    }
}

/// Returns the largest change of any channel over a small step.
fn jump(cache: &TextureCache, id: TextureId, a: Vec3, b: Vec3, width: f32) -> f32 {
    let footprint = |r: Vec3| EnvLookup { angle: Some(0.5 * width), ..toward(r) };
    let (a, b) = (look(cache, id, &footprint(a)), look(cache, id, &footprint(b)));
    (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max)
}

/// The noise is not continuous across edges. The values that are looked up must still be continuous there.
#[test]
fn cube_edges_and_corners_are_continuous() {
    let folder = Folder::new();
    let noise = |d: Vec3, c: usize| {
        let q = |v: f32| (v * 1000.0).round() as i32 as u32;
        random(q(d.x) ^ q(d.y).rotate_left(10) ^ q(d.z).rotate_left(20), c as u32)
    };
    cube_of(&folder, 16, &options(Mode::EnvCube), noise);
    let (cache, id) = folder.open("cube.env");
    let step = 1e-4;
    for i in 0..3000 {
        // The point is on an edge, where two components have the same magnitude, or at a corner, where all three have.
        let third = if i % 10 == 0 { 1.0 } else { random(i, 1) * 2.0 - 1.0 };
        let sign = |k| if random(i, k) < 0.5 { -1.0 } else { 1.0 };
        let (a, b) = (sign(2), sign(3));
        let edge = match i % 3 {
            0 => Vec3::new(a, b, third),
            1 => Vec3::new(a, third, b),
            _ => Vec3::new(third, a, b),
        };
        let aside = any_direction(i) * step;
        for width in [0.0, 0.05, 0.2, 1.0] {
            let j = jump(&cache, id, edge + aside, edge - aside, width);
            // A texel is 2/16 wide and differs by at most 1. The whole change would need 100 steps.
            assert!(j < 40.0 * step, "{edge} {width}: {j}");
        }
    }
}

#[test]
fn latlong_seam_and_poles_are_continuous() {
    let folder = Folder::new();
    latlong_of(&folder, (32, 16), |d, c| {
        let q = |v: f32| (v * 1000.0).round() as i32 as u32;
        random(q(d.x) ^ q(d.y).rotate_left(10) ^ q(d.z).rotate_left(20), c as u32)
    });
    let (cache, id) = folder.open("ll.env");
    let step = 1e-4;
    for i in 0..2000 {
        let theta = random(i, 0) * PI;
        let seam = Vec3::new(-theta.sin(), 0.0, theta.cos());
        let pole = Vec3::Z * if i % 2 == 0 { 1.0 } else { -1.0 };
        let aside = any_direction(i) * step;
        for width in [0.0, 0.1, 0.5] {
            if theta.sin() > 0.3 {
                let j = jump(&cache, id, seam + aside, seam - aside, width);
                assert!(j < 100.0 * step, "seam {seam} {width}: {j}");
            }
            // Around the pole all texels are within a small circle, so that the value is the same.
            let j = jump(&cache, id, pole + aside, pole - aside, width);
            assert!(j < 100.0 * step, "pole {pole} {width}: {j}");
        }
    }
}

/// Returns the mean of a map over the sphere under a Gaussian in Lambert's azimuthal projection around `r`. Half of
/// these widths (in radians) are its deviations along two perpendicular directions. All texels of `texels` count, each
/// with its solid angle.
fn brute(
    texels: &[(Vec3, f64, [f32; 3])],
    r: Vec3,
    axes: [Vec3; 2],
    widths: [f32; 2],
    texel: f64,
) -> [f64; 3] {
    let (mut sum, mut all) = ([0.0; 3], 0.0);
    let variance = widths.map(|w| (0.25 * f64::from(w * w) - texel * texel / 12.0).max(1e-9));
    for (d, solid, value) in texels {
        let k = 2.0 / (1.0 + f64::from(d.dot(r))).max(1e-9);
        let x = [0, 1].map(|i| f64::from(d.dot(axes[i])));
        let weight = solid * (-0.5 * k * (x[0] * x[0] / variance[0] + x[1] * x[1] / variance[1])).exp();
        all += weight;
        for c in 0..3 {
            sum[c] += weight * f64::from(value[c]);
        }
    }
    sum.map(|s| s / all)
}

/// Returns a colour for every direction, with edges.
fn town(d: Vec3, c: usize) -> f32 {
    let d = d.normalize();
    let q = |v: f32| ((v + 2.0) * 7.0) as u32;
    let block = random(q(d.x) + 64 * q(d.y) + 4096 * q(d.z), c as u32);
    let fence = if (d.y * 60.0).sin() > 0.6 && d.z > 0.0 { 0.6 } else { 0.0 };
    0.6 * block + fence * (0.5 + 0.2 * c as f32)
}

/// The footprints are ellipses of all sizes, ratios and directions, over edges, corners, the seam and the poles.
#[test]
fn environment_footprints_equal_brute_force() {
    let folder = Folder::new();
    const N: u32 = 64;
    cube_of(&folder, N, &options(Mode::EnvCube), town);
    latlong_of(&folder, (4 * N, 2 * N), town);
    let mut texels: [Vec<(Vec3, f64, [f32; 3])>; 2] = Default::default();
    for [forward, up, right] in FRAMES {
        for i in 0..N * N {
            let ndc = |v: u32| 2.0 * (v as f32 + 0.5) / N as f32 - 1.0;
            let d = forward + right * ndc(i % N) - up * ndc(i / N);
            let solid = f64::from(d.length()).powi(-3);
            texels[0].push((d.normalize(), solid, [0, 1, 2].map(|c| town(d, c))));
        }
    }
    for i in 0..8 * N * N {
        let (x, y) = (i % (4 * N), i / (4 * N));
        let (phi, theta) =
            (((x as f32 + 0.5) / (4 * N) as f32 - 0.5) * TAU, (y as f32 + 0.5) / (2 * N) as f32 * PI);
        let d = Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
        texels[1].push((d, f64::from(theta.sin()), [0, 1, 2].map(|c| town(d, c))));
    }
    for (texels, (name, texel)) in
        texels.iter().zip([("cube.env", 1.6 / N as f32), ("ll.env", PI / (2 * N) as f32)])
    {
        let (cache, id) = folder.open(name);
        let (mut squares, mut worst, n) = (0.0, 0.0_f64, 400);
        for i in 0..n {
            // A quarter of the footprints are at corners of the cube and at poles of the latitude-longitude map.
            let r = match i % 8 {
                0 => (Vec3::new(1.0, if i % 16 == 0 { 1.0 } else { -1.0 }, -1.0) + any_direction(i) * 0.1)
                    .normalize(),
                1 => (Vec3::Z + any_direction(i) * 0.2).normalize(),
                _ => any_direction(i),
            };
            let across = 1.6 * texel * (0.6 / texel).powf(random(i, 3));
            let ratio = (16.0_f32.powf(random(i, 4))).min(PI / across);
            let x = r.any_orthonormal_vector();
            let angle = random(i, 5) * TAU;
            let first = x * angle.cos() + r.cross(x) * angle.sin();
            let axes = [first, r.cross(first)];
            let lookup = EnvLookup { drdx: axes[0] * across * ratio, drdy: axes[1] * across, ..toward(r) };
            let got = look(&cache, id, &lookup);
            let exact = brute(texels, r, axes, [across * ratio, across], f64::from(texel));
            for c in 0..3 {
                let error = 255.0 * (f64::from(got[c]) - exact[c]);
                squares += error * error;
                worst = worst.max(error.abs());
            }
        }
        let rms = (squares / f64::from(3 * n)).sqrt();
        println!("{name}: {rms} {worst}");
        assert!(rms < 1.0 && worst < 10.0, "{name}: {rms} {worst}");
    }
}

#[test]
fn latlong_maps_have_their_orientation() {
    let folder = Folder::new();
    latlong_of(&folder, (64, 32), sky);
    let (cache, id) = folder.open("ll.env");
    let up = |r: Vec3, up: Option<Up>| look(&cache, id, &EnvLookup { up, ..toward(r) });
    for i in 0..100 {
        let d = any_direction(i);
        assert_eq!(up(d, None), up(d, Some(Up::Z)));
        // The frame has +y up, is right handed, and has +z in the centre and +x to its left.
        assert_eq!(up(Vec3::new(-d.y, d.z, d.x), Some(Up::Y)), up(d, Some(Up::Z)));
    }
    // The centre of the image is +x, and its upper edge is +z. A quarter of the width to the right of the centre is +y.
    let mut out = [0.0; 2];
    for (s, t, d) in
        [(0.5, 0.5, Vec3::X), (0.75, 0.5, Vec3::Y), (0.25, 0.5, Vec3::NEG_Y), (0.5, 0.0, Vec3::Z)]
    {
        cache.texture(id, &support::at(s, t), &mut out);
        let seen = up(d, None);
        assert!((seen[0] - sky(d, 0)).abs() < 0.06, "{s} {t} {d} {seen:?}");
    }
}

/// A latitude-longitude map has the directions of the convention of its own file, in any format of the texture. They
/// are +z up and left handed in TIFF, and +y up and right handed in OpenEXR.
#[test]
fn maps_of_one_panorama_show_the_same_directions_in_all_formats() {
    let folder = Folder::new();
    let paint = |x: u32, y: u32, c: usize| [x as f32 / 64.0, y as f32 / 32.0, 0.5][c];
    folder.image("pano.tif", (64, 32), 3, paint);
    folder.image("pano.exr", (64, 32), 3, paint);
    // The texture is made as a stream, and as a whole.
    let plain = options(Mode::EnvLatLong);
    let whole = MakeOptions { filter: granita_base::Filter::Triangle, ..plain.clone() };
    let float = Some(granita_image::PixelType::Float);
    for options in [plain, whole] {
        for (from, up) in [("pano.tif", Up::Z), ("pano.exr", Up::Y)] {
            let exr = MakeOptions { format: "OpenEXR".into(), pixel_type: float, ..options.clone() };
            let tiff = MakeOptions { format: "tiff".into(), ..options.clone() };
            folder.make(&[from], "a.env", &tiff).unwrap();
            folder.make(&[from], "b.exr", &exr).unwrap();
            // The maps that were made are converted once more.
            folder.make(&["b.exr"], "c.env", &tiff).unwrap();
            folder.make(&["a.env"], "d.exr", &exr).unwrap();
            let maps = ["a.env", "b.exr", "c.env", "d.exr"].map(|name| folder.open(name));
            for i in 0..50 {
                let d = any_direction(i);
                let seen = maps.each_ref().map(|(cache, id)| look(cache, *id, &toward(d)));
                let said = look(&maps[0].0, maps[0].1, &EnvLookup { up: Some(up), ..toward(d) });
                assert_eq!(seen[0], said, "{from} {d}");
                assert!(
                    seen[0].iter().zip(seen[1]).all(|(a, b)| (a - b).abs() < 1e-6),
                    "{from} {d}: {seen:?}"
                );
                for other in &seen[2..] {
                    assert!(
                        seen[0].iter().zip(other).all(|(a, b)| (a - b).abs() < 2e-3),
                        "{from} {d}: {seen:?}"
                    );
                }
            }
            // A cube is made of it as well.
            let cube = MakeOptions { mode: Mode::EnvCube, format: "tiff".into(), ..options.clone() };
            for map in ["a.env", "b.exr"] {
                folder.make(&[map], "cube.env", &cube).unwrap();
                let (cache, id) = folder.open("cube.env");
                for i in 0..50 {
                    // Directions at the seam, where colours are discontinuous, are excluded.
                    let d = any_direction(i);
                    let (seen, own) = (look(&cache, id, &toward(d)), look(&maps[0].0, maps[0].1, &toward(d)));
                    let at_seam = own[0] < 0.1 || own[0] > 0.9;
                    assert!(at_seam || (seen[1] - own[1]).abs() < 0.1, "{from} {map} {d}: {seen:?} {own:?}");
                }
            }
        }
    }
}

#[test]
fn invalid_directions_are_black() {
    let folder = Folder::new();
    cube_of(&folder, 8, &options(Mode::EnvCube), sky);
    latlong_of(&folder, (16, 8), sky);
    for name in ["cube.env", "ll.env"] {
        let (cache, id) = folder.open(name);
        for bad in [Vec3::ZERO, Vec3::NAN, Vec3::INFINITY, Vec3::new(f32::MAX, f32::MAX, 0.0)] {
            assert_eq!(look(&cache, id, &toward(bad)), [0.0; 3], "{name} {bad}");
            let v =
                look(&cache, id, &EnvLookup { drdx: bad, drdy: -bad, angle: Some(bad.x), ..toward(Vec3::X) });
            assert!(v.iter().all(|v| (0.0..=1.0).contains(v)), "{name} {bad}: {v:?}");
        }
    }
}

#[test]
fn faces_are_padded_to_tiles_and_levels_reach_one_texel() {
    let folder = Folder::new();
    let made = {
        cube_of(&folder, 100, &MakeOptions { resize: false, ..options(Mode::EnvCube) }, sky);
        folder.registry.open(&folder.path("cube.env")).unwrap()
    };
    assert_eq!(made.levels(0), 7);
    let sizes: Vec<_> = (0..7)
        .map(|l| made.spec(0, l).map(|s| (s.width, s.height, s.full_width, s.tile_width)).unwrap())
        .collect();
    assert_eq!(sizes[0], (384, 256, 100, 64));
    assert_eq!(sizes[4], (48, 32, 6, 16));
    assert_eq!(sizes[6], (48, 32, 1, 16));
    let (cache, id) = folder.open("cube.env");
    for i in 0..500 {
        let d = any_direction(i);
        let v = look(&cache, id, &toward(d));
        assert!((v[1] - sky(d, 1)).abs() < 0.01);
    }
}

#[test]
fn vertical_cross_and_light_probe_show_the_same_sky() {
    let folder = Folder::new();
    // The image is a vertical cross, with the column and row of px nx py ny pz nz.
    let cells = [(2, 1), (0, 1), (1, 0), (1, 2), (1, 1), (1, 3)];
    let n = 32;
    folder.image("vc.tif", (3 * n, 4 * n), 3, |x, y, c| {
        let Some(face) = cells.iter().position(|cell| *cell == (x / n, y / n)) else { return 0.0 };
        let ndc = |v: u32| 2.0 * ((v % n) as f32 + 0.5) / n as f32 - 1.0;
        let [forward, up, right] = FRAMES[face];
        // The lowest face is adjacent to the one above it, so that it is upside down.
        let turn = if face == 5 { -1.0 } else { 1.0 };
        sky(forward + (right * ndc(x) - up * ndc(y)) * turn, c)
    });
    folder.make(&["vc.tif"], "vc.env", &options(Mode::VertCross)).unwrap();
    // The image is an angular map of 200 pixels. The angle from +z grows evenly from the centre to the rim.
    folder.image("lp.tif", (200, 200), 3, |x, y, c| {
        let (u, v) = ((x as f32 + 0.5) / 100.0 - 1.0, 1.0 - (y as f32 + 0.5) / 100.0);
        let r = u.hypot(v);
        let angle = r * PI;
        let across = if r > 0.0 { angle.sin() / r } else { 0.0 };
        sky(Vec3::new(u * across, v * across, angle.cos()), c)
    });
    folder.make(&["lp.tif"], "lp.env", &options(Mode::LightProbe)).unwrap();
    for (name, tolerance) in [("vc.env", 0.02), ("lp.env", 0.03)] {
        let (cache, id) = folder.open(name);
        for i in 0..1000 {
            let d = any_direction(i);
            let v = look(&cache, id, &toward(d));
            for (c, v) in v.iter().enumerate() {
                assert!((v - sky(d, c)).abs() < tolerance, "{name} {d} {c}: {v} {}", sky(d, c));
            }
        }
    }
}

#[test]
fn inputs_of_wrong_sizes_are_refused() {
    let folder = Folder::new();
    for (i, name) in FACES.iter().enumerate() {
        folder.image(name, (8, if i == 3 { 9 } else { 8 }), 1, |_, _, _| 0.0);
    }
    let fails = |inputs: &[&str], mode, what: &str| {
        let error = folder.make(inputs, "x.env", &options(mode)).unwrap_err().to_string();
        assert!(error.contains(what), "{error}");
        assert!(!folder.path("x.env").exists());
    };
    fails(&FACES, Mode::EnvCube, "face ny is not square: 8 x 9");
    fails(&FACES[..5], Mode::EnvCube, "6 input files are needed, 5 given");
    fails(&["px.tif"], Mode::VertCross, "3 by 4");
    fails(&["ny.tif"], Mode::LightProbe, "square");
    fails(&["none.tif"], Mode::EnvLatLong, "none.tif");
}

/// OpenEXR stores cubes as columns, right handed. The same direction gives the same colour.
#[test]
fn openexr_maps_use_the_openexr_orientation() {
    let folder = Folder::new();
    let exr = |mode| MakeOptions { format: "OpenEXR".to_owned(), ..options(mode) };
    cube_of(&folder, 32, &exr(Mode::EnvCube), sky);
    let file = folder.registry.open(&folder.path("cube.env")).unwrap();
    let s = file.spec(0, 0).unwrap();
    assert_eq!((s.width, s.height, s.string("textureformat")), (32, 192, Some("CubeFace Environment")));
    let (cache, id) = folder.open("cube.env");
    for i in 0..1000 {
        let d = any_direction(i);
        let v = look(&cache, id, &toward(d));
        for (c, v) in v.iter().enumerate() {
            assert!((v - sky(d, c)).abs() < 0.02, "{d} {c}: {v} {}", sky(d, c));
        }
    }
    // A latitude-longitude map keeps its image, and declares that +z is up in it.
    latlong_of(&folder, (64, 32), sky);
    folder.make(&["ll.tif"], "ll.exr", &exr(Mode::EnvLatLong)).unwrap();
    let (cache, id) = folder.open("ll.exr");
    for i in 0..200 {
        let d = any_direction(i);
        let v = look(&cache, id, &toward(d));
        assert!((v[2] - sky(d, 2)).abs() < 0.02, "{d}: {v:?}");
        let v = look(&cache, id, &EnvLookup { up: Some(Up::Y), ..toward(Vec3::new(-d.y, d.z, d.x)) });
        assert!((v[2] - sky(d, 2)).abs() < 0.02, "{d}: {v:?}");
    }
}
