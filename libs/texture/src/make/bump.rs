//! Textures of slopes, from heights or normals, for filtered bump mapping.

use super::flat::{Bump, BumpFormat, NormalRange, SlopeFilter};
use super::picture::Picture;
use crate::image::Image;
use rayon::prelude::*;

/// The names of the channels: the height, the slopes in s and t, their squares, and their product.
const CHANNELS: [&str; 6] = ["b0_h", "b1_dhds", "b2_dhdt", "b3_dhds2", "b4_dhdt2", "b5_dh2dsdt"];

/// Returns the weights of the three rows and columns of a filter, and their total.
fn smoothing(filter: SlopeFilter) -> ([f32; 3], f32) {
    match filter {
        SlopeFilter::Sobel => ([1.0, 2.0, 1.0], 8.0),
        SlopeFilter::CentralDifference => ([0.0, 1.0, 0.0], 2.0),
    }
}

/// Returns the height and the slopes of a texel, in heights per texel.
fn of_heights(image: &Image, x: usize, y: usize, filter: SlopeFilter) -> [f32; 3] {
    let (weights, total) = smoothing(filter);
    let near = |v: usize, by: usize, n: usize| (v + by).saturating_sub(1).min(n - 1);
    let at = |i: usize, j: usize| image.texel(near(x, i, image.width), near(y, j, image.height))[0];
    const DIFFERENCE: [f32; 3] = [-1.0, 0.0, 1.0];
    let (mut s, mut t) = (0.0, 0.0);
    for (i, j) in (0..3).flat_map(|j| (0..3).map(move |i| (i, j))) {
        s += DIFFERENCE[i] * weights[j] * at(i, j);
        t += DIFFERENCE[j] * weights[i] * at(i, j);
    }
    [at(1, 1), s / total, t / total]
}

/// Returns the picture of slopes.
///
/// # Errors
/// Returns a message when the picture has too few channels, or when the options are not usable.
pub(crate) fn slopes(picture: &Picture, bump: &Bump) -> Result<Picture, String> {
    let n = picture.image.channels;
    let normals = match bump.format {
        BumpFormat::Height => false,
        BumpFormat::Normal if n < 3 => {
            return Err(format!("a normal map has 3 channels, this has {n}"));
        }
        BumpFormat::Normal => true,
        BumpFormat::Auto => n > 2 && !picture.is_grey(),
    };
    if bump.uv_scale.is_nan() || bump.uv_scale < 0.0 {
        return Err(format!("the scale of slopes is {}, it must not be negative", bump.uv_scale));
    }
    let centered = match bump.range {
        NormalRange::Centered => true,
        NormalRange::Positive => false,
        NormalRange::Auto => normals && picture.statistics().iter().any(|c| c.low < 0.0),
    };
    let middle = if centered { 0.0 } else { 0.5 };
    let (width, height) = (picture.image.width, picture.image.height);
    let per_unit = |n: usize| if normals || bump.uv_scale == 0.0 { 1.0 } else { n as f32 / bump.uv_scale };
    let sign = |negative: bool| if negative { -bump.scale } else { bump.scale };
    let (scale_s, scale_t) = (sign(bump.invert_s), sign(bump.invert_t));
    let (unit_s, unit_t) = (per_unit(width), per_unit(height));
    let mut image = Image::new(width, height, 6);
    image.data.par_chunks_mut(width * 6).enumerate().for_each(|(y, row)| {
        for (x, texel) in row.chunks_exact_mut(6).enumerate() {
            let [h, s, t] = if normals {
                let v = picture.image.texel(x, y);
                let (a, b, c) = (v[0] - middle, v[1] - middle, v[2] - middle);
                // There is no height.
                [-1.0, -a / c, -b / c]
            } else {
                of_heights(&picture.image, x, y, bump.filter)
            };
            let (s, t) = (s * scale_s, t * scale_t);
            // The order of the factors is that of OpenImageIO, on which the hash depends.
            let products = [s * s * unit_s * unit_s, t * t * unit_t * unit_t, s * t * unit_s * unit_t];
            texel[..3].copy_from_slice(&[h, s * unit_s, t * unit_t]);
            texel[3..].copy_from_slice(&products);
        }
    });
    Ok(Picture { image, channels: CHANNELS.map(str::to_owned).to_vec(), ..*picture })
}

#[cfg(test)]
mod tests {
    use super::super::picture::Window;
    use super::*;

    fn picture(width: usize, height: usize, channels: usize, data: Vec<f32>) -> Picture {
        let window = Window { x: 0, y: 0, width, height };
        let image = Image { width, height, channels, data };
        Picture { image, data: window, full: window, channels: vec![String::new(); channels] }
    }

    #[test]
    fn a_plane_has_its_slopes() {
        let heights = (0..25).map(|i| 0.25 * (i % 5) as f32 - 0.5 * (i / 5) as f32).collect();
        let plane = picture(5, 5, 1, heights);
        for filter in [SlopeFilter::Sobel, SlopeFilter::CentralDifference] {
            let bump = Bump { filter, invert_t: true, ..Bump::default() };
            let out = slopes(&plane, &bump).unwrap();
            assert_eq!(out.image.texel(2, 2), [-0.5, 0.25, 0.5, 0.0625, 0.25, 0.125]);
        }
        let uv = Bump { uv_scale: 2.5, ..Bump::default() };
        assert_eq!(slopes(&plane, &uv).unwrap().image.texel(2, 2)[1], 0.5);
        assert!(slopes(&plane, &Bump { uv_scale: -1.0, ..Bump::default() }).is_err());
        assert!(slopes(&plane, &Bump { format: BumpFormat::Normal, ..Bump::default() }).is_err());
    }

    #[test]
    fn normals_have_slopes_in_either_range() {
        let positive = picture(1, 1, 3, vec![0.75, 0.375, 1.0]);
        let out = slopes(&positive, &Bump::default()).unwrap();
        assert_eq!(out.image.data[..3], [-1.0, -0.5, 0.25]);
        let centered = picture(1, 1, 3, vec![0.5, -0.25, 1.0]);
        let out = slopes(&centered, &Bump::default()).unwrap();
        assert_eq!(out.image.data[..3], [-1.0, -0.5, 0.25]);
    }
}
