//! Environment maps from pictures of all sorts.

use super::input::Input;
use super::output::{Body, Texture};
use super::{MakeOptions, notes_of, power_of_two};
use crate::cube::{self, CubeLayout, FACE_NAMES};
use crate::error::{Result, TextureError};
use crate::picture::Picture;
use crate::{TextureKind, Wrap};
use granita_base::{Filter, Vec3};
use rayon::prelude::*;

const CLAMP: (Wrap, Wrap) = (Wrap::Clamp, Wrap::Clamp);

fn malformed(input: &Input, what: String) -> TextureError {
    TextureError::Malformed { path: input.path.clone(), what }
}

/// Faces are of one size, square, with the same channels; that size. `places` are their indices in
/// [`FACE_NAMES`].
pub(crate) fn check_faces(inputs: &[Input], places: &[usize]) -> Result<usize> {
    let first = &inputs[0];
    let first_name = FACE_NAMES[places[0]];
    for (input, name) in inputs.iter().zip(places.iter().map(|p| FACE_NAMES[*p])) {
        let (p, q) = (&input.picture, &first.picture);
        if p.width != p.height {
            return Err(malformed(input, format!("face {name} is not square: {} x {}", p.width, p.height)));
        }
        if (p.width, p.channels) != (q.width, q.channels) {
            return Err(malformed(
                input,
                format!(
                    "face {name} has {} x {} pixels of {} channels, face {first_name} {} x {} of {}",
                    p.width, p.height, p.channels, q.width, q.height, q.channels
                ),
            ));
        }
    }
    Ok(first.picture.width)
}

/// Pyramids of six faces, level by level.
pub(crate) fn cube_pyramid(faces: Vec<Picture>, filter: Filter) -> Vec<[Picture; 6]> {
    let mut pyramids: Vec<_> =
        faces.into_par_iter().map(|face| face.pyramid(filter, CLAMP).into_iter()).collect();
    let mut levels = Vec::new();
    loop {
        let level: Vec<Picture> = pyramids.iter_mut().filter_map(Iterator::next).collect();
        match <[Picture; 6]>::try_from(level) {
            Ok(level) => levels.push(level),
            Err(_) => return levels,
        }
    }
}

/// A square picture with `fov_deg`, as one with 90 degrees and `n` pixels: cut or extended by its border.
fn refit(face: &Picture, fov_deg: f32, n: usize) -> Picture {
    let scale = 1.0 / (fov_deg.to_radians() * 0.5).tan();
    if (scale - 1.0).abs() < 1e-6 {
        return face.resized(n, n, Filter::CatmullRom, CLAMP);
    }
    let size = face.width as f32;
    let mut out = Picture::new(n, n, face.channels);
    out.data.par_chunks_mut(n * face.channels).enumerate().for_each(|(y, row)| {
        for (x, texel) in row.chunks_exact_mut(face.channels).enumerate() {
            let place = |i: usize| {
                let ndc = 2.0 * (i as f32 + 0.5) / n as f32 - 1.0;
                (ndc * scale * 0.5 + 0.5) * size
            };
            face.bilinear(place(x), place(y), texel);
        }
    });
    out
}

fn finish(mut inputs: Vec<Input>, faces: Vec<Picture>, options: &MakeOptions) -> Texture {
    let notes = notes_of(&inputs);
    let pixel_type = inputs.iter().map(|i| i.pixel_type).max().unwrap_or(granita_image::PixelType::Float);
    let main = inputs.swap_remove(if inputs.len() == 6 { 4 } else { 0 });
    Texture {
        kind: TextureKind::CubeFaceEnvironment,
        body: Body::Cube(cube_pyramid(faces, options.filter)),
        channels: main.channels,
        pixel_type,
        attributes: main.attributes,
        notes,
    }
}

fn face_size(n: usize, options: &MakeOptions) -> usize {
    if options.resize { power_of_two(n) } else { n }
}

/// `-envcube`.
pub(crate) fn cube(inputs: Vec<Input>, options: &MakeOptions) -> Result<Texture> {
    let n = face_size(check_faces(&inputs, &[0, 1, 2, 3, 4, 5])?, options);
    let faces = inputs.iter().map(|i| refit(&i.picture, options.fov_deg, n)).collect();
    Ok(finish(inputs, faces, options))
}

/// `-vertcross`: three columns and four rows; the lowest face stands on its head.
pub(crate) fn vertical_cross(input: Input, options: &MakeOptions) -> Result<Texture> {
    let p = &input.picture;
    let n = p.width / 3;
    if n == 0 || p.width != 3 * n || p.height != 4 * n {
        let what =
            format!("a vertical cross is 3 by 4 square faces, this has {} x {} pixels", p.width, p.height);
        return Err(malformed(&input, what));
    }
    let cell = |column: usize, row: usize| p.cropped(column * n, row * n, n, n);
    let faces = [cell(2, 1), cell(0, 1), cell(1, 0), cell(1, 2), cell(1, 1), cell(1, 3).turned()];
    let size = face_size(n, options);
    let faces = faces.iter().map(|f| f.resized(size, size, Filter::CatmullRom, CLAMP)).collect();
    Ok(finish(vec![input], faces, options))
}

/// Where a direction (+z ahead, +x right, +y up) lies in an angular map, in [-1, 1] to the right and up:
/// the distance from the centre is the angle from +z over pi (P. Debevec, Light Probe Image Gallery).
pub(crate) fn angular(d: Vec3) -> (f32, f32) {
    let across = d.x.hypot(d.y);
    if across == 0.0 {
        // Straight ahead is the centre; straight behind is the whole rim, of which the right end will do.
        return if d.z >= 0.0 { (0.0, 0.0) } else { (1.0, 0.0) };
    }
    let r = across.atan2(d.z) / std::f32::consts::PI / across;
    (d.x * r, d.y * r)
}

/// `-lightprobe`: a square picture whose inscribed circle shows all directions.
pub(crate) fn light_probe(input: Input, options: &MakeOptions) -> Result<Texture> {
    let p = &input.picture;
    if p.width != p.height {
        let what = format!("a light probe is square, this has {} x {} pixels", p.width, p.height);
        return Err(malformed(&input, what));
    }
    // As many pixels per degree at the centre of a face as at the centre of the probe.
    let n = face_size(((p.width as f32 / std::f32::consts::PI).round() as usize).max(1), options);
    let faces = (0..6).map(|face| probe_face(p, face, n)).collect();
    Ok(finish(vec![input], faces, options))
}

/// One face, each texel the mean of 3 x 3 points.
fn probe_face(probe: &Picture, face: usize, n: usize) -> Picture {
    const SUB: usize = 3;
    let channels = probe.channels;
    let radius = probe.width as f32 * 0.5;
    let mut out = Picture::new(n, n, channels);
    out.data.par_chunks_mut(n * channels).enumerate().for_each(|(y, row)| {
        let mut value = vec![0.0; channels];
        for (x, texel) in row.chunks_exact_mut(channels).enumerate() {
            for i in 0..SUB * SUB {
                let place = |v: usize, sub: usize| (v as f32 + (sub as f32 + 0.5) / SUB as f32) / n as f32;
                let d = cube::direction(CubeLayout::Mosaic, face, place(x, i % SUB), place(y, i / SUB));
                let (u, v) = angular(d.normalize());
                probe.bilinear((1.0 + u) * radius, (1.0 - v) * radius, &mut value);
                let share = 1.0 / (i + 1) as f32;
                for (t, v) in texel.iter_mut().zip(&value) {
                    *t += (v - *t) * share;
                }
            }
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angular_map() {
        let close = |d: Vec3, u: f32, v: f32| {
            let (a, b) = angular(d);
            assert!((a - u).abs() < 1e-6 && (b - v).abs() < 1e-6, "{d}: {a} {b}");
        };
        close(Vec3::Z, 0.0, 0.0);
        close(Vec3::X, 0.5, 0.0);
        close(Vec3::Y, 0.0, 0.5);
        close(-Vec3::X, -0.5, 0.0);
        close(-Vec3::Z, 1.0, 0.0);
        close(Vec3::new(1.0, 0.0, 1.0).normalize(), 0.25, 0.0);
    }

    #[test]
    fn a_narrower_view_is_extended_and_a_wider_one_cut() {
        let mut p = Picture::new(64, 64, 1);
        for (i, v) in p.data.iter_mut().enumerate() {
            *v = ((i % 64) as f32 + 0.5) / 64.0;
        }
        let wide = 2.0 * 2.0_f32.atan().to_degrees();
        // Of a view twice as wide (in tangents) the middle half remains.
        let q = refit(&p, wide, 32);
        for x in 0..32 {
            assert!((q.data[x] - (0.25 + (x as f32 + 0.5) / 64.0)).abs() < 1e-4);
        }
        let q = refit(&p, 2.0 * 0.5_f32.atan().to_degrees(), 64);
        assert_eq!((q.data[0], q.data[63]), (p.data[0], p.data[63]));
        assert_eq!(refit(&p, 90.0, 64), p);
    }
}
