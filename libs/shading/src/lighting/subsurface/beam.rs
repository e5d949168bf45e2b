//! Diffusion of a beam that enters perpendicular to the surface. It is scattered along its whole path, and each
//! part of it has its own dipole (Habel, Christensen and Jarosz, Photon Beam Diffusion, Eurographics Symposium on
//! Rendering 2013, multiple scattering, with the diffusion coefficient of Grosjean and the boundary of d'Eon and
//! Irving that they use).
//!
//! Near the point of entry its profile is sharper than that of one dipole, and it is more accurate for materials
//! that absorb.

use super::{Each, Profiled, TOGETHER};
use granita_base::Color;
use granita_shade::approx;
use std::f64::consts::PI;

/// The radii of the table in mean free paths: [`RADII`] of them from the first, each larger by the factor.
const FIRST: f64 = 1e-3;
const FACTOR: f64 = 1.08;
/// The natural logarithm of [`FACTOR`].
const LN_FACTOR: f32 = 0.076_961_04;
const RADII: usize = 200;
/// The number of parts of the beam.
const PARTS: u32 = 64;

/// A material, as a table of the light that leaves at each distance.
#[derive(Clone, Debug)]
pub(crate) struct Beam {
    /// For each channel, the number of mean free paths per unit of length, and the logarithms of reflectances times
    /// the square of a mean free path.
    channels: [(f32, Vec<f32>); 3],
}

impl Beam {
    /// Makes a table from the reduced scattering and absorption coefficients per unit of length, and the index of
    /// refraction. Negative coefficients count as 0, an index below 1 as 1.
    pub(crate) fn new(scattering: Color, absorption: Color, eta: f32) -> Self {
        let moments = moments(f64::from(eta.clamp(1.0, 10.0)));
        let channel = |c: usize| {
            let (s, a) = (f64::from(scattering[c].max(0.0)), f64::from(absorption[c].max(0.0)));
            let extinction = s + a;
            if extinction.is_nan() || extinction <= 0.0 || s <= 0.0 {
                return (0.0, Vec::new());
            }
            // All lengths are in mean free paths.
            let albedo = s / extinction;
            let table = (0..RADII)
                .map(|k| albedo * reflected(FIRST * FACTOR.powi(k as i32), albedo, moments))
                .map(|r| libm::log(r.max(1e-37)) as f32)
                .collect();
            (extinction as f32, table)
        };
        Self { channels: std::array::from_fn(channel) }
    }
}

/// The beams of points that are gathered together, channel by channel.
pub(super) struct Beams<'b> {
    /// The numbers of mean free paths per unit of length; 0 for points without light.
    scale: [Each; 3],
    /// The logarithms of the reflectances.
    tables: [[&'b [f32]; TOGETHER]; 3],
}

impl<'b> Beams<'b> {
    pub(super) fn new(beams: &[&'b Beam]) -> Self {
        let mut all = Self { scale: [[0.0; TOGETHER]; 3], tables: [[&[0.0; RADII]; TOGETHER]; 3] };
        for (k, beam) in beams.iter().enumerate() {
            for (c, (scale, table)) in beam.channels.iter().enumerate().filter(|(_, (_, t))| !t.is_empty()) {
                (all.scale[c][k], all.tables[c][k]) = (*scale, table);
            }
        }
        all
    }
}

impl Profiled for Beams<'_> {
    #[inline(always)]
    fn channel(&self, c: usize, squared: &Each) -> Each {
        let (scale, tables) = (&self.scale[c], &self.tables[c]);
        let (mut at, mut below, mut logs, mut out) =
            ([0.0_f32; TOGETHER], [0.0; TOGETHER], [[0.0; TOGETHER]; 2], [0.0; TOGETHER]);
        for k in 0..TOGETHER {
            let radius = (squared[k].sqrt() * scale[k]).max(FIRST as f32);
            // A finite number has a logarithm that vectorises.
            at[k] = approx::ln_ordinary((radius / FIRST as f32).min(f32::MAX)) / LN_FACTOR;
        }
        for k in 0..TOGETHER {
            let first = (at[k] as usize).min(RADII - 2);
            below[k] = first as f32;
            logs[0][k] = tables[k][first];
            logs[1][k] = tables[k][first + 1];
        }
        for k in 0..TOGETHER {
            // Logarithms are above -86. The factors are multiplied one by one, because the square may overflow.
            let log = logs[0][k] + (logs[1][k] - logs[0][k]) * (at[k] - below[k]);
            let leaving = (approx::exp_near(log) * scale[k] * scale[k]).min(f32::MAX);
            out[k] = if at[k] < (RADII - 1) as f32 { leaving } else { 0.0 };
        }
        out
    }
}

/// Returns the reflectance of the inside of a surface for light of all directions, as the integrals of `F mu` and
/// `F mu^2` over the cosine.
fn moments(eta: f64) -> [f64; 2] {
    let mut sums = [0.0; 2];
    let n = 400;
    for i in 0..n {
        let inside = (f64::from(i) + 0.5) / f64::from(n);
        let sin = eta * (1.0 - inside * inside).sqrt();
        let fresnel = if sin >= 1.0 {
            1.0
        } else {
            let outside = (1.0 - sin * sin).sqrt();
            let s = (eta * inside - outside) / (eta * inside + outside);
            let p = (inside - eta * outside) / (inside + eta * outside);
            0.5 * (s * s + p * p)
        };
        sums[0] += fresnel * inside / f64::from(n);
        sums[1] += fresnel * inside * inside / f64::from(n);
    }
    sums
}

/// Returns the light that leaves at a radius, per area, relative to the light that enters. Lengths are in mean free
/// paths, with one scattering per free path.
fn reflected(radius: f64, albedo: f64, [first, second]: [f64; 2]) -> f64 {
    let absorbed = 1.0 - albedo;
    let diffusion = (2.0 * absorbed + albedo) / 3.0;
    let transport = (absorbed / diffusion).sqrt();
    let boundary = 2.0 * diffusion * (1.0 + 3.0 * second) / (1.0 - 2.0 * first);
    let (fluence, flux) = (0.25 * (1.0 - 2.0 * first), 0.5 * (1.0 - 3.0 * second));
    let part = |i: u32| {
        // The parts have equal weight under exp (-depth).
        let real = -libm::log(1.0 - (f64::from(i) + 0.5) / f64::from(PARTS));
        let mirrored = real + 2.0 * boundary;
        let (a, b) = (libm::hypot(radius, real), libm::hypot(radius, mirrored));
        let (ea, eb) = (libm::exp(-transport * a), libm::exp(-transport * b));
        let phi = (ea / a - eb / b) / (4.0 * PI * diffusion);
        let down = real * (1.0 + transport * a) * ea / (a * a * a);
        let up = mirrored * (1.0 + transport * b) * eb / (b * b * b);
        let leaving = fluence * phi + flux * (down + up) / (4.0 * PI);
        // This factor reduces the contribution close to the beam, where diffusion overestimates it.
        leaving * (1.0 - libm::exp(-2.0 * (a + real)))
    };
    albedo * (0..PARTS).map(part).sum::<f64>() / f64::from(PARTS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::Vec3;

    impl Beam {
        /// Returns the share of the light of the first channel that leaves again per area.
        fn first(&self, squared: f32) -> f32 {
            Beams::new(&[self]).channel(0, &[squared; TOGETHER])[0]
        }
    }

    #[test]
    fn radii_are_a_geometric_series() {
        assert_eq!(LN_FACTOR, FACTOR.ln() as f32);
    }

    fn total(profile: &Beam) -> f64 {
        let (mut sum, mut inner, mut radius) = (0.0_f64, 0.0_f64, 1e-4_f64);
        while radius < 5e3 {
            let middle = 0.5 * (inner + radius);
            sum +=
                f64::from(profile.first((middle * middle) as f32)) * PI * (radius * radius - inner * inner);
            inner = radius;
            radius *= 1.01;
        }
        sum
    }

    #[test]
    fn the_internal_reflectance_equals_fresnel() {
        // Twice the first moment is the mean reflectance: 0.596 for glass, and 0 for an index of 1.
        let [first, _] = moments(1.5);
        assert!((2.0 * first - 0.596).abs() < 2e-3, "{first}");
        assert!(moments(1.0).iter().all(|m| m.abs() < 1e-9));
    }

    #[test]
    fn the_beam_profile_reflects_at_most_all_light() {
        let mut before = 0.0;
        for albedo in [0.1_f32, 0.3, 0.5, 0.7, 0.9, 0.99, 0.999] {
            let whole = total(&Beam::new(Vec3::splat(albedo), Vec3::splat(1.0 - albedo), 1.3));
            assert!(whole > before && whole <= 1.0, "{albedo}: {whole}");
            before = whole;
        }
        assert!(before > 0.8, "{before}");
    }

    #[test]
    fn the_profile_table_equals_the_formula() {
        let beam = Beam::new(Vec3::splat(2.0), Vec3::splat(0.5), 1.4);
        let m = moments(1.4);
        for radius in [0.01, 0.07, 0.33, 1.0, 2.7, 6.0_f64] {
            let due = 0.8 * reflected(radius * 2.5, 0.8, m) * 2.5 * 2.5;
            let got = f64::from(beam.first((radius * radius) as f32));
            assert!((got / due - 1.0).abs() < 5e-3, "{radius}: {got} {due}");
        }
    }

    #[test]
    fn the_profile_scales_with_length() {
        let fine = Beam::new(Vec3::splat(20.0), Vec3::splat(5.0), 1.4).first(0.01);
        let coarse = Beam::new(Vec3::splat(2.0), Vec3::splat(0.5), 1.4).first(1.0);
        assert!((fine / coarse / 100.0 - 1.0).abs() < 1e-3);
    }
}
