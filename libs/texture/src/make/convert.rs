//! Conversion of latitude-longitude maps to cubes and back.

use crate::cube::{self, CubeLayout, texel_across};
use crate::environment::to_map;
use crate::image::Image;
use crate::lookup::Up;
use granita_base::Vec3;
use rayon::prelude::*;
use std::f32::consts::{PI, TAU};

/// Returns the column and row of the first of the four texels around a point, and the weights of the second ones.
pub(super) fn between(x: f32, y: f32) -> (i32, i32, f32, f32) {
    let (x, y) = (x - 0.5, y - 0.5);
    (x.floor() as i32, y.floor() as i32, x - x.floor(), y - y.floor())
}

/// Computes the weighted sum of four texels, which is exact where they are equal.
pub(super) fn mix(corners: [&[f32]; 4], fx: f32, fy: f32, out: &mut [f32]) {
    for (c, out) in out.iter_mut().enumerate() {
        let [a, b, d, e] = corners.map(|t| t[c]);
        let (top, bottom) = (a + (b - a) * fx, d + (e - d) * fx);
        *out = top + (bottom - top) * fy;
    }
}

/// Looks up a latitude-longitude map in a direction, bilinearly, over seam and poles.
pub(super) fn latlong_at(p: &Image, up: Up, d: Vec3, out: &mut [f32]) {
    let d = to_map(d, up);
    let (w, h) = (p.width as i32, p.height as i32);
    let s = libm::atan2f(d.y, d.x) / TAU + 0.5;
    let t = libm::atan2f(libm::hypotf(d.x, d.y), d.z) / PI;
    let (x, y, fx, fy) = between(s * w as f32, t * h as f32);
    let texel = |x: i32, y: i32| {
        let (y, turn) = if y < 0 {
            (-1 - y, w / 2)
        } else if y >= h {
            (2 * h - 1 - y, w / 2)
        } else {
            (y, 0)
        };
        p.texel((x + turn).rem_euclid(w) as usize, y.clamp(0, h - 1) as usize)
    };
    mix([texel(x, y), texel(x + 1, y), texel(x, y + 1), texel(x + 1, y + 1)], fx, fy, out);
}

/// Looks up six faces in a direction, bilinearly, over edges.
pub(super) fn cube_at(faces: &[Image; 6], d: Vec3, out: &mut [f32]) {
    let n = faces[0].width as i32;
    let p = cube::project(CubeLayout::Mosaic, d);
    let (x, y, fx, fy) = between(p.s * n as f32, p.t * n as f32);
    let texel = |x: i32, y: i32| match texel_across(CubeLayout::Mosaic, p.face, x, y, n) {
        Some((face, x, y)) => faces[face].texel(x as usize, y as usize),
        // Behind a corner there is no texel. The texel at the corner replaces it.
        None => faces[p.face].texel(x.clamp(0, n - 1) as usize, y.clamp(0, n - 1) as usize),
    };
    mix([texel(x, y), texel(x + 1, y), texel(x, y + 1), texel(x + 1, y + 1)], fx, fy, out);
}

/// Returns an image whose texels are means of `sub * sub` points. `at` receives column and row, with fractions.
pub(super) fn supersampled(
    (width, height): (usize, usize),
    channels: usize,
    sub: usize,
    at: impl Fn(f32, f32, &mut [f32]) + Sync,
) -> Image {
    let mut out = Image::new(width, height, channels);
    out.data.par_chunks_mut(width * channels).enumerate().for_each(|(y, row)| {
        let mut value = vec![0.0; channels];
        for (x, texel) in row.chunks_exact_mut(channels).enumerate() {
            for i in 0..sub * sub {
                let place = |v: usize, i: usize| v as f32 + (i as f32 + 0.5) / sub as f32;
                at(place(x, i % sub), place(y, i / sub), &mut value);
                let share = 1.0 / (i + 1) as f32;
                texel.iter_mut().zip(&value).for_each(|(t, v)| *t += (v - *t) * share);
            }
        }
    });
    out
}

/// Returns the number of points per texel and direction, from 2 to 16. Below that limit no texel of the source is
/// missed.
pub(super) fn points(from: f32, to: f32) -> usize {
    ((from / to * 1.5).ceil() as usize).clamp(2, 16)
}

/// Returns six faces of `n` texels a side from a latitude-longitude map.
pub(crate) fn to_cube(p: &Image, up: Up, n: usize) -> [Image; 6] {
    // Texels of a face are densest, in angle, at its corners. A quarter of the equator is a sufficient estimate.
    let sub = points(p.width as f32 / 4.0, n as f32);
    std::array::from_fn(|face| {
        supersampled((n, n), p.channels, sub, |x, y, out| {
            let d = cube::direction(CubeLayout::Mosaic, face, x / n as f32, y / n as f32);
            latlong_at(p, up, d, out);
        })
    })
}

/// Returns a latitude-longitude map from six faces.
pub(crate) fn to_latlong(faces: &[Image; 6], up: Up, (w, h): (usize, usize)) -> Image {
    let sub = points(faces[0].width as f32 * 4.0, w as f32);
    supersampled((w, h), faces[0].channels, sub, |x, y, out| {
        let (phi, theta) = ((x / w as f32 - 0.5) * TAU, y / h as f32 * PI);
        let d = Vec3::new(
            libm::sinf(theta) * libm::cosf(phi),
            libm::sinf(theta) * libm::sinf(phi),
            libm::cosf(theta),
        );
        let d = match up {
            Up::Z => d,
            Up::Y => Vec3::new(-d.y, d.z, d.x),
        };
        cube_at(faces, d, out);
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A band-limited map that is converted to a cube and back is the same within 1 percent (root mean square, over its
    /// range).
    #[test]
    fn maps_survive_conversion_to_cubes_and_back() {
        let (w, h) = (256, 128);
        for up in [Up::Y, Up::Z] {
            let mut p = Image::new(w, h, 1);
            for y in 0..h {
                for x in 0..w {
                    let (phi, theta) = ((x as f32 + 0.5) / w as f32 * TAU, (y as f32 + 0.5) / h as f32 * PI);
                    // The map consists of spherical harmonics up to order 8.
                    p.texel_mut(x, y)[0] = 0.5
                        + 0.2 * theta.cos()
                        + 0.15 * theta.sin().powi(4) * (4.0 * phi).cos()
                        + 0.15 * theta.sin().powi(8) * (8.0 * phi).sin();
                }
            }
            let faces = to_cube(&p, up, w / 4);
            let q = to_latlong(&faces, up, (w, h));
            let square: f32 = p.data.iter().zip(&q.data).map(|(a, b)| (a - b) * (a - b)).sum();
            let rms = (square / p.data.len() as f32).sqrt();
            assert!(rms < 0.01, "{up:?} {rms}");
        }
    }

    #[test]
    fn converted_maps_keep_their_directions() {
        let mut p = Image::new(64, 32, 3);
        for y in 0..32 {
            for x in 0..64 {
                let (phi, theta) = (((x as f32 + 0.5) / 64.0 - 0.5) * TAU, (y as f32 + 0.5) / 32.0 * PI);
                let d = [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()];
                p.texel_mut(x, y).copy_from_slice(&d);
            }
        }
        let mut v = [0.0; 3];
        for d in [Vec3::X, Vec3::NEG_Y, Vec3::new(0.6, 0.0, 0.8), Vec3::NEG_Z] {
            latlong_at(&p, Up::Z, d, &mut v);
            assert!((Vec3::from_array(v) - d).length() < 0.06, "{d} {v:?}");
            let mut seen = [0.0; 3];
            cube_at(&to_cube(&p, Up::Z, 32), d, &mut seen);
            assert!((Vec3::from_array(seen) - d).length() < 0.06, "{d} {seen:?}");
        }
    }
}
