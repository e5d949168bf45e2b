//! Textures of slopes, from heights or normals, for filtered bump mapping.

use super::flat::{Bump, BumpFormat, NormalRange, SlopeFilter};
use super::picture::Picture;
use crate::image::Image;
use granita_machine::widest;
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

/// Rows of heights with one more texel on each side, which repeats the border.
struct Heights([Vec<f32>; 3]);

impl Heights {
    /// Returns the first channel of three rows of texels of `n` channels.
    fn of(rows: [&[f32]; 3], n: usize) -> Self {
        Self(rows.map(|row| {
            let heights = row.iter().step_by(n).copied();
            let (first, last) = (row.first().copied(), row.get(row.len() - n).copied());
            first.into_iter().chain(heights).chain(last).collect()
        }))
    }

    /// Stores the slopes of the middle row, in heights per texel.
    fn slopes(&self, filter: SlopeFilter, s: &mut [f32], t: &mut [f32]) {
        const DIFFERENCE: [f32; 3] = [-1.0, 0.0, 1.0];
        let (weights, total) = smoothing(filter);
        let width = s.len();
        let near: [[&[f32]; 3]; 3] = [0, 1, 2].map(|j| [0, 1, 2].map(|i| &self.0[j][i..][..width]));
        widest!(for x in 0..width {
            let (mut ds, mut dt) = (0.0, 0.0);
            for j in 0..3 {
                for i in 0..3 {
                    ds += DIFFERENCE[i] * weights[j] * near[j][i][x];
                    dt += DIFFERENCE[j] * weights[i] * near[j][i][x];
                }
            }
            (s[x], t[x]) = (ds / total, dt / total);
        });
    }
}

/// The content of an image, as far as the interpretation of its channels depends on it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Content {
    /// True when all channels of each pixel are equal.
    pub(crate) is_grey: bool,
    /// True when a value is negative.
    pub(crate) has_negative: bool,
}

impl Content {
    /// The content that no interpretation depends on.
    pub(crate) const NONE: Self = Self { is_grey: false, has_negative: false };
}

impl Bump {
    /// True when the interpretation of an image of so many channels depends on its content.
    pub(crate) fn depends_on_content(&self, channels: usize) -> bool {
        let may_be_normals = self.format != BumpFormat::Height && channels > 2;
        may_be_normals && (self.format == BumpFormat::Auto || self.range == NormalRange::Auto)
    }
}

/// The computation of slopes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Slopes {
    filter: SlopeFilter,
    normals: bool,
    /// The value of a component of a normal that is 0.
    middle: f32,
    /// The factors of the slopes in s and t.
    scale: (f32, f32),
    /// The texels per unit of texture coordinates, in s and t.
    unit: (f32, f32),
}

impl Slopes {
    /// Returns the computation for an image of this size and number of channels. `content` is called only when the
    /// options leave the interpretation to it.
    ///
    /// # Errors
    /// Returns a message when there are too few channels, or when the options are not usable.
    pub(crate) fn new(
        bump: &Bump,
        (width, height): (usize, usize),
        channels: usize,
        content: impl Fn() -> Content,
    ) -> Result<Self, String> {
        let normals = match bump.format {
            BumpFormat::Height => false,
            BumpFormat::Normal if channels < 3 => {
                return Err(format!("a normal map has 3 channels, this has {channels}"));
            }
            BumpFormat::Normal => true,
            BumpFormat::Auto => channels > 2 && !content().is_grey,
        };
        if bump.uv_scale.is_nan() || bump.uv_scale < 0.0 {
            return Err(format!("the scale of slopes is {}, it must not be negative", bump.uv_scale));
        }
        let centered = match bump.range {
            NormalRange::Centered => true,
            NormalRange::Positive => false,
            NormalRange::Auto => normals && content().has_negative,
        };
        let unit = |n: usize| if normals || bump.uv_scale == 0.0 { 1.0 } else { n as f32 / bump.uv_scale };
        let sign = |negative: bool| if negative { -bump.scale } else { bump.scale };
        Ok(Self {
            filter: bump.filter,
            normals,
            middle: if centered { 0.0 } else { 0.5 },
            scale: (sign(bump.invert_s), sign(bump.invert_t)),
            unit: (unit(width), unit(height)),
        })
    }

    /// Returns the names of the channels.
    pub(crate) fn channels() -> Vec<String> {
        CHANNELS.map(str::to_owned).to_vec()
    }

    /// Computes a row of six channels. `rows` are the row above, the row and the row below of an image of `n` channels.
    /// At a border, the row itself is above or below it.
    pub(crate) fn row(&self, rows: [&[f32]; 3], n: usize, out: &mut [f32]) {
        let width = rows[1].len() / n;
        let (mut s, mut t) = (vec![0.0; width], vec![0.0; width]);
        if self.normals {
            for ((v, s), t) in rows[1].chunks_exact(n).zip(&mut s).zip(&mut t) {
                let [a, b, c] = [v[0], v[1], v[2]].map(|v| v - self.middle);
                (*s, *t) = (-a / c, -b / c);
            }
        } else {
            Heights::of(rows, n).slopes(self.filter, &mut s, &mut t);
        }
        let (unit_s, unit_t) = self.unit;
        let texels = out.as_chunks_mut::<6>().0.iter_mut();
        for (((texel, v), s), t) in texels.zip(rows[1].chunks_exact(n)).zip(s).zip(t) {
            // A normal map has no height.
            let h = if self.normals { -1.0 } else { v[0] };
            let (s, t) = (s * self.scale.0, t * self.scale.1);
            // The order of the factors is that of OpenImageIO, on which the hash depends.
            let products = [s * s * unit_s * unit_s, t * t * unit_t * unit_t, s * t * unit_s * unit_t];
            *texel = [h, s * unit_s, t * unit_t, products[0], products[1], products[2]];
        }
    }
}

/// Returns the picture of slopes.
///
/// # Errors
/// The errors of [`Slopes::new`].
pub(crate) fn slopes(picture: &Picture, bump: &Bump) -> Result<Picture, String> {
    let from = &picture.image;
    let (width, height, n) = (from.width, from.height, from.channels);
    let content = || Content {
        is_grey: picture.is_grey(),
        has_negative: picture.statistics().iter().any(|c| c.low < 0.0),
    };
    let slopes = Slopes::new(bump, (width, height), n, content)?;
    let mut image = Image::new(width, height, 6);
    image.data.par_chunks_mut(width * 6).enumerate().for_each(|(y, out)| {
        let near = |y: usize| &from.data[y * width * n..][..width * n];
        slopes.row([near(y.saturating_sub(1)), near(y), near((y + 1).min(height - 1))], n, out);
    });
    Ok(Picture { image, channels: Slopes::channels(), ..*picture })
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
