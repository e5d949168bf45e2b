//! Tests of `shadow ()` with maps of known scenes.
#![allow(clippy::unwrap_used, reason = "tests")]

mod support;

use granita_base::sample::{Draw, Sequence};
use granita_base::{Transform, Vec3};
use granita_image::{ImageSpec, PixelType};
use granita_texture::make::{MakeOptions, Mode};
use granita_texture::{ShadowLookup, TextureKind};
use support::{FACES, FRAMES, Folder, matrix, random};

/// Returns the camera of a light at (0, 0, -5) that looks along +z, with a field of view of 90 degrees.
fn camera() -> Transform {
    Transform::translate(Vec3::new(0.0, 0.0, 5.0))
}

/// Returns the transformation to (x/z, y/z), for a field of view of 90 degrees.
fn screen() -> Transform {
    let perspective = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 1., 0., 0., -0.1, 0.];
    camera().then(&Transform::from_rows(&perspective))
}

fn depth_image(folder: &Folder, name: &str, n: u32, matrices: bool, f: impl Fn(u32, u32) -> f32) {
    let mut spec = ImageSpec::new(n, n, 1, PixelType::Float);
    if matrices {
        spec.attributes.set(matrix("worldtocamera", &camera().to_rows()));
        spec.attributes.set(matrix("worldtoscreen", &screen().to_rows()));
    }
    folder.image_of(name, spec, |x, y, _| f(x, y));
}

fn options(mode: Mode) -> MakeOptions {
    MakeOptions { mode, ..MakeOptions::default() }
}

fn point(x: f32, y: f32, z: f32) -> ShadowLookup {
    ShadowLookup { p: Vec3::new(x, y, z), ..ShadowLookup::default() }
}

/// Makes a map in which the left half of the view is blocked at depth 5 (world z = 0).
fn half_blocked(folder: &Folder) {
    depth_image(folder, "z.tif", 128, true, |x, _| if x < 64 { 5.0 } else { 1e30 });
    folder.make(&["z.tif"], "z.sm", &options(Mode::Shadow)).unwrap();
}

#[test]
fn shadow_edges_are_in_place() {
    let folder = Folder::new();
    half_blocked(&folder);
    let (cache, id) = folder.open("z.sm");
    assert_eq!(cache.kind(id), TextureKind::Shadow);
    let s = |x: f32, z: f32| cache.shadow(id, &point(x, 0.0, z));
    // On a plane at depth 10 a texel is 20/128 wide. The edge is at x = 0.
    let texel = 20.0 / 128.0;
    assert_eq!(s(-texel, 5.0), 1.0);
    assert_eq!(s(texel, 5.0), 0.0);
    assert!((s(0.0, 5.0) - 0.5).abs() < 1e-4);
    assert!((s(-0.25 * texel, 5.0) - 0.75).abs() < 1e-3);
    // There is light in front of the blocker, and within the bias behind it.
    assert_eq!(s(-1.0, -1.0), 0.0);
    assert_eq!(s(-1.0, 0.005), 0.0);
    assert_eq!(s(-1.0, 0.02), 1.0);
    // The points are behind the light, beside the map, and not finite.
    assert_eq!(s(-1.0, -9.0), 0.0);
    assert_eq!(s(-100.0, 5.0), 0.0);
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        assert_eq!(s(bad, 5.0), 0.0);
        assert_eq!(s(0.0, bad), 0.0);
        let odd = ShadowLookup {
            dpdx: Vec3::splat(bad),
            sblur: bad,
            bias: bad,
            swidth: bad,
            ..point(-3.0, 0.0, 5.0)
        };
        assert!((0.0..=1.0).contains(&cache.shadow(id, &odd)));
    }
}

#[test]
fn shadow_maps_have_the_orientation_of_the_world() {
    let folder = Folder::new();
    depth_image(&folder, "z.tif", 64, true, |_, y| if y < 32 { 5.0 } else { 1e30 });
    folder.make(&["z.tif"], "z.sm", &options(Mode::Shadow)).unwrap();
    let (cache, id) = folder.open("z.sm");
    assert_eq!(cache.shadow(id, &point(0.0, 2.0, 5.0)), 1.0);
    assert_eq!(cache.shadow(id, &point(0.0, -2.0, 5.0)), 0.0);
}

#[test]
fn a_blurred_shadow_has_a_linear_penumbra_of_the_blur_width() {
    let folder = Folder::new();
    half_blocked(&folder);
    let (cache, id) = folder.open("z.sm");
    for samples in [16, 64, 256] {
        for i in 0..40 {
            // The offsets are from -0.15 to 0.15 of the map's width, which is 20 at this depth.
            let offset = (i as f32 / 39.0 - 0.5) * 0.3;
            let q = ShadowLookup {
                sblur: 0.2,
                tblur: 0.2,
                samples,
                draw: Draw::alone(Sequence::new(i)),
                ..point(offset * 20.0, 0.0, 5.0)
            };
            let expected = (0.5 - offset / 0.2).clamp(0.0, 1.0);
            let got = cache.shadow(id, &q);
            // The samples are stratified in rows of the edge's direction, so that the error is about one stratum.
            let tolerance = 1.0 / samples as f32 + 0.05;
            assert!((got - expected).abs() < tolerance, "{samples} {offset}: {got} {expected}");
            assert_eq!(got.to_bits(), cache.shadow(id, &q).to_bits());
        }
    }
}

#[test]
fn shadow_lookups_average_their_footprint() {
    let folder = Folder::new();
    half_blocked(&folder);
    let (cache, id) = folder.open("z.sm");
    let mut sum = 0.0;
    for seed in 0..50 {
        let q = ShadowLookup {
            dpdx: Vec3::X * 4.0,
            dpdy: Vec3::Y,
            draw: Draw::alone(Sequence::new(seed)),
            samples: 64,
            ..point(1.0, 0.0, 5.0)
        };
        let v = cache.shadow(id, &q);
        assert!((v - 0.25).abs() < 0.06, "{v}");
        sum += v / 50.0;
        assert_eq!(cache.shadow(id, &ShadowLookup { swidth: 0.0, twidth: 0.0, ..q }), 0.0);
    }
    assert!((sum - 0.25).abs() < 0.01, "{sum}");
}

#[test]
fn shadow_maps_need_matrices_which_options_can_give() {
    let folder = Folder::new();
    depth_image(&folder, "z.tif", 16, false, |_, _| 5.0);
    let error = folder.make(&["z.tif"], "z.sm", &options(Mode::Shadow)).unwrap_err().to_string();
    assert!(error.contains("worldtocamera") && error.contains("-Mcamera"), "{error}");
    let given = MakeOptions {
        mcamera: Some(camera().to_rows()),
        mscreen: Some(screen().to_rows()),
        ..options(Mode::Shadow)
    };
    folder.make(&["z.tif"], "z.sm", &given).unwrap();
    let (cache, id) = folder.open("z.sm");
    assert_eq!(cache.shadow(id, &point(0.0, 0.0, 1.0)), 1.0);
    let m = cache.info("z.sm", "viewingmatrix").unwrap();
    assert_eq!(m.data.to_floats().unwrap()[..], camera().to_rows());
    assert_eq!(cache.info("z.sm", "type").unwrap().data, "shadow".into());
    // A texture is not a shadow map. It gives no shadow and one warning.
    folder.image("t.tif", (8, 8), 3, |_, _, _| 0.0);
    let id = cache.find("t.tif").unwrap();
    for _ in 0..2 {
        assert_eq!(cache.shadow(id, &point(0.0, 0.0, 1.0)), 0.0);
    }
    assert_eq!(folder.texts().iter().filter(|t| t.contains("is not a shadow map")).count(), 1);
}

/// Makes a map of a light at (0, 0, -5) inside a cube of depth 4. Every face is a wall, except for the missing ones.
fn shadow_cube(folder: &Folder, names: &[&str; 6]) {
    for name in FACES {
        depth_image(folder, name, 50, true, |_, _| 4.0);
    }
    folder.make(names, "cube.sm", &options(Mode::ShadCube)).unwrap();
}

#[test]
fn cube_shadow_maps_cast_shadows_in_all_directions() {
    let folder = Folder::new();
    shadow_cube(&folder, &FACES);
    let (cache, id) = folder.open("cube.sm");
    assert_eq!(cache.kind(id), TextureKind::CubeFaceShadow);
    let light = Vec3::new(0.0, 0.0, -5.0);
    for i in 0..3000 {
        let r = |k| random(i, k) * 2.0 - 1.0;
        let d = Vec3::new(r(0), r(1), r(2));
        let depth = d.abs().max_element();
        let at = |depth_wanted: f32| ShadowLookup {
            p: light + d / depth * depth_wanted,
            sblur: if i % 2 == 0 { 0.05 } else { 0.0 },
            tblur: if i % 2 == 0 { 0.05 } else { 0.0 },
            draw: Draw::alone(Sequence::new(i)),
            ..ShadowLookup::default()
        };
        // Blur across an edge may compare with a depth slightly larger than the point's.
        assert_eq!(cache.shadow(id, &at(3.7)), 0.0, "{d}");
        assert_eq!(cache.shadow(id, &at(4.3)), 1.0, "{d}");
    }
    // At the light itself there is no shadow.
    assert_eq!(cache.shadow(id, &ShadowLookup { p: light, ..ShadowLookup::default() }), 0.0);
}

/// The map has round objects between a light and a ball around it. Their shadows are continuous over the edges and
/// corners of the cube, sharp and blurred.
#[test]
fn cube_shadows_are_continuous_over_edges() {
    let folder = Folder::new();
    const N: u32 = 64;
    let balls = [Vec3::new(1.0, 1.0, 1.0), Vec3::new(-1.0, 1.0, 0.3), Vec3::new(0.2, -1.0, -1.0)];
    for (name, [forward, up, right]) in FACES.iter().zip(FRAMES) {
        depth_image(&folder, name, N, true, |x, y| {
            let ndc = |v: u32| 2.0 * (v as f32 + 0.5) / N as f32 - 1.0;
            let d = (forward + right * ndc(x) - up * ndc(y)).normalize();
            let hit = balls.iter().filter_map(|c| {
                let (along, left) = (d.dot(*c), 0.5 - c.length_squared());
                let root = along * along + left;
                (along > 0.0 && root > 0.0).then(|| (along - root.sqrt()) * d.dot(forward))
            });
            hit.fold(1e30, f32::min)
        });
    }
    folder.make(&FACES, "cube.sm", &options(Mode::ShadCube)).unwrap();
    let (cache, id) = folder.open("cube.sm");
    let light = Vec3::new(0.0, 0.0, -5.0);
    let (mut worst, mut partly) = (0.0_f32, 0);
    for i in 0..6000 {
        let third = if i % 10 == 0 { 1.0 } else { random(i, 1) * 2.0 - 1.0 };
        let sign = |k| if random(i, k) < 0.5 { -1.0 } else { 1.0 };
        let (a, b) = (sign(2), sign(3));
        let edge = match i % 3 {
            0 => Vec3::new(a, b, third),
            1 => Vec3::new(a, third, b),
            _ => Vec3::new(third, a, b),
        };
        let aside = Vec3::new(random(i, 4) - 0.5, random(i, 5) - 0.5, random(i, 6) - 0.5) * 1e-5;
        let blur = [0.0, 0.05, 0.3][i as usize / 3 % 3];
        let look = |d: Vec3| {
            let q = ShadowLookup {
                p: light + d.normalize() * 3.0,
                sblur: blur,
                tblur: blur,
                samples: 64,
                draw: Draw::alone(Sequence::new(i)),
                ..ShadowLookup::default()
            };
            cache.shadow(id, &q)
        };
        let (one, other) = (look(edge + aside), look(edge - aside));
        worst = worst.max((one - other).abs());
        partly += u32::from(one > 0.01 && one < 0.99);
    }
    assert!(partly > 500 && worst < 1e-3, "{worst}, {partly}");
}

/// The map is a ball of fog around a light, with opacity 0.5 at its surface, in a cube of volume maps. Opacity grows
/// evenly from radius 2 to 6 on all faces, and no edge is visible.
#[test]
fn cube_volume_maps_are_continuous_over_edges() {
    let folder = Folder::new();
    const N: u32 = 64;
    for (name, [forward, up, right]) in FACES.iter().zip(FRAMES) {
        let mut spec = ImageSpec::new(N, N, 5, PixelType::Float);
        spec.attributes.set(matrix("worldtocamera", &camera().to_rows()));
        spec.attributes.set(matrix("worldtoscreen", &screen().to_rows()));
        folder.image_of(name, spec, |x, y, c| {
            let ndc = |v: u32| 2.0 * (v as f32 + 0.5) / N as f32 - 1.0;
            let d = (forward + right * ndc(x) - up * ndc(y)).normalize().dot(forward);
            [1e30, 0.5, 2.0 * d, 4.0 * d, 6.0 * d][c]
        });
    }
    folder.make(&FACES, "cube.vsm", &options(Mode::ShadCube)).unwrap();
    let input = folder.registry.open(&folder.path("cube.vsm")).unwrap();
    assert_eq!((input.levels(0), input.spec(0, 0).unwrap().nchannels()), (7, 5));
    let (cache, id) = folder.open("cube.vsm");
    assert_eq!(cache.kind(id), TextureKind::CubeFaceVolumeShadow);
    assert_eq!(cache.info("cube.vsm", "type").unwrap().data, "shadow".into());
    let light = Vec3::new(0.0, 0.0, -5.0);
    let look = |d: Vec3, radius: f32, blur: f32, seed: u32| {
        let p = light + d.normalize() * radius;
        let q = ShadowLookup {
            p,
            sblur: blur,
            tblur: blur,
            bias: 0.0,
            draw: Draw::alone(Sequence::new(seed)),
            ..ShadowLookup::default()
        };
        cache.shadow(id, &q)
    };
    for i in 0..3000 {
        let r = |k| random(i, k) * 2.0 - 1.0;
        let d = Vec3::new(r(0), r(1), r(2));
        let radius = 1.0 + 6.0 * random(i, 3);
        let expected = 0.5 * ((radius - 2.0) / 4.0).clamp(0.0, 1.0);
        let got = look(d, radius, 0.0, i);
        assert!((got - expected).abs() < 0.01, "{d} at {radius}: {got}, {expected}");
        // Blur changes the direction at the same depth along the face's axis. Points towards the middle are nearer.
        let got = look(d, radius, 0.05, i);
        assert!((got - expected).abs() < 0.03, "{d} at {radius}, blurred: {got}, {expected}");
    }
    for i in 0..3000 {
        let sign = |k| if random(i, k) < 0.5 { -1.0 } else { 1.0 };
        let edge = Vec3::new(sign(1), sign(2), random(i, 3) * 2.0 - 1.0);
        let aside = Vec3::new(random(i, 4) - 0.5, random(i, 5) - 0.5, random(i, 6) - 0.5) * 1e-5;
        let jump = look(edge + aside, 4.0, 0.0, i) - look(edge - aside, 4.0, 0.0, i);
        assert!(jump.abs() < 1e-3, "{edge}: {jump}");
    }
    // A face without a file is clear. Faces of one depth and of volumes cannot be combined.
    folder
        .make(&["-", FACES[1], FACES[2], FACES[3], FACES[4], FACES[5]], "x.vsm", &options(Mode::ShadCube))
        .unwrap();
    let id = cache.find("x.vsm").unwrap();
    let at = |x: f32| ShadowLookup { p: light + Vec3::X * x, ..ShadowLookup::default() };
    assert_eq!(cache.shadow(id, &at(5.0)), 0.0);
    assert!(cache.shadow(id, &at(-5.0)) > 0.3);
    depth_image(&folder, "px.tif", N, true, |_, _| 4.0);
    let error = folder.make(&FACES, "y.vsm", &options(Mode::ShadCube)).unwrap_err().to_string();
    assert!(error.contains("face nx holds a volume for a pixel, those before it one depth"), "{error}");
}

#[test]
fn empty_faces_cast_no_shadow() {
    let folder = Folder::new();
    let mut names = FACES;
    names[0] = "-";
    names[3] = "-";
    shadow_cube(&folder, &names);
    let (cache, id) = folder.open("cube.sm");
    let shadow = |d: Vec3| {
        let p = Vec3::new(0.0, 0.0, -5.0) + d * 10.0;
        cache.shadow(id, &ShadowLookup { p, ..ShadowLookup::default() })
    };
    let seen = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z].map(shadow);
    assert_eq!(seen, [0.0, 1.0, 1.0, 0.0, 1.0, 1.0]);
    // Without pz the matrices are missing.
    let mut names = FACES;
    names[4] = "-";
    let inputs: Vec<&str> = names.to_vec();
    let error = folder.make(&inputs, "x.sm", &options(Mode::ShadCube)).unwrap_err().to_string();
    assert!(error.contains("pz"), "{error}");
    let error = folder.make(&["-"; 6], "x.sm", &options(Mode::ShadCube)).unwrap_err().to_string();
    assert!(error.contains("empty"), "{error}");
}

#[test]
fn volume_shadow_maps_have_their_opacity_by_depth() {
    let folder = Folder::new();
    let mut spec = ImageSpec::new(64, 64, 5, PixelType::Float);
    spec.attributes.set(matrix("worldtocamera", &camera().to_rows()));
    spec.attributes.set(matrix("worldtoscreen", &screen().to_rows()));
    // There is smoke of opacity 0.6 from depth 4 to 8, half of it up to 5, and a wall at 20.
    let texel = [20.0, 0.6, 4.0, 5.0, 8.0];
    folder.image_of("v.tif", spec, |_, _, c| texel[c]);
    folder.make(&["v.tif"], "v.vsm", &options(Mode::VolShad)).unwrap();
    let input = folder.registry.open(&folder.path("v.vsm")).unwrap();
    assert_eq!(input.levels(0), 7);
    let (cache, id) = folder.open("v.vsm");
    assert_eq!(cache.kind(id), TextureKind::VolumeShadow);
    for blur in [0.0, 0.3] {
        let at = |depth: f32| {
            let q = ShadowLookup { sblur: blur, tblur: blur, bias: 0.0, ..point(0.0, 0.0, depth - 5.0) };
            cache.shadow(id, &q)
        };
        for (depth, a) in
            [(3.0, 0.0), (4.5, 0.15), (5.0, 0.3), (6.5, 0.45), (9.0, 0.6), (19.0, 0.6), (21.0, 1.0)]
        {
            assert!((at(depth) - a).abs() < 1e-4, "{blur} {depth}: {} {a}", at(depth));
        }
    }
}
