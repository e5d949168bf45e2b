//! The opacity of volume shadow maps at a point.

use crate::sampler::{Sampler, levels};
use crate::volume::opacity;
use crate::wrap::cell;
use granita_base::Vec3;

/// Returns the opacity of the map at (s, t) in front of depth `z`, trilinearly interpolated. It is 0 outside the map.
pub(crate) fn opacity_at(sampler: &mut Sampler<'_>, lod: f32, s: f32, t: f32, z: f32) -> f32 {
    if !(-1.0..=2.0).contains(&s) || !(-1.0..=2.0).contains(&t) {
        return 0.0;
    }
    let (level, share) = levels(lod, sampler.last());
    let value = opacity_in(sampler, level, s, t, z);
    if share > 0.0 { value + (opacity_in(sampler, level + 1, s, t, z) - value) * share } else { value }
}

fn opacity_in(sampler: &mut Sampler<'_>, level: usize, s: f32, t: f32, z: f32) -> f32 {
    let (width, height) = (sampler.level(level).width, sampler.level(level).height);
    let ((x, fx), (y, fy)) = (cell(s, width), cell(t, height));
    let mut corner = |x: i32, y: i32| {
        let inside = (0..width as i32).contains(&x) && (0..height as i32).contains(&y);
        if inside { sampler.with_texel(level, x as u32, y as u32, |v| opacity(v, z)) } else { 0.0 }
    };
    let top = corner(x, y) * (1.0 - fx) + corner(x + 1, y) * fx;
    let bottom = corner(x, y + 1) * (1.0 - fx) + corner(x + 1, y + 1) * fx;
    top * (1.0 - fy) + bottom * fy
}

/// Does the same as [`opacity_at`] in a direction from the centre of a cube, across its edges.
pub(crate) fn opacity_around(sampler: &mut Sampler<'_>, lod: f32, direction: Vec3, z: f32) -> f32 {
    let (level, share) = levels(lod, sampler.last());
    let mut at = |level: usize| sampler.around(level, direction, |texel| opacity(texel, z));
    let value = at(level);
    if share > 0.0 { value + (at(level + 1) - value) * share } else { value }
}
