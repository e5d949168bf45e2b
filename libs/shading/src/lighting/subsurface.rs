//! Subsurface scattering by the dipole diffusion model (Jensen, Marschner, Levoy and Hanrahan, A Practical Model
//! for Subsurface Light Transport, SIGGRAPH 2001), gathered hierarchically (Jensen and Buhler, A Rapid Hierarchical
//! Rendering Technique for Translucent Materials, SIGGRAPH 2002).

mod beam;

use beam::Beam;
use granita_base::{Color, Vec3};
use granita_machine::widest;
use granita_sdb::{Cluster, Clusters, Packed};
use granita_shade::approx;
use std::f32::consts::PI;

/// The number of places whose light is computed together.
const TOGETHER: usize = 32;

/// The diffusion profile of a material: how light that enters at one place leaves at others.
#[derive(Clone, Debug)]
pub(crate) enum Profile {
    /// The dipole model of the reference.
    Dipole(Dipole),
    /// The model of a beam that is scattered along its whole path.
    Beam(Box<Beam>),
}

impl Profile {
    /// Stores the light that leaves per area, relative to the light that enters at distances whose squares are given:
    /// for each channel that of all distances.
    fn reflectances(&self, squared: &[f32; TOGETHER], out: &mut [[f32; TOGETHER]; 3]) {
        match self {
            // Vector code gives the same results.
            Self::Dipole(dipole) => widest!({
                for (c, out) in out.iter_mut().enumerate() {
                    dipole.channel(c, squared, out);
                }
            }),
            Self::Beam(beam) => {
                for (k, squared) in squared.iter().enumerate() {
                    let light = beam.reflectance(*squared).to_array();
                    out.iter_mut().zip(light).for_each(|(out, light)| out[k] = light);
                }
            }
        }
    }

    /// Returns all light that leaves at `p`. The database holds light times area at the places where it enters.
    /// Boxes that subtend at most `max_solid_angle` (steradians) count as one place.
    pub(crate) fn gather(
        &self,
        records: &Packed,
        clusters: &Clusters,
        p: Vec3,
        max_solid_angle: f32,
    ) -> Color {
        let mut sum = Vec3::ZERO;
        // The square of the diagonal is twice the area of a flat square. The distance is measured to the nearest
        // side, so that boxes beside the point are opened where the profile is steep.
        let opens =
            |c: &Cluster| c.diagonal_squared > max_solid_angle.max(0.0) * c.distance_squared(p.to_array());
        let mut squared = [0.0; TOGETHER];
        let mut lights = [Vec3::ZERO; TOGETHER];
        let mut leaving = [[0.0; TOGETHER]; 3];
        let mut add = |squared: &[f32; TOGETHER], lights: &[Vec3]| {
            self.reflectances(squared, &mut leaving);
            for (k, light) in lights.iter().enumerate() {
                sum += Vec3::from_array(leaving.map(|channel| channel[k])) * *light;
            }
        };
        let mut count = 0;
        clusters.gather(records, &opens, &mut |at, light| {
            squared[count] = p.distance_squared(Vec3::from_array(at));
            lights[count] = Vec3::from_array(light);
            count += 1;
            if count == TOGETHER {
                add(&squared, &lights);
                count = 0;
            }
        });
        add(&squared, &lights[..count]);
        sum
    }
}

/// The profiles of a call. Neighbouring points are mostly of one material.
#[derive(Debug, Default)]
pub(crate) struct Profiles {
    last: Option<([u32; 7], Profile)>,
}

impl Profiles {
    /// Returns a profile by the word of the option "model": the beam model for "beam", otherwise the dipole.
    pub(crate) fn get(&mut self, model: &str, scattering: Color, absorption: Color, eta: f32) -> &Profile {
        let [a, b, c] = scattering.to_array();
        let [d, e, f] = absorption.to_array();
        let key = [a, b, c, d, e, f, eta].map(f32::to_bits);
        let known = self.last.take().filter(|(k, _)| *k == key);
        let made = known.unwrap_or_else(|| {
            let profile = match model {
                "beam" => Profile::Beam(Box::new(Beam::new(scattering, absorption, eta))),
                _ => Profile::Dipole(Dipole::new(scattering, absorption, eta)),
            };
            (key, profile)
        });
        &self.last.insert(made).1
    }
}

/// The dipole profile of a material, per channel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Dipole {
    /// The share of light that is scattered, not absorbed.
    albedo: Vec3,
    /// The effective transport coefficient, per unit of length.
    transport: Vec3,
    /// The depth of the real pole.
    real: Vec3,
    /// The height of the virtual pole.
    mirrored: Vec3,
}

impl Dipole {
    /// Makes a profile from the reduced scattering and absorption coefficients per unit of length, and the index of
    /// refraction. Negative coefficients count as 0, an index below 1 as 1.
    pub(crate) fn new(scattering: Color, absorption: Color, eta: f32) -> Self {
        let (scattering, absorption) = (scattering.max(Vec3::ZERO), absorption.max(Vec3::ZERO));
        let extinction = (scattering + absorption).max(Vec3::splat(1e-12));
        let eta = eta.max(1.0);
        // The mean reflection at the inside of the surface (Egan and Hilgeman's fit, as cited there).
        let inside = -1.440 / (eta * eta) + 0.710 / eta + 0.668 + 0.0636 * eta;
        let mismatch = (1.0 + inside) / (1.0 - inside);
        let real = extinction.recip();
        Self {
            albedo: scattering / extinction,
            // The roots are taken one by one, because the product may overflow.
            transport: (3.0 * absorption).map(f32::sqrt) * extinction.map(f32::sqrt),
            real,
            mirrored: real * (1.0 + 4.0 / 3.0 * mismatch),
        }
    }

    /// Stores the share of the light of a channel that leaves again per area, at distances from its entry whose squares
    /// are given.
    #[inline(always)]
    fn channel(&self, c: usize, squared: &[f32], out: &mut [f32]) {
        let transport = self.transport[c];
        let pole = |depth: f32, squared: f32| {
            // The lower bound keeps the square from underflowing.
            let way = (depth * depth + squared).sqrt().max(1e-15);
            let optical = transport * way;
            // Beyond, nothing is left.
            let fall = if optical < 87.0 { approx::exp_near(-optical) } else { 0.0 };
            depth / way * (1.0 + optical) * fall / (way * way)
        };
        let (real, mirrored, scale) = (self.real[c], self.mirrored[c], self.albedo[c] / (4.0 * PI));
        for (out, squared) in out.iter_mut().zip(squared) {
            *out = (pole(real, *squared) + pole(mirrored, *squared)) * scale;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_sdb::{Key, Schema, Value};

    impl Profile {
        /// Returns the light that leaves at a distance whose square is given.
        fn reflectance(&self, squared: f32) -> Color {
            let mut out = [[0.0; TOGETHER]; 3];
            self.reflectances(&[squared; TOGETHER], &mut out);
            Vec3::from_array(out.map(|channel| channel[TOGETHER - 1]))
        }
    }

    impl Dipole {
        fn reflectance(self, squared: f32) -> Color {
            Profile::Dipole(self).reflectance(squared)
        }
    }

    /// Returns the total light that leaves in closed form (the paper's section 4.1 gives it for the diffuse
    /// albedo).
    fn total(scattering: f64, absorption: f64, eta: f64) -> f64 {
        let albedo = scattering / (scattering + absorption);
        let inside = -1.440 / (eta * eta) + 0.710 / eta + 0.668 + 0.0636 * eta;
        let mismatch = (1.0 + inside) / (1.0 - inside);
        let root = (3.0 * (1.0 - albedo)).sqrt();
        0.5 * albedo * (1.0 + (-4.0 / 3.0 * mismatch * root).exp()) * (-root).exp()
    }

    #[test]
    fn the_profile_integrates_to_the_closed_form() {
        for (scattering, absorption) in [(2.19, 0.0021), (1.0, 1.0), (0.7, 6.3), (0.999, 0.001), (10.0, 0.5)]
        {
            for eta in [1.0, 1.3, 1.5] {
                let dipole =
                    Dipole::new(Vec3::splat(scattering as f32), Vec3::splat(absorption as f32), eta as f32);
                // Rings of a geometric series of radii.
                let (mut sum, mut inner) = (0.0_f64, 0.0_f64);
                let mut radius = 1e-4_f64;
                while radius < 3e3 {
                    let middle = 0.5 * (inner + radius);
                    let value = f64::from(dipole.reflectance((middle * middle) as f32).x);
                    sum += value * std::f64::consts::PI * (radius * radius - inner * inner);
                    inner = radius;
                    radius *= 1.005;
                }
                let due = total(scattering, absorption, eta);
                assert!((sum / due - 1.0).abs() < 5e-3, "{scattering} {absorption} {eta}: {sum} {due}");
                assert!(sum <= 1.0);
            }
        }
    }

    /// An evenly lit plane in a database gathers to the closed form, more exactly for smaller angles.
    #[test]
    fn an_evenly_lit_plane_reflects_its_albedo() {
        let schema = Schema { key: Key::Oriented, value: Value::Color };
        let (step, half) = (0.1_f32, 120);
        let record = |i: i32, j: i32| {
            let (x, y, area) = (i as f32 * step, j as f32 * step, step * step);
            [x, y, 0.0, 0.0, 0.0, 1.0, area, area, 0.5 * area]
        };
        let records: Vec<f32> =
            (-half..=half).flat_map(|i| (-half..=half).flat_map(move |j| record(i, j))).collect();
        let packed = Packed::new(schema, &records);
        let clusters = Clusters::new(&packed);
        let dipole = Profile::Dipole(Dipole::new(Vec3::splat(2.0), Vec3::splat(0.5), 1.3));
        let due = total(2.0, 0.5, 1.3) as f32;
        let p = Vec3::new(0.03, 0.04, 0.0);
        for (angle, within) in [(0.01, 0.005), (0.1, 0.01), (1.0, 0.06)] {
            let got = dipole.gather(&packed, &clusters, p, angle);
            assert!((got.x / due - 1.0).abs() < within, "{angle}: {got} {due}");
            assert!((got.z / got.x - 0.5).abs() < 1e-4);
        }
    }

    #[test]
    fn the_total_reflectance_grows_with_albedo_and_stays_below_one() {
        let mut before = 0.0;
        for albedo in [0.1, 0.3, 0.5, 0.7, 0.9, 0.95, 0.99, 0.999] {
            let dipole = Dipole::new(Vec3::splat(albedo), Vec3::splat(1.0 - albedo), 1.3);
            let (mut sum, mut inner, mut radius) = (0.0_f64, 0.0_f64, 1e-4_f64);
            while radius < 1e4 {
                let middle = 0.5 * (inner + radius);
                sum += f64::from(dipole.reflectance((middle * middle) as f32).x)
                    * std::f64::consts::PI
                    * (radius * radius - inner * inner);
                inner = radius;
                radius *= 1.005;
            }
            assert!((sum / total(f64::from(albedo), 1.0 - f64::from(albedo), 1.3) - 1.0).abs() < 5e-3);
            assert!(sum > before && sum <= 1.0, "{albedo}: {sum}");
            before = sum;
        }
    }

    #[test]
    fn profiles_are_reused_for_the_same_material() {
        let mut profiles = Profiles::default();
        let one = profiles.get("beam", Vec3::ONE, Vec3::splat(0.1), 1.3).reflectance(0.5);
        assert_eq!(profiles.get("beam", Vec3::ONE, Vec3::splat(0.1), 1.3).reflectance(0.5), one);
        assert_ne!(profiles.get("beam", Vec3::ONE, Vec3::splat(0.2), 1.3).reflectance(0.5), one);
    }

    #[test]
    fn invalid_materials_give_finite_profiles() {
        for scattering in [-1.0, 0.0, 1e-20, 1e20] {
            for absorption in [-1.0, 0.0, 1e-20, 1e20] {
                for eta in [0.0, 1.0, 3.0] {
                    let dipole = Dipole::new(Vec3::splat(scattering), Vec3::splat(absorption), eta);
                    let beam = Beam::new(Vec3::splat(scattering), Vec3::splat(absorption), eta);
                    for squared in [0.0, 1e-10, 1.0, 1e10] {
                        let r = dipole.reflectance(squared);
                        assert!(r.x >= 0.0, "{scattering} {absorption} {eta} {squared}: {r}");
                        let r = beam.reflectance(squared);
                        assert!(r.x >= 0.0, "beam {scattering} {absorption} {eta} {squared}: {r}");
                    }
                }
            }
        }
    }
}
