//! Sampling of directions within cones.

use granita_base::sample::{self, Sequence};
use granita_base::{Vec3, hash};
use granita_shade::approx;
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// The distribution of directions in a cone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Distribution {
    /// The pdf is proportional to the cosine of the angle to the axis.
    Cosine,
    /// The pdf is constant.
    Uniform,
}

impl Distribution {
    /// Returns the distribution that a shader names. Any word except "uniform" gives the default, "cosine".
    pub fn from_word(word: &str) -> Self {
        if word == "uniform" { Self::Uniform } else { Self::Cosine }
    }
}

/// Returns two unit vectors perpendicular to a unit vector and to each other (Duff et al., Building an Orthonormal
/// Basis, Revisited, JCGT 6(1), 2017).
pub fn basis(n: Vec3) -> (Vec3, Vec3) {
    let sign = 1.0_f32.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), Vec3::new(b, sign + n.y * n.y * a, -n.y))
}

/// Returns a unit direction within `half_angle` (radians) of the unit vector `axis`. `index` is that of one of `of`
/// samples of a sequence. The result is the axis itself when the angle is 0.
///
/// A cosine distribution covers at most the hemisphere.
pub fn in_cone(
    axis: Vec3,
    half_angle: f32,
    distribution: Distribution,
    [index, of]: [u32; 2],
    sequence: Sequence,
) -> Vec3 {
    if half_angle.is_nan() || half_angle <= 0.0 {
        return axis;
    }
    let (x, y) = sequence.square(index, of);
    let cos = match distribution {
        Distribution::Cosine => {
            let sin = approx::sin(half_angle.min(FRAC_PI_2));
            (1.0 - x * sin * sin).max(0.0).sqrt()
        }
        Distribution::Uniform => 1.0 - x * (1.0 - approx::cos(half_angle.min(PI))),
    };
    let sin = (1.0 - cos * cos).max(0.0).sqrt();
    let turn = y * TAU;
    let (u, v) = basis(axis);
    (u * (sin * approx::cos(turn)) + v * (sin * approx::sin(turn)) + axis * cos).normalize_or(axis)
}

/// The division of a cone around an axis into cells of equal weight: rings from the axis to the boundary, which have
/// the same number of sectors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConeCells {
    /// The number of rings.
    pub rings: u32,
    /// The number of sectors of each ring.
    pub sectors: u32,
    /// The sine of the cone's half angle, for cells that are weighted by the cosine.
    pub sin: f32,
    /// The half angle of a cone whose cells have equal solid angles, in radians. It may be wider than the
    /// hemisphere. `None` when cells are weighted by the cosine.
    pub uniform: Option<f32>,
}

impl ConeCells {
    /// Divides a cone into at most `samples` cells (at least one) of equal weight, by the cosine with the axis or
    /// by solid angle. `half_angle` is in radians. With cosines it is at most a right angle.
    pub fn new(samples: u32, half_angle: f32, cosine: bool) -> Self {
        let samples = samples.max(1);
        let rings = ((samples as f32 / PI).sqrt() as u32).max(1);
        let sin = approx::sin_near(half_angle.clamp(0.0, FRAC_PI_2));
        let uniform = (!cosine).then(|| half_angle.clamp(0.0, PI));
        Self { rings, sectors: (samples / rings).max(1), sin, uniform }
    }

    /// Returns the number of cells.
    pub fn count(&self) -> u32 {
        self.rings * self.sectors
    }

    /// True when all directions are the axis.
    pub fn is_narrow(&self) -> bool {
        let wide = self.uniform.unwrap_or(self.sin);
        wide.is_nan() || wide <= 0.0
    }

    /// The cosine of the half angle of a cone whose cells have equal solid angles; 0 for others.
    pub fn narrowest(&self) -> f32 {
        self.uniform.map_or(0.0, approx::cos_near)
    }

    /// Passes a direction in each cell (ring by ring) around a unit axis to `tell`. Directions are jittered so that
    /// rings and sectors are also filled evenly (Kensler, Correlated Multi-Jittered Sampling, 2013). Directions of
    /// further rounds fill each cell evenly.
    pub fn directions(&self, axis: Vec3, sequence: Sequence, tell: &mut dyn FnMut(u32, Vec3)) {
        if self.is_narrow() {
            return (0..self.count()).for_each(|index| tell(index, axis));
        }
        let (u, v) = basis(axis);
        let narrowest = self.narrowest();
        let (rings, sectors) = (self.rings as f32, self.sectors as f32);
        let Sequence { seed, .. } = sequence;
        let permuted = |n: u32, dimension: u32| -> Vec<u32> {
            let seed = hash::words(&[seed, dimension]);
            (0..n).map(|k| sample::permute(k, n, seed)).collect()
        };
        let (across, around) = (permuted(self.sectors, 1), permuted(self.rings, 2));
        let part = |k: u32, of: f32, index: u32, dimension: u32| {
            let jitter = hash::unit(hash::words(&[seed, index, dimension]));
            (k as f32 + jitter) / of
        };
        for ring in 0..self.rings {
            for sector in 0..self.sectors {
                let index = ring * self.sectors + sector;
                let x = part(across[sector as usize], sectors, index, 3);
                let y = part(around[ring as usize], rings, index, 4);
                let [x, y] = sequence.moved([x, y]);
                let (x, y) = ((ring as f32 + x) / rings, (sector as f32 + y) / sectors);
                let (sin, cos) = if self.uniform.is_some() {
                    let cos = 1.0 - x * (1.0 - narrowest);
                    ((1.0 - cos * cos).max(0.0).sqrt(), cos)
                } else {
                    let sin = self.sin * x.sqrt();
                    (sin, (1.0 - sin * sin).max(0.0).sqrt())
                };
                // The polynomials of shaders are the same on every machine. Those of the system's library are not.
                let turn = y * TAU;
                let (s, c) = (approx::sin_near(turn), approx::cos_near(turn));
                tell(index, (u * (sin * c) + v * (sin * s) + axis * cos).normalize_or(axis));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bases_are_orthonormal() {
        for n in [Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y, Vec3::Z, -Vec3::Z, Vec3::new(0.6, 0.0, -0.8)] {
            let (u, v) = basis(n);
            assert!(u.dot(v).abs() < 1e-6 && u.dot(n).abs() < 1e-6 && v.dot(n).abs() < 1e-6);
            assert!((u.length() - 1.0).abs() < 1e-6 && (v.length() - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn sampled_directions_have_the_mean_of_their_distribution() {
        let n = 4096;
        let mean = |d: Distribution, angle: f32| {
            (0..n).map(|i| in_cone(Vec3::Y, angle, d, [i, n], Sequence::new(7)).y).sum::<f32>() / n as f32
        };
        // E[cos] is 2/3 for a hemisphere with a cosine distribution, 1/2 for a uniform hemisphere, and 0 for the full
        // sphere.
        assert!((mean(Distribution::Cosine, std::f32::consts::FRAC_PI_2) - 2.0 / 3.0).abs() < 1e-3);
        assert!((mean(Distribution::Uniform, std::f32::consts::FRAC_PI_2) - 0.5).abs() < 1e-3);
        assert!(mean(Distribution::Uniform, std::f32::consts::PI).abs() < 1e-3);
    }

    #[test]
    fn sampled_directions_stay_in_their_cone() {
        for i in 0..256 {
            for d in [Distribution::Cosine, Distribution::Uniform] {
                let v = in_cone(-Vec3::Z, 0.3, d, [i, 1], Sequence::new(1));
                assert!(v.dot(-Vec3::Z).clamp(-1.0, 1.0).acos() < 0.3 + 1e-3);
            }
        }
        assert_eq!(in_cone(Vec3::X, 0.0, Distribution::Cosine, [3, 4], Sequence::new(1)), Vec3::X);
        assert_eq!(in_cone(Vec3::X, f32::NAN, Distribution::Cosine, [3, 4], Sequence::new(1)), Vec3::X);
    }
}
