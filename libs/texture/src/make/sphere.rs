//! MIP levels of maps of all directions, in which texels are weighted by their part of the sphere.
//!
//! Each texel is weighted by its exact solid angle. For a latitude-longitude map that is proportional to the sine of
//! the polar angle at the texel's centre, for any size. For a cube it is the difference at its corners of this function
//! on the plane at distance 1: `atan (u v / sqrt (u^2 + v^2 + 1))`.
//!
//! With the box filter each texel of a level is the mean of what it covers, so the mean of the level over the sphere is
//! that of the level before. Other filters reach over face edges, poles and the seam. One factor for each channel of a
//! level then compensates for what they lose or gain.

use crate::Wrap;
use crate::cube::{self, CubeLayout};
use crate::image::{Image, half};
use granita_base::Filter;
use rayon::prelude::*;

/// Returns the solid angle of the part of a face's plane between its centre and (u, v), in units of half its size.
fn corner(u: f64, v: f64) -> f64 {
    libm::atan2(u * v, (u * u + v * v + 1.0).sqrt())
}

/// Converts a fraction of the face to a coordinate of its plane.
fn plane(fraction: f64) -> f64 {
    2.0 * fraction - 1.0
}

/// Returns the parts of `from` texels that one of `to` texels covers: index, begin and end as fractions.
fn cover(o: usize, from: usize, to: usize) -> Vec<(usize, f64, f64)> {
    let (begin, end) = ((o * from) as f64 / to as f64, ((o + 1) * from) as f64 / to as f64);
    (begin.floor() as usize..(end.ceil() as usize).min(from))
        .map(|i| (i, begin.max(i as f64) / from as f64, end.min((i + 1) as f64) / from as f64))
        .filter(|(_, a, b)| b - a > 1e-12)
        .collect()
}

/// Returns the solid angles of the `n` texels of row `y` of a face, in steradians.
fn row_angles(n: usize, y: usize) -> Vec<f64> {
    let edge = |i: usize| plane(i as f64 / n as f64);
    let strip: Vec<f64> = (0..=n).map(|x| corner(edge(x), edge(y + 1)) - corner(edge(x), edge(y))).collect();
    strip.windows(2).map(|s| s[1] - s[0]).collect()
}

/// Returns the mean of every channel over the sphere.
fn cube_mean(faces: &[Image; 6]) -> Vec<f64> {
    let (n, channels) = (faces[0].width, faces[0].channels);
    let rows: Vec<Vec<f64>> = (0..n)
        .into_par_iter()
        .map(|y| {
            let angles = row_angles(n, y);
            let mut sums = vec![0.0; channels];
            for face in faces {
                for (x, angle) in angles.iter().enumerate() {
                    for (sum, v) in sums.iter_mut().zip(face.texel(x, y)) {
                        *sum += angle * f64::from(*v);
                    }
                }
            }
            sums
        })
        .collect();
    // The rows are summed in order, so that the number of threads does not matter.
    let mut total = vec![0.0; channels];
    for row in rows {
        total.iter_mut().zip(row).for_each(|(t, r)| *t += r / (4.0 * std::f64::consts::PI));
    }
    total
}

/// Returns the mean of every channel of a latitude-longitude map over the sphere.
pub(crate) fn latlong_mean(p: &Image) -> Vec<f64> {
    let mut total = vec![0.0; p.channels];
    let weight = |y: usize| libm::sin((y as f64 + 0.5) / p.height as f64 * std::f64::consts::PI);
    let all: f64 = (0..p.height).map(weight).sum::<f64>() * p.width as f64;
    for y in 0..p.height {
        let w = weight(y) / all;
        for texel in p.data[y * p.width * p.channels..][..p.width * p.channels].chunks_exact(p.channels) {
            total.iter_mut().zip(texel).for_each(|(t, v)| *t += w * f64::from(*v));
        }
    }
    total
}

/// Returns the next level of six faces with the box filter.
fn cube_halved(faces: &[Image; 6]) -> [Image; 6] {
    let (n, channels) = (faces[0].width, faces[0].channels);
    let m = half(n);
    let across: Vec<_> = (0..m).map(|o| cover(o, n, m)).collect();
    let row = |y: usize| {
        let down = cover(y, n, m);
        let mut out = vec![0.0_f32; 6 * m * channels];
        // The values of [`corner`] along the edges of the covered rows. Neighbours and all faces share them.
        let edges: Vec<[Vec<f64>; 2]> = (down.iter())
            .map(|(_, top, bottom)| {
                [*top, *bottom]
                    .map(|v| (0..=n).map(|x| corner(plane(x as f64 / n as f64), plane(v))).collect())
            })
            .collect();
        for (x, columns) in across.iter().enumerate() {
            let mut taps: Vec<(usize, usize, f64)> = Vec::with_capacity(9);
            for ((j, top, bottom), edge) in down.iter().zip(&edges) {
                for (i, left, right) in columns {
                    let at = |fraction: f64, v: f64, edge: &[f64]| {
                        // Between texels, as at odd sizes, the corner is not in the table.
                        let x = fraction * n as f64;
                        if (x - x.round()).abs() < 1e-9 {
                            edge[x.round() as usize]
                        } else {
                            corner(plane(fraction), plane(v))
                        }
                    };
                    let angle = at(*right, *bottom, &edge[1])
                        - at(*left, *bottom, &edge[1])
                        - at(*right, *top, &edge[0])
                        + at(*left, *top, &edge[0]);
                    taps.push((*i, *j, angle));
                }
            }
            let total: f64 = taps.iter().map(|t| t.2).sum();
            for (f, face) in faces.iter().enumerate() {
                let base = face.texel(taps[0].0, taps[0].1);
                let to = &mut out[(f * m + x) * channels..][..channels];
                for (c, to) in to.iter_mut().enumerate() {
                    let sum: f64 = taps[1..]
                        .iter()
                        .map(|(i, j, w)| w * (f64::from(face.texel(*i, *j)[c]) - f64::from(base[c])))
                        .sum();
                    *to = (f64::from(base[c]) + sum / total) as f32;
                }
            }
        }
        out
    };
    let rows: Vec<Vec<f32>> = (0..m).into_par_iter().map(row).collect();
    std::array::from_fn(|f| {
        let mut out = Image::new(m, m, channels);
        for (to, row) in out.data.chunks_exact_mut(m * channels).zip(&rows) {
            to.copy_from_slice(&row[f * m * channels..][..m * channels]);
        }
        out
    })
}

/// Returns the texels and weights of a filter for each of `to` texels, among `from` texels with `margin` more before
/// them.
fn spread(from: usize, to: usize, filter: Filter, margin: usize) -> Vec<Vec<(usize, f64)>> {
    let scale = from as f64 / to as f64;
    let width = filter.natural_width();
    (0..to)
        .map(|o| {
            let centre = (o as f64 + 0.5) * scale;
            let reach = f64::from(width) * 0.5 * scale;
            ((centre - reach - 0.5).floor() as i64..=(centre + reach - 0.5).ceil() as i64)
                .map(|i| (i, f64::from(filter.weight(((i as f64 + 0.5 - centre) / scale) as f32, width))))
                .filter(|(i, w)| *w != 0.0 && -*i <= margin as i64 && *i < (from + margin) as i64)
                .map(|(i, w)| ((i + margin as i64) as usize, w))
                .collect()
        })
        .collect()
}

/// Returns the extent of a filter beyond a texel of the next level, in texels of this one.
fn reach(filter: Filter, from: usize, to: usize) -> usize {
    (f64::from(filter.natural_width()) * 0.5 * from as f64 / to as f64).ceil() as usize + 1
}

/// Returns an image of size `to`. `padded` has `margin` texels around an image of size `from`. `measure` is the weight
/// of a texel of `padded`.
fn filtered(
    padded: &Image,
    margin: usize,
    from: (usize, usize),
    to: (usize, usize),
    filter: Filter,
    measure: impl Fn(usize, usize) -> f64 + Sync,
) -> Image {
    let n = padded.channels;
    let (across, down) = (spread(from.0, to.0, filter, margin), spread(from.1, to.1, filter, margin));
    let mut out = Image::new(to.0, to.1, n);
    out.data.par_chunks_mut(to.0 * n).zip(&down).for_each(|(row, down)| {
        let mut sums = vec![0.0; n];
        for (texel, across) in row.chunks_exact_mut(n).zip(&across) {
            sums.fill(0.0);
            let mut total = 0.0;
            let base = padded.texel(across[across.len() / 2].0, down[down.len() / 2].0);
            for (y, wy) in down {
                for (x, wx) in across {
                    let w = wx * wy * measure(*x, *y);
                    total += w;
                    for (c, sum) in sums.iter_mut().enumerate() {
                        *sum += w * (f64::from(padded.texel(*x, *y)[c]) - f64::from(base[c]));
                    }
                }
            }
            for (c, v) in texel.iter_mut().enumerate() {
                *v = (f64::from(base[c]) + if total == 0.0 { 0.0 } else { sums[c] / total }) as f32;
            }
        }
    });
    out
}

/// Multiplies the channels of a level so that their means become `wanted`.
fn correct(level: &mut [Image], mean: &[f64], wanted: &[f64]) {
    let factor: Vec<f32> = (mean.iter().zip(wanted))
        .map(|(m, w)| {
            let factor = w / m;
            // When the mean is near 0, the quotient is not meaningful.
            if (0.5..2.0).contains(&factor) && (factor - 1.0).abs() > 1e-7 { factor as f32 } else { 1.0 }
        })
        .collect();
    if factor.iter().any(|f| *f != 1.0) {
        for image in level {
            for texel in image.data.chunks_exact_mut(image.channels) {
                texel.iter_mut().zip(&factor).for_each(|(v, f)| *v *= f);
            }
        }
    }
}

/// Returns the next level of six faces with a filter other than the box, over face edges.
fn cube_filtered(faces: &[Image; 6], filter: Filter) -> [Image; 6] {
    let (n, channels) = (faces[0].width, faces[0].channels);
    let m = half(n);
    let margin = reach(filter, n, m);
    let size = n + 2 * margin;
    let place = |i: usize| (i as f32 - margin as f32 + 0.5) / n as f32;
    let measure = |x: usize, y: usize| {
        let (u, v) = (plane(f64::from(place(x))), plane(f64::from(place(y))));
        libm::pow(1.0 + u * u + v * v, -1.5)
    };
    std::array::from_fn(|face| {
        let mut padded = Image::new(size, size, channels);
        padded.data.par_chunks_mut(size * channels).enumerate().for_each(|(y, row)| {
            for (x, texel) in row.chunks_exact_mut(channels).enumerate() {
                let d = cube::direction(CubeLayout::Mosaic, face, place(x), place(y));
                let p = cube::project(CubeLayout::Mosaic, d);
                let index = |v: f32| ((v * n as f32) as usize).min(n - 1);
                let inside = (margin..margin + n).contains(&x) && (margin..margin + n).contains(&y);
                texel.copy_from_slice(if inside {
                    faces[face].texel(x - margin, y - margin)
                } else {
                    faces[p.face].texel(index(p.s), index(p.t))
                });
            }
        });
        filtered(&padded, margin, (n, n), (m, m), filter, measure)
    })
}

/// Returns the next level of a latitude-longitude map with a filter other than the box, over seam and poles.
fn latlong_filtered(p: &Image, filter: Filter) -> Image {
    let (w, h) = (p.width, p.height);
    let to = (half(w), half(h));
    let margin = reach(filter, w, to.0).max(reach(filter, h, to.1));
    let mut padded = Image::new(w + 2 * margin, h + 2 * margin, p.channels);
    for y in 0..padded.height {
        // Beyond a pole the rows continue on its other side.
        let row = (y as i64 - margin as i64).rem_euclid(2 * h as i64) as usize;
        let (row, turn) = if row < h { (row, 0) } else { (2 * h - 1 - row, w / 2) };
        for x in 0..padded.width {
            let column = (x as i64 - margin as i64 + turn as i64).rem_euclid(w as i64) as usize;
            padded.texel_mut(x, y).copy_from_slice(p.texel(column, row));
        }
    }
    let sine = |y: usize| libm::sin((y as f64 - margin as f64 + 0.5) / h as f64 * std::f64::consts::PI).abs();
    filtered(&padded, margin, (w, h), to, filter, |_, y| sine(y))
}

/// Returns all levels of six faces.
pub(crate) fn cube_pyramid(faces: [Image; 6], filter: Filter) -> Vec<[Image; 6]> {
    let wanted = cube_mean(&faces);
    let mut levels = vec![faces];
    while let Some(last) = levels.last().filter(|faces| faces[0].width > 1) {
        let next = if filter == Filter::Box {
            cube_halved(last)
        } else {
            let mut next = cube_filtered(last, filter);
            let mean = cube_mean(&next);
            correct(&mut next, &mean, &wanted);
            next
        };
        levels.push(next);
    }
    levels
}

/// Returns all levels of a latitude-longitude map.
pub(crate) fn latlong_pyramid(first: Image, filter: Filter) -> Vec<Image> {
    let wanted = latlong_mean(&first);
    let mut levels = vec![first];
    while let Some(last) = levels.last().filter(|p| p.width > 1 || p.height > 1) {
        let next = latlong_next(last, filter, &wanted);
        levels.push(next);
    }
    levels
}

/// Returns the next level of a latitude-longitude map whose mean over the sphere is `wanted`.
pub(crate) fn latlong_next(last: &Image, filter: Filter, wanted: &[f64]) -> Image {
    if filter == Filter::Box {
        let across = last.resized(half(last.width), last.height, filter, (Wrap::Periodic, Wrap::Clamp));
        return across.rows_by_solid_angle(half(last.height));
    }
    let mut next = latlong_filtered(last, filter);
    let mean = latlong_mean(&next);
    correct(std::slice::from_mut(&mut next), &mean, wanted);
    next
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::Vec3;

    fn noise(width: usize, height: usize, seed: u32) -> Image {
        let mut p = Image::new(width, height, 2);
        for (i, v) in p.data.iter_mut().enumerate() {
            // There are many dark texels and a few bright ones.
            *v = granita_base::hash::unit(granita_base::hash::words(&[i as u32, seed])).powi(20) * 1000.0;
        }
        p
    }

    #[test]
    fn solid_angles_of_texels_add_up_to_the_sphere() {
        for n in [1, 2, 7, 64] {
            let face: f64 = (0..n).flat_map(|y| row_angles(n, y)).sum();
            assert!((face * 6.0 - 4.0 * std::f64::consts::PI).abs() < 1e-12);
        }
    }

    /// Every level has the mean of the first over the sphere, for every filter, also at odd sizes.
    #[test]
    fn every_cube_level_keeps_the_mean_over_the_sphere() {
        for filter in Filter::ALL {
            for n in [1, 8, 13, 32] {
                let faces = std::array::from_fn(|f| noise(n, n, f as u32));
                let wanted = cube_mean(&faces);
                for level in cube_pyramid(faces, filter) {
                    for (a, b) in cube_mean(&level).iter().zip(&wanted) {
                        assert!((a / b - 1.0).abs() < 1e-6, "{filter:?} {n} at {}: {a} {b}", level[0].width);
                    }
                }
            }
            for (w, h) in [(64, 32), (32, 32), (33, 17), (5, 1)] {
                let p = noise(w, h, 9);
                let wanted = latlong_mean(&p);
                for level in latlong_pyramid(p, filter) {
                    for (a, b) in latlong_mean(&level).iter().zip(&wanted) {
                        assert!((a / b - 1.0).abs() < 1e-6, "{filter:?} {w} at {}: {a} {b}", level.width);
                    }
                }
            }
        }
    }

    #[test]
    fn constants_stay_exact_in_every_cube_level() {
        let mut p = Image::new(16, 16, 3);
        p.data.fill(0.3);
        for filter in Filter::ALL {
            for level in cube_pyramid(std::array::from_fn(|_| p.clone()), filter) {
                assert!(level.iter().all(|f| f.data.iter().all(|v| *v == 0.3)), "{filter:?}");
            }
            for level in latlong_pyramid(p.clone(), filter) {
                assert!(level.data.iter().all(|v| *v == 0.3), "{filter:?}");
            }
        }
    }

    /// All levels show a bright texel at the same place, with the same total light.
    #[test]
    fn a_small_light_stays_in_place_in_every_level() {
        let n = 32;
        for filter in [Filter::Box, Filter::Gaussian, Filter::BSpline] {
            // The texels are in the middle of a face, at an edge and at a corner.
            for (face, x, y) in [(0, 16, 16), (2, 31, 9), (5, 0, 0)] {
                let mut faces: [Image; 6] = std::array::from_fn(|_| Image::new(n, n, 1));
                faces[face].texel_mut(x, y)[0] = 1e4;
                let to = |f: usize, x: usize, y: usize, n: usize| {
                    let place = |i: usize| (i as f32 + 0.5) / n as f32;
                    cube::direction(CubeLayout::Mosaic, f, place(x), place(y)).normalize()
                };
                let light = to(face, x, y, n);
                let energy = cube_mean(&faces)[0];
                for level in cube_pyramid(faces, filter) {
                    assert!((cube_mean(&level)[0] / energy - 1.0).abs() < 1e-6);
                    let m = level[0].width;
                    let mut centre = Vec3::ZERO;
                    for (f, shown) in level.iter().enumerate() {
                        for y in 0..m {
                            for x in 0..m {
                                centre += to(f, x, y, m) * shown.texel(x, y)[0] * row_angles(m, y)[x] as f32;
                            }
                        }
                    }
                    let off = centre.normalize().angle_between(light);
                    assert!(off < 2.0 / m as f32, "{filter:?} face {face} at {m}: {off}");
                }
            }
        }
    }
}
