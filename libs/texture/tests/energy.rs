//! Environment maps keep their light in every level, in TIFF and OpenEXR files, as cubes and by latitude and longitude.
//!
//! Each texel is weighted by its solid angle, which for a latitude-longitude map is proportional to the sine of the
//! polar angle at its centre.
#![allow(clippy::unwrap_used, reason = "tests")]

mod support;

use granita_base::{Filter, Vec3};
use granita_image::{ImageInput, PixelType};
use granita_texture::EnvLookup;
use granita_texture::make::{MakeOptions, Mode};
use std::f32::consts::{PI, TAU};
use support::{FACES, FRAMES, Folder, random};

fn options(mode: Mode, format: &str) -> MakeOptions {
    MakeOptions { mode, format: format.to_owned(), ..MakeOptions::default() }
}

/// The directions, solid angles and first channels of the texels of a level.
type Sphere = Vec<(Vec3, f64, f64)>;

/// Reads a level of a latitude-longitude map. Directions follow the file's own convention, which does not matter for
/// energy.
fn latlong_level(file: &dyn ImageInput, level: usize) -> Sphere {
    let s = file.spec(0, level).unwrap();
    let (w, h, n) = (s.width, s.height, s.nchannels());
    let v = file.read_level(0, level).unwrap().to_floats();
    let mut all = Vec::new();
    for y in 0..h {
        let theta = (f64::from(y) + 0.5) / f64::from(h) * std::f64::consts::PI;
        for x in 0..w {
            let phi = ((x as f32 + 0.5) / w as f32 - 0.5) * TAU;
            let (sin, cos) = (theta.sin() as f32, theta.cos() as f32);
            let d = Vec3::new(sin * phi.cos(), sin * phi.sin(), cos);
            all.push((d, theta.sin(), f64::from(v[((y * w + x) * n as u32) as usize])));
        }
    }
    all
}

/// Reads a level of a mosaic or of a column; `None` where the column is smaller than six faces.
fn cube_level(file: &dyn ImageInput, level: usize) -> Option<Sphere> {
    let s = file.spec(0, level).unwrap();
    let column = file.format_name() == "exr";
    let (n, step) = if column { (s.width, s.width) } else { (s.full_width, s.width / 3) };
    if column && s.height != 6 * s.width {
        return None;
    }
    let v = file.read_level(0, level).unwrap().to_floats();
    let mut all = Vec::new();
    let corner = |u: f64, v: f64| (u * v).atan2((u * u + v * v + 1.0).sqrt());
    let edge = |i: u32| 2.0 * f64::from(i) / f64::from(n) - 1.0;
    for face in 0..6_u32 {
        let (left, top) = if column { (0, face * n) } else { (face / 2 * step, face % 2 * step) };
        let [forward, up, right] = FRAMES[face as usize];
        for y in 0..n {
            for x in 0..n {
                let angle = corner(edge(x + 1), edge(y + 1))
                    - corner(edge(x), edge(y + 1))
                    - corner(edge(x + 1), edge(y))
                    + corner(edge(x), edge(y));
                let ndc = |i: u32| 2.0 * (i as f32 + 0.5) / n as f32 - 1.0;
                let d = (forward + right * ndc(x) - up * ndc(y)).normalize();
                let at = ((top + y) * s.width + left + x) as usize * s.nchannels();
                all.push((d, angle, f64::from(v[at])));
            }
        }
    }
    Some(all)
}

fn mean(sphere: &Sphere) -> f64 {
    sphere.iter().map(|t| t.1 * t.2).sum::<f64>() / sphere.iter().map(|t| t.1).sum::<f64>()
}

fn centre(sphere: &Sphere) -> Vec3 {
    sphere.iter().map(|t| t.0 * (t.1 * t.2) as f32).sum::<Vec3>().normalize()
}

fn levels(folder: &Folder, name: &str, cube: bool) -> Vec<Sphere> {
    let file = folder.registry.open(&folder.path(name)).unwrap();
    (0..file.levels(0))
        .filter_map(|l| if cube { cube_level(&*file, l) } else { Some(latlong_level(&*file, l)) })
        .collect()
}

/// Returns a value of an image with many dark places and a few bright ones, as in skies.
fn contrast(i: u32, c: u32) -> f32 {
    0.05 + 500.0 * random(i, c).powi(30)
}

#[test]
fn the_mean_over_the_sphere_is_the_same_in_every_level() {
    let folder = Folder::new();
    for (i, name) in FACES.iter().enumerate() {
        folder.image(name, (64, 64), 3, |x, y, c| contrast(x + 64 * y + 4096 * i as u32, c as u32));
    }
    folder.image("ll.tif", (256, 128), 3, |x, y, c| contrast(x + 256 * y, 7 + c as u32));
    for format in ["tiff", "OpenEXR"] {
        for filter in [Filter::Box, Filter::Gaussian, Filter::CatmullRom, Filter::Mitchell] {
            let o = |mode| MakeOptions { filter, ..options(mode, format) };
            folder.make(&FACES, "cube", &o(Mode::EnvCube)).unwrap();
            folder.make(&["ll.tif"], "ll", &o(Mode::EnvLatLong)).unwrap();
            for (name, cube, count) in [("cube", true, 7), ("ll", false, 9)] {
                let levels = levels(&folder, name, cube);
                assert_eq!(levels.len(), count);
                let first = mean(&levels[0]);
                for (i, level) in levels.iter().enumerate() {
                    let off = (mean(level) / first - 1.0).abs();
                    assert!(off < 1e-4, "{format} {filter:?} {name} level {i}: {off}");
                }
            }
        }
    }
}

/// Levels keep the mean for sizes that are not powers of two, and for pixels that are halves. Levels of halves are
/// checked down to the size at which the rounding of one texel is significant.
#[test]
fn odd_sizes_and_halves_keep_the_mean_over_the_sphere() {
    let folder = Folder::new();
    folder.image("ll.tif", (300, 150), 1, |x, y, _| contrast(x + 300 * y, 3));
    for (i, name) in FACES.iter().enumerate() {
        folder.image(name, (50, 50), 1, |x, y, _| contrast(x + 50 * y + 2500 * i as u32, 4));
    }
    let odd = |mode| MakeOptions { resize: false, ..options(mode, "tiff") };
    folder.make(&["ll.tif"], "ll", &odd(Mode::EnvLatLong)).unwrap();
    folder.make(&FACES, "cube", &odd(Mode::EnvCube)).unwrap();
    let half = MakeOptions { pixel_type: Some(PixelType::Half), ..options(Mode::EnvLatLong, "OpenEXR") };
    folder.make(&["ll.tif"], "half", &half).unwrap();
    for (name, cube, least) in [("ll", false, 0), ("cube", true, 0), ("half", false, 32)] {
        let levels = levels(&folder, name, cube);
        let first = mean(&levels[0]);
        for level in levels.iter().filter(|l| l.len() >= least) {
            let off = (mean(level) / first - 1.0).abs();
            assert!(off < 1e-4, "{name} {} texels: {off}", level.len());
        }
    }
}

/// The light is one texel on an edge between faces, at a corner, at a pole, and on the seam.
#[test]
fn small_lights_keep_their_place_and_energy() {
    let folder = Folder::new();
    let check = |name: &str, cube: bool, texels: f32| {
        let all = levels(&folder, name, cube);
        let (energy, place) = (mean(&all[0]), centre(&all[0]));
        for level in &all {
            let side =
                if cube { (level.len() as f32 / 6.0).sqrt() } else { (level.len() as f32 / 2.0).sqrt() };
            assert!((mean(level) / energy - 1.0).abs() < 1e-4, "{name} {side}");
            // The position is not more precise than a texel. A texel that covers a quarter of the sphere has no useful
            // direction.
            if side >= 4.0 {
                let off = centre(level).angle_between(place);
                assert!(off < texels / side, "{name} {side}: {off}");
            }
        }
    };
    for format in ["tiff", "OpenEXR"] {
        for (face, lx, ly) in [(0_usize, 63, 20), (3, 0, 0), (4, 31, 63)] {
            for (i, name) in FACES.iter().enumerate() {
                let light = |x: u32, y: u32| if (i, x, y) == (face, lx, ly) { 1e4 } else { 0.0 };
                folder.image(name, (64, 64), 1, |x, y, _| light(x, y));
            }
            folder.make(&FACES, "cube", &options(Mode::EnvCube, format)).unwrap();
            if format == "tiff" {
                check("cube", true, 2.0);
            } else {
                // The frames of the column are different. All light must still be there.
                let all = levels(&folder, "cube", true);
                assert!(all.iter().all(|l| (mean(l) / mean(&all[0]) - 1.0).abs() < 1e-4));
            }
        }
        // The texels are at the upper pole, at the lower one, and on the seam.
        for (lx, ly) in [(17, 0), (200, 127), (255, 64), (0, 30)] {
            folder.image("ll.tif", (256, 128), 1, |x, y, _| if (x, y) == (lx, ly) { 1e4 } else { 0.0 });
            folder.make(&["ll.tif"], "ll", &options(Mode::EnvLatLong, format)).unwrap();
            check("ll", false, PI);
        }
    }
}

/// One bright texel in the middle of each face is seen in the direction of table 9.3. This holds for cubes of faces in
/// either format, and for the maps converted from them.
#[test]
fn cube_faces_have_the_directions_of_the_reference() {
    let folder = Folder::new();
    for (lit, [forward, up, right]) in FRAMES.iter().enumerate() {
        // The texel is slightly above the middle and twice as much to its right, so that a rotated face is detected
        // too.
        let (lx, ly) = (36, 30);
        for (i, name) in FACES.iter().enumerate() {
            let light = |x: u32, y: u32| if (i, x, y) == (lit, lx, ly) { 1.0 } else { 0.0 };
            folder.image(name, (64, 64), 1, |x, y, _| light(x, y));
        }
        let ndc = |i: u32| 2.0 * (i as f32 + 0.5) / 64.0 - 1.0;
        let d = *forward + *right * ndc(lx) - *up * ndc(ly);
        for format in ["tiff", "OpenEXR"] {
            folder.make(&FACES, "cube", &options(Mode::EnvCube, format)).unwrap();
            folder.make(&FACES, "ll", &options(Mode::EnvLatLong, format)).unwrap();
            folder.make(&["cube"], "ll2", &options(Mode::EnvLatLong, format)).unwrap();
            folder.make(&["ll"], "cube2", &options(Mode::EnvCube, format)).unwrap();
            for (name, least) in [("cube", 0.999), ("ll", 0.25), ("ll2", 0.25), ("cube2", 0.15)] {
                let (cache, id) = folder.open(name);
                let look = |r: Vec3| {
                    let mut v = [0.0];
                    cache.environment(id, &EnvLookup { r, ..EnvLookup::default() }, &mut v);
                    v[0]
                };
                assert!(look(d) > least, "{format} {name} face {}: {}", FACES[lit], look(d));
                for other in [d - *right * 0.2, d + *up * 0.2, -d, *up, *right] {
                    assert!(look(other) < 0.01, "{format} {name} face {} {other}", FACES[lit]);
                }
            }
        }
    }
}

/// The conversion of a latitude-longitude map to a cube and back, through files, keeps values within 1 percent.
#[test]
fn map_files_survive_conversion_to_cubes_and_back() {
    let folder = Folder::new();
    let (w, h) = (256_u32, 128_u32);
    // A latitude-longitude map keeps the convention of its source file. A cube becomes a latitude-longitude map in the
    // convention of its own format.
    for (format, panorama) in [("tiff", "ll.tif"), ("OpenEXR", "ll.exr")] {
        folder.image(panorama, (w, h), 3, |x, y, c| {
            let (phi, theta) = ((x as f32 + 0.5) / w as f32 * TAU, (y as f32 + 0.5) / h as f32 * PI);
            let k = 2 + 2 * c as i32;
            0.5 + 0.2 * theta.cos() + 0.25 * theta.sin().powi(k) * (k as f32 * phi).cos()
        });
        folder.make(&[panorama], "first", &options(Mode::EnvLatLong, format)).unwrap();
        folder.make(&["first"], "cube", &options(Mode::EnvCube, format)).unwrap();
        folder.make(&["cube"], "back", &options(Mode::EnvLatLong, format)).unwrap();
        let read = |name: &str| {
            let file = folder.registry.open(&folder.path(name)).unwrap();
            file.read_level(0, 0).unwrap().to_floats()
        };
        let (a, b) = (read("first"), read("back"));
        assert_eq!(a.len(), b.len());
        let square: f64 = a.iter().zip(&b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
        let rms = (square / a.len() as f64).sqrt();
        assert!(rms < 0.01, "{format}: {rms}");
    }
}
