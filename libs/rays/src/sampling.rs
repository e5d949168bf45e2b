//! Sampling of directions within cones.

use granita_base::{Vec3, sample};

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

/// Returns a unit direction within `half_angle` (radians) of the unit vector `axis`. `index` is that of a sample in
/// the sequence of `seed`. The result is the axis itself when the angle is 0.
///
/// A cosine distribution covers at most the hemisphere.
pub fn in_cone(axis: Vec3, half_angle: f32, distribution: Distribution, index: u32, seed: u32) -> Vec3 {
    if half_angle.is_nan() || half_angle <= 0.0 {
        return axis;
    }
    let (x, y) = sample::square(index, seed);
    let cos = match distribution {
        Distribution::Cosine => {
            let sin = half_angle.min(std::f32::consts::FRAC_PI_2).sin();
            (1.0 - x * sin * sin).max(0.0).sqrt()
        }
        Distribution::Uniform => 1.0 - x * (1.0 - half_angle.min(std::f32::consts::PI).cos()),
    };
    let sin = (1.0 - cos * cos).max(0.0).sqrt();
    let turn = y * std::f32::consts::TAU;
    let (u, v) = basis(axis);
    (u * (sin * turn.cos()) + v * (sin * turn.sin()) + axis * cos).normalize_or(axis)
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
            (0..n).map(|i| in_cone(Vec3::Y, angle, d, i, 7).y).sum::<f32>() / n as f32
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
                let v = in_cone(-Vec3::Z, 0.3, d, i, 1);
                assert!(v.dot(-Vec3::Z).clamp(-1.0, 1.0).acos() < 0.3 + 1e-3);
            }
        }
        assert_eq!(in_cone(Vec3::X, 0.0, Distribution::Cosine, 3, 1), Vec3::X);
        assert_eq!(in_cone(Vec3::X, f32::NAN, Distribution::Cosine, 3, 1), Vec3::X);
    }
}
