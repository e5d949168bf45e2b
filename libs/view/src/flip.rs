//! The perceived difference of two images that are shown alternately.
//!
//! P. Andersson, J. Nilsson, T. Akenine-Möller, M. Oskarsson, K. Åström, M. D. Fairchild: "FLIP: A Difference
//! Evaluator for Alternating Images", Proceedings of the ACM on Computer Graphics and Interactive Techniques 3
//! (2020), for images within the range of a screen. Colours are filtered by the contrast sensitivity of the eye at
//! the distance of the viewer, and compared in a perceptually uniform space. Differences of edges and points
//! increase the result.

use rayon::prelude::*;

/// The number of screen pixels per degree of sight, for a screen of 0.7 m and 3840 pixels that is seen from 0.7 m.
pub const PIXELS_PER_DEGREE: f32 = 67.020_64;

/// The contrast sensitivity, as a1, b1, a2, b2 of the two Gaussians for lightness, red-green and blue-yellow.
const SENSITIVITY: [[f32; 4]; 3] =
    [[1.0, 0.0047, 0.0, 1e-5], [1.0, 0.0053, 0.0, 1e-5], [34.1, 0.04, 13.5, 0.025]];

/// The exponent of colour differences.
const QC: f32 = 0.7;
/// The fraction of the largest colour difference up to which differences are mapped to 0 to [`PT`].
const PC: f32 = 0.4;
const PT: f32 = 0.95;
/// The exponent of feature differences.
const QF: f32 = 0.5;
/// The width of edges and points, in degrees.
const WIDTH: f32 = 0.082;

/// The matrix from linear Rec. 709 to XYZ with D65.
const TO_XYZ: [[f64; 3]; 3] = [
    [10_135_552.0 / 24_577_794.0, 8_788_810.0 / 24_577_794.0, 4_435_075.0 / 24_577_794.0],
    [2_613_072.0 / 12_288_897.0, 8_788_810.0 / 12_288_897.0, 887_015.0 / 12_288_897.0],
    [1_425_312.0 / 73_733_382.0, 8_788_810.0 / 73_733_382.0, 70_074_185.0 / 73_733_382.0],
];

type Planes = [Vec<f32>; 3];

fn xyz(rgb: [f32; 3]) -> [f32; 3] {
    TO_XYZ.map(|row| (0..3).map(|i| row[i] * f64::from(rgb[i])).sum::<f64>() as f32)
}

/// Returns white in XYZ.
fn white() -> [f32; 3] {
    xyz([1.0; 3])
}

/// Returns the inverse of [`TO_XYZ`].
fn from_xyz() -> [[f64; 3]; 3] {
    let m = TO_XYZ;
    let det = m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1])
        - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0])
        + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let (a, b) = ((j + 1) % 3, (j + 2) % 3);
            let (c, d) = ((i + 1) % 3, (i + 2) % 3);
            (m[a][c] * m[b][d] - m[a][d] * m[b][c]) / det
        })
    })
}

fn opponent(rgb: [f32; 3]) -> [f32; 3] {
    let (v, w) = (xyz(rgb), white());
    let [x, y, z] = [v[0] / w[0], v[1] / w[1], v[2] / w[2]];
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// Converts opponent colours to linear ones.
fn from_opponent(o: [f32; 3], inverse: &[[f64; 3]; 3], w: [f32; 3]) -> [f32; 3] {
    let y = (o[0] + 16.0) / 116.0;
    let v = [(o[1] / 500.0 + y) * w[0], y * w[1], (y - o[2] / 200.0) * w[2]];
    std::array::from_fn(|i| (0..3).map(|j| inverse[i][j] * f64::from(v[j])).sum::<f64>() as f32)
}

/// Returns CIELAB, with the colourfulness scaled by the lightness (the Hunt effect).
fn hunt_lab(rgb: [f32; 3], w: [f32; 3]) -> [f32; 3] {
    let v = xyz(rgb);
    let f = |t: f32| {
        const D: f32 = 6.0 / 29.0;
        if t > D * D * D { t.cbrt() } else { t / (3.0 * D * D) + 4.0 / 29.0 }
    };
    let [x, y, z] = [f(v[0] / w[0]), f(v[1] / w[1]), f(v[2] / w[2])];
    let lightness = 116.0 * y - 16.0;
    [lightness, 0.01 * lightness * 500.0 * (x - y), 0.01 * lightness * 200.0 * (y - z)]
}

fn distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    (a[0] - b[0]).abs() + (a[1] - b[1]).hypot(a[2] - b[2])
}

/// Filters rows, then columns, each with its own weights around the middle. Pixels beyond the edge equal those at the
/// edge.
fn filter(plane: &[f32], width: usize, across: &[f32], down: &[f32]) -> Vec<f32> {
    let height = plane.len() / width;
    let reach = across.len() / 2;
    let mut rows = vec![0.0; plane.len()];
    rows.par_chunks_mut(width).zip(plane.par_chunks(width)).for_each(|(out, row)| {
        for (x, out) in out.iter_mut().enumerate() {
            let at = |i: usize| row[(x + i).saturating_sub(reach).min(width - 1)];
            *out = across.iter().enumerate().map(|(i, w)| w * at(i)).sum();
        }
    });
    let mut out = vec![0.0; plane.len()];
    out.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        for (i, w) in down.iter().enumerate() {
            let row = &rows[(y + i).saturating_sub(reach).min(height - 1) * width..][..width];
            out.iter_mut().zip(row).for_each(|(out, v)| *out += w * v);
        }
    });
    out
}

/// Returns a plane of opponent colours, filtered by the contrast sensitivity of the eye.
fn seen(plane: &[f32], width: usize, [a1, b1, a2, b2]: [f32; 4], ppd: f32) -> Vec<f32> {
    use std::f32::consts::PI;
    let widest = SENSITIVITY.iter().flat_map(|s| [s[1], s[3]]).fold(0.0, f32::max);
    let reach = (3.0 * (widest / (2.0 * PI * PI)).sqrt() * ppd).ceil() as i32;
    let gauss = |b: f32| -> Vec<f32> {
        (-reach..=reach).map(|x| (-PI * PI * (x as f32 / ppd).powi(2) / b).exp()).collect()
    };
    let parts = [(a1, b1), (a2, b2)].map(|(a, b)| {
        let g = gauss(b);
        let sum: f32 = g.iter().sum();
        (a * (PI / b).sqrt(), g, sum * sum)
    });
    let total: f32 = parts.iter().map(|(weight, _, sum)| weight * sum).sum();
    let mut out = vec![0.0; plane.len()];
    for (weight, g, _) in parts.iter().filter(|p| p.0 > 0.0) {
        let part = filter(plane, width, g, g);
        out.iter_mut().zip(part).for_each(|(out, v)| *out += weight / total * v);
    }
    out
}

/// Returns the strength of edges and of points in a plane of lightness from 0 to 1.
fn features(plane: &[f32], width: usize, ppd: f32) -> [Vec<f32>; 2] {
    let sd = 0.5 * WIDTH * ppd;
    let reach = (3.0 * sd).ceil() as i32;
    let place = move || (-reach..=reach).map(|x| x as f32);
    let g: Vec<f32> = place().map(|x| (-x * x / (2.0 * sd * sd)).exp()).collect();
    let smooth: f32 = g.iter().sum();
    let smooth: Vec<f32> = g.iter().map(|v| v / smooth).collect();
    // The magnitudes of the positive weights and those of the negative weights each have the sum 1.
    let even = |list: Vec<f32>| -> Vec<f32> {
        let up: f32 = list.iter().filter(|v| **v > 0.0).sum();
        let down: f32 = list.iter().filter(|v| **v < 0.0).sum();
        list.iter().map(|v| if *v > 0.0 { v / up } else { -v / down }).collect()
    };
    let first = even(place().zip(&g).map(|(x, g)| -x * g).collect());
    let second = even(place().zip(&g).map(|(x, g)| (x * x / (sd * sd) - 1.0) * g).collect());
    [first, second].map(|f| {
        let (x, y) = (filter(plane, width, &f, &smooth), filter(plane, width, &smooth, &f));
        x.into_iter().zip(y).map(|(x, y)| x.hypot(y)).collect()
    })
}

/// Returns the difference of every pixel, from 0 (none) to 1, of two images with a width of `width` pixels in
/// linear Rec. 709. Values are clamped to 0 to 1.
///
/// # Panics
/// Panics when the images differ in size or have no pixels, which is an error in the calling code.
pub(crate) fn flip(a: &[[f32; 3]], b: &[[f32; 3]], width: usize, ppd: f32) -> Vec<f32> {
    assert!(a.len() == b.len() && width > 0 && a.len().is_multiple_of(width), "images of one size");
    let planes = |image: &[[f32; 3]]| -> Planes {
        let all: Vec<[f32; 3]> = image.par_iter().map(|p| opponent(p.map(|v| v.clamp(0.0, 1.0)))).collect();
        std::array::from_fn(|c| all.iter().map(|p| p[c]).collect())
    };
    let (inverse, w) = (from_xyz(), white());
    let colors = |planes: &Planes| -> Vec<[f32; 3]> {
        let [l, rg, by] = [0, 1, 2].map(|c| seen(&planes[c], width, SENSITIVITY[c], ppd));
        (0..l.len())
            .into_par_iter()
            .map(|i| {
                let rgb = from_opponent([l[i], rg[i], by[i]], &inverse, w);
                hunt_lab(rgb.map(|v| v.clamp(0.0, 1.0)), w)
            })
            .collect()
    };
    let largest = distance(hunt_lab([0.0, 1.0, 0.0], w), hunt_lab([0.0, 0.0, 1.0], w)).powf(QC);
    let (pa, pb) = (planes(a), planes(b));
    let (ca, cb) = (colors(&pa), colors(&pb));
    let lightness = |p: &Planes| -> Vec<f32> { p[0].iter().map(|v| (v + 16.0) / 116.0).collect() };
    let [edges_a, points_a] = features(&lightness(&pa), width, ppd);
    let [edges_b, points_b] = features(&lightness(&pb), width, ppd);
    (0..a.len())
        .into_par_iter()
        .map(|i| {
            let color = distance(ca[i], cb[i]).powf(QC);
            let bend = PC * largest;
            let color = if color < bend {
                color * PT / bend
            } else {
                PT + (color - bend) / (largest - bend) * (1.0 - PT)
            };
            let feature = (edges_a[i] - edges_b[i]).abs().max((points_a[i] - points_b[i]).abs());
            let feature = (std::f32::consts::FRAC_1_SQRT_2 * feature).powf(QF);
            color.clamp(0.0, 1.0).powf(1.0 - feature.clamp(0.0, 1.0))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_survive_conversion_to_opponent_space_and_back() {
        let (inverse, w) = (from_xyz(), white());
        for rgb in [[0.2, 0.5, 0.9], [1.0, 1.0, 1.0], [0.0, 0.0, 0.0]] {
            let back = from_opponent(opponent(rgb), &inverse, w);
            assert!((0..3).all(|c| (back[c] - rgb[c]).abs() < 1e-5), "{rgb:?}: {back:?}");
        }
    }

    #[test]
    fn flip_is_zero_for_equal_and_large_for_opposite_images() {
        let a: Vec<[f32; 3]> = (0..600).map(|i| [i as f32 / 600.0, 0.5, (i % 7) as f32 / 7.0]).collect();
        assert!(flip(&a, &a, 30, PIXELS_PER_DEGREE).iter().all(|v| *v == 0.0));
        let (black, white) = (vec![[0.0; 3]; 400], vec![[1.0; 3]; 400]);
        let d = flip(&black, &white, 20, PIXELS_PER_DEGREE);
        assert!(d.iter().all(|v| (0.95..=1.0).contains(v)), "{}", d[0]);
        assert_eq!(flip(&black[..1], &white[..1], 1, PIXELS_PER_DEGREE).len(), 1);
    }
}
