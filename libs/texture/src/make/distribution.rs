//! Tables that map the values of a channel to a Gaussian distribution and back, for blending by histograms.

use super::flat::Distribution;
use crate::image::Image;
use granita_base::{BaseType, Param, ParamData, ParamType, Params};

/// Returns the inverse of the error function, by bisection.
fn inverse_erf(y: f64) -> f64 {
    // Behind this the Gaussian is 1 in single precision.
    let y = y.clamp(-0.999_999_94, 0.999_999_94);
    let (mut low, mut high) = (-6.0, 6.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if libm::erf(middle) < y {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// Returns the two tables of a channel: from values to the Gaussian, and from the Gaussian to values.
fn tables(image: &Image, channel: usize, distribution: &Distribution) -> (Vec<f32>, Vec<f32>) {
    let bins = 1_usize << distribution.bits;
    let mut counts = vec![0_u64; bins];
    for texel in image.data.chunks_exact(image.channels) {
        counts[((texel[channel].clamp(0.0, 1.0) * bins as f32) as usize).min(bins - 1)] += 1;
    }
    for i in 1..bins {
        counts[i] += counts[i - 1];
    }
    let sigma = f64::from(distribution.sigma);
    let cut = libm::erf(1.0 / (2.0 * std::f64::consts::SQRT_2 * sigma));
    let all = counts[bins - 1].max(1) as f64;
    let to_gaussian: Vec<f32> = counts
        .iter()
        .map(|count| {
            let u = *count as f64 / all;
            let g = 0.5 + sigma * std::f64::consts::SQRT_2 * inverse_erf(cut * (2.0 * u - 1.0));
            g.clamp(0.0, 1.0) as f32
        })
        .collect();
    let last = (bins - 1) as f32;
    let to_values = (0..bins)
        .map(|i| {
            let above = to_gaussian.partition_point(|g| *g <= i as f32 / last);
            (above as f32 / last).clamp(0.0, 1.0)
        })
        .collect();
    (to_gaussian, to_values)
}

/// Returns the tables of the first channels as metadata.
pub(crate) fn metadata(image: &Image, channels: usize, distribution: &Distribution) -> Params {
    let mut out = Params::new();
    for c in 0..channels.min(image.channels) {
        let (to_gaussian, to_values) = tables(image, c, distribution);
        for (name, table) in [("invCDF", to_gaussian), ("CDF", to_values)] {
            let ty = ParamType::array(BaseType::Float, table.len() as u32);
            let name = format!("{name}_{c}");
            out.set(Param { name: name.as_str().into(), ty, data: ParamData::from(&table[..]) });
        }
    }
    let bits = ParamData::from(distribution.bits as i32);
    out.set(Param { name: "CDF_bits".into(), ty: ParamType::of(BaseType::Int), data: bits });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_function_is_inverted() {
        for x in [-2.5, -1.0, -0.1, 0.0, 0.3, 1.7] {
            assert!((inverse_erf(libm::erf(x)) - x).abs() < 1e-9, "{x}");
        }
    }

    /// A ramp has a uniform distribution, so that its table is the Gaussian's own.
    #[test]
    fn tables_grow_and_invert_each_other() {
        let data = (0..1024).map(|i| (i as f32 + 0.5) / 1024.0).collect();
        let ramp = Image { width: 1024, height: 1, channels: 1, data };
        let (to_gaussian, to_values) = tables(&ramp, 0, &Distribution { sigma: 1.0 / 6.0, bits: 8 });
        assert!(to_gaussian.is_sorted() && to_values.is_sorted());
        assert!((to_gaussian[127] - 0.5).abs() < 1e-6);
        for (i, g) in to_gaussian.iter().enumerate() {
            let back = to_values[(g * 255.0) as usize] * 255.0;
            assert!((back - i as f32).abs() <= 4.0, "{i}: {g} {back}");
        }
        assert_eq!(metadata(&ramp, 4, &Distribution { sigma: 0.2, bits: 4 }).0.len(), 3);
    }
}
