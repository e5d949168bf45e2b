//! Volume shadow maps: opacity against depth, per texel (reference 9.2.4).

use crate::sampler::{Sampler, cell, levels};

/// Opacity at depth `z` of a texel: `v` is z_opaque, alpha_trans, z_0 ... z_1 (at least four numbers).
///
/// Between the stored depths opacity grows linearly; at `z_opaque` it becomes 1.
pub(crate) fn opacity(v: &[f32], z: f32) -> f32 {
    let (opaque, alpha, depths) = (v[0], v[1], &v[2..]);
    if z > opaque {
        return 1.0;
    }
    if alpha <= 0.0 || z.is_nan() || z <= depths[0] {
        return 0.0;
    }
    let steps = (depths.len() - 1) as f32;
    for (i, pair) in depths.windows(2).enumerate() {
        if z < pair[1] {
            let part = if pair[1] > pair[0] { (z - pair[0]) / (pair[1] - pair[0]) } else { 1.0 };
            return (alpha * (i as f32 + part) / steps).clamp(0.0, 1.0);
        }
    }
    alpha.min(1.0)
}

/// Opacity of the map at (s, t) in front of depth `z`, trilinear; 0 outside the map.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opacity_of_a_texel() {
        // Opaque at 10; transparent part 0.5 from 2 to 6, half of it at 3.
        let v = [10.0, 0.5, 2.0, 3.0, 6.0];
        for (z, a) in
            [(0.0, 0.0), (2.0, 0.0), (2.5, 0.125), (3.0, 0.25), (4.5, 0.375), (6.0, 0.5), (9.0, 0.5)]
        {
            assert!((opacity(&v, z) - a).abs() < 1e-6, "{z}");
        }
        assert_eq!(opacity(&v, 10.5), 1.0);
        assert_eq!(opacity(&v, f32::NAN), 0.0);
        assert_eq!(opacity(&[1e30, 0.0, 1e30, 1e30], 5.0), 0.0);
        assert_eq!(opacity(&[1e30, 1.0, 3.0, 3.0], 3.5), 1.0);
    }
}
