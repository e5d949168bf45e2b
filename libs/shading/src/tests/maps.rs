//! Tests the lookups of shaders in files that the renderer performs.

use super::near;
use crate::fixture::{Finish as _, Fixture, flat_grid, param, shader};
use crate::{ShaderThread, ShadingContext};
use granita_base::{Color, Transform, Vec3};
use granita_image::{CreateOptions, FormatRegistry, ImageSpec, Limits, PixelType, Pixels};
use granita_scene::AttributeSet;
use granita_texture::make::{MakeOptions, Mode, make};
use std::f32::consts::{PI, TAU};
use std::path::{Path, PathBuf};

fn formats() -> FormatRegistry {
    granita_plugin::bundled_formats(Limits::default())
}

/// Writes an image of floats and makes a texture of it.
fn texture(
    folder: &Path,
    name: &str,
    size: (u32, u32),
    mode: Mode,
    f: impl Fn(u32, u32) -> Color,
) -> PathBuf {
    let (image, texture) = (folder.join("image.tif"), folder.join(name));
    let spec = ImageSpec::new(size.0, size.1, 3, PixelType::Float);
    let values = (0..size.0 * size.1).flat_map(|i| f(i % size.0, i / size.0).to_array()).collect();
    let mut file = formats().create(&image, "tiff", &CreateOptions::new(&spec, 1)).unwrap();
    file.write_rows(&Pixels::Float(values)).unwrap();
    file.close().unwrap();
    make(&[image], &texture, &MakeOptions { mode, ..MakeOptions::default() }, &formats(), &|_, _| ())
        .unwrap();
    texture
}

/// Makes a panorama, +z up, that stores every direction as a colour.
fn directions(folder: &Path) -> PathBuf {
    texture(folder, "d.env", (256, 128), Mode::EnvLatLong, |x, y| {
        let (phi, theta) = (((x as f32 + 0.5) / 256.0 - 0.5) * TAU, (y as f32 + 0.5) / 128.0 * PI);
        Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()) * 0.5 + 0.5
    })
}

/// Returns the colour of a surface shader at a point of the plane z = 0. `to_world` transforms from the shader's space
/// to world space.
fn color_at(f: &mut Fixture, name: &str, file: &Path, to_world: Transform, point: [f32; 2]) -> Color {
    let surface = shader(name, &[param("string file", file.to_str().unwrap())], to_world);
    let attributes = AttributeSet { surface: Some(surface), ..f.attributes("", &[], &[]) };
    let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, attributes);
    let (scene, camera, mut environment) = f.finish();
    environment.registry = formats();
    let frame = ShadingContext::new(&scene, &camera, &environment);
    let object = frame.object(&floor);
    let mut grid = flat_grid(&[point]);
    ShaderThread::new(&frame).shade(&object, &mut grid, &[]);
    grid.c.get(0)
}

fn close(got: Color, direction: Vec3) {
    let wanted = direction.normalize() * 0.5 + 0.5;
    assert!((got - wanted).abs().max_element() < 0.01, "{got} is not {wanted}");
}

#[test]
fn environment_lookups_apply_their_space_and_radius() {
    let folder = tempfile::tempdir().unwrap();
    let file = directions(folder.path());
    let plain = "surface plain (string file = \"\") { C = environment (file, vector (1, 2, -2)); }";
    let spaced = "surface spaced (string file = \"\") {
        C = environment (file, vector (1, 2, -2), \"space\", \"shader\");
    }";
    let near_by = "surface near (string file = \"\") {
        C = environment (file, P, vector (1, 0, 0), \"space\", \"shader\", \"radius\", 5);
    }";
    let far =
        "surface far (string file = \"\") { C = environment (file, P, vector (1, 0, 0), \"radius\", 0); }";
    let alpha = "surface alpha (string file = \"\") {
        float a = 0.5, d = 0;
        C = environment (file, vector (1, 2, -2), \"alpha\", a, \"hitdist\", d, \"firstchannel\", 1, \"fill\", 0.25);
        C = color (C[0], a, d / 1e38);
    }";
    let mut f = Fixture::new(&[plain, spaced, near_by, far, alpha]);
    let r = Vec3::new(1.0, 2.0, -2.0);
    let turned = Transform::rotate(90.0_f32.to_radians(), Vec3::Z);
    close(color_at(&mut f, "plain", &file, turned, [0.0; 2]), r);
    close(color_at(&mut f, "spaced", &file, turned, [0.0; 2]), turned.inverse().vector(r));
    // The environment is a ball of radius 5 around (0, 1, 0). The lookup along x starts at (0, 4, 0), 3 units from its
    // centre.
    let moved = Transform::translate(Vec3::Y);
    close(color_at(&mut f, "near", &file, moved, [0.0, 4.0]), Vec3::new(4.0, 3.0, 0.0));
    close(color_at(&mut f, "far", &file, moved, [0.0, 4.0]), Vec3::X);
    // Two channels remain from the second one on. The third and all later ones are filled.
    let got = color_at(&mut f, "alpha", &file, turned, [0.0; 2]);
    assert!((got.x - (0.5 + 1.0 / 3.0)).abs() < 0.01, "{got}");
    near(Color::new(0.0, got.y, got.z), Color::new(0.0, 0.25, 1.0));
    assert_eq!(f.complaints(), Vec::<String>::new());
}

/// Directions sampled from a map return its light, on a surface that faces +z.
#[test]
fn directions_sampled_from_a_map_carry_its_light() {
    let folder = tempfile::tempdir().unwrap();
    let source = |samples: u32| {
        format!(
            "surface drawn{samples} (string file = \"\") {{
                color sum = 0;
                float k;
                for (k = 0; k < {samples}; k += 1) {{
                    vector d = 0;
                    color c = (color) environment (file, vector (0, 0, 1), \"samples\", {samples}, \"sample\", k, \"direction\", d);
                    sum += c * max (0, d[2]) / M_PI;
                }}
                C = sum;
            }}"
        )
    };
    let (few, many) = (source(32), source(1024));
    let mut f = Fixture::new(&[&few, &many]);
    let at =
        |f: &mut Fixture, name: &str, file: &Path| color_at(f, name, file, Transform::IDENTITY, [0.3; 2]);
    let even = texture(folder.path(), "even.env", (64, 32), Mode::EnvLatLong, |_, _| Color::splat(0.5));
    let got = at(&mut f, "drawn1024", &even);
    assert!((got - 0.5).abs().max_element() < 2e-3, "{got}");
    // One bright texel acts as a point light. The expected value is its solid angle times the cosine, over pi.
    let sun = texture(folder.path(), "sun.env", (256, 128), Mode::EnvLatLong, |x, y| {
        if (x, y) == (200, 30) { Color::new(5000.0, 2500.0, 0.0) } else { Color::ZERO }
    });
    let z = |row: f32| (row / 128.0 * PI).cos();
    let exact = 5000.0 * (z(30.0) - z(31.0)) * TAU / 256.0 * z(30.5) / PI;
    let few = at(&mut f, "drawn32", &sun);
    assert!((few.x / exact - 1.0).abs() < 0.25, "{few} for {exact}");
    let many = at(&mut f, "drawn1024", &sun);
    assert!((many.x / exact - 1.0).abs() < 0.03, "{many} for {exact}");
    assert!((many.y / many.x - 0.5).abs() < 1e-3 && many.z == 0.0, "{many}");
    assert_eq!(f.complaints(), Vec::<String>::new());
}

/// A light samples directions in the region where light is gathered. This is in front of the surface, behind it, or the
/// whole sphere.
#[test]
fn lights_sample_directions_where_light_is_gathered() {
    let folder = tempfile::tempdir().unwrap();
    let sky = "light sky (string file = \"\", float n = 16) {
        float k;
        for (k = 0; k < n; k += 1) {
            vector toward = 0;
            color arrives = (color) environment (file, vector (Ns), \"samples\", n, \"sample\", k, \"direction\", toward);
            emit (-toward, 0) { Cl = arrives / M_PI; }
        }
    }";
    let front = "surface front () { C = diffuse (normalize (N)); }";
    let behind = "surface behind () {
        C = 0;
        lights (P, -N, M_PI_2) { C += Cl * max (0, dot (normalize (L), normalize (-N))); }
    }";
    let around = "surface around () { C = 0; lights (P) { C += Cl; } }";
    let both = "surface both () { C = diffuse (normalize (N)); lights (P) { C += Cl; } }";
    let half = texture(folder.path(), "half.env", (64, 32), Mode::EnvLatLong, |_, y| {
        Color::splat(if y < 16 { 1.0 } else { 3.0 })
    });
    let mut f = Fixture::new(&[sky, front, behind, around, both]);
    let file = param("string file", half.to_str().unwrap());
    f.light("sky", &[file], Transform::IDENTITY);
    // "front" and "behind" return the irradiance over pi, "around" the light of the whole sphere over pi, and "both"
    // the sum of "front" and "around".
    // A light draws as many more or fewer directions as all numbers of samples are multiplied by.
    let cases = [("front", 1.0, 0.06), ("behind", 3.0, 0.18), ("around", 8.0, 0.3), ("both", 9.0, 0.3)];
    let factors = [(1.0, 1.0), (0.5, 2.0), (2.5, 1.0), (64.0, 0.03)];
    for ((name, expected, off), (factor, of_off)) in
        cases.into_iter().flat_map(|case| factors.map(|f| (case, f)))
    {
        let off = off * of_off;
        let attributes = f.attributes(name, &[], &[]);
        let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, attributes);
        let (scene, camera, mut environment) = f.finish();
        environment.registry = formats();
        let frame = ShadingContext::new(&scene, &camera, &environment);
        frame.set_samples(factor);
        let object = frame.object(&floor);
        let mut grid = flat_grid(&[[0.3; 2], [0.4; 2], [-3.0, 2.0]]);
        ShaderThread::new(&frame).shade(&object, &mut grid, &[]);
        for lane in 0..3 {
            let got = grid.c.get(lane);
            assert!((got - expected).abs().max_element() < off, "{name}, {factor}: {got} for {expected}");
        }
    }
    assert_eq!(f.complaints(), Vec::<String>::new());
}

/// Directions that were sampled in advance for one query are not used for another query.
#[test]
fn sampled_directions_are_reused_for_the_same_query_only() {
    let folder = tempfile::tempdir().unwrap();
    let a = texture(folder.path(), "a.env", (64, 32), Mode::EnvLatLong, |_, _| Color::new(2.0, 1.0, 0.5));
    let b = texture(folder.path(), "b.env", (64, 32), Mode::EnvLatLong, |_, _| Color::splat(4.0));
    let several = format!(
        "surface several (string file = \"\") {{
            C = 0;
            float k;
            for (k = 0; k < 32; k += 1) {{
                C[0] += (float) environment (file, N, \"samples\", 32, \"sample\", k) / 32;
                C[1] += (float) environment (file, N, \"samples\", 32, \"sample\", k, \"firstchannel\", 1) / 32;
                C[2] += (float) environment (\"{}\", N, \"samples\", 32, \"sample\", k) / 32;
            }}
            C *= 32 / (4 * M_PI);
            // Beyond the last there are more of the same kind.
            if (C[0] > 1) C[1] += 0 * (float) environment (file, N, \"samples\", 3, \"sample\", 9);
        }}",
        b.display()
    );
    let mut f = Fixture::new(&[&several]);
    let got = color_at(&mut f, "several", &a, Transform::IDENTITY, [0.3; 2]);
    assert!((got - Color::new(2.0, 1.0, 4.0)).abs().max_element() < 0.05, "{got}");
    assert_eq!(f.complaints(), Vec::<String>::new());
}

#[test]
fn missing_maps_are_filled_reported_once_and_substituted() {
    let folder = tempfile::tempdir().unwrap();
    let file = texture(folder.path(), "grey.tx", (16, 16), Mode::Plain, |_, _| Color::splat(0.5));
    let missing = folder.path().join("nothing.tx");
    let plain = "surface plain (string file = \"\") {
        float a = 1;
        C = texture (file, 0.5, 0.5, \"fill\", 0.25, \"alpha\", a, \"wrap\", \"clamp\");
        C += texture (file, 0.5, 0.5, \"fill\", 0.25, \"wrap\", \"clamp\");
        C += color (a, 0, 0);
    }";
    let mut f = Fixture::new(&[plain]);
    let at = |f: &mut Fixture, file: &Path| color_at(f, "plain", file, Transform::IDENTITY, [0.0; 2]);
    near(at(&mut f, &missing), Color::splat(0.5));
    assert_eq!(f.complaints().iter().filter(|c| c.contains("nothing.tx")).count(), 1, "{:?}", f.complaints());
    f.global("string texture:substtexture", file.to_str().unwrap());
    // Its fourth channel is missing and filled.
    near(at(&mut f, &missing), Color::new(1.25, 1.0, 1.0));
    near(at(&mut f, &file), Color::new(1.25, 1.0, 1.0));
}

/// A lookup is continuous across the edge between two grids, because a footprint is that of the surface and not of
/// the grid.
#[test]
fn footprints_are_the_same_on_both_sides_of_a_border() {
    let folder = tempfile::tempdir().unwrap();
    let file = texture(folder.path(), "noise.tx", (256, 256), Mode::Plain, |x, y| {
        Color::splat(granita_base::hash::unit(granita_base::hash::words(&[x, y])))
    });
    let source = "surface bent (string file = \"\") {
        float x = P[0] / 10, y = P[1] / 10;
        C = texture (file, 0.3 + 0.3 * x * x + 0.05 * y, 0.4 + 0.2 * x + 0.3 * y * y);
    }";
    let mut f = Fixture::new(&[source]);
    let surface = shader("bent", &[param("string file", file.to_str().unwrap())], Transform::IDENTITY);
    let attributes = AttributeSet { surface: Some(surface), ..f.attributes("", &[], &[]) };
    let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, attributes);
    let (scene, camera, mut environment) = f.finish();
    environment.registry = formats();
    let frame = ShadingContext::new(&scene, &camera, &environment);
    let object = frame.object(&floor);
    // Two grids of 9 x 9 points share the points of one side.
    const N: usize = 9;
    let grid = |x0: f32| {
        let mut grid = granita_shade::Grid::new(granita_shade::Topology::Rect { nu: N, nv: N });
        for i in 0..N * N {
            let (x, y) = (x0 + (i % N) as f32 * 0.25, (i / N) as f32 * 0.25);
            grid.p.set(i, Vec3::new(x, y, 0.0));
            (grid.u[i], grid.v[i]) = (x / 10.0, y / 10.0);
        }
        ShaderThread::new(&frame).shade(&object, &mut grid, &[]);
        grid
    };
    let (left, right) = (grid(1.0), grid(3.0));
    for j in 0..N {
        let (a, b) = (left.c.get(j * N + N - 1), right.c.get(j * N));
        assert!((a - b).abs().max_element() < 2e-3, "{j}: {a} {b}");
    }
}
