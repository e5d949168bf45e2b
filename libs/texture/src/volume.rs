//! Volume shadow maps, which store opacity against depth per texel (reference 9.2.4).

/// The depth of empty texels (reference 9.2.4).
pub(crate) const EMPTY: f32 = 1e30;

/// Fills a texel. `curve` holds (depth, opacity) in order of depth, with opacity that never decreases. At a jump
/// both ends have the same depth. Between its points opacity grows linearly.
pub(crate) fn store(opaque: f32, curve: &[(f32, f32)], texel: &mut [f32]) {
    texel.fill(EMPTY);
    texel[0] = opaque;
    if texel.len() == 1 {
        return;
    }
    let alpha = curve.last().map_or(0.0, |c| c.1);
    texel[1] = alpha.max(0.0);
    if alpha.is_nan() || alpha <= 0.0 {
        return;
    }
    let steps = texel.len() - 3;
    // z_0 is the last depth without opacity. The others are the depths at which the curve reaches their share.
    for i in 0..=steps {
        let wanted = alpha * i as f32 / steps as f32;
        let after = curve.partition_point(|c| if i == 0 { c.1 <= 0.0 } else { c.1 < wanted - 1e-7 });
        let Some(&(z1, a1)) = curve.get(after) else { continue };
        texel[2 + i] = match after.checked_sub(1).map(|before| curve[before]) {
            Some((z0, _)) if i == 0 => z0,
            Some((z0, a0)) if a1 > a0 => z0 + (z1 - z0) * ((wanted - a0) / (a1 - a0)).clamp(0.0, 1.0),
            _ => z1,
        };
    }
    // Rounding must not make depths decrease, and no depth lies behind the opaque surface.
    for i in 2..texel.len() {
        let least = if i == 2 { f32::NEG_INFINITY } else { texel[i - 1] };
        texel[i] = texel[i].min(opaque).max(least);
    }
}

/// Returns the depth of the opaque surface that several texels share, and the least depth that belongs to it.
/// Depths within `opaque_width` of the farthest are one surface, at their mean. Nearer ones belong to the
/// transparent part.
pub(crate) fn common_surface(opaque: &[f32], opaque_width: f32) -> (f32, f32) {
    let farthest = opaque.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let least = farthest - opaque_width;
    let near = opaque.iter().filter(|z| **z >= least);
    let (sum, count) = near.fold((0.0_f64, 0.0_f64), |(sum, count), z| (sum + f64::from(*z), count + 1.0));
    let nearest = opaque.iter().copied().filter(|z| *z >= least).fold(farthest, f32::min);
    (((sum / count) as f32).clamp(nearest, farthest), least)
}

/// The samples of a pixel, which become a texel of a volume shadow map (reference 10.1.3).
///
/// ```
/// use granita_texture::VolumePixel;
/// // Of two samples one meets a surface of opacity 0.5 at depth 3, then an opaque one at 7; the other one only that.
/// let mut pixel = VolumePixel::default();
/// pixel.sample([(3.0, 0.5)], 7.0);
/// pixel.sample([], 7.02);
/// let mut texel = [0.0; 5];
/// pixel.finish(0.05, &mut texel);
/// assert_eq!(texel, [7.01, 0.25, 3.0, 3.0, 3.0]);
/// ```
#[derive(Clone, Debug, Default)]
pub struct VolumePixel {
    /// The depths and increases of opacity of all samples together.
    steps: Vec<(f32, f32)>,
    /// The depth of the opaque surface of each sample, and its opacity before.
    opaque: Vec<f32>,
    before: Vec<f32>,
    curve: Vec<(f32, f32)>,
}

impl VolumePixel {
    /// Adds a sample: depths with the increase of accumulated opacity at each (0 to 1 in total), and the depth at
    /// which the sample becomes opaque (infinite, or 1e30, if it never does).
    pub fn sample(&mut self, steps: impl IntoIterator<Item = (f32, f32)>, opaque: f32) {
        let first = self.steps.len();
        self.steps.extend(steps);
        self.before.push(self.steps[first..].iter().map(|s| s.1).sum::<f32>().min(1.0));
        self.opaque.push(opaque.min(EMPTY));
    }

    /// Computes the texel: z_opaque, alpha_trans, z_0 ... z_1 (at least four numbers). Its opacity at each depth is
    /// the mean of the samples'. Opaque depths that differ by no more than `opaque_width` are one surface. The
    /// pixel is then empty for reuse.
    pub fn finish(&mut self, opaque_width: f32, texel: &mut [f32]) {
        if self.opaque.is_empty() {
            return store(EMPTY, &[], texel);
        }
        let (opaque, least) = common_surface(&self.opaque, opaque_width);
        for (z, before) in self.opaque.iter().zip(&self.before) {
            if *z < least {
                self.steps.push((*z, 1.0 - before));
            }
        }
        self.steps.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let count = self.opaque.len() as f64;
        let (mut sum, mut last) = (0.0_f64, 0.0_f32);
        self.curve.clear();
        for (z, rise) in &self.steps {
            sum += f64::from(*rise);
            let now = ((sum / count) as f32).clamp(last, 1.0);
            self.curve.extend([(*z, last), (*z, now)]);
            last = now;
        }
        store(opaque, &self.curve, texel);
        self.steps.clear();
        self.opaque.clear();
        self.before.clear();
    }
}

/// Returns the opacity at depth `z` of a texel. `v` is z_opaque, alpha_trans, z_0 ... z_1 (at least four numbers).
///
/// Between the stored depths opacity grows linearly. At `z_opaque` it becomes 1.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_volume_texel_has_its_opacity_by_depth() {
        // The texel is opaque at 10. Its transparent part is 0.5 from 2 to 6, half of it at 3.
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

    #[test]
    fn a_volume_pixel_is_the_mean_of_its_samples() {
        let mut pixel = VolumePixel::default();
        let mut texel = [0.0; 6];
        // The pixel has no samples, and then a sample without surfaces.
        pixel.finish(0.05, &mut texel);
        assert_eq!(texel, [EMPTY, 0.0, EMPTY, EMPTY, EMPTY, EMPTY]);
        pixel.sample([], f32::INFINITY);
        pixel.finish(0.05, &mut texel);
        assert_eq!(texel, [EMPTY, 0.0, EMPTY, EMPTY, EMPTY, EMPTY]);
        // There is hair in front of a slanted wall, over two of four samples.
        for (hair, wall) in [(2.0_f32, 8.0), (3.0, 8.02), (8.04, 8.04), (8.06, 8.06)] {
            pixel.sample([], hair.min(wall));
        }
        pixel.finish(0.05, &mut texel);
        assert_eq!(texel, [8.05, 0.5, 2.0, 2.0, 3.0, 3.0]);
        for (z, a) in [(1.9, 0.0), (3.1, 0.5), (8.0, 0.5), (8.06, 1.0)] {
            assert_eq!(opacity(&texel, z), a, "{z}");
        }
    }

    #[test]
    fn thresholds_of_a_fog_are_at_its_depths_of_opacity() {
        // The layers of a fog of optical depth 2 lie from 1 to 5, with a separate offset for each sample. At optical
        // depth tau the opacity is `1 - exp (-tau)`.
        const N: usize = 400;
        let mut pixel = VolumePixel::default();
        for s in 0..16 {
            let mut clear = 1.0_f32;
            let layers: Vec<(f32, f32)> = (0..N)
                .map(|k| {
                    let z = 1.0 + 4.0 * (k as f32 + (s as f32 + 0.5) / 16.0) / N as f32;
                    let before = clear;
                    clear *= (-2.0 / N as f32).exp();
                    (z, before - clear)
                })
                .collect();
            pixel.sample(layers, f32::INFINITY);
        }
        let mut texel = [0.0; 2 + 33];
        pixel.finish(0.05, &mut texel);
        let exact = |z: f32| 1.0 - (-2.0 * (z - 1.0) / 4.0).exp();
        assert!((texel[1] - exact(5.0)).abs() < 1e-5, "{}", texel[1]);
        for k in 0..=80 {
            let z = 1.0 + 4.0 * k as f32 / 80.0;
            assert!((opacity(&texel, z) - exact(z)).abs() < 2e-3, "{z}: {}", opacity(&texel, z));
        }
        assert!(texel[2..].windows(2).all(|w| w[0] <= w[1]));
    }
}
