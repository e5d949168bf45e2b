//! Tests of `texture3d ()` with files of several images.
#![allow(clippy::unwrap_used, reason = "tests")]

mod support;

use granita_base::Vec3;
use granita_texture::{Lookup3d, TextureCache, TextureId, Wrap};
use support::{Folder, random};

/// Writes an uncompressed TIFF of float images, one channel each, of any sizes.
fn write(folder: &Folder, name: &str, images: &[(u32, u32)], f: impl Fn(u32, u32, u32) -> f32) {
    let mut bytes = vec![b'I', b'I', 42, 0, 0, 0, 0, 0];
    // The position of the link to the next directory.
    let mut link = 4;
    for (z, &(width, height)) in images.iter().enumerate() {
        let data = bytes.len() as u32;
        for i in 0..width * height {
            bytes.extend(f(i % width, i / width, z as u32).to_le_bytes());
        }
        let directory = bytes.len() as u32;
        bytes[link..link + 4].copy_from_slice(&directory.to_le_bytes());
        let entries: [(u16, u16, u32); 10] = [
            (256, 4, width),
            (257, 4, height),
            (258, 3, 32),
            (259, 3, 1),
            (262, 3, 1),
            (273, 4, data),
            (277, 3, 1),
            (278, 4, height),
            (279, 4, width * height * 4),
            (339, 3, 3),
        ];
        bytes.extend((entries.len() as u16).to_le_bytes());
        for (tag, ty, value) in entries {
            bytes.extend(tag.to_le_bytes());
            bytes.extend(ty.to_le_bytes());
            bytes.extend(1_u32.to_le_bytes());
            bytes.extend(value.to_le_bytes());
        }
        link = bytes.len();
        bytes.extend([0; 4]);
    }
    std::fs::write(folder.path(name), bytes).unwrap();
}

fn look(cache: &TextureCache, id: TextureId, lookup: &Lookup3d) -> f32 {
    let mut out = [f32::NAN];
    cache.texture3d(id, lookup, &mut out);
    out[0]
}

fn at(x: f32, y: f32, z: f32) -> Lookup3d {
    let clamp = Some(Wrap::Clamp);
    Lookup3d { p: Vec3::new(x, y, z), swrap: clamp, twrap: clamp, ..Lookup3d::default() }
}

#[test]
fn texels_of_volumes_are_found_at_their_coordinates() {
    let folder = Folder::new();
    write(&folder, "v.tif", &[(4, 3); 5], |x, y, z| (x + 10 * y + 100 * z) as f32);
    let (cache, id) = folder.open("v.tif");
    for (x, y, z) in [(0, 0, 0), (3, 2, 4), (1, 2, 3)] {
        let place = at((x as f32 + 0.5) / 4.0, (y as f32 + 0.5) / 3.0, (z as f32 + 0.5) / 5.0);
        assert!((look(&cache, id, &place) - (x + 10 * y + 100 * z) as f32).abs() < 1e-3);
    }
    // The positions are half way between slices, and outside.
    assert!((look(&cache, id, &at(0.125, 0.5 / 3.0, 0.4)) - 150.0).abs() < 1e-3);
    assert!((look(&cache, id, &at(0.125, 0.5 / 3.0, 7.0)) - 400.0).abs() < 1e-3);
    let black = Lookup3d { twrap: Some(Wrap::Black), ..at(0.125, 0.5 / 3.0, 1.2) };
    assert_eq!(look(&cache, id, &black), 0.0);
    let periodic = Lookup3d { twrap: Some(Wrap::Periodic), ..at(0.125, 0.5 / 3.0, 1.1) };
    assert!((look(&cache, id, &periodic) - 0.0).abs() < 1e-3);
    let fill = Lookup3d { first_channel: 1, fill: 0.25, ..at(0.5, 0.5, 0.5) };
    assert_eq!(look(&cache, id, &fill), 0.25);
    assert_eq!(look(&cache, id, &at(f32::NAN, 0.0, 0.0)), 0.0);
}

/// A ramp stays a ramp under any footprint that is inside. Noise becomes grey as footprints grow, in every direction.
#[test]
fn footprints_of_volumes_average_texels() {
    let folder = Folder::new();
    write(&folder, "ramp.tif", &[(32, 32); 32], |x, y, z| x as f32 + 2.0 * y as f32 + 3.0 * z as f32);
    write(&folder, "noise.tif", &[(32, 32); 32], |x, y, z| random(x + 32 * y + 1024 * z, 5));
    let ((ramp, ramp_id), (noise, noise_id)) = (folder.open("ramp.tif"), folder.open("noise.tif"));
    let mut spreads = Vec::new();
    for width in [0.02, 0.1, 0.25] {
        let mut square = 0.0;
        for i in 0..200 {
            let r = |k| random(i, k) - 0.5;
            let a = Vec3::new(r(0), r(1), r(2)).normalize() * width;
            let b = a.cross(Vec3::new(r(3), r(4), r(5))).normalize() * width;
            let p = Vec3::new(r(6), r(7), r(8)) * 0.3 + 0.5;
            let lookup = Lookup3d { dpdx: a, dpdy: b * 0.5, ..at(p.x, p.y, p.z) };
            let expected = (p * 32.0 - 0.5).dot(Vec3::new(1.0, 2.0, 3.0));
            assert!((look(&ramp, ramp_id, &lookup) - expected).abs() < 0.2, "{lookup:?}");
            square += (look(&noise, noise_id, &lookup) - 0.5).powi(2);
        }
        spreads.push((square / 200.0).sqrt());
    }
    assert!(spreads[0] > 0.1 && spreads[1] < 0.06 && spreads[2] < 0.02, "{spreads:?}");
    let blurred = Lookup3d { sblur: 0.3, tblur: 0.3, ..at(0.5, 0.5, 0.5) };
    assert!((look(&noise, noise_id, &blurred) - 0.5).abs() < 0.03);
}

#[test]
fn slices_of_different_sizes_are_reported() {
    let folder = Folder::new();
    write(&folder, "v.tif", &[(4, 3), (4, 4)], |x, _, _| x as f32);
    let (cache, id) = folder.open("v.tif");
    let mut out = [f32::NAN; 3];
    for _ in 0..2 {
        cache.texture3d(id, &Lookup3d { fill: 0.5, ..at(0.5, 0.5, 0.5) }, &mut out);
    }
    assert_eq!(out, [0.5, 0.5, 0.0]);
    let about: Vec<_> = folder.texts().into_iter().filter(|t| t.contains("slice 1 has 4 x 4")).collect();
    assert_eq!(about.len(), 1, "{about:?}");
}

/// The volume has bands of eight texels across x and across y. A blur along one direction does not change the other.
#[test]
fn blur_of_each_axis_is_independent() {
    let folder = Folder::new();
    let band = |x: u32| f32::from((x / 8).is_multiple_of(2));
    write(&folder, "x.tif", &[(32, 32); 32], |x, _, _| band(x));
    write(&folder, "y.tif", &[(32, 32); 32], |_, y, _| band(y));
    let ((across_x, x), (across_y, y)) = (folder.open("x.tif"), folder.open("y.tif"));
    let place = || at(20.0 / 32.0, 20.0 / 32.0, 0.5);
    let (s, t) = (Lookup3d { sblur: 0.3, ..place() }, Lookup3d { tblur: 0.3, ..place() });
    for (cache, id, blurs, keeps) in [(&across_x, x, &s, &t), (&across_y, y, &t, &s)] {
        let (blurred, kept) = (look(cache, id, blurs), look(cache, id, keeps));
        assert!(kept > 0.97 && blurred < 0.85, "{blurred} {kept}");
    }
}

#[test]
fn a_file_of_slices_is_a_volume() {
    let folder = Folder::new();
    write(&folder, "volume.tif", &[(4, 3); 5], |x, _, _| x as f32);
    write(&folder, "plain.tif", &[(4, 3)], |x, _, _| x as f32);
    write(&folder, "pages.tif", &[(4, 3), (2, 7)], |x, _, _| x as f32);
    for (name, kind, format) in [
        ("volume.tif", "volume", "Volume Texture"),
        ("plain.tif", "texture", "Plain Texture"),
        ("pages.tif", "texture", "Plain Texture"),
    ] {
        let (cache, _) = folder.open(name);
        let told = ["type", "textureformat"].map(|what| cache.info(name, what).unwrap().data);
        assert_eq!(told, [kind.into(), format.into()], "{name}");
    }
}
